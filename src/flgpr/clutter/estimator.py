"""The background that a detection computes: all channels, in two passes, one scan in memory.

The equations are written in :mod:`flgpr.clutter.background`, which takes the same steps one by one;
:mod:`flgpr.kernels.background` has the loops over pixels.

There are two normalisations. Each polarization and sub-band has its *own* gain, self-signature and
background (Wang et al. 2007, Eq. 2-5), which serve magnitudes. The *shared* ones are common to the
polarizations of a sub-band, so that the ratios and phases between polarizations, which polarimetry
uses, survive.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from flgpr.kernels.background import (
    add_clipped,
    gain_and_limit,
    magnitude_over_background,
    mean_of_nodes,
    residual,
    root_mean_square,
    subtract_and_divide,
)
from flgpr.kernels.filters import median_stack
from flgpr.types import AnyArray, Arrays, ComplexArray, Float32Array, FloatArray, IntArray

SelfSignature = Literal["none", "mean", "median"]
MagnitudeArray = Float32Array
_LOWEST_SHARE = 0.75  # of the pixels, whose rms is r_k
_CLIP_DEVIATIONS = 5.0  # above the mean, at which Eq. 2 clips magnitudes


@dataclass(frozen=True)
class Background:
    """Self-signature and gain background of a run, which clean its scan images."""

    #: (polarization, subband, y, x): B1 in units of the channel's own gain
    signature: ComplexArray
    #: (polarization, subband, y, x): B2 in units of the channel's own gain
    gain: MagnitudeArray
    #: (polarization, subband, y, x): B1 in units of the gain shared by the polarizations
    shared_signature: ComplexArray
    #: (subband, y, x): B2 in units of the shared gain, the same for all polarizations
    shared_gain: MagnitudeArray

    def cropped(self, rows: int) -> Background:
        """Return the background of the nearest ``rows`` image rows."""
        return Background(
            np.ascontiguousarray(self.signature[..., :rows, :]),
            np.ascontiguousarray(self.gain[..., :rows, :]),
            np.ascontiguousarray(self.shared_signature[..., :rows, :]),
            np.ascontiguousarray(self.shared_gain[..., :rows, :]),
        )

    def magnitude(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> MagnitudeArray:
        """Clean an image by channel: m'', in units of the background (Wang et al. 2007, Eq. 5).

        Parameters
        ----------
        image : (polarization, subband, y, x) ndarray of complex
            Scan image; the background may reach farther than it.
        gain : (polarization, subband) ndarray
            Gain r_k of the scan.
        rows : int, optional
            Nearest rows to clean, by default all of the image's.

        Returns
        -------
        (polarization, subband, rows, x) ndarray of float32
            Cleaned magnitudes.
        """
        kernel = magnitude_over_background
        return clean(kernel, np.float32, image, gain, self.signature, self.gain, rows)

    def own_coherent(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> ComplexArray:
        """Clean an image by channel with its phase, as for the paper's polarimetric features.

        The modulus is :meth:`magnitude`, whose parameters it takes.
        """
        kernel = subtract_and_divide
        return clean(kernel, np.complex64, image, gain, self.signature, self.gain, rows)

    def coherent(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> ComplexArray:
        """Clean an image with what the polarizations of a sub-band share: ``(v/r̄ - B1)/B̄2``.

        The parameters are those of :meth:`magnitude`.
        """
        kernel, level = subtract_and_divide, self.shared_gain
        shared = np.broadcast_to(shared_gain(gain), gain.shape)
        return clean(kernel, np.complex64, image, shared, self.shared_signature, level, rows)


def shared_gain(gain: FloatArray) -> FloatArray:
    """Compute the gain r̄ common to the polarizations, the root mean square of theirs.

    Gains (..., polarization, subband) become (..., 1, subband).
    """
    return np.sqrt(np.mean(gain**2, axis=-2, keepdims=True))


class BackgroundEstimator:
    """Estimate a run's background in two passes over its images.

    Call :meth:`add_signature` with every scan, then :meth:`add_gain` with every scan in the same
    order, then :meth:`result`.

    Parameters
    ----------
    median_size, mean_size : tuple of int
        Windows (y, x) of the two filters, odd numbers of pixels.
    step : int
        The median is taken at every ``step``-th pixel both ways, and the mean over those. The gain
        background is smooth over the mean's window, so that little is lost (the tests show how
        little) and most of the time is saved.
    method : {"none", "mean", "median"}
        That of :func:`flgpr.clutter.self_signature`; the median holds all images in memory.
    rows : int, optional
        Nearest image rows of which the background is estimated, by default all. Gains are always
        those of all rows, so that the first pass must see them.

    Raises
    ------
    ValueError
        If a window is not odd, the method is unknown, or the step is too long for the mean.
    """

    def __init__(
        self,
        median_size: tuple[int, int] = (21, 21),
        mean_size: tuple[int, int] = (51, 51),
        step: int = 1,
        method: SelfSignature = "mean",
        rows: int | None = None,
    ) -> None:
        check_smoothing(median_size, mean_size, step)
        check_method(method)
        self.median_size = median_size
        self.mean_size = mean_size
        self.step = step
        self.method = method
        self._rows = slice(rows)
        self._scaled: list[ComplexArray] = []  # images over their gains, for the median
        self.gains: list[FloatArray] = []
        self._shape: tuple[int, ...] | None = None
        self._signatures: tuple[ComplexArray, ComplexArray] | None = None
        self._median_total: FloatArray | None = None
        self._smoothed = 0  # scans of the second pass

    def add_signature(self, image: ComplexArray) -> FloatArray:
        """Add a scan to the self-signature in the first pass (Eq. 2).

        Parameters
        ----------
        image : (polarization, subband, y, x) ndarray of complex
            Scan image.

        Returns
        -------
        (polarization, subband) ndarray
            Gain r_k of the scan, which is also appended to ``gains``.

        Raises
        ------
        ValueError
            If the image has another shape than those before, or is zero or not finite.
        """
        rows = image[..., self._rows, :]
        if self._shape is None:
            self._begin(rows.shape)
        r, limit = measure(image, self._rows, self._shape)
        if self.method == "mean":
            # The sum over k of Eq. 2, min(m_k, μ_k + 5σ_k) exp(iθ_k) over r_k, and the same over
            # the shared gain.
            r_shared = np.broadcast_to(shared_gain(r), r.shape)
            add_clipped(
                by_channel(image),
                limit.ravel(),
                1 / r.ravel(),
                np.ascontiguousarray(1 / r_shared).ravel(),
                *self._B1_totals,
            )
        elif self.method == "median":
            self._scaled.append((rows / r[..., None, None]).astype(np.complex64))
        self.gains.append(r)
        return r

    def add_gain(self, image: ComplexArray) -> None:
        """Add a scan to the gain background in the second pass (Eq. 3 and 4).

        The image (polarization, subband, y, x) is that of the next scan of the first pass.
        """
        signature = self.signature()
        if self._smoothed >= len(self.gains):
            raise ValueError(
                "add_gain must be called once per scan of the first pass, "
                f"got more than {len(self.gains)}"
            )
        if image[..., self._rows, :].shape != signature.shape:
            raise ValueError(
                f"image must have the shape {signature.shape} of those before, got {image.shape}"
            )
        gain = self.gains[self._smoothed]
        smooth = smoothed_residual(image, gain, signature, self.median_size, self.step)
        self._add_medians(smooth, 1)

    def _add_medians(self, medians: FloatArray, scans: int) -> None:
        """Add the filtered magnitudes of scans to the sum of Eq. 4."""
        before = self._median_total
        self._median_total = medians if before is None else before + medians
        self._smoothed += scans

    def signature(self) -> ComplexArray:
        """Return the self-signature B1 (polarization, subband, y, x) of the scans so far.

        There must be at least two: of a single one it would be all of the image.
        """
        return self._both_signatures()[0]

    def _both_signatures(self) -> tuple[ComplexArray, ComplexArray]:
        """Return the self-signatures, over each channel's own gain and over the shared one."""
        if self._signatures is not None:
            return self._signatures
        least = 1 if self.method == "none" else 2
        if len(self.gains) < least or self._shape is None:
            scans = "one scan" if least == 1 else "two scans"
            raise ValueError(f"self-signature needs at least {scans}, got {len(self.gains)}")
        if self.method == "mean":
            N_scan = len(self.gains)
            B1 = (self._B1_totals / N_scan).astype(np.complex64)  # Eq. 2
            own, shared = B1.reshape(2, *self._shape)
        elif self.method == "median":
            gains = np.stack(self.gains)
            scaled = np.stack(self._scaled)
            ratio = (gains / shared_gain(gains))[..., None, None].astype(np.float32)
            own = complex_median(scaled)
            shared = complex_median(scaled * ratio)
        else:
            own = shared = np.zeros(self._shape, np.complex64)
        self._signatures = (own, shared)
        return self._signatures

    def result(self) -> Background:
        """Return the background once both passes have seen every scan."""
        own, shared = self._both_signatures()
        if self._median_total is None or self._smoothed != len(self.gains):
            raise ValueError(
                f"add_gain must be called for all {len(self.gains)} scans, got {self._smoothed}"
            )
        N_scan = self._smoothed
        medians = self._median_total / N_scan  # Eq. 4
        B2 = mean_filtered(medians, self._shape, self.mean_size, self.step)
        B2_shared = shared_level(B2, np.stack(self.gains))
        return Background(own, B2, shared, B2_shared)

    def first_sums(self, exact: bool = False) -> Arrays:
        """Return the sums of the first pass, which :meth:`take_first` adds to another estimator.

        Parameters
        ----------
        exact : bool
            Whether the totals are complex128, so that another estimator continues with the very
            same bits, or complex64, the precision of what is estimated from them.

        Returns
        -------
        dict of ndarray
            ``gains`` (scan, polarization, subband) and ``shape`` of the images; for the mean the
            totals ``own`` and ``shared``, for the median the images over their gains, ``scaled``.
        """
        if self._shape is None:
            raise ValueError("images must hold at least one scan, got none")
        sums = {"gains": np.stack(self.gains), "shape": np.array(self._shape)}
        if self.method == "median":
            sums["scaled"] = np.stack(self._scaled)
        elif self.method == "mean":
            precision = np.complex128 if exact else np.complex64
            totals = self._B1_totals.astype(precision).reshape(2, *self._shape)
            sums["own"], sums["shared"] = totals
        return sums

    def take_first(self, sums: Arrays) -> None:
        """Add the first pass of another (:meth:`first_sums`) over the scans that follow."""
        shape = tuple(int(n) for n in sums["shape"])
        if self._shape is None:
            self._begin(shape)
        if shape != self._shape:
            raise ValueError(
                f"image must have the shape {self._shape} of those before, got {shape}"
            )
        if self.method == "mean":
            self._B1_totals[0] += by_channel(sums["own"])
            self._B1_totals[1] += by_channel(sums["shared"])
        elif self.method == "median":
            self._scaled += list(sums["scaled"])
        self.gains += list(sums["gains"])
        self._signatures = None

    def first_result(self) -> Arrays:
        """Return what the second pass needs: ``gains``, ``signature`` and ``shared``.

        It needs at least two scans.
        """
        own, shared = self._both_signatures()
        return {"gains": np.stack(self.gains), "signature": own, "shared": shared}

    def continue_from(self, first: Arrays, scans: slice = slice(None)) -> None:
        """Begin the second pass over ``scans`` with another's first one (:meth:`first_result`)."""
        self._shape = first["signature"].shape
        self._signatures = (first["signature"], first["shared"])
        self.gains = list(first["gains"][scans])

    def second_sums(self) -> Arrays:
        """Return the sum of the medians at every ``step``-th pixel, and the count of scans."""
        if self._median_total is None:
            raise ValueError("images must hold at least one scan, got none")
        return {"median": self._median_total, "count": np.array(self._smoothed)}

    def take_second(self, sums: Arrays) -> None:
        """Add the second pass of another (:meth:`second_sums`) over the scans that follow."""
        self._add_medians(sums["median"], int(sums["count"]))

    def _begin(self, shape: tuple[int, ...]) -> None:
        """Allocate the sums for images (polarization, subband, y, x) of a shape."""
        self._shape = shape
        if self.method == "mean":
            # over each channel's own gain and over the shared one
            pixels = (2, shape[0] * shape[1], shape[2] * shape[3])
            self._B1_totals = np.zeros(pixels, np.complex128)


