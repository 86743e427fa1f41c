"""A draft of the mapping that imports one file of named arrays. Guesses end in a question mark."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass, field

import numpy as np

from flgpr.formats.arrays import ArrayFile, ArrayInfo
from flgpr.formats.draft_units import SHORTEST_SCANS, small_values, unit_of, unit_suffix
from flgpr.model import POLARIZATIONS
from flgpr.model.units import UNITS

_CLOCK = re.compile(r"gps|gnss|utc|epoch|stamp|scan|trace|pps|pose|slow")
"""What a time is called that is no delay of samples."""
_ANTENNA = re.compile(r"tx|rx|ant|elem|rec|source")
_PLACE = re.compile(r"pos|xyz|way|track|gps|gnss|rtk|coord|traj|odom|loc|place|transl|reference")
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
_GEODETIC = ("longitude", "latitude")


@dataclass
class _Draft:
    opened: ArrayFile
    used: set[str] = field(default_factory=set)
    topic: str = ""  #: of a recording's signal, whose arrays are looked at first

    def rest(self) -> list[ArrayInfo]:
        left = [info for info in self.opened.arrays.values() if info.name not in self.used]
        return (
            sorted(left, key=lambda info: not info.name.startswith(f"{self.topic}/"))
            if self.topic
            else left
        )


def draft_of_file(opened: ArrayFile) -> str:
    """Return the mapping (TOML) of a file; empty if no array of it can be the signal."""
    draft = _Draft(opened)
    signal, imaginary = find_signal(opened)
    if signal is None:
        return ""
    draft.topic = signal.name.rsplit("/", 1)[0] if opened.kind == "MCAP recording" else ""
    draft.used |= {signal.name, *([imaginary] if imaginary else [])}
    sizes = list(signal.shape)
    frequency = _find_axis(draft, ("freq", "hz", "tone"), sizes)
    recorded = opened.kind == "MCAP recording"  # whose arrays all are over messages
    samples, sure = (None, True) if frequency or recorded else _find_samples(draft, sizes)
    axis = frequency or samples
    positions = _find_positions(draft, signal)
    track = _find_track(draft, positions, sizes)
    way = (
        _find_way(draft, positions, sizes, math.prod(axis.shape) if axis else 0)
        if track is None
        else {}
    )
    positions.pop("way", None)
    others = list(sizes)  # lengths that scans may have
    if axis is not None and math.prod(axis.shape) in others:
        others.remove(math.prod(axis.shape))
    stamp = _find_axis(draft, ("time", "stamp", "t_"), others)
    labels = labels_of(opened, sizes)
    dims = _dims(
        sizes,
        axis,
        "frequency" if frequency else "sample" if sure else "sample?",
        positions,
        stamp,
        labels,
        way,
    )
    lines = [
        f"# Draft for {opened.path.name}. What ends in a question mark is a guess: check it and take the mark away.",
        f"title = {json.dumps(opened.path.stem)}",
        f"polarization = {json.dumps(labels)}",
        "",
        "[files]",
        f"data = {json.dumps(opened.path.name)}",
        "",
        "[signal]",
        f"variable = {json.dumps(signal.name)}",
        *([f"imaginary = {json.dumps(imaginary)}"] if imaginary else []),
        f"dims = {json.dumps(dims)}  # of {' x '.join(map(str, sizes))}",
    ]
    if axis is None and imaginary is None and not signal.dtype.startswith("complex"):
        lines += [
            "# interleaved = true  # if real and imaginary parts alternate",
            "# shape = [-1, 1]  # of a flat record",
        ]
    lines += [
        "",
        *_axis_lines(opened, frequency, samples, sure),
        *_position_lines(opened, positions, "pair" in dims),
    ]
    if stamp is not None:
        lines += [
            "[time]",
            f"variable = {json.dumps(stamp.name)}",
            f'unit = "{unit_of(opened, stamp, "s")}"',
            "",
        ]
    if track is not None:
        lines += _track_lines(draft, *track)
    elif not any(len(infos[0].shape) == 3 for infos in positions.values()):
        lines += _pose_lines(draft, way)
    return "\n".join(lines).rstrip() + "\n"


def find_signal(opened: ArrayFile) -> tuple[ArrayInfo | None, str | None]:
    """Find the array that is most likely the measured field, and the one of its imaginary part if that is apart."""
    arrays = [info for info in opened.arrays.values() if math.prod(info.shape) > 1]
    complex_ones = [
        info
        for info in arrays
        if re.match(r"complex|.*(\('r(eal)?'|\('re')", info.dtype, re.DOTALL)
    ]
    if complex_ones:
        return max(complex_ones, key=lambda info: math.prod(info.shape)), None
    for info in arrays:
        for real, imaginary in (("real", "imag"), ("re", "im"), ("_i", "_q")):
            wanted = re.sub(real, imaginary, info.name, flags=re.IGNORECASE).lower()
            other = next(
                (name for name in opened.arrays if name.lower() == wanted and name != info.name),
                None,
            )
            if other is not None and opened.arrays[other].shape == info.shape:
                return info, other
    large = [
        info
        for info in arrays
        if len(info.shape) >= 2
        and info.shape[-1] > 3
        and not re.search("covariance|orientation|rotation", info.name)
    ]
    return (max(large, key=lambda info: math.prod(info.shape)), None) if large else (None, None)


def _find_axis(
    draft: _Draft,
    words: tuple[str, ...],
    sizes: list[int],
    among: list[ArrayInfo] | None = None,
    fast: bool = False,
) -> ArrayInfo | None:
    for info in draft.rest() if among is None else among:
        if fast and not _is_fast(draft.opened, info):
            continue
        count = math.prod(info.shape)
        if count in sizes and max(info.shape, default=0) == count and count > 1:
            name = info.name.lower().replace("/", ".").split(".")[-1]
            short = ("freq" in words and name == "f") or ("time" in words and name == "t")
            if any(word in name for word in words) or short:
                values = small_values(draft.opened, info)
                if (
                    values is not None
                    and values.dtype.kind in "fiu"
                    and (np.diff(values.ravel().astype(float)) > 0).all()
                ):
                    draft.used.add(info.name)
                    return info
    return None


def _find_samples(draft: _Draft, sizes: list[int]) -> tuple[ArrayInfo | None, bool]:
    """Find the two-way delays or ranges of the samples, and tell whether they can be nothing else.

    A "time" may be the radar's fast time or the scans' clock: values below a tenth of a millisecond are the former.
    """
    for count in (sizes[-1:], sizes):
        found = _find_axis(draft, ("range", "delay", "t_ns", "twt", "fast"), count)
        if found is not None:
            return found, True
    times = [
        info
        for info in draft.rest()
        if "time" in info.name.lower() and not _CLOCK.search(info.name.lower())
    ]
    for wanted, sure in ((times, True), (times, False)):
        for count in (sizes[-1:], sizes):
            found = _find_axis(draft, ("time",), count, wanted, sure)
            if found is not None:
                return found, sure
    return None, True


def _is_fast(opened: ArrayFile, info: ArrayInfo) -> bool:
    """Tell whether times can only be those of samples: by their unit, or because they are that small."""
    unit = unit_suffix(info)
    if unit in ("ns", "ps", "us"):
        return True
    values = small_values(opened, info)
    return values is not None and bool(values.size) and float(np.abs(values).max()) < SHORTEST_SCANS


def _find_positions(draft: _Draft, signal: ArrayInfo) -> dict[str, list[ArrayInfo]]:
    sides: dict[str, list[ArrayInfo]] = {}
    for info in draft.rest():
        if len(info.shape) >= 2 and info.shape[-1] == 3 and 0 not in info.shape:
            name = info.name.lower()
            if name == "table" and len(draft.opened.arrays) > 1:
                continue  # all columns of a text, which have names of their own
            if draft.topic:
                if _PLACE.search(name.rsplit("/", 1)[-1]):
                    sides.setdefault("way", []).append(info)
                continue
            side = (
                "tx"
                if re.search(r"tx|trans|source", name)
                else "rx"
                if re.search(r"rx|rec", name)
                else "antenna"
            )
            sides.setdefault(side, []).append(info)
    by_axis = {name: draft.opened.arrays.get(_sibling(signal.name, name)) for name in "xyz"}
    structured = (
        re.search(r"[./]", signal.name) and not draft.topic
    )  # flat files' x, y, z are rather the vehicle's
    if not sides and structured and all(by_axis.values()):
        sides["xyz"] = [info for info in by_axis.values() if info is not None]
    return sides


def _find_track(
    draft: _Draft, positions: dict[str, list[ArrayInfo]], sizes: list[int]
) -> tuple[ArrayInfo, ArrayInfo] | None:
    """Take positions out of the antennas' that fit no axis of the signal but a clock of their own."""
    for side, infos in list(positions.items()):
        info = infos[0]
        if side == "xyz" or len(info.shape) != 2 or info.shape[0] in sizes:
            continue
        beside = _Draft(
            draft.opened, draft.used, info.name.rsplit("/", 1)[0] if draft.topic else ""
        )
        clock = _find_axis(beside, ("time", "t_", "stamp"), [info.shape[0]])
        if clock is not None:
            del positions[side]
            return clock, info
    return None


