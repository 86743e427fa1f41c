"""Tracks: positions of the vehicle in time, from another instrument than the radar."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.model.constants import POSE_COMPONENTS
from flgpr.model.frames import pose_matrix, wrapped
from flgpr.model.tables import full_column
from flgpr.types import ArrayLike, BoolArray, FloatArray, IndexArray, floats

TRACK_COLUMNS = (
    full_column("time", "s", "time on the clock of the positions"),
    full_column("x", "m", "cross-track position in the lane frame"),
    full_column("y", "m", "down-track position in the lane frame"),
    full_column("z", "m", "height over the mean ground"),
    full_column("heading", "rad", "clockwise from +y seen from above"),
    full_column("pitch", "rad", "see the vehicle frame"),
    full_column("roll", "rad", "see the vehicle frame"),
)


def make_track(
    time: ArrayLike,
    position: ArrayLike,
    heading: ArrayLike = 0.0,
    pitch: ArrayLike = 0.0,
    roll: ArrayLike = 0.0,
) -> pd.DataFrame:
    """Assemble and validate a track.

    Parameters
    ----------
    time : (fix,) array_like
        Times on the clock of the positions, s.
    position : (fix, 3) array_like
        Positions in the lane frame, m.
    heading, pitch, roll : float or (fix,) array_like
        Angles, rad.

    Returns
    -------
    DataFrame
        ``TRACK_COLUMNS``.

    Raises
    ------
    ValueError
        If the shapes differ, there are fewer than two fixes, or :func:`check_track` refuses it.
    """
    times = floats(time)
    points = floats(position)
    if times.ndim != 1 or times.size < 2 or points.shape != (times.size, 3):
        raise ValueError(
            "a track must have at least two fixes with time (fix,) and position (fix, 3), "
            f"got {times.shape} and {points.shape}"
        )
    columns = {"time": times, "x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
    for name, angle in (("heading", heading), ("pitch", pitch), ("roll", roll)):
        columns[name] = np.broadcast_to(floats(angle), times.shape)
    return check_track(pd.DataFrame(columns))


def check_track(track: pd.DataFrame) -> pd.DataFrame:
    """Return a track that is valid; any other is a ValueError.

    It must have the columns of ``TRACK_COLUMNS``, finite, and time that increases strictly.
    """
    names = [column.name for column in TRACK_COLUMNS]
    missing = [name for name in names if name not in track.columns]
    if missing:
        raise ValueError(
            f"track must have the columns {', '.join(names)}; missing: {', '.join(missing)}"
        )
    values = track[names].to_numpy(dtype=np.float64)
    bad = ~np.isfinite(values)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise ValueError(
            f"track.{names[column]} must be finite, got {values[row, column]} at fix {row}"
        )
    if (np.diff(values[:, 0]) <= 0).any():
        first = int(np.argmax(np.diff(values[:, 0]) <= 0))
        raise ValueError(
            f"track.time must increase strictly, got {values[first, 0]:g} s, "
            f"{values[first + 1, 0]:g} s"
        )
    return track


def bridged(
    time: FloatArray, pose: FloatArray, max_gap: float = np.inf
) -> tuple[BoolArray, list[str]]:
    """Mark the finite fixes of times (fix,) and poses (fix, 6), and count the others in a note.

    Missing fixes between others more than ``max_gap`` s apart, or fewer than two finite ones, are a
    ValueError.
    """
    finite = np.isfinite(time) & np.isfinite(pose).all(axis=1)
    rows = np.flatnonzero(finite)
    if rows.size < 2:
        raise ValueError(
            f"a track must have at least two finite fixes, got {rows.size} of {finite.size}"
        )
    gap = np.where(np.diff(rows) > 1, np.diff(time[rows]), 0.0)
    worst = int(gap.argmax())
    if gap[worst] > max_gap:
        raise ValueError(
            f"a track must have a finite fix at least every max_gap = {max_gap:g} s, "
            f"got none for {gap[worst]:g} s after {time[rows[worst]]:g} s"
        )
    missing = finite.size - rows.size
    if not missing:
        return finite, []
    return finite, [f"{missing} of {finite.size} fixes of the track not finite, bridged"]


def poses_at(
    track: pd.DataFrame,
    time: ArrayLike,
    clock_offset: float = 0.0,
    clock_rate: float = 1.0,
    max_gap: float = np.inf,
) -> FloatArray:
    """Interpolate the poses of a track linearly.

    Parameters
    ----------
    track : DataFrame
        Track.
    time : (scan,) array_like
        Times on the radar's clock, s.
    clock_offset, clock_rate : float
        Time on the track's clock is ``clock_offset + clock_rate·time``, s and 1.
    max_gap : float
        Longest gap of the track that is bridged, s.

    Returns
    -------
    (scan, 6) ndarray
        Poses, headings within ±π.

    Raises
    ------
    ValueError
        If a time is missing, outside the track or in a longer gap.
    """
    check_track(track)
    stamp = track["time"].to_numpy()
    track_time = clock_offset + clock_rate * floats(time)
    _check_times(track_time, stamp, max_gap)
    pose = np.empty((track_time.size, 6))
    for column, name in enumerate(POSE_COMPONENTS):
        values = track[name].to_numpy(dtype=np.float64)
        if name == "heading":
            values = np.unwrap(values)
        pose[:, column] = np.interp(track_time, stamp, values)
    pose[:, 3] = wrapped(pose[:, 3])
    return pose


def _check_times(track_time: FloatArray, stamp: FloatArray, max_gap: float) -> None:
    """Refuse times of scans that are missing, outside a track's fixes or in too long a gap."""
    if not np.isfinite(track_time).all():
        raise ValueError(
            "time must be finite for every scan to take poses from a track, got a missing time"
        )
    slack = 1e-9 * max(1.0, float(np.abs(stamp).max()))  # for the rounding of offset and rate
    if track_time.min() < stamp[0] - slack or track_time.max() > stamp[-1] + slack:
        raise ValueError(
            f"scan times must lie within the track, {stamp[0]:g} to {stamp[-1]:g} s, "
            f"got {track_time.min():g} to {track_time.max():g} s: is the clock offset right?"
        )
    right = np.clip(np.searchsorted(stamp, track_time), 1, stamp.size - 1)
    gap = stamp[right] - stamp[right - 1]
    if gap.max() > max_gap:
        worst = int(gap.argmax())
        raise ValueError(
            f"the track must have no gap over {max_gap:g} s, got {gap[worst]:g} s at scan {worst}"
        )


