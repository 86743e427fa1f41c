"""Background estimation over runs of any length: one scan in memory at a time, all channels together.

Two normalisations go side by side. Each polarization and sub-band has its *own* gain, self-signature and background
(Wang et al. 2007, Eq. 2-5, as ``background.py`` writes them), which serve magnitudes. The *shared* ones are common to
the polarizations of a sub-band, so that the ratios and phases between polarizations, which polarimetry looks at,
survive.
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
# share of the pixels in r_k; standard deviations of the magnitude limit
_LOWEST = 0.75
_CLIP = 5.0


@dataclass(frozen=True)
class Background:
    """What is taken from a scan image."""

    #: signature, shared_signature: (polarization, subband, y, x): B1 in units of the channel's own gain, and of the
    #: gain shared by the polarizations
    signature: ComplexArray
    #: gain, shared_gain: B2 likewise; ``shared_gain`` (subband, y, x) is the same for all polarizations
    gain: MagnitudeArray
    shared_signature: ComplexArray
    shared_gain: MagnitudeArray

    def cropped(self, rows: int) -> Background:
        """Give the background of the nearest ``rows`` image rows."""
        return Background(
            **{name: np.ascontiguousarray(one[..., :rows, :]) for name, one in vars(self).items()}
        )

    def magnitude(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> MagnitudeArray:
        """Clean an image by channel with its scan gain: m'', in units of the background (Wang et al. 2007, Eq. 5).

        ``rows`` are those nearest, by default all of the image's; the background may reach farther.
        """
        out = np.empty(_near(image, rows), np.float32)
        magnitude_over_background(
            _flat(image), gain.ravel(), _flat(self.signature), _flat(self.gain), _flat(out)
        )
        return out

    def own_coherent(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> ComplexArray:
        """Clean an image channel by channel and keep its phase, as the paper's polarimetric features have it.

        Its modulus is :meth:`magnitude`.
        """
        out = np.empty(_near(image, rows), np.complex64)
        subtract_and_divide(
            _flat(image), gain.ravel(), _flat(self.signature), _flat(self.gain), _flat(out)
        )
        return out

    def coherent(
        self, image: ComplexArray, gain: FloatArray, rows: int | None = None
    ) -> ComplexArray:
        """Clean an image with what the polarizations of a sub-band share: ``(v/r̄ - B1)/B̄2``."""
        out = np.empty(_near(image, rows), np.complex64)
        shared = np.broadcast_to(shared_gain(gain), gain.shape).ravel()
        subtract_and_divide(
            _flat(image), shared, _flat(self.shared_signature), _flat(self.shared_gain), _flat(out)
        )
        return out


def _near(image: ComplexArray, rows: int | None) -> tuple[int, ...]:
    """Shape of the nearest rows of an image."""
    return (
        *image.shape[:-2],
        image.shape[-2] if rows is None else min(rows, image.shape[-2]),
        image.shape[-1],
    )


def shared_gain(gain: FloatArray) -> FloatArray:
    """Gain r̄ (..., 1, subband) common to the polarizations: root mean square of theirs (..., polarization, subband)."""
    return np.sqrt(np.mean(gain**2, axis=-2, keepdims=True))


class BackgroundEstimator:
    """Estimate a run's background in two passes over its images.

    Call :meth:`add_signature` with every scan, then :meth:`add_gain` with every scan in the same order, then
    :meth:`result`. The median is taken at every ``step``-th pixel both ways, and the mean over those: the gain
    background is smooth over the mean's window, so that little is lost (see the tests for how little) and most of the
    time is saved. Windows (y, x) are odd pixels; ``method`` is that of :func:`flgpr.clutter.self_signature`, whose
    median keeps all images. With ``rows`` the background is that of the images' nearest rows alone; gains are always
    those of whole images, so that the first pass must see them.
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
        self._shared: ComplexArray | None = None
        self._median: FloatArray | None = None
        self._smoothed = 0

    def add_signature(self, image: ComplexArray) -> FloatArray:
        """First pass: take a scan into the self-signature (Eq. 2); give its gain r_k, which ``gains`` keeps."""
        near = image[..., self._rows, :]
        if self._shape is None:
            self._begin(near.shape)
        r, limit = self._measure(image)
        if self.method == "mean":
            # The sum over k of Eq. 2, min(m_k, μ_k + 5σ_k) exp(iθ_k) over r_k, and the same over
            # the shared gain.
            r_shared = np.broadcast_to(shared_gain(r), r.shape)
            weights = 1 / r.ravel(), np.ascontiguousarray(1 / r_shared).ravel()
            add_clipped(
                _flat(image), limit.ravel(), *weights, self._B1_total, self._B1_shared_total
            )
        elif self.method == "median":
            self._scaled.append((near / r[..., None, None]).astype(np.complex64))
        self.gains.append(r)
        return r

    def add_gain(self, image: ComplexArray) -> None:
        """Second pass: take a scan into the gain background (Eq. 3 and 4)."""
        signature = self.signature()
        if self._smoothed >= len(self.gains):
            raise ValueError(
                f"add_gain must be called once per scan of the first pass, got more than {len(self.gains)}"
            )
        if image[..., self._rows, :].shape != signature.shape:
            raise ValueError(
                f"image must have the shape {signature.shape} of those before, got {image.shape}"
            )
        smooth = self._smooth(image, self.gains[self._smoothed], signature)
        self._median = smooth if self._median is None else self._median + smooth
        self._smoothed += 1

    def signature(self) -> ComplexArray:
        """Self-signature B1 of the scans so far, at least two: of a single one it would be all of the image."""
        if self._signature is None:
            least = 1 if self.method == "none" else 2
            if len(self.gains) < least or self._shape is None:
                wanted = "one scan" if least == 1 else "two scans"
                raise ValueError(f"self-signature needs at least {wanted}, got {len(self.gains)}")
            if self.method == "mean":
                N_scan = len(self.gains)
                B1 = self._B1_total / N_scan  # Eq. 2
                B1_shared = self._B1_shared_total / N_scan
                self._signature = B1.astype(np.complex64).reshape(self._shape)
                self._shared = B1_shared.astype(np.complex64).reshape(self._shape)
            elif self.method == "median":
                gains = np.stack(self.gains)
                scaled = np.stack(self._scaled)
                shared = scaled * (gains / shared_gain(gains))[..., None, None].astype(np.float32)
                self._signature = complex_median(scaled)
                self._shared = complex_median(shared)
            else:
                self._signature = self._shared = np.zeros(self._shape, np.complex64)
        return self._signature

    def result(self) -> Background:
        """Assemble the background once both passes have seen every scan."""
        signature = self.signature()
        if self._median is None or self._smoothed != len(self.gains) or self._shared is None:
            raise ValueError(
                f"add_gain must be called for all {len(self.gains)} scans, got {self._smoothed}"
            )
        N_scan = self._smoothed
        B2 = self._spread_out(self._median / N_scan)  # Eq. 4
        return Background(signature, B2, self._shared, shared_level(B2, np.stack(self.gains)))

    def first_sums(self, exact: bool = False) -> dict[str, NDArray[Any]]:
        """Give what the first pass has gathered, to be taken in by another estimator.

        ``gains`` (scan, polarization, subband) and ``shape`` of the images; for the mean the totals ``own`` and
        ``shared``, for the median the images over their gains, ``scaled``. With ``exact`` the totals keep complex128,
        so that another goes on with the very same bits, else complex64: what is estimated from them has that precision
        anyway.
        """
        if self._shape is None:
            raise ValueError("images must hold at least one scan, got none")
        found = {"gains": np.stack(self.gains), "shape": np.array(self._shape)}
        if self.method == "median":
            return found | {"scaled": np.stack(self._scaled)}
        kind = np.complex128 if exact else np.complex64
        totals = (
            {"own": self._B1_total, "shared": self._B1_shared_total}
            if self.method == "mean"
            else {}
        )
        return found | {
            name: total.astype(kind).reshape(self._shape) for name, total in totals.items()
        }

    def take_first(self, sums: dict[str, NDArray[Any]]) -> None:
        """Take in what another estimator gathered in its first pass (:meth:`first_sums`) over the scans that follow."""
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
        """Give what the second pass needs: ``gains``, ``signature`` and ``shared``, of at least two scans."""
        signature = self.signature()
        shared = np.zeros_like(signature) if self._shared is None else self._shared
        return {"gains": np.stack(self.gains), "signature": signature, "shared": shared}

    def continue_from(self, first: dict[str, NDArray[Any]], scans: slice = slice(None)) -> None:
        """Begin the second pass, over ``scans``, where another estimator ended the first (:meth:`first_result`)."""
        self._shape = first["signature"].shape
        self._signature = first["signature"]
        self._shared = first["shared"]
        self.gains = list(first["gains"][scans])

    def second_sums(self) -> dict[str, NDArray[Any]]:
        """Give what the second pass has gathered: the medians' sum at every ``step``-th pixel, and the scans."""
        if self._median is None:
            raise ValueError("images must hold at least one scan, got none")
        return {"median": self._median, "count": np.array(self._smoothed)}

    def take_second(self, sums: dict[str, NDArray[Any]]) -> None:
        """Take in what another gathered in its second pass (:meth:`second_sums`) over the scans that follow."""
        self._median = sums["median"] if self._median is None else self._median + sums["median"]
        self._smoothed += int(sums["count"])

    def _begin(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        if self.method == "mean":
            pixels = (shape[0] * shape[1], shape[2] * shape[3])
            self._B1_total = np.zeros(pixels, np.complex128)
            self._B1_shared_total = np.zeros(pixels, np.complex128)

    def _measure(self, image: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """Return r_k, the rms of the lowest 75 % of the magnitudes m_k, and μ_k + 5σ_k, by channel (Eq. 2)."""
        if image[..., self._rows, :].shape != self._shape:
            raise ValueError(
                f"image must have the shape {self._shape} of those before, got {image.shape}"
            )
        gain = np.empty(image.shape[:2])
        limit = np.empty(image.shape[:2])
        pixels = image.shape[2] * image.shape[3]
        gain_and_limit(
            _flat(image), max(1, int(_LOWEST * pixels)), _CLIP, gain.ravel(), limit.ravel()
        )
        check_gain(gain)
        if not np.isfinite(limit).all():
            raise ValueError("image must be finite, got pixels that are not")
        return gain, limit

    def _smooth(self, image: ComplexArray, r: FloatArray, B1: ComplexArray) -> FloatArray:
        """Return m'_k = |v_k/r_k - B1| (Eq. 3) after the median filter, at every ``step``-th pixel."""
        m_prime = np.empty(B1.shape, np.float32)
        residual(_flat(image), r.ravel(), _flat(B1), _flat(m_prime))
        medians = median_stack(m_prime.reshape(-1, *m_prime.shape[2:]), self.median_size, self.step)
        return medians.astype(np.float64)

    def _spread_out(self, medians: FloatArray) -> MagnitudeArray:
        """Apply the mean filter, which is linear and so can come once, after the mean over the scans of Eq. 4."""
        if self._shape is None:
            raise ValueError("images must hold at least one scan, got none")
        sizes = zip(self._shape[2:], self.mean_size, strict=True)
        row, column = (np.stack(_nodes(n, size // 2, self.step)) for n, size in sizes)
        sums = np.pad(medians.cumsum(axis=1).cumsum(axis=2), ((0, 0), (1, 0), (1, 0)))
        level = np.empty((len(medians), *self._shape[2:]), np.float32)
        mean_of_nodes(sums, row, column, level)
        if not (level > 0).all():
            raise ValueError(
                "gain background must be positive everywhere, got zero: images equal their self-signature"
            )
        return level.reshape(self._shape)


def shared_level(level: MagnitudeArray, gains: FloatArray) -> MagnitudeArray:
    """Gain background B̄2 common to the polarizations: the root mean square of theirs, brought to the shared gain.

    ``level`` (polarization, subband, y, x) is B2 of every channel in units of its own gain.
    """
    ratio = np.mean(gains / shared_gain(gains), axis=0)
    out = np.empty(level.shape[1:], np.float32)
    root_mean_square(np.ascontiguousarray(level).reshape(*level.shape[:2], -1), ratio, _flat(out))
    return out


class CausalBackground:
    """Background from the scans so far, for live use: nothing waits for the end of the run.

    Self-signature and medians are running means, over all scans or, with ``span``, fading with that
    many scans, which follows a self-signature that drifts. The residuals of earlier scans are not
    made anew when the self-signature improves. A scan is cleaned with what those before it taught,
    so that nothing of a target in it is taken away and its alarms need not wait while it teaches
    (:meth:`learn`); the first that is cleaned is number ``warm_up``, at least
    3. The windows and ``rows`` are those of :class:`BackgroundEstimator`.
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
                f"warm_up must be at least {LEAST_WARM_UP} scans, got {warm_up}: two teach the background"
            )
        if span is not None and span < LEAST_SPAN:
            raise ValueError(f"span must be at least {LEAST_SPAN} scans, got {span}")
        self._tool = BackgroundEstimator(median_size, mean_size, step, rows=rows)
        self._span = span
        self._warm_up = warm_up
        self._count = 0
        self._means: list[Any] = []  # own and shared signature, ratios of the gains, medians
        self._given = False  # whether someone else has hold of them
        # the first two means, as images
        self._signatures: tuple[ComplexArray, ComplexArray] | None = None
        self._ready: Background | None = None  # of all that was learnt
        # a scan that was not learnt yet
        self._waiting: tuple[ComplexArray, FloatArray, FloatArray] | None = None

    def add(self, image: ComplexArray) -> tuple[FloatArray, Background | None]:
        """Take the next scan; give its gain and what to clean it with, None during the warm-up."""
        self.learn()
        tool = self._tool
        tool._shape = tool._shape or image[..., tool._rows, :].shape
        gain, limit = tool._measure(image)
        self._waiting = image, gain, limit
        if self._count + 1 >= self._warm_up and self._ready is None:
            self._prepare()
        return gain, self._ready

    def learn(self) -> None:
        """Take the last scan into the estimate; :meth:`add`, :meth:`state` do it themselves where it was not done."""
        if self._waiting is None:
            return
        (image, gain, limit), self._waiting = self._waiting, None
        tool = self._tool
        near = image[..., self._tool._rows, :].shape
        self._count += 1
        weight = 1 / min(self._count, self._span or self._count)
        common = shared_gain(gain)
        signatures = []
        ratio = gain / common
        if not self._means:
            self._means = [
                *(
                    np.zeros((near[0] * near[1], near[2] * near[3]), np.complex128)
                    for _ in range(2)
                ),
                ratio,
            ]
        for i, scale in enumerate(
            (1 / gain.ravel(), (1 / np.broadcast_to(common, gain.shape)).ravel())
        ):
            mean = self._means[i]
            signature = np.empty(near, np.complex64)
            self._means[i] = np.empty_like(mean) if self._given else mean
            blend_clipped(
                _flat(image), limit.ravel(), scale, weight, mean, self._means[i], _flat(signature)
            )
            signatures.append(signature)
        self._means[2] = _blend(self._means[2], ratio, weight)
        self._given = False
        own, shared = signatures
        if self._count >= 2:
            smooth = tool._smooth(image, gain, own)
            share = 1 / min(self._count - 1, self._span or self._count)
            self._means[3:] = [
                _blend(self._means[3] if len(self._means) > 3 else smooth, smooth, share)
            ]
        self._signatures = (own, shared)
        self._ready = None
        if self._count + 1 >= self._warm_up:
            with suppress(ValueError):  # the next scan is told
                self._prepare()

    def _prepare(self) -> None:
        """Make of the means what a scan is cleaned with."""
        if self._signatures is None:
            self._signatures = tuple(
                one.astype(np.complex64).reshape(self._tool._shape) for one in self._means[:2]
            )
        (own, shared), level = self._signatures, self._tool._spread_out(self._means[3])
        self._ready = Background(own, level, shared, shared_level(level, self._means[2][None]))

    def state(self) -> dict[str, NDArray[Any]]:
        """Give what has been learnt, for a later :meth:`restore`; later scans do not change it."""
        self.learn()
        self._given = True
        found = {
            "count": np.array(self._count),
            "shape": np.array(self._tool._shape or (), np.int64),
        }
        return found | {f"mean{i}": value for i, value in enumerate(self._means)}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what an estimate with the same parameters had learnt (:meth:`state`)."""
        count = int(state["count"])
        means = [f"mean{i}" for i in range(min(count + 2, 4) if count else 0)]
        missing = [name for name in means if name not in state]
        if missing:
            raise ValueError(f"state must hold {', '.join(missing)}, which it does not")
        self._count = count
        self._tool._shape = tuple(int(n) for n in state["shape"]) or None
        self._means = [np.asarray(state[name]) for name in means]
        self._given = True
        self._signatures = self._ready = self._waiting = None


def _nodes(count: int, half: int, step: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First of every ``step``-th pixel inside the window of each of ``count`` pixels, and the one after the last."""
    centre = np.arange(count)
    return -(-np.maximum(centre - half, 0) // step), np.minimum(
        centre + half, count - 1
    ) // step + 1


def _blend(old: Any, new: Any, weight: float) -> Any:
    return old + weight * (new - old)


def _flat(array: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(array).reshape(-1, array.shape[-2] * array.shape[-1])
