"""Which array of a file has which place in the mapping that imports it.

Arrays are told by their names, shapes and values. Every find takes its arrays out of those that the
next ones look among.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flgpr.formats.array_file import ArrayFile, ArrayInfo
from flgpr.formats.draft_units import is_fast_time, small_values

_CLOCK = re.compile(r"gps|gnss|utc|epoch|stamp|scan|trace|pps|pose|slow")
"""What a time is called that is no delay of samples."""
_ANTENNA = re.compile(r"tx|rx|ant|elem|rec|source")
_POSITION = re.compile(r"pos|xyz|way|track|gps|gnss|rtk|coord|traj|odom|loc|place|transl|reference")
_ROTATION = re.compile(r"orientation|rotation|quat")
_COMPONENTS = {
    "x": {"x", "cross", "across", "east", "easting", "crosstrack"},
    "y": {
        "y",
        "along",
        "da",
        "dist",
        "distance",
        "north",
        "northing",
        "downtrack",
        "chainage",
        "odometer",
    },
    "z": {"z", "height", "alt", "altitude", "elevation", "up"},
    "heading": {"heading", "yaw", "hdg", "psi"},
    "pitch": {"pitch"},
    "roll": {"roll"},
    "longitude": {"longitude", "lon", "long", "lng"},
    "latitude": {"latitude", "lat"},
}
"""Words in the names of the components of a pose."""
GEODETIC_COMPONENTS = ("longitude", "latitude")
RECORDING = "MCAP recording"


@dataclass
class ArraySearch:
    """A file, and which of its arrays have a place in the mapping."""

    opened: ArrayFile
    used: set[str] = field(default_factory=set)
    topic: str = ""  # of a recording's signal, whose arrays are tried first

    def unused(self) -> list[ArrayInfo]:
        """Return the arrays that have no place yet."""
        infos = [info for info in self.opened.arrays.values() if info.name not in self.used]
        if self.opened.repeated:
            infos = [info for info in infos if not info.name.startswith(self.opened.repeated)]
        if self.topic:
            infos.sort(key=lambda info: not info.name.startswith(f"{self.topic}/"))
        return infos


class SignalAxis(NamedTuple):
    """The array of the tones or of the samples, if there is one."""

    frequency: ArrayInfo | None = None
    samples: ArrayInfo | None = None
    certain: bool = True  # whether the samples can be nothing else

    @property
    def info(self) -> ArrayInfo | None:
        """The array."""
        return self.frequency or self.samples

    @property
    def name(self) -> str:
        """What the signal's axis is called."""
        if self.frequency is not None:
            return "frequency"
        return "sample" if self.certain else "sample?"


def find_stamp(search: ArraySearch, sizes: list[int], tones: int) -> ArrayInfo | None:
    """Find the times of the scans, and mark their array as used.

    Parameters
    ----------
    search : ArraySearch
        The file, and what has been found in it.
    sizes : list of int
        Lengths of the signal's axes.
    tones : int
        Number of tones or samples; 0 where none were found.

    Returns
    -------
    ArrayInfo or None
        The array.
    """
    scan_sizes = list(sizes)  # lengths that scans may have
    if tones in scan_sizes:
        scan_sizes.remove(tones)
    stamp = _find_axis(search.opened, search.unused(), ("time", "stamp", "t_"), scan_sizes)
    if stamp is not None:
        search.used.add(stamp.name)
    return stamp


def find_signal_axis(search: ArraySearch, sizes: list[int]) -> SignalAxis:
    """Find the tones, else the samples, and mark their array as used.

    Parameters
    ----------
    search : ArraySearch
        The file, and what has been found in it.
    sizes : list of int
        Lengths of the signal's axes.

    Returns
    -------
    SignalAxis
        The array, if there is one.
    """
    frequency = _find_axis(search.opened, search.unused(), ("freq", "hz", "tone"), sizes)
    is_recording = search.opened.kind == RECORDING  # whose arrays all are over messages
    if frequency is not None:
        axis = SignalAxis(frequency=frequency)
    else:
        axis = SignalAxis() if is_recording else _find_samples(search, sizes)
    if axis.info is not None:
        search.used.add(axis.info.name)
    return axis


