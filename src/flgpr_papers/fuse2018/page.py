"""The page of the reproduction: findings, figures and tables of the paper beside ours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.io import write_whole
from flgpr_papers.fuse2018 import figures
from flgpr_papers.fuse2018.findings import CONVENTIONS, scored
from flgpr_papers.fuse2018.fullwave import FullwaveStudy
from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.poses import PoseStudy
from flgpr_papers.fuse2018.process import VARIANTS, Calibration
from flgpr_papers.fuse2018.results import LaneResult
from flgpr_papers.kit.findings import Finding, by_chance
from flgpr_papers.kit.page import HEADER, draw, point_rows, study_html

Row = tuple[Any, ...]


def page_html(
    recipe: FuseRecipe,
    lanes: Sequence[LaneResult],
    loose: LaneResult,
    calibration: Calibration,
    example: Mapping[str, NDArray[Any]],
    poses: PoseStudy,
    fullwave: FullwaveStudy,
    found: Sequence[Finding],
    quick: bool,
    folder: Path,
) -> str:
    """Write the page, which needs nothing beside it; its figures are left in the folder as PNG too."""
    pictures = []
    for name, caption, figure in _figures(recipe, lanes, loose, example, poses, fullwave):
        picture = draw(figure, quick, 60 if quick else 110)
        write_whole(folder / f"{name}.png", picture)
        pictures.append((picture, caption))
    write_whole(folder / "fullwave.csv", fullwave.table.to_csv(index=False))
    return study_html(
        "fuse2018.html",
        quick=quick,
        recipe=recipe,
        lanes=[_lane_row(recipe, lane) for lane in lanes],
        found=found,
        chance=by_chance(found),
        header=HEADER,
        points=list(_points(recipe, lanes)),
        regions=[f"{a:g} to {b:g} m" for a, b in pairwise(recipe.image.edges)],
        thresholds=_threshold_rows(calibration),
        courses=_course_rows(lanes),
        poses=poses,
        errors=[f"{1000 * error:g}" for error in poses.errors],
        losses=_loss_rows(poses),
        fullwave=fullwave,
        peaks=_peak_rows(fullwave.table),
        false_alarms=[
            (r["roadside"], r["method"], r["false alarms"], f"{100 * r['masked']:.0f} %")
            for r in fullwave.false.to_dict("records")
        ],
        pictures=pictures,
    )


def _figures(
    recipe: FuseRecipe,
    lanes: Sequence[LaneResult],
    loose: LaneResult,
    example: Mapping[str, NDArray[Any]],
    poses: PoseStudy,
    fullwave: FullwaveStudy,
) -> Iterator[tuple[str, str, Figure]]:
    shown = {**example, "box side": np.asarray(recipe.boxes.side)}
    yield (
        "figure-3", "Fig. 3. L band, VV. Triangles: mines; rectangles: the two named clutter boxes, the strongest "
        "roadside object on either side.", figures.mask_figure(shown, "vv", "mask vv", "L band VV", True),
    )  # fmt: skip
    yield "figure-4", "Fig. 4. L band, VH.", figures.mask_figure(shown, "vh", "mask vh", "L band VH")
    if "x" in shown:
        yield "figure-5", "Fig. 5. X band, VV.", figures.mask_figure(shown, "x", "mask x", "X band VV")
    yield "figure-6", "Fig. 6. Mixed binary masks.", figures.mixed_figure(shown)
    yield "figure-7", "Fig. 7. Averages of iterations.", figures.stages_figure(shown)
    yield (
        "figure-8", "Fig. 8. Clutter power against iterations and combinations; shaded: 95 % interval of the mean. "
        "(The paper's text and caption exchange its parts a and b.)", figures.power_figure(lanes, example, recipe),
    )  # fmt: skip
    yield "figure-9", "Fig. 9. ROC with and without suppression.", figures.roc_figure(lanes, recipe)
    yield "variants", "The same frame, every variant.", figures.variants_figure(shown)
    yield "poses", "What poses cost the coherent sum (Eq. 4).", figures.pose_figure(poses, lanes, loose)
    yield (
        "fullwave", "The full-wave lane. Triangles: mines; cross: rock; square: post.",
        figures.fullwave_figure(fullwave),
    )  # fmt: skip


def _points(recipe: FuseRecipe, lanes: Sequence[LaneResult]) -> Iterator[Row]:
    """Pd at operating points, before and after, by both conventions of FAR."""
    for lane in lanes:
        for convention in CONVENTIONS:
            for variant in ("original", "iteration"):
                matched, _, options = scored(lane, variant, recipe, convention)
                area = {name: options[name] for name in ("area", "frame_area") if name in options}
                inside = {f"lane {lane.name}, {convention}": matched.truth["inside"].to_numpy(dtype=bool)}
                yield from point_rows({variant: matched}, inside, shared="count", **area)


def _lane_row(recipe: FuseRecipe, lane: LaneResult) -> Row:
    count = ((lane.objects["kind"] == kind).sum() for kind in ("bush", "post", "rock"))
    return lane.name, f"{recipe.lanes.length:g} m", len(lane.truth), lane.frames, *count


def _threshold_rows(calibration: Calibration) -> list[Row]:
    names, learnt = {"VV": "vv", "VH": "vh", "X": "second", "VH, roadside": "low_vh"}, calibration.learnt
    rows: list[Row] = [
        (words, *(f"{20 * np.log10(v):.1f}" for v in learnt[name])) for words, name in names.items() if name in learnt
    ]
    return [*rows, ("looks at mines", *learnt["looks"])]


def _course_rows(lanes: Sequence[LaneResult]) -> list[Row]:
    table = pd.concat([lane.courses for lane in lanes])
    rows = []
    for name, words in VARIANTS.items():
        one = table[table["variant"] == name]
        if one.empty or name == "original":
            continue
        stopped = f"{(one['stopped'] > 0).sum()} of {len(one)}" if "least" not in name else "cannot diverge"
        means = f"{100 * one['masked'].mean():.1f}", f"{one['residual'].mean():.3f}", f"{one['cpu'].median():.2f}"
        rows.append((words, *means, stopped))
    return rows


def _loss_rows(study: PoseStudy) -> list[Row]:
    losses = {f"formula, {band.upper()} band, dB": study.predicted[band] for band in ("l", "x")}
    losses["reflectors, L band, median, dB"] = np.median(study.measured, axis=1)
    return [(name, *(f"{v:.1f}" for v in values)) for name, values in losses.items()]


def _peak_rows(table: pd.DataFrame) -> list[Row]:
    return [
        (r["roadside"], r["method"], r["object"], f"{r['VV']:+.1f}", f"{r['HH']:+.1f}", f"{100 * r['masked']:.0f} %",
         *((r["rank"], r["above"]) if r["rank"] else ("", "")))
        for r in table[table["method"] != "none"].to_dict("records")
    ]  # fmt: skip
