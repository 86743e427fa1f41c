"""Reproduce Wang et al. 2007 on simulated lanes.

Three calibration and four blind ones, one page.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.cleaned import CleanedRun
from flgpr.chain.lane_setup import LaneSetup
from flgpr.chain.method import detection_of, engine_of
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import Recipe, parse_recipe
from flgpr.clutter import Background
from flgpr.imaging import ScanImager
from flgpr.kernels.sampling import bilinear
from flgpr.model import Lane, check_tones, lane_to_scan
from flgpr.results.description import describe_run
from flgpr.results.errors import ResultError
from flgpr.results.result import read_result, write_result
from flgpr.screen import RunViewSums, view_array
from flgpr.simulate import Scene, Sensor
from flgpr.store import open_run, read_manifest, sha256, write_whole
from flgpr_papers.kit.cache import read_arrays, store_lane, write_arrays
from flgpr_papers.kit.findings import Finding, write_findings
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread
from flgpr_papers.kit.worlds import World
from flgpr_papers.wang2007.analysis import LaneResult
from flgpr_papers.wang2007.costs import MEDIAN_STEP, Lanes, cost_table
from flgpr_papers.wang2007.findings import all_findings
from flgpr_papers.wang2007.lanes import (
    F1_BAND,
    LaneScenes,
    blind_scenes,
    calibration_scenes,
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

    What is finished already (a simulated lane, a lane's result) is taken as it is if it was made
    from the same scene, sensor and recipe; so a run that was stopped goes on where it was, lane by
    lane.
    """
    folder = Path(output)
    folder.mkdir(parents=True, exist_ok=True)
    calibration_names, blind_names = _lanes(quick, world)
    calibration = [make_part(folder, name, quick, world, track) for name in calibration_names]
    blind = [make_part(folder, name, quick, world, track) for name in blind_names]
    coarse = Lanes(
        [coarse_part(folder, name, quick, world, track) for name in calibration_names],
        [coarse_part(folder, name, quick, world, track) for name in blind_names],
    )
    costs = cost_table(Lanes(calibration, blind), coarse, draws=100 if quick else 1000)
    write_whole(folder / "costs.csv", costs.round(4).to_csv(index=False))
    recipe = parse_recipe(packaged_text("wang2007"))
    worlds = study_world("wang2007", world), other_world(folder, PAGE, world, quick)
    html, findings = page_html(
        folder, calibration, blind, recipe, sensor(), quick, track, costs, *worlds
    )
    write_findings(folder, findings, quick, world=world)
    write_whole(folder / PAGE, html)
    return folder / PAGE


def parts(quick: bool) -> list[str]:
    """List the lanes, each of which can be worked on by itself, the longest first."""
    return [name for lanes in reversed(_lanes(quick)) for name in lanes]


@one_blas_thread
def make_part(
    folder: Path, name: str, quick: bool, world: str = OWN, track: Track = silent
) -> LaneResult:
    """Process a lane; a blind one in the sub-band alone that the classifiers read.

    They were frozen before.

    What the coarse median of the recipe wang2007 gives on it is worked out beside, for the table of
    costs.
    """
    calibration, blind = _lanes(quick, world)
    scene, seed = (calibration | blind)[name]
    if name in calibration:
        text = packaged_text("wang2007")
        result = lane_result(folder, scene, seed, sensor(), text, track, examples=name == "c1")
    else:
        result = lane_result(folder, scene, seed, sensor(F1_BAND), _text_of_f1(), track, wide=False)
    coarse_part(folder, name, quick, world, track)
    return result


def coarse_part(
    folder: Path, name: str, quick: bool, world: str = OWN, track: Track = silent
) -> LaneResult:
    """Process the stored run of a lane with the coarse median of the recipe wang2007.

    It is in F1 alone.
    """
    calibration, blind = _lanes(quick, world)
    scene, seed = (calibration | blind)[name]
    radar = sensor() if name in calibration else sensor(F1_BAND)
    text = _text_of_f1().replace("median_step = 1\n", f"median_step = {MEDIAN_STEP}\n")
    return lane_result(folder, scene, seed, radar, text, track, wide=False, suffix="-coarse")


