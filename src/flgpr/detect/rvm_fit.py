"""Fitting sparse Bayesian logistic models: which kernels on training examples stay, and with what weights."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.metrics.pairwise import pairwise_kernels

from flgpr.kernels import relevance
from flgpr.kernels.laplacian_mode import laplacian_mode
from flgpr.kernels.threads import blas_on_one_thread

FloatArray = NDArray[np.float64]
Kernel = str | Callable[[FloatArray, FloatArray], Any]
KERNELS = ("rbf", "laplacian", "poly", "linear", "sigmoid", "precomputed")
_PARAMETERS = {
    "rbf": ("gamma",), "laplacian": ("gamma",), "poly": ("gamma", "degree", "coef0"), "linear": (),
    "sigmoid": ("gamma", "coef0"),
}  # fmt: skip
Algorithm = Literal["fast", "ard"]
ALGORITHMS = ("fast", "ard")
PRUNE = 1e9
"""Precision at which a weight counts as zero ("ard")."""
RISE = 1e-3
"""Smallest rise of the log evidence that makes an exchange."""
LATE = 5
"""Most functions that enter after the ascents."""
NEAR = 1e-3
"""Change of log α at which "ard" has done its part."""


@dataclass(frozen=True)
class SparseFit:
    """A sparse Bayesian logistic model of ``active`` columns of the design, rising.

    ``alpha`` are the precisions of the weights' priors, ``mean`` their mode and ``covariance`` that about it (Laplace's
    approximation, as of ``log_evidence``, log p(t | alpha)). ``n_iter`` counts the iterations of all starts together;
    ``converged`` tells that nothing was left to gain; ``rate`` is that of the Laplacian prior, 0 with ARD.
    """

    active: NDArray[np.int64]
    alpha: FloatArray
    mean: FloatArray
    covariance: FloatArray
    log_evidence: float
    n_iter: int
    converged: bool
    rate: float


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

    ``design`` is (sample, basis), ``target`` 0 or 1. "fast" adds and removes basis functions one by
    one (Tipping & Faul 2003). The evidence has many local maxima, so it starts ``n_starts`` times,
    once by the best single action at a time and else from different first functions, and exchanges
    members of the best models; a ``start`` takes the place of all but the first. "ard" begins with
    all basis functions and prunes (Tipping 2001, Sec. 2-3); as its steps grow ever smaller, the
    last digits of the precisions come from the fast ascent, no function entering.

    ``rate`` is that of the exponential prior exp(-rate/(2α)) on the variances, which makes the weights' priors
    Laplacian with scale 1/sqrt(rate); 0 is ARD, and "auto" takes the rate that makes the variances of the ARD fit most
    likely. ``tol`` is the largest gain of log evidence by a function's entering, and the largest change of log α, that
    is left; the change does not count once 50 rounds of it gain less than a hundredth of ``tol``. The model may be
    empty: then nothing is to be gained over the offset alone.
    """
    # Rows of basis functions, contiguous, because every sum over samples runs along them.
    rows = np.ascontiguousarray(np.asarray(design, dtype=np.float64).T)
    t = np.ascontiguousarray(target, dtype=np.float64)
    if rate == "auto":
        plain = fit_sparse(design, t, offset=offset, algorithm=algorithm, n_starts=n_starts, start=start, tol=tol,
                           max_iter=max_iter)  # fmt: skip
        if not len(plain.alpha):
            return plain
        rate = 2 * len(plain.alpha) / float((1 / plain.alpha).sum())
        start = None if start is None else plain
    # These matrices are small: threads that wait for one another cost more than they bring.
    with blas_on_one_thread():
        if algorithm == "ard":
            return _prune(rows, t, offset, rate, tol, max_iter)
        return _ascend(rows, t, offset, rate, n_starts, start, tol, max_iter)


def fit_laplacian_map(
    design: ArrayLike,
    target: ArrayLike,
    *,
    offset: float = 0.0,
    rate: float = 1.0,
    tol: float = 1e-5,
    max_iter: int = 1000,
) -> SparseFit:
    """Fit p(t = 1) = σ(Σ w_i φ_i + offset) at the mode of the weights under p(w_i) = λ/2 · exp(-λ |w_i|).

    The prior lies on the weights themselves, and its mode has weights that are exactly zero: that
    is what keeps few. The posterior has one mode, wherever the search begins. ``rate`` is λ², as in
    :func:`fit_sparse`, whose exponential prior on the variances is this prior once the variances
    are integrated out.

    At the mode each weight that is not zero is also that of a normal prior with the precision λ/|w_i|; ``alpha``,
    ``covariance`` and ``log_evidence`` are of these precisions. ``design`` is (sample, basis), ``target`` 0 or 1.
    ``tol`` is the largest miss of a weight's condition in units of λ, ``max_iter`` how often a weight may enter. The
    model may be empty.
    """
    rows = np.ascontiguousarray(np.asarray(design, dtype=np.float64).T)
    t = np.ascontiguousarray(target, dtype=np.float64)
    scale = math.sqrt(rate)
    with blas_on_one_thread():
        mode = laplacian_mode(rows, t, offset, scale, tol, max_iter)
        active = np.flatnonzero(mode.weights)
        alpha = scale / np.abs(mode.weights[active])
        posterior = relevance.laplace(rows[active], t, offset, alpha, mode.weights[active])
    return SparseFit(
        active, alpha, mode.weights[active], posterior.covariance,
        float(posterior.evidence), int(mode.entries), bool(mode.converged), rate,
    )  # fmt: skip


