"""A draft of the mapping that imports one file of named arrays.

Guesses end in a question mark.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flgpr.formats.arrays import SIGMF, ArrayFile, ArrayInfo
from flgpr.formats.draft_arrays import find_signal, labels_of
from flgpr.formats.draft_units import is_fast_time, small_values, unit_of
from flgpr.model.printable import printable
from flgpr.model.units import UNITS

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
_GEODETIC = ("longitude", "latitude")
_ANGLES = ("heading", "pitch", "roll")
_RECORDING = "MCAP recording"
_ANY_AXIS = "scan, polarization, pair, tx, rx or single?"
_NO_TONES = [
    "[frequency]  # no variable looks like the tones; span = [first, last] does as well",
    'variable = "?"',
    'unit = "Hz?"',
    "",
]
_ONE_ANTENNA = [
    "[antenna_position]  # in the vehicle frame",
    'x = "0?"',
    'y = "0?"',
    'z = "0?"',
    'unit = "m"',
    "",
]
_NO_ANTENNAS = [
    "[antenna_position]  # no variable looks like positions",
    "values = []",
    'unit = "m?"',
    "",
]


@dataclass
class _Draft:
    """A file, and which of its arrays have a place in the mapping."""

    opened: ArrayFile
    used: set[str] = field(default_factory=set)
    topic: str = ""  # of a recording's signal, whose arrays are tried first

    def unused(self) -> list[ArrayInfo]:
        """Return the arrays that have no place yet."""
        infos = [info for info in self.opened.arrays.values() if info.name not in self.used]
        if self.opened.kind == SIGMF and "sweeps" in self.opened.arrays:
            # What the captures state is there for the sweeps as well.
            infos = [info for info in infos if not info.name.startswith("captures/")]
        if self.topic:
            infos.sort(key=lambda info: not info.name.startswith(f"{self.topic}/"))
        return infos


class _Axis(NamedTuple):
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


def draft_of_file(opened: ArrayFile) -> str:
    """Draft the mapping of a file.

    Parameters
    ----------
    opened : ArrayFile
        The file.

    Returns
    -------
    str
        The mapping, TOML; empty if no array of the file can be the signal.
    """
    signal, imaginary = find_signal(opened)
    if signal is None:
        return ""
    draft = _Draft(opened)
    if opened.kind == _RECORDING:
        draft.topic = signal.name.rsplit("/", 1)[0]
    draft.used.add(signal.name)
    if imaginary:
        draft.used.add(imaginary)

    # Every find takes its arrays out of those that the next ones look among: the order counts.
    sizes = list(signal.shape)
    axis = _find_signal_axis(draft, sizes)
    tones = math.prod(axis.info.shape) if axis.info is not None else 0
    positions = _find_positions(draft, signal)
    track = _find_track(draft, positions, sizes)
    components: dict[str, ArrayInfo] = {}
    if track is None:
        components = _find_pose(draft, positions, sizes, tones)
    positions.pop("way", None)
    stamp = _find_stamp(draft, sizes, tones)

    labels = labels_of(opened, sizes)
    dims = _dims(sizes, axis, positions, stamp, labels, components)
    lines = _head_lines(opened, signal, imaginary, labels, dims, axis)
    lines += _axis_lines(opened, axis)
    lines += _position_lines(opened, positions, "pair" in dims)
    lines += _stamp_lines(opened, stamp)
    # Positions per scan are in the lane frame, and poses follow from them.
    in_lane = any(len(infos[0].shape) == 3 for infos in positions.values())
    if track is not None:
        lines += _track_lines(draft, *track)
    elif not in_lane:
        lines += _pose_lines(draft, components)
    return "\n".join(lines).rstrip() + "\n"


def _find_stamp(draft: _Draft, sizes: list[int], tones: int) -> ArrayInfo | None:
    """Find the times of the scans, and mark their array as used."""
    scan_sizes = list(sizes)  # lengths that scans may have
    if tones in scan_sizes:
        scan_sizes.remove(tones)
    stamp = _find_axis(draft.opened, draft.unused(), ("time", "stamp", "t_"), scan_sizes)
    if stamp is not None:
        draft.used.add(stamp.name)
    return stamp


def _stamp_lines(opened: ArrayFile, stamp: ArrayInfo | None) -> list[str]:
    """Return the table of the scans' times, if there are any."""
    if stamp is None:
        return []
    unit = unit_of(opened, stamp, "s")
    return ["[time]", f"variable = {json.dumps(stamp.name)}", f'unit = "{unit}"', ""]


