"""A mixture of Gaussians finds its groups and rejects what is far from all."""

import numpy as np
import pytest

from flgpr.detect import GaussianMixtureNovelty


def test_mixture_finds_the_number_of_groups():
    rng = np.random.default_rng(0)
    X = np.vstack([rng.normal(c, 0.3, (80, 2)) for c in (-3, 0, 3)])
    assert GaussianMixtureNovelty(random_state=0).fit(X).n_components_ == 3
    assert GaussianMixtureNovelty(random_state=0).fit(X[:80]).n_components_ == 1


def test_the_score_is_the_log_density_and_falls_with_the_distance():
    X = np.random.default_rng(1).normal(size=(200, 2))
    machine = GaussianMixtureNovelty(max_components=1, reg_covar=0.0, random_state=0).fit(X)
    z = (X - X.mean(axis=0)) / X.std(axis=0)
    covariance = np.cov(z.T, ddof=0)
    distance = np.einsum("ni,ij,nj->n", z, np.linalg.inv(covariance), z)
    density = -0.5 * (distance + np.linalg.slogdet(2 * np.pi * covariance)[1])
    np.testing.assert_allclose(machine.score_samples(X), density, atol=1e-3)
    assert machine.predict([[9.0, 9.0]])[0] == -1


def test_bad_parameters_are_refused():
    with pytest.raises(ValueError, match="max_components must be at least 1"):
        GaussianMixtureNovelty(max_components=0).fit(np.zeros((3, 1)))