def _text_of_f1() -> str:
    """Return the study's recipe with the sub-band F1 alone."""
    return re.sub(r"(?m)^F[0234] .*\n", "", packaged_text("wang2007"))


def _lanes(quick: bool, world: str = OWN) -> tuple[LaneScenes, LaneScenes]:
    """Return the calibration and the blind lanes."""
    return quick_scenes(world=world) if quick else (calibration_scenes(world), blind_scenes(world))


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
    """Simulate a lane and run the chain on it, or take what is there.

    If wanted, it has all that the figures need.

    ``suffix`` names results of another recipe on the same lane.
    """
    result_folder = folder / "results" / f"{scene.name}{suffix}"
    recipe = parse_recipe(text)
    check_tones(radar, recipe.image.x, recipe.image.y)
    store, truth, lane = store_lane(folder / "lanes", scene, seed, radar, track)
    extras = folder / "results" / f"{scene.name}-wide.bundle"
    pictures = folder / "results" / "examples.bundle"
    is_complete = (extras.is_file() or not wide) and (pictures.is_file() or not examples)
    if not (is_complete and _is_done(result_folder, store, text)):
        run = open_run(store)
        setup = LaneSetup(run, recipe, lane, explains=False, whole_background=True)
        engine_of(setup).run(track, ("signature", "gain", "view", "alarms", "features"))
        cleaned = setup.cleaned
        detection = detection_of(setup)
        extras.parent.mkdir(parents=True, exist_ok=True)
        if examples:
            save_examples(pictures, cleaned, run, recipe, truth, detection.alarms)
        if wide:
            far = wide_view(cleaned, run, recipe, lane, track)
            write_arrays(extras, {"view": far.values, "looks": far["looks"].values})
        write_result(result_folder, [detection], text, lane, describe_run(run, store))
    result = read_result(result_folder)
    main = result.detections[0]
    features = main.features if main.features is not None else pd.DataFrame()
    view = None
    if wide:
        arrays = read_arrays(extras)
        view = view_array(arrays["view"], arrays["looks"], recipe.run_view.grid(lane), {})
    return LaneResult(scene.name, lane, truth, main.alarms, features, main.view, view)


def wide_view(
    cleaned: CleanedRun, run: xr.Dataset, recipe: Recipe, lane: Lane, track: Track
) -> xr.DataArray:
    """Run-view of the prescreener's channel over the full range of the images."""
    screen = recipe.prescreen
    table = recipe.image
    p = [str(label) for label in run["polarization"].values].index(screen.polarization)
    b = list(table.subbands).index(screen.subband)
    whole_background = cleaned.whole_background
    channel = (slice(p, p + 1), slice(b, b + 1))
    arrays = (
        whole_background.signature[channel],
        whole_background.gain[channel],
        whole_background.shared_signature[channel],
        whole_background.shared_gain[b : b + 1],
    )
    background = Background(*(np.ascontiguousarray(array) for array in arrays))  # type: ignore[arg-type]
    band = {screen.subband: table.subbands[screen.subband]}
    # Which scans are whole depends on all polarizations, so that the choice is made before one is
    # taken.
    chosen = run.isel(scan=cleaned.imager.scans, polarization=[p])
    imager = ScanImager(chosen, table.grid(), band, table.window, table.tolerance)
    grid = recipe.run_view.grid(lane)
    sums = RunViewSums(grid, table.y[1])
    for image, gain in zip(track(imager, "full range", len(imager)), cleaned.gains, strict=True):
        magnitude = background.magnitude(image.values, np.ascontiguousarray(gain[channel]))
        sums.add(magnitude[0, 0], imager.grid, np.asarray(image.attrs["pose"]))
    return view_array(*sums.result(), grid, {})


