"""Poses from other instruments: tracks as CSV or NMEA, surveyed points per scan."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.door import read_named
from flgpr.formats.reader import reader_of
from flgpr.geo.anchor import Anchor
from flgpr.model.faults import faults_of
from flgpr.model.track import TRACK_COLUMNS, bridged, course, make_track
from flgpr.store.extras import optional
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.store.text import decode_text
from flgpr.store.text_tables import read_text_table

FloatArray = NDArray[np.float64]
_DAY = 86400.0
_ANGLES = ("heading", "pitch", "roll")
_LEAST_BASELINE = 1e-3  # m, between the marks on an array, for a heading to follow from them
FIXED = (4,)
"""GGA quality of a fixed carrier-phase solution."""


class _NmeaLog(NamedTuple):
    """What an NMEA log states."""

    fixes: list[tuple[float, float, float, float]]  # time, s, longitude, latitude, height, m
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
    columns: Mapping[str, NDArray[Any]], heading: str, notes: list[str]
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
    angles = [_angle(columns, name, level) for name in ("pitch", "roll")]
    missing = [
        name for name, angle in zip(("pitch", "roll"), angles, strict=True) if angle is level
    ]
    if missing:
        notes.append(f"no column tells {' and '.join(missing)}: 0 is taken")
    return time, np.stack([*position, level, *angles], axis=1)


def read_survey(path: str | Path) -> NDArray[np.float64]:
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
        if "left_x_m" in columns:
            pose = _poses_by_marks(columns)
        else:
            pose = _stated_poses(columns)
        bad = ~np.isfinite(pose).all(axis=1)
        if bad.any():
            raise ValueError(f"poses must be finite, got other values for scan {int(bad.argmax())}")
    return pose


def _stated_poses(columns: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Return the poses (row, 6) of a table that has columns of all their components."""
    position = [_needed(columns, f"{axis}_m") for axis in "xyz"]
    return np.stack([*position, *(_angle(columns, name) for name in _ANGLES)], axis=1)


def _poses_by_marks(columns: Mapping[str, NDArray[Any]]) -> FloatArray:
    """Return the poses (scan, 6) of an array with a surveyed mark on its left and on its right."""
    left = np.stack([_needed(columns, f"left_{axis}_m") for axis in "xyz"], axis=1)
    right = np.stack([_needed(columns, f"right_{axis}_m") for axis in "xyz"], axis=1)
    apart = right - left
    level = np.hypot(apart[:, 0], apart[:, 1])
    if not (level > _LEAST_BASELINE).all():
        raise ValueError(
            f"left and right marks must lie apart, they coincide at scan {int(level.argmin())}"
        )

    pitch = _angle(columns, "pitch")
    # Rx(pitch)·Ry(roll) takes the line to the right mark to (cos r, sin p·sin r, -cos p·sin r).
    length = np.linalg.norm(apart, axis=1)
    sine = apart[:, 2] / (length * np.cos(pitch))
    roll = -np.arcsin(np.clip(sine, -1, 1))
    # Seen from above: the line before the heading turns it, and as it was surveyed.
    aside = np.arctan2(np.sin(pitch) * np.sin(roll), np.cos(roll))
    direction = np.arctan2(apart[:, 1], apart[:, 0])
    heading = np.angle(np.exp(1j * (aside - direction)))
    middle = (left + right) / 2
    return np.column_stack([middle, heading, pitch, roll])


def read_nmea(
    path: str | Path, anchor: Anchor, quality: tuple[int, ...] = FIXED, height: float | None = None
) -> pd.DataFrame:
    """Read a track of a satellite receiver's antenna from NMEA 0183 sentences.

    Positions are from GGA, headings from HDT (dual antenna) where there are any, else from the
    course. Time is in seconds of the day (UTC), continued over midnight. Pitch and roll are zero:
    NMEA has no standard sentence for them. For lever arm and latency see
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
        The track (:func:`flgpr.model.track.make_track`); fixes not used are counted in
        ``attrs["notes"]``.

    Raises
    ------
    ValueError
        If a sentence is damaged, there are fewer than two fixes, or a height is needed.
    """
    path = existing(path)
    if height is None and not anchor.heights_known:
        raise ValueError("height must be given, the anchor's points have none")
    notes: list[str] = []
    log = _read_log(path, quality, notes)
    if len(log.fixes) < 2:
        raise ValueError(
            f"{path}: two fixes of quality {quality} or more are needed, "
            f"got {len(log.fixes)} (all: {dict(log.qualities)})"
        )

    table = np.array(log.fixes)
    is_later = np.append(True, np.diff(table[:, 0]) > 0)
    time = table[is_later, 0]
    position = anchor.from_geodetic(table[is_later, 1:])
    if height is not None:
        position[:, 2] = height
    heading = _headings(time, position, log.headings, anchor.azimuth)
    track = make_track(time, position, heading)

    _note_unused(log, quality, notes)
    not_later = np.count_nonzero(~is_later)
    if not_later:
        notes.append(f"{not_later} fixes whose time does not go on are not used")
    if not log.headings:
        notes.append("no sentence tells a heading: it is the direction of the way")
    notes.append("pitch and roll are taken as 0: NMEA tells none")
    track.attrs["notes"] = notes
    return track


