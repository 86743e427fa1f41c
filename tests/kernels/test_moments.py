"""Estimators of mean and covariance against NumPy and on samples with outliers."""

import numpy as np
import pytest

from flgpr.kernels.moments import ESTIMATORS, sample_moments

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("ddof", [0, 1])
def test_sample_moments_are_those_of_numpy(ddof):
    X = RNG.normal(size=(40, 3)) + 1j * RNG.normal(size=(40, 3))
    mean, covariance = sample_moments(X, ddof)
    np.testing.assert_allclose(mean, X.mean(axis=0), atol=1e-14)
    np.testing.assert_allclose(covariance, np.cov(X.T, ddof=ddof), atol=1e-13)


@pytest.mark.parametrize("name", sorted(ESTIMATORS))
def test_every_estimator_gives_a_hermitian_positive_covariance(name):
    X = RNG.normal(size=(200, 4)) @ RNG.normal(size=(4, 4))
    mean, covariance = ESTIMATORS[name](X)
    assert mean.shape == (4,)
    np.testing.assert_allclose(covariance, covariance.conj().T)
    assert np.linalg.eigvalsh(covariance)[0] > 0


@pytest.mark.parametrize("name", ["ogk", "clipped"])
def test_robust_estimators_are_hardly_moved_by_an_outlier(name):
    X = RNG.normal(size=(200, 3))
    X[0] = 1e4
    assert np.trace(ESTIMATORS[name](X)[1]) < 6
    assert np.trace(ESTIMATORS["sample"](X)[1]) > 1e5
