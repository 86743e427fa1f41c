"""The relevance vector machine against Tipping's equations, brute force and known problems."""

import numpy as np
import pytest
from scipy.special import expit
from sklearn.datasets import load_breast_cancer, load_iris, load_wine, make_moons
from sklearn.exceptions import ConvergenceWarning
from sklearn.preprocessing import scale
from sklearn.utils.estimator_checks import parametrize_with_checks

from flgpr.detect import (
    GaussianMixtureNovelty,
    OneClassRelevanceVectorMachine,
    RelevanceVectorClassifier,
    leave_one_out,
)
from flgpr.detect.rvm import moderate
from flgpr.detect.rvm_fit import SparseFit, fit_laplacian_map, fit_sparse
from flgpr.kernels import relevance
from reference import tipping2001
from reference.laplacian_mode import liblinear_weights, penalised_loss
from reference.ripley1996 import design_of, ripley, ripley_odds


@parametrize_with_checks(
    [
        RelevanceVectorClassifier(),
        RelevanceVectorClassifier(algorithm="ard", prior="laplacian"),
        RelevanceVectorClassifier(prior="laplacian-map"),
        OneClassRelevanceVectorMachine(),
        OneClassRelevanceVectorMachine(formulation="no-bias"),
        OneClassRelevanceVectorMachine(formulation="reference", random_state=0),
        GaussianMixtureNovelty(max_components=1, random_state=0),
    ]
)
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.SkipTestWarning")
def test_is_an_estimator(estimator, check):
    check(estimator)


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
    best, gain, s_best, q_best = relevance.candidates(
        rows, relevance.single(rows), allowed, active, posterior, 0.0, 1e-5
    )
    s, q = tipping2001.sparsity_and_quality(design, t, active, alpha)
    gains = np.where(q**2 > s, 0.5 * (q**2 / s - 1 - np.log(np.maximum(q**2 / s, 1e-9))), 0)
    gains[active] = 0
    assert best == gains.argmax()
    assert (gain, s_best, abs(q_best)) == pytest.approx(
        (gains.max(), s[best], abs(q[best])), rel=1e-6
    )
    every = relevance.entries(rows, allowed, active, posterior, 0.0)[0]
    np.testing.assert_allclose(every, gains, rtol=1e-5, atol=1e-8)
    ranked = relevance.ranking(relevance.single(rows), allowed, active, posterior, 0.0)
    np.testing.assert_allclose(ranked, gains, rtol=1e-3, atol=1e-4)


def test_single_actions_end_where_none_is_left(problem):
    design, t = problem
    rows = np.ascontiguousarray(design.T)
    active, alpha, _ = relevance.climb(
        rows, relevance.single(rows), t.astype(float), 0.0, np.ones(81, bool), 0.0, 1000
    )
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


def test_moderation_is_near_the_integral():
    for mean in (-3.0, -0.5, 0.0, 1.0, 4.0):
        for variance in (0.0, 0.5, 4.0, 30.0):
            a = mean + np.sqrt(variance) * np.linspace(-8, 8, 20_001)
            weight = np.exp(-(np.linspace(-8, 8, 20_001) ** 2) / 2)
            exact = (expit(a) * weight).sum() / weight.sum()
            assert expit(moderate(np.array([mean]), np.array([variance])))[0] == pytest.approx(
                exact, abs=0.02
            )


@pytest.mark.parametrize("seed", range(3))
def test_error_on_ripleys_problem_is_near_the_optimum_with_few_vectors(seed):
    X, y = ripley(250, seed)
    test_X, test_y = ripley(4000, 100 + seed)
    machine = RelevanceVectorClassifier(gamma=4.0).fit(X, y)
    optimum = np.mean((ripley_odds(test_X) > 0) != test_y)
    error = 1 - machine.score(test_X, test_y)
    assert len(machine.relevance_) <= 10
    assert error <= optimum + 0.03 + 3 * np.sqrt(0.1 * 0.9 / 4000)
    assert error >= optimum - 3 * np.sqrt(2 * 0.1 * 0.9 / 4000)


def test_probabilities_are_calibrated():
    X, y = ripley(400, 7)
    test_X, test_y = ripley(4000, 8)
    p = RelevanceVectorClassifier(gamma=4.0).fit(X, y).predict_proba(test_X)[:, 1]
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.6), (0.6, 0.9), (0.9, 1.0)):
        inside = (p >= low) & (p <= high)
        spread = np.sqrt(0.25 / inside.sum())
        assert abs(test_y[inside].mean() - p[inside].mean()) < 0.08 + 3 * spread


def test_moderation_never_changes_the_class_and_softens_probabilities():
    X, y = ripley(120, 4)
    soft = RelevanceVectorClassifier(gamma=4.0).fit(X, y)
    hard = RelevanceVectorClassifier(gamma=4.0, moderated=False).fit(X, y)
    p = soft.predict_proba(X)[:, 1]
    m = hard.predict_proba(X)[:, 1]
    np.testing.assert_array_equal(p > 0.5, m > 0.5)
    assert (np.abs(p - 0.5) < np.abs(m - 0.5)).all()


def test_any_kernel_serves_even_one_that_is_not_mercers():
    X, y = ripley(200, 5)
    test_X, test_y = ripley(2000, 6)

    def sharp(A, B):
        """A box: neither positive definite nor smooth; and shifted, so not symmetric."""
        return (np.abs(A[:, None] - B[None] - 0.05).max(axis=2) < 0.35).astype(float)

    kernel = sharp(X, X)
    assert np.linalg.eigvalsh((kernel + kernel.T) / 2).min() < -1
    error = 1 - RelevanceVectorClassifier(kernel=sharp).fit(X, y).score(test_X, test_y)
    assert error < 0.2
    for name in ("laplacian", "poly", "sigmoid"):
        assert (
            RelevanceVectorClassifier(kernel=name, gamma=1.0).fit(X, y).score(test_X, test_y) > 0.75
        )


