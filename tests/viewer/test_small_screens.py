"""Both pages on displays of many sizes: nothing is cut off or overlaps, and the page tells what is too small."""

import re

import numpy as np
import pytest
from test_drive_page import BEGIN, CLOCK, HIDDEN, LOOK, VEHICLE, Screen
from test_live_page import Feeder, alarm, scan

from flgpr.live.events import view_event

pytestmark = pytest.mark.slow("a browser draws every page")

CUT = """() => [...document.querySelectorAll('#drive *, #state *')]
    .filter((e) => e.checkVisibility() && e.textContent && !e.children.length)
    .map((e) => {
        const range = document.createRange();
        range.selectNodeContents(e);
        const words = range.getBoundingClientRect(), own = e.closest('button, div, section').getBoundingClientRect();
        const inside = words.left >= own.left && words.right <= own.right && words.top >= 0
            && words.right <= innerWidth && words.bottom <= innerHeight;
        return inside ? '' : e.id;
    }).filter((name) => name)"""
"""Names of what is written beyond the edges of its button, its panel or the window."""

PARTED = """() => ['drive-how', 'drive-where', 'drive-aside'].filter((id) => {
    const text = document.getElementById(id).firstChild;
    return [...(text?.data ?? '').matchAll(/\\d\\s\\S+/g)].some(({ index, 0: words }) => {
        const range = document.createRange();
        range.setStart(text, index);
        range.setEnd(text, index + words.length);
        return range.getClientRects().length > 1;
    });
})"""
"""Names of where a line ends between a number and its unit."""

OVERLAPS = """() => {
    const boxes = (list) => [...list].filter((e) => e.checkVisibility()).map((e) => [e, e.getBoundingClientRect()])
        .filter(([, box]) => box.width > 1 && box.height > 1);
    const pairs = (list) => boxes(list).flatMap(([a, p], i) => boxes(list).slice(i + 1)
        .filter(([, q]) => Math.min(p.right, q.right) - Math.max(p.left, q.left) > 1
            && Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 1)
        .map(([b]) => [a, b].map((e) => e.id || e.className || e.tagName)));
    const homes = ['body > header', '#tools', '#display', '#scrub', '#alarm > header', '#explain',
        '#lane-side', '#zoom'];
    return [...homes.flatMap((home) => pairs(document.querySelector(home).children)),
        ...pairs(document.querySelectorAll('body > header, #lane-side, aside')),
        ...pairs(document.querySelectorAll('aside > section'))];
}"""
"""Pairs of neighbours that lie over each other."""

AMBER = (0xFF, 0xB0, 0x00)


def lane_of(half):
    """Return the event that begins a run on a lane of twice this breadth, m."""
    vehicle = VEHICLE.model_dump() | {"stopping_distance": VEHICLE.stopping_distance}
    lane = {"x_min": -half, "x_max": half, "y_min": 0, "y_max": 60}
    return BEGIN | {"vehicle": vehicle, "lane": lane}


@pytest.fixture
def drive_at(tmp_path, serving, watch):
    """Open a driver's screen of a size on a run that has begun, with its clock in hand."""
    opened = []

    def start(size, half=2.0):
        feeder = Feeder(tmp_path)
        seen = view_event(0, np.ones((300, 60), np.float32))
        feeder.give(lane_of(half), scan(0, 0.0), scan(1, 1.0), seen)
        viewer = serving([], live=tmp_path)
        page = watch(viewer.__enter__(), size=size, script=CLOCK)
        opened.append((page, viewer))
        screen = Screen(page, tmp_path)
        screen.alive()
        screen.pass_time(600)
        return screen, feeder

    yield start
    for page, viewer in opened:
        page.close()
        viewer.__exit__(None, None, None)


