"""Wang et al. 2007: why four statements of the calibration lanes do not hold, on repeats of them.

The repeats are those of ``evidence/replicates.py``, three lanes with the paper's mines. Those of a
number differ in nothing but the radar's errors. What each explanation predicts was written before
any of them ran.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import flgpr
from flgpr.model import Sensor
from flgpr.progress import Track, silent
from flgpr.recipe.schema import parse_recipe
from flgpr_papers.kit.cache import key_of
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.wang2007.analysis import (
    MINES,
    POLARIZATIONS,
    LaneResult,
    Pool,
    Rescorer,
    all_forty,
    prescreened,
)
from flgpr_papers.wang2007.lanes import LaneScenes, calibration_scenes, quick_scenes, sensor
from flgpr_papers.wang2007.study import lane_result
from reasons.trials import Trial, declared_trials, measured

Record = dict[str, float]
REPEATS = (18, 19, 20)
"""Numbers of the repeats, as of ``evidence/replicates.py``."""
RADARS: dict[str, dict[str, float]] = {
    "nothing": {},
    "noise 12 dB up": {"clutter_to_noise_db": 3.0},
    "heading and attitude three times as uncertain": {"heading": 0.0105, "attitude": 0.006},
    "neither noise nor leakage between polarizations": {
        "clutter_to_noise_db": 60.0,
        "isolation_db": -60.0,
    },
}
"""Errors of the radar that are replaced, by what is changed.

The preset has 15 dB, -23 dB, 0.0035 and 0.002 rad.
"""
OTHER_LEVEL = 1.0
"""Difference of two run-views that changes the order of places on a lane, dB."""
_BURIED = {**MINES, "depth": lambda depth: depth > 0}
_ON_SURFACE = {**MINES, "depth": lambda depth: depth < 0}


def calibration_trials(folder: Path, quick: bool, world: str, track: Track) -> list[Trial]:
    """Run the repeats, or read what was measured on those that are on disk in ``folder/reasons``.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    quick : bool
        Two repeats of the quick study's lanes: shows that everything runs.
    world : str
        World of the study.
    track : callable
        Shows progress.
    """
    repeats = REPEATS[:2] if quick else REPEATS

    def of_repeat(name: str, repeat: int) -> tuple[str, Callable[[], Record]]:
        scenes = calibration_scenes(world, repeat)
        if quick:
            scenes = {lane: (scene, repeat) for lane, (scene, _) in quick_scenes(world)[0].items()}
        declared = [(scene.model_dump(mode="json"), seed) for scene, seed in scenes.values()]
        key = key_of(declared, RADARS[name], flgpr.__version__)
        work = folder / "reasons" / f"calibration-{key}.lanes"
        return work.stem, partial(calibration_record, work, scenes, changed_radar(name))

    records = measured(folder, RADARS, repeats, of_repeat, track, "calibration lanes")
    return declared_trials("wang2007", "calibration", paired(records))


def paired(records: Mapping[str, Sequence[Record]]) -> dict[str, list[Record]]:
    """Add to every record what the change has gained on its lanes: " gained" after the name."""
    return {
        name: [
            record | {f"{number} gained": value - same[number] for number, value in record.items()}
            for record, same in zip(of_change, records["nothing"], strict=True)
        ]
        for name, of_change in records.items()
    }


def changed_radar(name: str) -> Sensor:
    """Return the study's radar with a change of ``RADARS``."""
    radar = sensor()
    return radar.model_copy(update={"errors": radar.errors.model_copy(update=RADARS[name])})


def calibration_record(work: Path, scenes: LaneScenes, radar: Sensor) -> dict[str, float]:
    """Run the calibration lanes in a folder of their own, delete it, and return the numbers.

    Parameters
    ----------
    work : Path
        Folder of the lanes.
    scenes : mapping of str to tuple
        Scene and seed of each lane.
    radar : Sensor
        The radar.
    """
    text = packaged_text("wang2007")
    results = [
        lane_result(work, scene, seed, radar, text, silent) for scene, seed in scenes.values()
    ]
    recipe = parse_recipe(text)
    record = prescreener_numbers(results, recipe) | feature_numbers(Pool(results))
    shutil.rmtree(work)
    return record


def prescreener_numbers(results: Sequence[LaneResult], recipe: Any) -> dict[str, float]:
    """Return PD_mean of run-views (y_max and the two highest sub-bands), and how far two differ.

    Parameters
    ----------
    results : sequence of LaneResult
        The lanes, with other run-views.
    recipe : Recipe
        Recipe of the study.
    """
    record = {"other level": float(np.mean([_other_level(result) for result in results]))}
    for reach, view in {"16 m": "F1", "26 m": "wide"}.items():
        match = prescreened(results, "HH", view, recipe)
        record[reach] = Rescorer(match, MINES)(match.confidence)
    for polarization in POLARIZATIONS:
        for band in ("F3", "F4"):
            match = prescreened(results, polarization, band, recipe)
            for where, subset in {"buried": _BURIED, "surface": _ON_SURFACE}.items():
                record[f"{polarization} {band} {where}"] = Rescorer(match, subset)(match.confidence)
    return record


def _other_level(result: LaneResult) -> float:
    """Return the share of a lane where looks from beyond Y_max change the run-view."""
    near = result.view.sel(polarization="HH", subband="F1").values
    ratio = 20 * np.log10(result.other_views["wide"].values / near)
    return float(np.mean(np.abs(ratio[np.isfinite(ratio)]) > OTHER_LEVEL))


def feature_numbers(pool: Pool) -> dict[str, float]:
    """Return PD_mean of features and of the best five of all sub-bands.

    Parameters
    ----------
    pool : Pool
        Alarms of the lanes.
    """
    names = ("C_HH", "R_VV_HV", "R_HH_HV", "P_alpha")
    singles = pool.singles([f"{name}_F1" for name in names], "A")
    five = pool.search(all_forty(), "A", 5)
    nested, _, _ = pool.nested(all_forty(), 5)
    crossed = pool.singles(["C_HH_F1"], "C")
    return {
        **dict(zip(names, map(float, singles), strict=True)),
        "five": five[-1].score,
        "first of five": five[0].score,
        "five nested": nested,
        "C_HH by the other lanes": float(crossed[0]),
    }
