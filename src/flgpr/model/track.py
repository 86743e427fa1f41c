"""Tracks: where the vehicle was at what time, from another instrument than the radar."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from flgpr.model.constants import POSE_COMPONENTS
from flgpr.model.frames import pose_matrix
from flgpr.model.tables import Column

TRACK_COLUMNS = (
    Column("time", "number", "s", "time on the clock of the positions", required=True, missing=""),
    Column("x", "number", "m", "cross-track position in the lane frame", required=True, missing=""),
    Column("y", "number", "m", "down-track position in the lane frame", required=True, missing=""),
    Column("z", "number", "m", "height over the mean ground", required=True, missing=""),
    Column(
        "heading", "number", "rad", "clockwise from +y seen from above", required=True, missing=""
    ),
    Column("pitch", "number", "rad", "see the vehicle frame", required=True, missing=""),
    Column("roll", "number", "rad", "see the vehicle frame", required=True, missing=""),
)


def make_track(
    time: ArrayLike,
    position: ArrayLike,
    heading: ArrayLike = 0.0,
    pitch: ArrayLike = 0.0,
    roll: ArrayLike = 0.0,
) -> pd.DataFrame:
    """Assemble and validate a track: times on the positions' clock, and positions (fix, 3) in the lane frame."""
    times = np.asarray(time, dtype=np.float64)
    points = np.asarray(position, dtype=np.float64)
    if times.ndim != 1 or times.size < 2 or points.shape != (times.size, 3):
        raise ValueError(
            f"a track must have at least two fixes with time (fix,) and position (fix, 3), got {times.shape} and "
            f"{points.shape}"
        )
    angles = [
        np.broadcast_to(np.asarray(v, dtype=np.float64), times.shape)
        for v in (heading, pitch, roll)
    ]
    track = pd.DataFrame(
        dict(zip(("time", *POSE_COMPONENTS), [times, *points.T, *angles], strict=True))
    )
    return check_track(track)


def check_track(track: pd.DataFrame) -> pd.DataFrame:
    """Validate a track: the columns of ``TRACK_COLUMNS``, finite, and time that increases strictly."""
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
            f"track.time must increase strictly, got {values[first, 0]:g} s, {values[first + 1, 0]:g} s"
        )
    return track


def bridged(
    time: NDArray[np.float64], pose: NDArray[np.float64], max_gap: float = np.inf
) -> tuple[NDArray[np.bool_], list[str]]:
    """Tell which fixes, of times (fix,) and poses (fix, 6), are finite, and count the others in a note.

    Fixes that are missing between others more than ``max_gap`` s apart, or fewer than two finite ones, are a
    ValueError.
    """
    keep = np.isfinite(time) & np.isfinite(pose).all(axis=1)
    rows = np.flatnonzero(keep)
    if rows.size < 2:
        raise ValueError(
            f"a track must have at least two finite fixes, got {rows.size} of {keep.size}"
        )
    gap = np.where(np.diff(rows) > 1, np.diff(time[rows]), 0.0)
    worst = int(gap.argmax())
    if gap[worst] > max_gap:
        raise ValueError(
            f"a track must have a finite fix at least every max_gap = {max_gap:g} s, got none for {gap[worst]:g} s "
            f"after {time[rows[worst]]:g} s"
        )
    missing = keep.size - rows.size
    return keep, [
        f"{missing} of {keep.size} fixes of the track not finite, bridged"
    ] if missing else []


