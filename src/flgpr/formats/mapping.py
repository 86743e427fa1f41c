"""The mapping: a small TOML that states which variable of a file is what, and in which unit.

Nothing is guessed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from flgpr.door import read_named
from flgpr.model.bounds import NotNegative, Positive
from flgpr.model.faults import parse_entries
from flgpr.model.units import UNITS
from flgpr.store.files import existing

DIMS = ("scan", "polarization", "pair", "tx", "rx", "frequency", "sample", "complex", "single")
"""What an axis of the signal can be."""


def _given(*entries: Any) -> int:
    """Count the entries that are given."""
    return sum(entry is not None for entry in entries)


class _Table(BaseModel):
    """A table of a mapping: unknown entries are an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Variable(_Table):
    """A variable, or one column of it, where a bare name does not say enough."""

    file: str | None = None  #: where it lies; by default the file of its table
    variable: str
    column: int | None = None  #: column of a two-dimensional variable, from 0
    #: scan axis that its values run along, from 0, in a raster of scans
    axis: Annotated[int, Field(ge=0)] | None = None


EntryValue = float | str | Variable
"""A number, the name of a variable, or a :class:`Variable`."""
Axes = tuple[str, str, str]
"""Which axes of a file are x, y and z, such as ``("x", "-z", "y")``."""


class Index(_Table):
    """Which entry of a list each pair uses, such as the two columns of a table of channels."""

    file: str = "data"  #: where the numbers lie
    variable: str = "table"  #: where the numbers lie
    column: int | None = None  #: column of a two-dimensional variable, from 0
    first: Literal[0, 1]  #: number of the first entry: 1 in MATLAB's counting, 0 in C's


class Quantity(_Table):
    """A variable, or values written here, with a unit."""

    #: file, variable: where the values lie; ``values`` instead gives them here
    file: str = "data"
    variable: str | None = None
    values: float | list[float] | list[list[float]] | None = None
    #: first and last value of an even axis, as many as the signal has
    span: tuple[float, float] | None = None
    column: int | None = None  #: column of a two-dimensional variable, from 0
    unit: str  #: unit; there is no default
    #: whether the first value is subtracted, for clocks with an arbitrary start
    zero_first: bool = False

    @model_validator(mode="after")
    def _one_source(self) -> Quantity:
        if _given(self.variable, self.values, self.span) != 1:
            raise ValueError("give one of: variable, values or span")
        return self


class Positions(_Table):
    """Positions of antennas or of the vehicle.

    They are one variable (..., 3), or (..., 2) with z beside it, or an entry per axis, or values
    written here.
    """

    file: str = "data"
    variable: str | None = None  #: where they lie
    x: EntryValue | None = None  #: where they lie, or a number
    y: EntryValue | None = None  #: where they lie, or a number
    z: EntryValue | None = None  #: where they lie, or a number
    values: list[list[float]] | None = None  #: positions written here
    unit: str  #: unit of length
    index: Index | None = None  #: if the positions list antennas: which of them each pair uses
    #: "vehicle": fixed to the vehicle. "lane": positions per scan in the lane frame of an array
    #: that keeps its form and heading; poses follow from them
    frame: Literal["vehicle", "lane"] = "vehicle"

    @model_validator(mode="after")
    def _one_source(self) -> Positions:
        axes = _given(self.x, self.y, self.z)
        z_completes_variable = axes == 1 and _given(self.z, self.variable) == 2
        forms = _given(self.variable, self.values) + (axes == 3)
        if forms != 1 or not (axes in (0, 3) or z_completes_variable):
            raise ValueError(
                "give one of: variable (with z, if it has x and y alone), values, "
                "or all of x, y and z"
            )
        return self


