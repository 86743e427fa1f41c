"""The driver's screen of a live run: distance, stopping, losses, sound, colours, size."""

import os
import re
import threading
import time
from dataclasses import asdict

import numpy as np
import pytest
from test_live_page import START, Feeder, alarm, scan

from flgpr.live.events import view_event
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model.vehicle import Vehicle
from flgpr.store import save_run
from live_lane import STEP, make_lane_run, small_recipe

pytestmark = pytest.mark.slow("a browser draws every page")

VEHICLE = Vehicle(speed=15 / 3.6, reaction=0.5, deceleration=7.0)
BEGIN = START | {"vehicle": VEHICLE.model_dump() | {"stopping_distance": VEHICLE.stopping_distance}}
SEEN = """() => Object.fromEntries(['state-words', 'state-detail', 'drive-left', 'drive-aside', 'drive-verdict',
    'drive-margin', 'drive-speed', 'drive-next', 'drive-faults']
    .map((id) => [id, document.getElementById(id).textContent])
    .concat([['verdict', document.getElementById('drive').dataset.verdict]]))"""
AUDIO = """() => {
    window.tones = [];
    window.AudioContext = class {
        get currentTime() { return performance.now() / 1000; }
        resume() { return Promise.resolve(); }
        createGain() { return { gain: { setValueAtTime() {}, linearRampToValueAtTime() {} }, connect() {} }; }
        createOscillator() {
            const frequency = { value: 0 };
            const start = () => window.tones.push(frequency.value);
            return { frequency, start, stop() {}, connect: (next) => next };
        }
    };
}"""
CLOCK = """(() => {
    const later = window.setTimeout.bind(window), ask = window.fetch.bind(window), timers = new Map();
    let now = performance.now(), last = 0, waiting = 0;
    performance.now = () => now;
    window.setTimeout = (act, wait = 0) => timers.set(++last, { act, at: now + wait }) && last;
    window.clearTimeout = (timer) => timers.delete(timer);
    window.fetch = async (...what) => {
        waiting++;
        try {
            const answer = await ask(...what), text = await answer.text();
            answer.json = async () => JSON.parse(text);
            return answer;
        } finally { waiting--; }
    };
    window.pass = async ([milliseconds, answered]) => {
        const end = now + milliseconds;
        for (;;) {
            do await new Promise((done) => later(done)); while (answered && waiting);
            const [next] = [...timers].filter(([, one]) => one.at <= end).sort(([, a], [, b]) => a.at - b.at);
            if (!next) break;
            timers.delete(next[0]);
            now = next[1].at;
            next[1].act();
        }
        now = end;
    };
})()"""
"""A page's clock that goes only when it is told to; Playwright's would be that of every page of the browser."""


class Screen:
    """A driver's screen on a page whose clock goes only when it is told to, and a detection that seems alive."""

    def __init__(self, page, folder):
        self.watched = page
        self.page = page.page
        self.file = folder / "live.jsonl"

    def alive(self, ago=-100.0):
        """Let detection give a sign of life so long ago; by the test's own clock it stays fresh."""
        os.utime(self.file, (time.time() - ago,) * 2)

    def pass_time(self, milliseconds, answered=True):
        """Let the page's clock go on, and whatever it asks for be answered at once."""
        self.page.evaluate("(how) => pass(how)", [milliseconds, answered])

    def says(self):
        return self.page.evaluate(SEEN)


@pytest.fixture
def driving(tmp_path, serving, watch):
    """A driver's screen, the folder's feeder, and the clock in hand."""
    feeder = Feeder(tmp_path)
    feeder.give(BEGIN, scan(0, 0.0))
    with serving([], live=tmp_path) as viewer:
        page = watch(viewer, script=CLOCK)
        screen = Screen(page, tmp_path)
        screen.alive()
        screen.pass_time(600)
        yield screen, feeder
        page.close()


