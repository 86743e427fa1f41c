"""Matching of alarms to targets (Wang et al. 2007, rules 1 to 5), and checks that tables fit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from flgpr.model import Lane, as_lane, check_alarms, check_truth
from flgpr.scoring.area import union_area
from flgpr.scoring.places import Refraction
from flgpr.types import BoolArray, FloatArray, IntArray

LaneLike = Lane | Mapping[str, Any] | pd.DataFrame | pd.Series
Subset = Sequence[Any] | BoolArray | Mapping[str, Any] | Callable[[pd.DataFrame], Any] | str | None
MARGIN = 10.0
"""Distance outside the lane beyond which no table lies as a whole, unless it is of another, m."""
_BORDERS = {"x_min", "x_max", "y_min", "y_max"}
_ENOUGH = 5  # points from which a table's shape says that its axes are swapped


def as_lanes(lane: LaneLike) -> dict[str, Lane]:
    """Return the scored lanes by name; a single nameless lane has the name "".

    Parameters
    ----------
    lane : Lane, mapping, Series or DataFrame
        One lane in any form of :func:`flgpr.model.as_lane`; or several, as a mapping of names to
        lanes, or as a table with one lane per row, named in the column ``lane``.

    Returns
    -------
    dict of str to Lane
        The lanes.

    Raises
    ------
    ValueError
        If there is no lane, a border is missing or a name is repeated.
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


def lane_of_rows(table: pd.DataFrame, lanes: Mapping[str, Lane], name: str) -> IntArray:
    """Return the number of the lane in which each row of a table lies.

    Errors call the table ``name``.
    """
    known = list(lanes)
    if "lane" not in table.columns:
        if len(known) > 1:
            raise ValueError(
                f"{name} must have the column lane, for there are {len(known)} lanes: "
                f"{', '.join(known)}"
            )
        return np.zeros(len(table), dtype=np.int64)
    if known == [""]:
        lane_names = table["lane"].fillna("").astype(str)
        distinct = sorted(set(lane_names))
        if len(distinct) > 1:
            raise ValueError(
                f"lane must be given by name, for {name} holds several lanes: {', '.join(distinct)}"
            )
        return np.zeros(len(table), dtype=np.int64)
    lane_names = stated_lanes(table, known, name)
    strange = sorted(set(lane_names) - set(known))
    if strange:
        raise ValueError(f"{name}.lane must be one of {', '.join(known)}; got {strange[0]!r}")
    return np.asarray(pd.Index(known).get_indexer(pd.Index(lane_names)), dtype=np.int64)


def stated_lanes(table: pd.DataFrame, known: Sequence[str], name: str) -> pd.Series[str]:
    """Return the name of every row's lane; of a single one, where a row states none.

    Of several lanes every row must state its own, else it is a ValueError that calls the table
    ``name``.
    """
    lane_names = table["lane"].fillna("").astype(str)
    if len(known) == 1:
        return lane_names.where(lane_names != "", known[0])
    nowhere = np.flatnonzero(lane_names == "")
    if nowhere.size:
        raise ValueError(
            f"{name}.lane must name the lane in every row, for there are {len(known)}: "
            f"{', '.join(known)}; got none in row {nowhere[0] + 1} below the header "
            f"({nowhere.size} such rows)"
        )
    return lane_names


def positions(table: pd.DataFrame) -> FloatArray:
    """Return the positions x, y, m, of a checked table's rows (row, 2)."""
    return np.stack([table["x"].to_numpy(), table["y"].to_numpy()], axis=-1)


def check_place(points: FloatArray, lane: Lane, name: str) -> None:
    """Refuse points (row, 2) of a table that cannot lie in this lane.

    They may belong to another lane or coordinate system, or have swapped axes. Single points
    outside the lane are fine (Wang et al. 2007, rule 4); a table that lies outside as a whole is
    not.
    """
    if len(points) == 0:
        return
    x, y = points.T
    borders = f"x {lane.x_min:g}..{lane.x_max:g} m, y {lane.y_min:g}..{lane.y_max:g} m"
    extent = f"x {x.min():g}..{x.max():g}, y {y.min():g}..{y.max():g}"
    if _swapped(x, y, lane, known=name == "truth"):
        raise ValueError(
            f"{name} must have x across and y along the lane ({borders}), got {extent}: "
            "are the axes swapped?"
        )
    if lane.distance(x, y).min() > MARGIN:
        raise ValueError(
            f"{name} must lie in or near the lane ({borders}), got {extent}, "
            f"all more than {MARGIN:g} m outside: {_likely_cause(x, y)}"
        )


