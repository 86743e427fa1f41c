"""The fast imaging sums in single precision: interpolated range profiles of all channels at once.

Delays are kept as 32-bit fractions of the unambiguous range, so that they wrap as the sampled band
does, and they are computed once per antenna, not per pair. Every result is computed by one task in
a fixed order, whatever the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import float32, uint32, uint64
from numpy.typing import NDArray

from flgpr.jit.compiled import njit
from flgpr.kernels.geometry import antenna_rows
from flgpr.kernels.lanes import combine_antennas, gather_pairs, spread_pairs
from flgpr.kernels.layout import BLOCK, GATHER_PAIRS, padded, row_size
from flgpr.types import Float32Array, FloatArray, IntArray

_FAST = {"fastmath": True, "error_model": "numpy", "cache": True}


class Geometry(NamedTuple):
    """Positions of pairs and pixels, and how paths become bins and phases.

    ``delay``, ``cosine`` and ``sine`` are results of :func:`locate`, or empty: then they are
    computed anew wherever they are needed.
    """

    tx: IntArray  #: (pair,) rows of the transmitters in ``antenna``
    rx: IntArray  #: (pair,) rows of the receivers in ``antenna``
    antenna: FloatArray  #: (antenna, 3) positions, m
    pixels: FloatArray  #: (3, pixel) positions, m, padded to full blocks
    pixel_count: int  #: pixels without the padding
    medium: FloatArray  #: refractive indices above and below z = 0 (zero: no ground)
    per_turn: float  #: tone spacing over the speed of light, 1/m
    carrier: float  #: carrier over the speed of light, 1/m
    origin: int  #: 32-bit delay at which bin 0 starts
    shift: int  #: number of a delay's bits below a bin
    gain: Float32Array  #: (antenna, pixel) amplitudes, or (antenna, 0) for none
    #: (power, tap), flat: the polynomials of :func:`flgpr.kernels.kaiser.polynomials`, padded
    weight: Float32Array
    #: (block, antenna, pixel), flat, and likewise the phasors
    delay: NDArray[np.uint32] = np.empty(0, np.uint32)
    cosine: Float32Array = np.empty(0, np.float32)
    sine: Float32Array = np.empty(0, np.float32)


def polynomial_degree(width: int) -> int:
    """Return the degree of the taps' polynomials that loses nothing in single precision."""
    return width + 3


@njit(**_FAST)
def _locate(geometry, a, block, at, delay, cosine, sine):  # type: ignore[no-untyped-def]
    """Fill the delays and phasors of antenna ``a`` for a block of pixels from ``at`` on."""
    medium = geometry.medium
    per_turn = geometry.per_turn
    carrier = geometry.carrier
    gain = geometry.gain[a]
    first = uint64(block * BLOCK)
    antenna_rows(
        geometry.pixels,
        first,
        geometry.antenna[a],
        medium,
        per_turn,
        carrier,
        gain,
        uint64(at),
        delay,
        cosine,
        sine,
    )


@njit(nogil=True, **_FAST)
def locate(geometry, begin, end):  # type: ignore[no-untyped-def]
    """Fill the geometry's delays and phasors for some blocks: (block, antenna, pixel), flat."""
    antennas = geometry.antenna.shape[0]
    for block in range(begin, end):
        for a in range(antennas):
            _locate(
                geometry,
                a,
                block,
                (block * antennas + a) * BLOCK,
                geometry.delay,
                geometry.cosine,
                geometry.sine,
            )


