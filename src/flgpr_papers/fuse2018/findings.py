"""What Fuse et al. 2018 found, and whether simulated lanes show it too.

The paper's figures in dB are those of two named boxes of one frame. They are compared with the
named boxes of our frames, whose spread from frame to frame is the error of the paper's one frame,
too; they are alike within 6 dB. Mines are kept if the interval of the mean change of what they
alone give at their peaks lies within 1 dB.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from flgpr.clutter import TABLE_II
from flgpr.scoring import Comparison, Match, accumulated_area, compare, match, roc_of, unroll_frames
from flgpr.screen import prescreen
from flgpr.screen.views import view_array
from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.results import LaneResult
from flgpr_papers.kit.findings import (
    OPEN,
    SHARE,
    SHARE_DIFFERENCE,
    Finding,
    Interval,
    alike,
    clip,
    clustered,
    difference_of_means,
    in_words,
    judge,
    larger,
    parts_larger,
    together,
)

CONVENTIONS = {
    "frames": "area accumulated over all frames (Sec. 4)",
    "lane": "lane area, every place once",
}
PAPER_DB = 26.5
PAPER_MEAN_DB = 5.03
"""What the paper's clutter falls by with #6, and how much of it averaging gives, dB (Sec. 3.2)."""
FALL = f"combination #6 lowers the clutter power by {PAPER_DB:g} dB"
BY_MEAN = f"averaging alone gives about {PAPER_MEAN_DB:g} dB of it"
KEPT = "the targets' signals remain"
COVERS = "the mask does not cover targets"
FloatArray = NDArray[np.float64]
_BLOCK = 100.0  # m of the unrolled lane: ten frames
_HITS = 2
_OWN = ("iteration", "least squares", "least squares spared")
_RIVALS = (
    "shared",
    "whole response",
    "calibrated roadside",
    "least squares",
    "least squares spared",
    "least squares per frame",
    "L band alone",
)
# dB
_KEPT = 1.0
_ALIKE = 6.0
_MORE = ("larger", 0.0, 0.0)


def peaks_kept(low: float, high: float) -> str:
    """Judge whether mine peaks are kept by the interval of their mean change, dB."""
    return judge(low, high, (-_KEPT, _KEPT))


def strongest_boxes(lanes: Sequence[LaneResult]) -> pd.DataFrame:
    """Take the strongest clutter box left and right of every frame, a row each.

    ``cluster`` is the object.
    """
    tables = []
    for lane in lanes:
        if lane.boxes.empty:
            continue
        wide = lane.boxes.pivot_table(
            index=["frame", "side", "object"], columns="stage", values="power"
        ).reset_index()
        best = wide.loc[wide.groupby(["frame", "side"])["#0"].idxmax()]
        tables.append(best.assign(lane=lane.name, cluster=lane.name + best["object"].astype(str)))
    return pd.concat(tables, ignore_index=True)


def power_db(boxes: pd.DataFrame, stage: str) -> FloatArray:
    """Power in boxes under a stage over that of the original image, dB."""
    return np.asarray(10 * np.log10(boxes[stage].to_numpy() / boxes["#0"].to_numpy()))


def mine_changes(lanes: Sequence[LaneResult], variant: str) -> tuple[FloatArray, pd.Series]:
    """Change of every look's peak in a mine's halo, dB, and the mine each belongs to."""
    changes = []
    cluster = []
    for lane in lanes:
        wide = lane.mines.pivot_table(
            index=["frame", "target"], columns="variant", values="peak"
        ).reset_index()
        changes.append(20 * np.log10(wide[variant].to_numpy() / wide["original"].to_numpy()))
        cluster.append(lane.name + wide["target"].astype(str))
    return np.concatenate(changes), pd.concat(cluster, ignore_index=True)


