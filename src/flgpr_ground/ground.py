"""What the proving ground is: lanes and splits, from a description of a few kilobytes."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import Field, ValidationError, model_validator

from flgpr.door import read_named
from flgpr.jobs.simulated_lane import simulate_to_store
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import engine_of
from flgpr.model import Lane, Sensor, load_sensor
from flgpr.model.bounds import AtLeastOne
from flgpr.model.faults import describe_fault, faults_of, listed_faults
from flgpr.recipe.schema import parse_recipe
from flgpr.simulate import Scene, draw_world
from flgpr.stages import Positive, Table
from flgpr.store import (
    SAMPLE_LANES,
    lane_text,
    merge_tables,
    open_run,
    read_table,
    sample_lane,
    write_whole,
)
from flgpr.store.files import existing
from flgpr.store.lane_file import lane_file_of
from flgpr.store.tables import read_table_in
from flgpr.toml_text import parse_toml
from flgpr.types import Entries, floats

GROUNDS = ("proving-ground-2", "proving-ground-1", "full-wave-2", "full-wave-1")
"""The packaged descriptions, the first by default."""
ALL_TIERS = "all"
"""The name that chooses every tier."""
MINES = "mines"
"""Name of the group of all mines in the scores."""
BODY = "body "
"""Prefix of the groups of targets with one packaged body."""
Score = Mapping[Any, Any]
"""A row of a table of scores or costs, by its columns."""
SAMPLE = "sample"
"""What stands in place of paths for a packaged full-wave lane, alone or before "/" and its name."""


class LaneRow(Table):
    """Lanes of one design: what they are for, how many at which sites, and what lies in them.

    ``targets`` are sort, depth of the top (m) and number. ``soil``, ``surface``, ``errors`` and
    ``sensor`` change entries of the scene's soil and surface, of the sensor's errors and of the
    sensor. A lane that is there already has a ``run`` store, its ``truth`` and its borders x_min,
    x_max, y_min, y_max (m) instead; "sample/NAME" is a packaged full-wave lane, "sample" the first.
    """

    part: Literal["train", "validate", "test"]
    sites: tuple[str, ...] = ()
    copies: AtLeastOne = 1
    length: Positive = 1.0
    targets: tuple[tuple[str, float, int], ...] = ()
    run: str = ""
    truth: str = ""
    borders: tuple[float, float, float, float] | None = None
    soil: dict[str, float] = Field(default_factory=dict)
    surface: dict[str, float] = Field(default_factory=dict)
    sensor: dict[str, float] = Field(default_factory=dict)
    errors: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _complete(self) -> LaneRow:
        """Refuse a stored lane that lacks one of its entries."""
        if bool(self.run) != (self.borders is not None) or bool(self.run) != bool(self.truth):
            raise ValueError("run, truth and borders must be given together")
        name = self.packaged_lane
        if (name is not None) != (self.truth == SAMPLE):
            raise ValueError(
                'truth must be "sample" for a packaged lane, whose run is "sample" or '
                f'"sample/NAME", and for no other, got {self.truth} for {self.run}'
            )
        if name is not None and name not in SAMPLE_LANES:
            known = ", ".join(SAMPLE_LANES)
            raise ValueError(f"run must be sample/ and one of {known}, got {self.run}")
        return self

    @property
    def packaged_lane(self) -> str | None:
        """Name of the packaged full-wave lane that it takes; None for any other lane."""
        if self.run == SAMPLE:
            return SAMPLE_LANES[0]
        prefix = f"{SAMPLE}/"
        return self.run.removeprefix(prefix) if self.run.startswith(prefix) else None


class Fold(Table):
    """Patterns of the names of lanes to train on and to test on.

    Lanes that match a pattern of ``without`` are not trained on.
    """

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
    """The description, as its file has it; the comments of the file say what its entries mean."""

    name: str
    version: int
    sensor: str
    #: those of the sensor's polarizations that are recorded; all of them if none is named
    polarization: tuple[str, ...] = ()
    #: recipe in place of wang2007 of the packaged entries, of which no others enter then
    recipe: str = ""
    #: texts that stand once in that recipe, and what replaces each
    replace: tuple[tuple[str, str], ...] = ()
    #: the packaged entries that enter; all that fit if none is named
    entries: tuple[str, ...] = ()
    halo: float
    fars: tuple[float, ...]
    far: float
    reference: str
    scene: Entries
    sites: dict[str, str] = Field(default_factory=dict)  #: of a ground without tiers
    #: grounds of the same design at other sites, scored apart
    tiers: dict[str, TierRow] = Field(default_factory=dict)
    sorts: dict[str, dict[str, str]]
    lanes: dict[str, LaneRow]
    splits: dict[str, SplitRow]

    @model_validator(mode="after")
    def _check_tiers(self) -> Description:
        """Refuse tiers that are not of one design."""
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
class LaneData:
    """A lane of a proving ground; what it holds is read when it is asked for."""

    name: str  #: its name on the ground
    site: str  #: name of its site
    part: str  #: "train", "validate" or "test"; the truth of the last is sealed
    lane: Lane  #: its borders, m in the lane frame
    folder: Path = field(repr=False)  #: has the lanes of the ground
    recipe: str = field(repr=False)  #: TOML text of the recipe that makes the image

    @cached_property
    def run(self) -> xr.Dataset:
        """The run: ``signal`` (scan, polarization, pair, frequency), positions and poses."""
        return open_run(self.folder / f"{self.name}.zarr")

    @cached_property
    def image(self) -> xr.DataArray:
        """The run-view (polarization, subband, y, x) in the lane frame, over the background."""
        setup = ImagedRun(self.run, parse_recipe(self.recipe), self.lane, explains=False)
        engine = engine_of(setup)
        engine.run(names=list(engine.passes)[: list(engine.passes).index("view") + 1])
        return setup.view()

    @property
    def truth(self) -> pd.DataFrame:
        """The targets: ``x``, ``y`` (m), ``kind``, ``depth`` (m), ``target_id``.

        Raises
        ------
        ValueError
            If the lane is one to test on.
        """
        if self.part == "test":
            raise ValueError(f"truth must be of a training lane, got {self.name}, which is sealed")
        return read_table_in(self.folder, f"{self.name}-truth.csv", "truth")


@dataclass(frozen=True)
class GroundLane:
    """A lane of the ground: a scene that is simulated, or a run store with its truth."""

    name: str  #: tier if the ground has tiers, site, design and number
    site: str  #: the site's name on the ground
    part: str  #: "train", "validate" or "test"; the truth of the last is sealed
    lane: Lane  #: its borders
    seed: int  #: of everything random in it
    scene: Scene = field(repr=False)  #: what is there; empty for a stored lane
    sensor: Sensor = field(repr=False)  #: what sees it
    stored: tuple[Path, Path] | None = None  #: run store and truth of a lane that is there
    tier: str = ""  #: the tier it belongs to, if the ground has tiers

    @property
    def name_in_tier(self) -> str:
        """Site, design and number, the same in every tier.

        The patterns of splits match this name.
        """
        return self.name.removeprefix(f"{self.tier}-")

    @property
    def empty(self) -> bool:
        """Whether it has no targets."""
        return self.stored is None and not self.scene.draws

    @property
    def length(self) -> float:
        """Its length, m."""
        return self.lane.y_max - self.lane.y_min

    def data(self, folder: Path, recipe: str) -> LaneData:
        """Return it as it lies in a folder, with the recipe (TOML text) of its image."""
        return LaneData(self.name, self.site, self.part, self.lane, folder, recipe)

    def truth(self) -> pd.DataFrame:
        """Return the table of its targets."""
        if self.stored is None:
            return draw_world(self.scene, self.seed).truth()
        return read_table(self.stored[1], "truth")

    def truth_with_bodies(self) -> pd.DataFrame:
        """Return the table of its targets with the ``body`` of each.

        It is that of the scene or of the file, and empty for a generic mine of its kind.
        """
        truth = self.truth()
        if self.stored is not None:
            return truth if "body" in truth else truth.assign(body="")
        # Targets are named by their number in the world, from T001 on; those outside the lane are
        # not in the table.
        numbers = truth["target_id"].str.removeprefix("T").astype(int) - 1
        targets = draw_world(self.scene, self.seed).targets
        return truth.assign(body=[targets[number].body or "" for number in numbers])

    def make(self, store: Path) -> None:
        """Simulate it into a run store, or link the store that is there."""
        if self.stored is None:
            simulate_to_store(self.scene, self.sensor, self.seed, store, blind=True)
        else:
            open_run(self.stored[0])  # refuses what is no run store
            write_whole(lane_file_of(store), lane_text(self.lane))
            store.symlink_to(self.stored[0].resolve(), target_is_directory=True)


@dataclass(frozen=True)
class Ground:
    """A proving ground, or one tier of it."""

    table: Description  #: its description
    quick: bool  #: whether it is the quick form
    text: str = field(repr=False)  #: the TOML text that it was read from
    tier: str = ""  #: the tier whose lanes alone it has; empty for all lanes

    @property
    def title(self) -> str:
        """Name and version."""
        return f"{self.table.name}-{self.table.version}" + ("-quick" if self.quick else "")

    @property
    def sites(self) -> tuple[str, ...]:
        """Names of the sites, which are the same in every tier."""
        rows = list(self.table.tiers.values())
        return tuple(rows[0].sites if rows else self.table.sites)

    @property
    def tier_title(self) -> str:
        """What the tier is, empty for a ground without tiers."""
        return self.table.tiers[self.tier].title if self.tier else ""

    def chosen_tiers(self, chosen: str | None = None) -> list[Ground]:
        """Return the tiers, or the chosen one, as grounds; without tiers, the ground itself.

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

    @property
    def stored_lane_count(self) -> int:
        """How many of its lanes are run stores that were there already."""
        return sum(lane.stored is not None for lane in self.lanes.values())

    def matching(
        self, patterns: tuple[str, ...], without: tuple[str, ...] = ()
    ) -> list[GroundLane]:
        """Return the lanes whose names match patterns, in the ground's order.

        Parameters
        ----------
        patterns : tuple of str
            Patterns of names without that of the tier.
        without : tuple of str
            Patterns of lanes to leave out.
        """
        lanes = []
        for lane in self.lanes.values():
            found, left_out = (
                any(fnmatchcase(lane.name_in_tier, pattern) for pattern in names)
                for names in (patterns, without)
            )
            if found and not left_out:
                lanes.append(lane)
        return lanes

    def tested(self, split: str) -> list[GroundLane]:
        """Return the lanes that a split is scored on."""
        folds = self.table.splits[split].folds
        return [lane for fold in folds for lane in self.matching(fold.test)]

    def _make_lanes(self) -> Iterator[GroundLane]:
        """Yield all lanes: tier by tier, site by site, design by design."""
        preset = load_sensor(self.table.sensor)
        if self.table.polarization:
            recorded = {"polarization": self.table.polarization}
            preset = Sensor.model_validate({**preset.model_dump(), **recorded})
        table = self.table
        without_tiers = {"": TierRow(title="", sites=table.sites)}
        for tier, of_tier in (table.tiers or without_tiers).items():
            if self.tier not in ("", tier):
                continue
            for site, (design, row) in itertools.product(of_tier.sites, table.lanes.items()):
                if row.sites and site not in row.sites:
                    continue
                prefix = f"{tier}-{site}-{design}" if tier else f"{site}-{design}"
                if row.borders is not None:
                    lane = Lane(*row.borders)
                    stored = (Path(row.run), Path(row.truth))
                    if row.packaged_lane is not None:
                        folder = sample_lane(row.packaged_lane)
                        stored = (folder / "run.zarr", folder / "truth.csv")
                    yield GroundLane(
                        f"{prefix}-1", site, row.part, lane, 0, Scene(), preset, stored, tier
                    )
                    continue
                scene = self._scene(of_tier.sites[site], row, of_tier.surface.get(design, {}))
                entries = preset.model_dump()
                entries |= {**row.sensor, "errors": entries["errors"] | row.errors}
                sensor = Sensor.model_validate(entries)
                for number in range(1, row.copies + 1):
                    name = f"{prefix}-{number}"
                    seed = zlib.crc32(f"{self.title} {name}".encode())
                    own_scene = scene.model_copy(update={"name": name})
                    yield GroundLane(
                        name, site, row.part, scene.lane, seed, own_scene, sensor, tier=tier
                    )

    def _scene(self, site: str, row: LaneRow, tier_surface: dict[str, float]) -> Scene:
        """Return the scene of a design at a packaged site."""
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
        entries = {"site": site, "length": row.length, "draws": draws, "surface": surface}
        if row.soil:
            entries["soil"] = {**table.scene.get("soil", {}), **row.soil}
        return Scene.model_validate({**table.scene, **entries})


