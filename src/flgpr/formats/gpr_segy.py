"""SEG-Y of revisions 0 to 2, as radars write it, and Seismic Unix.

Byte positions are those of the standards (SEG-Y revision 2.1, Society of Exploration Geophysicists
2023), less one. Bytes 3507 to 3510 are the number of extra trace headers in revision 2.0; in 2.1 it
has two bytes, and the other two are the kind of survey. Files differ, and older ones have anything
there, so that a layout is taken that the file's size and its trace headers bear out.
"""

from __future__ import annotations

import itertools
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.gpr_parts import (
    FOOT,
    INTERVALS,
    MOST_SAMPLES,
    ZERO_ASSUMED,
    FloatArray,
    exact_floats,
    first_bytes,
    float64,
    gather_note,
    gather_of_separations,
    measured_distance,
    read_records,
)
from flgpr.formats.gpr_positions import Fix, Fixes, settle_fixes

_HEAD = 3600  # bytes of the text header and the binary header
_TRACE_HEAD = 240  # bytes
_STANZA = 3200  # bytes
_FORMATS = {
    1: "u4",
    2: "i4",
    3: "i2",
    5: "f4",
    6: "f8",
    8: "i1",
    10: "u4",
    11: "u2",
    16: "u1",
}
"""Types of the codes of sample formats; the first is IBM's floating point."""
_IBM = 1
_IEEE = 5
_NOT_READ = {
    4: "fixed point with gain",
    7: "24 bit",
    9: "64 bit",
    12: "64 bit unsigned",
    15: "24 bit unsigned",
}
_ORDERS = {b"\x01\x02\x03\x04": ">", b"\x04\x03\x02\x01": "<"}
_MOST_HEADERS = 1000  # extra text headers, or extra headers of a trace
_END_TEXT = re.compile(r"\s*\(\(\s*SEG\s*:\s*ENDTEXT\s*\)\)", re.IGNORECASE)
_WORDS = {
    "identification": ("i2", 28),
    "offset": ("i4", 36),
    "scalar": ("i2", 70),
    "source_x": ("i4", 72),
    "source_y": ("i4", 76),
    "group_x": ("i4", 80),
    "group_y": ("i4", 84),
    "unit": ("i2", 88),
    "late": ("i2", 108),
    "count": ("u2", 114),
    "interval": ("u2", 116),
    "weight": ("i2", 168),
    "cdp_x": ("i4", 180),
    "cdp_y": ("i4", 184),
}
"""Words of a trace header that are read: type and offset."""
_COORDINATES = {
    "source": "source coordinates (bytes 73-80)",
    "group": "group coordinates (bytes 81-88)",
    "cdp": "CDP coordinates (bytes 181-188)",
}
_ANGULAR = (2, 3, 4)  # codes of units of coordinates that are angles
_DEAD = (2, 3)  # codes of traces that are no data: dead, dummy
_PICOSECOND = 1e-12
_LONGEST_SEPARATION = 100.0  # m, of two antennas


@dataclass(frozen=True)
class _Layout:
    """Where the traces lie in a file."""

    start: int  #: of the first trace, bytes
    head: int  #: of a trace's headers, bytes
    samples: int
    end: int = 0  #: bytes behind the last trace


class _Geometry(NamedTuple):
    """What the trace headers state of where the traces are."""

    distance: FloatArray | None = None  # (trace,) along the line, m
    fixes: Fixes = Fixes()
    separation: float | None = None  # of the antennas, m
    gather: str = ""  # what a survey is whose antennas move apart


def read_segy(path: Path, limit: int) -> dict[str, Any]:
    """Read a SEG-Y file.

    Parameters
    ----------
    path : Path
        The recording.
    limit : int
        Bytes of memory to use.

    Returns
    -------
    dict of str to Any
        The entries of a :class:`flgpr.formats.gpr_files.GprSection`.

    Raises
    ------
    ValueError
        If the file contradicts itself.
    """
    raw = first_bytes(path, _HEAD + _TRACE_HEAD)
    if len(raw) < _HEAD:
        raise ValueError(f"its headers must have {_HEAD} bytes, the file has {len(raw)}")
    notes: list[str] = []
    order, code = _order_and_format(raw)
    revision = _revision_of(raw, order, notes)
    layout = _layout_of(path, raw, order, code, revision, notes)
    interval = _interval_of(raw, order, revision, notes)
    notes.append(
        "the sample interval is taken as picoseconds, as radars write it; "
        "SEG-Y itself has microseconds"
    )
    notes.append(ZERO_ASSUMED)
    record = _record(layout, order, code)
    table = read_records(path, layout.start, record, None, notes, limit, layout.end)
    samples = _ibm(table["samples"]) if code == _IBM else table["samples"]
    traces = exact_floats(samples, notes)
    _check_trace_headers(table, layout.samples, interval, notes)
    _leave_dead_out(table, traces, notes)
    geometry = _geometry(table, _unit_of_length(raw, order, notes), notes)
    return _entries(traces, layout.samples, interval, geometry, notes)


def _entries(
    traces: NDArray[np.floating[Any]],
    samples: int,
    interval: float,
    geometry: _Geometry,
    notes: list[str],
) -> dict[str, Any]:
    """Return the entries of a section of traces (trace, sample) at an interval, s."""
    return {
        "traces": traces[:, None],
        "delay": np.arange(samples) * interval,
        "distance": geometry.distance,
        "fixes": geometry.fixes.table,
        "fix_time": geometry.fixes.time,
        "separation": geometry.separation,
        "gather": geometry.gather,
        "history": tuple(notes),
    }


def _order_and_format(raw: bytes) -> tuple[str, int]:
    """Return the byte order and the code of the sample format."""
    stated = _ORDERS.get(raw[3296:3300])
    for order in (stated,) if stated else (">", "<"):
        code = _word(raw, f"{order}H", 3224)
        if code in _FORMATS:
            return order, code
    code = _word(raw, f"{stated or '>'}H", 3224)
    known = _NOT_READ.get(code) or _NOT_READ.get(_word(raw, "<H", 3224))
    meaning = f" ({known}, which is not read)" if known else ""
    raise ValueError(
        f"the code of its sample format must be one of {', '.join(map(str, _FORMATS))}, "
        f"got {code}{meaning}"
    )


def _word(raw: bytes, layout: str, position: int) -> Any:
    """Return the number at a position of the headers."""
    return struct.unpack_from(layout, raw, position)[0]


def _word_of_first_trace(raw: bytes, order: str, position: int) -> int:
    """Return a word of 16 bit of the first trace header; 0 if the file has none."""
    if len(raw) < _HEAD + _TRACE_HEAD:
        return 0
    return int(_word(raw, f"{order}H", _HEAD + position))


def _revision_of(raw: bytes, order: str, notes: list[str]) -> tuple[int, int]:
    """Return the revision, major and minor number.

    One that does not exist is noted and stands as it is.
    """
    major = raw[3500]
    minor = raw[3501]
    if order == "<" and major == 0 and minor in (1, 2):
        # The word was swapped with all others.
        major = minor
        minor = 0
    if major == 2:
        notes.append(f"SEG-Y revision {major}.{minor}")
    elif major > 2:
        notes.append(
            f"its revision word is {major}.{minor}, which does not exist: it is read as revision 1"
        )
    return major, minor


def _layout_of(
    path: Path, raw: bytes, order: str, code: int, revision: tuple[int, int], notes: list[str]
) -> _Layout:
    """Return where the traces lie.

    Of all layouts that the headers allow, it is the one that the file bears out best.
    """
    size = path.stat().st_size
    width = np.dtype(_FORMATS[code]).itemsize
    counts, other_counts = _sample_counts(raw, order, revision[0] >= 2)
    text_headers = _text_headers(path, raw, order)
    extra_headers: tuple[int, ...] = (0,)
    stated_extra = 0
    stanzas = 0
    first = 0
    if revision[0] == 2:
        extra_headers, stated_extra = _extra_headers(raw, order, revision[1])
        stanzas = _word(raw, f"{order}i", 3528)
        first = _word(raw, f"{order}Q", 3520)
    end = _STANZA * stanzas if 0 < stanzas <= _MOST_HEADERS else 0
    candidates = []
    options = itertools.product(text_headers, extra_headers, (*counts, *other_counts))
    for texts, extra, samples in options:
        start = first if _HEAD <= first < size else _HEAD + _STANZA * texts
        candidates.append(_Layout(start, _TRACE_HEAD * (1 + extra), samples, end))
    if not candidates:
        raise ValueError(
            "it must tell the number of samples, in its binary header or its first trace header, "
            "got none"
        )
    agreements = [_agreement(path, layout, order, width, size) for layout in candidates]
    best = candidates[int(np.argmax(agreements))]  # the first of equals is what the headers state
    if best.head > _TRACE_HEAD:
        notes.append(
            f"every trace has {best.head // _TRACE_HEAD - 1} extra headers, which are passed over"
        )
    elif stated_extra:
        notes.append(
            f"it tells {stated_extra} extra headers of every trace; the file's size shows none"
        )
    if not counts or best.samples != counts[0]:
        notes.append(f"the number of samples, {best.samples}, is that of the trace headers")
    if best.start != candidates[0].start:
        notes.append(
            f"its traces begin at byte {best.start}, not at {candidates[0].start} "
            "as its header tells"
        )
    if end:
        notes.append(f"{stanzas} stanzas behind the traces are not read")
    return best


def _sample_counts(raw: bytes, order: str, extended: bool) -> tuple[list[int], list[int]]:
    """Return the samples of a trace by the binary header, and others that the file may mean.

    With ``extended`` there is a long word of revision 2.
    """
    stated = _word(raw, f"{order}H", 3220)
    long = _word(raw, f"{order}i", 3268)
    first = [stated] if stated >= 2 else []
    if extended and 2 <= long <= MOST_SAMPLES and stated < 2:
        first = [long]
    others = [_word_of_first_trace(raw, order, 114)]
    if extended:
        others.append(long)
    return first, [count for count in others if 2 <= count <= MOST_SAMPLES and count not in first]


def _text_headers(path: Path, raw: bytes, order: str) -> list[int]:
    """Return how many extra text headers there may be.

    -1 in the file is as many as end with the stanza EndText.
    """
    stated = _word(raw, f"{order}h", 3504)
    if stated == -1:
        for number in range(1, _MOST_HEADERS + 1):
            block = first_bytes(path, _STANZA, _HEAD + _STANZA * (number - 1))
            texts = [block.decode(codec, errors="replace") for codec in ("ascii", "cp037")]
            if any(_END_TEXT.match(text) for text in texts):
                return [number, 0]
            if len(block) < _STANZA:
                break
    return [stated, 0] if 0 < stated <= _MOST_HEADERS else [0]


def _extra_headers(raw: bytes, order: str, minor: int) -> tuple[tuple[int, ...], int]:
    """Return how many extra headers a trace may have, and how many are stated.

    What the minor revision states goes first.
    """
    long = _word(raw, f"{order}i", 3506)
    short = _word(raw, f"{order}h", 3506)
    counts = [long, short] if minor == 0 else [short, long]
    plausible = [count for count in counts if 0 < count <= _MOST_HEADERS]
    stated = plausible[0] if plausible else 0
    return tuple(dict.fromkeys([*plausible, 0])), stated


