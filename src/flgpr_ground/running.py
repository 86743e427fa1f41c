"""Running detectors on the proving ground.

Lanes are made once. Every detector is trained on some, frozen, and tried on others.
"""

from __future__ import annotations

import itertools
import json
import math
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from flgpr.door import Folder, refuse_links
from flgpr.jobs.job import LaneJob, code_versions, make_job
from flgpr.jobs.survey import detect_survey
from flgpr.jobs.training import train_on_lanes
from flgpr.jobs.workers import DEFAULTS, Report, RunOptions
from flgpr.method.classifier import feature_values, make_training_set
from flgpr.recipe.schema import parse_recipe
from flgpr.stages.too_few import check_classes
from flgpr.store import open_run, read_manifest, sha256, write_table, write_whole
from flgpr.store.outputs import log_finished
from flgpr.store.run_writer import is_finished
from flgpr.store.tables import lane_file_of, parse_columns, read_table_in
from flgpr_ground.card import CARD
from flgpr_ground.entries import ORACLES, Entry, find_entry, packaged_entries
from flgpr_ground.ground import Ground, GroundLane, in_tier, load_ground
from flgpr_ground.lane_data import LaneData, lane_data
from flgpr_ground.own import OwnDetector
from flgpr_trials.sealing import seal_truth

T = TypeVar("T")

SEALED = "truth.sealed.json"
PRINTS = "fingerprints.csv"
ALARMS = "alarms.csv"
COSTS = "costs.json"
MARK = "ground.json"
ABOUT = "entry.json"
Costs = dict[str, dict[str, float]]
"""Processor seconds and peak bytes by lane, and of every training."""


def read_ground(folder: Path) -> Ground:
    """Read the ground of a benchmark's folder; a ValueError if it is none."""
    if not Folder(folder).has(MARK):
        raise ValueError(f"folders must be those of `flgpr benchmark run`, got {folder}")
    quick = bool(Folder(folder).json(MARK)["quick"])
    return load_ground(quick, folder / "ground.toml")


def common_ground(folders: Sequence[Path]) -> Ground:
    """Read the ground that all folders are of; several are a ValueError."""
    grounds = [read_ground(folder) for folder in folders]
    if any(ground != grounds[0] for ground in grounds):
        titles = ", ".join(ground.title for ground in grounds)
        raise ValueError(f"folders must all be of one ground, got {titles}")
    return grounds[0]


def passphrase(ground: Ground) -> str:
    """Return the passphrase of the sealed truth.

    It is public: the seal guards against accidents, not against who means to look.
    """
    return f"the truth of {ground.title}"


def make_lanes(
    ground: Ground, folder: Path, options: RunOptions, tiers: Sequence[Ground] | None = None
) -> None:
    """Simulate the lanes that are not there yet.

    The truth of all test lanes is sealed, that of the others lies beside them. Fingerprints are
    taken of all lanes that are there.

    Parameters
    ----------
    ground : Ground
        The ground with all of its tiers.
    folder : Path
        Takes the lanes.
    options : RunOptions
        Who does the work.
    tiers : sequence of Ground, optional
        The tiers whose lanes are made; by default all.
    """
    seal_tested(ground, folder)
    missing = []
    for tier in tiers or ground.chosen_tiers():
        missing += [name for name in tier.lanes if not is_finished(folder / f"{name}.zarr")]
    with options.executor() as executor:
        jobs = [(ground.quick, ground.text, name, str(folder.resolve())) for name in missing]
        for _ in options.track(executor.run(make_lane, jobs), "simulating lanes", len(jobs)):
            pass

    present = Folder(folder).read_if_listed(PRINTS)
    known: dict[Any, Any] = {}  # prints that were taken are not taken anew
    if present is not None:
        known = parse_columns(present).set_index("sha256", drop=False).to_dict("index")
    rows = []
    for name in ground.lanes:
        store = folder / f"{name}.zarr"
        if is_finished(store):
            rows.append(known.get(read_manifest(store)["sha256"]) or fingerprint(folder, name))
    write_whole(folder / PRINTS, pd.DataFrame(rows).to_csv(index=False, float_format="%.7g"))


def seal_tested(ground: Ground, folder: Path) -> None:
    """Seal the truth of all test lanes, if that was not done yet."""
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / SEALED).is_file():
        return
    tables = []
    borders = {}
    for lane in ground.lanes.values():
        if lane.part == "test":
            truth = lane.truth_with_bodies() if ground.table.tiers else lane.truth()
            # Named so that those of all lanes are different.
            names = lane.name + "-" + truth["target_id"]
            tables.append(truth.assign(lane=lane.name, target_id=names))
            borders[lane.name] = lane.lane
    truth = pd.concat(tables, ignore_index=True)
    seal_truth(truth, borders, folder / SEALED, passphrase(ground), halo=ground.table.halo)


def make_lane(quick: bool, ground: str, name: str, folder: str) -> Report:
    """Simulate one lane, with its truth beside it unless that is sealed.

    Parameters
    ----------
    quick : bool
        Whether the ground is the quick form.
    ground : str
        TOML text of the ground.
    name : str
        Name of the lane.
    folder : str
        Takes the lane.

    Returns
    -------
    Report
        The name of the ``lane``.
    """
    lane = load_ground(quick, ground).lanes[name]
    if lane.part != "test":
        write_table(lane.truth(), Path(folder) / f"{name}-truth.csv")
    lane.make(Path(folder) / f"{name}.zarr")
    return {"lane": name}


def fingerprint(folder: Path, name: str) -> dict[str, Any]:
    """Return a lane's digest, and the rms of its echoes by polarization.

    By the rms lanes of machines are compared that compute other bits.
    """
    store = folder / f"{name}.zarr"
    run = open_run(store)
    power = np.abs(run["signal"].values) ** 2
    level = np.sqrt(np.nanmean(power, axis=(0, 2, 3), dtype=float))
    labels = [str(label) for label in run["polarization"].values]
    return {
        "lane": name,
        "sha256": read_manifest(store)["sha256"],
        **dict(zip(labels, level, strict=True)),
    }


def read_costs(folder: Path) -> Costs:
    """Read what an entry cost; empty if it has not begun."""
    return dict(Folder(folder).json(COSTS)) if Folder(folder).has(COSTS) else {}


def measured_cost(ground: Ground, name: str, entry: Path) -> dict[str, Any]:
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


