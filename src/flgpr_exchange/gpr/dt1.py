"""Sensors & Software's DT1 with its text header HD, as the maker's pulseEKKO manuals describe them.

A trace header has 25 words of 32 bit floating point and a comment of 28 bytes: words 1 to 3 are
number, position and samples of the trace, word 6 the bytes of a sample, words 15 to 20 the
positions of receiver and transmitter, word 22 is 1 where the trace is no data, word 24 the second
of the day, word 25 is 1 where the operator set a mark.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flgpr.types import AnyArray, Entries, FloatArray, Notes
from flgpr_exchange.gpr.along_line import (
    FARTHEST,
    gather_of_separations,
    measured_clock,
    measured_distance,
)
from flgpr_exchange.gpr.parts import (
    INTERVALS,
    MOST_SAMPLES,
    NANOSECOND,
    ZERO_ASSUMED,
    Header,
    exact_floats,
    find_companion,
    first_bytes,
    float64,
    length_unit,
    note_count,
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


def read_dt1(path: Path, limit: int, notes: Notes) -> Entries:
    """Read a DT1.

    Parameters
    ----------
    path : Path
        The recording.
    limit : int
        Bytes of memory to use.
    notes : list of str
        Takes what is assumed, replaced or not used.

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
    head = read_header(path, ".hd", "=", notes)
    samples = int(head.needed("NUMBER OF PTS/TRC", 2, MOST_SAMPLES))
    shortest, longest = (edge / NANOSECOND for edge in INTERVALS)
    window = head.needed("TOTAL TIME WINDOW", shortest, longest * samples)

    stated = head.number("NUMBER OF TRACES", 0, 1e9)
    table = _records(path, head, samples, stated, notes, limit)
    header_words = float64(table["head"])
    traces = exact_floats(table["samples"], notes)
    empty = header_words[:, 21] == 1
    traces[empty] = np.nan
    note_count(notes, empty, "traces without data, as their headers say")

    zero = head.number("TIMEZERO AT POINT", -1e6, 1e6)  # counted from 1
    if zero is None:
        notes.append(ZERO_ASSUMED)
    elif zero == 0:
        notes.append(
            "TIMEZERO AT POINT is 0, but points are counted from 1: the first one is taken"
        )
    megahertz = head.number("NOMINAL FREQUENCY", 0, 1e5)
    distance, separation = _lengths(head, header_words, notes)
    fixes = _fixes(path, header_words, notes)
    for columns, meaning in _UNUSED:
        filled = (np.nan_to_num(header_words[:, columns]) != 0).any(axis=1)
        count = np.count_nonzero(filled)
        if count:
            notes.append(f"{meaning} of {count} traces is not used")
    return {
        "traces": traces[:, None],
        "delay": (np.arange(samples) - ((zero or 1.0) - 1.0)) * window * NANOSECOND / samples,
        "distance": distance,
        "time": measured_clock(header_words[:, 23], notes),
        "fixes": fixes,
        "marks": tuple(np.flatnonzero(header_words[:, 24] == 1).tolist()),
        "frequencies": (megahertz * 1e6 if megahertz else None,),
        "separation": separation,
        "gather": _gather(head, header_words, notes),
    }


def _records(
    path: Path, head: Header, samples: int, stated: float | None, notes: Notes, limit: int
) -> AnyArray:
    """Read the traces with their headers.

    Byte order and sample type are those that the trace headers bear out.
    """
    name = head.text("DATA TYPE").upper().replace(" ", "")
    if name and name not in _TYPES:
        raise ValueError(f"{head.path.name}: DATA TYPE must be I*2 or F*4, got {name[:40]!r}")

    raw = first_bytes(path, _HEADER, 0, "a trace header", _HEADER)
    first_words = np.frombuffer(raw, "<f4")
    swapped_words = first_words.byteswap()
    swapped = first_words[2] != samples and swapped_words[2] == samples
    width = (swapped_words if swapped else first_words)[5]

    # The type that is stated, else by the bytes of a sample, unless it moves the second header.
    likely = _TYPES.get(name) or ("f4" if width == 4 else "i2")
    order = ">" if swapped else "<"
    records = {}
    for kind in (likely, "i2" if likely == "f4" else "f4"):
        fields = [("head", f"{order}f4", 25), ("comment", "S28")]
        records[kind] = np.dtype([*fields, ("samples", f"{order}{kind}", samples)])
    sample = likely
    for kind, record in reversed(records.items()):
        second = first_bytes(path, record.itemsize, record.itemsize)
        is_cut_off = len(second) < record.itemsize
        if is_cut_off or np.frombuffer(second, record)["head"][0, 2] == samples:
            sample = kind
    table = read_records(path, 0, records[sample], stated, notes, limit)

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


def _lengths(
    head: Header, header_words: FloatArray, notes: Notes
) -> tuple[FloatArray | None, float | None]:
    """Return the distance along the line (trace,), m, and the antennas' separation, m, if known."""
    name = head.text("POSITION UNITS")
    unit = length_unit(name or "m")
    step = head.number("STEP SIZE USED", -1e4, 1e4)
    separation = head.number("ANTENNA SEPARATION", 0, 1e3)
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
        unit = 1.0
    return distance, separation * unit


def _fixes(path: Path, header_words: FloatArray, notes: Notes) -> Fixes:
    """Return the positions of the .GPS beside the recording, or of newer instruments' .GP2."""
    older = find_companion(path, ".gps")
    newer = find_companion(path, ".gp2")
    note_unread(path, (".ini", ".top", ".nav"), notes)
    if older is not None and newer is not None:
        notes.append(f"{newer.name} lies beside it and is not read, because {older.name} is")
    stated = header_words[:, 0]
    # The traces' own numbers, if that is what the header words are.
    are_numbers = (np.abs(stated) <= 1e9).all() and (stated == np.round(stated)).all()
    numbers = stated.astype(np.int64) if are_numbers else None
    return nmea_fixes(older or newer, len(stated), notes, numbers)


def _gather(head: Header, header_words: FloatArray, notes: Notes) -> str:
    """Return what the file calls a survey whose antennas move apart; empty for a line."""
    mode = head.text("SURVEY MODE")
    letters = "".join(filter(str.isalpha, mode.lower()))
    if any(word in letters for word in _GATHERS):
        return mode
    if letters not in _LINES:
        notes.append(
            f"SURVEY MODE is {mode[:40]!r}, which is not known: it is read as a line of one offset"
        )
    positions = header_words[:, 14:20]  # of receiver and transmitter; all are 0 if not filled in
    if not (np.abs(positions) <= FARTHEST).all() or not positions.any():
        return ""
    apart = np.linalg.norm(positions[:, :3] - positions[:, 3:], axis=1)
    return gather_of_separations(apart, "", notes)