def _find_way(
    draft: _Draft, positions: dict[str, list[ArrayInfo]], sizes: list[int], tones: int
) -> dict[str, ArrayInfo]:
    """Take what tells a pose per scan: ``position`` (scan, 2, 3 or 6), or single components by their names."""
    scans = [size for size in sizes if size > 1]
    if tones in scans:
        scans.remove(tones)

    found: dict[str, ArrayInfo] = {}
    for info in draft.rest():
        wide = len(info.shape) == 2 and info.shape[0] in scans and info.shape[1] in (2, 3, 6)
        name = info.name.lower()
        if wide and "position" not in found and _PLACE.search(name) and not _ANTENNA.search(name):
            found["position"] = info
            for side, infos in list(positions.items()):
                positions[side] = [one for one in infos if one is not info]
                if not positions[side]:
                    del positions[side]
    vectors = [
        info
        for info in draft.rest()
        if max(info.shape, default=0) == math.prod(info.shape) and info.shape
    ]
    for name, words in _COMPONENTS.items():
        for info in vectors:
            tokens = set(re.split(r"[_\W]+", info.name.lower()))
            if (
                math.prod(info.shape) in scans
                and tokens & words
                and not _ANTENNA.search(info.name.lower())
            ):
                found.setdefault(name, info)
    if "position" in found or "xyz" in positions:
        found = {name: info for name, info in found.items() if name not in "xyz"}
    in_lane = "position" in found or {"x", "y"} <= set(found)
    if in_lane or not set(_GEODETIC) <= set(found):
        found = {name: info for name, info in found.items() if name not in _GEODETIC}
    draft.used |= {info.name for info in found.values()}
    return found


