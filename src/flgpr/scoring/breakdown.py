"""Pd by kind, depth and soil; Pd against the distance at which a decision must stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

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
) -> NDArray[np.float64]:
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
    borders = np.asarray(edges, dtype=np.float64)
    if borders.ndim != 1 or len(borders) < 1 or (np.diff(borders) <= 0).any():
        raise ValueError(f"depth_edges must rise strictly, got {list(edges)}")
    inner = [f"{upper * 100:g} to {lower * 100:g} cm" for upper, lower in pairwise(borders)]
    names = [f"under {borders[0] * 100:g} cm", *inner, f"{borders[-1] * 100:g} cm and deeper"]
    # Categories keep the classes in the order of depth, not of the alphabet.
    codes = np.searchsorted(borders, depth.to_numpy(), side="right")
    codes = np.where(depth.isna(), -1, codes)
    classes = pd.Categorical.from_codes(codes, pd.Index(names), ordered=True)
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
    """Compute the ROC of what is known while the vehicle can still stop.

    Only scans at least the decision distance away from an alarm count.

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
        How the confidences of one alarm's scans become one; its position is that of its most
        confident scan.

    Returns
    -------
    dict of float to DataFrame
        The curve at each decision distance; ``attrs["decision_distance"]`` names it.

    Raises
    ------
    ValueError
        If ``ahead`` is missing or not finite, or a table or an option is not valid.
    """
    one_of("combine", combine, ("max", "mean"))
    table = check_alarms(sightings.drop(columns="alarm_id", errors="ignore"))
    if "ahead" not in table.columns or not _all_finite(table["ahead"]):
        raise ValueError(
            "sightings must have the column ahead, finite, m: "
            "the distance from the radar in that scan"
        )
    if "alarm_id" in sightings.columns:
        table["alarm_id"] = _names_of_alarms(sightings["alarm_id"])
    keys = [name for name in ("lane", "alarm_id") if name in table.columns]
    curves = {}
    for distance in distances:
        rows = table[table["ahead"] >= distance].reset_index(drop=True)
        if "alarm_id" in keys:
            rows = _one_row_per_alarm(rows, keys, combine)
        curve = roc(rows, truth, lane, **options)
        curve.attrs["decision_distance"] = float(distance)
        curves[float(distance)] = curve
    return curves


def _one_row_per_alarm(
    rows: pd.DataFrame, keys: list[str], combine: Literal["max", "mean"]
) -> pd.DataFrame:
    """Return each alarm's most confident scan, with the confidences of its scans combined."""
    groups = rows.groupby(keys, sort=False, dropna=False)["confidence"]
    combined = groups.transform(combine)
    strongest = groups.idxmax()
    return rows.assign(confidence=combined).loc[strongest].reset_index(drop=True)


def _all_finite(column: pd.Series[Any]) -> bool:
    """Return whether all cells of a column are finite numbers."""
    return bool(np.isfinite(pd.to_numeric(column, errors="coerce")).all())


def _names_of_alarms(column: pd.Series[Any]) -> list[Any]:
    """Return the name of each row's alarm.

    A row without a name is an alarm of its own. Its number cannot be taken for a name, which is
    text.
    """
    names: list[Any] = []
    for row, (name, is_missing) in enumerate(zip(column, column.isna(), strict=True)):
        names.append(row if is_missing else str(name))
    return names


def decision_table(
    curves: Mapping[float, pd.DataFrame], far: float = 0.01, far_max: float = 0.1
) -> pd.DataFrame:
    """Summarise curves of :func:`decision_curves` at an allowed false alarm rate.

    Parameters
    ----------
    curves : mapping of float to DataFrame
        Curves by decision distance, m.
    far : float
        Allowed false alarm rate, per m².
    far_max : float
        End of the averaging of PD_mean, per m².

    Returns
    -------
    DataFrame
        One row per distance: ``distance`` (m), ``threshold``, ``pd``, ``pd_low``, ``pd_high``,
        ``far``, the one reached, ``n_detected``, ``n_targets`` and ``pd_mean``.
    """
    columns = ["threshold", "pd", "pd_low", "pd_high", "far", "n_detected", "n_targets"]
    rows = []
    for distance, curve in curves.items():
        point = curve.iloc[int(operating_row(curve, far))]
        row = {"distance": distance, **point[columns].to_dict()}
        row["pd_mean"] = pd_mean(curve, far_max)
        rows.append(row)
    return pd.DataFrame(rows).astype({"n_detected": int, "n_targets": int})
