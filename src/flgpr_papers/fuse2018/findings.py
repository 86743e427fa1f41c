"""Findings of Fuse et al. 2018 on simulated lanes: the paper's statements, then our own questions.

The statements and their rules are declared in ``statements.toml``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from flgpr.clutter import TABLE_II
from flgpr.scoring import Comparison, Match, accumulated_area, compare, match, roc_of, unroll_frames
from flgpr.screen import prescreen
from flgpr.screen.views import view_array
from flgpr.types import ArrayLike, Entries, FloatArray, floats
from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.process import LaneResult
from flgpr_papers.kit.findings import Finding, Statements, in_words
from flgpr_papers.kit.intervals import (
    SHARE_DIFFERENCE,
    Interval,
    clip,
    clustered,
    difference_of_means,
    together,
)

CONVENTIONS = {
    "frames": "area accumulated over all frames (Sec. 4)",
    "lane": "lane area, every place once",
}
"""Conventions of the area of FAR, and how they are called in full."""
HITS = 2
"""Frames in which an alarm must appear to be declared, where alarms are followed over frames."""
_BLOCK = 100.0  # m of the unrolled lane: ten frames


def frame_match(lane: LaneResult, variant: str, recipe: FuseRecipe) -> Match:
    """Match a variant's alarms frame by frame.

    Every frame's detection area gets a stretch of its own on an unrolled lane, so that the same
    ground counts again in every frame, as in the paper. Neighbouring frames, which see the same
    clutter, stay together when stretches of lane are resampled.

    Parameters
    ----------
    lane : LaneResult
        Results of the lane.
    variant : str
        Name of the variant.
    recipe : FuseRecipe
        The study.

    Returns
    -------
    Match
        Alarms and looks; column ``mine`` of the truth names the mine, ``inside`` the looks in the
        detection area.
    """
    score = recipe.score
    used = np.flatnonzero(np.isfinite(lane.poses[:, 0]))
    poses = {int(frame): lane.poses[frame] for frame in used}
    alarms = lane.alarms[lane.alarms["variant"] == variant]
    alarms = alarms.rename(columns={"magnitude": "confidence"})
    columns = ["frame", "across", "ahead", "confidence"]
    frames = unroll_frames(alarms[columns], poses, lane.truth, recipe.area, score.halo / 2)
    return match(frames.alarms, frames.looks, frames.lane, score.halo, halo_as="diameter")


def lane_match(lane: LaneResult, variant: str, recipe: FuseRecipe) -> Match:
    """Match a variant's alarms on the lane's map, every position once.

    The parameters are those of :func:`frame_match`.
    """
    level = lane.maps[variant]
    area = recipe.lane
    view = view_array(level, np.isfinite(level).astype(np.int64), recipe.map_grid, {})
    alarms = prescreen(view, area, recipe.score.radius, density=10.0)
    alarms = alarms[area.contains(alarms["x"], alarms["y"])]
    alarms = alarms.assign(confidence=alarms["magnitude"])
    return match(alarms, _lane_truth(lane), area, recipe.score.halo, halo_as="diameter")


def track_match(lane: LaneResult, variant: str, recipe: FuseRecipe) -> Match:
    """Match a variant's alarms, followed over frames, every position once.

    The parameters are those of :func:`frame_match`.
    """
    alarms = lane.alarms[lane.alarms["variant"] == variant]
    tracks = follow(alarms, recipe.score.halo / 2, HITS)
    tracks = tracks[recipe.lane.contains(tracks["x"], tracks["y"])]
    return match(tracks, _lane_truth(lane), recipe.lane, recipe.score.halo, halo_as="diameter")


def _lane_truth(lane: LaneResult) -> pd.DataFrame:
    """Return the truth of a lane with the columns of :func:`frame_match`."""
    return lane.truth.assign(mine=lane.truth["target_id"], inside=True)


def scored(
    lane: LaneResult, variant: str, recipe: FuseRecipe, convention: str
) -> tuple[Match, pd.DataFrame, dict[str, object]]:
    """Score a variant on a lane by a convention of FAR.

    Parameters
    ----------
    lane, variant, recipe
        As of :func:`frame_match`.
    convention : str
        One of ``CONVENTIONS``.

    Returns
    -------
    matched : Match
        The alarms matched to looks or mines.
    curve : DataFrame
        The ROC.
    options : dict
        Options of `flgpr.scoring.compare` that belong to the convention.
    """
    if convention == "frames":
        matched = frame_match(lane, variant, recipe)
        total = accumulated_area(lane.frames, recipe.score.x, recipe.score.y)
        area: dict[str, object] = {"area": "frames", "frame_area": total}
        options = {**area, "block": _BLOCK, "cluster": "mine"}
    else:
        matched = lane_match(lane, variant, recipe)
        area = {"area": "union"}
        options = {**area, "block": 10.0, "cluster": "mine"}
    inside = matched.truth["inside"].to_numpy(dtype=bool)
    curve = roc_of(matched, inside, shared="count", **area)  # type: ignore[arg-type]
    return matched, curve, options


def compared(
    lane: LaneResult, first: str, second: str, recipe: FuseRecipe, convention: str
) -> Comparison:
    """Compare two variants on a lane by a convention of FAR.

    Parameters
    ----------
    lane : LaneResult
        Results of the lane.
    first, second : str
        Names of the variants.
    recipe : FuseRecipe
        The study.
    convention : str
        One of ``CONVENTIONS``.
    """
    first_match, _, options = scored(lane, first, recipe, convention)
    second_match, _, _ = scored(lane, second, recipe, convention)
    inside = first_match.truth["inside"].to_numpy(dtype=bool)
    return compare(
        first_match,
        second_match,
        inside,
        far_max=recipe.score.far_max,
        far=recipe.score.far,
        draws=recipe.boxes.draws,
        **options,  # type: ignore[arg-type]
    )


def follow(alarms: pd.DataFrame, gate: float, hits: int) -> pd.DataFrame:
    """Join the alarms of frames into tracks that stand still in the lane frame.

    Frame by frame, each alarm, strongest first, continues the nearest track within the gate that
    has none of this frame yet, or begins one. A track stands at the mean of its alarms, weighed by
    magnitude. Its confidence is the ``hits``-th largest of its magnitudes: at a threshold, the
    tracks are declared of which so many frames exceed it.

    Parameters
    ----------
    alarms : DataFrame
        ``frame``, ``x``, ``y`` (m, lane frame) and ``magnitude``.
    gate : float
        Largest distance of an alarm from its track, m.
    hits : int
        Least number of frames of a track.

    Returns
    -------
    DataFrame
        ``x``, ``y`` (m), ``confidence`` and ``frames``; tracks of fewer frames are left out.
    """
    tracks: list[list[FloatArray]] = []
    by_magnitude = alarms.sort_values("magnitude", ascending=False, kind="stable")
    for _, frame in by_magnitude.groupby("frame", sort=True):
        positions = np.array([_track_position(track) for track in tracks]).reshape(-1, 2)
        is_free = np.ones(len(positions), dtype=bool)
        for alarm in floats(frame[["x", "y", "magnitude"]]):
            distance = np.where(is_free, np.hypot(*(positions - alarm[:2]).T), np.inf)
            if distance.size and distance.min() <= gate:
                nearest = int(distance.argmin())
                tracks[nearest].append(alarm)
                is_free[nearest] = False
            else:
                tracks.append([alarm])
    rows = []
    for track in tracks:
        if len(track) >= hits:
            magnitudes = [magnitude for *_, magnitude in track]
            rows.append((*_track_position(track), np.sort(magnitudes)[-hits], len(track)))
    return pd.DataFrame(rows, columns=["x", "y", "confidence", "frames"])


def _track_position(track: Sequence[FloatArray]) -> FloatArray:
    """Return the position of a track, weighed by the magnitudes of its alarms."""
    points = np.array(track)
    return np.average(points[:, :2], axis=0, weights=points[:, 2])


def pooled(lanes: Sequence[LaneResult], table: str, name: str = "target") -> pd.DataFrame:
    """Return a table of several lanes.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    table : str
        Name of the table.
    name : str
        Its column with the name of a mine or an object.

    Returns
    -------
    DataFrame
        The rows of all lanes, with ``lane`` and with ``cluster``, the mine or object by lane.
    """
    rows = pd.concat([getattr(lane, table).assign(lane=lane.name) for lane in lanes])
    return rows.assign(cluster=rows["lane"] + rows[name].astype(str))


def strongest_boxes(lanes: Sequence[LaneResult]) -> pd.DataFrame:
    """Return the strongest clutter box left and right of every frame, a row each.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.

    Returns
    -------
    DataFrame
        ``lane``, ``frame``, ``side``, ``object``, ``cluster``, the object by lane, and the power at
        every stage and of every variant.
    """
    rows = pooled([lane for lane in lanes if len(lane.boxes)], "boxes", "object")
    of_box = ["lane", "frame", "side", "object", "cluster"]
    wide = rows.pivot_table(index=of_box, columns="stage", values="power").reset_index()
    strongest = wide.groupby(of_box[:3])["#0"].idxmax()
    return wide.loc[strongest].reset_index(drop=True)


def power_db(boxes: pd.DataFrame, stage: str) -> FloatArray:
    """Return the power in boxes at a stage over that of the original image, dB."""
    return 10 * np.log10(boxes[stage].to_numpy() / boxes["#0"].to_numpy())


def mean_over_boxes(
    boxes: pd.DataFrame, values: ArrayLike, recipe: FuseRecipe, level: float = 0.95
) -> Interval:
    """Return the mean of values over boxes with its interval over objects."""
    return clustered(values, boxes["cluster"], recipe.boxes.draws, level=level)


def mine_changes(lanes: Sequence[LaneResult], variant: str) -> tuple[FloatArray, pd.Series]:
    """Return the change of every look's peak in a mine's halo, dB, and the mine of each look.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    variant : str
        Name of the variant.
    """
    of_look = ["lane", "frame", "target", "cluster"]
    wide = pooled(lanes, "mines").pivot_table(index=of_look, columns="variant", values="peak")
    wide = wide.reset_index()
    return 20 * np.log10(wide[variant].to_numpy() / wide["original"].to_numpy()), wide["cluster"]


def mine_powers(lanes: Sequence[LaneResult], variant: str) -> tuple[FloatArray, pd.Series]:
    """Return the mean power in a box about every look's mine, dB, and the mine of each look.

    The parameters are those of :func:`mine_changes`.
    """
    rows = pooled(lanes, "mines")
    rows = rows[rows["variant"] == variant]
    return 10 * np.log10(rows["power"].to_numpy()), rows["cluster"]


def own_changes(lanes: Sequence[LaneResult], variant: str) -> tuple[FloatArray, pd.Series]:
    """Return the change of what every mine alone gives at its peak, dB, and the mine of each look.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    variant : str
        Name of the variant.
    """
    rows = pooled(lanes, "own")
    rows = rows[rows["variant"] == variant]
    return floats(rows["change_db"]), rows["cluster"]


def frame_spread(boxes: pd.DataFrame, values: FloatArray) -> float:
    """Return how far a figure of one frame, as the paper shows, may lie from the mean, in dB.

    It is half of Student's interval for one frame more: left and right box of a frame are taken
    together, and their spread from frame to frame is that of the paper's one frame, too. It is 0
    where there are not two frames: nothing is known of it, and the margin alone counts.

    Parameters
    ----------
    boxes : DataFrame
        As :func:`strongest_boxes` returns it.
    values : (box,) ndarray
        A value for each box, dB.
    """
    frames = boxes.assign(value=values).groupby(["lane", "frame"])["value"].agg(["mean", "count"])
    means = frames.loc[frames["count"] == 2, "mean"]
    if len(means) < 2:
        return 0.0
    return float(stdtrit(len(means) - 1, 0.975) * means.std())


def with_interval(interval: Interval) -> str:
    """Format a level with its interval, dB."""
    value, low, high = (f"{number:z.1f}" for number in interval)
    return f"{value} dB ({low} to {high})"


PAPER_DB = 26.5
PAPER_MEAN_DB = 5.03
"""What the paper's clutter falls by with #6, and how much of it averaging gives, dB (Sec. 3.2)."""
STATEMENTS = Statements("fuse2018")
KEPT = STATEMENTS.declared["kept"]["claim"]
"""Claim that the signals of the mines remain."""
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
    boxes = strongest_boxes(lanes)
    return [
        *paper_findings(lanes, recipe),
        _mines_alone_finding(lanes, recipe),
        *_power_findings(lanes, boxes, recipe),
        *[_rival_finding(variant, lanes, recipe) for variant in _RIVALS],
        *[_track_finding(lane, recipe) for lane in lanes],
        *[_pose_finding(variant, loose, boxes, recipe) for variant in ("iteration", "shared")],
    ]


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
        findings += _band_findings(lanes, recipe)
        findings += _ratio_findings(lanes, strongest_boxes(lanes), recipe)
    findings += _mine_findings(lanes, recipe)
    for lane in lanes:
        for convention, words in CONVENTIONS.items():
            comparison = compared(lane, "iteration", "original", recipe, convention)
            finding = STATEMENTS.number(
                "roc",
                (comparison.difference, comparison.low, comparison.high),
                lane=lane.name,
                convention=words,
                c=comparison,
                score=recipe.score,
                counted="looks" if convention == "frames" else "mines",
            )
            findings.append(finding)
    return findings


