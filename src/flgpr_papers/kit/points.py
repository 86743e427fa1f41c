"""Pd at operating points with its interval, and what alarms that know nothing of the targets would find there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from flgpr.scoring import Match, chance, clopper_pearson, operating_row, roc_of

FAR = (0.01, 0.02, 0.05, 0.1)
"""Operating points that every page tells, per m²."""
HEADER = ["alarms by", "targets", *(f"Pd at {far:g} per m², 95 %, chance" for far in FAR)]


def detections_at(matched: Match, subset: Any, far: float, **area: Any) -> tuple[int, int, float]:
    """Count the targets found at an allowed FAR (per m²), and all; with the chance level of Pd there."""
    return _read(chance(matched).beside(roc_of(matched, subset, **area), subset), far)


def _read(curve: pd.DataFrame, far: float) -> tuple[int, int, float]:
    row = curve.iloc[int(operating_row(curve, far))]
    return int(row["n_detected"]), int(row["n_targets"]), float(row["chance"])


def in_words(found: int, targets: int, by_chance: float) -> str:
    """Write a Pd with its counts, exact interval and chance level."""
    low, high = clopper_pearson(found, targets)
    return f"{found} of {targets} = {found / max(targets, 1):.0%} ({low:.0%} to {high:.0%}), chance {by_chance:.0%}"


def point_rows(matches: Mapping[str, Match], subsets: Mapping[str, Any], **area: Any) -> list[tuple[str, ...]]:
    """Tabulate detectors and subsets of the targets by operating points."""
    rows = []
    for name, one in matches.items():
        level = chance(one)
        for kind, subset in subsets.items():
            curve = level.beside(roc_of(one, subset, **area), subset)
            rows.append((name, kind, *(in_words(*_read(curve, far)) for far in FAR)))
    return rows
