"""GSSI's XML beside a DZT: marks, spacing and waypoints, as readgssi and RGPR read it."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from flgpr.budget import Budget
from flgpr.model.printable import in_one_line
from flgpr.types import FloatArray, Notes, floats
from flgpr_exchange.gpr.parts import length_unit, read_companion

_MOST_WAYPOINTS = 1_000_000
_MOST_MEMORY = 300 * 10**6  # bytes that all elements may take: 3 million of them
_AGREE = 0.05  # share by which two spacings of one file may differ


class DzxContent(NamedTuple):
    """What GSSI's XML beside a DZT states."""

    marks: tuple[int, ...] = ()  #: scans, from 0, that the operator marked
    spacing: float | None = None  #: of scans, m
    #: (waypoint, 2): scan and distance along the line, m
    distances: FloatArray = np.empty((0, 2))


def read_dzx(path: Path | None, count: int, notes: Notes) -> DzxContent:
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
        notes.append(f"{path.name} was found and not understood: {in_one_line(error, 120)}")
        return DzxContent()
    unit = _text_of(root, "horizontalUnit")
    scale = length_unit(unit or "m")
    if scale is None:
        notes.append(
            f"{path.name} has lengths in {unit[:20]!r}, which is no unit that is known: "
            "they are not used"
        )

    marks, distances, corners = _read_waypoints(root, count, scale)
    spacing = _number(_text_of(root, "unitsPerScan")) * (scale or np.nan)
    if not 0 < spacing < np.inf:
        return DzxContent(marks, None, distances if len(distances) else corners)
    if len(distances) or len(corners) < 2:
        return DzxContent(marks, spacing, distances if len(distances) else corners)
    measured = np.ptp(corners[:, 1]) / max(np.ptp(corners[:, 0]), 1.0)
    if abs(measured - spacing) > _AGREE * spacing:
        notes.append(
            f"{path.name} contradicts itself: its scans are {spacing:.4g} m apart by "
            f"unitsPerScan and {measured:.4g} m by localCoords; neither is used"
        )
        return DzxContent(marks)
    return DzxContent(marks, spacing, corners)


def _read_waypoints(
    root: ElementTree.Element, count: int, scale: float | None
) -> tuple[tuple[int, ...], FloatArray, FloatArray]:
    """Return what the waypoints of all profiles and targets state of ``count`` scans.

    These are the scans with a mark, and (waypoint, 2) scans with their distance along the line, m,
    as it is stated, and as it follows from their places. ``scale`` is their unit of length, m.
    """
    marks: set[int] = set()
    distances: list[tuple[float, float]] = []
    corners: list[tuple[float, float, float]] = []  # scan, x and y, m
    elements = (one for one in root.iter() if _name(one) in ("WayPt", "TargetWayPt"))
    for element in islice(elements, _MOST_WAYPOINTS):
        waypoint = {_name(entry): entry.text or "" for entry in element}
        # A target has its scan in a list of scan, sample, channel and property.
        is_target = "scanSampChanProp" in waypoint
        scan_of_target = waypoint.get("scanSampChanProp", "").split(",")[0]
        scan = _number(waypoint.get("scan", scan_of_target))
        if not 0 <= scan < count:
            continue
        if is_target or waypoint.get("mark", "").strip().lower() == "user":
            marks.add(int(scan))
        if scale is None:
            continue
        distance = _number(waypoint.get("distance", ""))
        if np.isfinite(distance):
            distances.append((scan, distance * scale))
        local = [_number(cell) for cell in waypoint.get("localCoords", "").split(",")[:2]]
        if len(local) == 2 and np.isfinite(local).all():
            corners.append((scan, local[0] * scale, local[1] * scale))
    scans, x, y = floats(sorted(corners)).reshape(-1, 3).T
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))[: scans.size]
    stated = floats(distances).reshape(-1, 2)
    return tuple(sorted(marks)), stated, np.column_stack([scans, along])


def _name(element: ElementTree.Element) -> str:
    """Return the name of an element without its name space."""
    return str(element.tag).rpartition("}")[2]


def _text_of(root: ElementTree.Element, name: str) -> str:
    """Return the text of the first element of a name; empty if there is none."""
    return next((one.text or "" for one in root.iter() if _name(one) == name), "")


def _number(text: str) -> float:
    """Return a number; NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan
