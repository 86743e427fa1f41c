"""Mode of logistic weights under a Laplacian prior, by a search over zero weights and signs.

With the signs given, the penalised loss is smooth and Newton's method solves it. The search lets
the weight in that breaks its condition most, solves, and lets a weight out where it would change
its sign (the feature-sign search of Lee et al. 2007, here with the logistic loss in place of
squares). Wide kernels make nearly dependent basis functions, on which descent by coordinates takes
thousands of sweeps; the small systems here do not mind.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.kernels.relevance import _logistic

_NEWTON = 200  # steps between two entries
_HALVINGS = 40  # of a step that does not descend
_RIDGE = 1 + 1e-9  # keeps the curvature of nearly dependent basis functions invertible
_TINY = 1e-12


class Mode(NamedTuple):
    """End of the search: weights (k,), number of entries, and whether all conditions hold."""

    weights: Any
    entries: int
    converged: bool


@njit(cache=True)
def _newton_step(rows: Any, residual: Any, curvature: Any, scale: float, sign: Any) -> Any:
    """Return slope and step (k,) of the penalised loss in the active weights of fixed signs."""
    slope = -(rows @ residual) + scale * sign
    hessian = (rows * curvature) @ rows.T
    for i in range(len(sign)):
        hessian[i, i] = hessian[i, i] * _RIDGE + _TINY
    return slope, -np.linalg.solve(hessian, slope)


@njit(cache=True)
def _loss(
    rows: Any,
    target: Any,
    scale: float,
    start: Any,
    weights: Any,
    new: Any,
    residual: Any,
    curvature: Any,
) -> float:
    """Return the penalised loss at new active weights; fills residual and curvature.

    ``start`` is the argument of σ at the old weights.
    """
    trial = start + (new - weights) @ rows
    return -_logistic(trial, target, residual, curvature) + scale * np.abs(new).sum()


@njit(cache=True)
def _descend(
    rows: Any,
    target: Any,
    scale: float,
    argument: Any,
    weights: Any,
    step: Any,
    residual: Any,
    curvature: Any,
) -> Any:
    """Return the lowest of the full step and the points before where a weight becomes zero.

    It gives the new active weights and whether the loss fell.
    """
    before = _loss(rows, target, scale, argument, weights, weights, residual, curvature)
    best = weights.copy()
    lowest = before
    first = 1.0
    for i in range(-1, len(weights)):
        size = 1.0
        if i >= 0:
            if weights[i] == 0 or weights[i] * (weights[i] + step[i]) >= 0:
                continue
            size = -weights[i] / step[i]
            first = min(first, size)
        new = weights + size * step
        if i >= 0:
            new[i] = 0.0
        loss = _loss(rows, target, scale, argument, weights, new, residual, curvature)
        if loss < lowest:
            best = new
            lowest = loss
    for _ in range(_HALVINGS):
        if lowest < before:
            return best, True
        first *= 0.5
        new = weights + first * step
        loss = _loss(rows, target, scale, argument, weights, new, residual, curvature)
        if loss < lowest:
            best = new
            lowest = loss
    return best, lowest < before


@njit(cache=True)
def _solve_active(
    rows: Any,
    target: Any,
    scale: float,
    miss: float,
    weights: Any,
    sign: Any,
    argument: Any,
    residual: Any,
    curvature: Any,
) -> None:
    """Move the active weights to the least loss, in place; those that reach zero are removed."""
    for _ in range(_NEWTON):
        active = np.flatnonzero(sign)
        if not active.size:
            return
        active_rows = rows[active]
        old = weights[active]
        slope, step = _newton_step(active_rows, residual, curvature, scale, sign[active])
        if np.abs(slope).max() <= 0.1 * miss:
            return
        new, fell = _descend(active_rows, target, scale, argument, old, step, residual, curvature)
        if fell:
            argument += (new - old) @ active_rows
            weights[active] = new
            sign[:] = np.sign(weights)
        _logistic(argument, target, residual, curvature)
        if not fell:  # as far as the arithmetic goes
            return


@njit(cache=True)
def laplacian_mode(
    rows: Any, target: Any, offset: float, scale: float, tol: float, max_iter: int
) -> Any:
    """Minimise -log p(t | w) + scale · Σ|w|, which is convex.

    ``rows`` (k, N) basis functions, ``target`` (N,) in {0, 1}. It ends when no weight misses its
    condition by more than ``tol`` times the scale: slope = -scale · sign(w), and |slope| at most
    the scale where w = 0.
    """
    k, n = rows.shape
    weights = np.zeros(k)
    sign = np.zeros(k)
    residual = np.empty(n)
    curvature = np.empty(n)
    argument = np.full(n, offset)
    _logistic(argument, target, residual, curvature)
    miss = tol * scale
    for entry in range(max_iter):
        _solve_active(rows, target, scale, miss, weights, sign, argument, residual, curvature)
        slopes = -(rows @ residual)
        missed_at_zero = np.where(weights == 0, np.abs(slopes) - scale, 0.0)
        enters = int(missed_at_zero.argmax())
        if missed_at_zero[enters] <= miss:
            missed = np.where(weights == 0, 0.0, np.abs(slopes + scale * np.sign(weights)))
            return Mode(weights, entry, missed.max() <= miss)
        sign[:] = np.sign(weights)
        sign[enters] = -np.sign(slopes[enters])
    return Mode(weights, max_iter, False)
