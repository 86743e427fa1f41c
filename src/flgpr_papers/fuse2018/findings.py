"""Findings of Fuse et al. 2018 on simulated lanes: whether they show what the paper found.

The paper's figures in dB are those of two named boxes of one frame. They are compared with the
named boxes of our frames, whose spread from frame to frame is the error of the paper's one frame,
too; they are alike within 6 dB. The signals of mines remain if the interval of the mean change of
what they alone give at their peaks lies within 1 dB.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.clutter import TABLE_II
from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.matches import CONVENTIONS, compared
from flgpr_papers.fuse2018.powers import (
    frame_error,
    mean_over_boxes,
    mine_changes,
    one_frame,
    own_changes,
    power_db,
    strongest_boxes,
    with_interval,
)
from flgpr_papers.fuse2018.questions import own_findings
from flgpr_papers.fuse2018.results import LaneResult
from flgpr_papers.kit.findings import (
    SHARE,
    SHARE_DIFFERENCE,
    Finding,
    alike,
    clustered,
    difference_of_means,
    judge,
    larger,
    parts_larger,
    together,
)

PAPER_DB = 26.5
PAPER_MEAN_DB = 5.03
"""What the paper's clutter falls by with #6, and how much of it averaging gives, dB (Sec. 3.2)."""
FALL = f"combination #6 lowers the clutter power by {PAPER_DB:g} dB"
BY_MEAN = f"averaging alone gives about {PAPER_MEAN_DB:g} dB of it"
KEPT = "the targets' signals remain"
COVERS = "the mask does not cover targets"
FloatArray = NDArray[np.float64]
_KEPT = 1.0  # dB by which a peak may change
_ALIKE = 6.0  # dB by which a figure of the paper may differ
_LARGER_THAN_ZERO = ("larger", 0.0, 0.0)


def peaks_kept(low: float, high: float) -> str:
    """Return the verdict on whether mine peaks remain, by the interval of their change, dB."""
    return judge(low, high, (-_KEPT, _KEPT))


def all_findings(
    lanes: Sequence[LaneResult], loose: LaneResult, recipe: FuseRecipe
) -> list[Finding]:
    """Judge the paper's statements, then our own questions.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    loose : LaneResult
        Result of a lane with the presets' looser navigation.
    recipe : FuseRecipe
        The study.
    """
    statements = paper_findings(lanes, recipe)
    return [*statements, *own_findings(lanes, loose, strongest_boxes(lanes), recipe)]


