"""SEG-Y of revisions 0 to 2, as radars write it, and Seismic Unix."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flgpr.types import AnyArray, Entries, Float32Array, Notes
from flgpr_exchange.gpr.parts import (
    FOOT,
    INTERVALS,
    ZERO_ASSUMED,
    exact_floats,
    first_bytes,
    header_words,
    interleaved_channels,
    note_count,
    read_records,
)
from flgpr_exchange.gpr.segy_layout import (
    PICOSECOND,
    TRACE_HEAD,
    TRACE_WORDS,
    TraceLayout,
    interval_of,
    layout_of,
    read_head,
    record_type,
)
from flgpr_exchange.gpr.segy_places import geometry_of

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
    _check_trace_headers(table, traces.shape[1], interval, notes)
    dead = np.isin(table["identification"], _DEAD)
    traces[dead] = np.nan
    note_count(notes, dead, "traces without data, as their headers say (dead or dummy)")
    counted = _channels_of(table)
    by_channel = interleaved_channels(
        traces, counted or stated, "the count of an ensemble's traces", notes
    )
    if counted:
        by_channel = traces.reshape(-1, counted, traces.shape[1])
    channels = by_channel.shape[1]
    geometry = geometry_of(table[::channels][: len(by_channel)], metre, notes)
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


def _check_trace_headers(table: AnyArray, samples: int, interval: float, notes: Notes) -> None:
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
    if np.ptp(offset) > 0:
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
