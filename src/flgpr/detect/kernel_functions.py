"""Kernels by name or function: basis functions centred on training examples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics.pairwise import pairwise_kernels

FloatArray = NDArray[np.float64]
Kernel = str | Callable[[FloatArray, FloatArray], Any]
KERNELS = ("rbf", "laplacian", "poly", "linear", "sigmoid", "precomputed")
_PARAMETERS = {
    "rbf": ("gamma",), "laplacian": ("gamma",), "poly": ("gamma", "degree", "coef0"), "linear": (),
    "sigmoid": ("gamma", "coef0"),
}  # fmt: skip


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
            raise ValueError(f"kernel must return the shape {(len(X), len(centres))}, got {values.shape}")
    elif kernel == "precomputed":
        values = X
    elif kernel in KERNELS:
        given = {"gamma": gamma, "degree": degree, "coef0": coef0}
        values = pairwise_kernels(X, centres, metric=kernel, **{name: given[name] for name in _PARAMETERS[kernel]})
    else:
        raise ValueError(f"kernel must be a function or one of {', '.join(KERNELS)}, got {kernel!r}")
    if not np.isfinite(values).all():
        raise ValueError(f"kernel must have finite values, got {int((~np.isfinite(values)).sum())} that are not")
    return np.asarray(values, dtype=np.float64)
