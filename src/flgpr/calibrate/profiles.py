"""Coherent sums over an aperture for all range biases at once, from one range profile per sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.kernels.biases import sum_over_biases
from flgpr.model import SPEED_OF_LIGHT, antennas_in_lane, complete_scans, way_weights
from flgpr.model.arrays import FloatArray
from flgpr.model.phase import path_phase

_TABLE = 1 << 23  # samples of the profiles held at a time, 64 MiB


def resolution(frequency: ArrayLike) -> float:
    """Range resolution c/2B of a band of tones, one way, m."""
    return SPEED_OF_LIGHT / max(float(np.ptp(np.asarray(frequency))), 1.0) / 2


def fields_over_bias(
    run: xr.Dataset, poses: Sequence[ArrayLike], points: ArrayLike, biases: tuple[float, float]
) -> tuple[NDArray[np.complex64], FloatArray]:
    """Sum a run coherently at points, for poses that may be right and range biases that may be.

    Tones have a Hann window, scans the weights of :func:`flgpr.model.way_weights`. The sum is
    ``Σ w·s(f)·exp(+j2πf(L + 2·bias)/c)`` but for a phase that is the same for all of a bias.

    Parameters
    ----------
    run : xarray.Dataset
        A run with a complete scan.
    poses : (trial,) sequence of (scan, 6) array_like
        Poses of all its scans, one set for each trial.
    points : (point, 3) array_like
        Places in the lane frame, m.
    biases : tuple of float
        Least and greatest bias, m.

    Returns
    -------
    field : (trial, polarization, point, bias) ndarray of complex64
    bias : (bias,) ndarray
        Evenly spaced, at a quarter of the range resolution or less, m.
    """
    tones = run["frequency"].values
    spacing, slot = lattice(tones)
    middle = float(tones[0]) + spacing * (int(slot[-1]) // 2)
    size = 1 << int(4 * slot[-1] + 3).bit_length()
    step = SPEED_OF_LIGHT / spacing / size
    first = int(np.floor(2 * biases[0] / step))
    last = int(np.ceil(2 * biases[1] / step))
    places = np.asarray(points, dtype=np.float64)
    signal = run["signal"].values
    scans = np.flatnonzero(complete_scans(run))
    if not scans.size:
        raise ValueError(
            f"run must have a scan without missing sweeps, got none among {run.sizes['scan']}"
        )
    ways = [np.asarray(pose, dtype=np.float64)[scans] for pose in poses]
    weights = [way_weights(pose[:, :3]) for pose in ways]
    field = np.zeros((len(ways), len(places), signal.shape[1], last - first + 1), np.complex64)
    block = max(1, _TABLE // (size * signal.shape[1] * signal.shape[2]))
    for begin in range(0, scans.size, block):
        part = slice(begin, begin + block)
        table = _profiles(signal[scans[part]], tones, spacing, slot, size)
        table = np.concatenate(
            [table, np.take(table, np.arange(last - first + 2), axis=-1, mode="wrap")], axis=-1
        )
        for way, weight, out in zip(ways, weights, field, strict=True):
            ends = antennas_in_lane(run, way[part])
            share = np.repeat(weight[part], signal.shape[2])
            sum_over_biases(table, *ends, share, places, step, middle / SPEED_OF_LIGHT, first, out)
    return field.swapaxes(1, 2), np.asarray(
        np.arange(first, last + 1) * (0.5 * step), dtype=np.float64
    )


def lattice(frequency: ArrayLike) -> tuple[float, NDArray[np.int64]]:
    """Spacing (Hz) of the even spectrum that tones lie on, gaps included, and their slots in it.

    Tones that lie on none are given one at their mean spacing, in which they are but near their slots. Fewer than two
    tones are a ValueError.
    """
    tones = np.asarray(frequency, dtype=np.float64)
    if tones.size < 2:
        raise ValueError(f"run must have two tones or more to tell ranges, got {tones.size}")
    for spacing in (float(np.diff(tones).min()), float(np.ptp(tones)) / (tones.size - 1)):
        slot = np.rint((tones - tones[0]) / spacing).astype(np.int64)
        if slot[-1] < 64 * tones.size:
            break
    return float(np.ptp(tones)) / int(slot[-1]), slot


def _profiles(
    signal: NDArray[Any], tones: FloatArray, spacing: float, slot: NDArray[np.int64], size: int
) -> NDArray[np.complex64]:
    """Make range profiles (polarization, scan·pair, size) of a signal (scan, polarization, pair, frequency)."""
    taper = np.hanning(tones.size + 2)[1:-1]
    data = (
        (signal * taper.astype(np.float32)).swapaxes(0, 1).reshape(signal.shape[1], -1, tones.size)
    )
    centre = int(slot[-1]) // 2
    if np.abs(tones - tones[0] - slot * spacing).max() > 1e-3 * spacing:
        step = SPEED_OF_LIGHT / spacing / size
        turn = path_phase(tones - tones[0] - spacing * centre, -step * np.arange(size))
        return np.asarray(data.astype(np.complex64) @ turn.T.astype(np.complex64))
    spectrum = np.zeros((*data.shape[:-1], size), np.complex64)
    spectrum[..., (slot - centre) % size] = data
    return np.asarray(np.fft.ifft(spectrum, axis=-1, norm="forward"), dtype=np.complex64)
