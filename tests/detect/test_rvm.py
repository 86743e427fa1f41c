"""The relevance vector machine against Tipping's equations, brute force and known problems."""

import numpy as np
import pytest
from scipy.special import expit
from sklearn.datasets import load_breast_cancer, load_iris, load_wine
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
from flgpr.detect.rvm_fit import SparseFit, fit_sparse
from reference.ripley1996 import design_of, ripley, ripley_odds


@pytest.mark.slow("all checks of scikit-learn for every form")
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


@pytest.mark.slow("fits many machines")
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
