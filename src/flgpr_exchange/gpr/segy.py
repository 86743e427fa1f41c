"""SEG-Y of revisions 0 to 2, as radars write it, and Seismic Unix.

Byte positions are those of the standards (SEG-Y revision 2.1, Society of Exploration Geophysicists
2023), less one. Bytes 3507 to 3510 are the number of extra trace headers in revision 2.0; in 2.1 it
has two bytes, and the other two are the kind of survey. Files differ, and older ones have anything
there, so that a layout is taken that the file's size and its trace headers bear out.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flgpr.types import AnyArray, Entries, Float32Array, Notes
from flgpr_exchange.gpr.along_line import interleaved_channels
from flgpr_exchange.gpr.parts import (
    FOOT,
    INTERVALS,
    MOST_SAMPLES,
    ZERO_ASSUMED,
    exact_floats,
    first_bytes,
    header_words,
    note_count,
    read_records,
    words_type,
)
from flgpr_exchange.gpr.segy_places import geometry_of_channels

HEAD = 3600  # bytes of the text header and the binary header
TRACE_HEAD = 240  # bytes
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
_BINARY = {
    "ensemble": ("u2", 3212),  # traces of it
    "interval": ("u2", 3216),
    "samples": ("u2", 3220),
    "code": ("u2", 3224),  # of the sample format
    "system": ("u2", 3254),  # of measures
    "long_samples": ("i4", 3268),  # revision 2
    "long_interval": ("f8", 3272),  # revision 2
    "major": ("u1", 3500),  # number of the revision
    "minor": ("u1", 3501),
    "text_headers": ("i2", 3504),
    "extra_headers": ("i4", 3506),  # revision 2.0
    "few_extra_headers": ("i2", 3506),  # revision 2.1
    "first": ("u8", 3520),  # byte of the first trace, revision 2
    "stanzas": ("i4", 3528),  # behind the traces, revision 2
    "trace_samples": ("u2", HEAD + 114),  # by the first trace header
    "trace_interval": ("u2", HEAD + 116),
}
"""Words of the binary header and of the first trace header that are read: type and offset."""
TRACE_WORDS = {
    "record": ("i4", 8),
    "channel": ("i4", 12),
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
PICOSECOND = 1e-12


class SegyHead(NamedTuple):
    """What the headers of a file state."""

    order: str  #: of bytes, "<" or ">"
    words: Entries  #: of the binary header and of the first trace header
    major: int  #: number of the revision
    minor: int


class TraceLayout(NamedTuple):
    """Where the traces lie in a file."""

    start: int  #: of the first trace, bytes
    head: int  #: of a trace's headers, bytes
    samples: int
    end: int = 0  #: bytes behind the last trace


def read_head(path: Path, notes: Notes) -> SegyHead:
    """Read the headers of a file.

    Parameters
    ----------
    path : Path
        The file.
    notes : list of str
        Takes what is assumed, replaced or not used; of a revision that does not exist, too, which
        is returned as it is.

    Returns
    -------
    SegyHead
        What they state; words of a trace that is not there are 0.

    Raises
    ------
    ValueError
        If the headers are cut off, or the code of the sample format is none that is read.
    """
    raw = first_bytes(path, HEAD + TRACE_HEAD, 0, "its headers", HEAD)
    raw = raw.ljust(HEAD + TRACE_HEAD, b"\0")
    heads = {order: header_words(raw, _BINARY, order) for order in "><"}
    orders = _ORDERS.get(raw[3296:3300], "><")
    order = next((order for order in orders if heads[order]["code"] in _FORMATS), None)
    if order is None:
        code = heads[orders[0]]["code"]
        meaning = _NOT_READ.get(code) or _NOT_READ.get(heads["<"]["code"])
        remark = f" ({meaning}, which is not read)" if meaning else ""
        codes = ", ".join(map(str, _FORMATS))
        raise ValueError(
            f"the code of its sample format must be one of {codes}, got {code}{remark}"
        )

    words = heads[order]
    major, minor = words["major"], words["minor"]
    if order == "<" and major == 0 and minor in (1, 2):
        # The word was swapped with all others.
        major, minor = minor, 0
    if major == 2:
        notes.append(f"SEG-Y revision {major}.{minor}")
    elif major > 2:
        notes.append(
            f"its revision word is {major}.{minor}, which does not exist: it is read as revision 1"
        )
    return SegyHead(order, words, major, minor)


def layout_of(path: Path, head: SegyHead, notes: Notes) -> TraceLayout:
    """Return where the traces lie.

    Of all layouts that the headers allow, it is the one that the file bears out best.

    Parameters
    ----------
    path : Path
        The file.
    head : SegyHead
        Its headers.
    notes : list of str
        Takes what is assumed, replaced or not used.

    Returns
    -------
    TraceLayout
        The layout.

    Raises
    ------
    ValueError
        If no header tells the number of samples.
    """
    words = head.words
    stated = words["samples"]
    long = words["long_samples"] if head.major >= 2 else 0
    if stated < 2:
        stated = long
    counts = [
        count
        for count in dict.fromkeys((stated, words["trace_samples"], long))
        if 2 <= count <= MOST_SAMPLES
    ]
    texts = words["text_headers"]
    if texts == -1:
        texts = _count_to_end_text(path)
    text_headers = (texts, 0) if 0 < texts <= _MOST_HEADERS else (0,)
    extra_headers, stanzas, first = [0], 0, 0
    if head.major == 2:
        extras = [words["extra_headers"], words["few_extra_headers"]]
        likely_first = extras if head.minor == 0 else extras[::-1]
        plausible = [count for count in likely_first if 0 < count <= _MOST_HEADERS]
        extra_headers = list(dict.fromkeys([*plausible, 0]))
        stanzas, first = words["stanzas"], words["first"]
    end = _STANZA * stanzas if 0 < stanzas <= _MOST_HEADERS else 0

    candidates = []
    has_first = HEAD <= first < path.stat().st_size
    for texts, extra, samples in itertools.product(text_headers, extra_headers, counts):
        start = first if has_first else HEAD + _STANZA * texts
        candidates.append(TraceLayout(start, TRACE_HEAD * (1 + extra), samples, end))
    if not candidates:
        raise ValueError(
            "it must tell the number of samples, in its binary header or its first trace header, "
            "got none"
        )

    agreements = [_agreement(path, layout, head) for layout in candidates]
    best = candidates[int(np.argmax(agreements))]  # the first of equals is what the headers state
    extra = best.head // TRACE_HEAD - 1
    if extra:
        notes.append(f"every trace has {extra} extra headers, which are passed over")
    elif extra_headers[0]:
        notes.append(
            f"it tells {extra_headers[0]} extra headers of every trace; the file's size shows none"
        )
    if best.samples != stated:
        notes.append(f"the number of samples, {best.samples}, is that of the trace headers")
    if best.start != candidates[0].start:
        notes.append(
            f"its traces begin at byte {best.start}, not at {candidates[0].start} as its header "
            "tells"
        )
    if end:
        notes.append(f"{stanzas} stanzas behind the traces are not read")
    return best


def _count_to_end_text(path: Path) -> int:
    """Count the extra text headers up to the stanza EndText, in ASCII or in EBCDIC; 0 without."""
    for number in range(_MOST_HEADERS):
        block = first_bytes(path, _STANZA, HEAD + _STANZA * number)
        texts = [block.decode(codec, errors="replace") for codec in ("ascii", "cp037")]
        if any(map(_END_TEXT.match, texts)):
            return number + 1
    return 0


def _agreement(path: Path, layout: TraceLayout, head: SegyHead) -> int:
    """Count what bears a layout out.

    That is a whole number of traces, and the sample count in the first trace headers.
    """
    record = record_type(layout, head.order, head.words["code"]).itemsize
    available = path.stat().st_size - layout.start - layout.end
    if available < record:
        return -1
    agreement = 2 if available % record == 0 else 0
    expected = layout.samples & 0xFFFF  # the trace header's word has 16 bit
    for number in (0, 1, available // record - 1):
        word = first_bytes(path, 2, layout.start + number * record + 114)
        agreement += word == np.array(expected, f"{head.order}u2").tobytes()
    return agreement


def interval_of(head: SegyHead, notes: Notes) -> float:
    """Return the sample interval, s.

    It is that of the binary header, of revision 2's long word, or of the first trace header.

    Parameters
    ----------
    head : SegyHead
        The headers.
    notes : list of str
        Takes what is assumed, replaced or not used.

    Returns
    -------
    float
        The interval, s.

    Raises
    ------
    ValueError
        If no header tells it, or it is not plausible.
    """
    words = head.words
    interval = float(words["interval"])
    if not interval and head.major == 2 and 0 < words["long_interval"] < np.inf:
        interval = words["long_interval"]
    if not interval and words["trace_interval"]:
        interval = float(words["trace_interval"])
        notes.append(f"the sample interval, {interval:.0f}, is that of the first trace header")
    if not interval:
        raise ValueError(
            "it must tell the sample interval, in its binary header or its trace headers, got 0"
        )
    if not INTERVALS[0] <= interval * PICOSECOND <= INTERVALS[1]:
        raise ValueError(f"its sample interval must be from 0.1 to 1e6 ps, got {interval:g}")
    return interval * PICOSECOND


def record_type(layout: TraceLayout, order: str, code: int) -> np.dtype[Any]:
    """Return the type of a trace with the words of its header that are read.

    Parameters
    ----------
    layout : TraceLayout
        Where the traces lie.
    order : str
        Byte order, "<" or ">".
    code : int
        Code of the sample format.

    Returns
    -------
    numpy.dtype
        Of a record with a field for every word, and ``samples``.
    """
    width = np.dtype(_FORMATS[code]).itemsize
    samples = (f"{layout.samples}{_FORMATS[code]}", layout.head)
    return words_type(
        TRACE_WORDS | {"samples": samples}, layout.head + layout.samples * width, order
    )


_IBM = 1
_IEEE = 5
_MOST_CHANNELS = 256
_DEAD = (2, 3)  # codes of traces that are no data: dead, dummy


def read_segy(path: Path, limit: int, notes: Notes) -> Entries:
    """Read a SEG-Y file.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    head = read_head(path, notes)
    layout = layout_of(path, head, notes)
    interval = interval_of(head, notes)
    notes.append(
        "the sample interval is taken as picoseconds, as radars write it; "
        "SEG-Y itself has microseconds"
    )
    notes.append(ZERO_ASSUMED)

    record = record_type(layout, head.order, head.words["code"])
    table = read_records(path, layout.start, record, None, notes, limit, layout.end)
    system = head.words["system"]
    if system not in (0, 1, 2):
        notes.append(
            f"its measurement system is {system}, which does not exist: lengths are taken as metres"
        )
    metre = FOOT if system == 2 else 1.0
    is_ibm = head.words["code"] == _IBM
    return _entries(table, is_ibm, head.words["ensemble"], interval, metre, notes)


