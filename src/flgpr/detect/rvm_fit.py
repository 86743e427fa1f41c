"""Fit of sparse Bayesian logistic models: which kernels on training examples remain, and how."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from sklearn.metrics.pairwise import pairwise_kernels

from flgpr.jit.threads import blas_on_one_thread
from flgpr.kernels import relevance
from flgpr.kernels.laplacian_mode import laplacian_mode
from flgpr.types import ArrayLike, BoolArray, FloatArray, IntArray, floats

Kernel = str | Callable[[FloatArray, FloatArray], Any]
KERNELS = ("rbf", "laplacian", "poly", "linear", "sigmoid", "precomputed")
_PARAMETERS = {
    "rbf": ("gamma",),
    "laplacian": ("gamma",),
    "poly": ("gamma", "degree", "coef0"),
    "linear": (),
    "sigmoid": ("gamma", "coef0"),
}
Algorithm = Literal["fast", "ard"]
ALGORITHMS = ("fast", "ard")
PRUNE = 1e9
"""Precision at which a weight counts as zero ("ard")."""
RISE = 1e-3
"""Smallest rise of the log evidence that makes an exchange."""
LATE = 5
"""Most functions that enter after the ascents."""
SETTLED = 1e-3
"""Change of log α at which "ard" hands over to the fast ascent."""


@dataclass(frozen=True)
class SparseFit:
    """A sparse Bayesian logistic model, in Laplace's approximation."""

    active: IntArray  #: columns of the design, rising
    alpha: FloatArray  #: precisions of the weights' priors
    mean: FloatArray  #: mode of the weights
    covariance: FloatArray  #: of the weights about their mode
    log_evidence: float  #: log p(t | alpha)
    n_iter: int  #: iterations of all starts together
    converged: bool  #: whether nothing was left to gain
    rate: float  #: of the Laplacian prior, 0 with ARD


def fit_sparse(
    design: ArrayLike,
    target: ArrayLike,
    *,
    offset: float = 0.0,
    algorithm: Algorithm = "fast",
    rate: float | Literal["auto"] = 0.0,
    n_starts: int = 5,
    start: SparseFit | None = None,
    tol: float = 1e-5,
    max_iter: int = 1000,
) -> SparseFit:
    """Fit p(t = 1) = σ(Σ w_i φ_i + offset) with w_i ~ N(0, 1/α_i) and α maximising the evidence.

    The evidence has many local maxima. The model may be empty: then nothing is to be gained over
    the offset alone.

    Parameters
    ----------
    design : (sample, basis) array_like
        Basis functions φ at the samples.
    target : (sample,) array_like
        Labels t, 0 or 1.
    offset : float
        Log odds where all weights are zero.
    algorithm : {"fast", "ard"}
        "fast" adds and removes basis functions one by one (Tipping & Faul 2003). "ard" begins with
        all basis functions and prunes (Tipping 2001, Sec. 2-3); as its steps grow ever smaller, the
        last digits of the precisions come from the fast ascent, no function entering.
    rate : float or "auto"
        Rate of the exponential prior exp(-rate/(2α)) on the variances, which makes the weights'
        priors Laplacian with scale 1/sqrt(rate). 0 is ARD; "auto" takes the rate that makes the
        variances of the ARD fit most likely.
    n_starts : int
        Number of starts of "fast": one by the best single action at a time, the others from
        different first functions; members of the best models are exchanged.
    start : SparseFit, optional
        Model to begin with, in place of all starts but the first.
    tol : float
        Largest gain of log evidence by a function's entering, and largest change of log α, that is
        left. The change does not count once 50 rounds of it gain less than a hundredth of ``tol``.
    max_iter : int
        Most iterations of a start.

    Returns
    -------
    SparseFit
        The model.
    """
    # Rows of basis functions, contiguous, because every sum over samples runs along them.
    rows = np.ascontiguousarray(floats(design).T)
    t = np.ascontiguousarray(target, dtype=np.float64)
    every = np.ones(len(rows), np.bool_)
    problem = relevance.Problem(rows, relevance.single(rows), t, offset, every, 0.0)

    def fit(rate: float, start: SparseFit | None) -> SparseFit:
        of_rate = problem._replace(rate=rate)
        if algorithm == "ard":
            return _prune(of_rate, tol, max_iter)
        return _ascend(of_rate, n_starts, start, tol, max_iter)

    # These matrices are small: threads that wait for one another cost more than they save.
    with blas_on_one_thread():
        if rate != "auto":
            return fit(rate, start)
        ard_fit = fit(0.0, start)
        if not len(ard_fit.alpha):
            return ard_fit
        likely_rate = 2 * len(ard_fit.alpha) / float((1 / ard_fit.alpha).sum())
        return fit(likely_rate, None if start is None else ard_fit)