def clutter_findings(boxes: pd.DataFrame, recipe: FuseRecipe) -> list[Finding]:
    """Judge what Sec. 3.2 says of the clutter power, in all iterations and combinations.

    Parameters
    ----------
    boxes : DataFrame
        As `flgpr_papers.fuse2018.findings.strongest_boxes` returns it.
    recipe : FuseRecipe
        The study.
    """
    sixth = power_db(boxes, "iteration 6")
    seventh = power_db(boxes, "iteration 7")
    averaged = power_db(boxes, "#6")
    gain = (sixth + seventh) / 2 - averaged
    findings = []
    for name, values, figure in (
        ("fall", -averaged, PAPER_DB),
        ("by-mean", gain, PAPER_MEAN_DB),
        ("by-mean-last", seventh - averaged, PAPER_MEAN_DB),
    ):
        spread = frame_spread(boxes, values)
        finding = STATEMENTS.number(
            name,
            mean_over_boxes(boxes, values, recipe),
            figure=(figure, figure - spread, figure + spread),
            count=len(boxes),
            spread=spread,
        )
        findings.append(finding)
    less = power_db(boxes, "iteration 1") - seventh
    counts: Entries = {"count": len(boxes), "objects": boxes["cluster"].nunique()}
    others = [f"#{number}" for number in TABLE_II if number != 6]
    gaps = {}
    for name in others:
        more = power_db(boxes, name) - power_db(boxes, "#6")
        level = together(len(others))
        gaps[f"{name} less #6"] = mean_over_boxes(boxes, more, recipe, level)
    return [
        *findings,
        STATEMENTS.number("averaging", mean_over_boxes(boxes, gain, recipe), **counts),
        STATEMENTS.number("iterations", mean_over_boxes(boxes, less, recipe)),
        STATEMENTS.larger("combination", gaps),
    ]