def _head_lines(
    opened: ArrayFile,
    signal: ArrayInfo,
    imaginary: str | None,
    labels: list[str],
    dims: list[str],
    axis: _Axis,
) -> list[str]:
    """Return the head of a mapping, and its tables of the files and of the signal."""
    lines = [
        f"# Draft for {printable(opened.path.name)}. "
        "What ends in a question mark is a guess: check it and take the mark away.",
        f"title = {json.dumps(opened.path.stem)}",
        f"polarization = {json.dumps(labels)}",
        "",
        "[files]",
        f"data = {json.dumps(opened.path.name)}",
        "",
        "[signal]",
        f"variable = {json.dumps(signal.name)}",
    ]
    if imaginary:
        lines.append(f"imaginary = {json.dumps(imaginary)}")
    lengths = " x ".join(map(str, signal.shape))
    lines.append(f"dims = {json.dumps(dims)}  # of {lengths}")
    is_complex = imaginary is not None or signal.dtype.startswith("complex")
    if axis.info is None and not is_complex:
        lines += [
            "# interleaved = true  # if real and imaginary parts alternate",
            "# shape = [-1, 1]  # of a flat record",
        ]
    return [*lines, ""]


def _find_signal_axis(draft: _Draft, sizes: list[int]) -> _Axis:
    """Find the tones, else the samples, and mark their array as used."""
    frequency = _find_axis(draft.opened, draft.unused(), ("freq", "hz", "tone"), sizes)
    is_recording = draft.opened.kind == _RECORDING  # whose arrays all are over messages
    if frequency is not None:
        axis = _Axis(frequency=frequency)
    else:
        axis = _Axis() if is_recording else _find_samples(draft, sizes)
    if axis.info is not None:
        draft.used.add(axis.info.name)
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


def _find_samples(draft: _Draft, sizes: list[int]) -> _Axis:
    """Find the two-way delays or ranges of the samples.

    A "time" may be the radar's fast time or the scans' clock: values below a tenth of a millisecond
    are the former. The last axis of the signal is tried first.
    """
    unused = draft.unused()
    for tried in (sizes[-1:], sizes):
        vocabulary = ("range", "delay", "t_ns", "twt", "fast")
        samples = _find_axis(draft.opened, unused, vocabulary, tried)
        if samples is not None:
            return _Axis(samples=samples)
    times = []
    for info in unused:
        name = info.name.lower()
        if "time" in name and not _CLOCK.search(name):
            times.append(info)
    fast = [info for info in times if is_fast_time(draft.opened, info)]
    for candidates, certain in ((fast, True), (times, False)):
        for tried in (sizes[-1:], sizes):
            samples = _find_axis(draft.opened, candidates, ("time",), tried)
            if samples is not None:
                return _Axis(samples=samples, certain=certain)
    return _Axis()


def _find_positions(draft: _Draft, signal: ArrayInfo) -> dict[str, list[ArrayInfo]]:
    """Find the arrays of positions (..., 3), by what they may be.

    They are those of "tx", "rx" or any "antenna"; those of x, y and z apart are "xyz", and those of
    a vehicle in a recording "way".
    """
    sides: dict[str, list[ArrayInfo]] = {}
    for info in draft.unused():
        if len(info.shape) < 2 or info.shape[-1] != 3 or 0 in info.shape:
            continue
        name = info.name.lower()
        if name == "table" and len(draft.opened.arrays) > 1:
            continue  # all columns of a text, which have names of their own
        if draft.topic:
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
    is_structured = re.search(r"[./]", signal.name) and not draft.topic
    if not sides and is_structured:
        by_axis = [draft.opened.arrays.get(_sibling(signal.name, axis)) for axis in "xyz"]
        known = [info for info in by_axis if info is not None]
        if len(known) == len(by_axis):
            sides["xyz"] = known
    return sides


def _find_track(
    draft: _Draft, positions: dict[str, list[ArrayInfo]], sizes: list[int]
) -> tuple[ArrayInfo, ArrayInfo] | None:
    """Return clock and positions that fit no axis of the signal but one another.

    The positions are taken out of the antennas'.
    """
    for side, infos in list(positions.items()):
        info = infos[0]
        if side == "xyz" or len(info.shape) != 2 or info.shape[0] in sizes:
            continue
        topic = info.name.rsplit("/", 1)[0] if draft.topic else ""
        candidates = _Draft(draft.opened, draft.used, topic).unused()
        vocabulary = ("time", "t_", "stamp")
        clock = _find_axis(draft.opened, candidates, vocabulary, [info.shape[0]])
        if clock is not None:
            draft.used.add(clock.name)
            del positions[side]
            return clock, info
    return None


def _find_pose(
    draft: _Draft, positions: dict[str, list[ArrayInfo]], sizes: list[int], tones: int
) -> dict[str, ArrayInfo]:
    """Find the arrays of a pose per scan, and mark them as used.

    They are ``position`` (scan, 2, 3 or 6), which is taken out of the antennas' positions, or
    single components by their names.
    """
    scans = [size for size in sizes if size > 1]
    if tones in scans:
        scans.remove(tones)
    components: dict[str, ArrayInfo] = {}
    position = _find_position(draft, scans)
    if position is not None:
        components["position"] = position
        for side, infos in list(positions.items()):
            positions[side] = [info for info in infos if info is not position]
            if not positions[side]:
                del positions[side]

    vectors = []
    for info in draft.unused():
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
    if in_lane or not set(_GEODETIC) <= set(components):
        _leave_out(components, _GEODETIC)
    draft.used |= {info.name for info in components.values()}
    return components


def _leave_out(components: dict[str, ArrayInfo], names: Iterable[str]) -> None:
    """Take components out that others stand for."""
    for name in names:
        components.pop(name, None)


def _find_position(draft: _Draft, scans: list[int]) -> ArrayInfo | None:
    """Return the first array of a position per scan."""
    for info in draft.unused():
        if len(info.shape) != 2:
            continue
        rows, columns = info.shape
        if rows not in scans or columns not in (2, 3, 6):
            continue
        name = info.name.lower()
        if _POSITION.search(name) and not _ANTENNA.search(name):
            return info
    return None


def _pose_lines(draft: _Draft, components: dict[str, ArrayInfo]) -> list[str]:
    """Return the table of a pose per scan."""
    lines = [
        "[pose]  # the vehicle in the lane frame; heading is clockwise from +y seen from above"
    ]
    position = components.get("position")
    if position is not None:
        unit = unit_of(draft.opened, position, "m")
        height = ', z = "0?"' if position.shape[1] == 2 else ""
        lines.append(
            f'position = {{variable = {json.dumps(position.name)}{height}, unit = "{unit}"}}'
        )
        if position.shape[1] == 6:
            return [*lines, 'angle_unit = "rad?"']
    elif set(_GEODETIC) <= set(components):
        lines.append(_geodetic_line(components))
    else:
        known = [name for name in "xyz" if name in components]
        for name in "xyz":
            lines.append(f"{name} = {_guess(components, name, '0?' if known else '?')}")
        lines.append(f'unit = "{_common_unit(draft, components, known, "m")}"')
    # Without a heading the course over ground stands for it, if there are positions.
    has_positions = position is not None or "y" in components or "longitude" in components
    heading = "?"
    if has_positions:
        heading = "course?"
    elif components:
        heading = "0?"
    for name in _ANGLES:
        without = heading if name == "heading" else "0?"
        lines.append(f"{name} = {_guess(components, name, without)}")
    angles = [name for name in _ANGLES if name in components]
    unit = _common_unit(draft, components, angles, "rad")
    return [*lines, f'angle_unit = "{unit}"']


