"""Impulse data to tones."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def impulse_to_frequency(
    samples: ArrayLike, delay: ArrayLike, band: tuple[float, float], pad: int = 1
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Take time-domain (impulse) data to tones: the spectrum complex128 (..., frequency), and the frequencies, Hz.

    A scatterer at the delay t gives ``exp(-j2πft)`` times the pulse's spectrum, since the axis keeps its start. Outside
    the recorded time of ``1/Δf`` delays repeat; padding with zeros makes that time longer and the tones denser.

    Parameters
    ----------
    samples : (..., delay) array_like
        Recorded field, real, or its analytic signal.
    delay : (delay,) array_like
        Two-way delay of each sample, s, uniform.
    band : tuple of float
        First and last frequency to keep, Hz; below the Nyquist frequency.
    pad : int
        The record is made this many times as long by zeros.
    """
    values, axis = np.asarray(samples), np.asarray(delay, dtype=np.float64)
    if axis.ndim != 1 or axis.size < 2 or values.shape[-1] != axis.size:
        raise ValueError(f"delay must have one value per sample, got {axis.shape} for samples {values.shape}")
    step = float(np.diff(axis).mean())
    if not np.isfinite(axis).all() or step <= 0 or np.abs(np.diff(axis) - step).max() > 0.01 * step:
        raise ValueError("delay must increase in equal steps (within 1 %), got an uneven or falling axis")
    nyquist = 0.5 / step
    if not (0 < band[0] < band[1] <= nyquist):
        raise ValueError(f"band must lie between 0 and the Nyquist frequency {nyquist:g} Hz, got {band}")
    if pad < 1:
        raise ValueError(f"pad must be at least 1, got {pad}")
    count = axis.size * int(pad)
    frequency: NDArray[np.float64] = np.arange((count + 1) // 2) / (count * step)
    keep = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))
    if not keep.size:
        raise ValueError(f"band must hold a tone; tones are {frequency[1]:g} Hz apart, got {band}")
    signal = np.fft.fft(values, count, axis=-1)[..., keep]
    return signal * np.exp(-2j * np.pi * frequency[keep] * axis[0]), frequency[keep]
