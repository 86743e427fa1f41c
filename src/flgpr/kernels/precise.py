"""The interpolation of profiles in double precision: the same sums as in ``profiles``, written plainly."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray


class PreciseGeometry(NamedTuple):
    """Paths and how they become bins and phases.

    ``path`` (antenna, pixel) m; ``tx``, ``rx`` (pair,) its rows; ``gain`` (antenna, pixel), or (antenna, 0) for none;
    ``per_turn`` and ``carrier`` the tone spacing and the carrier over the speed of light, 1/m; ``size`` bins make the
    ambiguous range, of which bin 0 of a table starts at ``start``; ``weight`` (tap, power) the taps' polynomials.
    """

    path: NDArray[np.float64]
    tx: NDArray[np.int64]
    rx: NDArray[np.int64]
    gain: NDArray[np.float64]
    per_turn: float
    carrier: float
    size: int
    start: float
    weight: NDArray[np.float64]


@njit(cache=True)
def _locate(geometry, q, p, taps):  # type: ignore[no-untyped-def]
    """Fill ``taps`` with the weights at pixel ``p`` of pair ``q``; return the first bin and the carrier's phasor."""
    i, j = geometry.tx[q], geometry.rx[q]
    length = geometry.path[i, p] + geometry.path[j, p]
    turns = length * geometry.per_turn
    place = (turns - math.floor(turns)) * geometry.size - geometry.start
    place -= geometry.size * math.floor(place / geometry.size)
    bin_ = int(place)
    y = place - bin_ - 0.5
    for a in range(taps.size):
        value = 0.0
        for n in range(geometry.weight.shape[1] - 1, -1, -1):
            value = value * y + geometry.weight[a, n]
        taps[a] = value
    phase = length * geometry.carrier
    angle = 2 * math.pi * (phase - math.floor(phase))
    size = geometry.gain[i, p] * geometry.gain[j, p] if geometry.gain.shape[1] > 0 else 1.0
    return bin_, size * complex(math.cos(angle), math.sin(angle))


@njit(parallel=True, cache=True)
def adjoint_precise(table, geometry, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` (channel, pixel) from the profiles ``table`` (pair, bin, channel)."""
    for p in prange(out.shape[1]):
        taps = np.empty(geometry.weight.shape[0])
        total = np.zeros(out.shape[0], np.complex128)
        for q in range(table.shape[0]):
            bin_, phasor = _locate(geometry, q, p, taps)
            for a in range(taps.size):
                for c in range(total.size):
                    total[c] += taps[a] * phasor * table[q, bin_ + a, c]
        for c in range(total.size):
            out[c, p] = total[c]


@njit(parallel=True, cache=True)
def forward_precise(table, geometry, image):  # type: ignore[no-untyped-def]
    """Fill ``table`` from ``image`` (channel, pixel): the transpose of :func:`adjoint_precise`."""
    for q in prange(table.shape[0]):
        taps = np.empty(geometry.weight.shape[0])
        table[q] = 0
        for p in range(image.shape[1]):
            bin_, phasor = _locate(geometry, q, p, taps)
            for a in range(taps.size):
                for c in range(image.shape[0]):
                    table[q, bin_ + a, c] += taps[a] * phasor.conjugate() * image[c, p]
