"""GSSI's XML beside a DZT: marks, spacing and waypoints, as readgssi and RGPR read it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from flgpr.budget import Budget
from flgpr.types import FloatArray
from flgpr_exchange.gpr.parts import length_unit, read_companion

_MOST_WAYPOINTS = 1_000_000
_MOST_MEMORY = 300 * 10**6  # bytes that all elements may take: 3 million of them
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
        Budget("its XML", _MOST_MEMORY).spend_values(text.count("<") - text.count("</"))
        content = re.sub(r"^\s*<\?xml[^>]*\?>", "", text)
        root = ElementTree.fromstring(content)  # noqa: S314  # entities are refused
    except (ValueError, ElementTree.ParseError) as error:
        reason = " ".join(str(error).split())
        notes.append(f"{path.name} was found and not understood: {reason[:120]}")
        return DzxContent()
    unit = _text_of(root, "horizontalUnit")
    scale = length_unit(unit or "m")
    if scale is None:
        notes.append(
            f"{path.name} has lengths in {unit[:20]!r}, which is no unit that is known: "
            "they are not used"
        )

    waypoints = _read_waypoints(root, count, scale)
    units_per_scan = _number(_text_of(root, "unitsPerScan"))
    spacing = None
    if scale is not None and np.isfinite(units_per_scan) and units_per_scan > 0:
        spacing = units_per_scan * scale

    rows = waypoints.distances or _along(waypoints.corners)
    table = np.array(rows, dtype=np.float64).reshape(-1, 2)
    if spacing is not None and not waypoints.distances and len(table) > 1:
        scans = max(np.ptp(table[:, 0]), 1.0)
        measured = np.ptp(table[:, 1]) / scans
        if abs(measured - spacing) > _AGREE * spacing:
            notes.append(
                f"{path.name} contradicts itself: its scans are {spacing:.4g} m apart by "
                f"unitsPerScan and {measured:.4g} m by localCoords; neither is used"
            )
            return DzxContent(waypoints.marks)
    return DzxContent(waypoints.marks, spacing, table)


def _read_waypoints(root: ElementTree.Element, count: int, scale: float | None) -> _Waypoints:
    """Return what the waypoints state of ``count`` scans; ``scale`` is their unit of length, m."""
    marks: set[int] = set()
    distances: list[tuple[float, float]] = []
    corners: list[tuple[float, float, float]] = []
    for waypoint in _waypoints(root):
        # A target has its scan in a list of scan, sample, channel and property.
        is_target = "scanSampChanProp" in waypoint
        scan_of_target = waypoint.get("scanSampChanProp", "").split(",")[0]
        scan = _number(waypoint.get("scan", scan_of_target))
        if not (np.isfinite(scan) and 0 <= scan < count):
            continue
        is_of_user = waypoint.get("mark", "").strip().lower() == "user"
        if is_of_user or is_target:
            marks.add(int(scan))
        if scale is None:
            continue
        distance = _number(waypoint.get("distance", ""))
        if np.isfinite(distance):
            distances.append((scan, distance * scale))
        cells = waypoint.get("localCoords", "").split(",")
        local = [_number(cell) for cell in cells[:2]]
        if len(local) == 2 and np.isfinite(local).all():
            x, y = local
            corners.append((scan, x * scale, y * scale))
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
    for element in root.iter():
        if _name(element) == name:
            return element.text or ""
    return ""


def _number(text: str) -> float:
    """Return a number; NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan
