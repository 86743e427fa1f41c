"""Pd by kind, depth and soil; Pd against the distance at which a decision must stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pandas as pd

from flgpr.model import check_alarms
from flgpr.scoring.chance_level import Chance
from flgpr.scoring.curve import clopper_pearson, operating_row, pd_mean
from flgpr.scoring.lane_roc import AreaRule, roc, roc_of
from flgpr.scoring.matching import LaneLike, Match, one_of

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
    """Tabulate Pd by properties of the targets, all at the one threshold that keeps the FAR of the whole list.

    The groups add up to the whole: an alarm in the halos of two targets finds both, whichever
    groups they belong to.

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
    """
    curve = roc_of(matched, area=area, frame_area=frame_area, level=level)
    row = int(operating_row(curve, far))
    threshold = float(curve["threshold"].iloc[row])
    table = matched.truth.assign(found=matched.best()[1] >= threshold)
    names = [name for name in by if name in table.columns or name != "soil"]
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise ValueError(f"by must name columns of truth, got {', '.join(missing)}")
    if "depth" in names and depth_edges is not None:
        table["depth"] = depth_classes(table["depth"], depth_edges)
    groups = table.groupby(names, sort=True, dropna=False, observed=True)
    result = groups["found"].agg(n_targets="size", n_detected="sum").reset_index()
    low, high = clopper_pearson(result["n_detected"], result["n_targets"], level)
    result = result.assign(pd=result["n_detected"] / result["n_targets"], pd_low=low, pd_high=high)
    if chance is not None:
        moved = table.assign(
            clear=(~np.isnan(chance.best)).sum(axis=1),
            struck=(chance.best >= threshold).sum(axis=1),
        )
        sums = moved.groupby(names, sort=True, dropna=False, observed=True)[
            ["clear", "struck"]
        ].sum()
        result["chance"] = (sums["struck"] / sums["clear"]).to_numpy()
    result.attrs = {
        "threshold": threshold,
        "far": float(curve["far"].iloc[row]),
        "far_allowed": float(far),
    }
    return result


def depth_classes(depth: pd.Series[Any], edges: Sequence[float] = DEPTH_EDGES) -> pd.Series[Any]:
    """Sort depths (m) into classes in the order of depth; one on an edge belongs to the deeper, unknown to none."""
    borders = np.asarray(edges, dtype=np.float64)
    if borders.ndim != 1 or len(borders) < 1 or (np.diff(borders) <= 0).any():
        raise ValueError(f"depth_edges must rise strictly, got {list(edges)}")
    inner = [f"{a * 100:g} to {b * 100:g} cm" for a, b in pairwise(borders)]
    names = [f"under {borders[0] * 100:g} cm", *inner, f"{borders[-1] * 100:g} cm and deeper"]
    # Categories keep the classes in the order of depth, not of the alphabet.
    place = np.where(depth.isna(), -1, np.searchsorted(borders, depth.to_numpy(), side="right"))
    classes = pd.Categorical.from_codes(place, pd.Index(names), ordered=True)
    return pd.Series(classes.remove_unused_categories(), index=depth.index)


def decision_curves(
    sightings: pd.DataFrame,
    truth: pd.DataFrame,
    lane: LaneLike,
    distances: Sequence[float] = tuple(range(8, 17)),
    *,
    combine: Literal["max", "mean"] = "max",
    **options: Any,
) -> dict[float, pd.DataFrame]:
    """Compute the ROC of what is known while the vehicle can still stop: only scans at least so far away count.

    Parameters
    ----------
    sightings : DataFrame
        One row per alarm and scan that saw it: an alarm table with the column ``ahead``, the
        down-track distance from the radar to the alarm in that scan, m. Rows that share
        ``alarm_id`` (and ``lane``) are one alarm; without that column each row is an alarm of its
        own.
    truth, lane, options
        As for :func:`flgpr.scoring.roc`.
    distances : sequence of float
        Decision distances, m.
    combine : {"max", "mean"}
        How the confidences of one alarm's scans become one; its place is that of its most confident
        scan.

    Returns
    -------
    dict of float to DataFrame
        The curve at each decision distance; ``attrs["decision_distance"]`` names it.
    """
    one_of("combine", combine, ("max", "mean"))
    table = check_alarms(sightings.drop(columns="alarm_id", errors="ignore"))
    if (
        "ahead" not in table.columns
        or not np.isfinite(pd.to_numeric(table["ahead"], errors="coerce")).all()
    ):
        raise ValueError(
            "sightings must have the column ahead, finite, m: the distance from the radar in that scan"
        )
    if "alarm_id" in sightings.columns:
        # A row without a name is an alarm of its own; its number cannot be taken for a name, which
        # is text.
        table["alarm_id"] = [
            row if missing else str(name)
            for row, (name, missing) in enumerate(
                zip(sightings["alarm_id"], sightings["alarm_id"].isna(), strict=True)
            )
        ]
    keys = [name for name in ("lane", "alarm_id") if name in table.columns]
    curves = {}
    for distance in distances:
        seen = table[table["ahead"] >= distance].reset_index(drop=True)
        if "alarm_id" in keys:
            groups = seen.groupby(keys, sort=False, dropna=False)["confidence"]
            joined = groups.transform(combine)
            strongest = groups.idxmax()
            seen = seen.assign(confidence=joined).loc[strongest].reset_index(drop=True)
        curve = roc(seen, truth, lane, **options)
        curve.attrs["decision_distance"] = float(distance)
        curves[float(distance)] = curve
    return curves


def decision_table(
    curves: Mapping[float, pd.DataFrame], far: float = 0.01, far_max: float = 0.1
) -> pd.DataFrame:
    """Summarise what :func:`decision_curves` gives at the allowed ``far``, per m²: one row per distance.

    Its columns are ``distance`` (m), ``threshold``, ``pd``, ``pd_low``, ``pd_high``, ``far``, the one reached,
    ``n_detected``, ``n_targets`` and ``pd_mean``, averaged up to ``far_max``.
    """
    rows = []
    for distance, curve in curves.items():
        point = curve.iloc[int(operating_row(curve, far))]
        columns = ("threshold", "pd", "pd_low", "pd_high", "far", "n_detected", "n_targets")
        rows.append(
            {
                "distance": distance,
                **point[list(columns)].to_dict(),
                "pd_mean": pd_mean(curve, far_max),
            }
        )
    return pd.DataFrame(rows).astype({"n_detected": int, "n_targets": int})
