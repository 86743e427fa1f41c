"""Range profiles of a whole array focused on points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import float32

from flgpr.jit.compiled import njit
from flgpr.jit.threads import shared
from flgpr.kernels.geometry import cos_sin


# Neither is compiled by fast mathematics: then the sums differed between a process that compiles
# and one that loads.
@njit(error_model="numpy", cache=True)
def _steer(signal: Any, wavenumber: Any, path: Any, real: Any, imaginary: Any) -> None:
    """Add to a beam (polarization, tone) the data of all pairs, their delays to a point undone."""
    tones = wavenumber.size
    cosine = np.empty(tones, np.float32)
    sine = np.empty(tones, np.float32)
    for q in range(path.size):
        for k in range(tones):
            turns = wavenumber[k] * path[q]
            cosine[k], sine[k] = cos_sin(float32(turns - np.floor(turns + 0.5)))
        for c in range(signal.shape[0]):
            for k in range(tones):
                value = signal[c, q, k]
                real[c, k] += value.real * cosine[k] - value.imag * sine[k]
                imaginary[c, k] += value.real * sine[k] + value.imag * cosine[k]


@shared(cache=True)
def focus(signal, wavenumber, path, kernel, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``out`` with the magnitudes of range profiles of the array focused on points.

    A point's sums depend on nothing but its own path.

    Parameters
    ----------
    signal : (polarization, pair, tone) ndarray of complex64
        Data of a scan.
    wavenumber : (tone,) ndarray
        Frequency over the speed of light, 1/m.
    path : (point, pair) ndarray
        Optical paths from transmitter over point to receiver, m.
    kernel : (2, tone, range) ndarray of float32
        Real and imaginary part of the transform from a beam's tones to its ranges.
    out : (point, polarization, range) ndarray of float32
        Magnitudes, per pair.
    begin, end : int
        Points of this call.
    """
    channels, pairs, tones = signal.shape
    ranges = kernel.shape[2]
    for n in range(begin, end):
        beam = np.zeros((2, channels, tones), np.float32)
        _steer(signal, wavenumber, path[n], beam[0], beam[1])
        total = np.zeros((2, channels, ranges), np.float32)
        for k in range(tones):
            for c in range(channels):
                re = beam[0, c, k]
                im = beam[1, c, k]
                for i in range(ranges):
                    total[0, c, i] += re * kernel[0, k, i] - im * kernel[1, k, i]
                    total[1, c, i] += re * kernel[1, k, i] + im * kernel[0, k, i]
        for c in range(channels):
            for i in range(ranges):
                out[n, c, i] = np.sqrt(total[0, c, i] ** 2 + total[1, c, i] ** 2) / pairs