def _swapped(x: FloatArray, y: FloatArray, lane: Lane, known: bool) -> bool:
    """Return whether the axes of points are likely swapped; ``known`` are surveyed targets."""
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
    if len(x) < _ENOUGH:
        return False
    return bool(np.ptp(x) > 2 * across and np.ptp(y) <= across)


def _likely_cause(x: FloatArray, y: FloatArray) -> str:
    """Return a question that points to why a table lies outside the lane."""
    if max(np.abs(x).max(), np.abs(y).max()) > 1e4:
        return (
            "are these map coordinates (UTM, or millimetres)? Lane coordinates in metres are needed"
        )
    may_be_degrees = np.abs(x).max() <= 180 and np.abs(y).max() <= 90
    if may_be_degrees and np.ptp(x) < 0.1 and np.ptp(y) < 0.1:
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
        """Compute the area of each lane that false alarms can stand on.

        Parameters
        ----------
        area : {"union", "paper"}
            Lane less the exact union of the halos clipped to it; or lane less N·π·r² (Wang et al.
            2007, rule 6), which can be negative.

        Returns
        -------
        (lane,) ndarray
            Areas, m².
        """
        points = positions(self.truth)
        areas = []
        for number, lane in enumerate(self.lanes.values()):
            targets = points[self.target_lane == number]
            discs = len(targets) * math.pi * self.halo**2
            halos = union_area(targets, self.halo, lane) if area == "union" else discs
            areas.append(lane.area - halos)
        return np.array(areas)

    def best(
        self, chosen: BoolArray | None = None, shared: Literal["drop", "count"] = "drop"
    ) -> tuple[Any, ...]:
        """Find each target's best alarm (Wang et al. 2007, rule 2).

        It has the highest confidence, then the least distance, then the first row in the table. An
        alarm in the halo of a chosen and of another target is disregarded (rule 5), or with
        ``shared="count"`` counts for the chosen one. With the assignment "nearest" it is in the
        halo of its nearest target only.

        Parameters
        ----------
        chosen : (target,) ndarray of bool, optional
            Targets to score; all by default.
        shared : {"drop", "count"}
            What becomes of an alarm that two targets share, of which one is not chosen.

        Returns
        -------
        alarm, confidence, distance : (target,) ndarray
            Row of the alarm (-1 for none), its confidence (-inf) and its distance, m (NaN).
        """
        targets = len(self.truth)
        if chosen is None:
            counts = np.ones(len(self.pair_alarm), dtype=bool)
        else:
            counts = chosen[self.pair_target]
            if shared == "drop":
                in_other_halo = np.zeros(len(self.alarms), dtype=bool)
                in_other_halo[self.pair_alarm[~counts]] = True
                counts &= ~in_other_halo[self.pair_alarm]
        row = self.pair_alarm[counts]
        target = self.pair_target[counts]
        pair_distance = self.pair_distance[counts]
        best = first_of_each(target, -self.confidence[row], pair_distance, row)
        alarm = np.full(targets, -1, dtype=np.int64)
        distance = np.full(targets, np.nan)
        confidence = np.full(targets, -np.inf)
        alarm[target[best]] = row[best]
        distance[target[best]] = pair_distance[best]
        confidence[target[best]] = self.confidence[row[best]]
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

    Returns
    -------
    Match
        Alarms and targets, and which lie within a halo of one another.

    Raises
    ------
    ValueError
        If a table is not valid, does not lie in the lane, or an option is not one of those named.

    Examples
    --------
    >>> import pandas as pd
    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import assign, label_alarms, match
    >>> alarms = pd.DataFrame({"x": [0.2, 1.0, -1.1], "y": [10.3, 44.0, 30.1]})
    >>> alarms["confidence"] = [3, 2, 1]
    >>> truth = pd.DataFrame({"target_id": ["a", "b"], "x": [0.0, -1.0], "y": [10.0, 30.0]})
    >>> truth = truth.assign(kind="metal", depth=0.05)
    >>> matched = match(alarms, truth, Lane(-2.0, 2.0, 0.0, 60.0), halo=1.0)
    >>> label_alarms(matched)["label"].tolist()
    ['detection', 'false', 'detection']
    >>> assign(matched)[["target_id", "rank", "distance"]].round(2)
      target_id  rank  distance
    0         a     1      0.36
    1         b     3      0.14
    """
    radius = _halo_radius(halo, halo_as)
    one_of("assignment", assignment, ("halo", "nearest"))
    alarms = check_alarms(alarms).reset_index(drop=True)
    truth = check_truth(truth).reset_index(drop=True)
    lanes = as_lanes(lane)
    if list(lanes) == [""] and "lane" in alarms.columns and "lane" in truth.columns:
        named = [set(table["lane"].dropna().astype(str)) - {""} for table in (alarms, truth)]
        if all(named) and not named[0] & named[1]:
            lies = " and ".join(", ".join(sorted(names)) for names in named)
            raise ValueError(
                f"alarms and truth must be of one lane, got {lies}: is it the right truth?"
            )
    alarm_lane = lane_of_rows(alarms, lanes, "alarms")
    target_lane = lane_of_rows(truth, lanes, "truth")
    alarm_points = positions(alarms)
    surveyed = positions(truth)
    for number, scored_lane in enumerate(lanes.values()):
        check_place(alarm_points[alarm_lane == number], scored_lane, "alarms")
        check_place(surveyed[target_lane == number], scored_lane, "truth")
    if refraction is not None:
        truth = refraction.move(truth)
    expected = positions(truth)

    inside = np.zeros(len(alarms), dtype=bool)
    pairs = []
    for number, scored_lane in enumerate(lanes.values()):
        alarm_rows = np.flatnonzero(alarm_lane == number)
        target_rows = np.flatnonzero(target_lane == number)
        points = alarm_points[alarm_rows]
        inside[alarm_rows] = scored_lane.contains(*points.T)
        first, second, lengths = pairs_within(points, expected[target_rows], radius)
        pairs.append((alarm_rows[first], target_rows[second], lengths))
    alarm, target, distance = (np.concatenate(column) for column in zip(*pairs, strict=True))

    # An alarm in any halo is not false, also where it detects the nearest target alone.
    in_halo = np.zeros(len(alarms), dtype=bool)
    in_halo[alarm] = True
    if assignment == "nearest":
        nearest = first_of_each(alarm, distance, target)
        alarm = alarm[nearest]
        target = target[nearest]
        distance = distance[nearest]
    return Match(
        alarms=alarms,
        truth=truth,
        lanes=lanes,
        halo=radius,
        alarm_lane=alarm_lane,
        target_lane=target_lane,
        pair_alarm=alarm,
        pair_target=target,
        pair_distance=distance,
        in_halo=in_halo,
        false=inside & ~in_halo,
        refraction=refraction,
    )


def _halo_radius(halo: float, halo_as: str) -> float:
    """Return the radius of a halo, m, that is given as a radius or a diameter."""
    if not (isinstance(halo, int | float | np.number) and math.isfinite(halo) and halo > 0):
        raise ValueError(f"halo must be a positive number of metres, got {halo!r}")
    one_of("halo_as", halo_as, ("radius", "diameter"))
    return float(halo) / (2 if halo_as == "diameter" else 1)


def first_of_each(group: IntArray, *keys: FloatArray | IntArray) -> IntArray:
    """Return the row of each group that comes first by its keys, of which the foremost decides."""
    order = np.lexsort((*reversed(keys), group))
    _, first = np.unique(group[order], return_index=True)
    return np.asarray(order[first])


def pairs_within(
    first_points: FloatArray, second_points: FloatArray, radius: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the pairs of points of two sets that lie within a radius, its border included.

    Parameters
    ----------
    first_points, second_points : (n, 2), (m, 2) ndarray
        Points, m.
    radius : float
        Radius, m.

    Returns
    -------
    first, second : (pair,) ndarray of int
        Rows of the first and of the second set.
    distance : (pair,) ndarray
        Distance of the two, m.
    """
    if len(first_points) == 0 or len(second_points) == 0:
        no_rows = np.zeros(0, dtype=np.int64)
        return no_rows, no_rows, np.zeros(0)
    # The tree rounds differently on the border: let it find a little too much, then decide by the
    # plain formula.
    a_little_more = radius * (1 + 1e-6) + 1e-9
    candidates = cKDTree(first_points).sparse_distance_matrix(
        cKDTree(second_points), a_little_more, output_type="ndarray"
    )
    first = candidates["i"].astype(np.int64)
    second = candidates["j"].astype(np.int64)
    step = first_points[first] - second_points[second]
    distance = np.hypot(step[:, 0], step[:, 1])
    within = distance <= radius
    return first[within], second[within], distance[within]


