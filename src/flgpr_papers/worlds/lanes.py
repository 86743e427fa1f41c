"""Lanes of a world.

Simulated, searched by the packaged recipe of Wang et al. 2007, scored mine by mine, and kept. The
lanes and the radar are those of the paper's blind lanes (mines at 7.5 cm, the tones of sub-band F1
alone), but for the number of mines: as many of each kind as it takes to tell a probability of
detection.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import flgpr
from flgpr.chain.method import detect
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import Recipe, parse_recipe, recipe_text
from flgpr.execution.workers import Executor
from flgpr.model import Sensor, load_sensor
from flgpr.scoring import assign, chance, match, operating_row, roc_of
from flgpr.simulate import Scene, draw_world, simulate
from flgpr.store import write_whole
from flgpr_papers.kit.cache import key_of
from flgpr_papers.kit.mines import find_mix, mix_draws
from flgpr_papers.kit.worlds import DECLARED, write_site
from flgpr_papers.worlds.signature import signal_to_clutter

KINDS = ("metal", "plastic", "simulant")
"""Kinds of targets in every lane, in equal numbers."""
_LANE = DECLARED["lane"]
FAR: tuple[float, ...] = tuple(_LANE["far"])
"""False alarms per m² at which Pd is read."""


@dataclass(frozen=True)
class LaneJob:
    """A lane to simulate and to score."""

    part: str  #: of the map that it belongs to
    name: str  #: of the lane, different for every lane of a part
    about: dict[str, Any]  #: columns that tell what the lane is: levels of axes, replicate
    site: dict[str, Any]  #: tables of its site
    mines: str  #: mix that stands for plastic mines
    length: float  #: m
    count: int  #: targets of each kind
    seed: int
    height: float | None = None  #: of the array, m; None takes the sensor's own
    #: nearest and farthest ground used, m ahead; the lane is searched once for each. Empty takes
    #: the recipe's own
    ground: tuple[tuple[float, float], ...] = ()
    ratios: bool = True  #: whether the signal to clutter of every target is measured, too
    version: str = field(default=flgpr.__version__)  #: of the program

    def path(self, folder: Path) -> Path:
        """Return the file of the lane's record.

        Another lane of the same name, or another version, has another.
        """
        bodies = {mix: find_mix(mix).parts for mix in self.mixes}
        return folder / "lanes" / self.part / f"{self.name}-{key_of(asdict(self), bodies)}.json"

    @property
    def mixes(self) -> tuple[str, str, str]:
        """Mixes that stand for metal mines, plastic mines and simulants."""
        return "metal", self.mines, "simulant"


def run_jobs(
    folder: Path, jobs: Sequence[LaneJob], executor: Executor, track: Track = silent
) -> None:
    """Run the lanes that are not on disk."""
    left = [(asdict(job), str(folder)) for job in jobs if not job.path(folder).is_file()]
    label = jobs[0].part if jobs else "lanes"
    for _ in track(executor.run(run_job, left), label, len(left)):
        pass


def run_job(job: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """Simulate and score a lane and write its record; returns its name and the seconds it took."""
    lane = LaneJob(**job)
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        scene = lane_scene(lane, Path(scratch))
    sensor = radar(lane.height)
    run, truth = simulate(scene, sensor, lane.seed)
    bodies = pd.DataFrame(
        {"body": [target.body for target in draw_world(scene, lane.seed).targets]}
    )
    truth = truth.assign(body=bodies["body"].to_numpy())
    targets_found = []
    for ground in lane.ground or (None,):
        recipe = lane_recipe(ground)
        alarms = detect(run, recipe, scene.lane).alarms
        targets_found.append(_scored(alarms, truth, scene, ground))
    ratios: list[float] = []
    if lane.ratios:
        ratios = signal_to_clutter(scene, sensor, lane.seed, tuple(_LANE["band"])).tolist()
    seconds = time.process_time() - begin
    targets = truth[["target_id", "kind", "body", "x", "y", "depth"]].to_dict("records")
    record = {
        "about": lane.about,
        "seconds": seconds,
        "targets": targets,
        "ratio_db": ratios,
        "found": targets_found,
    }
    path = lane.path(Path(folder))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps(record))
    return {"lane": lane.name, "seconds": seconds}


def lane_scene(lane: LaneJob, scratch: Path) -> Scene:
    """Make the scene of a lane; its site goes through a file of its own."""
    draws: list[dict[str, Any]] = []
    for mix in lane.mixes:
        draws += mix_draws(mix, _LANE["depth"], lane.count)
    path = scratch / "site.toml"
    write_site(path, lane.site)
    scene = {
        "name": lane.name,
        "site": str(path),
        "length": lane.length,
        "draws": draws,
        "track": _LANE["track"],
    }
    validated = Scene.model_validate(scene | {"surface": {"density": _LANE["density"]}})
    return validated.model_copy(update={"site": None})  # its tables are in the scene now


def radar(height: float | None = None) -> Sensor:
    """Load the array of Wang et al. 2007 with the tones of F1 alone.

    If wanted, it stands at another height (m).
    """
    sensor = load_sensor("sri-array")
    axis = sensor.tones.axis()
    low, high = _LANE["band"]
    inside = axis[(axis >= low) & (axis <= high)]
    tones = sensor.tones.model_copy(update={"start": inside[0], "count": inside.size})
    own_height = sensor.height if height is None else height
    return sensor.model_copy(update={"tones": tones, "height": own_height})


def lane_recipe(ground: tuple[float, float] | None = None) -> Recipe:
    """Return the packaged recipe wang2007 with F1 alone.

    If wanted, it has other nearest and farthest ground (m ahead).
    """
    recipe = parse_recipe(re.sub(r"(?m)^F[0234] .*\n", "", recipe_text("wang2007")))
    if ground is None:
        return recipe
    nearest, farthest = ground
    image = recipe.image.model_copy(update={"y": (nearest, max(recipe.image.y[1], farthest))})
    view = recipe.run_view.model_copy(update={"y_max": farthest})
    return recipe.model_copy(update={"image": image, "run_view": view})


def _scored(
    alarms: pd.DataFrame, truth: pd.DataFrame, scene: Scene, ground: tuple[float, float] | None
) -> dict[str, Any]:
    """Return at which FAR (per m²) every target is found, and Pd by chance at the declared ones."""
    matched = match(alarms, truth, scene.lane, _LANE["halo"])
    cost = assign(matched)["far"]
    curve = chance(matched).add_chance_column(roc_of(matched))
    by_chance = [float(curve["chance"].iloc[int(operating_row(curve, far))]) for far in FAR]
    return {
        "ground": ground,
        "far": [float(value) if math.isfinite(value) else None for value in cost],
        "chance": [value if math.isfinite(value) else None for value in by_chance],
        "alarms": len(alarms),
    }


def read_targets(folder: Path, jobs: Sequence[LaneJob]) -> pd.DataFrame:
    """Read what is on disk: a row per target and ground used.

    Returns
    -------
    DataFrame
        The columns that tell what the lane is; ``lane``, its name; ``nearest`` and ``farthest``
        ground used, m (NaN: the recipe's own); ``target_id``, ``kind``, ``body``, ``x``, ``y``,
        ``depth`` (m); ``far``, the false alarms per m² at which the target is found (infinite where
        no alarm is near); ``chance_F``, Pd by chance in its lane at F false alarms per m²;
        ``ratio_db``, its signal to clutter, dB (NaN where it was not measured).
    """
    tables = []
    for job in jobs:
        path = job.path(folder)
        if not path.is_file():
            continue
        record = json.loads(path.read_text(encoding="utf-8"))
        targets = pd.DataFrame(record["targets"])
        ratio = record["ratio_db"] or [math.nan] * len(targets)
        for target in record["found"]:
            nearest, farthest = target["ground"] or (math.nan, math.nan)
            columns = {
                **record["about"],
                "lane": job.name,
                "nearest": nearest,
                "farthest": farthest,
            }
            table = targets.assign(**columns, ratio_db=ratio)
            table["far"] = [math.inf if value is None else value for value in target["far"]]
            for far, value in zip(FAR, target["chance"], strict=True):
                table[f"chance_{far:g}"] = math.nan if value is None else value
            tables.append(table)
    if not tables:
        return pd.DataFrame()
    every = pd.concat(tables, ignore_index=True)
    first = [*jobs[0].about, "lane", "nearest", "farthest"]
    return every[[*first, *(name for name in every.columns if name not in first)]]


def lane_table(targets: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Count what was found in every lane.

    Parameters
    ----------
    targets : DataFrame
        As :func:`read_targets` gives it.
    by : sequence of str
        Columns that tell lanes apart.

    Returns
    -------
    DataFrame
        The columns ``by``; of every kind ``KIND_targets``, their number, ``KIND_F``, how many are
        found at F false alarms per m², and ``KIND_ratio_db``, the mean of their signal to clutter,
        dB; ``chance_F``.
    """
    rows = []
    for values, lane in targets.groupby(list(by), sort=False, dropna=False):
        row = dict(zip(by, values, strict=True))
        for kind in KINDS:
            of_kind = lane[lane["kind"] == kind]
            row[f"{kind}_targets"] = len(of_kind)
            for far in FAR:
                row[f"{kind}_{far:g}"] = int((of_kind["far"] <= far).sum())
            row[f"{kind}_ratio_db"] = float(np.mean(of_kind["ratio_db"]))
        for far in FAR:
            row[f"chance_{far:g}"] = float(lane[f"chance_{far:g}"].iloc[0])
        rows.append(row)
    return pd.DataFrame(rows)
