"""One draft of a mapping for all files of an own array together: scans, antennas, frequencies, positions.

A file by itself does not tell what the others do: which axis has the antennas shows in the list of antennas, which has
the tones in the list of tones, and how many scans there are in the list of positions. What follows from lengths, names
and stated units stands as it is; what is still a guess ends in a question mark, as in a draft of one file
(:mod:`flgpr.formats.explain`).
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.door import read_named
from flgpr.formats.arrays import LIMIT, ArrayFile, ArrayInfo, open_arrays
from flgpr.formats.explain import Explanation, explain_file, find_signal, labels_of, unit_of
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.units import UNITS
from flgpr.store.files import existing

FloatArray = NDArray[np.float64]
_SMALL = 2_000_000  # values; larger arrays are no list of antennas, tones or positions
_CERTAIN_HERTZ = 1e8  # no radar has tones of so many kHz, MHz or GHz
_LONGEST_ARRAY = 20.0  # m; an array on a vehicle is no longer
_LONGEST_STEP = 50.0  # m from scan to scan
_TABLES = (".csv", ".txt", ".tsv", ".dat")
_FREQUENCY_NAMES = re.compile(r"freq|tone|(^|[_./])(f|hz|ghz|mhz)($|[_./])", re.IGNORECASE)
_TIME_NAMES = re.compile(r"time|stamp|(^|[_./])(t|utc|tow)($|[_./])", re.IGNORECASE)
_TX_NAMES = re.compile(r"(^|[^a-z])tx|trans|source|sender", re.IGNORECASE)
_RX_NAMES = re.compile(r"(^|[^a-z])rx|recei|receptor|empf", re.IGNORECASE)
_WAY_NAMES: dict[str, set[str]] = {
    "longitude": {"lon", "long", "longitude", "lng", "laenge"},
    "latitude": {"lat", "latitude", "breite"},
    "height": {"height", "alt", "altitude", "elevation", "ellipsoidal", "hoehe", "z", "up", "hgt"},
    "x": {"x", "east", "easting", "rechts", "rechtswert"},
    "y": {"y", "north", "northing", "hoch", "hochwert"},
    "heading": {"heading", "yaw", "hdg", "azimuth", "course"},
    "pitch": {"pitch"},
    "roll": {"roll"},
}


@dataclass
class _Group:
    """Files that differ by numbers in their names alone, and what the first of them holds."""

    key: str  #: name in the mapping's table of files
    paths: list[Path]
    opened: ArrayFile
    role: dict[str, list[str]] = field(default_factory=dict)  #: columns of text of a table, by name


@dataclass(frozen=True)
class _Source:
    """An array of a group."""

    group: _Group
    info: ArrayInfo

    @property
    def count(self) -> int:
        return math.prod(self.info.shape)

    def values(self) -> NDArray[Any]:
        return self.group.opened.read(self.info.name)

    def entry(self, unit: str | None = None) -> str:
        parts = [f"file = {json.dumps(self.group.key)}", f"variable = {json.dumps(self.info.name)}"]
        if unit is not None:
            parts.append(f'unit = "{unit}"')
        return "{" + ", ".join(parts) + "}"


@dataclass
class _Antennas:
    """Antennas of one kind: where their positions lie, and how many they are."""

    source: _Source
    count: int
    unit: str
    why: str = ""
    values: FloatArray | None = None  #: (antenna, 3) where they are a part of a list


def explain_files(
    paths: Sequence[str | Path], limit: int = LIMIT, beside: str | Path | None = None
) -> Explanation:
    """Tell what several files of one measurement hold, and draft the one mapping that imports them together.

    Parameters
    ----------
    paths : sequence of path
        The files: scans, one or many, and what belongs to them, in any order.
    limit : int
        Bytes that a file and an array may take.
    beside : path, optional
        The mapping that will be written; its file names are relative to its folder. By default they
        are relative to the folder of the first file.

    Returns
    -------
    Explanation
        ``lines`` tell every group of files; ``mapping`` is the draft.

    Raises
    ------
    ValueError
        If a file cannot be read, files of one group differ in their arrays, or no file holds a
        signal.
    """
    files = [existing(path) for path in paths]
    if not files:
        raise ValueError("paths must name at least one file, got none")
    groups = _groups(files, limit)
    lines: list[str] = []
    for group in groups:
        count = len(group.paths)
        head = group.paths[0].name if count == 1 else f"{count} files like {group.paths[0].name}"
        lines.append(f"{head} ({group.opened.kind})" + (", each" if count > 1 else ""))
        lines += [f"  {line}" for line in explain_file(group.paths[0], limit).lines]
    home = files[0].parent if beside is None else Path(beside).parent
    return Explanation(files[0], f"{len(files)} files", lines, _Together(groups, home).draft())


def _groups(files: list[Path], limit: int) -> list[_Group]:
    """Put files together whose names differ by numbers alone and whose arrays are alike."""
    by_name: dict[tuple[str, str], list[Path]] = {}
    for path in files:
        by_name.setdefault((str(path.parent), re.sub(r"\d+", "*", path.name)), []).append(path)
    groups: list[_Group] = []
    for alike in by_name.values():
        alike.sort(key=lambda path: [int(part) for part in re.findall(r"\d+", path.name)])
        opened = open_arrays(alike[0], limit)
        for path in alike[1:]:
            names = list(open_arrays(path, limit).arrays)
            if names != list(opened.arrays):
                raise ValueError(
                    f"{path}: files of one kind must hold the same arrays, got {', '.join(names)} beside "
                    f"{', '.join(opened.arrays)} of {alike[0].name}"
                )
        texts = _text_columns(alike[0]) if alike[0].suffix.lower() in _TABLES else {}
        groups.append(_Group(_key(alike[0], {group.key for group in groups}), alike, opened, texts))
    return groups


def _key(path: Path, taken: set[str]) -> str:
    """Return a name for a file that TOML takes without quotes."""
    key = re.sub(r"\W+", "_", re.sub(r"\d+", "", path.stem), flags=re.ASCII).strip("_") or "file"
    while key in taken or key == "data":
        key += "_"
    return key


def _text_columns(path: Path) -> dict[str, list[str]]:
    """Return the columns of a table that hold text, such as which antenna is a transmitter, by their header."""
    text = read_named(path, LIMIT).decode("utf-8-sig", errors="replace")
    lines = [
        line
        for line in text.splitlines()
        if line.strip() and not line.lstrip().startswith(("#", "%"))
    ]
    if len(lines) < 2:
        return {}
    mark = next((mark for mark in ";\t," if mark in lines[0]), ",")
    rows = [row for row in csv.reader(io.StringIO("\n".join(lines)), delimiter=mark) if row]
    columns: dict[str, list[str]] = {}
    for number, name in enumerate(rows[0]):
        cells = [row[number].strip() if number < len(row) else "" for row in rows[1:]]
        if any(re.search(r"[A-Za-z]", cell) for cell in cells):
            columns[name.strip()] = cells
    return columns


class _Together:
    """All files of a measurement, and what each axis and table of its mapping is."""

    def __init__(self, groups: list[_Group], home: Path) -> None:
        self.home = home
        self.groups = groups
        self.data, self.signal, self.imaginary = self._signal_of_all()
        self.data.key = "data"
        self.used = {(self.data.key, self.signal.name), (self.data.key, self.imaginary or "")}
        self.sizes = list(self.signal.shape)
        self.frequency = self._axis(_FREQUENCY_NAMES)
        self.samples = (
            None
            if self.frequency
            else self._axis(re.compile(r"range|delay|time|t_ns|twt", re.IGNORECASE))
        )
        self.antennas = self._find_antennas()
        self.labels = labels_of(self.data.opened, self.sizes)
        self.way = self._find_way()

    def _signal_of_all(self) -> tuple[_Group, ArrayInfo, str | None]:
        best: tuple[int, _Group, ArrayInfo, str | None] | None = None
        for group in self.groups:
            signal, imaginary = find_signal(group.opened)
            if signal is None:
                continue
            size = math.prod(signal.shape) * len(group.paths)
            complex_or_parts = imaginary is not None or signal.dtype.startswith("complex")
            size *= 10 if complex_or_parts else 1  # a table of antennas is no field
            if best is None or size > best[0]:
                best = size, group, signal, imaginary
        if best is None:
            names = ", ".join(path.name for group in self.groups for path in group.paths[:1])
            raise ValueError(
                f"one of the files must hold a signal, an array of many numbers, got none in {names}"
            )
        return best[1:]

    def _rest(self) -> list[_Source]:
        return [
            _Source(group, info)
            for group in self.groups
            for info in group.opened.arrays.values()
            if (group.key, info.name) not in self.used
        ]

    def _take(self, source: _Source) -> _Source:
        self.used.add((source.group.key, source.info.name))
        return source

    def _axis(self, names: re.Pattern[str]) -> _Source | None:
        """Find values that increase along an axis of the signal, the longest first: by their name, or by a file's."""
        fits: list[tuple[int, _Source]] = []
        for source in self._rest():
            flat = max(source.info.shape, default=0) == source.count > 1 and source.count <= _SMALL
            called = names.search(source.info.name) or (
                names.search(source.group.paths[0].stem) and source.info.name in ("array", "table")
            )
            if not (flat and called and source.count in self.sizes):
                continue
            values = source.values()
            if (
                values.dtype.kind in "fiu"
                and (np.diff(values.ravel().astype(np.float64)) > 0).all()
            ):
                fits.append((source.count, source))
        if not fits:
            return None
        return self._take(max(fits, key=lambda fit: fit[0])[1])

    def _find_antennas(self) -> dict[str, _Antennas]:
        """Find the positions of transmitters and receivers, or of pairs."""
        found: dict[str, _Antennas] = {}
        for source in self._rest():
            if (
                len(source.info.shape) != 2
                or source.info.shape[1] != 3
                or source.count > 3 * _SMALL
            ):
                continue
            if source.info.shape[0] not in self.sizes and not self._is_product(
                source.info.shape[0]
            ):
                continue
            side = self._side(source)
            if side is None or side in found:
                continue
            unit, why = self._length_unit(source, source.values())
            found[side] = _Antennas(self._take(source), source.info.shape[0], unit, why)
        if {"tx", "rx"} <= set(found) or "antenna" in found:
            return found
        return self._antennas_of_lists() or found

    def _is_product(self, count: int) -> bool:
        return any(count == a + b for a in self.sizes for b in self.sizes)

    def _side(self, source: _Source) -> str | None:
        name = (
            source.info.name
            if source.info.name not in ("array", "table")
            else source.group.paths[0].stem
        )
        if _TX_NAMES.search(name):
            return "tx"
        if _RX_NAMES.search(name):
            return "rx"
        table = source.group.role or source.group.paths[0].suffix.lower() in _TABLES
        return None if table or source.info.shape[0] not in self.sizes else "antenna"

    def _antennas_of_lists(self) -> dict[str, _Antennas]:
        """Find one list of all antennas: with a column that tells their kind, else transmitters first."""
        for group in self.groups:
            for source, points in self._point_lists(group):
                kinds = self._kinds(group, len(points))
                unit, why = self._length_unit(source, points)
                if kinds is not None:
                    tx = points[kinds == "tx"]
                    rx = points[kinds == "rx"]
                    if len(tx) in self.sizes and len(rx) in self.sizes:
                        words = f"{why}, " if why else ""
                        why_tx = f"{words}of the rows that are called transmitters"
                        why_rx = f"{words}of the rows that are called receivers"
                        return {
                            "tx": _Antennas(source, len(tx), unit, why_tx, tx),
                            "rx": _Antennas(source, len(rx), unit, why_rx, rx),
                        }
                split = self._split(len(points))
                if split is not None:
                    tx = points[: split[0]]
                    rx = points[split[0] :]
                    return {
                        "tx": _Antennas(
                            source,
                            len(tx),
                            f"{unit.rstrip('?')}?",
                            "transmitters first in the list?",
                            tx,
                        ),
                        "rx": _Antennas(source, len(rx), unit, "the rest of the list", rx),
                    }
        return {}

    def _point_lists(self, group: _Group) -> list[tuple[_Source, FloatArray]]:
        """Return the lists (antenna, 3) of a group: arrays of three columns, or columns called x, y and z."""
        arrays = group.opened.arrays
        lists: list[tuple[_Source, FloatArray]] = []
        named = {_token(name, "xyz"): name for name in arrays}
        if {"x", "y", "z"} <= set(named):
            sides = [group.opened.read(named[axis]).astype(np.float64).ravel() for axis in "xyz"]
            if len({side.size for side in sides}) == 1:
                lists.append((_Source(group, arrays[named["x"]]), np.stack(sides, axis=-1)))
        for info in arrays.values():
            if len(info.shape) == 2 and info.shape[1] == 3 and info.shape[0] <= _SMALL:
                lists.append(
                    (_Source(group, info), group.opened.read(info.name).astype(np.float64))
                )
        return lists

    def _kinds(self, group: _Group, count: int) -> NDArray[np.str_] | None:
        """Read from a column of text which antenna transmits and which receives."""
        for cells in group.role.values():
            low = [cell.lower() for cell in cells]
            sides = [
                "tx" if one.startswith(("t", "s")) else "rx" if one.startswith(("r", "e")) else ""
                for one in low
            ]
            if len(sides) == count and set(sides) == {"tx", "rx"}:
                return np.array(sides)
        return None

    def _split(self, count: int) -> tuple[int, int] | None:
        """Tell how many transmitters and receivers a list of so many antennas has, by two axes of the signal."""
        others = [size for size in self.sizes if size > 1]
        if self.frequency is not None and self.frequency.count in others:
            others.remove(self.frequency.count)
        pairs = [
            (a, b)
            for i, a in enumerate(others)
            for k, b in enumerate(others)
            if i < k and a + b == count
        ]
        return pairs[0] if len(pairs) == 1 else None

    def _length_unit(self, source: _Source, points: NDArray[Any]) -> tuple[str, str]:
        """Return the unit of antennas' positions, and why: stated, or by what their spread can be; else a guess."""
        stated = unit_of(source.group.opened, source.info, "m")
        if not stated.endswith("?"):
            return stated, ""
        spread = float(np.ptp(np.asarray(points, dtype=np.float64), axis=0).max())
        lowest = self._lowest_frequency()
        if lowest is None or spread == 0:
            return stated, ""
        # Were it centimetres, the whole array would be smaller than half a wavelength.
        if spread <= _LONGEST_ARRAY and 0.01 * spread < 0.5 * SPEED_OF_LIGHT / lowest:
            return (
                "m",
                f"by their spread of {spread:.3g}: in cm the array would be below half a wavelength",
            )
        return stated, ""

    def _lowest_frequency(self) -> float | None:
        if self.frequency is None:
            return None
        unit, _ = self._frequency_unit()
        return float(np.min(self.frequency.values())) * UNITS["frequency"][unit.rstrip("?")]

    def _frequency_unit(self) -> tuple[str, str]:
        assert self.frequency is not None  # noqa: S101 - the caller has looked
        unit = unit_of(self.frequency.group.opened, self.frequency.info, "Hz")
        if unit == "Hz?" and float(np.max(self.frequency.values())) >= _CERTAIN_HERTZ:
            return "Hz", "by their size"
        return unit, ""

    def _find_way(self) -> dict[str, _Source]:
        """Find columns or arrays that tell where the vehicle was, all of one file and of one length."""
        best: dict[str, _Source] = {}
        for group in self.groups:
            found: dict[str, _Source] = {}
            for source in self._rest():
                if (
                    source.group is not group
                    or max(source.info.shape, default=0) != source.count
                    or source.count < 2
                ):
                    continue
                for name, words in _WAY_NAMES.items():
                    if name not in found and _token(source.info.name, words) is not None:
                        found[name] = source
                        break
                if _TIME_NAMES.search(source.info.name):
                    found.setdefault("time", source)
            placed = {"longitude", "latitude"} <= set(found) or {"x", "y"} <= set(found)
            of_antennas = (
                any(one.source.group is group for one in self.antennas.values())
                and group is not self.data
            )
            if placed and not of_antennas and len(found) > len(best):
                best = found
        return best

    def scans(self, dims: list[str]) -> int | None:
        """Count the scans of all files together; None where no axis and no file is one."""
        along = [k for k, name in enumerate(dims) if name.startswith("scan")]
        if along:
            return self.sizes[along[0]] * len(self.data.paths)
        return len(self.data.paths) if len(self.data.paths) > 1 else None

    def dims(self) -> list[str]:
        """Name the axes of the signal; a question mark where lengths leave a choice."""
        names = [""] * len(self.sizes)

        def put(count: int, name: str) -> None:
            fits = [k for k, size in enumerate(self.sizes) if size == count and not names[k]]
            if fits:
                place = fits[-1] if name in ("frequency", "sample") else fits[0]
                names[place] = name if len(fits) == 1 else f"{name}?"

        axis = self.frequency or self.samples
        if axis is not None:
            put(axis.count, "frequency" if self.frequency else "sample")
        if self.labels[0] != "HH?" and len(self.labels) > 1:
            put(len(self.labels), "polarization")
        tx = self.antennas.get("tx")
        rx = self.antennas.get("rx")
        if tx is not None and rx is not None and tx.count * rx.count > 1:
            if self._holds(tx.count, rx.count, names):
                put(tx.count, "tx")
                put(rx.count, "rx")
            else:
                put(tx.count, "pair")
        elif "antenna" in self.antennas:
            count = self.antennas["antenna"].count
            free = [size for size, name in zip(self.sizes, names, strict=True) if not name]
            for name in (
                ("tx", "rx") if free.count(count) == 2 else ("pair",)
            ):  # each antenna sends and receives
                names[
                    next(k for k, size in enumerate(self.sizes) if size == count and not names[k])
                ] = name
        for k, size in enumerate(self.sizes):
            if not names[k] and size == 1:
                names[k] = "single"
        left = [k for k, name in enumerate(names) if not name]
        if len(left) == 1:
            rows = self._rows()
            certain = rows is not None and rows == self.sizes[left[0]] * len(self.data.paths)
            names[left[0]] = "scan" if certain else "scan?"
            left = []
        for k in left:
            names[k] = "scan, polarization, pair, tx, rx or single?"
        return names

    def _holds(self, tx: int, rx: int, names: list[str]) -> bool:
        """Tell whether transmitters and receivers have an axis each."""
        free = [size for size, name in zip(self.sizes, names, strict=True) if not name]
        if tx not in free:
            return False
        free.remove(tx)
        return rx in free

    def _rows(self) -> int | None:
        return next(iter(self.way.values())).count if self.way else None

    def draft(self) -> str:
        """Write the mapping."""
        dims = self.dims()
        several = len(self.data.paths) > 1
        join = ""
        if several:
            join = "scan" if any(name.startswith("scan") for name in dims) else "new scan"
            rows = self._rows()
            certain = join == "scan" or rows is None or rows == len(self.data.paths)
            join += "" if certain or self.way.get("time") is not None else "?"
        lines = [
            f"# Draft for {sum(len(group.paths) for group in self.groups)} files together.",
            "# What ends in a question mark is a guess: check it and take the mark away.",
            f"title = {json.dumps(self.data.paths[0].parent.resolve().name or 'own array')}",
            f"polarization = {json.dumps(self.labels)}",
        ]
        if join:
            what = (
                "each file is a scan"
                if join.startswith("new")
                else "each file continues the scans of the one before"
            )
            lines.append(f"join = {json.dumps(join)}  # {len(self.data.paths)} files: {what}")
        lines += ["", "[files]"]
        lines += [
            f"{group.key} = {self._names(group)}" for group in self.groups if self._needed(group)
        ]
        lines += [
            "",
            "[signal]",
            f"variable = {json.dumps(self.signal.name)}",
            *([f"imaginary = {json.dumps(self.imaginary)}"] if self.imaginary else []),
            f"dims = {json.dumps(dims)}  # of {' x '.join(map(str, self.sizes))}",
            "",
            *self._axis_lines(),
            *self._antenna_lines(),
            *self._way_lines(self.scans(dims)),
        ]
        return "\n".join(lines).rstrip() + "\n"

    def _needed(self, group: _Group) -> bool:
        if group is self.data:
            return True
        sources = [self.frequency, self.samples, *self.way.values()]
        sources += [one.source for one in self.antennas.values() if one.values is None]
        return any(source is not None and source.group is group for source in sources)

    def _names(self, group: _Group) -> str:
        names = [os.path.relpath(path, self.home or ".") for path in group.paths]
        if len(names) == 1:
            return json.dumps(names[0])
        folder = group.paths[0].parent
        pattern = re.sub(r"\d+", "*", group.paths[0].name)
        if {path.name for path in folder.glob(pattern)} == {path.name for path in group.paths}:
            return json.dumps(os.path.relpath(folder / pattern, self.home or "."))
        return json.dumps(names)

    def _axis_lines(self) -> list[str]:
        if self.frequency is not None:
            unit, why = self._frequency_unit()
            return ["[frequency]", *_where(self.frequency), _unit_line(unit, why), ""]
        if self.samples is not None:
            usual = "m" if "range" in self.samples.info.name.lower() else "ns"
            unit = unit_of(self.samples.group.opened, self.samples.info, usual)
            meaning = "range?" if unit.rstrip("?") in UNITS["length"] else "delay?"
            return [
                "[samples]", *_where(self.samples), _unit_line(unit),
                f'meaning = "{meaning}"  # delay, range (one way) or path (there and back)',
                'band = ["?", "?"]  # first and last frequency to keep', 'band_unit = "GHz"', "",
            ]  # fmt: skip
        return [
            "[frequency]  # no file holds values that increase along an axis of the signal",
            'span = ["?", "?"]  # first and last tone', 'unit = "GHz"', "",
        ]  # fmt: skip

    def _antenna_lines(self) -> list[str]:
        sides = ("tx", "rx") if {"tx", "rx"} <= set(self.antennas) else ("antenna",)
        if not set(sides) <= set(self.antennas):
            return ["[antenna_position]  # in the vehicle frame; no file holds as many places as there are antennas",
                    'values = [["?", "?", "?"]]', 'unit = "m"', ""]  # fmt: skip
        lines: list[str] = []
        for side in sides:
            one = self.antennas[side]
            lines.append(f"[{side}_position]  # in the vehicle frame: x right, y forward, z up")
            if one.values is None:
                lines += _where(one.source)
            else:
                lines += [
                    "values = [",
                    *(f"    {json.dumps(row)}," for row in one.values.tolist()),
                    "]",
                ]
            lines += [_unit_line(one.unit, one.why), ""]
        return lines

    def _way_lines(self, scans: int | None) -> list[str]:
        way = self.way
        if not way:
            return ["[pose]  # no file tells where the vehicle was", 'x = "?"', 'y = "?"', 'z = "?"', 'unit = "m"',
                    'heading = "?"', 'pitch = "0?"', 'roll = "0?"', 'angle_unit = "deg"']  # fmt: skip
        rows = next(iter(way.values())).count
        if rows == scans:
            return self._pose_lines()
        return self._track_lines(rows, scans)

    def _pose_lines(self) -> list[str]:
        way = self.way
        lines = [
            "[pose]  # the vehicle in the lane frame, a row per scan; heading is clockwise from +y seen from above",
            f"file = {json.dumps(next(iter(way.values())).group.key)}",
        ]
        if {"longitude", "latitude"} <= set(way):
            lines.append(f"geodetic = {self._geodetic()}  # needs --anchor, or --anchor-from-track")
        else:
            unit, why = self._way_unit()
            lines += [f"{axis} = {json.dumps(way[axis].info.name)}" for axis in "xy"]
            z = way.get("height")
            lines += [
                f"z = {json.dumps(z.info.name) if z else '0.0  # no column of heights'}",
                _unit_line(unit, why),
            ]
        return [*lines, *self._attitude_lines()]

    def _geodetic(self) -> str:
        way = self.way
        parts = [f"file = {json.dumps(way['longitude'].group.key)}"]
        parts += [
            f"{name} = {json.dumps(way[name].info.name)}" for name in ("longitude", "latitude")
        ]
        height = way.get("height")
        parts.append(f"height = {json.dumps(height.info.name) if height else 0.0}")
        return "{" + ", ".join(parts) + ', angle_unit = "deg", unit = "m"}'

    def _way_unit(self) -> tuple[str, str]:
        way = self.way
        stated = unit_of(way["x"].group.opened, way["x"].info, "m")
        if not stated.endswith("?"):
            return stated, ""
        places = np.stack([way[axis].values().astype(np.float64).ravel() for axis in "xy"])
        steps = np.hypot(*np.diff(places, axis=1))
        middle = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
        if 0.02 <= middle <= _LONGEST_STEP:
            return "m", f"by their steps of {middle:.3g} from row to row"
        return stated, ""

    def _attitude_lines(self) -> list[str]:
        way = self.way
        lines: list[str] = []
        for name, without in (
            ("heading", '"course?"  # along the way'),
            ("pitch", "0.0"),
            ("roll", "0.0"),
        ):
            known = way.get(name)
            lines.append(f"{name} = {json.dumps(known.info.name) if known else without}")
        units = [unit_of(way[name].group.opened, way[name].info, "deg") for name in ("heading", "pitch", "roll")
                 if name in way]  # fmt: skip
        return [*lines, f'angle_unit = "{units[0] if units else "deg"}"']

    def _track_lines(self, rows: int, scans: int | None) -> list[str]:
        """Write a track on a clock of its own, where there are more or fewer fixes than scans."""
        way = self.way
        stamp = self._axis(_TIME_NAMES)
        counts = (
            f"{rows} fixes of {scans or 'an unknown number of'} scans: a track on its own clock"
        )
        lines = ["[time]  # the radar's time of every scan"]
        if stamp is not None:
            lines += [*_where(stamp), _unit_line(unit_of(stamp.group.opened, stamp.info, "s")), ""]
        else:
            lines += [
                'span = ["?", "?"]  # of the first and the last scan, on the clock of the fixes',
                'unit = "s"',
                "",
            ]
        lines.append(f"[track]  # {counts}")
        clock = way.get("time")
        if clock is not None:
            lines.append(f"time = {clock.entry(unit_of(clock.group.opened, clock.info, 's'))}")
        else:
            lines.append('time = {values = ["?"], unit = "s"}  # no column of times')
        if {"longitude", "latitude"} <= set(way):
            lines.append(f"geodetic = {self._geodetic()}  # needs --anchor, or --anchor-from-track")
        else:
            unit, why = self._way_unit()
            key = json.dumps(way["x"].group.key)
            sides = [f"{axis} = {json.dumps(way[axis].info.name)}" for axis in "xy"]
            height = way.get("height")
            sides.append(f"z = {json.dumps(height.info.name) if height else 0.0}")
            words = f"  # {why}" if why else ""
            lines.append(f'position = {{file = {key}, {", ".join(sides)}, unit = "{unit}"}}{words}')
        return [
            *lines,
            *self._attitude_lines(),
            "clock_offset = 0.0  # the track's clock less the radar's, s",
        ]


def _where(source: _Source) -> list[str]:
    lines = [] if source.group.key == "data" else [f"file = {json.dumps(source.group.key)}"]
    return [*lines, f"variable = {json.dumps(source.info.name)}"]


def _unit_line(unit: str, why: str = "") -> str:
    return f'unit = "{unit}"' + (f"  # {why}" if why else "")


def _token(name: str, words: Any) -> str | None:
    """Return the word of a name that is one of ``words``."""
    tokens = re.split(r"[_\W]+", name.lower())
    return next((token for token in tokens if token in set(words)), None)