def select_targets(truth: pd.DataFrame, subset: Subset) -> BoolArray:
    """Return which targets of a truth table a subset selects.

    Parameters
    ----------
    truth : DataFrame
        Checked truth table.
    subset : None, str, sequence, mapping or callable
        None selects all targets, a ``target_id`` or a sequence of them those. A mapping of columns
        selects rows with a value, one of a list of values, or for which a predicate of the column
        is true; all conditions must hold, e.g. ``{"kind": "metal", "depth": lambda d: d > 0.05}``.
        A predicate of the table, or a boolean array, gives one truth value per row.

    Returns
    -------
    (target,) ndarray of bool
        Whether each target is selected.

    Raises
    ------
    ValueError
        If a column or id does not exist, or no target of a table that has some is selected.
    """
    if subset is None:
        return np.ones(len(truth), dtype=bool)
    if isinstance(subset, Mapping):
        chosen = np.ones(len(truth), dtype=bool)
        for name, condition in subset.items():
            if name not in truth.columns:
                raise ValueError(
                    f"subset must name columns of truth, got {name!r}; "
                    f"there are {', '.join(truth.columns)}"
                )
            chosen &= _rows_with(truth[name], condition)
    elif callable(subset):
        chosen = _as_mask(subset(truth), len(truth))
    elif isinstance(subset, str):
        chosen = _by_id(truth, [subset])
    else:
        values = np.asarray(subset)
        is_mask = values.dtype == bool
        chosen = _as_mask(values, len(truth)) if is_mask else _by_id(truth, list(subset))
    if len(truth) and not chosen.any():
        kinds = ", ".join(sorted(map(str, truth["kind"].unique())))
        raise ValueError(
            f"subset must select at least one target, "
            f"got {subset!r} of {len(truth)} targets ({kinds})"
        )
    return chosen


