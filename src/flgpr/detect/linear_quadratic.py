"""The linear-quadratic form that every detector of Cosgrove et al. 2004 is, on samples and on chips of images."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import validate_data

from flgpr.kernels.correlate import correlate_bank


def check_samples(estimator: BaseEstimator, X: Any, reset: bool) -> NDArray[Any]:
    """Check samples that may be complex, and give them in double precision; a fit resets ``n_features_in_``."""
    if not np.iscomplexobj(np.asarray(X)):
        return np.asarray(validate_data(estimator, X, reset=reset, dtype=np.float64))
    values = np.asarray(X, dtype=np.complex128)
    real = validate_data(estimator, values.real, reset=reset, dtype=np.float64)
    imaginary = validate_data(estimator, values.imag, reset=False, dtype=np.float64)
    return np.asarray(real + 1j * imaginary)


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
        value = (
            np.abs(projection) ** 2 @ self.strength
            + 2 * (samples @ self.linear.conj()).real
            + self.constant
        )
        return np.asarray(value, dtype=np.float64)

    def after(self, mean: NDArray[Any], matrix: NDArray[Any]) -> LinearQuadraticForm:
        """Give the form of raw samples y whose value is that of this one at ``x = matrix (y - mean)``."""
        vectors = self.vectors @ matrix.conj()
        linear = matrix.conj().T @ self.linear
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
        kind = (
            np.complex64 if np.iscomplexobj(image) or np.iscomplexobj(self.linear) else np.float32
        )
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
    mu = np.asarray(mean)
    C = np.asarray(covariance)
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


@dataclass(frozen=True)
class ChipDetector:
    """Linear-quadratic forms on raw image chips, whitening included; the score is the largest of their values."""

    forms: tuple[LinearQuadraticForm, ...]
    channels: tuple[
        str, ...
    ]  #: names of the image channels in the order of the features, such as ("HH", "VV")
    shape: tuple[
        int, int
    ]  #: pixels of a chip down-track and cross-track; (28, 1) is the paper's range cut
    spacing: tuple[float, float]  #: pixel spacing down-track and cross-track, m
    notes: dict[str, Any] = field(default_factory=dict)  #: how it was trained

    def __post_init__(self) -> None:
        if not self.forms:
            raise ValueError("forms must hold at least one form, got none")
        features = len(self.channels) * self.shape[0] * self.shape[1]
        if any(form.linear.size != features for form in self.forms):
            sizes = [form.linear.size for form in self.forms]
            raise ValueError(
                f"forms must have {features} features for these channels and chips, got {sizes}"
            )
        if not all(step > 0 for step in self.spacing):
            raise ValueError(f"spacing must be positive, got {self.spacing}")

    def likelihood(
        self,
        image: NDArray[Any],
        channels: tuple[str, ...] | None = None,
        spacing: tuple[float, float] | None = None,
    ) -> NDArray[np.float32]:
        """Score the chip around every pixel of an image (channel, y, x) (Cosgrove et al. 2004, Sec. IV-B).

        The image's channels and pixel spacing (down-track and cross-track, m) are compared with the detector's when
        given; others are a ValueError. A chip one pixel wide fits any cross-track spacing. Scores (y, x) are NaN where
        the chip leaves the image or touches a pixel that is not finite.
        """
        if channels is not None and tuple(channels) != self.channels:
            raise ValueError(f"channels must be {self.channels}, got {tuple(channels)}")
        axes = [axis for axis in (0, 1) if self.shape[axis] > 1]
        if spacing is not None and not all(
            np.isclose(spacing[k], self.spacing[k], rtol=1e-3) for k in axes
        ):
            raise ValueError(f"spacing must be {self.spacing} m, got {spacing}")
        maps = [form.likelihood(image, self.shape) for form in self.forms]
        return maps[0] if len(maps) == 1 else np.asarray(np.max(maps, axis=0))
