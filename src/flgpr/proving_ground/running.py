"""Running detectors on the proving ground: lanes made once, each trained on some, frozen, and tried on others."""

from __future__ import annotations

import itertools
import json
import shutil
import tomllib
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.chain.recipe import parse_recipe, recipe_text
from flgpr.door import Folder
from flgpr.execution.job import code_versions
from flgpr.execution.survey import DEFAULTS, RunOptions, detect_survey
from flgpr.execution.training import train_on_lanes, training_lanes
from flgpr.execution.workers import Report
from flgpr.proving_ground.ground import Ground, GroundLane, load_ground
from flgpr.store import open_run, read_manifest, sha256, write_table, write_whole
from flgpr.store.tables import parse_columns, read_table_in
from flgpr.trials import seal_truth

SEALED = "truth.sealed.json"
PRINTS = "fingerprints.csv"
ALARMS = "alarms.csv"
COSTS = "costs.json"
MARK = "ground.json"
ABOUT = "entry.json"
ORACLES = {
    "oracle": (
        "far",
        "knows every mine's echo but for a phase in each look, and the clutter's covariance",
    ),
    "oracle-phase": ("far_phase", "knows the phases, too"),
}
"""What :func:`flgpr.proving_ground.oracle.run_oracle` gives, as rows of the table: column, title."""
Costs = dict[str, dict[str, float]]
"""Processor seconds and peak bytes by lane, and of every training."""


@dataclass(frozen=True)
class Entry:
    """A detector that enters: a recipe's text, or a folder of alarm lists made elsewhere."""

    name: str
    title: str
    text: str = ""
    alarms: Path | None = None


def packaged_entries(ground: Ground) -> dict[str, Entry]:
    """Read the packaged entries: packaged recipes with what this ground's array or the entry asks for changed.

    Some are changed further for the quick form, whose few mines would not teach them anything.
    """
    told = tomllib.loads(
        (resources.files("flgpr.proving_ground") / "entries.toml").read_text("utf-8")
    )
    found = {}
    own = ground.table.recipe
    for name, row in told.items():
        if own and (row["recipe"] != "wang2007" or "replace" in row):
            continue  # made for another array
        text = recipe_text(own or row["recipe"])
        for old, new in (*row.get("replace", []), *(row.get("quick", []) if ground.quick else [])):
            if text.count(old) != 1:
                raise ValueError(
                    f"entry {name} must replace what stands once in {row['recipe']}, got {old!r}"
                )
            text = text.replace(old, new)
        top = f"confidence = {json.dumps(row['confidence'])}\n" if "confidence" in row else ""
        found[name] = Entry(name, row["title"], f"{top}{text}\n{row.get('add', '')}")
    return found


def find_entry(what: str | Path, ground: Ground) -> Entry:
    """Find a packaged entry by its name, a recipe (packaged or TOML), or a folder with alarm lists of one's own."""
    entries = packaged_entries(ground)
    if str(what) in entries:
        return entries[str(what)]
    path = Path(what)
    if path.is_dir():
        if not list(path.glob("*.csv")):
            raise ValueError(
                f"a folder that enters must hold alarm lists, SPLIT.csv, got none in {path}"
            )
        return Entry(path.name, f"alarms of {path.name}", alarms=path)
    text = recipe_text(what)
    return Entry(path.stem, parse_recipe(text, str(what)).description, text)


def read_ground(folder: Path) -> Ground:
    """Read the ground that a benchmark's folder is of."""
    if not Folder(folder).has(MARK):
        raise ValueError(f"folders must be those of `flgpr benchmark run`, got {folder}")
    quick = bool(Folder(folder).json(MARK)["quick"])
    return load_ground(quick, folder / "ground.toml")


def passphrase(ground: Ground) -> str:
    """Passphrase of the sealed truth: public, for it guards against accidents, not against who means to look."""
    return f"the truth of {ground.title}"


