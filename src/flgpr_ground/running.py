"""Running detectors on the proving ground: trained on some lanes, frozen, and tried on others."""

from __future__ import annotations

import itertools
import json
import math
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from flgpr.door import Folder, refuse_links
from flgpr.jobs.job import LaneJob, code_versions, make_job
from flgpr.jobs.survey import detect_survey
from flgpr.jobs.training import train_on_lanes
from flgpr.jobs.workers import DEFAULTS, Report, RunOptions
from flgpr.method.classifier import feature_values, make_training_set
from flgpr.recipe.schema import parse_recipe
from flgpr.stages.too_few import check_classes
from flgpr.store import sha256, write_table, write_whole
from flgpr.store.lane_file import lane_file_of
from flgpr.store.tables import parse_columns, read_table_in
from flgpr.types import Entries
from flgpr_ground.card import CARD
from flgpr_ground.entries import ORACLES, Entry, find_entry, packaged_entries
from flgpr_ground.ground import Ground, GroundLane, in_tier, load_ground
from flgpr_ground.lanes import begin_folder, make_lanes
from flgpr_ground.own import OwnDetector

T = TypeVar("T")

ALARMS = "alarms.csv"
COSTS = "costs.json"
ABOUT = "entry.json"
Costs = dict[str, dict[str, float]]
"""Processor seconds and peak bytes by lane, and of every training."""


def read_costs(folder: Path) -> Costs:
    """Read what an entry cost; empty if it has not begun."""
    return dict(Folder(folder).json(COSTS)) if Folder(folder).has(COSTS) else {}


def measured_cost(ground: Ground, name: str, entry: Path) -> Entries:
    """Return what an entry cost where it was run."""
    metres = lane_seconds = training_seconds = 0.0
    peaks = []
    for work, cost in read_costs(entry).items():
        if work in ground.lanes and cost:
            metres += ground.lanes[work].length
            lane_seconds += cost["processor_seconds"]
            peaks.append(cost.get("peak_bytes", math.nan))
        if work.startswith("training"):
            training_seconds += cost["processor_seconds"]
    return {
        "entry": name,
        "seconds_per_km": lane_seconds / (metres / 1000) if metres else math.nan,
        "training_seconds": training_seconds,
        "peak_bytes": max(peaks, default=math.nan),
    }


