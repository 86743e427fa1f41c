"""What each array of a measurement's files is: the signal, its axes, the antennas, and where the vehicle was.

What follows from lengths, names and stated units is taken as it is. What is a guess ends in a question mark.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.arrays import ArrayInfo
from flgpr.formats.draft_groups import TABLES, ArraySource, FileGroup, name_token
from flgpr.formats.draft_single import find_signal, labels_of
from flgpr.formats.draft_units import unit_of
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.units import UNITS

FloatArray = NDArray[np.float64]
_SMALL = 2_000_000  # values; larger arrays are no list of antennas, tones or positions
_CERTAIN_HERTZ = 1e8  # no radar has tones of so many kHz, MHz or GHz
_LONGEST_ARRAY = 20.0  # m; an array on a vehicle is no longer
_LONGEST_STEP = 50.0  # m from scan to scan
_SHORTEST_STEP = 0.02
_FREQUENCY_NAMES = re.compile(r"freq|tone|(^|[_./])(f|hz|ghz|mhz)($|[_./])", re.IGNORECASE)
_SAMPLE_NAMES = re.compile(r"range|delay|time|t_ns|twt", re.IGNORECASE)
TIME_NAMES = re.compile(r"time|stamp|(^|[_./])(t|utc|tow)($|[_./])", re.IGNORECASE)
"""What times of scans and of fixes are called."""
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
class Antennas:
    """Antennas of one kind: where their positions lie, and how many they are."""

    source: ArraySource
    count: int
    unit: str
    why: str = ""
    values: FloatArray | None = None  #: (antenna, 3) where they are a part of a list


class Roles:
    """What the arrays of all groups of files are.

    Files without an array that can be the signal are a ValueError.
    """

    def __init__(self, groups: list[FileGroup]) -> None:
        self.groups = groups
        self.data, self.signal, self.imaginary = self._signal_of_all()
        self.data.key = "data"
        self.used = {(self.data.key, self.signal.name), (self.data.key, self.imaginary or "")}
        self.sizes = list(self.signal.shape)
        self.frequency = self.find_axis(_FREQUENCY_NAMES)
        self.samples = None if self.frequency else self.find_axis(_SAMPLE_NAMES)
        self.antennas = self._find_antennas()
        self.labels = labels_of(self.data.opened, self.sizes)
        self.way = self._find_way()

    def _signal_of_all(self) -> tuple[FileGroup, ArrayInfo, str | None]:
        best: tuple[int, FileGroup, ArrayInfo, str | None] | None = None
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

    def _rest(self) -> list[ArraySource]:
        return [
            ArraySource(group, info)
            for group in self.groups
            for info in group.opened.arrays.values()
            if (group.key, info.name) not in self.used
        ]

    def _take(self, source: ArraySource) -> ArraySource:
        self.used.add((source.group.key, source.info.name))
        return source

    def find_axis(self, names: re.Pattern[str]) -> ArraySource | None:
        """Find values that increase along an axis of the signal, the longest first: by their name, or by a file's."""
        fits: list[tuple[int, ArraySource]] = []
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

    def _find_antennas(self) -> dict[str, Antennas]:
        """Find the positions of transmitters and receivers, or of pairs."""
        found: dict[str, Antennas] = {}
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
            found[side] = Antennas(self._take(source), source.info.shape[0], unit, why)
        if {"tx", "rx"} <= set(found) or "antenna" in found:
            return found
        return self._antennas_of_lists() or found

    def _is_product(self, count: int) -> bool:
        return any(count == a + b for a in self.sizes for b in self.sizes)

    def _side(self, source: ArraySource) -> str | None:
        name = (
            source.info.name
            if source.info.name not in ("array", "table")
            else source.group.paths[0].stem
        )
        if _TX_NAMES.search(name):
            return "tx"
        if _RX_NAMES.search(name):
            return "rx"
        table = source.group.texts or source.group.paths[0].suffix.lower() in TABLES
        return None if table or source.info.shape[0] not in self.sizes else "antenna"

    def _antennas_of_lists(self) -> dict[str, Antennas]:
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
                            "tx": Antennas(source, len(tx), unit, why_tx, tx),
                            "rx": Antennas(source, len(rx), unit, why_rx, rx),
                        }
                split = self._split(len(points))
                if split is not None:
                    tx = points[: split[0]]
                    rx = points[split[0] :]
                    return {
                        "tx": Antennas(
                            source,
                            len(tx),
                            f"{unit.rstrip('?')}?",
                            "transmitters first in the list?",
                            tx,
                        ),
                        "rx": Antennas(source, len(rx), unit, "the rest of the list", rx),
                    }
        return {}

    def _point_lists(self, group: FileGroup) -> list[tuple[ArraySource, FloatArray]]:
        """Return the lists (antenna, 3) of a group: arrays of three columns, or columns called x, y and z."""
        arrays = group.opened.arrays
        lists: list[tuple[ArraySource, FloatArray]] = []
        named = {name_token(name, "xyz"): name for name in arrays}
        if {"x", "y", "z"} <= set(named):
            sides = [group.opened.read(named[axis]).astype(np.float64).ravel() for axis in "xyz"]
            if len({side.size for side in sides}) == 1:
                lists.append((ArraySource(group, arrays[named["x"]]), np.stack(sides, axis=-1)))
        for info in arrays.values():
            if len(info.shape) == 2 and info.shape[1] == 3 and info.shape[0] <= _SMALL:
                lists.append(
                    (ArraySource(group, info), group.opened.read(info.name).astype(np.float64))
                )
        return lists

    def _kinds(self, group: FileGroup, count: int) -> NDArray[np.str_] | None:
        """Read from a column of text which antenna transmits and which receives."""
        for cells in group.texts.values():
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

    def _length_unit(self, source: ArraySource, points: NDArray[Any]) -> tuple[str, str]:
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
        unit, _ = self.frequency_unit()
        return float(np.min(self.frequency.values())) * UNITS["frequency"][unit.rstrip("?")]

    def frequency_unit(self) -> tuple[str, str]:
        """Return the unit of the tones, and why; a question mark where it is a guess."""
        if self.frequency is None:
            return "Hz?", ""
        unit = unit_of(self.frequency.group.opened, self.frequency.info, "Hz")
        if unit == "Hz?" and float(np.max(self.frequency.values())) >= _CERTAIN_HERTZ:
            return "Hz", "by their size"
        return unit, ""

    def _find_way(self) -> dict[str, ArraySource]:
        """Find columns or arrays that tell where the vehicle was, all of one file and of one length."""
        best: dict[str, ArraySource] = {}
        for group in self.groups:
            found: dict[str, ArraySource] = {}
            for source in self._rest():
                if (
                    source.group is not group
                    or max(source.info.shape, default=0) != source.count
                    or source.count < 2
                ):
                    continue
                for name, words in _WAY_NAMES.items():
                    if name not in found and name_token(source.info.name, words) is not None:
                        found[name] = source
                        break
                if TIME_NAMES.search(source.info.name):
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
                names[place] = name if self.sizes.count(count) == 1 else f"{name}?"

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
            sides = ("tx", "rx") if free.count(count) == 2 else ("pair",)  # each sends and receives
            for name in sides:
                place = next(
                    k for k, size in enumerate(self.sizes) if size == count and not names[k]
                )
                names[place] = name
        for k, size in enumerate(self.sizes):
            if not names[k] and size == 1:
                names[k] = "single"
        left = [k for k, name in enumerate(names) if not name]
        if len(left) == 1:
            rows = self.fixes()
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

    def fixes(self) -> int | None:
        """Count the rows that tell where the vehicle was; None without any."""
        return next(iter(self.way.values())).count if self.way else None

    def way_unit(self) -> tuple[str, str]:
        """Return the unit of the vehicle's places, and why: stated, or by their steps; else a guess."""
        way = self.way
        stated = unit_of(way["x"].group.opened, way["x"].info, "m")
        if not stated.endswith("?"):
            return stated, ""
        places = np.stack([way[axis].values().astype(np.float64).ravel() for axis in "xy"])
        steps = np.hypot(*np.diff(places, axis=1))
        middle = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
        if _SHORTEST_STEP <= middle <= _LONGEST_STEP:
            return "m", f"by their steps of {middle:.3g} from row to row"
        return stated, ""
