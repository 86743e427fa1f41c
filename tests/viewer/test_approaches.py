"""Approaches to the mines of the packaged drive: the driver is warned, and told to brake early enough.

``FLGPR_APPROACHES`` tells how many there are at each of three speeds: 20 for the sixty of the page.
"""

from collections import Counter

import pytest
from approaching import APPROACHES, CLOCK_OF_SERVER, SPEEDS, all_approaches

from flgpr.model.vehicle import Vehicle

pytestmark = pytest.mark.slow("drives many times")
CAUTION = 2.0  # s, within which no screen may be green, beside the stopping distance


def says_to_brake(shown):
    """Tell whether the driver is told to brake for an alarm; the loss of the radar would stop the vehicle as well."""
    return shown["word"] in ("brake", "stop") and not shown["state"]


def test_brake_comes_early_enough_and_no_screen_is_green_before_an_alarm(tmp_path, serving, watch):
    number = frames_near = 0
    green = Counter()
    over = []
    words = Counter()
    abrupt = []
    with serving([], live=tmp_path) as viewer:
        page = watch(viewer, script=CLOCK_OF_SERVER)
        for start, speed, frames in all_approaches(
            page.page, tmp_path / "live.jsonl", says_to_brake
        ):
            stopping = Vehicle.of(
                speed=speed,
                reaction=start["vehicle"]["reaction"],
                deceleration=start["vehicle"]["deceleration"],
            ).stopping_distance
            for frame in frames:
                words[frame.shown["word"]] += 1
                if frame.counts and 0 < frame.left < stopping + CAUTION * speed:
                    frames_near += 1
                    green[number] += frame.shown["word"] == "clear"
            told = [one.shown["word"] for one in frames if not one.shown["state"]]
            if told[told.index("brake") - 1] != "slow":
                abrupt.append(number)
            if frames[-1].left <= 0 or frames[-1].speed > 0:
                over.append((number, 3.6 * speed, frames[-1].left))
            number += 1
        page.close()
    assert number == APPROACHES * len(SPEEDS)
    print(
        f"{frames_near} frames near an alarm, {sum(green.values())} green; over: {over}; {words}; abrupt: {abrupt}"
    )
    assert frames_near > 16 * number  # the test could fail
    assert sum(green.values()) == 0
    assert over == []
    assert abrupt == []  # amber before red
    assert words["clear"] > 0
    assert min(words[word] for word in ("slow", "brake", "stop")) > 0
