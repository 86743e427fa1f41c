"""Which alarm belongs to which target and which are false (Wang et al. 2007, rules 1 to 5), if the tables fit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flgpr.model import Lane, as_lane, check_alarms, check_truth
from flgpr.scoring.area import union_area
from flgpr.scoring.places import Refraction

LaneLike = Lane | Mapping[str, Any] | pd.DataFrame | pd.Series
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Subset = Sequence[Any] | BoolArray | Mapping[str, Any] | Callable[[pd.DataFrame], Any] | str | None
# m; a table whose every point lies farther than this outside the lane belongs to another lane or
# frame
MARGIN = 10.0
_BORDERS = {"x_min", "x_max", "y_min", "y_max"}
_ENOUGH = 5  # points from which a table's shape says that its axes are swapped


def as_lanes(lane: LaneLike) -> dict[str, Lane]:
    """Take one lane or several, by name; a single nameless lane has the name "".

    A lane comes in any form :func:`flgpr.model.as_lane` takes; several as a mapping of names to
    lanes, or as a table with one lane per row named in the column ``lane``. No lane, a missing
    border or a repeated name is a ValueError.
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
            raise ValueError(
                f"{name} must have the column lane, for there are {len(known)} lanes: {', '.join(known)}"
            )
        return np.zeros(len(table), dtype=np.int64)
    named = table["lane"].fillna("").astype(str)
    if known == [""]:
        several = sorted(set(named))
        if len(several) > 1:
            raise ValueError(
                f"lane must be given by name, for {name} holds several lanes: {', '.join(several)}"
            )
        return np.zeros(len(table), dtype=np.int64)
    if len(known) == 1:
        named = named.where(named != "", known[0])
    strange = sorted(set(named) - set(known))
    if strange:
        raise ValueError(f"{name}.lane must be one of {', '.join(known)}; got {strange[0]!r}")
    return np.asarray(
        named.map({lane: number for number, lane in enumerate(known)}), dtype=np.int64
    )


def positions(table: pd.DataFrame) -> FloatArray:
    """Take the positions x, y, m, of a checked table's rows (row, 2)."""
    return np.stack([table["x"].to_numpy(), table["y"].to_numpy()], axis=-1)


def check_place(points: FloatArray, lane: Lane, name: str) -> None:
    """Refuse a table's points (row, 2) that cannot lie in this lane: another place or coordinate system, swapped axes.

    Single points outside the lane are fine (Wang et al. 2007, rule 4); a table that lies outside as
    a whole is not.
    """
    if len(points) == 0:
        return
    x, y = points.T
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
    across = lane.x_max - lane.x_min
    along = lane.y_max - lane.y_min
    if along < 2 * across:
        return False
    fits = lane.contains(x, y).mean()
    fits_swapped = lane.contains(y, x).mean()
    if fits_swapped < 0.9 or fits > 0.1:
        return False
    if known:
        # Nobody surveys a lane's targets more than its width beside it; alarms may well lie there.
        return bool((np.maximum(lane.x_min - x, x - lane.x_max) > across).mean() > 0.5)
    spread = len(x) >= _ENOUGH and np.ptp(x) > 2 * across and np.ptp(y) <= across
    return bool(spread)


