"""MALÅ's RD3 and RD7 with their text header RAD, and ImpulseRadar's IPRB with IPRH.

ImpulseRadar's layout follows MALÅ's: one reader takes both, by a table of what differs.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from flgpr.types import Entries, Notes
from flgpr_exchange.gpr.along_line import channel_offsets, equal_steps, interleaved_channels
from flgpr_exchange.gpr.antennas import noted_frequency
from flgpr_exchange.gpr.parts import (
    INTERVALS,
    MOST_SAMPLES,
    ZERO_ASSUMED,
    Header,
    exact_floats,
    read_header,
    read_records,
)
from flgpr_exchange.gpr.positions import CHANNEL_OF_NAME, cor_fixes, find_cor, note_unread

_MICROSECOND = 1e-6


class _Maker(NamedTuple):
    """What differs between the headers of the two makers."""

    name: str
    header: str  # its ending
    channels: str  # entry of how many channels there are
    steps: tuple[str, ...]  # entries of the trace spacing, the first that is stated counts
    no_wheel: tuple[str, str]  # entry, and how its value begins where no wheel turned
    unread: tuple[str, ...]  # endings of files beside it


_MALA = _Maker(
    name="MALÅ",
    header=".rad",
    channels="NUMBER_OF_CH",
    steps=("DISTANCE INTERVAL",),
    no_wheel=("DISTANCE FLAG", "0"),
    unread=(".mrk", ".em", ".gps"),
)
_IMPULSE = _Maker(
    name="ImpulseRadar",
    header=".iprh",
    channels="CHANNELS",
    steps=("USER DISTANCE INTERVAL", "DISTANCE INTERVAL"),
    no_wheel=("TRIG SOURCE", "time"),
    unread=(".mrk", ".time", ".gps"),
)
_FILES: dict[str, tuple[_Maker, float | None]] = {
    ".rd3": (_MALA, 16),
    ".rd7": (_MALA, 32),
    ".iprb": (_IMPULSE, None),
}
"""Maker of a file by its ending, and its bits a sample; None where the header states them."""


def read_mala(path: Path, limit: int, notes: Notes) -> Entries:
    """Read an RD3, RD7 or IPRB.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    maker, bits = _FILES[path.suffix.lower()]
    head = read_header(path, maker.header, ":", notes)
    samples = int(head.needed("SAMPLES", 2, MOST_SAMPLES))
    fastest = _MICROSECOND / INTERVALS[0]
    interval = _MICROSECOND / head.needed("FREQUENCY", _MICROSECOND / INTERVALS[1], fastest)
    if bits is None:
        bits = head.number("DATA VERSION", 16, 32)
        if bits is None:
            notes.append("the header tells no DATA VERSION: samples are read as 16 bit")
        elif bits not in (16, 32):
            raise ValueError(f"{head.path.name}: DATA VERSION must be 16 or 32, got {bits:g}")
    record = np.dtype(("<i4" if bits == 32 else "<i2", samples))
    last = head.number("LAST TRACE", 0, 1e9)
    many = int(head.number(maker.channels, 0, 4096) or 1)
    are_places = last is not None and last * many * record.itemsize == path.stat().st_size
    table = read_records(path, 0, record, None if are_places else last, notes, limit)
    traces = interleaved_channels(
        exact_floats(table, notes),
        many,
        maker.channels,
        notes,
        last,
        CHANNEL_OF_NAME.fullmatch(path.stem) is not None,
    )
    count = len(traces)

    name, step = _step(head, maker, notes)
    zero = head.number("ZERO LEVEL", 0, samples) if maker is _IMPULSE else None
    if zero is None:
        notes.append(ZERO_ASSUMED)
    time = None
    seconds = head.number("TIME INTERVAL", 0, 1e6) if maker is _MALA else None
    if seconds and head.text("TIME FLAG") == "1":
        notes.append(
            f"the traces' clock is that of a trace every {seconds:g} s, by TIME INTERVAL in the "
            "header"
        )
        time = np.arange(count, dtype=np.float64) * seconds
    frequency = noted_frequency(head.text("ANTENNAS", "ANTENNA"), maker.name, notes)
    fixes = cor_fixes(find_cor(path, notes), count, notes)
    note_unread(path, maker.unread, notes)
    return {
        "traces": traces,
        "delay": (np.arange(samples) - (zero or 0.0)) * interval,
        "distance": equal_steps(count, step, f"{name} in the header", notes),
        "time": time,
        "fixes": fixes,
        "frequencies": (frequency,) * traces.shape[1],
        "separation": head.number("ANTENNA SEPARATION", 0, 1e3),
        "offsets": channel_offsets(head, traces.shape[1], notes),
        "title": head.text("SITE"),
    }


def _step(head: Header, maker: _Maker, notes: Notes) -> tuple[str, float | None]:
    """Return the entry of the trace spacing, and that, m; None where no wheel was used."""
    steps = {name: head.number(name, -1e4, 1e4) for name in maker.steps}
    name = next((name for name, step in steps.items() if step), maker.steps[-1])
    step = steps[name]
    entry, beginning = maker.no_wheel
    if step and head.text(entry).lower().startswith(beginning):
        notes.append(f"{entry} is {beginning}: no wheel was used, and {name} ({step:g} m) is not")
        return name, None
    return name, step
