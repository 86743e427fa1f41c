"""Pixel loops of background removal, all channels of a scan at once (Wang et al. 2007, Eq. 2, 3 and 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

_SHIFT = 20  # float32 bits below the 12 that sort magnitudes into coarse bins


@njit(cache=True)
def _rms_of_lowest(magnitude: Any, keep: int) -> float:
    """Root mean square of the ``keep`` smallest values, none negative: bits of such floats order as they do."""
    bits = magnitude.view(np.uint32)
    count = np.zeros(1 << (32 - _SHIFT), np.int64)
    for value in bits:
        count[value >> _SHIFT] += 1
    edge, below = 0, 0
    while below + count[edge] < keep:
        below += count[edge]
        edge += 1
    total, at = 0.0, 0
    border = np.empty(count[edge], np.float32)
    for i in range(magnitude.size):
        place = bits[i] >> _SHIFT
        if place < edge:
            total += np.float64(magnitude[i]) ** 2
        elif place == edge:
            border[at] = magnitude[i]
            at += 1
    border.sort()
    for i in range(keep - below):
        total += np.float64(border[i]) ** 2
    return np.sqrt(total / keep)


@njit(parallel=True, cache=True)
def gain_and_limit(images, keep, clip, gain, limit):  # type: ignore[no-untyped-def]
    """Scan gain r_k and clipping limit μ + ``clip``·σ of every channel of ``images`` (channel, pixel)."""
    for c in prange(images.shape[0]):
        magnitude = np.empty(images.shape[1], np.float32)
        total = 0.0
        for i in range(magnitude.size):
            magnitude[i] = abs(images[c, i])
            total += magnitude[i]
        mean = total / magnitude.size
        spread = 0.0
        for value in magnitude:
            spread += (value - mean) ** 2
        gain[c] = _rms_of_lowest(magnitude, keep)
        limit[c] = mean + clip * np.sqrt(spread / magnitude.size)


@njit(parallel=True, cache=True)
def add_clipped(images, limit, own, shared, own_total, shared_total):  # type: ignore[no-untyped-def]
    """Add ``images`` (channel, pixel), clipped in magnitude, times ``own`` and times ``shared``, to two totals."""
    for c in prange(images.shape[0]):
        for i in range(images.shape[1]):
            value = np.complex128(images[c, i])
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
            out[c, i] = abs(images[c, i] * scale - signature[c, i])


@njit(parallel=True, cache=True)
def subtract_and_divide(images, gain, signature, background, out):  # type: ignore[no-untyped-def]
    """``(images/gain - signature)/background`` (channel, pixel); ``gain`` and ``background`` one per channel."""
    for c in prange(images.shape[0]):
        scale = np.float32(1 / gain[c])
        for i in range(images.shape[1]):
            out[c, i] = (images[c, i] * scale - signature[c, i]) / background[c, i]


@njit(parallel=True, cache=True)
def magnitude_over_background(images, gain, signature, background, out):  # type: ignore[no-untyped-def]
    """Modulus of :func:`subtract_and_divide`."""
    for c in prange(images.shape[0]):
        scale = np.float32(1 / gain[c])
        for i in range(images.shape[1]):
            out[c, i] = abs(images[c, i] * scale - signature[c, i]) / background[c, i]
