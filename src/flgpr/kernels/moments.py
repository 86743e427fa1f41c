"""Mean and covariance of circular complex vectors, sample, shrunk and robust."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import chi2
from sklearn.base import BaseEstimator
from sklearn.covariance import ledoit_wolf, oas
from sklearn.utils.validation import validate_data

from flgpr.types import AnyArray, FloatArray

Moments = tuple[AnyArray, AnyArray]
LEAST_OGK = 4
"""Rows that moments by orthogonal pairs need: an outlier of three cannot be identified."""
# Maronna & Zamar 2002, Sec. 5: constants of the τ-scale, and the quantile beyond which rows are
# left out.
_TAU_LOCATION = 4.5
_TAU_SCALE = 3.0
_OGK_KEPT = 0.9


def sample_moments(X: AnyArray, ddof: int = 0) -> Moments:
    """Return mean and covariance ``E[(x - mean)(x - mean)^H]`` of rows.

    Parameters
    ----------
    X : (N, n_features) ndarray
        Samples, real or complex.
    ddof : int
        By how much the divisor N is reduced.

    Returns
    -------
    mean : (n_features,) ndarray
        Mean.
    covariance : (n_features, n_features) ndarray
        Covariance.
    """
    mean = X.mean(axis=0)
    centred = X - mean
    return mean, centred.T @ centred.conj() / (X.shape[0] - ddof)


def ledoit_wolf_moments(X: AnyArray) -> Moments:
    """Return mean, and covariance shrunk to a multiple of the identity (Ledoit & Wolf 2004).

    Parameters and results are those of :func:`sample_moments`.
    """
    mean = X.mean(axis=0)
    return mean, _fold(ledoit_wolf(_composite(X - mean), assume_centered=True)[0], X)


def oas_moments(X: AnyArray) -> Moments:
    """Return mean, and covariance shrunk by the oracle approximation (Chen et al. 2010)."""
    mean = X.mean(axis=0)
    return mean, _fold(oas(_composite(X - mean), assume_centered=True)[0], X)


def ogk_moments(X: AnyArray) -> Moments:
    """Return robust mean and covariance by orthogonal pairs (Maronna & Zamar 2002).

    There may be fewer rows than columns.

    Covariances of pairs come from robust scales of their sums and differences (Gnanadesikan &
    Kettenring 1972). The principal axes of that matrix, with robust scales along them, make a
    positive semidefinite one. This is done twice; then rows that lie far out are left out, and the
    rest give mean and covariance. Parameters and results are those of :func:`sample_moments`.

    Raises
    ------
    ValueError
        If there are fewer than ``LEAST_OGK`` rows, or more than half of a column is equal: it has
        no robust scale.
    """
    if X.shape[0] < LEAST_OGK:
        raise ValueError(f'moments = "ogk" needs at least {LEAST_OGK} samples, got {X.shape[0]}')
    rows = _composite(X)
    distance = _ogk_distance(rows)
    features = rows.shape[1]
    cutoff = np.median(distance) * chi2.ppf(_OGK_KEPT, features) / chi2.ppf(0.5, features)
    return sample_moments(X[distance <= cutoff])


def _ogk_distance(rows: FloatArray) -> FloatArray:
    """Return the rows' squared distances from the robust mean, of two OGK passes."""
    scaled = rows
    for _ in range(2):
        scaled = scaled / _robust_scale(scaled)
        pairs = _pairwise_covariance(scaled)
        _, axes = np.linalg.eigh(pairs)
        scaled = scaled @ axes
    centre = _robust_location(scaled)
    return np.sum(((scaled - centre) / _robust_scale(scaled)) ** 2, axis=1)


def _pairwise_covariance(scaled: FloatArray) -> FloatArray:
    """Return ``(s(x_j + x_k)² - s(x_j - x_k)²) / 4`` of all pairs of columns of scale s = 1."""
    features = scaled.shape[1]
    pairs = np.eye(features)
    for j in range(features - 1):
        column = scaled[:, j, None]
        remaining = scaled[:, j + 1 :]
        scale_of_sum = _robust_scale(column + remaining)
        scale_of_difference = _robust_scale(column - remaining)
        covariance = (scale_of_sum**2 - scale_of_difference**2) / 4
        pairs[j, j + 1 :] = covariance
        pairs[j + 1 :, j] = covariance
    return pairs


