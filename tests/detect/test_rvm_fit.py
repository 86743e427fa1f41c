"""The fit of sparse Bayesian models against the formulas of Tipping 2001 and slow twins."""

import numpy as np
import pytest
from scipy.special import expit
from sklearn.datasets import make_moons

from flgpr.detect import (
    RelevanceVectorClassifier,
)
from flgpr.detect.rvm_fit import fit_laplacian_map, fit_sparse
from flgpr.kernels import relevance
from reference import tipping2001
from reference.laplacian_mode import liblinear_weights, penalised_loss
from reference.ripley1996 import design_of, ripley


@pytest.fixture(scope="module")
def problem():
    X, y = ripley(80, 3)
    return design_of(X), y


def test_mode_covariance_and_evidence_are_tippings(problem):
    design, t = problem
    active = np.array([3, 17, 40, 80])
    alpha = np.array([0.2, 1.0, 0.05, 2.0])
    rows = np.ascontiguousarray(design[:, active].T)
    mean, covariance, residual, curvature, evidence, found = relevance.laplace(
        rows, t.astype(float), 0.3, alpha, np.zeros(4)
    )
    w, slow, B, y = tipping2001.mode_and_covariance(design[:, active], t, alpha, 0.3)
    assert found
    np.testing.assert_allclose(mean, w, rtol=1e-7)
    np.testing.assert_allclose(covariance, slow, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(residual, t - y, atol=1e-8)
    np.testing.assert_allclose(curvature, np.diag(B), atol=1e-8)
    assert evidence == pytest.approx(
        tipping2001.log_evidence(design[:, active], t, alpha, 0.3), abs=1e-8
    )


def test_laplaces_evidence_is_near_the_integral():
    X, t = ripley(40, 0)
    design = design_of(X)[:, [2, 40]]
    alpha = np.array([0.3, 0.5])
    grid = np.linspace(-12, 12, 401)
    w = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1)
    c = w @ design.T
    joint = (t * c - np.logaddexp(0, c)).sum(axis=-1) - 0.5 * (alpha * w**2).sum(axis=-1)
    integral = (
        np.log(np.exp(joint).sum() * (grid[1] - grid[0]) ** 2)
        + 0.5 * np.log(alpha / (2 * np.pi)).sum()
    )
    rows = np.ascontiguousarray(design.T)
    evidence = relevance.laplace(rows, t.astype(float), 0.0, alpha, np.zeros(2)).evidence
    assert evidence == pytest.approx(integral, abs=0.05)
    far = relevance.laplace(rows, t.astype(float), 0.0, 100 * alpha, np.zeros(2)).evidence
    assert abs(far - integral) > 0.5  # the test could fail: other precisions have another evidence


def test_fixed_point_and_no_gain_outside_by_the_textbook_formulas(problem):
    design, t = problem
    fit = fit_sparse(design, t, tol=1e-8)
    assert fit.converged
    w, covariance, _, _ = tipping2001.mode_and_covariance(design[:, fit.active], t, fit.alpha)
    np.testing.assert_allclose(fit.alpha, (1 - fit.alpha * np.diag(covariance)) / w**2, rtol=1e-5)
    s, q = tipping2001.sparsity_and_quality(design, t, fit.active, fit.alpha)
    outside = np.setdiff1d(np.arange(design.shape[1]), fit.active)
    assert (q[outside] ** 2 <= s[outside] * (1 + 1e-3)).all()
    np.testing.assert_allclose(
        fit.alpha, s[fit.active] ** 2 / (q[fit.active] ** 2 - s[fit.active]), rtol=1e-4
    )
    assert (q[fit.active] ** 2 > s[fit.active]).all()


def test_candidates_have_the_textbook_gain(problem):
    design, t = problem
    active = np.array([5, 60])
    alpha = np.array([0.1, 0.2])
    rows = np.ascontiguousarray(design.T)
    posterior = relevance.laplace(rows[active], t.astype(float), 0.0, alpha, np.zeros(2))
    allowed = np.ones(81, bool)
    fixed = relevance.Problem(rows, relevance.single(rows), t.astype(float), 0.0, allowed, 0.0)
    best, gain, s_best, q_best = relevance.candidates(fixed, allowed, active, posterior, 1e-5)
    s, q = tipping2001.sparsity_and_quality(design, t, active, alpha)
    gains = np.where(q**2 > s, 0.5 * (q**2 / s - 1 - np.log(np.maximum(q**2 / s, 1e-9))), 0)
    gains[active] = 0
    assert best == gains.argmax()
    assert (gain, s_best, abs(q_best)) == pytest.approx(
        (gains.max(), s[best], abs(q[best])), rel=1e-6
    )
    every = relevance.entries(fixed, active, posterior)[0]
    np.testing.assert_allclose(every, gains, rtol=1e-5, atol=1e-8)
    ranked = relevance.ranking(fixed, allowed, active, posterior)
    np.testing.assert_allclose(ranked, gains, rtol=1e-3, atol=1e-4)


