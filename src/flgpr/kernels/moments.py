"""Mean and covariance of circular complex vectors, sample, shrunk and robust."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.covariance import MinCovDet, ledoit_wolf, oas

Moments = tuple[NDArray[Any], NDArray[Any]]


def sample_moments(X: NDArray[Any], ddof: int = 0) -> Moments:
    """Mean and covariance ``E[(x - mean)(x - mean)^H]`` of the rows of ``X``, divided by N - ddof."""
    mean = X.mean(axis=0)
    centred = X - mean
    return mean, centred.T @ centred.conj() / (X.shape[0] - ddof)


def ledoit_wolf_moments(X: NDArray[Any]) -> Moments:
    """Sample mean, covariance shrunk to a multiple of the identity (Ledoit & Wolf 2004)."""
    mean = X.mean(axis=0)
    return mean, _fold(ledoit_wolf(_composite(X - mean), assume_centered=True)[0], X)


def oas_moments(X: NDArray[Any]) -> Moments:
    """Sample mean, covariance shrunk by the oracle approximation (Chen et al. 2010)."""
    mean = X.mean(axis=0)
    return mean, _fold(oas(_composite(X - mean), assume_centered=True)[0], X)


def robust_moments(X: NDArray[Any]) -> Moments:
    """Minimum covariance determinant (Rousseeuw & Van Driessen 1999): a part of the rows may be anything."""
    fitted = MinCovDet(random_state=0).fit(_composite(X))
    location = fitted.location_
    mean = location[: X.shape[1]] + 1j * location[X.shape[1] :] if np.iscomplexobj(X) else location
    return mean, _fold(fitted.covariance_, X)


def clipped_moments(X: NDArray[Any]) -> Moments:
    """Mean and covariance of rows whose energy is clipped at the median energy: no single row can dominate."""
    energy = np.sum(np.abs(X) ** 2, axis=1)
    limit = np.median(energy)
    scale = np.sqrt(np.divide(limit, energy, out=np.ones_like(energy), where=energy > limit))
    return sample_moments(X * scale[:, None])


ESTIMATORS: dict[str, Callable[[NDArray[Any]], Moments]] = {
    "sample": sample_moments,
    "ledoit-wolf": ledoit_wolf_moments,
    "oas": oas_moments,
    "robust": robust_moments,
    "clipped": clipped_moments,
}


def _composite(X: NDArray[Any]) -> NDArray[np.float64]:
    return np.hstack([X.real, X.imag]) if np.iscomplexobj(X) else X


def _fold(covariance: NDArray[np.float64], X: NDArray[Any]) -> NDArray[Any]:
    """Covariance of a circular vector from that of its real and imaginary parts, stacked."""
    if not np.iscomplexobj(X):
        return covariance
    n = X.shape[1]
    rr, ri, ir, ii = covariance[:n, :n], covariance[:n, n:], covariance[n:, :n], covariance[n:, n:]
    return rr + ii + 1j * (ir - ri)
