"""Randomised worlds: a scene and a sensor some of whose entries are drawn anew for every lane.

A detector that is trained on one kind of ground learns that ground. Lanes whose soil, roughness,
echoes and radar differ from one to the next leave it only what they have in common ("domain
randomization": Tobin et al., IROS 2017).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from flgpr.model import Sensor
from flgpr.model.faults import first_fault, load_preset, preset_names
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Scene

_WORLDS = resources.files("flgpr.simulate.scene") / "worlds"
_WAYS = ("between", "ratio", "one_of")
Value = float | str
Tables = Mapping[str, Any]
DrawnT = TypeVar("DrawnT", bound=BaseModel)


class Worlds(BaseModel):
    """Which entries of a scene and of a sensor are drawn, and from what.

    Both hold tables as theirs do. In place of a value stands ``[least, greatest]``, between which
    all are as likely; ``{ ratio = [least, greatest] }``, between which all ratios are; or
    ``{ one_of = [...] }``.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    scene: dict[str, Any] = Field(default_factory=dict)
    sensor: dict[str, Any] = Field(default_factory=dict)

    @field_validator("scene", "sensor")
    @classmethod
    def _check(cls, tables: dict[str, Any]) -> dict[str, Any]:
        """Refuse what is no way to draw a value."""
        for name, how in _leaves(tables):
            _check_way(name, *_way(how))
        return tables


def world_names() -> list[str]:
    """Return the names of the packaged randomised worlds."""
    return preset_names(_WORLDS)


def load_worlds(name: str | Path) -> Worlds:
    """Load randomised worlds from a packaged name or a TOML file.

    An entry that breaks a rule is a ValueError that names it.
    """
    return load_preset(Worlds, "worlds", name, _WORLDS)


def draw_into(
    worlds: Worlds, scene: Scene, sensor: Sensor, seed: int
) -> tuple[Scene, Sensor, list[str]]:
    """Draw the entries of a world into a scene and a sensor.

    Parameters
    ----------
    worlds : Worlds
        What is drawn. It stands in place of what the scene and the sensor say of these entries.
    scene, sensor
        Where it is drawn into.
    seed : int
        The same seed draws the same values, whatever else is drawn.

    Returns
    -------
    scene : Scene
    sensor : Sensor
    drawn : list of str
        What was drawn: "soil.clay 12.3".

    Raises
    ------
    ValueError
        If there is no such entry, or a value breaks its rule.
    """
    drawn: list[str] = []
    new_scene = _with_drawn(scene, worlds.scene, f"worlds {worlds.name}: scene", seed, drawn)
    new_sensor = _with_drawn(sensor, worlds.sensor, f"worlds {worlds.name}: sensor", seed, drawn)
    return new_scene, new_sensor, drawn


def _with_drawn(model: DrawnT, ways: Tables, what: str, seed: int, drawn: list[str]) -> DrawnT:
    """Return a model with drawn values in place of its own."""
    tables = model.model_dump(exclude_unset=True)
    for name, how in _leaves(ways):
        value = _draw(how, stream(seed, f"worlds {name}"))
        drawn.append(f"{name} {value if isinstance(value, str) else format(value, '.4g')}")
        *path, entry = name.split(".")
        table = tables
        for step in path:
            table = table.setdefault(step, {})
        table[entry] = value
    try:
        return type(model).model_validate(tables)
    except ValidationError as error:
        raise ValueError(f"{what}.{first_fault(error, type(model))}") from None


def _leaves(tables: Tables, before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name of every drawn entry, and how it is drawn."""
    for name, value in tables.items():
        if isinstance(value, dict) and not set(value) & set(_WAYS):
            yield from _leaves(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _way(how: Any) -> tuple[str, Any]:
    """Return the way in which an entry is drawn, and the values that it is drawn from."""
    if isinstance(how, dict) and len(how) == 1:
        return next(iter(how.items()))
    return "between", how


def _check_way(name: str, way: str, values: Any) -> None:
    """Refuse values that nothing can be drawn from."""
    if way == "one_of":
        if isinstance(values, list) and values:
            return
        raise ValueError(f"{name} must have values in one_of, got {values!r}")
    is_pair = isinstance(values, list) and len(values) == 2
    numbers = is_pair and all(isinstance(value, int | float) for value in values)
    if way not in _WAYS or not numbers or not values[0] <= values[1]:
        raise ValueError(
            f"{name} must be [least, greatest], {{ ratio = [least, greatest] }} or "
            f"{{ one_of = [...] }}, got {values!r}"
        )
    if way == "ratio" and not values[0] > 0:
        raise ValueError(f"{name} must have ratios of values over zero, got {values!r}")


def _draw(how: Any, rng: np.random.Generator) -> Value:
    """Draw a value."""
    way, values = _way(how)
    if way == "one_of":
        return values[int(rng.integers(len(values)))]
    least, greatest = values
    if way == "ratio":
        return float(least * (greatest / least) ** rng.random())
    return float(rng.uniform(least, greatest))
