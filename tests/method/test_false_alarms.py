"""Thresholds for a false-alarm rate: of training lanes, and of the lane itself."""

import math

import numpy as np
import pytest

from flgpr.method.stands_out import (
    MOST_KEPT,
    free_ground,
    own_threshold,
    threshold_of_lane,
    training_threshold,
)
from flgpr.method.unlike import FreeGround


def lane(rng, area=100.0, density=0.3, shift=0.0):
    """Alarms at no target of a lane whose level is its own."""
    count = rng.poisson(density * area)
    return free_ground(rng.normal(shift + rng.normal(0.0, 0.5), 1.0, count), area)


def test_a_lane_has_no_more_alarms_above_its_threshold_than_the_rate_allows():
    confidence = [5.0, 4.0, 3.0, 2.0, 1.0]
    assert threshold_of_lane(confidence, 10.0, 0.2) == 3.0  # two alarms lie above it
    assert threshold_of_lane(confidence, 30.0, 0.1) == 2.0  # 0.1 * 30 is a hair less than three
    assert threshold_of_lane(confidence, 10.0, 0.05) == 5.0
    assert threshold_of_lane(confidence, 10.0, 0.5) == -math.inf


@pytest.mark.parametrize("count", [19, 39])
def test_on_new_lanes_like_those_of_training_the_rate_holds_as_often_as_is_said(count):
    rng = np.random.default_rng(count)
    trials = 1500
    held = 0
    for _ in range(trials):
        known = training_threshold([lane(rng) for _ in range(count)], 0.05)
        new = lane(rng)
        above = sum(value > known.threshold for value in new.confidence)
        held += above <= 0.05 * new.area
    share = held / trials
    error = np.sqrt(0.05 * 0.95 / trials)
    assert known.share == pytest.approx(0.95, abs=0.001)
    # No less than said, and not by being so high that nothing is ever above it.
    assert share > known.share - 3 * error
    assert share < known.share + 4 * error


def test_few_lanes_promise_less():
    rng = np.random.default_rng(1)
    known = training_threshold([lane(rng) for _ in range(9)], 0.05)
    assert known.share == 0.9
    assert "holds on 90 % of lanes like the 9 of training" in known.words(3)


def test_the_lanes_own_threshold_keeps_the_rate_whatever_lies_there():
    rng = np.random.default_rng(2)
    for _ in range(200):
        area = rng.uniform(5.0, 200.0)
        rate = rng.uniform(0.01, 0.3)
        confidence = rng.standard_cauchy(rng.integers(0, 80))
        threshold = own_threshold(confidence, area, rate)
        assert (confidence > threshold.threshold).sum() <= rate * area + 1e-9
        assert threshold.source == "lane"


def test_what_is_not_known_is_said():
    assert "train it again on 3 lanes or more" in training_threshold([], 0.1).words(0)
    assert training_threshold([], 0.1).threshold is None
    known = [FreeGround(area=10.0, confidence=[1.0])] * 3
    too_high = training_threshold(known, 2 * MOST_KEPT)
    assert too_high.threshold is None
    assert too_high.as_json(0)["threshold"] is None
    assert f"keeps {MOST_KEPT:g} alarms per m²" in too_high.words(0)


def test_of_a_training_lane_the_strongest_alarms_are_kept():
    kept = free_ground(np.array([1.0, np.nan, 3.0, *np.zeros(200)]), 20.0)
    assert kept.confidence[:2] == [3.0, 1.0]
    assert len(kept.confidence) == MOST_KEPT * 20 + 1
