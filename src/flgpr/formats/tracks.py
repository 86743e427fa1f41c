"""Poses from other instruments: tracks as CSV or NMEA, surveyed points per scan."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.door import read_named
from flgpr.formats.arrays import open_arrays
from flgpr.formats.axes import attitude_of, axes_matrix
from flgpr.formats.mapping import factor
from flgpr.formats.motive import is_motive
from flgpr.geo.anchor import Anchor
from flgpr.model.track import TRACK_COLUMNS, bridged, course, make_track
from flgpr.store.extras import optional
from flgpr.store.files import existing, faults_of
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.store.text import decode_text
from flgpr.store.text_tables import read_text_table

_DAY = 86400.0
FIXED = (4,)
"""GGA quality of a fixed carrier-phase solution."""


def read_track(
    path: str | Path,
    heading: str = "column",
    body: str | None = None,
    axes: Sequence[str] | None = None,
    max_gap: float = 1.0,
) -> pd.DataFrame:
    """Read a track from CSV with the columns ``time_s``, ``x_m``, ``y_m``, ``z_m`` in the lane frame.

    Angles are in ``heading_deg`` or ``heading_rad``, ``pitch_deg`` and ``roll_deg`` or the same
    with rad. With ``heading`` "column" all three must be there; with "course" the heading is the
    direction of the way, and pitch and roll are zero where there are no such columns. What an
    import writes beside a run (``time``, ``x``, ...) is read, too, and a take of OptiTrack Motive:
    of the rigid body ``body`` (the only one, if it is None), with ``axes``, which of Motive's axes
    are the lane's x, y and z, such as ``("x", "-z", "y")`` where Motive has y up; the body's own
    axes must have been made along them, with the vehicle along +y of the lane.

    Fixes that are not finite are left out and counted in ``attrs["notes"]``. A missing column, a stretch of more than
    ``max_gap`` s without a finite fix between others that are left out, or a time that does not increase is a
    ValueError.
    """
    if heading not in ("column", "course"):
        raise ValueError(f"heading must be 'column' or 'course', got {heading!r}")
    take = is_motive(existing(path, "track"))
    if not take and (body is not None or axes is not None):
        raise ValueError(f"{path}: body and axes are of takes of OptiTrack Motive, this is none")
    reading: list[str] = []
    with faults_of(path):
        time, pose = (
            _take(Path(path), body, axes)
            if take
            else _fixes(read_text_table(Path(path), reading), heading, reading)
        )
        keep, notes = bridged(time, pose, max_gap)
        if heading == "course":
            pose[keep, 3] = course(pose[keep, :3])
        track = make_track(time[keep], pose[keep, :3], *pose[keep, 3:].T)
    track.attrs["notes"] = [*reading, *notes]
    return track


def _fixes(
    columns: Mapping[str, NDArray[Any]], heading: str, notes: list[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Take times and poses (fix, 6) of a table; a heading along the way is left zero."""
    names = [column.name for column in TRACK_COLUMNS]
    if set(names) <= set(columns):
        time, *parts = (_needed(columns, name) for name in names)
        return time, np.stack(parts, axis=1)
    time = _needed(columns, "time_s")
    place = [_needed(columns, f"{axis}_m") for axis in "xyz"]
    if heading == "course":
        angles = [0.0 * time, *(_angle(columns, name, 0.0 * time) for name in ("pitch", "roll"))]
        flat = [name for name in ("pitch", "roll") if not _has_angle(columns, name)]
        if flat:
            notes.append(f"no column tells {' and '.join(flat)}: 0 is taken")
    else:
        angles = [_angle(columns, name) for name in ("heading", "pitch", "roll")]
    return time, np.stack([*place, *angles], axis=1)


