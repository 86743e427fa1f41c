"""Exact intervals for a proportion and for a rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special
from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]
_NODES = 400
_SMOOTH = 500.0


def clopper_pearson(successes: ArrayLike, trials: ArrayLike, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Bound a probability by the exact binomial interval (Clopper & Pearson 1934), equal tails: low, high.

    Successes and trials are broadcast against one another; the bounds cover at least as often as the level says and are
    0 and 1 without any trial.

    Examples
    --------
    All of 12 found says little of the thirteenth; none of 50 bounds from above.

    >>> from flgpr.scoring import clopper_pearson
    >>> low, high = clopper_pearson([12, 9, 0], [12, 12, 50])
    >>> low.round(3), high.round(3)
    (array([0.735, 0.428, 0.   ]), array([1.   , 0.945, 0.071]))
    """
    tail = _tail(level)
    k, n = np.broadcast_arrays(np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64))
    if ((k < 0) | (k > n)).any():
        raise ValueError(f"successes must lie between 0 and trials, got {k.min():g}..{k.max():g} of {n.min():g}")
    low = np.where(k > 0, special.betaincinv(np.maximum(k, 1), n - k + 1, tail), 0.0)
    high = np.where(k < n, special.betaincinv(k + 1, np.maximum(n - k, 1), 1 - tail), 1.0)
    return low, high


def poisson_interval(count: ArrayLike, exposure: ArrayLike = 1.0, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Bound a rate by the exact Poisson interval (Garwood 1936), equal tails: low, high.

    Events (a mean of repeated counts need not be whole) are counted over an exposure, e.g. an area in m²; the bounds
    are per unit of it and cover at least as often as the level says.

    Examples
    --------
    No false alarm on 300 m², and three:

    >>> from flgpr.scoring import poisson_interval
    >>> low, high = poisson_interval([0, 3], 300.0)
    >>> low.round(4), high.round(4)  # per m²
    (array([0.    , 0.0021]), array([0.0123, 0.0292]))
    """
    tail = _tail(level)
    counts, over = np.asarray(count, dtype=np.float64), np.asarray(exposure, dtype=np.float64)
    if (counts < 0).any():
        raise ValueError(f"count must not be negative, got {counts.min():g}")
    if not (over > 0).all():
        raise ValueError(f"exposure must be positive, got {over.min():g}")
    # A curve of many rows holds the same count again and again: invert each once.
    n, back = np.unique(counts, return_inverse=True)
    low, high = _gamma_quantile(n, tail), _gamma_quantile(n + 1, 1 - tail)
    return low[back].reshape(counts.shape) / over, high[back].reshape(counts.shape) / over


def _gamma_quantile(shape: FloatArray, probability: float) -> FloatArray:
    """Invert the regularised incomplete gamma function for rising shapes; 0 for the shape 0."""
    if len(shape) <= 4 * _NODES or shape[0] < _SMOOTH:
        few = shape[: max(4 * _NODES, int(np.searchsorted(shape, _SMOOTH)))]
        exact = np.where(few > 0, special.gammaincinv(np.where(few > 0, few, 1), probability), 0.0)
        rest = shape[len(few) :]
        return exact if len(rest) == 0 else np.append(exact, _gamma_quantile(rest, probability))
    # The standardised quantile varies slowly with the shape: a spline through nodes agrees to 1e-12 and takes no time.
    nodes = np.geomspace(shape[0], shape[-1], _NODES)
    standard = CubicSpline(np.log(nodes), (special.gammaincinv(nodes, probability) - nodes) / np.sqrt(nodes))
    return shape + np.sqrt(shape) * standard(np.log(shape))


def _tail(level: float) -> float:
    if not 0 < level < 1:
        raise ValueError(f"level must lie between 0 and 1, got {level}")
    return (1 - level) / 2
