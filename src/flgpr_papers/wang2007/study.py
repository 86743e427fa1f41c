"""Reproduce Wang et al. 2007 on simulated lanes: three calibration and four blind ones, one page.

The study in order: simulate every lane, run the detection chain of the recipe on it, judge the
paper's statements by all lanes (:mod:`flgpr_papers.wang2007.findings`).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.clutter import Background
from flgpr.design.point_spread import PointSpread
from flgpr.features import FEATURES
from flgpr.imaging import ScanImager
from flgpr.method.classifier import count_mines, make_training_set
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detection_of, engine_of
from flgpr.model import Sensor, check_tones
from flgpr.progress import Track, silent
from flgpr.recipe.schema import parse_recipe
from flgpr.results.description import describe_run
from flgpr.results.manifest import ResultError
from flgpr.results.result import read_result, write_result
from flgpr.scoring import Match, roc_of
from flgpr.scoring.curve import held_pd_mean
from flgpr.screen import MeanViewSums, RunViewSums, view_array
from flgpr.simulate import Scene
from flgpr.store import open_run, read_manifest, sha256
from flgpr.types import AnyArray, Arrays, Entries, floats
from flgpr_papers.kit.cache import read_arrays, store_lane, write_arrays
from flgpr_papers.kit.intervals import SHARE, spread
from flgpr_papers.kit.page import HEADER, detections_at, point_rows
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study import Outcome, Study
from flgpr_papers.kit.study_worlds import OWN
from flgpr_papers.wang2007 import figures
from flgpr_papers.wang2007.analysis import (
    AREA,
    BANDS,
    BURIED_METAL,
    BURIED_PLASTIC,
    METHODS,
    MINES,
    POLARIZATIONS,
    SIMULANTS,
    LaneResult,
    all_forty,
    clutter_levels,
)
from flgpr_papers.wang2007.examples import save_examples
from flgpr_papers.wang2007.figures import Measured
from flgpr_papers.wang2007.findings import SETS, Tables, all_findings
from flgpr_papers.wang2007.lanes import (
    F1_BAND,
    LaneScenes,
    blind_scenes,
    calibration_scenes,
    f1_alone,
    quick_scenes,
    sensor,
)


def page_facts(measured: Measured) -> Entries:
    """Return what the captions and their numbers take."""
    recipe = measured.recipe
    radar = measured.radar
    calibration = measured.calibration
    examples = measured.examples
    image = recipe.image
    tones = radar.tones.axis()
    middle = float(np.mean(image.y))
    resolution = {}
    for name in BANDS:
        response = PointSpread(radar, image.subbands[name], image.window)
        resolution[name] = 100 * response.widths((0.0, middle, 0.0))[0]
    steps = np.abs(np.diff(examples["series_place"][:, 1]))
    median, mean, step = recipe.smoothing
    known = make_training_set([result.training for result in calibration], columns=["M_HH_F1"])
    false_alarms = int((measured.tables.pool.labels["label"] == "false").sum())
    mines = count_mines(result.truth for result in calibration)
    return {
        "recipe": recipe,
        "radar": radar,
        "image": image,
        "tones": tones,
        "transmitters": len(radar.tx),
        "receivers": len(radar.rx),
        "tilt": np.degrees(radar.tilt),
        "first": tones[0] / 1e6,
        "last": tones[-1] / 1e9,
        "width": np.ptp(image.x),
        "example": dict(zip(examples["names"], examples["titles"], strict=True)),
        "middle": middle,
        "resolution": resolution,
        "shortest": steps.min(),
        "longest": steps.max(),
        "likeness": likeness(examples["series"]),
        "median": median,
        "mean": mean,
        "every": "" if step == 1 else f", at every {step}th both ways",
        "view_width": np.ptp(recipe.run_view.x),
        "pixel": 100 * recipe.run_view.spacing,
        "patch_pixel": 100 * recipe.contrast.spacing,
        "false_per_mine": false_alarms / max(mines, 1),
        "training": known.weight.size,
        "duplicated": known.weight.sum(),
        **_alarm_facts(measured),
    }


def _alarm_facts(measured: Measured) -> Entries:
    """Return what the captions say of clutter, alarms and Pd."""
    recipe = measured.recipe
    calibration = measured.calibration
    tables = measured.tables
    area = sum(np.ptp(recipe.run_view.x) * result.length for result in calibration)
    alarms = sum(len(result.alarms) for result in calibration)
    levels = clutter_levels(calibration)
    clutter = {}
    pd_means = {}
    for name in POLARIZATIONS:
        clutter[name] = ", ".join(f"{band} {levels[f'{name} {band}'].mean():.1f}" for band in BANDS)
        texts = []
        for band in BANDS:
            curve = roc_of(tables.channels[name, band], MINES, area=AREA)
            texts.append(f"{band} {held_pd_mean(curve):.2f}")
        pd_means[name] = ", ".join(texts)
    contrast = tables.pool.match_of(tables.pool.confidence(SETS["A"], "A"))
    pds = {}
    for far in (0.02, 0.07):
        pds[f"plastic {far}"] = _pd(contrast, BURIED_PLASTIC, far)
        pds[f"simulants {far}"] = _pd(contrast, SIMULANTS, far)
    for name, match in tables.blind.items():
        pds[f"{name} metal"] = _pd(match, BURIED_METAL, 0.01)
        pds[f"{name} plastic"] = _pd(match, BURIED_PLASTIC, 0.05)
    return {
        "density": alarms * np.pi * recipe.prescreen.radius**2 / area,
        "clutter": clutter,
        "pd_mean": pd_means,
        "prescreened": _pd(tables.channels["HH", "F1"], MINES, 0.15),
        "pd": pds,
    }


def likeness(series: AnyArray) -> float:
    """Return the mean correlation of neighbouring images of a series, of their levels in dB.

    Parameters
    ----------
    series : (image, y, x) ndarray
        Magnitudes.
    """
    levels = np.log(np.maximum(floats(series.reshape(len(series), -1)), 1e-30))
    return float(np.mean([np.corrcoef(first, second)[0, 1] for first, second in pairwise(levels)]))


def _pd(matched: Match, subset: Any, far: float) -> str:
    """Write a Pd as counts, with the chance level."""
    n_found, targets, by_chance = detections_at(matched, subset, far, area=AREA)
    return f"{n_found} of {targets}, chance {by_chance:.0%}"


def page_tables(measured: Measured) -> Entries:
    """Return what the template of the page takes."""
    tables = measured.tables
    pool = tables.pool
    score, confidence, chosen = pool.nested(all_forty()[:10], 5)
    low, high = pool.interval(confidence, tables.draws)
    return {
        "radar": measured.radar,
        "lanes": [*measured.calibration, *measured.blind],
        "header": HEADER,
        "points": _point_rows(tables),
        "retrained": _retrained(tables),
        "methods": METHODS,
        "features": list(FEATURES),
        "numbered": [f"#{number} {name}" for number, name in enumerate(FEATURES, start=1)],
        "printed": tomllib.loads(packaged_text("wang2007", "paper")),
        "tables": tables,
        "swapped": pool.singles([f"swapped.{name}_F1" for name in FEATURES], "A"),
        "shared": pool.singles([f"shared.{name}_F1" for name in FEATURES[6:]], "A"),
        "nested": {
            "score": score,
            "low": low,
            "high": high,
            "chosen": "; ".join(", ".join(names) for names in chosen),
        },
    }


def _point_rows(tables: Tables) -> list[tuple[str, ...]]:
    """Tabulate Pd at the operating points, of prescreener and classifiers on all lanes."""
    pool = tables.pool
    matches = {"prescreener, HH F1": tables.channels["HH", "F1"]}
    for name, columns in SETS.items():
        matches[f"{name}, calibration"] = pool.match_of(pool.confidence(columns, "C"))
    blind_matches = {f"{name}, blind": match for name, match in tables.blind.items()}
    subsets: Entries
    subsets = {"buried metal": BURIED_METAL, "buried plastic": BURIED_PLASTIC, "mines": MINES}
    rows = point_rows(matches, {**subsets, "simulants": SIMULANTS}, area=AREA)
    return rows + point_rows(blind_matches, subsets, area=AREA)


def _retrained(tables: Tables) -> list[tuple[Any, ...]]:
    """Return PD_mean of both classifiers by methods A and C, with two intervals.

    The first is over lanes and targets alone, the second with training in every draw.
    """
    pool = tables.pool
    rows = []
    for (name, columns), method in product(SETS.items(), "AC"):
        confidence = pool.confidence(columns, method)
        value = pool.scorer(confidence)
        drawn = pool.retrained(columns, method, tables.retrainings)
        anew = spread(value, drawn, bounds=SHARE)[1:]
        rows.append((name, METHODS[method], value, pool.interval(confidence, tables.draws), anew))
    return rows


VIEWS = ("wide", "largest", "mean")
"""Other run-views of the prescreener's channel that are computed beside that of the recipe."""