def test_precomputed_kernel_is_the_kernel():
    X, y = ripley(90, 9)
    other = ripley(30, 10)[0]
    named = RelevanceVectorClassifier(gamma=4.0).fit(X, y)
    matrix = np.exp(-4 * ((other[:, None] - X[None]) ** 2).sum(axis=2))
    given = RelevanceVectorClassifier(kernel="precomputed").fit(design_of(X, bias=False), y)
    np.testing.assert_array_equal(given.relevance_, named.relevance_)
    np.testing.assert_allclose(given.predict_proba(matrix), named.predict_proba(other), atol=1e-8)


def test_attributes_reproduce_the_model():
    X, y = ripley(90, 11)
    labels = np.where(y == 1, "mine", "clutter")
    machine = RelevanceVectorClassifier(gamma=4.0, moderated=False).fit(X, labels)
    assert list(machine.classes_) == ["clutter", "mine"]
    np.testing.assert_array_equal(machine.relevance_vectors_, X[machine.relevance_])
    K = np.exp(-4 * ((X[:, None] - machine.relevance_vectors_[None]) ** 2).sum(axis=2))
    c = K @ machine.dual_coef_ + machine.intercept_
    np.testing.assert_allclose(machine.predict_proba(X)[:, 1], expit(c), atol=1e-12)
    assert machine.converged_
    assert machine.n_iter_ > 1


def test_starts_and_exchanges_only_raise_the_evidence():
    sets = [
        (scale(load_iris().data), load_iris().target == 1),
        (scale(load_wine().data), load_wine().target == 1),
    ]
    X, y = load_breast_cancer(return_X_y=True)
    sets.append((scale(X)[:200], y[:200]))
    gains = []
    for X, y in sets:
        one = RelevanceVectorClassifier(n_starts=1).fit(X, y).log_evidence_
        many = RelevanceVectorClassifier(n_starts=9).fit(X, y).log_evidence_
        gains.append(many - one)
    assert min(gains) >= -1e-6
    assert max(gains) > 0.1


def test_leave_one_out_is_refitting_without_the_example():
    X, y = ripley(40, 12)
    machine = RelevanceVectorClassifier(gamma=4.0)
    p, machines = leave_one_out(machine, X, y)
    for n in (0, 17, 39):
        rest = np.arange(40) != n
        fresh = RelevanceVectorClassifier(gamma=4.0).fit(X[rest], y[rest])
        assert p[n] == fresh.predict_proba(X[[n]])[0, 1]
        assert machines[n].log_evidence_ == fresh.log_evidence_
    own = machine.fit(X, y).predict_proba(X)[:, 1]
    assert np.abs(p - own).max() > 0.01  # held out is not resubstituted


def test_warm_starts_reach_the_same_optimum_or_a_better_one():
    X, y = ripley(100, 13)
    machine = RelevanceVectorClassifier(gamma=4.0)
    cold = leave_one_out(machine, X, y)
    warm = leave_one_out(machine, X, y, warm=True)
    difference = np.array(
        [a.log_evidence_ - b.log_evidence_ for a, b in zip(warm[1], cold[1], strict=True)]
    )
    assert np.mean(difference > -1e-3) > 0.8  # the same optimum or a better one
    assert difference.min() > -1.0
    same = np.abs(difference) < 1e-6
    np.testing.assert_allclose(warm[0][same], cold[0][same], atol=2e-3)


def test_an_uninformative_problem_may_need_no_vector():
    fit = fit_sparse(np.ones((10, 1)), np.tile([0.0, 1.0], 5))
    assert isinstance(fit, SparseFit)
    assert fit.converged
    assert len(fit.active) == 0
    assert fit.log_evidence == pytest.approx(10 * np.log(0.5))


def test_stopping_early_is_said():
    X, y = ripley(60, 14)
    with pytest.warns(ConvergenceWarning, match="max_iter"):
        machine = RelevanceVectorClassifier(gamma=4.0, max_iter=1).fit(X, y)
    assert not machine.converged_


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"prior": "flat"}, "prior must be one of ard, laplacian, laplacian-map, got 'flat'"),
        ({"algorithm": "em"}, "algorithm must be one of"),
        ({"n_starts": 0}, "n_starts must be at least 1, got 0"),
        ({"tol": 0.0}, "tol must be positive"),
        ({"rate": -1.0}, "rate must be a positive number"),
        ({"gamma": -2.0}, "gamma must be a positive number"),
        ({"kernel": "fancy"}, "kernel must be a function or one of"),
        ({"kernel": lambda A, B: np.zeros((2, 2))}, "kernel must return the shape"),
        (
            {"kernel": lambda A, B: np.full((len(A), len(B)), np.nan)},
            "kernel must have finite values",
        ),
        ({"kernel": "precomputed"}, "X must be the square kernel matrix"),
    ],
)
def test_errors_name_the_parameter(parameters, message):
    X, y = ripley(20, 15)
    with pytest.raises(ValueError, match=message):
        RelevanceVectorClassifier(**parameters).fit(X, y)


def test_one_class_of_labels_is_refused():
    with pytest.raises(ValueError, match="y must hold 2 classes"):
        RelevanceVectorClassifier().fit(np.eye(4), np.ones(4))
