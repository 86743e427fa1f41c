"""Worlds in which the papers' statements are asked again, the arid site with four things varied; lanes seen again."""

from __future__ import annotations

import itertools
import json
import math
import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from scipy.optimize import brentq

from flgpr.io import write_whole
from flgpr.simulate import Scene, soil, told
from flgpr.simulate.scene import site_tables

_DECLARED = tomllib.loads((resources.files("flgpr_papers") / "worlds.toml").read_text(encoding="utf-8"))
AXES: dict[str, list[Any]] = _DECLARED["axes"]
"""Values of every axis by its name, declared before anything was run."""


@dataclass(frozen=True)
class World:
    """A place in the space of soil and roadside."""

    number: int  #: of the world; its lanes are drawn from seeds of their own
    permittivity: float  #: ε' at 1 GHz
    loss: str  #: "mironov", that of the soil model at the moisture which gives the permittivity, or "low", tan δ = 0.01
    roughness: float  #: rms height of the surface, mm
    roadside: str  #: "none", "posts" or "bushes"

    @property
    def name(self) -> str:
        """A name that can be a folder's."""
        return f"e{self.permittivity:g}-{self.loss}-{self.roughness:g}mm-{self.roadside}"

    @property
    def roadside_density(self) -> dict[str, float]:
        """Bushes and posts per metre of lane."""
        return {kind: float(_DECLARED["roadside"][kind]) * (kind == self.roadside) for kind in ("bushes", "posts")}

    def moisture(self) -> float:
        """Volumetric moisture at which the soil model has the permittivity."""
        clay = _DECLARED["soil"]["clay"]
        return float(brentq(lambda m: soil.mironov([1e9], clay, m)[0].real - self.permittivity, 0.0, 0.5))

    def site(self, folder: Path) -> str:
        """Write the world as a site of scenes; gives the file's path."""
        tables = site_tables(_DECLARED["site"])
        own = {"model": "mironov", "moisture": round(self.moisture(), 5), **_DECLARED["soil"]}
        tables["soil"] = own | ({"loss_tangent": _DECLARED["low_loss"]} if self.loss == "low" else {})
        tables["surface"]["rms_height"] = self.roughness / 1000
        tables["clutter"] |= self.roadside_density
        lines = []
        for name, table in tables.items():
            lines += [f"[{name}]", *(f"{entry} = {json.dumps(value)}" for entry, value in table.items()), ""]
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.name}.toml"
        write_whole(path, "\n".join(lines))
        return str(path)


def smooth_worlds() -> list[World]:
    """Worlds of the experiment beside the map, with numbers of their own."""
    told = dict(_DECLARED["smooth"])
    first, count = len(worlds()), told.pop("lanes")
    return [World(first + k, **told) for k in range(count)]


def worlds() -> list[World]:
    """All worlds of the declared axes."""
    return [World(number, *values) for number, values in enumerate(itertools.product(*AXES.values()))]


def turned(scene: Scene, seed: int) -> Scene:
    """Turn a lane by half a turn with all that the seed put there, targets in order, as seen from the other end."""
    data = told(scene, seed)
    for thing in (*data["targets"], *data["objects"], *data["patches"]):
        thing["x"], thing["y"] = -thing["x"], scene.length - thing["y"]
        if "azimuth" in thing:
            thing["azimuth"] += math.pi
    return Scene.model_validate(data)


def changed(scene: Scene, targets: list[Any] | None = None, **parts: dict[str, Any]) -> Scene:
    """Make a scene anew with some entries of its parts replaced."""
    data = scene.model_dump(exclude_unset=True)
    for part, entries in parts.items():
        data[part] = {**data.get(part, {}), **entries}
    return Scene.model_validate(data if targets is None else data | {"targets": targets})
