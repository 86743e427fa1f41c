"""What the proving ground is: lanes, the part each plays, and splits, from a description of a few kilobytes."""

from __future__ import annotations

import itertools
import tomllib
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from flgpr.chain.stages import Positive, Table
from flgpr.model import Sensor, load_sensor
from flgpr.model.faults import describe_fault
from flgpr.simulate import Scene

GROUND = "proving-ground-1"
"""The packaged description."""


class LaneRow(Table):
    """Lanes of one design: what they are for, how many at which sites, what lies in them, what differs from the rest.

    ``targets`` are sort, depth of the top (m) and number; ``surface`` and ``errors`` change entries of the scene's
    surface and of the sensor's errors, ``sensor`` entries of the sensor.
    """

    part: Literal["train", "validate", "test"]
    sites: tuple[str, ...] = ()
    copies: Annotated[int, Field(ge=1)] = 1
    length: Positive
    targets: tuple[tuple[str, float, int], ...]
    surface: dict[str, float] = Field(default_factory=dict)
    sensor: dict[str, float] = Field(default_factory=dict)
    errors: dict[str, float] = Field(default_factory=dict)


class Fold(Table):
    """Patterns of the names of lanes to train on, less those ``without``, and of lanes to test on."""

    train: tuple[str, ...]
    without: tuple[str, ...] = ()
    test: tuple[str, ...]


class SplitRow(Table):
    """Folds whose alarms are scored as one list, on targets of some kinds or of all."""

    title: str
    folds: tuple[Fold, ...]
    kinds: tuple[str, ...] = ()


class Description(Table):
    """The description, as its file has it; in what it means its comments say more."""

    name: str
    version: int
    sensor: str
    halo: float
    fars: tuple[float, ...]
    far: float
    reference: str
    scene: dict[str, Any]
    sites: dict[str, str]
    sorts: dict[str, dict[str, str]]
    lanes: dict[str, LaneRow]
    splits: dict[str, SplitRow]


@dataclass(frozen=True)
class GroundLane:
    """A lane of the ground, ready to be simulated."""

    name: str  #: site, design and number
    site: str  #: the site's name on the ground
    part: str  #: "train", "validate" or "test"; the truth of the last is sealed
    seed: int  #: of everything random in it
    scene: Scene = field(repr=False)  #: what is there
    sensor: Sensor = field(repr=False)  #: what sees it


@dataclass(frozen=True)
class Ground:
    """A proving ground: its description, and whether it is the quick form."""

    table: Description
    quick: bool
    text: str = field(repr=False)  #: what it was read from

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.table.name}-{self.table.version}" + ("-quick" if self.quick else "")

    @cached_property
    def lanes(self) -> dict[str, GroundLane]:
        """All lanes by name."""
        return {lane.name: lane for lane in self._make_lanes()}

    def matching(self, patterns: tuple[str, ...], without: tuple[str, ...] = ()) -> list[GroundLane]:
        """Find lanes by patterns of their names, in the ground's order."""

        def fits(name: str, some: tuple[str, ...]) -> bool:
            return any(fnmatchcase(name, pattern) for pattern in some)

        return [one for name, one in self.lanes.items() if fits(name, patterns) and not fits(name, without)]

    def tested(self, split: str) -> list[GroundLane]:
        """List the lanes that a split is scored on."""
        return [lane for fold in self.table.splits[split].folds for lane in self.matching(fold.test)]

    def _make_lanes(self) -> Iterator[GroundLane]:
        table, preset = self.table, load_sensor(self.table.sensor)
        for site, (design, row) in itertools.product(table.sites, table.lanes.items()):
            if row.sites and site not in row.sites:
                continue
            errors = preset.errors.model_copy(update=row.errors)
            sensor = preset.model_copy(update={**row.sensor, "errors": errors})
            unknown = {sort for sort, _, _ in row.targets} - set(table.sorts)
            if unknown:
                raise ValueError(f"targets must be of a sort that is described, got {', '.join(sorted(unknown))}")
            draws = [{**table.sorts[sort], "depth": depth, "count": count} for sort, depth, count in row.targets]
            surface = {**table.scene.get("surface", {}), **row.surface}
            for number in range(1, row.copies + 1):
                name = f"{site}-{design}-{number}"
                parts = {"name": name, "site": table.sites[site], "length": row.length, "draws": draws}
                scene = Scene.model_validate({**table.scene, **parts, "surface": surface})
                yield GroundLane(name, site, row.part, zlib.crc32(f"{self.title} {name}".encode()), scene, sensor)


def load_ground(quick: bool = False, source: str | Path | None = None) -> Ground:
    """Read the packaged description, or one of your own from a file, or its text; one not valid is a ValueError.

    The quick form has the sites of the table ``quick`` and the lanes and splits that it names, some of them its own,
    with its entries laid over theirs.
    """
    place = resources.files("flgpr.benchmark") / f"{GROUND}.toml" if source is None else source
    text = place if isinstance(place, str) else place.read_text("utf-8")
    data = tomllib.loads(text)
    over = data.pop("quick", {})
    if quick:
        for part in ("lanes", "splits"):
            data[part] = {name: data[part].get(name, {}) | entries for name, entries in over.pop(part, {}).items()}
        data["sites"] = over.pop("sites", data["sites"])
        data = _laid_over(data, over)
    try:
        return Ground(Description.model_validate(data), quick, text)
    except ValidationError as error:
        faults = "; ".join(describe_fault(one, Description, "ground") for one in error.errors())
        raise ValueError(faults) from None


def _laid_over(data: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Lay entries of nested tables over others."""
    both = {
        key: _laid_over(data[key], value) if isinstance(value, dict) and isinstance(data.get(key), dict) else value
        for key, value in over.items()
    }
    return {**data, **both}
