"""Alarms that are too many to draw are grouped until zoomed; a slider goes through the scans."""

import re

import numpy as np
import pandas as pd
import pytest
from test_live_page import START, Feeder, alarm, scan

from flgpr.commands.raw_run import RawRun
from flgpr.live.events import view_event
from flgpr.viewer import Viewer
from long_lane import make_long_lane
from raw_lane import make_raw_lane

pytestmark = pytest.mark.slow("a browser draws every page")

GROUPED = "alarms grouped until zoomed"


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    return make_long_lane(tmp_path_factory.mktemp("crowded") / "lane", 1500, 3, alarms=5000)


def numbers(one):
    """Return the numbers on the groups of the picture, from its export."""
    _, data = one.saved("#export-svg")
    picture = data.decode().split('<g clip-path="url(#lane)">')[1].split("</g>")[0]
    return [int(number) for number in re.findall(r">(\d+)</text>", picture)]


def test_labels_of_close_targets_cover_neither_each_other_nor_a_target(watch, serving, tmp_path):
    places = np.array([[0.0, 5.0], [0.1, 5.6], [-0.3, 5.3], [0.2, 5.3], [0.0, 8.0], [0.0, 9.5]])
    truth = pd.DataFrame({"x": places[:, 0], "y": places[:, 1], "kind": "plastic", "depth": 0.05})
    truth.insert(0, "target_id", [f"t{number}" for number in range(len(truth))])
    lane = make_long_lane(tmp_path / "lane", 150, alarms=20, truth=truth)
    with serving([lane]) as viewer:
        _, data = watch(viewer, size=(1440, 900)).saved("#export-svg")
    label = r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>plastic 5\.0 cm<'
    labels = np.array(re.findall(label, data.decode()), float)
    assert 3 <= len(labels) < len(truth)
    offset = np.abs(labels[:, None] - labels)[~np.eye(len(labels), dtype=bool)]
    assert ((offset[:, 0] >= 68) | (offset[:, 1] >= 11)).all()


def test_five_thousand_alarms_are_grouped_by_density_until_zoomed(watch, serving, crowded):
    with serving([crowded]) as viewer:
        one = watch(viewer)
        page = one.page
        page.locator("#threshold").fill("100000")
        assert one.text("#threshold-left") == "5000 of 5000 alarms left"
        one.pixels()
        assert GROUPED in one.text("#badge")
        assert "so many alarms" in one.text("#legend")
        assert "a hit among them" in one.text("#legend")
        counts = numbers(one)
        assert 50 < len(counts) < 700
        assert 4950 <= sum(counts) <= 5000  # a cell with one alarm shows that alarm
        box = page.locator("#lane").bounding_box()
        for x in range(300, 340, 4):  # some group lies within a cell's breadth
            page.mouse.move(box["x"] + x, box["y"] + 250)
            words = one.page.text_content("#tip")
            if "highest confidence" in words:
                break
        assert re.match(r"\d+ alarms\n", words)
        for _ in range(6):
            if GROUPED not in one.text("#badge"):
                break
            page.mouse.click(box["x"] + x, box["y"] + 250)
            page.keyboard.press("+")
            one.pixels()
        assert GROUPED not in one.text("#badge")
        assert "so many alarms" not in one.text("#legend")
        page.keyboard.press("Escape")
        assert numbers(one) == []
        page.keyboard.press("f")
        page.locator("#threshold").fill("3")  # few are left: each is drawn
        one.pixels()
        assert GROUPED not in one.text("#badge")


def test_a_slider_marks_the_scans_of_a_result(watch, shown, demo):
    one = watch(shown)
    scans = len(demo[0].manifest["run"]["pose"])
    assert one.text("#scan-out") == f"all {scans} scans"
    before = one.pixels()
    one.page.locator("#scan").fill("1")
    assert re.match(rf"scan 1 of {scans}, y \S+ m", one.text("#scan-out"))
    assert np.abs(one.pixels() - before).max() > 50
    one.page.keyboard.press("h")
    assert one.text("#scan-out").startswith("scan 0 of")
    one.page.keyboard.press("j")
    assert one.text("#scan-out").startswith("scan 1 of")
    one.page.click("#scan-all")
    assert one.text("#scan-out") == f"all {scans} scans"
    assert np.abs(one.pixels() - before).max() == 0


