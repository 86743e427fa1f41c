"""Pd against the distance at which a decision must stand, while the vehicle can still stop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import pandas as pd

from flgpr.model import check_alarms
from flgpr.scoring.curve import held_pd_mean, operating_row
from flgpr.scoring.lane_roc import roc
from flgpr.scoring.matching import LaneLike, one_of


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
    ahead = pd.to_numeric(table.get("ahead", pd.Series([np.nan])), errors="coerce")
    if not np.isfinite(ahead).all():
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


def _names_of_alarms(column: pd.Series[Any]) -> list[Any]:
    """Return the name of each row's alarm.

    A row without a name is an alarm of its own. Its number cannot be taken for a name, which is
    text.
    """
    is_missing = column.isna()
    return [
        row if missing else str(name)
        for row, (name, missing) in enumerate(zip(column, is_missing, strict=True))
    ]


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
        row["pd_mean"] = held_pd_mean(curve, far_max)
        rows.append(row)
    return pd.DataFrame(rows).astype({"n_detected": int, "n_targets": int})
