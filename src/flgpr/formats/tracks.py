"""Poses from other instruments: tracks as CSV or NMEA, surveyed points per scan."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from flgpr.formats.nmea import (
    HEADINGS,
    Position,
    SentenceCounts,
    heading_of,
    heading_time,
    position_of,
    sentences_of,
)
from flgpr.formats.reader import reader_of
from flgpr.geo.anchor import Anchor
from flgpr.geo.track_anchor import is_astray
from flgpr.model.faults import faults_of
from flgpr.model.frames import wrapped
from flgpr.model.track import TRACK_COLUMNS, bridged, course, make_track
from flgpr.store.files import existing
from flgpr.store.text import text_of
from flgpr.store.text_tables import read_text_table
from flgpr.types import AnyArray, FloatArray, Notes, floats

_DAY = 86400.0
_ANGLES = ("heading", "pitch", "roll")
_LEAST_BASELINE = 1e-3  # m, between the marks on an array, for a heading to follow from them
FIXED = (4,)
"""GGA quality of a fixed carrier-phase solution."""


class _NmeaLog(NamedTuple):
    """What an NMEA log states."""

    fixes: list[tuple[float, Position]]  # time, s, and position
    headings: list[tuple[float, float]]  # time, s, and heading, rad
    qualities: Counter[int]  # of all GGA, used or not


def read_track(
    path: str | Path,
    heading: str = "column",
    body: str | None = None,
    axes: Sequence[str] | None = None,
    max_gap: float = 1.0,
) -> pd.DataFrame:
    """Read a track in the lane frame from CSV, or from a take of OptiTrack Motive.

    A CSV has the columns ``time_s``, ``x_m``, ``y_m``, ``z_m``, and angles in ``heading_deg`` or
    ``heading_rad``, ``pitch_deg`` and ``roll_deg`` or the same with rad; or those of the table that
    an import writes beside a run (``time``, ``x``, ...). In a take the body's own axes must have
    been made along the lane's, with the vehicle along +y.

    Parameters
    ----------
    path : path
        The file.
    heading : {"column", "course"}
        With "column" all three angles must be there; with "course" the heading is the direction of
        travel, and pitch and roll are zero where there are no such columns.
    body : str, optional
        The rigid body of a take; the only one, if it is None.
    axes : (3,) sequence of str, optional
        Which of Motive's axes are the lane's x, y and z, such as ``("x", "-z", "y")`` where Motive
        has y up.
    max_gap : float
        Longest stretch without a finite fix, s, between others.

    Returns
    -------
    pandas.DataFrame
        The track (:func:`flgpr.model.track.make_track`). Fixes that are not finite are left out and
        counted in ``attrs["notes"]``.

    Raises
    ------
    ValueError
        If a column is missing, a gap is longer than ``max_gap``, or a time does not increase.
    """
    if heading not in ("column", "course"):
        raise ValueError(f"heading must be 'column' or 'course', got {heading!r}")
    reader = reader_of(existing(path, "track"), "poses")
    if reader is None and (body is not None or axes is not None):
        raise ValueError(f"{path}: body and axes are of takes of OptiTrack Motive, this is none")
    reading: list[str] = []
    with faults_of(path):
        if reader is not None:
            time, pose = reader.read_poses(Path(path), body, axes)
        else:
            columns = read_text_table(Path(path), reading)
            time, pose = _poses_of_table(columns, heading, reading)
        finite, notes = bridged(time, pose, max_gap)
        if heading == "course":
            pose[finite, 3] = course(pose[finite, :3])
        track = make_track(time[finite], pose[finite, :3], *pose[finite, 3:].T)
    track.attrs["notes"] = [*reading, *notes]
    return track


def _poses_of_table(
    columns: Mapping[str, AnyArray], heading: str, notes: Notes
) -> tuple[FloatArray, FloatArray]:
    """Return times and poses (fix, 6) of a table; a heading by the course is left zero."""
    names = [column.name for column in TRACK_COLUMNS]
    if set(names) <= set(columns):
        time, *components = (_needed(columns, name) for name in names)
        return time, np.stack(components, axis=1)
    time = _needed(columns, "time_s")
    if heading == "column":
        return time, _stated_poses(columns)
    position = [_needed(columns, f"{axis}_m") for axis in "xyz"]
    level = 0.0 * time
    angles = {name: _angle(columns, name, level) for name in _ANGLES[1:]}
    missing = [name for name, angle in angles.items() if angle is level]
    if missing:
        notes.append(f"no column tells {' and '.join(missing)}: 0 is taken")
    return time, np.stack([*position, level, *angles.values()], axis=1)


def read_survey(path: str | Path) -> FloatArray:
    """Read the poses of stop-and-go scans from surveyed points, one CSV line per scan in order.

    Columns are either ``x_m``, ``y_m``, ``z_m`` of the array's reference point and ``heading_deg``,
    ``pitch_deg``, ``roll_deg`` (or rad), or the positions of two marks on the array, ``left_x_m``
    ... ``right_z_m``: then the reference point is midway, heading and roll follow from the line
    between them, and the pitch must be given. Positions are in the lane.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    (scan, 6) ndarray
        Poses, m and rad.

    Raises
    ------
    ValueError
        If a column is missing, a value is not finite, or the marks coincide.
    """
    with faults_of(path):
        columns = read_text_table(existing(path))
        pose = _poses_by_marks(columns) if "left_x_m" in columns else _stated_poses(columns)
        bad = ~np.isfinite(pose).all(axis=1)
        if bad.any():
            raise ValueError(f"poses must be finite, got other values for scan {int(bad.argmax())}")
    return pose


def _stated_poses(columns: Mapping[str, AnyArray]) -> FloatArray:
    """Return the poses (row, 6) of a table that has columns of all their components."""
    position = [_needed(columns, f"{axis}_m") for axis in "xyz"]
    return np.stack([*position, *(_angle(columns, name) for name in _ANGLES)], axis=1)


def _poses_by_marks(columns: Mapping[str, AnyArray]) -> FloatArray:
    """Return the poses (scan, 6) of an array with a surveyed mark on its left and on its right."""
    left, right = (
        np.stack([_needed(columns, f"{side}_{axis}_m") for axis in "xyz"], axis=1)
        for side in ("left", "right")
    )
    apart = right - left
    level = np.hypot(apart[:, 0], apart[:, 1])
    if not (level > _LEAST_BASELINE).all():
        raise ValueError(
            f"left and right marks must lie apart, they coincide at scan {int(level.argmin())}"
        )

    pitch = _angle(columns, "pitch")
    # Rx(pitch)·Ry(roll) takes the line to the right mark to (cos r, sin p·sin r, -cos p·sin r).
    sine = apart[:, 2] / (np.linalg.norm(apart, axis=1) * np.cos(pitch))
    roll = -np.arcsin(np.clip(sine, -1, 1))
    # Seen from above: the line before the heading turns it, and as it was surveyed.
    aside = np.arctan2(np.sin(pitch) * np.sin(roll), np.cos(roll))
    direction = np.arctan2(apart[:, 1], apart[:, 0])
    heading = wrapped(aside - direction)
    return np.column_stack([(left + right) / 2, heading, pitch, roll])


def read_nmea(
    path: str | Path, anchor: Anchor, quality: tuple[int, ...] = FIXED, height: float | None = None
) -> pd.DataFrame:
    """Read a track of a satellite receiver's antenna from NMEA 0183 sentences.

    Positions are from GGA, headings from HDT, THS, PASHR or PTNL,AVR (dual antenna) where there are
    any, else from the course. Time is in seconds of the day (UTC), continued over midnight. Pitch
    and roll are zero: NMEA has no standard sentence for them. For lever arm and latency see
    :func:`flgpr.model.track.reference_track`.

    Parameters
    ----------
    path : path
        The log.
    anchor : Anchor
        Takes longitude and latitude to the lane.
    quality : tuple of int
        Qualities of the GGA fixes to use.
    height : float, optional
        Height of the antenna over the ground, m, needed where the anchor has no heights.

    Returns
    -------
    pandas.DataFrame
        The track (:func:`flgpr.model.track.make_track`); sentences and fixes that are not used are
        counted in ``attrs["notes"]``.

    Raises
    ------
    ValueError
        If there are fewer than two fixes, a height is needed, or heights over the sea alone meet an
        anchor that was surveyed.
    """
    path = existing(path)
    if height is None and not anchor.heights_known:
        raise ValueError("height must be given, the anchor's points have none")
    notes: Notes = []
    log = _read_log(path, quality, notes)
    is_own_anchor = math.isnan(anchor.sigma)
    places = _places_of(log, path, notes, height is None, is_own_anchor)
    if len(places) < 2:
        reasons = "".join(f"; {note}" for note in notes)
        raise ValueError(
            f"{path}: two fixes of quality {quality} or more are needed, "
            f"got {len(places)} (all: {dict(log.qualities)}){reasons}"
        )

    is_later = np.append(True, np.diff(places[:, 0]) > 0)
    time = places[is_later, 0]
    with faults_of(path):
        position = anchor.from_geodetic(places[is_later, 1:])
        if height is not None:
            position[:, 2] = height
        if log.headings:
            stamp, angle = _in_order(log.headings, notes)
            in_lane = np.interp(time, stamp, np.unwrap(angle)) - anchor.azimuth
            heading = wrapped(in_lane)
        else:
            # One fix that lies aside must not turn the way beside it.
            on_way = ~is_astray(position)
            of_way = np.unwrap(course(position[on_way]))
            heading = wrapped(np.interp(time, time[on_way], of_way))
        track = make_track(time, position, heading)

    total = sum(log.qualities.values())
    if total > len(log.fixes):
        counts = ", ".join(f"{count} of {kind}" for kind, count in sorted(log.qualities.items()))
        notes.append(
            f"{total - len(log.fixes)} of {total} fixes are not of quality {quality} and not used "
            f"({counts})"
        )
    not_later = np.count_nonzero(~is_later)
    if not_later:
        notes.append(f"{not_later} fixes whose time does not go on are not used")
    if not log.headings:
        notes.append("no sentence tells a heading: it is the direction of the way")
    notes.append("pitch and roll are taken as 0, which NMEA does not tell")
    track.attrs["notes"] = notes
    return track


def _read_log(path: Path, quality: tuple[int, ...], notes: Notes) -> _NmeaLog:
    """Read the GGA of some qualities and the headings of a log; count what is not used."""
    text = text_of(path, notes)
    counts = SentenceCounts()
    fixes: list[tuple[float, Position]] = []
    qualities: Counter[int] = Counter()
    headings: dict[str, list[tuple[float, float]]] = {kind: [] for kind in HEADINGS}
    now = -math.inf
    without_fix = 0
    without_heading = 0
    for _, _, sentence in sentences_of([text], ("GGA", *HEADINGS), counts):
        if sentence.kind == "GGA":
            position = position_of(sentence)
            if position is None or math.isnan(position.time):
                without_fix += 1
                continue
            qualities[position.quality] += 1
            now = _continued(position.time, now)
            if position.quality in quality:
                fixes.append((now, position))
            continue
        heading = heading_of(sentence)
        clock = heading_time(sentence)
        if math.isfinite(clock):
            now = _continued(clock, now)
        if heading is None:
            without_heading += 1
        elif math.isfinite(now):
            headings[sentence.kind].append((now, math.radians(heading)))
    notes += counts.notes(path.name)
    if without_fix:
        notes.append(f"{without_fix} GGA sentences tell no position or no time and are not used")
    if without_heading:
        notes.append(
            f"{without_heading} sentences tell no heading: it goes on evenly between the others"
        )
    stated = [kind for kind in HEADINGS if headings[kind]]
    if len(stated) > 1:
        notes.append(f"headings are those of {stated[0]}; {', '.join(stated[1:])} are not used")
    if stated and not HEADINGS[stated[0]]:
        notes.append(
            f"{stated[0]} states no time: a heading has that of the position before it, one fix late "
            "where the receiver sends it first"
        )
    return _NmeaLog(fixes, headings[stated[0]] if stated else [], qualities)


def _continued(clock: float, now: float) -> float:
    """Return a time of day, s, on the day that a log is at, or the next: it goes on over midnight."""
    return clock + _DAY * round((now - clock) / _DAY) if math.isfinite(now) else clock


def _in_order(headings: list[tuple[float, float]], notes: Notes) -> FloatArray:
    """Return times and headings (2, fix) in order, the first of each time; count the others."""
    stamp, angle = np.array(headings).T
    stamp, first = np.unique(stamp, return_index=True)
    if len(first) < len(headings):
        notes.append(
            f"{len(headings) - len(first)} of {len(headings)} headings state no time, or one that came "
            "before, and are not used: the first after a position is that of its time"
        )
    return np.stack([stamp, angle[first]])


def _places_of(
    log: _NmeaLog, path: Path, notes: Notes, needs_height: bool, is_own_anchor: bool
) -> FloatArray:
    """Return time, s, longitude, latitude, degrees, and ellipsoidal height, m, of fixes (fix, 4).

    Heights over the sea alone are good for an anchor that the log makes itself. Where heights are
    not needed, what is missing is taken as 0.
    """
    rows = [(time, *fix[1:5]) for time, fix in log.fixes]
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    if not needs_height:
        table[:, 3:] = np.nan_to_num(table[:, 3:])
    has_height = np.isfinite(table[:, 3])
    missing = np.count_nonzero(~has_height)
    if missing:
        notes.append(f"{missing} of {len(table)} fixes tell no height and are not used")
    table = table[has_height]
    unknown = np.isnan(table[:, 4])
    if unknown.any():
        separation = 0.0
        taken = "0 m is taken"
        if not unknown.all():
            separation = float(np.median(table[~unknown, 4]))
            taken = "that of the others is taken"
        elif not is_own_anchor:
            raise ValueError(
                f"{path}: no GGA tells the separation of the geoid from the ellipsoid, so that its "
                "heights over the sea do not fit the anchor's over the ellipsoid, by up to 100 m: "
                "let the receiver write it, or make the anchor of the log itself "
                "(anchor_from_track)"
            )
        table[unknown, 4] = separation
        notes.append(
            f"{np.count_nonzero(unknown)} of {len(table)} fixes of {path.name} tell no separation of "
            f"the geoid from the ellipsoid: {taken}"
        )
    return np.column_stack([table[:, :3], table[:, 3] + table[:, 4]])


def nmea_places(path: str | Path, quality: tuple[int, ...] = FIXED) -> FloatArray:
    """Read the positions of an NMEA log's GGA sentences; those that cannot be used are left out.

    Parameters
    ----------
    path : path
        The log.
    quality : tuple of int
        Qualities of the GGA fixes to use.

    Returns
    -------
    (fix, 3) ndarray
        Longitude, latitude (degrees) and ellipsoidal height (m).
    """
    path = existing(path)
    return _places_of(_read_log(path, quality, []), path, [], True, True)[:, 1:]


def _needed(columns: Mapping[str, AnyArray], name: str) -> FloatArray:
    """Return a column of real numbers that must be there."""
    if name not in columns or np.iscomplexobj(columns[name]):
        known = ", ".join(key for key in columns if key != "table") or "no header line"
        raise ValueError(f"the column {name} is missing; got {known}")
    return floats(columns[name])


def _angle(
    columns: Mapping[str, AnyArray], name: str, default: FloatArray | None = None
) -> FloatArray:
    """Return an angle, rad, or ``default`` where there is no column of it."""
    if f"{name}_rad" in columns:
        return _needed(columns, f"{name}_rad")
    if f"{name}_deg" in columns:
        return floats(np.radians(_needed(columns, f"{name}_deg")))
    if default is None:
        raise ValueError(f"the column {name}_deg or {name}_rad is missing")
    return default