def frame_match(lane: LaneResult, variant: str, recipe: FuseRecipe) -> Match:
    """Match a variant's alarms frame by frame.

    Every frame's detection area gets a place of its own on an unrolled lane, so that the same
    ground counts again in every frame, as in the paper, and neighbouring frames, which see the same
    clutter, stay together when stretches of lane are resampled.

    Alarms and looks; column ``mine`` of the truth names the mine, ``inside`` the looks in the
    detection area.
    """
    score = recipe.score
    used = np.flatnonzero(np.isfinite(lane.poses[:, 0]))
    alarms = lane.alarms[lane.alarms["variant"] == variant].rename(
        columns={"magnitude": "confidence"}
    )
    poses = {int(frame): lane.poses[frame] for frame in used}
    frames = unroll_frames(
        alarms[["frame", "across", "ahead", "confidence"]],
        poses,
        lane.truth,
        recipe.area,
        score.halo / 2,
    )
    return match(frames.alarms, frames.looks, frames.lane, score.halo, halo_as="diameter")


def lane_match(lane: LaneResult, variant: str, recipe: FuseRecipe) -> Match:
    """Match a variant's alarms on the lane's map, every place once."""
    level = lane.maps[variant]
    area = recipe.lane
    view = view_array(level, np.isfinite(level).astype(np.int64), recipe.map_grid, {})
    peaks = prescreen(view, area, recipe.score.radius, density=10.0)
    peaks = peaks[area.contains(peaks["x"], peaks["y"])].assign(confidence=lambda t: t["magnitude"])
    truth = lane.truth.assign(mine=lane.truth["target_id"], inside=True)
    return match(peaks, truth, area, recipe.score.halo, halo_as="diameter")


def track_match(lane: LaneResult, variant: str, recipe: FuseRecipe) -> Match:
    """Match a variant's alarms, followed over frames, every place once."""
    alarms = lane.alarms[lane.alarms["variant"] == variant]
    tracks = follow(alarms, recipe.score.halo / 2, _HITS)
    tracks_in_lane = tracks[recipe.lane.contains(tracks["x"], tracks["y"])]
    truth = lane.truth.assign(mine=lane.truth["target_id"], inside=True)
    return match(tracks_in_lane, truth, recipe.lane, recipe.score.halo, halo_as="diameter")


def scored(
    lane: LaneResult, variant: str, recipe: FuseRecipe, convention: str
) -> tuple[Match, pd.DataFrame, dict[str, object]]:
    """Score a variant on a lane by a FAR convention.

    Gives the ROC, too, and what a comparison needs besides.
    """
    if convention == "frames":
        matched = frame_match(lane, variant, recipe)
        total = accumulated_area(lane.frames, recipe.score.x, recipe.score.y)
        options: dict[str, object] = {
            "area": "frames",
            "frame_area": total,
            "block": _BLOCK,
            "cluster": "mine",
        }
    else:
        matched = lane_match(lane, variant, recipe)
        options = {"area": "union", "block": 10.0, "cluster": "mine"}
    area = {name: options[name] for name in ("area", "frame_area") if name in options}
    inside = matched.truth["inside"].to_numpy(dtype=bool)
    return matched, roc_of(matched, inside, shared="count", **area), options  # type: ignore[arg-type]


def compared(
    lane: LaneResult, first: str, second: str, recipe: FuseRecipe, convention: str
) -> Comparison:
    """Compare two variants on a lane by a FAR convention."""
    (a, _, options), (b, _, _) = (
        scored(lane, name, recipe, convention) for name in (first, second)
    )
    inside = a.truth["inside"].to_numpy(dtype=bool)
    return compare(
        a,
        b,
        inside,
        far_max=recipe.score.far_max,
        far=recipe.score.far,
        draws=recipe.boxes.draws,
        **options,  # type: ignore[arg-type]
    )


def all_findings(
    lanes: Sequence[LaneResult], loose: LaneResult, recipe: FuseRecipe
) -> list[Finding]:
    """Judge everything, the paper's statements first, then our own questions."""
    boxes = strongest_boxes(lanes)
    return [*paper_findings(lanes, recipe), *_own_findings(lanes, loose, boxes, recipe)]


def paper_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge the paper's statements; those on roadside clutter only where there is some."""
    boxes = []
    if any(len(lane.boxes) for lane in lanes):
        boxes = [*clutter_findings(strongest_boxes(lanes), recipe), *band_findings(lanes, recipe)]
    return [*boxes, *_mine_findings(lanes, recipe), *_roc_findings(lanes, recipe)]


def _in_words(interval: Interval, unit: str = " dB", digits: int = 1) -> str:
    """Return an interval in words."""
    value, low, high = (f"{number:z.{digits}f}" for number in interval)
    return f"{value}{unit} ({low} to {high})"