def _agreement(path: Path, layout: _Layout, order: str, width: int, size: int) -> int:
    """Count what bears a layout out.

    That is a whole number of traces, and the sample count in the first trace headers.
    """
    record = layout.head + layout.samples * width
    available = size - layout.start - layout.end
    if available < record:
        return -1
    agreement = 2 if available % record == 0 else 0
    for number in (0, 1, available // record - 1):
        word = first_bytes(path, 2, layout.start + number * record + 114)
        if len(word) == 2 and _word(word, f"{order}H", 0) == layout.samples & 0xFFFF:
            agreement += 1
    return agreement


def _interval_of(raw: bytes, order: str, revision: tuple[int, int], notes: list[str]) -> float:
    """Return the sample interval, s.

    It is that of the binary header, of revision 2's long word, or of the first trace header.
    """
    stated = _word(raw, f"{order}H", 3216)
    long = _word(raw, f"{order}d", 3272)
    of_trace = _word_of_first_trace(raw, order, 116)
    if stated >= 1:
        interval = float(stated)
    elif revision[0] == 2 and np.isfinite(long) and long > 0:
        interval = long
    elif of_trace >= 1:
        notes.append(f"the sample interval, {of_trace}, is that of the first trace header")
        interval = float(of_trace)
    else:
        raise ValueError(
            "it must tell the sample interval, in its binary header or its trace headers, got 0"
        )
    if not INTERVALS[0] <= interval * _PICOSECOND <= INTERVALS[1]:
        raise ValueError(f"its sample interval must be from 0.1 to 1e6 ps, got {interval:g}")
    return interval * _PICOSECOND


def _record(layout: _Layout, order: str, code: int) -> np.dtype[Any]:
    """Return the type of a trace with the words of its header that are read."""
    formats: list[Any] = [order + kind for kind, _ in _WORDS.values()]
    offsets = [offset for _, offset in _WORDS.values()]
    sample = order + _FORMATS[code]
    fields: Any = {
        "names": [*_WORDS, "samples"],
        "formats": [*formats, (sample, layout.samples)],
        "offsets": [*offsets, layout.head],
        "itemsize": layout.head + layout.samples * np.dtype(sample).itemsize,
    }
    return np.dtype(fields)


def _leave_dead_out(
    table: NDArray[Any], traces: NDArray[np.floating[Any]], notes: list[str]
) -> None:
    """Make traces (trace, sample) NaN that their headers call dead or dummy."""
    dead = np.isin(table["identification"], _DEAD)
    if dead.any():
        traces[dead] = np.nan
        notes.append(
            f"{np.count_nonzero(dead)} traces without data, as their headers say (dead or dummy)"
        )


def _check_trace_headers(
    table: NDArray[Any], samples: int, interval: float, notes: list[str]
) -> None:
    """Add notes of what the trace headers state otherwise, and of what of it is not applied.

    ``interval`` is in s.
    """
    differs = (table["count"] != 0) & (table["count"] != samples & 0xFFFF)
    if differs.any():
        low = table["count"][differs].min()
        high = table["count"][differs].max()
        notes.append(
            f"{np.count_nonzero(differs)} trace headers tell {low} to {high} samples: "
            f"all traces are read with {samples}"
        )
    intervals = table["interval"]
    off = np.abs(intervals * _PICOSECOND - interval) > 0.5 * _PICOSECOND
    others = np.count_nonzero((intervals != 0) & off)
    if others:
        notes.append(
            f"{others} trace headers tell another sample interval (bytes 117-118) than "
            f"{interval * 1e12:g} ps, which is used"
        )
    late = np.count_nonzero(table["late"])
    if late:
        notes.append(
            f"the delay of the recording of {late} traces is not applied; give the time zero"
        )
    weighted = np.count_nonzero(table["weight"])
    if weighted:
        notes.append(f"the weighting factors of {weighted} traces (bytes 169-170) are not applied")
    offset = table["offset"].astype(np.float64)
    if np.ptp(offset) > 0 and np.abs(offset).max() > 0:
        notes.append(
            "the distance from source to receiver (bytes 37-40) goes from "
            f"{offset.min():g} to {offset.max():g}: it is not used, and a gather whose antennas "
            "move apart is no common-offset line"
        )


def _unit_of_length(raw: bytes, order: str, notes: list[str]) -> float:
    """Return the unit of coordinates that are lengths, m."""
    system = _word(raw, f"{order}H", 3254)
    if system not in (0, 1, 2):
        notes.append(
            f"its measurement system is {system}, which does not exist: lengths are taken as metres"
        )
    return FOOT if system == 2 else 1.0


def _geometry(table: NDArray[Any], metre: float, notes: list[str]) -> _Geometry:
    """Return where the traces are, and how far apart their antennas.

    ``metre`` is the unit of coordinates that are lengths.
    """
    placed = _line_geometry(table, metre, notes)
    return placed._replace(gather=_gather(table, metre, notes))


def _line_geometry(table: NDArray[Any], metre: float, notes: list[str]) -> _Geometry:
    """Return distance along the line, or fixes, and the antennas' separation, if stated."""
    coordinates = _changing_coordinates(table, notes)
    if not coordinates:
        return _Geometry()
    name, points = next(iter(coordinates.items()))
    units = np.unique(table["unit"])
    if units.size > 1:
        notes.append(
            f"its traces have {units.size} units of coordinates: "
            f"the {_COORDINATES[name]} are not used"
        )
        return _Geometry()
    unit = int(units[0])
    if unit in _ANGULAR:
        notes.append(f"the positions are the {_COORDINATES[name]} of the traces")
        return _Geometry(fixes=_fixes_of(_degrees(points, unit), notes))
    if unit != 1:
        notes.append(f"the unit of its coordinates is {unit}: they are taken as lengths")
    points = _without_far_zeros(points, notes)
    distance = np.append(0.0, np.hypot(*np.diff(points, axis=0).T).cumsum()) * metre
    notes.append(
        f"the distance along the line is that of the traces' coordinates, the {_COORDINATES[name]}"
    )
    where = "distances from trace to trace"
    settled = measured_distance(distance, None, where, "the header", notes)
    separation = _separation(coordinates, metre, notes)
    for other in coordinates:
        gives_separation = other == "group" and separation is not None
        if other != name and not gives_separation:
            notes.append(f"the {_COORDINATES[other]} are not used")
    return _Geometry(settled, Fixes(), separation)


def _coordinates(table: NDArray[Any], name: str) -> FloatArray:
    """Return coordinates (trace, 2) of the trace headers, by their scalar, in the headers' unit."""
    scalar = float64(table["scalar"])  # a negative one divides
    scale = np.where(scalar < 0, 1 / np.maximum(-scalar, 1), np.maximum(scalar, 1))
    return np.stack([table[f"{name}_x"] * scale, table[f"{name}_y"] * scale], axis=1)


def _gather(table: NDArray[Any], metre: float, notes: list[str]) -> str:
    """Return what a survey is whose source and receiver move apart by their coordinates.

    It is empty for a line.
    """
    source = _coordinates(table, "source")
    group = _coordinates(table, "group")
    both = source.any(axis=1) & group.any(axis=1)
    if np.isin(table["unit"], _ANGULAR).any() or np.count_nonzero(both) < 2:
        return ""
    apart = np.hypot(*(group - source)[both].T) * metre
    gather = gather_of_separations(apart, " m", notes)
    if gather:
        notes.append(gather_note(gather))
    return gather


def _changing_coordinates(table: NDArray[Any], notes: list[str]) -> dict[str, FloatArray]:
    """Return the coordinates (trace, 2) that change along the line, by their names."""
    coordinates = {}
    for name, words in _COORDINATES.items():
        points = _coordinates(table, name)
        if np.ptp(points, axis=0).any():
            coordinates[name] = points
        elif points.any() and len(points) > 1:
            notes.append(f"the {words} are the same in all traces: they are not used")
    return coordinates


def _degrees(points: FloatArray, unit: int) -> FloatArray:
    """Return degrees of coordinates in a unit of angle.

    They are seconds of arc (2), degrees (3), or degrees, minutes and seconds as digits (4).
    """
    if unit == 4:
        return _sexagesimal(points)
    return points / (3600 if unit == 2 else 1)


def _fixes_of(degrees: FloatArray, notes: list[str]) -> Fixes:
    """Return the fixes of longitudes and latitudes (trace, 2)."""
    fixes = []
    for trace, (longitude, latitude) in enumerate(degrees.tolist()):
        fixes.append(Fix(float(trace), longitude, latitude, np.nan))
    return settle_fixes(fixes, len(degrees), notes, "the trace headers")


def _without_far_zeros(points: FloatArray, notes: list[str]) -> FloatArray:
    """Return points (trace, 2) with those at 0, 0 put between their neighbours.

    They stay where the line is near 0, 0.
    """
    is_set = np.asarray(points.any(axis=1))
    missing = np.count_nonzero(~is_set)
    nearest = np.abs(points[is_set]).max(axis=1).min() if is_set.any() else 0.0
    if not missing or nearest <= 10 * np.ptp(points[is_set], axis=0).max():
        return points
    notes.append(
        f"{missing} of {len(points)} traces are at 0, 0, far from all others, "
        "and are put between their neighbours"
    )
    return _between_neighbours(points, is_set)


def _between_neighbours(points: FloatArray, usable: NDArray[np.bool_]) -> FloatArray:
    """Return points (trace, 2), those that are not usable between those before and behind."""
    trace = np.arange(len(points))
    sides = [np.interp(trace, trace[usable], side[usable]) for side in points.T]
    return np.stack(sides, axis=1)


def _separation(coordinates: dict[str, FloatArray], metre: float, notes: list[str]) -> float | None:
    """Return the distance of source and group, m, where it is the same in all traces."""
    if "source" not in coordinates or "group" not in coordinates:
        return None
    both = coordinates["source"].any(axis=1) & coordinates["group"].any(axis=1)
    if not both.any():
        return None
    apart = np.hypot(*(coordinates["group"] - coordinates["source"])[both].T) * metre
    if not 0 < apart.mean() <= _LONGEST_SEPARATION or np.ptp(apart) > 0.1 * apart.mean():
        return None
    notes.append("the antennas' separation is the distance of source and group coordinates")
    return float(apart.mean())


def _sexagesimal(values: FloatArray) -> FloatArray:
    """Return degrees of numbers whose digits are degrees, minutes and seconds: DDDMMSS.ss."""
    size = np.abs(values)
    degrees, rest = np.divmod(size, 10_000)
    minutes, seconds = np.divmod(rest, 100)
    return np.asarray(np.sign(values) * (degrees + minutes / 60 + seconds / 3600), dtype=np.float64)


def _ibm(words: NDArray[Any]) -> NDArray[np.float32]:
    """Return IBM's floating point as IEEE's.

    It has a sign, an exponent of 16 less 64 and 24 bits of fraction.
    """
    word = words.astype(np.uint32)
    fraction = (word & 0xFFFFFF).astype(np.float64) * 2.0**-24
    size = np.ldexp(fraction, 4 * (((word >> 24) & 0x7F).astype(np.int32) - 64))
    # What is too large for any recorder is refused by what follows.
    with np.errstate(over="ignore"):
        return np.where(word >> 31, -size, size).astype(np.float32)


def read_su(path: Path, limit: int) -> dict[str, Any]:
    """Read a file of Seismic Unix.

    It has the traces of SEG-Y revision 0 without its headers, IEEE floats of 32 bits. Samples and
    interval are those of the first trace header. The byte order is the one in which the file's size
    is a whole number of traces.

    Parameters
    ----------
    path : Path
        The recording.
    limit : int
        Bytes of memory to use.

    Returns
    -------
    dict of str to Any
        The entries of a :class:`flgpr.formats.gpr_files.GprSection`.

    Raises
    ------
    ValueError
        If the file contradicts itself.
    """
    raw = first_bytes(path, _TRACE_HEAD)
    if len(raw) < _TRACE_HEAD:
        raise ValueError(
            f"its first trace header must have {_TRACE_HEAD} bytes, the file has {len(raw)}"
        )
    order, samples, interval = _su_order(raw, path.stat().st_size)
    notes = [
        f"the byte order is taken as {'big' if order == '>' else 'little'}-endian, "
        "in which the trace headers fit",
        "the sample interval is taken as picoseconds, as radars write it; "
        "Seismic Unix itself has microseconds",
        ZERO_ASSUMED,
    ]
    layout = _Layout(0, _TRACE_HEAD, samples)
    table = read_records(path, 0, _record(layout, order, _IEEE), None, notes, limit)
    traces = exact_floats(table["samples"], notes)
    _check_trace_headers(table, samples, interval, notes)
    _leave_dead_out(table, traces, notes)
    return _entries(traces, samples, interval, _geometry(table, 1.0, notes), notes)


def _su_order(raw: bytes, size: int) -> tuple[str, int, float]:
    """Return byte order, samples and interval, s, of a file of Seismic Unix.

    The order is the one in which the size of the file fits, else the first that is plausible.
    """
    plausible: list[tuple[str, int, float]] = []
    for order in "<>":
        samples = _word(raw, f"{order}H", 114)
        interval = _word(raw, f"{order}H", 116) * _PICOSECOND
        if samples < 2 or not INTERVALS[0] <= interval <= INTERVALS[1]:
            continue
        if size % (_TRACE_HEAD + 4 * samples) == 0:
            return order, samples, interval
        plausible.append((order, samples, interval))
    if not plausible:
        raise ValueError(
            "its first trace header must tell samples and interval (bytes 115-118), "
            "in either byte order"
        )
    return plausible[0]