@dataclass
class _EntryRun:
    """The run of an entry over a ground."""

    ground: Ground  #: the ground, or one tier of it
    entry: Entry  #: an entry that is a recipe or a class of one's own
    lanes: Path  #: the folder that has the lanes
    folder: Path  #: takes what the entry makes
    options: RunOptions  #: who does the work
    #: classes of one's own, by training lanes
    fitted: dict[tuple[str, ...], Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        write_whole(self.folder / "recipe.toml", self.entry.text)
        self.costs = read_costs(self.folder)

    def run(self) -> None:
        """Write the alarms of every split, fold by fold; folds that are there are left alone."""
        for split, row in self.ground.table.splits.items():
            (self.folder / split).mkdir(exist_ok=True)
            tables = []
            for number, fold in enumerate(row.folds, 1):
                name = f"{split}/fold-{number}.csv"
                if not (self.folder / name).is_file():
                    trained_on = self.ground.matching(fold.train, fold.without)
                    tested = self.ground.matching(fold.test)
                    found = zip(tested, self._alarms(trained_on, tested), strict=True)
                    alarms = pd.concat([table.assign(lane=lane.name) for lane, table in found])
                    write_table(alarms, self.folder / name)
                tables.append(read_table_in(self.folder, name, "alarms"))
            write_table(pd.concat(tables, ignore_index=True), self.folder / split / ALARMS)
            write_whole(self.folder / COSTS, json.dumps(self.costs, indent=1) + "\n")

    def _alarms(
        self, trained_on: Sequence[GroundLane], tested: Sequence[GroundLane]
    ) -> list[pd.DataFrame]:
        """Train on lanes, and return the alarms in each of others."""
        if self.entry.own is not None:
            return self._own_alarms(self.entry.own, trained_on, tested)
        recipe = parse_recipe(self.entry.text, self.entry.name)
        learns = recipe.learning() or recipe.detector is not None
        detected = self._detected(tested, self._trained(trained_on) if learns else None)
        return [alarms for alarms, _ in detected]

    def _own_alarms(
        self, own: OwnDetector, trained_on: Sequence[GroundLane], tested: Sequence[GroundLane]
    ) -> list[pd.DataFrame]:
        """Return the alarms of a class of one's own in each lane; it sees truth in ``fit`` alone.

        Every lane is tried, so that a fault is told with all lanes that have it.
        """
        names = tuple(lane.name for lane in trained_on)
        if names not in self.fitted:
            examples = self._own_examples(own, trained_on)
            for _ in self.options.track([own], f"{own.name}: fit on {len(names)} lanes", 1):
                work = f"training {_short_digest(names)}"
                self.fitted[names] = self._timed(work, own.fitted, *examples)
        features = [None] * len(tested) if own.takes_lanes else self._features(tested)
        given = zip(tested, features, strict=True)
        tables = []
        faults: dict[str, list[str]] = {}
        for lane, table in self.options.track(given, f"{own.name}: detect", len(tested)):
            try:
                tables.append(self._own_alarms_of(lane, table, own, self.fitted[names]))
            except ValueError as error:
                faults.setdefault(str(error), []).append(lane.name)
        if faults:
            told = [
                f"{fault} on {len(lanes)} of {len(tested)} lanes: {', '.join(lanes)}"
                for fault, lanes in faults.items()
            ]
            raise ValueError("; ".join(told))
        return tables

    def _own_alarms_of(
        self,
        lane: GroundLane,
        table: tuple[pd.DataFrame, ...] | None,
        own: OwnDetector,
        fitted: Any,
    ) -> pd.DataFrame:
        """Return the alarms of a class in a lane, whose recipe's alarms and features are given."""
        if table is None:
            self.costs.pop(lane.name, None)  # of an earlier fold
            return self._timed(
                lane.name, own.detect, fitted, lane.data(self.lanes, self.entry.text)
            )
        alarms, rows = table
        columns = own.columns(list(rows.columns))
        complete = feature_values(rows, columns)[1]
        scores = self._timed(lane.name, own.scores, fitted, rows.loc[complete, columns])
        return alarms.loc[complete, ["x", "y"]].assign(confidence=scores)

    def _own_examples(self, own: OwnDetector, lanes: Sequence[GroundLane]) -> tuple[Any, ...]:
        """Return what a class of one's own learns from: lanes, or features and labels of alarms."""
        given = [lane.data(self.lanes, self.entry.text) for lane in lanes]
        if own.takes_lanes:
            return (given,)
        examples = []
        for lane, (alarms, features) in zip(given, self._features(lanes), strict=True):
            examples.append((lane.name, alarms, features, lane.truth, lane.lane))
        columns = own.columns(list(examples[0][2].columns))
        labelled = make_training_set(examples, self.ground.table.halo, columns)
        check_classes("all", int((labelled.label == 1).sum()), int((labelled.label == 0).sum()))
        return labelled.features[columns], labelled.label

    def _features(self, lanes: Sequence[GroundLane]) -> list[tuple[pd.DataFrame, pd.DataFrame]]:
        """Return the alarms of lanes and their features, which all folds share."""
        folder = self.folder / "features"
        folder.mkdir(exist_ok=True)
        missing = [lane for lane in lanes if not (folder / f"{lane.name}.csv").is_file()]
        detected = self._detected(missing) if missing else []
        for lane, (alarms, features) in zip(missing, detected, strict=True):
            write_table(alarms, folder / f"{lane.name}-alarms.csv")
            write_table(features, folder / f"{lane.name}.csv")
        tables = []
        for lane in lanes:
            alarms = read_table_in(folder, f"{lane.name}-alarms.csv", "alarms")
            tables.append((alarms, parse_columns(Folder(folder).read(f"{lane.name}.csv"))))
        return tables

    def _timed(self, work: str, call: Callable[..., T], *given: Any) -> T:
        """Call a method of one's own, and count its processor time under a name of the costs."""
        begun = time.process_time()
        result = call(*given)
        cost = self.costs.setdefault(work, {"processor_seconds": 0.0})
        cost["processor_seconds"] += time.process_time() - begun
        return result

    def _detected(
        self, lanes: Sequence[GroundLane], model: Path | None = None
    ) -> list[tuple[pd.DataFrame, pd.DataFrame]]:
        """Return the alarms of lanes by the recipe, and their features."""
        results = self.folder / "results"
        refuse_links(results)
        with self._counting_costs(results) as (options, costs):
            jobs = [self._job(lane, results / lane.name, options, model) for lane in lanes]
            detect_survey(jobs, results, options=options)
        self.costs |= costs
        tables = []
        for lane in lanes:
            alarms = read_table_in(results, f"{lane.name}/alarms.csv", "alarms")
            features = Folder(results / lane.name).read_if_listed("features.csv")
            tables.append((alarms, pd.DataFrame() if features is None else parse_columns(features)))
        shutil.rmtree(results)
        return tables

    def _trained(self, trained_on: Sequence[GroundLane]) -> Path:
        """Train on lanes, unless that was done, and return the model."""
        name = _short_digest([lane.name for lane in trained_on])
        model = self.folder / "models" / name
        if model.is_dir():
            return model
        with self._counting_costs(model.with_name(f"{name}-costs")) as (options, costs):
            jobs = []
            for lane in trained_on:
                truth = self.lanes / f"{lane.name}-truth.csv"
                jobs.append(self._job(lane, model, options, truth=truth))
            train_on_lanes(jobs, model, (), self.ground.table.halo, options, overwrite=True)
        self.costs[f"training {name}"] = {
            "processor_seconds": sum(cost["processor_seconds"] for cost in costs.values()),
            "peak_bytes": max(cost["peak_bytes"] for cost in costs.values()),
        }
        return model

    def _job(
        self,
        lane: GroundLane,
        output: Path,
        options: RunOptions,
        model: Path | None = None,
        truth: Path | None = None,
    ) -> LaneJob:
        """Return the job of the entry's recipe on a lane."""
        run = self.lanes / f"{lane.name}.zarr"
        borders = lane_file_of(run)
        text = self.entry.text
        return make_job(run, text, borders, output, False, model, truth=truth, options=options)

    @contextmanager
    def _counting_costs(self, folder: Path) -> Iterator[tuple[RunOptions, Costs]]:
        """Yield options that count processor time and memory by lane, and the counts.

        The counts are written to a folder, so that a stop does not lose them.
        """
        costs = read_costs(folder)

        def note(report: Report) -> None:
            cost = costs.setdefault(report["lane"], {"processor_seconds": 0.0, "peak_bytes": 0.0})
            cost["processor_seconds"] += report["processor_seconds"]
            cost["peak_bytes"] = max(cost["peak_bytes"], report["peak_bytes"])

        try:
            yield replace(self.options, note=note), costs
        finally:
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(folder / COSTS, json.dumps(costs, indent=1) + "\n")


def _short_digest(lane_names: Sequence[str]) -> str:
    """Return a short digest of the lanes that are trained on."""
    return sha256(json.dumps(lane_names).encode())[:12]


def run_entry(ground: Ground, entry: Entry, lanes: Path, folder: Path, options: RunOptions) -> None:
    """Train an entry, freeze it and write its alarms, or copy alarm lists made elsewhere.

    Parameters
    ----------
    ground : Ground
        The ground, or one tier of it.
    entry : Entry
        The entry.
    lanes : Path
        The folder that has the lanes.
    folder : Path
        Takes what the entry makes. What another recipe or program made there is deleted.
    options : RunOptions
        Who does the work.
    """
    refuse_links(folder)
    if Folder(folder).has(ABOUT) and Folder(folder).json(ABOUT).get("made_of") != made_of(entry):
        card = (folder.parent if ground.tier else folder) / CARD
        if card.is_file():
            raise ValueError(
                f"{entry.name} must be the detector that was entered ({card}), got a changed one: "
                "it runs under another name"
            )
        shutil.rmtree(folder)
    write_about(ground, entry, folder)
    if entry.alarms is None:
        _EntryRun(ground, entry, lanes, folder, options).run()
        return
    for split, table in submitted(ground, entry.alarms).items():
        (folder / split).mkdir(exist_ok=True)
        write_table(table, folder / split / ALARMS)


def submitted(ground: Ground, folder: Path) -> dict[str, pd.DataFrame]:
    """Read the alarm lists of a folder.

    Parameters
    ----------
    ground : Ground
        The ground, or one tier of it.
    folder : Path
        Holds a list SPLIT.csv for some splits, with alarms in lanes of every tier.

    Returns
    -------
    dict of str to DataFrame
        The alarms by split. For one tier of a ground there are those in its lanes alone, and no
        list without any.

    Raises
    ------
    ValueError
        If a list is named after no split, or does not name the lanes of its split in the column
        ``lane``.
    """
    tables = {
        path.stem: read_table_in(folder, path.name, "alarms")
        for path in sorted(folder.glob("*.csv"))
    }
    for split, table in tables.items():
        if split not in ground.table.splits:
            raise ValueError(
                f"alarm lists must be named after splits, {', '.join(ground.table.splits)}, "
                f"got {split}.csv"
            )
        lanes_of_split = {lane.name for lane in replace(ground, tier="").tested(split)}
        if "lane" not in table.columns or not set(table["lane"]) <= lanes_of_split:
            raise ValueError(
                f"{split}.csv must name the lanes of {split} in the column lane: "
                f"{', '.join(sorted(lanes_of_split))}"
            )
    of_tier = {split: in_tier(table, ground) for split, table in tables.items()}
    return {split: table for split, table in of_tier.items() if len(table) or not ground.tier}


def made_of(entry: Entry) -> str:
    """Return a digest of an entry's recipe, of its class and of the program."""
    inputs: list[Any] = [entry.text, code_versions()]
    if entry.own is not None:
        inputs.append([entry.own.path, entry.own.digest])
    return sha256(json.dumps(inputs).encode())


def write_about(ground: Ground, entry: Entry, folder: Path, fault: str = "") -> None:
    """Write what an entry is, and why it did not finish if so."""
    folder.mkdir(parents=True, exist_ok=True)
    about: Entries = {
        "ground": ground.title,
        "entry": entry.name,
        "title": entry.title,
        "fault": fault,
    }
    if ground.tier:
        about["tier"] = ground.tier
    about["made_of"] = made_of(entry)
    if entry.own is not None:
        about["authors"] = list(entry.own.authors)
    write_whole(folder / ABOUT, json.dumps(about, indent=1) + "\n")


def run_benchmark(
    entries: Sequence[str | Path],
    output: str | Path,
    quick: bool = False,
    how: RunOptions = DEFAULTS,
    ground: str | Path | None = None,
    tier: str | None = None,
) -> Path:
    """Run detectors on the proving ground: make its lanes, train, freeze, detect.

    An interrupted run resumes.

    The lanes of all chosen tiers are made first. Then all entries run on one tier before the first
    runs on the next, so that a run that is interrupted leaves whole tiers behind.

    Parameters
    ----------
    entries : sequence of str or path
        Names of packaged entries, recipes, "module:Class" of classes of one's own
        (:func:`flgpr_ground.own.load_own`), beside which the reference runs, or folders of alarm
        lists ``SPLIT.csv``; none takes all packaged entries.
    output : str or path
        Folder that takes the lanes, ``lanes``, and a folder per entry, with one per tier in it
        where there are tiers.
    quick : bool
        The quick form, which shows that everything runs.
    how : RunOptions, optional
        Who does the work.
    ground : str or path, optional
        Name of a packaged proving ground, by default the newest, or TOML file of one's own, as
        those are described.
    tier : str, optional
        The tier to run on; by default, and with "all", every tier of the ground.

    Returns
    -------
    Path
        The folder. What it has in ``kept``, images that entries share, may be deleted.

    Raises
    ------
    ValueError
        If an entry is not there, not valid or does not fit the lanes, the folder is of another form
        of the ground, or the ground has no such tier.
    """
    chosen = load_ground(quick, ground)
    folder = Path(output)
    tiers = chosen.chosen_tiers(tier)
    to_run = _checked_entries(entries, chosen)
    begin_folder(chosen, folder)
    make_lanes(chosen, folder / "lanes", how, tiers)
    how = replace(how, pass_cache=folder / "kept")
    jobs = list(itertools.product(tiers, to_run))
    for on_tier, entry in how.track(jobs, "entries", len(jobs)):
        own_folder = entry_folder(folder, entry.name, on_tier)
        try:
            run_entry(on_tier, entry, folder / "lanes", own_folder, how)
        except (ValueError, ModuleNotFoundError) as error:
            # The others shall not wait for an entry that cannot be trained.
            where = f" on the tier {on_tier.tier}" if on_tier.tier else ""
            warnings.warn(f"{entry.name} did not finish{where}: {error}", stacklevel=2)
            write_about(on_tier, entry, own_folder, str(error))
    return folder


def _checked_entries(names: Sequence[str | Path], ground: Ground) -> list[Entry]:
    """Return the entries of these names, by default all packaged ones; refuse what is not valid."""
    entries = [find_entry(name, ground) for name in names]
    packaged = packaged_entries(ground)
    if not entries:
        entries = list(packaged.values())
    reference = ground.table.reference
    is_there = reference in {entry.name for entry in entries}
    if any(entry.own for entry in entries) and reference in packaged and not is_there:
        entries.append(packaged[reference])
    names_of_own = [entry.name for entry in entries if entry.own]
    if len(set(names_of_own)) < len(names_of_own):
        raise ValueError(
            f"classes of one's own must have names of their own, got {', '.join(names_of_own)}"
        )
    if {entry.name for entry in entries} & set(ORACLES):
        raise ValueError(
            f"entries must not be called {' or '.join(ORACLES)}, which are what the oracle gives"
        )
    for entry in entries:
        if entry.alarms is None:
            parse_recipe(entry.text, entry.name)
        else:
            submitted(ground, entry.alarms)
    return entries


def entry_folder(folder: Path, entry: str, ground: Ground) -> Path:
    """Return the folder of what an entry makes on a ground, or on one tier of it."""
    return folder / "entries" / entry / ground.tier