def _gap(boxes: pd.DataFrame, values: FloatArray, recipe: FuseRecipe) -> Interval:
    """Return the mean of values over boxes with its interval over clusters."""
    return clustered(values, boxes["cluster"], recipe.boxes.draws)


def one_frame(boxes: pd.DataFrame, values: FloatArray, figure: float) -> Interval:
    """Return our frames' named boxes less those of the one frame that the paper shows.

    Left and right are taken together.
    """
    pairs = _pairs(boxes, values)
    if len(pairs) < 2:
        return np.nan, -np.inf, np.inf
    gap = float(pairs.mean()) - figure
    half = float(stdtrit(len(pairs) - 1, 0.975) * pairs.std() * np.sqrt(1 + 1 / len(pairs)))
    return gap, gap - half, gap + half


def frame_error(boxes: pd.DataFrame, values: FloatArray) -> float:
    """Bound the standard error of a figure of one frame by the deviation of ours.

    0 where there are not two.
    """
    pairs = _pairs(boxes, values)
    return float(pairs.std()) if len(pairs) > 1 else 0.0


def _pairs(boxes: pd.DataFrame, values: FloatArray) -> pd.Series:
    """Mean of a frame's two named boxes, where it has two."""
    frames = boxes.assign(value=values).groupby(["lane", "frame"])["value"].agg(["mean", "count"])
    return frames.loc[frames["count"] == 2, "mean"]


def _figure_finding(
    claim: str, boxes: pd.DataFrame, values: FloatArray, figure: float, recipe: FuseRecipe
) -> Finding:
    """Judge a figure of the paper by the boxes of one frame."""
    gap = one_frame(boxes, values, figure)
    every = _gap(boxes, values, recipe)
    ours = f"two boxes of a frame {_in_words((gap[0] + figure, gap[1] + figure, gap[2] + figure))}"
    note = f"interval of one frame; mean over all {len(boxes)} boxes {_in_words(every)}"
    asks = ("alike", _ALIKE, frame_error(boxes, values))
    return Finding(
        claim,
        f"{figure:g} dB",
        ours,
        alike(*gap[1:], _ALIKE),
        note,
        interval=gap,
        asks=asks,
        unit="dB",
    )


def clutter_findings(boxes: pd.DataFrame, recipe: FuseRecipe) -> list[Finding]:
    """Judge what Sec. 3.2 says of the clutter power, by named boxes.

    All iterations and combinations are judged.
    """
    single = (power_db(boxes, "iteration 6") + power_db(boxes, "iteration 7")) / 2
    gain = single - power_db(boxes, "#6")
    steps = _gap(boxes, power_db(boxes, "iteration 1") - power_db(boxes, "iteration 7"), recipe)
    other_combinations = [f"#{number}" for number in TABLE_II if number != 6]
    better = {
        f"{name} less #6": _over_six(boxes, name, together(len(other_combinations)), recipe)
        for name in other_combinations
    }
    mean = _gap(boxes, gain, recipe)
    size = f"{len(boxes)} boxes of {boxes['cluster'].nunique()} objects"
    return [
        _figure_finding(FALL, boxes, -power_db(boxes, "#6"), PAPER_DB, recipe),
        _figure_finding(BY_MEAN, boxes, gain, PAPER_MEAN_DB, recipe),
        Finding(
            "averaging lowers the clutter",
            "cancelled out by taking the average (Sec. 3.2)",
            _in_words(mean),
            larger(*mean[1:]),
            size,
            interval=mean,
            asks=_MORE,
            unit="dB",
        ),
        Finding(
            "more iterations leave less clutter",
            "power falls with the iteration (Fig. 8)",
            _in_words(steps),
            larger(*steps[1:]),
            "iteration 7 against iteration 1, without averaging",
            interval=steps,
            asks=_MORE,
            unit="dB",
        ),
        parts_larger(
            "#6 is the best combination",
            "produces the best pattern (Sec. 3.2)",
            better,
            note="dB, #6 against each of #0 to #5, by intervals that hold together",
        ),
    ]


