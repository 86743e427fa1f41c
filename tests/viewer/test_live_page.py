"""The page of a live run: scans arrive, alarms come and go, the vehicle drives."""

import csv
import io
import json
import re
from contextlib import contextmanager

import numpy as np
import pytest
from watching import viridis

from flgpr.live.events import alarm_event, as_line, view_event
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.live.updates import LiveAlarm
from flgpr.model.vehicle import Vehicle
from flgpr.store import read_table, save_run
from live_lane import LANE, SCANS, make_lane_run, small_recipe

VEHICLE = Vehicle(speed=15 / 3.6, front=1.0)
GRID = {"x": -2.95, "y": 0.05, "nx": 60, "dx": 0.1, "dy": 0.1}
START = {
    "event": "start",
    "title": "yard",
    "lane": {"x_min": -3, "x_max": 3, "y_min": 0, "y_max": 60},
    "grid": GRID,
    "channel": ["HH", "F1"],
    "georeference": {"latitude": 48.0, "longitude": 11.0, "azimuth": 0.0},
    "vehicle": VEHICLE.model_dump() | {"stopping_distance": VEHICLE.stopping_distance},
}


def scan(number, y):
    return {
        "event": "scan",
        "scan": number,
        "pose": [0, y, 5, 0, 0, 0],
        "outcome": "taken",
        "latency_ms": 60 + number,
    }


def alarm(name, x, y, confidence, at, state="new"):
    one = LiveAlarm(name, x, y, confidence, 3.0, 4, state, 12.0)
    return alarm_event(one, 0, np.array([0, at, 5, 0, 0, 0.0]), VEHICLE, 0.07)


class Feeder:
    def __init__(self, folder):
        self.file = folder / "live.jsonl"

    def give(self, *events):
        with self.file.open("a") as out:
            out.write("".join(as_line(event) for event in events))


@pytest.fixture
def follow(serving, watch):
    """Open a page on a folder of events; it is closed before its server, which it asks all the time."""

    @contextmanager
    def start(folder, **options):
        with serving([], live=folder) as viewer:
            page = watch(viewer, **options)
            page.page.click("#to-desk")
            try:
                yield page
            finally:
                page.close()

    return start


@pytest.fixture
def live(tmp_path, follow):
    """A page that follows a file of events, with its run begun."""
    feeder = Feeder(tmp_path)
    with follow(tmp_path) as page:
        feeder.give(START)
        page.until("document.querySelector('#a-pol').value === 'HH'")
        yield page, feeder


def wait_words(page, words):
    page.until(f"document.querySelector('#live-words')?.textContent.includes({json.dumps(words)})")


def test_scans_alarms_and_distances_arrive(live):
    page, feeder = live
    feeder.give(scan(0, 2.0), alarm("alarm-1", 1.0, 12.5, 4.5, 2.0), scan(1, 4.0))
    wait_words(page, "2 scans")
    assert "1 alarms, 61 ms" in page.text("#live-words")
    assert "7.5 m ahead: alarm-1, 1.0 m right" in page.text("#live")
    assert "Stopping distance 9.1 m" in page.text("#live")
    feeder.give(scan(2, 14.0))
    wait_words(page, "3 scans")
    assert "ahead" not in page.text("#live ul")
    feeder.give({"event": "end", "duplicate": 3, "late": 0})
    wait_words(page, "ended")
    assert page.text("#live-faults") == "Scans: 3 duplicate"


@pytest.mark.slow("a browser draws every page")
def test_new_alarms_are_told_to_screen_readers(live):
    page, feeder = live
    feeder.give(scan(0, 2.0))
    wait_words(page, "1 scans")
    feeder.give(alarm("alarm-1", 1.0, 34.5, 4.5, 2.0), alarm("alarm-2", -0.5, 7.0, 3.0, 2.0))
    page.until("document.querySelector('#said').textContent.startsWith('New alarm')")
    said = page.page.text_content("#said")
    assert said == (
        "New alarm: alarm-2, 4.0 metres ahead, 0.5 metres left, brake, confidence 3.00, and 1 more"
    )
    assert page.page.get_attribute("#said", "aria-live") == "polite"
    labels = page.page.eval_on_selector_all(
        "#live li", "(all) => all.map((one) => one.getAttribute('aria-label'))"
    )
    assert labels[0].startswith("alarm-2, 4.0 metres ahead, 0.5 metres left, brake")
    assert "brake" not in labels[1]
    assert "brake" in page.text("#live li:first-child")


