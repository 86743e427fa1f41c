"""Reproduce Fuse et al. 2018.

Dual-band model-based clutter suppression on two simulated arid lanes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from flgpr.chain.progress import Track, silent
from flgpr.store import write_whole
from flgpr_papers.fuse2018.findings import all_findings, paper_findings
from flgpr_papers.fuse2018.fullwave import fullwave_study
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, fuse_recipe, masks_stage, simulate_lane
from flgpr_papers.fuse2018.page import page_html
from flgpr_papers.fuse2018.poses import pose_study
from flgpr_papers.fuse2018.process import VARIANTS, Calibration, Cleaned, calibrate, process_lane
from flgpr_papers.fuse2018.results import (
    LaneResult,
    example_arrays,
    read_records,
    result_key,
    stored_calibration,
    write_records,
)
from flgpr_papers.kit.cache import read_arrays, write_arrays
from flgpr_papers.kit.findings import Finding, write_findings
from flgpr_papers.kit.study_worlds import OWN, other_world, study_world
from flgpr_papers.kit.threads import one_blas_thread
from flgpr_papers.kit.worlds import World

PAGE = "fuse2018.html"
LANES = ("A", "B")


@one_blas_thread
def reproduce(
    output: str | Path, quick: bool = False, track: Track = silent, world: str = OWN
) -> Path:
    """Simulate and clean the calibration lane and lanes A and B, and write the results.

    These are the page, the findings and the tables.

    What is finished already (a simulated lane, the thresholds, a lane's results) is taken as it is
    if it was made by the same recipe, so that a run that was stopped goes on where it was.
    """
    folder = Path(output)
    recipe = fuse_recipe(quick, world)
    stores = folder / "lanes"
    results = folder / "results"
    for subfolder in (stores, results):
        subfolder.mkdir(parents=True, exist_ok=True)
    key = result_key(recipe, quick)
    calibration = stored_calibration(
        results / f"calibration-{key}.json",
        lambda: calibrate(simulate_lane(stores, recipe, "calibration", track), recipe, track),
    )
    lanes = [lane_result(folder, recipe, name, quick, calibration, track) for name in LANES]
    loose = loose_result(folder, recipe, LANES[0], quick, calibration, track)
    poses = pose_study(recipe, draws=8 if quick else 60)
    example = read_arrays(results / f"example-{result_key(recipe, quick, calibration)}.bundle")
    fullwave = fullwave_study(quick)
    findings = all_findings(lanes, loose, recipe)
    write_findings(folder, findings, quick, world=world)
    page = folder / PAGE
    worlds = study_world("fuse2018", world), other_world(folder, PAGE, world, quick)
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
        *worlds,
    )
    write_whole(page, html)
    return page


def lane_result(
    folder: Path, recipe: FuseRecipe, name: str, quick: bool, calibration: Calibration, track: Track
) -> LaneResult:
    """Simulate and clean a lane, or take what is there."""
    key = result_key(recipe, quick, calibration)
    path = folder / "results" / f"{name}-{key}.json"
    shown = folder / "results" / f"example-{key}.bundle"
    frames = simulate_lane(folder / "lanes", recipe, name, track)

    def keep(cleaned: Cleaned) -> None:
        if name == LANES[0]:
            write_arrays(shown, example_arrays(cleaned, frames, recipe))

    if not path.is_file():
        records = process_lane(
            frames, calibration, recipe, track, tuple(VARIANTS), recipe.study.every, keep
        )
        write_records(path, frames, records)
    return read_records(path, frames)


def loose_result(
    folder: Path, recipe: FuseRecipe, name: str, quick: bool, calibration: Calibration, track: Track
) -> LaneResult:
    """Clean some apertures of a lane with the presets' looser navigation."""
    path = folder / "results" / f"{name}-loose-{result_key(recipe, quick, calibration)}.json"
    frames = simulate_lane(folder / "lanes", recipe, name, track)
    if not path.is_file():
        variants = ("original", "iteration", "shared")
        wrong = loosened(frames, recipe)
        records = process_lane(
            wrong, calibration, recipe, track, variants, recipe.study.loose_every
        )
        write_records(path, wrong, records)
    return read_records(path, frames)


def loosened(frames: Frames, recipe: FuseRecipe) -> Frames:
    """Add errors to a lane's reported poses, up to the looser navigation.

    They are the same in both bands.
    """
    more = np.sqrt(max(recipe.study.loose_position**2 - recipe.radar.position**2, 0.0))
    run = frames.stage.setup.run
    other_runs = frames.stage.setup.others
    shift = np.zeros(run["pose"].shape)
    shift[:, :3] = np.random.default_rng(1).normal(0, more, (len(shift), 3))
    runs = {
        band: run_of_band.assign(pose=run_of_band["pose"] + shift)
        for band, run_of_band in {"l": run, **other_runs}.items()
    }
    return replace(frames, stage=masks_stage(runs, recipe))


def findings_in(world: World, folder: Path) -> list[Finding]:
    """Judge the paper's statements on lane A.

    The thresholds are of the calibration lane of the same world.
    """
    recipe = fuse_recipe(quick=True)
    seeds = {name: 1000 * (world.number + 1) + k for k, name in enumerate(("calibration", "A"))}
    content = {"site": world.site(folder), "seeds": seeds, **world.roadside_density}
    recipe = recipe.model_copy(
        update={
            "lanes": recipe.lanes.model_copy(update=content),
            "radar": recipe.radar.model_copy(update={"scatterers": 25.0}),  # per m²
        }
    )
    calibration = calibrate(simulate_lane(folder, recipe, "calibration", silent), recipe, silent)
    frames = simulate_lane(folder, recipe, "A", silent)
    path = folder / "A.json"
    records = process_lane(frames, calibration, recipe, silent, ("original", "iteration"))
    write_records(path, frames, records)
    return paper_findings([read_records(path, frames)], recipe)
