"""Scoring frame by frame (Fuse et al. 2018).

Every frame counts its detection area, the same ground again in each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from flgpr.model import Lane, ground_points, lane_to_scan
from flgpr.scoring.lane_roc import accumulated_area
from flgpr.scoring.lane_score import Rules, Score, score
from flgpr.types import ArrayLike, BoolArray, floats

GAP = 5.0
"""Ground between frames on the unrolled lane, m: no halo bridges it."""
_FRAMES_PER_BLOCK = 10  # drawn together in the bootstrap: neighbours see the same clutter


@dataclass(frozen=True)
class UnrolledFrames:
    """Frames one behind the other on a lane of their own, where the rules for lanes count each."""

    alarms: pd.DataFrame  #: x, y (m, unrolled), confidence; ``frame`` and the rest as given
    #: one row for every frame that sees a target: the truth's columns, ``target_id`` with the
    #: frame's number, ``mine`` the target's own, ``inside`` whether it lies in the detection area
    looks: pd.DataFrame
    lane: Lane  #: the unrolled lane
    slot: float  #: length that a frame has of it, m
    frames: int  #: number of frames


def unroll_frames(
    alarms: pd.DataFrame,
    poses: Mapping[int, ArrayLike],
    truth: pd.DataFrame,
    area: Lane,
    halo: float,
) -> UnrolledFrames:
    """Lay the detection areas of all frames one behind the other on an unrolled lane.

    Parameters
    ----------
    alarms : DataFrame
        Alarms with ``frame``, ``across``, ``ahead`` (m, scan frame) and ``confidence``.
    poses : mapping of int to (6,) array_like
        Pose of every frame that was searched, by its number.
    truth : DataFrame
        Truth table, lane frame.
    area : Lane
        Detection area of a frame, in its scan frame (Sec. 4: -7 to 7 m, 5 to 10 m ahead).
    halo : float
        Radius of the halo, m, at most half of ``GAP``: targets so far outside the area are kept,
        since an alarm beside one of them is not false.

    Returns
    -------
    UnrolledFrames
        Alarms and looks at targets on the unrolled lane.

    Raises
    ------
    ValueError
        If the halo is too large, no frame was searched, or an alarm belongs to a frame that was
        not.
    """
    if not 0 < halo <= GAP / 2:
        raise ValueError(
            f"halo must be positive and at most {GAP / 2:g} m to be scored by frames, got {halo:g}"
        )
    if not poses:
        raise ValueError("poses must hold at least one frame that was searched, got none")
    unknown = sorted(set(alarms["frame"]) - set(poses))
    if unknown:
        raise ValueError(
            f"frame must be one of those that were searched, got alarms of {unknown[:4]}"
        )

    slot = area.y_max - area.y_min + GAP
    start = {frame: number * slot - area.y_min for number, frame in enumerate(sorted(poses))}
    offset = floats(alarms["frame"].map(start))
    unrolled = alarms.assign(x=alarms["across"], y=floats(alarms["ahead"]) + offset)

    in_reach = Lane(area.x_min - halo, area.x_max + halo, area.y_min - halo, area.y_max + halo)
    points = ground_points(truth)
    looks = []
    for frame in sorted(poses):
        across, ahead = lane_to_scan(points, floats(poses[frame]))[:, :2].T
        table = truth.assign(
            x=across,
            y=ahead + start[frame],
            inside=area.contains(across, ahead),
            mine=truth["target_id"],
            target_id=truth["target_id"].astype(str) + f"-{frame}",
        )
        looks.append(table[in_reach.contains(across, ahead)])
    all_looks = pd.concat(looks, ignore_index=True)
    unrolled_lane = Lane(area.x_min, area.x_max, 0.0, slot * len(poses))
    return UnrolledFrames(unrolled, all_looks, unrolled_lane, slot, len(poses))


def score_frames(
    alarms: pd.DataFrame,
    poses: Mapping[int, ArrayLike],
    truth: pd.DataFrame,
    area: Lane,
    rules: Rules | None = None,
    *,
    name: str = "main",
    title: str = "",
) -> Score:
    """Score alarms that were raised frame by frame, every frame counting its area.

    It is the score of Fuse et al. 2018, Sec. 4, Fig. 9. A target counts once in every frame whose
    detection area holds it. An alarm in the halo of a target outside the area is neither detection
    nor false. In the bootstrap all looks at a target are drawn together, and so are the false
    alarms of ten frames. The exact intervals take looks as independent, which they are not.

    Parameters
    ----------
    alarms, poses, truth, area
        As for :func:`unroll_frames`.
    rules : Rules, optional
        Scoring rules, whose halo is that of ``unroll_frames``.
    name, title : str
        What the list is called, for a machine and in words.

    Returns
    -------
    Score
        The score, as of :func:`flgpr.scoring.score`.

    Raises
    ------
    ValueError
        If a table, a frame or a rule is not valid.

    Examples
    --------
    A vehicle sees one mine in two frames, and finds it in the second; the first has a false alarm.

    >>> import pandas as pd
    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import Rules, score_frames
    >>> poses = {0: [0, 0, 3, 0, 0, 0], 1: [0, 2, 3, 0, 0, 0]}
    >>> alarms = pd.DataFrame({"frame": [0, 1], "across": [-4.0, 1.1], "ahead": [7.0, 6.0]})
    >>> alarms = alarms.assign(confidence=[2.0, 3.0])
    >>> truth = pd.DataFrame({"target_id": ["a"], "x": [1.0], "y": [8.0], "kind": "metal"})
    >>> area = Lane(-7.0, 7.0, 5.0, 10.0)
    >>> rules = Rules(halo=0.5, draws=100)
    >>> scored = score_frames(alarms, poses, truth.assign(depth=0.05), area, rules)
    >>> scored.curve[["n_detected", "n_targets", "n_false", "area"]].iloc[-1].tolist()
    [1.0, 2.0, 1.0, 140.0]
    """
    rules = rules or Rules()
    radius = rules.halo / 2 if rules.halo_as == "diameter" else rules.halo
    unrolled = unroll_frames(alarms, poses, truth, area, radius)
    inside = unrolled.looks["inside"].to_numpy(dtype=bool)
    near_outside = _is_within(unrolled.alarms, unrolled.looks[~inside], radius)
    near_inside = _is_within(unrolled.alarms, unrolled.looks[inside], radius)
    is_ignored = near_outside & ~near_inside
    total = accumulated_area(unrolled.frames, (area.x_min, area.x_max), (area.y_min, area.y_max))
    by_frames = replace(
        rules,
        area="frames",
        frame_area=total,
        block=_FRAMES_PER_BLOCK * unrolled.slot,
        cluster="mine",
    )
    counted = unrolled.alarms[~is_ignored].reset_index(drop=True)
    looks = unrolled.looks[inside].drop(columns="inside").reset_index(drop=True)
    return score(counted, looks, unrolled.lane, by_frames, name=name, title=title)


def _is_within(alarms: pd.DataFrame, looks: pd.DataFrame, radius: float) -> BoolArray:
    """Return whether each alarm lies in the halo of one of the looks."""
    x = floats(alarms[["x"]]) - looks["x"].to_numpy()
    y = floats(alarms[["y"]]) - looks["y"].to_numpy()
    return np.asarray((np.hypot(x, y) <= radius).any(axis=1))
