"""MALÅ's RD3 and RD7 with their text header RAD, and ImpulseRadar's IPRB with IPRH.

ImpulseRadar's layout follows MALÅ's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flgpr_exchange.gpr.antennas import noted_frequency
from flgpr_exchange.gpr.parts import (
    INTERVALS,
    MOST_SAMPLES,
    ZERO_ASSUMED,
    Header,
    equal_steps,
    exact_floats,
    find_companion,
    read_header,
    read_records,
)
from flgpr_exchange.gpr.positions import cor_fixes, note_unread

_MICROSECOND = 1e-6


def read_mala(path: Path, limit: int) -> dict[str, Any]:
    """Read an RD3 or RD7.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    notes: list[str] = []
    head = read_header(path, ".rad", ":", notes)
    samples, interval = _sampling(head)
    sample_type = "<i4" if path.suffix.lower() == ".rd7" else "<i2"
    stated = head.number("LAST TRACE", 0, 1e9, False)
    table = read_records(path, 0, np.dtype((sample_type, samples)), stated, notes, limit)

    step = head.number("DISTANCE INTERVAL", -1e4, 1e4, False)
    if head.text("DISTANCE FLAG") == "0" and step:
        notes.append(
            f"DISTANCE FLAG is 0: no wheel was used, and DISTANCE INTERVAL ({step:g} m) is not"
        )
        step = None
    notes.append(ZERO_ASSUMED)

    seconds = head.number("TIME INTERVAL", 0, 1e6, False)
    time = None
    if seconds and head.text("TIME FLAG") == "1":
        time = np.arange(len(table)) * float(seconds)
        notes.append(
            f"the traces' clock is that of a trace every {seconds:g} s, "
            "by TIME INTERVAL in the header"
        )

    frequency = noted_frequency(head.text("ANTENNAS", "ANTENNA"), "MALÅ", notes)
    fixes = cor_fixes(find_companion(path, ".cor"), len(table), notes)
    note_unread(path, (".mrk", ".em", ".gps"), notes)
    return {
        "traces": exact_floats(table, notes)[:, None],
        "delay": np.arange(samples) * interval,
        "distance": equal_steps(len(table), step, "DISTANCE INTERVAL in the header", notes),
        "time": time,
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "frequencies": (frequency,),
        "separation": head.number("ANTENNA SEPARATION", 0, 1e3, False),
        "title": head.text("SITE") or path.stem,
        "history": tuple(notes),
    }


def read_impulse(path: Path, limit: int) -> dict[str, Any]:
    """Read an IPRB; parameters, entries and errors are those of :func:`read_mala`."""
    notes: list[str] = []
    head = read_header(path, ".iprh", ":", notes)
    samples, interval = _sampling(head)
    bits = head.number("DATA VERSION", 16, 32, False)
    if bits is None:
        notes.append("the header tells no DATA VERSION: samples are read as 16 bit")
    elif bits not in (16, 32):
        raise ValueError(f"{head.path.name}: DATA VERSION must be 16 or 32, got {bits:g}")
    record = np.dtype(("<i4" if bits == 32 else "<i2", samples))
    stated = head.number("LAST TRACE", 0, 1e9, False)
    table = read_records(path, 0, record, stated, notes, limit)

    name = "USER DISTANCE INTERVAL"
    step = head.number(name, -1e4, 1e4, False)
    wheel_step = head.number("DISTANCE INTERVAL", -1e4, 1e4, False)
    if not step:
        name = "DISTANCE INTERVAL"
        step = wheel_step
    if head.text("TRIG SOURCE").lower().startswith("time") and step:
        notes.append(f"TRIG SOURCE is time: no wheel was used, and {name} ({step:g} m) is not")
        step = None

    zero = head.number("ZERO LEVEL", 0, samples, False)
    if zero is None:
        notes.append(ZERO_ASSUMED)
    frequency = noted_frequency(head.text("ANTENNA"), "ImpulseRadar", notes)
    fixes = cor_fixes(find_companion(path, ".cor"), len(table), notes)
    note_unread(path, (".mrk", ".time", ".gps"), notes)
    return {
        "traces": exact_floats(table, notes)[:, None],
        "delay": (np.arange(samples) - (zero or 0.0)) * interval,
        "distance": equal_steps(len(table), step, f"{name} in the header", notes),
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "frequencies": (frequency,),
        "separation": head.number("ANTENNA SEPARATION", 0, 1e3, False),
        "history": tuple(notes),
    }


def _sampling(head: Header) -> tuple[int, float]:
    """Return the samples of a trace, and their interval, s; the header has the rate in MHz."""
    samples = int(head.needed("SAMPLES", 2, MOST_SAMPLES))
    lowest = _MICROSECOND / INTERVALS[1]
    highest = _MICROSECOND / INTERVALS[0]
    return samples, _MICROSECOND / head.needed("FREQUENCY", lowest, highest)