def run(folder: Path, quick: bool, track: Track, world: str) -> Outcome:
    """Simulate the lanes, run the chain on them, and judge them.

    A simulated lane or a lane's result that is on disk is used if it was made from the same scene,
    sensor and recipe.
    """
    calibration, blind = [
        [make_part(folder, name, quick, world, track) for name in scenes]
        for scenes in lane_scenes(quick, world)
    ]
    recipe = parse_recipe(packaged_text("wang2007"))
    findings, tables = all_findings(calibration, blind, recipe, 100 if quick else 1000)
    measured = Measured(
        recipe=recipe,
        radar=sensor(),
        calibration=calibration,
        blind=blind,
        tables=tables,
        examples=read_arrays(folder / "results" / "examples.bundle"),
    )
    return Outcome(
        findings=findings,
        measured=measured,
        facts=page_facts(measured),
        tables=page_tables(measured),
    )


def lane_scenes(quick: bool, world: str = OWN) -> tuple[LaneScenes, LaneScenes]:
    """Return the scenes of the calibration and of the blind lanes."""
    if quick:
        return quick_scenes(world)
    return calibration_scenes(world), blind_scenes(world)


def _parts(quick: bool) -> list[str]:
    """Return the names of the lanes, the longest first."""
    calibration, blind = lane_scenes(quick)
    return [*blind, *calibration]


