"""Sensors & Software's DT1 with its text header HD, as the maker's pulseEKKO manuals describe them.

A trace header has 25 words of 32 bit floating point and a comment of 28 bytes: words 1 to 3 are number, position and
samples of the trace, word 6 the bytes of a sample, words 15 to 20 the places of receiver and transmitter, word 22 is 1
where the trace is no data, word 24 the second of the day, word 25 is 1 where the operator set a mark.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.gpr_parts import (
    FARTHEST,
    INTERVALS,
    MOST_SAMPLES,
    NANOSECOND,
    ZERO_ASSUMED,
    FloatArray,
    Header,
    exact_floats,
    find_beside,
    first_bytes,
    float64,
    gather_note,
    gather_of_separations,
    length_unit,
    measured_clock,
    measured_places,
    read_header,
    read_records,
)
from flgpr.formats.gpr_positions import Fixes, nmea_fixes, note_unread

_TYPES = {"I*2": "i2", "F*4": "f4"}
_WORDS = {"i2": "16 bit", "f4": "32 bit floating point"}
_LINES = ("", "reflection", "commonoffset", "profile")
_GATHERS = (
    "cmp", "warr", "midpoint", "depthpoint", "wideangle", "commonsource", "commonshot", "commonreceiver", "multi",
    "transillum", "tomograph", "mog", "zop", "vrp", "borehole",
)  # fmt: skip
"""What the letters of SURVEY MODE are for a line, and hold for a survey whose antennas move apart."""
_UNUSED = (
    (slice(3, 4), "the topography (word 4)"),
    (slice(8, 14), "the satellite receiver's position (words 9 to 14)"),
    (slice(20, 21), "the adjustment of time zero (word 21)"),
)
"""Columns of a trace header's words that are told and not used, and what they are."""
_LEAST_SEPARATION = 0.005  # m, of two antennas


def read_dt1(path: Path, limit: int) -> dict[str, Any]:
    """Read a DT1: the entries of a :class:`flgpr.formats.gpr_files.GprSection`; what contradicts is a ValueError."""
    notes: list[str] = []
    head = read_header(path, ".hd", "=", notes)
    samples = int(head.needed("NUMBER OF PTS/TRC", 2, MOST_SAMPLES))
    window = head.needed(
        "TOTAL TIME WINDOW", INTERVALS[0] / NANOSECOND, INTERVALS[1] / NANOSECOND * samples
    )
    stated = head.number("NUMBER OF TRACES", 0, 1e9, False)
    table = _records(path, head, samples, stated, notes, limit)
    words = float64(table["head"])
    traces = exact_floats(table["samples"], notes)
    empty = words[:, 21] == 1
    traces[empty] = np.nan
    if empty.any():
        notes.append(f"{np.count_nonzero(empty)} traces without data, as their headers say")
    zero = head.number("TIMEZERO AT POINT", -1e6, 1e6, False)
    if zero is None:
        notes.append(ZERO_ASSUMED)
    elif zero == 0:
        notes.append(
            "TIMEZERO AT POINT is 0, but points are counted from 1: the first one is taken"
        )
    megahertz = head.number("NOMINAL FREQUENCY", 0, 1e5, False)
    distance, separation = _lengths(head, words, notes)
    fixes = _fixes(path, words, notes)
    _note_unused_words(words, notes)
    gather = _gather(head, words, notes)
    if gather:
        notes.append(gather_note(gather))
    return {
        "traces": traces[:, None],
        # Points are counted from 1.
        "delay": (np.arange(samples) - ((zero or 1.0) - 1.0)) * window * NANOSECOND / samples,
        "distance": distance,
        "time": measured_clock(words[:, 23], notes),
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "marks": tuple(np.flatnonzero(words[:, 24] == 1).tolist()),
        "frequencies": (megahertz * 1e6 if megahertz else None,),
        "separation": separation,
        "gather": gather,
        "history": tuple(notes),
    }


def _records(
    path: Path, head: Header, samples: int, stated: float | None, notes: list[str], limit: int
) -> NDArray[Any]:  # fmt: skip
    """Read the traces with their headers, in the byte order and the sample type that the trace headers bear out."""
    name = head.text("DATA TYPE").upper().replace(" ", "")
    if name and name not in _TYPES:
        raise ValueError(f"{head.path.name}: DATA TYPE must be I*2 or F*4, got {name[:40]!r}")
    raw = first_bytes(path, 100)
    if len(raw) < 100:
        raise ValueError(f"a trace header must have 100 bytes, the file has {len(raw)}")
    first = np.frombuffer(raw, "<f4")
    turned = first[2] != samples and first.byteswap()[2] == samples
    width = (first.byteswap() if turned else first)[5]
    stated_type = _TYPES.get(name) or ("f4" if width == 4 else "i2")
    other = "i2" if stated_type == "f4" else "f4"
    sample = stated_type
    if not _second_agrees(path, samples, stated_type, turned) and _second_agrees(
        path, samples, other, turned
    ):
        sample = other
    table = read_records(path, 0, _record(samples, sample, turned), stated, notes, limit)
    told = float64(table["head"][:, 2])
    if (told != samples).any():
        bad = int(np.argmax(told != samples))
        raise ValueError(
            f"trace {bad} must have {samples} points as {head.path.name} says, got {told[bad]:g}"
        )
    if sample != _TYPES.get(name, "i2"):
        says = f"DATA TYPE is {name}" if name else "no DATA TYPE is told"
        notes.append(f"samples are read as {_WORDS[sample]}, by their size ({says})")
    return table