# The steps of an estimate, of all scans (above) and of the scans so far (``causal.py``)


def check_method(method: str) -> None:
    """Refuse an unknown method of estimating the self-signature."""
    if method not in get_args(SelfSignature):
        raise ValueError(f"self_signature method must be none, mean or median, got {method!r}")


def check_windows(median_size: tuple[int, int], mean_size: tuple[int, int]) -> None:
    """Refuse windows (y, x) of the gain background whose sides are not odd numbers of pixels."""
    for name, size in (("median_size", median_size), ("mean_size", mean_size)):
        if any(n < 1 or n % 2 == 0 for n in size):
            raise ValueError(f"{name} must be odd numbers of pixels, got {size}")


def check_smoothing(median_size: tuple[int, int], mean_size: tuple[int, int], step: int) -> None:
    """Refuse windows (y, x) that are not odd, and a step that is too long for the mean."""
    check_windows(median_size, mean_size)
    if not 1 <= step <= max(1, min(mean_size) // 2):
        raise ValueError(f"step must lie between 1 and half of mean_size {mean_size}, got {step}")


def check_gain(gain: FloatArray) -> None:
    """Refuse a scan without a gain r_k."""
    if not (np.isfinite(gain).all() and (gain > 0).all()):
        raise ValueError(
            "image must be finite and not zero everywhere to have a gain, "
            f"got a gain of {gain.min()}: a polarization of its scan, or all of it, holds nothing"
        )


def measure(
    image: ComplexArray, rows: slice, shape: tuple[int, ...] | None
) -> tuple[FloatArray, FloatArray]:
    """Return r_k, the rms of the lowest 75 % of m_k, and μ_k + 5σ_k, by channel (Eq. 2).

    Parameters
    ----------
    image : (polarization, subband, y, x) ndarray of complex
        Scan image.
    rows : slice
        Rows of which the background is estimated; the gain is that of all rows.
    shape : tuple of int
        Shape that these rows must have.

    Raises
    ------
    ValueError
        If they have another shape, a gain is zero or a pixel is not finite.
    """
    if image[..., rows, :].shape != shape:
        raise ValueError(f"image must have the shape {shape} of those before, got {image.shape}")
    gain = np.empty(image.shape[:2])
    limit = np.empty(image.shape[:2])
    pixels = image.shape[2] * image.shape[3]
    lowest = max(1, int(_LOWEST_SHARE * pixels))
    gain_and_limit(by_channel(image), lowest, _CLIP_DEVIATIONS, gain.ravel(), limit.ravel())
    check_gain(gain)
    if not np.isfinite(limit).all():
        raise ValueError("image must be finite, got pixels that are not")
    return gain, limit


def complex_median(stack: AnyArray) -> ComplexArray:
    """Compute the median of the real and of the imaginary part over the first axis."""
    return np.asarray(
        np.median(stack.real, axis=0) + 1j * np.median(stack.imag, axis=0), dtype=np.complex64
    )


def smoothed_residual(
    image: ComplexArray,
    r: FloatArray,
    B1: ComplexArray,
    median_size: tuple[int, int],
    step: int,
) -> FloatArray:
    """Return the median-filtered m'_k = |v_k/r_k - B1| (Eq. 3) at every ``step``-th pixel.

    Parameters
    ----------
    image : (polarization, subband, y, x) ndarray of complex
        Scan image v_k.
    r : (polarization, subband) ndarray
        Its gain.
    B1 : (polarization, subband, y, x) ndarray of complex
        Self-signature.
    median_size : tuple of int
        Window (y, x) of the median.
    step : int
        Distance between the pixels of the result.
    """
    m_prime = np.empty(B1.shape, np.float32)
    residual(by_channel(image), r.ravel(), by_channel(B1), by_channel(m_prime))
    medians = median_stack(m_prime.reshape(-1, *m_prime.shape[2:]), median_size, step)
    return medians.astype(np.float64)


def mean_filtered(
    medians: FloatArray, shape: tuple[int, ...] | None, mean_size: tuple[int, int], step: int
) -> MagnitudeArray:
    """Return B2 from medians at every ``step``-th pixel, averaged over the scans.

    The mean filter is linear, so that it is applied once, after the mean over the scans of Eq. 4.

    Parameters
    ----------
    medians : (channel, y, x) ndarray
        Mean over the scans of :func:`smoothed_residual`.
    shape : tuple of int
        Shape (polarization, subband, y, x) of the result; None if no scan was added.
    mean_size : tuple of int
        Window (y, x) of the mean.
    step : int
        Distance between the pixels of the medians.

    Raises
    ------
    ValueError
        If the background is zero somewhere, or no scan was added.
    """
    if shape is None:
        raise ValueError("images must hold at least one scan, got none")
    ny, nx = shape[2:]
    row = np.stack(_nodes(ny, mean_size[0] // 2, step))
    column = np.stack(_nodes(nx, mean_size[1] // 2, step))
    sums = np.pad(medians.cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0)))
    level = np.empty((len(medians), ny, nx), np.float32)
    mean_of_nodes(sums, row, column, level)
    if not (level > 0).all():
        raise ValueError(
            "gain background must be positive everywhere, got zero: "
            "images equal their self-signature"
        )
    return level.reshape(shape)


def shared_level(level: MagnitudeArray, gains: FloatArray) -> MagnitudeArray:
    """Compute the gain background B̄2 common to the polarizations.

    It is the root mean square of theirs, converted to the shared gain.

    Parameters
    ----------
    level : (polarization, subband, y, x) ndarray of float32
        B2 of every channel in units of its own gain.
    gains : (scan, polarization, subband) ndarray
        Gains r_k of all scans.

    Returns
    -------
    (subband, y, x) ndarray of float32
        B̄2 in units of the shared gain.
    """
    ratio = np.mean(gains / shared_gain(gains), axis=0)
    out = np.empty(level.shape[1:], np.float32)
    root_mean_square(
        np.ascontiguousarray(level).reshape(*level.shape[:2], -1), ratio, by_channel(out)
    )
    return out


def _nodes(count: int, half: int, step: int) -> tuple[IntArray, IntArray]:
    """Return the nodes, every ``step``-th pixel, inside the window about each of ``count`` pixels.

    They are the number of the first node and that after the last one.
    """
    centre = np.arange(count)
    first = -(-np.maximum(centre - half, 0) // step)
    end = np.minimum(centre + half, count - 1) // step + 1
    return first, end


def clean(
    kernel: Any,
    dtype: type[np.generic],
    image: ComplexArray,
    gain: FloatArray,
    signature: ComplexArray,
    level: MagnitudeArray,
    rows: int | None = None,
) -> AnyArray:
    """Return the nearest rows of an image (..., y, x), by default all, by a kernel of Eq. 5.

    Every channel has one gain.
    """
    out = np.empty(image[..., :rows, :].shape, dtype)
    kernel(
        by_channel(image),
        gain.ravel(),
        by_channel(signature),
        by_channel(level),
        by_channel(out),
    )
    return out


def by_channel(array: AnyArray) -> AnyArray:
    """Return (channel, pixel) of (..., y, x); a view where the array is contiguous."""
    return np.ascontiguousarray(array).reshape(-1, array.shape[-2] * array.shape[-1])