class Signal(_Table):
    """The measured field."""

    file: str = "data"
    #: variable, imaginary: the array, and the one with its imaginary part if that is apart
    variable: str
    imaginary: str | None = None
    #: what each of its axes is: scan (more than once for a raster, whose scans then follow in C
    #: order), polarization, pair (or tx and rx), frequency (or sample for impulse data); "complex"
    #: for an axis of real and imaginary part; "single" for an axis of length one that is nothing
    dims: list[str]
    #: what the variable is where it is no complex number: a magnitude in dB, or as it is
    magnitude: Literal["dB", "linear"] | None = None
    phase: str | None = None  #: the array of the phase beside a magnitude
    phase_unit: Literal["deg", "rad"] | None = None
    #: True where real and imaginary parts alternate along the variable's last axis
    interleaved: bool = False
    #: shape that the values of a file, complex if they are interleaved, are brought to in C order;
    #: -1 is what is left
    shape: list[int] | None = None
    conjugate: bool = False  #: True where the recorder's phase is exp(+j2πfL/c)

    @model_validator(mode="after")
    def _known_dims(self) -> Signal:
        dims = self.dims
        not_repeatable = [name for name in dims if name not in ("single", "scan")]
        if not set(dims) <= set(DIMS) or len(set(not_repeatable)) != len(not_repeatable):
            raise ValueError(
                f"dims must be of {', '.join(DIMS)}, none but scan and single twice, got {dims}"
            )
        polar = _given(self.magnitude, self.phase, self.phase_unit)
        if polar not in (0, 3):
            raise ValueError("magnitude, phase and phase_unit go together")
        if self.interleaved + _given(self.imaginary) + polar // 3 + ("complex" in dims) > 1:
            raise ValueError(
                "give one of imaginary, interleaved, magnitude with phase, or complex in dims"
            )
        if ("frequency" in dims) == ("sample" in dims):
            raise ValueError(f"dims must hold either frequency or sample, got {dims}")
        if ("tx" in dims) != ("rx" in dims) or {"tx", "pair"} <= set(dims):
            raise ValueError(f"dims must hold pair, or tx and rx together, got {dims}")
        return self


class Samples(Quantity):
    """The axis of impulse data."""

    #: two-way delay (unit of time), one-way range or total path (unit of length)
    meaning: Literal["delay", "range", "path"]
    band: tuple[float, float]  #: frequencies to keep
    band_unit: str  #: their unit
    pad: Annotated[int, Field(ge=1, le=16)] = 1  #: see :func:`flgpr.formats.impulse_to_frequency`
    #: frequency that a receiver mixed to zero, in the unit of the band; complex samples at
    #: baseband need it
    carrier: NotNegative = 0.0


class PathOffset(Quantity):
    """What the recorder subtracted from every path, such as the distance of a scene centre."""

    meaning: Literal["range", "path"]  #: one-way range (doubled) or total path
    along: Literal["scan", "pair"] = "pair"  #: what several values belong to


class Geodetic(_Table):
    """Positions on WGS 84, which an anchor takes to the lane."""

    file: str = "data"
    longitude: EntryValue
    latitude: EntryValue
    height: EntryValue | None = None  #: over the ellipsoid
    #: height of the positioning antenna above the ground, in place of the receiver's heights, which
    #: are too coarse for it, and over another ground where the lane is tied to the track
    above_ground: Annotated[float, Field(gt=0)] | None = None
    angle_unit: str  #: of longitude and latitude
    unit: str  #: of the height

    @model_validator(mode="after")
    def _has_height(self) -> Geodetic:
        if not _given(self.height, self.above_ground):
            raise ValueError("give height, or above_ground")
        return self


class Orientation(_Table):
    """Attitude as a rotation from the body's axes to those of the file."""

    file: str = "data"
    #: quaternions (..., 4) x, y, z, w, or with ``euler`` angles (..., 3)
    variable: str | None = None
    #: the quaternions' components one by one
    x: EntryValue | None = None
    y: EntryValue | None = None
    z: EntryValue | None = None
    w: EntryValue | None = None
    #: order of Euler angles, "XYZ" about the body's turned axes, "xyz" about fixed ones
    euler: str | None = None
    unit: str | None = None  #: of Euler angles
    body: Axes  #: which axes of the body are the vehicle's x (right), y (forward) and z (up)

    @model_validator(mode="after")
    def _one_source(self) -> Orientation:
        components = _given(self.x, self.y, self.z, self.w)
        if components not in (0, 4) or components // 4 + _given(self.variable) != 1:
            raise ValueError("give either variable, or all of x, y, z and w")
        if _given(self.euler, self.unit) == 1 or (_given(self.euler) and components):
            raise ValueError("Euler angles are told by variable, euler and unit together")
        return self