def test_single_actions_end_where_none_is_left(problem):
    design, t = problem
    rows = np.ascontiguousarray(design.T)
    fixed = relevance.Problem(
        rows, relevance.single(rows), t.astype(float), 0.0, np.ones(81, bool), 0.0
    )
    active, alpha, _ = relevance.climb(fixed, 1000)
    w, covariance, *_ = tipping2001.mode_and_covariance(design[:, active], t, alpha)
    np.testing.assert_allclose(alpha, (1 - alpha * np.diag(covariance)) / w**2, rtol=5e-3)
    s, q = tipping2001.sparsity_and_quality(design, t, active, alpha)
    outside = np.setdiff1d(np.arange(81), active)
    assert (q[outside] ** 2 <= s[outside] * (1 + 1e-2)).all()
    # The whole fit begins there among others, and can only be better.
    assert (
        fit_sparse(design, t).log_evidence
        >= tipping2001.log_evidence(design[:, active], t, alpha) - 1e-6
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_pruning_agrees_with_the_dense_twin_and_growing_is_no_worse(seed):
    X, t = ripley(60, seed)
    design = design_of(X)
    active, alpha = tipping2001.equation_16_updates(design, t, 800)
    slow = tipping2001.log_evidence(design[:, active], t, alpha)
    ard = fit_sparse(design, t, algorithm="ard")
    fast = fit_sparse(design, t)
    assert ard.converged
    assert ard.log_evidence == pytest.approx(slow, abs=0.02)
    strong = alpha < 1e3  # the twin has not quite pruned the rest
    np.testing.assert_array_equal(ard.active, active[strong])
    assert fast.log_evidence >= slow - 1e-3
    p = [expit(design[:, f.active] @ f.mean) for f in (ard, fast)]
    w, *_ = tipping2001.mode_and_covariance(design[:, active], t, alpha)
    np.testing.assert_allclose(p[0], expit(design[:, active] @ w), atol=0.02)
    assert np.mean((p[1] > 0.5) == (expit(design[:, active] @ w) > 0.5)) > 0.9


def test_variance_is_the_maximum_with_and_without_a_laplacian_prior():
    for s, q, rate in ((1.0, 3.0, 0.0), (0.4, 2.5, 0.7), (5.0, 4.0, 2.0)):
        v = np.linspace(1e-4, 30, 300_001)
        gain = 0.5 * (q * q * v / (1 + v * s) - np.log1p(v * s) - rate * v)
        assert relevance.best_variance(s, q, rate) == pytest.approx(v[gain.argmax()], abs=2e-4)


@pytest.mark.parametrize(("gamma", "rate"), [(0.3, 1.0), (4.0, 0.04), (16.0, 1.0)])
def test_mode_under_a_laplacian_prior_is_the_least_of_the_penalised_loss(gamma, rate):
    X, t = ripley(120, 2)
    design = design_of(X, gamma)
    fit = fit_laplacian_map(design, t, rate=rate, tol=1e-7)
    weights = np.zeros(design.shape[1])
    weights[fit.active] = fit.mean
    scale = np.sqrt(rate)
    other = liblinear_weights(design, t, scale)
    ours, theirs = (penalised_loss(design, t, w, scale) for w in (weights, other))
    assert ours <= theirs + 1e-9
    assert fit.converged
    slope = -design.T @ (t - expit(design @ weights))
    np.testing.assert_allclose(slope[fit.active], -scale * np.sign(fit.mean), atol=1e-6 * scale)
    assert np.abs(slope).max() <= scale * (1 + 1e-6)
    # Each weight that is not zero is also the mode under a normal prior of the precision that is
    # given.
    mode, covariance, *_ = tipping2001.mode_and_covariance(design[:, fit.active], t, fit.alpha)
    np.testing.assert_allclose(fit.mean, mode, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-3, atol=1e-8)


def test_mode_under_a_laplacian_prior_keeps_more_vectors_than_the_evidence_and_has_one_answer():
    X, t = make_moons(200, noise=0.3, random_state=0)
    counts = {
        prior: len(RelevanceVectorClassifier(gamma=8.0, prior=prior).fit(X, t).relevance_)
        for prior in ("laplacian", "laplacian-map")
    }
    assert counts["laplacian-map"] == 27  # 13.5 %: the paper reports 14
    assert counts["laplacian"] < counts["laplacian-map"]
    order = np.random.default_rng(0).permutation(200)
    one, other = (
        RelevanceVectorClassifier(gamma=8.0, prior="laplacian-map").fit(X[rows], t[rows])
        for rows in (np.arange(200), order)
    )
    np.testing.assert_allclose(one.decision_function(X), other.decision_function(X), atol=1e-3)


def test_mode_with_an_offset_and_one_class_stays_at_the_offset_far_away():
    X, _ = ripley(60, 1)
    design = design_of(X, 4.0, bias=False)
    fit = fit_laplacian_map(design, np.ones(60), offset=-4.0)
    weights = np.zeros(60)
    weights[fit.active] = fit.mean
    slope = -design.T @ (1 - expit(design @ weights - 4.0))
    assert np.abs(slope).max() <= 1 + 1e-4
    assert 0 < fit.active.size < 60


def test_laplacian_fit_is_stationary_in_the_penalised_evidence(problem):
    design, t = problem
    fit = fit_sparse(design, t, rate=0.5, tol=1e-9)
    s, q = tipping2001.sparsity_and_quality(design, t, fit.active, fit.alpha)
    v = 1 / fit.alpha
    s = s[fit.active]
    q = q[fit.active]
    slope = 0.5 * (-s / (1 + v * s) + q**2 / (1 + v * s) ** 2 - 0.5)
    np.testing.assert_allclose(slope, 0, atol=1e-5)
    pruned = fit_sparse(design, t, rate=0.5, algorithm="ard")
    free = fit_sparse(design, t)
    assert pruned.converged
    # The exponential prior holds the variances down, and costs evidence.
    for one in (fit, pruned):
        assert (1 / one.alpha).sum() < (1 / free.alpha).sum()
        assert one.log_evidence < free.log_evidence
