"""Duplication of hits in training (Wang et al. 2007, Eq. 18 and 19)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def hit_weights(
    target: ArrayLike, distance: ArrayLike, w0: float, beta: ArrayLike = 1.0, label_radius: float = 1.0
) -> NDArray[np.int64]:
    """How often each alarm enters the training set: W = max(1, round(W0·β·w)) for hits, 1 for false alarms.

    ``w`` shares a target's weight among its alarms in proportion to ``exp(-d²/r²)``; halves are rounded up.

    Parameters
    ----------
    target : (alarm,) array_like of int
        Number of the target that each alarm hits, -1 for a false alarm.
    distance : (alarm,) array_like
        Distance d to that target, m; not read for false alarms.
    w0 : float
        W0, number of false alarms per target.
    beta : float or (alarm,) array_like
        β: 1 for hits on mines, 0.5 for hits on simulants.
    label_radius : float
        r, r_label, the radius within which alarms were labelled hits, m.

    Examples
    --------
    A false alarm, two hits of one mine, and one of another:

    >>> from flgpr.detect import hit_weights
    >>> hit_weights([-1, 0, 0, 1], [9.0, 0.0, 0.5, 1.0], w0=10)
    array([ 1,  6,  4, 10])
    """
    hit_of = np.asarray(target, dtype=np.int64)
    away = np.asarray(distance, dtype=np.float64)
    if hit_of.ndim != 1 or away.shape != hit_of.shape:
        raise ValueError(f"target and distance must have one entry per alarm, got {hit_of.shape} and {away.shape}")
    factor = np.broadcast_to(np.asarray(beta, dtype=np.float64), hit_of.shape)
    if not (np.isfinite(w0) and w0 >= 0 and label_radius > 0 and (factor >= 0).all()):
        raise ValueError(f"w0, beta must not be negative, label_radius positive, got {w0}, {factor}, {label_radius}")
    weights = np.ones(hit_of.size, np.int64)
    hit = hit_of >= 0
    if not hit.any():
        return weights
    if not (np.isfinite(away[hit]).all() and (away[hit] >= 0).all()):
        raise ValueError("distance must be finite and not negative for every hit")
    _, group = np.unique(hit_of[hit], return_inverse=True)
    near = np.exp(-((away[hit] / label_radius) ** 2))
    share = near / np.bincount(group, near)[group]
    weights[hit] = np.maximum(1, np.floor(w0 * factor[hit] * share + 0.5).astype(np.int64))
    return weights
