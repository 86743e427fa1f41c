"""Reproduce Wang et al. 2007 on simulated lanes: three calibration and four blind ones, one page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.chain.lane_chain import CleanedRun, LaneChain
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import Recipe, parse_recipe
from flgpr.clutter import Background
from flgpr.imaging import ScanImager
from flgpr.io import open_run, read_manifest, sha256, write_whole
from flgpr.model import Lane
from flgpr.results.description import describe_run
from flgpr.results.result import ResultError, read_result, write_result
from flgpr.screen import RunViewSums, view_array
from flgpr.simulate import Scene, Sensor
from flgpr_papers.kit.cache import read_arrays, store_lane, write_arrays
from flgpr_papers.kit.findings import write_findings
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.wang2007.analysis import LaneResult
from flgpr_papers.wang2007.examples import save_examples
from flgpr_papers.wang2007.lanes import blind_scenes, calibration_scenes, quick_scenes, sensor
from flgpr_papers.wang2007.page import page_html

PAGE = "wang2007.html"


def reproduce(output: str | Path, quick: bool = False, track: Track = silent) -> Path:
    """Simulate the lanes, run the chain on them, and write the page.

    What is finished already (a simulated lane, a lane's result) is taken as it is if it was made from the same scene,
    sensor and recipe; so a run that was stopped goes on where it was, lane by lane.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    calibration, blind = ([make_part(folder, name, quick, track) for name in lanes] for lanes in _lanes(quick))
    recipe = parse_recipe(packaged_text("wang2007"))
    html, findings = page_html(folder, calibration, blind, recipe, sensor(), quick, track)
    write_findings(folder, findings, quick)
    write_whole(folder / PAGE, html)
    return folder / PAGE


def parts(quick: bool) -> list[str]:
    """List the lanes, each of which can be worked on by itself, the longest first."""
    return [name for lanes in reversed(_lanes(quick)) for name in lanes]


def make_part(folder: Path, name: str, quick: bool, track: Track = silent) -> LaneResult:
    """Work on a lane, a blind one in the sub-band alone that the classifiers look at, which were frozen before."""
    calibration, blind = _lanes(quick)
    scene, seed = (calibration | blind)[name]
    text = packaged_text("wang2007")
    if name in calibration:
        return lane_result(folder, scene, seed, sensor(), text, track, examples=name == "c1")
    text = re.sub(r"(?m)^F[0234] .*\n", "", text)
    radar = sensor(parse_recipe(text).image.subbands["F1"])
    return lane_result(folder, scene, seed, radar, text, track, wide=False)


def _lanes(quick: bool) -> tuple[dict[str, tuple[Scene, int]], dict[str, tuple[Scene, int]]]:
    return quick_scenes() if quick else (calibration_scenes(), blind_scenes())


def lane_result(
    folder: Path,
    scene: Scene,
    seed: int,
    radar: Sensor,
    text: str,
    track: Track,
    examples: bool = False,
    wide: bool = True,
) -> LaneResult:
    """Simulate a lane and run the chain on it, or take what is there.

    What was found and what is there; with the run-view over the full range and with examples for the figures if wanted.
    """
    home, recipe = folder / "results" / scene.name, parse_recipe(text)
    store, truth, lane = store_lane(folder / "lanes", scene, seed, radar, track)
    extras = folder / "results" / f"{scene.name}-wide.bundle"
    pictures = folder / "results" / "examples.bundle"
    there = (extras.is_file() or not wide) and (pictures.is_file() or not examples)
    if not (there and _is_done(home, store, text)):
        run = open_run(store)
        chain = LaneChain(run, recipe, lane, explains=False, whole=True)
        chain.go(track, ("signature", "gain", "view", "alarms", "features"))
        cleaned, found = chain.cleaned, chain.detection()
        extras.parent.mkdir(parents=True, exist_ok=True)
        if examples:
            save_examples(pictures, cleaned, run, recipe, truth, found.alarms)
        if wide:
            far = wide_view(cleaned, run, recipe, lane, track)
            write_arrays(extras, {"view": far.values, "looks": far["looks"].values})
        write_result(home, [found], text, lane, describe_run(run, store))
    result = read_result(home)
    main = result.detections[0]
    features = main.features if main.features is not None else pd.DataFrame()
    view = None
    if wide:
        arrays = read_arrays(extras)
        view = view_array(arrays["view"], arrays["looks"], recipe.run_view.grid(lane), {})
    return LaneResult(scene.name, lane, truth, main.alarms, features, main.view, view)


def wide_view(cleaned: CleanedRun, run: xr.Dataset, recipe: Recipe, lane: Lane, track: Track) -> xr.DataArray:
    """Run-view of the prescreener's channel over the full range of the images."""
    screen, table = recipe.prescreen, recipe.image
    p = [str(label) for label in run["polarization"].values].index(screen.polarization)
    b = list(table.subbands).index(screen.subband)
    whole, place = cleaned.whole_background, (slice(p, p + 1), slice(b, b + 1))
    parts = whole.signature[place], whole.gain[place], whole.shared_signature[place], whole.shared_gain[b : b + 1]
    one = Background(*(np.ascontiguousarray(part) for part in parts))  # type: ignore[arg-type]
    band = {screen.subband: table.subbands[screen.subband]}
    # Which scans are whole depends on all polarizations, so that the choice is made before one is taken.
    chosen = run.isel(scan=cleaned.imager.scans, polarization=[p])
    imager = ScanImager(chosen, table.grid(), band, table.window, table.tolerance)
    grid = recipe.run_view.grid(lane)
    sums = RunViewSums(grid, table.y[1])
    for image, gain in zip(track(imager, "full range", len(imager)), cleaned.gains, strict=True):
        magnitude = one.magnitude(image.values, np.ascontiguousarray(gain[place]))
        sums.add(magnitude[0, 0], imager.grid, np.asarray(image.attrs["pose"]))
    return view_array(*sums.result(), grid, {})


def _is_done(home: Path, store: Path, text: str) -> bool:
    try:
        manifest: dict[str, Any] = read_result(home).manifest
    except ResultError:
        return False
    same = manifest["run"].get("store_sha256") == read_manifest(store)["sha256"]
    return bool(same and manifest["recipe_sha256"] == sha256(text.encode()))
