"""Eigenvalues and eigenvectors of many 3 x 3 Hermitian matrices, by cyclic Jacobi rotations.

Jacobi leaves a diagonal matrix as it is, so that equal eigenvalues keep the axes as their
eigenvectors, and finds small eigenvectors' components to full relative accuracy; both matter to
polarimetry.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.jit.threads import shared

_SWEEPS = 12  # six reach machine precision; quadratic convergence


@njit(cache=True)
def _rotate(a: Any, v: Any, p: int, q: int) -> None:
    """Make ``a[p, q]`` zero by a unitary rotation and multiply ``v`` by it, both in place.

    With φ the phase of a_pq, τ = (a_qq - a_pp)/(2|a_pq|), and t the root of smaller magnitude of
    t² + 2τt - 1 = 0, the rotation has the cosine c = 1/√(1 + t²) and the sine s = tc (Golub & Van
    Loan 2013, Sec. 8.5, there for real matrices).
    """
    size = abs(a[p, q])
    if size == 0.0:
        return
    phase = a[p, q] / size
    tau = (a[q, q].real - a[p, p].real) / (2 * size)
    t = 1.0 / (abs(tau) + np.sqrt(1 + tau * tau))
    if tau < 0:
        t = -t
    c = 1.0 / np.sqrt(1 + t * t)
    s = t * c
    # Columns p and q of both matrices, and then rows p and q of the one that becomes diagonal.
    for k in range(3):
        x, y = a[k, p], a[k, q]
        a[k, p] = c * x - s * np.conj(phase) * y
        a[k, q] = s * phase * x + c * y
        x, y = v[k, p], v[k, q]
        v[k, p] = c * x - s * np.conj(phase) * y
        v[k, q] = s * phase * x + c * y
    for k in range(3):
        x, y = a[p, k], a[q, k]
        a[p, k] = c * x - s * phase * y
        a[q, k] = s * np.conj(phase) * x + c * y
    # Zero by construction; rounding leaves a little.
    a[p, q] = 0.0
    a[q, p] = 0.0


@njit(cache=True)
def _solve(a: Any, v: Any) -> None:
    """Make a matrix ``a`` diagonal by cyclic rotations and multiply ``v`` by them, in place."""
    for _ in range(_SWEEPS):
        off = abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2])
        scale = abs(a[0, 0].real) + abs(a[1, 1].real) + abs(a[2, 2].real)
        if off <= 1e-17 * scale:
            break
        _rotate(a, v, 0, 1)
        _rotate(a, v, 0, 2)
        _rotate(a, v, 1, 2)


@shared(cache=True)
def eigen_3x3(matrices, values, vectors, begin, end):  # type: ignore[no-untyped-def]
    """Decompose Hermitian matrices; eigenvalues come in no order.

    Parameters
    ----------
    matrices : (n, 3, 3) ndarray of complex128
        Hermitian matrices; they stay as they are.
    values : (n, 3) ndarray
        Eigenvalues, filled.
    vectors : (n, 3, 3) ndarray of complex128
        Eigenvectors of length one, filled; column i belongs to eigenvalue i.
    begin, end : int
        Matrices of this call.
    """
    for n in range(begin, end):
        a = matrices[n].copy()
        v = np.zeros((3, 3), np.complex128)
        for i in range(3):
            v[i, i] = 1.0
        _solve(a, v)
        for i in range(3):
            values[n, i] = a[i, i].real
            for k in range(3):
                vectors[n, k, i] = v[k, i]