def _pose_lines(draft: _Draft, way: dict[str, ArrayInfo]) -> list[str]:
    lines = [
        "[pose]  # the vehicle in the lane frame; heading is clockwise from +y seen from above"
    ]
    angles = [name for name in ("heading", "pitch", "roll") if name in way]
    position = way.get("position")
    if position is not None:
        unit = unit_of(draft.opened, position, "m")
        beside = ', z = "0?"' if position.shape[1] == 2 else ""
        lines.append(
            f'position = {{variable = {json.dumps(position.name)}{beside}, unit = "{unit}"}}'
        )
        if position.shape[1] == 6:
            return [*lines, 'angle_unit = "rad?"']
    elif set(_GEODETIC) <= set(way):
        lines.append(_geodetic_line(way))
    else:
        places = [name for name in "xyz" if name in way]
        lines += [f"{name} = {_guess(way, name, '0?' if places else '?')}" for name in "xyz"]
        lines.append(f'unit = "{_common_unit(draft, [way[name] for name in places], "m")}"')
    placed = position is not None or "y" in way or "longitude" in way
    course = "course?" if placed else "0?" if way else "?"
    lines += [
        f"{name} = {_guess(way, name, '0?' if name != 'heading' else course)}"
        for name in ("heading", "pitch", "roll")
    ]
    return [*lines, f'angle_unit = "{_common_unit(draft, [way[name] for name in angles], "rad")}"']