def _geodetic_line(components: dict[str, ArrayInfo]) -> str:
    """Return the entry of positions by longitude and latitude."""
    cells = [f"{name} = {json.dumps(components[name].name)}" for name in _GEODETIC]
    height = json.dumps(components["z"].name) if "z" in components else '"0?"'
    cells += [f"height = {height}", 'angle_unit = "deg?"', 'unit = "m?"']
    return f"geodetic = {{{', '.join(cells)}}}  # needs --anchor, or --anchor-from-track"


def _guess(components: dict[str, ArrayInfo], name: str, without: str) -> str:
    """Return the variable of a component, with a question mark unless it is called just that."""
    if name not in components:
        return json.dumps(without)
    variable = components[name].name
    last_word = re.split(r"[/.]", variable.lower())[-1]
    is_called_so = last_word.split("_")[0] == name
    return json.dumps(variable if is_called_so else f"{variable}?")


def _common_unit(
    draft: _Draft, components: dict[str, ArrayInfo], names: list[str], usual: str
) -> str:
    """Return the unit of several components; a question mark where theirs differ."""
    units = {unit_of(draft.opened, components[name], usual) for name in names}
    if not units:
        return f"{usual}?"
    return units.pop() if len(units) == 1 else "?"


def _track_lines(draft: _Draft, clock: ArrayInfo, position: ArrayInfo) -> list[str]:
    """Return the table of a track on a clock of its own."""
    opened = draft.opened
    time_unit = unit_of(opened, clock, "s")
    position_unit = unit_of(opened, position, "m")
    lines = [
        "[track]  # positions on a clock of their own",
        f'time = {{variable = {json.dumps(clock.name)}, unit = "{time_unit}"}}',
        f'position = {{variable = {json.dumps(position.name)}, unit = "{position_unit}"}}',
    ]
    rotation = _find_rotation(draft, position)
    if rotation is not None:
        body = '["-y?", "x?", "z?"]'
        lines.append(
            f"orientation = {{variable = {json.dumps(rotation.name)}, body = {body}}}  "
            "# of x forward, y left, z up"
        )
    else:
        lines += ['heading = "course?"', 'pitch = "0?"', 'roll = "0?"', 'angle_unit = "deg?"']
    return [
        *lines,
        "clock_offset = 0.0  # the track's clock less the radar's, s; flgpr.calibrate finds it",
    ]


def _find_rotation(draft: _Draft, position: ArrayInfo) -> ArrayInfo | None:
    """Return the quaternions that belong to the positions of a track."""
    topic = position.name.rsplit("/", 1)[0]
    for info in draft.unused():
        if info.shape != (position.shape[0], 4) or not _ROTATION.search(info.name.lower()):
            continue
        if not draft.topic or info.name.startswith(f"{topic}/"):
            return info
    return None


def _sibling(name: str, other: str) -> str:
    """Return the name of another member of the structure or group that an array is in."""
    for mark in (".", "/"):
        if mark in name:
            return name.rsplit(mark, 1)[0] + mark + other
    return other


