"""Numbers of the ROC and their intervals, against scikit-learn and samples of known truth."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from sklearn.metrics import roc_auc_score

from flgpr_papers.flsar2004 import findings as fi
from flgpr_papers.flsar2004 import machines as ma

pytestmark = pytest.mark.slow("studies of papers")


def scores_of(mine, clutter, target=None):
    mine = np.asarray(mine, float)
    clutter = np.asarray(clutter, float)
    clutter = clutter[:, None] if clutter.ndim == 1 else clutter
    target = np.arange(len(mine)).astype(str) if target is None else np.asarray(target)
    return ma.HeldOut(mine, clutter, target, np.arange(len(clutter)).astype(str), np.ones(1))


def test_area_is_scikit_learns_and_its_interval_covers():
    rng = np.random.default_rng(1)
    one = scores_of(rng.normal(1, 1, 40), rng.normal(0, 1, 90))
    label = np.repeat([1, 0], [40, 90])
    assert fi.auc(one) == pytest.approx(
        roc_auc_score(label, np.concatenate([one.mine, one.clutter.ravel()]))
    )
    # Φ(1/√2)
    truth = 0.7602
    hits = 0
    for seed in range(60):
        draw = np.random.default_rng(seed)
        value = fi.auc_interval(scores_of(draw.normal(1, 1, 30), draw.normal(0, 1, 60)), 200)
        hits += value[1] <= truth <= value[2]
    assert hits >= 50  # 95 % of 60 less three standard errors


def test_looks_at_one_mine_widen_the_interval():
    rng = np.random.default_rng(2)
    mine = rng.normal(1, 1, 30)
    clutter = rng.normal(0, 1, 300)
    alone = fi.auc_interval(scores_of(mine, clutter), 500)
    twice = fi.auc_interval(
        scores_of(np.repeat(mine, 2), clutter, np.repeat(np.arange(30), 2)), 500
    )
    wrong = fi.auc_interval(scores_of(np.repeat(mine, 2), clutter), 500)
    assert twice[2] - twice[1] == pytest.approx(alone[2] - alone[1], rel=0.15)
    assert wrong[2] - wrong[1] < 0.9 * (twice[2] - twice[1])


def test_paired_differences_are_tighter_than_independent_ones():
    rng = np.random.default_rng(3)
    mine = rng.normal(1, 1, 50)
    clutter = rng.normal(0, 1, 100)
    a = scores_of(mine, clutter)
    b = scores_of(mine + rng.normal(0, 0.1, 50), clutter)
    measure = fi.Measure(area=200.0, far=0.07, draws=500)
    value, low, high = measure.difference(a, b)
    assert low <= value <= high
    alone = measure.interval(a)
    assert high - low < 0.5 * (alone[2] - alone[1])


def test_partial_area_and_pd_are_those_of_the_curve():
    rng = np.random.default_rng(5)
    for repeats in (1, 3):
        one = scores_of(rng.normal(1, 1, 30), rng.normal(0, 1, (80, repeats)))
        area = 160.0
        curve = fi.roc(one, area)
        far = curve["far"].to_numpy()
        pd_of = curve["pd"].to_numpy()
        for limit in (0.04, 0.07, 0.3):
            grid = (np.arange(20_000) + 0.5) / 20_000 * limit
            step = pd_of[np.searchsorted(far, grid, side="right") - 1]
            # Each output of clutter stands for the mines above it: the curve's value before it
            # falls due.
            assert fi.Measure(area, limit).value(one) == pytest.approx(step.mean(), abs=0.02)
            at = pd_of[np.searchsorted(far, limit, side="right") - 1]
            assert fi.Measure(area, limit, at=True).value(one) == pytest.approx(at, abs=1 / 30)
    whole = scores_of(rng.normal(1, 1, 30), rng.normal(0, 1, 80))
    assert fi.Measure(160.0, 0.5).value(whole) == pytest.approx(
        fi.auc(whole)
    )  # 80 in 160 m²: the whole ROC


def test_partial_area_by_chance_is_what_random_scores_give():
    rng = np.random.default_rng(6)
    measure = fi.Measure(160.0, 0.07)
    values = [
        measure.value(scores_of(rng.normal(size=30), rng.normal(size=80))) for _ in range(200)
    ]
    one = scores_of(rng.normal(size=30), rng.normal(size=80))
    assert np.mean(values) == pytest.approx(measure.chance(one), abs=0.015)
    values = [dataclasses.replace(measure, at=True).value(scores_of(rng.normal(size=30), rng.normal(size=80)))
              for _ in range(200)]  # fmt: skip
    assert np.mean(values) == pytest.approx(
        dataclasses.replace(measure, at=True).chance(one), abs=0.02
    )


def test_strength_is_compared_at_the_same_depth_alone():
    a = pd.DataFrame({"peak": [1.0, 9.0], "depth": [0.0, 0.1], "target": ["s", "t"]})
    b = pd.DataFrame(
        {"peak": [2.0, 8.0, 100.0], "depth": [0.0, 0.1, 0.15], "target": ["u", "v", "w"]}
    )
    assert fi.stronger_interval(a, b, 20)[0] == 0.5


def test_pd_at_a_false_alarm_rate():
    one = scores_of([5, 4, 3, 2, 1, 0.5], [4.5, 2.5, 0.7, 0.1])
    assert fi.pd_count(one, 100.0, 0.01, np.ones(6, bool)) == (
        3,
        6,
    )  # one false alarm: everything above 2.5
    assert fi.pd_count(one, 100.0, 0.0, np.array([1, 1, 0, 0, 0, 0], bool)) == (1, 2)
