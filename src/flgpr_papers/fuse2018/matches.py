"""Alarms of the lanes of Fuse et al. 2018 matched to mines, by two conventions of the area of FAR.

The paper accumulates the detection area of all frames, so that the same ground counts again in
every frame (Sec. 4). The other convention counts every position of the lane once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from flgpr.scoring import Comparison, Match, accumulated_area, compare, match, roc_of, unroll_frames
from flgpr.screen import prescreen
from flgpr.screen.views import view_array
from flgpr.types import FloatArray, floats
from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.process import LaneResult

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
