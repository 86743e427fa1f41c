"""Where the traces of a SEG-Y file are, by the coordinates in their headers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flgpr.model.frames import steps_of
from flgpr.types import AnyArray, FloatArray, Notes, floats
from flgpr_exchange.gpr.along_line import between_neighbours, gather_of_separations, way_along
from flgpr_exchange.gpr.parts import float64, note_count
from flgpr_exchange.gpr.positions import Fixes, settle_fixes

_COORDINATES = {
    "source": "source coordinates (bytes 73-80)",
    "group": "group coordinates (bytes 81-88)",
    "cdp": "CDP coordinates (bytes 181-188)",
}
_LARGEST_ANGLE = {2: 648_000.0, 3: 180.0, 4: 1_800_000.0}
"""Codes of units of coordinates that are angles, and their largest numbers."""
_LARGEST_LENGTH = 1e7  # of coordinates of both axes; eastings and northings of a grid are smaller
_FLOATS = (1e-3, 1e8)  # sizes of coordinates that are written as floats
_SEPARATIONS = (0.005, 20.0)  # m, that the distance from source to receiver may be
_LONGEST_SEPARATION = 100.0  # m, of two antennas
_SPREAD = 0.1  # share of the mean separation by which constant ones may differ
_DEGREES = 3  # code of that unit
_STANDING = 1e-3  # m from trace to trace, that no line of traces has
_LEAST_OFFSET = 1e-3  # m, of a channel's antennas
_FAR = 10  # extents of a line; 0, 0 at more than so many from it is no place on it


class HeaderGeometry(NamedTuple):
    """What the trace headers state of where the traces are."""

    distance: FloatArray | None = None  # (trace,) along the line, m
    fixes: Fixes = Fixes()
    separation: float | None = None  # of the antennas, m
    offsets: FloatArray | None = None  # (channel, 2) of their middles across and along, m
    gather: str = ""  # what a survey is whose antennas move apart


def geometry_of_channels(
    table: AnyArray, channels: int, metre: float, notes: Notes
) -> HeaderGeometry:
    """Return where the traces of several channels are, one after the other in every record.

    Places along the line are those of the first channel. Where the antennas of one are elsewhere,
    or otherwise apart, is told.

    Parameters
    ----------
    table : (trace,) ndarray of records
        As for :func:`geometry_of`, all channels.
    channels : int
        Their number.
    metre, notes
        As for :func:`geometry_of`.

    Returns
    -------
    HeaderGeometry
        That of the first channel, with the offsets of all.
    """
    records = len(table) // channels * channels
    tables = [table[:records][channel::channels] for channel in range(channels)]
    placed = geometry_of(tables[0], metre, notes)
    for channel, own in enumerate(tables[1:], 1):
        separation = geometry_of(own, metre, []).separation
        if separation is not None and separation != placed.separation:
            first = "unknown" if placed.separation is None else f"{placed.separation:g} m"
            notes.append(
                f"antennas of channel {channel} are {separation:g} m apart, those of channel 0 "
                f"{first}, which is taken for all: import the channels apart, each with its separation"
            )
    if placed.distance is None:
        return placed
    name = next(
        name for name in _COORDINATES if np.ptp(_coordinates(tables[0], name), axis=0).any()
    )
    points = np.stack([_coordinates(one, name) * metre for one in tables])
    course = points[0, -1] - points[0, 0]
    course /= np.hypot(*course) or 1.0
    from_middle = (points - points.mean(axis=0)).mean(axis=1)
    offsets = np.stack([from_middle @ [course[1], -course[0]], from_middle @ course], axis=1)
    if np.abs(offsets).max() < _LEAST_OFFSET:
        return placed
    x = ", ".join(f"{value:.3g}" for value in offsets[:, 0])
    notes.append(f"antennas of the channels are put {x} m across, by the {_COORDINATES[name]}")
    return placed._replace(offsets=offsets)


def geometry_of(table: AnyArray, metre: float, notes: Notes) -> HeaderGeometry:
    """Return where the traces are, and how far apart their antennas.

    Parameters
    ----------
    table : (trace,) ndarray of records
        The trace headers: coordinates of source, group and CDP with their ``scalar`` and ``unit``
        (SEG-Y revision 2.1, bytes 71 to 90 and 181 to 188).
    metre : float
        Metres of a unit of coordinates that are lengths.
    notes : list of str
        Takes what is assumed, replaced or not used.

    Returns
    -------
    HeaderGeometry
        Distances or fixes, whichever the coordinates give, and the antennas' separation.
    """
    placed = _line_geometry(table, metre, notes)
    if placed.separation is None:
        placed = placed._replace(separation=_stated_offset(table, metre, notes))
    if np.isin(table["unit"], list(_LARGEST_ANGLE)).any():
        return placed
    source, group = _coordinates(table, "source"), _coordinates(table, "group")
    separations = _separations(source, group, metre)
    if separations.size < 2:
        return placed
    return placed._replace(gather=gather_of_separations(separations, " m", notes))


def _stated_offset(table: AnyArray, metre: float, notes: Notes) -> float | None:
    """Return the distance from source to receiver, m, where it is the same in all traces.

    By the standard it is in the unit of lengths; radars write it scaled as the coordinates are, or
    in millimetres.
    """
    stated = np.unique(np.abs(float64(table["offset"])))
    if stated.size != 1 or stated[0] == 0:
        return None
    offset = float(stated[0])
    scale = float(_scale_of(table)[0])
    manners = {
        "scaled as the coordinates are": offset * scale * metre,
        "in the unit of lengths": offset * metre,
        "in millimetres": offset / 1000,
    }
    for manner, separation in manners.items():
        if _SEPARATIONS[0] <= separation <= _SEPARATIONS[1]:
            notes.append(
                f"the antennas are {separation:g} m apart: the distance from source to receiver "
                f"(bytes 37-40) is {offset:g} in all traces, taken {manner}"
            )
            return separation
    notes.append(
        f"the distance from source to receiver (bytes 37-40), {offset:g} in all traces, is none of "
        "antennas and not used"
    )
    return None


def _line_geometry(table: AnyArray, metre: float, notes: Notes) -> HeaderGeometry:
    """Return distance along the line, or fixes, and the antennas' separation, if stated."""
    coordinates: dict[str, FloatArray] = {}  # (trace, 2) that change along the line
    for name, description in _COORDINATES.items():
        points = _coordinates(table, name, notes)
        if np.ptp(points, axis=0).any():
            coordinates[name] = points
        elif points.any() and len(points) > 1:
            notes.append(f"the {description} are the same in all traces: they are not used")
    if not coordinates:
        return HeaderGeometry()
    name, points = next(iter(coordinates.items()))
    units = np.unique(table["unit"])
    if units.size > 1:
        notes.append(
            f"its traces have {units.size} units of coordinates: "
            f"the {_COORDINATES[name]} are not used"
        )
        return HeaderGeometry()

    unit = int(units[0])
    if unit not in _LARGEST_ANGLE and _are_degrees(points * metre):
        notes.append(
            f"the {_COORDINATES[name]} are taken as degrees, though their unit is {unit}: as lengths "
            f"all traces would lie within {np.ptp(points, axis=0).max() * metre:.2g} m"
        )
        unit = _DEGREES
    if unit in _LARGEST_ANGLE:
        notes.append(f"the positions are the {_COORDINATES[name]} of the traces")
        fixes = np.full((len(points), 5), np.nan)  # neither heights nor times are known
        fixes[:, 0] = np.arange(len(points))
        fixes[:, 1:3] = _degrees(points, unit)
        return HeaderGeometry(fixes=settle_fixes(fixes, len(points), notes, "the trace headers"))
    if unit != 1:
        notes.append(f"the unit of its coordinates is {unit}: they are taken as lengths")

    points = _without_far_zeros(points, notes)
    settled = way_along(points * metre, f"the {_COORDINATES[name]}", notes)
    separation = _separation(coordinates, metre, notes)
    for other in coordinates:
        gives_separation = other == "group" and separation is not None
        if other != name and not gives_separation:
            notes.append(f"the {_COORDINATES[other]} are not used")
    return HeaderGeometry(settled, Fixes(), separation)


def _are_degrees(points: FloatArray) -> bool:
    """Return whether points (trace, 2), m, are longitude and latitude rather than lengths.

    As lengths they stand still; as degrees they go at the pace of traces.
    """
    longitude, latitude = np.abs(points).max(axis=0)
    step = float(np.median(steps_of(points))) if len(points) > 1 else 0.0
    is_far = np.abs(points).max() > _STANDING * len(points)
    return bool(longitude <= 180 and latitude <= 90 and is_far and 0 < step < _STANDING / 10)


def _scale_of(table: AnyArray) -> FloatArray:
    """Return the factors (trace,) of the coordinates, by their scalar (bytes 71-72)."""
    scalar = float64(table["scalar"])
    # By the standard a negative scalar divides; 0 counts as 1.
    return np.where(scalar < 0, 1 / np.maximum(-scalar, 1), np.maximum(scalar, 1))


def _coordinates(table: AnyArray, name: str, notes: Notes | None = None) -> FloatArray:
    """Return coordinates (trace, 2) of the trace headers, by their scalar, in the headers' unit.

    Some programs write floats where the standard has whole numbers: those are told by what they
    would be as whole numbers, beyond all places.
    """
    words = np.stack([table[f"{name}_{axis}"] for axis in "xy"], axis=1)
    scale = _scale_of(table)[:, None]
    whole = words * scale
    largest = _LARGEST_ANGLE.get(int(table["unit"][0]), _LARGEST_LENGTH)
    is_set = words != 0
    if not is_set.any() or not (np.abs(whole[is_set]) > largest).all():
        return whole
    numbers = float64(words.view(words.dtype.str.replace("i", "f")))
    size = np.abs(numbers[is_set])
    if not ((size >= _FLOATS[0]) & (size <= _FLOATS[1])).all():
        return whole
    if notes is not None:
        scaled = " without their scalar" if (scale != 1).any() else ""
        notes.append(
            f"the {_COORDINATES[name]} are read as floating point{scaled}, as some programs write "
            f"them: as whole numbers they would be up to {np.abs(whole).max():.3g}"
        )
    return numbers


def _separations(source: FloatArray, group: FloatArray, metre: float) -> FloatArray:
    """Return the distances (trace,), m, of the traces whose source and group are both stated.

    Coordinates 0, 0 count as not stated.
    """
    is_stated = source.any(axis=1) & group.any(axis=1)
    return floats(np.hypot(*(group[is_stated] - source[is_stated]).T) * metre)


def _degrees(points: FloatArray, unit: int) -> FloatArray:
    """Return degrees of coordinates in a unit of angle.

    They are seconds of arc (2), degrees (3), or degrees, minutes and seconds as digits (4).
    """
    if unit == 2:
        return points / 3600
    if unit == 3:
        return points
    degrees, rest = np.divmod(np.abs(points), 10_000)
    minutes, seconds = np.divmod(rest, 100)
    return floats(np.sign(points) * (degrees + minutes / 60 + seconds / 3600))


def _without_far_zeros(points: FloatArray, notes: Notes) -> FloatArray:
    """Return points (trace, 2) with those at 0, 0 put between their neighbours.

    They stay where the line is near 0, 0.
    """
    is_set = np.asarray(points.any(axis=1))
    missing = np.count_nonzero(~is_set)
    if not missing or not is_set.any():
        return points
    stated = points[is_set]
    if np.abs(stated).max(axis=1).min() <= _FAR * np.ptp(stated, axis=0).max():
        return points
    text = "are at 0, 0, far from all others, and are put between their neighbours"
    note_count(notes, missing, f"of {len(points)} traces {text}")
    return between_neighbours(points, is_set)


def _separation(coordinates: dict[str, FloatArray], metre: float, notes: Notes) -> float | None:
    """Return the distance of source and group, m, where it is the same in all traces."""
    if not {"source", "group"} <= set(coordinates):
        return None
    separations = _separations(coordinates["source"], coordinates["group"], metre)
    if not separations.size:
        return None
    mean = float(separations.mean())
    if not 0 < mean <= _LONGEST_SEPARATION or np.ptp(separations) > _SPREAD * mean:
        return None
    notes.append("the antennas' separation is the distance of source and group coordinates")
    return mean
