"""What several scripts need: an entry's alarms matched, what they find and state, and tables in Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import expit

from flgpr.jobs.simulated_lane import simulate_to_store
from flgpr.model import Sensor
from flgpr.scoring import clopper_pearson, match
from flgpr.scoring.matching import Match
from flgpr.simulate import Scene
from flgpr.store import read_table, write_table
from flgpr_ground.ground import Ground, GroundLane
from flgpr_ground.running import ALARMS, entry_folder

CONTRAST_RECIPE = """name = "contrast"
description = "Contrast to the surroundings, mean over the looks"

[image]
x = [-2.5, 2.5]
y = [{near}, 16.0]
spacing = 0.05
window = "hann"
polarizations = ["{channel}"]
frames = {frames}

[image.subbands]
band = {band}

[background]
self_signature = "mean"
median = 1.05
mean = 2.55
median_step = 3

[run_view]
x = [-1.5, 1.5]
spacing = 0.1
y_max = 16.0
look = "mean"

[prescreen]
polarization = "{channel}"
subband = "band"
radius = 0.5
density = 0.75

[contrast]
polarization = "{channel}"
subband = "band"
size = 25
spacing = 0.1
inner = [5, 3]
guard = [9, 7]

[score]
halo = 0.5
area = "union"
"""
"""The contrast as a recipe; channel, band, where images begin and how many scans are summed are filled in."""


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [f"| {' | '.join(map(str, cells))} |" for cells in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def with_share(found: int, count: int) -> str:
    """Return how many of some are found, with the exact 95 % interval of their share."""
    low, high = clopper_pearson(found, count)
    return f"{found} of {count} ({low:.2f} to {high:.2f})"


def matched(
    ground: Ground, truth: pd.DataFrame, folders: list[Path], entry: str, split: str
) -> Match:
    """Match an entry's alarms in a split, those of the first folder in which it ran."""
    files = [entry_folder(folder, entry, ground) / split / ALARMS for folder in folders]
    file = next(one for one in files if one.parent.is_dir())
    lanes = {lane.name: lane.lane for lane in ground.tested(split)}
    own = truth[truth["lane"].isin(lanes)].reset_index(drop=True)
    return match(read_table(file, "alarms"), own, lanes, ground.table.halo)


def made_lanes(out: Path, lanes: Iterable[GroundLane]) -> tuple[list[Path], list[Path]]:
    """Return the runs and truths of lanes in a folder; those that are not there are simulated."""
    runs = []
    truths = []
    for lane in lanes:
        runs.append(out / f"{lane.name}.zarr")
        truths.append(out / f"{lane.name}.csv")
        if not runs[-1].exists():
            write_table(lane.truth(), truths[-1])
            lane.make(runs[-1])
    return runs, truths


def each_of(listed: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return entries of a declaration as often as their ``count`` says, without it."""
    entries = []
    for entry in listed:
        single = {name: value for name, value in entry.items() if name != "count"}
        entries += [single] * entry["count"]
    return entries


def simulated(scene: Scene, sensor: Sensor, seed: int, run: Path) -> Path:
    """Return the run of a scene in a folder of its own, simulated unless that was done there."""
    done = run.with_name("done")
    if not done.is_file():
        simulate_to_store(scene, sensor, seed, run)
        done.touch()
    return run


def alone(pairs: pd.DataFrame, far: float, one: str, other: str) -> tuple[int, int, float]:
    """Return how many targets two detectors each find alone at a rate, and McNemar's p."""
    of_rate = pairs[pairs["far_allowed"] == far]
    both = of_rate[["first", "second"]].apply(set, axis=1) == {one, other}
    pair = of_rate[both].iloc[0]
    counts = int(pair["only_first"]), int(pair["only_second"])
    own, its = counts if pair["first"] == one else counts[::-1]
    return own, its, float(pair["p"])


def far_at(far: np.ndarray, level: float) -> float:
    """Return the false alarms per m² at which a share of the targets is found."""
    ordered = np.sort(far)
    return float(ordered[math.ceil(level * len(ordered)) - 1])


class Stated(NamedTuple):
    """Alarms in the borders of some lanes, with what their confidence states."""

    p: np.ndarray  # (alarm,) stated probability of a target
    hit: np.ndarray  # (alarm,) whether there is one within the halo


def stated_in(of_entry: Match, lanes: list[str]) -> Stated:
    """Return the alarms in lanes with targets, and which are hits."""
    p = []
    hit = []
    for name in lanes:
        alarms = of_entry.alarms[of_entry.alarms["lane"] == name]
        targets = of_entry.truth[of_entry.truth["lane"] == name][["x", "y"]].to_numpy()
        xy = alarms[["x", "y"]].to_numpy()
        inside = of_entry.lanes[name].contains(xy[:, 0], xy[:, 1])
        off = np.linalg.norm(xy[inside][:, None] - targets, axis=-1).min(axis=1)
        hit.append(off <= of_entry.halo)
        p.append(expit(alarms["confidence"].to_numpy()[inside]))
    return Stated(np.concatenate(p), np.concatenate(hit))
