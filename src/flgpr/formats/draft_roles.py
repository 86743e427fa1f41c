"""What each array of a measurement's files is.

An array is the signal, an axis of it, positions of antennas, or where the vehicle was. What follows
from lengths, names and stated units is taken as it is. What is a guess ends in a question mark.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.array_file import ArrayInfo
from flgpr.formats.draft_arrays import find_signal, labels_of
from flgpr.formats.draft_groups import TABLES, ArraySource, FileGroup, name_token
from flgpr.formats.draft_units import unit_of
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.units import UNITS

FloatArray = NDArray[np.float64]
_SMALL = 2_000_000  # values; larger arrays are no list of antennas, tones or positions
_CERTAIN_HERTZ = 1e8  # no radar has tones of so many kHz, MHz or GHz
_LONGEST_ARRAY = 20.0  # m; an array on a vehicle is no longer
_LONGEST_STEP = 50.0  # m from scan to scan
_SHORTEST_STEP = 0.02
_COMPLEX_WEIGHT = 10  # by which complex arrays go before real ones: a table is no field
_FREQUENCY_NAMES = re.compile(r"freq|tone|(^|[_./])(f|hz|ghz|mhz)($|[_./])", re.IGNORECASE)
_SAMPLE_NAMES = re.compile(r"range|delay|time|t_ns|twt", re.IGNORECASE)
TIME_NAMES = re.compile(r"time|stamp|(^|[_./])(t|utc|tow)($|[_./])", re.IGNORECASE)
"""What times of scans and of fixes are called."""
_TX_NAMES = re.compile(r"(^|[^a-z])tx|trans|source|sender", re.IGNORECASE)
_RX_NAMES = re.compile(r"(^|[^a-z])rx|recei|receptor|empf", re.IGNORECASE)
_UNNAMED = ("array", "table")  # names of arrays in files that name none
_POSE_NAMES: dict[str, set[str]] = {
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
class Antennas:
    """Antennas of one kind: where their positions lie, and how many they are."""

    source: ArraySource
    count: int
    unit: str
    reason: str = ""  #: why it is that unit
    values: FloatArray | None = None  #: (antenna, 3) where they are some rows of a list


class _Signal(NamedTuple):
    """The measured field: its group of files, its array, and that of its imaginary part."""

    group: FileGroup
    info: ArrayInfo
    imaginary: str | None


class Roles:
    """What the arrays of all groups of files are.

    Files without an array that can be the signal are a ValueError.
    """

    def __init__(self, groups: list[FileGroup]) -> None:
        self.groups = groups
        self.data, self.signal, self.imaginary = self._find_signal()
        self.data.key = "data"
        self.used = {(self.data.key, self.signal.name)}
        if self.imaginary:
            self.used.add((self.data.key, self.imaginary))
        self.sizes = list(self.signal.shape)
        self.frequency = self.find_axis(_FREQUENCY_NAMES)
        self.samples = None if self.frequency else self.find_axis(_SAMPLE_NAMES)
        self.antennas = self._find_antennas()
        self.labels = labels_of(self.data.opened, self.sizes)
        self.pose_columns = self._find_pose_columns()

    def _find_signal(self) -> _Signal:
        """Find the largest array that can be the measured field."""
        best: _Signal | None = None
        best_size = -1
        for group in self.groups:
            info, imaginary = find_signal(group.opened)
            if info is None:
                continue
            size = math.prod(info.shape) * len(group.paths)
            if imaginary is not None or info.dtype.startswith("complex"):
                size *= _COMPLEX_WEIGHT
            if size > best_size:
                best = _Signal(group, info, imaginary)
                best_size = size
        if best is None:
            names = ", ".join(group.paths[0].name for group in self.groups)
            raise ValueError(
                "one of the files must hold a signal, an array of many numbers, "
                f"got none in {names}"
            )
        return best

    def _unused(self) -> list[ArraySource]:
        """Return the arrays that are nothing yet."""
        sources = []
        for group in self.groups:
            for info in group.opened.arrays.values():
                if (group.key, info.name) not in self.used:
                    sources.append(ArraySource(group, info))
        return sources

    def _take(self, source: ArraySource) -> ArraySource:
        """Mark an array as used, and return it."""
        self.used.add((source.group.key, source.info.name))
        return source

    def find_axis(self, names: re.Pattern[str]) -> ArraySource | None:
        """Find the longest array of values that increase along an axis of the signal.

        Its name matches ``names``, or that of its file where the file names no array.
        """
        longest: ArraySource | None = None
        for source in self._unused():
            if not _is_vector(source) or source.count > _SMALL:
                continue
            if source.count not in self.sizes or not _is_called(source, names):
                continue
            if longest is not None and source.count <= longest.count:
                continue
            # Last, because it reads the array.
            values = source.values()
            if values.dtype.kind in "fiu" and _increases(values):
                longest = source
        if longest is None:
            return None
        return self._take(longest)

    def _find_antennas(self) -> dict[str, Antennas]:
        """Find the positions of transmitters and receivers, or of pairs."""
        antennas: dict[str, Antennas] = {}
        for source in self._unused():
            shape = source.info.shape
            if len(shape) != 2 or shape[1] != 3 or source.count > 3 * _SMALL:
                continue
            if shape[0] not in self.sizes and not self._is_sum_of_axes(shape[0]):
                continue
            side = self._side(source)
            if side is None or side in antennas:
                continue
            unit, reason = self._length_unit(source, source.values())
            antennas[side] = Antennas(self._take(source), shape[0], unit, reason)

        are_complete = {"tx", "rx"} <= set(antennas) or "antenna" in antennas
        if are_complete:
            return antennas
        return self._antennas_of_lists() or antennas

    def _is_sum_of_axes(self, count: int) -> bool:
        """Return whether a number is the sum of the lengths of two axes of the signal."""
        return any(count == first + second for first, second in product(self.sizes, repeat=2))

    def _side(self, source: ArraySource) -> str | None:
        """Return which antennas a list of positions is of, by its name; None if unknown."""
        name = source.info.name
        if name in _UNNAMED:
            name = source.group.paths[0].stem
        if _TX_NAMES.search(name):
            return "tx"
        if _RX_NAMES.search(name):
            return "rx"
        # A table without such a name may be anything with three columns, such as a track.
        is_table = source.group.paths[0].suffix.lower() in TABLES
        if source.group.texts or is_table:
            return None
        return "antenna" if source.info.shape[0] in self.sizes else None

    def _antennas_of_lists(self) -> dict[str, Antennas]:
        """Find one list of all antennas.

        A column states the kind of each, else transmitters come first.
        """
        for group in self.groups:
            for source, points in self._point_lists(group):
                antennas = self._by_kind(source, points) or self._by_order(source, points)
                if antennas:
                    return antennas
        return {}

    def _by_kind(self, source: ArraySource, points: FloatArray) -> dict[str, Antennas]:
        """Return transmitters and receivers of a list by a column of their kinds, if any."""
        kinds = _kinds_in(source.group, len(points))
        if kinds is None:
            return {}
        tx = points[kinds == "tx"]
        rx = points[kinds == "rx"]
        if len(tx) not in self.sizes or len(rx) not in self.sizes:
            return {}
        unit, reason = self._length_unit(source, points)
        start = f"{reason}, " if reason else ""
        why_tx = f"{start}of the rows that are called transmitters"
        why_rx = f"{start}of the rows that are called receivers"
        return {
            "tx": Antennas(source, len(tx), unit, why_tx, tx),
            "rx": Antennas(source, len(rx), unit, why_rx, rx),
        }

    def _by_order(self, source: ArraySource, points: FloatArray) -> dict[str, Antennas]:
        """Return transmitters and receivers of a list by their numbers, if these are certain."""
        count = self._transmitters_of(len(points))
        if count is None:
            return {}
        tx = points[:count]
        rx = points[count:]
        unit, _ = self._length_unit(source, points)
        guess = f"{unit.rstrip('?')}?"
        return {
            "tx": Antennas(source, len(tx), guess, "transmitters first in the list?", tx),
            "rx": Antennas(source, len(rx), unit, "the rest of the list", rx),
        }

    def _point_lists(self, group: FileGroup) -> list[tuple[ArraySource, FloatArray]]:
        """Return the lists (antenna, 3) of a group.

        They are arrays of three columns, or columns called x, y and z.
        """
        arrays = group.opened.arrays
        lists: list[tuple[ArraySource, FloatArray]] = []
        name_of = {name_token(name, "xyz"): name for name in arrays}
        if {"x", "y", "z"} <= set(name_of):
            sides = []
            for axis in "xyz":
                values = group.opened.read(name_of[axis])
                sides.append(values.astype(np.float64).ravel())
            sizes = {side.size for side in sides}
            if len(sizes) == 1:
                source = ArraySource(group, arrays[name_of["x"]])
                lists.append((source, np.stack(sides, axis=-1)))

        for info in arrays.values():
            has_three_columns = len(info.shape) == 2 and info.shape[1] == 3
            if has_three_columns and info.shape[0] <= _SMALL:
                points = group.opened.read(info.name).astype(np.float64)
                lists.append((ArraySource(group, info), points))
        return lists

    def _transmitters_of(self, count: int) -> int | None:
        """Return how many of so many antennas transmit; None if two axes do not make it certain."""
        sizes = [size for size in self.sizes if size > 1]
        if self.frequency is not None and self.frequency.count in sizes:
            sizes.remove(self.frequency.count)
        splits = [pair for pair in combinations(sizes, 2) if sum(pair) == count]
        return splits[0][0] if len(splits) == 1 else None

    def _length_unit(self, source: ArraySource, points: NDArray[Any]) -> tuple[str, str]:
        """Return the unit of antennas' positions, and why.

        It is stated, or follows from what their spread can be; else it is a guess.
        """
        stated = unit_of(source.group.opened, source.info, "m")
        if not stated.endswith("?"):
            return stated, ""
        positions = np.asarray(points, dtype=np.float64)
        spread = float(np.ptp(positions, axis=0).max())
        lowest = self._lowest_frequency()
        if lowest is None or spread == 0:
            return stated, ""
        # Were it centimetres, the array would be smaller than half a wavelength: it would see no
        # direction.
        half_wavelength = 0.5 * SPEED_OF_LIGHT / lowest
        spread_if_cm = 0.01 * spread
        if spread > _LONGEST_ARRAY or spread_if_cm >= half_wavelength:
            return stated, ""
        reason = (
            f"by their spread of {spread:.3g}: in cm the array would be below half a wavelength"
        )
        return "m", reason

    def _lowest_frequency(self) -> float | None:
        """Return the lowest tone, Hz; None if no array holds the tones."""
        if self.frequency is None:
            return None
        unit, _ = self.frequency_unit()
        lowest = float(np.min(self.frequency.values()))
        return lowest * UNITS["frequency"][unit.rstrip("?")]

    def frequency_unit(self) -> tuple[str, str]:
        """Return the unit of the tones, and why; a question mark where it is a guess."""
        if self.frequency is None:
            return "Hz?", ""
        unit = unit_of(self.frequency.group.opened, self.frequency.info, "Hz")
        highest = float(np.max(self.frequency.values()))
        if unit == "Hz?" and highest >= _CERTAIN_HERTZ:
            return "Hz", "by their size"
        return unit, ""

    def _find_pose_columns(self) -> dict[str, ArraySource]:
        """Find the arrays of where the vehicle was, all of one file."""
        best: dict[str, ArraySource] = {}
        for group in self.groups:
            # The x, y and z of a list of antennas are no track.
            groups_of_antennas = [antennas.source.group for antennas in self.antennas.values()]
            holds_antennas = any(other is group for other in groups_of_antennas)
            if holds_antennas and group is not self.data:
                continue
            columns = self._pose_columns_in(group)
            is_geodetic = {"longitude", "latitude"} <= set(columns)
            is_in_lane = {"x", "y"} <= set(columns)
            if (is_geodetic or is_in_lane) and len(columns) > len(best):
                best = columns
        return best

    def _pose_columns_in(self, group: FileGroup) -> dict[str, ArraySource]:
        """Return the vectors of a group that are called as components of a pose, or as times."""
        columns: dict[str, ArraySource] = {}
        for source in self._unused():
            if source.group is not group or not _is_vector(source):
                continue
            for name, vocabulary in _POSE_NAMES.items():
                if name not in columns and name_token(source.info.name, vocabulary) is not None:
                    columns[name] = source
                    break
            if TIME_NAMES.search(source.info.name):
                columns.setdefault("time", source)
        return columns

    def scan_count(self, dims: list[str]) -> int | None:
        """Count the scans of all files together; None where no axis and no file is one."""
        files = len(self.data.paths)
        for size, name in zip(self.sizes, dims, strict=True):
            if name.startswith("scan"):
                return size * files
        return files if files > 1 else None

    def dims(self) -> list[str]:
        """Return the names of the signal's axes; a question mark where lengths leave a choice."""
        names = [""] * len(self.sizes)
        axis = self.frequency or self.samples
        if axis is not None:
            self._name_axis(names, axis.count, "frequency" if self.frequency else "sample")
        if self.labels[0] != "HH?" and len(self.labels) > 1:
            self._name_axis(names, len(self.labels), "polarization")
        self._name_antenna_axes(names)
        for number, size in enumerate(self.sizes):
            if not names[number] and size == 1:
                names[number] = "single"

        unnamed = [number for number, name in enumerate(names) if not name]
        if len(unnamed) != 1:
            for number in unnamed:
                names[number] = "scan, polarization, pair, tx, rx or single?"
            return names
        number = unnamed[0]
        scans = self.sizes[number] * len(self.data.paths)
        # As many fixes as scans leave no doubt.
        names[number] = "scan" if self.fix_count() == scans else "scan?"
        return names

    def _name_axis(self, names: list[str], count: int, name: str) -> None:
        """Name an axis of that length; others of the same length leave a doubt."""
        free = self._unnamed_axes(names, count)
        if not free:
            return
        # Recorders write a sweep in one piece: its axis is rather the last.
        number = free[-1] if name in ("frequency", "sample") else free[0]
        is_only = self.sizes.count(count) == 1
        names[number] = name if is_only else f"{name}?"

    def _unnamed_axes(self, names: list[str], count: int) -> list[int]:
        """Return the numbers of the axes of that length that have no name yet."""
        axes = []
        for number, size in enumerate(self.sizes):
            if size == count and not names[number]:
                axes.append(number)
        return axes

    def _name_antenna_axes(self, names: list[str]) -> None:
        """Name the axes of transmitters and receivers, or of pairs."""
        tx = self.antennas.get("tx")
        rx = self.antennas.get("rx")
        free = [size for size, name in zip(self.sizes, names, strict=True) if not name]
        if tx is not None and rx is not None and tx.count * rx.count > 1:
            if _have_axis_each(tx.count, rx.count, free):
                self._name_axis(names, tx.count, "tx")
                self._name_axis(names, rx.count, "rx")
            else:
                self._name_axis(names, tx.count, "pair")
        elif "antenna" in self.antennas:
            count = self.antennas["antenna"].count
            # With two axes of that length every antenna sends, and every one receives.
            sides = ("tx", "rx") if free.count(count) == 2 else ("pair",)
            for name in sides:
                axes = self._unnamed_axes(names, count)
                if axes:  # else the one axis of that length is another's
                    names[axes[0]] = name

    def fix_count(self) -> int | None:
        """Count the rows of where the vehicle was; None without any."""
        if not self.pose_columns:
            return None
        first = next(iter(self.pose_columns.values()))
        return first.count

    def position_unit(self) -> tuple[str, str]:
        """Return the unit of the vehicle's positions, and why.

        It is stated, or follows from their steps; else it is a guess.
        """
        source = self.pose_columns["x"]
        stated = unit_of(source.group.opened, source.info, "m")
        if not stated.endswith("?"):
            return stated, ""
        sides = []
        for axis in "xy":
            values = self.pose_columns[axis].values()
            sides.append(values.astype(np.float64).ravel())
        steps = np.hypot(*np.diff(np.stack(sides), axis=1))
        finite = steps[np.isfinite(steps)]
        middle = float(np.median(finite)) if finite.size else 0.0
        if _SHORTEST_STEP <= middle <= _LONGEST_STEP:
            return "m", f"by their steps of {middle:.3g} from row to row"
        return stated, ""


