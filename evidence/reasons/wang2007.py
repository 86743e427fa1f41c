"""Experiments on why statements of Wang et al. 2007 do not hold here, and what our recipe costs.

Small twins of its lanes with one thing changed. Twins have the study's site, radar and drive. Those
of one seed differ in nothing but what is changed. What each explanation predicts was written before
they ran.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import flgpr
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import engine_of
from flgpr.model import lane_to_scan
from flgpr.progress import Track, silent
from flgpr.recipe.schema import Recipe, parse_recipe, recipe_text
from flgpr.screen import RunViewSums, view_array
from flgpr.simulate import BARE, EVEN, Scene, simulate
from flgpr.simulate.bodies.signature.table import body_size
from flgpr_papers.kit.cache import key_of
from flgpr_papers.kit.mines import mix_draws
from flgpr_papers.kit.scenes import changed
from flgpr_papers.kit.study_worlds import OWN, study_world
from flgpr_papers.wang2007.analysis import LaneResult, clutter_levels, stands_out
from flgpr_papers.wang2007.lanes import TRACK, sensor
from reasons.calibration_lanes import calibration_trials
from reasons.recipe_costs import cost_trials
from reasons.trials import Trial, declared_trials, measured

FloatArray = NDArray[np.float64]
Record = Mapping[str, Any]
SEEDS = (301, 302)
"""Seeds of the twins with each change."""
CLUTTER_LENGTH = 150.0
"""Length of a lane on which clutter is measured, m."""
SCAN_EVERY = 3
"""Of so many scans one is measured by itself."""
NEAR, FAR, HALF = 8.0, 16.0, 3.0
"""Ground that the paper's Fig. 8 shows: from NEAR to FAR ahead and HALF to either side, m."""
CLEAR = 1.5
"""Distance from every target at which clutter is measured, m."""
_CLUTTER_DRAWS = (
    ("metal", -0.15, 2),
    ("plastic", -0.15, 1),
    ("metal", 0.05, 1),
    ("metal", 0.10, 1),
    ("plastic", 0.05, 2),
    ("plastic", 0.10, 1),
    ("simulant", 0.05, 2),
)
_TARGETS = "targets taken out"
_STREWN = "nothing in or on the soil"
_BESIDE = "nothing beside the lane"
_SURFACE = "the surface alone"
_EVEN_SURFACE = "the surface alone, without patchiness"
_IN_SOIL: dict[str, dict[str, Any]] = {
    **EVEN,
    "clutter": {"rocks": 0.0, "patches": 0.0},
    "holes": {"empty": 0.0},
}
_ALONE: dict[str, dict[str, Any]] = {**EVEN, "clutter": BARE, "holes": {"on": False}}
CLUTTER_CHANGES: dict[str, tuple[bool, dict[str, dict[str, Any]]]] = {
    "nothing": (True, {}),
    _TARGETS: (False, {}),
    _STREWN: (True, _IN_SOIL),
    _BESIDE: (True, {"clutter": {"bushes": 0.0, "posts": 0.0}}),
    _SURFACE: (False, _ALONE),
    _EVEN_SURFACE: (False, _ALONE | {"surface": {"texture_shape": None}}),
}
"""Whether there are targets, and entries of the scene's parts, by what is changed."""


def trials(
    folder: Path, quick: bool = False, world: str = OWN, track: Track = silent
) -> list[Trial]:
    """Run the experiments, or read those that are on disk in ``folder/reasons``.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    quick : bool
        Short lanes of one seed with a thin surface: shows that everything runs.
    world : str
        World of the study. The costs are of prepared lanes alone.
    track : callable
        Shows progress.

    Returns
    -------
    list of Trial
        In the order of the statements.
    """
    seeds = SEEDS[:1] if quick else SEEDS

    def of_lane(name: str, seed: int) -> tuple[str, Callable[[], Record]]:
        scene = clutter_scene(name, quick, world)
        key = key_of(scene.model_dump(mode="json"), seed, SCAN_EVERY, flgpr.__version__)
        return f"clutter-{key}", partial(clutter_record, scene, seed)

    records = measured(folder, CLUTTER_CHANGES, seeds, of_lane, track, "changed lanes")
    trial_list = clutter_trials(records)
    trial_list += calibration_trials(folder, quick, world, track)
    if world == OWN:
        trial_list += cost_trials(folder, quick, world, track)
    return trial_list