def paper_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge the paper's statements; those on roadside clutter only where there is some.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    recipe : FuseRecipe
        The study.
    """
    findings = []
    if any(len(lane.boxes) for lane in lanes):
        findings += clutter_findings(strongest_boxes(lanes), recipe)
        findings += band_findings(lanes, recipe)
    findings += _mine_findings(lanes, recipe)
    for lane in lanes:
        for convention in CONVENTIONS:
            findings.append(_roc_finding(lane, convention, recipe))
    return findings


def clutter_findings(boxes: pd.DataFrame, recipe: FuseRecipe) -> list[Finding]:
    """Judge what Sec. 3.2 says of the clutter power, in all iterations and combinations.

    Parameters
    ----------
    boxes : DataFrame
        As `flgpr_papers.fuse2018.powers.strongest_boxes` returns it.
    recipe : FuseRecipe
        The study.
    """
    sixth = power_db(boxes, "iteration 6")
    seventh = power_db(boxes, "iteration 7")
    averaging_gain = (sixth + seventh) / 2 - power_db(boxes, "#6")
    return [
        _figure_finding(FALL, boxes, -power_db(boxes, "#6"), PAPER_DB, recipe),
        _figure_finding(BY_MEAN, boxes, averaging_gain, PAPER_MEAN_DB, recipe),
        _larger_finding(
            "averaging lowers the clutter",
            "cancelled out by taking the average (Sec. 3.2)",
            boxes,
            averaging_gain,
            f"{len(boxes)} boxes of {boxes['cluster'].nunique()} objects",
            recipe,
        ),
        _larger_finding(
            "more iterations leave less clutter",
            "power falls with the iteration (Fig. 8)",
            boxes,
            power_db(boxes, "iteration 1") - seventh,
            "iteration 7 against iteration 1, without averaging",
            recipe,
        ),
        _combination_finding(boxes, recipe),
    ]


def _figure_finding(
    claim: str, boxes: pd.DataFrame, values: FloatArray, figure: float, recipe: FuseRecipe
) -> Finding:
    """Judge a figure of the paper by the boxes of one frame."""
    gap, low, high = one_frame(boxes, values, figure)
    of_frame = with_interval((gap + figure, low + figure, high + figure))
    of_all = with_interval(mean_over_boxes(boxes, values, recipe))
    return Finding(
        claim=claim,
        paper=f"{figure:g} dB",
        ours=f"two boxes of a frame {of_frame}",
        verdict=alike(low, high, _ALIKE),
        note=f"interval of one frame; mean over all {len(boxes)} boxes {of_all}",
        interval=(gap, low, high),
        asks=("alike", _ALIKE, frame_error(boxes, values)),
        unit="dB",
    )


def _larger_finding(
    claim: str,
    paper: str,
    boxes: pd.DataFrame,
    values: FloatArray,
    note: str,
    recipe: FuseRecipe,
) -> Finding:
    """Judge that the mean of values over boxes lies above zero, dB."""
    mean, low, high = mean_over_boxes(boxes, values, recipe)
    return Finding(
        claim=claim,
        paper=paper,
        ours=with_interval((mean, low, high)),
        verdict=larger(low, high),
        note=note,
        interval=(mean, low, high),
        asks=_LARGER_THAN_ZERO,
        unit="dB",
    )


def _combination_finding(boxes: pd.DataFrame, recipe: FuseRecipe) -> Finding:
    """Judge that #6 leaves less clutter than every other combination of Table II."""
    others = [f"#{number}" for number in TABLE_II if number != 6]
    level = together(len(others))
    gaps = {}
    for name in others:
        more = power_db(boxes, name) - power_db(boxes, "#6")
        gap = clustered(more, boxes["cluster"], recipe.boxes.draws, level=level)
        gaps[f"{name} less #6"] = gap
    return parts_larger(
        "#6 is the best combination",
        "produces the best pattern (Sec. 3.2)",
        gaps,
        note="dB, #6 against each of #0 to #5, by intervals that hold together",
    )


def band_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge what the masks rest on.

    It is how the bands tell buried targets from clutter, and what the fundamental part covers.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    recipe : FuseRecipe
        The study.
    """
    table = pd.concat([lane.bands.assign(lane=lane.name) for lane in lanes])
    table["cluster"] = table["lane"] + table["name"].astype(str)
    mines = table[table["what"] == "mine"]
    clutter = table[table["what"] == "clutter"]
    findings = []
    for band, title in (("vh", "L band VH"), ("x", "X band")):
        if band in table and not table[band].isna().all():
            findings.append(_weak_finding(band, title, mines, clutter, recipe))
    share, low, high = clustered(clutter["held"], clutter["cluster"], recipe.boxes.draws)
    covered = Finding(
        claim="the fundamental mask covers most of the clutter",
        paper="able to cover the most part of the region (Sec. 2.4)",
        ours=with_interval((share, low, high), "", 2),
        verdict=larger(low, high, 0.5),
        note="share of the VV power in the boxes of roadside objects",
        interval=(share, low, high),
        asks=("larger", 0.5, 0.0),
        bounds=SHARE,
    )
    return [*findings, covered]


def _weak_finding(
    band: str, title: str, mines: pd.DataFrame, clutter: pd.DataFrame, recipe: FuseRecipe
) -> Finding:
    """Judge that buried targets are weaker in a band than objects above the ground."""
    draws = recipe.boxes.draws
    clutter_level = clustered(20 * np.log10(clutter[band]), clutter["cluster"], draws)
    mine_level = clustered(20 * np.log10(mines[band]), mines["cluster"], draws)
    gap, low, high = difference_of_means(clutter_level, mine_level)
    return Finding(
        claim=f"the {title} response of buried targets is weak",
        paper="weak, that of above-ground objects strong (Sec. 1)",
        ours=with_interval((gap, low, high)),
        verdict=larger(low, high),
        note=f"peak over the median at its distance, roadside objects less mines; "
        f"{len(clutter)} and {len(mines)} looks",
        interval=(gap, low, high),
        asks=_LARGER_THAN_ZERO,
        unit="dB",
    )


def _mine_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge what the paper says of the mines' peaks."""
    return [_peak_finding(lanes, recipe), _mask_finding(lanes, recipe)]