def _over_six(boxes: pd.DataFrame, stage: str, level: float, recipe: FuseRecipe) -> Interval:
    """Clutter power under a combination over that under #6, dB."""
    more = power_db(boxes, stage) - power_db(boxes, "#6")
    return clustered(more, boxes["cluster"], recipe.boxes.draws, level=level)


def band_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge what the masks rest on.

    What tells buried targets from clutter, and what the fundamental part holds.
    """
    table = pd.concat([lane.bands.assign(lane=lane.name) for lane in lanes])
    table["cluster"] = table["lane"] + table["name"].astype(str)
    mines = table[table["what"] == "mine"]
    clutter = table[table["what"] == "clutter"]
    findings = []
    for band, band_title in (("vh", "L band VH"), ("x", "X band")):
        if band not in table or table[band].isna().all():
            continue
        levels = [
            clustered(20 * np.log10(lane[band]), lane["cluster"], recipe.boxes.draws)
            for lane in (clutter, mines)
        ]
        gap = difference_of_means(*levels)
        findings.append(
            Finding(
                f"the {band_title} response of buried targets is weak",
                "weak, that of above-ground objects strong (Sec. 1)",
                _in_words(gap),
                larger(*gap[1:]),
                f"peak over the median at its distance, roadside objects less mines; "
                f"{len(clutter)} and {len(mines)} looks",
                interval=gap,
                asks=_MORE,
                unit="dB",
            )
        )
    share = clustered(clutter["held"], clutter["cluster"], recipe.boxes.draws)
    findings.append(
        Finding(
            "the fundamental mask covers most of the clutter",
            "able to cover the most part of the region (Sec. 2.4)",
            _in_words(share, "", 2),
            larger(*share[1:], 0.5),
            "share of the VV power in the boxes of roadside objects",
            interval=share,
            asks=("larger", 0.5, 0.0),
            bounds=SHARE,
        )
    )
    return findings


def own_changes(lanes: Sequence[LaneResult], variant: str) -> tuple[FloatArray, pd.Series]:
    """Return the change of every mine's own peak, dB, look by look, and the mine's name."""
    rows = pd.concat(
        [lane.own[lane.own["variant"] == variant].assign(lane=lane.name) for lane in lanes]
    )
    return rows["change_db"].to_numpy(dtype=np.float64), rows["lane"] + rows["target"].astype(str)


def _mine_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge what the paper says of the mines' peaks."""
    changes, targets = own_changes(lanes, "iteration")
    mean = clustered(changes, targets, recipe.boxes.draws)
    peaks, cluster = mine_changes(lanes, "iteration")
    halo = clustered(peaks, cluster, recipe.boxes.draws)
    looks = pd.concat(
        [lane.mines[lane.mines["variant"] == "original"].assign(lane=lane.name) for lane in lanes]
    )
    share = clustered(
        looks["masked"], looks["lane"] + looks["target"].astype(str), recipe.boxes.draws
    )
    count = f"{len(changes)} looks at {targets.nunique()} mines"
    return [
        Finding(
            KEPT,
            "target signals still remain (Sec. 3.2)",
            _in_words(mean),
            peaks_kept(*mean[1:]),
            f"change of what a mine alone gives at its peak, mask and amplitudes held fixed, "
            f"{count}; within 1 dB "
            f"agrees. The largest pixel of its halo, clutter included, changes by "
            f"{_in_words(halo)}",
            interval=mean,
            rule=(-_KEPT, _KEPT),
            unit="dB",
        ),
        Finding(
            COVERS,
            "covers just the clutter area (Sec. 3.1)",
            _in_words(share, "", 3),
            judge(*share[1:], (0.0, 0.05)),
            f"share of {len(peaks)} looks whose peak is masked; up to 5 % agrees",
            interval=share,
            rule=(0.0, 0.05),
            bounds=SHARE,
        ),
    ]