def _entries(
    table: AnyArray, is_ibm: bool, stated: int, interval: float, metre: float, notes: Notes
) -> Entries:
    """Return the entries of a section of traces at an interval, s.

    ``stated`` are the traces of an ensemble by the binary header, ``metre`` the unit of lengths.
    """
    traces = exact_floats(_ibm(table["samples"]) if is_ibm else table["samples"], notes)
    counted = _channels_of(table)
    _check_trace_headers(table, counted or 1, traces.shape[1], interval, notes)
    dead = np.isin(table["identification"], _DEAD)
    traces[dead] = np.nan
    note_count(notes, dead, "traces without data, as their headers say (dead or dummy)")
    by_channel = interleaved_channels(
        traces, counted or stated, "the count of an ensemble's traces", notes
    )
    if counted:
        by_channel = traces.reshape(-1, counted, traces.shape[1])
    channels = by_channel.shape[1]
    geometry = geometry_of_channels(table, channels, metre, notes)
    return {
        "traces": by_channel,
        "delay": np.arange(traces.shape[1]) * interval,
        "frequencies": (None,) * channels,
        **geometry._asdict(),
    }


def _channels_of(table: AnyArray) -> int:
    """Return how many channels trace headers count in each record (bytes 9-16); 0 if none."""
    channel = table["channel"]
    count = int(channel.max())
    if not 1 < count <= _MOST_CHANNELS or len(table) % count or len(table) == count:
        return 0
    expected = 1 + np.arange(len(table)) % count
    records = table["record"].reshape(-1, count)
    is_one_record = (records == records[:, :1]).all() and (np.diff(records[:, 0]) != 0).all()
    return count if is_one_record and (channel == expected).all() else 0


