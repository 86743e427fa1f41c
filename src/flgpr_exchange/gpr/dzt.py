"""GSSI's DZT: the structure tagRFHeader of the SIR manuals.

Every channel has a header of 1024 bytes. Tags other than 0xnnFF stand in files that RADAN edited,
such as the example data of GPRPy.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from flgpr.types import Entries, FloatArray, IntArray, Notes
from flgpr_exchange.gpr.along_line import equal_steps, measured_distance
from flgpr_exchange.gpr.antennas import antenna_frequency, noted_frequency, set_frequency
from flgpr_exchange.gpr.dzx import DzxContent, read_dzx
from flgpr_exchange.gpr.parts import (
    INTERVALS,
    NANOSECOND,
    exact_floats,
    find_companion,
    first_bytes,
    header_words,
    note_count,
    read_records,
)
from flgpr_exchange.gpr.positions import nmea_fixes, note_unread

_HEADER = 1024  # bytes, of each channel
_OLD_HEADER = 512  # bytes, of files older than that structure
_MOST_CHANNELS = 4
_COUNTED = 16  # traces whose numbers tell whether they are of one channel
_MINI_XT = 14  # number of the system StructureScan Mini XT, whose antenna has no name (readgssi)
_TYPES: dict[int, tuple[DTypeLike, float]] = {
    8: ("u1", 128.0),
    16: ("<u2", 32768.0),
    32: ("<i4", 0.0),
}
"""Types of samples by their bits, and the count of no signal."""
_RATES = (1e-3, 1e6)  # scans a second that are plausible
_SPACINGS = (1e-3, 1e5)  # scans per metre that are plausible


_WORDS = {
    "tag": ("u2", 0),
    "start": ("u2", 2),  # of the samples, in headers or bytes
    "samples": ("u2", 4),
    "bits": ("u2", 6),
    "per_second": ("f4", 10),  # scans
    "per_metre": ("f4", 14),  # scans
    "position": ("f4", 22),  # of the first sample, ns
    "range": ("f4", 26),  # ns
    "channels": ("u2", 52),
    "antenna": ("S14", 98),
    "system": ("u1", 113),
}
"""Words of a channel's header that are read: type and offset."""


def read_dzt(path: Path, limit: int, notes: Notes) -> Entries:
    """Read a DZT.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    raw = first_bytes(path, _MOST_CHANNELS * _HEADER, 0, "its header", _HEADER)
    head = header_words(raw[:_HEADER], _WORDS, "<")
    _check_head(head, notes)
    channels = head["channels"] or 1
    samples = head["samples"]
    start = head["start"]

    # By the structure a small number counts headers, and a larger one bytes, which all channels'
    # headers take.
    begin = _HEADER * (start if 0 < start < _HEADER else channels)
    if start == _OLD_HEADER and begin >= path.stat().st_size:
        begin = _OLD_HEADER
        notes.append(f"its header has {_OLD_HEADER} bytes, as old files have")
    sample, offset = _TYPES[head["bits"]]
    if channels > 1 and begin < _HEADER * channels and _counts_on(path, begin, sample, samples):
        notes.append(
            f"the header tells {channels} channels, has no room for their headers, and the traces' "
            "own numbers go on from one to the next: they are read as one channel"
        )
        channels = 1
    # Headers that are not there are zero.
    whole = raw[: max(begin, _HEADER)].ljust(_MOST_CHANNELS * _HEADER, b"\0")
    heads = [
        header_words(whole[_HEADER * channel : _HEADER * (channel + 1)], _WORDS, "<")
        for channel in range(channels)
    ]
    delays = _delays(heads, notes)

    record = np.dtype((sample, (channels, samples)))
    table = read_records(path, begin, record, None, notes, limit)
    trace_words = table[:, 0, :2].astype(np.int64)
    if channels == 1:
        _note_repeated(trace_words[:, 0], notes)
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
    distance = _distance(count, head["per_metre"], dzx, notes)
    per_second = head["per_second"]
    is_rate = _RATES[0] <= per_second <= _RATES[1]
    what = "scans a second in the header are no rate"
    time = None
    if _is_plausible(is_rate, per_second, what, notes) and distance is None:
        notes.append(f"the traces' clock is that of {per_second:g} scans a second, by the header")
        time = np.arange(count) / per_second
    fixes = nmea_fixes(find_companion(path, ".dzg"), count, notes, trace_words[:, 0])
    note_unread(path, (".dza", ".plt", ".tmf"), notes)
    return {
        "traces": traces,
        "delay": delays[0],
        "channel_delay": delays if (delays != delays[0]).any() else None,
        "distance": distance,
        "time": time,
        "fixes": fixes,
        "marks": _marks(trace_words[:, 1], dzx, notes),
        "frequencies": _frequencies(heads, notes),
    }


def _counts_on(path: Path, begin: int, sample: DTypeLike, samples: int) -> bool:
    """Return whether the first traces are numbered one after the other, whatever the channel."""
    record = np.dtype((sample, (samples,)))
    raw = first_bytes(path, _COUNTED * record.itemsize, begin)
    traces = np.frombuffer(raw, record.base)[: len(raw) // record.itemsize * samples]
    return bool((np.diff(traces[::samples].astype(np.int64)) == 1).all()) and traces.size > samples


def _note_repeated(numbers: IntArray, notes: Notes) -> None:
    """Note where every number of a trace stands several times, as those of channels do."""
    times = np.unique(np.unique(numbers, return_counts=True)[1])
    if times.size == 1 and 1 < times[0] <= _MOST_CHANNELS and (np.diff(numbers) >= 0).all():
        notes.append(
            f"every trace number stands {times[0]} times, as those of {times[0]} channels do, and "
            "the header tells 1: they are read as traces of one, and the line may be too long"
        )


def _check_head(head: Entries, notes: Notes) -> None:
    """Refuse a first header of no such file; note what is unusual in one."""
    tag, samples, bits, channels = (head[name] for name in ("tag", "samples", "bits", "channels"))
    if bits not in _TYPES or samples < 4 or channels > _MOST_CHANNELS:
        raise ValueError(
            "it must have 8, 16 or 32 bits, 4 or more samples and 1 to 4 channels, "
            f"got {bits}, {samples}, {channels} (its tag is {tag:#06x})"
        )
    if not channels:
        notes.append("the header tells 0 channels: one is read")
    if tag & 0xFF != 0xFF:
        notes.append(f"its tag is {tag:#06x}, not 0xnnFF: so begin files that RADAN edited")


def _is_plausible(is_within: bool, value: float, what: str, notes: Notes) -> bool:
    """Return whether a value of the header is within its bounds; note one that is not, unless 0."""
    if value != 0 and not is_within:
        notes.append(f"{value:g} {what} and are not used")
    return is_within


def _delays(heads: list[Entries], notes: Notes) -> FloatArray:
    """Return the delays (channel, sample), s, by each channel's own header."""
    first = heads[0]
    samples = first["samples"]
    delays = np.empty((len(heads), samples))
    for channel, head in enumerate(heads):
        position, window = head["position"], head["range"]
        interval = window * NANOSECOND / samples
        if not INTERVALS[0] <= interval <= INTERVALS[1] or not abs(position) <= 100 * window:
            if channel == 0:
                raise ValueError(
                    f"range and position must be times in ns, got {window:g} and {position:g}"
                )
            notes.append(
                f"the header of channel {channel} tells no time window: "
                "it is taken as that of the first"
            )
            delays[channel] = delays[0]
            continue
        if head["samples"] and any(head[name] != first[name] for name in ("samples", "bits")):
            raise ValueError(
                f"channel {channel} must have {samples} samples of {first['bits']} bits as the "
                f"first, got {head['samples']} of {head['bits']}"
            )
        delays[channel] = position * NANOSECOND + np.arange(samples) * interval
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