class _VehiclePlace(_Table):
    """Where the vehicle was: a place and an attitude, each in one of several forms."""

    #: in the lane frame; a variable (..., 6) holds heading, pitch, roll, too
    position: Positions | None = None
    #: in place of position; headings are then clockwise from true north
    geodetic: Geodetic | None = None
    #: heading, pitch, roll: number or variable, or "course" for a heading along the course
    heading: EntryValue | None = None
    pitch: EntryValue | None = None
    roll: EntryValue | None = None
    angle_unit: str | None = None
    orientation: Orientation | None = None  #: in place of heading, pitch and roll
    #: which axes of the file are the lane's x, y and z, for positions and orientation
    axes: Axes = ("x", "y", "z")

    @model_validator(mode="after")
    def _complete_attitude(self) -> _VehiclePlace:
        missing = [name for name in ("heading", "pitch", "roll") if getattr(self, name) is None]
        if self.orientation is not None:
            if len(missing) < 3:
                raise ValueError("give either orientation, or heading, pitch and roll")
            return self
        may_be_columns = self.position is not None and self.position.variable is not None
        if missing and not (may_be_columns and len(missing) == 3):
            raise ValueError(f"{missing[0]} is missing")
        if self.angle_unit is None:
            raise ValueError("angle_unit is missing")
        return self


class Poses(_VehiclePlace):
    """Pose of every scan: position or geodetic, or x, y and z here; and an attitude."""

    file: str = "data"
    x: EntryValue | None = None
    y: EntryValue | None = None
    z: EntryValue | None = None
    unit: str | None = None  #: of x, y, z

    @model_validator(mode="after")
    def _one_place(self) -> Poses:
        coordinates = ("x", "y", "z", "unit")
        missing = [name for name in coordinates if getattr(self, name) is None]
        forms = _given(self.position, self.geodetic)
        if forms + (len(missing) < len(coordinates)) > 1:
            raise ValueError("give one of position, geodetic, or x, y, z and unit")
        if not forms and missing:
            raise ValueError(f"{missing[0]} is missing")
        return self


class TrackTable(_VehiclePlace):
    """Positions on another clock than the radar's."""

    time: Quantity  #: time of each fix
    #: clock_offset, clock_rate: time on the track's clock is
    #: ``clock_offset + clock_rate·(radar's time)``; see :mod:`flgpr.calibrate`
    clock_offset: float
    clock_rate: float = 1.0
    #: the positioning antenna in the vehicle frame, m
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    latency: float = 0.0  #: how late the time stamps are, s
    max_gap: Positive = 1.0  #: longest gap between fixes to interpolate over, s

    @model_validator(mode="after")
    def _one_place(self) -> TrackTable:
        if _given(self.position, self.geodetic) != 1:
            raise ValueError("give either position or geodetic")
        return self


