"""Scores that are sums of kernels, by hand and from a file that nobody checked."""

import math

import numpy as np
import pytest

from flgpr.detect.scorers import kernel_machines
from flgpr.detect.scorers.kernel_machines import (
    OneClassRelevanceScorer,
    RelevanceScorer,
    VectorScorer,
    logistic,
)

ARRAYS = {"vectors": np.array([[0.0, 0.0], [1.0, 2.0]]), "weight": np.array([1.0, -2.0])}
SETTINGS = {"kernel": "rbf", "gamma": 0.5, "degree": 3.0, "coef0": 1.0, "intercept": 0.25}
X = np.array([[1.0, 1.0]])
KERNELS = {
    "linear": (0.0, 3.0),
    "rbf": (math.exp(-1.0), math.exp(-0.5)),
    "laplacian": (math.exp(-1.0), math.exp(-0.5)),
    "poly": (1.0, 2.5**3),
    "sigmoid": (math.tanh(1.0), math.tanh(2.5)),
}
"""Kernels of (1, 1) with (0, 0) and (1, 2), by their definitions."""


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_score_is_the_weighted_sum_of_kernels_and_the_intercept(kernel):
    scorer = VectorScorer.restored(SETTINGS | {"kernel": kernel}, ARRAYS, 2)
    first, second = KERNELS[kernel]
    np.testing.assert_allclose(scorer(X), first - 2 * second + 0.25, rtol=1e-12)
    assert scorer(np.zeros((0, 2))).shape == (0,)


def test_blocks_of_samples_change_no_score(monkeypatch):
    samples = np.random.default_rng(3).normal(size=(7, 2))
    scorer = VectorScorer.restored(SETTINGS, ARRAYS, 2)
    together = scorer(samples)
    monkeypatch.setattr(kernel_machines, "_VALUES_AT_ONCE", 4)  # two samples at once
    np.testing.assert_array_equal(scorer(samples), together)


def test_log_odds_shrink_with_the_variance_of_the_weights():
    """MacKay 1992: m / sqrt(1 + π s²/8), with s² of two weights and the bias, each of variance 4."""
    settings = SETTINGS | {"kernel": "linear", "moderated": True, "bias": True}
    arrays = ARRAYS | {"covariance": 4 * np.eye(3)}
    mean = -2 * 3.0 + 0.25
    variance = 4 * (0.0**2 + 3.0**2 + 1.0)
    scorer = RelevanceScorer.restored(settings, arrays, 2)
    assert scorer(X)[0] == pytest.approx(mean / math.sqrt(1 + math.pi * variance / 8))
    plain = RelevanceScorer.restored(settings | {"moderated": False}, arrays, 2)
    assert plain(X)[0] == pytest.approx(mean)


def test_a_covariance_that_does_not_fit_the_weights_is_refused():
    settings = SETTINGS | {"moderated": True, "bias": True}
    with pytest.raises(ValueError, match=r"array 'covariance' must have the shape \(3, 3\)"):
        RelevanceScorer.restored(settings, ARRAYS | {"covariance": np.eye(2)}, 2)
    with pytest.raises(
        ValueError, match=r"setting 'kernel' must be one of linear, .*, got 'cosine'"
    ):
        VectorScorer.restored(SETTINGS | {"kernel": "cosine"}, ARRAYS, 2)


def test_a_scale_of_one_class_must_be_positive():
    settings = SETTINGS | {"moderated": False, "bias": False, "offset": 0.5, "intercept": 0.0}
    arrays = ARRAYS | {
        "covariance": np.eye(2),
        "weight": np.zeros(2),
        "own_centre": np.zeros(2),
        "own_scale": np.ones(2),
    }
    scorer = OneClassRelevanceScorer.restored(settings, arrays, 2)
    assert scorer(X)[0] == pytest.approx(0.0)  # log odds of 0 are one half, less the offset
    with pytest.raises(ValueError, match=r"array 'own_scale' must be positive, got 0\.0"):
        OneClassRelevanceScorer.restored(settings, arrays | {"own_scale": np.array([1.0, 0.0])}, 2)


def test_the_logistic_function_does_not_overflow():
    np.testing.assert_array_equal(logistic(np.array([-1e9, 0.0, 1e9])), [0.0, 0.5, 1.0])
