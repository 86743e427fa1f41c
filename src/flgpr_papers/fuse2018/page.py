"""What the page says beside findings and figures: facts, numbers and tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
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

Row = tuple[Any, ...]
_THRESHOLDS = {"VV": "vv", "VH": "vh", "X": "second", "VH, roadside": "low_vh"}


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
    ours = {}
    for name, statement in STATEMENTS.declared.items():
        ours[name] = by_claim.get(statement["claim"], "nothing to measure")
    return {
        "recipe": recipe,
        "regions": len(recipe.image.edges) - 1,
        "borders": ", ".join(f"{edge:g}" for edge in recipe.image.edges),
        "pixels": {
            name: f"{100 * np.mean(mask):.1f} %"
            for name, mask in measured.example.items()
            if mask.dtype == bool
        },
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
    better = "#5" if more > 0 else "#6"
    return f"{better} leaves less, by {abs(more):.1f} dB."


def roc_rows(measured: Measured) -> Rows:
    """Return Pd without and with suppression, for Fig. 9."""
    recipe = measured.recipe
    rows = []
    for lane in measured.lanes:
        curves = [scored(lane, name, recipe, "frames")[1] for name in ("original", "iteration")]
        for far in (0.05, 0.1):
            text = " and ".join(f"{pd_at(curve, far):.2f}" for curve in curves)
            quantity = f"Pd, lane {lane.name}, {far:g} per m², without and with"
            rows.append((quantity, "not told in numbers", text))
    return rows


def page_tables(measured: Measured) -> dict[str, Any]:
    """Return what the template of the page takes."""
    recipe = measured.recipe
    lanes = measured.lanes
    learnt = measured.calibration.learnt
    poses = measured.poses
    fullwave = measured.fullwave
    losses = {f"formula, {band.upper()} band, dB": poses.predicted[band] for band in BANDS}
    losses["reflectors, L band, median, dB"] = np.median(poses.measured, axis=1)
    thresholds: list[Row] = []
    for title, name in _THRESHOLDS.items():
        if name in learnt:
            levels = 20 * np.log10(learnt[name])
            thresholds.append((title, *[f"{level:.1f}" for level in levels]))
    return {
        "recipe": recipe,
        "lanes": [_lane_row(recipe, lane) for lane in lanes],
        "header": HEADER,
        "points": _points(recipe, lanes),
        "regions": [f"{a:g} to {b:g} m" for a, b in pairwise(recipe.image.edges)],
        "thresholds": [*thresholds, ("looks at mines", *learnt["looks"])],
        "courses": _course_rows(lanes),
        "poses": poses,
        "errors": [f"{1000 * error:g}" for error in poses.errors],
        "losses": [(name, *[f"{one:.1f}" for one in loss]) for name, loss in losses.items()],
        "fullwave": fullwave,
        "peaks": _peak_rows(fullwave.table),
        "false_alarms": [
            (row["roadside"], row["method"], row["false alarms"], f"{100 * row['masked']:.0f} %")
            for row in fullwave.false.to_dict("records")
        ],
        "system": _system_rows(recipe),
        "combinations": [(f"#{k}", _output(iterations)) for k, iterations in TABLE_II.items()],
    }


def _output(iterations: Sequence[int]) -> str:
    """Name the output images of a combination as Table II does."""
    if not any(iterations):
        return "Original SAR image"
    return f"Iterations {' and '.join(map(str, iterations))} times"


def _system_rows(recipe: FuseRecipe) -> list[Row]:
    """Tabulate both radars as Table I does."""
    antennas = []
    bands = []
    polarizations = []
    for band in BANDS:
        sensor = band_sensor(recipe, band)
        tx, rx = (len(np.unique(side, axis=0)) for side in sensor.pairs())
        tones = sensor.tones.axis()
        antennas.append(f"{tx} transmitters, {rx} receivers")
        bands.append(f"{tones[0] / 1e9:.2f} GHz to {tones[-1] / 1e9:.2f} GHz, {len(tones)} tones")
        polarizations.append(", ".join(sensor.polarization))
    return [
        ("Antennas, L band", "8 transmitters, 8 receivers", antennas[0]),
        ("Antennas, X band", "32 transmitters, 4 receivers", antennas[1]),
        ("Frequency bandwidth, L band", "0.75 GHz to 3.2 GHz", bands[0]),
        ("Frequency bandwidth, X band", "8.4 GHz to 10.4 GHz (the text: 8 to 12 GHz)", bands[1]),
        ("Polarization, L band", "VV, HH, VH, HV", polarizations[0]),
        ("Polarization, X band", "VV", polarizations[1]),
    ]


def _points(recipe: FuseRecipe, lanes: Sequence[LaneResult]) -> list[Row]:
    """Return Pd at operating points, before and after, by both conventions of FAR."""
    rows: list[Row] = []
    for lane in lanes:
        for convention in CONVENTIONS:
            for variant in ("original", "iteration"):
                matched, _, options = scored(lane, variant, recipe, convention)
                area = {name: options[name] for name in ("area", "frame_area") if name in options}
                inside = matched.truth["inside"].to_numpy(dtype=bool)
                subsets = {f"lane {lane.name}, {convention}": inside}
                rows += point_rows({variant: matched}, subsets, shared="count", **area)
    return rows


def _lane_row(recipe: FuseRecipe, lane: LaneResult) -> Row:
    """Return the row of a lane: its length, mines, frames and objects."""
    counts = [(lane.objects["kind"] == kind).sum() for kind in ("bush", "post", "rock")]
    return lane.name, f"{recipe.lanes.length:g} m", len(lane.truth), lane.frames, *counts


def _course_rows(lanes: Sequence[LaneResult]) -> list[Row]:
    """Tabulate how the residual goes by variant."""
    table = pd.concat([lane.courses for lane in lanes])
    rows = []
    for name, title in VARIANTS.items():
        rows_of_variant = table[table["variant"] == name]
        if rows_of_variant.empty or name == "original":
            continue
        counts = ["no iterations"] * 3
        if "least" not in name:
            flags = rows_of_variant[["rises", "diverged", "fallen"]] > 0
            counts = [f"{count} of {len(flags)}" for count in flags.sum()]
        masked = f"{100 * rows_of_variant['masked'].mean():.1f}"
        residual = f"{rows_of_variant['residual'].mean():.3f}"
        seconds = f"{rows_of_variant['cpu'].median():.2f}"
        rows.append((title, masked, residual, seconds, *counts))
    return rows


def _peak_rows(table: pd.DataFrame) -> list[Row]:
    """Tabulate the peaks of the full-wave run by method."""
    rows: list[Row] = []
    for row in table[table["method"] != "none"].to_dict("records"):
        changes = (f"{row['VV']:+.1f}", f"{row['HH']:+.1f}", f"{100 * row['masked']:.0f} %")
        ranks = (row["rank"], row["above"]) if row["rank"] else ("", "")
        rows.append((row["roadside"], row["method"], row["object"], *changes, *ranks))
    return rows
