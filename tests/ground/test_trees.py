"""Scores of trees, by hand, and tables of nodes that nobody checked."""

import math

import numpy as np
import pytest

from flgpr_ground.scorers.trees import BoostedScorer, ForestScorer, IsolationScorer

TWO_TREES = {
    # The first parts feature 0 at 0.5; the second is one leaf.
    "first": np.array([0, 3]),
    "left": np.array([1, -1, -1, -1]),
    "right": np.array([2, -1, -1, -1]),
    "feature": np.array([0, 0, 0, 0]),
    "split": np.array([0.5, 0.0, 0.0, 0.0]),
    "value": np.array([0.0, 0.25, 0.75, 0.5]),
}
X = np.array([[0.5, 9.0], [0.6, -9.0]])


def test_a_sample_at_the_threshold_goes_left():
    scorer = BoostedScorer.restored({"baseline": 1.0}, TWO_TREES, 2)
    np.testing.assert_array_equal(scorer(X), [1.75, 2.25])


def test_a_forest_has_the_log_odds_of_the_mean_share():
    scorer = ForestScorer.restored({}, TWO_TREES, 2)
    low, high = (0.25 + 0.5) / 2, (0.75 + 0.5) / 2
    np.testing.assert_allclose(
        scorer(X), [math.log(low / (1 - low)), math.log(high / (1 - high))], rtol=1e-12
    )


def test_an_isolation_forest_has_the_power_of_the_relative_length():
    """Liu, Ting & Zhou 2008: -2^(-d / (n c)) - offset with d = 0.75, n = 2, c = 1."""
    settings = {"mean_length": 1.0, "offset": -0.5}
    scorer = IsolationScorer.restored(settings, TWO_TREES, 2)
    assert scorer(X)[0] == pytest.approx(-(2 ** (-0.75 / 2)) + 0.5)


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"left": np.array([0, -1, -1, -1])}, "array 'left' must lead to later nodes of the tree"),
        ({"right": np.array([3, -1, -1, -1])}, "array 'right' must lead to later nodes"),
        ({"right": np.array([-1, -1, -1, -1])}, "a node must have two children or none"),
        ({"feature": np.array([2, 0, 0, 0])}, "array 'feature' must be from 0 to 1"),
        ({"first": np.array([1, 3])}, "array 'first' must rise from 0 within the nodes"),
        ({"first": np.array([0, 4])}, "array 'first' must rise from 0 within the nodes"),
        ({"value": np.array([0.0, 0.25, 1.5, 0.5])}, "array 'value' must lie between 0 and 1"),
    ],
)
def test_paths_that_leave_their_tree_or_do_not_end_are_refused(changes, rule):
    with pytest.raises(ValueError, match=rule):
        ForestScorer.restored({}, TWO_TREES | changes, 2)