def _note_unused(log: _NmeaLog, quality: tuple[int, ...], notes: list[str]) -> None:
    """Add a note of the fixes of a log that are of other qualities, with counts of each."""
    total = sum(log.qualities.values())
    unused = total - len(log.fixes)
    if not unused:
        return
    counts = ", ".join(f"{count} of {kind}" for kind, count in sorted(log.qualities.items()))
    notes.append(f"{unused} of {total} fixes are not of quality {quality} and not used ({counts})")


def _read_log(path: Path, quality: tuple[int, ...], notes: list[str]) -> _NmeaLog:
    """Read the GGA of some qualities and the HDT of a log."""
    log = _NmeaLog([], [], Counter())
    now = -math.inf

    def take(message: Any) -> None:
        nonlocal now
        if message.msgID == "GGA":
            log.qualities[message.quality] += 1
            if message.quality in quality:
                now = _continued_time(message.time, now)
                log.fixes.append((now, *_place_of(message)))
        elif message.msgID == "HDT" and math.isfinite(now):
            log.headings.append((now, math.radians(float(message.headingT))))

    _read_sentences(path, notes, take)
    return log


def _read_sentences(path: Path, notes: list[str], take: Callable[[Any], None]) -> None:
    """Hand on the sentences of a log one by one; a damaged one is a ValueError with its line."""
    library = optional("pynmeagps", "gnss")
    text = decode_text(read_named(path, MAX_MEMORY), path.name, notes)
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        sentence = line.strip().encode("latin-1", "replace") + b"\r\n"
        try:
            take(library.NMEAReader.parse(sentence))
        except Exception as error:
            message = " ".join(str(error).split())[:120]
            raise ValueError(
                f"{path}: line {number} is no valid NMEA sentence: {message}"
            ) from None


def nmea_places(path: str | Path, quality: tuple[int, ...] = FIXED) -> NDArray[np.float64]:
    """Read the positions of an NMEA log's GGA sentences.

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

    Raises
    ------
    ValueError
        If a sentence is damaged.
    """
    places: list[tuple[float, float, float]] = []

    def take(message: Any) -> None:
        if message.msgID == "GGA" and message.quality in quality:
            places.append(_place_of(message))

    _read_sentences(existing(path), [], take)
    return np.array(places, dtype=np.float64).reshape(-1, 3)


def _place_of(message: Any) -> tuple[float, float, float]:
    """Return longitude, latitude, degrees, and ellipsoidal height, m, of a GGA sentence."""
    return message.lon, message.lat, float(message.alt) + float(message.sep)


def _headings(
    time: FloatArray, position: FloatArray, headings: list[tuple[float, float]], azimuth: float
) -> FloatArray:
    """Return headings (fix,), rad, in the lane: of the sentences, or of the course if none."""
    if not headings:
        return course(position)
    stamp, angle = np.array(headings).T
    in_lane = np.interp(time, stamp, np.unwrap(angle)) - azimuth
    return np.asarray(np.angle(np.exp(1j * in_lane)), dtype=np.float64)


def _continued_time(clock: Any, last: float) -> float:
    """Return a time of the day, s, continued over midnight from the ``last`` one."""
    now = clock.hour * 3600 + clock.minute * 60 + clock.second + clock.microsecond * 1e-6
    if math.isfinite(last):
        now += _DAY * math.floor(last / _DAY)
        if now < last - _DAY / 2:
            now += _DAY
    return float(now)


def _needed(columns: Mapping[str, NDArray[Any]], name: str) -> FloatArray:
    """Return a column of real numbers that must be there."""
    if name not in columns or np.iscomplexobj(columns[name]):
        known = ", ".join(key for key in columns if key != "table") or "no header line"
        raise ValueError(f"the column {name} is missing; got {known}")
    return np.asarray(columns[name], dtype=np.float64)


def _angle(
    columns: Mapping[str, NDArray[Any]], name: str, default: FloatArray | None = None
) -> FloatArray:
    """Return an angle, rad, or ``default`` where there is no column of it."""
    if f"{name}_rad" in columns:
        return _needed(columns, f"{name}_rad")
    if f"{name}_deg" in columns:
        return np.asarray(np.radians(_needed(columns, f"{name}_deg")), dtype=np.float64)
    if default is None:
        raise ValueError(f"the column {name}_deg or {name}_rad is missing")
    return default
