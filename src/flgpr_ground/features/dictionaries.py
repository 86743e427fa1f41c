"""Dictionaries of local descriptors: visual words, and Fisher vectors of a Gaussian mixture.

All of it works with one thread, so that sums keep their order: equal input gives equal bits.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from sklearn.cluster import KMeans
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr.jit.threads import blas_on_one_thread
from flgpr.types import AnyArray, FloatArray, floats
from flgpr_ground.features.patch_descriptors import split_grid

_LEAST_VARIANCE = 1e-6  # of a principal direction, as a share of the first one's
_STARTS = 3  # of k-means, of which the best counts
_ROUNDS = 100  # of k-means and of expectation maximisation at most


class Whitening(NamedTuple):
    """Principal directions of descriptors, each scaled to unit variance."""

    mean: FloatArray  #: (component,)
    projection: FloatArray  #: (direction, component)

    def __call__(self, descriptors: FloatArray) -> FloatArray:
        """Return descriptors (..., component) in the principal directions (..., direction)."""
        with blas_on_one_thread():
            return (descriptors - self.mean) @ self.projection.T


class Mixture(NamedTuple):
    """Gaussians with diagonal covariances."""

    share: FloatArray  #: (gaussian,) their weights, which add up to 1
    mean: FloatArray  #: (gaussian, direction)
    deviation: FloatArray  #: (gaussian, direction) standard deviations


def learn_whitening(descriptors: FloatArray, directions: int) -> Whitening:
    """Return the principal directions of descriptors, scaled so that their variances are one.

    Parameters
    ----------
    descriptors : (n, component) ndarray
        Examples.
    directions : int
        How many; no more than there are components.
    """
    with blas_on_one_thread():
        mean = descriptors.mean(axis=0)
        covariance = np.cov(descriptors, rowvar=False, bias=True).reshape(mean.size, mean.size)
        variance, vectors = np.linalg.eigh(covariance)
    variance = variance[::-1][:directions]
    vectors = vectors[:, ::-1][:, :directions]
    least = max(_LEAST_VARIANCE * float(variance[0]), np.finfo(np.float64).tiny)
    scale = 1 / np.sqrt(np.maximum(variance, least))
    return Whitening(mean, np.ascontiguousarray((vectors * scale).T))


def learn_words(descriptors: FloatArray, count: int, seed: int) -> FloatArray:
    """Return the visual words of a dictionary, the centres of k-means.

    Parameters
    ----------
    descriptors : (n, direction) ndarray
        Examples, at least as many as words.
    count : int
        Number of words.
    seed : int
        Of the centres that it begins with.

    Returns
    -------
    (word, direction) ndarray
        The words.
    """
    means = KMeans(count, n_init=_STARTS, max_iter=_ROUNDS, random_state=seed)
    # Fewer different examples than words: some words are then the same.
    _fit(means, descriptors)
    return floats(means.cluster_centers_)


def _fit(model: KMeans | GaussianMixture, descriptors: FloatArray) -> None:
    """Fit a model on one thread; what a hundred rounds found is what is used."""
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(descriptors)


def learn_mixture(descriptors: FloatArray, gaussians: int, seed: int) -> Mixture:
    """Return the mixture of Gaussians that expectation maximisation finds.

    Parameters
    ----------
    descriptors : (n, direction) ndarray
        Examples, at least as many as Gaussians.
    gaussians : int
        Number of Gaussians.
    seed : int
        Of the k-means that it begins with.
    """
    mixture = GaussianMixture(
        gaussians, covariance_type="diag", max_iter=_ROUNDS, random_state=seed
    )
    _fit(mixture, descriptors)
    deviation = np.sqrt(floats(mixture.covariances_))
    return Mixture(floats(mixture.weights_), floats(mixture.means_), deviation)


def word_histograms(descriptors: FloatArray, dictionary: FloatArray, divisions: int) -> FloatArray:
    """Return how often every visual word is the nearest one in each part of a patch.

    That is the bag of visual words (Csurka, Dance, Fan, Willamowski & Bray, "Visual categorization
    with bags of keypoints", ECCV workshop on statistical learning in computer vision, 2004), of
    every part by itself. Of the shares the square root is taken, so that a product of two
    histograms is the Bhattacharyya coefficient (Perronnin, Sánchez & Liu, CVPR 2010).

    Parameters
    ----------
    descriptors : (n, row, column, direction) ndarray
        Local descriptors of patches, on a grid.
    dictionary : (word, direction) ndarray
        The words.
    divisions : int
        Parts of a patch each way.

    Returns
    -------
    (n, part, word) ndarray
        Square roots of shares.
    """
    with blas_on_one_thread():
        # Squared distances, less the descriptors' own squares, which are alike for all words.
        distance = (dictionary**2).sum(axis=1) - 2 * descriptors @ dictionary.T
    nearest = distance.argmin(axis=-1)
    is_word = floats(nearest[..., None] == np.arange(len(dictionary)))
    shares = [block.mean(axis=-2) for block in split_grid(is_word, divisions)]
    return np.sqrt(np.stack(shares, axis=1))


def fisher_vectors(descriptors: FloatArray, mixture: Mixture) -> FloatArray:
    """Return the gradients of a mixture's log-likelihood of descriptors, before normalisation.

    See Perronnin, Sánchez & Mensink, "Improving the Fisher kernel for large-scale image
    classification", ECCV 2010, Sec. 2: by the means and the standard deviations of all Gaussians,
    in units of the square root of their Fisher information.

    Parameters
    ----------
    descriptors : (..., position, direction) ndarray
        Local descriptors.
    mixture : Mixture
        The Gaussians.

    Returns
    -------
    (..., 2 * gaussian * direction) ndarray
        By all means, Gaussian after Gaussian, then by all deviations.
    """
    share = mixture.share[:, None]
    off = (descriptors[..., None, :] - mixture.mean) / mixture.deviation

    # Posterior of every Gaussian; the largest density is taken out so that none overflows.
    log_density = np.log(mixture.share) - np.log(mixture.deviation).sum(axis=1)
    log_density = log_density - 0.5 * (off**2).sum(axis=-1)
    log_density -= log_density.max(axis=-1, keepdims=True)
    density = np.exp(log_density)
    posterior = (density / density.sum(axis=-1, keepdims=True))[..., None]

    by_mean = (posterior * off).mean(axis=-3) / np.sqrt(share)
    by_deviation = (posterior * (off**2 - 1)).mean(axis=-3) / np.sqrt(2 * share)
    gradients = np.stack([by_mean, by_deviation], axis=-3)
    return gradients.reshape(*gradients.shape[:-3], -1)


def improved_fisher_vectors(vectors: AnyArray) -> FloatArray:
    """Return the signed square roots of Fisher vectors (..., component), scaled to a norm of one.

    See Perronnin, Sánchez & Mensink, ECCV 2010, Sec. 3.1 and 3.2. A vector of zeros stays so.
    """
    powered = np.sign(vectors) * np.sqrt(np.abs(vectors))
    norm = np.sqrt((powered**2).sum(axis=-1, keepdims=True))
    return powered / np.where(norm > 0, norm, 1.0)