def make_lanes(
    ground: Ground, home: Path, how: RunOptions, tiers: Sequence[Ground] | None = None
) -> None:
    """Simulate the lanes that are not there yet, of all tiers or of some.

    The truth of all test lanes is sealed, that of the others lies beside. Fingerprints are taken of
    all lanes that are there, those of other tiers too.
    """
    seal_tested(ground, home)
    chosen = ground.chosen_tiers() if tiers is None else tiers
    wanted = [name for tier in chosen for name in tier.lanes]
    left = [name for name in wanted if not _is_made(home, name)]
    with how.executor() as executor:
        jobs = [(ground.quick, ground.text, name, str(home.resolve())) for name in left]
        for _ in how.track(executor.run(make_lane, jobs), "simulating lanes", len(jobs)):
            pass
    prints = home / PRINTS
    held = Folder(home).read_if_listed(PRINTS)
    known = (
        {} if held is None else parse_columns(held).set_index("sha256", drop=False).to_dict("index")
    )
    rows = [
        known.get(read_manifest(home / f"{name}.zarr")["sha256"]) or fingerprint(home, name)
        for name in ground.lanes
        if _is_made(home, name)
    ]
    write_whole(prints, pd.DataFrame(rows).to_csv(index=False, float_format="%.7g"))


def _is_made(home: Path, name: str) -> bool:
    return (home / f"{name}.zarr").is_dir()


def seal_tested(ground: Ground, home: Path) -> None:
    """Seal the truth of all test lanes, if that was not done yet."""
    home.mkdir(parents=True, exist_ok=True)
    if not (home / SEALED).is_file():
        tested = [lane for lane in ground.lanes.values() if lane.part == "test"]
        tables = [_truth(lane, with_bodies=bool(ground.table.tiers)) for lane in tested]
        borders = {lane.name: lane.lane for lane in tested}
        seal_truth(
            pd.concat(tables, ignore_index=True),
            borders,
            home / SEALED,
            passphrase(ground),
            halo=ground.table.halo,
        )


def make_lane(quick: bool, ground: str, name: str, home: str) -> Report:
    """Simulate one lane, with its truth beside it unless that is sealed."""
    lane = load_ground(quick, ground).lanes[name]
    folder = Path(home)
    if lane.part != "test":
        write_table(lane.truth(), folder / f"{name}-truth.csv")
    lane.make(folder / f"{name}.zarr")
    return {"lane": name}


def _truth(lane: GroundLane, with_bodies: bool) -> pd.DataFrame:
    truth = lane.truth_with_bodies() if with_bodies else lane.truth()
    return truth.assign(lane=lane.name, target_id=lane.name + "-" + truth["target_id"])


def fingerprint(home: Path, name: str) -> dict[str, Any]:
    """Tell a lane's digest, and the rms of its echoes by polarization, by which machines of other bits are compared."""
    store = home / f"{name}.zarr"
    run = open_run(store)
    level = np.sqrt(np.nanmean(np.abs(run["signal"].values) ** 2, axis=(0, 2, 3), dtype=float))
    labels = [str(label) for label in run["polarization"].values]
    return {
        "lane": name,
        "sha256": read_manifest(store)["sha256"],
        **dict(zip(labels, level, strict=True)),
    }


def read_costs(folder: Path) -> Costs:
    """Read what an entry took, nothing if it has not begun."""
    return dict(Folder(folder).json(COSTS)) if Folder(folder).has(COSTS) else {}


