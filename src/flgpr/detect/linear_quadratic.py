"""The linear-quadratic form that every detector of Cosgrove et al. 2004 is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.kernels.correlate import correlate_bank


@dataclass(frozen=True)
class LinearQuadraticForm:
    """``T(x) = Σ_j s_j |u_j^H x - o_j|² + 2 Re(b^H x) + k`` (Cosgrove et al. 2004, Eq. 4 and 12)."""

    strength: NDArray[np.float64]  #: weights s_j, of either sign
    vectors: NDArray[Any]  #: (rank, n_features): u_j, one per row
    linear: NDArray[Any]  #: b
    offset: NDArray[Any]  #: o_j
    constant: float = 0.0  #: k

    @property
    def rank(self) -> int:
        """Number of projections."""
        return self.strength.size

    def __call__(self, X: ArrayLike) -> NDArray[np.float64]:
        """Evaluate the form on samples (n_samples, n_features); returns (n_samples,)."""
        samples = np.asarray(X)
        projection = samples @ self.vectors.conj().T - self.offset
        value = np.abs(projection) ** 2 @ self.strength + 2 * (samples @ self.linear.conj()).real + self.constant
        return np.asarray(value, dtype=np.float64)

    def after(self, mean: NDArray[Any], matrix: NDArray[Any]) -> LinearQuadraticForm:
        """Give the form of raw samples y whose value is that of this one at ``x = matrix (y - mean)``."""
        vectors, linear = self.vectors @ matrix.conj(), matrix.conj().T @ self.linear
        offset = self.offset + vectors.conj() @ mean
        constant = self.constant - 2 * float((linear.conj() @ mean).real)
        return LinearQuadraticForm(self.strength, vectors, linear, offset, constant)

    def likelihood(self, image: NDArray[Any], shape: tuple[int, int]) -> NDArray[np.float32]:
        """Evaluate the form on the chip around every pixel of an image (channel, y, x), as float32 (y, x).

        The chip of pixel i reaches from ``i - n//2`` on over n pixels, down-track and cross-track; its samples are
        stacked channel by channel, row by row. NaN where the chip leaves the image or touches a pixel that is not
        finite.
        """
        channels, (v, u) = image.shape[0], shape
        if channels * v * u != self.linear.size:
            raise ValueError(
                f"image and chip must make {self.linear.size} features, got {channels} channels of {v} x {u} pixels"
            )
        value = np.full(image.shape[1:], np.nan, dtype=np.float32)
        if image.shape[1] < v or image.shape[2] < u:
            return value
        kind = np.complex64 if np.iscomplexobj(image) or np.iscomplexobj(self.linear) else np.float32
        # The total is finite only if all pixels are, which spares the common case a mask.
        broken = None if np.isfinite(image.sum()) else ~np.isfinite(image).all(axis=0)
        clean = image if broken is None else np.where(broken, 0, image)
        inner = self._correlate(np.asarray(clean, dtype=kind), shape)
        value[v // 2 : v // 2 + inner.shape[0], u // 2 : u // 2 + inner.shape[1]] = inner
        return value if broken is None else np.where(_touched(broken, shape), np.nan, value)

    def _correlate(self, image: NDArray[Any], shape: tuple[int, int]) -> NDArray[np.float32]:
        scaled = self.vectors * np.sqrt(np.abs(self.strength))[:, None]
        bank = np.concatenate([scaled, self.linear[None]]).reshape(-1, image.shape[0], *shape)
        answer = correlate_bank(image, bank.astype(np.complex64))
        shift = (self.offset * np.sqrt(np.abs(self.strength))).astype(np.complex64)
        value = np.float32(2) * answer[-1].real + np.float32(self.constant)
        for j in range(self.rank):
            part = answer[j] - shift[j] if shift[j] else answer[j]
            value += np.float32(np.sign(self.strength[j])) * (part.real**2 + part.imag**2)
        return np.asarray(value)


def as_moments(mean: ArrayLike, covariance: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    """Take a mean μ (n,) and a covariance C (n, n); others are a ValueError."""
    mu, C = np.asarray(mean), np.asarray(covariance)
    if mu.ndim != 1 or C.shape != (mu.size, mu.size):
        raise ValueError(
            f"mean and covariance must have the shapes (n,) and (n, n), got {np.shape(mu)} and {np.shape(C)}"
        )
    return mu, C


def hermitian_form(
    A: NDArray[Any], b: NDArray[Any], rank: int | None = None, by_magnitude: bool = False
) -> LinearQuadraticForm:
    """Write ``x^H A x + 2 Re(b^H x)`` through eigenvectors (Cosgrove et al. 2004, Eq. 9-12).

    The ``rank`` largest are kept, in magnitude if asked; None keeps all.
    """
    values, vectors = np.linalg.eigh(A)
    order = np.argsort(-np.abs(values) if by_magnitude else -values, kind="stable")[:rank]
    return LinearQuadraticForm(values[order], vectors[:, order].T.copy(), b, np.zeros(order.size))


def _touched(broken: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels whose chip holds a broken pixel, by a summed-area table."""
    (v, u), (rows, columns) = shape, broken.shape
    table = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    table[1:, 1:] = broken.cumsum(0).cumsum(1)
    count = table[v:, u:] - table[:-v, u:] - table[v:, :-u] + table[:-v, :-u]
    touched = np.zeros(broken.shape, dtype=bool)
    touched[v // 2 : v // 2 + count.shape[0], u // 2 : u // 2 + count.shape[1]] = count > 0
    return touched
