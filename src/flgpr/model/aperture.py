"""Synthetic apertures: the scans of a run as one array."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flgpr.model.frames import lane_to_scan, vehicle_to_lane
from flgpr.model.run import check_run, complete_scan_numbers, complete_scans, make_run
from flgpr.types import AnyArray, ArrayLike, FloatArray, floats

LINE_STARTS = "line_starts"
"""Attribute of a run of several lines: the number of the first scan of each."""
_JUMP = 4.0  # times the usual step, from which on nothing was measured in between
_ANY_ORDER = 1.5  # times the way to the nearest place, of steps between places in any order
_SAME_PLACE = 1e-4  # m, within which two places are one
_PLACES_ABOUT = 9  # nearest places by which the usual step is judged, a place itself among them
_LEAST_ALIGNMENT = 0.8  # length of the mean unit vector of headings that go one way
_LARGEST = 5e8  # bytes of a run that is taken as one aperture


def antennas_in_lane(run: xr.Dataset, poses: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the positions (scan·pair, 3) of a run's antennas in the lane, m, at poses (scan, 6).

    They are those of the transmitters and of the receivers.
    """
    ends = np.stack([run[name].values for name in ("tx_position", "rx_position")])
    tx, rx = vehicle_to_lane(ends[:, None], poses).reshape(2, -1, 3)
    return tx, rx


def as_aperture(run: xr.Dataset, weights: ArrayLike) -> tuple[AnyArray, FloatArray, FloatArray]:
    """Return all scans as one array: the field, weighted by scan, and its antennas.

    The field is (polarization, scan·pair, frequency), the antennas' positions are (scan·pair, 3).
    """
    data = run["signal"].values * np.asarray(weights, dtype=np.float32)[:, None, None, None]
    field = data.transpose(1, 0, 2, 3).reshape(data.shape[1], -1, data.shape[3])
    return field, *antennas_in_lane(run, run["pose"].values)


def way_weights(position: ArrayLike) -> FloatArray:
    """Return the share of the track of each position (scan, 3), see ``way_shares``.

    The mean is one.
    """
    return _over_mean(way_shares(position))


def _over_mean(share: FloatArray) -> FloatArray:
    """Return shares over their mean; ones where all are zero."""
    return share / share.mean() if share.sum() > 0 else np.ones(share.size)


def way_shares(position: ArrayLike) -> FloatArray:
    """Return the way that each position stands for: half the way to both neighbours.

    From the end of a row to the begin of the next, over a gap, or between places in any order,
    nothing was measured: there each side stands for a step as usual about it, and a place to which
    the vehicle comes again shares that.

    Parameters
    ----------
    position : (scan, 3) array_like
        Positions in the order of the scans, m.

    Returns
    -------
    (scan,) ndarray
        Shares, m.
    """
    places = floats(position)
    ways = np.diff(places, axis=0)
    step = np.linalg.norm(ways, axis=1)
    moves = step[step > 0]
    # A track goes on as it went; places in any order turn back from step to step.
    goes_on = len(ways) < 2 or np.sum(ways[1:] * ways[:-1]) >= 0
    if not moves.size or (goes_on and step.max() <= _JUMP * np.median(moves)):
        return _half_steps(step, step)
    return _shares_with_jumps(places, step, bool(goes_on))


def _shares_with_jumps(position: FloatArray, step: FloatArray, goes_on: bool) -> FloatArray:
    """Return the shares of positions (scan, 3), m, some steps of which may be jumps.

    Where the way turns back and is longer than to the nearest places, its order says nothing.
    """
    stop = np.append(0, np.cumsum(step > 0))  # scans at one place, one after the other
    begins = np.flatnonzero(np.append(True, step > 0))
    usual, visits = _usual_steps(position[begins])
    way = step[step > 0]
    is_jump = way > _JUMP * np.maximum(usual[:-1], usual[1:])
    to_next = np.where(is_jump, (usual / visits)[:-1], way)
    from_last = np.where(is_jump, (usual / visits)[1:], way)
    share = _half_steps(to_next, from_last)
    if not goes_on and np.median(way) > _ANY_ORDER * np.median(usual):
        share = usual / visits
    share = share / np.bincount(stop)
    return floats(share[stop])


def _usual_steps(places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far apart places (place, 3) are about each of them, m, and how often each is there.

    That is the median over the nearest places of the distance to their own nearest one, whatever
    the order.
    """
    from scipy.spatial import cKDTree  # slow to load, and hardly any track has jumps

    rounded = np.round(places / _SAME_PLACE)
    distinct, which, counts = np.unique(rounded, axis=0, return_inverse=True, return_counts=True)
    if len(distinct) < 2:
        return np.zeros(len(places)), np.ones(len(places))
    tree = cKDTree(distinct * _SAME_PLACE)
    distance, near = tree.query(tree.data, k=min(_PLACES_ABOUT, len(distinct)))
    usual = np.median(distance[near, 1], axis=1)
    which = which.ravel()
    return usual[which], counts[which].astype(np.float64)


def _half_steps(to_next: FloatArray, from_last: FloatArray) -> FloatArray:
    """Return half of the steps (scan - 1,) from each scan to the next and from the one before."""
    return np.asarray(0.5 * (np.append(to_next, 0.0) + np.append(0.0, from_last)))


def half_steps(step: FloatArray) -> FloatArray:
    """Return half of both steps around each of their ends, over the mean; ones without a step."""
    return _over_mean(_half_steps(step, step))


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


def synthetic_aperture(run: xr.Dataset) -> tuple[AnyArray, FloatArray, FloatArray]:
    """Return all complete scans of a run as one aperture.

    Each scan is weighted by its share of the track (:func:`flgpr.model.way_weights`), so that a
    vehicle that stands still for a while is not counted for every scan.

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
    (:func:`flgpr.model.way_weights`), so that a vehicle that stands still for a while does not
    count for every scan. A run of more than 0.5 GB, or without a complete scan, is a ValueError.
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
