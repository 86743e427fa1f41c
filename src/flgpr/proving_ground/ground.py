"""What the proving ground is: lanes, the part each plays, and splits, from a description of a few kilobytes."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import pandas as pd
from pydantic import Field, ValidationError, model_validator

from flgpr.chain.stages import Positive, Table
from flgpr.door import parse_toml, read_named
from flgpr.execution.simulated_lane import simulate_to_store
from flgpr.model import Lane, Sensor, load_sensor
from flgpr.model.faults import describe_fault
from flgpr.simulate import Scene, draw_world
from flgpr.store import lane_text, merge_tables, open_run, read_table, sample_lane, write_whole
from flgpr.store.files import existing, faults_of

GROUNDS = ("proving-ground-2", "proving-ground-1", "full-wave-1")
"""The packaged descriptions, the first by default."""
ALL_TIERS = "all"
"""What stands for every tier where one may be chosen."""
MINES = "mines"
"""Name of the group of all mines in the scores."""
BODY = "body "
"""What stands before the name of a packaged body in the names of groups."""


class LaneRow(Table):
    """Lanes of one design: what they are for, how many at which sites, what lies in them, what differs from the rest.

    ``targets`` are sort, depth of the top (m) and number; ``surface`` and ``errors`` change entries
    of the scene's surface and of the sensor's errors, ``sensor`` entries of the sensor. A lane that
    is there already has a ``run`` store, its ``truth`` and its borders x_min, x_max, y_min, y_max
    (m) instead; "sample" is the packaged full-wave one.
    """

    part: Literal["train", "validate", "test"]
    sites: tuple[str, ...] = ()
    copies: Annotated[int, Field(ge=1)] = 1
    length: Positive = 1.0
    targets: tuple[tuple[str, float, int], ...] = ()
    run: str = ""
    truth: str = ""
    borders: tuple[float, float, float, float] | None = None
    surface: dict[str, float] = Field(default_factory=dict)
    sensor: dict[str, float] = Field(default_factory=dict)
    errors: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _told(self) -> LaneRow:
        if bool(self.run) != (self.borders is not None) or bool(self.run) != bool(self.truth):
            raise ValueError("run, truth and borders must be given together")
        return self


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


class TierRow(Table):
    """Sites at which all lanes of the ground are laid out, under names that every tier has.

    ``surface`` changes entries of the scene's surface, by design of the lanes, after those of the
    design itself.
    """

    title: str
    sites: dict[str, str]
    surface: dict[str, dict[str, float]] = Field(default_factory=dict)


class Description(Table):
    """The description, as its file has it; in what it means its comments say more."""

    name: str
    version: int
    sensor: str
    recipe: str = ""  #: stands in for the packaged entries' wang2007, the others do not enter then
    halo: float
    fars: tuple[float, ...]
    far: float
    reference: str
    scene: dict[str, Any]
    sites: dict[str, str] = Field(default_factory=dict)  #: of a ground without tiers
    tiers: dict[str, TierRow] = Field(
        default_factory=dict
    )  #: grounds of the same design at other sites, scored apart
    sorts: dict[str, dict[str, str]]
    lanes: dict[str, LaneRow]
    splits: dict[str, SplitRow]

    @model_validator(mode="after")
    def _check_tiers(self) -> Description:
        if bool(self.sites) == bool(self.tiers):
            raise ValueError("sites must be given, or tiers that have their own, and not both")
        names = {tuple(row.sites) for row in self.tiers.values()}
        if len(names) > 1:
            raise ValueError(
                "tiers must name the same sites in the same order, so that they are of one design"
            )
        for name, row in self.tiers.items():
            strange = sorted(set(row.surface) - set(self.lanes))
            if strange:
                raise ValueError(
                    f"surface of the tier {name} must name designs of lanes, got "
                    f"{', '.join(strange)}"
                )
        if ALL_TIERS in self.tiers:
            raise ValueError(
                f"tiers must not be called {ALL_TIERS!r}, which stands for every one of them"
            )
        return self


@dataclass(frozen=True)
class GroundLane:
    """A lane of the ground: what is to be simulated, or a run store and its truth that are there."""

    name: str  #: tier if the ground has tiers, site, design and number
    site: str  #: the site's name on the ground
    part: str  #: "train", "validate" or "test"; the truth of the last is sealed
    lane: Lane  #: its borders
    seed: int  #: of everything random in it
    scene: Scene = field(repr=False)  #: what is there; of a stored lane nothing is told
    sensor: Sensor = field(repr=False)  #: what sees it
    stored: tuple[Path, Path] | None = None  #: run store and truth of a lane that is there
    tier: str = ""  #: the tier it belongs to, if the ground has tiers

    @property
    def name_in_tier(self) -> str:
        """Site, design and number, the same in every tier: what the patterns of splits are compared with."""
        return self.name.removeprefix(f"{self.tier}-") if self.tier else self.name

    @property
    def empty(self) -> bool:
        """Whether it has no targets."""
        return self.stored is None and not self.scene.draws

    @property
    def length(self) -> float:
        """Its length, m."""
        return self.lane.y_max - self.lane.y_min

    def truth(self) -> pd.DataFrame:
        """Make the table of its targets."""
        return (
            draw_world(self.scene, self.seed).truth()
            if self.stored is None
            else read_table(self.stored[1], "truth")
        )

    def truth_with_bodies(self) -> pd.DataFrame:
        """Make the table of its targets with the packaged ``body`` of each, empty for a generic mine of its kind."""
        truth = self.truth()
        if self.stored is not None:
            return truth.assign(body="")
        # Targets are named by their number in the world, from T001 on; those outside the lane are
        # not in the table.
        numbers = truth["target_id"].str.removeprefix("T").astype(int) - 1
        targets = draw_world(self.scene, self.seed).targets
        return truth.assign(body=[targets[number].body or "" for number in numbers])

    def make(self, store: Path) -> None:
        """Simulate it into a run store, or link the one that is there."""
        if self.stored is None:
            simulate_to_store(self.scene, self.sensor, self.seed, store, blind=True)
        else:
            open_run(self.stored[0])  # refuses what is none
            write_whole(store.with_name(f"{store.stem}-lane.toml"), lane_text(self.lane))
            store.symlink_to(self.stored[0].resolve(), target_is_directory=True)


@dataclass(frozen=True)
class Ground:
    """A proving ground, or one tier of it: its description, and whether it is the quick form."""

    table: Description
    quick: bool
    text: str = field(repr=False)  #: what it was read from
    tier: str = ""  #: the tier whose lanes alone it has; empty for all lanes

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.table.name}-{self.table.version}" + ("-quick" if self.quick else "")

    @property
    def sites(self) -> tuple[str, ...]:
        """Names of the sites, which are the same in every tier."""
        if not self.table.tiers:
            return tuple(self.table.sites)
        first_tier = next(iter(self.table.tiers.values()))
        return tuple(first_tier.sites)

    @property
    def tier_title(self) -> str:
        """What the tier is, empty for a ground without tiers."""
        return self.table.tiers[self.tier].title if self.tier else ""

    def chosen_tiers(self, chosen: str | None = None) -> list[Ground]:
        """Give the tiers, or the one that is chosen, as grounds of their own; one without tiers is its own only one.

        Parameters
        ----------
        chosen : str, optional
            Name of a tier; None or "all" takes every tier.

        Raises
        ------
        ValueError
            If the ground has no tier of that name.
        """
        names = tuple(self.table.tiers) or ("",)
        if chosen in (None, ALL_TIERS):
            return [replace(self, tier=name) for name in names]
        if chosen not in self.table.tiers:
            known = ", ".join((*self.table.tiers, ALL_TIERS))
            raise ValueError(f"tier must be one of those of {self.title}, {known}, got {chosen!r}")
        return [replace(self, tier=chosen)]

    @cached_property
    def lanes(self) -> dict[str, GroundLane]:
        """All lanes by name."""
        return {lane.name: lane for lane in self._make_lanes()}

    def matching(
        self, patterns: tuple[str, ...], without: tuple[str, ...] = ()
    ) -> list[GroundLane]:
        """Find lanes by patterns of their names, without that of the tier, in the ground's order."""

        def fits(lane: GroundLane, some: tuple[str, ...]) -> bool:
            return any(fnmatchcase(lane.name_in_tier, pattern) for pattern in some)

        return [
            lane for lane in self.lanes.values() if fits(lane, patterns) and not fits(lane, without)
        ]

    def tested(self, split: str) -> list[GroundLane]:
        """List the lanes that a split is scored on."""
        return [
            lane for fold in self.table.splits[split].folds for lane in self.matching(fold.test)
        ]

    def _make_lanes(self) -> Iterator[GroundLane]:
        preset = load_sensor(self.table.sensor)
        for tier, sites in self._sites_by_tier().items():
            for site, (design, row) in itertools.product(sites, self.table.lanes.items()):
                if row.sites and site not in row.sites:
                    continue
                prefix = f"{tier}-{site}-{design}" if tier else f"{site}-{design}"
                if row.borders is not None:
                    yield _stored_lane(f"{prefix}-1", site, tier, row, preset)
                    continue
                scene = self._scene(sites[site], row, self._tier_surface(tier, design))
                sensor = _changed_sensor(preset, row)
                for number in range(1, row.copies + 1):
                    name = f"{prefix}-{number}"
                    seed = zlib.crc32(f"{self.title} {name}".encode())
                    named = scene.model_copy(update={"name": name})
                    yield GroundLane(
                        name, site, row.part, scene.lane, seed, named, sensor, tier=tier
                    )

    def _sites_by_tier(self) -> dict[str, dict[str, str]]:
        """Give the packaged sites by their names on the ground, for the tiers whose lanes it has."""
        if not self.table.tiers:
            return {"": self.table.sites}
        return {
            name: row.sites for name, row in self.table.tiers.items() if self.tier in ("", name)
        }

    def _tier_surface(self, tier: str, design: str) -> dict[str, float]:
        """Entries of the surface that a tier changes in lanes of a design."""
        return self.table.tiers[tier].surface.get(design, {}) if tier else {}

    def _scene(self, site: str, row: LaneRow, tier_surface: dict[str, float]) -> Scene:
        """Put what a design lays onto a packaged site."""
        table = self.table
        unknown = {sort for sort, _, _ in row.targets} - set(table.sorts)
        if unknown:
            raise ValueError(
                f"targets must be of a sort that is described, got {', '.join(sorted(unknown))}"
            )
        draws = [
            {**table.sorts[sort], "depth": depth, "count": count}
            for sort, depth, count in row.targets
        ]
        surface = {**table.scene.get("surface", {}), **row.surface, **tier_surface}
        own = {"site": site, "length": row.length, "draws": draws, "surface": surface}
        return Scene.model_validate({**table.scene, **own})