class Course:
    """An entry on its way over the ground: ``home`` has the lanes, ``folder`` takes what the entry makes."""

    def __init__(
        self, ground: Ground, entry: Entry, home: Path, folder: Path, how: RunOptions
    ) -> None:
        self.ground = ground
        self.home = home
        self.folder = folder
        self.how = how
        self.recipe = parse_recipe(entry.text, entry.name)
        self.file = folder / "recipe.toml"
        write_whole(self.file, entry.text)
        self.costs = read_costs(folder)

    def run(self) -> None:
        """Write the alarms of every split, fold by fold; those that are there are left alone."""
        for split, row in self.ground.table.splits.items():
            (self.folder / split).mkdir(exist_ok=True)
            folds = [
                self.folder / split / f"fold-{number}.csv"
                for number in range(1, len(row.folds) + 1)
            ]
            for fold, path in zip(row.folds, folds, strict=True):
                if not path.is_file():
                    known = self.ground.matching(fold.train, fold.without)
                    write_table(self._alarms(known, self.ground.matching(fold.test)), path)
            parts = [
                read_table_in(self.folder, path.relative_to(self.folder), "alarms")
                for path in folds
            ]
            write_table(pd.concat(parts, ignore_index=True), self.folder / split / ALARMS)
            write_whole(self.folder / COSTS, json.dumps(self.costs, indent=1) + "\n")

    def _alarms(self, known: Sequence[GroundLane], tested: Sequence[GroundLane]) -> pd.DataFrame:
        """Train on lanes, detect on others and give the alarms of these, with their lane."""
        model = (
            self._trained(known)
            if self.recipe.learning() or self.recipe.detector is not None
            else None
        )
        results = self.folder / "results"
        with self._spending(results) as (how, spent):
            runs, borders = self._files(tested)
            detect_survey(
                runs, recipe_text(self.file), results, borders, model, report=False, how=how
            )
        self.costs |= spent
        found = [
            read_table_in(results, f"{one.name}/alarms.csv", "alarms").assign(lane=one.name)
            for one in tested
        ]
        shutil.rmtree(results)
        return pd.concat(found, ignore_index=True)

    def _trained(self, known: Sequence[GroundLane]) -> Path:
        """Train on lanes, unless that was done, and give the model."""
        name = sha256(json.dumps([lane.name for lane in known]).encode())[:12]
        model = self.folder / "models" / name
        if not model.is_dir():
            with self._spending(model.with_name(f"{name}-costs")) as (how, spent):
                runs, borders, truths = self._files(known, "-truth.csv")
                text = recipe_text(self.file)
                others: list[dict[str, Path]] = [{} for _ in runs]
                lanes = training_lanes(
                    parse_recipe(text), runs, truths, borders, others, how.max_memory
                )
                radius = self.ground.table.halo
                train_on_lanes(text, lanes, model, (), radius, how, overwrite=True)
            self.costs[f"training {name}"] = {
                "processor_seconds": sum(one["processor_seconds"] for one in spent.values()),
                "peak_bytes": max(one["peak_bytes"] for one in spent.values()),
            }
        return model

    def _files(self, lanes: Sequence[GroundLane], *more: str) -> list[list[Path]]:
        """List the runs and the borders of lanes, and files of other endings."""
        return [
            [self.home / f"{lane.name}{end}" for lane in lanes]
            for end in (".zarr", "-lane.toml", *more)
        ]

    @contextmanager
    def _spending(self, folder: Path) -> Iterator[tuple[RunOptions, Costs]]:
        """Give what counts processor time and memory by lane, and the counts, which a folder keeps after a stop."""
        path = folder / COSTS
        spent = read_costs(folder)

        def note(report: Report) -> None:
            own = spent.setdefault(report["lane"], {"processor_seconds": 0.0, "peak_bytes": 0.0})
            own["processor_seconds"] += report["processor_seconds"]
            own["peak_bytes"] = max(own["peak_bytes"], report["peak_bytes"])

        try:
            yield replace(self.how, note=note), spent
        finally:
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(path, json.dumps(spent, indent=1) + "\n")


def run_entry(ground: Ground, entry: Entry, home: Path, folder: Path, how: RunOptions) -> None:
    """Train an entry, freeze it and write its alarms, or take over alarm lists made elsewhere."""
    if Folder(folder).has(ABOUT) and Folder(folder).json(ABOUT).get("made_of") != made_of(entry):
        shutil.rmtree(folder)  # what another recipe or program found
    _tell(ground, entry, folder)
    if entry.alarms is None:
        Course(ground, entry, home, folder, how).run()
        return
    for split, table in submitted(ground, entry.alarms).items():
        (folder / split).mkdir(exist_ok=True)
        write_table(table, folder / split / ALARMS)


