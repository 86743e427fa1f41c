"""Simple calibration of sweeps by a network analyser: a standard, the through, and cables."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flgpr.model import SPEED_OF_LIGHT, check_run
from flgpr.model.phase import lengthen
from flgpr.model.run import with_signal
from flgpr.types import ArrayLike, floats


def subtract_standard(run: xr.Dataset, standard: xr.Dataset) -> xr.Dataset:
    """Subtract the mean of sweeps of a standard: a short, a load or the empty sky.

    Parameters
    ----------
    run, standard : xarray.Dataset
        A run, and complete sweeps of the same pairs, polarizations and tones.

    Returns
    -------
    xarray.Dataset
        The difference.

    Raises
    ------
    ValueError
        If pairs, polarizations or tones differ, or a sweep of the standard is missing.
    """
    return run.assign(signal=run["signal"] - _mean(run, standard))


def divide_by_through(run: xr.Dataset, through: xr.Dataset, length: ArrayLike = 0.0) -> xr.Dataset:
    """Divide by the through connection: cables, switches and amplifiers cancel.

    Paths then begin at the antennas.

    Parameters
    ----------
    run, through : xarray.Dataset
        A run, and complete sweeps of the same pairs, polarizations and tones with the antennas'
        cables joined, which are averaged.
    length : (pair,) array_like or float
        Electrical length of the joint that replaces the antennas, m.

    Returns
    -------
    xarray.Dataset
        The calibrated run.

    Raises
    ------
    ValueError
        If pairs, polarizations or tones differ, or a sweep of the through is missing or zero.
    """
    mean = _mean(run, through).values
    if (mean == 0).any():
        _, pair, tone = np.argwhere(mean == 0)[0]
        raise ValueError(
            f"through must not be zero, it is for pair {pair} at tone {tone}: is a channel dead?"
        )
    path = np.broadcast_to(floats(length), (run.sizes["pair"],))
    signal = lengthen(run["signal"].values / mean, run["frequency"].values, path)
    return with_signal(run, signal)


def remove_delay(run: xr.Dataset, delay: ArrayLike) -> xr.Dataset:
    """Remove the delay of cables from a run.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    delay : float or (pair,) array_like
        Delay of both cables of a pair together, s; finite.

    Returns
    -------
    xarray.Dataset
        The run without the delay.

    Raises
    ------
    ValueError
        If the delay is not finite or does not fit the pairs.
    """
    check_run(run)
    value = floats(delay)
    if value.shape not in ((), (run.sizes["pair"],)) or not np.isfinite(value).all():
        raise ValueError(
            f"delay must be one finite value or one for each of {run.sizes['pair']} pairs"
        )
    path = np.broadcast_to(-SPEED_OF_LIGHT * value, (run.sizes["pair"],))
    signal = lengthen(run["signal"].values, run["frequency"].values, path)
    return with_signal(run, signal)


def _mean(run: xr.Dataset, standard: xr.Dataset) -> xr.DataArray:
    """Return the mean scan of a standard that fits a run and is complete."""
    check_run(run)
    check_run(standard)
    for name in ("frequency", "polarization"):
        if not np.array_equal(run[name].values, standard[name].values):
            raise ValueError(f"run and standard must have the same {name}, they differ")
    if run.sizes["pair"] != standard.sizes["pair"]:
        raise ValueError(
            f"standard must have {run.sizes['pair']} pairs as the run has, "
            f"got {standard.sizes['pair']}"
        )
    if not standard["valid"].values.all():
        raise ValueError("standard must have every sweep, some are missing")
    return standard["signal"].mean("scan")
