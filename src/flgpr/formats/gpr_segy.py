"""SEG-Y of revisions 0 to 2, as radars write it.

Byte positions are those of the standards (SEG-Y revision 2.1, Society of Exploration Geophysicists 2023), less one.
Bytes 3507 to 3510 are the number of extra trace headers in revision 2.0; in 2.1 it has two bytes, and the other two are
the kind of survey. Files differ, and older ones have anything there, so that a layout is taken that the file's size and
its trace headers bear out.
"""

from __future__ import annotations

import itertools
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
    measured_places,
    read_records,
)
from flgpr.formats.gpr_positions import Fix, Fixes, settle_fixes

_HEAD = 3600  # bytes of the text header and the binary header
# bytes
_TRACE_HEAD = 240
_STANZA = 3200
_FORMATS = {
    1: "u4", 2: "i4", 3: "i2", 5: "f4", 6: "f8", 8: "i1", 10: "u4", 11: "u2", 16: "u1",
}  # fmt: skip
"""Types of the codes of sample formats; the first is IBM's floating point."""
_IBM = 1
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
    "identification": ("i2", 28), "offset": ("i4", 36), "scalar": ("i2", 70), "source_x": ("i4", 72),
    "source_y": ("i4", 76), "group_x": ("i4", 80), "group_y": ("i4", 84), "unit": ("i2", 88), "late": ("i2", 108),
    "count": ("u2", 114), "interval": ("u2", 116), "weight": ("i2", 168), "cdp_x": ("i4", 180), "cdp_y": ("i4", 184),
}  # fmt: skip
"""Words of a trace header that are looked at: type and offset."""
_PLACES = {
    "source": "source coordinates (bytes 73-80)", "group": "group coordinates (bytes 81-88)",
    "cdp": "CDP coordinates (bytes 181-188)",
}  # fmt: skip
_ANGULAR = (2, 3, 4)  # codes of units of coordinates that are angles
_DEAD = (2, 3)  # codes of traces that are no data: dead, dummy


@dataclass(frozen=True)
class _Layout:
    """Where the traces lie in a file."""

    start: int  #: of the first trace, bytes
    head: int  #: of a trace's headers, bytes
    samples: int
    end: int = 0  #: bytes behind the last trace