@pytest.mark.slow("a browser draws every page")
def test_alarms_that_come_with_the_page_are_not_all_read_out(tmp_path, follow):
    feeder = Feeder(tmp_path)
    feeder.give(START, scan(0, 2.0), alarm("alarm-1", 1.0, 14.5, 4.5, 2.0))
    with follow(tmp_path) as page:
        wait_words(page, "1 alarms")
        assert "New alarm" not in page.page.text_content("#said")


@pytest.mark.slow("a browser draws every page")
def test_a_known_alarm_changes_and_a_withdrawn_one_goes(live):
    page, feeder = live
    feeder.give(
        scan(0, 2.0), alarm("alarm-1", 1.0, 14.5, 4.5, 2.0), alarm("alarm-2", 0.0, 16.0, 2.0, 2.0)
    )
    wait_words(page, "2 alarms")
    page.page.keyboard.press("n")
    assert page.text("#alarm-title") == "alarm-1"
    feeder.give(
        alarm("alarm-2", 0.1, 16.1, 9.0, 2.0, "update"),
        alarm("alarm-1", 1, 14.5, 1.0, 2.0, "withdrawn"),
    )
    wait_words(page, "1 alarms")
    assert page.page.locator("#alarm").is_hidden()  # what was selected is gone
    assert "Alarms (1 of 1)" in page.text("#list-title")
    assert "9" in page.text("#rows tr:first-child")


@pytest.mark.slow("a browser draws every page")
def test_the_run_view_grows_in_the_right_colours(live):
    page, feeder = live
    rng = np.random.default_rng(5)
    view = np.exp(rng.normal(size=(600, 60))).astype(np.float32)
    view[:, :5] = np.nan
    feeder.give(scan(0, 5.0), view_event(0, view[:300]), view_event(250, view[250:]))
    wait_words(page, "1 scans")
    page.page.keyboard.press("f")
    for box in ("#show-alarms", "#show-truth"):
        page.page.uncheck(box)
    for _ in range(6):
        page.page.keyboard.press("+")
    seen = page.pixels()
    box = page.page.locator("#lane").bounding_box()
    level = 20 * np.log10(view)
    # The page takes the median of the rows that came first, unless a later one is far off.
    share = (level - np.nanmedian(20 * np.log10(view[:300])) + 5) / 35
    agree = total = 0
    for px in range(120, int(box["width"]) - 120, 53):
        for py in range(80, int(box["height"]) - 120, 43):
            page.page.mouse.move(box["x"] + px, box["y"] + py)
            words = page.text("#readout").replace("\u2212", "-")
            y, x = (
                float(re.search(pattern, words).group(1))
                for pattern in (r"y (\S+) m", r"x (\S+) m")
            )
            row, column = (y - GRID["y"]) / 0.1, (x - GRID["x"]) / 0.1
            inside = (
                max(abs(row % 1 - 0.5), abs(column % 1 - 0.5)) > 0.2 and 0 <= round(column) < 60
            )
            if not inside or not np.isfinite(share[round(row), round(column)]):
                continue
            want = viridis(np.clip(share[round(row), round(column)], 0, 1))
            agree += np.abs(seen[py, px] - want).max() <= 12
            total += 1
            assert re.search(r"48\.00\d{4}°, 11\.00\d{4}°|48\.00\d{4}°, 10\.99\d{4}°", words)
    assert total > 30
    assert (
        agree > 0.75 * total
    )  # the lane's border, the track and half a pixel of rounding cost some


