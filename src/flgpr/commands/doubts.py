"""Warnings about tables of alarms or targets before they are scored; nothing is changed."""

from __future__ import annotations

import pandas as pd

from flgpr.commands.reach import are_near
from flgpr.scoring.matching import LaneLike
from flgpr.store.notes import log_note

_SHARE_OUTSIDE = 0.5  # of the rows, above which the axes may be swapped
_ROW_NAMES = {"alarms": "alarms", "truth": "targets"}


def table_doubts(table: pd.DataFrame, kind: str, lanes: LaneLike) -> list[str]:
    """Return what is doubtful about a table.

    That is a table without rows; rows at one place, in one lane, of one confidence or kind; and
    more than half of the rows outside their lane while with x and y swapped more of them would lie
    inside.

    Parameters
    ----------
    table : pandas.DataFrame
        Alarms, targets or objects with ``x`` and ``y``, m.
    kind : str
        "alarms", "truth" or "objects".
    lanes : Lane, or mapping of Lane by name
        Where the rows should lie.

    Returns
    -------
    list of str
        A sentence for each doubt.
    """
    row_name = _ROW_NAMES.get(kind, "objects")
    count = len(table)
    if not count:
        return [f"it holds no {row_name}: a header and no row"]

    doubts: list[str] = []
    keys = [name for name in ("x", "y", "confidence", "kind", "lane") if name in table.columns]
    repeated = int(table.duplicated(keys).sum())
    if repeated:
        doubts.append(
            f"{repeated} of {count} {row_name} repeat another one at the same place; all are kept"
        )

    inside = int(are_near(table, lanes).sum())
    swapped = table.rename(columns={"x": "y", "y": "x"})
    inside_if_swapped = int(are_near(swapped, lanes).sum())
    outside = count - inside
    if outside > _SHARE_OUTSIDE * count and inside_if_swapped > inside:
        doubts.append(
            f"{outside} of {count} {row_name} lie outside the lane; with x and y swapped, "
            f"{inside_if_swapped} would lie inside: are the axes swapped?"
        )
    elif outside == count:
        doubts.append(f"all {outside} {row_name} lie outside the lane")
    return doubts


def tell_doubts(table: pd.DataFrame, kind: str, name: str, lanes: LaneLike) -> None:
    """Print the doubts of :func:`table_doubts` about a table.

    Parameters
    ----------
    table : pandas.DataFrame
        Alarms or truth.
    kind : str
        "alarms" or "truth".
    name : str
        Name of the table's file.
    lanes : Lane or mapping of str to Lane
        The lane, or lanes by name.
    """
    for doubt in table_doubts(table, kind, lanes):
        log_note(f"{name}: {doubt}")
