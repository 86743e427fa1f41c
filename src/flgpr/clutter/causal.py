"""Background estimation from the scans so far, for live detection (Wang et al. 2007, Eq. 2-4)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from flgpr.clutter.estimator import (
    Background,
    by_channel,
    check_smoothing,
    mean_filtered,
    measure,
    shared_gain,
    shared_level,
    smoothed_residual,
)
from flgpr.kernels.background import blend_clipped
from flgpr.types import AnyArray, Arrays, ComplexArray, FloatArray

LEAST_WARM_UP = 3
LEAST_SPAN = 2
"""Scans that causal estimates need."""


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
        check_smoothing(median_size, mean_size, step)
        self._median_size = median_size
        self._mean_size = mean_size
        self._step = step
        self._rows = slice(rows)
        # Of those rows of an image; None before the first scan.
        self._shape: tuple[int, ...] | None = None
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
        self._shape = self._shape or image[..., self._rows, :].shape
        gain, limit = measure(image, self._rows, self._shape)
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
            polarizations, subbands, ny, nx = image[..., self._rows, :].shape
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
        signature = np.empty(image[..., self._rows, :].shape, np.complex64)
        blend_clipped(
            by_channel(image), limit.ravel(), scale, weight, mean, updated, by_channel(signature)
        )
        self._means[number] = updated
        return signature

    def _blend_medians(
        self, image: ComplexArray, gain: FloatArray, own_signature: ComplexArray
    ) -> None:
        """Add the filtered residual of the last scan to the mean of the medians."""
        smooth = smoothed_residual(image, gain, own_signature, self._median_size, self._step)
        weight = 1 / min(self._count - 1, self._span or self._count)
        medians = self._means[3] if len(self._means) > 3 else smooth
        self._means[3:] = [_blend(medians, smooth, weight)]

    def _assemble(self) -> None:
        """Compute from the means the background of the next scan."""
        if self._signatures is None:
            shape = self._shape
            own_signature = self._means[0].astype(np.complex64).reshape(shape)
            shared = self._means[1].astype(np.complex64).reshape(shape)
            self._signatures = (own_signature, shared)
        own_signature, shared = self._signatures
        level = mean_filtered(self._means[3], self._shape, self._mean_size, self._step)
        common_level = shared_level(level, self._means[2][None])
        self._background = Background(own_signature, level, shared, common_level)

    def state(self) -> Arrays:
        """Return the estimate for a later :meth:`restore`; later scans do not change it."""
        self.learn()
        self._means_given_out = True
        state = {
            "count": np.array(self._count),
            "shape": np.array(self._shape or (), np.int64),
        }
        for number, mean in enumerate(self._means):
            state[f"mean{number}"] = mean
        return state

    def restore(self, state: Mapping[str, AnyArray]) -> None:
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
        self._shape = tuple(int(n) for n in state["shape"]) or None
        self._means = [np.asarray(state[name]) for name in names]
        self._means_given_out = True
        self._signatures = None
        self._background = None
        self._pending = None


def _blend(old: Any, new: Any, weight: float) -> Any:
    """Update a running mean by a new value."""
    return old + weight * (new - old)
