"""Tables before they are scored: which rows lie where alarms were searched, and what is doubtful.

Targets out of reach are counted apart. Of what is doubtful a warning tells; nothing is changed.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.model.units import UNITS
from flgpr.report.trial_block import borders_in_words
from flgpr.scoring import as_lanes
from flgpr.scoring.matching import LaneLike, Match, stated_lanes
from flgpr.store.notes import log_note
from flgpr.types import BoolArray, Entries, floats

_SHARE_OUTSIDE = 0.5  # of the rows, above which the axes may be swapped
_ROW_NAMES = {"alarms": "alarms", "truth": "targets"}
_MOST_OUTSIDE = 0.5  # of the targets, above which the truth is of another lane
_ONE_TARGET = 0.1  # m, which is less than a mine is wide
_CHANCE = 0.01  # probability below which falling confidences are no chance
_DEEPEST = 1.0  # m, below which no mine is laid: a greater depth is likely in another unit


def targets_in_reach(
    targets: pd.DataFrame, lanes: LaneLike, halo: float, name: str
) -> tuple[pd.DataFrame, Entries]:
    """Return the targets whose halo touches the searched ground, and a note on the others.

    No alarm of that ground can be a hit on a target that lies farther outside than the halo. It is
    counted apart and no miss.

    Parameters
    ----------
    targets : pandas.DataFrame
        Targets with ``x`` and ``y``, m, and ``lane`` where there are several.
    lanes : Lane, or mapping of Lane by name
        Searched ground.
    halo : float
        Halo radius, m.
    name : str
        File of the targets, for messages.

    Returns
    -------
    targets : pandas.DataFrame
        Those in reach.
    notes : dict
        For the report: ``targets_outside`` names the others, if there are any.

    Raises
    ------
    ValueError
        If more than half of the targets lie outside. The error counts them, and those that would
        lie inside with other axes.
    """
    if not halo > 0:
        raise ValueError(f"halo must be a positive radius in metres, got {halo:g}")
    count = len(targets)
    in_reach = are_near(targets, lanes, halo, "truth")
    outside = count - int(in_reach.sum())
    if not outside:
        return targets, {}
    if outside > _MOST_OUTSIDE * count:
        raise ValueError(
            f"truth must lie in the ground that was searched ({borders_in_words(as_lanes(lanes))}): {outside} of "
            f"{count} targets of {name} lie more than the halo of {halo:g} m outside; "
            f"{_other_axes(targets, lanes, halo)}"
        )
    identifiers = [str(value) for value in targets.loc[~in_reach, "target_id"]]
    log_note(
        f"{name}: {outside} of {count} targets lie more than the halo of {halo:g} m outside the "
        f"ground that was searched ({borders_in_words(as_lanes(lanes))}); they are counted apart, not as misses: "
        f"{', '.join(identifiers)}"
    )
    return targets[in_reach], {"targets_outside": identifiers}


def are_near(
    table: pd.DataFrame, lanes: LaneLike, margin: float = 0.0, name: str = "alarms"
) -> BoolArray:
    """Return which rows of a table lie in their lane or a little outside.

    Parameters
    ----------
    table : pandas.DataFrame
        Positions ``x`` and ``y``, m, and ``lane`` where there are several.
    lanes : Lane or mapping of str to Lane
        The lane, or lanes by name.
    margin : float
        How far outside a row may lie, m.
    name : {"alarms", "truth"}
        What the table is, for errors.

    Returns
    -------
    (row,) ndarray of bool
        Which rows do.
    """
    lanes_by_name = as_lanes(lanes)
    has_lanes = "lane" in table.columns and list(lanes_by_name) != [""]
    stated = stated_lanes(table, list(lanes_by_name), name) if has_lanes else None
    x = floats(table["x"])
    y = floats(table["y"])
    in_reach = np.zeros(len(table), dtype=np.bool_)
    for lane_name, lane in lanes_by_name.items():
        is_near = lane.distance(x, y) <= margin
        if stated is not None:
            is_near &= (stated == lane_name).to_numpy()
        in_reach |= is_near
    return in_reach


def _other_axes(targets: pd.DataFrame, lanes: LaneLike, halo: float) -> str:
    """Return in words how many targets would be in reach with other axes."""
    trials = {
        "x and y swapped": targets.rename(columns={"x": "y", "y": "x"}),
        "the other sign of x": targets.assign(x=-targets["x"]),
        "the other sign of y": targets.assign(y=-targets["y"]),
    }
    for unit in ("ft", "cm"):
        factor = UNITS["length"][unit]
        trials[unit] = targets.assign(x=factor * targets["x"], y=factor * targets["y"])
    counts = {}
    for trial, changed in trials.items():
        counts[trial] = int(are_near(changed, lanes, halo).sum())
    best = max(counts, key=lambda trial: counts[trial])
    if 2 * counts[best] > len(targets):
        told = f"they are in {best}" if best in UNITS["length"] else f"it is with {best}"
        return f"{counts[best]} would be in reach if {told}; else, are they of another lane?"
    return (
        "none of the other axes and units tried brings them there: are they of another lane, or "
        "in another frame (longitude and latitude, or a map's, need an `anchor`)?"
    )


def table_doubts(table: pd.DataFrame, kind: str, lanes: LaneLike) -> list[str]:
    """Return what is doubtful about a table.

    That is a table without rows; rows at one place, in one lane, of one confidence or kind; rows
    outside their lane, with a question if more of them would lie inside with x and y swapped; and
    depths of more than a metre.

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
    close = _close_together(table) if kind == "truth" and inside and not repeated else 0
    if close:
        doubts.append(
            f"targets of one kind lie less than {_ONE_TARGET:g} m apart ({close} of them): are they "
            "two rows of one target? both are kept"
        )
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
    elif outside:
        doubts.append(f"{outside} of {count} {row_name} lie outside the lane")
    return doubts + _depth_doubts(table, row_name)