def _robust_location(columns: FloatArray) -> FloatArray:
    """Return the mean of columns, weighed by the distance from the median (Yohai & Zamar 1988)."""
    median, spread = _median_and_spread(columns)
    distance = (columns - median) / (_TAU_LOCATION * spread)
    weight = np.clip(1 - distance**2, 0, None) ** 2
    return np.sum(weight * columns, axis=0) / np.sum(weight, axis=0)


def _robust_scale(columns: FloatArray) -> FloatArray:
    """Return the τ-scale of every column (Yohai & Zamar 1988).

    It is the root mean square about the location, of distances cut off at 3 spreads.
    """
    _, spread = _median_and_spread(columns)
    standardised = (columns - _robust_location(columns)) / spread
    cut_off = np.minimum(standardised**2, _TAU_SCALE**2)
    scale: FloatArray = spread * np.sqrt(np.mean(cut_off, axis=0))
    return scale


def _median_and_spread(
    columns: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the median of every column and the median distance from it, which must not be zero."""
    median = np.median(columns, axis=0)
    spread = np.median(np.abs(columns - median), axis=0)
    if not np.all(spread > 0):
        raise ValueError(
            'moments = "ogk" needs columns in which fewer than half of the samples are equal, '
            f"got {np.count_nonzero(spread == 0)} that are not"
        )
    return median, spread


def clipped_moments(X: AnyArray) -> Moments:
    """Return mean and covariance of rows clipped at the median energy, so that none dominates."""
    energy = np.sum(np.abs(X) ** 2, axis=1)
    limit = np.median(energy)
    scale = np.sqrt(np.divide(limit, energy, out=np.ones_like(energy), where=energy > limit))
    return sample_moments(X * scale[:, None])


ESTIMATORS: dict[str, Callable[[AnyArray], Moments]] = {
    "sample": sample_moments,
    "ledoit-wolf": ledoit_wolf_moments,
    "oas": oas_moments,
    "ogk": ogk_moments,
    "clipped": clipped_moments,
}


def moments_estimator(name: str) -> Callable[[AnyArray], Moments]:
    """Return the estimator of mean and covariance of a name; an unknown one is a ValueError."""
    if name not in ESTIMATORS:
        raise ValueError(f"moments must be one of {', '.join(ESTIMATORS)}, got {name!r}")
    return ESTIMATORS[name]


def check_samples(estimator: BaseEstimator, X: Any, reset: bool, minimum: int = 1) -> AnyArray:
    """Return checked samples, real or complex, in double precision.

    Scikit-learn's own check refuses complex numbers: their parts are checked one by one.

    Parameters
    ----------
    estimator : BaseEstimator
        Estimator that is fitted or used.
    X : (n_samples, n_features) array_like
        Samples.
    reset : bool
        Whether the estimator takes its number of features from these samples, as in a fit.
    minimum : int
        Least number of samples.

    Returns
    -------
    (n_samples, n_features) ndarray
        Samples, float64 or complex128.

    Raises
    ------
    ValueError
        If the shape does not fit, or a value is not finite.
    """
    rules = {"dtype": np.float64, "ensure_min_samples": minimum}
    if not np.iscomplexobj(np.asarray(X)):
        return validate_data(estimator, X, reset=reset, **rules)
    values = np.asarray(X, dtype=np.complex128)
    real = validate_data(estimator, values.real, reset=reset, **rules)
    imaginary = validate_data(estimator, values.imag, reset=False, **rules)
    return real + 1j * imaginary


def _composite(X: AnyArray) -> FloatArray:
    """Return samples with real and imaginary parts side by side."""
    return np.hstack([X.real, X.imag]) if np.iscomplexobj(X) else X


def _fold(covariance: FloatArray, X: AnyArray) -> AnyArray:
    """Return a circular vector's covariance from that of its stacked real and imaginary parts."""
    if not np.iscomplexobj(X):
        return covariance
    n = X.shape[1]
    rr = covariance[:n, :n]
    ri = covariance[:n, n:]
    ir = covariance[n:, :n]
    ii = covariance[n:, n:]
    return rr + ii + 1j * (ir - ri)