def test_a_slider_goes_through_the_scans_of_a_run(watch, serving, tmp_path):
    make_raw_lane(tmp_path / "run.zarr", scans=60)
    with serving(Viewer([tmp_path / "run.zarr"], raw=RawRun)) as viewer:
        one = watch(viewer)
        one.until("document.getElementById('bscan').getAttribute('aria-busy') === 'false'")
        one.page.locator("#scan").fill("37")
        assert one.text("#raw-scan") == "scan 37"
        assert one.text("#scan-out").startswith("scan 37 of 60, y 6.3 m")
        one.page.focus("#bscan")
        one.page.keyboard.press("ArrowRight")
        assert one.text("#scan-out").startswith("scan 38 of 60")
        assert one.page.input_value("#scan") == "38"


@pytest.fixture
def driven(tmp_path, serving, watch):
    """The desk of a live run of four scans, each of which sees rows of the lane and changes an alarm."""
    feeder = Feeder(tmp_path)
    feeder.give(START)
    for number in range(4):
        rows = np.full((100, 60), 10.0 ** (number / 2), np.float32)  # 0, 10, 20, 30 dB
        feeder.give(scan(number, float(number)), view_event(50 * number, rows))
        feeder.give(alarm(f"alarm-{number}", 0.5, 8.0 + 2 * number, 4.0 + number, float(number)))
    feeder.give(alarm("alarm-1", 0.5, 10.0, 4.0, 3.0, "withdrawn"))
    with serving([], live=tmp_path) as viewer:
        one = watch(viewer)
        one.page.click("#to-desk")
        one.until("document.querySelectorAll('#rows tr').length === 3")
        yield one, feeder
        one.close()


def level(one, y):
    """Return the level at a place of the lane of 60 m that is in sight, dB, or what the page says of it."""
    box = one.page.locator("#lane").bounding_box()
    width = box["width"] - 98
    px = 46 + width / 2 + (y - 30) * 0.985 * width / 60
    one.page.mouse.move(box["x"] + px, box["y"] + box["height"] / 3)
    words = one.text("#readout").replace("\u2212", "-")
    assert float(re.match(r"y (\S+) m", words).group(1)) == pytest.approx(y, abs=0.3)
    found = re.search(r"\((\S+) re", words)
    return round(float(found.group(1))) if found else one.page.text_content("#tip")


def test_a_live_run_goes_back_in_time_and_comes_back(driven):
    one, feeder = driven
    page = one.page
    assert one.text("#scan-out") == "now: 4 scans"
    assert [level(one, y) for y in (2.0, 7.0, 12.0, 18.0)] == [0, 10, 20, 30]
    page.locator("#scan").fill("1")
    assert one.text("#scan-out") == "scan 1 of 4, y 1.0 m"
    assert "vehicle at y 1.0 m" in one.text("#live-words")
    assert "Gone back to scan 1" in one.text("#live-then")
    assert page.locator("#rows tr").all_inner_texts()[0].split()[0] == "alarm-1"
    assert page.locator("#rows tr").count() == 2
    assert [level(one, y) for y in (2.0, 7.0, 12.0)] == [0, 10, 10]
    assert level(one, 18.0).startswith("seen by no scan")
    feeder.give(scan(4, 4.0), alarm("alarm-4", -0.5, 20.0, 9.0, 4.0))
    one.until("document.getElementById('scan').max === '4'")
    assert one.text("#scan-out") == "scan 1 of 5, y 1.0 m"  # what comes meanwhile waits
    assert page.locator("#rows tr").count() == 2
    page.click("#scan-all")
    assert one.text("#scan-out") == "now: 5 scans"
    assert page.locator("#rows tr").count() == 4
    assert "vehicle at y 4.0 m" in one.text("#live-words")
    assert [level(one, y) for y in (7.0, 12.0)] == [10, 20]


def test_the_drivers_screen_shows_what_is_known_now(driven):
    one, _ = driven
    one.page.locator("#scan").fill("0")
    assert one.page.locator("#live-then").count() == 1
    one.page.click("#to-drive")
    assert one.page.locator("#scrub").is_hidden()
    one.page.click("#to-desk")
    assert one.text("#scan-out") == "now: 4 scans"


def test_going_back_keeps_the_threshold(driven):
    one, _ = driven
    one.page.locator("#threshold").fill("2")  # alarm-3 and alarm-2
    chosen = one.text("#threshold-out")
    one.page.locator("#scan").fill("0")  # alarm-0 alone, weaker
    assert one.page.locator("#rows tr").count() == 0
    one.page.click("#scan-all")
    assert one.text("#threshold-out") == chosen
    assert one.page.locator("#rows tr").count() == 2
