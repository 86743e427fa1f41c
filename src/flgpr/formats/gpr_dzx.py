"""GSSI's XML beside a DZT: marks, spacing and waypoints, as readgssi and RGPR read it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from flgpr.formats.gpr_parts import (
    FloatArray,
    length_unit,
    read_companion,
)

_MOST_WAYPOINTS = 1_000_000
_AGREE = 0.05  # share by which two spacings of one file may differ


@dataclass(frozen=True)
class DzxContent:
    """What GSSI's XML beside a DZT states."""

    marks: tuple[int, ...] = ()  #: scans, from 0, that the operator marked
    spacing: float | None = None  #: of scans, m
    #: (waypoint, 2): scan and distance along the line, m
    distances: FloatArray = field(default_factory=lambda: np.empty((0, 2)))


class _Waypoints(NamedTuple):
    """What the waypoints of a DZX state."""

    marks: tuple[int, ...]
    distances: list[tuple[float, float]]  # scan, and m along the line
    corners: list[tuple[float, float, float]]  # scan, x and y, m


def read_dzx(path: Path | None, count: int, notes: list[str]) -> DzxContent:
    """Read a ``.dzx``, GSSI's XML, as readgssi and RGPR do.

    Parameters
    ----------
    path : Path or None
        The file; None if there is none.
    count : int
        Scans of the recording.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    DzxContent
        What it states of the scans.
    """
    if path is None:
        return DzxContent()
    try:
        text = read_companion(path, notes)
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise ValueError("it declares entities")
        content = re.sub(r"^\s*<\?xml[^>]*\?>", "", text)
        root = ElementTree.fromstring(content)  # noqa: S314  # entities are refused
    except (ValueError, ElementTree.ParseError) as error:
        notes.append(
            f"{path.name} was found and not understood: {' '.join(str(error).split())[:120]}"
        )
        return DzxContent()
    unit = _text_of(root, "horizontalUnit")
    scale = length_unit(unit or "m")
    if scale is None:
        notes.append(
            f"{path.name} has lengths in {unit[:20]!r}, which is no unit that is known: "
            "they are not used"
        )

    waypoints = _read_waypoints(root, count, scale)
    spacing = _number(_text_of(root, "unitsPerScan"))
    known = None
    if scale is not None and np.isfinite(spacing) and spacing > 0:
        known = spacing * scale

    rows = waypoints.distances or _along(waypoints.corners)
    table = np.array(rows, dtype=np.float64).reshape(-1, 2)
    if known is not None and not waypoints.distances and len(table) > 1:
        measured = np.ptp(table[:, 1]) / max(np.ptp(table[:, 0]), 1.0)
        if abs(measured - known) > _AGREE * known:
            notes.append(
                f"{path.name} contradicts itself: its scans are {known:.4g} m apart by "
                f"unitsPerScan and {measured:.4g} m by localCoords; neither is used"
            )
            return DzxContent(waypoints.marks)
    return DzxContent(waypoints.marks, known, table)


def _read_waypoints(root: ElementTree.Element, count: int, scale: float | None) -> _Waypoints:
    """Return what the waypoints state of ``count`` scans; ``scale`` is their unit of length, m."""
    marks: set[int] = set()
    distances: list[tuple[float, float]] = []
    corners: list[tuple[float, float, float]] = []
    for waypoint in _waypoints(root):
        scan = _number(waypoint.get("scan", waypoint.get("scanSampChanProp", "").split(",")[0]))
        if not (np.isfinite(scan) and 0 <= scan < count):
            continue
        if waypoint.get("mark", "").strip().lower() == "user" or "scanSampChanProp" in waypoint:
            marks.add(int(scan))
        if scale is None:
            continue
        distance = _number(waypoint.get("distance", ""))
        if np.isfinite(distance):
            distances.append((scan, distance * scale))
        local = [_number(cell) for cell in waypoint.get("localCoords", "").split(",")[:2]]
        if len(local) == 2 and np.isfinite(local).all():
            corners.append((scan, local[0] * scale, local[1] * scale))
    return _Waypoints(tuple(sorted(marks)), distances, corners)


def _along(corners: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
    """Return scan and distance, m, along the line through points (scan, x, y) by their scans."""
    rows: list[tuple[float, float]] = []
    distance = 0.0
    ordered = sorted(corners)
    for number, (scan, x, y) in enumerate(ordered):
        if number:
            _, last_x, last_y = ordered[number - 1]
            distance += float(np.hypot(x - last_x, y - last_y))
        rows.append((scan, distance))
    return rows


def _waypoints(root: ElementTree.Element) -> Iterator[dict[str, str]]:
    """Yield the waypoints of all profiles and targets: the texts of their entries by name."""
    count = 0
    for element in root.iter():
        if _name(element) in ("WayPt", "TargetWayPt"):
            count += 1
            if count > _MOST_WAYPOINTS:
                return
            yield {_name(entry): entry.text or "" for entry in element}


def _name(element: ElementTree.Element) -> str:
    """Return the name of an element without its name space."""
    return str(element.tag).rpartition("}")[2]


def _text_of(root: ElementTree.Element, name: str) -> str:
    """Return the text of the first element of a name; empty if there is none."""
    return next((element.text or "" for element in root.iter() if _name(element) == name), "")


def _number(text: str) -> float:
    """Return a number; NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan
