"""What a table of alarms or targets makes one doubt, before it is scored: told in lines, and nothing is changed."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.scoring import as_lanes
from flgpr.scoring.matching import LaneLike
from flgpr.store.notes import tell_note

_SHARE_OUTSIDE = 0.5  # of the rows, from where on the axes may be swapped


def table_doubts(table: pd.DataFrame, kind: str, lanes: LaneLike) -> list[str]:
    """Return what is doubtful about a table of "alarms" or "truth", in words: none, repeated, or swapped rows.

    A table without rows; rows at one place, in one lane, of one confidence or kind; and more than half of the rows
    outside their lane while with x and y swapped more of them would lie inside.
    """
    what = {"alarms": "alarms", "truth": "targets"}.get(kind, "objects")
    if not len(table):
        return [f"it holds no {what}: a header and no row"]
    doubts: list[str] = []
    same = [name for name in ("x", "y", "confidence", "kind", "lane") if name in table.columns]
    repeated = int(table.duplicated(same).sum())
    if repeated:
        doubts.append(
            f"{repeated} of {len(table)} {what} repeat another one at the same place; all are kept"
        )
    inside = _inside(table, lanes, "x", "y")
    swapped = _inside(table, lanes, "y", "x")
    outside = len(table) - inside
    if outside > _SHARE_OUTSIDE * len(table) and swapped > inside:
        doubts.append(
            f"{outside} of {len(table)} {what} lie outside the lane; with x and y swapped, {swapped} would lie inside: "
            "are the axes swapped?"
        )
    elif outside == len(table):
        doubts.append(f"all {outside} {what} lie outside the lane")
    return doubts


def tell_doubts(table: pd.DataFrame, kind: str, name: str, lanes: LaneLike) -> None:
    """Tell the doubts of :func:`table_doubts` of a table that came from a file of that name."""
    for doubt in table_doubts(table, kind, lanes):
        tell_note(f"{name}: {doubt}")


def _inside(table: pd.DataFrame, lanes: LaneLike, across: str, along: str) -> int:
    """Count the rows that lie in their lane."""
    named = as_lanes(lanes)
    x = table[across].to_numpy(np.float64)
    y = table[along].to_numpy(np.float64)
    if "lane" not in table.columns or list(named) == [""]:
        inside = [lane.contains(x, y) for lane in named.values()]
        return int(np.any(inside, axis=0).sum())
    own = table["lane"].astype(str).to_numpy()
    return sum(int((lane.contains(x, y) & (own == name)).sum()) for name, lane in named.items())