class Mapping(_Table):
    """A mapping: what the files of a measurement hold, and where the vehicle was."""

    title: str  #: an attribute of the run
    source: str = ""  #: an attribute of the run
    #: name -> path relative to the mapping's folder; ``data`` is what the command line names, if it
    #: names files. A list or a pattern is read file by file and joined
    files: dict[str, str | list[str]] = {}
    #: dimension along which several files continue ("scan" or "pair"), or "new pair" and "new scan"
    #: where each file is one of them
    join: Literal["scan", "pair", "new scan", "new pair"] = "scan"
    polarization: list[str]  #: labels in the order of the data
    signal: Signal
    frequency: Quantity | None = None
    samples: Samples | None = None
    antenna_position: Positions | None = None
    tx_position: Positions | None = None
    rx_position: Positions | None = None
    path_offset: PathOffset | None = None
    pose: Poses | None = None
    track: TrackTable | None = None
    time: Quantity | None = None

    @model_validator(mode="before")
    @classmethod
    def _refuse_guesses(cls, entries: Any) -> Any:
        """Refuse the question marks of a draft, all in one error."""
        if isinstance(entries, dict):
            kept = ("title", "source", "files")
            guesses = dict(
                guess
                for name, entry in entries.items()
                if name not in kept
                for guess in _guesses(entry, str(name))
            )
            if guesses:
                (first, value), *further = guesses.items()
                more = f" (and so are {', '.join(name for name, _ in further)})" if further else ""
                raise ValueError(
                    f"{first} is still a guess, got {value!r}{more}: "
                    "check it and take the question mark away"
                )
        return entries

    @model_validator(mode="after")
    def _consistent(self) -> Mapping:
        """Refuse tables that contradict one another, or are missing."""
        if _given(self.tx_position, self.rx_position) + 2 * _given(self.antenna_position) != 2:
            raise ValueError(
                "the geometry is missing or double: give antenna_position (one antenna sends and "
                "receives), or tx_position and rx_position"
            )
        tables = ("frequency", "samples")
        needed, other = tables if "frequency" in self.signal.dims else tables[::-1]
        if getattr(self, needed) is None or getattr(self, other) is not None:
            raise ValueError(f"signal.dims asks for the table {needed} and no table {other}")
        positions = (self.antenna_position, self.tx_position)
        in_lane = any(entry is not None and entry.frame == "lane" for entry in positions)
        if _given(self.pose, self.track) + in_lane > 1:
            raise ValueError(
                "the vehicle's place is told twice: give one of pose, track, "
                "or positions with frame = 'lane'"
            )
        if self.track is not None and self.time is None:
            raise ValueError("track asks for the table time, the radar's time of every scan")
        return self


def _guesses(entries: Any, where: str) -> Iterator[tuple[str, str]]:
    """Yield the names and values of entries that end in a question mark."""
    if isinstance(entries, dict):
        for name, value in entries.items():
            yield from _guesses(value, f"{where}.{name}")
    elif isinstance(entries, list):
        for value in entries:
            yield from _guesses(value, where)
    elif isinstance(entries, str) and entries.endswith("?"):
        yield where, entries


def factor(unit: str | None, kind: str, where: str) -> float:
    """Return what to multiply values by to have them in SI units.

    Parameters
    ----------
    unit : str or None
        The unit, such as "ns".
    kind : str
        Its kind, such as "time".
    where : str
        Name of the entry in an error.

    Returns
    -------
    float
        The factor.

    Raises
    ------
    ValueError
        If the unit is missing, or none of its kind.
    """
    if unit is None:
        raise ValueError(f"{where} is missing")
    if unit not in UNITS[kind]:
        raise ValueError(f"{where} must be one of {', '.join(UNITS[kind])}, got {unit!r}")
    return UNITS[kind][unit]


def parse_mapping(text: str | bytes, name: str = "mapping") -> Mapping:
    """Return the mapping that a TOML text holds.

    Parameters
    ----------
    text : str or bytes
        The text.
    name : str
        What to call it in an error.

    Returns
    -------
    Mapping
        The mapping.

    Raises
    ------
    ValueError
        If an entry is missing, unknown or against a rule; the error names it.
    """
    return parse_entries(Mapping, text, name)


def read_mapping(path: str | Path) -> Mapping:
    """Read a mapping from a TOML file.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    Mapping
        The mapping (:func:`parse_mapping`).

    Raises
    ------
    ValueError
        If an entry is missing, unknown or breaks a rule; the error names file and entry.
    FileNotFoundError
        If there is no file.
    """
    return parse_mapping(read_named(existing(path, "mapping")), str(path))
