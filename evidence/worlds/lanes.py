"""Lanes of the map of worlds: simulated, searched by the recipe wang2007, scored mine by mine.

The lanes and the radar are those of the blind lanes of Wang et al. 2007 (mines at 7.5 cm, the tones
of sub-band F1 alone), but for the number of mines: there are as many of each kind as it takes to
measure a probability of detection. The record of every lane stays on disk.
"""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import flgpr
from flgpr.jobs.workers import Executor
from flgpr.method.method import detect
from flgpr.model import Sensor
from flgpr.progress import Track, silent
from flgpr.recipe.schema import Recipe, parse_recipe, recipe_text
from flgpr.scoring import assign, chance, match, operating_row, roc_of
from flgpr.simulate import Scene, draw_world, simulate
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.mines import find_mix, mix_draws
from flgpr_papers.wang2007.lanes import F1_BAND, f1_alone
from flgpr_papers.wang2007.lanes import sensor as f1_sensor
from worlds.signature import signal_to_clutter
from worlds.space import DECLARED, write_site

KINDS = ("metal", "plastic", "simulant")
"""Kinds of targets in every lane, in equal numbers."""
_LANE = DECLARED["lane"]
FAR: tuple[float, ...] = tuple(_LANE["far"])
"""False alarms per m² at which Pd is read."""
_TARGET_COLUMNS = ["target_id", "kind", "body", "x", "y", "depth"]


@dataclass(frozen=True)
class LaneJob:
    """A lane to simulate and to score.

    The names of the fields are part of the key of its record on disk.
    """

    part: str  #: of the map that it belongs to
    name: str  #: of the lane, different for every lane of a part
    about: dict[str, Any]  #: columns that identify the lane: levels of axes, replicate
    site: dict[str, Any]  #: tables of its site
    mines: str  #: mix that stands for plastic mines
    length: float  #: m
    count: int  #: targets of each kind
    seed: int
    height: float | None = None  #: of the array, m; None takes the sensor's own
    #: nearest and farthest ground used, m ahead; the lane is searched once for each. Empty takes
    #: the recipe's own
    ground: tuple[tuple[float, float], ...] = ()
    ratios: bool = True  #: signal to clutter is measured, too; of the key alone
    version: str = field(default=flgpr.__version__)  #: of the program

    def path(self, folder: Path) -> Path:
        """Return the file of the lane's record, with a key of the lane and of the version."""
        bodies = {mix: find_mix(mix).parts for mix in self.mixes}
        return folder / "lanes" / self.part / f"{self.name}-{key_of(asdict(self), bodies)}.json"

    @property
    def mixes(self) -> tuple[str, str, str]:
        """Mixes that stand for metal mines, plastic mines and simulants."""
        return "metal", self.mines, "simulant"


def declared_lane(
    part: str,
    name: str,
    about: dict[str, Any],
    site: dict[str, Any],
    number: int,
    mines: str = "",
    height: float | None = None,
    ground: tuple[tuple[float, float], ...] = (),
) -> LaneJob:
    """Return a lane of a part with the declared length, number of targets and first seed.

    Parameters
    ----------
    part, name, about, site, height, ground
        As of :class:`LaneJob`.
    number : int
        Added to the part's first seed.
    mines : str
        Mix that stands for plastic mines; the declared one without it.
    """
    declared = DECLARED[part]
    return LaneJob(
        part, name, about, site, mines or declared["mines"], float(declared["length"]),
        declared["count"], declared["seed"] + number, height, ground,
    )  # fmt: skip


def run_jobs(
    folder: Path, jobs: Sequence[LaneJob], executor: Executor, track: Track = silent
) -> None:
    """Run the lanes that are not on disk.

    Parameters
    ----------
    folder : Path
        Folder of the map of worlds.
    jobs : sequence of LaneJob
        The lanes of a part of the map.
    executor : Executor
        Workers, each at a lane.
    track : Track
        Shows progress.
    """
    pending = []
    for job in jobs:
        if not job.path(folder).is_file():
            pending.append((asdict(job), str(folder)))
    label = jobs[0].part if jobs else "lanes"
    for _ in track(executor.run(run_job, pending), label, len(pending)):
        pass


def run_job(job: Mapping[str, Any], folder: str) -> None:
    """Simulate and score a lane in a worker process, and write its record.

    Parameters
    ----------
    job : mapping
        Fields of a :class:`LaneJob`.
    folder : str
        Folder of the map of worlds.
    """
    lane = LaneJob(**job)
    read_or_make(lane.path(Path(folder)), partial(lane_record, lane))


def lane_record(lane: LaneJob) -> dict[str, Any]:
    """Simulate and score a lane: its targets, at which FAR each is found, its signal to clutter."""
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        scene = lane_scene(lane, Path(scratch))
    sensor = radar(lane.height)
    run, truth = simulate(scene, sensor, lane.seed)
    truth["body"] = [target.body for target in draw_world(scene, lane.seed).targets]
    scores = []
    for ground in lane.ground or (None,):
        alarms = detect(run, lane_recipe(ground), scene.lane).alarms
        scores.append(_scored(alarms, truth, scene, ground))
    ratios = signal_to_clutter(scene, sensor, lane.seed, tuple(_LANE["band"])).tolist()
    return {
        "about": lane.about,
        "seconds": time.process_time() - begin,
        "targets": truth[_TARGET_COLUMNS].to_dict("records"),
        "ratio_db": ratios,
        "found": scores,
    }