def _close_together(targets: pd.DataFrame) -> int:
    """Return how many pairs of targets of one kind, in one lane, are closer than any two mines lie."""
    from scipy.spatial import cKDTree

    keys = [name for name in ("kind", "lane") if name in targets.columns]
    groups = targets.groupby(keys) if keys else [("", targets)]
    trees = [cKDTree(floats(group[["x", "y"]])) for _, group in groups]
    return sum(len(tree.query_pairs(_ONE_TARGET)) for tree in trees)


def tell_ranking_doubts(matched: Match, far: float | None, reached: float, name: str) -> None:
    """Print what is doubtful about a scored list: confidences that fall, and a rate out of reach.

    Parameters
    ----------
    matched : Match
        Alarms and targets.
    far : float or None
        Operating point that was asked for, per m².
    reached : float
        False alarm rate of the whole list, per m².
    name : str
        Name of the list's file.
    """
    from scipy.stats import mannwhitneyu

    hits = matched.confidence[matched.in_halo]
    false = matched.confidence[matched.false]
    if len(hits) and len(false) and mannwhitneyu(hits, false, alternative="less").pvalue < _CHANCE:
        log_note(
            f"{name}: alarms at targets have lower confidences than false ones, which chance gives "
            f"in less than {_CHANCE:.0%} of lists: higher must be more like a mine; is the order "
            "reversed?"
        )
    if far is not None and far > reached:
        log_note(
            f"{name}: far of {far:g} per m² is beyond the {reached:.3g} per m² of the whole list: "
            "all its alarms count there"
        )


def _depth_doubts(table: pd.DataFrame, row_name: str) -> list[str]:
    """Return what is doubtful about the depths of a table, if it has any."""
    if "depth" not in table.columns:
        return []
    depth = floats(table["depth"])
    deep = int((np.abs(depth) > _DEEPEST).sum())
    if not deep:
        return []
    worst = float(depth[np.nanargmax(np.abs(depth))])
    return [
        f"{deep} of {len(table)} {row_name} have a depth of more than {_DEEPEST:g} m, "
        f"such as {worst:g} m: depths are metres to the top of the target; are these centimetres?"
    ]


def refuse_elsewhere(alarms: pd.DataFrame, lanes: LaneLike, name: str) -> Entries:
    """Refuse a list of which every alarm lies outside the lane; return how many others do.

    Such a list belongs to another lane, or its columns are not what they seem: a score of it would
    say that nothing was found.

    Parameters
    ----------
    alarms : pandas.DataFrame
        Alarms with ``x`` and ``y``, m.
    lanes : Lane, or mapping of Lane by name
        The lane, or lanes by name.
    name : str
        File of the alarms, for messages.

    Returns
    -------
    dict
        For the report: ``alarms_outside`` of the lane, if there are any.

    Raises
    ------
    ValueError
        If all alarms lie outside.
    """
    inside = are_near(alarms, lanes)
    outside = len(alarms) - int(inside.sum())
    if not outside:
        return {}
    if outside == len(alarms):
        x = alarms["x"]
        y = alarms["y"]
        raise ValueError(
            f"alarms must lie in the lane ({borders_in_words(as_lanes(lanes))}): all {outside} of {name} lie "
            f"outside, x {x.min():g} to {x.max():g}, y {y.min():g} to {y.max():g}; "
            f"{_other_axes(alarms, lanes, 0.0)}"
        )
    return {"alarms_outside": outside}


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
