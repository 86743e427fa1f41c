"""Dead channels and drift."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from flgpr.model import check_run

QUIET = -25.0
"""Level under the median of a polarization's pairs at which a channel counts as dead, dB."""
STEADY = 0.5
"""Least coherence from scan to scan of a channel that shares its neighbours' standing part, 1."""


def channel_health(run: xr.Dataset, quiet: float = QUIET) -> pd.DataFrame:
    """Return the level of every channel, what is missing, whether it is dead, and its drift.

    The standing field of a channel (antenna coupling and the vehicle's own reflections) is the same
    in every scan; the complex factor by which it changes is the channel's drift in gain and phase.
    The drift is known only where the standing field is strong: ``coherence`` is its share of the
    power.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    quiet : float
        Level under the median pair at which a channel is dead, dB.

    Returns
    -------
    DataFrame
        A row per polarization and pair: ``polarization``, ``pair``, ``level_db`` (re the median
        pair), ``missing`` (sweeps), ``stuck`` (share of the band with one and the same value in all
        scans), ``coherence`` (0 to 1), ``gain_drift_db`` and ``phase_drift_rad`` (last quarter of
        the scans against the first; NaN for fewer than four scans), ``dead`` (true if under
        ``quiet`` dB, stuck or without any sweep).
    """
    check_run(run)
    rows = []
    signal = run["signal"].values
    valid = run["valid"].values
    for k, label in enumerate(run["polarization"].values):
        sweeps_by_pair = []
        for pair in range(run.sizes["pair"]):
            sweeps_by_pair.append(signal[valid[:, k, pair], k, pair])
        power = np.array([_power(sweeps) for sweeps in sweeps_by_pair])
        # Pairs without a sweep do not count for the median.
        median = float(np.median(power[power > 0])) if (power > 0).any() else 1.0
        for pair, sweeps in enumerate(sweeps_by_pair):
            level = 10 * np.log10(power[pair] / median) if power[pair] > 0 else -np.inf
            stuck = 0.0
            if len(sweeps) > 1:
                stuck = float((sweeps == sweeps[:1]).all(axis=0).mean())
            double = sweeps.astype(np.complex128)
            gain, phase = _drift(double)
            rows.append(
                {
                    "polarization": str(label),
                    "pair": pair,
                    "level_db": level,
                    "missing": int(np.count_nonzero(~valid[:, k, pair])),
                    "stuck": stuck,
                    "coherence": _coherence(double),
                    "gain_drift_db": gain,
                    "phase_drift_rad": phase,
                    "dead": bool(len(sweeps) == 0 or level < quiet or stuck > 0.5),
                }
            )
    return pd.DataFrame(rows)


def health_summary(table: pd.DataFrame) -> list[str]:
    """Return sentences on the table of :func:`channel_health`: what is dead and what drifts."""
    lines = []
    dead = table[table["dead"]]
    if len(dead):
        names = [f"{row.polarization} pair {row.pair}" for row in dead.head(8).itertuples()]
        more = " ..." if len(dead) > 8 else ""
        lines.append(f"{len(dead)} of {len(table)} channels are dead: {', '.join(names)}{more}")
    has_drift = (table["coherence"] >= STEADY) & table["gain_drift_db"].notna()
    steady = table[~table["dead"] & has_drift]
    by_gain = steady["gain_drift_db"].abs() > 1.0
    by_phase = steady["phase_drift_rad"].abs() > 0.2
    drifting = steady[by_gain | by_phase]
    if len(drifting):
        worst = drifting.iloc[int(drifting["gain_drift_db"].abs().to_numpy().argmax())]
        lines.append(
            f"{len(drifting)} of {len(steady)} channels with a standing part drift by over 1 dB or "
            f"0.2 rad, the most {worst['polarization']} pair {worst['pair']} "
            f"by {worst['gain_drift_db']:+.1f} dB"
        )
    if lines:
        return lines
    return [f"all {len(table)} channels are alive" + (", none drifts" if len(steady) else "")]


def _power(sweeps: NDArray[np.complexfloating]) -> float:
    """Return the mean power; 0 without a sweep."""
    return float(np.mean(np.abs(sweeps.astype(np.complex128)) ** 2)) if sweeps.size else 0.0


def _coherence(sweeps: NDArray[np.complex128]) -> float:
    """Return the power of the mean over the mean power, less what chance makes of it.

    The mean of N independent sweeps has 1/N of their power.
    """
    count = len(sweeps)
    total = _power(sweeps)
    if count < 2 or total == 0:
        return 0.0
    share = _power(sweeps.mean(axis=0)) / total
    return max(0.0, (share - 1 / count) / (1 - 1 / count))


def _drift(sweeps: NDArray[np.complex128]) -> tuple[float, float]:
    """Return the drift of gain, dB, and phase, rad, from the first to the last quarter of scans."""
    quarter = len(sweeps) // 4
    if quarter < 1:
        return np.nan, np.nan
    first = sweeps[:quarter].mean(axis=0)
    last = sweeps[-quarter:].mean(axis=0)
    base = float((np.abs(first) ** 2).sum())
    factor = complex((first.conj() * last).sum()) / base if base > 0 else 0j
    if not factor:
        return np.nan, np.nan
    return 20 * np.log10(abs(factor)), float(np.angle(factor))


def disturbed_tones(signal: ArrayLike) -> NDArray[np.bool_]:
    """Mark the tones on which something else transmits.

    Such a tone changes from scan to scan by over 10 dB more than the tones around it do, by the
    median over scans and the median of 21 tones.

    Parameters
    ----------
    signal : (scan, frequency) array_like of complex
        Sweeps of a channel.

    Returns
    -------
    (frequency,) ndarray of bool
        Disturbed tones; none with fewer than three scans or seven tones.
    """
    values = np.asarray(signal)
    if len(values) < 3 or values.shape[1] < 7:
        return np.zeros(values.shape[1], dtype=np.bool_)
    change = np.median(np.abs(np.diff(values, axis=0)), axis=0)
    half = min(10, (change.size - 1) // 2)
    padded = np.pad(change, half, mode="edge")
    usual = np.median(sliding_window_view(padded, 2 * half + 1), axis=-1)
    return np.asarray(change > 10**0.5 * usual)  # 10 dB of power
