"""Today and the earlier drive blink by one button, which keeps place and zoom."""

import numpy as np
import pytest
from test_drive_page import CLOCK, Screen
from test_live_page import Feeder, scan
from test_small_screens import CUT, lane_of

from small_results import small_result

pytestmark = pytest.mark.slow("a browser draws every page")


@pytest.fixture(scope="module")
def two_days(tmp_path_factory, serving):
    folder = small_result(tmp_path_factory.mktemp("days") / "result", days=True)
    with serving([folder]) as viewer:
        yield viewer


@pytest.mark.parametrize("size", [(1440, 900), (820, 1180), (390, 844)])
def test_one_button_blinks_between_today_and_the_earlier_drive(watch, two_days, size):
    one = watch(two_days, size=size)
    page = one.page
    page.keyboard.press("+")
    page.keyboard.press("ArrowRight")
    changed = one.pixels()
    button = page.locator("#days")
    button.click()
    shown = [page.locator(f"#{side}-set option:checked").inner_text() for side in "ab"]
    assert shown == ["today", "earlier drive"]
    today = one.pixels()
    assert button.get_attribute("aria-pressed") == "true"
    box = button.bounding_box()
    assert box["x"] > 0
    assert box["x"] + box["width"] < size[0]
    button.click()  # without motion the button turns the page
    earlier = one.pixels()
    for picture in (today, earlier):
        assert np.array_equal(picture[-30:], changed[-30:])  # the axis below
    assert np.abs(today - earlier).mean() > 2
    page.keyboard.press("w")
    assert page.input_value("#a-set") == "0/main"
    beside = np.s_[:, :-60]  # the buttons, of which one is pressed
    assert np.array_equal(one.pixels()[beside], changed[beside])


def test_a_result_of_one_drive_has_no_such_button(watch, shown):
    one = watch(shown)
    assert one.page.locator("#days").is_hidden()
    one.page.keyboard.press("w")
    assert one.page.input_value("#a-set").endswith("/main")


@pytest.mark.parametrize("size", [(1440, 900), (820, 1180), (390, 844)])
def test_a_live_page_says_that_alarms_are_changes(watch, serving, tmp_path, size):
    feeder = Feeder(tmp_path)
    words = (
        "what an earlier drive predicts is subtracted, so what lay there then does not stand out"
    )
    feeder.give(lane_of(2.0) | {"notes": [words]}, scan(0, 0.0), scan(1, 1.0))
    feeder.give({"event": "counts", "without_earlier": 7})
    with serving([], live=tmp_path) as viewer:
        one = watch(viewer, size=size, script=CLOCK)
        screen = Screen(one, tmp_path)
        screen.alive()
        screen.pass_time(600)
        assert screen.says()["drive-prior"] == "what lay there before is not shown"
        assert screen.page.evaluate(CUT) == []
        screen.page.click("#to-desk")
        assert one.text("#live-changes") == f"W{words[1:]}."
        assert "7 beside every earlier drive" in one.text("#live-faults")
        one.close()
