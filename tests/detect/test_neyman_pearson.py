"""The Gaussian Neyman-Pearson detector against Cosgrove et al. 2004, Eq. 2."""

import numpy as np
import pytest

from flgpr.detect import NeymanPearsonDetector, neyman_pearson_form
from reference.cosgrove2004 import circular, equation_2


@pytest.fixture
def rng():
    return np.random.default_rng(2)


def signal(rng, n=5):
    mu = rng.normal(size=n) + 1j * rng.normal(size=n)
    factor = rng.normal(size=(n, 2)) + 1j * rng.normal(size=(n, 2))
    return mu, factor @ factor.conj().T


def test_form_is_equation_2(rng):
    mu, C = signal(rng)
    X = circular(rng, 0 * mu, np.eye(5), 20)
    assert np.allclose(neyman_pearson_form(mu, C)(X), [equation_2(x, mu, C) for x in X])
    assert np.allclose(neyman_pearson_form(mu, C, rank=2)(X), neyman_pearson_form(mu, C)(X))


def test_form_is_the_log_likelihood_ratio(rng):
    mu, C = signal(rng)
    X = circular(rng, mu, C + np.eye(5), 50)
    form = neyman_pearson_form(mu, C)
    logdet = np.linalg.slogdet(C + np.eye(5))[1]
    # E1 of the log-likelihood ratio is the divergence of the two Gaussians.
    divergence = np.trace(C).real + np.linalg.norm(mu) ** 2 - logdet
    many = form(circular(rng, mu, C + np.eye(5), 100_000)) - logdet
    assert abs(many.mean() - divergence) < 4 * many.std() / np.sqrt(many.size)
    assert np.isfinite(form(X)).all()


def test_without_covariance_it_is_the_matched_filter(rng):
    mu, _ = signal(rng)
    X = circular(rng, 0 * mu, np.eye(5), 20)
    value = neyman_pearson_form(mu, np.zeros((5, 5)))(X)
    assert np.allclose(value, 2 * (X @ mu.conj()).real - np.linalg.norm(mu) ** 2)


def test_training_recovers_the_known_form(rng):
    mu, C = signal(rng)
    detector = NeymanPearsonDetector(rank=2).fit(circular(rng, mu, C + np.eye(5), 20_000))
    X = circular(rng, mu, C + np.eye(5), 200)
    found = detector.decision_function(X)
    wanted = neyman_pearson_form(mu, C)(X)
    assert np.corrcoef(found, wanted)[0, 1] > 0.999


def test_few_examples_leave_a_finite_form(rng):
    mu, C = signal(rng)
    detector = NeymanPearsonDetector(rank=None).fit(circular(rng, mu, C + np.eye(5), 3))
    assert (detector.forms_[0].strength >= 0).all()
    assert (detector.forms_[0].strength < 1).all()
    assert np.isclose(detector.eigenvalues_[-1], -1)


def test_full_shrinkage_leaves_the_matched_filter(rng):
    mu, C = signal(rng)
    examples = circular(rng, mu, C + np.eye(5), 30)
    detector = NeymanPearsonDetector(shrinkage=1.0).fit(examples)
    X = circular(rng, 0 * mu, np.eye(5), 10)
    mean = examples.mean(axis=0)
    assert np.allclose(
        detector.decision_function(X), 2 * (X @ mean.conj()).real - np.linalg.norm(mean) ** 2
    )


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"rank": -2}, "rank"),
        ({"shrinkage": 2}, "shrinkage"),
        ({"ddof": 6}, "ddof"),
        ({"moments": "x"}, "moments"),
    ],
)
def test_bad_parameters_are_named(rng, parameters, message):
    with pytest.raises(ValueError, match=message):
        NeymanPearsonDetector(**parameters).fit(rng.normal(size=(6, 3)))
