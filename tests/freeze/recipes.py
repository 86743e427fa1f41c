"""What every packaged recipe finds on small lanes, by the command line alone."""

import json
import multiprocessing
import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.store import Bundle, sample_lane
from freeze.frozen import DATA, array_digest, digest, json_digest
from systems.lanes import SMALL

LEARNING = sorted(SMALL)
"""Recipes that are cut down to the small array and trained on its lane."""
PACKAGED_LANE = (
    "demo",
    "demo-mean-self-signature",
    "demo-median-self-signature",
    "demo-roadside-suppressed",
    "miniature",
)
"""Recipes of the array of the packaged lane, which learn nothing."""
RECIPES = sorted([*LEARNING, *PACKAGED_LANE])
CAUSAL = ("fused", "wang2007", "wang2007-printed")
"""Recipes that run live."""
SECOND_BAND = ("fuse2018", "fuse2018-printed")
SECTION = {name: 2.1 if name in PACKAGED_LANE else 6.0 for name in RECIPES}
"""Longest section, m."""
KILLED = ("flsar2004", "fuse2018", "wang2007")
"""Recipes that are killed and resumed by two workers; ``systems`` shares the work of all others."""
TABLES = ("alarms", "features", "view")
_VEHICLE = ("speed", "reaction", "deceleration", "front", "stopping_distance")
_TIMES = ("arrived", "latency", "latency_ms", "margin_m", "in_time")
"""Entries of live events that hold times, or follow from them."""


def flgpr(*words: object, typed: str = "") -> str:
    """Run a command that must succeed, and return what it printed."""
    done = CliRunner().invoke(app, [str(word) for word in words], input=typed)
    assert done.exit_code == 0, (words, done.exit_code, done.output, done.exception)
    return done.stdout


@dataclass(frozen=True)
class Case:
    """A recipe with the lane that it is run on, in a folder of ``lanes.make_lanes``."""

    name: str
    lanes: Path

    @property
    def folder(self) -> Path:
        """Folder of what this recipe makes."""
        return self.lanes / self.name

    @property
    def model(self) -> Path:
        """Folder of the trained model."""
        return self.folder / "model"

    @property
    def run(self) -> Path:
        """Store of the run that it detects on."""
        if self.name in PACKAGED_LANE:
            return sample_lane() / "run.zarr"
        return self.lanes / "test.zarr"

    @property
    def recipe(self) -> str:
        """Name or file of the recipe."""
        return self.name if self.name in PACKAGED_LANE else str(self.lanes / f"{self.name}.toml")

    def train(self) -> None:
        """Train the recipe, where it is one of those that are trained."""
        if self.name in PACKAGED_LANE:
            return
        flgpr(
            "train", self.lanes / "train.zarr", "--truth", self.lanes / "train.csv",
            "--recipe", self.recipe, "--lane", self.lanes / "train-lane.toml",
            *self._second_band("train"), "-o", self.model, "--quiet",
        )  # fmt: skip

    def detect(self, output: str, *more: object) -> Path:
        """Detect on the test lane and return the result folder."""
        flgpr(*self.detection(output, *more))
        return self.folder / output

    def detection(self, output: str, *more: object) -> list[str]:
        """Return the words of the command that detects."""
        if self.name in PACKAGED_LANE:
            about = ["--lane", self.lanes / "packaged-lane.toml"]
        else:
            about = ["--lane", self.lanes / "test-lane.toml", "--model", self.model]
        words = [
            "detect", self.run, "--recipe", self.recipe, *about, *self._second_band("test"), *more,
            "-o", self.folder / output, "--quiet",
        ]  # fmt: skip
        return [str(word) for word in words]

    def live(self, output: str, *more: object) -> list[str]:
        """Return the words of the command that detects on scans as they come."""
        words = [
            "live", self.lanes / "incoming", "--recipe", self.recipe, "--model", self.model,
            "--lane", self.lanes / "test-lane.toml", "--speed", 10, *more,
            "-o", self.folder / output, "--quiet",
        ]  # fmt: skip
        return [str(word) for word in words]

    def _second_band(self, lane: str) -> list[str]:
        if self.name not in SECOND_BAND:
            return []
        return ["--with", f"x={self.lanes / lane}-x.zarr"]


def frozen_table(case: str, table: str) -> Path:
    """Return the place of a frozen table."""
    return DATA / "recipes" / f"{case}-{table}.csv"


def result_tables(folder: Path) -> dict[str, pd.DataFrame]:
    """Read alarms and features of every detection of a result, and the levels of its run-views."""
    homes = {"main": folder} | {one.name: one for one in sorted(folder.glob("variants/*"))}
    alarms = []
    features = []
    views = []
    for name, home in homes.items():
        alarms.append(pd.read_csv(home / "alarms.csv").assign(detection=name))
        if (home / "features.csv").exists():
            features.append(pd.read_csv(home / "features.csv").assign(detection=name))
        views.append(view_levels(home / "run_view.npz").assign(detection=name))
    tables = {"alarms": pd.concat(alarms, ignore_index=True)}
    if features:
        tables["features"] = pd.concat(features, ignore_index=True)
    tables["view"] = pd.concat(views, ignore_index=True)
    return tables


