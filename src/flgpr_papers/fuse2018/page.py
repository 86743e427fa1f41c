"""The page of the reproduction: findings, figures and tables of the paper beside ours."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

import flgpr
from flgpr.io import write_whole
from flgpr_papers.fuse2018 import figures
from flgpr_papers.fuse2018.fullwave import FullwaveStudy
from flgpr_papers.fuse2018.poses import PoseStudy
from flgpr_papers.fuse2018.process import VARIANTS, Calibration
from flgpr_papers.fuse2018.recipe import FuseRecipe
from flgpr_papers.fuse2018.results import LaneResult
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.page import draw, figure_html, findings_table, plain_table, quick_note, study_html, wide_table

_RULES = (
    "Intervals are 95 %, by bootstrap over objects, mines and stretches of lane. A claim that something is larger "
    "agrees if the interval of the difference lies above zero, disagrees if below, and is undecided otherwise; a "
    "figure of the paper agrees if it lies in our interval. Where the paper is silent (<i>not tried</i>) the question "
    "is ours."
)


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
    parts = [
        "<h1>Fuse, Gonzalez-Valdes, Martinez-Lorenzo &amp; Rappaport 2018 on simulated lanes</h1>",
        quick_note(quick, "A few mines on short lanes with thin surfaces and coarse pixels"),
        _lanes_text(recipe, lanes),
        "<h2>Findings</h2>",
        findings_table(found, _RULES),
        "<h2>Thresholds</h2>",
        _threshold_table(calibration, recipe),
        "<h2>Suppression, variant by variant</h2>",
        _course_table(lanes, recipe),
        "<h2>Pose accuracy</h2>",
        _pose_text(poses, recipe),
        "<h2>The full-wave lane</h2>",
        *_fullwave_tables(fullwave),
        "<h2>Figures</h2>",
    ]
    for name, caption, figure in _figures(recipe, lanes, loose, example, poses, fullwave):
        picture = draw(figure, quick, 60 if quick else 110)
        write_whole(folder / f"{name}.png", picture)
        parts.append(figure_html(picture, caption))
    write_whole(folder / "fullwave.csv", fullwave.table.to_csv(index=False))
    return study_html("Fuse et al. 2018, reproduced", parts)


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


def _lanes_text(recipe: FuseRecipe, lanes: Sequence[LaneResult]) -> str:
    rows = [
        [lane.name, f"{recipe.lanes.length:g} m", str(len(lane.truth)), str(lane.frames)]
        + [str(int((lane.objects["kind"] == kind).sum())) for kind in ("bush", "post", "rock")]
        for lane in lanes
    ]
    return (
        f"<p>flgpr {escape(flgpr.__version__)}; L band 0.75-3.2 GHz, 8 by 8 antennas, four polarizations; X band "
        "8.4-10.4 GHz (the paper's text says 8-12 GHz, its table 8.4-10.4; the table is taken), 32 by 4, VV; one "
        f"vehicle, one set of poses. Images over cross-range {recipe.image.x[0]:g} to {recipe.image.x[1]:g} m, "
        f"{recipe.image.y[0]:g} to {recipe.image.y[1]:g} m ahead, {recipe.image.frames} frames summed coherently. "
        "Lanes are simulated and hold metal mines only; thresholds come from a third lane and were not touched "
        "afterwards.</p>" + plain_table(["lane", "length", "mines", "apertures", "bushes", "posts", "rocks"], rows)
    )


def _threshold_table(calibration: Calibration, recipe: FuseRecipe) -> str:
    limits, edges = calibration.thresholds, recipe.image.edges
    names = {"VV": limits.vv, "VH": limits.vh, "X": limits.second, "VH, roadside": limits.low_vh}
    rows = [
        [name, *(f"{20 * np.log10(v):.1f}" for v in values)] for name, values in names.items() if values is not None
    ]
    rows.append(["looks at mines", *(str(n) for n in calibration.looks)])
    head = ["dB", *(f"{a:g} to {b:g} m" for a, b in pairwise(edges))]
    return (
        "<p>From the calibration lane, per sub-region: VV the weakest mine's peak; VH and X the most that any mine's "
        f"response (within {recipe.mask.response_db:g} dB of its VV peak) reaches; the low VH threshold the mean at "
        "the roadside. The paper's extended mask, (VV low and VH low) or VH low, is VH low alone.</p>"
        + plain_table(head, rows)
    )


def _course_table(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> str:
    table = pd.concat([lane.courses for lane in lanes])
    rows = []
    for name, words in VARIANTS.items():
        one = table[table["variant"] == name]
        if one.empty or name == "original":
            continue
        stopped = int((one["stopped"] > 0).sum())
        rows.append(
            [words, f"{100 * one['masked'].mean():.1f}", f"{one['residual'].mean():.3f}", f"{one['cpu'].median():.2f}",
             f"{stopped} of {len(one)}" if "least" not in name else "cannot diverge"]
        )  # fmt: skip
    return (
        f"<p>Means over the apertures; {recipe.suppress.iterations} iterations, combination "
        f"#{recipe.suppress.combination}. An aperture counts as stopped if the residual of the shared fit or of any of "
        "its frames would have risen before the last iteration; its last good iteration then stands in.</p>"
        + plain_table(["variant", "pixels masked, %", "residual", "CPU, s (median)", "stopped"], rows)
    )


def _pose_text(study: PoseStudy, recipe: FuseRecipe) -> str:
    head = ["error of the position, mm", *(f"{1000 * e:g}" for e in study.errors)]
    rows = [[f"formula, {band.upper()} band, dB", *(f"{v:.1f}" for v in study.predicted[band])] for band in ("l", "x")]
    rows.append(["reflectors, L band, median, dB", *(f"{v:.1f}" for v in np.median(study.measured, axis=1))])
    return (
        f"<p>A loss of 1 dB allows an error along the line of sight of {1000 * study.needed['l']:.1f} mm rms from "
        f"frame to frame in the L band and {1000 * study.needed['x']:.1f} mm in the X band. The lanes have "
        f"{1000 * recipe.radar.position:g} mm in each axis; X-band frames are therefore averaged in magnitude. A sum "
        f"of only {recipe.image.frames} frames loses a little less than the formula, which is for many.</p>"
        + plain_table(head, rows)
    )


def _fullwave_tables(study: FullwaveStudy) -> Iterator[str]:
    yield (
        f"<p>Single band, masks from VV and VH; thresholds from {study.worlds} simulated lanes with the same array and "
        "soil, in medians of each sub-region, since the full-wave data have a scale of their own. The paper's roadside "
        "(4 to 10 m of 10) is scaled in two ways. Changes are of the peak within 0.4 m, with the same mask in both "
        "polarizations; <i>masked</i> is the share of the VV response; rank and false alarms above are in VV.</p>"
    )
    table = study.table[study.table["method"] != "none"]
    rows = [
        [r["roadside"], r["method"], r["object"], f"{r['VV']:+.1f}", f"{r['HH']:+.1f}", f"{100 * r['masked']:.0f} %",
         str(r["rank"]) if r["rank"] else "", str(r["above"]) if r["rank"] else ""]
        for r in table.to_dict("records")
    ]  # fmt: skip
    yield wide_table(["roadside", "method", "object", "VV, dB", "HH, dB", "masked", "rank", "false above"], rows)
    yield plain_table(
        ["roadside", "method", "false alarms in the lane", "pixels masked"],
        [[r["roadside"], r["method"], str(r["false alarms"]), f"{100 * r['masked']:.0f} %"]
         for r in study.false.to_dict("records")],
    )  # fmt: skip
