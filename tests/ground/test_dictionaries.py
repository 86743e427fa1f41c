"""Dictionaries of local descriptors: words, mixtures and their encodings, against slow twins and by hand."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from flgpr_ground.features.dictionaries import (
    Mixture,
    fisher_vectors,
    improved_fisher_vectors,
    learn_mixture,
    learn_whitening,
    learn_words,
    word_histograms,
)
from reference import patch_features as slow

RNG = np.random.default_rng(5)
CENTRES = np.array([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0], [0.0, 6.0, 3.0], [-6.0, 2.0, 0.0]])
EXAMPLES = np.concatenate([centre + RNG.normal(size=(300, 3)) for centre in CENTRES])
MIXTURE = Mixture(
    np.array([0.5, 0.3, 0.2]), RNG.normal(size=(3, 4)), RNG.uniform(0.5, 2.0, size=(3, 4))
)


def test_whitened_descriptors_have_a_unit_covariance():
    mixing = RNG.normal(size=(5, 5))
    descriptors = RNG.normal(size=(2000, 5)) @ mixing + 7.0
    whitening = learn_whitening(descriptors, 3)
    assert whitening.projection.shape == (3, 5)
    whitened = whitening(descriptors)
    np.testing.assert_allclose(np.cov(whitened, rowvar=False, bias=True), np.eye(3), atol=1e-9)
    np.testing.assert_allclose(whitened.mean(axis=0), 0, atol=1e-9)
    # The first direction is the one with the largest variance.
    variance, vectors = np.linalg.eigh(np.cov(descriptors, rowvar=False))
    along = abs(whitening.projection[0] @ vectors[:, -1]) / np.linalg.norm(whitening.projection[0])
    assert along == pytest.approx(1, abs=1e-9)
    assert variance[-1] >= variance[0]


def test_directions_without_variance_do_not_blow_up():
    descriptors = np.repeat(RNG.normal(size=(200, 2)), 2, axis=1)  # copies: rank 2 of 4
    whitened = learn_whitening(descriptors, 4)(descriptors)
    assert np.abs(whitened).max() < 10
    assert not learn_whitening(np.ones((5, 3)), 3)(np.ones((5, 3))).any()


def test_words_are_the_centres_of_what_was_shown():
    words = learn_words(EXAMPLES, 4, seed=0)
    distance = np.linalg.norm(words[:, None] - CENTRES, axis=-1)
    assert sorted(distance.argmin(axis=1)) == [0, 1, 2, 3]
    assert distance.min(axis=1).max() < 0.3


def test_a_mixture_has_the_moments_of_what_was_shown():
    mixture = learn_mixture(EXAMPLES, 4, seed=0)
    np.testing.assert_allclose(mixture.share, 0.25, atol=0.01)
    np.testing.assert_allclose(mixture.deviation, 1.0, atol=0.15)
    assert mixture.share.sum() == pytest.approx(1)


@pytest.mark.parametrize(
    "learn", [learn_words, lambda *given: np.hstack(learn_mixture(*given)[1:])]
)
def test_dictionaries_are_the_same_whatever_threads_there_are(learn):
    examples = RNG.normal(size=(3000, 6))
    first = learn(examples, 12, 1)
    with threadpool_limits(2):
        np.testing.assert_array_equal(learn(examples, 12, 1), first)
    assert not np.array_equal(learn(examples, 12, 2), first)


def test_fewer_different_examples_than_words_are_no_fault():
    words = learn_words(np.repeat(CENTRES[:2], 5, axis=0), 4, seed=0)
    assert words.shape == (4, 3)
    assert np.isfinite(words).all()


def test_a_histogram_counts_the_nearest_words_of_each_pool():
    words = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    descriptors = RNG.uniform(-1, 5, size=(2, 4, 4, 2))
    histograms = word_histograms(descriptors, words, 2)
    assert histograms.shape == (2, 4, 3)
    np.testing.assert_allclose((histograms**2).sum(axis=-1), 1.0)
    counts = np.zeros(3)
    for x in descriptors[1, 2:, :2].reshape(-1, 2):
        counts[np.argmin([np.linalg.norm(x - word) for word in words])] += 1
    np.testing.assert_allclose(histograms[1, 2], np.sqrt(counts / 4))


def test_fisher_vectors_are_their_slow_twin():
    descriptors = RNG.normal(size=(2, 7, 4)) * 2
    ours = fisher_vectors(descriptors, MIXTURE)
    for of_patch, vector in zip(descriptors, ours, strict=True):
        np.testing.assert_allclose(vector, slow.fisher_vector(of_patch, *MIXTURE), atol=1e-12)


def test_fisher_vectors_are_those_of_scikit_image():
    """The library has a gradient by the weights first, and that by the deviations with the other sign."""
    feature = pytest.importorskip(
        "skimage.feature", reason="scikit-image is a dependency of the tests alone"
    )
    mixture = feature.learn_gmm(EXAMPLES, n_modes=4, gm_args={"covariance_type": "diag"})
    ours = Mixture(mixture.weights_, mixture.means_, np.sqrt(mixture.covariances_))
    theirs = feature.fisher_vector(EXAMPLES[::50], mixture)
    vector = fisher_vectors(EXAMPLES[::50], ours)
    np.testing.assert_allclose(vector[:12], theirs[4:16], atol=1e-9)
    np.testing.assert_allclose(vector[12:], -theirs[16:], atol=1e-9)


def test_a_fisher_vector_is_the_gradient_of_the_log_likelihood():
    """By a small step of one mean and one deviation, over the root of the information (Sec. 2)."""
    descriptors = RNG.normal(size=(9, 4))

    def log_likelihood(mixture):
        total = 0.0
        for x in descriptors:
            off = (x - mixture.mean) / mixture.deviation
            density = np.exp(-0.5 * (off**2).sum(axis=1)) / mixture.deviation.prod(axis=1)
            total += np.log((mixture.share * density).sum())
        return total / len(descriptors)

    vector = fisher_vectors(descriptors, MIXTURE).reshape(2, 3, 4)
    for number, entry, factor in ((0, "mean", 1.0), (1, "deviation", np.sqrt(2))):
        step = np.zeros((3, 4))
        step[1, 2] = 1e-6
        moved = MIXTURE._replace(**{entry: getattr(MIXTURE, entry) + step})
        gradient = (log_likelihood(moved) - log_likelihood(MIXTURE)) / 1e-6
        scaled = gradient * MIXTURE.deviation[1, 2] / (factor * np.sqrt(MIXTURE.share[1]))
        assert vector[number, 1, 2] == pytest.approx(scaled, rel=1e-4)


def test_far_descriptors_do_not_overflow():
    assert np.isfinite(fisher_vectors(np.full((1, 4), 1e3), MIXTURE)).all()


def test_improved_vectors_are_signed_roots_of_unit_norm():
    np.testing.assert_allclose(
        improved_fisher_vectors(np.array([[9.0, -16.0], [0.0, 0.0]])), [[0.6, -0.8], [0.0, 0.0]]
    )
