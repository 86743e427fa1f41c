"""How the traces lie in a SEG-Y file: byte order, formats, lengths and intervals.

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
from typing import Any

import numpy as np

from flgpr_exchange.gpr.parts import (
    INTERVALS,
    MOST_SAMPLES,
    first_bytes,
    words_type,
)

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
_WORDS = {
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


@dataclass(frozen=True)
class TraceLayout:
    """Where the traces lie in a file."""

    start: int  #: of the first trace, bytes
    head: int  #: of a trace's headers, bytes
    samples: int
    end: int = 0  #: bytes behind the last trace


def order_and_format(raw: bytes) -> tuple[str, int]:
    """Return the byte order and the code of the sample format.

    Parameters
    ----------
    raw : bytes
        The beginning of the file: text header and binary header.

    Returns
    -------
    order : str
        "<" or ">".
    code : int
        One of the codes that are read.

    Raises
    ------
    ValueError
        If the code is none of these.
    """
    stated = _ORDERS.get(raw[3296:3300])
    orders = (stated,) if stated else (">", "<")
    for order in orders:
        code = word_at(raw, f"{order}H", 3224)
        if code in _FORMATS:
            return order, code

    code = word_at(raw, f"{orders[0]}H", 3224)
    little_endian_code = word_at(raw, "<H", 3224)
    meaning = _NOT_READ.get(code) or _NOT_READ.get(little_endian_code)
    remark = f" ({meaning}, which is not read)" if meaning else ""
    codes = ", ".join(map(str, _FORMATS))
    raise ValueError(f"the code of its sample format must be one of {codes}, got {code}{remark}")


def word_at(raw: bytes, layout: str, position: int) -> Any:
    """Return the number at a position of the headers.

    Parameters
    ----------
    raw : bytes
        The headers.
    layout : str
        Byte order and type, as for :mod:`struct`.
    position : int
        Byte at which the number begins, from 0.

    Returns
    -------
    int or float
        The number.
    """
    return struct.unpack_from(layout, raw, position)[0]


def _word_of_first_trace(raw: bytes, order: str, position: int) -> int:
    """Return a word of 16 bit of the first trace header; 0 if the file has none."""
    if len(raw) < HEAD + TRACE_HEAD:
        return 0
    return int(word_at(raw, f"{order}H", HEAD + position))


def revision_of(raw: bytes, order: str, notes: list[str]) -> tuple[int, int]:
    """Return the revision, major and minor number.

    One that does not exist is noted, and returned as it is.

    Parameters
    ----------
    raw : bytes
        The beginning of the file: text header, binary header and first trace header.
    order : str
        Byte order, "<" or ">".
    notes : list of str
        Takes what is assumed, replaced or not used.

    Returns
    -------
    tuple of int
        Major and minor number.
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