def make_part(
    folder: Path, name: str, quick: bool, world: str = OWN, track: Track = silent
) -> LaneResult:
    """Run a lane through the chain, or read its result if it is on disk.

    A blind lane has the sub-band F1 alone, which the frozen classifiers read.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    name : str
        Name of the lane.
    quick, track, world
        As the study runs.
    """
    text = packaged_text("wang2007")
    calibration, blind = lane_scenes(quick, world)
    if name in calibration:
        scene, seed = calibration[name]
        is_first = name == "c1"
        return lane_result(folder, scene, seed, sensor(), text, track, examples=is_first)
    scene, seed = blind[name]
    return lane_result(folder, scene, seed, sensor(F1_BAND), f1_alone(text), track, wide=False)


def lane_result(
    folder: Path,
    scene: Scene,
    seed: int,
    radar: Sensor,
    text: str,
    track: Track,
    examples: bool = False,
    wide: bool = True,
    suffix: str = "",
) -> LaneResult:
    """Simulate a lane and run the chain on it, or read what is on disk.

    Parameters
    ----------
    folder : Path
        Folder of the study: ``lanes`` has the run stores, ``results`` the results.
    scene : Scene
        The lane.
    seed : int
        Seed of everything that the scene leaves to chance.
    radar : Sensor
        The radar.
    text : str
        The recipe, TOML.
    track : Track
        Shows progress.
    examples : bool
        Whether the images of single targets are saved, for the figures.
    wide : bool
        Whether there are other run-views of the prescreener's channel, too.
    suffix : str
        Added to the name of the result, where another recipe runs on the same lane.
    """
    recipe = parse_recipe(text)
    check_tones(radar, recipe.image.x, recipe.image.y)
    store, truth, lane = store_lane(folder / "lanes", scene, seed, radar, track)
    results = folder / "results"
    result_folder = results / f"{scene.name}{suffix}"
    views_file = results / f"{scene.name}-views.bundle"
    examples_file = results / "examples.bundle"
    is_complete = _is_done(result_folder, store, text)
    is_complete &= (views_file.is_file() or not wide) and (examples_file.is_file() or not examples)
    if not is_complete:
        results.mkdir(parents=True, exist_ok=True)
        imaged = ImagedRun(open_run(store), recipe, lane, explains=False, whole_background=True)
        engine_of(imaged).run(track, ("signature", "gain", "view", "alarms", "features"))
        detection = detection_of(imaged)
        if examples:
            save_examples(examples_file, imaged, truth, detection.alarms)
        if wide:
            write_arrays(views_file, other_views(imaged, track))
        write_result(result_folder, [detection], text, lane, describe_run(imaged.run, store))
    views = {}
    if wide:
        arrays = read_arrays(views_file)
        grid = recipe.run_view.grid(lane)
        for name in VIEWS:
            views[name] = view_array(arrays[name], arrays[f"{name} looks"], grid, {})
    main = read_result(result_folder).detections[0]
    features = pd.DataFrame() if main.features is None else main.features
    return LaneResult(scene.name, lane, truth, main.alarms, features, main.view, views)


