"""What each array of a measurement's files is.

An array is the signal, an axis of it, positions of antennas, or where the vehicle was. What follows
from lengths, names and stated units is taken as it is. What is a guess ends in a question mark.
Every find takes its arrays out of those that the next ones look among.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.draft_arrays import (
    ANTENNA,
    CLOCK,
    FREQUENCY,
    POSITION,
    RECEIVER,
    ROTATION,
    SAMPLES,
    TABLES,
    TIME,
    TRANSMITTER,
    WAY,
    Antennas,
    ArraySource,
    Field,
    FileGroup,
    Places,
    component_of,
    find_signal,
    labels_of,
)
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.units import UNITS
from flgpr.types import FloatArray

ANY_AXIS = "scan, polarization, pair, tx, rx or single?"
_CERTAIN_HERTZ = 1e8  # no radar has tones of so many kHz, MHz or GHz
_LONGEST_ARRAY = 20.0  # m; an array on a vehicle is no longer
_LONGEST_STEP = 50.0  # m from scan to scan
_SHORTEST_STEP = 0.02
_PER_SCAN = ("of every scan", 0)
_COMPLEX_WEIGHT = 10  # by which complex arrays go before real ones: a table is no field
_SIDES = {"tx": "transmitters", "rx": "receivers"}
_KINDS = {"t": "tx", "s": "tx", "r": "rx", "e": "rx"}
"""Kinds of antennas by the first letters of their words, also of sender and Empfänger."""
_POINT_COLUMNS = (2, 3, 6)  # of a position per row: with a height, with three angles


class Roles:
    """What the arrays of all groups of files are.

    Files without an array that can be the signal are a ValueError.
    """

    def __init__(self, groups: list[FileGroup]) -> None:
        self.groups = groups
        self.data, self.field = self._find_signal()
        self.data.key = "data"
        self.signal = self.field.info
        self.topic = ArraySource(self.data, self.signal).topic  #: of the signal in a recording
        parts = (self.signal.name, self.field.imaginary, self.field.phase)
        self.used = {("data", name) for name in parts if name}
        self.sizes = list(self.signal.shape)
        self.frequency = self.find_axis(FREQUENCY, self.sizes)
        self.samples, self.are_samples = self._find_samples()
        self.axis = self.frequency or self.samples
        self.scan_sizes = [size for size in self.sizes if size > 1]  #: lengths scans may have
        if self.axis is not None and self.axis.count in self.scan_sizes:
            self.scan_sizes.remove(self.axis.count)
        self.antennas = self._find_antennas()
        self.places = self._find_places()
        self.stamp = self.find_axis(TIME, self.scan_sizes, [self.data])
        self.labels = labels_of(self.data.opened, self.sizes)

    def _find_signal(self) -> tuple[FileGroup, Field]:
        """Find the largest array that can be the measured field, and its group of files."""
        candidates = []
        for group in self.groups:
            field = find_signal(group.opened)
            if field is not None:
                size = math.prod(field.info.shape) * len(group.paths)
                weight = _COMPLEX_WEIGHT if field.is_complex else 1
                candidates.append((size * weight, group, field))
        if not candidates:
            names = ", ".join(group.paths[0].name for group in self.groups)
            raise ValueError(
                "one of the files must hold a signal, an array of many numbers, "
                f"got none in {names}"
            )
        _, data, field = max(candidates, key=itemgetter(0))
        return data, field

    def _unused(self, groups: Sequence[FileGroup] = ()) -> list[ArraySource]:
        """Return the arrays that are nothing yet.

        In a recording those of the signal's topic go first, and the times at which messages were
        recorded last.
        """
        sources = [
            ArraySource(group, info)
            for group in groups or self.groups
            for info in group.opened.arrays.values()
            if not (group.opened.repeated and info.name.startswith(group.opened.repeated))
            and (group.key, info.name) not in self.used
        ]
        return sorted(sources, key=lambda one: (one.topic != self.topic, one.is_log_time))

    def _take(self, source: ArraySource) -> ArraySource:
        """Mark an array as used, and return it."""
        self.used.add((source.group.key, source.info.name))
        return source

    def find_axis(
        self, names: re.Pattern[str], sizes: list[int], groups: Sequence[FileGroup] = ()
    ) -> ArraySource | None:
        """Find the first array that is called so and increases along an axis, and take it."""
        called = [source for source in self._unused(groups) if source.is_called(names)]
        return self._take_axis(called, sizes)

    def _take_axis(self, sources: list[ArraySource], sizes: list[int]) -> ArraySource | None:
        """Take the first array whose values increase along an axis of one of these lengths."""
        for source in sources:
            if source.is_vector and source.count in sizes and source.increases():
                return self._take(source)
        return None

    def _find_samples(self) -> tuple[ArraySource | None, bool]:
        """Find the two-way delays or ranges of the samples, and whether they can be nothing else.

        A "time" may be the radar's fast time or the scans' clock: values below a tenth of a
        millisecond are the former. The last axis of the signal is tried first.
        """
        if self.frequency is not None or self.topic:  # all arrays of a topic are over messages
            return None, True
        unused = self._unused()
        delays = [source for source in unused if source.is_called(SAMPLES)]
        times = [one for one in unused if "time" in one.label and not CLOCK.search(one.label)]
        fast = [time for time in times if time.is_fast_time()]
        slow = [time for time in times if time.group is self.data or not _tells_places(time.group)]
        for sources, are_certain in ((delays, True), (fast, True), (slow, False)):
            for sizes in (self.sizes[-1:], self.sizes):
                samples = self._take_axis(sources, sizes)
                if samples is not None:
                    return samples, are_certain
        return None, True

    def _find_antennas(self) -> dict[str, Antennas]:
        """Find the positions of transmitters and receivers, or of pairs."""
        antennas: dict[str, Antennas] = {}
        for source in self._unused():
            shape = source.info.shape
            is_list = len(shape) >= 2 and shape[-1] == 3 and 0 not in shape
            if not is_list or source.topic or self._is_position(source):
                continue
            side = self._side(source)
            if side is None or side in antennas:
                continue
            unit, reason = self._length_unit(source, source.numbers())
            antennas[side] = Antennas(self._take(source), shape[-2], unit, reason)
        if {"tx", "rx"} <= set(antennas) or "antenna" in antennas:
            return antennas
        return self._antennas_of_lists() or antennas or self._antennas_beside_signal()

    def _is_position(self, source: ArraySource) -> bool:
        """Return whether an array holds a position of the vehicle per row, not an antenna's."""
        shape = source.info.shape
        if len(shape) != 2 or shape[1] not in _POINT_COLUMNS or _is_table(source):
            return False
        if ANTENNA.search(source.label):
            return False
        if source.group is not self.data:
            return WAY.search(f"{source.group.paths[0].stem.lower()} {source.label}") is not None
        # Those of another length than the axes are a track, if they have a clock.
        is_other = shape[1] == 3 and shape[0] not in self.sizes and not source.topic
        return is_other or POSITION.search(source.label) is not None

    def _side(self, source: ArraySource) -> str | None:
        """Return which antennas a list of positions is of, by its name; None if unknown."""
        rows = source.info.shape[-2]
        in_data = source.group is self.data
        if in_data and _is_table(source):
            return None
        may_be_some = in_data or rows in self.sizes
        for side, names in (("tx", TRANSMITTER), ("rx", RECEIVER)):
            if may_be_some and names.search(source.label):
                return side
        # A table without such a name may be anything with three columns, such as a track.
        is_table = source.group.paths[0].suffix.lower() in TABLES
        if is_table and not in_data:
            return None
        is_named = in_data and ANTENNA.search(source.label)
        return "antenna" if is_named or rows in self.sizes else None

    def _antennas_beside_signal(self) -> dict[str, Antennas]:
        """Return the x, y and z that lie in the signal's own structure or group."""
        inside = re.match(r".*[./]", self.signal.name)
        arrays = self.data.opened.arrays
        names = [f"{inside[0]}{axis}" for axis in "xyz"] if inside and not self.topic else []
        if not names or not set(names) <= set(arrays):
            return {}
        sides = [self._take(ArraySource(self.data, arrays[name])) for name in names]
        unit = sides[0].unit("m")
        return {"antenna": Antennas(sides[0], sides[0].count, unit, sides=sides)}

    def _antennas_of_lists(self) -> dict[str, Antennas]:
        """Find one list of all antennas.

        A column states the kind of each, else transmitters come first.
        """
        for group in self.groups:
            for source, points in self._point_lists(group):
                kinds = _kinds_in(group, len(points))
                unit, reason = self._length_unit(source, points)
                start = f"{reason}, " if reason else ""
                units = {side: unit for side in _SIDES}
                reasons = {
                    side: f"{start}of the rows that are called {name}"
                    for side, name in _SIDES.items()
                }
                if kinds is None:
                    kinds = self._kinds_by_order(len(points))
                    units["tx"] = f"{unit.rstrip('?')}?"
                    reasons = {
                        "tx": "transmitters first in the list?",
                        "rx": "the rest of the list",
                    }
                found = {}
                for side in _SIDES:
                    rows = points[kinds == side]
                    found[side] = Antennas(source, len(rows), units[side], reasons[side], rows)
                if all(antennas.count in self.sizes for antennas in found.values()):
                    return found
        return {}

    def _kinds_by_order(self, count: int) -> NDArray[np.str_]:
        """Return "tx" and "rx" of so many antennas if two axes make certain how many of each."""
        splits = [pair for pair in combinations(self.scan_sizes, 2) if sum(pair) == count]
        return np.repeat(["tx", "rx"], splits[0] if len(splits) == 1 else (0, count))

    def _point_lists(self, group: FileGroup) -> Iterator[tuple[ArraySource, FloatArray]]:
        """Yield the lists (antenna, 3) of a group: columns called x, y and z, or arrays of three.

        Columns beside the signal are the vehicle's.
        """
        sides: dict[str, ArraySource] = {}
        for source in self._unused([group]):
            component = component_of(source.label)
            if component is not None and component[1] == 0:
                sides[component[0]] = source
        sources = [sides[axis] for axis in "xyz" if axis in sides]
        lengths = {source.count for source in sources}
        if group is not self.data and len(sources) == 3 and len(lengths) == 1:
            yield sources[0], np.stack([source.numbers().ravel() for source in sources], axis=-1)
        for source in self._unused([group]):
            shape = source.info.shape
            is_named = POSITION.search(source.label) or ANTENNA.search(source.label)
            if len(shape) == 2 and shape[1] == 3 and (is_named or group is not self.data):
                yield source, source.numbers().reshape(-1, 3)

    def _length_unit(self, source: ArraySource, points: FloatArray) -> tuple[str, str]:
        """Return the unit of antennas' positions, and why.

        It is stated, or follows from what their spread can be; else it is a guess.
        """
        stated = source.unit("m")
        positions = points.reshape(-1, 3)
        spread = float(np.ptp(positions, axis=0).max()) if positions.size else 0.0
        if not stated.endswith("?") or self.frequency is None or spread == 0:
            return stated, ""
        # Were it centimetres, the array would be smaller than half a wavelength: it would see no
        # direction.
        unit, _ = self.frequency_unit()
        lowest = float(np.min(self.frequency.numbers())) * UNITS["frequency"][unit.rstrip("?")]
        if spread > _LONGEST_ARRAY or 0.01 * spread >= 0.5 * SPEED_OF_LIGHT / lowest:
            return stated, ""
        reason = (
            f"by their spread of {spread:.3g}: in cm the array would be below half a wavelength"
        )
        return "m", reason

    def frequency_unit(self) -> tuple[str, str]:
        """Return the unit of the tones, and why; a question mark where it is a guess."""
        if self.frequency is None:
            return "Hz?", ""
        unit = self.frequency.unit("Hz")
        if unit == "Hz?" and self.frequency.largest() >= _CERTAIN_HERTZ:
            return "Hz", "by their size"
        return unit, ""

    def _find_places(self) -> Places | None:
        """Find the arrays of where the vehicle was, all of one file."""
        # The x, y and z of a list of antennas are no track.
        of_antennas = [antennas.source.group for antennas in self.antennas.values()]
        found = []
        for group in self.groups:
            if group is self.data or not any(group is one for one in of_antennas):
                found += self._places_in(group)
        best = max(found, key=Places.precedence, default=None)
        if best is not None:
            for name, source in best.columns.items():
                if name != "time" or best.count not in self.scan_sizes:
                    self._take(source)
        return best

    def _places_in(self, group: FileGroup) -> list[Places]:
        """Return what a group tells of the vehicle: arrays per scan, or of another length."""
        ranked = []
        for source in self._unused([group]):
            component = self._component(source)
            if component is not None:
                ranked.append((component[1], component[0], source))
        by_length: dict[tuple[str, int], dict[str, ArraySource]] = {}
        for _, name, source in sorted(ranked, key=itemgetter(0)):  # the plainest names first
            is_per_scan = group is self.data and source.rows in self.scan_sizes
            key = _PER_SCAN if is_per_scan else (source.topic, source.rows)
            by_length.setdefault(key, {}).setdefault(name, source)
        found = []
        for key, columns in by_length.items():
            places = Places(group, columns, group is not self.data)
            places.keep_form()
            is_track = places.form not in ((), ("x", "y")) and places.holds("time")
            is_per_scan = key == _PER_SCAN and bool(set(columns) - {"time", "orientation"})
            if is_track or is_per_scan or (places.form and places.is_table):
                found.append(places)
        return found

    def _component(self, source: ArraySource) -> tuple[str, int] | None:
        """Return what an array tells of the vehicle, and how plainly its name says so."""
        label = source.label
        if self._is_position(source):
            return "position", 0 if POSITION.search(label) else 1
        is_rotation = ROTATION.search(label) is not None
        if len(source.info.shape) == 2 and source.info.shape[1] == 4:
            return ("orientation", 0) if is_rotation else None
        if not source.is_vector or ANTENNA.search(label):
            return None
        component = component_of(label)
        if component is not None and not is_rotation:
            return component
        return ("time", 0) if source.is_called(TIME) else None

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
        if self.axis is not None:
            name = "frequency" if self.frequency else "sample"
            self._name_axis(names, self.axis.count, name if self.are_samples else f"{name}?", -1)
        if self.stamp is not None:
            self._name_axis(names, self.stamp.count, "scan")
        if self.labels[0] != "HH?":
            self._name_axis(names, len(self.labels), "polarization", -1)
        self._name_antenna_axes(names)
        is_real = self.samples is None and not self.field.is_complex
        pairs = self._unnamed_axes(names, 2)
        if is_real and len(pairs) == 1:  # tones of real numbers have an imaginary part somewhere
            names[pairs[0]] = "complex?"
        for number, size in enumerate(self.sizes):
            if not names[number] and size == 1:
                names[number] = "single"
        self._name_scans(names)
        any_axis = ANY_AXIS.replace(" or", ", complex or") if is_real else ANY_AXIS
        return [name or any_axis for name in names]

    def _name_scans(self, names: list[str]) -> None:
        """Name the axis of the scans by the number of fixes, or as the only one that is left."""
        unnamed = [number for number, name in enumerate(names) if not name]
        if _has_scans(names) or not unnamed:
            return
        files = len(self.data.paths)
        is_certain = len(unnamed) == 1 and not any(map(_is_guess, names))
        for number in unnamed:
            size = self.sizes[number]
            if self.places is not None and size * files == self.places.count:
                names[number] = "scan" if is_certain or self.sizes.count(size) == 1 else "scan?"
                return
        if len(unnamed) == 1:
            names[unnamed[0]] = "scan?"

    def _name_axis(self, names: list[str], count: int, name: str, place: int = 0) -> None:
        """Name the first axis of that length, or the last; others of it leave a doubt.

        Recorders write a sweep in one piece: its axis is rather the last.
        """
        free = self._unnamed_axes(names, count)
        if free and name not in names:
            is_certain = self.sizes.count(count) == 1 or _is_guess(name)
            names[free[place]] = name if is_certain else f"{name}?"

    def _unnamed_axes(self, names: list[str], count: int) -> list[int]:
        """Return the numbers of the axes of that length that have no name yet."""
        axes = enumerate(zip(self.sizes, names, strict=True))
        return [number for number, (size, name) in axes if size == count and not name]

    def _name_antenna_axes(self, names: list[str]) -> None:
        """Name the axes of transmitters and receivers, or of pairs."""
        for found in self.antennas.values():
            if found.scans is not None:
                self._name_axis(names, found.scans, "scan")
        counts = {side: found.count for side, found in self.antennas.items()}
        free = Counter(size for size, name in zip(self.sizes, names, strict=True) if not name)
        if set(_SIDES) <= set(counts):
            tx, rx = (counts[side] for side in _SIDES)
            if tx * rx > 1 and Counter([tx, rx]) <= free:
                self._name_axis(names, tx, "tx")
                self._name_axis(names, rx, "rx")
            elif tx * rx > 1:
                self._name_axis(names, tx, "pair", -1)
        elif counts:
            count = next(iter(counts.values()))
            axes = self._unnamed_axes(names, count)
            # With two axes of that length, of which none has the scans, every antenna sends, and
            # every one receives.
            if len(axes) == 2 and (len(self.data.paths) > 1 or _has_scans(names)):
                names[axes[0]], names[axes[1]] = "tx", "rx"
            else:
                self._name_axis(names, count, "pair", -1)

    def position_unit(self) -> tuple[str, str]:
        """Return the unit of the vehicle's x, y and z, and why.

        It is stated, or follows from the steps of a table of fixes; else it is a guess.
        """
        columns = {} if self.places is None else self.places.columns
        units = {columns[axis].unit("m") for axis in "xyz" if axis in columns}
        stated = units.pop() if len(units) == 1 else "?"
        if stated != "m?" or self.places is None or not self.places.is_table:
            return stated, ""
        steps = np.hypot(*(np.diff(columns[axis].numbers().ravel()) for axis in "xy"))
        finite = steps[np.isfinite(steps)]
        middle = float(np.median(finite)) if finite.size else 0.0
        if _SHORTEST_STEP <= middle <= _LONGEST_STEP:
            return "m", f"by their steps of {middle:.3g} from row to row"
        return stated, ""


def _is_table(source: ArraySource) -> bool:
    """Return whether an array is all columns of a text, which have names of their own."""
    return source.info.name == "table" and len(source.group.opened.arrays) > 1


def _tells_places(group: FileGroup) -> bool:
    """Return whether a file has columns of places: its times are those of fixes."""
    components = [component_of(name) for name in group.opened.arrays]
    return any(found is not None and found[0] in ("x", "longitude") for found in components)


def _is_guess(name: str) -> bool:
    """Return whether the name of an axis ends in a question mark."""
    return name.endswith("?")


def _has_scans(names: list[str]) -> bool:
    """Return whether one of the axes is, or may be, that of the scans."""
    return "scan" in names or "scan?" in names


def _kinds_in(group: FileGroup, count: int) -> NDArray[np.str_] | None:
    """Return which antenna transmits ("tx") and which receives ("rx"), by a column of text."""
    for cells in group.texts.values():
        sides = [_KINDS.get(cell[:1].lower(), "") for cell in cells]
        if len(sides) == count and set(sides) == {"tx", "rx"}:
            return np.array(sides)
    return None
