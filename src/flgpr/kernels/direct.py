"""The imaging sums term by term, in double precision, for any tones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.jit.threads import shared

_TWO_PI = 2.0 * math.pi


@njit(cache=True)
def _amplitude(gain: Any, a: int, b: int, p: int) -> float:
    """Return the two-way amplitude of antennas ``a``, ``b`` at pixel ``p``; one without gains."""
    return gain[a, p] * gain[b, p] if gain.shape[1] > 0 else 1.0


@shared(axis=2, cache=True)
def adjoint_direct(data, weight, wavenumber, path, tx, rx, offset, gain, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` with ``Σ weight·gain·data·exp(+j2π·wavenumber·L)`` over pairs and tones.

    Parameters
    ----------
    data : (channel, pair, tone) ndarray of complex
        Data of a scan.
    weight : (subband, tone) ndarray
        Weights of the tones.
    wavenumber : (tone,) ndarray
        Frequency over the speed of light, 1/m.
    path : (antenna, pixel) ndarray
        One-way optical paths, m.
    tx, rx : (pair,) ndarray of int
        Rows of ``path`` and ``gain`` of every pair's antennas.
    offset : (pair,) ndarray
        Length that is subtracted from a pair's path, m.
    gain : (antenna, pixel) or (antenna, 0) ndarray
        One-way amplitudes; none are one everywhere.
    out : (channel, subband, pixel) ndarray of complex
        Image.
    begin, end : int
        Pixels of this call.
    """
    channels, pairs, tones = data.shape
    bands = weight.shape[0]
    for p in range(begin, end):
        total = np.zeros((channels, bands), np.complex128)
        for q in range(pairs):
            length = path[tx[q], p] + path[rx[q], p] - offset[q]
            size = _amplitude(gain, tx[q], rx[q], p)
            for k in range(tones):
                # Whole turns are taken off first: the argument of cosine and sine stays small.
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


@shared(axis=1, cache=True)
def forward_direct(image, weight, wavenumber, path, tx, rx, offset, gain, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` (channel, pair, tone) from ``image`` (channel, subband, pixel).

    This is the transpose of :func:`adjoint_direct`, whose other arguments it takes; ``begin`` and
    ``end`` are pairs.
    """
    channels, bands, count = image.shape
    tones = wavenumber.shape[0]
    for q in range(begin, end):
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
