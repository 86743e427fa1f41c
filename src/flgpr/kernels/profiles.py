"""The fast imaging sums in single precision: profiles of every pair, interpolated for all channels at once.

Delays are kept as 32-bit fractions of the unambiguous range, so that they wrap as the sampled band does, and they are
computed once per antenna, not per pair. Every result is computed by one task in a fixed order, whatever the number of
threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float32, uint32, uint64
from numpy.typing import NDArray

from flgpr.kernels.compiled import njit
from flgpr.kernels.geometry import antenna_rows
from flgpr.kernels.lanes import gather_pairs, spread_pairs
from flgpr.kernels.layout import BLOCK, GATHER_PAIRS

_FAST = {"fastmath": True, "error_model": "numpy", "cache": True}


class Geometry(NamedTuple):
    """Where pairs and pixels are, and how paths become bins and phases.

    ``tx``, ``rx`` (pair,) index ``antenna`` (antenna, 3) m; ``pixels`` (3, pixel) m, padded to whole blocks, of which
    ``pixel_count`` are wanted; ``medium`` the refractive indices above and below z = 0 (zero: no ground); ``per_turn``
    and ``carrier`` the tone spacing and the carrier over the speed of light, 1/m; ``origin`` the 32-bit delay at which
    bin 0 starts and ``shift`` the number of its bits below a bin; ``gain`` (antenna, pixel), or (antenna, 0) for none;
    ``weight`` (tap, power) the polynomials of :func:`flgpr.kernels.kaiser.polynomials`.
    """

    tx: NDArray[np.int64]
    rx: NDArray[np.int64]
    antenna: NDArray[np.float64]
    pixels: NDArray[np.float64]
    pixel_count: int
    medium: NDArray[np.float64]
    per_turn: float
    carrier: float
    origin: int
    shift: int
    gain: NDArray[np.float32]
    weight: NDArray[np.float32]


def polynomial_degree(width: int) -> int:
    """Degree of the taps' polynomials that loses nothing in single precision."""
    return width + 3


@njit(**_FAST)
def _combine(i, j, g, delay, cosine, sine, base, origin, shift, lanes, start, fields, field):  # type: ignore[no-untyped-def]
    """Make the table rows, bin fractions and phasors of a pair from the rows ``i`` and ``j`` of its two antennas."""
    row, block = uint64(g * BLOCK), uint64(BLOCK)
    low = uint32(shift)
    mask = (uint32(1) << low) - uint32(1)
    scale, first = float32(1.0 / (1 << shift)), uint32(origin)
    for k in range(block):
        d = uint32(delay[i + k] + delay[j + k] - first)
        start[row + k] = (base + (d >> low)) * uint32(lanes)
        fields[field + uint64(2) * block + k] = float32(d & mask) * scale - float32(0.5)
        ci, si, cj, sj = cosine[i + k], sine[i + k], cosine[j + k], sine[j + k]
        fields[field + k] = ci * cj - si * sj
        fields[field + block + k] = si * cj + ci * sj


