"""Background estimation over runs of any length, with one scan in memory at a time.

There are two normalisations. Each polarization and sub-band has its *own* gain, self-signature and
background (Wang et al. 2007, Eq. 2-5, as in ``background.py``), which serve magnitudes. The
*shared* ones are common to the polarizations of a sub-band, so that the ratios and phases between
polarizations, which polarimetry uses, survive.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.clutter.background import (
    ComplexArray,
    SelfSignature,
    check_gain,
    check_method,
    check_windows,
    complex_median,
)
from flgpr.kernels.background import (
    add_clipped,
    blend_clipped,
    gain_and_limit,
    magnitude_over_background,
    mean_of_nodes,
    residual,
    root_mean_square,
    subtract_and_divide,
)
from flgpr.kernels.filters import median_stack

FloatArray = NDArray[np.float64]
MagnitudeArray = NDArray[np.float32]
LEAST_WARM_UP = 3
LEAST_SPAN = 2
"""Scans that causal estimates need."""
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
        out = np.empty(_shape_of_rows(image, rows), np.float32)
        magnitude_over_background(
            _flat(image), gain.ravel(), _flat(self.signature), _flat(self.gain), _flat(out)
        )
        return out

    def own_coherent(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> ComplexArray:
        """Clean an image by channel with its phase, as for the paper's polarimetric features.

        The modulus is :meth:`magnitude`, whose parameters it takes.
        """
        out = np.empty(_shape_of_rows(image, rows), np.complex64)
        subtract_and_divide(
            _flat(image), gain.ravel(), _flat(self.signature), _flat(self.gain), _flat(out)
        )
        return out

    def coherent(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> ComplexArray:
        """Clean an image with what the polarizations of a sub-band share: ``(v/r̄ - B1)/B̄2``.

        The parameters are those of :meth:`magnitude`.
        """
        out = np.empty(_shape_of_rows(image, rows), np.complex64)
        shared = np.broadcast_to(shared_gain(gain), gain.shape).ravel()
        subtract_and_divide(
            _flat(image), shared, _flat(self.shared_signature), _flat(self.shared_gain), _flat(out)
        )
        return out


def _shape_of_rows(image: ComplexArray, rows: int | None) -> tuple[int, ...]:
    """Return the shape of the nearest rows of an image, by default of all."""
    available = image.shape[-2]
    count = available if rows is None else min(rows, available)
    return (*image.shape[:-2], count, image.shape[-1])


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
        check_windows(median_size, mean_size)
        check_method(method)
        if not 1 <= step <= max(1, min(mean_size) // 2):
            raise ValueError(
                f"step must lie between 1 and half of mean_size {mean_size}, got {step}"
            )
        self.median_size = median_size
        self.mean_size = mean_size
        self.step = step
        self.method = method
        self._rows = slice(rows)
        self._scaled: list[ComplexArray] = []  # images over their gains, for the median
        self.gains: list[FloatArray] = []
        self._shape: tuple[int, ...] | None = None
        self._signature: ComplexArray | None = None
        self._shared_signature: ComplexArray | None = None
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
        r, limit = self._measure(image)
        if self.method == "mean":
            # The sum over k of Eq. 2, min(m_k, μ_k + 5σ_k) exp(iθ_k) over r_k, and the same over
            # the shared gain.
            r_shared = np.broadcast_to(shared_gain(r), r.shape)
            add_clipped(
                _flat(image),
                limit.ravel(),
                1 / r.ravel(),
                np.ascontiguousarray(1 / r_shared).ravel(),
                self._B1_total,
                self._B1_shared_total,
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
        smooth = self._smooth(image, self.gains[self._smoothed], signature)
        if self._median_total is None:
            self._median_total = smooth
        else:
            self._median_total = self._median_total + smooth
        self._smoothed += 1

    def signature(self) -> ComplexArray:
        """Return the self-signature B1 (polarization, subband, y, x) of the scans so far.

        There must be at least two: of a single one it would be all of the image.
        """
        if self._signature is not None:
            return self._signature
        least = 1 if self.method == "none" else 2
        if len(self.gains) < least or self._shape is None:
            scans = "one scan" if least == 1 else "two scans"
            raise ValueError(f"self-signature needs at least {scans}, got {len(self.gains)}")
        if self.method == "mean":
            N_scan = len(self.gains)
            B1 = self._B1_total / N_scan  # Eq. 2
            B1_shared = self._B1_shared_total / N_scan
            self._signature = B1.astype(np.complex64).reshape(self._shape)
            self._shared_signature = B1_shared.astype(np.complex64).reshape(self._shape)
        elif self.method == "median":
            gains = np.stack(self.gains)
            scaled = np.stack(self._scaled)
            ratio = (gains / shared_gain(gains))[..., None, None].astype(np.float32)
            self._signature = complex_median(scaled)
            self._shared_signature = complex_median(scaled * ratio)
        else:
            self._signature = np.zeros(self._shape, np.complex64)
            self._shared_signature = self._signature
        return self._signature

    def result(self) -> Background:
        """Return the background once both passes have seen every scan."""
        signature = self.signature()
        complete = self._smoothed == len(self.gains)
        if self._median_total is None or not complete or self._shared_signature is None:
            raise ValueError(
                f"add_gain must be called for all {len(self.gains)} scans, got {self._smoothed}"
            )
        N_scan = self._smoothed
        B2 = self._mean_filtered(self._median_total / N_scan)  # Eq. 4
        B2_shared = shared_level(B2, np.stack(self.gains))
        return Background(signature, B2, self._shared_signature, B2_shared)

    def first_sums(self, exact: bool = False) -> dict[str, NDArray[Any]]:
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
            sums["own"] = self._B1_total.astype(precision).reshape(self._shape)
            sums["shared"] = self._B1_shared_total.astype(precision).reshape(self._shape)
        return sums

    def take_first(self, sums: dict[str, NDArray[Any]]) -> None:
        """Add the first pass of another (:meth:`first_sums`) over the scans that follow."""
        shape = tuple(int(n) for n in sums["shape"])
        if self._shape is None:
            self._begin(shape)
        if shape != self._shape:
            raise ValueError(
                f"image must have the shape {self._shape} of those before, got {shape}"
            )
        if self.method == "mean":
            self._B1_total += _flat(sums["own"])
            self._B1_shared_total += _flat(sums["shared"])
        elif self.method == "median":
            self._scaled += list(sums["scaled"])
        self.gains += list(sums["gains"])
        self._signature = None

    def first_result(self) -> dict[str, NDArray[Any]]:
        """Return what the second pass needs: ``gains``, ``signature`` and ``shared``.

        It needs at least two scans.
        """
        signature = self.signature()
        shared = self._shared_signature
        if shared is None:
            shared = np.zeros_like(signature)
        return {"gains": np.stack(self.gains), "signature": signature, "shared": shared}

    def continue_from(self, first: dict[str, NDArray[Any]], scans: slice = slice(None)) -> None:
        """Begin the second pass over ``scans`` with another's first one (:meth:`first_result`)."""
        self._shape = first["signature"].shape
        self._signature = first["signature"]
        self._shared_signature = first["shared"]
        self.gains = list(first["gains"][scans])

    def second_sums(self) -> dict[str, NDArray[Any]]:
        """Return the sum of the medians at every ``step``-th pixel, and the count of scans."""
        if self._median_total is None:
            raise ValueError("images must hold at least one scan, got none")
        return {"median": self._median_total, "count": np.array(self._smoothed)}

    def take_second(self, sums: dict[str, NDArray[Any]]) -> None:
        """Add the second pass of another (:meth:`second_sums`) over the scans that follow."""
        if self._median_total is None:
            self._median_total = sums["median"]
        else:
            self._median_total = self._median_total + sums["median"]
        self._smoothed += int(sums["count"])

    def _begin(self, shape: tuple[int, ...]) -> None:
        """Allocate the sums for images (polarization, subband, y, x) of a shape."""
        self._shape = shape
        if self.method == "mean":
            pixels = (shape[0] * shape[1], shape[2] * shape[3])
            self._B1_total = np.zeros(pixels, np.complex128)
            self._B1_shared_total = np.zeros(pixels, np.complex128)

    def _measure(self, image: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Return r_k, the rms of the lowest 75 % of m_k, and μ_k + 5σ_k, by channel (Eq. 2)."""
        if image[..., self._rows, :].shape != self._shape:
            raise ValueError(
                f"image must have the shape {self._shape} of those before, got {image.shape}"
            )
        gain = np.empty(image.shape[:2])
        limit = np.empty(image.shape[:2])
        pixels = image.shape[2] * image.shape[3]
        lowest = max(1, int(_LOWEST_SHARE * pixels))
        gain_and_limit(_flat(image), lowest, _CLIP_DEVIATIONS, gain.ravel(), limit.ravel())
        check_gain(gain)
        if not np.isfinite(limit).all():
            raise ValueError("image must be finite, got pixels that are not")
        return gain, limit

    def _smooth(self, image: ComplexArray, r: FloatArray, B1: ComplexArray) -> FloatArray:
        """Return the median-filtered m'_k = |v_k/r_k - B1| (Eq. 3) at every ``step``-th pixel."""
        m_prime = np.empty(B1.shape, np.float32)
        residual(_flat(image), r.ravel(), _flat(B1), _flat(m_prime))
        medians = median_stack(m_prime.reshape(-1, *m_prime.shape[2:]), self.median_size, self.step)
        return medians.astype(np.float64)

    def _mean_filtered(self, medians: FloatArray) -> MagnitudeArray:
        """Return B2 from medians at every ``step``-th pixel, averaged over the scans.

        The mean filter is linear, so that it is applied once, after the mean over the scans of Eq.
        4.
        """
        if self._shape is None:
            raise ValueError("images must hold at least one scan, got none")
        ny, nx = self._shape[2:]
        row = np.stack(_nodes(ny, self.mean_size[0] // 2, self.step))
        column = np.stack(_nodes(nx, self.mean_size[1] // 2, self.step))
        sums = np.pad(medians.cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0)))
        level = np.empty((len(medians), ny, nx), np.float32)
        mean_of_nodes(sums, row, column, level)
        if not (level > 0).all():
            raise ValueError(
                "gain background must be positive everywhere, got zero: "
                "images equal their self-signature"
            )
        return level.reshape(self._shape)


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
    root_mean_square(np.ascontiguousarray(level).reshape(*level.shape[:2], -1), ratio, _flat(out))
    return out


class CausalBackground:
    """Estimate the background from the scans so far, for live use before the end of the run.

    Self-signature and medians are running means. The residuals of earlier scans are not computed
    anew when the self-signature improves. A scan is cleaned with the estimate from those before it,
    so that nothing of a target in it is subtracted and its alarms need not wait until it is
    included (:meth:`learn`).

    Parameters
    ----------
    median_size, mean_size, step, rows
        As for :class:`BackgroundEstimator`.
    span : int, optional
        Scans with which the running means fade, to follow a self-signature that drifts; by default
        they are over all scans.
    warm_up : int
        Number of the first scan that is cleaned, at least 3.

    Raises
    ------
    ValueError
        If ``warm_up`` or ``span`` is too short.
    """

    def __init__(
        self,
        median_size: tuple[int, int] = (21, 21),
        mean_size: tuple[int, int] = (51, 51),
        step: int = 3,
        span: int | None = None,
        warm_up: int = 5,
        rows: int | None = None,
    ) -> None:
        if warm_up < LEAST_WARM_UP:
            raise ValueError(
                f"warm_up must be at least {LEAST_WARM_UP} scans, got {warm_up}: "
                "the background is estimated from two"
            )
        if span is not None and span < LEAST_SPAN:
            raise ValueError(f"span must be at least {LEAST_SPAN} scans, got {span}")
        self._estimator = BackgroundEstimator(median_size, mean_size, step, rows=rows)
        self._span = span
        self._warm_up = warm_up
        self._count = 0
        # Running means: own and shared signature, ratios of the gains, medians. Once given out by
        # state() they must not be overwritten.
        self._means: list[Any] = []
        self._means_given_out = False
        # The first two of the means as images, and the background of all scans learnt.
        self._signatures: tuple[ComplexArray, ComplexArray] | None = None
        self._background: Background | None = None
        # The last scan, its gain and limit, until it is learnt.
        self._pending: tuple[ComplexArray, FloatArray, FloatArray] | None = None

    def add(self, image: ComplexArray) -> tuple[FloatArray, Background | None]:
        """Add the next scan.

        Parameters
        ----------
        image : (polarization, subband, y, x) ndarray of complex
            Scan image.

        Returns
        -------
        gain : (polarization, subband) ndarray
            Gain r_k of the scan.
        background : Background or None
            What to clean it with, from the scans before; None during the warm-up.
        """
        self.learn()
        estimator = self._estimator
        estimator._shape = estimator._shape or image[..., estimator._rows, :].shape
        gain, limit = estimator._measure(image)
        self._pending = (image, gain, limit)
        if self._count + 1 >= self._warm_up and self._background is None:
            self._assemble()
        return gain, self._background

    def learn(self) -> None:
        """Include the last scan in the estimate.

        :meth:`add` and :meth:`state` do so themselves where it was not done before.
        """
        if self._pending is None:
            return
        image, gain, limit = self._pending
        self._pending = None
        self._count += 1
        weight = 1 / min(self._count, self._span or self._count)
        common = shared_gain(gain)
        ratio = gain / common
        if not self._means:
            polarizations, subbands, ny, nx = image[..., self._estimator._rows, :].shape
            shape = (polarizations * subbands, ny * nx)
            self._means = [np.zeros(shape, np.complex128), np.zeros(shape, np.complex128), ratio]

        own_scale = 1 / gain.ravel()
        shared_scale = (1 / np.broadcast_to(common, gain.shape)).ravel()
        own_signature = self._blend_signature(0, image, limit, own_scale, weight)
        shared = self._blend_signature(1, image, limit, shared_scale, weight)
        self._means[2] = _blend(self._means[2], ratio, weight)
        self._means_given_out = False
        if self._count >= 2:
            self._blend_medians(image, gain, own_signature)
        self._signatures = (own_signature, shared)
        self._background = None
        if self._count + 1 >= self._warm_up:
            with suppress(ValueError):  # add() raises it with the next scan
                self._assemble()

    def _blend_signature(
        self,
        number: int,
        image: ComplexArray,
        limit: FloatArray,
        scale: FloatArray,
        weight: float,
    ) -> ComplexArray:
        """Add the last scan, clipped and scaled, to a mean; return the mean as an image."""
        mean = self._means[number]
        updated = np.empty_like(mean) if self._means_given_out else mean
        signature = np.empty(image[..., self._estimator._rows, :].shape, np.complex64)
        blend_clipped(_flat(image), limit.ravel(), scale, weight, mean, updated, _flat(signature))
        self._means[number] = updated
        return signature

    def _blend_medians(
        self, image: ComplexArray, gain: FloatArray, own_signature: ComplexArray
    ) -> None:
        """Add the filtered residual of the last scan to the mean of the medians."""
        smooth = self._estimator._smooth(image, gain, own_signature)
        weight = 1 / min(self._count - 1, self._span or self._count)
        medians = self._means[3] if len(self._means) > 3 else smooth
        self._means[3:] = [_blend(medians, smooth, weight)]

    def _assemble(self) -> None:
        """Compute from the means the background of the next scan."""
        if self._signatures is None:
            shape = self._estimator._shape
            own_signature = self._means[0].astype(np.complex64).reshape(shape)
            shared = self._means[1].astype(np.complex64).reshape(shape)
            self._signatures = (own_signature, shared)
        own_signature, shared = self._signatures
        level = self._estimator._mean_filtered(self._means[3])
        common_level = shared_level(level, self._means[2][None])
        self._background = Background(own_signature, level, shared, common_level)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the estimate for a later :meth:`restore`; later scans do not change it."""
        self.learn()
        self._means_given_out = True
        state = {
            "count": np.array(self._count),
            "shape": np.array(self._estimator._shape or (), np.int64),
        }
        for number, mean in enumerate(self._means):
            state[f"mean{number}"] = mean
        return state

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from the :meth:`state` of an estimate with the same parameters.

        A state that lacks a mean is a ValueError.
        """
        count = int(state["count"])
        mean_count = min(count + 2, 4) if count else 0
        names = [f"mean{number}" for number in range(mean_count)]
        missing = [name for name in names if name not in state]
        if missing:
            raise ValueError(f"state must hold {', '.join(missing)}, which it does not")
        self._count = count
        self._estimator._shape = tuple(int(n) for n in state["shape"]) or None
        self._means = [np.asarray(state[name]) for name in names]
        self._means_given_out = True
        self._signatures = None
        self._background = None
        self._pending = None


def _nodes(count: int, half: int, step: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the nodes, every ``step``-th pixel, inside the window about each of ``count`` pixels.

    They are the number of the first node and that after the last one.
    """
    centre = np.arange(count)
    first = -(-np.maximum(centre - half, 0) // step)
    end = np.minimum(centre + half, count - 1) // step + 1
    return first, end


def _blend(old: Any, new: Any, weight: float) -> Any:
    """Update a running mean by a new value."""
    return old + weight * (new - old)


def _flat(array: NDArray[Any]) -> NDArray[Any]:
    """Return (channel, pixel) of (..., y, x); a view where the array is contiguous."""
    return np.ascontiguousarray(array).reshape(-1, array.shape[-2] * array.shape[-1])
