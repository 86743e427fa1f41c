"""Sparse Bayesian logistic models: Laplace's approximation and the ascent of the evidence."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flgpr.jit.compiled import njit

_NEWTON = 60  # steps of Newton's method, of which few are needed
_TINY = 1e-300
_RIDGE = 1 + 1e-12  # keeps the curvature of nearly dependent basis functions invertible
_HOLD = 3  # sweeps between entries
_SETTLE = 50  # sweeps when nothing enters
# a function that keeps entering and leaving gains only while the likelihood is held quadratic
_ENTRIES = 5
_DROP = 0.5  # fall of the log evidence below its highest that a step may cost
_LOGIT = np.log(0.95 / 0.05)  # log odds that the first function is fitted to
_STILL = 1e-3  # change of log α that is no action any more
_CONFIRM = 3  # candidates looked at in double precision


class Problem(NamedTuple):
    """Examples, basis functions and prior of a model: what stays the same all through a fit."""

    rows: Any  #: (M, N): all basis functions at the examples
    coarse: Any  #: (2, M, N) of float32: the same and their squares (:func:`single`)
    target: Any  #: (N,): labels, 0 or 1
    offset: float  #: log odds where all weights are zero
    allowed: Any  #: (M,) of bool: functions that may enter
    rate: float  #: of the prior, as in :func:`best_variance`


class Posterior(NamedTuple):
    """Laplace's approximation: mode (k,), covariance (k, k), residual t - y, curvature y(1 - y).

    The log evidence follows.
    """

    mean: Any
    covariance: Any
    residual: Any
    curvature: Any
    evidence: float
    converged: bool


class Ascent(NamedTuple):
    """End of an ascent: active indices (k,), precisions (k,), mode, covariance, log evidence."""

    active: Any
    alpha: Any
    mean: Any
    covariance: Any
    evidence: float
    iterations: int
    converged: bool


@njit(cache=True)
def _logistic(c: Any, target: Any, residual: Any, curvature: Any) -> float:
    """Return the log likelihood at the argument ``c`` of σ; fills residual t - y and y(1 - y)."""
    total = 0.0
    product = 1.0
    for n in range(c.size):
        e = np.exp(-abs(c[n]))
        u = 1 / (1 + e)
        residual[n] = target[n] - (u if c[n] >= 0 else e * u)
        curvature[n] = e * u * u
        total += target[n] * c[n] - max(c[n], 0.0)
        # One logarithm for many factors, each at most 2.
        product *= 1 + e
        if product > 1e280:
            total -= np.log(product)
            product = 1.0
    return total - np.log(product)


@njit(cache=True)
def laplace(rows: Any, target: Any, offset: float, alpha: Any, mean: Any) -> Any:
    """Return Laplace's approximation about the mode of the weights (Tipping 2001, Sec. 3).

    The mode is found by Newton's method with line search.

    Parameters
    ----------
    rows : (k, N) ndarray
        Basis functions at the examples.
    target : (N,) ndarray
        Labels, 0 or 1.
    offset : float
        Log odds where all weights are zero.
    alpha : (k,) ndarray
        Precisions of the weights' prior.
    mean : (k,) ndarray
        Weights to begin with.

    Returns
    -------
    Posterior
        Approximation; it says whether the mode was reached.
    """
    k, n = rows.shape
    residual = np.empty(n)
    curvature = np.empty(n)
    mean = mean.copy()
    c = mean @ rows + offset
    value = _logistic(c, target, residual, curvature) - 0.5 * (alpha * mean * mean).sum()
    converged = False
    hessian = np.empty((k, k))
    for _ in range(_NEWTON):
        hessian = (rows * curvature) @ rows.T
        for i in range(k):
            hessian[i, i] = (hessian[i, i] + alpha[i]) * _RIDGE
        gradient = rows @ residual - alpha * mean
        step = np.linalg.solve(hessian, gradient)
        rise = (gradient * step).sum()
        if converged or rise < 1e-18:
            converged = True
            break
        direction = step @ rows
        scale = 1.0
        # Halved until the rise is a share of the predicted one (Armijo's condition).
        while True:
            trial = mean + scale * step
            moved = c + scale * direction
            reached = (
                _logistic(moved, target, residual, curvature) - 0.5 * (alpha * trial * trial).sum()
            )
            if reached >= value + 1e-4 * scale * rise or scale < 1e-10:
                break
            scale *= 0.5
        mean = trial
        c = moved
        # So near the mode that Newton's steps square the error: one more evaluation ends it.
        converged = rise < 1e-9 * (1 + abs(value))
        value = reached
    covariance = np.linalg.inv(hessian)
    logdet = 2 * np.log(np.diag(np.linalg.cholesky(hessian))).sum() if k else 0.0
    evidence = value + 0.5 * np.log(alpha).sum() - 0.5 * logdet
    return Posterior(mean, covariance, residual, curvature, evidence, converged)


@njit(cache=True)
def best_variance(s: float, q: float, rate: float) -> float:
    """Return the prior variance 1/α of a basis function that maximises the marginal likelihood.

    A value that is not positive leaves the function out.

    The variance follows from the root of -s u + q² - rate u² with u = 1 + s/α: Tipping & Faul 2003,
    Eq. 20 for ``rate`` 0, and with an exponential prior exp(-rate/(2α)) on the variance, which
    makes the prior of the weight Laplacian.

    Parameters
    ----------
    s, q : float
        Sparsity and quality of the function without its own weight.
    rate : float
        Rate of the exponential prior; zero for none.
    """
    q2 = q * q
    u = 2 * q2 / (s + np.sqrt(s * s + 4 * rate * q2))
    return (u - 1) / s


@njit(cache=True)
def _gain(s: float, q: float, rate: float) -> float:
    """Return the rise of the log evidence when a basis function enters with its best variance."""
    if s <= 0 or q * q <= s + rate:
        return 0.0
    variance = best_variance(s, q, rate)
    u = 1 + s * variance
    return 0.5 * (q * q * variance / u - np.log(u) - rate * variance)


def single(rows: Any) -> Any:
    """Return basis functions and their squares in single precision: half as much to read."""
    values = rows.astype(np.float32)
    return np.stack((values, values * values))


@njit(cache=True)
def _gains(s: Any, q: Any, allowed: Any, active: Any, rate: float) -> Any:
    """Return the gain of every basis function, zero for active ones and those not allowed."""
    inside = np.zeros(s.size, np.bool_)
    inside[active] = True
    gain = np.zeros(s.size)
    for i in range(s.size):
        if allowed[i] and not inside[i]:
            gain[i] = _gain(s[i], q[i], rate)
    return gain


def entries(problem: Problem, active: Any, posterior: Any) -> Any:
    """Return gain, sparsity S and quality Q of all basis functions.

    At the mode Q = φᵀ(t - y): the term of the model vanishes with the gradient (Tipping & Faul
    2003, Eq. 24).

    Parameters
    ----------
    problem : Problem
        Examples, basis functions and prior.
    active : (k,) ndarray of int
        Functions that are in the model.
    posterior : Posterior
        Laplace's approximation of the model.

    Returns
    -------
    gain, s, q : (M,) ndarray
        Rise of the log evidence when the function enters, zero for those that are in the model or
        not allowed; sparsity; quality.
    """
    rows = problem.rows
    covariance = posterior.covariance
    residual = posterior.residual
    curvature = posterior.curvature
    s = (rows * rows) @ curvature
    cross = (rows[active] * curvature) @ rows.T
    s -= (cross * (covariance @ cross)).sum(axis=0)
    q = rows @ residual
    return _gains(s, q, problem.allowed, active, problem.rate), s, q


@njit(cache=True)
def ranking(problem: Problem, allowed: Any, active: Any, posterior: Any) -> Any:
    """Return the gain of all basis functions as :func:`entries` has it, in single precision.

    ``allowed`` (M,) are those that may enter.
    """
    coarse = problem.coarse
    covariance = posterior.covariance
    residual = posterior.residual
    curvature = posterior.curvature
    k = active.size
    factors = np.empty((k + 1, residual.size), np.float32)
    for j in range(k):
        factors[j] = coarse[0, active[j]] * curvature
    factors[k] = residual
    sums = (factors @ coarse[0].T).astype(np.float64)
    s = (coarse[1] @ curvature.astype(np.float32)).astype(np.float64)
    explained = covariance @ sums[:k]
    for i in range(s.size):
        total = 0.0
        for j in range(k):
            total += sums[j, i] * explained[j, i]
        s[i] -= total
    return _gains(s, sums[k], allowed, active, problem.rate)


@njit(cache=True)
def entry(problem: Problem, function: int, active: Any, posterior: Any) -> Any:
    """Return gain, S and Q of a basis function in double precision."""
    rows = problem.rows
    covariance = posterior.covariance
    residual = posterior.residual
    curvature = posterior.curvature
    weighted = rows[function] * curvature
    cross = rows[active] @ weighted
    s = (rows[function] * weighted).sum() - (cross * (covariance @ cross)).sum()
    q = (rows[function] * residual).sum()
    return _gain(s, q, problem.rate), s, q


@njit(cache=True)
def candidates(
    problem: Problem, allowed: Any, active: Any, posterior: Any, tolerance: float
) -> Any:
    """Return the best function to enter, or -1, with its gain, S and Q, in double precision."""
    gain = ranking(problem, allowed, active, posterior)
    for _ in range(_CONFIRM):
        best = int(gain.argmax())
        if gain[best] <= tolerance:
            break
        exact, s, q = entry(problem, best, active, posterior)
        if exact > tolerance:
            return best, exact, s, q
        gain[best] = 0
    return -1, 0.0, 0.0, 0.0


@njit(cache=True)
def _sweep(alpha: Any, mean: Any, covariance: Any, rate: float) -> float:
    """Set every active weight's best precision in turn; return the largest change.

    The likelihood is taken as quadratic.

    Changes ``alpha`` (inf where a weight leaves), ``mean`` and ``covariance`` in place.
    """
    change = 0.0
    for j in range(alpha.size):
        if np.isinf(alpha[j]):
            continue
        variance_j = covariance[j, j]
        s = 1 / variance_j - alpha[j]
        q = mean[j] / variance_j
        column = covariance[:, j].copy()
        variance = best_variance(s, q, rate) if s > _TINY and q * q > s + rate else 0.0
        if variance <= 0:
            factor = 1 / variance_j
            alpha[j] = np.inf
            change = np.inf
        else:
            new = 1 / variance
            change = max(change, abs(np.log(new / alpha[j])))
            factor = (new - alpha[j]) / (1 + (new - alpha[j]) * variance_j)
            alpha[j] = new
        mean -= factor * mean[j] * column
        for i in range(alpha.size):
            for k in range(alpha.size):
                covariance[k, i] -= factor * (column[k] * column[i])
    return change


@njit(cache=True)
def _laplace_of(problem: Problem, active: Any, alpha: Any, mean: Any) -> Any:
    """Return Laplace's approximation of some of the functions, and its evidence less penalty."""
    posterior = laplace(problem.rows[active], problem.target, problem.offset, alpha, mean)
    return posterior, posterior.evidence - 0.5 * problem.rate * (1 / alpha).sum()


