"""The imaging sums from range profiles in double precision.

The same as ``kernels/profiles.py`` for tolerances that single precision does not reach.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.jit.threads import shared
from flgpr.types import FloatArray, IntArray


class PreciseGeometry(NamedTuple):
    """Paths, and how they become bins and phases."""

    path: FloatArray  #: (antenna, pixel) one-way optical paths, m
    tx: IntArray  #: (pair,) rows of the transmitters
    rx: IntArray  #: (pair,) rows of the receivers
    gain: FloatArray  #: (antenna, pixel) one-way amplitudes, or (antenna, 0) for none
    per_turn: float  #: tone spacing over the speed of light, 1/m
    carrier: float  #: carrier over the speed of light, 1/m
    size: int  #: bins of the ambiguous range
    start: float  #: bin of the ambiguous range where bin 0 of a table starts
    weight: FloatArray  #: (tap, power) the taps' polynomials, lowest power first


@njit(cache=True)
def _locate(geometry, q, p, taps):  # type: ignore[no-untyped-def]
    """Fill ``taps`` with the weights of pair ``q`` at pixel ``p``; return first bin and phasor."""
    i = geometry.tx[q]
    j = geometry.rx[q]
    length = geometry.path[i, p] + geometry.path[j, p]

    # Position in the ambiguous range, which wraps, and in the table, which starts elsewhere.
    turns = length * geometry.per_turn
    position = (turns - math.floor(turns)) * geometry.size - geometry.start
    position -= geometry.size * math.floor(position / geometry.size)
    bin_ = int(position)

    # Polynomials in the fraction of a bin less one half, by Horner's rule.
    y = position - bin_ - 0.5
    for a in range(taps.size):
        value = 0.0
        for n in range(geometry.weight.shape[1] - 1, -1, -1):
            value = value * y + geometry.weight[a, n]
        taps[a] = value

    phase = length * geometry.carrier
    angle = 2 * math.pi * (phase - math.floor(phase))
    size = geometry.gain[i, p] * geometry.gain[j, p] if geometry.gain.shape[1] > 0 else 1.0
    return bin_, size * complex(math.cos(angle), math.sin(angle))


@shared(axis=1, cache=True)
def adjoint_precise(table, geometry, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` (channel, pixel) from the profiles ``table`` (pair, bin, channel).

    ``geometry`` is a :class:`PreciseGeometry`; ``begin`` and ``end`` are pixels.
    """
    for p in range(begin, end):
        taps = np.empty(geometry.weight.shape[0])
        total = np.zeros(out.shape[0], np.complex128)
        for q in range(table.shape[0]):
            bin_, phasor = _locate(geometry, q, p, taps)
            for a in range(taps.size):
                for c in range(total.size):
                    total[c] += taps[a] * phasor * table[q, bin_ + a, c]
        for c in range(total.size):
            out[c, p] = total[c]


@shared(cache=True)
def forward_precise(image, geometry, table, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``table`` (pair, bin, channel) from ``image`` (channel, pixel).

    This is the transpose of :func:`adjoint_precise`; ``begin`` and ``end`` are pairs.
    """
    for q in range(begin, end):
        taps = np.empty(geometry.weight.shape[0])
        table[q] = 0
        for p in range(image.shape[1]):
            bin_, phasor = _locate(geometry, q, p, taps)
            for a in range(taps.size):
                for c in range(image.shape[0]):
                    table[q, bin_ + a, c] += taps[a] * phasor.conjugate() * image[c, p]
