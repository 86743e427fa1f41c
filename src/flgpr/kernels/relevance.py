"""Sparse Bayesian logistic models: Laplace's approximation and the fast ascent of the marginal likelihood."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

_NEWTON = 60
_TINY = 1e-300
_RIDGE = 1 + 1e-12  # keeps the curvature of nearly dependent basis functions invertible
_HOLD = 3  # sweeps between entries
_SETTLE = 50  # sweeps when nothing enters
_ENTRIES = 5  # a function that keeps entering and leaving gains only while the likelihood is held quadratic
_DROP = 0.5  # fall of the log evidence below its highest that a step may cost
_RISE = 1e-3  # smallest rise of the log evidence that makes an exchange


@njit(cache=True)
def _log_likelihood(c: Any, target: Any, weight: Any) -> float:
    total = 0.0
    for n in range(c.size):
        if weight[n] > 0:
            total += weight[n] * (target[n] * c[n] - max(c[n], 0.0) - np.log1p(np.exp(-abs(c[n]))))
    return total


@njit(cache=True)
def _logistic(c: Any, target: Any, weight: Any, residual: Any, curvature: Any) -> None:
    for n in range(c.size):
        e = np.exp(-abs(c[n]))
        y = 1 / (1 + e) if c[n] >= 0 else e / (1 + e)
        residual[n] = weight[n] * (target[n] - y)
        curvature[n] = weight[n] * e / (1 + e) ** 2


@njit(cache=True)
def laplace(rows: Any, target: Any, weight: Any, offset: float, alpha: Any, mean: Any) -> Any:
    """Newton's method with line search to the mode of the weights (Tipping 2001, Sec. 3).

    ``rows`` (k, N) basis functions, ``target`` (N,) in {0, 1}, ``alpha`` (k,) precisions, ``mean`` (k,) start.
    Returns mode, covariance (k, k), residual w(t - y), curvature w y(1 - y), log evidence, whether it converged.
    """
    k, n = rows.shape
    residual, curvature = np.empty(n), np.empty(n)
    mean = mean.copy()
    c = mean @ rows + offset
    value = _log_likelihood(c, target, weight) - 0.5 * (alpha * mean * mean).sum()
    found = False
    hessian = np.empty((k, k))
    for _ in range(_NEWTON):
        _logistic(c, target, weight, residual, curvature)
        hessian = (rows * curvature) @ rows.T
        for i in range(k):
            hessian[i, i] = (hessian[i, i] + alpha[i]) * _RIDGE
        gradient = rows @ residual - alpha * mean
        step = np.linalg.solve(hessian, gradient)
        rise = (gradient * step).sum()
        if found or rise < 1e-18:
            found = True
            break
        direction = step @ rows
        scale = 1.0
        while True:
            trial = mean + scale * step
            moved = c + scale * direction
            reached = _log_likelihood(moved, target, weight) - 0.5 * (alpha * trial * trial).sum()
            if reached >= value + 1e-4 * scale * rise or scale < 1e-10:
                break
            scale *= 0.5
        mean, c = trial, moved
        # So near the mode that Newton's steps square the error: one more evaluation ends it.
        found = rise < 1e-9 * (1 + abs(value))
        value = reached
    covariance = np.linalg.inv(hessian)
    logdet = 2 * np.log(np.diag(np.linalg.cholesky(hessian))).sum() if k else 0.0
    evidence = value + 0.5 * np.log(alpha).sum() - 0.5 * logdet
    return mean, covariance, residual, curvature, evidence, found


@njit(cache=True)
def best_variance(s: float, q: float, rate: float) -> float:
    """Prior variance 1/α that maximises the marginal likelihood of one basis function; not positive: leave it out.

    Root of -s u + q² - rate u² with u = 1 + s/α: Tipping & Faul 2003, Eq. 20 for ``rate`` 0, and with an exponential
    prior exp(-rate/(2α)) on the variance, which makes the prior of the weight Laplacian.
    """
    q2 = q * q
    u = 2 * q2 / (s + np.sqrt(s * s + 4 * rate * q2))
    return (u - 1) / s


@njit(cache=True)
def _gain(s: float, q: float, rate: float) -> float:
    """Rise of the log evidence when a basis function enters with its best variance."""
    if s <= 0 or q * q <= s + rate:
        return 0.0
    variance = best_variance(s, q, rate)
    u = 1 + s * variance
    return 0.5 * (q * q * variance / u - np.log(u) - rate * variance)


@njit(cache=True)
def candidates(rows: Any, square: Any, allowed: Any, active: Any, posterior: Any, rate: float) -> Any:
    """Sparsity S and quality Q of all basis functions left out; returns the best one and its gain, S and Q.

    At the mode Q = φᵀ(t - y): the term of the model vanishes with the gradient (Tipping & Faul 2003, Eq. 24).
    """
    covariance, residual, curvature = posterior
    s = square @ curvature
    if active.size:
        cross = (rows[active] * curvature) @ rows.T
        s -= (cross * (covariance @ cross)).sum(axis=0)
    q = rows @ residual
    inside = np.zeros(rows.shape[0], np.bool_)
    inside[active] = True
    best, most = -1, 0.0
    for i in range(rows.shape[0]):
        if allowed[i] and not inside[i]:
            gain = _gain(s[i], q[i], rate)
            if gain > most:
                best, most = i, gain
    return best, most, s[best], q[best]


@njit(cache=True)
def _sweep(alpha: Any, mean: Any, covariance: Any, rate: float) -> float:
    """Give every active weight its best precision in turn, the likelihood held quadratic; returns the largest change.

    Changes ``alpha`` (inf where a weight leaves), ``mean`` and ``covariance`` in place.
    """
    change = 0.0
    for j in range(alpha.size):
        if np.isinf(alpha[j]):
            continue
        own = covariance[j, j]
        s, q = 1 / own - alpha[j], mean[j] / own
        column = covariance[:, j].copy()
        variance = best_variance(s, q, rate) if s > _TINY and q * q > s + rate else 0.0
        if variance <= 0:
            factor = 1 / own
            alpha[j] = np.inf
            change = np.inf
        else:
            new = 1 / variance
            change = max(change, abs(np.log(new / alpha[j])))
            factor = (new - alpha[j]) / (1 + (new - alpha[j]) * own)
            alpha[j] = new
        mean -= factor * mean[j] * column
        covariance -= factor * np.outer(column, column)
    return change


@njit(cache=True)
def _step(
    rows: Any, target: Any, weight: Any, offset: float, rate: float,
    active: Any, alpha: Any, goal: Any, mean: Any, floor: float,
) -> Any:  # fmt: skip
    """Take the precisions towards their goal (inf: out), in halved steps where the evidence would fall below a floor.

    The goal is the best for a likelihood held quadratic. Where all examples are as good as certain the curvature
    vanishes, and functions that carry the model would leave it. Returns active, precisions, Laplace's approximation,
    evidence less penalty, whether a step was taken.
    """
    part = 1.0
    for _ in range(8):
        if part == 1.0:
            kept = np.isfinite(goal)
            trial, chosen, begin = goal[kept], active[kept], mean[kept]
        else:
            trial = alpha * (np.minimum(goal, 1e3 * alpha) / alpha) ** part
            chosen, begin = active, mean
        posterior = laplace(rows[chosen], target, weight, offset, trial, begin)
        value = posterior[4] - 0.5 * rate * (1 / trial).sum()
        if value >= floor:
            return chosen, trial, posterior, value, True
        part *= 0.5
    posterior = laplace(rows[active], target, weight, offset, alpha, mean)
    return active, alpha.copy(), posterior, posterior[4] - 0.5 * rate * (1 / alpha).sum(), False


@njit(cache=True)
def ascend(
    rows: Any, square: Any, target: Any, weight: Any, offset: float, allowed: Any, rate: float,
    start: Any, alpha: Any, mean: Any, first: Any, tolerance: float, max_iter: int,
) -> Any:  # fmt: skip
    """Raise the evidence until no basis function gains by entering, changing or leaving (Tipping & Faul 2003).

    ``rows`` (M, N) all basis functions, ``square`` their squares, ``allowed`` (M,) which may enter; ``start``,
    ``alpha`` and ``mean`` (k,) the model to begin with; ``first`` (M,) which may enter first. Returns active indices,
    precisions, mode, covariance, log evidence, iterations, whether it converged.
    """
    active, alpha = start.copy(), alpha.copy()
    posterior = laplace(rows[active], target, weight, offset, alpha, mean)
    value = posterior[4] - 0.5 * rate * (1 / alpha).sum()
    peak = value
    permitted, entries = first, np.zeros(rows.shape[0], np.int64)
    converged = False
    iteration = 0
    while iteration < max_iter:
        iteration += 1
        open_to = permitted & (entries < _ENTRIES)
        entering, gain, s, q = candidates(rows, square, open_to, active, posterior[1:4], rate)
        permitted = allowed
        growing = gain > tolerance
        if growing:
            entries[entering] += 1
            grown, more = np.append(active, entering), np.append(alpha, 1 / best_variance(s, q, rate))
            trial = laplace(rows[grown], target, weight, offset, more, np.append(posterior[0], 0.0))
            reached = trial[4] - 0.5 * rate * (1 / more).sum()
            if reached < peak - _DROP:
                entries[entering] = _ENTRIES
                continue
            active, alpha, posterior, value = grown, more, trial, reached
        change, before = 0.0, value
        for _ in range(_HOLD if growing else _SETTLE):
            peak = max(peak, value)
            goal, mean = alpha.copy(), posterior[0].copy()
            change = _sweep(goal, mean, posterior[1].copy(), rate)
            active, alpha, posterior, value, moved = _step(
                rows, target, weight, offset, rate, active, alpha, goal, mean, peak - _DROP
            )
            if not moved:
                change = 0.0
            if change < tolerance:
                break
        # Where two functions are almost alike their precisions creep along a ridge without end and without gain.
        flat = abs(value - before) < 1e-2 * tolerance
        if not growing and (change < tolerance or flat) and posterior[5] and iteration > 1:
            converged = True
            break
    return active, alpha, posterior[0], posterior[1], posterior[4], iteration, converged


@njit(cache=True)
def exchange(
    rows: Any, square: Any, target: Any, weight: Any, offset: float, allowed: Any, rate: float,
    fit: Any, tolerance: float, max_iter: int,
) -> Any:  # fmt: skip
    """Leave a local maximum: take out one basis function after another and ascend anew from what is left.

    The first to enter must be another one. ``fit`` is what :func:`ascend` returns, and so is the result, whose evidence
    (less the prior's penalty) is no lower.
    """
    best = fit
    tried, place = 0, 0
    iterations = fit[5]
    while tried < best[0].size:
        place = place % best[0].size
        kept = np.ones(best[0].size, np.bool_)
        kept[place] = False
        first = allowed.copy()
        first[best[0][place]] = False
        trial = ascend(
            rows, square, target, weight, offset, allowed, rate,
            best[0][kept], best[1][kept], best[2][kept], first, tolerance, max_iter,
        )  # fmt: skip
        iterations += trial[5]
        if trial[6] and penalised(trial, rate) > penalised(best, rate) + _RISE:
            best, tried = trial, 0
        else:
            tried, place = tried + 1, place + 1
    return best[0], best[1], best[2], best[3], best[4], iterations, best[6]


@njit(cache=True)
def penalised(fit: Any, rate: float) -> float:
    """Log evidence with the log prior of the variances, up to a constant."""
    return fit[4] - 0.5 * rate * (1 / fit[1]).sum()
