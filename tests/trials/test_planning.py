import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from slow_scoring import fewest_mines

from flgpr.model import Lane, check_truth
from flgpr.scoring import clopper_pearson, poisson_interval
from flgpr.trials import area_needed, emplacement_plan, mines_needed, sample_size

SORTS = pd.DataFrame(
    {"kind": ["metal", "plastic"], "depth": [0.05, 0.1], "count": [6, 4], "soil": ["clay", "sand"]}
)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([0.5, 0.8, 0.9, 0.95]), st.integers(0, 5), st.sampled_from([0.8, 0.9, 0.95]))
def test_mines_needed_is_the_smallest_number_by_counting_up(pd_claim, misses, confidence):
    assert mines_needed(pd_claim, misses, confidence) == fewest_mines(pd_claim, misses, confidence)


def test_the_smallest_plan_is_the_textbook_one():
    plan = sample_size(0.9, 0.01, 0.95)
    assert (plan.mines, plan.misses, plan.false_alarms) == (29, 0, 0)
    assert plan.area == pytest.approx(-math.log(0.05) / 0.01)
    assert math.isnan(plan.pd_power)
    joint = sample_size(0.9, 0.01, 0.95, joint=True)
    assert joint.mines == 36  # 0.9^36 < 0.025 < 0.9^35
    assert joint.area == pytest.approx(-math.log(0.025) / 0.01)


def test_a_plan_shows_what_it_promises_and_no_smaller_one_does():
    plan = sample_size(0.9, 0.01, 0.95, true_pd=0.97, true_far=0.004, power=0.8)
    low = clopper_pearson(plan.mines - plan.misses, plan.mines, 0.9)[0]
    high = poisson_interval(plan.false_alarms, plan.area, 0.9)[1]
    assert low >= 0.9
    assert clopper_pearson(plan.mines - 1 - plan.misses, plan.mines - 1, 0.9)[0] < 0.9
    assert high == pytest.approx(0.01)
    assert plan.pd_power == pytest.approx(stats.binom.cdf(plan.misses, plan.mines, 0.03))
    assert plan.far_power == pytest.approx(stats.poisson.cdf(plan.false_alarms, 0.004 * plan.area))
    assert min(plan.pd_power, plan.far_power) >= 0.8
    fewer = mines_needed(0.9, plan.misses - 1, 0.95)
    assert stats.binom.cdf(plan.misses - 1, fewer, 0.03) < 0.8


def test_power_by_simulation():
    plan = sample_size(0.8, 0.05, 0.9, true_pd=0.95, true_far=0.02, power=0.85)
    rng = np.random.default_rng(0)
    runs = 20_000
    passed = (rng.binomial(plan.mines, 0.05, runs) <= plan.misses).mean()
    assert passed == pytest.approx(plan.pd_power, abs=4 * math.sqrt(0.25 / runs))
    # A detector that just misses the claim passes at most once in ten.
    assert (rng.binomial(plan.mines, 0.2, runs) <= plan.misses).mean() <= 0.1 + 4 * math.sqrt(
        0.09 / runs
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pd": 1.0}, "pd must lie between"),
        ({"far": 0.0}, "far must be positive"),
        ({"confidence": 95}, "confidence must lie between"),
        ({"power": 0}, "power must lie between"),
        ({"true_pd": 0.85}, "true_pd must be above"),
        ({"true_far": 0.02}, "true_far must be under"),
        ({"true_far": 0.00999}, "true_far must be further under"),
    ],
)
def test_plans_that_cannot_be_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        sample_size(**change)


def test_sizes_check_their_arguments():
    with pytest.raises(ValueError, match="pd must lie"):
        mines_needed(1.0, 0)
    with pytest.raises(ValueError, match=r"pd must be so low .* got 0\.99999"):
        mines_needed(1.0 - 1e-15, 0)
    with pytest.raises(ValueError, match="misses must not"):
        mines_needed(0.9, -1)
    with pytest.raises(ValueError, match="far must be positive"):
        area_needed(math.nan, 0)
    with pytest.raises(ValueError, match=r"far must be so high .* got 1e-320"):
        area_needed(1e-320, 0)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.floats(0, 3), st.floats(0, 1))
def test_a_lane_plan_keeps_spacing_edge_and_counts(seed, spacing, edge):
    lanes = {"a": Lane(0, 4, 0, 60), "b": Lane(-2, 2, 100, 160)}
    plan = emplacement_plan(lanes, SORTS, seed, spacing=spacing, edge=edge)
    check_truth(plan)
    assert plan.groupby("kind").size().to_dict() == {"metal": 6, "plastic": 4}
    assert (plan["soil"] == np.where(plan["kind"] == "metal", "clay", "sand")).all()
    for name, lane in lanes.items():
        own = plan[plan["lane"] == name][["x", "y"]].to_numpy()
        inner = Lane(lane.x_min + edge, lane.x_max - edge, lane.y_min + edge, lane.y_max - edge)
        assert inner.contains(own[:, 0], own[:, 1]).all()
        apart = np.hypot(*(own[:, None] - own[None]).transpose(2, 0, 1))[
            np.triu_indices(len(own), 1)
        ]
        assert (apart >= spacing).all()
    pd.testing.assert_frame_equal(
        plan, emplacement_plan(lanes, SORTS, seed, spacing=spacing, edge=edge)
    )


def test_places_are_uniform_and_kinds_are_dealt_at_random():
    lane = Lane(0, 10, 0, 100)
    plans = [emplacement_plan(lane, SORTS, seed, spacing=0, edge=0) for seed in range(200)]
    y = np.concatenate([plan["y"] for plan in plans])
    assert stats.kstest(y / 100, "uniform").pvalue > 1e-4
    first = [plan["kind"].iloc[0] for plan in plans]
    assert stats.binomtest(first.count("metal"), 200, 0.6).pvalue > 1e-4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"targets": SORTS.drop(columns="count")}, "missing: count"),
        ({"targets": SORTS.assign(count=1.5)}, "whole and positive"),
        ({"targets": SORTS.assign(count="many")}, "whole and positive"),
        ({"targets": SORTS.iloc[:0]}, "whole and positive"),
        ({"targets": SORTS.assign(count=1e300)}, "at most 100000 targets, got 2e"),
        ({"targets": SORTS.assign(x=1.0)}, "columns that are drawn here, got x"),
        ({"targets": SORTS.assign(book="no.jsonl")}, "columns that are drawn here, got book"),
        ({"seed": -1}, "seed must not be negative, got -1"),
        ({"spacing": -1.0}, "spacing and edge must not"),
        ({"spacing": 50.0}, "found room for"),
        ({"edge": 2.0}, "edge must leave ground"),
    ],
)
def test_lanes_that_cannot_be_planned_are_named(change, message):
    arguments = {"lane": Lane(0, 4, 0, 60), "targets": SORTS, "seed": 1, **change}
    with pytest.raises(ValueError, match=message):
        emplacement_plan(**arguments)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"lane": ["A", "B"]}, "must not have columns that are drawn here, got lane"),
        ({"depth": ["5 cm", "0.1"]}, r"targets\.depth must be finite numbers \(m\), got '5 cm'"),
        ({"depth": [0.05, math.nan]}, r"targets\.depth must be finite numbers \(m\), got nan"),
        ({"kind": ["metal", " "]}, r"targets\.kind must say what each target is, got ' '"),
    ],
)
def test_sorts_that_would_be_planned_otherwise_than_they_say_are_refused(changed, words):
    with pytest.raises(ValueError, match=words):
        emplacement_plan(Lane(-2, 2, 0, 60), SORTS.assign(**changed), 1)