def test_a_radar_that_falls_silent_is_seen_within_a_second(driving):
    screen, feeder = driving
    for number in range(1, 5):
        feeder.give(scan(number, float(number)), alarm("alarm-1", 0.5, 12.0, 4.5, number))
        screen.alive()
        screen.pass_time(250)
    assert screen.says()["state-words"] == ""
    assert re.fullmatch(r"[67]\.\d m", screen.says()["drive-left"])
    for _ in range(20):
        screen.pass_time(50)
        if (said := screen.says())["state-words"]:
            break
    assert (said["state-words"], said["verdict"], said["drive-left"]) == ("No radar", "blind", "–")
    assert re.fullmatch(r"for 0\.[789] s", said["state-detail"])
    assert screen.page.locator("#state-words").bounding_box()["height"] > 60
    feeder.give(scan(5, 5.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    for k in range(5):  # frames come, none of use
        feeder.give({"event": "counts", "masked": k})
        screen.alive()
        screen.pass_time(400)
    assert screen.says()["state-words"] == "Scans unusable"


def problem(number, kind="pose"):
    words = f"scan {number} after scan {number - 1}: 46 m away in 0.238 s, 193.2 m/s, at most 30 m/s (speed)"
    return {"event": "problem", "name": "a.scan", "words": words, "kind": kind, "scan": number}


def health(finding, stop):
    words = f"{finding}: 2, at most 1"
    return {
        "event": "problem", "name": "a.scan", "words": words, "kind": "health",
        "finding": finding, "stop": stop,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("finding", "told"),
    [
        ("frozen positions", ("Positions frozen", "check the GPS")),
        ("no positions", ("No positions", "check the GPS")),
        ("repeated scans", ("Radar frozen", "start it again")),
    ],
)
def test_what_blinds_the_radar_says_stop_until_a_scan_is_of_use_again(driving, finding, told):
    screen, feeder = driving
    for number in range(1, 5):
        feeder.give(scan(number, float(number)))
        screen.alive()
        screen.pass_time(250)
    feeder.give(health("disturbed tones", stop=False))  # a line, and no more
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert said["state-words"] == ""
    assert screen.page.locator("#drive-faults").inner_text() == "radar: disturbed tones"
    feeder.give(health(finding, stop=True))
    for number in range(5, 8):
        feeder.give(scan(number, 4.0) | {"outcome": "still"})
        screen.alive()
        screen.pass_time(250)
        said = screen.says()
        assert (said["state-words"], said["state-detail"]) == told
        assert said["verdict"] == "blind"
    feeder.give(scan(8, 5.0))
    screen.alive()
    screen.pass_time(250)
    assert screen.says()["state-words"] == ""


def test_positions_that_are_wrong_are_seen_within_a_second_and_until_they_are_good_again(driving):
    screen, feeder = driving
    near = alarm("alarm-1", 0.5, 12.0, 4.5, 4.0)
    for number in range(1, 5):
        feeder.give(scan(number, float(number)), near)
        screen.alive()
        screen.pass_time(250)
    assert screen.says()["state-words"] == ""
    feeder.give(problem(5))  # a single one costs its scan, no more
    screen.alive()
    screen.pass_time(250)
    feeder.give(scan(6, 6.0))
    screen.alive()
    screen.pass_time(250)
    assert (screen.says()["state-words"], screen.says()["verdict"]) == ("", "go")
    feeder.give(problem(7))
    screen.alive()
    screen.pass_time(250)
    feeder.give(problem(8))
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert (said["state-words"], said["state-detail"]) == ("Positions wrong", "check the GPS")
    assert (said["verdict"], said["drive-left"]) == ("blind", "–")
    for width in (1024, 390):
        screen.page.set_viewport_size({"width": width, "height": 768})
        box = screen.page.locator("#state-detail").bounding_box()
        assert box["x"] + box["width"] <= width  # what to do is read in full
    screen.page.set_viewport_size({"width": 1280, "height": 800})
    for number in range(9, 14):  # as long as they last, whatever else is missed by now
        feeder.give(problem(number), {"event": "counts", "implausible": number - 6})
        screen.alive()
        screen.pass_time(250)
        assert screen.says()["state-words"] == "Positions wrong"
    feeder.give(scan(14, 7.0))
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert (said["state-words"], said["verdict"]) == ("", "go")
    assert said["drive-faults"] == "scans: wrong place 7"


def test_one_wrong_position_of_a_slow_radar_is_seen_within_a_second(driving):
    screen, feeder = driving
    for number in range(1, 10):
        feeder.give(scan(number, float(number)))
        screen.alive()
        screen.pass_time(2000)
    feeder.give(problem(10))
    screen.alive()
    screen.pass_time(1000)
    assert screen.says()["state-words"] == "Positions wrong"


def test_where_detection_starts_anew_the_alarms_of_before_lie_ahead_no_more(driving):
    screen, feeder = driving
    feeder.give(scan(1, 1.0), alarm("alarm-1", 0.5, 12.0, 4.5, 1.0))
    screen.alive()
    screen.pass_time(250)
    feeder.give(problem(2), problem(3))
    screen.alive()
    screen.pass_time(250)
    assert screen.says()["state-words"] == "Positions wrong"
    anew = {
        "event": "anew",
        "scan": 4,
        "held": [2, 3],
        "pose": [0, -494.0, 5, 0, 0, 0],
        "forgotten": False,
    }
    feeder.give(
        anew,
        *(scan(number, -498.0 + number) for number in (2, 3, 4)),
        {"event": "counts", "restarts": 1},
    )
    feeder.give(
        alarm("alarm-1", 0.5, 12.0, 4.5, -494.0, "final"),
        alarm("alarm-2", 0.5, -480.0, 4.5, -494.0),
    )
    screen.alive()
    screen.pass_time(250)
    said = screen.says()
    assert (said["state-words"], said["verdict"]) == ("", "go")
    assert float(said["drive-left"][:-2]) == pytest.approx(13, abs=2.1)
    assert said["drive-next"] == ""
    assert said["drive-faults"] == "scans: moved 1"


def test_a_clock_that_jumps_is_no_matter_of_positions(driving):
    screen, feeder = driving
    for number in range(1, 6):
        feeder.give(problem(number, "clock"), scan(number, float(number)))
        screen.alive()
        screen.pass_time(250)
        assert screen.says()["state-words"] == ""


def test_a_loss_is_seen_at_the_desk_and_nothing_moves_for_it(driving):
    screen, feeder = driving
    screen.page.click("#to-desk")
    feeder.give(scan(1, 1.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.page.locator("#state").is_hidden()
    before = [
        screen.page.locator(name).bounding_box() for name in ("#lane", "#live", "#export-menu")
    ]
    screen.pass_time(1000)
    assert screen.page.inner_text("#state-words").upper() == "NO RADAR"
    assert screen.page.locator("#state").is_visible()
    assert [
        screen.page.locator(name).bounding_box() for name in ("#lane", "#live", "#export-menu")
    ] == before


def test_what_another_look_is_worth_is_told_while_it_may_be_waited_for(driving):
    screen, feeder = driving
    one = alarm("alarm-1", 0.5, 16.0, 0.5, 1) | {"p": 0.622, "next_p": [0.396, 0.704], "wait": True}
    for number in range(1, 5):
        feeder.give(scan(number, float(number)), one)
        screen.alive()
        screen.pass_time(250)
    said = screen.page.inner_text("#drive-chances"), screen.says()["drive-margin"]
    assert said[0] == "p 62 %, next 40\u201370 %"
    assert said[1].endswith(" m, look again")
    height = float(
        screen.page.evaluate(
            "parseFloat(getComputedStyle(document.getElementById('drive-chances')).fontSize)"
        )
    )
    assert height >= 38
    screen.page.set_viewport_size({"width": 1024, "height": 768})  # the least that the docs ask for
    assert screen.page.evaluate(
        "drive.scrollHeight <= drive.clientHeight && drive.scrollWidth <= drive.clientWidth"
    )
    line = screen.page.locator("#live li").first
    assert line.text_content().endswith("62 \u2192 40\u201370 % wait")
    assert line.get_attribute("aria-label").endswith(
        "p 62 %, next 40\u201370 %, worth another look"
    )
    feeder.give(scan(5, 5.0), one | {"state": "update", "y": 8.0})  # too near to stop by now
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["verdict"] == "halt"
    assert "look again" not in screen.says()["drive-margin"]
    plain = {name: value for name, value in one.items() if name not in ("p", "next_p", "wait")}
    feeder.give(scan(6, 6.0), plain | {"state": "update", "y": 20.0})
    screen.alive()
    screen.pass_time(400)
    assert screen.page.locator("#drive-chances").is_hidden()
    assert "look again" not in screen.says()["drive-margin"]


def test_ground_unlike_the_training_takes_the_place_of_the_probability(driving):
    screen, feeder = driving
    one = alarm("alarm-1", 0.5, 16.0, 0.5, 1) | {"p": 0.622, "next_p": [0.396, 0.704]}
    words = "this ground is unlike the training: the confidences do not hold"
    unlike = {"event": "ground", "scan": 2, "unlike": True, "words": [words, "0.9 (limit 0.4)"]}
    like = {"event": "ground", "scan": 3, "unlike": False, "words": ["like the training again"]}

    def shown_after(number, *events):
        feeder.give(scan(number, float(number)), *events)
        screen.alive()
        screen.pass_time(400)
        return screen.page.inner_text("#drive-chances")

    assert shown_after(1, one).startswith("p 62 %")
    assert shown_after(2, unlike) == "Ground unlike the training"
    assert "the confidences do not hold" in screen.page.locator("#live-unlike").text_content()
    assert shown_after(3, like).startswith("p 62 %")
    assert screen.page.locator("#live-unlike").count() == 0


def test_a_slow_radar_has_its_own_rhythm(driving):
    screen, feeder = driving
    for number in range(1, 12):
        feeder.give(scan(number, float(number)))
        screen.alive()
        screen.pass_time(1200)
    assert screen.says()["state-words"] == ""
    screen.pass_time(4000)
    assert screen.says()["state-words"] == "No radar"


def test_a_detection_that_stands_still_and_a_dead_connection_are_seen(driving):
    screen, feeder = driving
    feeder.give(scan(1, 1.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    screen.alive(ago=5.0)
    screen.pass_time(400)
    assert screen.says()["state-words"] == "Detection stopped"
    feeder.give(scan(2, 2.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    screen.page.route("**/data/live*", lambda _: None)  # asked, never answered
    screen.pass_time(1000, answered=False)
    assert screen.says()["state-words"] == "No connection"
    screen.page.unroute_all()
    screen.pass_time(2400, answered=False)  # what hangs is given up
    feeder.give(scan(3, 3.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["state-words"] == ""
    feeder.give(scan(4, 4.0) | {"latency_ms": 2300.0}, alarm("alarm-1", 0.5, 30.0, 4.5, 4.0))
    screen.alive()
    screen.pass_time(400)
    said = screen.says()
    assert (said["state-words"], said["state-detail"]) == ("Too slow", "2.3 s late")
    assert float(said["drive-left"][:-2]) < 26 - 2.3 * 15 / 3.6  # it has driven on since
    feeder.give({"event": "end"})
    screen.alive(ago=50.0)
    screen.pass_time(400)
    assert screen.says()["state-words"] == "Run ended"


def test_a_page_whose_scripts_stand_still_says_so(driving):
    """No timer fires while the clock stands; the words come from an animation that a living page always sets back."""
    screen, _ = driving
    opacity = "() => getComputedStyle(document.getElementById('frozen')).opacity"
    screen.pass_time(150)
    assert screen.page.evaluate(opacity) == "0"
    for _ in range(1200):
        if screen.page.evaluate(opacity) == "1":
            break
        screen.page.wait_for_timeout(50)
    assert screen.page.evaluate(opacity) == "1"
    assert screen.page.locator("#frozen").bounding_box()["width"] == 1280
    screen.pass_time(150)
    assert screen.page.evaluate(opacity) == "0"


def test_whether_it_can_stop_follows_the_settings(driving):
    screen, feeder = driving
    feeder.give(
        scan(1, 0.0), alarm("alarm-1", -0.6, 6.0, 4.5, 0.0), alarm("alarm-2", 0.6, 9.0, 3.0, 0.0)
    )
    screen.alive()
    screen.pass_time(400)
    said = screen.says()
    assert said["drive-speed"] == "15 km/h stated stops in 3.3 m"
    assert said["drive-aside"] == "0.6 m left"
    assert (said["verdict"], said["drive-verdict"]) == ("go", "Can stop")
    left = float(said["drive-left"][:-2])
    spare = float(said["drive-margin"].split()[0])
    assert left == pytest.approx(spare + VEHICLE.stopping_distance, abs=0.11)
    assert said["drive-next"] == f"then {left + 3:.1f} m"
    screen.page.click("#drive-set")
    for button, times in (("Longer reaction", 10), ("Weaker brakes", 8)):
        for _ in range(times):
            screen.page.click(f"[aria-label='{button}']")
    assert (
        screen.page.inner_text("#set-sum") == "Stops in 9.1 m"
    )  # 1.5 s and 3 m/s²: what the docs work out
    feeder.give(scan(2, 0.0))
    screen.alive()
    screen.pass_time(400)
    said = screen.says()
    assert (said["verdict"], said["drive-verdict"]) == ("halt", "Cannot stop")
    assert said["drive-margin"].endswith("m too near")
    for _ in range(10):
        screen.page.click("[aria-label='Slower']")
    feeder.give(scan(3, 0.0))
    screen.alive()
    screen.pass_time(400)
    said = screen.says()
    assert said["drive-speed"] == "5 km/h set stops in 2.4 m"
    assert said["verdict"] == "go"
    screen.page.click("#set-measured")
    feeder.give(scan(4, 0.0) | {"arrived": 100.0}, scan(5, 2.0) | {"arrived": 101.0})
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["drive-speed"] == "7 km/h stops in 3.7 m"


def test_sound_is_off_until_it_is_switched_on(driving):
    screen, feeder = driving
    screen.page.evaluate(AUDIO)
    feeder.give(scan(1, 0.0))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["drive-aside"] == "nothing seen yet"
    near = alarm("alarm-1", -0.6, 3.0, 4.5, 0.0)
    feeder.give(scan(2, 0.0), near, view_event(0, np.ones((200, 60), np.float32)))
    screen.alive()
    screen.pass_time(400)
    assert screen.says()["verdict"] == "halt"
    assert screen.page.evaluate("tones") == []
    screen.page.click("#drive-sound")
    assert screen.page.get_attribute("#drive-sound", "aria-pressed") == "true"
    feeder.give(scan(3, 0.1))
    screen.alive()
    screen.pass_time(500)
    assert screen.page.evaluate("tones").count(1200) >= 1
    screen.pass_time(1500)
    assert screen.page.evaluate("tones[tones.length - 1]") == 220  # nothing comes any more
    screen.page.click("#drive-sound")
    feeder.give(scan(4, 8.0))
    screen.alive()
    screen.pass_time(400)
    assert re.fullmatch("none in 1[01] m", screen.says()["drive-aside"])
    before = len(screen.page.evaluate("tones"))
    screen.pass_time(1000)
    assert len(screen.page.evaluate("tones")) == before


LOOK = """() => {
    const colours = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
    const light = (colour) => {
        colours.clearRect(0, 0, 1, 1);
        colours.fillStyle = colour;
        colours.fillRect(0, 0, 1, 1);
        const [r, g, b] = [...colours.getImageData(0, 0, 1, 1).data].slice(0, 3).map((v) => v / 255)
            .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const ground = (e) => {
        const own = getComputedStyle(e).backgroundColor;
        return own === 'rgba(0, 0, 0, 0)' && e.parentElement ? ground(e.parentElement) : own;
    };
    const all = [...document.querySelectorAll('#drive *, #state *, #drive-settings *:not(#ruler, #ruler *)')]
        .filter((e) => e.checkVisibility());
    return {
        type: all.filter((e) => e.textContent && !e.children.length).map((e) => {
            const style = getComputedStyle(e), [a, b] = [light(style.color), light(ground(e))];
            const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
            return { name: e.id || e.textContent, size: parseFloat(style.fontSize), contrast };
        }),
        buttons: all.filter((e) => e.tagName === 'BUTTON').map((e) => [e.textContent,
            ...['left', 'top', 'right', 'bottom', 'width', 'height'].map((n) => e.getBoundingClientRect()[n])]),
        cut: all.filter((e) => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline')
            .map((e) => e.id),
    };
}"""


@pytest.mark.parametrize("size", [(1024, 768), (1280, 800), (1920, 1080)])
def test_it_is_read_from_afar_in_any_light_and_touched_with_gloves(tmp_path, serving, watch, size):
    feeder = Feeder(tmp_path)
    feeder.give(
        BEGIN,
        scan(0, 0.0) | {"arrived": 5.0},
        scan(1, 1.0) | {"arrived": 6.0},
        alarm("alarm-1", -1.6, 2.4, 4.5, 0.0),
    )
    feeder.give(*(alarm(f"alarm-{k}", 0.0, 10.0 + k, 4.5, 0.0) for k in range(2, 5)))
    feeder.give({"event": "counts", "missing": 88, "masked": 88, "duplicate": 88})
    names = set()
    smallest = {}
    with serving([], live=tmp_path) as viewer:
        page = watch(viewer, size=size, script=CLOCK)
        screen = Screen(page, tmp_path)
        screen.alive()
        screen.pass_time(1500)
        assert screen.says()["state-words"] == "No radar"
        for words in ("No radar", "", "settings"):
            if not words:
                feeder.give(scan(2, 2.0) | {"arrived": 7.0})
                screen.alive()
                screen.pass_time(300)
                assert (screen.says()["state-words"], screen.says()["verdict"]) == ("", "halt")
            if words == "settings":
                page.page.click("#drive-set")
            for theme in ("light", "night", "sun"):
                page.page.evaluate(
                    "(theme) => { document.documentElement.dataset.theme = theme; }", theme
                )
                looks = page.page.evaluate(LOOK)
                for one in looks["type"]:
                    assert one["size"] >= 38, one
                    assert one["contrast"] >= (7 if theme == "sun" else 4.5), (theme, one)
                    smallest[one["name"]] = min(one["size"], smallest.get(one["name"], 999))
                names |= {one["name"] for one in looks["type"]}
                assert looks["cut"] == []
                for name, left, top, right, bottom, width, height in looks["buttons"]:
                    assert min(width, height) >= 72, name
                    assert left >= 0
                    assert top >= 0
                    assert right <= size[0]
                    assert bottom <= size[1], name
        page.close()
    assert names >= {
        "drive-left",
        "drive-verdict",
        "drive-margin",
        "drive-speed",
        "state-words",
        "set-reaction-out",
    }
    assert min(smallest[name] for name in ("drive-left", "drive-verdict", "state-words")) >= 48


def test_a_hand_on_the_picture_does_not_take_it_from_the_vehicle(driving):
    screen, _ = driving
    assert screen.page.get_attribute("#follow", "aria-pressed") == "true"
    box = screen.page.locator("#lane").bounding_box()
    screen.page.mouse.move(box["x"] + 200, box["y"] + 200)
    screen.page.mouse.down()
    screen.page.mouse.move(box["x"] + 300, box["y"] + 500, steps=4)
    screen.page.mouse.up()
    screen.page.mouse.wheel(0, 300)
    assert screen.page.get_attribute("#follow", "aria-pressed") == "true"
    assert screen.page.locator("#alarm").is_hidden()


def test_the_button_goes_through_day_night_and_sun(driving):
    screen, _ = driving
    assert screen.page.inner_text("#drive-theme") == "Day"
    for name, theme in (("Night", "night"), ("Sun", "sun"), ("Day", "light")):
        screen.page.click("#drive-theme")
        assert screen.page.inner_text("#drive-theme") == name
        assert screen.page.evaluate("document.documentElement.dataset.theme") == theme
    screen.page.click("#drive-theme")
    screen.page.click("#to-desk")
    assert screen.page.locator("#export-menu").is_visible()
    assert screen.page.evaluate("document.documentElement.dataset.theme") == "dark"
    screen.page.click("#to-drive")
    assert screen.page.inner_text("#drive-theme") == "Night"
    assert screen.page.locator("#export-menu").is_hidden()


def test_a_drive_at_the_speed_of_a_vehicle_with_faults(tmp_path, serving, watch):
    """15 km/h from the radar's files to the screen, scans lost, late, twice and holed on the way."""
    save_run(make_lane_run(), tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    options = LiveOptions(
        tmp_path / "recipe.toml", tmp_path / "out", tmp_path / "in", vehicle=VEHICLE.changed(threshold=1.0)
    )
    faults = ["lost:16:8", "late:27:2", "twice:30:3", "nan:33:2"]
    live = LiveRun(options)
    detection = threading.Thread(target=live.run)
    radar = threading.Thread(
        target=feed,
        args=(tmp_path / "run.zarr", tmp_path / "in", 15 / 3.6 / STEP),
        kwargs={"faults": faults},
    )
    seen = []
    with serving([], live=tmp_path / "out") as viewer:
        page = watch(viewer)
        assert page.page.evaluate(SEEN)["state-words"] in ("", "Waiting")
        detection.start()
        page.until("document.getElementById('state-detail').textContent === 'for the first scan'")
        radar.start()
        try:
            for _ in range(1200):
                seen.append(page.page.evaluate(SEEN))
                if seen[-1]["state-words"] == "Run ended":
                    break
                page.page.wait_for_timeout(40)
        finally:
            live.stop()
            for thread in (radar, detection):
                thread.join(30)
        page.close()
    end = seen[-1]
    assert (end["state-words"], end["drive-left"], end["verdict"]) == ("Run ended", "–", "free")
    assert (
        end["drive-faults"] == "scans: lost 8, twice 3, holes 2"
    )  # the late one still came in time
    told = [one for one in seen if one["verdict"] in ("go", "halt")]
    assert told
    for one in told:
        left = float(one["drive-left"][:-2])
        stop = float(re.search(r"stops in (\S+) m", one["drive-speed"])[1])
        margin = float(one["drive-margin"].split()[0]) * (1 if one["verdict"] == "go" else -1)
        assert left - stop == pytest.approx(margin, abs=0.16)
        assert left >= 0
        assert one["drive-margin"].endswith("to spare" if one["verdict"] == "go" else "too near")
    for one in seen:
        if one["state-words"] in (
            "No radar",
            "No connection",
            "Detection stopped",
            "Scans unusable",
        ):
            assert (one["drive-left"], one["verdict"]) == ("–", "blind")
