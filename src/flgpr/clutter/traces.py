"""Steps on the raw data of a run, as every program for ground-penetrating radar has them.

Each takes a run to a new one and works on tones: what acts on a trace as a filter is a factor per tone, and what acts
on its time is a product with the range profile. Sweeps that are missing stay missing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.clutter.standing import standing_field, subtract_standing
from flgpr.model import SPEED_OF_LIGHT, complete_scans
from flgpr.model.phase import lengthen

FloatArray = NDArray[np.float64]
GAINS = ("power", "agc")


def shift_time(run: xr.Dataset, delay: float) -> xr.Dataset:
    """Put time zero ``delay`` later (s): every echo then comes that much earlier."""
    return _with(
        run, lengthen(run["signal"].values, run["frequency"].values, -SPEED_OF_LIGHT * delay)
    )


def dewow(run: xr.Dataset, length: float) -> xr.Dataset:
    """Take a trace's running mean over ``length`` (s) off it: ``1 - sinc(f·length)`` on every tone.

    It removes the slow swing that saturated receivers leave under the echoes.
    """
    if not length > 0:
        raise ValueError(f"dewow must be a positive time, got {length:g} s")
    return _with(run, run["signal"].values * (1.0 - np.sinc(run["frequency"].values * length)))


def band_pass(run: xr.Dataset, low: float, high: float, taper: float = 0.1) -> xr.Dataset:
    """Keep the tones from ``low`` to ``high`` (Hz); the outer share ``taper`` of the band falls off as a cosine.

    A band that is empty or holds no tone is a ValueError.
    """
    if not (0 <= low < high and 0 <= taper <= 1):
        raise ValueError(
            f"band must have 0 <= low < high and a taper from 0 to 1, got {low:g}, {high:g}, {taper:g}"
        )
    frequency = run["frequency"].values
    keep = (frequency >= low) & (frequency <= high)
    if not keep.any():
        raise ValueError(
            f"band must hold a tone of the run, {frequency[0]:g} to {frequency[-1]:g} Hz, got {low:g} to {high:g} Hz"
        )
    inner = run.isel(frequency=keep)
    from_edge = np.minimum(frequency[keep] - low, high - frequency[keep]) / (high - low)
    weight = (
        np.ones(from_edge.size)
        if taper == 0
        else np.sin(np.pi / 2 * np.clip(2 * from_edge / taper, 0, 1)) ** 2
    )
    return _with(inner, inner["signal"].values * weight)


def remove_standing(run: xr.Dataset, scans: int | None = None) -> xr.Dataset:
    """Take off what stands still from scan to scan, see :func:`flgpr.clutter.standing_field`.

    With ``scans`` it is estimated anew for every scan, from so many around it, which lets a slowly changing ground
    surface go, too, and whatever else is longer than that. Fewer than three complete scans are a ValueError.
    """
    signal = run["signal"].values.copy()
    complete = np.flatnonzero(complete_scans(run))
    known = signal[complete]
    if scans is None or scans >= len(known):
        signal[complete] = subtract_standing(known, standing_field(known))
        return _with(run, signal)
    if scans < 3:
        raise ValueError(f"background must be estimated from at least 3 scans, got {scans}")
    for here, scan in enumerate(complete):
        start = int(np.clip(here - scans // 2, 0, len(known) - scans))
        signal[scan] = subtract_standing(known[here], standing_field(known[start : start + scans]))
    return _with(run, signal)


def subtract_run(run: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """Subtract another run of the same tones, polarizations and pairs: scan by scan, or the mean of its scans.

    Its mean is taken if it has another number of scans; if its axes differ, that is a ValueError.
    """
    for axis in ("frequency", "polarization"):
        mine = run[axis].values
        its = other[axis].values
        if mine.shape != its.shape or not (
            np.allclose(mine, its, rtol=1e-9) if axis == "frequency" else (mine == its).all()
        ):
            raise ValueError(
                f"subtract must be a run of the same {axis}, got {its.size} beside {mine.size}, or others"
            )
    if run.sizes["pair"] != other.sizes["pair"]:
        raise ValueError(
            f"subtract must be a run of {run.sizes['pair']} pairs, got {other.sizes['pair']}"
        )
    there = other["signal"].values
    if other.sizes["scan"] != run.sizes["scan"]:
        complete = complete_scans(other)
        if not complete.any():
            raise ValueError("subtract must be a run with a scan without missing sweeps, got none")
        there = there[complete].mean(axis=0)
    return _with(run, run["signal"].values - there)


def gate(run: xr.Dataset, start: float, stop: float = np.inf, ramp: float = 0.0) -> xr.Dataset:
    """Silence what comes before ``start`` or after ``stop`` (s, there and back), with cosine ramps of ``ramp`` s.

    The direct wave goes so. It needs even tones, for time is read from their transform.
    """
    if not (start < stop and ramp >= 0):
        raise ValueError(
            f"gate must have start < stop and a ramp that is not negative, got {start:g}, {stop:g} s"
        )

    def weight(time: FloatArray, _: NDArray[Any]) -> FloatArray:
        inside = np.minimum(time - start, stop - time)
        return (
            np.asarray(inside >= 0, float)
            if ramp == 0
            else np.sin(np.pi / 2 * np.clip(inside / ramp, 0, 1)) ** 2
        )

    return _in_time(run, weight)


def time_gain(run: xr.Dataset, kind: Literal["power", "agc"], value: float) -> xr.Dataset:
    """Amplify late echoes: by ``time**value`` ("power"), or by one over the level in a window of ``value`` s ("agc").

    The level is the root of the mean power in the window, of each trace by itself. It needs even tones.
    """
    if kind not in GAINS:
        raise ValueError(f"gain must be one of {', '.join(GAINS)}, got {kind!r}")
    if not value > 0:
        raise ValueError(f"gain {kind} must have a positive value, got {value:g}")

    def weight(time: FloatArray, profile: NDArray[Any]) -> FloatArray:
        if kind == "power":
            return np.asarray((np.maximum(time, 0.0) / time.max()) ** value)
        window = max(
            round(min(value / (time[1] - time[0]), time.size)), 1
        )  # no longer than the trace
        kernel = np.fft.rfft(np.ones(window) / window, time.size)
        power = np.fft.irfft(np.fft.rfft(np.abs(profile) ** 2) * kernel, time.size)
        level = np.sqrt(np.maximum(np.roll(power, -(window // 2), axis=-1), 0.0))
        top = level.max(axis=-1, keepdims=True)
        return np.asarray(
            1.0 / np.maximum(level, 1e-4 * np.where(top > 0, top, 1.0))
        )  # at most 80 dB

    return _in_time(run, weight)


def tone_step(run: xr.Dataset) -> float:
    """Step of the tones, Hz; uneven ones have no range profile by a transform and are a ValueError."""
    frequency = run["frequency"].values
    step = float(np.diff(frequency).mean()) if frequency.size > 1 else 0.0
    if step <= 0 or np.abs(np.diff(frequency) - step).max() > 1e-3 * step:
        raise ValueError(
            "tones must be at least two and even to tell times, within a thousandth of their step"
        )
    return step


def _in_time(
    run: xr.Dataset, weight: Callable[[FloatArray, NDArray[Any]], FloatArray]
) -> xr.Dataset:
    """Multiply the range profiles by a weight (time), or (..., time) by what the profile is."""
    signal = run["signal"].values.copy()
    step = tone_step(run)
    time = np.arange(run.sizes["frequency"]) / (run.sizes["frequency"] * step)
    for scan in np.flatnonzero(complete_scans(run)):
        profile = np.fft.ifft(signal[scan], axis=-1)
        signal[scan] = np.fft.fft(profile * weight(time, profile), axis=-1)
    return _with(run, signal)


def _with(run: xr.Dataset, signal: NDArray[Any]) -> xr.Dataset:
    return run.assign(signal=(run["signal"].dims, signal.astype(np.complex64, copy=False)))