def in_tier(alarms: pd.DataFrame, tier: Ground) -> pd.DataFrame:
    """Return the alarms, by their column ``lane``, in the lanes of a tier.

    On a ground without tiers these are all alarms.
    """
    if not tier.tier:
        return alarms
    return alarms[alarms["lane"].isin(tier.lanes)].reset_index(drop=True)


def load_ground(quick: bool = False, source: str | Path | None = None) -> Ground:
    """Read a description of a proving ground.

    Parameters
    ----------
    quick : bool
        Whether to return the quick form. It has the sites of the table ``quick``, of each tier if
        there are tiers, and the lanes and splits that it names, some of them its own, with its
        entries laid over theirs.
    source : str or path, optional
        Name of a packaged description, by default the first; a file; or the text itself, which has
        several lines.

    Returns
    -------
    Ground
        The ground with all of its tiers.

    Raises
    ------
    ValueError
        If the description is not valid, or has no quick form.
    """
    name = GROUNDS[0] if source is None else str(source)
    if name in GROUNDS:
        text = packaged_text(f"{name}.toml")
    elif "\n" in name:
        name, text = "ground", name
    else:
        with faults_of(name):
            text = read_named(existing(name, "proving ground")).decode("utf-8")
    with faults_of(name):
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
        faults = listed_faults(error, lambda fault: describe_fault(fault, Description, "ground"))
        raise ValueError("; ".join(faults)) from None