def poses_at(
    track: pd.DataFrame,
    time: ArrayLike,
    clock_offset: float = 0.0,
    clock_rate: float = 1.0,
    max_gap: float = np.inf,
) -> NDArray[np.float64]:
    """Interpolate a track at ``clock_offset + clock_rate·time``, linearly, to poses (scan, 6) with headings within ±π.

    A time outside the track, or in a gap longer than ``max_gap``, is a ValueError.
    """
    check_track(track)
    stamp = track["time"].to_numpy()
    when = clock_offset + clock_rate * np.asarray(time, dtype=np.float64)
    if not np.isfinite(when).all():
        raise ValueError(
            "time must be finite for every scan to take poses from a track, got a missing time"
        )
    slack = 1e-9 * max(1.0, float(np.abs(stamp).max()))
    if when.min() < stamp[0] - slack or when.max() > stamp[-1] + slack:
        raise ValueError(
            f"scan times must lie within the track, {stamp[0]:g} to {stamp[-1]:g} s, got {when.min():g} to "
            f"{when.max():g} s: is the clock offset right?"
        )
    right = np.clip(np.searchsorted(stamp, when), 1, stamp.size - 1)
    gap = stamp[right] - stamp[right - 1]
    if gap.max() > max_gap:
        worst = int(gap.argmax())
        raise ValueError(
            f"the track must have no gap over {max_gap:g} s, got {gap[worst]:g} s at scan {worst}"
        )
    pose = np.empty((when.size, 6))
    for column, name in enumerate(POSE_COMPONENTS):
        values = track[name].to_numpy(dtype=np.float64)
        pose[:, column] = np.interp(when, stamp, np.unwrap(values) if name == "heading" else values)
    pose[:, 3] = np.angle(np.exp(1j * pose[:, 3]))
    return pose


def reference_track(
    track: pd.DataFrame, lever_arm: ArrayLike = (0.0, 0.0, 0.0), latency: float = 0.0
) -> pd.DataFrame:
    """Take a track of a positioning antenna to the array's reference point.

    ``p - Rz(-heading)·Rx(pitch)·Ry(roll)·lever_arm`` at ``time - latency``; the lever arm is the antenna's place in the
    vehicle frame, the latency how late the time stamps are.
    """
    check_track(track)
    lever = np.asarray(lever_arm, dtype=np.float64)
    if lever.shape != (3,) or not np.isfinite(lever).all() or not np.isfinite(latency):
        raise ValueError(
            f"lever_arm must be three finite lengths and latency finite, got {lever.tolist()}, {latency}"
        )
    moved = track.copy()
    moved["time"] = track["time"] - latency
    moved[["x", "y", "z"]] = track[["x", "y", "z"]].to_numpy() - attitudes(track) @ lever
    return moved


def attitudes(track: pd.DataFrame) -> NDArray[np.float64]:
    """Rotation (fix, 3, 3) from the vehicle frame to lane axes at every fix: ``Rz(-heading)·Rx(pitch)·Ry(roll)``."""
    return pose_matrix(track[list(POSE_COMPONENTS)])


def course(position: ArrayLike, least: float = 0.05) -> NDArray[np.float64]:
    """Heading clockwise from +y of a track from the direction it moves in; one that never moves is a ValueError.

    A fix nearer than ``least`` to its neighbours takes the heading of the nearest that is not.
    """
    points = np.asarray(position, dtype=np.float64)[:, :2]
    rows = np.arange(len(points))
    after = _first_away(points, least)
    before = len(points) - 1 - _first_away(points[::-1], least)[::-1]
    step = points[after] - points[before]
    known = np.flatnonzero(np.hypot(*step.T) >= least)
    if not known.size:
        raise ValueError(
            f"the track must move by at least {least:g} m to tell a heading, it does not"
        )
    heading = np.unwrap(np.arctan2(step[known, 0], step[known, 1]))
    return np.asarray(np.angle(np.exp(1j * np.interp(rows, known, heading))), dtype=np.float64)


def _first_away(points: NDArray[np.float64], least: float) -> NDArray[np.intp]:
    """Index of the first later point that is at least so far away, of every point; its own where there is none."""
    found = np.arange(len(points))
    open_ones = np.arange(len(points) - 1)
    lag = 1
    while open_ones.size:
        away = np.hypot(*(points[open_ones + lag] - points[open_ones]).T) >= least
        found[open_ones[away]] += lag
        lag += 1
        open_ones = open_ones[~away]
        open_ones = open_ones[open_ones + lag < len(points)]
    return found
