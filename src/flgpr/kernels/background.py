"""Pixel loops of background removal for all channels (Wang et al. 2007, Eq. 2, 3 and 5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.jit.threads import shared
from flgpr.kernels.filters import sorted_order

_SHIFT = 20  # float32 bits below the 12 that sort magnitudes into coarse bins


@njit(cache=True)
def _magnitude(value: Any) -> Any:
    """Return the magnitude of a complex64 value, computed in double precision.

    It cannot overflow, and is compiled to vector code as ``abs`` is not.
    """
    re = np.float64(value.real)
    im = np.float64(value.imag)
    return np.float32(np.sqrt(re * re + im * im))


@njit(cache=True)
def _near(limit: float) -> float:
    """Return the square below which a magnitude is surely below the limit.

    It saves the root, which takes long.
    """
    return limit * limit * (1 - 1e-9)


@njit(cache=True)
def _clipped(pixel: Any, limit: float, threshold: float) -> Any:
    """Return a pixel clipped to a magnitude ``limit`` if its power is above ``threshold``."""
    value = np.complex128(pixel)
    if value.real * value.real + value.imag * value.imag > threshold:
        magnitude = abs(value)
        if magnitude > limit:
            value *= limit / magnitude
    return value


@shared(cache=True)
def gain_and_limit(images, keep, clip, gain, limit, begin, end):  # type: ignore[no-untyped-def]
    """Fill the scan gain r_k and clipping limit μ + ``clip``·σ of ``images`` (channel, pixel).

    The gain is the root mean square of the ``keep`` smallest magnitudes. The bits of floats that
    are not negative have the order of their values.
    """
    for c in range(begin, end):
        magnitude = np.empty(images.shape[1], np.float32)
        for i in range(magnitude.size):
            magnitude[i] = _magnitude(images[c, i])
        bits = magnitude.view(np.uint32)
        count = np.zeros(1 << (32 - _SHIFT), np.int64)
        total = 0.0
        for i in range(magnitude.size):
            total += magnitude[i]
            count[bits[i] >> _SHIFT] += 1
        mean = total / magnitude.size
        edge = 0
        below = 0
        while below + count[edge] < keep:
            below += count[edge]
            edge += 1
        # One more than needed: every value is written before it is known to belong there.
        border = np.empty(count[edge] + 1, np.float32)
        spread = 0.0
        lowest = 0.0
        at = 0
        for i in range(magnitude.size):
            value = np.float64(magnitude[i])
            coarse = bits[i] >> _SHIFT
            spread += (value - mean) ** 2
            lowest += value * value if coarse < edge else 0.0
            border[at] = magnitude[i]
            at += coarse == edge
        order = sorted_order(border[:at])
        for i in range(keep - below):
            lowest += np.float64(border[order[i]]) ** 2
        gain[c] = np.sqrt(lowest / keep)
        limit[c] = mean + clip * np.sqrt(spread / magnitude.size)


@shared(cache=True)
def add_clipped(images, limit, own_scale, shared, own_total, shared_total, begin, end):  # type: ignore[no-untyped-def]
    """Add ``images`` (channel, pixel), clipped in magnitude, to two totals.

    They are weighted by ``own_scale`` and by ``shared``. The totals may hold the first pixels
    alone.
    """
    for c in range(begin, end):
        threshold = _near(limit[c])
        for i in range(own_total.shape[1]):
            value = _clipped(images[c, i], limit[c], threshold)
            own_total[c, i] += own_scale[c] * value
            shared_total[c, i] += shared[c] * value


@shared(cache=True)
def blend_clipped(images, limit, scale, weight, means, out, signature, begin, end):  # type: ignore[no-untyped-def]
    """Move ``means`` (channel, pixel) by ``weight`` towards ``images``, clipped and scaled.

    The means may hold the first pixels alone; they go to ``out``, which may be the same array, and
    with less precision to ``signature``.
    """
    for c in range(begin, end):
        threshold = _near(limit[c])
        for i in range(means.shape[1]):
            mean = means[c, i]
            mean += weight * (scale[c] * _clipped(images[c, i], limit[c], threshold) - mean)
            out[c, i] = mean
            signature[c, i] = mean


@shared(cache=True)
def residual(images, gain, signature, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` (channel, pixel) with the magnitude of ``images/gain - signature``."""
    for c in range(begin, end):
        scale = np.float32(1 / gain[c])
        for i in range(out.shape[1]):
            out[c, i] = _magnitude(images[c, i] * scale - signature[c, i])


@shared(cache=True)
def mean_of_nodes(sums, rows, columns, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` (channel, y, x) with the mean of a coarse lattice's nodes inside a window.

    ``sums`` (channel, row, column) are their sums from the first on, a zero before them; ``rows``
    (2, y) and ``columns`` (2, x) the first of them inside the window and the one after the last.
    """
    for c in range(begin, end):
        line = np.empty(sums.shape[2])
        for y in range(out.shape[1]):
            for k in range(line.size):
                line[k] = sums[c, rows[1, y], k] - sums[c, rows[0, y], k]
            height = rows[1, y] - rows[0, y]
            for x in range(out.shape[2]):
                first, last = columns[0, x], columns[1, x]
                out[c, y, x] = (line[last] - line[first]) / (height * (last - first))


@shared(cache=True)
def root_mean_square(level, ratio, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` with the root mean square over polarizations of ``level`` times ``ratio``.

    ``level`` is (polarization, subband, pixel).
    """
    for b in range(begin, end):
        for i in range(out.shape[1]):
            total = 0.0
            for p in range(level.shape[0]):
                total += (level[p, b, i] * ratio[p, b]) ** 2
            out[b, i] = np.sqrt(total / level.shape[0])


@shared(cache=True)
def subtract_and_divide(images, gain, signature, background, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` (channel, pixel) with ``(images/gain - signature)/background``.

    There is one ``gain`` per channel; fewer backgrounds are used for the channels in turn.
    """
    for c in range(begin, end):
        scale = np.float32(1 / gain[c])
        level = background[c % background.shape[0]]
        for i in range(out.shape[1]):
            value = images[c, i] * scale - signature[c, i]
            out[c, i] = complex(value.real / level[i], value.imag / level[i])


@shared(cache=True)
def magnitude_over_background(images, gain, signature, background, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` with the modulus of :func:`subtract_and_divide`."""
    for c in range(begin, end):
        scale = np.float32(1 / gain[c])
        for i in range(out.shape[1]):
            out[c, i] = _magnitude(images[c, i] * scale - signature[c, i]) / background[c, i]
