"""Files that lie beside a recording: positions of a satellite receiver, marks and spacing.

``.gps`` and ``.gp2`` are Sensors & Software's, ``.dzg`` and ``.dzx`` GSSI's, ``.cor`` MALÅ's and ImpulseRadar's. Their
layouts are as files show them and as RGPR, readgssi, ridal and ImpDAR read them. What is found and not used is told in
``notes``, with a count; nothing in such a file keeps the recording itself from being read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.gpr_parts import (
    DAY,
    FOOT,
    FloatArray,
    find_beside,
    is_header_line,
    length_unit,
    text_beside,
)

NO_FIXES: FloatArray = np.empty((0, 4))
_SENTENCE = re.compile(r"\$[A-Z]{2}(GGA|RMC),([^*\"\s]*)")
_TRACE = re.compile(r"\s*Trace\s*#\s*(\d{1,9})", re.IGNORECASE)
_SCAN = re.compile(r"\s*\$GSSIS,(\d{1,9})")
_NOT_MEASURED = {"6": "dead reckoning", "7": "put in by hand", "8": "simulated"}
"""Qualities of GGA (NMEA 0183) that are no measurement of a satellite receiver."""
_ROW = re.compile(r"\s*\"?(\d{1,9})\"?\s*[,;\t]")
_ANGLE = re.compile(r"([NSEW]?)([-+]?[\d.:]+)([NSEW]?)")
_ANGLE_SIGNS = re.compile("[°º'’′\"”″]+")  # of degrees, minutes and seconds
_HEIGHT = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_MOST_WAYPOINTS = 1_000_000
_AGREE = 0.05  # share by which two spacings of one file may differ


class Fix(NamedTuple):
    """A position of a satellite receiver, as a file tells it."""

    trace: float  #: from 0
    longitude: float  #: degrees, WGS 84
    latitude: float
    height: float  #: over the ellipsoid, m; NaN if the file tells none
    time: float = np.nan  #: s of the day; NaN if unknown


@dataclass(frozen=True)
class Fixes:
    """The positions that are used, in the order of their traces."""

    table: FloatArray = field(
        default_factory=lambda: NO_FIXES
    )  #: (fix, 4): trace, longitude, latitude, height
    time: FloatArray = field(
        default_factory=lambda: np.empty(0)
    )  #: (fix,) s of the first day, NaN where unknown


def nmea_fixes(
    path: Path | None, count: int, notes: list[str], numbers: NDArray[np.integer] | None = None
) -> Fixes:  # fmt: skip
    """Return the positions of NMEA sentences, each after a line that names its trace, or in a row that begins with it.

    GGA is used; RMC, which has no height, where there is no GGA. ``numbers`` (trace,) are the traces' own numbers from
    1 on, where a recording has them.
    """
    if path is None:
        return Fixes()
    try:
        text = text_beside(path, notes)
    except ValueError as error:
        notes.append(f"{path.name} was found and not understood: {error}")
        return Fixes()
    found: dict[str, list[Fix]] = {"GGA": [], "RMC": []}
    sentences = 0
    nowhere = 0
    unusable = 0
    not_measured: dict[str, int] = {}
    trace: int | None = None
    for line in text.splitlines():
        named = _TRACE.match(line)
        scan = _SCAN.match(line)
        if named is not None:
            trace = int(named[1]) - 1
        elif scan is not None:
            trace = int(scan[1])
        sentence = _SENTENCE.search(line)
        if sentence is None:
            continue
        row = _ROW.match(line[: sentence.start()])
        if row is not None:
            trace = int(row[1]) - 1
        sentences += 1
        cells = sentence[2].split(",")
        fix = _fix_of_sentence(sentence[1], cells, trace)
        if fix is not None and sentence[1] == "GGA" and cells[5] in _NOT_MEASURED:
            quality = _NOT_MEASURED[cells[5]]
            not_measured[quality] = not_measured.get(quality, 0) + 1
        if fix is None:
            unusable += 1
        elif trace is None:
            nowhere += 1
        else:
            found[sentence[1]].append(fix)
    if not sentences:
        notes.append(f"{path.name} was found and holds no position that is understood")
    if unusable:
        notes.append(
            f"{unusable} of {sentences} sentences of {path.name} tell no position (the receiver had no fix)"
        )
    for quality, number in not_measured.items():
        notes.append(
            f"{number} of {sentences} sentences of {path.name} are {quality}: they are used"
        )
    if nowhere:
        notes.append(f"{nowhere} positions of {path.name} name no trace and are not used")
    if found["RMC"] and not found["GGA"]:
        notes.append(f"{path.name} holds RMC sentences alone, which tell no height")
    return settle_fixes(found["GGA"] or found["RMC"], count, notes, path.name, numbers)


def _fix_of_sentence(kind: str, cells: Sequence[str], trace: int | None) -> Fix | None:
    """Return the position of a GGA or RMC sentence (NMEA 0183); None if it tells none."""
    lowest, quality, nothing = (1, 5, "0") if kind == "GGA" else (2, 1, "V")
    if len(cells) < (11 if kind == "GGA" else 6) or cells[quality] in (nothing, ""):
        return None
    try:
        latitude = _nmea_degrees(cells[lowest])
        longitude = _nmea_degrees(cells[lowest + 2])
        height = _gga_height(cells) if kind == "GGA" else np.nan
    except (ValueError, OverflowError):
        return None
    latitude = -latitude if cells[lowest + 1] == "S" else latitude
    longitude = -longitude if cells[lowest + 3] == "W" else longitude
    return Fix(
        np.nan if trace is None else trace, longitude, latitude, height, _clock_time(cells[0])
    )


def _nmea_degrees(text: str) -> float:
    """Return degrees of ``dddmm.mmmm``."""
    value = float(text)
    return int(value // 100) + value % 100 / 60


def _gga_height(cells: Sequence[str]) -> float:
    """Return the height over the ellipsoid: that over the sea and the geoid's, in the units that the cells name."""
    if not cells[8]:
        return np.nan
    height = float(cells[8]) * (FOOT if cells[9].upper() == "F" else 1.0)
    if len(cells) > 11 and cells[10]:
        height += float(cells[10]) * (FOOT if cells[11].upper() == "F" else 1.0)
    return height


