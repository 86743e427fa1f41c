"""Reproduce Wang et al. 2007 on simulated lanes: three calibration and four blind ones, one page.

The study in order: simulate every lane, run the detection chain of the recipe on it, judge the
paper's statements by all lanes (:mod:`flgpr_papers.wang2007.findings`), write the page.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.clutter import Background
from flgpr.imaging import ScanImager
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detection_of, engine_of
from flgpr.model import Lane, check_tones
from flgpr.progress import Track, silent
from flgpr.recipe.schema import Recipe, parse_recipe
from flgpr.results.description import describe_run
from flgpr.results.errors import ResultError
from flgpr.results.result import read_result, write_result
from flgpr.screen import RunViewSums, view_array
from flgpr.simulate import Scene, Sensor
from flgpr.store import open_run, read_manifest, sha256, write_whole
from flgpr_papers.kit.cache import read_arrays, store_lane, write_arrays
from flgpr_papers.kit.findings import write_findings
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread
from flgpr_papers.wang2007.analysis import LaneResult
from flgpr_papers.wang2007.costs import MEDIAN_STEP, Lanes, cost_table
from flgpr_papers.wang2007.examples import save_examples
from flgpr_papers.wang2007.lanes import (
    F1_BAND,
    LaneScenes,
    blind_scenes,
    calibration_scenes,
    f1_alone,
    quick_scenes,
    sensor,
)
from flgpr_papers.wang2007.page import page_html

PAGE = "wang2007.html"


@one_blas_thread
def reproduce(
    output: str | Path, quick: bool = False, track: Track = silent, world: str = OWN
) -> Path:
    """Simulate the lanes, run the chain on them, and write the page.

    A simulated lane or a lane's result that is on disk is used if it was made from the same scene,
    sensor and recipe, so that an interrupted run resumes lane by lane.

    Parameters
    ----------
    output : str or Path
        Folder to work in.
    quick : bool
        Small lanes that only show that everything runs.
    track : Track
        Shows progress.
    world : str
        World of the lanes, see `flgpr_papers.kit.study_worlds`.

    Returns
    -------
    Path
        The page.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    calibration_names, blind_names = _lanes(quick, world)
    lanes = Lanes(
        calibration=[make_part(folder, name, quick, world, track) for name in calibration_names],
        blind=[make_part(folder, name, quick, world, track) for name in blind_names],
    )
    coarse_lanes = Lanes(
        calibration=[coarse_part(folder, name, quick, world, track) for name in calibration_names],
        blind=[coarse_part(folder, name, quick, world, track) for name in blind_names],
    )
    costs = cost_table(lanes, coarse_lanes, draws=100 if quick else 1000)
    write_whole(folder / "costs.csv", costs.round(4).to_csv(index=False))
    html, findings = page_html(
        folder,
        lanes.calibration,
        lanes.blind,
        parse_recipe(packaged_text("wang2007")),
        sensor(),
        quick,
        track,
        costs,
        study_world("wang2007", world),
        other_world(folder, PAGE, world, quick),
    )
    write_findings(folder, findings, quick, world=world)
    write_whole(folder / PAGE, html)
    return folder / PAGE


def parts(quick: bool) -> list[str]:
    """Return the names of the lanes, each of which can be run by itself, the longest first."""
    calibration, blind = _lanes(quick)
    return [*blind, *calibration]


@one_blas_thread
def make_part(
    folder: Path, name: str, quick: bool, world: str = OWN, track: Track = silent
) -> LaneResult:
    """Run a lane through the chain, or read its result if it is on disk.

    A blind lane has the sub-band F1 alone, which the frozen classifiers read. The lane is run a
    second time with the coarse median of the recipe wang2007, for the table of costs.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    name : str
        Name of the lane, see :func:`parts`.
    quick, track, world
        As of :func:`reproduce`.
    """
    calibration, blind = _lanes(quick, world)
    if name in calibration:
        scene, seed = calibration[name]
        text = packaged_text("wang2007")
        result = lane_result(folder, scene, seed, sensor(), text, track, examples=name == "c1")
    else:
        scene, seed = blind[name]
        radar = sensor(F1_BAND)
        result = lane_result(
            folder, scene, seed, radar, f1_alone(packaged_text("wang2007")), track, wide=False
        )
    coarse_part(folder, name, quick, world, track)
    return result


def coarse_part(
    folder: Path, name: str, quick: bool, world: str = OWN, track: Track = silent
) -> LaneResult:
    """Run a lane with the coarse median of the recipe wang2007, in F1 alone.

    The parameters are those of :func:`make_part`.
    """
    calibration, blind = _lanes(quick, world)
    if name in calibration:
        scene, seed = calibration[name]
        radar = sensor()
    else:
        scene, seed = blind[name]
        radar = sensor(F1_BAND)
    text = f1_alone(packaged_text("wang2007")).replace(
        "median_step = 1\n", f"median_step = {MEDIAN_STEP}\n"
    )
    return lane_result(folder, scene, seed, radar, text, track, wide=False, suffix="-coarse")


