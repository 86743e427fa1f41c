"""Sensors: the antenna array, its tones and polarizations, as TOML presets."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from flgpr.model.run import POLARIZATIONS

Position = tuple[float, float, float]


class Tones(BaseModel):
    """Uniform stepped-frequency tones.

    Attributes
    ----------
    start, step : float
        First tone and spacing, Hz.
    count : int
        Number of tones.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    start: Annotated[float, Field(ge=1e6)]
    step: Annotated[float, Field(gt=0)]
    count: Annotated[int, Field(ge=1)]

    def axis(self) -> NDArray[np.float64]:
        """Tones, Hz, shape (count,)."""
        return np.asarray(self.start + self.step * np.arange(self.count), dtype=np.float64)


class Sensor(BaseModel):
    """An antenna array with every transmitter paired with every receiver.

    Attributes
    ----------
    name, source : str
        Name, and where the figures come from.
    tones : Tones
        Frequencies.
    polarization : tuple of str
        Polarizations in the order of the data.
    tx, rx : tuple of positions
        Antenna positions in the vehicle frame, m. The vehicle frame's origin is the array's reference point.
    height : float
        Height of the reference point over the mean ground, m.
    tilt : float
        Downward tilt of the antennas' axes, rad.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str
    source: str
    tones: Tones
    polarization: tuple[str, ...]
    tx: tuple[Position, ...]
    rx: tuple[Position, ...]
    height: Annotated[float, Field(gt=0)]
    tilt: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _spread_lines(cls, data: Any) -> Any:
        # An array along a line may be written as {first, last, count} instead of every position.
        if isinstance(data, dict):
            data = dict(data)
            for side in ("tx", "rx"):
                line = data.get(side)
                if isinstance(line, dict):
                    try:
                        ends = np.asarray([line["first"], line["last"]], dtype=float)
                        count = int(line["count"])
                    except (KeyError, TypeError, ValueError):
                        raise ValueError(f"{side} must be a list of positions or hold first, last and count") from None
                    data[side] = [tuple(p) for p in np.linspace(ends[0], ends[1], count).tolist()]
        return data

    @model_validator(mode="after")
    def _check(self) -> Sensor:
        unknown = [label for label in self.polarization if label not in POLARIZATIONS]
        if unknown or not self.polarization or len(set(self.polarization)) != len(self.polarization):
            raise ValueError(f"polarization must be different ones of {POLARIZATIONS}, got {self.polarization}")
        if not self.tx or not self.rx:
            raise ValueError("tx and rx must each hold at least one antenna")
        return self

    def pairs(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions of every pair, transmitter by transmitter.

        Returns
        -------
        tx_position, rx_position : (pair, 3) ndarray
            Vehicle frame, m; pair = transmitter index times number of receivers plus receiver index.
        """
        tx, rx = np.asarray(self.tx, dtype=float), np.asarray(self.rx, dtype=float)
        return np.repeat(tx, len(rx), axis=0), np.tile(rx, (len(tx), 1))


def sensor_presets() -> list[str]:
    """Names of the packaged sensors."""
    folder = resources.files("flgpr.model") / "presets"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_sensor(name: str | Path) -> Sensor:
    """Load a sensor from a preset or a TOML file.

    Parameters
    ----------
    name : str or Path
        Name of a preset, or path of a TOML file.

    Returns
    -------
    Sensor
        The sensor.

    Raises
    ------
    ValueError
        If there is no such preset or file, or it breaks a rule; the message names the entry.
    """
    if str(name) in sensor_presets():
        text = (resources.files("flgpr.model") / "presets" / f"{name}.toml").read_text(encoding="utf-8")
    elif Path(name).is_file():
        text = Path(name).read_text(encoding="utf-8")
    else:
        raise ValueError(f"sensor must be a TOML file or one of {', '.join(sensor_presets())}, got {str(name)!r}")
    try:
        return Sensor.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"sensor {name}: not valid TOML: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "sensor"
        raise ValueError(f"sensor {name}: {where}: {first['msg']}") from None
