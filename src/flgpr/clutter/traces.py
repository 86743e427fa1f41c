"""Processing steps on the raw data of a run, known from every program for ground-penetrating radar.

Each step returns a new run and works on tones: a filter along a trace is a factor per tone, and a
weight in time is a product with the range profile. Missing sweeps stay missing.
:func:`flgpr.clutter.remove_standing` removes the background.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import xarray as xr

from flgpr.model import SPEED_OF_LIGHT, complete_scans, unambiguous_path
from flgpr.model.phase import lengthen
from flgpr.model.run import with_signal
from flgpr.types import AnyArray, FloatArray

GAINS = ("power", "agc")
_SAME_PLACE = 0.05  # m, within which antennas of two runs are the same
_LEAST_LEVEL = 1e-4  # of a trace's greatest level: an automatic gain amplifies by at most 80 dB


def shift_time(run: xr.Dataset, delay: float) -> xr.Dataset:
    """Move time zero ``delay`` (s) later: every echo then comes that much earlier.

    A delay longer than the record, after which echoes come round again, is a ValueError.
    """
    record = unambiguous_path(run["frequency"].values) / SPEED_OF_LIGHT
    if abs(delay) >= record:
        raise ValueError(
            f"time zero must move by less than the record, {record:.4g} s, got {delay:g} s"
        )
    signal = lengthen(run["signal"].values, run["frequency"].values, -SPEED_OF_LIGHT * delay)
    shifted = with_signal(run, signal)
    first = run.attrs.get("first_sample_s")
    if first is None:
        return shifted
    return shifted.assign_attrs(first_sample_s=float(first) - delay)


def dewow(run: xr.Dataset, length: float) -> xr.Dataset:
    """Subtract the running mean over ``length`` (s) from every trace.

    On every tone this is the factor ``1 - sinc(f·length)``. It removes the slow swing that
    saturated receivers leave under the echoes.
    """
    if not length > 0:
        raise ValueError(f"dewow must be a positive time, got {length:g} s")
    factor = 1.0 - np.sinc(run["frequency"].values * length)
    return with_signal(run, run["signal"].values * factor)


def band_pass(run: xr.Dataset, low: float, high: float, taper: float = 0.1) -> xr.Dataset:
    """Keep the tones of a band and taper its edges.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    low, high : float
        Band, Hz.
    taper : float
        Share of the band's part that the run's tones reach, over which the weight falls off as a
        cosine at the band's edges.

    Returns
    -------
    xarray.Dataset
        The run with the tones of the band alone.

    Raises
    ------
    ValueError
        If the band is empty or holds no tone of the run.
    """
    if not (0 <= low < high and 0 <= taper <= 1):
        raise ValueError(
            "band must have 0 <= low < high and a taper from 0 to 1, "
            f"got {low:g}, {high:g}, {taper:g}"
        )
    frequency = run["frequency"].values
    keep = (frequency >= low) & (frequency <= high)
    if not keep.any():
        raise ValueError(
            f"band must hold a tone of the run, {frequency[0]:g} to {frequency[-1]:g} Hz, "
            f"got {low:g} to {high:g} Hz"
        )
    band = run.isel(frequency=keep)
    # A band that ends beyond the tones cuts nothing there, and tapers its other edge no more for it.
    width = min(high, frequency[-1]) - max(low, frequency[0])
    weight = np.ones(int(keep.sum()))
    if taper != 0 and width > 0:
        from_edge = np.minimum(frequency[keep] - low, high - frequency[keep]) / width
        weight = np.sin(np.pi / 2 * np.clip(2 * from_edge / taper, 0, 1)) ** 2
    return with_signal(band, band["signal"].values * weight)


def subtract_run(run: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """Subtract another run of the same tones, polarizations and pairs.

    Parameters
    ----------
    run : xarray.Dataset
        The run that is cleaned.
    other : xarray.Dataset
        What is subtracted: scan by scan, or the mean of its complete scans if it has another number
        of scans.

    Returns
    -------
    xarray.Dataset
        The difference, at the poses of ``run``.

    Raises
    ------
    ValueError
        If tones, polarizations or pairs differ, their antennas lie elsewhere or in another order, or
        no complete scan is left for a mean.
    """
    for axis in ("frequency", "polarization"):
        labels = run[axis].values
        other_labels = other[axis].values
        if not _same_labels(axis, labels, other_labels):
            raise ValueError(
                f"subtract must be a run of the same {axis}, "
                f"got {other_labels.size} beside {labels.size}, or others"
            )
    if run.sizes["pair"] != other.sizes["pair"]:
        raise ValueError(
            f"subtract must be a run of {run.sizes['pair']} pairs, got {other.sizes['pair']}"
        )
    for side in ("tx_position", "rx_position"):
        apart = np.linalg.norm(run[side].values - other[side].values, axis=-1).max()
        if apart > _SAME_PLACE:
            raise ValueError(
                f"subtract must be a run of the same pairs in the same order, their {side} lie up to "
                f"{apart:.3g} m apart"
            )
    background = other["signal"].values
    if other.sizes["scan"] != run.sizes["scan"]:
        complete = complete_scans(other)
        if not complete.any():
            raise ValueError("subtract must be a run with a scan without missing sweeps, got none")
        background = background[complete].mean(axis=0)
    return with_signal(run, run["signal"].values - background)


def _same_labels(axis: str, labels: AnyArray, other: AnyArray) -> bool:
    """Compare the labels of an axis: tones to 1e-9, polarizations letter by letter."""
    if labels.shape != other.shape:
        return False
    if axis == "frequency":
        return bool(np.allclose(labels, other, rtol=1e-9))
    return bool((labels == other).all())


def gate(run: xr.Dataset, start: float, stop: float = np.inf, ramp: float = 0.0) -> xr.Dataset:
    """Set to zero what arrives outside a gate in two-way time, such as the direct wave.

    Parameters
    ----------
    run : xarray.Dataset
        A run with even tones: time is read from their transform.
    start, stop : float
        First and last time that stay, s.
    ramp : float
        Length of the cosine ramps inside the gate's ends, s.

    Returns
    -------
    xarray.Dataset
        The gated run.

    Raises
    ------
    ValueError
        If the gate is empty or holds no time of the record, the ramp is negative, or the tones are
        not even.
    """
    if not (start < stop and ramp >= 0):
        raise ValueError(
            "gate must have start < stop and a ramp that is not negative, "
            f"got {start:g}, {stop:g} s"
        )
    record = 1 / tone_step(run)
    if start >= record or stop <= 0:
        raise ValueError(
            f"gate must hold a time of the record, 0 to {record:.4g} s, got {start:g} to {stop:g} s"
        )

    def weight(time: FloatArray, _: AnyArray) -> FloatArray:
        inside = np.minimum(time - start, stop - time)
        if ramp == 0:
            return np.asarray(inside >= 0, float)
        return np.asarray(np.sin(np.pi / 2 * np.clip(inside / ramp, 0, 1)) ** 2)

    return _weight_in_time(run, weight)


def time_gain(run: xr.Dataset, kind: Literal["power", "agc"], value: float) -> xr.Dataset:
    """Amplify late echoes.

    Parameters
    ----------
    run : xarray.Dataset
        A run with even tones.
    kind : {"power", "agc"}
        By ``time**value``, or by one over the level in a window of ``value`` s: the root of the
        mean power in the window, of each trace by itself. The latter amplifies by at most 80 dB.
    value : float
        Exponent, or length of the window, s; positive.

    Returns
    -------
    xarray.Dataset
        The amplified run.

    Raises
    ------
    ValueError
        If the kind is unknown, the value is not positive, or the tones are not even.
    """
    if kind not in GAINS:
        raise ValueError(f"gain must be one of {', '.join(GAINS)}, got {kind!r}")
    if not value > 0:
        raise ValueError(f"gain {kind} must have a positive value, got {value:g}")

    def power_law(time: FloatArray, _: AnyArray) -> FloatArray:
        return np.asarray((np.maximum(time, 0.0) / time.max()) ** value)

    def automatic_gain(time: FloatArray, profile: AnyArray) -> FloatArray:
        # The window is no longer than the trace.
        window = max(round(min(value / (time[1] - time[0]), time.size)), 1)
        kernel = np.fft.rfft(np.ones(window) / window, time.size)
        power = np.fft.irfft(np.fft.rfft(np.abs(profile) ** 2) * kernel, time.size)
        level = np.sqrt(np.maximum(np.roll(power, -(window // 2), axis=-1), 0.0))
        top = level.max(axis=-1, keepdims=True)
        floor = _LEAST_LEVEL * np.where(top > 0, top, 1.0)
        return np.asarray(1.0 / np.maximum(level, floor))

    return _weight_in_time(run, power_law if kind == "power" else automatic_gain)


def tone_step(run: xr.Dataset) -> float:
    """Return the step of the tones, Hz.

    Uneven tones have no range profile by a transform and are a ValueError.
    """
    frequency = run["frequency"].values
    step = float(np.diff(frequency).mean()) if frequency.size > 1 else 0.0
    if step <= 0 or np.abs(np.diff(frequency) - step).max() > 1e-3 * step:
        raise ValueError(
            "tones must be at least two and even to tell times, within a thousandth of their step"
        )
    return step


def _weight_in_time(
    run: xr.Dataset, weight: Callable[[FloatArray, AnyArray], FloatArray]
) -> xr.Dataset:
    """Multiply the range profiles by weights (..., time), made from times and the profile."""
    signal = run["signal"].values.copy()
    step = tone_step(run)
    time = np.arange(run.sizes["frequency"]) / (run.sizes["frequency"] * step)
    for scan in np.flatnonzero(complete_scans(run)):
        profile = np.fft.ifft(signal[scan], axis=-1)
        signal[scan] = np.fft.fft(profile * weight(time, profile), axis=-1)
    return with_signal(run, signal)
