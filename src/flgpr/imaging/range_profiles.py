"""Range profiles of sweeps as direct sums over tones, which need not be even."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flgpr.types import Float32Array, FloatArray, floats

ComplexArray = NDArray[np.complexfloating]
LEAST_LEVEL = -999.0
"""Level of a zero, dB."""
_SUMS_AT_ONCE = 2**22  # tones x delays of one product, 32 MiB of phases


@dataclass(frozen=True)
class DelayBins:
    """Even bins of two-way delay."""

    start: float  #: s
    stop: float  #: s
    count: int
    sums_per_bin: int = 1  #: delays that are summed for every bin

    def delays(self) -> FloatArray:
        """Return the delays (count · sums_per_bin,) of all sums, evenly spaced, s."""
        total = self.count * self.sums_per_bin
        return floats(self.start + (self.stop - self.start) * (np.arange(total) + 0.5) / total)


def range_profiles(
    signal: ComplexArray, frequency: FloatArray, bins: DelayBins, amplitude: bool
) -> Float32Array:
    """Return range profiles of sweeps, summed under a Hann window.

    Every tone counts by its share of the band, so that uneven tones are weighed rightly. The sum is
    ``Σ w(f)·s(f)·exp(+j2πft)``.

    Parameters
    ----------
    signal : (scan, frequency) ndarray of complex
        Sweeps of a channel.
    frequency : (frequency,) ndarray of float
        Tones, Hz.
    bins : DelayBins
        Two-way delays, s.
    amplitude : bool
        Whether a bin holds its largest amplitude, or the real part of a single sum.

    Returns
    -------
    (scan, bin) ndarray of float32
        In units of the signal.
    """
    window = np.hanning(frequency.size + 2)[1:-1]
    weight = window * np.gradient(frequency)
    weighted = (signal * (weight / weight.sum())).astype(np.complex64)
    delays = bins.delays()
    fold = bins.sums_per_bin
    scans = len(signal)
    profiles = np.empty((scans, bins.count), np.float32)
    block = max(_SUMS_AT_ONCE // (frequency.size * fold), 1)
    for first in range(0, bins.count, block):
        stop = first + block
        # Whole turns are dropped in double precision: single precision is enough for the rest.
        turns = np.outer(frequency, delays[first * fold : stop * fold]) % 1.0
        sums = weighted @ np.exp(2j * np.pi * turns).astype(np.complex64)
        if amplitude:
            profiles[:, first:stop] = np.abs(sums).reshape(scans, -1, fold).max(axis=2)
        else:
            profiles[:, first:stop] = sums.real
    return profiles


def levels(values: NDArray[np.inexact]) -> NDArray[np.floating]:
    """Return levels of amplitudes, dB, not below ``LEAST_LEVEL``; NaN stays."""
    with np.errstate(divide="ignore"):
        return np.maximum(20 * np.log10(np.abs(values)), LEAST_LEVEL)
