"""Weights of kernels that solve the problem of multiple-kernel learning, and the machine on their sum."""

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics.pairwise import rbf_kernel
from sklearn.svm import SVC
from sklearn.utils.estimator_checks import parametrize_with_checks

from flgpr.detect import MultipleKernelClassifier
from flgpr_ground.detect import multiple_kernels


@pytest.mark.slow("all checks of scikit-learn for every form")
@parametrize_with_checks(
    [MultipleKernelClassifier(), MultipleKernelClassifier(class_weight="balanced")]
)
def test_is_an_estimator(estimator, check):
    check(estimator)


@pytest.fixture
def samples():
    """Two features that tell the classes apart, two that tell less, and two that tell nothing."""
    rng = np.random.default_rng(4)
    y = np.repeat([0, 1], [80, 40])
    X = rng.normal(size=(120, 6))
    X[:, :2] += 1.6 * y[:, None]
    X[:, 2:4] += 0.7 * y[:, None]
    return X, y


def dual_optimum(X, y, weights, columns, C=1.0):
    """The dual objective of the support vector machine on a weighted sum of kernels."""
    kernel = sum(
        weight * rbf_kernel(X[:, group], gamma=1 / (X[:, group].var() * len(group)))
        for weight, group in zip(weights, columns, strict=True)
    )
    machine = SVC(C=C, kernel="precomputed", tol=1e-8).fit(kernel, y)
    coefficients = machine.dual_coef_[0]
    support = kernel[np.ix_(machine.support_, machine.support_)]
    return np.abs(coefficients).sum() - coefficients @ support @ coefficients / 2


def test_one_group_is_the_support_vector_machine_of_scikit_learn(samples):
    X, y = samples
    ours = MultipleKernelClassifier(groups=(6,), C=2.0, class_weight="balanced").fit(X, y)
    theirs = SVC(C=2.0, class_weight="balanced", tol=1e-5).fit(X, y)
    np.testing.assert_allclose(ours.decision_function(X), theirs.decision_function(X), atol=1e-6)
    assert ours.kernel_weights_.tolist() == [1.0]


def test_the_weights_of_two_kernels_are_those_of_the_least_dual_optimum(samples):
    """MKL minimises over the weights what the machine maximises (Xu et al. 2010, Eq. 2)."""
    X, y = samples
    columns = [[0, 1], [2, 3]]
    fitted = MultipleKernelClassifier(groups=(2, 2), tol=1e-6, max_iter=2000).fit(X[:, :4], y)
    shares = np.linspace(0, 1, 101)
    objective = [dual_optimum(X, y, (share, 1 - share), columns) for share in shares]
    assert 0.05 < shares[np.argmin(objective)] < 0.95
    assert fitted.kernel_weights_[0] == pytest.approx(shares[np.argmin(objective)], abs=0.015)


def test_kernels_with_a_weight_are_worth_the_same_and_the_others_less(samples):
    """The Karush-Kuhn-Tucker conditions of the weights on the simplex, to the machine's tolerance."""
    X, y = samples
    fitted = MultipleKernelClassifier(tol=1e-5, max_iter=5000).fit(X, y)
    vectors = fitted.support_vectors_
    worth = np.array(
        [
            fitted.dual_coef_
            @ rbf_kernel(vectors[:, [k]], gamma=fitted.gamma_[k])
            @ fitted.dual_coef_
            for k in range(6)
        ]
    )
    used = fitted.kernel_weights_ > 0.02
    assert used.any()
    assert not used.all()
    np.testing.assert_allclose(worth[used], worth.max(), rtol=0.01)
    assert (worth[~used] < worth.max()).all()
    assert fitted.kernel_weights_.sum() == pytest.approx(1)


def test_what_tells_nothing_weighs_least(samples):
    X, y = samples
    fitted = MultipleKernelClassifier(groups=(2, 2, 2)).fit(X, y)
    first, second, third = fitted.kernel_weights_
    assert first > second > third
    assert (fitted.decision_function(X[y == 1]) > 0).mean() > 0.7


def test_kernels_that_are_computed_anew_give_the_same_bits(samples, monkeypatch):
    X, y = samples
    first = MultipleKernelClassifier(groups=(2, 4)).fit(X, y)
    monkeypatch.setattr(multiple_kernels, "_REMEMBERED", 0)
    second = MultipleKernelClassifier(groups=(2, 4)).fit(X, y)
    np.testing.assert_array_equal(first.kernel_weights_, second.kernel_weights_)
    np.testing.assert_array_equal(first.decision_function(X), second.decision_function(X))


def test_weights_that_still_change_are_reported(samples):
    with pytest.warns(ConvergenceWarning, match=r"still change by .* after 1 rounds; raise max_i"):
        MultipleKernelClassifier(max_iter=1).fit(*samples)


@pytest.mark.parametrize("groups", [(2, 3), (6, 0), (7, -1), ()])
def test_groups_that_do_not_make_the_features_are_refused(samples, groups):
    with pytest.raises(ValueError, match="groups must be positive and add up to 6 features, got"):
        MultipleKernelClassifier(groups=groups).fit(*samples)


def test_labels_may_be_words_and_weights_belong_to_them(samples):
    X, y = samples
    words = np.array(["clutter", "mine"])[y]
    plain = MultipleKernelClassifier(groups=(2, 4)).fit(X, words)
    costly = {"clutter": 1.0, "mine": 10.0}
    careful = MultipleKernelClassifier(groups=(2, 4), class_weight=costly).fit(X, words)
    found = (careful.predict(X) == "mine").sum()
    assert found > (plain.predict(X) == "mine").sum() > 0


def test_parameters_are_checked(samples):
    with pytest.raises(ValueError, match="gamma must be positive or 'scale', got -1"):
        MultipleKernelClassifier(gamma=-1.0).fit(*samples)
    with pytest.raises(ValueError, match="tol must be positive, got 0"):
        MultipleKernelClassifier(tol=0).fit(*samples)
    with pytest.raises(ValueError, match="max_iter must be at least 1, got 0"):
        MultipleKernelClassifier(max_iter=0).fit(*samples)
