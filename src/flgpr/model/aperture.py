"""Synthetic apertures: the scans of a run as one array."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.model.arrays import FloatArray
from flgpr.model.frames import lane_to_scan, vehicle_to_lane
from flgpr.model.run import check_run, complete_scan_numbers, complete_scans, make_run

LINE_STARTS = "line_starts"
"""Attribute of a run of several lines: the number of the first scan of each."""
_LEAST_ALIGNMENT = 0.8  # length of the mean unit vector of headings that go one way
_LARGEST = 5e8  # bytes of a run that is taken as one aperture


def antennas_in_lane(run: xr.Dataset, poses: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the positions (scan·pair, 3) of a run's antennas in the lane, m, at poses (scan, 6).

    They are those of the transmitters and of the receivers.
    """
    ends = np.stack([run[name].values for name in ("tx_position", "rx_position")])
    tx, rx = vehicle_to_lane(ends[:, None], poses).reshape(2, -1, 3)
    return tx, rx


def as_aperture(run: xr.Dataset, weights: ArrayLike) -> tuple[NDArray[Any], FloatArray, FloatArray]:
    """Return all scans as one array: the field, weighted by scan, and its antennas.

    The field is (polarization, scan·pair, frequency), the antennas' positions are (scan·pair, 3).
    """
    data = run["signal"].values * np.asarray(weights, dtype=np.float32)[:, None, None, None]
    field = data.transpose(1, 0, 2, 3).reshape(data.shape[1], -1, data.shape[3])
    return field, *antennas_in_lane(run, run["pose"].values)


def way_weights(position: ArrayLike) -> FloatArray:
    """Return the share of the track of each position (scan, 3): half the way to both neighbours.

    The mean is one.
    """
    steps = np.diff(np.asarray(position, dtype=np.float64), axis=0)
    return half_steps(np.linalg.norm(steps, axis=1))


def half_steps(step: FloatArray) -> FloatArray:
    """Return half of both steps around each of their ends, over the mean; ones without a step."""
    share = 0.5 * (np.append(step, 0.0) + np.append(0.0, step))
    return share / share.mean() if share.sum() > 0 else np.ones(share.size)


def aperture_pose(run: xr.Dataset) -> FloatArray:
    """Return the pose (6,) of a run taken as one scan: mean position and heading, level.

    The means are along the track of its complete scans. Without one, or with headings that do not
    go one way, it is a ValueError.
    """
    pose = run["pose"].values[complete_scan_numbers(run)]
    weights = way_weights(pose[:, :3])
    ahead = weights @ np.exp(1j * pose[:, 3]) / weights.sum()
    if not abs(ahead) > _LEAST_ALIGNMENT:
        raise ValueError(
            "run must head one way to be one aperture; "
            "its headings differ too much for a mean of them"
        )
    heading = np.angle(ahead)
    return np.array([*np.average(pose[:, :3], axis=0, weights=weights), heading, 0.0, 0.0])


def synthetic_aperture(run: xr.Dataset) -> tuple[NDArray[Any], FloatArray, FloatArray]:
    """Return all complete scans of a run as one aperture.

    Each scan is weighted by its share of the track (half the distance to its neighbours; the mean
    is one), so that a vehicle that stands still for a while is not counted for every scan.

    Parameters
    ----------
    run : xarray.Dataset
        A run with a complete scan.

    Returns
    -------
    field : (polarization, scan·pair, frequency) ndarray
        Weighted data.
    tx, rx : (scan·pair, 3) ndarray
        Positions of the antennas in the lane frame, m.

    Raises
    ------
    ValueError
        If the run has no complete scan.
    """
    check_run(run)
    scans = complete_scan_numbers(run)
    pose = run["pose"].values[scans]
    return as_aperture(run.isel(scan=scans), way_weights(pose[:, :3]))


def aperture_run(run: xr.Dataset) -> xr.Dataset:
    """Return a run of a single scan with the antennas of all complete scans as its array.

    Its pose is :func:`aperture_pose`. Each position is weighted by its share of the track
    (:func:`way_weights`), so that a vehicle that stands still for a while does not count for every
    scan. A run of more than 0.5 GB, or without a complete scan, is a ValueError.
    """
    check_run(run)
    scans = complete_scans(run)
    pose = aperture_pose(run)
    size = run["signal"].dtype.itemsize * run["signal"].size * int(scans.sum()) // run.sizes["scan"]
    if size > _LARGEST:
        raise ValueError(
            f"run must have at most {_LARGEST / 1e9:g} GB to be one aperture, "
            f"got {size / 1e9:.3g} GB"
        )
    field, tx, rx = synthetic_aperture(run)
    height = [0.0, 0.0, pose[2]]
    return make_run(
        field[None],
        run["frequency"].values,
        run["polarization"].values,
        lane_to_scan(tx, pose) - height,
        lane_to_scan(rx, pose) - height,
        pose[None],
        [run["time"].values[scans].mean()],
        dict(run.attrs),
    )
