"""What a report begins with where no truth is known: the places that stand out, a sentence each."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import pandas as pd

from flgpr.model import Lane
from flgpr.results.result import Result

MOST_PLACES = 40
"""Places that are numbered and explained."""
_EDGE = 0.25  # m
_MOSTLY = 0.5  # of an alarm's amplitude


def places_that_stand_out(result: Result) -> list[list[str]]:
    """Return rank, name, place and a sentence of every alarm that stands out, at most 40."""
    stands_out = result.manifest["run"].get("stands_out", {})
    border = stands_out.get("border")
    if border is None:
        return []
    outstanding = outstanding_alarms(result.alarms, result.lane, border)
    rows = []
    for rank, alarm in enumerate(outstanding[:MOST_PLACES].to_dict("records"), 1):
        side = "left" if alarm["x"] < 0 else "right"
        place = f"{alarm['y']:.2f} m along, {abs(alarm['x']):.2f} m {side}"
        rows.append(
            [
                str(rank),
                str(alarm["alarm_id"]),
                place,
                alarm_sentence(alarm, result.lane, border),
            ]
        )
    return rows


def outstanding_alarms(alarms: pd.DataFrame, lane: Lane, border: float) -> pd.DataFrame:
    """Return the alarms in the lane of at least a confidence."""
    return alarms[lane.contains(alarms["x"], alarms["y"]) & (alarms["confidence"] >= border)]


def alarm_sentence(alarm: Mapping[Hashable, Any], lane: Lane, border: float) -> str:
    """Return why an alarm stands out, and what speaks against it.

    Parameters
    ----------
    alarm : mapping
        Its row of the table of alarms.
    lane : Lane
        The lane.
    border : float
        Confidence from which on alarms stand out.

    Returns
    -------
    str
        Its strength, the scans that saw it, the roadside and the lane's edge.
    """
    confidence = float(alarm["confidence"])
    parts = [f"confidence {confidence:.3g} ({border:.3g} suffices)"]
    if not pd.isna(alarm.get("p")):
        parts = [f"probability {alarm['p']:.2f} where mines are as frequent as in training"]
    scans = alarm.get("scans")
    if scans is not None and not pd.isna(scans):
        seen = f"seen by {scans:.0f} scans"
        parts.append("seen by one scan only: take another look" if scans == 1 else seen)
    roadside = alarm.get("roadside")
    if roadside is not None and not pd.isna(roadside):
        share = f"{min(100 * roadside, 100):.0f} %"
        is_mostly = roadside >= _MOSTLY
        parts.append(f"{share} of it is the roadside's" if is_mostly else "not the roadside's")
    margin = min(alarm["x"] - lane.x_min, lane.x_max - alarm["x"])
    if margin < _EDGE:
        parts.append("at the edge of the lane")
    return ", ".join(parts)
