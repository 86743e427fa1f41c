"""Worlds in which mines are looked for: a prepared lane with six axes varied."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.optimize import brentq

from flgpr.simulate.ground import soil
from flgpr.simulate.scene.scene import Soil, site_tables
from flgpr.store import write_whole
from flgpr.toml_text import toml_lines

_FILES = Path(__file__).parent
DECLARED: dict[str, Any] = tomllib.loads((_FILES / "worlds.toml").read_text(encoding="utf-8"))
"""Axes, lanes and parts of the map of worlds, declared before anything was run."""
AXES: dict[str, list[Any]] = DECLARED["axes"]
"""Levels of every axis by its name."""
IN_SOIL = ("stones", "roots", "lenses", "heterogeneity", "holes")
"""Tables of a site that say what is in the soil; rocks and wet patches on it go with them."""
_ON_SOIL = ("rocks", "patches")


@dataclass(frozen=True)
class World:
    """A point in the space of soil, surface, roadside and mines.

    The names of the fields are part of the keys of records on disk.
    """

    number: int  #: of the world; its lanes are drawn from seeds of their own
    roughness: float  #: rms height of the surface, mm
    permittivity: float  #: ε' at 1 GHz
    #: "mironov", that of the soil model at the moisture which gives the permittivity, or "low"
    loss: str
    contents: str  #: what is in the soil: "nothing", "prepared" or "natural", that of a site
    roadside: str  #: "none", "posts" or "bushes"
    mines: str  #: mix that stands for plastic mines, see :mod:`flgpr_papers.kit.mines`
    replicate: int = 0  #: 1 for a world that comes a second time, with seeds of its own

    @property
    def name(self) -> str:
        """A name that can be a folder's."""
        soil_and_surface = f"{self.roughness:g}mm-e{self.permittivity:g}-{self.loss}"
        return f"{self.number:03d}-{soil_and_surface}-{self.contents}-{self.roadside}-{self.mines}"

    @property
    def roadside_density(self) -> dict[str, float]:
        """Bushes and posts per metre of lane; 0 for what does not stand at the roadside."""
        densities = {}
        for kind in ("bushes", "posts"):
            density = float(DECLARED["roadside"][kind])
            densities[kind] = density if kind == self.roadside else 0.0
        return densities

    def moisture(self) -> float:
        """Return the volumetric moisture at which the soil model has the permittivity."""
        clay = DECLARED["soil"]["clay"]

        def excess(moisture: float) -> float:
            return float(soil.mironov([1e9], clay, moisture)[0].real - self.permittivity)

        return float(brentq(excess, 0.0, 0.5))

    def tables(self) -> dict[str, Any]:
        """Return the world as the tables of a site."""
        tables = site_tables(DECLARED["sites"]["prepared"])
        tables["soil"] = {
            "model": "mironov",
            "clay": DECLARED["soil"]["clay"],
            "moisture": round(self.moisture(), 5),
        }
        if self.loss == "low":
            tables["soil"]["loss_tangent"] = DECLARED["soil"]["low_loss"]
        tables["surface"] = tables.get("surface", {}) | {"rms_height": self.roughness / 1000}
        tables |= in_soil_of(self.contents, self.permittivity)
        clutter = tables.get("clutter", {})
        tables["clutter"] = clutter | on_soil_of(self.contents) | self.roadside_density
        return tables


def design_worlds() -> list[World]:
    """Return all rows of the designed fraction as worlds, repeats too, in their order."""
    text = (_FILES / "worlds.csv").read_text(encoding="utf-8")
    designed = []
    for number, row in enumerate(csv.DictReader(text.splitlines())):
        levels: dict[str, Any] = {}
        for axis, values in AXES.items():
            levels[axis] = type(values[0])(row[axis])
        designed.append(World(number, **levels, replicate=int(row["replicate"])))
    return designed


def in_soil_of(contents: str, permittivity: float) -> dict[str, dict[str, Any]]:
    """Return the tables of what is in the soil: those of a site, or everything off for "nothing".

    Fluctuations of the permittivity are those of the site times ``(ε - 1)`` over that of the site's
    own soil, for packing and moisture change what is not air (assumed).

    Parameters
    ----------
    contents : str
        "nothing", "prepared" or "natural".
    permittivity : float
        ε' of the world's soil at 1 GHz.
    """
    if contents == "nothing":
        return {name: {"on": False} for name in IN_SOIL}
    tables = site_tables(DECLARED["sites"][contents])
    site_permittivity = float(Soil(**tables["soil"]).media([1e9])[-1][0].real)
    scale = (permittivity - 1) / (site_permittivity - 1)
    tables_in_soil = {name: dict(tables.get(name, {})) for name in IN_SOIL}
    for name, entry in (("heterogeneity", "deviation"), ("lenses", "contrast")):
        if entry in tables_in_soil[name]:
            tables_in_soil[name][entry] = round(tables_in_soil[name][entry] * scale, 6)
    return tables_in_soil


def on_soil_of(contents: str) -> dict[str, float]:
    """Return rocks and wet patches per m²: those of a site, or none for "nothing"."""
    clutter: dict[str, Any] = {}
    if contents != "nothing":
        clutter = site_tables(DECLARED["sites"][contents]).get("clutter", {})
    return {name: float(clutter.get(name, 0.0)) for name in _ON_SOIL}


def write_site(path: Path, tables: dict[str, Any]) -> None:
    """Write tables of a site as a TOML file, which is complete or not there at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, "\n".join(toml_lines(tables, {})))