class LargestViewSums(RunViewSums):
    """Find the largest magnitude at every pixel of the lane."""

    def _view(self, sums: Mapping[str, AnyArray]) -> AnyArray:
        return sums["first"]


def other_views(imaged: ImagedRun, track: Track) -> Arrays:
    """Compute other run-views of the prescreener's channel, by the names ``VIEWS``.

    "wide" is over the full range of the images; "largest" and "mean" take the largest or the mean of
    the looks in place of the second largest.

    Parameters
    ----------
    imaged : ImagedRun
        The lane's run with its backgrounds.
    track : Track
        Shows progress.

    Returns
    -------
    dict
        Magnitude (y, x) in the lane frame by name, and with " looks" behind it the number of looks.
    """
    screen = imaged.recipe.prescreen
    table = imaged.recipe.image
    polarizations = [str(label) for label in imaged.run["polarization"].values]
    p = polarizations.index(screen.polarization)
    b = list(table.subbands).index(screen.subband)
    channel = slice(p, p + 1), slice(b, b + 1)
    whole = imaged.whole_background
    of_channel = [whole.signature[channel], whole.gain[channel], whole.shared_signature[channel]]
    arrays_of = map(np.ascontiguousarray, (*of_channel, whole.shared_gain[channel[1]]))
    background = Background(*arrays_of)  # type: ignore[arg-type]
    band = {screen.subband: table.subbands[screen.subband]}
    # Whether a scan is complete depends on all polarizations: the scans are chosen before one
    # polarization is taken.
    chosen = imaged.run.isel(scan=imaged.imager.scans, polarization=[p])
    imager = ScanImager(chosen, table.grid(), band, table.window, table.tolerance)
    grid = imaged.recipe.run_view.grid(imaged.lane)
    near = imaged.recipe.run_view.y_max
    sums = {
        "wide": RunViewSums(grid, table.y[1]),
        "largest": LargestViewSums(grid, near),
        "mean": MeanViewSums(grid, near),
    }
    for image, gain in zip(track(imager, "full range", len(imager)), imaged.gains, strict=True):
        magnitude = background.magnitude(image.values, np.ascontiguousarray(gain[channel]))
        for of_view in sums.values():
            of_view.add(magnitude[0, 0], imager.grid, np.asarray(image.attrs["pose"]))
    arrays: Arrays = {}
    for name, of_view in sums.items():
        arrays[name], arrays[f"{name} looks"] = of_view.result()
    return arrays


def _is_done(result_folder: Path, store: Path, text: str) -> bool:
    """Return whether there is a result of this store and recipe."""
    try:
        manifest = read_result(result_folder).manifest
    except ResultError:
        return False
    has_same_store = manifest["run"].get("store_sha256") == read_manifest(store)["sha256"]
    return bool(has_same_store and manifest["recipe_sha256"] == sha256(text.encode()))


STUDY = Study("wang2007", "wang2007.html", figures, run, _parts, make_part, dpi=(100, 100))