@njit(nogil=True, **_FAST)
def adjoint(table, bins, geometry, out, taps, powers, channels, begin, end):  # type: ignore[no-untyped-def]
    """Fill blocks of an image from range profiles.

    Parameters
    ----------
    table : (pair·bin·lane,) ndarray of float32
        Range profiles of :func:`flgpr.kernels.transform.compress`.
    bins : int
        Bins of a profile.
    geometry : Geometry
        Pairs and pixels.
    out : (channel, pixel) ndarray of complex64
        Image.
    taps, powers, channels : tuple
        As long as the window has bins, as its polynomials have coefficients, and as a table row
        has channels.
    begin, end : int
        Blocks of this call.
    """
    tx = geometry.tx
    rx = geometry.rx
    count = geometry.pixel_count
    origin = uint32(geometry.origin)
    shift = uint32(geometry.shift)
    weight = geometry.weight
    antennas = geometry.antenna.shape[0]
    pairs = tx.shape[0]
    half = len(channels)
    width = padded(len(taps))
    lanes = row_size(len(taps), half)
    fields_per_pair = (width + 2) * BLOCK
    stored = geometry.delay.shape[0] > 0
    delay = geometry.delay if stored else np.empty(antennas * BLOCK, np.uint32)
    cosine = geometry.cosine if stored else np.empty(antennas * BLOCK, np.float32)
    sine = geometry.sine if stored else np.empty(antennas * BLOCK, np.float32)
    start = np.empty(GATHER_PAIRS * BLOCK, np.uint32)
    fields = np.empty(GATHER_PAIRS * fields_per_pair, np.float32)
    total = np.empty(BLOCK * lanes, np.float32)
    complete = total.view(np.complex64)
    for block in range(begin, end):
        total[:] = 0
        block_start = block * antennas * BLOCK if stored else 0
        if not stored:
            for a in range(antennas):
                _locate(geometry, a, block, a * BLOCK, delay, cosine, sine)
        # A few pairs at a time: their weights stay in the nearest cache.
        for q in range(0, pairs, GATHER_PAIRS):
            group = min(GATHER_PAIRS, pairs - q)
            for g in range(group):
                i = uint64(block_start + tx[q + g] * BLOCK)
                j = uint64(block_start + rx[q + g] * BLOCK)
                base = uint32((q + g) * bins)
                pair = uint64(g)
                combine_antennas(
                    delay,
                    cosine,
                    sine,
                    i,
                    j,
                    base,
                    origin,
                    shift,
                    weight,
                    powers,
                    taps,
                    channels,
                    start,
                    fields,
                    pair,
                )
            for k in range(uint64(BLOCK)):
                gather_pairs(
                    total, k * uint64(lanes), table, start, fields, k, uint64(group), taps, channels
                )
        needed = min(BLOCK, count - block * BLOCK)
        if half == 1:
            for k in range(needed):
                re = float32(0)
                im = float32(0)
                for a in range(width):
                    re += total[k * lanes + a]
                    im += total[k * lanes + width + a]
                out[0, block * BLOCK + k] = complex(re, im)
        else:
            for c in range(out.shape[0]):
                for k in range(needed):
                    out[c, block * BLOCK + k] = complete[k * half + c]


@njit(cache=True)
def _antennas_of(tx, rx, q, group, used, local):  # type: ignore[no-untyped-def]
    """Return the number of antennas of ``group`` pairs from ``q``.

    They are listed in ``used``, with their numbers there in ``local``.
    """
    antennas = 0
    for g in range(2 * group):
        needed = tx[q + g // 2] if g % 2 == 0 else rx[q + g // 2]
        local[g] = antennas
        for a in range(antennas):
            if used[a] == needed:
                local[g] = a
        if local[g] == antennas:
            used[antennas] = needed
            antennas += 1
    return antennas


@njit(nogil=True, **_FAST)
def forward(table, bins, geometry, image, taps, powers, channels, q, end):  # type: ignore[no-untyped-def]
    """Fill the pairs ``q`` to ``end`` of ``table`` from ``image`` (channel, pixel).

    This is the transpose of :func:`adjoint`, whose other arguments it takes. A call owns the
    profiles of its pairs and goes through all pixels in order: the result of a pair does not depend
    on the other pairs.
    """
    tx = geometry.tx
    rx = geometry.rx
    count = geometry.pixel_count
    origin = uint32(geometry.origin)
    shift = uint32(geometry.shift)
    weight = geometry.weight
    half = len(channels)
    group = end - q
    fields_per_pair = (padded(len(taps)) + 2) * BLOCK
    lanes = row_size(len(taps), half)
    most = 2 * group
    table[q * bins * lanes : end * bins * lanes] = 0
    used = np.empty(most, np.int64)
    local = np.empty(most, np.int64)
    antennas = _antennas_of(tx, rx, q, group, used, local)
    stored = geometry.delay.shape[0] > 0
    delay = geometry.delay if stored else np.empty(most * BLOCK, np.uint32)
    cosine = geometry.cosine if stored else np.empty(most * BLOCK, np.float32)
    sine = geometry.sine if stored else np.empty(most * BLOCK, np.float32)
    if stored:
        for g in range(most):
            local[g] = used[local[g]]
    start = np.empty(group * BLOCK, np.uint32)
    fields = np.empty(group * fields_per_pair, np.float32)
    value = np.zeros(BLOCK * 2 * half, np.float32)
    for block in range((count + BLOCK - 1) // BLOCK):
        first = uint64(block * BLOCK)
        needed = uint64(min(BLOCK, count - block * BLOCK))
        block_start = block * geometry.antenna.shape[0] * BLOCK if stored else 0
        if not stored:
            for a in range(antennas):
                _locate(geometry, used[a], block, a * BLOCK, delay, cosine, sine)
        for g in range(group):
            i = uint64(block_start + local[2 * g] * BLOCK)
            j = uint64(block_start + local[2 * g + 1] * BLOCK)
            base = uint32((q + g) * bins)
            pair = uint64(g)
            combine_antennas(
                delay,
                cosine,
                sine,
                i,
                j,
                base,
                origin,
                shift,
                weight,
                powers,
                taps,
                channels,
                start,
                fields,
                pair,
            )
        for c in range(uint64(image.shape[0])):
            for k in range(needed):
                value[k * uint64(2 * half) + c] = image[c, first + k].real
                value[k * uint64(2 * half) + c + uint64(half)] = image[c, first + k].imag
        for k in range(needed):
            spread_pairs(
                value, k * uint64(2 * half), table, start, fields, k, uint64(group), taps, channels
            )
