"""Pd by kind, depth and soil."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from flgpr.scoring.chance_level import Chance
from flgpr.scoring.curve import clopper_pearson, operating_row
from flgpr.scoring.lane_roc import AreaRule, roc_of
from flgpr.scoring.matching import Match
from flgpr.types import FloatArray, floats

DEPTH_EDGES = (0.0, 0.025, 0.075, 0.125, 0.175)


def pd_table(
    matched: Match,
    far: float = 0.01,
    by: Sequence[str] = ("kind", "depth", "soil"),
    *,
    depth_edges: Sequence[float] | None = DEPTH_EDGES,
    area: AreaRule = "union",
    frame_area: float | None = None,
    level: float = 0.95,
    chance: Chance | None = None,
) -> pd.DataFrame:
    """Tabulate Pd by properties of the targets at an allowed false alarm rate.

    All groups have one threshold, at which the whole list keeps the allowed FAR. The groups add up
    to the whole: an alarm in the halos of two targets finds both, whichever groups they belong to.

    Parameters
    ----------
    matched, area, frame_area
        As for :func:`flgpr.scoring.roc_of`.
    far : float
        Allowed false alarm rate, per m².
    by : sequence of str
        Columns of truth to group by; "soil" is left out where truth does not have it.
    depth_edges : sequence of float, optional
        Borders of depth classes, m; a depth on a border belongs to the deeper class. ``None`` takes
        depths as they are.
    level : float
        Level of the Clopper-Pearson intervals.
    chance : Chance, optional
        Chance level of the same match, see :func:`flgpr.scoring.chance`.

    Returns
    -------
    DataFrame
        One row per combination that occurs: the columns of ``by``, ``n_targets``, ``n_detected``,
        ``pd``, ``pd_low``, ``pd_high`` and, with a chance level, ``chance``, the Pd it gives;
        ``attrs`` hold ``threshold`` and ``far``, the one reached.

    Raises
    ------
    ValueError
        If ``by`` names a column that truth does not have, or an option is not valid.
    """
    curve = roc_of(matched, area=area, frame_area=frame_area, level=level)
    row = int(operating_row(curve, far))
    threshold = float(curve["threshold"].iloc[row])
    _, best_confidence, _ = matched.best()
    table = matched.truth.assign(found=best_confidence >= threshold)
    names = [name for name in by if name in table.columns or name != "soil"]
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise ValueError(f"by must name columns of truth, got {', '.join(missing)}")
    if "depth" in names and depth_edges is not None:
        table["depth"] = depth_classes(table["depth"], depth_edges)

    groups = table.groupby(names, sort=True, dropna=False, observed=True)
    result = groups["found"].agg(n_targets="size", n_detected="sum").reset_index()
    low, high = clopper_pearson(result["n_detected"], result["n_targets"], level)
    share = result["n_detected"] / result["n_targets"]
    result = result.assign(pd=share, pd_low=low, pd_high=high)
    if chance is not None:
        result["chance"] = _chance_by_group(table, names, chance, threshold)
    result.attrs = {
        "threshold": threshold,
        "far": float(curve["far"].iloc[row]),
        "far_allowed": float(far),
    }
    return result


def _chance_by_group(
    table: pd.DataFrame, names: list[str], chance: Chance, threshold: float
) -> FloatArray:
    """Return the Pd by chance of every group of targets, in the order of the groups.

    It is the share of moved halos that a free alarm strikes, of those that overlap no other.
    """
    counted = table.assign(
        clear_halos=(~np.isnan(chance.best)).sum(axis=1),
        struck_halos=(chance.best >= threshold).sum(axis=1),
    )
    by_group = counted.groupby(names, sort=True, dropna=False, observed=True)
    sums = by_group[["clear_halos", "struck_halos"]].sum()
    return (sums["struck_halos"] / sums["clear_halos"]).to_numpy()


def depth_classes(depth: pd.Series[Any], edges: Sequence[float] = DEPTH_EDGES) -> pd.Series[Any]:
    """Return the class of each depth, in the order of depth.

    Depths and edges are in m. A depth on an edge belongs to the deeper class, an unknown one to
    none.
    """
    borders = floats(edges)
    if borders.ndim != 1 or len(borders) < 1 or (np.diff(borders) <= 0).any():
        raise ValueError(f"depth_edges must rise strictly, got {list(edges)}")
    inner = [f"{upper * 100:g} to {lower * 100:g} cm" for upper, lower in pairwise(borders)]
    names = [f"under {borders[0] * 100:g} cm", *inner, f"{borders[-1] * 100:g} cm and deeper"]
    # Categories keep the classes in the order of depth, not of the alphabet.
    codes = np.searchsorted(borders, depth.to_numpy(), side="right")
    codes = np.where(depth.isna(), -1, codes)
    classes = pd.Categorical.from_codes(codes, pd.Index(names), ordered=True)
    return pd.Series(classes.remove_unused_categories(), index=depth.index)
