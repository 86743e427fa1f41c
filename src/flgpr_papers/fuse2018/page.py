"""What the page says beside findings and figures: facts, numbers and tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
import pandas as pd

from flgpr.clutter import TABLE_II
from flgpr.scoring import pd_at
from flgpr_papers.fuse2018.findings import STATEMENTS
from flgpr_papers.fuse2018.fullwave import FullwaveStudy
from flgpr_papers.fuse2018.lanes import BANDS, FuseRecipe, band_sensor
from flgpr_papers.fuse2018.matches import CONVENTIONS, scored
from flgpr_papers.fuse2018.poses import PoseStudy
from flgpr_papers.fuse2018.powers import power_db, strongest_boxes
from flgpr_papers.fuse2018.process import LaneResult
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration
from flgpr_papers.kit.cache import Arrays
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.page import HEADER, Rows, point_rows

@dataclass(frozen=True)
class Measured:
    """What the study has measured, for its figures and its page."""

    recipe: FuseRecipe  #: the study
    lanes: Sequence[LaneResult]  #: results of lanes A and B
    loose: LaneResult  #: result of lane A with the presets' looser navigation
    calibration: Calibration  #: what the calibration lane teaches
    example: Arrays  #: what the figures show of one aperture
    poses: PoseStudy  #: loss of the coherent sum by wrong poses
    fullwave: FullwaveStudy  #: the packaged full-wave lane


def page_facts(measured: Measured, found: Sequence[Finding]) -> dict[str, Any]:
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


def roc_rows(measured: Measured) -> Rows:
    """Return Pd without and with suppression, for Fig. 9."""
    rows = []
    for lane in measured.lanes:
        before, after = [
            scored(lane, name, measured.recipe, "frames")[1] for name in ("original", "iteration")
        ]
        for far in (0.05, 0.1):
            quantity = f"Pd, lane {lane.name}, {far:g} per m², without and with"
            ours = f"{pd_at(before, far):.2f} and {pd_at(after, far):.2f}"
            rows.append((quantity, "not told in numbers", ours))
    return rows


def page_tables(measured: Measured) -> dict[str, Any]:
    """Return what the template of the page takes."""
    recipe = measured.recipe
    learnt = measured.calibration.learnt
    poses = measured.poses
    losses = {f"formula, {band.upper()} band, dB": poses.predicted[band] for band in BANDS}
    losses["reflectors, L band, median, dB"] = np.median(poses.measured, axis=1)
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
        "poses": poses,
        "errors": [f"{1000 * error:g}" for error in poses.errors],
        "losses": losses,
        "fullwave": measured.fullwave,
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
