"""Synthetic apertures: the scans of a run as one array."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.model.arrays import FloatArray
from flgpr.model.frames import lane_to_scan, vehicle_to_lane
from flgpr.model.run import check_run, complete_scans, make_run

LINE_STARTS = "line_starts"
"""Attribute of a run of several lines: the number of the first scan of each."""
_ALIKE = 0.8  # length of the mean of the headings' unit vectors from which on they are one way
_LARGEST = 5e8  # bytes of a run that is taken as one aperture


def antennas_in_lane(run: xr.Dataset, poses: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Places (scan·pair, 3) of a run's antennas, transmitting and receiving, at poses (scan, 6) of the lane, m."""
    ends = np.stack([run[name].values for name in ("tx_position", "rx_position")])
    tx, rx = vehicle_to_lane(ends[:, None], poses).reshape(2, -1, 3)
    return tx, rx


def as_aperture(run: xr.Dataset, weights: ArrayLike) -> tuple[NDArray[Any], FloatArray, FloatArray]:
    """Take all scans as one array: field (polarization, scan·pair, frequency), weighted by scan, and its antennas."""
    data = run["signal"].values * np.asarray(weights, dtype=np.float32)[:, None, None, None]
    field = data.transpose(1, 0, 2, 3).reshape(data.shape[1], -1, data.shape[3])
    return field, *antennas_in_lane(run, run["pose"].values)


def way_weights(position: ArrayLike) -> FloatArray:
    """Share of the way that each position (scan, 3) stands for, half the way to both neighbours over the mean."""
    return half_steps(
        np.linalg.norm(np.diff(np.asarray(position, dtype=np.float64), axis=0), axis=1)
    )


def half_steps(step: FloatArray) -> FloatArray:
    """Half of both steps around each of their ends, over the mean; ones if there is no step."""
    share = 0.5 * (np.append(step, 0.0) + np.append(0.0, step))
    return share / share.mean() if share.sum() > 0 else np.ones(share.size)


def aperture_pose(run: xr.Dataset) -> FloatArray:
    """Pose (6,) of a run taken as one scan: mean place and heading along the way of its complete scans, level."""
    pose = run["pose"].values[complete_scans(run)]
    if not len(pose):
        raise ValueError(
            f"run must have a scan without missing sweeps, got none among {run.sizes['scan']}"
        )
    weights = way_weights(pose[:, :3])
    ahead = weights @ np.exp(1j * pose[:, 3]) / weights.sum()
    if not abs(ahead) > _ALIKE:
        raise ValueError(
            "run must head one way to be one aperture; its headings differ too much for a mean of them"
        )
    heading = np.angle(ahead)
    return np.array([*np.average(pose[:, :3], axis=0, weights=weights), heading, 0.0, 0.0])


def synthetic_aperture(run: xr.Dataset) -> tuple[NDArray[Any], FloatArray, FloatArray]:
    """Take all complete scans of a run as one aperture: field (polarization, scan·pair, frequency) and antennas, m.

    The antennas' places (scan·pair, 3), transmitting and receiving, are in the lane frame. Each scan is weighted by the
    way it stands for (half the distance to its neighbours; the mean is one), so that a vehicle that stands still for a
    while is not counted for every scan. A run without a complete scan is a ValueError.
    """
    check_run(run)
    scans = np.flatnonzero(complete_scans(run))
    if not scans.size:
        raise ValueError(
            f"run must have a scan without missing sweeps, got none among {run.sizes['scan']}"
        )
    pose = run["pose"].values[scans]
    return as_aperture(run.isel(scan=scans), way_weights(pose[:, :3]))


def aperture_run(run: xr.Dataset) -> xr.Dataset:
    """Take a run as a single scan, of an array that is all places at which its antennas were in complete scans.

    Its pose is :func:`aperture_pose`. Each place is weighted by the way it stands for, so that a vehicle that stands
    still for a while does not count for every scan (:func:`way_weights`). A run of more than 0.5 GB, or
    without a complete scan, is a ValueError.
    """
    check_run(run)
    scans = complete_scans(run)
    pose = aperture_pose(run)
    size = run["signal"].dtype.itemsize * run["signal"].size * int(scans.sum()) // run.sizes["scan"]
    if size > _LARGEST:
        raise ValueError(
            f"run must have at most {_LARGEST / 1e9:g} GB to be one aperture, got {size / 1e9:.3g} GB"
        )
    field, tx, rx = synthetic_aperture(run)
    tx, rx = (lane_to_scan(ends, pose) - [0.0, 0.0, pose[2]] for ends in (tx, rx))
    time = [run["time"].values[scans].mean()]
    return make_run(
        field[None],
        run["frequency"].values,
        run["polarization"].values,
        tx,
        rx,
        pose[None],
        time,
        dict(run.attrs),
    )
