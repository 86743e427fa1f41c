"""Reproduce Fuse et al. 2018: dual-band model-based clutter suppression on two simulated lanes.

The study in order: simulate the calibration lane and learn the thresholds of the masks, simulate
lanes A and B, clean every aperture by every variant of the suppression, judge the paper's
statements.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from flgpr.progress import Track
from flgpr_papers.fuse2018 import figures
from flgpr_papers.fuse2018.findings import all_findings
from flgpr_papers.fuse2018.fullwave import fullwave_study
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, fuse_recipe, masks_stage, simulate_lane
from flgpr_papers.fuse2018.page import Measured, page_facts, page_tables, roc_rows
from flgpr_papers.fuse2018.poses import pose_study
from flgpr_papers.fuse2018.process import (
    LaneResult,
    process_lane,
    read_records,
    result_key,
    stored_calibration,
    write_records,
)
from flgpr_papers.fuse2018.records import example_arrays
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration, Cleaned
from flgpr_papers.kit.cache import read_arrays, write_arrays
from flgpr_papers.kit.study import Outcome, Study

LANES = ("A", "B")


def run(folder: Path, quick: bool, track: Track, world: str) -> Outcome:
    """Simulate and clean the lanes, and judge them; what is on disk of this recipe is used."""
    recipe = fuse_recipe(quick, world)
    calibration = stored_calibration(folder, recipe, quick, track)
    lanes = [lane_result(folder, recipe, name, quick, calibration, track) for name in LANES]
    loose = lane_result(folder, recipe, LANES[0], quick, calibration, track, loose=True)
    key = result_key(recipe, quick, calibration)
    measured = Measured(
        recipe=recipe,
        lanes=lanes,
        loose=loose,
        calibration=calibration,
        example=read_arrays(folder / "results" / f"example-{key}.bundle"),
        poses=pose_study(recipe, draws=8 if quick else 60),
        fullwave=fullwave_study(quick),
    )
    findings = all_findings(lanes, loose, recipe)
    return Outcome(
        findings=findings,
        figures=_figures(measured),
        facts=page_facts(measured, findings),
        rows={"figure-9": roc_rows(measured)},
        tables=page_tables(measured),
        files={"fullwave.csv": measured.fullwave.table.to_csv(index=False)},
    )


def _figures(measured: Measured) -> dict[str, Callable[[], Figure]]:
    """Return what draws each figure of the page, by name."""
    recipe = measured.recipe
    lanes = measured.lanes
    shown = {**measured.example, "box side": np.asarray(recipe.boxes.side)}
    drawn: dict[str, Callable[[], Figure]] = {
        "figure-1": partial(figures.geometry_figure, recipe),
        "figure-2": partial(figures.procedure_figure, shown),
    }
    for number, (band, title) in enumerate(figures.BANDS.items(), start=3):
        if band in shown:
            drawn[f"figure-{number}"] = partial(figures.mask_figure, shown, band, title)
    return drawn | {
        "figure-6": partial(figures.masks_figure, shown, figures.MIXED),
        "figure-7": partial(
            figures.averages_figure, shown, **figures.columns_of(shown, figures.STAGES, 2)
        ),
        "figure-8": partial(figures.power_figure, lanes, shown, recipe),
        "figure-9": partial(figures.roc_figure, lanes, recipe, columns=len(lanes)),
        "variants": partial(
            figures.cleaned_figure, shown, **figures.columns_of(shown, figures.CLEANED, 3)
        ),
        "regions": partial(figures.masks_figure, shown, figures.READINGS),
        "variants-roc": partial(
            figures.variants_roc_figure, lanes, recipe, rows=2, columns=len(lanes)
        ),
        "poses": partial(figures.pose_figure, measured.poses, lanes, measured.loose),
        "fullwave": partial(figures.fullwave_figure, measured.fullwave),
    }


def lane_result(
    folder: Path,
    recipe: FuseRecipe,
    name: str,
    quick: bool,
    calibration: Calibration,
    track: Track,
    loose: bool = False,
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
    loose : bool
        Whether some apertures are cleaned with the presets' looser navigation instead.
    """
    key = result_key(recipe, quick, calibration)
    frames = simulate_lane(folder / "lanes", recipe, name, track)
    path = folder / "results" / f"{name}{'-loose' if loose else ''}-{key}.json"
    if path.is_file():
        return read_records(path, frames)
    if loose:
        variants = ("original", "iteration", "shared")
        loose_frames = loosened(frames, recipe)
        every = recipe.study.loose_every
        records = process_lane(loose_frames, calibration, recipe, track, variants, every)
        write_records(path, loose_frames, records)
        return read_records(path, frames)

    def save_example(cleaned: Cleaned) -> None:
        arrays = example_arrays(cleaned, frames, recipe)
        write_arrays(path.with_name(f"example-{key}.bundle"), arrays)

    example = save_example if name == LANES[0] else None
    every = recipe.study.every
    records = process_lane(frames, calibration, recipe, track, tuple(VARIANTS), every, example)
    write_records(path, frames, records)
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


STUDY = Study("fuse2018", "fuse2018.html", run, dpi=(110, 60))
