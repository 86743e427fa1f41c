"""The mapping: a small TOML that says which variable of a file is what, and in which unit. Nothing is guessed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from flgpr.io.files import existing
from flgpr.model.faults import parse_entries

UNITS: dict[str, dict[str, float]] = {
    "frequency": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12},
    "angle": {"rad": 1.0, "deg": 0.017453292519943295},
}
DIMS = ("scan", "polarization", "pair", "tx", "rx", "frequency", "sample", "single")


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


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
    column: int | None = None  #: column of a two-dimensional variable, from 0
    unit: str  #: unit; there is no default
    zero_first: bool = False  #: whether the first value is subtracted, for clocks with an arbitrary start

    @model_validator(mode="after")
    def _one_source(self) -> Quantity:
        if (self.variable is None) == (self.values is None):
            raise ValueError("give either variable or values")
        return self


class Positions(_Table):
    """Antenna positions: one variable (..., 3) or one per axis, or values written here."""

    file: str = "data"
    variable: str | None = None  #: where they lie
    x: str | None = None  #: where they lie
    y: str | None = None  #: where they lie
    z: str | None = None  #: where they lie
    values: list[list[float]] | None = None  #: positions written here
    unit: str  #: unit of length
    index: Index | None = None  #: if the positions list antennas: which of them each pair uses
    #: "vehicle": fixed to the vehicle. "lane": positions per scan in the lane frame of an array that keeps its form and
    #: heading; poses follow from them
    frame: Literal["vehicle", "lane"] = "vehicle"

    @model_validator(mode="after")
    def _one_source(self) -> Positions:
        axes = [axis is not None for axis in (self.x, self.y, self.z)]
        if sum((self.variable is not None, self.values is not None, all(axes))) != 1 or any(axes) != all(axes):
            raise ValueError("give one of: variable, values, or all of x, y and z")
        return self


class Signal(_Table):
    """The measured field."""

    file: str = "data"
    #: variable, imaginary: the array, and the one with its imaginary part if that is apart
    variable: str
    imaginary: str | None = None
    #: what each of its axes is: scan, polarization, pair (or tx and rx), frequency (or sample for impulse data);
    #: "single" for an axis of length one that is nothing
    dims: list[str]
    conjugate: bool = False  #: True where the recorder's phase is exp(+j2πfL/c)

    @model_validator(mode="after")
    def _known_dims(self) -> Signal:
        unknown = [name for name in self.dims if name not in DIMS]
        plain = [name for name in self.dims if name != "single"]
        if unknown or len(set(plain)) != len(plain):
            raise ValueError(f"dims must be different ones of {', '.join(DIMS)}, got {self.dims}")
        if ("frequency" in self.dims) == ("sample" in self.dims):
            raise ValueError(f"dims must hold either frequency or sample, got {self.dims}")
        if ("tx" in self.dims) != ("rx" in self.dims) or ("tx" in self.dims and "pair" in self.dims):
            raise ValueError(f"dims must hold pair, or tx and rx together, got {self.dims}")
        return self


class Samples(Quantity):
    """The axis of impulse data."""

    #: two-way delay (unit of time), one-way range or total path (unit of length)
    meaning: Literal["delay", "range", "path"]
    band: tuple[float, float]  #: frequencies to keep
    band_unit: str  #: their unit
    pad: Annotated[int, Field(ge=1, le=16)] = 1  #: see :func:`flgpr.io.impulse_to_frequency`


class PathOffset(Quantity):
    """What was subtracted from every path by the recorder, such as the distance of a scene centre."""

    meaning: Literal["range", "path"]  #: one-way range (doubled) or total path
    along: Literal["scan", "pair"] = "pair"  #: what several values belong to


class Poses(_Table):
    """Pose of every scan: each component a number or the name of a variable, all six required."""

    file: str = "data"
    x: float | str
    y: float | str
    z: float | str
    heading: float | str
    pitch: float | str
    roll: float | str
    unit: str  #: of x, y, z
    angle_unit: str  #: of heading, pitch, roll


class TrackTable(_Table):
    """Positions on another clock than the radar's."""

    time: Quantity  #: time of each fix
    position: Positions  #: positions (fix, 3) in the lane frame
    #: heading, pitch, roll: number or variable, or "course" for a heading along the way
    heading: float | str
    pitch: float | str
    roll: float | str
    angle_unit: str
    #: clock_offset, clock_rate: time on the track's clock is ``clock_offset + clock_rate·(radar's time)``; see
    #: :mod:`flgpr.calibrate`
    clock_offset: float
    clock_rate: float = 1.0
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: the positioning antenna in the vehicle frame, m
    latency: float = 0.0  #: how late the time stamps are, s
    max_gap: Annotated[float, Field(gt=0)] = 1.0  #: longest gap between fixes to interpolate over, s


class Mapping(_Table):
    """A whole mapping."""

    title: str  #: kept with the run
    source: str = ""  #: kept with the run
    #: name -> path relative to the mapping's folder; ``data`` is what the command line names, if it names files. A list
    #: or a pattern is read file by file and joined
    files: dict[str, str | list[str]] = {}
    #: dimension along which several files continue ("scan" or "pair"), or "new pair" and "new scan" where each file is
    #: one of them
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

    @model_validator(mode="after")
    def _whole(self) -> Mapping:
        both = self.tx_position is not None and self.rx_position is not None
        if (self.antenna_position is not None) == both or (self.tx_position is None) != (self.rx_position is None):
            raise ValueError(
                "the geometry is missing or double: give antenna_position (one antenna sends and receives), or "
                "tx_position and rx_position"
            )
        wanted, other = ("frequency", "samples") if "frequency" in self.signal.dims else ("samples", "frequency")
        if getattr(self, wanted) is None or getattr(self, other) is not None:
            raise ValueError(f"signal.dims asks for the table {wanted} and no table {other}")
        lane = [p is not None and p.frame == "lane" for p in (self.antenna_position, self.tx_position)]
        if sum((self.pose is not None, self.track is not None, any(lane))) > 1:
            raise ValueError(
                "the vehicle's place is told twice: give one of pose, track, or positions with frame = 'lane'"
            )
        if self.track is not None and self.time is None:
            raise ValueError("track asks for the table time, the radar's time of every scan")
        return self


def factor(unit: str, kind: str, where: str) -> float:
    """Look up what to multiply a unit by for SI units; an unknown one, or a guess ending in "?", is an error."""
    if unit.endswith("?"):
        raise ValueError(f"{where} is still a guess, got {unit!r}: check it and take the question mark away")
    if unit not in UNITS[kind]:
        raise ValueError(f"{where} must be one of {', '.join(UNITS[kind])}, got {unit!r}")
    return UNITS[kind][unit]


def parse_mapping(text: str | bytes, name: str = "mapping") -> Mapping:
    """Parse a mapping, TOML; an entry that is missing, unknown or against a rule is an error that names it."""
    return parse_entries(Mapping, text, name)


def read_mapping(path: str | Path) -> Mapping:
    """Read a mapping from a TOML file; what :func:`parse_mapping` refuses is a ValueError."""
    return parse_mapping(existing(path, "mapping").read_bytes(), str(path))