def _find_axis(
    opened: ArrayFile,
    candidates: Iterable[ArrayInfo],
    vocabulary: tuple[str, ...],
    sizes: list[int],
) -> ArrayInfo | None:
    """Return the first array of increasing values whose length is among ``sizes``.

    One of the ``vocabulary`` must be in its name.
    """
    for info in candidates:
        count = math.prod(info.shape)
        is_vector = max(info.shape, default=0) == count > 1
        if not is_vector or count not in sizes or not _is_called(info, vocabulary):
            continue
        values = small_values(opened, info)
        if values is None or values.dtype.kind not in "fiu":
            continue
        if (np.diff(values.ravel().astype(float)) > 0).all():
            return info
    return None


def _is_called(info: ArrayInfo, vocabulary: tuple[str, ...]) -> bool:
    """Return whether the name of an array holds one of the words, or is their letter."""
    name = info.name.lower().replace("/", ".").split(".")[-1]
    if "freq" in vocabulary and name == "f":
        return True
    if "time" in vocabulary and name == "t":
        return True
    return any(word in name for word in vocabulary)


def _find_samples(search: ArraySearch, sizes: list[int]) -> SignalAxis:
    """Find the two-way delays or ranges of the samples.

    A "time" may be the radar's fast time or the scans' clock: values below a tenth of a millisecond
    are the former. The last axis of the signal is tried first.
    """
    unused = search.unused()
    for tried in (sizes[-1:], sizes):
        vocabulary = ("range", "delay", "t_ns", "twt", "fast")
        samples = _find_axis(search.opened, unused, vocabulary, tried)
        if samples is not None:
            return SignalAxis(samples=samples)
    times = []
    for info in unused:
        name = info.name.lower()
        if "time" in name and not _CLOCK.search(name):
            times.append(info)
    fast = [info for info in times if is_fast_time(search.opened, info)]
    for candidates, certain in ((fast, True), (times, False)):
        for tried in (sizes[-1:], sizes):
            samples = _find_axis(search.opened, candidates, ("time",), tried)
            if samples is not None:
                return SignalAxis(samples=samples, certain=certain)
    return SignalAxis()


def find_positions(search: ArraySearch, signal: ArrayInfo) -> dict[str, list[ArrayInfo]]:
    """Find the arrays of positions (..., 3), by what they may be.

    They are those of "tx", "rx" or any "antenna"; those of x, y and z apart are "xyz", and those of
    a vehicle in a recording "way".

    Parameters
    ----------
    search : ArraySearch
        The file, and what has been found in it.
    signal : ArrayInfo
        The signal.

    Returns
    -------
    dict of str to list of ArrayInfo
        The arrays by what they may be.
    """
    sides: dict[str, list[ArrayInfo]] = {}
    for info in search.unused():
        if len(info.shape) < 2 or info.shape[-1] != 3 or 0 in info.shape:
            continue
        name = info.name.lower()
        if name == "table" and len(search.opened.arrays) > 1:
            continue  # all columns of a text, which have names of their own
        if search.topic:
            if _POSITION.search(name.rsplit("/", 1)[-1]):
                sides.setdefault("way", []).append(info)
            continue
        if re.search(r"tx|trans|source", name):
            side = "tx"
        elif re.search(r"rx|rec", name):
            side = "rx"
        else:
            side = "antenna"
        sides.setdefault(side, []).append(info)
    # The x, y and z of flat files are rather the vehicle's.
    is_structured = re.search(r"[./]", signal.name) and not search.topic
    if not sides and is_structured:
        by_axis = [search.opened.arrays.get(_sibling(signal.name, axis)) for axis in "xyz"]
        known = [info for info in by_axis if info is not None]
        if len(known) == len(by_axis):
            sides["xyz"] = known
    return sides


