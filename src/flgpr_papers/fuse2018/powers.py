"""Power in clutter boxes and at mines on the lanes of Fuse et al. 2018, with intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.process import LaneResult
from flgpr_papers.kit.intervals import Interval, clustered

FloatArray = NDArray[np.float64]


def strongest_boxes(lanes: Sequence[LaneResult]) -> pd.DataFrame:
    """Return the strongest clutter box left and right of every frame, a row each.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.

    Returns
    -------
    DataFrame
        ``lane``, ``frame``, ``side``, ``object``, the power at every stage and of every variant,
        and ``cluster``, the object by lane.
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
    """Return the power in boxes at a stage over that of the original image, dB."""
    return np.asarray(10 * np.log10(boxes[stage].to_numpy() / boxes["#0"].to_numpy()))


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
    changes = []
    mines = []
    for lane in lanes:
        wide = lane.mines.pivot_table(
            index=["frame", "target"], columns="variant", values="peak"
        ).reset_index()
        changes.append(20 * np.log10(wide[variant].to_numpy() / wide["original"].to_numpy()))
        mines.append(lane.name + wide["target"].astype(str))
    return np.concatenate(changes), pd.concat(mines, ignore_index=True)


def mine_powers(lanes: Sequence[LaneResult], variant: str) -> tuple[FloatArray, pd.Series]:
    """Return the mean power in a box about every look's mine, dB, and the mine of each look.

    The parameters are those of :func:`mine_changes`.
    """
    tables = [lane.mines.assign(lane=lane.name) for lane in lanes]
    rows = pd.concat(tables)
    rows = rows[rows["variant"] == variant]
    return 10 * np.log10(rows["power"].to_numpy()), rows["lane"] + rows["target"].astype(str)


def own_changes(lanes: Sequence[LaneResult], variant: str) -> tuple[FloatArray, pd.Series]:
    """Return the change of what every mine alone gives at its peak, dB, and the mine of each look.

    Parameters
    ----------
    lanes : sequence of LaneResult
        Results of the lanes.
    variant : str
        Name of the variant.
    """
    tables = []
    for lane in lanes:
        tables.append(lane.own[lane.own["variant"] == variant].assign(lane=lane.name))
    rows = pd.concat(tables)
    return rows["change_db"].to_numpy(dtype=np.float64), rows["lane"] + rows["target"].astype(str)


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
    means = _frame_means(boxes, values)
    if len(means) < 2:
        return 0.0
    return float(stdtrit(len(means) - 1, 0.975) * means.std())


def _frame_means(boxes: pd.DataFrame, values: FloatArray) -> pd.Series:
    """Return the mean of a frame's two boxes, where it has two."""
    frames = boxes.assign(value=values).groupby(["lane", "frame"])["value"].agg(["mean", "count"])
    return frames.loc[frames["count"] == 2, "mean"]


def with_interval(interval: Interval, unit: str = " dB", digits: int = 1) -> str:
    """Format a value with its interval in a fixed number of decimals."""
    value, low, high = (f"{number:z.{digits}f}" for number in interval)
    return f"{value}{unit} ({low} to {high})"
