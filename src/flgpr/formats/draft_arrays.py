"""What a draft of a mapping knows of arrays: words, units, groups of files, places and fields.

Words by which arrays are known stand in one table. Files of one measurement are in groups that
differ by numbers in their names alone. Units are those that a file states, by an attribute or at
the end of a name, else they are guessed by size; a guess ends in a question mark.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flgpr.formats.array_file import ArrayFile, ArrayInfo
from flgpr.formats.arrays import open_arrays
from flgpr.model import POLARIZATIONS
from flgpr.model.units import UNITS
from flgpr.store.files import natural_order
from flgpr.store.text_tables import text_columns
from flgpr.types import FloatArray

RECORDING = "MCAP recording"
"""Kind of file whose arrays are of topics: all are over messages."""
UNNAMED = ("array", "table")
"""Names of arrays in files that name none."""
FREQUENCY = re.compile(r"freq|tone|hz|(^|_)f($|_)")
SAMPLES = re.compile(r"range|delay|t_ns|twt|fast")
"""What delays or ranges of samples are called; a time may be the scans' clock as well."""
TIME = re.compile(r"time|stamp|(^|_)(t|utc|tow)($|_)")
"""What times of scans, of samples and of fixes are called."""
TRANSMITTER = re.compile(r"tx|trans(?!l)|source|sender")
RECEIVER = re.compile(r"rx|(?<![a-z])rec(?!h)|recei|recep|empf")
ANTENNA = re.compile(rf"{TRANSMITTER.pattern}|{RECEIVER.pattern}|ant|elem")
WAY = re.compile(r"way|track|gps|gnss|rtk|traj|odom")
"""What only positions of a vehicle are called."""
CLOCK = re.compile(rf"{WAY.pattern}|utc|epoch|stamp|scan|trace|pps|pose|slow")
"""What a time is called that is no delay of samples."""
POSITION = re.compile(rf"{WAY.pattern}|pos|xyz|coord|loc|place|transl|reference")
ROTATION = re.compile(r"orientation|rotation|quat")
COMPONENTS: dict[str, tuple[str, ...]] = {
    "longitude": ("longitude", "lon", "long", "lng", "laenge"),
    "latitude": ("latitude", "lat", "breite"),
    "x": ("x", "east", "easting", "rechts", "rechtswert", "cross", "across", "crosstrack"),
    "y": (
        "y",
        "north",
        "northing",
        "hoch",
        "hochwert",
        "along",
        "da",
        "dist",
        "distance",
        "downtrack",
        "chainage",
        "odometer",
    ),
    "z": ("z", "height", "alt", "altitude", "elevation", "up", "ellipsoidal", "hoehe", "hgt"),
    "heading": ("heading", "yaw", "hdg", "psi", "azimuth", "course"),
    "pitch": ("pitch",),
    "roll": ("roll",),
}
"""Words in the names of the components of a pose, the plainest first."""


def component_of(name: str) -> tuple[str, int] | None:
    """Return the component of a pose that a name is called by, and how plainly: 0 is plainest."""
    tokens = re.split(r"[_\W]+", name.lower())
    for component, words in COMPONENTS.items():
        for rank, word in enumerate(words):
            if word in tokens:
                return component, rank
    return None


SMALL = 2_000_000
"""Values of an array, at most, that is read to explain it."""
SHORTEST_SCANS = 1e-4
"""Times of scans reach it, s; two-way delays of samples do not."""
_NO_SUFFIX = ("in", "h", "min")  # units that are words in names
_LONG_UNITS = {
    "meter": "m",
    "metre": "m",
    "foot": "ft",
    "feet": "ft",
    "degree": "deg",
    "radian": "rad",
    "second": "s",
}


def small_values(opened: ArrayFile, info: ArrayInfo) -> Any:
    """Read a small array.

    An array that cannot be read keeps no other from being explained.

    Parameters
    ----------
    opened : ArrayFile
        The file.
    info : ArrayInfo
        The array.

    Returns
    -------
    (...) ndarray or None
        Its values; None if it is large or cannot be read.
    """
    if math.prod(info.shape) > SMALL:
        return None
    try:
        return opened.read(info.name)
    except ValueError:
        return None