def _lanes(quick: bool, world: str = OWN) -> tuple[LaneScenes, LaneScenes]:
    """Return the scenes of the calibration and of the blind lanes."""
    if quick:
        return quick_scenes(world=world)
    return calibration_scenes(world), blind_scenes(world)


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
        Whether there is a run-view over the full range of the images, too.
    suffix : str
        Added to the name of the result, where another recipe runs on the same lane.
    """
    recipe = parse_recipe(text)
    check_tones(radar, recipe.image.x, recipe.image.y)
    store, truth, lane = store_lane(folder / "lanes", scene, seed, radar, track)
    result_folder = folder / "results" / f"{scene.name}{suffix}"
    wide_file = folder / "results" / f"{scene.name}-wide.bundle"
    examples_file = folder / "results" / "examples.bundle"
    is_complete = _is_done(result_folder, store, text)
    if wide and not wide_file.is_file():
        is_complete = False
    if examples and not examples_file.is_file():
        is_complete = False
    if not is_complete:
        run = open_run(store)
        setup = ImagedRun(run, recipe, lane, explains=False, whole_background=True)
        engine_of(setup).run(track, ("signature", "gain", "view", "alarms", "features"))
        detection = detection_of(setup)
        wide_file.parent.mkdir(parents=True, exist_ok=True)
        if examples:
            save_examples(examples_file, setup, run, recipe, truth, detection.alarms)
        if wide:
            view = wide_view(setup, run, recipe, lane, track)
            write_arrays(wide_file, {"view": view.values, "looks": view["looks"].values})
        write_result(result_folder, [detection], text, lane, describe_run(run, store))
    full_range_view = None
    if wide:
        arrays = read_arrays(wide_file)
        grid = recipe.run_view.grid(lane)
        full_range_view = view_array(arrays["view"], arrays["looks"], grid, {})
    main = read_result(result_folder).detections[0]
    return LaneResult(
        name=scene.name,
        lane=lane,
        truth=truth,
        alarms=main.alarms,
        features=pd.DataFrame() if main.features is None else main.features,
        view=main.view,
        wide_view=full_range_view,
    )


def wide_view(
    imaged: ImagedRun, run: xr.Dataset, recipe: Recipe, lane: Lane, track: Track
) -> xr.DataArray:
    """Compute the run-view of the prescreener's channel over the full range of the images.

    Parameters
    ----------
    imaged : ImagedRun
        The lane's run with its backgrounds.
    run : Dataset
        The run itself.
    recipe : Recipe
        Recipe of the study.
    lane : Lane
        Borders of the lane.
    track : Track
        Shows progress.

    Returns
    -------
    DataArray
        Magnitude (y, x) in the lane frame.
    """
    screen = recipe.prescreen
    table = recipe.image
    polarizations = [str(label) for label in run["polarization"].values]
    p = polarizations.index(screen.polarization)
    b = list(table.subbands).index(screen.subband)
    channel = (slice(p, p + 1), slice(b, b + 1))
    background = _background_of(imaged.whole_background, channel)
    band = {screen.subband: table.subbands[screen.subband]}
    # Whether a scan is complete depends on all polarizations: the scans are chosen before one
    # polarization is taken.
    chosen = run.isel(scan=imaged.imager.scans, polarization=[p])
    imager = ScanImager(chosen, table.grid(), band, table.window, table.tolerance)
    grid = recipe.run_view.grid(lane)
    sums = RunViewSums(grid, table.y[1])
    for image, gain in zip(track(imager, "full range", len(imager)), imaged.gains, strict=True):
        magnitude = background.magnitude(image.values, np.ascontiguousarray(gain[channel]))
        sums.add(magnitude[0, 0], imager.grid, np.asarray(image.attrs["pose"]))
    return view_array(*sums.result(), grid, {})


def _background_of(background: Background, channel: tuple[slice, slice]) -> Background:
    """Return the background of one polarization and sub-band, in contiguous arrays."""
    _, subband = channel
    arrays = (
        background.signature[channel],
        background.gain[channel],
        background.shared_signature[channel],
        background.shared_gain[subband],
    )
    return Background(*(np.ascontiguousarray(array) for array in arrays))  # type: ignore[arg-type]


def _is_done(result_folder: Path, store: Path, text: str) -> bool:
    """Return whether there is a result of this store and recipe."""
    try:
        manifest: dict[str, Any] = read_result(result_folder).manifest
    except ResultError:
        return False
    if manifest["run"].get("store_sha256") != read_manifest(store)["sha256"]:
        return False
    return bool(manifest["recipe_sha256"] == sha256(text.encode()))