def _is_vector(source: ArraySource) -> bool:
    """Return whether an array has several values, all along one axis."""
    return max(source.info.shape, default=0) == source.count > 1


def _increases(values: NDArray[Any]) -> bool:
    """Return whether numbers increase from one to the next."""
    return bool((np.diff(values.ravel().astype(np.float64)) > 0).all())


def _is_called(source: ArraySource, names: re.Pattern[str]) -> bool:
    """Return whether the name of an array, or of a file that names none, matches."""
    if names.search(source.info.name):
        return True
    return source.info.name in _UNNAMED and bool(names.search(source.group.paths[0].stem))


def _kinds_in(group: FileGroup, count: int) -> NDArray[np.str_] | None:
    """Return which antenna transmits ("tx") and which receives ("rx"), by a column of text."""
    for cells in group.texts.values():
        sides = [_kind_of(cell.lower()) for cell in cells]
        if len(sides) == count and set(sides) == {"tx", "rx"}:
            return np.array(sides)
    return None


def _kind_of(word: str) -> str:
    """Return the kind that a word states; empty if it states none."""
    if word.startswith(("t", "s")):
        return "tx"
    return "rx" if word.startswith(("r", "e")) else ""


def _have_axis_each(tx: int, rx: int, sizes: list[int]) -> bool:
    """Return whether there is an axis for so many transmitters, and another for the receivers."""
    if tx not in sizes:
        return False
    sizes_left = list(sizes)
    sizes_left.remove(tx)
    return rx in sizes_left
