"""Reproduce Fuse et al. 2018: dual-band model-based clutter suppression on two simulated lanes.

The study in order: simulate the calibration lane and learn the thresholds of the masks, simulate
lanes A and B, clean every aperture by every variant of the suppression, judge the paper's
statements, write the page.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from flgpr.progress import Track, silent
from flgpr.store import write_whole
from flgpr_papers.fuse2018.findings import all_findings
from flgpr_papers.fuse2018.fullwave import fullwave_study
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, fuse_recipe, masks_stage, simulate_lane
from flgpr_papers.fuse2018.page import page_html
from flgpr_papers.fuse2018.poses import pose_study
from flgpr_papers.fuse2018.process import calibrate, process_lane
from flgpr_papers.fuse2018.results import (
    LaneResult,
    example_arrays,
    read_records,
    result_key,
    stored_calibration,
    write_records,
)
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration, Cleaned
from flgpr_papers.kit.cache import read_arrays, write_arrays
from flgpr_papers.kit.findings import write_findings
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread

PAGE = "fuse2018.html"
LANES = ("A", "B")


@one_blas_thread
def reproduce(
    output: str | Path, quick: bool = False, track: Track = silent, world: str = OWN
) -> Path:
    """Simulate and clean the calibration lane and lanes A and B, and write page, findings, tables.

    What is on disk (a simulated lane, the thresholds, a lane's results) is used if it was made by
    the same recipe, so that an interrupted run resumes.

    Parameters
    ----------
    output : str or Path
        Folder to work in.
    quick : bool
        Short lanes that only show that everything runs.
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
    recipe = fuse_recipe(quick, world)
    stores = folder / "lanes"
    results = folder / "results"
    stores.mkdir(parents=True, exist_ok=True)
    results.mkdir(parents=True, exist_ok=True)

    def make_calibration() -> Calibration:
        frames = simulate_lane(stores, recipe, "calibration", track)
        return calibrate(frames, recipe, track)

    calibration_file = results / f"calibration-{result_key(recipe, quick)}.json"
    calibration = stored_calibration(calibration_file, make_calibration)
    lanes = [lane_result(folder, recipe, name, quick, calibration, track) for name in LANES]
    loose = loose_result(folder, recipe, LANES[0], quick, calibration, track)
    poses = pose_study(recipe, draws=8 if quick else 60)
    example = read_arrays(results / f"example-{result_key(recipe, quick, calibration)}.bundle")
    fullwave = fullwave_study(quick)
    findings = all_findings(lanes, loose, recipe)
    write_findings(folder, findings, quick, world=world)
    html = page_html(
        recipe,
        lanes,
        loose,
        calibration,
        example,
        poses,
        fullwave,
        findings,
        quick,
        folder,
        study_world("fuse2018", world),
        other_world(folder, PAGE, world, quick),
    )
    write_whole(folder / PAGE, html)
    return folder / PAGE


def lane_result(
    folder: Path, recipe: FuseRecipe, name: str, quick: bool, calibration: Calibration, track: Track
) -> LaneResult:
    """Simulate and clean a lane, or read its results if they are on disk.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    recipe : FuseRecipe
        The study.
    name : str
        Name of the lane, "A" or "B". Lane A has the aperture that the figures show.
    quick : bool
        Whether the study is a quick run.
    calibration : Calibration
        What the calibration lane teaches.
    track : Track
        Shows progress.
    """
    key = result_key(recipe, quick, calibration)
    path = folder / "results" / f"{name}-{key}.json"
    example_file = folder / "results" / f"example-{key}.bundle"
    frames = simulate_lane(folder / "lanes", recipe, name, track)

    def save_example(cleaned: Cleaned) -> None:
        if name == LANES[0]:
            write_arrays(example_file, example_arrays(cleaned, frames, recipe))

    if not path.is_file():
        records = process_lane(
            frames, calibration, recipe, track, tuple(VARIANTS), recipe.study.every, save_example
        )
        write_records(path, frames, records)
    return read_records(path, frames)


def loose_result(
    folder: Path, recipe: FuseRecipe, name: str, quick: bool, calibration: Calibration, track: Track
) -> LaneResult:
    """Clean some apertures of a lane with the presets' looser navigation, or read the results.

    The parameters are those of :func:`lane_result`.
    """
    path = folder / "results" / f"{name}-loose-{result_key(recipe, quick, calibration)}.json"
    frames = simulate_lane(folder / "lanes", recipe, name, track)
    if not path.is_file():
        variants = ("original", "iteration", "shared")
        loose_frames = loosened(frames, recipe)
        records = process_lane(
            loose_frames, calibration, recipe, track, variants, recipe.study.loose_every
        )
        write_records(path, loose_frames, records)
    return read_records(path, frames)


def loosened(frames: Frames, recipe: FuseRecipe) -> Frames:
    """Return a lane's frames with larger errors of the reported poses, the same in both bands.

    Together with the errors that are there they have the deviation of the looser navigation.

    Parameters
    ----------
    frames : Frames
        The lane's frames.
    recipe : FuseRecipe
        The study.
    """
    variance = recipe.study.loose_position**2 - recipe.radar.position**2
    deviation = np.sqrt(max(variance, 0.0))
    l_band_run = frames.stage.setup.run
    shift = np.zeros(l_band_run["pose"].shape)
    shift[:, :3] = np.random.default_rng(1).normal(0, deviation, (len(shift), 3))
    runs = {}
    for band, run in {"l": l_band_run, **frames.stage.setup.others}.items():
        runs[band] = run.assign(pose=run["pose"] + shift)
    return replace(frames, stage=masks_stage(runs, recipe))
