"""The linear-quadratic form of every detector of Cosgrove et al. 2004, on samples and on images."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from flgpr.kernels.correlate import chip_sums, correlate_bank
from flgpr.kernels.moments import check_samples
from flgpr.types import AnyArray, ArrayLike, BoolArray, Entries, Float32Array, FloatArray, floats


@dataclass(frozen=True)
class LinearQuadraticForm:
    """Evaluate ``T(x) = Σ_j s_j |u_j^H x - o_j|² + 2 Re(b^H x) + k``.

    These are Eq. 4 and 12 of Cosgrove et al. 2004. Unlike there, each projection has an offset, so
    that the mean of a whitening needs no pass over the samples (:meth:`after`).
    """

    strength: FloatArray  #: weights s_j, of either sign
    vectors: AnyArray  #: (rank, n_features): u_j, one per row
    linear: AnyArray  #: b
    offset: AnyArray  #: o_j
    constant: float = 0.0  #: k

    @property
    def rank(self) -> int:
        """Number of projections."""
        return self.strength.size

    def __call__(self, X: ArrayLike) -> FloatArray:
        """Return the values (n_samples,) of the form on samples (n_samples, n_features)."""
        samples = np.asarray(X)
        projection = samples @ self.vectors.conj().T - self.offset
        quadratic = np.abs(projection) ** 2 @ self.strength
        linear = 2 * (samples @ self.linear.conj()).real
        return floats(quadratic + linear + self.constant)

    def after(self, mean: AnyArray, matrix: AnyArray) -> LinearQuadraticForm:
        """Return the form of raw samples y that equals this one at ``x = matrix (y - mean)``.

        With W the matrix and μ the mean, ``u^H x = (W^H u)^H y - (W^H u)^H μ``, and likewise for b.

        Parameters
        ----------
        mean : (n_raw,) ndarray
            Mean μ of the samples.
        matrix : (n_features, n_raw) ndarray
            Whitening W.
        """
        vectors = self.vectors @ matrix.conj()
        linear = matrix.conj().T @ self.linear
        offset = self.offset + vectors.conj() @ mean
        constant = self.constant - 2 * float((linear.conj() @ mean).real)
        return LinearQuadraticForm(self.strength, vectors, linear, offset, constant)

    def likelihood(self, image: AnyArray, shape: tuple[int, int]) -> Float32Array:
        """Return the value of the form on the chip around every pixel of an image.

        The chip of pixel i reaches from ``i - n//2`` on over n pixels, down-track and cross-track;
        its samples are stacked channel by channel, row by row.

        Parameters
        ----------
        image : (channel, y, x) ndarray
            Image.
        shape : tuple of int
            Pixels of a chip down-track and cross-track.

        Returns
        -------
        (y, x) ndarray of float32
            Values, NaN where the chip leaves the image or holds a pixel that is not finite.

        Raises
        ------
        ValueError
            If image and chip do not make as many features as the form has.
        """
        channels = image.shape[0]
        v, u = shape
        if channels * v * u != self.linear.size:
            raise ValueError(
                f"image and chip must make {self.linear.size} features, "
                f"got {channels} channels of {v} x {u} pixels"
            )
        value = np.full(image.shape[1:], np.nan, dtype=np.float32)
        if image.shape[1] < v or image.shape[2] < u:
            return value
        is_complex = np.iscomplexobj(image) or np.iscomplexobj(self.linear)
        dtype = np.complex64 if is_complex else np.float32

        # The total is finite only if all pixels are: the common case needs no mask.
        broken = None if np.isfinite(image.sum()) else np.asarray(~np.isfinite(image).all(axis=0))
        finite = image if broken is None else np.where(broken, 0, image)
        inner = self._correlate(np.asarray(finite, dtype=dtype), shape)
        value[_around_middles(inner.shape, shape)] = inner
        if broken is None:
            return value
        return np.where(_chip_holds(broken, shape), np.nan, value)

    def _correlate(self, image: AnyArray, shape: tuple[int, int]) -> Float32Array:
        """Return the values of all chips inside an image, by correlation with the vectors."""
        # The roots of the strengths go into the vectors; their signs are left for the sum.
        root_strength = np.sqrt(np.abs(self.strength))
        scaled = self.vectors * root_strength[:, None]
        bank = np.concatenate([scaled, self.linear[None]]).reshape(-1, image.shape[0], *shape)
        answer = correlate_bank(image, bank.astype(np.complex64))
        shift = (self.offset * root_strength).astype(np.complex64)
        value = np.float32(2) * answer[-1].real + np.float32(self.constant)
        for j in range(self.rank):
            projection = answer[j] - shift[j] if shift[j] else answer[j]
            energy = projection.real**2 + projection.imag**2
            value += np.float32(np.sign(self.strength[j])) * energy
        return np.asarray(value)


def as_moments(mean: ArrayLike, covariance: ArrayLike) -> tuple[AnyArray, AnyArray]:
    """Return a mean μ (n,) and a covariance C (n, n) as arrays; other shapes are a ValueError."""
    mu = np.asarray(mean)
    C = np.asarray(covariance)
    if mu.ndim != 1 or C.shape != (mu.size, mu.size):
        raise ValueError(
            "mean and covariance must have the shapes (n,) and (n, n), "
            f"got {np.shape(mu)} and {np.shape(C)}"
        )
    return mu, C


def hermitian_form(
    A: AnyArray, b: AnyArray, rank: int | None = None, by_magnitude: bool = False
) -> LinearQuadraticForm:
    """Return ``x^H A x + 2 Re(b^H x)`` by eigenvectors of A (Cosgrove et al. 2004, Eq. 9-12).

    Parameters
    ----------
    A : (n, n) ndarray
        Hermitian matrix.
    b : (n,) ndarray
        Linear part.
    rank : int, optional
        Number of largest eigenvalues that are used; None uses all.
    by_magnitude : bool
        Whether eigenvalues are compared by magnitude.

    Returns
    -------
    LinearQuadraticForm
        The form.
    """
    values, vectors = np.linalg.eigh(A)
    size = np.abs(values) if by_magnitude else values
    order = np.argsort(-size, kind="stable")[:rank]
    chosen = vectors[:, order].T.copy()
    return LinearQuadraticForm(values[order], chosen, b, np.zeros(order.size))


def _around_middles(inner: tuple[int, ...], shape: tuple[int, int]) -> tuple[slice, slice]:
    """Return the pixels of an image that are the middles of its chips, ``inner`` in number."""
    v, u = shape
    return slice(v // 2, v // 2 + inner[0]), slice(u // 2, u // 2 + inner[1])


def _chip_holds(broken: BoolArray, shape: tuple[int, int]) -> BoolArray:
    """Mark the pixels whose chip holds a broken pixel."""
    count = chip_sums(broken, shape)
    holds = np.zeros(broken.shape, dtype=bool)
    holds[_around_middles(count.shape, shape)] = count > 0
    return holds


class QuadraticDetector(BaseEstimator):  # type: ignore[misc]
    """A detector whose score is the largest of its forms, ``forms_``."""

    forms_: tuple[LinearQuadraticForm, ...]

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Return the scores (n_samples,) of samples (n_samples, n_features), real or complex."""
        check_is_fitted(self)
        samples = check_samples(self, X, reset=False)
        return np.asarray(np.max([form(samples) for form in self.forms_], axis=0))