def _stored_lane(name: str, site: str, tier: str, row: LaneRow, preset: Sensor) -> GroundLane:
    """Make a lane of a run store and a truth that are there."""
    if row.borders is None:
        raise ValueError(f"lane {name} must have borders, for it is one that is there already")
    files = sample_files() if row.run == "sample" else (Path(row.run), Path(row.truth))
    return GroundLane(name, site, row.part, Lane(*row.borders), 0, Scene(), preset, files, tier)


def _changed_sensor(preset: Sensor, row: LaneRow) -> Sensor:
    """Change the entries of the sensor and of its errors that a design names."""
    entries = preset.model_dump()
    return Sensor.model_validate(
        {**entries, **row.sensor, "errors": entries["errors"] | row.errors}
    )


def sample_files() -> tuple[Path, Path]:
    """Run store and truth of the packaged full-wave lane."""
    return sample_lane() / "run.zarr", sample_lane() / "truth.csv"


def load_ground(quick: bool = False, source: str | Path | None = None) -> Ground:
    """Read a packaged description, or one of your own from a file, or its text; one not valid is a ValueError.

    The quick form has the sites of the table ``quick``, of each tier if there are tiers, and the
    lanes and splits that it names, some of them its own, with its entries laid over theirs.
    """
    name = GROUNDS[0] if source is None else str(source)
    if isinstance(source, str) and name not in GROUNDS:
        text = source
    else:
        packaged = resources.files("flgpr.proving_ground") / f"{name}.toml"
        with faults_of(name):
            text = (
                packaged.read_text("utf-8")
                if name in GROUNDS
                else read_named(existing(name, "proving ground")).decode("utf-8")
            )
    with faults_of(name if isinstance(source, Path) else "ground"):
        data = parse_toml(text)
    over = data.pop("quick", {})
    if quick and not over:
        raise ValueError(
            f"quick must be asked of a ground that has such a form, got {data.get('name')}"
        )
    if quick:
        data = _quick_form(data, over)
    try:
        return Ground(Description.model_validate(data), quick, text)
    except ValidationError as error:
        faults = "; ".join(describe_fault(one, Description, "ground") for one in error.errors())
        raise ValueError(faults) from None


def _quick_form(data: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Lay the table ``quick`` over a description: the lanes and splits that it names alone, and its sites."""
    for part in ("lanes", "splits"):
        data[part] = {
            name: data[part].get(name, {}) | entries for name, entries in over.pop(part, {}).items()
        }
    if "sites" in over:
        data["sites"] = over.pop("sites")
    for tier, entries in over.pop("tiers", {}).items():
        data["tiers"][tier] = data["tiers"].get(tier, {}) | entries
    for row in data.get("tiers", {}).values():
        surface = row.get("surface", {})
        row["surface"] = {
            design: entries for design, entries in surface.items() if design in data["lanes"]
        }
    return merge_tables(data, over)
