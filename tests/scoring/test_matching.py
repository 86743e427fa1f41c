"""Matching: lanes by name, halos with their border, subsets, and tables of another place."""

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.scoring import as_lanes, match, select_targets
from flgpr.scoring.matching import pairs_within
from flgpr.scoring.places import Refraction

LANE = Lane(-2.0, 2.0, 0.0, 60.0)


def alarms(*rows):
    return pd.DataFrame(rows, columns=["x", "y", "confidence"], dtype=float)


def truth(*rows, **columns):
    table = pd.DataFrame(rows, columns=["x", "y"], dtype=float)
    names = [f"m{number}" for number in range(len(rows))]
    return table.assign(target_id=names, **{"kind": "metal", "depth": 0.05, **columns})


def test_an_alarm_on_the_border_of_a_halo_is_within():
    matched = match(alarms([0, 11, 1], [0, 11.001, 2]), truth([0, 10]), LANE, halo=1.0)
    assert matched.in_halo.tolist() == [True, False]
    assert matched.false.tolist() == [False, True]
    assert matched.pair_distance.tolist() == [1.0]


def test_a_diameter_is_twice_a_radius():
    table = alarms([0, 10.6, 1])
    assert match(table, truth([0, 10]), LANE, 1.0).in_halo.all()
    assert not match(table, truth([0, 10]), LANE, 1.0, halo_as="diameter").in_halo.any()


def test_the_best_alarm_is_the_most_confident_then_the_nearest_then_the_first():
    table = alarms([0, 10.5, 2], [0, 10.2, 3], [0, 9.9, 3], [0, 10.1, 3])
    alarm, confidence, distance = match(table, truth([0, 10]), LANE).best()
    assert (alarm.tolist(), confidence.tolist()) == ([2], [3.0])
    assert distance[0] == pytest.approx(0.1)


def test_a_shared_alarm_counts_for_a_subset_only_if_that_is_asked_for():
    matched = match(alarms([0, 10.5, 1]), truth([0, 10], [0, 11]), LANE)
    chosen = np.array([True, False])
    assert matched.best(chosen)[0].tolist() == [-1, -1]
    assert matched.best(chosen, "count")[0].tolist() == [0, -1]


def test_to_the_nearest_target_an_alarm_belongs_to_one():
    table = alarms([0, 10.4, 1])
    targets = truth([0, 10], [0, 11])
    assert len(match(table, targets, LANE).pair_alarm) == 2
    assert match(table, targets, LANE, assignment="nearest").pair_target.tolist() == [0]


def test_alarms_meet_targets_of_their_own_lane_only():
    lanes = {"a": LANE, "b": LANE}
    matched = match(
        alarms([0, 10, 1], [0, 10, 2]).assign(lane=["a", "b"]),
        truth([0, 10]).assign(lane="b"),
        lanes,
    )
    assert matched.pair_alarm.tolist() == [1]
    assert matched.alarm_lane.tolist() == [0, 1]


def test_refraction_moves_the_target_away_from_the_radar():
    buried = truth([0, 10], depth=0.10)
    moved = match(alarms([0, 10, 1]), buried, LANE, refraction=Refraction(10.7)).truth
    assert moved["y"].iloc[0] > 10.2
    assert moved["x"].iloc[0] == 0


def test_areas_are_the_lane_less_the_halos():
    matched = match(alarms(), truth([0, 10], [2, 30]), LANE, 1.0)
    assert matched.lane_areas()[0] == pytest.approx(240 - 1.5 * np.pi)
    assert matched.lane_areas("paper")[0] == pytest.approx(240 - 2 * np.pi)


def test_lanes_by_name_or_without_one():
    assert as_lanes(LANE) == {"": LANE}
    borders = {"x_min": -2, "x_max": 2, "y_min": 0, "y_max": 60}
    assert as_lanes(pd.DataFrame([{"lane": "a", **borders}])) == {"a": LANE}
    with pytest.raises(ValueError, match="lane must name every lane once, got a, a"):
        as_lanes(pd.DataFrame([{"lane": "a", **borders}] * 2))
    with pytest.raises(ValueError, match="at least one lane, got an empty mapping"):
        as_lanes({})


@pytest.mark.parametrize(
    ("subset", "expected"),
    [
        (None, [True, True, True]),
        ("m1", [False, True, False]),
        (["m0", "m2"], [True, False, True]),
        ({"kind": "metal"}, [True, False, True]),
        ({"kind": "metal", "depth": lambda depth: depth > 0.1}, [False, False, True]),
        (lambda table: table["depth"] < 0.1, [True, False, False]),
        (np.array([True, False, False]), [True, False, False]),
    ],
)
def test_subsets(subset, expected):
    table = truth(
        [0, 1], [0, 2], [0, 3], kind=["metal", "plastic", "metal"], depth=[0.05, 0.1, 0.2]
    )
    assert select_targets(table, subset).tolist() == expected


@pytest.mark.parametrize(
    ("subset", "rule"),
    [
        ("m9", "subset must name target_id of truth, got 'm9'"),
        ({"soil": "sand"}, "subset must name columns of truth, got 'soil'"),
        ({"kind": "wood"}, r"at least one target, got .* of 1 targets \(metal\)"),
        ([True, False], "one truth value per target"),
    ],
)
def test_a_subset_that_selects_nothing_is_refused(subset, rule):
    with pytest.raises(ValueError, match=rule):
        select_targets(truth([0, 1]), subset)


@pytest.mark.parametrize(
    ("points", "rule"),
    [
        ([[10, 0.1], [20, -1], [30, 0], [40, 1], [50, 1]], "are the axes swapped"),
        ([[400_000, 5_700_000]], "are these map coordinates"),
        ([[13.1, 52.4]] * 2, "are these degrees of longitude and latitude"),
        ([[0, 200]], "is it the right lane"),
    ],
)
def test_a_table_of_another_place_is_refused(points, rule):
    table = alarms(*[[*point, 1] for point in points])
    with pytest.raises(ValueError, match=rule):
        match(table, truth([0, 10]), Lane(-2.0, 2.0, 0.0, 40.0) if "degrees" in rule else LANE)


def test_pairs_are_those_of_the_plain_formula():
    rng = np.random.default_rng(3)
    first = rng.uniform(0, 3, (40, 2))
    second = rng.uniform(0, 3, (30, 2))
    row, column, distance = pairs_within(first, second, 0.5)
    table = np.hypot(*(first[:, None] - second[None]).transpose(2, 0, 1))
    assert set(zip(row.tolist(), column.tolist(), strict=True)) == set(
        zip(*(axis.tolist() for axis in np.nonzero(table <= 0.5)), strict=True)
    )
    np.testing.assert_array_equal(distance, table[row, column])
    assert pairs_within(first, second[:0], 0.5)[0].size == 0