def _geodetic_line(way: dict[str, ArrayInfo]) -> str:
    parts = [f"{name} = {json.dumps(way[name].name)}" for name in _GEODETIC]
    height = json.dumps(way["z"].name) if "z" in way else '"0?"'
    places = ", ".join([*parts, f"height = {height}"])
    return (
        f'geodetic = {{{places}, angle_unit = "deg?", unit = "m?"}}  '
        "# needs --anchor, or --anchor-from-track"
    )


def _guess(way: dict[str, ArrayInfo], name: str, without: str) -> str:
    """Give the variable of a component, with a mark unless it is called just that."""
    if name not in way:
        return json.dumps(without)
    called = way[name].name
    last = re.split(r"[/.]", called.lower())[-1].split("_")[0]
    return json.dumps(called if last == name else f"{called}?")


def _common_unit(draft: _Draft, infos: list[ArrayInfo], usual: str) -> str:
    units = {unit_of(draft.opened, info, usual) for info in infos} or {f"{usual}?"}
    return units.pop() if len(units) == 1 else "?"


def _track_lines(draft: _Draft, clock: ArrayInfo, position: ArrayInfo) -> list[str]:
    opened = draft.opened
    lines = [
        "[track]  # positions on a clock of their own",
        f'time = {{variable = {json.dumps(clock.name)}, unit = "{unit_of(opened, clock, "s")}"}}',
        f'position = {{variable = {json.dumps(position.name)}, unit = "{unit_of(opened, position, "m")}"}}',
    ]
    beside = position.name.rsplit("/", 1)[0]
    turned = [
        info.name
        for info in draft.rest()
        if info.shape == (position.shape[0], 4) and re.search(r"orientation|rotation|quat", info.name.lower())
        and (not draft.topic or info.name.startswith(f"{beside}/"))
    ]  # fmt: skip
    if turned:
        body = '["-y?", "x?", "z?"]'
        lines.append(
            f"orientation = {{variable = {json.dumps(turned[0])}, body = {body}}}  # of x forward, y left, z up"
        )
    else:
        lines += ['heading = "course?"', 'pitch = "0?"', 'roll = "0?"', 'angle_unit = "deg?"']
    return [
        *lines,
        "clock_offset = 0.0  # the track's clock less the radar's, s; flgpr.calibrate finds it",
    ]


def labels_of(opened: ArrayFile, sizes: list[int]) -> list[str]:
    """Read the polarizations of a file if it names them, else guess one, marked so."""
    for info in opened.arrays.values():
        if math.prod(info.shape) in sizes:
            values = small_values(opened, info)
            if values is not None and values.dtype.kind in "US":
                labels = [
                    one.decode() if isinstance(one, bytes) else str(one) for one in values.ravel()
                ]
                if labels and set(labels) <= set(POLARIZATIONS):
                    return labels
    return ["HH?"]


def _sibling(name: str, other: str) -> str:
    for mark in (".", "/"):
        if mark in name:
            return name.rsplit(mark, 1)[0] + mark + other
    return other