def reference_track(
    track: pd.DataFrame, lever_arm: ArrayLike = (0.0, 0.0, 0.0), latency: float = 0.0
) -> pd.DataFrame:
    """Return the track of the array's reference point from that of a positioning antenna.

    It is ``p - Rz(-heading)·Rx(pitch)·Ry(roll)·lever_arm`` at ``time - latency``.

    Parameters
    ----------
    track : DataFrame
        Track of the antenna.
    lever_arm : (3,) array_like
        Position of the antenna in the vehicle frame, m.
    latency : float
        How late the time stamps are, s.

    Returns
    -------
    DataFrame
        Track of the reference point.

    Raises
    ------
    ValueError
        If the track is not valid, or the lever arm or the latency is not finite.
    """
    check_track(track)
    lever = floats(lever_arm)
    if lever.shape != (3,) or not np.isfinite(lever).all() or not np.isfinite(latency):
        raise ValueError(
            "lever_arm must be three finite lengths and latency finite, "
            f"got {lever.tolist()}, {latency}"
        )
    reference = track.copy()
    reference["time"] = track["time"] - latency
    reference[["x", "y", "z"]] = track[["x", "y", "z"]].to_numpy() - attitudes(track) @ lever
    return reference


def attitudes(track: pd.DataFrame) -> FloatArray:
    """Return the rotations (fix, 3, 3) from the vehicle frame to lane axes at every fix."""
    return pose_matrix(track[list(POSE_COMPONENTS)])


def course(position: ArrayLike, least: float = 0.05) -> FloatArray:
    """Return the heading, clockwise from +y, from the motion of positions (fix, 2 or 3).

    A fix nearer than ``least`` (m) to its neighbours has the heading of the nearest that is not. A
    track that never moves so far is a ValueError.
    """
    points = floats(position)[:, :2]
    rows = np.arange(len(points))
    after = _first_distant(points, least)
    before = len(points) - 1 - _first_distant(points[::-1], least)[::-1]
    step = points[after] - points[before]
    known = np.flatnonzero(np.hypot(*step.T) >= least)
    if not known.size:
        raise ValueError(
            f"the track must move by at least {least:g} m to tell a heading, it does not"
        )
    heading = np.unwrap(np.arctan2(step[known, 0], step[known, 1]))
    return wrapped(np.interp(rows, known, heading))


def _first_distant(points: FloatArray, least: float) -> IndexArray:
    """Return, for every point, the index of the first later one at least so far away.

    Where there is none it is the point's own index.
    """
    first = np.arange(len(points))
    searching = np.arange(len(points) - 1)
    lag = 1
    while searching.size:
        is_distant = np.hypot(*(points[searching + lag] - points[searching]).T) >= least
        first[searching[is_distant]] += lag
        lag += 1
        searching = searching[~is_distant]
        searching = searching[searching + lag < len(points)]
    return first
