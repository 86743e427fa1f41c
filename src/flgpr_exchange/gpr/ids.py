"""IDS GeoRadar's DT.

Its layout is not published: it is as the programs of others find it (RGPR, ``R/readIDS.R``).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr_exchange.gpr.parts import (
    INTERVALS,
    ZERO_ASSUMED,
    equal_steps,
    exact_floats,
    first_bytes,
    numbers_in,
    read_records,
)

_LARGEST_HEADER = 2**20  # bytes
_MARK = 4  # bytes at the begin of a record
_ANTENNA_WIDTHS = [16, 16, 16, 5, 16, 16, 16, 5]
"""Bytes of x, y, z and frequency of the transmitter, and of the receiver."""


class _Head(NamedTuple):
    """What the record H of the header states."""

    stated_traces: int
    samples: int
    offset: int  # count of no signal
    window: float  # s
    step: float  # of traces, m


def read_ids(path: Path, limit: int) -> dict[str, Any]:
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
    head = _head_of(header[b"H"], size)

    notes = ["the layout of IDS files is not published: this is what others found in theirs"]
    record = np.dtype(
        [
            ("mark", "u1", _MARK),
            ("samples", "<i2", head.samples),
            ("rest", "u1", size - _MARK - 2 * head.samples),
        ]
    )
    table = read_records(path, start, record, head.stated_traces or None, notes, limit)
    marks = table["mark"]
    letters = marks[:, 0]
    if (letters != ord("R")).any():
        bad = int(np.argmax(letters != ord("R")))
        raise ValueError(f"trace {bad} must begin with R, got byte {letters[bad]:#04x}")

    counts = _with_sign(table["samples"], notes)
    traces = exact_floats(counts, notes) - np.float32(head.offset)
    is_lost = (marks[:, 1] == 1) & (marks[:, 2] == 6)
    traces[is_lost] = np.nan
    if is_lost.any():
        notes.append(f"{np.count_nonzero(is_lost)} traces without data, as their marks say")
    notes.append(ZERO_ASSUMED)

    frequency, separation = _antennas_of(header.get(b"ATR", b""))
    plausible_step = head.step if 0 < abs(head.step) < 1e3 else None
    marked = np.flatnonzero(np.isin(marks[:, 1], (8, 9)))
    return {
        "traces": traces[:, None],
        "delay": np.arange(head.samples) * (head.window / head.samples),
        "distance": equal_steps(len(traces), plausible_step, "the header's step", notes),
        "marks": tuple(marked.tolist()),
        "frequencies": (frequency,),
        "separation": separation,
        "history": tuple(notes),
    }


def _head_of(content: bytes, size: int) -> _Head:
    """Return what the record H states; ``size`` are the bytes of a record."""
    stated, samples = struct.unpack_from("<2i", content, 12)
    (offset,) = struct.unpack_from("<i", content, 40)
    most = (size - _MARK) // 2
    if not 2 <= samples <= most:
        raise ValueError(f"samples must be from 2 to the {most} that a record holds, got {samples}")
    numbers = numbers_in(content[44:], [16] * 10)
    window = numbers[3]
    if not INTERVALS[0] <= window / samples <= INTERVALS[1]:
        raise ValueError(f"its window must be a time in seconds, got {window:g}")
    return _Head(stated, samples, offset, window, step=numbers[8])


def _antennas_of(content: bytes) -> tuple[float | None, float | None]:
    """Return the nominal frequency, Hz, and the separation, m, of the antennas in the record ATR.

    What is not plausible is None.
    """
    antennas = numbers_in(content, _ANTENNA_WIDTHS)
    megahertz = antennas[3]
    apart_x = antennas[4] - antennas[0]
    apart_y = antennas[5] - antennas[1]
    separation = float(np.hypot(apart_x, apart_y))
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
        name = raw[begin : begin + 3].split(b"\0")[0].strip()
        records[name] = raw[begin + 4 : begin + size]
    return records, start


def _with_sign(samples: NDArray[Any], notes: list[str]) -> NDArray[Any]:
    """Return counts (trace, sample) as signed or unsigned numbers: a wrong sign makes leaps."""
    unsigned = samples.view("<u2")
    is_signed = _mean_leap(samples) <= _mean_leap(unsigned)
    notes.append(f"counts taken as {'signed' if is_signed else 'unsigned'}, by their smaller leaps")
    return samples if is_signed else unsigned


def _mean_leap(samples: NDArray[Any]) -> float:
    """Return the mean difference of a sample from the one before."""
    steps = np.diff(samples.astype(np.int32), axis=1)
    return float(np.abs(steps).mean())
