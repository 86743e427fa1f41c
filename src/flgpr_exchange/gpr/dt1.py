"""Sensors & Software's DT1 with its text header HD, as the maker's pulseEKKO manuals describe them.

A trace header has 25 words of 32 bit floating point and a comment of 28 bytes: words 1 to 3 are
number, position and samples of the trace, word 6 the bytes of a sample, words 15 to 20 the
positions of receiver and transmitter, word 22 is 1 where the trace is no data, word 24 the second
of the day, word 25 is 1 where the operator set a mark.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flgpr.types import AnyArray, FloatArray, IntArray
from flgpr_exchange.gpr.parts import (
    FARTHEST,
    INTERVALS,
    MOST_SAMPLES,
    NANOSECOND,
    ZERO_ASSUMED,
    Header,
    exact_floats,
    find_companion,
    first_bytes,
    float64,
    gather_note,
    gather_of_separations,
    length_unit,
    measured_clock,
    measured_distance,
    read_header,
    read_records,
)
from flgpr_exchange.gpr.positions import Fixes, nmea_fixes, note_unread

_HEADER = 100  # bytes of the words of a trace header
_TYPES = {"I*2": "i2", "F*4": "f4"}
_TYPE_WORDS = {"i2": "16 bit", "f4": "32 bit floating point"}
_LINES = ("", "reflection", "commonoffset", "profile")
_GATHERS = (
    "cmp",
    "warr",
    "midpoint",
    "depthpoint",
    "wideangle",
    "commonsource",
    "commonshot",
    "commonreceiver",
    "multi",
    "transillum",
    "tomograph",
    "mog",
    "zop",
    "vrp",
    "borehole",
)
"""Letters of SURVEY MODE: all of them for a line, some for a survey whose antennas move apart."""
_UNUSED = (
    (slice(3, 4), "the topography (word 4)"),
    (slice(8, 14), "the satellite receiver's position (words 9 to 14)"),
    (slice(20, 21), "the adjustment of time zero (word 21)"),
)
"""Columns of a trace header's words that are noted and not used, and what they are."""
_LEAST_SEPARATION = 0.005  # m, of two antennas


def read_dt1(path: Path, limit: int) -> dict[str, Any]:
    """Read a DT1.

    Parameters
    ----------
    path : Path
        The recording.
    limit : int
        Bytes of memory to use.

    Returns
    -------
    dict of str to Any
        The entries of a :class:`~flgpr.formats.section.GprSection`.

    Raises
    ------
    ValueError
        If header and file contradict one another.
    MissingHeaderError
        If there is no header.
    """
    notes: list[str] = []
    head = read_header(path, ".hd", "=", notes)
    samples = int(head.needed("NUMBER OF PTS/TRC", 2, MOST_SAMPLES))
    shortest = INTERVALS[0] / NANOSECOND
    longest = INTERVALS[1] / NANOSECOND * samples
    window = head.needed("TOTAL TIME WINDOW", shortest, longest)

    stated = head.number("NUMBER OF TRACES", 0, 1e9, False)
    table = _records(path, head, samples, stated, notes, limit)
    header_words = float64(table["head"])
    traces = exact_floats(table["samples"], notes)
    empty = header_words[:, 21] == 1
    traces[empty] = np.nan
    if empty.any():
        notes.append(f"{np.count_nonzero(empty)} traces without data, as their headers say")

    zero = _zero_point(head, notes)
    megahertz = head.number("NOMINAL FREQUENCY", 0, 1e5, False)
    distance, separation = _lengths(head, header_words, notes)
    fixes = _fixes(path, header_words, notes)
    _note_unused_words(header_words, notes)

    gather = _gather(head, header_words, notes)
    if gather:
        notes.append(gather_note(gather))
    return {
        "traces": traces[:, None],
        "delay": (np.arange(samples) - zero) * window * NANOSECOND / samples,
        "distance": distance,
        "time": measured_clock(header_words[:, 23], notes),
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "marks": tuple(np.flatnonzero(header_words[:, 24] == 1).tolist()),
        "frequencies": (megahertz * 1e6 if megahertz else None,),
        "separation": separation,
        "gather": gather,
        "history": tuple(notes),
    }


def _zero_point(head: Header, notes: list[str]) -> float:
    """Return the sample, from 0, at time zero; points of the header are counted from 1."""
    point = head.number("TIMEZERO AT POINT", -1e6, 1e6, False)
    if point is None:
        notes.append(ZERO_ASSUMED)
    elif point == 0:
        notes.append(
            "TIMEZERO AT POINT is 0, but points are counted from 1: the first one is taken"
        )
    return (point or 1.0) - 1.0


