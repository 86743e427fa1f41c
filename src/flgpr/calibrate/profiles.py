"""Coherent sums over an aperture for all range biases, from one range profile per sweep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from flgpr.kernels.biases import sum_over_biases
from flgpr.model import SPEED_OF_LIGHT, antennas_in_lane, way_weights
from flgpr.model.phase import path_phase
from flgpr.model.run import complete_scan_numbers
from flgpr.types import AnyArray, ArrayLike, ComplexArray, FloatArray, IntArray, floats

_SAMPLES_AT_ONCE = 1 << 23  # of the profiles, 64 MiB


def resolution(frequency: ArrayLike) -> float:
    """Return the range resolution c/2B of a band of tones, one way, m."""
    return SPEED_OF_LIGHT / max(float(np.ptp(np.asarray(frequency))), 1.0) / 2


def fields_over_bias(
    run: xr.Dataset, poses: Sequence[ArrayLike], points: ArrayLike, biases: tuple[float, float]
) -> tuple[ComplexArray, FloatArray]:
    """Sum a run coherently at points, for trial poses and range biases.

    Tones have a Hann window, scans the weights of :func:`flgpr.model.way_weights`. The sum is
    ``Σ w·s(f)·exp(+j2πf(L + 2·bias)/c)`` but for a phase that is the same for all of a bias.

    Parameters
    ----------
    run : xarray.Dataset
        A run with a complete scan.
    poses : (trial,) sequence of (scan, 6) array_like
        Poses of all its scans, one set for each trial.
    points : (point, 3) array_like
        Points in the lane frame, m.
    biases : tuple of float
        Least and greatest bias, m.

    Returns
    -------
    field : (trial, polarization, point, bias) ndarray of complex64
    bias : (bias,) ndarray
        Evenly spaced, at a quarter of the range resolution or less, m.

    Raises
    ------
    ValueError
        If the run has no complete scan or fewer than two tones.
    """
    tones = run["frequency"].values
    signal = run["signal"].values
    positions = floats(points)
    scans = complete_scan_numbers(run)

    # Profiles of four times as many bins as the spectrum has slots, or more; a bias of half a bin
    # of path shifts all values by one bin.
    spacing, slot = lattice(tones)
    size = 1 << int(4 * slot[-1] + 3).bit_length()
    step = SPEED_OF_LIGHT / spacing / size
    first = int(np.floor(2 * biases[0] / step))
    last = int(np.ceil(2 * biases[1] / step))
    middle_tone = float(tones[0]) + spacing * (int(slot[-1]) // 2)
    carrier = middle_tone / SPEED_OF_LIGHT

    trials = [floats(pose)[scans] for pose in poses]
    weights = [way_weights(pose[:, :3]) for pose in trials]
    shape = (len(trials), len(positions), signal.shape[1], last - first + 1)
    field = np.zeros(shape, np.complex64)
    scans_at_once = max(1, _SAMPLES_AT_ONCE // (size * signal.shape[1] * signal.shape[2]))
    for begin in range(0, scans.size, scans_at_once):
        of_block = slice(begin, begin + scans_at_once)
        table = _profiles(signal[scans[of_block]], tones, spacing, slot, size)
        # Repeated from its beginning, so that no range of a bias has to be wrapped.
        beginning = np.take(table, np.arange(last - first + 2), axis=-1, mode="wrap")
        table = np.concatenate([table, beginning], axis=-1)
        for pose, weight, out in zip(trials, weights, field, strict=True):
            tx, rx = antennas_in_lane(run, pose[of_block])
            share = np.repeat(weight[of_block], signal.shape[2])
            sum_over_biases(table, tx, rx, share, positions, step, carrier, first, out)

    bias = np.arange(first, last + 1) * (0.5 * step)
    return field.swapaxes(1, 2), floats(bias)


def lattice(frequency: ArrayLike) -> tuple[float, IntArray]:
    """Return the even spectrum of tones, gaps included.

    Uneven tones have one at their mean spacing, and lie near its slots.

    Parameters
    ----------
    frequency : (tone,) array_like
        Frequencies in increasing order, Hz.

    Returns
    -------
    spacing : float
        Spacing of the slots, Hz.
    slot : (tone,) ndarray of int
        Slots of the tones, the first one 0.

    Raises
    ------
    ValueError
        If there are fewer than two tones.
    """
    tones = floats(frequency)
    if tones.size < 2:
        raise ValueError(f"run must have two tones or more to tell ranges, got {tones.size}")
    least = float(np.diff(tones).min())
    mean = float(np.ptp(tones)) / (tones.size - 1)
    for spacing in (least, mean):
        slot = np.rint((tones - tones[0]) / spacing).astype(np.int64)
        if slot[-1] < 64 * tones.size:  # otherwise the spectrum would be gaps alone
            break
    return float(np.ptp(tones)) / int(slot[-1]), slot


def _profiles(
    signal: AnyArray, tones: FloatArray, spacing: float, slot: IntArray, size: int
) -> ComplexArray:
    """Return range profiles (polarization, scan·pair, size) of a signal.

    The signal is (scan, polarization, pair, frequency).
    """
    # Of two points more, so that the outermost tones do not get the weight zero.
    taper = np.hanning(tones.size + 2)[1:-1]
    tapered = (signal * taper.astype(np.float32)).swapaxes(0, 1)
    data = tapered.reshape(signal.shape[1], -1, tones.size)
    centre = int(slot[-1]) // 2

    off_grid = np.abs(tones - tones[0] - slot * spacing).max()
    if off_grid > 1e-3 * spacing:
        # Uneven tones: the sum itself in place of a transform.
        step = SPEED_OF_LIGHT / spacing / size
        turn = path_phase(tones - tones[0] - spacing * centre, -step * np.arange(size))
        return data.astype(np.complex64) @ turn.T.astype(np.complex64)

    spectrum = np.zeros((*data.shape[:-1], size), np.complex64)
    spectrum[..., (slot - centre) % size] = data
    return np.asarray(np.fft.ifft(spectrum, axis=-1, norm="forward"), dtype=np.complex64)
