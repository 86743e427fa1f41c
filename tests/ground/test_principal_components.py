"""The likelihood ratio of principal components against densities of complex Gaussians, worked out in full."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from sklearn.utils.estimator_checks import parametrize_with_checks

from flgpr.clutter import ClutterWhitener
from flgpr.detect import NeymanPearsonDetector, PrincipalComponentDetector
from flgpr.kernels.moments import sample_moments


@pytest.mark.slow("all checks of scikit-learn for every form")
@parametrize_with_checks(
    [PrincipalComponentDetector()],
    expected_failed_checks=lambda _: {"check_complex_data": "takes complex samples"},
)
def test_scikit_learn_check(estimator, check):
    check(estimator)


def normal(rng, count, features):
    real = rng.normal(size=(count, features))
    return (real + 1j * rng.normal(size=(count, features))) / np.sqrt(2)


def log_density(X, mean, covariance):
    """Of CN(mean, covariance), as that of real and imaginary parts side by side."""
    parts = [[covariance.real, -covariance.imag], [covariance.imag, covariance.real]]
    both = np.concatenate([X.real, X.imag], axis=1)
    middle = np.concatenate([mean.real, mean.imag])
    return multivariate_normal.logpdf(both, middle, np.block(parts) / 2)


@pytest.fixture
def mines():
    rng = np.random.default_rng(2)
    directions = normal(rng, 2, 5)
    strength = normal(rng, 300, 2) * np.array([4.0, 2.0])
    return normal(rng, 300, 5) + strength @ directions + np.array([1.0, 1j, 0, 0, 0])


def test_it_is_the_ratio_of_two_densities(mines):
    detector = PrincipalComponentDetector(rank=2).fit(mines)
    mean, covariance = sample_moments(mines)
    values, vectors = np.linalg.eigh(covariance - np.eye(5))
    leading = vectors[:, -2:]
    of_mine = np.eye(5) + (leading * values[-2:]) @ leading.conj().T
    X = normal(np.random.default_rng(5), 50, 5) * 3
    ratio = log_density(X, mean, of_mine) - log_density(X, np.zeros(5, complex), np.eye(5))
    np.testing.assert_allclose(detector.decision_function(X), ratio, rtol=1e-9)
    np.testing.assert_allclose(detector.eigenvalues_, values[::-1], rtol=1e-9)


def test_the_ratio_of_raw_samples_is_that_of_whitened_ones(mines):
    rng = np.random.default_rng(8)
    clutter = normal(rng, 400, 5) @ normal(rng, 5, 5) + 0.3
    whitener = ClutterWhitener("sample").fit(clutter)
    detector = PrincipalComponentDetector(rank=3).fit(whitener.transform(mines))
    raw = detector.forms_[0].after(whitener.mean_, whitener.matrix_)
    wanted = detector.decision_function(whitener.transform(mines))
    np.testing.assert_allclose(raw(mines), wanted, rtol=1e-8)


def test_without_a_component_it_is_the_shift_of_the_mean():
    """x = 2, μ = 1: |x|² - |x - μ|² = 4 - 1 = 3."""
    detector = PrincipalComponentDetector(rank=0).fit(np.array([[0.5], [1.5]], complex))
    assert detector.decision_function(np.array([[2.0 + 0j]]))[0] == pytest.approx(3.0)


def test_a_variance_of_four_costs_its_logarithm():
    """Mean 0, variance 4: ln p1/p0 = |x|² (1 - 1/4) - ln 4."""
    examples = np.array([[2.0], [-2.0], [2j], [-2j]], complex)
    detector = PrincipalComponentDetector(rank=1).fit(examples)
    score = detector.decision_function(np.array([[0j], [2.0 + 0j]]))
    np.testing.assert_allclose(score, [-np.log(4), 3 - np.log(4)])
    eq2 = NeymanPearsonDetector(rank=1).fit(examples).decision_function(np.array([[0j]]))
    assert eq2[0] == pytest.approx(0)  # without the constant


def test_looks_of_mines_score_above_those_of_clutter(mines):
    detector = PrincipalComponentDetector(rank=2).fit(mines[:200])
    clutter = normal(np.random.default_rng(9), 200, 5)
    assert detector.decision_function(mines[200:]).mean() > 0
    assert detector.decision_function(clutter).mean() < 0
