"""Compiled pixel loops of the background, to make it faster (Wang et al. 2007, Eq. 2, 3 and 5).

What is estimated in which order, and why, is in :mod:`flgpr.clutter.estimator`, which calls these
loops; the equations are in :mod:`flgpr.clutter.background`.
"""

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
    """Fill the scan gain r_k and the clipping limit μ + ``clip``·σ of every channel.

    Parameters
    ----------
    images : (channel, pixel) ndarray of complex64
        Scan image.
    keep : int
        Number of smallest magnitudes, whose root mean square is the gain.
    clip : float
        Standard deviations above the mean at which magnitudes are clipped.
    gain, limit : (channel,) ndarray
        Filled.
    begin, end : int
        Channels of this call.
    """
    for c in range(begin, end):
        magnitude = np.empty(images.shape[1], np.float32)
        for i in range(magnitude.size):
            magnitude[i] = _magnitude(images[c, i])
        # The smallest magnitudes without a sort: counted in coarse bins of their bits, which have
        # the order of the values, as none is negative.
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
    """Add images, clipped in magnitude, to two totals (Wang et al. 2007, Eq. 2).

    Parameters
    ----------
    images : (channel, pixel) ndarray of complex64
        Scan image.
    limit : (channel,) ndarray
        Magnitude at which pixels are clipped.
    own_scale, shared : (channel,) ndarray
        Weights of the image in the two totals, the inverse gains.
    own_total, shared_total : (channel, pixel) ndarray of complex128
        Totals; they may hold the first pixels alone.
    begin, end : int
        Channels of this call.
    """
    for c in range(begin, end):
        threshold = _near(limit[c])
        for i in range(own_total.shape[1]):
            value = _clipped(images[c, i], limit[c], threshold)
            own_total[c, i] += own_scale[c] * value
            shared_total[c, i] += shared[c] * value


@shared(cache=True)
def blend_clipped(images, limit, scale, weight, means, out, signature, begin, end):  # type: ignore[no-untyped-def]
    """Move running means towards images, clipped in magnitude and scaled.

    It is Eq. 2 of Wang et al. 2007 for live detection, see ``clutter/causal.py``.

    Parameters
    ----------
    images : (channel, pixel) ndarray of complex64
        Scan image.
    limit, scale : (channel,) ndarray
        Magnitude at which pixels are clipped, and inverse gain.
    weight : float
        Share of the image in the new means.
    means : (channel, pixel) ndarray of complex128
        Means so far; they may hold the first pixels alone.
    out : (channel, pixel) ndarray of complex128
        New means; it may be the same array.
    signature : (channel, pixel) ndarray of complex64
        New means in single precision.
    begin, end : int
        Channels of this call.
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

    Parameters
    ----------
    sums : (channel, row + 1, column + 1) ndarray
        Sums of the nodes from the first on, zero before them.
    rows, columns : (2, y), (2, x) ndarray of int
        First row and column of nodes inside the window, and the ones after the last.
    out : (channel, y, x) ndarray of float32
        Means.
    begin, end : int
        Channels of this call.
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

    Parameters
    ----------
    level : (polarization, subband, pixel) ndarray of float32
        Gain background of every channel.
    ratio : (polarization, subband) ndarray
        Factor of every channel.
    out : (subband, pixel) ndarray of float32
        Root mean squares.
    begin, end : int
        Sub-bands of this call.
    """
    for b in range(begin, end):
        for i in range(out.shape[1]):
            total = 0.0
            for p in range(level.shape[0]):
                total += (level[p, b, i] * ratio[p, b]) ** 2
            out[b, i] = np.sqrt(total / level.shape[0])


@shared(cache=True)
def subtract_and_divide(images, gain, signature, background, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` with ``(images/gain - signature)/background`` (Wang et al. 2007, Eq. 5).

    Parameters
    ----------
    images : (channel, pixel) ndarray of complex64
        Scan image.
    gain : (channel,) ndarray
        Gain of every channel.
    signature : (channel, pixel) ndarray of complex64
        Self-signature, in units of the gain.
    background : (channel, pixel) ndarray of float32
        Gain background; fewer of them are used for the channels in turn.
    out : (channel, pixel) ndarray of complex64
        Cleaned image; it may hold the first pixels alone.
    begin, end : int
        Channels of this call.
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