def _take(
    path: Path, body: str | None, axes: Sequence[str] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    opened = open_arrays(path)
    known = [name.removesuffix("/rotation") for name in opened.arrays if name.endswith("/rotation")]
    bodies = [name for name in known if f"{name}/position" in opened.arrays]
    if (body is None and len(bodies) != 1) or (body is not None and body not in bodies):
        raise ValueError(f"body must be one of {', '.join(bodies) or 'none'}, got {body!r}")
    if axes is None:
        raise ValueError(
            "axes must say which of Motive's axes are the lane's x, y and z, such as x,-z,y where Motive has y up"
        )
    name = body or bodies[0]
    place = opened.read(f"{name}/position")
    turn = opened.read(f"{name}/rotation")
    if turn.shape[1] != 4:
        raise ValueError(
            "a take with Euler angles needs a mapping that tells their order: export quaternions instead"
        )
    scale = factor(opened.arrays[f"{name}/position"].unit, "length", "the header's Length Units")
    pose = np.concatenate(
        [scale * place @ axes_matrix(axes).T, attitude_of(turn, axes, axes)], axis=1
    )
    return opened.read("time"), pose


def read_survey(path: str | Path) -> NDArray[np.float64]:
    """Read the poses (scan, 6) of stop-and-go scans from points surveyed in the lane, one CSV line per scan in order.

    Columns are either ``x_m``, ``y_m``, ``z_m`` of the array's reference point and ``heading_deg``, ``pitch_deg``,
    ``roll_deg`` (or rad), or the places of two marks on the array, ``left_x_m`` ... ``right_z_m``: then the reference
    point is midway, heading and roll follow from the line between them, and the pitch must be given. Poses are in m and
    rad.
    """
    columns = _columns(path)
    with faults_of(path):
        if "left_x_m" in columns:
            left, right = (
                np.stack([_needed(columns, f"{side}_{axis}_m") for axis in "xyz"], axis=1)
                for side in ("left", "right")
            )
            apart = right - left
            level = np.hypot(apart[:, 0], apart[:, 1])
            if not (level > 1e-3).all():
                raise ValueError(
                    f"left and right marks must lie apart, they coincide at scan {int(level.argmin())}"
                )
            pitch = _angle(columns, "pitch")
            # Rx(pitch)·Ry(roll) takes the line to the right mark to (cos r, sin p·sin r, -cos p·sin
            # r).
            roll = -np.arcsin(
                np.clip(apart[:, 2] / (np.linalg.norm(apart, axis=1) * np.cos(pitch)), -1, 1)
            )
            aside = np.arctan2(np.sin(pitch) * np.sin(roll), np.cos(roll))
            heading = np.angle(np.exp(1j * (aside - np.arctan2(apart[:, 1], apart[:, 0]))))
            pose = np.column_stack([(left + right) / 2, heading, pitch, roll])
        else:
            place = [_needed(columns, f"{axis}_m") for axis in "xyz"]
            pose = np.column_stack(
                [*place, *(_angle(columns, name) for name in ("heading", "pitch", "roll"))]
            )
        bad = ~np.isfinite(pose).all(axis=1)
        if bad.any():
            raise ValueError(f"poses must be finite, got other values for scan {int(bad.argmax())}")
    return pose


def read_nmea(
    path: str | Path, anchor: Anchor, quality: tuple[int, ...] = FIXED, height: float | None = None
) -> pd.DataFrame:
    """Read a track of a satellite receiver's antenna from NMEA 0183 sentences.

    Positions are from GGA of the given qualities, headings from HDT (dual antenna) where there are any, else from the
    way. Time is in seconds of the day (UTC), continued over midnight. Pitch and roll are zero: NMEA has no standard
    sentence for them. ``height`` is the antenna's over the ground, m, needed where the anchor has no heights. For lever
    arm and latency see :func:`flgpr.model.track.reference_track`. A damaged sentence or fewer than two fixes is a
    ValueError.
    """
    path = existing(path)
    nmea = optional("pynmeagps", "gnss")
    if height is None and not anchor.heights_known:
        raise ValueError("height must be given, the anchor's points have none")
    fixes: list[tuple[float, float, float, float]] = []
    headings: list[tuple[float, float]] = []
    seen: dict[int, int] = {}
    now = -math.inf
    notes: list[str] = []
    for number, line in enumerate(
        decode_text(read_named(path, MAX_MEMORY), path.name, notes).splitlines()
    ):
        if not line.strip():
            continue
        try:
            message = nmea.NMEAReader.parse(line.strip().encode("latin-1", "replace") + b"\r\n")
            if message.msgID == "GGA":
                seen[message.quality] = seen.get(message.quality, 0) + 1
                if message.quality in quality:
                    now = _later(message.time, now)
                    fixes.append(
                        (now, message.lon, message.lat, float(message.alt) + float(message.sep))
                    )
            elif message.msgID == "HDT" and math.isfinite(now):
                headings.append((now, math.radians(float(message.headingT))))
        except Exception as error:
            words = " ".join(str(error).split())[:120]
            raise ValueError(
                f"{path}: line {number + 1} is no valid NMEA sentence: {words}"
            ) from None
    if len(fixes) < 2:
        raise ValueError(
            f"{path}: two fixes of quality {quality} or more are needed, got {len(fixes)} (all: {seen})"
        )
    table = np.array(fixes)
    keep = np.append(True, np.diff(table[:, 0]) > 0)
    time = table[keep, 0]
    place = anchor.from_geodetic(table[keep, 1:])
    if height is not None:
        place[:, 2] = height
    track = make_track(time, place, _headings(time, place, headings, anchor.azimuth))
    unused = sum(seen.values()) - len(fixes)
    if unused:
        counts = ", ".join(f"{count} of {one}" for one, count in sorted(seen.items()))
        notes.append(
            f"{unused} of {sum(seen.values())} fixes are not of quality {quality} and not used ({counts})"
        )
    if not keep.all():
        notes.append(f"{np.count_nonzero(~keep)} fixes whose time does not go on are not used")
    if not headings:
        notes.append("no sentence tells a heading: it is the direction of the way")
    notes.append("pitch and roll are taken as 0: NMEA tells none")
    track.attrs["notes"] = notes
    return track


def nmea_places(path: str | Path, quality: tuple[int, ...] = FIXED) -> NDArray[np.float64]:
    """Read the places (fix, 3) of an NMEA log: longitude, latitude (degrees) and ellipsoidal height (m) of its GGA.

    ``quality`` is as for :func:`read_nmea`; a damaged sentence is a ValueError.
    """
    path = existing(path)
    nmea = optional("pynmeagps", "gnss")
    places: list[tuple[float, float, float]] = []
    for number, line in enumerate(
        decode_text(read_named(path, MAX_MEMORY), path.name).splitlines()
    ):
        if not line.strip():
            continue
        try:
            message = nmea.NMEAReader.parse(line.strip().encode("latin-1", "replace") + b"\r\n")
            if message.msgID == "GGA" and message.quality in quality:
                places.append((message.lon, message.lat, float(message.alt) + float(message.sep)))
        except Exception as error:
            words = " ".join(str(error).split())[:120]
            raise ValueError(
                f"{path}: line {number + 1} is no valid NMEA sentence: {words}"
            ) from None
    return np.array(places, dtype=np.float64).reshape(-1, 3)


def _headings(
    time: NDArray[np.float64],
    place: NDArray[np.float64],
    headings: list[tuple[float, float]],
    azimuth: float,
) -> NDArray[np.float64]:
    if not headings:
        return course(place)
    stamp, angle = np.array(headings).T
    found = np.interp(time, stamp, np.unwrap(angle)) - azimuth
    return np.asarray(np.angle(np.exp(1j * found)), dtype=np.float64)


def _later(clock: Any, last: float) -> float:
    now = clock.hour * 3600 + clock.minute * 60 + clock.second + clock.microsecond * 1e-6
    if math.isfinite(last):
        now += _DAY * math.floor(last / _DAY)
        if now < last - _DAY / 2:
            now += _DAY
    return float(now)


def _columns(path: str | Path) -> dict[str, NDArray[Any]]:
    with faults_of(path):
        return read_text_table(existing(path))


def _needed(columns: Mapping[str, NDArray[Any]], name: str) -> NDArray[np.float64]:
    if name not in columns or np.iscomplexobj(columns[name]):
        known = ", ".join(key for key in columns if key != "table") or "no header line"
        raise ValueError(f"the column {name} is missing; got {known}")
    return np.asarray(columns[name], dtype=np.float64)


def _has_angle(columns: Mapping[str, NDArray[Any]], name: str) -> bool:
    return f"{name}_rad" in columns or f"{name}_deg" in columns


def _angle(
    columns: Mapping[str, NDArray[Any]], name: str, default: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    if f"{name}_rad" in columns:
        return _needed(columns, f"{name}_rad")
    if f"{name}_deg" in columns:
        return np.asarray(np.radians(_needed(columns, f"{name}_deg")), dtype=np.float64)
    if default is None:
        raise ValueError(f"the column {name}_deg or {name}_rad is missing")
    return default
