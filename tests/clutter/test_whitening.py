"""Whitening of clutter."""

import numpy as np
import pytest

from flgpr.clutter import ClutterWhitener, whitening_matrix
from reference.cosgrove2004 import circular


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def covariance(rng, n):
    factor = rng.normal(size=(n, n)) + 1j * rng.normal(size=(n, n))
    return factor @ factor.conj().T / n + 0.1 * np.eye(n)


@pytest.mark.parametrize("basis", ["eigen", "cholesky", "symmetric"])
def test_matrix_whitens(rng, basis):
    C = covariance(rng, 5)
    W = whitening_matrix(C, basis)
    assert np.allclose(W @ C @ W.conj().T, np.eye(5))


@pytest.mark.parametrize("basis", ["eigen", "cholesky", "symmetric"])
def test_training_clutter_comes_out_white(rng, basis):
    X = circular(rng, np.arange(4) * 1j, covariance(rng, 4), 300)
    white = ClutterWhitener(basis=basis).fit_transform(X)
    assert np.allclose(white.mean(axis=0), 0)
    assert np.allclose(white.T @ white.conj() / 300, np.eye(4))


@pytest.mark.parametrize("moments", ["ledoit-wolf", "oas", "ogk"])
def test_estimators_converge_to_the_covariance(rng, moments):
    C = covariance(rng, 4)
    found = ClutterWhitener(moments=moments).fit(circular(rng, np.ones(4), C, 6000))
    assert np.linalg.norm(found.covariance_ - C) < 0.1 * np.linalg.norm(C)
    assert np.allclose(found.covariance_, found.covariance_.conj().T)


def test_shrinkage_makes_few_samples_enough(rng):
    X = circular(rng, np.zeros(20), covariance(rng, 20), 10)
    with pytest.raises(ValueError, match="positive definite"):
        ClutterWhitener().fit(X)
    for moments in ("ledoit-wolf", "oas"):
        assert np.isfinite(ClutterWhitener(moments=moments).fit(X).matrix_).all()


def test_robust_covariance_ignores_targets_left_in(rng):
    C = covariance(rng, 3)
    X = circular(rng, np.zeros(3), C, 1000)
    X[:80] += 60
    plain, robust = (ClutterWhitener(moments=m).fit(X).covariance_ for m in ("sample", "ogk"))
    assert np.linalg.norm(plain - C) > 10 * np.linalg.norm(C)
    assert np.linalg.norm(robust - C) < 0.3 * np.linalg.norm(C)


def test_bad_input_is_named(rng):
    with pytest.raises(ValueError, match="basis"):
        whitening_matrix(np.eye(3), "other")
    with pytest.raises(ValueError, match="Hermitian"):
        whitening_matrix(np.triu(np.ones((3, 3))))
    with pytest.raises(ValueError, match="moments"):
        ClutterWhitener(moments="best").fit(rng.normal(size=(9, 2)))
    with pytest.raises(ValueError, match="features"):
        ClutterWhitener().fit(rng.normal(size=(9, 2))).transform(rng.normal(size=(9, 3)))