def read_segy(path: Path, limit: int) -> dict[str, Any]:
    """Return the entries of a :class:`flgpr.formats.gpr_files.GprSection` from a SEG-Y file.

    Contradictions in the file raise a ValueError.
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
        "the sample interval is taken as picoseconds, as radars write it; SEG-Y itself has microseconds"
    )
    notes.append(ZERO_ASSUMED)
    table = read_records(
        path, layout.start, _record(layout, order, code), None, notes, limit, layout.end
    )
    traces = exact_floats(_ibm(table["samples"]) if code == _IBM else table["samples"], notes)
    _check_trace_headers(table, layout.samples, interval, notes)
    _leave_dead_out(table, traces, notes)
    metre = _unit_of_length(raw, order, notes)
    distance, fixes, separation = _geometry(table, metre, notes)
    return {
        "traces": traces[:, None],
        "delay": np.arange(layout.samples) * interval,
        "distance": distance,
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "separation": separation,
        "gather": _gather(table, metre, notes),
        "history": tuple(notes),
    }


def _order_and_format(raw: bytes) -> tuple[str, int]:
    """Return the byte order and the code of the sample format."""
    stated = _ORDERS.get(raw[3296:3300])
    for order in (stated,) if stated else (">", "<"):
        (code,) = struct.unpack_from(f"{order}H", raw, 3224)
        if code in _FORMATS:
            return order, code
    code = struct.unpack_from(f"{stated or '>'}H", raw, 3224)[0]
    swapped = struct.unpack_from("<H", raw, 3224)[0]
    known = _NOT_READ.get(code) or _NOT_READ.get(swapped)
    what = f" ({known}, which is not read)" if known else ""
    raise ValueError(
        f"the code of its sample format must be one of {', '.join(map(str, _FORMATS))}, got {code}{what}"
    )


def _revision_of(raw: bytes, order: str, notes: list[str]) -> tuple[int, int]:
    """Return the revision, major and minor number; one that does not exist is told and stands as it is."""
    major = raw[3500]
    minor = raw[3501]
    if order == "<" and major == 0 and minor in (1, 2):
        # the word was turned round with all others
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
) -> _Layout:  # fmt: skip
    """Return where the traces lie: of all that the headers allow, the layout that the file bears out best."""
    size = path.stat().st_size
    width = np.dtype(_FORMATS[code]).itemsize
    second = revision[0] == 2
    stated, extended = _sample_counts(raw, order, revision[0] >= 2)
    text = _text_headers(path, raw, order)
    extra, told = _extra_headers(raw, order, revision[1]) if second else ((0,), 0)
    trailer = struct.unpack_from(f"{order}i", raw, 3528)[0] if second else 0
    end = _STANZA * trailer if 0 < trailer <= _MOST_HEADERS else 0
    (first,) = struct.unpack_from(f"{order}Q", raw, 3520) if second else (0,)
    candidates = []
    for headers, more, samples in itertools.product(text, extra, (*stated, *extended)):
        start = first if _HEAD <= first < size else _HEAD + _STANZA * headers
        candidates.append(_Layout(start, _TRACE_HEAD * (1 + more), samples, end))
    if not candidates:
        raise ValueError(
            "it must tell the number of samples, in its binary header or its first trace header, got none"
        )
    marks = [_agreement(path, layout, order, width, size) for layout in candidates]
    best = candidates[int(np.argmax(marks))]  # the first of equals is what the headers state
    if best.head > _TRACE_HEAD:
        notes.append(
            f"every trace has {best.head // _TRACE_HEAD - 1} extra headers, which are passed over"
        )
    elif told:
        notes.append(f"it tells {told} extra headers of every trace; the file's size shows none")
    if not stated or best.samples != stated[0]:
        notes.append(f"the number of samples, {best.samples}, is that of the trace headers")
    if best.start != candidates[0].start:
        notes.append(
            f"its traces begin at byte {best.start}, not at {candidates[0].start} as its header tells"
        )
    if end:
        notes.append(f"{trailer} stanzas behind the traces are not read")
    return best


def _sample_counts(raw: bytes, order: str, extended: bool) -> tuple[list[int], list[int]]:
    """Return the samples of a trace that the binary header tells, and others that the file may mean."""
    (stated,) = struct.unpack_from(f"{order}H", raw, 3220)
    (more,) = struct.unpack_from(f"{order}i", raw, 3268)
    own = (
        struct.unpack_from(f"{order}H", raw, _HEAD + 114)[0]
        if len(raw) >= _HEAD + _TRACE_HEAD
        else 0
    )
    first = [stated] if stated >= 2 else []
    if extended and 2 <= more <= MOST_SAMPLES and stated < 2:
        first = [more]
    others = [own, *([more] if extended else [])]
    return first, [one for one in others if 2 <= one <= MOST_SAMPLES and one not in first]


def _text_headers(path: Path, raw: bytes, order: str) -> list[int]:
    """Return how many extra text headers there may be; -1 in the file is as many as end with the stanza EndText."""
    (stated,) = struct.unpack_from(f"{order}h", raw, 3504)
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
    """Return how many extra headers a trace may have, what the revision says first, and what is stated."""
    long = struct.unpack_from(f"{order}i", raw, 3506)[0]
    short = struct.unpack_from(f"{order}h", raw, 3506)[0]
    options = [long, short] if minor == 0 else [short, long]
    found = [one for one in options if 0 < one <= _MOST_HEADERS]
    stated = found[0] if found else 0
    return tuple(dict.fromkeys([*found, 0])), stated


def _agreement(path: Path, layout: _Layout, order: str, width: int, size: int) -> int:
    """Count what bears a layout out: a whole number of traces, and the sample count in the first trace headers."""
    record = layout.head + layout.samples * width
    room = size - layout.start - layout.end
    if room < record:
        return -1
    agreement = 2 if room % record == 0 else 0
    for number in (0, 1, room // record - 1):
        word = first_bytes(path, 2, layout.start + number * record + 114)
        if len(word) == 2 and struct.unpack(f"{order}H", word)[0] == layout.samples & 0xFFFF:
            agreement += 1
    return agreement


def _interval_of(raw: bytes, order: str, revision: tuple[int, int], notes: list[str]) -> float:
    """Return the sample interval, s: of the binary header, of revision 2's long word, or of the first trace header."""
    (stated,) = struct.unpack_from(f"{order}H", raw, 3216)
    (long,) = struct.unpack_from(f"{order}d", raw, 3272)
    own = (
        struct.unpack_from(f"{order}H", raw, _HEAD + 116)[0]
        if len(raw) >= _HEAD + _TRACE_HEAD
        else 0
    )
    if stated >= 1:
        interval = float(stated)
    elif revision[0] == 2 and np.isfinite(long) and long > 0:
        interval = long
    elif own >= 1:
        notes.append(f"the sample interval, {own}, is that of the first trace header")
        interval = float(own)
    else:
        raise ValueError(
            "it must tell the sample interval, in its binary header or its trace headers, got 0"
        )
    if not INTERVALS[0] <= interval * 1e-12 <= INTERVALS[1]:
        raise ValueError(f"its sample interval must be from 0.1 to 1e6 ps, got {interval:g}")
    return interval * 1e-12