def _records(
    path: Path, head: Header, samples: int, stated: float | None, notes: list[str], limit: int
) -> AnyArray:
    """Read the traces with their headers.

    Byte order and sample type are those that the trace headers bear out.
    """
    name = head.text("DATA TYPE").upper().replace(" ", "")
    if name and name not in _TYPES:
        raise ValueError(f"{head.path.name}: DATA TYPE must be I*2 or F*4, got {name[:40]!r}")

    raw = first_bytes(path, _HEADER)
    if len(raw) < _HEADER:
        raise ValueError(f"a trace header must have {_HEADER} bytes, the file has {len(raw)}")
    first_words = np.frombuffer(raw, "<f4")
    swapped_words = first_words.byteswap()
    swapped = first_words[2] != samples and swapped_words[2] == samples
    width = (swapped_words if swapped else first_words)[5]

    sample = _TYPES.get(name) or ("f4" if width == 4 else "i2")
    other = "i2" if sample == "f4" else "f4"
    # A wrong type of samples moves the second trace header.
    as_stated = _second_agrees(path, samples, sample, swapped)
    if not as_stated and _second_agrees(path, samples, other, swapped):
        sample = other
    table = read_records(path, 0, _record(samples, sample, swapped), stated, notes, limit)

    points = float64(table["head"][:, 2])
    if (points != samples).any():
        bad = int(np.argmax(points != samples))
        raise ValueError(
            f"trace {bad} must have {samples} points as {head.path.name} says, got {points[bad]:g}"
        )
    if sample != _TYPES.get(name, "i2"):
        reason = f"DATA TYPE is {name}" if name else "no DATA TYPE is told"
        notes.append(f"samples are read as {_TYPE_WORDS[sample]}, by their size ({reason})")
    return table


def _record(samples: int, sample: str, swapped: bool) -> np.dtype[Any]:
    """Return the type of a trace: header words, comment and samples."""
    record = np.dtype(
        [
            ("head", "<f4", 25),
            ("comment", "S28"),
            ("samples", f"<{sample}", samples),
        ]
    )
    return record.newbyteorder() if swapped else record


def _second_agrees(path: Path, samples: int, sample: str, swapped: bool) -> bool:
    """Return whether the second trace header lies where it does if samples are of a type.

    It is true if there is no second trace.
    """
    record = _record(samples, sample, swapped)
    raw = first_bytes(path, record.itemsize, record.itemsize)
    return len(raw) < record.itemsize or np.frombuffer(raw, record)["head"][0, 2] == samples


def _lengths(
    head: Header, header_words: FloatArray, notes: list[str]
) -> tuple[FloatArray | None, float | None]:
    """Return the distance along the line (trace,), m, and the antennas' separation, m, if known."""
    name = head.text("POSITION UNITS")
    unit = length_unit(name or "m")
    step = head.number("STEP SIZE USED", -1e4, 1e4, False)
    separation = head.number("ANTENNA SEPARATION", 0, 1e3, False)
    if unit is None:
        notes.append(
            f"POSITION UNITS are {name[:20]!r}, which is no unit that is known: "
            "no place and no separation is used"
        )
        return None, None
    if not name:
        notes.append("POSITION UNITS are not told: positions are taken as metres")
    distance = measured_distance(
        header_words[:, 1] * unit,
        None if step is None else step * unit,
        "positions of the trace headers",
        "STEP SIZE USED in the header",
        notes,
    )
    if separation is None:
        return distance, None
    if 0 < separation * unit < _LEAST_SEPARATION <= separation:
        notes.append(
            f"ANTENNA SEPARATION {separation:g} is taken as metres: "
            f"antennas cannot be {separation:g} {name} apart"
        )
        return distance, separation
    return distance, separation * unit


def _note_unused_words(header_words: FloatArray, notes: list[str]) -> None:
    """Add notes of the words of the trace headers that are filled in and not used."""
    for columns, meaning in _UNUSED:
        values = np.nan_to_num(header_words[:, columns])
        filled = np.count_nonzero((values != 0).any(axis=1))
        if filled:
            notes.append(f"{meaning} of {filled} traces is not used")


def _fixes(path: Path, header_words: FloatArray, notes: list[str]) -> Fixes:
    """Return the positions of the .GPS beside the recording, or of newer instruments' .GP2."""
    older = find_companion(path, ".gps")
    newer = find_companion(path, ".gp2")
    note_unread(path, (".ini", ".top", ".nav"), notes)
    if older is not None and newer is not None:
        notes.append(f"{newer.name} lies beside it and is not read, because {older.name} is")
    return nmea_fixes(older or newer, len(header_words), notes, _trace_numbers(header_words[:, 0]))


def _trace_numbers(values: FloatArray) -> IntArray | None:
    """Return the traces' own numbers, if that is what the header words are."""
    if not np.isfinite(values).all():
        return None
    too_large = np.abs(values) > 1e9
    fractional = values != np.round(values)
    if too_large.any() or fractional.any():
        return None
    return values.astype(np.int64)


def _gather(head: Header, header_words: FloatArray, notes: list[str]) -> str:
    """Return what the file calls a survey whose antennas move apart; empty for a line."""
    mode = head.text("SURVEY MODE")
    letters = "".join(filter(str.isalpha, mode.lower()))
    if any(word in letters for word in _GATHERS):
        return mode
    if letters not in _LINES:
        notes.append(
            f"SURVEY MODE is {mode[:40]!r}, which is not known: it is read as a line of one offset"
        )
    positions = header_words[:, 14:20]  # of receiver and transmitter
    if not np.isfinite(positions).all() or (np.abs(positions) > FARTHEST).any():
        return ""
    if not positions.any():
        return ""  # not filled in
    apart = np.linalg.norm(positions[:, :3] - positions[:, 3:], axis=1)
    return gather_of_separations(apart, "", notes)