def _ascend(
    rows: FloatArray, t: FloatArray, offset: float, rate: float, n_starts: int, start: SparseFit | None, tol: float,
    max_iter: int,
) -> SparseFit:  # fmt: skip
    every = np.ones(len(rows), np.bool_)
    fixed = (rows, relevance.single(rows), t, offset, every, rate)
    fits = [relevance.ascend(*fixed, *relevance.climb(*fixed, max_iter), every, tol, max_iter)]
    if start is not None:
        fits.append(
            relevance.ascend(*fixed, start.active, start.alpha, start.mean, every, tol, max_iter)
        )
    else:
        empty = (np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
        fits += [
            relevance.ascend(*fixed, *empty, first, tol, max_iter)
            for first in _first(len(rows), n_starts - 1)
        ]
    iterations = sum(fit.iterations for fit in fits)
    fits.sort(key=lambda fit: -relevance.penalised(fit, rate))
    # Starts often end in the same model; to improve it twice would be in vain.
    models = {tuple(np.sort(fit.active)): fit for fit in reversed(fits)}
    different = list(models.values())[::-1][: max(1, n_starts // 3)]
    improved = [_exchange(fixed, fit, tol, max_iter) for fit in different]
    iterations += sum(
        new.iterations - old.iterations for new, old in zip(improved, different, strict=True)
    )
    best = _complete(
        fixed, max(improved, key=lambda fit: relevance.penalised(fit, rate)), tol, max_iter
    )
    return _sorted(best, iterations, rate)


def _exchange(
    fixed: tuple[Any, ...], fit: relevance.Ascent, tol: float, max_iter: int
) -> relevance.Ascent:
    """Leave a local maximum: take out one basis function after another and ascend anew, another one entering first."""
    *_, allowed, rate = fixed
    tried = 0
    place = 0
    iterations = fit.iterations
    best = fit
    while tried < len(best.active):
        place %= len(best.active)
        kept = np.arange(len(best.active)) != place
        first = allowed.copy()
        first[best.active[place]] = False
        start = (best.active[kept], best.alpha[kept], best.mean[kept])
        trial = relevance.ascend(*fixed, *start, first, tol, max_iter)
        iterations += trial.iterations
        if (
            trial.converged
            and relevance.penalised(trial, rate) > relevance.penalised(best, rate) + RISE
        ):
            best = trial
            tried = 0
        else:
            tried = tried + 1
            place = place + 1
    return best._replace(iterations=iterations)


def _complete(
    fixed: tuple[Any, ...], fit: relevance.Ascent, tol: float, max_iter: int
) -> relevance.Ascent:
    """Let in what gains by double precision and was not seen in single precision, which ranks the functions."""
    rows, _, t, offset, every, rate = fixed
    for _ in range(LATE):
        active = fit.active
        alpha = fit.alpha
        mean = fit.mean
        posterior = relevance.laplace(rows[active], t, offset, alpha, mean)
        gain, s, q = relevance.entries(rows, every, active, posterior, rate)
        new = int(gain.argmax())
        if gain[new] <= tol:
            break
        more = np.append(alpha, 1 / relevance.best_variance(s[new], q[new], rate))
        trial = relevance.ascend(
            *fixed, np.append(active, new), more, np.append(mean, 0.0), every, tol, max_iter
        )
        if relevance.penalised(trial, rate) <= relevance.penalised(fit, rate):
            break
        fit = trial
    return fit


def _first(count: int, n_starts: int) -> list[NDArray[np.bool_]]:
    """Which functions may enter first: all, then every n-th from the last (the bias) back, from the one before, ..."""
    masks = [np.ones(count, np.bool_)] if n_starts else []
    for k in range(min(n_starts - 1, count)):
        mask = np.zeros(count, np.bool_)
        mask[count - 1 - k :: -(n_starts - 1)] = True
        masks.append(mask)
    return masks


def _prune(
    rows: FloatArray, t: FloatArray, offset: float, rate: float, tol: float, max_iter: int
) -> SparseFit:
    """Tipping 2001, Eq. 16: α = γ/w² for all weights together; with a rate the root of w²α² - γα - rate."""
    active = np.arange(len(rows))
    alpha = np.ones(len(rows))
    mean = np.zeros(len(rows))
    iteration = 0
    while iteration < max_iter:
        iteration += 1
        posterior = relevance.laplace(rows[active], t, offset, alpha, mean)
        mean = posterior.mean
        determined = np.maximum(1 - alpha * np.diag(posterior.covariance), 1e-12)
        power = np.maximum(mean**2, 1e-300)
        new = (determined + np.sqrt(determined**2 + 4 * power * rate)) / (2 * power)
        kept = new < PRUNE
        change = np.abs(np.log(new / alpha))[kept].max(initial=0.0)
        active = active[kept]
        alpha = new[kept]
        mean = mean[kept]
        if kept.all() and change < NEAR:
            break
    closed = np.zeros(len(rows), np.bool_)
    fit = relevance.ascend(
        rows, relevance.single(rows), t, offset, closed, rate, active, alpha, mean, closed, tol, max_iter
    )  # fmt: skip
    return _sorted(fit, iteration + fit.iterations, rate)


def _sorted(fit: relevance.Ascent, iterations: int, rate: float) -> SparseFit:
    order = np.argsort(fit.active)
    return SparseFit(
        fit.active[order], fit.alpha[order], fit.mean[order], fit.covariance[np.ix_(order, order)],
        float(fit.evidence), int(iterations), bool(fit.converged), float(rate),
    )  # fmt: skip


def resolve_gamma(gamma: float | str, X: FloatArray) -> float:
    """Width of a kernel: a number, "scale", 1 / (n_features · variance of X), or "auto", 1 / n_features."""
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
    """Evaluate K(x, centre) as (n, m); the kernel need not be a Mercer kernel, nor symmetric.

    It is a name in ``KERNELS`` with the parameters of :func:`sklearn.metrics.pairwise.pairwise_kernels`, or a function
    of two arrays (n, feature), (m, feature). "precomputed" takes the values as ``X``.
    """
    if callable(kernel):
        values = np.asarray(kernel(X, centres), dtype=np.float64)
        if values.shape != (len(X), len(centres)):
            raise ValueError(
                f"kernel must return the shape {(len(X), len(centres))}, got {values.shape}"
            )
    elif kernel == "precomputed":
        values = X
    elif kernel in KERNELS:
        given = {"gamma": gamma, "degree": degree, "coef0": coef0}
        values = pairwise_kernels(
            X, centres, metric=kernel, **{name: given[name] for name in _PARAMETERS[kernel]}
        )
    else:
        raise ValueError(
            f"kernel must be a function or one of {', '.join(KERNELS)}, got {kernel!r}"
        )
    if not np.isfinite(values).all():
        raise ValueError(
            f"kernel must have finite values, got {int((~np.isfinite(values)).sum())} that are not"
        )
    return np.asarray(values, dtype=np.float64)