def fit_laplacian_map(
    design: ArrayLike,
    target: ArrayLike,
    *,
    offset: float = 0.0,
    rate: float = 1.0,
    tol: float = 1e-5,
    max_iter: int = 1000,
) -> SparseFit:
    """Fit p(t = 1) = σ(Σ w_i φ_i + offset) at the mode of the weights under a Laplacian prior.

    The prior is p(w_i) = λ/2 · exp(-λ |w_i|). It lies on the weights themselves, and its mode has
    weights that are exactly zero: that is what keeps few. The posterior has one mode, wherever the
    search begins.

    Parameters
    ----------
    design : (sample, basis) array_like
        Basis functions φ at the samples.
    target : (sample,) array_like
        Labels t, 0 or 1.
    offset : float
        Log odds where all weights are zero.
    rate : float
        λ², as in :func:`fit_sparse`, whose exponential prior on the variances is this prior once
        the variances are integrated out.
    tol : float
        Largest error of a weight's condition, in units of λ.
    max_iter : int
        How often a weight may enter.

    Returns
    -------
    SparseFit
        The model, which may be empty. At the mode each weight that is not zero is also that of a
        normal prior with the precision λ/|w_i|; ``alpha``, ``covariance`` and ``log_evidence`` are
        of these precisions.
    """
    rows = np.ascontiguousarray(floats(design).T)
    t = np.ascontiguousarray(target, dtype=np.float64)
    scale = math.sqrt(rate)
    with blas_on_one_thread():
        mode = laplacian_mode(rows, t, offset, scale, tol, max_iter)
        active = np.flatnonzero(mode.weights)
        alpha = scale / np.abs(mode.weights[active])
        posterior = relevance.laplace(rows[active], t, offset, alpha, mode.weights[active])
    return SparseFit(
        active=active,
        alpha=alpha,
        mean=mode.weights[active],
        covariance=posterior.covariance,
        log_evidence=float(posterior.evidence),
        n_iter=int(mode.entries),
        converged=bool(mode.converged),
        rate=rate,
    )


