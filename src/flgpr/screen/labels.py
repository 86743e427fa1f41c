"""Labels of alarms for training (Wang et al. 2007, Sec. II-B)."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.model import Lane, check_truth

HIT, FALSE, NEITHER = "hit", "false", "neither"


def label_alarms(alarms: pd.DataFrame, truth: pd.DataFrame, lane: Lane, radius: float = 1.0) -> pd.DataFrame:
    """Label alarms as hits, false alarms or neither, each hit with its closest target.

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
        ``label`` ("hit", "false" or "neither"), ``target`` (row in the truth table of the closest target, -1 unless a
        hit) and ``distance`` to the closest target (m, NaN without any), with the index of ``alarms``.
    """
    if not radius > 0:
        raise ValueError(f"radius must be positive, got {radius}")
    targets = check_truth(truth)
    place, there = (t[["x", "y"]].to_numpy(dtype=np.float64) for t in (alarms, targets))
    if len(there):
        away = np.linalg.norm(place[:, None] - there[None], axis=-1)
        target, distance = away.argmin(axis=1), away.min(axis=1)
    else:
        target, distance = np.full(len(place), -1), np.full(len(place), np.nan)
    hit = distance <= radius
    inside = lane.contains(place[:, 0], place[:, 1])
    label = np.where(hit, HIT, np.where(inside, FALSE, NEITHER))
    return pd.DataFrame({"label": label, "target": np.where(hit, target, -1), "distance": distance}, index=alarms.index)
