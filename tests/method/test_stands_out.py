"""Which alarms stand out from those of their lane, without truth."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flgpr.method.imaged_run import ImagedRun
from flgpr.method.instead import describe_trust
from flgpr.method.method import detection_of, engine_of
from flgpr.method.sections import seen_part
from flgpr.method.stands_out import (
    ABOVE,
    DENSEST,
    FEWEST,
    bright_beside,
    tail_threshold,
    what_stands_out,
)
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe
from flgpr.report.overview import alarm_sentence
from flgpr.results.description import check_description
from small_lane import small_recipe, small_run

LANE = Lane(-1.5, 1.5, 0.0, 30.0)


def alarms_of(confidence, x=0.0):
    count = len(confidence)
    return pd.DataFrame(
        {
            "alarm_id": [f"alarm-{number}" for number in range(count)],
            "x": np.broadcast_to(x, count),
            "y": np.linspace(1.0, 29.0, count),
            "confidence": confidence,
        }
    )


def test_one_place_of_clutter_is_expected_as_strong():
    """The mean over many lanes of clutter whose tail is exponential, for a scale and a level of any kind."""
    rng = np.random.default_rng(1)
    beyond = []
    for _ in range(2000):
        clutter = 3.0 + 2.5 * rng.exponential(size=80)
        beyond.append((clutter > tail_threshold(clutter, LANE.area)).sum())
    assert 0.9 < np.mean(beyond) < 1.2


@pytest.mark.parametrize("strength", [15.0, 1e3])
def test_mines_do_not_hide_one_another(strength):
    """As many as a lane may hold, however strong they are, leave the threshold as that of clutter alone."""
    rng = np.random.default_rng(2)
    clutter = np.sort(rng.exponential(size=100))[::-1]
    mines = int(np.ceil(DENSEST * LANE.area))
    mixed = np.concatenate([clutter[mines:], clutter[0] + strength * np.ones(mines)])
    want = tail_threshold(clutter, LANE.area)
    assert tail_threshold(mixed, LANE.area) == pytest.approx(want)
    assert (mixed > want).sum() == mines + (clutter[mines:] > want).sum()


def test_a_lane_with_few_alarms_has_no_tail():
    enough = int(np.ceil(DENSEST * LANE.area)) + FEWEST + 1
    assert tail_threshold(np.arange(enough - 1.0), LANE.area) is None
    assert tail_threshold(np.arange(float(enough)), LANE.area) is not None
    told = what_stands_out(alarms_of(np.arange(5.0)), LANE)
    assert (told.source, told.border, told.count, told.weak) == ("", None, 0, 5)
    assert told.sentences() == ["5 places, too few to say which of them stand out"]
    assert what_stands_out(alarms_of([]), LANE).sentences() == ["no place was raised"]


class Decides:
    border = 0.5


def test_a_trained_detector_decides():
    told = what_stands_out(alarms_of([3.0, 0.5, 0.4, -1.0]), LANE, Decides())
    assert (told.source, told.border, told.count, told.weak) == ("model", 0.5, 2, 2)
    assert told.sentences()[0] == "2 places stand out, 2 are weak"


def test_the_threshold_for_a_rate_comes_first():
    alarms = alarms_of([3.0, 0.5, 0.4, -1.0]).assign(**{ABOVE: [1, 0, 0, 0]})
    told = what_stands_out(alarms, LANE, Decides())
    assert (told.source, told.border, told.count) == ("rate", 3.0, 1)
    none = what_stands_out(alarms.assign(**{ABOVE: 0}), LANE, Decides())
    assert none.count == 0
    assert none.border > 3.0
    assert none.sentences()[0] == "no place stands out, 4 are weak"
    json.dumps(none.as_json(), allow_nan=False)


def test_alarms_beside_the_lane_do_not_count():
    told = what_stands_out(alarms_of([3.0, 2.0, 1.0], x=[0.0, 2.0, 0.0]), LANE, Decides())
    assert (told.count, told.weak, told.beside) == (2, 0, 1)
    assert told.sentences()[0] == "2 places stand out, 0 are weak, 1 stands out beside the lane"


def test_a_lane_that_no_scan_saw_has_no_answer():
    told = what_stands_out(alarms_of([]), seen_part(LANE, Lane(-1.5, 1.5, 40.0, 60.0)))
    assert told.sentences()[0].startswith("no answer: no scan sees the lane")
    assert seen_part(LANE, Lane(-9.0, 9.0, 10.0, 60.0)) == Lane(-1.5, 1.5, 10.0, 30.0)


def test_too_many_places_are_a_doubt_about_the_run():
    told = what_stands_out(alarms_of(np.ones(20)), LANE, Decides())
    assert "more than a road holds" in told.sentences()[-1]
    assert told.density == pytest.approx(20 / LANE.area)


def test_bright_things_beside_the_lane_are_told_where_the_contrast_ranks():
    places = pd.DataFrame({"x": [0.0, 1.0, 2.0, -2.5, 2.2], "y": 5.0})
    beside = places.assign(magnitude=[3.0, 4.0, 9.0, 4.5, 4.0])
    (told,) = bright_beside(beside, LANE)
    assert told.startswith("brighter than all in the lane, beside it: 2; the contrast misses mines")
    assert bright_beside(places.assign(magnitude=[3.0, 9.0, 2.0, 4.5, 4.0]), LANE) == []
    assert bright_beside(beside[2:], LANE) == []  # nothing in the lane to compare with
    assert bright_beside(beside[:0], LANE) == []


@pytest.mark.parametrize(("ranks", "count"), [("contrast", 1), ("magnitude", 0)])
def test_only_a_ranking_by_contrast_says_what_bright_things_hide(ranks, count):
    text = f'confidence = "{ranks}"\n' + small_recipe()
    narrow = Lane(-0.3, 0.3, 3.0, 10.0)  # the scatterer at x = -0.4 lies beside it
    one = ImagedRun(small_run(), parse_recipe(text), narrow, explains=False)
    engine_of(one).run()
    detection = detection_of(one)
    outshone = detection.alarms.assign(magnitude=detection.alarms["x"].abs())
    said = describe_trust(one, [replace(detection, alarms=outshone)])["stands_out"]["notes"]
    assert sum("brighter than all in the lane" in sentence for sentence in said) == count


def test_an_alarm_is_explained():
    alarm = {"x": 1.4, "y": 3.0, "confidence": 5.0, "scans": 1.0, "roadside": 0.8}
    said = alarm_sentence(alarm, LANE, 4.0)
    assert said == (
        "confidence 5 (4 suffices), seen by one scan only: take another look, 80 % of it is the roadside's, "
        "at the edge of the lane"
    )
    higher = alarm | {"height": 0.414, "height_low": 0.3, "height_high": 0.5}
    assert "roadside's, at a height of 0.41 m (0.30 to 0.50), at" in alarm_sentence(higher, LANE, 4)
    plain = {"x": 0.0, "y": 3.0, "confidence": 0.0, "p": 0.5, "scans": 3.0, "roadside": np.nan}
    assert alarm_sentence(plain, LANE, -1.0) == (
        "probability 0.50 where mines are as frequent as in training, seen by 3 scans"
    )


def test_what_a_manifest_holds_of_it_is_checked():
    for told in (
        what_stands_out(alarms_of([3.0, -1.0]), LANE, Decides()),
        what_stands_out(alarms_of([]), LANE),
    ):
        check_description({"stands_out": told.as_json()})
    check_description({})  # of a version before


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("stands_out", []),
        ("stands_out.notes", "3 places"),
        ("stands_out.notes", [3]),
        ("stands_out.border", "high"),
        ("stands_out.border", True),
        ("stands_out.border", float("nan")),
        ("stands_out.source", 7),
    ],
)
def test_a_forged_manifest_is_refused(entry, value):
    first, _, inner = entry.partition(".")
    with pytest.raises(ValueError, match=rf"run\.{entry} must be"):
        check_description({first: {inner: value} if inner else value})
