"""IDS GeoRadar's DT.

Its layout is not published: it is as the programs of others find it (RGPR, ``R/readIDS.R``).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from flgpr.types import AnyArray, Entries, Notes
from flgpr_exchange.gpr.along_line import equal_steps, interleaved_channels
from flgpr_exchange.gpr.parts import (
    INTERVALS,
    ZERO_ASSUMED,
    exact_floats,
    first_bytes,
    header_words,
    note_count,
    numbers_in,
    read_records,
)

_LARGEST_HEADER = 2**20  # bytes
_MARK = 4  # bytes at the begin of a record
_ANTENNA_WIDTHS = [16, 16, 16, 5]
"""Bytes of x, y, z and frequency of an antenna; ATR holds transmitter and receiver, ATX and ARX one
each."""
_INTEGERS = {"traces": ("i4", 12), "samples": ("i4", 16), "zero": ("i4", 40)}
"""Integers of the record H: type and offset; zero is the count of no signal."""
_INTEGERS_END = 44  # bytes; ten numbers of 16 letters follow
_WINDOW = 3  # which of these is the time window
_STEPS = (6, 8)  # and which may be the distance of the traces: the cell across stands there, too


def read_ids(path: Path, limit: int, notes: Notes) -> Entries:
    """Read a DT.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    raw = first_bytes(path, _LARGEST_HEADER)
    size = int.from_bytes(raw[4:6], "little")
    if raw[:1] != b"V" or size < 256 or size % 2:
        raise ValueError(
            f"it must begin with V and the even length of its records, got {raw[:1]!r} and {size}"
        )

    header, start = _header_records(raw, size)
    if b"H" not in header:
        raise ValueError("it must hold a record H with the window and the step, got none")
    head = header_words(header[b"H"][:_INTEGERS_END], _INTEGERS, "<")
    samples = head["samples"]
    most = (size - _MARK) // 2
    if not 2 <= samples <= most:
        raise ValueError(f"samples must be from 2 to the {most} that a record holds, got {samples}")
    numbers = numbers_in(header[b"H"][_INTEGERS_END:], [16] * 10)
    window = numbers[_WINDOW]
    if not INTERVALS[0] <= window / samples <= INTERVALS[1]:
        raise ValueError(f"its window must be a time in seconds, got {window:g}")

    notes.append("the layout of IDS files is not published: this is what others found in theirs")
    rest = size - _MARK - 2 * samples
    fields = [("mark", "u1", _MARK), ("samples", "<i2", samples), ("rest", "u1", rest)]
    table = read_records(path, start, np.dtype(fields), head["traces"] or None, notes, limit)
    marks = table["mark"]
    letters = marks[:, 0]
    if (letters != ord("R")).any():
        bad = int(np.argmax(letters != ord("R")))
        raise ValueError(f"trace {bad} must begin with R, got byte {letters[bad]:#04x}")

    # A wrong sign makes leaps from sample to sample.
    signed, unsigned = table["samples"], table["samples"].view("<u2")
    is_signed = _mean_leap(signed) <= _mean_leap(unsigned)
    notes.append(f"counts taken as {'signed' if is_signed else 'unsigned'}, by their smaller leaps")
    traces = exact_floats(signed if is_signed else unsigned, notes) - np.float32(head["zero"])
    is_lost = (marks[:, 1] == 1) & (marks[:, 2] == 6)
    traces[is_lost] = np.nan
    note_count(notes, is_lost, "traces without data, as their marks say")
    notes.append(ZERO_ASSUMED)

    frequency, separation = _antennas_of(header)
    step = _step_of([numbers[field] for field in _STEPS], notes)
    stated = re.search(rb"N_CHANNEL\s*=\s*(\d{1,3})", header.get(b"S", b""))
    traces = interleaved_channels(traces, int(stated[1]) if stated else 1, "N_CHANNEL", notes)
    marked = np.flatnonzero(np.isin(marks[:, 1], (8, 9)))
    return {
        "traces": traces,
        "delay": np.arange(samples) * (window / samples),
        "distance": equal_steps(len(traces), step, "the header's step", notes),
        "marks": tuple(np.unique(marked // (len(marks) // len(traces))).tolist()),
        "frequencies": (frequency,) * traces.shape[1],
        "separation": separation,
    }


def _step_of(steps: list[float], notes: Notes) -> float | None:
    """Return the distance of the traces, m: the first field of H that can be it."""
    plausible = [step for step in steps if 0 < abs(step) < 1e3]
    if len(set(plausible)) > 1:
        fields = " and ".join(
            f"{step:g} m in field {field + 1}" for field, step in zip(_STEPS, steps, strict=True)
        )
        notes.append(
            f"two numbers of H may be the distance of the traces, {fields}: the first is taken; "
            "`step` replaces it"
        )
    return plausible[0] if plausible else None


def _antennas_of(header: dict[bytes, bytes]) -> tuple[float | None, float | None]:
    """Return the nominal frequency, Hz, and the separation, m, of the antennas of a header.

    What is not plausible is None.
    """
    width = sum(_ANTENNA_WIDTHS)
    content = header.get(b"ATR") or b"".join(
        header.get(name, b"")[:width].ljust(width) for name in (b"ATX", b"ARX")
    )
    antennas = numbers_in(content, 2 * _ANTENNA_WIDTHS)
    megahertz = antennas[3]
    separation = float(np.hypot(antennas[4] - antennas[0], antennas[5] - antennas[1]))
    return (
        megahertz * 1e6 if 1 <= megahertz <= 1e5 else None,
        separation if 0 < separation <= 1e3 else None,
    )


def _header_records(raw: bytes, size: int) -> tuple[dict[bytes, bytes], int]:
    """Return the contents of the records of the header by their names, and where the traces begin.

    All records have one length, and begin with their name; that of a trace is R.
    """
    letters = [raw[begin : begin + 1] for begin in range(0, len(raw), size)]
    if b"R" not in letters:
        raise ValueError(
            "it must hold a record R, the first trace, "
            f"in its first {_LARGEST_HEADER} bytes, got none"
        )
    start = letters.index(b"R") * size
    records = {}
    for begin in range(size, start, size):
        # Real recorders put other bytes behind a name that is shorter.
        name = re.match(rb"[A-Z]*[0-9]?", raw[begin : begin + 3])
        records[name[0] if name else b""] = raw[begin + 4 : begin + size]
    return records, start


def _mean_leap(samples: AnyArray) -> float:
    """Return the mean difference of a sample from the one before."""
    steps = np.diff(samples.astype(np.int32), axis=1)
    return float(np.abs(steps).mean())
