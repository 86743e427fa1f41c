"""The imaging sums written out term by term, in double precision, for any tones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

_TWO_PI = 2.0 * math.pi


@njit(cache=True)
def _amplitude(gain: Any, a: int, b: int, p: int) -> float:
    return gain[a, p] * gain[b, p] if gain.shape[1] > 0 else 1.0


@njit(parallel=True, cache=True)
def adjoint_direct(data, weight, wavenumber, path, tx, rx, offset, gain, out):  # type: ignore[no-untyped-def]
    """Sum ``weight·gain·data·exp(+j2π·wavenumber·L)`` over pairs and tones.

    ``data`` (channel, pair, tone), ``weight`` (subband, tone), ``wavenumber`` f/c (tone,) 1/m, ``path``
    (antenna, pixel) m, ``tx``/``rx`` (pair,) its rows, ``offset`` (pair,) m, ``gain`` (antenna, pixel) or (antenna, 0),
    ``out`` (channel, subband, pixel).
    """
    channels, pairs, tones = data.shape
    bands = weight.shape[0]
    for p in prange(out.shape[2]):
        total = np.zeros((channels, bands), np.complex128)
        for q in range(pairs):
            length = path[tx[q], p] + path[rx[q], p] - offset[q]
            size = _amplitude(gain, tx[q], rx[q], p)
            for k in range(tones):
                turns = wavenumber[k] * length
                angle = _TWO_PI * (turns - math.floor(turns))
                carrier = size * complex(math.cos(angle), math.sin(angle))
                for c in range(channels):
                    term = data[c, q, k] * carrier
                    for s in range(bands):
                        total[c, s] += weight[s, k] * term
        for c in range(channels):
            for s in range(bands):
                out[c, s, p] = total[c, s]


@njit(parallel=True, cache=True)
def forward_direct(image, weight, wavenumber, path, tx, rx, offset, gain, out):  # type: ignore[no-untyped-def]
    """Sum ``weight·gain·image·exp(-j2π·wavenumber·L)`` over pixels and sub-bands: the transpose of the adjoint.

    ``image`` (channel, subband, pixel), ``out`` (channel, pair, tone); the rest as in :func:`adjoint_direct`.
    """
    channels, bands, count = image.shape
    tones = wavenumber.shape[0]
    for q in prange(tx.shape[0]):
        total = np.zeros((channels, tones), np.complex128)
        for p in range(count):
            length = path[tx[q], p] + path[rx[q], p] - offset[q]
            size = _amplitude(gain, tx[q], rx[q], p)
            for k in range(tones):
                turns = wavenumber[k] * length
                angle = -_TWO_PI * (turns - math.floor(turns))
                carrier = size * complex(math.cos(angle), math.sin(angle))
                for c in range(channels):
                    value = 0.0j
                    for s in range(bands):
                        value += weight[s, k] * image[c, s, p]
                    total[c, k] += value * carrier
        for c in range(channels):
            for k in range(tones):
                out[c, q, k] = total[c, k]
