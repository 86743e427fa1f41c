"""Pixel loops of background removal, all channels of a scan at once (Wang et al. 2007, Eq. 2, 3 and 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from flgpr.kernels.compiled import njit
from flgpr.kernels.filters import sorted_order

_SHIFT = 20  # float32 bits below the 12 that sort magnitudes into coarse bins


@njit(cache=True)
def _magnitude(value: Any) -> Any:
    """Magnitude of a complex64 value, in double precision: it cannot overflow, and is vector code as ``abs`` is not."""
    re, im = np.float64(value.real), np.float64(value.imag)
    return np.float32(np.sqrt(re * re + im * im))


@njit(parallel=True, cache=True)
def gain_and_limit(images, keep, clip, gain, limit):  # type: ignore[no-untyped-def]
    """Scan gain r_k and clipping limit μ + ``clip``·σ of every channel of ``images`` (channel, pixel).

    The gain is the root mean square of the ``keep`` smallest magnitudes: bits of such floats order as they do.
    """
    for c in prange(images.shape[0]):
        magnitude = np.empty(images.shape[1], np.float32)
        for i in range(magnitude.size):
            magnitude[i] = _magnitude(images[c, i])
        bits = magnitude.view(np.uint32)
        count = np.zeros(1 << (32 - _SHIFT), np.int64)
        total = 0.0
        for i in range(magnitude.size):
            total += magnitude[i]
            count[bits[i] >> _SHIFT] += 1
        mean, edge, below = total / magnitude.size, 0, 0
        while below + count[edge] < keep:
            below += count[edge]
            edge += 1
        border = np.empty(count[edge] + 1, np.float32)  # one more: every value is written before it is judged
        spread, lowest, at = 0.0, 0.0, 0
        for i in range(magnitude.size):
            value, place = np.float64(magnitude[i]), bits[i] >> _SHIFT
            spread += (value - mean) ** 2
            lowest += value * value if place < edge else 0.0
            border[at] = magnitude[i]
            at += place == edge
        order = sorted_order(border[:at])
        for i in range(keep - below):
            lowest += np.float64(border[order[i]]) ** 2
        gain[c] = np.sqrt(lowest / keep)
        limit[c] = mean + clip * np.sqrt(spread / magnitude.size)


@njit(parallel=True, cache=True)
def add_clipped(images, limit, own, shared, own_total, shared_total):  # type: ignore[no-untyped-def]
    """Add ``images`` (channel, pixel), clipped in magnitude, times ``own`` and times ``shared``, to two totals.

    The totals may hold the first pixels alone.
    """
    for c in prange(images.shape[0]):
        near = limit[c] * limit[c] * (1 - 1e-9)  # below it no magnitude need be taken, which is dear
        for i in range(own_total.shape[1]):
            value = np.complex128(images[c, i])
            if value.real * value.real + value.imag * value.imag > near:
                magnitude = abs(value)
                if magnitude > limit[c]:
                    value *= limit[c] / magnitude
            own_total[c, i] += own[c] * value
            shared_total[c, i] += shared[c] * value


@njit(parallel=True, cache=True)
def residual(images, gain, signature, out):  # type: ignore[no-untyped-def]
    """Magnitude of ``images/gain - signature`` (channel, pixel)."""
    for c in prange(images.shape[0]):
        scale = np.float32(1 / gain[c])
        for i in range(images.shape[1]):
            out[c, i] = _magnitude(images[c, i] * scale - signature[c, i])


@njit(parallel=True, cache=True)
def subtract_and_divide(images, gain, signature, background, out):  # type: ignore[no-untyped-def]
    """``(images/gain - signature)/background`` (channel, pixel); ``gain`` and ``background`` one per channel."""
    for c in prange(images.shape[0]):
        scale = np.float32(1 / gain[c])
        for i in range(images.shape[1]):
            value, level = images[c, i] * scale - signature[c, i], background[c, i]
            out[c, i] = complex(value.real / level, value.imag / level)


@njit(parallel=True, cache=True)
def magnitude_over_background(images, gain, signature, background, out):  # type: ignore[no-untyped-def]
    """Modulus of :func:`subtract_and_divide`."""
    for c in prange(images.shape[0]):
        scale = np.float32(1 / gain[c])
        for i in range(images.shape[1]):
            out[c, i] = _magnitude(images[c, i] * scale - signature[c, i]) / background[c, i]
