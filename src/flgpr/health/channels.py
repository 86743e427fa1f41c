"""Dead channels and drift."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from flgpr.health.sums import HealthSums
from flgpr.model import check_run
from flgpr.model.run import polarizations_of
from flgpr.types import FloatArray

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
    valid = run["valid"].values
    sums = HealthSums(run["signal"].shape[1:], run.sizes["scan"])
    for scan in range(run.sizes["scan"]):
        signal = run["signal"].variable[scan].values
        if not valid[scan].all():
            signal = np.where(valid[scan, ..., None], signal, np.nan)
        sums.add(signal)
    return channel_table(sums, polarizations_of(run), (~valid).sum(axis=0), quiet)


def channel_table(
    sums: HealthSums,
    polarizations: Sequence[str],
    missing: NDArray[np.integer],
    quiet: float = QUIET,
) -> pd.DataFrame:
    """Return the table of :func:`channel_health` from sums.

    Parameters
    ----------
    sums : HealthSums
        Sums of a run.
    polarizations : sequence of str
        Their names.
    missing : (polarization, pair) ndarray of int
        Sweeps that are missing.
    quiet : float
        Level under the median pair at which a channel is dead, dB.
    """
    level = channel_levels(sums)
    always = (sums.stuck == sums.steps[..., None]) & (sums.steps[..., None] > 0)
    stuck = always.mean(axis=-1)
    coherence = _coherence(sums)
    gain, phase = _drift(sums)
    dead = (sums.sweeps == 0) | (level < quiet) | (stuck > 0.5)
    count, pairs = level.shape
    columns = {
        "level_db": level,
        "missing": missing,
        "stuck": stuck,
        "coherence": coherence,
        "gain_drift_db": gain,
        "phase_drift_rad": phase,
        "dead": dead,
    }
    return pd.DataFrame(
        {
            "polarization": np.repeat(np.array(polarizations, object), pairs),
            "pair": np.tile(np.arange(pairs), count),
            **{name: values.ravel() for name, values in columns.items()},
        }
    )


def channel_levels(sums: HealthSums) -> FloatArray:
    """Return the mean level of channels (polarization, pair) over the median pair, dB.

    Pairs without a sweep, and without power, do not count for the median.
    """
    power = sums.power / np.maximum(sums.sweeps, 1)
    levels = np.full(power.shape, -np.inf)
    for row, of_row in zip(levels, power, strict=True):
        known = of_row > 0
        if known.any():
            row[known] = 10 * np.log10(of_row[known] / np.median(of_row[known]))
    return levels


def health_summary(table: pd.DataFrame) -> list[str]:
    """Return sentences on the table of :func:`channel_health`: what is dead and what drifts."""
    lines = []
    dead = table[table["dead"]]
    if len(dead):
        names = [f"{row.polarization} pair {row.pair}" for row in dead.head(8).itertuples()]
        more = " ..." if len(dead) > 8 else ""
        lines.append(f"{len(dead)} of {len(table)} channels are dead: {', '.join(names)}{more}")
    steady = steady_channels(table)
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
    alive = "the channel is alive" if len(table) == 1 else f"all {len(table)} channels are alive"
    return [alive + (", none drifts" if len(steady) else "")]


def steady_channels(table: pd.DataFrame) -> pd.DataFrame:
    """Return the living channels whose standing part is strong enough to tell a drift."""
    return table[~table["dead"] & (table["coherence"] >= STEADY) & table["gain_drift_db"].notna()]


def _coherence(sums: HealthSums) -> FloatArray:
    """Return the power of the mean over the mean power, less what chance makes of it.

    The mean of N independent sweeps has 1/N of their power.
    """
    count = np.maximum(sums.sweeps, 1)
    standing = np.mean(np.abs(sums.mean) ** 2, axis=-1)
    total = sums.power / count
    share = np.divide(standing, total, out=np.zeros_like(total), where=total > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        known = (share - 1 / count) / (1 - 1 / count)
    return np.where((count < 2) | (total == 0), 0.0, np.maximum(known, 0.0))


def _drift(sums: HealthSums) -> tuple[FloatArray, FloatArray]:
    """Return the drift of gain, dB, and phase, rad, from the first to the last quarter of scans."""
    unknown = np.full(sums.sweeps.shape, np.nan)
    if not sums.first.size:
        return unknown, unknown
    first = sums.first / np.maximum(sums.in_first, 1)[..., None]
    last = sums.last / np.maximum(sums.in_last, 1)[..., None]
    base = (np.abs(first) ** 2).sum(axis=-1)
    product = (first.conj() * last).sum(axis=-1)
    known = (base > 0) & (product != 0)
    factor = np.divide(product, base, out=np.ones_like(product), where=known)
    gain = np.where(known, 20 * np.log10(np.abs(factor)), np.nan)
    return gain, np.where(known, np.angle(factor), np.nan)


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
    return np.asarray(change > 10**0.5 * median_around(change, 2 * half + 1))  # 10 dB of power


def median_around(values: FloatArray, count: int) -> FloatArray:
    """Return the running median of an odd number of values; the first and the last stand for more."""
    padded = np.pad(values, count // 2, mode="edge")
    return np.asarray(np.median(sliding_window_view(padded, count), axis=-1))