@pytest.mark.parametrize(
    "size",
    [
        (1440, 900),
        (820, 1180),
        (800, 1280),
        (640, 1024),
        (768, 1024),
        (390, 844),
        (844, 390),
        (1024, 768),
    ],
)
def test_the_drivers_screen_is_read_in_full_upright_and_on_a_phone(drive_at, size):
    screen, feeder = drive_at(size)
    look = {"p": 0.622, "next_p": [0.396, 0.704], "wait": True}
    feeder.give(scan(2, 2.0), alarm("alarm-1", -1.6, 4.4, 4.5, 0.0) | look)
    feeder.give(*(alarm(f"alarm-{k}", 0.0, 20.0 + k, 4.5, 0.0) for k in range(2, 5)))
    feeder.give({"event": "counts", "missing": 88, "masked": 88, "duplicate": 88})
    screen.alive()
    screen.pass_time(300)
    assert screen.says()["word"] == "stop"
    assert screen.says()["drive-prior"]
    assert screen.page.inner_text("#drive-sound") == "Sound"
    assert screen.page.locator("#state-clock").is_visible()
    assert screen.page.evaluate(CUT) == []
    assert screen.page.evaluate(HIDDEN) == []
    assert screen.page.evaluate(PARTED) == []
    picture = screen.page.locator("#lane").bounding_box()
    assert min(picture["width"], picture["height"]) >= 150
    small = size in ((390, 844), (844, 390))
    assert screen.page.locator("#drive-small").is_hidden() != small
    looks = screen.page.evaluate(LOOK)
    if small:
        assert re.fullmatch(
            r"Small screen: read it from 0\.\d m", screen.page.inner_text("#drive-small")
        )
        assert min(one["size"] for one in looks["type"]) >= 12
        assert min(min(width, height) for *_, width, height in looks["buttons"]) >= 30
    else:
        assert min(one["size"] for one in looks["type"]) >= 38
        assert min(min(width, height) for *_, width, height in looks["buttons"]) >= 72
    feeder.give(scan(3, 6.0))
    screen.alive()
    screen.pass_time(300)
    assert screen.says()["word"] == "over"  # the longest word
    assert screen.page.evaluate(CUT) == []
    assert screen.page.evaluate(HIDDEN) == []
    for _ in range(4):
        screen.pass_time(400)
    assert screen.says()["state-words"] == "No radar"
    assert screen.page.evaluate(CUT) == []
    screen.alive(ago=5.0)
    screen.pass_time(400)
    assert screen.says()["state-words"] == "Detection stopped"  # the longest
    assert screen.page.evaluate(CUT) == []


def test_the_vehicle_hides_no_alarm(drive_at):
    screen, feeder = drive_at((1024, 768))
    without = screen.page.locator("#lane").screenshot()
    feeder.give(alarm("alarm-1", 0.0, 1.0, 4.5, 1.0))  # right below the vehicle
    screen.alive()
    screen.pass_time(300)
    assert screen.page.locator("#lane").screenshot() != without


def test_only_alarms_in_the_way_of_the_vehicle_are_filled(drive_at):
    screen, feeder = drive_at((1024, 768), half=3.0)
    kept = VEHICLE.width / 2 + VEHICLE.clearance

    def amber_pixels(x):
        feeder.give(alarm("alarm-1", x, 14.0, 4.5, 1.0), scan(2, 1.0))
        screen.alive()
        screen.pass_time(300)
        return int((np.abs(screen.watched.pixels() - AMBER).max(axis=2) < 6).sum())

    assert amber_pixels(kept + 0.1) == 0
    assert "alarm" not in screen.says()["drive-aside"]
    assert amber_pixels(kept - 0.1) > 60
    assert screen.says()["word"] == "slow"


def in_first_screen(page):
    """Return whether the sentence that answers is read without scrolling, in full."""
    box = page.locator("#answer").bounding_box()
    size = page.viewport_size
    return (
        box["x"] >= 0
        and box["x"] + box["width"] <= size["width"]
        and (box["y"] + box["height"] <= size["height"] / 2)
    )


@pytest.mark.parametrize(
    "size", [(1280, 800), (1024, 768), (820, 1180), (800, 1280), (640, 400), (512, 384), (390, 844)]
)
def test_the_viewer_fits_any_window(watch, shown, size):
    """Twice the size on 1280 x 800 is a window of 640 x 400."""
    one = watch(shown, size=size)
    page = one.page
    assert one.text("#answer").startswith("2 of 3 targets found (Pd 0.67, ")
    assert in_first_screen(page)
    page.keyboard.press("n")
    page.wait_for_selector("#patches canvas")
    page.keyboard.press("s")  # with picture B the toolbar is at its longest
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    assert page.evaluate(OVERLAPS) == []
    picture = page.locator("#lane").bounding_box()
    assert picture["width"] >= 320
    assert picture["height"] >= 180
    beside = page.locator("aside").bounding_box()
    if size[0] <= 900:
        assert beside["x"] == 0
        assert beside["y"] >= picture["y"] + picture["height"]
        assert page.evaluate("scrollY") == 0  # the list does not take the page from the picture
    else:
        assert beside["x"] >= picture["width"]