def _check_trace_headers(
    table: AnyArray, channels: int, samples: int, interval: float, notes: Notes
) -> None:
    """Add notes of what the trace headers state otherwise, and of what of it is not applied.

    ``interval`` is in s.
    """
    differs = (table["count"] != 0) & (table["count"] != samples & 0xFFFF)
    if differs.any():
        low = table["count"][differs].min()
        high = table["count"][differs].max()
        text = f"trace headers tell {low} to {high} samples: all traces are read with {samples}"
        note_count(notes, differs, text)
    intervals = table["interval"]
    off = np.abs(intervals * PICOSECOND - interval) > 0.5 * PICOSECOND
    note_count(
        notes,
        (intervals != 0) & off,
        "trace headers tell another sample interval (bytes 117-118) than "
        f"{interval * 1e12:g} ps, which is used",
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
    if np.ptp(offset.reshape(-1, channels), axis=0).any():
        notes.append(
            "the distance from source to receiver (bytes 37-40) goes from "
            f"{offset.min():g} to {offset.max():g}: it is not used, and a gather whose antennas "
            "move apart is no common-offset line"
        )


def _ibm(ibm_words: AnyArray) -> Float32Array:
    """Return IBM's floating point as IEEE's.

    It has a sign, an exponent of 16 less 64 and 24 bits of fraction.
    """
    word = ibm_words.astype(np.uint32)
    fraction = (word & 0xFFFFFF).astype(np.float64) * 2.0**-24
    exponent = ((word >> 24) & 0x7F).astype(np.int32) - 64
    size = np.ldexp(fraction, 4 * exponent)
    # What is too large for any recorder is refused by what follows.
    with np.errstate(over="ignore"):
        return np.where(word >> 31, -size, size).astype(np.float32)


def read_su(path: Path, limit: int, notes: Notes) -> Entries:
    """Read a file of Seismic Unix.

    It has the traces of SEG-Y revision 0 without its headers, IEEE floats of 32 bits. Samples and
    interval are those of the first trace header. The byte order is the one in which the file's size
    is a whole number of traces.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    raw = first_bytes(path, TRACE_HEAD, 0, "its first trace header", TRACE_HEAD)
    plausible = []
    for order in "<>":
        words = header_words(raw, TRACE_WORDS, order)
        samples, interval = words["count"], words["interval"] * PICOSECOND
        if samples >= 2 and INTERVALS[0] <= interval <= INTERVALS[1]:
            rest = path.stat().st_size % (TRACE_HEAD + 4 * samples)
            plausible.append((rest > 0, order == ">", samples, interval))
    if not plausible:
        raise ValueError(
            "its first trace header must tell samples and interval (bytes 115-118), "
            "in either byte order"
        )
    # The order in which the size of the file fits, else the first that is plausible.
    _, is_big, samples, interval = min(plausible)
    notes += [
        f"the byte order is taken as {'big' if is_big else 'little'}-endian, "
        "in which the trace headers fit",
        "the sample interval is taken as picoseconds, as radars write it; "
        "Seismic Unix itself has microseconds",
        ZERO_ASSUMED,
    ]
    record = record_type(TraceLayout(0, TRACE_HEAD, samples), "<>"[is_big], _IEEE)
    table = read_records(path, 0, record, None, notes, limit)
    return _entries(table, False, 1, interval, 1.0, notes)
