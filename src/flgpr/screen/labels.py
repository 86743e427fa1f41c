"""Labels of alarms for training: hits, false alarms or neither (Wang et al. 2007, Sec. II-B)."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.model import Lane, check_truth

HIT = "hit"
FALSE = "false"
NEITHER = "neither"


def label_training_alarms(
    alarms: pd.DataFrame, truth: pd.DataFrame, lane: Lane, radius: float = 1.0
) -> pd.DataFrame:
    """Return the labels of alarms: hits, each with its closest target, false alarms or neither.

    Parameters
    ----------
    alarms, truth : DataFrame
        x, y in the lane frame, m, and the truth table of the same lane. Only training may see it.
    lane : Lane
        The lane; alarms outside it that hit nothing are neither.
    radius : float
        r_label: alarms within it of a target's centre are hits, its border included, m.

    Returns
    -------
    DataFrame
        ``label`` ("hit", "false" or "neither"), ``target`` (row in the truth table of the closest
        target, -1 unless a hit) and ``distance`` to the closest target (m, NaN without any), with
        the index of ``alarms``.

    Raises
    ------
    ValueError
        If the radius is not positive, or the truth table is not valid.
    """
    if not radius > 0:
        raise ValueError(f"radius must be positive, got {radius}")
    position = alarms[["x", "y"]].to_numpy(dtype=np.float64)
    target_position = check_truth(truth)[["x", "y"]].to_numpy(dtype=np.float64)
    if len(target_position):
        distances = np.linalg.norm(position[:, None] - target_position[None], axis=-1)
        target = distances.argmin(axis=1)
        distance = distances.min(axis=1)
    else:
        target = np.full(len(position), -1)
        distance = np.full(len(position), np.nan)
    hit = distance <= radius
    inside = lane.contains(position[:, 0], position[:, 1])
    label = np.where(hit, HIT, np.where(inside, FALSE, NEITHER))
    return pd.DataFrame(
        {"label": label, "target": np.where(hit, target, -1), "distance": distance},
        index=alarms.index,
    )