def lane_scene(lane: LaneJob, scratch: Path) -> Scene:
    """Return the scene of a lane.

    Parameters
    ----------
    lane : LaneJob
        The lane.
    scratch : Path
        Folder for the file of its site, which is not needed any more afterwards.
    """
    draws: list[dict[str, Any]] = []
    for mix in lane.mixes:
        draws += mix_draws(mix, _LANE["depth"], lane.count)
    site_file = scratch / "site.toml"
    write_site(site_file, lane.site)
    scene = Scene.model_validate(
        {
            "name": lane.name,
            "site": str(site_file),
            "length": lane.length,
            "draws": draws,
            "track": _LANE["track"],
            "surface": {"density": _LANE["density"]},
        }
    )
    # The tables of the site are in the scene now.
    return scene.model_copy(update={"site": None})


def radar(height: float | None = None) -> Sensor:
    """Load the array of Wang et al. 2007 with the tones of F1 alone.

    Parameters
    ----------
    height : float, optional
        Height of the array, m; the preset's by default.
    """
    sensor = f1_sensor(F1_BAND)
    return sensor if height is None else sensor.model_copy(update={"height": height})


def lane_recipe(ground: tuple[float, float] | None = None) -> Recipe:
    """Return the packaged recipe wang2007 with the sub-band F1 alone.

    Parameters
    ----------
    ground : tuple of float, optional
        Nearest and farthest ground that is used, m ahead; the recipe's own by default.
    """
    recipe = parse_recipe(f1_alone(recipe_text("wang2007")))
    if ground is None:
        return recipe
    nearest, farthest = ground
    image = recipe.image.model_copy(update={"y": (nearest, max(recipe.image.y[1], farthest))})
    view = recipe.run_view.model_copy(update={"y_max": farthest})
    return recipe.model_copy(update={"image": image, "run_view": view})


def _scored(
    alarms: pd.DataFrame, truth: pd.DataFrame, scene: Scene, ground: tuple[float, float] | None
) -> dict[str, Any]:
    """Return at which FAR (per m²) every target is found, and Pd by chance at the declared ones.

    None stands for what is not finite.
    """
    matched = match(alarms, truth, scene.lane, _LANE["halo"])
    curve = chance(matched).add_chance_column(roc_of(matched))
    by_chance = []
    for far in FAR:
        by_chance.append(float(curve["chance"].iloc[int(operating_row(curve, far))]))
    return {
        "ground": ground,
        "far": [_finite(float(far)) for far in assign(matched)["far"]],
        "chance": [_finite(share) for share in by_chance],
        "alarms": len(alarms),
    }


def _finite(value: float) -> float | None:
    """Return a number as JSON can hold it, None if it is not finite."""
    return value if math.isfinite(value) else None


def read_targets(folder: Path, jobs: Sequence[LaneJob]) -> pd.DataFrame:
    """Read the targets of the lanes that are on disk: a row per target and ground used.

    Parameters
    ----------
    folder : Path
        Folder of the map of worlds.
    jobs : sequence of LaneJob
        The lanes of a part of the map.

    Returns
    -------
    DataFrame
        The columns that tell what the lane is; ``lane``, its name; ``nearest`` and ``farthest``
        ground used, m (NaN: the recipe's own); ``target_id``, ``kind``, ``body``, ``x``, ``y``,
        ``depth`` (m); ``far``, the false alarms per m² at which the target is found (infinite where
        no alarm is near); ``chance_F``, Pd by chance in its lane at F false alarms per m²;
        ``ratio_db``, its signal to clutter, dB.
    """
    tables = []
    for job in jobs:
        path = job.path(folder)
        if path.is_file():
            tables += _target_tables(job, json.loads(path.read_text(encoding="utf-8")))
    if not tables:
        return pd.DataFrame()
    every = pd.concat(tables, ignore_index=True)
    first = [*jobs[0].about, "lane", "nearest", "farthest"]
    others = [name for name in every.columns if name not in first]
    return every[[*first, *others]]


def _target_tables(job: LaneJob, record: Mapping[str, Any]) -> list[pd.DataFrame]:
    """Return the targets of a lane's record, a table for each ground used."""
    targets = pd.DataFrame(record["targets"])
    targets["ratio_db"] = record["ratio_db"]
    tables = []
    for score in record["found"]:
        nearest, farthest = score["ground"] or (math.nan, math.nan)
        table = targets.assign(**record["about"], lane=job.name, nearest=nearest, farthest=farthest)
        table["far"] = [math.inf if far is None else far for far in score["far"]]
        for far, share in zip(FAR, score["chance"], strict=True):
            table[f"chance_{far:g}"] = math.nan if share is None else share
        tables.append(table)
    return tables


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
