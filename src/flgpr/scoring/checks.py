"""Do the tables, the lane and each other's coordinates fit together? Clear errors where they do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.model import Lane, as_lane

LaneLike = Lane | Mapping[str, Any] | pd.DataFrame | pd.Series
MARGIN = 10.0  # m; a table whose every point lies farther than this outside the lane belongs to another lane or frame
_BORDERS = {"x_min", "x_max", "y_min", "y_max"}
_ENOUGH = 5  # points from which a table's shape says that its axes are swapped


def as_lanes(lane: LaneLike) -> dict[str, Lane]:
    """Take one lane or several, by name; a single nameless lane has the name "".

    A lane comes in any form :func:`flgpr.model.as_lane` takes; several as a mapping of names to lanes, or as a table
    with one lane per row named in the column ``lane``. No lane, a missing border or a repeated name is a ValueError.
    """
    if isinstance(lane, pd.DataFrame):
        if len(lane) == 0:
            raise ValueError("lane must hold at least one lane, got an empty table")
        if "lane" not in lane.columns:
            return {"": as_lane(lane)}
        names = [str(name) for name in lane["lane"]]
        if len(set(names)) < len(names):
            raise ValueError(f"lane must name every lane once, got {', '.join(names)}")
        return {name: as_lane(lane.iloc[[row]]) for row, name in enumerate(names)}
    if isinstance(lane, Mapping) and not _BORDERS & set(lane):
        if not lane:
            raise ValueError("lane must hold at least one lane, got an empty mapping")
        return {str(name): as_lane(value) for name, value in lane.items()}
    return {"": as_lane(lane)}


def lane_of_rows(table: pd.DataFrame, lanes: Mapping[str, Lane], name: str) -> NDArray[np.int64]:
    """Tell in which of the lanes, by position, each row lies; ``name`` is what errors call the table."""
    known = list(lanes)
    if "lane" not in table.columns:
        if len(known) > 1:
            raise ValueError(f"{name} must have the column lane, for there are {len(known)} lanes: {', '.join(known)}")
        return np.zeros(len(table), dtype=np.int64)
    named = table["lane"].fillna("").astype(str)
    if known == [""]:
        several = sorted(set(named))
        if len(several) > 1:
            raise ValueError(f"lane must be given by name, for {name} holds several lanes: {', '.join(several)}")
        return np.zeros(len(table), dtype=np.int64)
    if len(known) == 1:
        named = named.where(named != "", known[0])
    strange = sorted(set(named) - set(known))
    if strange:
        raise ValueError(f"{name}.lane must be one of {', '.join(known)}; got {strange[0]!r}")
    return np.asarray(named.map({lane: number for number, lane in enumerate(known)}), dtype=np.int64)


def check_place(table: pd.DataFrame, lane: Lane, name: str) -> None:
    """Refuse a table that cannot lie in this lane: another place, another coordinate system, swapped axes.

    Single points outside the lane are fine (Wang et al. 2007, rule 4); a table that lies outside as a whole is not.
    """
    if len(table) == 0:
        return
    x, y = table["x"].to_numpy(), table["y"].to_numpy()
    borders = f"x {lane.x_min:g}..{lane.x_max:g} m, y {lane.y_min:g}..{lane.y_max:g} m"
    extent = f"x {x.min():g}..{x.max():g}, y {y.min():g}..{y.max():g}"
    if _swapped(x, y, lane, known=name == "truth"):
        raise ValueError(
            f"{name} must have x across and y along the lane ({borders}), got {extent}: are the axes swapped?"
        )
    away = np.hypot(
        np.maximum(np.maximum(lane.x_min - x, x - lane.x_max), 0),
        np.maximum(np.maximum(lane.y_min - y, y - lane.y_max), 0),
    )
    if away.min() > MARGIN:
        raise ValueError(
            f"{name} must lie in or near the lane ({borders}), got {extent}, all more than {MARGIN:g} m outside: "
            f"{_likely_cause(x, y)}"
        )


def _swapped(x: NDArray[np.float64], y: NDArray[np.float64], lane: Lane, known: bool) -> bool:
    across, along = lane.x_max - lane.x_min, lane.y_max - lane.y_min
    if along < 2 * across:
        return False
    fits, fits_swapped = lane.contains(x, y).mean(), lane.contains(y, x).mean()
    if fits_swapped < 0.9 or fits > 0.1:
        return False
    if known:
        # Nobody surveys a lane's targets more than its width beside it; alarms may well lie there.
        return bool((np.maximum(lane.x_min - x, x - lane.x_max) > across).mean() > 0.5)
    spread = len(x) >= _ENOUGH and np.ptp(x) > 2 * across and np.ptp(y) <= across
    return bool(spread)


def _likely_cause(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    if max(np.abs(x).max(), np.abs(y).max()) > 1e4:
        return "are these map coordinates (UTM, or millimetres)? Lane coordinates in metres are needed"
    if np.abs(x).max() <= 180 and np.abs(y).max() <= 90 and np.ptp(x) < 0.1 and np.ptp(y) < 0.1:
        return "are these degrees of longitude and latitude? Lane coordinates in metres are needed"
    return "is it the right lane?"