def unit_suffix(info: ArrayInfo) -> str:
    """Return the unit that ends an array's name, such as ns of t_ns; empty if there is none."""
    name = info.name.lower()
    last = re.split(r"[_\W]", name)[-1]
    units = (unit for units in UNITS.values() for unit in units if unit.lower() == last)
    return next((unit for unit in units if last != name and unit not in _NO_SUFFIX), "")


TABLES = (".csv", ".txt", ".tsv", ".dat")
"""Endings of tables, whose columns may hold text."""


@dataclass
class FileGroup:
    """Files that differ by numbers in their names alone, and what the first of them holds."""

    key: str  #: name in the mapping's table of files
    paths: list[Path]
    opened: ArrayFile
    #: columns of text of a table, by name
    texts: dict[str, list[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class ArraySource:
    """An array of a group."""

    group: FileGroup
    info: ArrayInfo

    @property
    def count(self) -> int:
        """How many values it has."""
        return math.prod(self.info.shape)

    @property
    def is_vector(self) -> bool:
        """Whether it has several values, all along one axis."""
        return max(self.info.shape, default=0) == self.count > 1

    @property
    def rows(self) -> int:
        """How many values it has along its axis, or how many points (row, 3)."""
        return self.count if self.is_vector else self.info.shape[-2]

    @property
    def topic(self) -> str:
        """The topic that it is of, in a recording; else empty."""
        if self.group.opened.kind != RECORDING:
            return ""
        return re.sub(r"@[^/]*$|/[^/@]*$", "", self.info.name)

    @property
    def is_log_time(self) -> bool:
        """Whether it is when the messages of a topic were recorded, not what they hold."""
        return bool(self.topic) and "@" in self.info.name

    @property
    def label(self) -> str:
        """Its name without the topic, in small letters; that of a file which names none."""
        if self.info.name in UNNAMED:
            return self.group.paths[0].stem.lower()
        return self.info.name.removeprefix(self.topic).lower()

    def is_called(self, names: re.Pattern[str]) -> bool:
        """Return whether the last part of its label matches."""
        return names.search(re.split(r"[/.]", self.label)[-1]) is not None

    def numbers(self) -> FloatArray:
        """Return its values, those of the first file of the group.

        They are none where it is large, damaged or of other values than real numbers: that keeps
        no other array from its place.
        """
        values = small_values(self.group.opened, self.info)
        if values is None or values.dtype.kind not in "fiu":
            return np.zeros(0)
        return values.astype(np.float64)

    def increases(self) -> bool:
        """Return whether it holds numbers that increase from one to the next."""
        numbers = self.numbers().ravel()
        return numbers.size > 1 and bool((np.diff(numbers) > 0).all())

    def largest(self) -> float:
        """Return its largest finite magnitude; 0 where it is not read."""
        values = small_values(self.group.opened, self.info)
        if values is None or values.dtype.kind not in "biufc":
            return 0.0
        magnitudes = np.abs(values[np.isfinite(values)])
        return float(magnitudes.max(initial=0.0))

    def unit(self, usual: str) -> str:
        """Return its unit.

        Parameters
        ----------
        usual : str
            The usual unit of its kind, such as "m".

        Returns
        -------
        str
            The unit that the file states, by an attribute or at the end of the name, else one
            guessed by size, with a question mark.
        """
        kind = next(units for units in UNITS.values() if usual in units)
        stated = self.info.unit
        if len(stated) > 2:
            stated = _LONG_UNITS.get(stated.strip().lower().rstrip("s"), stated)
        for unit in (stated, unit_suffix(self.info)):
            if unit in kind:
                return unit
        top = self.largest() if usual in ("Hz", "ns") else 0.0
        if usual == "Hz" and top < 1e6:
            return "MHz?" if top >= 100 else "GHz?"
        return "s?" if usual == "ns" and 0 < top < SHORTEST_SCANS else f"{usual}?"

    def is_fast_time(self) -> bool:
        """Return whether times can only be those of samples: by their unit, or by their size."""
        has_short_unit = unit_suffix(self.info) in ("ns", "ps", "us")
        return has_short_unit or 0 < self.largest() < SHORTEST_SCANS


def group_files(files: list[Path], limit: int) -> list[FileGroup]:
    """Group files whose names differ by numbers alone.

    Parameters
    ----------
    files : list of Path
        The files.
    limit : int
        Bytes that a file and an array may take.

    Returns
    -------
    list of FileGroup
        The groups, in the order of their first files.

    Raises
    ------
    ValueError
        If a file cannot be read, or the files of a group hold different arrays.
    """
    by_name: dict[tuple[Path, str], list[Path]] = {}
    for path in files:
        by_name.setdefault((path.parent, re.sub(r"\d+", "*", path.name)), []).append(path)
    groups: list[FileGroup] = []
    taken = {"data"}
    for paths in by_name.values():
        paths.sort(key=natural_order)
        first, *others = paths
        opened = open_arrays(first, limit)
        expected = list(opened.arrays)
        for path in others:
            names = list(open_arrays(path, limit).arrays)
            if names != expected:
                raise ValueError(
                    f"{path}: files of one kind must hold the same arrays, got {', '.join(names)} "
                    f"beside {', '.join(expected)} of {first.name}"
                )
        texts: dict[str, list[str]] = {}
        if first.suffix.lower() in TABLES:
            with suppress(ValueError):  # a take or a log may end so, too
                texts = text_columns(first)
        # A name that TOML takes without quotes.
        key = re.sub(r"\W+", "_", re.sub(r"\d+", "", first.stem), flags=re.ASCII).strip("_")
        key = key or "file"
        while key in taken:
            key += "_"
        taken.add(key)
        groups.append(FileGroup(key, paths, opened, texts))
    return groups


_FORMS = (("position",), ("x", "y"), ("longitude", "latitude"))
"""Components that tell a place together."""


@dataclass
class Antennas:
    """Antennas of one kind: where their positions lie, and how many they are."""

    source: ArraySource
    count: int
    unit: str
    reason: str = ""  #: why it is that unit
    values: FloatArray | None = None  #: (antenna, 3) where they are some rows of a list
    sides: Sequence[ArraySource] = ()  #: x, y and z where they lie apart

    @property
    def scans(self) -> int | None:
        """How many scans have positions of their own, in the lane frame; None if one has all."""
        shape = self.source.info.shape
        return shape[0] if len(shape) == 3 else None


@dataclass
class Places:
    """Where the vehicle was: arrays of one file by component, with times if there are any."""

    group: FileGroup
    columns: dict[str, ArraySource]
    is_table: bool  #: whether it is a table of fixes in a file of its own, not beside the signal

    @property
    def count(self) -> int:
        """How many fixes there are."""
        return next(iter(self.columns.values())).rows

    def holds(self, *names: str) -> bool:
        """Return whether all of these components are there."""
        return set(names) <= set(self.columns)

    @property
    def form(self) -> tuple[str, ...]:
        """The components that tell where the vehicle was; empty where it is height or heading.

        Beside the signal, x and y are in the lane and stand for longitude and latitude. Those of a
        table of fixes may be in any frame.
        """
        forms = (_FORMS[0], _FORMS[2], _FORMS[1]) if self.is_table else _FORMS
        return next((form for form in forms if self.holds(*form)), ())

    @property
    def are_geodetic(self) -> bool:
        """Whether positions are longitudes and latitudes."""
        return self.form == ("longitude", "latitude")

    def keep_form(self) -> None:
        """Take components out that others stand for."""
        for name in {name for form in _FORMS for name in form}.difference(self.form or ("x", "y")):
            self.columns.pop(name, None)

    def precedence(self) -> tuple[bool, bool, int]:
        """Return what makes one file's places go before another's."""
        return bool(self.form), not self.are_geodetic, len(self.columns)


_NO_FIELD = re.compile(r"covariance|orientation|rotation")
_COMPLEX = re.compile(r"complex|.*(\('r(eal)?'|\('re')", re.DOTALL)
_PHASE = re.compile(
    r"phase|(?<![a-z])ang(?:le)?(?![a-z])|(?<![a-z])arg(?![a-z])"
    r"|(?<![a-z])deg(?![a-z])|(?<![a-z])rad(?![a-z])"
)
_MAGNITUDE = re.compile(r"mag|(?<![a-z])db|amp|(?<![a-z])abs")
_IMAGINARY = (("real", "imag"), ("re", "im"), ("_i", "_q"))
"""What names of real parts hold, and those of imaginary parts in its stead."""


def find_signal(opened: ArrayFile) -> Field | None:
    """Find the array that is most likely the measured field, and what its phase is in.

    Parameters
    ----------
    opened : ArrayFile
        The file.

    Returns
    -------
    Field or None
        The field; None if there is none.
    """
    if opened.signal:
        return Field(opened.arrays[opened.signal])
    arrays = [info for info in opened.arrays.values() if math.prod(info.shape) > 1]
    complex_arrays = [info for info in arrays if _COMPLEX.match(info.dtype)]
    if complex_arrays:
        return Field(max(complex_arrays, key=_count))
    for info in arrays:
        imaginary = _imaginary_of(info, opened)
        if imaginary is not None:
            return Field(info, imaginary)
    polar = _find_polar(opened)
    tables = [info for info in arrays if len(info.shape) >= 2 and info.shape[-1] > 3]
    fields = [info for info in tables if not _NO_FIELD.search(info.name)]
    if polar is None and fields:
        return Field(max(fields, key=_count))
    return polar


class Field(NamedTuple):
    """A measured field, as it lies in a file."""

    info: ArrayInfo  #: the array, or its real part, or its magnitude
    imaginary: str | None = None  #: the array of its imaginary part, if that is apart
    phase: str | None = None  #: the array of its phase, of a magnitude
    form: str = ""  #: of the magnitude: "dB" or "linear"
    unit: str = ""  #: of the phase: "deg" or "rad"

    @property
    def is_complex(self) -> bool:
        """Whether it has phases."""
        has_parts = self.imaginary is not None or self.phase is not None
        return has_parts or self.info.dtype.startswith("complex")


def _find_polar(opened: ArrayFile) -> Field | None:
    """Return the magnitude and the phase that network analysers export apart.

    They are the first of a file by their names whose shapes agree.
    """
    for phase in opened.arrays.values():
        beside = _PHASE.split(phase.name.lower(), maxsplit=1)
        if len(beside) != 2 or math.prod(phase.shape) < 2:
            continue
        for info in opened.arrays.values():
            name = info.name.lower()
            is_pair = info.shape == phase.shape and _MAGNITUDE.search(name)
            if is_pair and info is not phase and name.startswith(beside[0].rstrip(" _:")):
                form = "dB" if "db" in name or "log" in name else "linear"
                unit = "rad" if "rad" in phase.name.lower() else "deg"
                return Field(info, None, phase.name, form, unit)
    return None


def _count(info: ArrayInfo) -> int:
    """Return how many values an array has."""
    return math.prod(info.shape)


def _imaginary_of(info: ArrayInfo, opened: ArrayFile) -> str | None:
    """Return the array whose name and shape make it the imaginary part of another."""
    for real, imaginary in _IMAGINARY:
        expected = re.sub(real, imaginary, info.name, flags=re.IGNORECASE).lower()
        called = [name for name in opened.arrays if name.lower() == expected and name != info.name]
        if called and opened.arrays[called[0]].shape == info.shape:
            return called[0]
    return None


def labels_of(opened: ArrayFile, sizes: list[int]) -> list[str]:
    """Return the polarizations of a file if it names them, else a guess.

    Parameters
    ----------
    opened : ArrayFile
        The file.
    sizes : list of int
        Lengths of the signal's axes.

    Returns
    -------
    list of str
        The labels; "HH?" alone where the file names none.
    """
    for info in opened.arrays.values():
        values = small_values(opened, info) if _count(info) in sizes else None
        if values is None or values.dtype.kind not in "US":
            continue
        labels = np.char.decode(values) if values.dtype.kind == "S" else values
        if set(labels.ravel().tolist()) <= set(POLARIZATIONS) and labels.size:
            return list(labels.ravel().tolist())
    return ["HH?"]