@dataclass(frozen=True)
class ChipDetector:
    """Score raw image chips by the largest of several forms, which include the whitening."""

    forms: tuple[LinearQuadraticForm, ...]
    #: names of the image channels in the order of the features, such as ("HH", "VV")
    channels: tuple[str, ...]
    #: pixels of a chip down-track and cross-track; (28, 1) is the paper's range cut
    shape: tuple[int, int]
    spacing: tuple[float, float]  #: pixel spacing down-track and cross-track, m
    notes: Entries = field(default_factory=dict)  #: how it was trained

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
        image: AnyArray,
        channels: tuple[str, ...] | None = None,
        spacing: tuple[float, float] | None = None,
    ) -> Float32Array:
        """Score the chip around every pixel of an image (Cosgrove et al. 2004, Sec. IV-B).

        Parameters
        ----------
        image : (channel, y, x) ndarray
            Image.
        channels : tuple of str, optional
            Its channels, to compare with the detector's.
        spacing : tuple of float, optional
            Its pixel spacing down-track and cross-track, m, to compare with the detector's. A chip
            one pixel wide fits any cross-track spacing.

        Returns
        -------
        (y, x) ndarray of float32
            Scores, NaN where the chip leaves the image or holds a pixel that is not finite.

        Raises
        ------
        ValueError
            If channels or spacing differ.
        """
        if channels is not None and tuple(channels) != self.channels:
            raise ValueError(f"channels must be {self.channels}, got {tuple(channels)}")
        if spacing is not None and not self._fits(spacing):
            raise ValueError(f"spacing must be {self.spacing} m, got {spacing}")
        maps = [form.likelihood(image, self.shape) for form in self.forms]
        if len(maps) == 1:
            return maps[0]
        return np.asarray(np.max(maps, axis=0))

    def _fits(self, spacing: tuple[float, float]) -> bool:
        """Compare a pixel spacing with the detector's along the axes with more than one pixel."""
        for axis in (0, 1):
            equal = np.isclose(spacing[axis], self.spacing[axis], rtol=1e-3)
            if self.shape[axis] > 1 and not equal:
                return False
        return True
