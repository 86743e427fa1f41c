"""Reproduce Fuse et al. 2018: dual-band model-based clutter suppression on two simulated lanes.

The study in order: simulate the calibration lane and learn the thresholds of the masks, simulate
lanes A and B, clean every aperture by every variant of the suppression, judge the paper's
statements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.clutter import TABLE_II, accuracy_needed
from flgpr.progress import Track
from flgpr.scoring import pd_at
from flgpr.types import Entries
from flgpr_papers.fuse2018 import figures
from flgpr_papers.fuse2018.figures import Measured
from flgpr_papers.fuse2018.findings import (
    CONVENTIONS,
    STATEMENTS,
    all_findings,
    power_db,
    scored,
    strongest_boxes,
)
from flgpr_papers.fuse2018.lanes import (
    BANDS,
    Frames,
    FuseRecipe,
    band_sensor,
    fuse_recipe,
    masks_stage,
    simulate_lane,
)
from flgpr_papers.fuse2018.process import (
    LaneResult,
    example_arrays,
    process_lane,
    read_records,
    result_key,
    stored_calibration,
    write_records,
)
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration, Cleaned
from flgpr_papers.kit.cache import read_arrays, write_arrays
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.page import HEADER, point_rows
from flgpr_papers.kit.study import Outcome, Study


def page_facts(measured: Measured, found: Sequence[Finding]) -> Entries:
    """Return what the captions and their numbers take."""
    recipe = measured.recipe
    by_claim = {finding.claim: finding.ours for finding in found}
    ours = {
        name: by_claim.get(statement["claim"], "nothing to measure")
        for name, statement in STATEMENTS.declared.items()
    }
    masks = {name: mask for name, mask in measured.example.items() if mask.dtype == bool}
    return {
        "recipe": recipe,
        "regions": len(recipe.image.edges) - 1,
        "borders": ", ".join(f"{edge:g}" for edge in recipe.image.edges),
        "pixels": {name: f"{100 * np.mean(mask):.1f} %" for name, mask in masks.items()},
        "ours": ours,
        "right_box": _right_box(measured),
        "pds": _pd_texts(measured),
    }


def _right_box(measured: Measured) -> str:
    """Return by how much #5 and #6 differ in the right box of the example frame."""
    boxes = strongest_boxes(measured.lanes[:1])
    is_shown = boxes["frame"] == int(measured.example["frame"])
    boxes = boxes[is_shown & (boxes["side"] == "right")]
    if boxes.empty:
        return "there is none."
    more = float((power_db(boxes, "#6") - power_db(boxes, "#5"))[0])
    return f"{'#5' if more > 0 else '#6'} leaves less, by {abs(more):.1f} dB."


def _pd_texts(measured: Measured) -> dict[str, str]:
    """Return Pd without and with suppression by lane and FAR, for Fig. 9."""
    texts = {}
    for lane in measured.lanes:
        before, after = [
            scored(lane, name, measured.recipe, "frames")[1] for name in ("original", "iteration")
        ]
        for far in (0.05, 0.1):
            texts[f"{lane.name} {far:g}"] = f"{pd_at(before, far):.2f} and {pd_at(after, far):.2f}"
    return texts


def page_tables(measured: Measured) -> Entries:
    """Return what the template of the page takes."""
    recipe = measured.recipe
    learnt = measured.calibration.learnt
    courses = pd.concat([lane.courses for lane in measured.lanes])
    sensors = [band_sensor(recipe, band) for band in BANDS]
    return {
        "recipe": recipe,
        "lanes": measured.lanes,
        "header": HEADER,
        "points": _points(recipe, measured.lanes),
        "regions": [f"{a:g} to {b:g} m" for a, b in pairwise(recipe.image.edges)],
        "levels": {name: 20 * np.log10(value) for name, value in learnt.items()},
        "looks": learnt["looks"],
        "variants": VARIANTS,
        "courses": {name: rows for name, rows in courses.groupby("variant") if name != "original"},
        "pose_needed": [accuracy_needed(one.tones.axis(), 1.0) for one in sensors],
        "sensors": sensors,
        "antennas": [[len(np.unique(side, axis=0)) for side in one.pairs()] for one in sensors],
        "combinations": TABLE_II,
    }


def _points(recipe: FuseRecipe, lanes: Sequence[LaneResult]) -> list[tuple[str, ...]]:
    """Return Pd at operating points, before and after, by both conventions of FAR."""
    rows: list[tuple[str, ...]] = []
    for lane, convention, variant in product(lanes, CONVENTIONS, ("original", "iteration")):
        matched, _, options = scored(lane, variant, recipe, convention)
        area = {name: options[name] for name in ("area", "frame_area") if name in options}
        inside = matched.truth["inside"].to_numpy(dtype=bool)
        subsets = {f"lane {lane.name}, {convention}": inside}
        rows += point_rows({variant: matched}, subsets, shared="count", **area)
    return rows


LANES = ("A", "B")


def run(folder: Path, quick: bool, track: Track, world: str) -> Outcome:
    """Simulate and clean the lanes, and judge them; what is on disk of this recipe is used."""
    recipe = fuse_recipe(quick, world)
    calibration = stored_calibration(folder, recipe, quick, track)
    lanes = [lane_result(folder, recipe, name, quick, calibration, track) for name in LANES]
    loose = lane_result(folder, recipe, LANES[0], quick, calibration, track, loose=True)
    key = result_key(recipe, quick, calibration)
    shown = read_arrays(folder / "results" / f"example-{key}.bundle")
    measured = Measured(
        recipe=recipe,
        lanes=lanes,
        loose=loose,
        calibration=calibration,
        example={**shown, "box side": np.asarray(recipe.boxes.side)},
    )
    findings = all_findings(lanes, loose, recipe)
    return Outcome(
        findings=findings,
        measured=measured,
        facts=page_facts(measured, findings),
        tables=page_tables(measured),
    )


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
    runs = {
        band: run.assign(pose=run["pose"] + shift)
        for band, run in {"l": l_band_run, **frames.stage.setup.others}.items()
    }
    return replace(frames, stage=masks_stage(runs, recipe))


STUDY = Study("fuse2018", "fuse2018.html", figures, run, dpi=(110, 60))
