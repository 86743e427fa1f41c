"""GSSI's DZT: the structure tagRFHeader of the SIR manuals.

Every channel has a header of 1024 bytes. Tags other than 0xnnFF stand in files that RADAN edited,
such as the example data of GPRPy.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from flgpr_exchange.gpr.antennas import antenna_frequency, noted_frequency, set_frequency
from flgpr_exchange.gpr.dzx import DzxContent, read_dzx
from flgpr_exchange.gpr.parts import (
    INTERVALS,
    NANOSECOND,
    FloatArray,
    equal_steps,
    exact_floats,
    find_companion,
    first_bytes,
    measured_distance,
    read_records,
)
from flgpr_exchange.gpr.positions import nmea_fixes, note_unread

_HEADER = 1024  # bytes, of each channel
_OLD_HEADER = 512  # bytes, of files older than that structure
_MOST_CHANNELS = 4
_MINI_XT = 14  # number of the system StructureScan Mini XT, whose antenna has no name (readgssi)
_TYPES: dict[int, tuple[DTypeLike, float]] = {
    8: ("u1", 128.0),
    16: ("<u2", 32768.0),
    32: ("<i4", 0.0),
}
"""Types of samples by their bits, and the count of no signal."""
_RATES = (1e-3, 1e6)  # scans a second that are plausible
_SPACINGS = (1e-3, 1e5)  # scans per metre that are plausible


class _Head(NamedTuple):
    """What the header of the first channel states."""

    tag: int
    start: int  # of the samples, in headers or bytes
    samples: int
    bits: int
    per_second: float
    per_metre: float
    stated_channels: int

    @property
    def channels(self) -> int:
        """How many channels are read."""
        return self.stated_channels or 1


def read_dzt(path: Path, limit: int) -> dict[str, Any]:
    """Read a DZT.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    raw = first_bytes(path, _MOST_CHANNELS * _HEADER)
    if len(raw) < _HEADER:
        raise ValueError(f"its header must have {_HEADER} bytes, the file has {len(raw)}")
    notes: list[str] = []
    head = _head_of(raw, notes)
    channels = head.channels
    samples = head.samples

    # By the structure a small number counts headers, and a larger one bytes, which all channels'
    # headers take.
    headers = head.start if 0 < head.start < _HEADER else channels
    begin = _HEADER * headers
    if head.start == _OLD_HEADER and begin >= path.stat().st_size:
        begin = _OLD_HEADER
        notes.append(f"its header has {_OLD_HEADER} bytes, as old files have")
    delays = _delays(raw, begin, channels, samples, notes)

    sample, offset = _TYPES[head.bits]
    record = np.dtype((sample, (channels, samples)))
    table = read_records(path, begin, record, None, notes, limit)
    trace_words = table[:, 0, :2].astype(np.int64)
    traces = exact_floats(table, notes)
    traces -= offset  # counts of 8 and 16 bit have no sign
    third_sample = traces[..., 2:3]
    traces[..., :2] = third_sample
    notes.append(
        "the first two samples of every trace are its number and marks: "
        "the third stands in their place"
    )

    count = len(traces)
    dzx = read_dzx(find_companion(path, ".dzx"), count, notes)
    distance = _distance(count, head.per_metre, dzx, notes)
    time = _time(count, head.per_second, distance is None, notes)
    fixes = nmea_fixes(find_companion(path, ".dzg"), count, notes, trace_words[:, 0])
    note_unread(path, (".dza", ".plt", ".tmf"), notes)
    return {
        "traces": traces,
        "delay": delays[0],
        "channel_delay": delays if (delays != delays[0]).any() else None,
        "distance": distance,
        "time": time,
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "marks": _marks(trace_words[:, 1], dzx, notes),
        "frequencies": _frequencies(raw[: max(begin, _HEADER)], channels, notes),
        "history": tuple(notes),
    }