def _record(layout: _Layout, order: str, code: int) -> np.dtype[Any]:
    """Return the type of a trace with the words of its header that are looked at."""
    fields: Any = {
        "names": [*_WORDS, "samples"],
        "formats": [
            *(order + kind for kind, _ in _WORDS.values()),
            (order + _FORMATS[code], layout.samples),
        ],
        "offsets": [*(at for _, at in _WORDS.values()), layout.head],
        "itemsize": layout.head + layout.samples * np.dtype(_FORMATS[code]).itemsize,
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
    """Tell what the trace headers say otherwise than all do, or what of theirs is not applied; ``interval`` in s."""
    other = (table["count"] != 0) & (table["count"] != samples & 0xFFFF)
    if other.any():
        low = table["count"][other].min()
        high = table["count"][other].max()
        notes.append(
            f"{np.count_nonzero(other)} trace headers tell {low} to {high} samples: all traces are read with {samples}"
        )
    paces = table["interval"]
    others = np.count_nonzero((paces != 0) & (np.abs(paces * 1e-12 - interval) > 0.5e-12))
    if others:
        notes.append(
            f"{others} trace headers tell another sample interval (bytes 117-118) than {interval * 1e12:g} ps, which "
            "is used"
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
            f"the distance from source to receiver (bytes 37-40) goes from {offset.min():g} to {offset.max():g}: it is "
            "not used, and a gather whose antennas move apart is no common-offset line"
        )


def _unit_of_length(raw: bytes, order: str, notes: list[str]) -> float:
    """Return the unit of coordinates that are lengths, m."""
    system = struct.unpack_from(f"{order}H", raw, 3254)[0]
    if system not in (0, 1, 2):
        notes.append(
            f"its measurement system is {system}, which does not exist: lengths are taken as metres"
        )
    return FOOT if system == 2 else 1.0


def _geometry(
    table: NDArray[Any], metre: float, notes: list[str]
) -> tuple[FloatArray | None, Fixes, float | None]:  # fmt: skip
    """Return the distance along the line (trace,), m, or fixes, and the antennas' separation, m, if they are told."""
    places = {}
    for name in _PLACES:
        place = _coordinates(table, name)
        if np.ptp(place, axis=0).any():
            places[name] = place
        elif place.any() and len(place) > 1:
            notes.append(f"the {_PLACES[name]} are the same in all traces: they are not used")
    if not places:
        return None, Fixes(), None
    name, place = next(iter(places.items()))
    units = np.unique(table["unit"])
    if units.size > 1:
        notes.append(
            f"its traces have {units.size} units of coordinates: the {_PLACES[name]} are not used"
        )
        return None, Fixes(), None
    unit = int(units[0])
    if unit in _ANGULAR:  # seconds of arc, degrees, and degrees, minutes and seconds as digits
        degrees = _sexagesimal(place) if unit == 4 else place / (3600 if unit == 2 else 1)
        fixes = [
            Fix(float(trace), pair[0], pair[1], np.nan)
            for trace, pair in enumerate(degrees.tolist())
        ]
        notes.append(f"the positions are the {_PLACES[name]} of the traces")
        return None, settle_fixes(fixes, len(table), notes, "the trace headers"), None
    if unit != 1:
        notes.append(f"the unit of its coordinates is {unit}: they are taken as lengths")
    somewhere = np.asarray(place.any(axis=1))
    nowhere = np.logical_not(somewhere)
    far = np.abs(place[somewhere]).max(axis=1).min() if somewhere.any() else 0.0
    if nowhere.any() and far > 10 * np.ptp(place[somewhere], axis=0).max():
        notes.append(
            f"{np.count_nonzero(nowhere)} of {len(table)} traces are at 0, 0, far from all others, and are put between "
            "their neighbours"
        )
        place = _between_neighbours(place, somewhere)
    way = np.append(0.0, np.hypot(*np.diff(place, axis=0).T).cumsum()) * metre
    notes.append(
        f"the distance along the line is that of the traces' coordinates, the {_PLACES[name]}"
    )
    distance = measured_places(way, None, "distances from trace to trace", "the header", notes)
    separation = _separation(places, metre, notes)
    for other in places:
        if other != name and not (other == "group" and separation is not None):
            notes.append(f"the {_PLACES[other]} are not used")
    return distance, Fixes(), separation


def _coordinates(table: NDArray[Any], name: str) -> FloatArray:
    """Return coordinates (trace, 2) of the trace headers, by their scalar, in the headers' unit."""
    scalar = float64(table["scalar"])
    scale = np.where(scalar < 0, 1 / np.maximum(-scalar, 1), np.maximum(scalar, 1))
    return np.stack([table[f"{name}_x"] * scale, table[f"{name}_y"] * scale], axis=1)


def _gather(table: NDArray[Any], metre: float, notes: list[str]) -> str:
    """Return what to call a survey whose source and receiver move apart by their coordinates; empty for a line."""
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


def _between_neighbours(place: FloatArray, usable: NDArray[np.bool_]) -> FloatArray:
    """Put places (trace, 2) that are not usable between those before and behind."""
    trace = np.arange(len(place))
    sides = [np.interp(trace, trace[usable], side[usable]) for side in place.T]
    return np.stack(sides, axis=1)


def _separation(places: dict[str, FloatArray], metre: float, notes: list[str]) -> float | None:
    """Return the distance of source and group, m, where both are told and it is the same in all traces."""
    if "source" not in places or "group" not in places:
        return None
    both = places["source"].any(axis=1) & places["group"].any(axis=1)
    if not both.any():
        return None
    apart = np.hypot(*(places["group"] - places["source"])[both].T) * metre
    if not 0 < apart.mean() <= 100 or np.ptp(apart) > 0.1 * apart.mean():
        return None
    notes.append("the antennas' separation is the distance of source and group coordinates")
    return float(apart.mean())


def _sexagesimal(values: FloatArray) -> FloatArray:
    """Return degrees of numbers whose digits are degrees, two of minutes and two of seconds: DDDMMSS.ss."""
    size = np.abs(values)
    degrees, rest = np.divmod(size, 10_000)
    minutes, seconds = np.divmod(rest, 100)
    return np.asarray(np.sign(values) * (degrees + minutes / 60 + seconds / 3600), dtype=np.float64)


def _ibm(words: NDArray[Any]) -> NDArray[np.float32]:
    """Take IBM's floating point, sign, exponent of 16 less 64 and 24 bits of fraction, to IEEE's."""
    word = words.astype(np.uint32)
    fraction = (word & 0xFFFFFF).astype(np.float64) * 2.0**-24
    size = np.ldexp(fraction, 4 * (((word >> 24) & 0x7F).astype(np.int32) - 64))
    with np.errstate(
        over="ignore"
    ):  # what is too large for any recorder is refused by what follows
        return np.where(word >> 31, -size, size).astype(np.float32)


def read_su(path: Path, limit: int) -> dict[str, Any]:
    """Read a file of Seismic Unix: the traces of SEG-Y revision 0 without its headers, IEEE floats of 32 bits.

    Samples and interval are those of the first trace header. The byte order is the one in which the file's size is a
    whole number of traces; what contradicts is a ValueError.
    """
    raw = first_bytes(path, _TRACE_HEAD)
    if len(raw) < _TRACE_HEAD:
        raise ValueError(
            f"its first trace header must have {_TRACE_HEAD} bytes, the file has {len(raw)}"
        )
    order, samples, interval = _su_order(raw, path.stat().st_size)
    notes = [
        f"the byte order is taken as {'big' if order == '>' else 'little'}-endian, in which the trace headers fit",
        "the sample interval is taken as picoseconds, as radars write it; Seismic Unix itself has microseconds",
        ZERO_ASSUMED,
    ]
    layout = _Layout(0, _TRACE_HEAD, samples)
    table = read_records(path, 0, _record(layout, order, 5), None, notes, limit)
    traces = exact_floats(table["samples"], notes)
    _check_trace_headers(table, samples, interval, notes)
    _leave_dead_out(table, traces, notes)
    distance, fixes, separation = _geometry(table, 1.0, notes)
    return {
        "traces": traces[:, None],
        "delay": np.arange(samples) * interval,
        "distance": distance,
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "separation": separation,
        "gather": _gather(table, 1.0, notes),
        "history": tuple(notes),
    }


def _su_order(raw: bytes, size: int) -> tuple[str, int, float]:
    """Return byte order, samples and interval, s, of a file of Seismic Unix: the order in which all of them fit."""
    tries: list[tuple[int, str, int, float]] = []
    for order in "<>":
        samples = int.from_bytes(raw[114:116], "little" if order == "<" else "big")
        picoseconds = int.from_bytes(raw[116:118], "little" if order == "<" else "big")
        interval = picoseconds * 1e-12
        if samples >= 2 and INTERVALS[0] <= interval <= INTERVALS[1]:
            rest = size % (_TRACE_HEAD + 4 * samples)
            tries.append((rest, order, samples, interval))
    fits = [one for one in tries if one[0] == 0] or tries[:1]
    if not fits:
        raise ValueError(
            "its first trace header must tell samples and interval (bytes 115-118), in either byte order"
        )
    return fits[0][1:]
