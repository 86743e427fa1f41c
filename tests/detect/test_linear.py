"""Scores that are linear in the features, by hand and from a file that nobody checked."""

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from flgpr.detect.scorers.linear import LinearScorer

SETTINGS = {"intercept": -1.0, "plain": True}
ARRAYS = {"weight": np.array([2.0, -0.5])}


def test_a_score_is_the_weighted_sum_and_the_intercept():
    scorer = LinearScorer.restored(SETTINGS, ARRAYS, 2)
    np.testing.assert_array_equal(scorer(np.array([[1.0, 2.0], [0.0, 0.0]])), [0.0, -1.0])
    assert scorer(np.zeros((0, 2))).shape == (0,)
    assert scorer.threshold == 0.0


def test_what_is_written_is_restored():
    scorer = LinearScorer.restored(SETTINGS, ARRAYS, 2)
    again = LinearScorer.restored(scorer.settings(), scorer.arrays(), 2)
    X = np.random.default_rng(1).normal(size=(5, 2))
    np.testing.assert_array_equal(again(X), scorer(X))


@pytest.mark.parametrize(
    ("settings", "arrays", "rule"),
    [
        (SETTINGS, {"weight": np.ones(3)}, r"array 'weight' must have the shape \(2\), got \(3,\)"),
        (SETTINGS, {"weight": np.ones(2, np.int64)}, "must hold float64, got int64"),
        (SETTINGS, {"weight": np.array([1.0, np.nan])}, "must be finite, got 1 that are not"),
        (SETTINGS | {"plain": 1}, ARRAYS, "setting 'plain' must be true or false, got 1"),
        (SETTINGS | {"intercept": np.inf}, ARRAYS, "'intercept' must be a finite number, got inf"),
        (SETTINGS | {"extra": 1}, ARRAYS, "setting 'extra' does not belong to it"),
        ({"plain": True}, ARRAYS, "setting 'intercept' is missing"),
    ],
)
def test_what_breaks_a_rule_is_refused(settings, arrays, rule):
    with pytest.raises(ValueError, match=rule):
        LinearScorer.restored(settings, arrays, 2)


def test_three_classes_are_refused_and_weighted_examples_are_marked():
    X = np.random.default_rng(2).normal(size=(60, 2))
    with pytest.raises(ValueError, match="estimator must part two classes"):
        LinearScorer.of(LogisticRegression().fit(X, np.repeat([0, 1, 2], 20)))
    y = np.repeat([0, 1], 30)
    assert LinearScorer.of(LogisticRegression().fit(X, y)).unweighted
    assert not LinearScorer.of(LogisticRegression(class_weight="balanced").fit(X, y)).unweighted