def _rows_with(column: pd.Series[Any], condition: Any) -> BoolArray:
    """Return which cells of a column are a value, one of several, or satisfy a predicate."""
    if callable(condition):
        return _as_mask(condition(column), len(column))
    is_list = isinstance(condition, list | tuple | set | frozenset | np.ndarray | pd.Series)
    values = list(condition) if is_list else [condition]
    return column.isin(values).to_numpy(dtype=bool)


def _as_mask(values: Any, length: int) -> BoolArray:
    """Return truth values, one per target, as an array."""
    mask = np.asarray(values)
    if mask.shape != (length,) or mask.dtype != bool:
        raise ValueError(
            f"subset must give one truth value per target ({length}), got {mask.dtype} {mask.shape}"
        )
    return mask


def _by_id(truth: pd.DataFrame, ids: list[Any]) -> BoolArray:
    """Return which targets have one of these ids, all of which must exist."""
    known = set(truth["target_id"])
    unknown = [name for name in ids if name not in known]
    if unknown:
        raise ValueError(
            f"subset must name target_id of truth, got {unknown[0]!r} ({len(unknown)} unknown)"
        )
    return truth["target_id"].isin(ids).to_numpy(dtype=bool)


def one_of(name: str, value: Any, allowed: tuple[Any, ...]) -> None:
    """Refuse an option that is none of those allowed."""
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {value!r}")