def _head_of(raw: bytes, notes: list[str]) -> _Head:
    """Return what the header of the first channel states."""
    head = _Head(
        *struct.unpack_from("<4H", raw, 0),
        *struct.unpack_from("<2f", raw, 10),
        *struct.unpack_from("<H", raw, 52),
    )
    has_channels = 1 <= head.channels <= _MOST_CHANNELS
    if head.bits not in _TYPES or head.samples < 4 or not has_channels:
        raise ValueError(
            "it must have 8, 16 or 32 bits, 4 or more samples and 1 to 4 channels, "
            f"got {head.bits}, {head.samples}, {head.channels} (its tag is {head.tag:#06x})"
        )
    if not head.stated_channels:
        notes.append("the header tells 0 channels: one is read")
    if head.tag & 0xFF != 0xFF:
        notes.append(f"its tag is {head.tag:#06x}, not 0xnnFF: so begin files that RADAN edited")
    return head


def _time(
    count: int, per_second: float, needed: bool, notes: list[str]
) -> NDArray[np.float64] | None:
    """Return the traces' clock (trace,), s, by the header's rate, where that is ``needed``."""
    plausible = np.isfinite(per_second) and _RATES[0] <= per_second <= _RATES[1]
    if per_second != 0 and not plausible:
        notes.append(f"{per_second:g} scans a second in the header are no rate and are not used")
    if not (needed and plausible):
        return None
    notes.append(f"the traces' clock is that of {per_second:g} scans a second, by the header")
    return np.arange(count) / per_second


def _delays(raw: bytes, begin: int, channels: int, samples: int, notes: list[str]) -> FloatArray:
    """Return the delays (channel, sample), s, by each channel's own header.

    Samples begin at the byte ``begin``.
    """
    delays = np.empty((channels, samples))
    for channel in range(channels):
        base = _HEADER * channel
        delay = None
        if channel == 0 or base + _HEADER <= min(begin, len(raw)):
            delay = _delay_of(raw, base, channel, samples)
        if delay is None and channel == 0:
            position, window = struct.unpack_from("<2f", raw, 22)
            raise ValueError(
                f"range and position must be times in ns, got {window:g} and {position:g}"
            )
        if delay is None:
            notes.append(
                f"the header of channel {channel} tells no time window: "
                "it is taken as that of the first"
            )
            delay = delays[0]
        delays[channel] = delay
    if (delays[:, 0] == 0).any():
        notes.append("the header puts time zero at the first sample")
    for channel, delay in enumerate(delays):
        if (delay != delays[0]).any():
            window = (delay[1] - delay[0]) * samples / NANOSECOND
            zero = -delay[0] / NANOSECOND
            notes.append(
                f"channel {channel} has a header of its own: time window {window:.6g} ns, "
                f"time zero {zero:.6g} ns after its start"
            )
    return delays


def _delay_of(raw: bytes, base: int, channel: int, samples: int) -> FloatArray | None:
    """Return the delays (sample,), s, that a channel's header at the byte ``base`` states.

    It is None if that states no time window.
    """
    header_samples, header_bits = struct.unpack_from("<2H", raw, base + 4)
    first_bits = struct.unpack_from("<H", raw, 6)[0]
    position, window = struct.unpack_from("<2f", raw, base + 22)
    interval = window * NANOSECOND / samples
    if not INTERVALS[0] <= interval <= INTERVALS[1] or not abs(position) <= 100 * window:
        return None
    if header_samples and (header_samples, header_bits) != (samples, first_bits):
        raise ValueError(
            f"channel {channel} must have {samples} samples of {first_bits} bits as the first, "
            f"got {header_samples} of {header_bits}"
        )
    return np.asarray(position * NANOSECOND + np.arange(samples) * interval, dtype=np.float64)


