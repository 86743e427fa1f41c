"""Our own questions about the variants of the suppression of Fuse et al. 2018, without verdicts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.scoring import compare
from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.matches import HITS, compared, lane_match, track_match
from flgpr_papers.fuse2018.powers import (
    mean_over_boxes,
    mine_changes,
    own_changes,
    power_db,
    strongest_boxes,
    with_interval,
)
from flgpr_papers.fuse2018.results import LaneResult
from flgpr_papers.kit.findings import (
    OPEN,
    SHARE_DIFFERENCE,
    Finding,
    clip,
    clustered,
    in_words,
)

FloatArray = NDArray[np.float64]
# Questions of which of two variants removes more clutter: claim, the better by it, the other.
_REMOVES_MORE = (
    (
        "least squares removes more clutter than the iteration with one reflectivity at equal cost",
        "least squares",
        "shared",
    ),
    ("the road fitted too and not subtracted", "least squares spared", "least squares"),
    (
        "one reflectivity for all frames removes more than one per frame",
        "shared",
        "iteration",
    ),
    (
        "B of the whole response removes more than B of each sub-region's own",
        "whole response",
        "iteration",
    ),
    (
        "the roadside's level of the calibration lane removes more than that of the frame itself",
        "calibrated roadside",
        "iteration",
    ),
)
_REMOVES_MORE_BY_MASK = (
    (
        "with a reflectivity per frame, least squares removes more than the iteration",
        "least squares per frame",
        "iteration",
    ),
    ("masks by connected region remove more clutter than by pixel", "regions", "iteration"),
    ("the X band removes clutter that VV and VH alone leave", "iteration", "L band alone"),
)
_FOLLOWED = ("iteration", "least squares", "least squares spared")
"""Variants through which what the mines alone add is followed."""
_RIVALS = (
    "shared",
    "whole response",
    "calibrated roadside",
    "least squares",
    "least squares spared",
    "least squares per frame",
    "L band alone",
)
"""Variants whose ROC is compared with that of the iteration."""


def own_findings(
    lanes: Sequence[LaneResult], loose: LaneResult, boxes: pd.DataFrame, recipe: FuseRecipe
) -> list[Finding]:
    """Return the findings of our own questions about the variants.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    loose : LaneResult
        Result of a lane with the presets' looser navigation.
    boxes : DataFrame
        As `flgpr_papers.fuse2018.powers.strongest_boxes` returns it.
    recipe : FuseRecipe
        The study.
    """
    findings = [_mines_alone_finding(lanes, recipe)]
    for claim, better, worse in _REMOVES_MORE:
        findings.append(_power_finding(claim, better, worse, lanes, boxes, recipe))
    findings.append(_fall_back_finding(lanes, boxes, recipe))
    for claim, better, worse in _REMOVES_MORE_BY_MASK:
        findings.append(_power_finding(claim, better, worse, lanes, boxes, recipe))
    for variant in _RIVALS:
        findings.append(_rival_finding(variant, lanes, recipe))
    for lane in lanes:
        findings.append(_track_finding(lane, recipe))
    for variant in ("iteration", "shared"):
        findings.append(_pose_finding(variant, loose, boxes, recipe))
    return findings


def _mines_alone_finding(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Finding:
    """Return how what a mine alone gives at its peak changes by variant."""
    changes = {}
    for variant in _FOLLOWED:
        change, mines = own_changes(lanes, variant)
        changes[variant] = clustered(change, mines, recipe.boxes.draws)
    texts = [f"{variant} {with_interval(change)}" for variant, change in changes.items()]
    return Finding(
        claim="what a mine alone gives at its peak",
        paper="not tried",
        ours="; ".join(texts),
        verdict=OPEN,
        interval=changes["least squares"],
    )


def _power_finding(
    claim: str,
    better: str,
    worse: str,
    lanes: Sequence[LaneResult],
    boxes: pd.DataFrame,
    recipe: FuseRecipe,
) -> Finding:
    """Return by how much a variant leaves less clutter than another."""
    gap = mean_over_boxes(boxes, power_db(boxes, worse) - power_db(boxes, better), recipe)
    change, mines = mine_changes(lanes, better)
    peaks = clustered(change, mines, recipe.boxes.draws)
    return Finding(
        claim=claim,
        paper="not tried",
        ours=with_interval(gap),
        verdict=OPEN,
        note=f"mine peaks change by {with_interval(peaks)}.",
        interval=gap,
    )


def _fall_back_finding(
    lanes: Sequence[LaneResult], boxes: pd.DataFrame, recipe: FuseRecipe
) -> Finding:
    """Return in how many apertures the iteration diverged, and what falling back gives."""
    courses = pd.concat([lane.courses[lane.courses["variant"] == "iteration"] for lane in lanes])
    fall = power_db(boxes, "as printed") - power_db(boxes, "iteration")
    gap = mean_over_boxes(boxes, fall, recipe)
    rises = int((courses["rises"] > 0).sum())
    diverged = int((courses["diverged"] > 0).sum())
    fallen = int((courses["fallen"] > 0).sum())
    note = (
        f"of {len(courses)} apertures the residual rose for an iteration in {rises}, by up to "
        f"{100 * courses['rise'].max():.2g} %; the last was worse than another in {diverged}, and "
        f"their average, too, in {fallen}"
    )
    return Finding(
        claim="falling back to the best iteration where a course diverged removes more",
        paper="always averages iterations 6 and 7",
        ours=with_interval(gap),
        verdict=OPEN,
        note=note,
        interval=gap,
        unit="dB",
    )


def _rival_finding(variant: str, lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Finding:
    """Compare the ROC of a variant with that of the iteration, lane by lane.

    Every frame counts its area.
    """
    gaps = []
    texts = []
    means = []
    for lane in lanes:
        comparison = compared(lane, variant, "iteration", recipe, "frames")
        gap = (comparison.difference, comparison.low, comparison.high)
        gaps.append(gap)
        texts.append(f"lane {lane.name} {in_words(*clip(gap, SHARE_DIFFERENCE))}")
        means.append(
            f"lane {lane.name} {comparison.pd_mean_a:.2f} against {comparison.pd_mean_b:.2f}"
        )
    return Finding(
        claim=f"ROC better with {variant} than with the iteration in each frame (frames)",
        paper="not tried",
        ours="; ".join(texts),
        verdict=OPEN,
        note=f"PD_mean {'; '.join(means)}",
        interval=min(gaps, key=lambda gap: gap[1]),
        bounds=SHARE_DIFFERENCE,
    )


def _track_finding(lane: LaneResult, recipe: FuseRecipe) -> Finding:
    """Compare the ROC of alarms followed over frames with that of the map of means."""
    comparison = compare(
        track_match(lane, "iteration", recipe),
        lane_match(lane, "iteration", recipe),
        far_max=recipe.score.far_max,
        far=recipe.score.far,
        draws=recipe.boxes.draws,
    )
    return Finding(
        claim=f"ROC better with alarms followed over {HITS} frames than on the map of means, "
        f"lane {lane.name}",
        paper="false alarms significantly reduced (the sequel's abstract)",
        ours=f"{comparison.difference:+.3f} ({comparison.low:+.3f} to {comparison.high:+.3f})",
        verdict=OPEN,
        note=f"PD_mean {comparison.pd_mean_a:.2f} against {comparison.pd_mean_b:.2f}, chance "
        f"{comparison.chance_a:.2f} and {comparison.chance_b:.2f}; lane area",
        interval=(comparison.difference, comparison.low, comparison.high),
    )


def _pose_finding(
    variant: str, loose: LaneResult, boxes: pd.DataFrame, recipe: FuseRecipe
) -> Finding:
    """Return how much suppression is lost with the looser navigation."""
    both = boxes.merge(
        strongest_boxes([loose])[["cluster", "frame", variant, "#0"]],
        on=["cluster", "frame"],
        suffixes=("", " loose"),
    )
    of_loose = both.assign(**{"#0": both["#0 loose"]})
    loss = power_db(of_loose, f"{variant} loose") - power_db(both, variant)
    gap = mean_over_boxes(both, loss, recipe)
    return Finding(
        claim=f"poses wrong by {100 * recipe.study.loose_position:g} cm cost suppression "
        f"({variant})",
        paper="not tried",
        ours=with_interval(gap),
        verdict=OPEN,
        note=f"{len(both)} boxes of lane {loose.name}",
        interval=gap,
    )