def _clock_time(text: str) -> float:
    """Return the second of the day of ``hhmmss.ss`` or ``hh:mm:ss``; NaN if it is none."""
    found = re.fullmatch(r"(\d{1,2}):?(\d{2}):?(\d{2}(?:[.,]\d*)?)", text.strip())
    if found is None:
        return np.nan
    return 3600.0 * int(found[1]) + 60.0 * int(found[2]) + float(found[3].replace(",", "."))


def cor_fixes(path: Path | None, count: int, notes: list[str]) -> Fixes:
    """Return the positions of a ``.cor``: trace (from 1), date, time, latitude, N or S, longitude, E or W, height.

    Columns are parted by tabs, blanks, semicolons or commas; decimals may have commas where commas do not part the
    columns. Latitude and longitude may be ``deg:min:s``, or have the signs of these, and may carry their letter or a
    sign. Another letter makes a row that is not understood: O is east in German, and west in French and Spanish.
    """
    if path is None:
        return Fixes()
    try:
        lines = text_beside(path, notes).splitlines()
    except ValueError as error:
        notes.append(f"{path.name} was found and not understood: {error}")
        return Fixes()
    found: list[Fix] = []
    strange = 0
    for number, line in enumerate(lines):
        names_columns = not found and is_header_line(line)
        is_text = number == 0 and not line.strip().lstrip("\"'")[:1].isdigit()
        if not line.strip() or names_columns or is_text:
            continue
        fix = _fix_of_row(_cor_cells(line))
        if fix is None:
            strange += 1
        else:
            found.append(fix)
    if strange:
        notes.append(
            f"{strange} of {strange + len(found)} lines of {path.name} were not understood and are left out"
        )
    return settle_fixes(found, count, notes, path.name)


def _cor_cells(line: str) -> list[str]:
    """Split a line of a ``.cor`` into cells with decimal points."""
    cells = re.split(r"[;\t ]+", line.strip().strip(";"))
    if len(cells) >= 5:  # commas are decimal, or stand beside blanks
        return [cell.strip('",').replace(",", ".") for cell in cells]
    return [cell.strip('" ') for cell in re.split(r"[,;\t]", line.strip())]


def _fix_of_row(cells: Sequence[str]) -> Fix | None:
    """Return the position that a row of a ``.cor`` tells; None if it is not understood."""
    if len(cells) < 6 or not re.fullmatch(r"\d{1,9}(\.0*)?", cells[0]):
        return None
    latitude, at = _angle_at(cells, 3, "NS")
    longitude, at = _angle_at(cells, at, "EW")
    if latitude is None or longitude is None:
        return None
    height = _HEIGHT.match(cells[at]) if at < len(cells) else None
    return Fix(
        float(cells[0]) - 1,
        longitude,
        latitude,
        float(height[0]) if height else np.nan,
        _clock_time(cells[2]),
    )