class _EntryRun:
    """The run of an entry over a ground.

    Parameters
    ----------
    ground : Ground
        The ground, or one tier of it.
    entry : Entry
        An entry that is a recipe or a class of one's own.
    lanes : Path
        The folder that has the lanes.
    folder : Path
        Takes what the entry makes.
    options : RunOptions
        Who does the work.
    """

    def __init__(
        self, ground: Ground, entry: Entry, lanes: Path, folder: Path, options: RunOptions
    ) -> None:
        self.ground = ground
        self.entry = entry
        self.lanes = lanes
        self.folder = folder
        self.options = options
        self.fitted: dict[tuple[str, ...], Any] = {}  # classes of one's own, by training lanes
        write_whole(folder / "recipe.toml", entry.text)
        self.costs = read_costs(folder)

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
            told = []
            for fault, lanes in faults.items():
                told.append(f"{fault} on {len(lanes)} of {len(tested)} lanes: {', '.join(lanes)}")
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
            return self._timed(lane.name, own.detect, fitted, self._lane_data(lane))
        alarms, rows = table
        columns = own.columns(list(rows.columns))
        complete = feature_values(rows, columns)[1]
        scores = self._timed(lane.name, own.scores, fitted, rows.loc[complete, columns])
        return alarms.loc[complete, ["x", "y"]].assign(confidence=scores)

    def _own_examples(self, own: OwnDetector, lanes: Sequence[GroundLane]) -> tuple[Any, ...]:
        """Return what a class of one's own learns from: lanes, or features and labels of alarms."""
        given = [self._lane_data(lane) for lane in lanes]
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

    def _lane_data(self, lane: GroundLane) -> LaneData:
        """Return a lane as a class of one's own sees it."""
        return lane_data(lane, self.lanes, self.entry.text)

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
    tables = {}
    for path in sorted(folder.glob("*.csv")):
        tables[path.stem] = read_table_in(folder, path.name, "alarms")
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
    about: dict[str, Any] = {
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


def begin_folder(ground: Ground, folder: Path) -> None:
    """Make the folder of a ground, with its description; one of another ground is a ValueError."""
    if Folder(folder).has(MARK) and read_ground(folder) != ground:
        raise ValueError(
            f"output must be a folder of {ground.title} as it is now, got one of another ground: "
            f"{folder}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "ground.toml", ground.text)
    write_whole(folder / MARK, json.dumps({"ground": ground.title, "quick": ground.quick}) + "\n")


def make_ground(
    output: str | Path,
    quick: bool = False,
    how: RunOptions = DEFAULTS,
    ground: str | Path | None = None,
    tier: str | None = None,
) -> Path:
    """Make the lanes of a proving ground, and run no detector.

    Parameters
    ----------
    output : str or path
        Folder of the ground, as for :func:`run_benchmark`, which goes on from there.
    quick : bool
        The quick form.
    how : RunOptions, optional
        Who does the work.
    ground : str or path, optional
        Name of a packaged proving ground, by default the newest, or a TOML file.
    tier : str, optional
        The tier whose lanes are made; by default, and with "all", every tier.

    Returns
    -------
    Path
        The folder, with run stores, borders, truth of the lanes that are not sealed, the sealed
        truth and fingerprints in ``lanes``.

    Raises
    ------
    ValueError
        If the folder is of another form of the ground, or the ground has no such tier.
    """
    chosen = load_ground(quick, ground)
    tiers = chosen.chosen_tiers(tier)
    folder = Path(output)
    begin_folder(chosen, folder)
    lanes = folder / "lanes"
    before = Folder(lanes).read(PRINTS) if Folder(lanes).has(PRINTS) else None
    make_lanes(chosen, lanes, how, tiers)
    if Folder(lanes).read(PRINTS) == before:
        log_finished(lanes)
    return folder


def open_lane(
    name: str,
    folder: str | Path = "proving-ground",
    quick: bool = False,
    ground: str | Path | None = None,
) -> LaneData:
    """Return a lane of a proving ground with its run, image and truth; it is made if it is not there.

    Parameters
    ----------
    name : str
        Name of the lane, as ``flgpr benchmark list`` gives it.
    folder : str or path
        Folder of the ground, as for :func:`run_benchmark`.
    quick, ground
        As for :func:`run_benchmark`.

    Returns
    -------
    LaneData
        The lane. The truth of test lanes is sealed.

    Raises
    ------
    ValueError
        If the ground has no such lane, or the folder is of another one.

    Examples
    --------
    A packaged full-wave lane needs no simulation:

    >>> import tempfile
    >>> from flgpr.proving_ground import open_lane
    >>> lane = open_lane("arid-lane-1", tempfile.mkdtemp(), ground="full-wave-1")
    >>> lane.part, dict(lane.run["signal"].sizes)
    ('test', {'scan': 3, 'polarization': 4, 'pair': 32, 'frequency': 142})
    """
    chosen = load_ground(quick, ground)
    if name not in chosen.lanes:
        known = ", ".join(chosen.lanes)
        raise ValueError(f"name must be that of a lane of {chosen.title}, {known}, got {name!r}")
    begin_folder(chosen, Path(folder))
    lanes = Path(folder) / "lanes"
    lanes.mkdir(exist_ok=True)
    if not is_finished(lanes / f"{name}.zarr"):
        make_lane(quick, chosen.text, name, str(lanes.resolve()))
    recipe = packaged_entries(chosen)["wang2007"].text
    return lane_data(chosen.lanes[name], lanes, recipe)


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
    of_entry = folder / "entries" / entry
    return of_entry / ground.tier if ground.tier else of_entry