def _roc_findings(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> list[Finding]:
    """Judge what the paper says of the ROC, by both conventions of FAR."""
    findings = []
    for lane in lanes:
        for convention, convention_title in CONVENTIONS.items():
            comparison = compared(lane, "iteration", "original", recipe, convention)
            findings.append(
                Finding(
                    f"ROC better with suppression, lane {lane.name}, {convention_title}",
                    "significantly improved (Fig. 9)",
                    f"PD_mean {comparison.pd_mean_b:.2f} to {comparison.pd_mean_a:.2f}, by "
                    f"{comparison.difference:+.2f} "
                    f"({comparison.low:+.2f} to {comparison.high:+.2f})",
                    larger(comparison.low, comparison.high),
                    interval=(comparison.difference, comparison.low, comparison.high),
                    asks=_MORE,
                    bounds=SHARE_DIFFERENCE,
                    note=f"Pd averaged over FAR up to {recipe.score.far_max:g} per m², "
                    f"{comparison.n_targets} "
                    f"{'looks' if convention == 'frames' else 'mines'}; at {comparison.far:g} per "
                    f"m² {comparison.only_a} mines are "
                    f"found more often with it, {comparison.only_b} without",
                )
            )
    return findings


def _own_findings(
    lanes: Sequence[LaneResult], loose: LaneResult, boxes: pd.DataFrame, recipe: FuseRecipe
) -> list[Finding]:
    """Judge our own questions about the variants."""

    def against(claim: str, better: str, worse: str) -> list[Finding]:
        gap = _gap(boxes, power_db(boxes, worse) - power_db(boxes, better), recipe)
        change, cluster = mine_changes(lanes, better)
        peaks = clustered(change, cluster, recipe.boxes.draws)
        text = f"mine peaks change by {_in_words(peaks)}."
        return [Finding(claim, "not tried", _in_words(gap), OPEN, text, interval=gap)]

    lost = {name: clustered(*own_changes(lanes, name), recipe.boxes.draws) for name in _OWN}
    words = "; ".join(f"{name} {_in_words(interval)}" for name, interval in lost.items())
    findings = [
        Finding(
            "what a mine alone gives at its peak",
            "not tried",
            words,
            OPEN,
            interval=lost["least squares"],
        )
    ]
    findings += against(
        "least squares removes more clutter than the iteration with one reflectivity at equal cost",
        "least squares",
        "shared",
    )
    findings += against(
        "the road fitted too and not subtracted", "least squares spared", "least squares"
    )
    findings += against(
        "one reflectivity for all frames removes more than one per frame", "shared", "iteration"
    )
    findings += against(
        "B of the whole response removes more than B of each sub-region's own",
        "whole response",
        "iteration",
    )
    findings += against(
        "the roadside's level of the calibration lane removes more than that of the frame itself",
        "calibrated roadside",
        "iteration",
    )
    findings += [_fall_back_finding(lanes, boxes, recipe)]
    findings += against(
        "with a reflectivity per frame, least squares removes more than the iteration",
        "least squares per frame",
        "iteration",
    )
    findings += against(
        "masks by connected region remove more clutter than by pixel", "regions", "iteration"
    )
    findings += against(
        "the X band removes clutter that VV and VH alone leave", "iteration", "L band alone"
    )
    findings += [_rival_finding(name, lanes, recipe) for name in _RIVALS]
    for lane in lanes:
        cleaned = lane_match(lane, "iteration", recipe)
        tracks = track_match(lane, "iteration", recipe)
        interval = compare(
            tracks,
            cleaned,
            far_max=recipe.score.far_max,
            far=recipe.score.far,
            draws=recipe.boxes.draws,
        )
        findings.append(
            Finding(
                f"ROC better with alarms followed over {_HITS} frames than on the map of means, "
                f"lane {lane.name}",
                "false alarms significantly reduced (the sequel's abstract)",
                f"{interval.difference:+.3f} ({interval.low:+.3f} to {interval.high:+.3f})",
                OPEN,
                f"PD_mean {interval.pd_mean_a:.2f} against {interval.pd_mean_b:.2f}, chance "
                f"{interval.chance_a:.2f} and "
                f"{interval.chance_b:.2f}; lane area",
                interval=(interval.difference, interval.low, interval.high),
            )
        )
    wrong = strongest_boxes([loose])
    for name in ("iteration", "shared"):
        close = boxes.merge(
            wrong[["cluster", "frame", name, "#0"]],
            on=["cluster", "frame"],
            suffixes=("", " loose"),
        )
        worse = power_db(close.assign(**{"#0": close["#0 loose"]}), f"{name} loose") - power_db(
            close, name
        )
        gap = clustered(worse, close["cluster"], recipe.boxes.draws)
        findings.append(
            Finding(
                f"poses wrong by {100 * recipe.study.loose_position:g} cm cost suppression "
                f"({name})",
                "not tried",
                _in_words(gap),
                OPEN,
                f"{len(close)} boxes of lane {loose.name}",
                interval=gap,
            )
        )
    return findings


def _rival_finding(name: str, lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Finding:
    """Compare the ROC of a variant with that of the iteration, lane by lane.

    Every frame counts its area.
    """
    comparisons = {lane.name: compared(lane, name, "iteration", recipe, "frames") for lane in lanes}
    gaps = {
        lane: (comparison.difference, comparison.low, comparison.high)
        for lane, comparison in comparisons.items()
    }
    ours = "; ".join(
        f"lane {lane} {in_words(*clip(gap, SHARE_DIFFERENCE))}" for lane, gap in gaps.items()
    )
    means = "; ".join(
        f"lane {lane} {comparison.pd_mean_a:.2f} against {comparison.pd_mean_b:.2f}"
        for lane, comparison in comparisons.items()
    )
    least = min(gaps.values(), key=lambda gap: gap[1])
    claim = f"ROC better with {name} than with the iteration in each frame (frames)"
    return Finding(
        claim, "not tried", ours, OPEN, f"PD_mean {means}", interval=least, bounds=SHARE_DIFFERENCE
    )


def _fall_back_finding(
    lanes: Sequence[LaneResult], boxes: pd.DataFrame, recipe: FuseRecipe
) -> Finding:
    """Return where the iteration diverged, and what falling back to its best does."""
    courses = pd.concat([lane.courses[lane.courses["variant"] == "iteration"] for lane in lanes])
    gap = _gap(boxes, power_db(boxes, "as printed") - power_db(boxes, "iteration"), recipe)
    counts = {name: int((courses[name] > 0).sum()) for name in ("rises", "diverged", "fallen")}
    note = (
        f"of {len(courses)} apertures the residual rose for an iteration in {counts['rises']}, by "
        f"up to "
        f"{100 * courses['rise'].max():.2g} %; the last was worse than another in "
        f"{counts['diverged']}, and their "
        f"average, too, in {counts['fallen']}"
    )
    claim = "falling back to the best iteration where a course diverged removes more"
    return Finding(
        claim,
        "always averages iterations 6 and 7",
        _in_words(gap),
        OPEN,
        note,
        interval=gap,
        unit="dB",
    )


def follow(alarms: pd.DataFrame, gate: float, hits: int) -> pd.DataFrame:
    """Join the alarms of frames into tracks that stand still in the lane frame.

    Frame by frame each alarm, strongest first, continues the nearest track within the gate that has
    none of this frame yet, or begins one; a track stands at the mean of its alarms, weighed by
    magnitude. Its confidence is the ``hits``-th largest of its magnitudes: at a threshold are
    declared the tracks of which so many frames exceed it.

    ``alarms`` has frame, x, y (m, lane frame) and magnitude; ``gate`` is in m. The table has x, y,
    confidence and frames; tracks of fewer frames than ``hits`` are left out.
    """
    tracks: list[list[NDArray[np.float64]]] = []
    for _, frame in alarms.sort_values("magnitude", ascending=False, kind="stable").groupby(
        "frame", sort=True
    ):
        old = np.array([_place(track) for track in tracks]).reshape(-1, 2)
        free = np.ones(len(old), dtype=bool)
        for alarm in frame[["x", "y", "magnitude"]].to_numpy(dtype=np.float64):
            distance = np.where(free, np.hypot(*(old - alarm[:2]).T), np.inf)
            if distance.size and distance.min() <= gate:
                nearest = int(distance.argmin())
                tracks[nearest].append(alarm)
                free[nearest] = False
            else:
                tracks.append([alarm])
    long_tracks = [track for track in tracks if len(track) >= hits]
    rows = []
    for track in long_tracks:
        magnitudes = [magnitude for *_, magnitude in track]
        rows.append((*_place(track), np.sort(magnitudes)[-hits], len(track)))
    return pd.DataFrame(rows, columns=["x", "y", "confidence", "frames"])


def _place(track: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the position of a track, weighed by the magnitudes of its alarms."""
    points = np.array(track)
    return np.asarray(np.average(points[:, :2], axis=0, weights=points[:, 2]))
