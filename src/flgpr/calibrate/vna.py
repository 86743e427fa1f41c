"""Simple calibration of sweeps by a network analyser: what is always there, the through, and cables."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from flgpr.model import SPEED_OF_LIGHT, check_run
from flgpr.model.phase import lengthen


def subtract_standard(run: xr.Dataset, standard: xr.Dataset) -> xr.Dataset:
    """Subtract the mean of sweeps taken with a short, a load or the empty sky in place of the scene.

    They are of the same pairs, polarizations and tones, with no sweep missing; others are a ValueError.
    """
    return run.assign(signal=run["signal"] - _mean(run, standard))


def divide_by_through(run: xr.Dataset, through: xr.Dataset, length: ArrayLike = 0.0) -> xr.Dataset:
    """Divide by the through connection: cables, switches and amplifiers drop out, and paths begin at the antennas.

    Parameters
    ----------
    run, through : xarray.Dataset
        A run, and sweeps of the same pairs, polarizations and tones with the antennas' cables
        joined, which are averaged; others, or ones that are missing or zero somewhere, are a
        ValueError.
    length : (pair,) array_like or float
        Electrical length of the joint that takes the antennas' place, m.
    """
    mean = _mean(run, through).values
    if (mean == 0).any():
        where = np.argwhere(mean == 0)[0]
        raise ValueError(
            f"through must not be zero, it is for pair {where[1]} at tone {where[2]}: is a channel dead?"
        )
    path = np.broadcast_to(np.asarray(length, dtype=np.float64), (run.sizes["pair"],))
    signal = lengthen(run["signal"].values / mean, run["frequency"].values, path)
    return run.assign(signal=(run["signal"].dims, signal.astype(np.complex64)))


def remove_delay(run: xr.Dataset, delay: ArrayLike) -> xr.Dataset:
    """Take the delay of cables out: of both cables of a pair together, s, one or for each pair; it must be finite."""
    check_run(run)
    value = np.asarray(delay, dtype=np.float64)
    if value.shape not in ((), (run.sizes["pair"],)) or not np.isfinite(value).all():
        raise ValueError(
            f"delay must be one finite value or one for each of {run.sizes['pair']} pairs"
        )
    path = np.broadcast_to(-SPEED_OF_LIGHT * value, (run.sizes["pair"],))
    return run.assign(
        signal=(run["signal"].dims, lengthen(run["signal"].values, run["frequency"].values, path))
    )


def _mean(run: xr.Dataset, standard: xr.Dataset) -> xr.DataArray:
    check_run(run)
    check_run(standard)
    for name in ("frequency", "polarization"):
        if not np.array_equal(run[name].values, standard[name].values):
            raise ValueError(f"run and standard must have the same {name}, they differ")
    if run.sizes["pair"] != standard.sizes["pair"]:
        raise ValueError(
            f"standard must have {run.sizes['pair']} pairs as the run has, got {standard.sizes['pair']}"
        )
    if not standard["valid"].values.all():
        raise ValueError("standard must have every sweep, some are missing")
    return standard["signal"].mean("scan")