def clutter_scene(name: str, quick: bool = False, world: str = OWN) -> Scene:
    """Return a lane of the study's site with few targets and a change of ``CLUTTER_CHANGES``.

    Parameters
    ----------
    name : str
        Name of the change.
    quick : bool
        A short lane.
    world : str
        World of the study.
    """
    targets, tables = CLUTTER_CHANGES[name]
    site = study_world("wang2007", world)
    draws: list[dict[str, Any]] = []
    for kind, depth, count in _CLUTTER_DRAWS if targets else ():
        draws += _draws(kind, depth, count, site.mixes.get(kind))
    scene = Scene.model_validate(
        {
            "name": "twin",
            "site": site.sites["lane"],
            "length": 36.0 if quick else CLUTTER_LENGTH,
            "draws": draws,
            "track": {**TRACK, "step": (2.6, 3.0), "start": -14.0} if quick else TRACK,
            "surface": {"density": 20.0 if quick else 100.0},
        }
    )
    changes: dict[str, Any] = {table: dict(entries) for table, entries in tables.items()}
    return changed(scene, **changes)


def _draws(kind: str, depth: float, count: int, mix: str | None) -> list[dict[str, Any]]:
    """Return the draws of mines of a mix, or of the generic body (None).

    A body that lies on the ground has the depth of its own height.
    """
    if mix is None:
        return [{"kind": kind, "depth": depth, "count": count}]
    draws = mix_draws(mix, depth, count)
    if depth < 0:
        for draw in draws:
            draw["depth"] = -body_size(draw["body"])["height"]
    return draws


def clutter_record(scene: Scene, seed: int) -> dict[str, Any]:
    """Simulate a lane in HH and VV and measure how far its clutter stands out in every sub-band.

    Parameters
    ----------
    scene : Scene
        The lane.
    seed : int
        Seed of what the scene leaves to chance.

    Returns
    -------
    dict
        ``view``, a row per stretch of 10 m of the run-view, and ``scans``, a row per scan image
        that was measured: the 99 % quantile over the median, dB, by channel ("HH F1").
    """
    radar = sensor().model_copy(update={"polarization": ("HH", "VV")})
    run, truth = simulate(scene, radar, seed)
    recipe = parse_recipe(recipe_text("wang2007"))
    setup = ImagedRun(run, recipe, scene.lane, explains=False)
    engine_of(setup).run(silent, ("signature", "gain"))
    view, scans = _run_view(setup, run, recipe, scene, truth)
    result = LaneResult("twin", scene.lane, truth, pd.DataFrame(), pd.DataFrame(), view, {})
    levels = clutter_levels([result], CLEAR).drop(columns="lane")
    return {"view": levels.to_dict("records"), "scans": scans}


def _run_view(
    imaged: ImagedRun, run: xr.Dataset, recipe: Recipe, scene: Scene, truth: pd.DataFrame
) -> tuple[xr.DataArray, list[dict[str, Any]]]:
    """Put the cleaned scan images together to a run-view, and measure some by themselves."""
    grid = recipe.run_view.grid(scene.lane)
    sums = RunViewSums(grid, recipe.run_view.y_max)
    channels = {
        "polarization": [str(label) for label in run["polarization"].values],
        "subband": list(recipe.image.subbands),
    }
    rows = []
    for index in range(len(imaged)):
        image = imaged.near_image(index)
        magnitude = imaged.background.magnitude(image.values, imaged.gains[index])
        sums.add(magnitude, imaged.near, np.asarray(image.attrs["pose"]))
        if index % SCAN_EVERY == 0:
            rows.append(_scan_row(magnitude, image, channels, truth))
    return view_array(*sums.result(), grid, channels), rows


def _scan_row(
    magnitude: NDArray[Any],
    image: xr.DataArray,
    channels: Mapping[str, Sequence[str]],
    truth: pd.DataFrame,
) -> dict[str, float]:
    """Return how far clutter stands out in a scan image, on the ground of the paper's Fig. 8."""
    x, y = np.meshgrid(image["x"].values, image["y"].values)
    chosen = (np.abs(x) <= HALF) & (y >= NEAR) & (y <= FAR)
    targets = np.column_stack([truth["x"], truth["y"], np.zeros(len(truth))])
    for target_x, target_y, _ in lane_to_scan(targets, np.asarray(image.attrs["pose"])):
        chosen &= np.hypot(x - target_x, y - target_y) > CLEAR
    row = {}
    for p, polarization in enumerate(channels["polarization"]):
        for b, subband in enumerate(channels["subband"]):
            row[f"{polarization} {subband}"] = stands_out(magnitude[p, b][chosen])
    return row


def clutter_trials(records: Mapping[str, Sequence[Record]]) -> list[Trial]:
    """Return trials of what makes clutter in HH stand out less in F2 than in F1 (Fig. 8)."""
    rows = {}
    for name, of_lanes in records.items():
        rows[name] = list(chain.from_iterable(record["view"] for record in of_lanes))
        rows[f"scans: {name}"] = list(chain.from_iterable(record["scans"] for record in of_lanes))
    return declared_trials("wang2007", "clutter", rows, lanes=len(records["nothing"]))