@njit(cache=True)
def _step(problem: Problem, active: Any, alpha: Any, goal: Any, mean: Any, floor: float) -> Any:
    """Move the precisions towards their goal, in halved steps if the evidence fell below a floor.

    A goal of inf removes the function.

    The goal is the best for a likelihood held quadratic. Where all examples are as good as certain
    the curvature vanishes, and functions that carry the model would leave it. Returns active,
    precisions, Laplace's approximation, evidence less penalty, whether a step was taken.
    """
    share = 1.0
    for _ in range(8):
        if share == 1.0:
            remains = np.isfinite(goal)
            trial = goal[remains]
            chosen = active[remains]
            begin = mean[remains]
        else:
            trial = alpha * (np.minimum(goal, 1e3 * alpha) / alpha) ** share
            chosen = active
            begin = mean
        posterior, value = _laplace_of(problem, chosen, trial, begin)
        if value >= floor:
            return chosen, trial, posterior, value, True
        share *= 0.5
    posterior, value = _laplace_of(problem, active, alpha, mean)
    return active, alpha.copy(), posterior, value, False


@njit(cache=True)
def ascend(
    problem: Problem, start: Any, alpha: Any, mean: Any, first: Any, tolerance: float, max_iter: int
) -> Any:
    """Raise the evidence until no basis function gains by a change (Tipping & Faul 2003).

    Unlike the paper's single actions, all active precisions are set in sweeps between two entries;
    it takes fewer of the expensive passes over all functions. :func:`climb` is the paper's way.

    Parameters
    ----------
    problem : Problem
        Examples, basis functions and prior.
    start : (k,) ndarray of int
        Functions of the model to begin with.
    alpha, mean : (k,) ndarray
        Its precisions and weights.
    first : (M,) ndarray of bool
        Functions that may enter in the first iteration.
    tolerance : float
        Gain of the log evidence, and change of log α, that counts.
    max_iter : int
        Most iterations.

    Returns
    -------
    Ascent
        Model at the end.
    """
    active = start.copy()
    alpha = alpha.copy()
    posterior, value = _laplace_of(problem, active, alpha, mean)
    peak = value
    permitted = first
    entries = np.zeros(problem.rows.shape[0], np.int64)
    converged = False
    iteration = 0
    while iteration < max_iter:
        iteration += 1
        open_to = permitted & (entries < _ENTRIES)
        entering, gain, s, q = candidates(problem, open_to, active, posterior, tolerance)
        permitted = problem.allowed
        growing = gain > tolerance
        if growing:
            entries[entering] += 1
            grown = np.append(active, entering)
            more = np.append(alpha, 1 / best_variance(s, q, problem.rate))
            trial, reached = _laplace_of(problem, grown, more, np.append(posterior.mean, 0.0))
            # The gain held for a quadratic likelihood only: the function does not come back.
            if reached < peak - _DROP:
                entries[entering] = _ENTRIES
                continue
            active = grown
            alpha = more
            posterior = trial
            value = reached
        change = 0.0
        before = value
        for _ in range(_HOLD if growing else _SETTLE):
            peak = max(peak, value)
            goal = alpha.copy()
            mean = posterior.mean.copy()
            change = _sweep(goal, mean, posterior.covariance.copy(), problem.rate)
            active, alpha, posterior, value, moved = _step(
                problem, active, alpha, goal, mean, peak - _DROP
            )
            if not moved:
                change = 0.0
            if change < tolerance:
                break
        # Where two functions are almost alike their precisions creep along a ridge without end and
        # without gain.
        flat = abs(value - before) < 1e-2 * tolerance
        if not growing and (change < tolerance or flat) and posterior.converged and iteration > 1:
            converged = True
            break
    return Ascent(
        active,
        alpha,
        posterior.mean,
        posterior.covariance,
        posterior.evidence,
        iteration,
        converged,
    )