def _record(samples: int, sample: str, turned: bool) -> np.dtype[Any]:
    """Return the type of a trace: header words, comment and samples."""
    record = np.dtype([("head", "<f4", 25), ("comment", "S28"), ("samples", f"<{sample}", samples)])
    return record.newbyteorder() if turned else record


def _second_agrees(path: Path, samples: int, sample: str, turned: bool) -> bool:
    """Tell whether the second trace header lies where it does if samples are of a type; true if there is no second."""
    record = _record(samples, sample, turned)
    raw = first_bytes(path, record.itemsize, record.itemsize)
    return len(raw) < record.itemsize or np.frombuffer(raw, record)["head"][0, 2] == samples


def _lengths(
    head: Header, words: FloatArray, notes: list[str]
) -> tuple[FloatArray | None, float | None]:  # fmt: skip
    """Return the distance along the line (trace,), m, and the antennas' separation, m, if they are told."""
    name = head.text("POSITION UNITS")
    unit = length_unit(name or "m")
    step = head.number("STEP SIZE USED", -1e4, 1e4, False)
    separation = head.number("ANTENNA SEPARATION", 0, 1e3, False)
    if unit is None:
        notes.append(
            f"POSITION UNITS are {name[:20]!r}, which is no unit that is known: no place and no separation is used"
        )
        return None, None
    if not name:
        notes.append("POSITION UNITS are not told: positions are taken as metres")
    scaled = None if step is None else step * unit
    distance = measured_places(
        words[:, 1] * unit,
        scaled,
        "positions of the trace headers",
        "STEP SIZE USED in the header",
        notes,
    )
    if separation is not None and 0 < separation * unit < _LEAST_SEPARATION <= separation:
        notes.append(
            f"ANTENNA SEPARATION {separation:g} is taken as metres: antennas cannot be {separation:g} {name} apart"
        )
        return distance, separation
    return distance, None if separation is None else separation * unit


def _note_unused_words(words: FloatArray, notes: list[str]) -> None:
    """Tell which words of the trace headers are filled in and not used."""
    for columns, meaning in _UNUSED:
        filled = np.count_nonzero((np.nan_to_num(words[:, columns]) != 0).any(axis=1))
        if filled:
            notes.append(f"{meaning} of {filled} traces is not used")


def _fixes(path: Path, words: FloatArray, notes: list[str]) -> Fixes:
    """Return the positions of the .GPS beside the recording, or of the .GP2 of newer instruments."""
    older = find_beside(path, ".gps")
    newer = find_beside(path, ".gp2")
    note_unread(path, (".ini", ".top", ".nav"), notes)
    if older is not None and newer is not None:
        notes.append(f"{newer.name} lies beside it and is not read, because {older.name} is")
    return nmea_fixes(older or newer, len(words), notes, _whole_numbers(words[:, 0]))


def _whole_numbers(values: FloatArray) -> NDArray[np.int64] | None:
    """Return the traces' own numbers, if that is what the header words are."""
    if (
        not np.isfinite(values).all()
        or (np.abs(values) > 1e9).any()
        or (values != np.round(values)).any()
    ):
        return None
    return values.astype(np.int64)


def _gather(head: Header, words: FloatArray, notes: list[str]) -> str:
    """Return what the file calls a survey whose antennas move apart; empty for a line of one offset."""
    mode = head.text("SURVEY MODE")
    letters = "".join(filter(str.isalpha, mode.lower()))
    if any(word in letters for word in _GATHERS):
        return mode
    if letters not in _LINES:
        notes.append(
            f"SURVEY MODE is {mode[:40]!r}, which is not known: it is read as a line of one offset"
        )
    places = words[:, 14:20]  # of receiver and transmitter
    if not np.isfinite(places).all() or (np.abs(places) > FARTHEST).any() or not places.any():
        return ""  # not filled in
    apart = np.linalg.norm(places[:, :3] - places[:, 3:], axis=1)
    return gather_of_separations(apart, "", notes)