def _peak_finding(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Finding:
    """Judge that the signals of the mines remain (Sec. 3.2)."""
    draws = recipe.boxes.draws
    changes, targets = own_changes(lanes, "iteration")
    mean, low, high = clustered(changes, targets, draws)
    halo = clustered(*mine_changes(lanes, "iteration"), draws)
    return Finding(
        claim=KEPT,
        paper="target signals still remain (Sec. 3.2)",
        ours=with_interval((mean, low, high)),
        verdict=peaks_kept(low, high),
        note=f"change of what a mine alone gives at its peak, mask and amplitudes held fixed, "
        f"{len(changes)} looks at {targets.nunique()} mines; within 1 dB agrees. The largest "
        f"pixel of its halo, clutter included, changes by {with_interval(halo)}",
        interval=(mean, low, high),
        rule=(-_KEPT, _KEPT),
        unit="dB",
    )


def _mask_finding(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Finding:
    """Judge that the mask does not cover the mines (Sec. 3.1)."""
    tables = []
    for lane in lanes:
        tables.append(lane.mines[lane.mines["variant"] == "original"].assign(lane=lane.name))
    looks = pd.concat(tables)
    mines = looks["lane"] + looks["target"].astype(str)
    share, low, high = clustered(looks["masked"], mines, recipe.boxes.draws)
    peaks, _ = mine_changes(lanes, "iteration")
    rule = (0.0, 0.05)
    return Finding(
        claim=COVERS,
        paper="covers just the clutter area (Sec. 3.1)",
        ours=with_interval((share, low, high), "", 3),
        verdict=judge(low, high, rule),
        note=f"share of {len(peaks)} looks whose peak is masked; up to 5 % agrees",
        interval=(share, low, high),
        rule=rule,
        bounds=SHARE,
    )


def _roc_finding(lane: LaneResult, convention: str, recipe: FuseRecipe) -> Finding:
    """Judge that the ROC of a lane is better with suppression (Fig. 9)."""
    comparison = compared(lane, "iteration", "original", recipe, convention)
    counted = "looks" if convention == "frames" else "mines"
    return Finding(
        claim=f"ROC better with suppression, lane {lane.name}, {CONVENTIONS[convention]}",
        paper="significantly improved (Fig. 9)",
        ours=f"PD_mean {comparison.pd_mean_b:.2f} to {comparison.pd_mean_a:.2f}, by "
        f"{comparison.difference:+.2f} ({comparison.low:+.2f} to {comparison.high:+.2f})",
        verdict=larger(comparison.low, comparison.high),
        note=f"Pd averaged over FAR up to {recipe.score.far_max:g} per m², "
        f"{comparison.n_targets} {counted}; at {comparison.far:g} per m² {comparison.only_a} mines "
        f"are found more often with it, {comparison.only_b} without",
        interval=(comparison.difference, comparison.low, comparison.high),
        asks=_LARGER_THAN_ZERO,
        bounds=SHARE_DIFFERENCE,
    )