@pytest.mark.slow("a browser draws every page")
def test_the_picture_follows_the_vehicle_until_it_is_moved(tmp_path, follow):
    feeder = Feeder(tmp_path)
    with follow(tmp_path) as page:
        feeder.give(START | {"lane": None})
        page.until("document.querySelector('#a-pol').value === 'HH'")
        assert page.page.get_attribute("#follow", "aria-pressed") == "true"
        box = page.page.locator("#lane").bounding_box()

        def middle():
            page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 200)
            return float(
                re.search(r"y (\S+) m", page.text("#readout").replace("\u2212", "-")).group(1)
            )

        feeder.give(scan(0, 20.0))
        wait_words(page, "1 scans")
        first = middle()
        feeder.give(scan(1, 50.0))
        wait_words(page, "2 scans")
        assert middle() == pytest.approx(first + 30, abs=0.5)
        page.page.keyboard.press("ArrowRight")
        assert page.page.get_attribute("#follow", "aria-pressed") == "false"
        feeder.give(scan(2, 20.0))
        wait_words(page, "3 scans")
        moved = middle()
        page.page.keyboard.press("l")
        assert page.page.get_attribute("#follow", "aria-pressed") == "true"
        assert middle() == pytest.approx(first, abs=0.5) != pytest.approx(moved, abs=0.5)


@pytest.mark.slow("a browser draws every page")
def test_the_threshold_hides_weak_alarms_and_keeps_its_place(live):
    page, feeder = live
    told = [alarm(f"alarm-{k}", 0.1 * k, 10.0 + k, float(k), 2.0) for k in range(1, 7)]
    feeder.give(scan(0, 2.0), *told)
    wait_words(page, "6 alarms")
    assert page.page.locator("#live li").count() == 6
    page.page.locator("#threshold").fill("3")  # at 4.0: alarms 4, 5 and 6
    assert page.page.locator("#live li").count() == 3
    assert "Alarms (3 of 6)" in page.text("#list-title")
    feeder.give(alarm("alarm-7", 0, 15.0, 7.5, 2.0), alarm("alarm-8", 0, 15.0, 0.5, 2.0))
    wait_words(page, "8 alarms")
    assert "Alarms (4 of 8)" in page.text("#list-title")
    assert page.page.locator("#live li").count() == 4


@pytest.mark.slow("a browser draws every page")
def test_news_take_neither_focus_nor_clicks_away(live):
    page, feeder = live
    told = [alarm(f"alarm-{k}", 0.1 * k, 10.0 + k, float(k), 2.0) for k in range(1, 7)]
    feeder.give(scan(0, 2.0), *told)
    wait_words(page, "6 alarms")
    button = page.page.locator("#rows button", has_text="alarm-4")
    button.focus()
    box = button.bounding_box()
    page.page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.page.mouse.down()
    changed = [
        alarm(f"alarm-{k}", 0.1 * k, 10.0 + k, float(k) + 0.25, 2.0, "update") for k in range(1, 7)
    ]
    feeder.give(scan(1, 2.5), *changed, alarm("alarm-7", 0, 20.0, 0.5, 2.0))
    wait_words(page, "7 alarms")
    assert page.page.evaluate("document.activeElement.textContent") == "alarm-4"
    page.page.mouse.up()
    assert page.text("#alarm-title") == "alarm-4"
    assert "4.25" in page.text("#rows tr[aria-selected=true]")
    feeder.give(
        alarm("alarm-1", 0.1, 11.0, 9.5, 2.0, "update"),
        alarm("alarm-6", 0.6, 16, 6.0, 2.0, "withdrawn"),
    )
    wait_words(page, "6 alarms")
    names = page.page.eval_on_selector_all(
        "#rows button", "(all) => all.map((one) => one.textContent)"
    )
    assert names == ["alarm-1", "alarm-5", "alarm-4", "alarm-3", "alarm-2", "alarm-7"]
    assert page.text("#alarm-title") == "alarm-4"


