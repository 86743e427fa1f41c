"""A draft of the mapping that imports one file of named arrays.

Guesses end in a question mark. Which array is what is found out in ``formats/draft_search.py``.
"""

from __future__ import annotations

import json
import math
import re

from flgpr.formats.array_file import ArrayFile, ArrayInfo
from flgpr.formats.draft_arrays import find_signal, labels_of
from flgpr.formats.draft_search import (
    GEODETIC_COMPONENTS,
    RECORDING,
    ArraySearch,
    SignalAxis,
    find_pose,
    find_positions,
    find_rotation,
    find_signal_axis,
    find_stamp,
    find_track,
)
from flgpr.formats.draft_units import unit_of
from flgpr.model.printable import printable
from flgpr.model.units import UNITS

_ANGLES = ("heading", "pitch", "roll")
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
    search = ArraySearch(opened)
    if opened.kind == RECORDING:
        search.topic = signal.name.rsplit("/", 1)[0]
    search.used.add(signal.name)
    if imaginary:
        search.used.add(imaginary)

    # Every find takes its arrays out of those that the next ones look among: the order counts.
    sizes = list(signal.shape)
    axis = find_signal_axis(search, sizes)
    tones = math.prod(axis.info.shape) if axis.info is not None else 0
    positions = find_positions(search, signal)
    track = find_track(search, positions, sizes)
    components: dict[str, ArrayInfo] = {}
    if track is None:
        components = find_pose(search, positions, sizes, tones)
    positions.pop("way", None)
    stamp = find_stamp(search, sizes, tones)

    labels = labels_of(opened, sizes)
    dims = _dims(sizes, axis, positions, stamp, labels, components)
    lines = _head_lines(opened, signal, imaginary, labels, dims, axis)
    lines += _axis_lines(opened, axis)
    lines += _position_lines(opened, positions, "pair" in dims)
    lines += _stamp_lines(opened, stamp)
    # Positions per scan are in the lane frame, and poses follow from them.
    in_lane = any(len(infos[0].shape) == 3 for infos in positions.values())
    if track is not None:
        lines += _track_lines(search, *track)
    elif not in_lane:
        lines += _pose_lines(search, components)
    return "\n".join(lines).rstrip() + "\n"


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
    axis: SignalAxis,
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


def _pose_lines(search: ArraySearch, components: dict[str, ArrayInfo]) -> list[str]:
    """Return the table of a pose per scan."""
    lines = [
        "[pose]  # the vehicle in the lane frame; heading is clockwise from +y seen from above"
    ]
    position = components.get("position")
    if position is not None:
        unit = unit_of(search.opened, position, "m")
        height = ', z = "0?"' if position.shape[1] == 2 else ""
        lines.append(
            f'position = {{variable = {json.dumps(position.name)}{height}, unit = "{unit}"}}'
        )
        if position.shape[1] == 6:
            return [*lines, 'angle_unit = "rad?"']
    elif set(GEODETIC_COMPONENTS) <= set(components):
        lines.append(_geodetic_line(components))
    else:
        known = [name for name in "xyz" if name in components]
        for name in "xyz":
            lines.append(f"{name} = {_guess(components, name, '0?' if known else '?')}")
        lines.append(f'unit = "{_common_unit(search, components, known, "m")}"')
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
    unit = _common_unit(search, components, angles, "rad")
    return [*lines, f'angle_unit = "{unit}"']


def _geodetic_line(components: dict[str, ArrayInfo]) -> str:
    """Return the entry of positions by longitude and latitude."""
    cells = [f"{name} = {json.dumps(components[name].name)}" for name in GEODETIC_COMPONENTS]
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
    search: ArraySearch, components: dict[str, ArrayInfo], names: list[str], usual: str
) -> str:
    """Return the unit of several components; a question mark where theirs differ."""
    units = {unit_of(search.opened, components[name], usual) for name in names}
    if not units:
        return f"{usual}?"
    return units.pop() if len(units) == 1 else "?"


def _track_lines(search: ArraySearch, clock: ArrayInfo, position: ArrayInfo) -> list[str]:
    """Return the table of a track on a clock of its own."""
    opened = search.opened
    time_unit = unit_of(opened, clock, "s")
    position_unit = unit_of(opened, position, "m")
    lines = [
        "[track]  # positions on a clock of their own",
        f'time = {{variable = {json.dumps(clock.name)}, unit = "{time_unit}"}}',
        f'position = {{variable = {json.dumps(position.name)}, unit = "{position_unit}"}}',
    ]
    rotation = find_rotation(search, position)
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


def _dims(
    sizes: list[int],
    axis: SignalAxis,
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


def _axis_lines(opened: ArrayFile, axis: SignalAxis) -> list[str]:
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
