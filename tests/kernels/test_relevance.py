"""Laplace's approximation and the best precision of a basis function, by their defining equations."""

import numpy as np
import pytest
from scipy.optimize import minimize, minimize_scalar

from flgpr.kernels.relevance import best_variance, laplace


def test_the_mode_and_covariance_are_those_of_the_posterior():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(3, 50))
    target = (rows[0] + rng.normal(size=50) > 0).astype(float)
    alpha = np.array([0.5, 2.0, 10.0])

    def negative_log_posterior(weights):
        c = weights @ rows + 0.2
        likelihood = target @ c - np.logaddexp(0, c).sum()
        return 0.5 * (alpha * weights**2).sum() - likelihood

    posterior = laplace(rows, target, 0.2, alpha, np.zeros(3))
    assert posterior.converged
    want = minimize(negative_log_posterior, np.zeros(3), tol=1e-12).x
    np.testing.assert_allclose(posterior.mean, want, atol=1e-5)
    y = 1 / (1 + np.exp(-(posterior.mean @ rows + 0.2)))
    np.testing.assert_allclose(posterior.residual, target - y, atol=1e-12)
    hessian = (rows * y * (1 - y)) @ rows.T + np.diag(alpha)
    np.testing.assert_allclose(posterior.covariance, np.linalg.inv(hessian), rtol=1e-8)
    sign, logdet = np.linalg.slogdet(hessian)
    evidence = -negative_log_posterior(posterior.mean) + 0.5 * np.log(alpha).sum() - 0.5 * logdet
    assert sign == 1
    assert posterior.evidence == pytest.approx(evidence, abs=1e-8)


@pytest.mark.parametrize("rate", [0.0, 0.3])
def test_the_best_variance_maximises_the_marginal_likelihood(rate):
    """Tipping & Faul 2003: l(v) = (q²v/(1 + sv) - log(1 + sv))/2, less the prior's rate·v/2."""
    s = 2.0
    q = 3.0

    def loss(variance):
        u = 1 + s * variance
        return -0.5 * (q**2 * variance / u - np.log(u) - rate * variance)

    want = minimize_scalar(loss, bounds=(1e-6, 20), method="bounded", options={"xatol": 1e-10}).x
    assert best_variance(s, q, rate) == pytest.approx(want, rel=1e-5)


def test_a_basis_function_that_explains_too_little_is_left_out():
    assert best_variance(2.0, 1.0, 0.0) < 0
    assert best_variance(2.0, 1.5, 0.0) > 0
    assert best_variance(2.0, 1.5, 10.0) < 0