@njit(cache=True)
def climb(problem: Problem, max_iter: int) -> Any:
    """Take the single best action at a time, removals first (Tipping & Faul 2003, Sec. 4).

    It begins with the function whose sums over the examples of either label differ most, relative
    to its norm. It is slower than :func:`ascend` and takes other steps, so that it ends in other
    maxima.

    Parameters
    ----------
    problem : Problem
        Examples, basis functions and prior.
    max_iter : int
        Most actions.

    Returns
    -------
    active : (k,) ndarray of int
        Functions of the model.
    alpha, mean : (k,) ndarray
        Its precisions and weights.
    """
    rows = problem.rows
    target = problem.target
    rate = problem.rate
    slant = rows @ (target - 0.5)
    for i in range(slant.size):
        slant[i] = (
            abs(slant[i]) / np.sqrt((rows[i] * rows[i]).sum() + _TINY)
            if problem.allowed[i]
            else -1.0
        )
    first = int(slant.argmax())
    row = rows[first]
    # Least squares for log odds of a probability of 0.95 for the own label (Tipping's initial
    # weight).
    weight = (row * np.copysign(_LOGIT, target - 0.5)).sum() / ((row * row).sum() + _TINY)
    active = np.full(1, first)
    alpha = np.full(1, 1 / max(weight * weight, 1e-6))
    mean = np.full(1, weight)
    for _ in range(max_iter):
        posterior, _ = _laplace_of(problem, active, alpha, mean)
        mean = posterior.mean
        covariance = posterior.covariance
        variance_j = np.diag(covariance)
        s = 1 / variance_j - alpha
        q = mean / variance_j
        # The best action on an active function: to leave, or to change its precision.
        best = -1
        most = 0.0
        leave = False
        goal = 0.0
        for j in range(active.size):
            ratio = s[j] / alpha[j]
            current = 0.5 * (q[j] * q[j] / (s[j] + alpha[j]) - np.log1p(ratio))
            variance = (
                best_variance(s[j], q[j], rate)
                if s[j] > _TINY and q[j] * q[j] > s[j] + rate
                else 0.0
            )
            if variance <= 0:
                rise = -current
                if active.size > 1 and (not leave or rise > most):
                    best = j
                    most = rise
                    leave = True
            elif not leave:
                u = 1 + s[j] * variance
                rise = 0.5 * (q[j] * q[j] * variance / u - np.log(u)) - current
                rise -= 0.5 * rate * (variance - 1 / alpha[j])
                if rise > most and abs(np.log(variance * alpha[j])) > _STILL:
                    best = j
                    most = rise
                    goal = 1 / variance
        if leave:
            remains = np.arange(active.size) != best
            active = active[remains]
            alpha = alpha[remains]
            mean = mean[remains]
            continue
        entering, _, s_new, q_new = candidates(problem, problem.allowed, active, posterior, most)
        if entering >= 0:
            active = np.append(active, entering)
            alpha = np.append(alpha, 1 / best_variance(s_new, q_new, rate))
            mean = np.append(mean, 0.0)
        elif best >= 0:
            alpha[best] = goal
        else:
            break
    return active, alpha, mean


def penalised(fit: Ascent, rate: float) -> float:
    """Return the log evidence with the log prior of the variances, up to a constant."""
    return fit.evidence - 0.5 * rate * (1 / fit.alpha).sum()