def _band_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge what the masks rest on.

    It is how the bands tell buried targets from clutter, and what the fundamental part covers.
    """
    table = pooled(lanes, "bands", "name")
    clutter, mines = [table[table["what"] == what] for what in ("clutter", "mine")]
    findings = []
    for band, title in (("vh", "L band VH"), ("x", "X band")):
        if band in table and not table[band].isna().all():
            gap = difference_of_means(
                mean_over_boxes(clutter, 20 * np.log10(clutter[band]), recipe),
                mean_over_boxes(mines, 20 * np.log10(mines[band]), recipe),
            )
            finding = STATEMENTS.number(
                "weak", gap, title=title, clutter=len(clutter), mines=len(mines)
            )
            findings.append(finding)
    covered = mean_over_boxes(clutter, clutter["held"], recipe)
    return [*findings, STATEMENTS.number("covers-clutter", covered)]


def _ratio_findings(
    lanes: Sequence[LaneResult], boxes: pd.DataFrame, recipe: FuseRecipe
) -> list[Finding]:
    """Judge the gain of signal to clutter, and that clutter falls below the mines' power."""
    draws = recipe.boxes.draws
    signal = clustered(*own_changes(lanes, "iteration"), draws)
    clutter = mean_over_boxes(boxes, power_db(boxes, "#6"), recipe)
    over = {}
    for variant in ("original", "iteration"):
        mines = clustered(*mine_powers(lanes, variant), draws)
        power = mean_over_boxes(boxes, 10 * np.log10(boxes[variant].to_numpy()), recipe)
        over[variant] = difference_of_means(mines, power)
    return [
        STATEMENTS.number("signal-to-clutter", difference_of_means(signal, clutter)),
        STATEMENTS.number(
            "below-targets", over["iteration"], before=with_interval(over["original"])
        ),
    ]