@pytest.mark.slow("a browser draws every page")
def test_live_alarms_are_exported_with_their_place_on_earth(live):
    page, feeder = live
    feeder.give(
        scan(0, 2.0), alarm("alarm-1", 1.0, 14.5, 4.5, 2.0), alarm("alarm-2", 0.0, 16.0, 2.0, 2.0)
    )
    wait_words(page, "2 alarms")
    _, data = page.saved("#export-csv")
    rows = list(csv.DictReader(io.StringIO(data.decode())))
    assert [(row["alarm_id"], float(row["y"])) for row in rows] == [
        ("alarm-1", 14.5),
        ("alarm-2", 16.0),
    ]
    name, data = page.saved("#export-geojson")
    assert name == "flgpr-alarms.geojson"
    longitude, latitude = json.loads(data)["features"][0]["geometry"]["coordinates"]
    assert latitude == pytest.approx(48 + 14.5 / 111_207, abs=1e-6)
    assert longitude == pytest.approx(11 + 1.0 / 74_635, abs=1e-6)
    _, data = page.saved("#export-svg")
    assert b"alarm-1" in data or b"m</text>" in data


@pytest.mark.slow("a browser draws every page")
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080)])
def test_nothing_is_cut_off_live(tmp_path, follow, scheme, size):
    feeder = Feeder(tmp_path)
    told = [alarm(f"alarm-{100 + k}", (-1) ** k * 0.3 * k, 6.0 + k, 12.34, 2.0) for k in range(9)]
    counts = dict.fromkeys(
        ("late", "duplicate", "corrupt", "masked", "pose_filled", "pose_missing"), 123
    )
    feeder.give(START, scan(0, 2.0), *told, {"event": "counts", **counts})
    with follow(tmp_path, size=size, scheme=scheme) as page:
        wait_words(page, "9 alarms")
        over = page.page.evaluate(
            """() => [...document.querySelectorAll('header, #display, #under, aside, #live, #live li')]
                .filter((e) => e.scrollWidth > e.clientWidth + 1).map((e) => e.id || e.tagName)"""
        )
        assert over == []
        assert page.page.evaluate("document.getElementById('lane').clientHeight") > 250


@pytest.mark.slow("a browser draws every page")
def test_a_live_run_is_shown_as_it_is(tmp_path, follow):
    """From the radar's files to the page, with nothing between made up."""
    save_run(make_lane_run(), tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    feed(tmp_path / "run.zarr", tmp_path / "incoming", float("inf"))
    with follow(tmp_path / "out") as page:
        LiveRun(
            LiveOptions(
                tmp_path / "recipe.toml", tmp_path / "out", tmp_path / "incoming", vehicle=VEHICLE
            )
        ).run()
        wait_words(page, "ended")
        alarms = read_table(tmp_path / "out" / "alarms.csv", "alarms")
        assert f"{SCANS} scans, {len(alarms)} alarms" in page.text("#live-words")
        assert "not understood" not in page.text("#live-words")
        page.page.keyboard.press("n")
        assert page.text("#alarm-title") == alarms["alarm_id"][0]
        _, data = page.saved("#export-csv")
        rows = list(csv.DictReader(io.StringIO(data.decode())))
        assert [row["alarm_id"] for row in rows] == alarms["alarm_id"].tolist()
        assert [float(row["confidence"]) for row in rows] == pytest.approx(
            alarms["confidence"].tolist(), rel=1e-8
        )
        assert LANE.y_min < alarms["y"].min()


@pytest.mark.slow("a browser draws every page")
def test_a_live_run_drives_over_the_picture_of_a_result(demo, tmp_path, serving, watch):
    feeder = Feeder(tmp_path)
    feeder.give(START, scan(0, 1.0), alarm("alarm-1", 0.5, 4.0, 4.5, 1.0))
    with serving([demo[0].folder], live=tmp_path) as viewer:
        page = watch(viewer)
        wait_words(page, "1 alarms")
        before = page.pixels()
        assert page.page.input_value("#a-band") == "0.45-1.5"
        assert "of 11" in page.text("#list-title")
        feeder.give(alarm("alarm-2", -0.5, 3.0, 4.5, 1.0))
        wait_words(page, "2 alarms")
        assert np.abs(page.pixels() - before).max() > 20
        page.page.keyboard.press("n")
        assert page.text("#alarm-title") == demo[0].detections[0].alarms["alarm_id"][0]
        page.close()