def _is_done(result_folder: Path, store: Path, text: str) -> bool:
    """Return whether a result is of this store and recipe."""
    try:
        manifest: dict[str, Any] = read_result(result_folder).manifest
    except ResultError:
        return False
    same = manifest["run"].get("store_sha256") == read_manifest(store)["sha256"]
    return bool(same and manifest["recipe_sha256"] == sha256(text.encode()))


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on three calibration lanes and a blind one."""
    text = packaged_text("wang2007")
    radar = sensor()
    first_seed = 1000 * (world.number + 1)
    calibration_lanes, blind_lanes = quick_scenes(world.site(folder))
    calibration = []
    for scene, seed in calibration_lanes.values():
        calibration.append(lane_result(folder, scene, seed + first_seed, radar, text, silent))
    blind = []
    for scene, seed in blind_lanes.values():
        blind.append(lane_result(folder, scene, seed + first_seed, radar, text, silent))
    return all_findings(calibration, blind, parse_recipe(text), draws=100)[0]


_AHEAD = 11.0  # m before the array at which an example target is shown
_CONSECUTIVE = 5
_LABEL_RADIUS = 1.0  # m, r_label


def save_examples(
    path: Path,
    cleaned: CleanedRun,
    run: xr.Dataset,
    recipe: Recipe,
    truth: pd.DataFrame,
    alarms: pd.DataFrame,
) -> None:
    """Save the scan images and patches of Figs. 2-5, 8 and 10."""
    table = recipe.image
    imager = ScanImager(run, table.grid(), table.subbands, table.window, table.tolerance)
    chosen = example_targets(truth, alarms)
    arrays: dict[str, Any] = {
        "polarization": run["polarization"].values.astype(str),
        "subband": np.array(list(table.subbands)),
    }
    arrays |= {"x": imager.grid.x, "y": imager.grid.y, "near": cleaned.grid.ny}
    poses = run["pose"].values
    number = {int(scan): index for index, scan in enumerate(imager.scans)}
    for name, example in chosen.items():
        scan = _scan_before(imager, poses, example.y)
        image = imager.image(scan).values
        arrays[f"raw_{name}"] = np.abs(image).astype(np.float16 if image.max() == 0 else np.float32)
        arrays[f"clean_{name}"] = cleaned.whole_background.magnitude(
            image, cleaned.gains[number[scan]]
        )
        arrays[f"place_{name}"] = lane_to_scan([example.x, example.y, 0.0], poses[scan])[:2]
        patches, distances = _patches(cleaned, recipe, example.alarm_x, example.alarm_y)
        arrays[f"patches_{name}"] = patches
        arrays[f"distances_{name}"] = distances
    follow = series_scans(imager.scans, poses, chosen["surface"].y, sum(table.y) / 2)
    hh = list(arrays["polarization"]).index("HH")
    f1 = list(table.subbands).index(recipe.prescreen.subband)
    arrays["series"] = np.stack([np.abs(imager.image(scan).values[hh, f1]) for scan in follow])
    surface = [chosen["surface"].x, chosen["surface"].y, 0.0]
    arrays["series_place"] = np.stack([lane_to_scan(surface, poses[scan])[:2] for scan in follow])
    arrays["signature"] = np.abs(cleaned.whole_background.signature[hh, f1])
    arrays["gain"] = cleaned.whole_background.gain[hh, f1]
    arrays["names"] = np.array(list(chosen))
    arrays["titles"] = np.array([example.title for example in chosen.values()])
    write_arrays(path, arrays)


class Example(NamedTuple):
    """What a figure shows.

    The place of a target or of a false alarm, that of the alarm (both m), and words.
    """

    x: float
    y: float
    alarm_x: float
    alarm_y: float
    title: str


def example_targets(truth: pd.DataFrame, alarms: pd.DataFrame) -> dict[str, Example]:
    """Choose the targets of Figs. 2 to 5, 8 and 10.

    Mines by kind and depth, and the strongest false alarm. ``surface`` is a plastic mine on the
    ground, ``metal`` one 15 cm deep, ``shallow`` a metal one and ``plastic`` a plastic one 5 cm
    deep; of several the one with the strongest alarm, of none the nearest in depth.
    """
    mines = truth[truth["kind"].isin(["metal", "plastic"])]
    plastic = mines[mines["kind"] == "plastic"]
    metal = mines[mines["kind"] == "metal"]
    examples = {
        "surface": _example(plastic, -1.0, mines, alarms),
        "metal": _example(metal, 0.15, mines, alarms),
        "shallow": _example(metal[metal["depth"] > 0], 0.05, mines, alarms),
        "plastic": _example(plastic[plastic["depth"] > 0], 0.05, mines, alarms),
    }
    distances = _distances(alarms, truth)
    free = alarms[(distances.min(axis=1) > 2) & (alarms["x"].abs() < 1.5)]
    strongest = (free if len(free) else alarms).sort_values("confidence", ascending=False).iloc[0]
    position = float(strongest["x"]), float(strongest["y"])
    examples["false"] = Example(*position, *position, "strongest false alarm")
    return examples


def _example(
    table: pd.DataFrame, depth: float, others: pd.DataFrame, alarms: pd.DataFrame
) -> Example:
    """Choose the mine nearest in depth with the strongest alarm within 1 m.

    Its own place stands in for one without.
    """
    mines = table if len(table) else others
    off = (mines["depth"] - depth).abs()
    alike = mines[off <= off.min() + 0.02]
    near = _distances(alarms, alike) <= _LABEL_RADIUS
    confidence = np.where(near, alarms["confidence"].to_numpy()[:, None], -np.inf)
    alarm, number = np.unravel_index(int(np.argmax(confidence)), confidence.shape)
    hit = bool(near[alarm, number])
    target = alike.iloc[int(number) if hit else 0]
    where = "on the surface" if target["depth"] < 0 else f"{100 * target['depth']:.0f} cm deep"
    title = f"{target['kind']} mine {where}" + ("" if hit else ", no alarm: cut at the mine")
    position = alarms.iloc[int(alarm)] if hit else target
    return Example(
        float(target["x"]), float(target["y"]), float(position["x"]), float(position["y"]), title
    )


def _distances(alarms: pd.DataFrame, targets: pd.DataFrame) -> NDArray[np.float64]:
    """Return the distance (alarm, target) of every alarm from every target, m."""
    across = alarms["x"].to_numpy()[:, None] - targets["x"].to_numpy()[None]
    along = alarms["y"].to_numpy()[:, None] - targets["y"].to_numpy()[None]
    return np.asarray(np.hypot(across, along))


def _scan_before(imager: ScanImager, poses: NDArray[np.float64], y: float) -> int:
    """Return the scan from which a position is nearest to the usual distance ahead."""
    ahead = y - poses[imager.scans, 1]
    return int(imager.scans[int(np.argmin(np.abs(ahead - _AHEAD)))])


def series_scans(
    scans: NDArray[Any], poses: NDArray[np.float64], y: float, middle: float
) -> list[int]:
    """Choose five consecutive scans that see a place of the lane, as the paper's Fig. 4 does.

    Parameters
    ----------
    scans : (n,) ndarray of int
        Numbers of the scans that have an image.
    poses : (scan, 6) ndarray
        Poses of all scans.
    y : float
        Place along the lane, m.
    middle : float
        Distance ahead at which the third scan is to have the place, that of the image's middle, m.
    """
    ahead = y - poses[scans, 1]
    nearest = int(np.argmin(np.abs(ahead - middle)))
    first = max(0, min(nearest - _CONSECUTIVE // 2, len(scans) - _CONSECUTIVE))
    return [int(scan) for scan in scans[first : first + _CONSECUTIVE]]


def _patches(
    cleaned: CleanedRun, recipe: Recipe, x: float, y: float
) -> tuple[NDArray[np.float32], NDArray[Any]]:
    """Return incoherent patches (scan, polarization, subband, y, x) of all scans that count.

    They are ordered from near to far.
    """
    grid = cleaned.grid
    offsets = recipe.contrast.patch().offsets()
    poses = cleaned.imager.run["pose"].values
    patches = []
    distances = []
    for index, scan in enumerate(cleaned.imager.scans):
        local = lane_to_scan([x, y, 0.0], poses[scan])[:2]
        if not grid.y_min <= local[1] <= recipe.run_view.y_max:
            continue
        magnitude = cleaned.background.magnitude(
            cleaned.imager.image(int(scan)).values, cleaned.gains[index]
        )
        row = (local[1] + offsets[..., 1] - grid.y_min) / grid.dy
        patches.append(
            bilinear(magnitude, row, (local[0] + offsets[..., 0] - grid.x_min) / grid.dx)
        )
        distances.append(local[1])
    order = np.argsort(distances)
    return np.stack(patches)[order].astype(np.float32), np.asarray(distances)[order]