def _distance(count: int, per_metre: float, dzx: DzxContent, notes: Notes) -> FloatArray | None:
    """Return the distance along the line (trace,), m.

    It is that of the waypoints of the DZX, else by the wheel or by the DZX's spacing.
    """
    _, first_rows = np.unique(dzx.distances[:, 0], return_index=True)
    waypoints = dzx.distances[first_rows]  # one for each scan, ascending
    if len(waypoints) > 1 and np.ptp(waypoints[:, 1]) > 0:
        distance = _between_waypoints(count, waypoints, notes)
        return measured_distance(distance, None, "distances of the DZX", "the DZX", notes)
    is_spacing = _SPACINGS[0] <= abs(per_metre) <= _SPACINGS[1]
    what = "scans per metre in the header"
    if _is_plausible(is_spacing, per_metre, f"{what} are no spacing", notes):
        return equal_steps(count, 1 / per_metre, f"{per_metre:g} {what}", notes)
    if dzx.spacing is not None and 1e-5 <= dzx.spacing <= 1e3:
        return equal_steps(count, dzx.spacing, "unitsPerScan of the DZX", notes)
    return None


def _between_waypoints(count: int, waypoints: FloatArray, notes: Notes) -> FloatArray:
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
    note_count(
        notes,
        (trace < first) | (trace > last),
        "traces lie before the first or behind the last of them, and go on at the mean step",
    )
    step = (last_distance - first_distance) / (last - first)
    distance = np.interp(trace, waypoints[:, 0], waypoints[:, 1])
    distance += step * (np.minimum(trace - first, 0) + np.maximum(trace - last, 0))
    return distance


def _marks(mark_words: IntArray, dzx: DzxContent, notes: Notes) -> tuple[int, ...]:
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
    note_count(notes, len(dzx.marks), "marks are those of the DZX")
    return tuple(sorted({*marked.tolist(), *dzx.marks}))


def _frequencies(heads: list[Entries], notes: Notes) -> tuple[float | None, ...]:
    """Return the nominal frequency of each channel's antenna, Hz, by its name in the header."""
    names = [head["antenna"].split(b"\0")[0].decode("latin-1").strip() for head in heads]
    quoted = ", ".join(map(repr, names))
    notes.append(f"antennas {quoted}; the file tells no antenna separation")
    is_mini_xt = heads[0]["system"] >> 3 == _MINI_XT  # the lower bits are a version
    frequencies: list[float | None] = []
    for channel, name in enumerate(names):
        of_set = set_frequency(names[0], channel) if channel else None
        is_unknown = antenna_frequency(name, "GSSI", channel) is None
        if is_unknown and of_set is not None:
            notes.append(
                f"the antenna of channel {channel} is taken as the second of {names[0]!r}: "
                f"{of_set / 1e6:g} MHz"
            )
            frequencies.append(of_set)
        elif is_unknown and is_mini_xt:
            notes.append("its system is a StructureScan Mini XT, whose antenna is taken")
            frequencies.append(antenna_frequency("SSMINIXT", "GSSI"))
        else:
            frequencies.append(noted_frequency(name, "GSSI", notes, channel))
    return tuple(frequencies)