def layout_of(
    path: Path, raw: bytes, order: str, code: int, revision: tuple[int, int], notes: list[str]
) -> TraceLayout:
    """Return where the traces lie.

    Of all layouts that the headers allow, it is the one that the file bears out best.

    Parameters
    ----------
    path : Path
        The file.
    raw : bytes
        The beginning of the file: text header, binary header and first trace header.
    order : str
        Byte order, "<" or ">".
    code : int
        Code of the sample format.
    revision : tuple of int
        Major and minor number of the revision.
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
        stanzas = word_at(raw, f"{order}i", 3528)
        first = word_at(raw, f"{order}Q", 3520)
    end = _STANZA * stanzas if 0 < stanzas <= _MOST_HEADERS else 0

    candidates = []
    options = itertools.product(text_headers, extra_headers, (*counts, *other_counts))
    for texts, extra, samples in options:
        start = first if HEAD <= first < size else HEAD + _STANZA * texts
        candidates.append(TraceLayout(start, TRACE_HEAD * (1 + extra), samples, end))
    if not candidates:
        raise ValueError(
            "it must tell the number of samples, in its binary header or its first trace header, "
            "got none"
        )

    agreements = [_agreement(path, layout, order, width, size) for layout in candidates]
    best = candidates[int(np.argmax(agreements))]  # the first of equals is what the headers state
    _note_differences(best, candidates[0], counts, stated_extra, notes)
    if end:
        notes.append(f"{stanzas} stanzas behind the traces are not read")
    return best


def _note_differences(
    best: TraceLayout, stated: TraceLayout, counts: list[int], stated_extra: int, notes: list[str]
) -> None:
    """Add notes of where a layout differs from what the headers state."""
    extra_headers = best.head // TRACE_HEAD - 1
    if extra_headers:
        notes.append(f"every trace has {extra_headers} extra headers, which are passed over")
    elif stated_extra:
        notes.append(
            f"it tells {stated_extra} extra headers of every trace; the file's size shows none"
        )
    if not counts or best.samples != counts[0]:
        notes.append(f"the number of samples, {best.samples}, is that of the trace headers")
    if best.start != stated.start:
        notes.append(
            f"its traces begin at byte {best.start}, not at {stated.start} as its header tells"
        )


def _sample_counts(raw: bytes, order: str, extended: bool) -> tuple[list[int], list[int]]:
    """Return the samples of a trace by the binary header, and others that the file may mean.

    With ``extended`` there is a long word of revision 2.
    """
    stated = word_at(raw, f"{order}H", 3220)
    long = word_at(raw, f"{order}i", 3268)
    first = [stated] if stated >= 2 else []
    if extended and 2 <= long <= MOST_SAMPLES and stated < 2:
        first = [long]
    candidates = [_word_of_first_trace(raw, order, 114)]
    if extended:
        candidates.append(long)
    others = []
    for count in candidates:
        if 2 <= count <= MOST_SAMPLES and count not in first:
            others.append(count)
    return first, others


def _text_headers(path: Path, raw: bytes, order: str) -> list[int]:
    """Return how many extra text headers there may be.

    -1 in the file is as many as end with the stanza EndText.
    """
    stated = word_at(raw, f"{order}h", 3504)
    if stated == -1:
        for number in range(1, _MOST_HEADERS + 1):
            block = first_bytes(path, _STANZA, HEAD + _STANZA * (number - 1))
            if _is_end_text(block):
                return [number, 0]
            if len(block) < _STANZA:
                break
    return [stated, 0] if 0 < stated <= _MOST_HEADERS else [0]


def _is_end_text(block: bytes) -> bool:
    """Return whether a text header is the stanza EndText, in ASCII or in EBCDIC."""
    texts = [block.decode(codec, errors="replace") for codec in ("ascii", "cp037")]
    return any(_END_TEXT.match(text) for text in texts)


def _extra_headers(raw: bytes, order: str, minor: int) -> tuple[tuple[int, ...], int]:
    """Return how many extra headers a trace may have, and how many are stated.

    What the minor revision states goes first.
    """
    long = word_at(raw, f"{order}i", 3506)
    short = word_at(raw, f"{order}h", 3506)
    counts = [long, short] if minor == 0 else [short, long]
    plausible = [count for count in counts if 0 < count <= _MOST_HEADERS]
    stated = plausible[0] if plausible else 0
    return tuple(dict.fromkeys([*plausible, 0])), stated


def _agreement(path: Path, layout: TraceLayout, order: str, width: int, size: int) -> int:
    """Count what bears a layout out.

    That is a whole number of traces, and the sample count in the first trace headers.
    """
    record = layout.head + layout.samples * width
    available = size - layout.start - layout.end
    if available < record:
        return -1
    agreement = 2 if available % record == 0 else 0
    expected = layout.samples & 0xFFFF  # the trace header's word has 16 bit
    last = available // record - 1
    for number in (0, 1, last):
        word = first_bytes(path, 2, layout.start + number * record + 114)
        if len(word) == 2 and word_at(word, f"{order}H", 0) == expected:
            agreement += 1
    return agreement


def interval_of(raw: bytes, order: str, revision: tuple[int, int], notes: list[str]) -> float:
    """Return the sample interval, s.

    It is that of the binary header, of revision 2's long word, or of the first trace header.

    Parameters
    ----------
    raw : bytes
        The beginning of the file: text header, binary header and first trace header.
    order : str
        Byte order, "<" or ">".
    revision : tuple of int
        Major and minor number of the revision.
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
    stated = word_at(raw, f"{order}H", 3216)
    long = word_at(raw, f"{order}d", 3272)
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
    sample = order + _FORMATS[code]
    words: dict[str, tuple[Any, int]] = {
        name: (order + kind, offset) for name, (kind, offset) in _WORDS.items()
    }
    words["samples"] = ((sample, layout.samples), layout.head)
    return words_type(words, layout.head + layout.samples * np.dtype(sample).itemsize)