def _dims(
    sizes: list[int], axis: ArrayInfo | None, axis_name: str, positions: dict[str, list[ArrayInfo]],
    stamp: ArrayInfo | None, labels: list[str], way: dict[str, ArrayInfo],
) -> list[str]:  # fmt: skip
    """Name the axes whose length tells what they are; the others get a question mark."""
    names = ["?"] * len(sizes)

    def put(count: int, name: str) -> None:
        """Name the last axis of that length that has no name; others of the same length leave a doubt."""
        fits = [k for k, size in enumerate(sizes) if size == count and names[k] == "?"]
        if fits and not {name, f"{name}?"} & set(names):
            certain = sizes.count(count) == 1 or name.endswith("?")
            names[fits[-1]] = name if certain else f"{name}?"

    if axis is not None:
        put(math.prod(axis.shape), axis_name)
    if stamp is not None:
        put(math.prod(stamp.shape), "scan")
    if labels[0] != "HH?":
        put(len(labels), "polarization")
    apart = {"tx", "rx"} <= set(positions) and positions["tx"][0].shape != positions["rx"][0].shape
    for side, infos in positions.items():
        rows = infos[0].shape[-2] if side != "xyz" else math.prod(infos[0].shape)
        if len(infos[0].shape) == 3:
            put(infos[0].shape[0], "scan")
        put(rows, side if apart and side != "antenna" else "pair")
    if way and not {"scan", "scan?"} & set(names):
        put(max(next(iter(way.values())).shape), "scan")
    if names.count("?") == 1 and not {"scan", "scan?"} & set(names):
        names[names.index("?")] = "scan?"
    return [
        name if name != "?" else "scan, polarization, pair, tx, rx or single?" for name in names
    ]


def _axis_lines(
    opened: ArrayFile, frequency: ArrayInfo | None, samples: ArrayInfo | None, sure: bool
) -> list[str]:  # fmt: skip
    if frequency is not None:
        unit = unit_of(opened, frequency, "Hz")
        return ["[frequency]", f"variable = {json.dumps(frequency.name)}", f'unit = "{unit}"', ""]
    if samples is not None:
        unit = unit_of(opened, samples, "m" if "range" in samples.name.lower() else "ns")
        meaning = "range?" if unit.rstrip("?") in UNITS["length"] else "delay?"
        return [
            "[samples]", f"variable = {json.dumps(samples.name + ('' if sure else '?'))}", f'unit = "{unit}"',
            f'meaning = "{meaning}"  # delay, range (one way) or path (there and back)',
            "band = []  # first and last frequency to keep", 'band_unit = "GHz"', "",
        ]  # fmt: skip
    return [
        "[frequency]  # no variable looks like the tones; span = [first, last] does as well",
        'variable = "?"',
        'unit = "Hz?"',
        "",
    ]


def _position_lines(
    opened: ArrayFile, positions: dict[str, list[ArrayInfo]], pairs: bool
) -> list[str]:
    if "xyz" in positions:
        names = [
            f"{axis} = {json.dumps(info.name)}"
            for axis, info in zip("xyz", positions["xyz"], strict=True)
        ]
        return ["[antenna_position]", *names, 'unit = "m?"', ""]
    if not positions and not pairs:
        return [
            "[antenna_position]  # in the vehicle frame",
            *(f'{axis} = "0?"' for axis in "xyz"),
            'unit = "m"',
            "",
        ]
    if not positions:
        return [
            "[antenna_position]  # no variable looks like positions",
            "values = []",
            'unit = "m?"',
            "",
        ]
    lines = []
    for side in ("tx", "rx") if "tx" in positions and "rx" in positions else list(positions)[:1]:
        info = positions[side][0]
        frame = ['frame = "lane?"'] if len(info.shape) == 3 else []
        unit = unit_of(opened, info, "m")
        lines += [
            f"[{side}_position]",
            f"variable = {json.dumps(info.name)}",
            f'unit = "{unit}"',
            *frame,
            "",
        ]
    return lines