def view_levels(path: Path) -> pd.DataFrame:
    """Return mean, spread and largest value of every channel of a run-view."""
    with np.load(path, allow_pickle=False) as arrays:
        magnitude = arrays["magnitude"]
        polarizations = arrays["polarization"]
        subbands = arrays["subband"]
    rows = []
    for p, polarization in enumerate(polarizations):
        for s, subband in enumerate(subbands):
            seen = magnitude[p, s][np.isfinite(magnitude[p, s])].astype(np.float64)
            channel = f"{polarization} {subband}"
            level = {"mean": seen.mean(), "spread": seen.std(), "largest": seen.max()}
            rows.append({"channel": channel, "pixels": seen.size, **level})
    return pd.DataFrame(rows)


def result_digests(folder: Path) -> dict[str, str]:
    """Return digests of the numbers of a result: words, versions and times do not enter."""
    digests = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".csv":
            digests[name] = digest(path.read_bytes())
        elif path.suffix == ".npz":
            digests[name] = archive_digest(path)
    layers = {path.name: digest(path.read_bytes()) for path in folder.glob("view/*/*.f16")}
    digests["view/*.f16"] = json_digest(layers)
    index = json.loads((folder / "view" / "index.json").read_text())
    digests["view/index.json"] = json_digest(_numbers_of(index))
    if (folder / "model").is_dir():
        digests["model"] = bundle_digest(folder / "model" / "model.bundle")
    return digests


def archive_digest(path: Path) -> str:
    """Return the digest of the arrays of a NumPy archive."""
    with np.load(path, allow_pickle=False) as arrays:
        return json_digest({name: array_digest(arrays[name]) for name in arrays.files})


def bundle_digest(path: Path) -> str:
    """Return the digest of the arrays of a bundle."""
    return json_digest({name: array_digest(values) for name, values in Bundle(path).items()})


def _numbers_of(index: dict) -> dict:
    """Take what is no wording from the index of the viewer's files."""
    names = ("name", "alarms", "features", "contributions", "training", "evidence", "border")
    detections = [{name: one.get(name) for name in names} for one in index["detections"]]
    layers = [{k: v for k, v in one.items() if k != "stage"} for one in index["layers"]]
    rest = {name: index[name] for name in ("grid", "channel", "scans", "sight")}
    return {"detections": detections, "layers": layers, **rest}


def section_digests(folder: Path) -> dict[str, str]:
    """Return digests of all sections of a lane and of the table of all alarms."""
    digests = {"alarms.csv": digest((folder / "alarms.csv").read_bytes())}
    for home in sorted(folder.glob("section-*")):
        digests[home.name] = json_digest(result_digests(home))
    return digests


def live_digests(folder: Path) -> dict[str, str]:
    """Return digests of the alarms, events and last snapshot of a live run."""
    arrays = dict(Bundle(folder / "snapshot.bundle"))
    # Sums that only tell a radar at fault decide nothing on a clean run.
    deciding = {name: arrays[name] for name in arrays if not name.startswith("health.")}
    snapshot = json_digest({name: array_digest(values) for name, values in deciding.items()})
    alarms = digest((folder / "alarms.csv").read_bytes())
    return {"alarms.csv": alarms, "events": json_digest(events(folder)), "snapshot": snapshot}


def events(folder: Path) -> list[dict]:
    """Read the events of a live run without their times, and of the vehicle what results knew of it."""
    lines = (folder / "live.jsonl").read_text().splitlines()
    told = [json.loads(line) for line in lines]
    for one in told:
        if "vehicle" in one:
            one["vehicle"] = {name: one["vehicle"][name] for name in _VEHICLE}
    return [{name: one[name] for name in one if name not in _TIMES} for one in told]


def killed(words: list[str], suffix: str, count: int) -> int:
    """Run a command in a process that is killed as it names a file for the count-th time.

    Only files that get a name with this suffix count: a file of a work folder or a snapshot is
    written under another name and renamed when it is whole. The exit code of the process is
    returned.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["flgpr.jobs.preload"])
    process = context.Process(target=_run_and_die, args=(words, suffix, count))
    process.start()
    process.join()
    return process.exitcode


def _run_and_die(words: list[str], suffix: str, count: int) -> None:
    named = 0

    def watch(event: str, arguments: tuple) -> None:
        nonlocal named
        if event == "os.rename" and os.fspath(arguments[1]).endswith(suffix):
            named += 1
            if named == count:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(watch)
    sys.exit(CliRunner().invoke(app, words).exit_code)