def find_track(
    search: ArraySearch, positions: dict[str, list[ArrayInfo]], sizes: list[int]
) -> tuple[ArrayInfo, ArrayInfo] | None:
    """Return clock and positions that fit no axis of the signal but one another.

    The positions are taken out of the antennas'.

    Parameters
    ----------
    search : ArraySearch
        The file, and what has been found in it.
    positions : dict of str to list of ArrayInfo
        What :func:`find_positions` found; what is taken out is deleted.
    sizes : list of int
        Lengths of the signal's axes.

    Returns
    -------
    clock, position : ArrayInfo
        The arrays; None where there are none.
    """
    for side, infos in list(positions.items()):
        info = infos[0]
        if side == "xyz" or len(info.shape) != 2 or info.shape[0] in sizes:
            continue
        topic = info.name.rsplit("/", 1)[0] if search.topic else ""
        candidates = ArraySearch(search.opened, search.used, topic).unused()
        vocabulary = ("time", "t_", "stamp")
        clock = _find_axis(search.opened, candidates, vocabulary, [info.shape[0]])
        if clock is not None:
            search.used.add(clock.name)
            del positions[side]
            return clock, info
    return None


def find_pose(
    search: ArraySearch, positions: dict[str, list[ArrayInfo]], sizes: list[int], tones: int
) -> dict[str, ArrayInfo]:
    """Find the arrays of a pose per scan, and mark them as used.

    They are ``position`` (scan, 2, 3 or 6), which is taken out of the antennas' positions, or
    single components by their names.

    Parameters
    ----------
    search : ArraySearch
        The file, and what has been found in it.
    positions : dict of str to list of ArrayInfo
        What :func:`find_positions` found; what is taken out is deleted.
    sizes : list of int
        Lengths of the signal's axes.
    tones : int
        Number of tones or samples; 0 where none were found.

    Returns
    -------
    dict of str to ArrayInfo
        The arrays by component.
    """
    scans = [size for size in sizes if size > 1]
    if tones in scans:
        scans.remove(tones)
    components: dict[str, ArrayInfo] = {}
    position = _find_position(search, scans)
    if position is not None:
        components["position"] = position
        for side, infos in list(positions.items()):
            positions[side] = [info for info in infos if info is not position]
            if not positions[side]:
                del positions[side]

    vectors = []
    for info in search.unused():
        count = math.prod(info.shape)
        is_vector = bool(info.shape) and max(info.shape) == count
        if is_vector and count in scans and not _ANTENNA.search(info.name.lower()):
            vectors.append(info)
    for name, vocabulary in _COMPONENTS.items():
        for info in vectors:
            if set(re.split(r"[_\W]+", info.name.lower())) & vocabulary:
                components.setdefault(name, info)

    if position is not None or "xyz" in positions:
        _leave_out(components, "xyz")
    in_lane = position is not None or {"x", "y"} <= set(components)
    if in_lane or not set(GEODETIC_COMPONENTS) <= set(components):
        _leave_out(components, GEODETIC_COMPONENTS)
    search.used |= {info.name for info in components.values()}
    return components


def _leave_out(components: dict[str, ArrayInfo], names: Iterable[str]) -> None:
    """Take components out that others stand for."""
    for name in names:
        components.pop(name, None)


def _find_position(search: ArraySearch, scans: list[int]) -> ArrayInfo | None:
    """Return the first array of a position per scan."""
    for info in search.unused():
        if len(info.shape) != 2:
            continue
        rows, columns = info.shape
        if rows not in scans or columns not in (2, 3, 6):
            continue
        name = info.name.lower()
        if _POSITION.search(name) and not _ANTENNA.search(name):
            return info
    return None


def find_rotation(search: ArraySearch, position: ArrayInfo) -> ArrayInfo | None:
    """Return the quaternions that belong to the positions of a track.

    Parameters
    ----------
    search : ArraySearch
        The file, and what has been found in it.
    position : ArrayInfo
        The positions.

    Returns
    -------
    ArrayInfo or None
        The array (sample, 4).
    """
    topic = position.name.rsplit("/", 1)[0]
    for info in search.unused():
        if info.shape != (position.shape[0], 4) or not _ROTATION.search(info.name.lower()):
            continue
        if not search.topic or info.name.startswith(f"{topic}/"):
            return info
    return None


def _sibling(name: str, other: str) -> str:
    """Return the name of another member of the structure or group that an array is in."""
    for mark in (".", "/"):
        if mark in name:
            return name.rsplit(mark, 1)[0] + mark + other
    return other
