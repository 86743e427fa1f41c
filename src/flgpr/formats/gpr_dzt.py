"""GSSI's DZT: the structure tagRFHeader of the SIR manuals, a header of 1024 bytes for every channel.

Tags other than 0xnnFF stand in files that RADAN edited, such as the example data of GPRPy.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from flgpr.formats.gpr_antennas import antenna_frequency, noted_frequency, set_frequency
from flgpr.formats.gpr_parts import (
    INTERVALS,
    NANOSECOND,
    FloatArray,
    equal_steps,
    exact_floats,
    find_beside,
    first_bytes,
    measured_places,
    read_records,
)
from flgpr.formats.gpr_positions import DzxContent, nmea_fixes, note_unread, read_dzx

_HEADER = 1024  # bytes, of each channel
_OLD_HEADER = 512  # bytes, of files older than that structure
_MINI_XT = 14  # number of the system StructureScan Mini XT, whose antenna has no name (readgssi)


def read_dzt(path: Path, limit: int) -> dict[str, Any]:
    """Read a DZT: the entries of a :class:`flgpr.formats.gpr_files.GprSection`; what contradicts is a ValueError."""
    raw = first_bytes(path, 4 * _HEADER)
    if len(raw) < _HEADER:
        raise ValueError(f"its header must have {_HEADER} bytes, the file has {len(raw)}")
    tag, start, samples, bits = struct.unpack_from("<4H", raw, 0)
    per_second, per_metre = struct.unpack_from("<2f", raw, 10)
    told = struct.unpack_from("<H", raw, 52)[0]
    channels = told or 1
    types: dict[int, tuple[DTypeLike, float]] = {
        8: ("u1", 128.0),
        16: ("<u2", 32768.0),
        32: ("<i4", 0.0),
    }
    if bits not in types or samples < 4 or not 1 <= channels <= 4:
        raise ValueError(
            f"it must have 8, 16 or 32 bits, 4 or more samples and 1 to 4 channels, got {bits}, {samples}, {channels} "
            f"(its tag is {tag:#06x})"
        )
    notes: list[str] = []
    if not told:
        notes.append("the header tells 0 channels: one is read")
    if tag & 0xFF != 0xFF:
        notes.append(f"its tag is {tag:#06x}, not 0xnnFF: so begin files that RADAN edited")
    begin = _HEADER * (start if 0 < start < _HEADER else channels)
    if start == _OLD_HEADER and begin >= path.stat().st_size:
        begin = _OLD_HEADER
        notes.append(f"its header has {_OLD_HEADER} bytes, as old files have")
    delays = _delays(raw, begin, channels, samples, notes)
    sample, offset = types[bits]
    table = read_records(path, begin, np.dtype((sample, (channels, samples))), None, notes, limit)
    words = table[:, 0, :2].astype(np.int64)
    traces = exact_floats(table, notes)
    traces -= offset
    traces[..., :2] = traces[..., 2:3]
    notes.append(
        "the first two samples of every trace are its number and marks: the third stands in their place"
    )
    count = len(traces)
    beside = read_dzx(find_beside(path, ".dzx"), count, notes)
    distance = _distance(count, per_metre, beside, notes)
    steady = bool(np.isfinite(per_second) and 1e-3 <= per_second <= 1e6)
    if per_second != 0 and not steady:
        notes.append(f"{per_second:g} scans a second in the header are no rate and are not used")
    timed = distance is None and steady
    if timed:
        notes.append(f"the traces' clock is that of {per_second:g} scans a second, by the header")
    fixes = nmea_fixes(find_beside(path, ".dzg"), count, notes, words[:, 0])
    note_unread(path, (".dza", ".plt", ".tmf"), notes)
    return {
        "traces": traces,
        "delay": delays[0],
        "channel_delay": delays if (delays != delays[0]).any() else None,
        "distance": distance,
        "time": np.arange(count) / per_second if timed else None,
        "fixes": fixes.table,
        "fix_time": fixes.time,
        "marks": _marks(words[:, 1], beside, notes),
        "frequencies": _frequencies(raw[: max(begin, _HEADER)], channels, notes),
        "history": tuple(notes),
    }


def _delays(raw: bytes, begin: int, channels: int, samples: int, notes: list[str]) -> FloatArray:
    """Return the delays (channel, sample), s, by each channel's own header; samples begin at the byte ``begin``."""
    delays = np.empty((channels, samples))
    for channel in range(channels):
        base = _HEADER * channel
        own = None
        if not channel or base + _HEADER <= min(begin, len(raw)):
            own = _delay_of(raw, base, channel, samples)
        if own is None and channel == 0:
            position, window = struct.unpack_from("<2f", raw, 22)
            raise ValueError(
                f"range and position must be times in ns, got {window:g} and {position:g}"
            )
        if own is None:
            notes.append(
                f"the header of channel {channel} tells no time window: it is taken as that of the first"
            )
        delays[channel] = delays[0] if own is None else own
    if (delays[:, 0] == 0).any():
        notes.append("the header puts time zero at the first sample")
    for channel, delay in enumerate(delays):
        if (delay != delays[0]).any():
            window = (delay[1] - delay[0]) * samples / NANOSECOND
            notes.append(
                f"channel {channel} has a header of its own: time window {window:.6g} ns, time zero "
                f"{-delay[0] / NANOSECOND:.6g} ns after its start"
            )
    return delays