def _mine_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge that the signals of the mines remain, and that the mask does not cover them."""
    draws = recipe.boxes.draws
    changes, targets = own_changes(lanes, "iteration")
    halo = clustered(*mine_changes(lanes, "iteration"), draws)
    kept = STATEMENTS.number(
        "kept",
        clustered(changes, targets, draws),
        looks=len(changes),
        mines=targets.nunique(),
        halo=with_interval(halo),
    )
    looks = pooled(lanes, "mines")
    looks = looks[looks["variant"] == "original"]
    masked = clustered(looks["masked"], looks["cluster"], draws)
    return [kept, STATEMENTS.number("spares-targets", masked, looks=len(looks))]


def _mines_alone_finding(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Finding:
    """Return how what a mine alone gives at its peak changes by variant."""
    changes = {
        variant: clustered(*own_changes(lanes, variant), recipe.boxes.draws)
        for variant in _FOLLOWED
    }
    texts = [f"{variant} {with_interval(change)}" for variant, change in changes.items()]
    return STATEMENTS.number("alone", changes["least squares"], changes="; ".join(texts))


def _power_findings(
    lanes: Sequence[LaneResult], boxes: pd.DataFrame, recipe: FuseRecipe
) -> list[Finding]:
    """Return by how much a variant leaves less clutter than another.

    Among them is what falling back gives where the iteration diverged, and in how many apertures
    it did.
    """
    courses = pd.concat([lane.courses[lane.courses["variant"] == "iteration"] for lane in lanes])
    counts: Entries = dict((courses[["rises", "diverged", "fallen"]] > 0).sum())
    findings = []
    for name, question in STATEMENTS.declared.items():
        if "better" in question:
            better = question["better"]
            gap = power_db(boxes, question["worse"]) - power_db(boxes, better)
            peaks = clustered(*mine_changes(lanes, better), recipe.boxes.draws)
            finding = STATEMENTS.number(
                name,
                mean_over_boxes(boxes, gap, recipe),
                peaks=with_interval(peaks),
                apertures=len(courses),
                rise=100 * courses["rise"].max(),
                **counts,
            )
            findings.append(finding)
    return findings


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
    lowest = min(gaps, key=lambda gap: gap[1])
    return STATEMENTS.number(
        "rival", lowest, variant=variant, gaps="; ".join(texts), means="; ".join(means)
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
    interval = (comparison.difference, comparison.low, comparison.high)
    return STATEMENTS.number("followed", interval, c=comparison, hits=HITS, lane=lane.name)


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
    return STATEMENTS.number(
        "loose",
        mean_over_boxes(both, loss, recipe),
        centimetres=100 * recipe.study.loose_position,
        variant=variant,
        boxes=len(both),
        lane=loose.name,
    )
