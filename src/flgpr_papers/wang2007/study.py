"""Reproduce Wang et al. 2007 on simulated lanes: three calibration and four blind ones, one page.

The study in order: simulate every lane, run the detection chain of the recipe on it, judge the
paper's statements by all lanes (:mod:`flgpr_papers.wang2007.findings`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.clutter import Background
from flgpr.imaging import ScanImager
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detection_of, engine_of
from flgpr.model import Sensor, check_tones
from flgpr.progress import Track, silent
from flgpr.recipe.schema import parse_recipe
from flgpr.results.description import describe_run
from flgpr.results.manifest import ResultError
from flgpr.results.result import read_result, write_result
from flgpr.screen import MeanViewSums, RunViewSums, view_array
from flgpr.simulate import Scene
from flgpr.store import open_run, read_manifest, sha256
from flgpr_papers.kit.cache import read_arrays, store_lane, write_arrays
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study import Outcome, Study
from flgpr_papers.kit.study_worlds import OWN
from flgpr_papers.wang2007 import figures
from flgpr_papers.wang2007.analysis import BURIED_METAL, BURIED_PLASTIC, LaneResult
from flgpr_papers.wang2007.costs import MEDIAN_STEP, Lanes, cost_table
from flgpr_papers.wang2007.examples import save_examples
from flgpr_papers.wang2007.findings import SETS, all_findings
from flgpr_papers.wang2007.lanes import (
    F1_BAND,
    LaneScenes,
    blind_scenes,
    calibration_scenes,
    f1_alone,
    quick_scenes,
    sensor,
)
from flgpr_papers.wang2007.page import Measured, page_facts, page_tables

_BAND_DRAWS = 200
VIEWS = ("wide", "largest", "mean")
"""Other run-views of the prescreener's channel that are computed beside that of the recipe."""


def run(folder: Path, quick: bool, track: Track, world: str) -> Outcome:
    """Simulate the lanes, run the chain on them, and judge them.

    A simulated lane or a lane's result that is on disk is used if it was made from the same scene,
    sensor and recipe.
    """
    draws = 100 if quick else 1000
    printed, coarse = [
        Lanes(
            *[
                [part(folder, name, quick, world, track) for name in lanes]
                for lanes in _lanes(quick, world)
            ]
        )
        for part in (make_part, coarse_part)
    ]
    recipe = parse_recipe(packaged_text("wang2007"))
    findings, tables = all_findings(*printed, recipe, draws)
    measured = Measured(
        recipe=recipe,
        radar=sensor(),
        calibration=printed.calibration,
        blind=printed.blind,
        tables=tables,
        examples=read_arrays(folder / "results" / "examples.bundle"),
        costs=cost_table(printed, coarse, draws),
        draws=draws,
    )
    return Outcome(
        findings=findings,
        figures=drawings(measured),
        facts=page_facts(measured),
        tables=page_tables(measured),
        files={"costs.csv": measured.costs.round(4).to_csv(index=False)},
    )


def drawings(measured: Measured) -> dict[str, Callable[[], Figure]]:
    """Return what draws Fig. 1 to 14, by name."""
    examples = measured.examples
    first_lane = measured.calibration[0]
    tables = measured.tables
    pool = tables.pool
    buried = {"metal": BURIED_METAL, "plastic": BURIED_PLASTIC}
    trained = {name: pool.match_of(pool.confidence(columns, "A")) for name, columns in SETS.items()}
    best = {"prescreener": tables.channels["HH", "F1"], "C_HH": trained["A"]}
    final = {"calibration": trained, "blind": tables.blind}

    def final_curves() -> Figure:
        bands = {}
        for kind, subset in buried.items():
            bands[kind] = pool.bands(SETS["B"], "A", subset, figures.BAND_FAR, _BAND_DRAWS)
        return figures.classifier_figure(final, buried, bands)

    drawn: list[Callable[[], Figure]] = [
        partial(figures.geometry_figure, measured.radar, measured.recipe),
        partial(figures.polarization_figure, examples),
        partial(figures.subband_figure, examples),
        partial(figures.series_figure, examples),
        partial(figures.background_figure, examples),
        partial(figures.run_view_figure, first_lane, False),
        partial(figures.run_view_figure, first_lane, True),
        partial(figures.clean_bands_figure, examples),
        partial(figures.prescreener_figure, tables.channels, tables.first_run),
        partial(figures.patch_figure, examples),
        partial(figures.region_figure, measured.recipe),
        partial(figures.normalisation_figure, measured.calibration),
        partial(figures.classifier_figure, {"calibration": best}, buried),
        final_curves,
    ]
    return {f"figure-{number}": draw for number, draw in enumerate(drawn, start=1)}


def _lanes(quick: bool, world: str = OWN) -> tuple[LaneScenes, LaneScenes]:
    """Return the scenes of the calibration and of the blind lanes."""
    if quick:
        return quick_scenes(world=world)
    return calibration_scenes(world), blind_scenes(world)


def _parts(quick: bool) -> list[str]:
    """Return the names of the lanes, the longest first."""
    calibration, blind = _lanes(quick)
    return [*blind, *calibration]


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
        Name of the lane.
    quick, track, world
        As the study runs.
    """
    text = packaged_text("wang2007")
    calibration, blind = _lanes(quick, world)
    if name in calibration:
        scene, seed = calibration[name]
        is_first = name == "c1"
        result = lane_result(folder, scene, seed, sensor(), text, track, examples=is_first)
    else:
        scene, seed = blind[name]
        radar = sensor(F1_BAND)
        result = lane_result(folder, scene, seed, radar, f1_alone(text), track, wide=False)
    coarse_part(folder, name, quick, world, track)
    return result


def coarse_part(
    folder: Path, name: str, quick: bool, world: str = OWN, track: Track = silent
) -> LaneResult:
    """Run a lane with the coarse median of the recipe wang2007, in F1 alone.

    The parameters are those of :func:`make_part`.
    """
    calibration, blind = _lanes(quick, world)
    scene, seed = (calibration | blind)[name]
    radar = sensor() if name in calibration else sensor(F1_BAND)
    text = f1_alone(packaged_text("wang2007")).replace(
        "median_step = 1\n", f"median_step = {MEDIAN_STEP}\n"
    )
    return lane_result(folder, scene, seed, radar, text, track, wide=False, suffix="-coarse")


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

    def _view(self, sums: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
        return sums["first"]


def other_views(imaged: ImagedRun, track: Track) -> dict[str, NDArray[Any]]:
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
    channel = (slice(p, p + 1), slice(b, b + 1))
    background = _background_of(imaged.whole_background, channel)
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
    arrays: dict[str, NDArray[Any]] = {}
    for name, of_view in sums.items():
        arrays[name], arrays[f"{name} looks"] = of_view.result()
    return arrays


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
        manifest = read_result(result_folder).manifest
    except ResultError:
        return False
    has_same_store = manifest["run"].get("store_sha256") == read_manifest(store)["sha256"]
    return bool(has_same_store and manifest["recipe_sha256"] == sha256(text.encode()))


STUDY = Study("wang2007", "wang2007.html", run, _parts, make_part, dpi=(100, 100))