def _likely_cause(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    if max(np.abs(x).max(), np.abs(y).max()) > 1e4:
        return (
            "are these map coordinates (UTM, or millimetres)? Lane coordinates in metres are needed"
        )
    if np.abs(x).max() <= 180 and np.abs(y).max() <= 90 and np.ptp(x) < 0.1 and np.ptp(y) < 0.1:
        return "are these degrees of longitude and latitude? Lane coordinates in metres are needed"
    return "is it the right lane?"


@dataclass(frozen=True)
class Match:
    """Alarms matched to targets; every score is a view of it."""

    #: alarms, truth: the checked tables, rows numbered from 0; targets where they are expected in
    #: the image
    alarms: pd.DataFrame
    truth: pd.DataFrame
    lanes: dict[str, Lane]  #: the scored lanes by name
    halo: float  #: halo radius, m
    #: alarm_lane, target_lane: (alarm,), (target,) position of each row's lane in ``lanes``
    alarm_lane: IntArray
    target_lane: IntArray
    #: pair_alarm, pair_target: (pair,) rows of every alarm and target that are within a halo of one
    #: another
    pair_alarm: IntArray
    pair_target: IntArray
    pair_distance: FloatArray  #: (pair,) their distance, m
    in_halo: BoolArray  #: (alarm,) alarms within the halo of any known target
    false: BoolArray  #: (alarm,) false alarms: in no halo and inside the lane (rule 3)
    refraction: Refraction | None = None  #: the correction that moved the targets

    @property
    def confidence(self) -> FloatArray:
        """Confidence of every alarm."""
        return self.alarms["confidence"].to_numpy()

    def lane_areas(self, area: Literal["union", "paper"] = "union") -> FloatArray:
        """Compute the area, m², that false alarms can stand on, lane by lane.

        It is the lane less the exact union of the halos clipped to it, or less N·π·r² (Wang et al.
        2007, rule 6), which can be negative.
        """
        points = positions(self.truth)
        areas = []
        for number, lane in enumerate(self.lanes.values()):
            own = points[self.target_lane == number]
            halos = (
                union_area(own, self.halo, lane)
                if area == "union"
                else len(own) * math.pi * self.halo**2
            )
            areas.append(lane.area - halos)
        return np.array(areas)

    def best(
        self, chosen: BoolArray | None = None, shared: Literal["drop", "count"] = "drop"
    ) -> tuple[Any, ...]:
        """Find each target's best alarm (rule 2): highest confidence, then the nearest, then the first in the table.

        An alarm in the halo of a chosen and of another target is disregarded (rule 5), or with
        ``shared="count"`` counts for the chosen one; with the assignment "nearest" it is in the
        halo of its nearest target only. Gives row (-1 for none), confidence (-inf) and distance (m;
        NaN).
        """
        targets = len(self.truth)
        keep = (
            np.ones(len(self.pair_alarm), dtype=bool)
            if chosen is None
            else chosen[self.pair_target]
        )
        if chosen is not None and shared == "drop":
            elsewhere = np.zeros(len(self.alarms), dtype=bool)
            elsewhere[self.pair_alarm[~keep]] = True
            keep &= ~elsewhere[self.pair_alarm]
        row = self.pair_alarm[keep]
        target = self.pair_target[keep]
        away = self.pair_distance[keep]
        order = np.lexsort((row, away, -self.confidence[row], target))
        first = order[np.unique(target[order], return_index=True)[1]]
        alarm = np.full(targets, -1, dtype=np.int64)
        distance = np.full(targets, np.nan)
        confidence = np.full(targets, -np.inf)
        alarm[target[first]] = row[first]
        distance[target[first]] = away[first]
        confidence[target[first]] = self.confidence[row[first]]
        return alarm, confidence, distance


def match(
    alarms: pd.DataFrame,
    truth: pd.DataFrame,
    lane: LaneLike,
    halo: float = 1.0,
    *,
    halo_as: Literal["radius", "diameter"] = "radius",
    assignment: Literal["halo", "nearest"] = "halo",
    refraction: Refraction | None = None,
) -> Match:
    """Match alarms to targets.

    Parameters
    ----------
    alarms, truth : DataFrame
        Tables as :mod:`flgpr.model` describes them. With several lanes both name theirs in the
        column ``lane``, and alarms meet only targets of their own lane.
    lane : Lane, mapping, Series or DataFrame
        The scored lane, or several, see :func:`as_lanes`.
    halo : float
        Halo size, m. An alarm at exactly this distance is within.
    halo_as : {"radius", "diameter"}
        Whether the halo is given as a radius (Wang et al. 2007) or a diameter (Fuse et al. 2018).
    assignment : {"halo", "nearest"}
        Whether an alarm within several halos can detect each of those targets (Wang et al. 2007,
        rules 1 and 2 to the letter), or only the nearest (as that paper labels training hits).
    refraction : Refraction, optional
        Move buried targets to where focusing on the surface shows them. Off by default, as in the
        papers.

    Raises
    ------
    ValueError
        If a table is not valid, does not lie in the lane, or an option is not one of those named.

    Examples
    --------
    >>> import pandas as pd
    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import assign, label_alarms, match
    >>> alarms = pd.DataFrame({"x": [0.2, 1.0, -1.1], "y": [10.3, 44.0, 30.1], "confidence": [3, 2, 1]})
    >>> truth = pd.DataFrame({"target_id": ["a", "b"], "x": [0.0, -1.0], "y": [10.0, 30.0], "kind": "metal"})
    >>> matched = match(alarms, truth.assign(depth=0.05), Lane(-2.0, 2.0, 0.0, 60.0), halo=1.0)
    >>> label_alarms(matched)["label"].tolist()
    ['detection', 'false', 'detection']
    >>> assign(matched)[["target_id", "rank", "distance"]].round(2)
      target_id  rank  distance
    0         a     1      0.36
    1         b     3      0.14
    """
    if not (isinstance(halo, int | float | np.number) and math.isfinite(halo) and halo > 0):
        raise ValueError(f"halo must be a positive number of metres, got {halo!r}")
    one_of("halo_as", halo_as, ("radius", "diameter"))
    one_of("assignment", assignment, ("halo", "nearest"))
    radius = float(halo) / (2 if halo_as == "diameter" else 1)
    alarms = check_alarms(alarms).reset_index(drop=True)
    truth = check_truth(truth).reset_index(drop=True)
    lanes = as_lanes(lane)
    alarm_lane = lane_of_rows(alarms, lanes, "alarms")
    target_lane = lane_of_rows(truth, lanes, "truth")
    inside = np.zeros(len(alarms), dtype=bool)
    at = positions(alarms)
    given = positions(truth)
    for number, one in enumerate(lanes.values()):
        check_place(at[alarm_lane == number], one, "alarms")
        check_place(given[target_lane == number], one, "truth")
    if refraction is not None:
        truth = refraction.move(truth)
    expected = positions(truth)
    pairs = []
    for number, one in enumerate(lanes.values()):
        own = np.flatnonzero(alarm_lane == number)
        known = np.flatnonzero(target_lane == number)
        here = at[own]
        there = expected[known]
        inside[own] = one.contains(here[:, 0], here[:, 1])
        row, target, distance = pairs_within(here, there, radius)
        pairs.append((own[row], known[target], distance))
    row, target, distance = (np.concatenate(column) for column in zip(*pairs, strict=True))
    in_halo = np.zeros(len(alarms), dtype=bool)
    in_halo[row] = True
    if assignment == "nearest":
        order = np.lexsort((target, distance, row))
        keep = order[np.unique(row[order], return_index=True)[1]]
        row = row[keep]
        target = target[keep]
        distance = distance[keep]
    false = inside & ~in_halo
    return Match(
        alarms,
        truth,
        lanes,
        radius,
        alarm_lane,
        target_lane,
        row,
        target,
        distance,
        in_halo,
        false,
        refraction,
    )


def pairs_within(
    here: FloatArray, there: FloatArray, radius: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """List the pairs (first, second, distance) of points of two sets within a radius, its border included, m."""
    if len(here) == 0 or len(there) == 0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(0)
    # The tree rounds differently on the border: let it find a little too much, then decide by the
    # plain formula.
    near = cKDTree(here).sparse_distance_matrix(
        cKDTree(there), radius * (1 + 1e-6) + 1e-9, output_type="ndarray"
    )
    first = near["i"].astype(np.int64)
    second = near["j"].astype(np.int64)
    distance = np.hypot(here[first, 0] - there[second, 0], here[first, 1] - there[second, 1])
    keep = distance <= radius
    return first[keep], second[keep], distance[keep]


def select_targets(truth: pd.DataFrame, subset: Subset) -> BoolArray:
    """Tell which targets of a truth table a subset names, as a boolean per row.

    ``None``: all. A ``target_id`` or a sequence of them. A mapping of columns to a value, a list of
    values or a predicate of the column, all of which must hold, e.g. ``{"kind": "metal", "depth":
    lambda d: d > 0.05}``. A predicate of the table that gives one truth value per row. A boolean
    array with one value per row. A column or id that is not there, or no target of a table that has
    some, is a ValueError.
    """
    if subset is None:
        return np.ones(len(truth), dtype=bool)
    if isinstance(subset, Mapping):
        chosen = np.ones(len(truth), dtype=bool)
        for name, wanted in subset.items():
            if name not in truth.columns:
                raise ValueError(
                    f"subset must name columns of truth, got {name!r}; there are {', '.join(truth.columns)}"
                )
            chosen &= _rows_with(truth[name], wanted)
    elif callable(subset):
        chosen = _as_mask(subset(truth), len(truth))
    elif isinstance(subset, str):
        chosen = _by_id(truth, [subset])
    else:
        values = np.asarray(subset)
        chosen = (
            _as_mask(values, len(truth)) if values.dtype == bool else _by_id(truth, list(subset))
        )
    if len(truth) and not chosen.any():
        kinds = ", ".join(sorted(map(str, truth["kind"].unique())))
        raise ValueError(
            f"subset must select at least one target, got {subset!r} of {len(truth)} targets ({kinds})"
        )
    return chosen


def _rows_with(column: pd.Series[Any], wanted: Any) -> BoolArray:
    if callable(wanted):
        return _as_mask(wanted(column), len(column))
    values = (
        list(wanted)
        if isinstance(wanted, list | tuple | set | frozenset | np.ndarray | pd.Series)
        else [wanted]
    )
    return column.isin(values).to_numpy(dtype=bool)


def _as_mask(values: Any, length: int) -> BoolArray:
    mask = np.asarray(values)
    if mask.shape != (length,) or mask.dtype != bool:
        raise ValueError(
            f"subset must give one truth value per target ({length}), got {mask.dtype} {mask.shape}"
        )
    return mask


def _by_id(truth: pd.DataFrame, wanted: list[Any]) -> BoolArray:
    unknown = [name for name in wanted if name not in set(truth["target_id"])]
    if unknown:
        raise ValueError(
            f"subset must name target_id of truth, got {unknown[0]!r} ({len(unknown)} unknown)"
        )
    return truth["target_id"].isin(wanted).to_numpy(dtype=bool)


def one_of(name: str, value: Any, allowed: tuple[Any, ...]) -> None:
    """Refuse an option that is none of those allowed."""
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {value!r}")
