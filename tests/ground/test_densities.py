"""Scores by the density of examples, by hand, and files that nobody checked."""

import math

import numpy as np
import pytest

from flgpr_ground.scorers.densities import (
    CopulaScorer,
    MixtureScorer,
    NeighbourScorer,
    TailScorer,
    tail_logs,
)

MIXTURE = {
    "own_centre": np.array([1.0]),
    "own_scale": np.array([2.0]),
    "share": np.array([0.25, 0.75]),
    "mean": np.array([[0.0], [1.0]]),
    "root": np.array([[[1.0]], [[0.5]]]),  # standard deviations of 1 and 2
}
NEIGHBOURS = {"neighbours": 2, "method": "mean", "power": 2.0, "threshold": 1.0}
EXAMPLES = {"examples": np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 9.0]])}


def normal(z, mean, deviation):
    square = ((z - mean) / deviation) ** 2
    return math.exp(-square / 2) / (deviation * math.sqrt(2 * math.pi))


def test_a_mixture_has_the_log_density_less_the_offset():
    scorer = MixtureScorer.restored({"offset": -2.0}, MIXTURE, 1)
    z = (2.0 - 1.0) / 2.0
    wanted = math.log(0.25 * normal(z, 0.0, 1.0) + 0.75 * normal(z, 1.0, 2.0)) + 2.0
    assert scorer(np.array([[2.0]]))[0] == pytest.approx(wanted, rel=1e-12)
    far = scorer(np.array([[1e6]]))  # no density that is not zero in floating point
    assert np.isfinite(far).all()


@pytest.mark.parametrize("name", ["share", "own_scale", "root"])
def test_shares_scales_and_roots_must_be_positive(name):
    arrays = MIXTURE | {name: np.zeros_like(MIXTURE[name])}
    with pytest.raises(ValueError, match=rf"array '{name}' must be positive, got 0\.0"):
        MixtureScorer.restored({"offset": 0.0}, arrays, 1)


def test_tails_are_shares_of_samples_at_most_and_at_least_as_large():
    X = np.array([[1.0], [2.0], [2.0], [9.0]])
    left, right, skewed = tail_logs(X)
    np.testing.assert_allclose(np.exp(-left[:, 0]), [1 / 4, 3 / 4, 3 / 4, 1])
    np.testing.assert_allclose(np.exp(-right[:, 0]), [1, 3 / 4, 3 / 4, 1 / 4])
    np.testing.assert_allclose(skewed, right)  # the longer tail is on the right
    symmetric = tail_logs(np.array([[-1.0], [0.0], [1.0]]))
    np.testing.assert_allclose(symmetric[2], symmetric[0] + symmetric[1])


def test_what_lies_farther_out_scores_higher():
    examples = {"examples": np.linspace(-1, 1, 21)[:, None]}
    for kind in (TailScorer, CopulaScorer):
        scorer = kind.restored({"threshold": 1.0}, examples, 1)
        middle, outside = scorer(np.array([[0.0], [5.0]]))
        assert outside > middle
        assert scorer(np.zeros((0, 1))).shape == (0,)


@pytest.mark.parametrize(
    ("power", "method", "wanted"),
    [
        (2.0, "mean", 2.5),  # distances of 0, 5 and 9
        (2.0, "largest", 5.0),
        (1.0, "largest", 7.0),
        (0.0, "largest", 4.0),  # the largest difference of a feature
    ],
)
def test_distances_of_the_nearest_examples(power, method, wanted):
    scorer = NeighbourScorer.restored(NEIGHBOURS | {"power": power, "method": method}, EXAMPLES, 2)
    assert scorer(np.array([[0.0, 0.0]]))[0] == pytest.approx(wanted)


def test_more_neighbours_than_examples_are_refused():
    with pytest.raises(ValueError, match="'neighbours' must be a whole number from 1 to 3, got 4"):
        NeighbourScorer.restored(NEIGHBOURS | {"neighbours": 4}, EXAMPLES, 2)
    none = {"examples": np.zeros((0, 2))}
    with pytest.raises(ValueError, match="array 'examples' must hold an example, got 0"):
        NeighbourScorer.restored(NEIGHBOURS | {"neighbours": 1}, none, 2)
