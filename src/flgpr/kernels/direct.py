"""The imaging sums written out term by term, in double precision, for any tones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

_TWO_PI = 2.0 * math.pi


@njit(cache=True, inline="always")
def _distance(a: Any, b: Any) -> Any:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(parallel=True, cache=True)
def adjoint_direct(
    data: NDArray[np.complex64],
    weight: NDArray[np.float64],
    wavenumber: NDArray[np.float64],
    tx: NDArray[np.float64],
    rx: NDArray[np.float64],
    offset: NDArray[np.float64],
    index: float,
    pixels: NDArray[np.float64],
    out: NDArray[np.complex64],
) -> None:
    """Sum ``weight·data·exp(+j2π·wavenumber·L)`` over pairs and tones.

    ``data`` (channel, pair, tone), ``weight`` (subband, tone), ``wavenumber`` f/c (tone,) 1/m,
    ``tx``/``rx`` (pair, 3) m, ``offset`` (pair,) m, ``index`` refractive index of the medium, ``pixels`` (pixel, 3) m,
    ``out`` (channel, subband, pixel).
    """
    channels, pairs, tones = data.shape
    bands = weight.shape[0]
    for p in prange(pixels.shape[0]):
        total = np.zeros((channels, bands), np.complex128)
        for q in range(pairs):
            path = index * (_distance(tx[q], pixels[p]) + _distance(rx[q], pixels[p])) - offset[q]
            for k in range(tones):
                turns = wavenumber[k] * path
                angle = _TWO_PI * (turns - math.floor(turns))
                carrier = complex(math.cos(angle), math.sin(angle))
                for c in range(channels):
                    term = data[c, q, k] * carrier
                    for s in range(bands):
                        total[c, s] += weight[s, k] * term
        for c in range(channels):
            for s in range(bands):
                out[c, s, p] = total[c, s]


@njit(parallel=True, cache=True)
def forward_direct(
    image: NDArray[np.complex64],
    weight: NDArray[np.float64],
    wavenumber: NDArray[np.float64],
    tx: NDArray[np.float64],
    rx: NDArray[np.float64],
    offset: NDArray[np.float64],
    index: float,
    pixels: NDArray[np.float64],
    out: NDArray[np.complex64],
) -> None:
    """Sum ``weight·image·exp(-j2π·wavenumber·L)`` over pixels and sub-bands: the transpose of :func:`adjoint_direct`.

    ``image`` (channel, subband, pixel), ``out`` (channel, pair, tone); the rest as in :func:`adjoint_direct`.
    """
    channels, bands, count = image.shape
    tones = wavenumber.shape[0]
    for q in prange(tx.shape[0]):
        total = np.zeros((channels, tones), np.complex128)
        for p in range(count):
            path = index * (_distance(tx[q], pixels[p]) + _distance(rx[q], pixels[p])) - offset[q]
            for k in range(tones):
                turns = wavenumber[k] * path
                angle = -_TWO_PI * (turns - math.floor(turns))
                carrier = complex(math.cos(angle), math.sin(angle))
                for c in range(channels):
                    value = 0.0j
                    for s in range(bands):
                        value += weight[s, k] * image[c, s, p]
                    total[c, k] += value * carrier
        for c in range(channels):
            for k in range(tones):
                out[c, q, k] = total[c, k]