@njit(**_FAST)
def _weigh(fields, field, weight, taps):  # type: ignore[no-untyped-def]
    """Replace the bin fraction in row 2 of a pair's fields by the weights of all taps in rows 2 and on."""
    width = len(taps)
    even, odd = (width + 3) // 2 + 1, (width + 4) // 2
    block = uint64(BLOCK)
    for k in range(block):
        y = fields[field + uint64(2) * block + k]
        yy = y * y
        for a in range((width + 1) // 2):
            e = weight[a, 2 * even - 2]
            for n in range(1, even):
                e = e * yy + weight[a, 2 * (even - 1 - n)]
            o = weight[a, 2 * odd - 1]
            for n in range(1, odd):
                o = o * yy + weight[a, 2 * (odd - n) - 1]
            o *= y
            fields[field + uint64(2 + a) * block + k] = e + o
            fields[field + uint64(1 + width - a) * block + k] = e - o


@njit(nogil=True, **_FAST)
def adjoint(table, bins, geometry, out, taps, channels, begin, end):  # type: ignore[no-untyped-def]
    """Fill pixel blocks ``begin`` to ``end`` of ``out`` (channel, pixel) from ``table`` (pair, bin, lane)."""
    tx, rx, antenna, pixels, count = geometry.tx, geometry.rx, geometry.antenna, geometry.pixels, geometry.pixel_count
    medium, per_turn, carrier = geometry.medium, geometry.per_turn, geometry.carrier
    origin, shift, gain, weight = geometry.origin, geometry.shift, geometry.gain, geometry.weight
    antennas, pairs, half, fields_per_pair = antenna.shape[0], tx.shape[0], len(channels), (len(taps) + 2) * BLOCK
    lanes = 2 * half
    delay = np.empty(antennas * BLOCK, np.uint32)
    cosine, sine = np.empty(antennas * BLOCK, np.float32), np.empty(antennas * BLOCK, np.float32)
    start = np.empty(GATHER_PAIRS * BLOCK, np.uint32)
    fields = np.empty(GATHER_PAIRS * fields_per_pair, np.float32)
    total = np.empty(BLOCK * 2 * lanes, np.float32)
    for block in range(begin, end):
        first = uint64(block * BLOCK)
        total[:] = 0
        for a in range(antennas):
            at = uint64(a * BLOCK)
            antenna_rows(pixels, first, antenna[a], medium, per_turn, carrier, gain[a], at, delay, cosine, sine)
        for q in range(0, pairs, GATHER_PAIRS):
            held = min(GATHER_PAIRS, pairs - q)
            for g in range(held):
                i, j, field = uint64(tx[q + g] * BLOCK), uint64(rx[q + g] * BLOCK), uint64(g * fields_per_pair)
                base = uint32((q + g) * bins)
                _combine(i, j, g, delay, cosine, sine, base, origin, shift, lanes, start, fields, field)
                _weigh(fields, field, weight, taps)
            for k in range(uint64(BLOCK)):
                gather_pairs(total, k * uint64(2 * lanes), table, start, fields, k, uint64(held), taps, channels)
        for c in range(out.shape[0]):
            for k in range(min(BLOCK, count - block * BLOCK)):
                t = k * 2 * lanes + c
                re = total[t] - total[t + lanes + half]
                out[c, block * BLOCK + k] = complex(re, total[t + half] + total[t + lanes])


@njit(cache=True)
def _antennas_of(tx, rx, q, held, used, local):  # type: ignore[no-untyped-def]
    """List in ``used`` the antennas of ``held`` pairs from ``q`` and in ``local`` each one's place; return how many."""
    antennas = 0
    for g in range(2 * held):
        wanted = tx[q + g // 2] if g % 2 == 0 else rx[q + g // 2]
        local[g] = antennas
        for a in range(antennas):
            if used[a] == wanted:
                local[g] = a
        if local[g] == antennas:
            used[antennas] = wanted
            antennas += 1
    return antennas


@njit(nogil=True, **_FAST)
def forward(table, bins, geometry, image, taps, channels, q, end):  # type: ignore[no-untyped-def]
    """Fill the pairs from ``q`` up to ``end`` of ``table`` from ``image`` (channel, pixel): transpose of the adjoint.

    A call owns the profiles of its pairs and goes through all pixels in order: what it finds for a pair does not depend
    on the others.
    """
    tx, rx, antenna, pixels, count = geometry.tx, geometry.rx, geometry.antenna, geometry.pixels, geometry.pixel_count
    medium, per_turn, carrier = geometry.medium, geometry.per_turn, geometry.carrier
    origin, shift, gain, weight = geometry.origin, geometry.shift, geometry.gain, geometry.weight
    half, fields_per_pair, held = len(channels), (len(taps) + 2) * BLOCK, end - q
    lanes, most = 2 * half, 2 * held
    table[q * bins * lanes : (q + held) * bins * lanes] = 0
    used, local = np.empty(most, np.int64), np.empty(most, np.int64)
    antennas = _antennas_of(tx, rx, q, held, used, local)
    delay = np.empty(most * BLOCK, np.uint32)
    cosine, sine = np.empty(most * BLOCK, np.float32), np.empty(most * BLOCK, np.float32)
    start = np.empty(held * BLOCK, np.uint32)
    fields = np.empty(held * fields_per_pair, np.float32)
    value = np.zeros(BLOCK * lanes, np.float32)
    for block in range((count + BLOCK - 1) // BLOCK):
        first = uint64(block * BLOCK)
        wanted = uint64(min(BLOCK, count - block * BLOCK))
        for a in range(antennas):
            n, at = used[a], uint64(a * BLOCK)
            antenna_rows(pixels, first, antenna[n], medium, per_turn, carrier, gain[n], at, delay, cosine, sine)
        for g in range(held):
            i, j, field = (uint64(local[2 * g] * BLOCK), uint64(local[2 * g + 1] * BLOCK), uint64(g * fields_per_pair))
            base = uint32((q + g) * bins)
            _combine(i, j, g, delay, cosine, sine, base, origin, shift, lanes, start, fields, field)
            _weigh(fields, field, weight, taps)
        for c in range(uint64(image.shape[0])):
            for k in range(wanted):
                value[k * uint64(lanes) + c] = image[c, first + k].real
                value[k * uint64(lanes) + c + uint64(half)] = image[c, first + k].imag
        for k in range(wanted):
            spread_pairs(value, k * uint64(lanes), table, start, fields, k, uint64(held), taps, channels)