def _dims(
    sizes: list[int],
    axis: _Axis,
    positions: dict[str, list[ArrayInfo]],
    stamp: ArrayInfo | None,
    labels: list[str],
    components: dict[str, ArrayInfo],
) -> list[str]:
    """Return the names of the signal's axes.

    Those whose length does not make it certain get a question mark.
    """
    names = ["?"] * len(sizes)
    if axis.info is not None:
        _name_axis(names, sizes, math.prod(axis.info.shape), axis.name)
    if stamp is not None:
        _name_axis(names, sizes, math.prod(stamp.shape), "scan")
    if labels[0] != "HH?":
        _name_axis(names, sizes, len(labels), "polarization")
    _name_antenna_axes(names, sizes, positions)
    if components and not _has_scans(names):
        first = next(iter(components.values()))
        _name_axis(names, sizes, max(first.shape), "scan")
    if names.count("?") == 1 and not _has_scans(names):
        names[names.index("?")] = "scan?"
    return [_ANY_AXIS if name == "?" else name for name in names]


def _has_scans(names: list[str]) -> bool:
    """Return whether one of the axes is, or may be, that of the scans."""
    return "scan" in names or "scan?" in names


def _name_antenna_axes(
    names: list[str], sizes: list[int], positions: dict[str, list[ArrayInfo]]
) -> None:
    """Name the axes of transmitters and receivers, or of pairs, by the lengths of positions."""
    are_apart = False  # whether transmitters and receivers differ in their number
    if {"tx", "rx"} <= set(positions):
        are_apart = positions["tx"][0].shape != positions["rx"][0].shape
    for side, infos in positions.items():
        shape = infos[0].shape
        rows = math.prod(shape) if side == "xyz" else shape[-2]
        if len(shape) == 3:
            _name_axis(names, sizes, shape[0], "scan")
        name = side if are_apart and side != "antenna" else "pair"
        _name_axis(names, sizes, rows, name)


def _name_axis(names: list[str], sizes: list[int], count: int, name: str) -> None:
    """Name the last axis of that length that has no name.

    Others of the same length leave a doubt.
    """
    free = [k for k, size in enumerate(sizes) if size == count and names[k] == "?"]
    if free and not {name, f"{name}?"} & set(names):
        certain = sizes.count(count) == 1 or name.endswith("?")
        names[free[-1]] = name if certain else f"{name}?"


def _axis_lines(opened: ArrayFile, axis: _Axis) -> list[str]:
    """Return the table of the tones or of the samples."""
    if axis.frequency is not None:
        unit = unit_of(opened, axis.frequency, "Hz")
        variable = json.dumps(axis.frequency.name)
        return ["[frequency]", f"variable = {variable}", f'unit = "{unit}"', ""]
    if axis.samples is None:
        return _NO_TONES
    name = axis.samples.name
    unit = unit_of(opened, axis.samples, "m" if "range" in name.lower() else "ns")
    meaning = "range?" if unit.rstrip("?") in UNITS["length"] else "delay?"
    return [
        "[samples]",
        f"variable = {json.dumps(name if axis.certain else f'{name}?')}",
        f'unit = "{unit}"',
        f'meaning = "{meaning}"  # delay, range (one way) or path (there and back)',
        "band = []  # first and last frequency to keep",
        'band_unit = "GHz"',
        "",
    ]


def _position_lines(
    opened: ArrayFile, positions: dict[str, list[ArrayInfo]], pairs: bool
) -> list[str]:
    """Return the tables of the antennas' positions; ``pairs``: whether the signal has an axis."""
    if "xyz" in positions:
        names = []
        for axis, info in zip("xyz", positions["xyz"], strict=True):
            names.append(f"{axis} = {json.dumps(info.name)}")
        return ["[antenna_position]", *names, 'unit = "m?"', ""]
    if not positions:
        return _NO_ANTENNAS if pairs else _ONE_ANTENNA
    sides = list(positions)[:1]
    if {"tx", "rx"} <= set(positions):
        sides = ["tx", "rx"]
    lines = []
    for side in sides:
        info = positions[side][0]
        lines += [
            f"[{side}_position]",
            f"variable = {json.dumps(info.name)}",
            f'unit = "{unit_of(opened, info, "m")}"',
        ]
        if len(info.shape) == 3:
            lines.append('frame = "lane?"')
        lines.append("")
    return lines