def _angle_at(cells: Sequence[str], at: int, letters: str) -> tuple[float | None, int]:
    """Return an angle that begins at a cell, its letter before, within or after it, and the cell that follows."""
    if at < len(cells) and cells[at].upper() in tuple(letters):
        side = cells[at].upper()
        at = at + 1
    else:
        side = ""
    text = _ANGLE_SIGNS.sub(":", cells[at].upper()) if at < len(cells) else ""
    found = _ANGLE.fullmatch(re.sub(r":(?=[NSEW]?$)", "", text))
    if found is None:
        return None, at
    side = side or found[1] or found[3]
    at += 1
    if not side and at < len(cells) and cells[at].upper() in tuple(letters):
        side = cells[at].upper()
        at = at + 1
    # M behind a longitude is the unit of a height that is missing.
    strange = at < len(cells) and re.fullmatch(r"[^\W\d_Mm]", cells[at]) is not None
    if strange or (side and side not in letters):
        return None, at
    try:
        parts = [float(part) for part in found[2].split(":")]
    except ValueError:
        return None, at
    angle = sum(abs(part) / 60**power for power, part in enumerate(parts))
    negative = found[2].startswith("-") or side == letters[1]
    return (-angle if negative else angle), at


def settle_fixes(
    found: Sequence[Fix], count: int, notes: list[str], name: str, numbers: NDArray[np.integer] | None = None
) -> Fixes:  # fmt: skip
    """Return the positions that lie on the Earth and on one of ``count`` traces, the first of each trace.

    Where the trace numbers of a file begin anew, lines were merged: then a position belongs to the trace of its own
    line, if ``numbers`` (trace,), the traces' own numbers from 1 on, begin anew as often. Otherwise those from there on
    are left out.
    """
    table = np.array(found, dtype=np.float64).reshape(-1, 5)
    table = _on_own_lines(table, notes, name, numbers)
    nowhere = (table[:, 1] == 0) & (table[:, 2] == 0)
    if nowhere.any():
        notes.append(
            f"{np.count_nonzero(nowhere)} of {len(found)} positions left out: 0 N 0 E, where no receiver was"
        )
    good = (
        np.isfinite(table[:, :3]).all(axis=1)
        & (np.abs(table[:, 1]) <= 180)
        & (np.abs(table[:, 2]) <= 90)
    )
    good &= (table[:, 0] >= 0) & (table[:, 0] < count) & ~(np.abs(table[:, 3]) >= 1e5)
    if not (good | nowhere).all():
        lost = np.count_nonzero(~(good | nowhere))
        notes.append(
            f"{lost} of {len(found)} positions left out: no place on the Earth, or no trace"
        )
    table = table[good & ~nowhere]
    table[:, 4] = _over_midnight(table[:, 4])
    back = np.diff(table[:, 4]) < 0
    if back.any():
        notes.append(f"the receiver's clock in {name} goes back {np.count_nonzero(back)} times")
    first = np.unique(table[:, 0], return_index=True)[1]
    if first.size < len(table):
        notes.append(
            f"{len(table) - first.size} positions are further ones of the same trace: its first is used"
        )
    table = table[first]
    flat = np.isnan(table[:, 3])
    if flat.any():
        notes.append(
            f"{np.count_nonzero(flat)} of {len(table)} positions tell no height: 0 m is taken"
        )
        table[flat, 3] = 0.0
    return Fixes(table[:, :4], table[:, 4])


def _on_own_lines(
    table: FloatArray, notes: list[str], name: str, numbers: NDArray[np.integer] | None
) -> FloatArray:  # fmt: skip
    """Put the positions of merged lines on their own traces; leave those out whose line is not known."""
    restarts = _restarts(table[:, 0])
    if not restarts.size:
        return table
    starts = np.empty(0, int) if numbers is None else np.flatnonzero(np.diff(numbers) < 0) + 1
    if numbers is None or starts.size != restarts.size:
        lost = len(table) - restarts[0]
        notes.append(
            f"{lost} of {len(table)} positions of {name} left out: its trace numbers begin anew, as those of merged "
            "lines, and the traces do not tell where"
        )
        return table[: restarts[0]]
    placed = table.copy()
    line_of_fix = np.searchsorted(restarts, np.arange(len(table)), side="right")
    edges = [0, *starts.tolist(), len(numbers)]
    for line in range(len(edges) - 1):
        own = np.arange(edges[line], edges[line + 1])
        mine = np.flatnonzero(line_of_fix == line)
        match = np.searchsorted(numbers[own], table[mine, 0] + 1)
        known = (match < own.size) & (
            numbers[own][np.minimum(match, own.size - 1)] == table[mine, 0] + 1
        )
        placed[mine, 0] = np.where(known, own[np.minimum(match, own.size - 1)], np.nan)
    notes.append(
        f"{len(edges) - 1} lines were merged: the positions of {name} are put on the traces of their own line"
    )
    return placed


def _restarts(trace: FloatArray) -> NDArray[np.intp]:
    """Return where trace numbers begin anew: they fall, and the next one does not go on from before the fall."""
    falls = np.flatnonzero(np.diff(trace) < 0) + 1
    following = np.append(trace, -np.inf)
    return falls[following[falls + 1] < trace[falls - 1]]