def _delay_of(raw: bytes, base: int, channel: int, samples: int) -> FloatArray | None:
    """Return the delays (sample,), s, that a channel's header at a byte tells; None if it tells no time window."""
    own_samples, own_bits = struct.unpack_from("<2H", raw, base + 4)
    first_bits = struct.unpack_from("<H", raw, 6)[0]
    position, window = struct.unpack_from("<2f", raw, base + 22)
    if not (
        INTERVALS[0] <= window * NANOSECOND / samples <= INTERVALS[1]
        and abs(position) <= 100 * window
    ):
        return None
    if own_samples and (own_samples, own_bits) != (samples, first_bits):
        raise ValueError(
            f"channel {channel} must have {samples} samples of {first_bits} bits as the first, got {own_samples} of "
            f"{own_bits}"
        )
    return np.asarray(
        position * NANOSECOND + np.arange(samples) * (window * NANOSECOND / samples),
        dtype=np.float64,
    )


def _distance(
    count: int, per_metre: float, beside: DzxContent, notes: list[str]
) -> FloatArray | None:  # fmt: skip
    """Return the distance along the line (trace,), m: of the waypoints of the DZX, else by the wheel or its spacing."""
    scans = np.unique(beside.distances[:, 0], return_index=True)[1]
    if scans.size > 1 and np.ptp(beside.distances[scans, 1]) > 0:
        known = beside.distances[scans]
        notes.append(
            f"{scans.size} distances of the DZX are used; the traces between them are put at equal steps"
        )
        outside = np.count_nonzero(
            (np.arange(count) < known[0, 0]) | (np.arange(count) > known[-1, 0])
        )
        if outside:
            notes.append(
                f"{outside} traces lie before the first or behind the last of them, and go on at the mean step"
            )
        step = (known[-1, 1] - known[0, 1]) / (known[-1, 0] - known[0, 0])
        trace = np.arange(count)
        place = np.interp(trace, known[:, 0], known[:, 1])
        place += step * (np.minimum(trace - known[0, 0], 0) + np.maximum(trace - known[-1, 0], 0))
        return measured_places(place, None, "distances of the DZX", "the DZX", notes)
    plausible = np.isfinite(per_metre) and 1e-3 <= abs(per_metre) <= 1e5
    if per_metre != 0 and not plausible:
        notes.append(f"{per_metre:g} scans per metre in the header are no spacing and are not used")
    if plausible:
        return equal_steps(
            count, 1 / per_metre, f"{per_metre:g} scans per metre in the header", notes
        )
    if beside.spacing is not None and 1e-5 <= beside.spacing <= 1e3:
        return equal_steps(count, beside.spacing, "unitsPerScan of the DZX", notes)
    return None


def _marks(words: NDArray[np.int64], beside: DzxContent, notes: list[str]) -> tuple[int, ...]:
    """Return the traces with a mark: where the second word differs from the usual one, and those of the DZX."""
    values, which = np.unique(words, return_inverse=True)
    marked = np.flatnonzero(words != values[np.bincount(which).argmax()])
    if 2 * marked.size >= words.size:
        notes.append(
            f"the mark words of {marked.size} of {words.size} traces differ from the rest: none is taken for a mark"
        )
        marked = marked[:0]
    if beside.marks:
        notes.append(f"{len(beside.marks)} marks are those of the DZX")
    return tuple(sorted({*marked.tolist(), *beside.marks}))


def _frequencies(raw: bytes, channels: int, notes: list[str]) -> tuple[float | None, ...]:
    """Return the nominal frequency of each channel's antenna, Hz, by its name in the channel's own header."""
    names = []
    for channel in range(channels):
        cell = raw[_HEADER * channel + 98 : _HEADER * channel + 112]
        names.append(cell.split(b"\0")[0].decode("latin-1").strip())
    notes.append(f"antennas {', '.join(map(repr, names))}; the file tells no antenna separation")
    is_mini_xt = raw[113] >> 3 == _MINI_XT
    return tuple(_frequency_of(channel, names, is_mini_xt, notes) for channel in range(channels))


def _frequency_of(
    channel: int, names: list[str], is_mini_xt: bool, notes: list[str]
) -> float | None:
    """Return the nominal frequency of a channel's antenna, Hz: by its name, the set it is of, or the system."""
    name = names[channel]
    if antenna_frequency(name, "GSSI", channel) is None:
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