def _distance(count: int, per_metre: float, dzx: DzxContent, notes: list[str]) -> FloatArray | None:
    """Return the distance along the line (trace,), m.

    It is that of the waypoints of the DZX, else by the wheel or by the DZX's spacing.
    """
    _, first_rows = np.unique(dzx.distances[:, 0], return_index=True)
    waypoints = dzx.distances[first_rows]  # one for each scan, ascending
    if len(waypoints) > 1 and np.ptp(waypoints[:, 1]) > 0:
        distance = _between_waypoints(count, waypoints, notes)
        return measured_distance(distance, None, "distances of the DZX", "the DZX", notes)
    plausible = np.isfinite(per_metre) and _SPACINGS[0] <= abs(per_metre) <= _SPACINGS[1]
    if per_metre != 0 and not plausible:
        notes.append(f"{per_metre:g} scans per metre in the header are no spacing and are not used")
    if plausible:
        where = f"{per_metre:g} scans per metre in the header"
        return equal_steps(count, 1 / per_metre, where, notes)
    if dzx.spacing is not None and 1e-5 <= dzx.spacing <= 1e3:
        return equal_steps(count, dzx.spacing, "unitsPerScan of the DZX", notes)
    return None


def _between_waypoints(count: int, waypoints: FloatArray, notes: list[str]) -> FloatArray:
    """Return the distance (trace,), m, between waypoints (waypoint, 2) of scan and distance.

    It goes on at the mean step before the first and behind the last.
    """
    notes.append(
        f"{len(waypoints)} distances of the DZX are used; "
        "the traces between them are put at equal steps"
    )
    trace = np.arange(count)
    first, first_distance = waypoints[0]
    last, last_distance = waypoints[-1]
    outside = np.count_nonzero((trace < first) | (trace > last))
    if outside:
        notes.append(
            f"{outside} traces lie before the first or behind the last of them, "
            "and go on at the mean step"
        )
    step = (last_distance - first_distance) / (last - first)
    distance = np.interp(trace, waypoints[:, 0], waypoints[:, 1])
    before_first = np.minimum(trace - first, 0)
    behind_last = np.maximum(trace - last, 0)
    distance += step * (before_first + behind_last)
    return distance


def _marks(mark_words: NDArray[np.int64], dzx: DzxContent, notes: list[str]) -> tuple[int, ...]:
    """Return the traces with a mark.

    Their second word differs from the usual one, or the DZX marks them.
    """
    values, which = np.unique(mark_words, return_inverse=True)
    usual = values[np.bincount(which).argmax()]
    marked = np.flatnonzero(mark_words != usual)
    if 2 * marked.size >= mark_words.size:
        notes.append(
            f"the mark words of {marked.size} of {mark_words.size} traces differ from the rest: "
            "none is taken for a mark"
        )
        marked = marked[:0]
    if dzx.marks:
        notes.append(f"{len(dzx.marks)} marks are those of the DZX")
    return tuple(sorted({*marked.tolist(), *dzx.marks}))


def _frequencies(raw: bytes, channels: int, notes: list[str]) -> tuple[float | None, ...]:
    """Return the nominal frequency of each channel's antenna, Hz, by its name in the header."""
    names = []
    for channel in range(channels):
        cell = raw[_HEADER * channel + 98 : _HEADER * channel + 112]
        names.append(cell.split(b"\0")[0].decode("latin-1").strip())
    quoted = ", ".join(map(repr, names))
    notes.append(f"antennas {quoted}; the file tells no antenna separation")
    is_mini_xt = raw[113] >> 3 == _MINI_XT  # the lower bits are a version
    frequencies = []
    for channel in range(channels):
        frequencies.append(_frequency_of(channel, names, is_mini_xt, notes))
    return tuple(frequencies)


def _frequency_of(
    channel: int, names: list[str], is_mini_xt: bool, notes: list[str]
) -> float | None:
    """Return the nominal frequency of a channel's antenna, Hz.

    It is known by its name, the set it is of, or the system.
    """
    name = names[channel]
    if antenna_frequency(name, "GSSI", channel) is not None:
        return noted_frequency(name, "GSSI", notes, channel)
    of_set = set_frequency(names[0], channel) if channel else None
    if of_set is not None:
        notes.append(
            f"the antenna of channel {channel} is taken as the second of {names[0]!r}: "
            f"{of_set / 1e6:g} MHz"
        )
        return of_set
    if is_mini_xt:
        notes.append("its system is a StructureScan Mini XT, whose antenna is taken")
        return antenna_frequency("SSMINIXT", "GSSI")
    return noted_frequency(name, "GSSI", notes, channel)