def packaged_text(name: str) -> str:
    """Return a text file of the package."""
    with faults_of(name):
        return (resources.files("flgpr_ground") / name).read_text("utf-8")


def _quick_form(data: Entries, over: Entries) -> Entries:
    """Lay the table ``quick`` over a description, of which only what the table names stays."""
    for table in ("lanes", "splits"):
        rows = over.pop(table, {})
        data[table] = {name: data[table].get(name, {}) | rows[name] for name in rows}
    data["sites"] = over.pop("sites", data.get("sites", {}))
    for tier, entries in over.pop("tiers", {}).items():
        data["tiers"][tier] = data["tiers"].get(tier, {}) | entries
    for row in data.get("tiers", {}).values():
        surface = row.get("surface", {})
        row["surface"] = {name: surface[name] for name in surface if name in data["lanes"]}
    return merge_tables(data, over)


def opening_split(ground: Ground) -> str:
    """Name the split that the opening figure shows, the first."""
    return next(iter(ground.table.splits))


def scores_at(
    scores: pd.DataFrame,
    ground: Ground,
    split: str,
    group: str | None = MINES,
    far: float | None = None,
) -> pd.DataFrame:
    """Return the scores of a ground, or of one of its tiers, in a split at an allowed FAR.

    Parameters
    ----------
    scores : pandas.DataFrame
        What :func:`flgpr.proving_ground.score_entries` gives.
    ground : Ground
        The ground, or one of its tiers, whose scores are chosen.
    split : str
        Name of the split.
    group : str or None
        The group of targets: all mines by default, a site, a kind or a body; None for all groups.
    far : float, optional
        The allowed FAR, per m²; by default that of comparison.

    Returns
    -------
    pandas.DataFrame
        A row per entry, and per group or tier where none is chosen.
    """
    allowed = ground.table.far if far is None else far
    # A FAR that was written to a table and read again may differ in its last digit.
    is_chosen = np.isclose(floats(scores["far_allowed"]), allowed) & (scores["split"] == split)
    if group is not None:
        is_chosen &= scores["group"] == group
    if ground.tier:
        is_chosen &= scores["tier"] == ground.tier
    return scores[is_chosen]


def by_pd(scores: pd.DataFrame) -> pd.DataFrame:
    """Return scores with the largest Pd first."""
    return scores.sort_values("pd", ascending=False, kind="stable")