def _ascend(
    problem: relevance.Problem, n_starts: int, start: SparseFit | None, tol: float, max_iter: int
) -> SparseFit:
    """Ascend the evidence from several starts and return the best model (Tipping & Faul 2003)."""
    every = problem.allowed

    def penalised(fit: relevance.Ascent) -> float:
        return float(relevance.penalised(fit, problem.rate))

    # The best single action at a time, and then all precisions together.
    climbed = relevance.climb(problem, max_iter)
    fits = [relevance.ascend(problem, *climbed, every, tol, max_iter)]
    if start is not None:
        fits.append(
            relevance.ascend(problem, start.active, start.alpha, start.mean, every, tol, max_iter)
        )
    else:
        empty = (np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
        for first in _first_functions(len(every), n_starts - 1):
            fits.append(relevance.ascend(problem, *empty, first, tol, max_iter))
    iterations = sum(fit.iterations for fit in fits)
    fits.sort(key=lambda fit: -penalised(fit))
    # Starts often end in the same model: it is improved once only.
    models = {tuple(np.sort(fit.active)): fit for fit in reversed(fits)}
    different = list(models.values())[::-1][: max(1, n_starts // 3)]
    improved = []
    for fit in different:
        improved.append(_exchange(problem, fit, tol, max_iter))
        iterations += improved[-1].iterations - fit.iterations
    best = _complete(problem, max(improved, key=penalised), tol, max_iter)
    return _sorted(best, iterations, problem.rate)


def _exchange(
    problem: relevance.Problem, fit: relevance.Ascent, tol: float, max_iter: int
) -> relevance.Ascent:
    """Leave a local maximum by an exchange of basis functions.

    One after another is removed, and the ascent begins anew with another one entering first.
    """
    rate = problem.rate
    tried = 0
    number = 0
    iterations = fit.iterations
    best = fit
    while tried < len(best.active):
        number %= len(best.active)
        remaining = np.arange(len(best.active)) != number
        first = problem.allowed.copy()
        first[best.active[number]] = False
        start = (best.active[remaining], best.alpha[remaining], best.mean[remaining])
        trial = relevance.ascend(problem, *start, first, tol, max_iter)
        iterations += trial.iterations
        rise = relevance.penalised(trial, rate) > relevance.penalised(best, rate) + RISE
        if trial.converged and rise:
            best = trial
            tried = 0
        else:
            tried = tried + 1
            number = number + 1
    return best._replace(iterations=iterations)


def _complete(
    problem: relevance.Problem, fit: relevance.Ascent, tol: float, max_iter: int
) -> relevance.Ascent:
    """Add functions whose gain shows in double precision only: the ascent ranks them in single."""
    rate = problem.rate
    for _ in range(LATE):
        active = fit.active
        alpha = fit.alpha
        mean = fit.mean
        posterior = relevance.laplace(
            problem.rows[active], problem.target, problem.offset, alpha, mean
        )
        gain, s, q = relevance.entries(problem, active, posterior)
        new = int(gain.argmax())
        if gain[new] <= tol:
            break
        more = np.append(alpha, 1 / relevance.best_variance(s[new], q[new], rate))
        trial = relevance.ascend(
            problem,
            np.append(active, new),
            more,
            np.append(mean, 0.0),
            problem.allowed,
            tol,
            max_iter,
        )
        if relevance.penalised(trial, rate) <= relevance.penalised(fit, rate):
            break
        fit = trial
    return fit


def _first_functions(count: int, n_starts: int) -> list[BoolArray]:
    """Return which functions may enter first in every start.

    They are all, then every n-th from the last (the bias) back, from the one before it, and so on.
    """
    masks = [np.ones(count, np.bool_)] if n_starts else []
    for k in range(min(n_starts - 1, count)):
        mask = np.zeros(count, np.bool_)
        mask[count - 1 - k :: -(n_starts - 1)] = True
        masks.append(mask)
    return masks


def _prune(problem: relevance.Problem, tol: float, max_iter: int) -> SparseFit:
    """Prune from all functions on: α = γ/w² for all weights together (Tipping 2001, Eq. 16).

    With a rate of the Laplacian prior α is the root of w²α² - γα - rate.
    """
    rows, rate = problem.rows, problem.rate
    active = np.arange(len(rows))
    alpha = np.ones(len(rows))
    mean = np.zeros(len(rows))
    iteration = 0
    while iteration < max_iter:
        iteration += 1
        posterior = relevance.laplace(rows[active], problem.target, problem.offset, alpha, mean)
        mean = posterior.mean
        # γ = 1 - αΣ: how well the examples determine a weight, from 0 to 1.
        determined = np.maximum(1 - alpha * np.diag(posterior.covariance), 1e-12)
        power = np.maximum(mean**2, 1e-300)
        new = (determined + np.sqrt(determined**2 + 4 * power * rate)) / (2 * power)
        remains = new < PRUNE
        change = np.abs(np.log(new / alpha))[remains].max(initial=0.0)
        active = active[remains]
        alpha = new[remains]
        mean = mean[remains]
        if remains.all() and change < SETTLED:
            break
    none_enters = np.zeros(len(rows), np.bool_)
    fixed = problem._replace(allowed=none_enters)
    fit = relevance.ascend(fixed, active, alpha, mean, none_enters, tol, max_iter)
    return _sorted(fit, iteration + fit.iterations, rate)


def _sorted(fit: relevance.Ascent, iterations: int, rate: float) -> SparseFit:
    """Return a model with its functions in the order of the design."""
    order = np.argsort(fit.active)
    return SparseFit(
        active=fit.active[order],
        alpha=fit.alpha[order],
        mean=fit.mean[order],
        covariance=fit.covariance[np.ix_(order, order)],
        log_evidence=float(fit.evidence),
        n_iter=int(iterations),
        converged=bool(fit.converged),
        rate=float(rate),
    )


def resolve_gamma(gamma: float | str, X: FloatArray) -> float:
    """Return the width γ of a kernel.

    Parameters
    ----------
    gamma : float or {"scale", "auto"}
        A number, "scale" for 1 / (n_features · variance of X), or "auto" for 1 / n_features.
    X : (n_samples, n_features) ndarray
        Samples.

    Raises
    ------
    ValueError
        If it is none of these.
    """
    if gamma == "scale":
        variance = float(X.var())
        return 1 / (X.shape[1] * variance) if variance > 0 else 1.0
    if gamma == "auto":
        return 1 / X.shape[1]
    if isinstance(gamma, str) or not (np.isfinite(gamma) and gamma > 0):
        raise ValueError(f"gamma must be a positive number, 'scale' or 'auto', got {gamma!r}")
    return float(gamma)


def evaluate_kernel(
    kernel: Kernel, X: FloatArray, centres: FloatArray, gamma: float, degree: float, coef0: float
) -> FloatArray:
    """Evaluate a kernel, which need not be a Mercer kernel, nor symmetric.

    Parameters
    ----------
    kernel : str or callable
        A name in ``KERNELS``, a function of two arrays (n, feature) and (m, feature), or
        "precomputed", which takes the values as ``X``.
    X, centres : (n, feature), (m, feature) ndarray
        Samples and centres.
    gamma, degree, coef0 : float
        Parameters of :func:`sklearn.metrics.pairwise.pairwise_kernels`.

    Returns
    -------
    (n, m) ndarray
        Values.

    Raises
    ------
    ValueError
        If the kernel is unknown, or a function returns another shape.
    """
    if callable(kernel):
        values = floats(kernel(X, centres))
        if values.shape != (len(X), len(centres)):
            raise ValueError(
                f"kernel must return the shape {(len(X), len(centres))}, got {values.shape}"
            )
    elif kernel == "precomputed":
        values = X
    elif kernel in KERNELS:
        parameters = {"gamma": gamma, "degree": degree, "coef0": coef0}
        used = {name: parameters[name] for name in _PARAMETERS[kernel]}
        values = pairwise_kernels(X, centres, metric=kernel, **used)
    else:
        raise ValueError(
            f"kernel must be a function or one of {', '.join(KERNELS)}, got {kernel!r}"
        )
    if not np.isfinite(values).all():
        raise ValueError(
            f"kernel must have finite values, got {int((~np.isfinite(values)).sum())} that are not"
        )
    return floats(values)