def submitted(ground: Ground, home: Path) -> dict[str, pd.DataFrame]:
    """Read the alarm lists SPLIT.csv of a folder; each must name the lanes of its split in the column ``lane``.

    A list may hold alarms in lanes of every tier. For one tier of a ground its own alarms are
    given, and no list that names none of its lanes.
    """
    tables = {
        path.stem: read_table_in(home, path.name, "alarms") for path in sorted(home.glob("*.csv"))
    }
    for split, table in tables.items():
        if split not in ground.table.splits:
            raise ValueError(
                f"alarm lists must be named after splits, {', '.join(ground.table.splits)}, got "
                f"{split}.csv"
            )
        wanted = {lane.name for lane in replace(ground, tier="").tested(split)}
        if "lane" not in table.columns or not set(table["lane"]) <= wanted:
            raise ValueError(
                f"{split}.csv must name the lanes of {split} in the column lane: "
                f"{', '.join(sorted(wanted))}"
            )
    if not ground.tier:
        return tables
    in_tier = {split: table[table["lane"].isin(ground.lanes)] for split, table in tables.items()}
    return {split: table.reset_index(drop=True) for split, table in in_tier.items() if len(table)}


def made_of(entry: Entry) -> str:
    """Tell recipe and program apart from others."""
    return sha256(json.dumps([entry.text, code_versions()]).encode())


def _tell(ground: Ground, entry: Entry, folder: Path, fault: str = "") -> None:
    """Write what an entry is, and why it did not finish if so."""
    folder.mkdir(parents=True, exist_ok=True)
    about = {"ground": ground.title, "entry": entry.name, "title": entry.title, "fault": fault}
    if ground.tier:
        about["tier"] = ground.tier
    about["made_of"] = made_of(entry)
    write_whole(folder / ABOUT, json.dumps(about, indent=1) + "\n")


def run_benchmark(
    entries: Sequence[str | Path],
    output: str | Path,
    quick: bool = False,
    how: RunOptions = DEFAULTS,
    ground: str | Path | None = None,
    tier: str | None = None,
) -> Path:
    """Run detectors on the proving ground: make its lanes, train, freeze, detect; an interrupted run resumes.

    The lanes of all chosen tiers are made first. Then all entries run on one tier before the first
    runs on the next, so that a run that is interrupted leaves whole tiers behind.

    Parameters
    ----------
    entries : sequence of str or path
        Names of packaged entries, recipes, or folders of alarm lists ``SPLIT.csv``; none takes all
        packaged entries.
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
    chosen = load_ground(quick, None if ground is None else Path(ground))
    folder = Path(output)
    tiers = chosen.chosen_tiers(tier)
    found = [find_entry(one, chosen) for one in entries] or list(packaged_entries(chosen).values())
    if {entry.name for entry in found} & set(ORACLES):
        raise ValueError(
            f"entries must not be called {' or '.join(ORACLES)}, which are what the oracle gives"
        )
    for entry in found:
        if entry.alarms is None:
            parse_recipe(entry.text, entry.name)
        else:
            submitted(chosen, entry.alarms)
    if Folder(folder).has(MARK) and read_ground(folder) != chosen:
        raise ValueError(
            f"output must be a folder of {chosen.title} as it is now, got one of another ground: "
            f"{folder}"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "ground.toml", chosen.text)
    write_whole(folder / MARK, json.dumps({"ground": chosen.title, "quick": quick}) + "\n")
    make_lanes(chosen, folder / "lanes", how, tiers)
    how = replace(how, pass_cache=folder / "kept")
    jobs = list(itertools.product(tiers, found))
    for part, entry in how.track(jobs, "entries", len(jobs)):
        own_folder = entry_folder(folder, entry.name, part)
        try:
            run_entry(part, entry, folder / "lanes", own_folder, how)
        except (
            ValueError,
            ModuleNotFoundError,
        ) as error:  # the others shall not wait for one that cannot be trained
            where = f" on the tier {part.tier}" if part.tier else ""
            warnings.warn(f"{entry.name} did not finish{where}: {error}", stacklevel=2)
            _tell(part, entry, own_folder, str(error))
    return folder


def entry_folder(folder: Path, entry: str, ground: Ground) -> Path:
    """Folder that takes what an entry makes on a ground, or on one tier of it."""
    own = folder / "entries" / entry
    return own / ground.tier if ground.tier else own
