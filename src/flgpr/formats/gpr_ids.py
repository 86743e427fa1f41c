"""IDS GeoRadar's DT, whose layout is not published: it is as the programs of others find it (RGPR, ``R/readIDS.R``)."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.formats.gpr_parts import (
    INTERVALS,
    ZERO_ASSUMED,
    equal_steps,
    exact_floats,
    first_bytes,
    numbers_in,
    read_records,
)

_LARGEST_HEADER = 2**20  # bytes


def read_ids(path: Path, limit: int) -> dict[str, Any]:
    """Read a DT: the entries of a :class:`flgpr.formats.gpr_files.GprSection`; what contradicts is a ValueError."""
    raw = first_bytes(path, _LARGEST_HEADER)
    size = int.from_bytes(raw[4:6], "little")
    if raw[:1] != b"V" or size < 256 or size % 2:
        raise ValueError(
            f"it must begin with V and the even length of its records, got {raw[:1]!r} and {size}"
        )
    # Records of one length, each begins with its name: those of the header, then a trace each,
    # whose name is R.
    names = [raw[k : k + 1] for k in range(0, len(raw), size)]
    if b"R" not in names:
        raise ValueError(
            f"it must hold a record R, the first trace, in its first {_LARGEST_HEADER} bytes, got none"
        )
    start = names.index(b"R") * size
    header = {
        raw[k : k + 3].split(b"\0")[0].strip(): raw[k + 4 : k + size]
        for k in range(size, start, size)
    }
    if b"H" not in header:
        raise ValueError("it must hold a record H with the window and the step, got none")
    stated, samples = struct.unpack_from("<2i", header[b"H"], 12)
    offset = struct.unpack_from("<i", header[b"H"], 40)[0]
    if not 2 <= samples <= (size - 4) // 2:
        raise ValueError(
            f"samples must be from 2 to the {(size - 4) // 2} that a record holds, got {samples}"
        )
    _, _, _, window, _, _, _, _, step, _ = numbers_in(header[b"H"][44:], [16] * 10)
    if not INTERVALS[0] <= window / samples <= INTERVALS[1]:
        raise ValueError(f"its window must be a time in seconds, got {window:g}")
    notes = ["the layout of IDS files is not published: this is what others found in theirs"]
    record = np.dtype(
        [("mark", "u1", 4), ("samples", "<i2", samples), ("rest", "u1", size - 4 - 2 * samples)]
    )
    table = read_records(path, start, record, stated or None, notes, limit)
    if (table["mark"][:, 0] != ord("R")).any():
        bad = int(np.argmax(table["mark"][:, 0] != ord("R")))
        raise ValueError(f"trace {bad} must begin with R, got byte {table['mark'][bad, 0]:#04x}")
    signed = table["samples"]
    bare = signed.view("<u2")
    rough = [
        np.abs(np.diff(one.astype(np.int32), axis=1)).mean() for one in (signed, bare)
    ]  # a wrong sign leaps
    notes.append(
        f"counts taken as {'signed' if rough[0] <= rough[1] else 'unsigned'}, by their smaller leaps"
    )
    traces = exact_floats(signed if rough[0] <= rough[1] else bare, notes) - np.float32(offset)
    lost = (table["mark"][:, 1] == 1) & (table["mark"][:, 2] == 6)
    traces[lost] = np.nan
    if lost.any():
        notes.append(f"{np.count_nonzero(lost)} traces without data, as their marks say")
    notes.append(ZERO_ASSUMED)
    places = numbers_in(header.get(b"ATR", b""), [16, 16, 16, 5, 16, 16, 16, 5])
    apart = float(np.hypot(places[4] - places[0], places[5] - places[1]))
    megahertz = places[3] if np.isfinite(places[3]) else np.nan
    return {
        "traces": traces[:, None],
        "delay": np.arange(samples) * (window / samples),
        "distance": equal_steps(
            len(traces), step if 0 < abs(step) < 1e3 else None, "the header's step", notes
        ),
        "marks": tuple(np.flatnonzero(np.isin(table["mark"][:, 1], (8, 9))).tolist()),
        "frequencies": (megahertz * 1e6 if 1 <= megahertz <= 1e5 else None,),
        "separation": apart if 0 < apart <= 1e3 else None,
        "history": tuple(notes),
    }