def _over_midnight(time: FloatArray) -> FloatArray:
    """Count times of the day on where they pass midnight."""
    known = np.flatnonzero(np.isfinite(time))
    time[known] += DAY * np.cumsum(np.append(0, np.diff(time[known]) < -DAY / 2))[: known.size]
    return time


@dataclass(frozen=True)
class DzxContent:
    """What GSSI's XML beside a DZT tells."""

    marks: tuple[int, ...] = ()  #: scans, from 0, that the operator marked
    spacing: float | None = None  #: of scans, m
    #: (waypoint, 2): scan and distance along the line, m
    distances: FloatArray = field(default_factory=lambda: np.empty((0, 2)))


def read_dzx(path: Path | None, count: int, notes: list[str]) -> DzxContent:
    """Return what a ``.dzx``, GSSI's XML, tells of ``count`` scans, as readgssi and RGPR read it."""
    if path is None:
        return DzxContent()
    try:
        text = text_beside(path, notes)
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("it declares entities")
        root = ElementTree.fromstring(re.sub(r"^\s*<\?xml[^>]*\?>", "", text))  # noqa: S314  # entities are refused
    except (ValueError, ElementTree.ParseError) as error:
        notes.append(
            f"{path.name} was found and not understood: {' '.join(str(error).split())[:120]}"
        )
        return DzxContent()
    unit = _text_of(root, "horizontalUnit")
    scale = length_unit(unit or "m")
    if scale is None:
        notes.append(
            f"{path.name} has lengths in {unit[:20]!r}, which is no unit that is known: they are not used"
        )
    spacing = _number(_text_of(root, "unitsPerScan"))
    marks: set[int] = set()
    distances: list[tuple[float, float]] = []
    corners: list[tuple[float, float, float]] = []
    for waypoint in _waypoints(root):
        scan = _number(waypoint.get("scan", waypoint.get("scanSampChanProp", "").split(",")[0]))
        if not (np.isfinite(scan) and 0 <= scan < count):
            continue
        if waypoint.get("mark", "").strip().lower() == "user" or "scanSampChanProp" in waypoint:
            marks.add(int(scan))
        distance = _number(waypoint.get("distance", ""))
        if scale is not None and np.isfinite(distance):
            distances.append((scan, distance * scale))
        local = [_number(part) for part in waypoint.get("localCoords", "").split(",")[:2]]
        if scale is not None and len(local) == 2 and np.isfinite(local).all():
            corners.append((scan, local[0] * scale, local[1] * scale))
    known = spacing * scale if scale is not None and np.isfinite(spacing) and spacing > 0 else None
    table = np.array(distances or _along(corners), dtype=np.float64).reshape(-1, 2)
    if known is not None and not distances and len(table) > 1:
        told = np.ptp(table[:, 1]) / max(np.ptp(table[:, 0]), 1.0)
        if abs(told - known) > _AGREE * known:
            notes.append(
                f"{path.name} contradicts itself: its scans are {known:.4g} m apart by unitsPerScan and {told:.4g} m "
                "by localCoords; neither is used"
            )
            return DzxContent(tuple(sorted(marks)))
    return DzxContent(tuple(sorted(marks)), known, table)


def _along(corners: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
    """Return scan and distance along the way through places (scan, x, y) in the order of their scans."""
    way: list[tuple[float, float]] = []
    distance = 0.0
    ordered = sorted(corners)
    for number, (scan, x, y) in enumerate(ordered):
        if number:
            distance += float(np.hypot(x - ordered[number - 1][1], y - ordered[number - 1][2]))
        way.append((scan, distance))
    return way


def _waypoints(root: ElementTree.Element) -> Iterator[dict[str, str]]:
    """Go through the waypoints of all profiles and targets: the texts of their entries by name."""
    seen = 0
    for element in root.iter():
        if _name(element) in ("WayPt", "TargetWayPt"):
            seen += 1
            if seen > _MOST_WAYPOINTS:
                return
            yield {_name(entry): entry.text or "" for entry in element}


def _name(element: ElementTree.Element) -> str:
    """Return the name of an element without its name space."""
    return str(element.tag).rpartition("}")[2]


def _text_of(root: ElementTree.Element, name: str) -> str:
    return next((element.text or "" for element in root.iter() if _name(element) == name), "")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def note_unread(path: Path, suffixes: Sequence[str], notes: list[str]) -> None:
    """Tell which files of the same name lie beside a recording and are not read."""
    for suffix in suffixes:
        beside = find_beside(path, suffix)
        if beside is not None:
            notes.append(f"{beside.name} lies beside it and is not read")
