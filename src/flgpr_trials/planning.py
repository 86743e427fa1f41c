"""Planning of a test: how many mines, how much ground, and where the mines go."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from numbers import Real

import numpy as np
import pandas as pd
from scipy import special

from flgpr.model import Lane
from flgpr.scoring.matching import LaneLike, as_lanes
from flgpr.types import FloatArray, IntArray, floats

_MOST = 100_000
_MOST_MINES = 10**12
_TRIES = 2_000


@dataclass(frozen=True)
class SamplePlan:
    """Size of a test that can show a Pd and a FAR."""

    #: mines, misses: mines to emplace and misses that may happen
    mines: int
    misses: int
    area: float  #: ground to score outside the halos, m²
    false_alarms: int  #: false alarms that may happen on it
    #: pd_power, far_power: probability that a detector as good as assumed passes each
    pd_power: float
    far_power: float


def sample_size(
    pd: float = 0.9,
    far: float = 0.01,
    confidence: float = 0.95,
    *,
    true_pd: float | None = None,
    true_far: float | None = None,
    power: float = 0.8,
    joint: bool = False,
) -> SamplePlan:
    """Compute how many mines and how much ground show Pd >= pd at FAR <= far.

    A claim is shown when its exact one-sided bound (Clopper-Pearson, Poisson) meets it. Without an
    assumption on the detector the plan is the smallest: no miss and no false alarm may happen.

    Parameters
    ----------
    pd, far : float
        What is to be shown; far per m².
    confidence : float
        Confidence of each claim.
    true_pd, true_far : float, optional
        What the detector is assumed to reach; better than what is to be shown.
    power : float
        Probability with which such a detector shall pass each claim.
    joint : bool
        Whether both claims together shall have the confidence (Bonferroni).

    Returns
    -------
    SamplePlan
        Mines and ground, and what may happen on them.

    Raises
    ------
    ValueError
        If a value is out of range, or the assumption is too close to what is to be shown.

    Examples
    --------
    >>> from flgpr.trials import sample_size
    >>> plan = sample_size(0.9, 0.01, 0.95, true_pd=0.96, true_far=0.005)
    >>> plan.mines, round(plan.area)
    (116, 1944)
    """
    _check_open(pd=pd, confidence=confidence, power=power)
    if not (math.isfinite(far) and far > 0):
        raise ValueError(f"far must be positive, got {far}")
    if true_pd is not None and not pd < true_pd <= 1:
        raise ValueError(f"true_pd must be above pd = {pd} and at most 1, got {true_pd}")
    if true_far is not None and not 0 <= true_far < far:
        raise ValueError(f"true_far must be under far = {far}, got {true_far}")
    confidence_of_each = (1 + confidence) / 2 if joint else confidence
    least_mines = partial(mines_needed, pd, confidence=confidence_of_each)
    least_area = partial(area_needed, far, confidence=confidence_of_each)
    misses, pd_power = 0, math.nan
    if true_pd is not None:
        misses, pd_power = _fewest(
            lambda count: _at_most(count, least_mines(count), 1 - true_pd),
            power,
            f"true_pd must be further above pd = {pd}, got {true_pd}: it takes over {_MOST} misses",
        )
    false_alarms, far_power = 0, math.nan
    if true_far is not None:
        false_alarms, far_power = _fewest(
            lambda count: float(special.pdtr(count, true_far * least_area(count))),
            power,
            f"true_far must be further under far = {far}, got {true_far}: "
            f"over {_MOST} false alarms",
        )
    mines, area = least_mines(misses), least_area(false_alarms)
    return SamplePlan(mines, misses, area, false_alarms, pd_power, far_power)


def _fewest(power_of: Callable[[int], float], power: float, too_close: str) -> tuple[int, float]:
    """Return how many failures must be allowed for a power, and the power then.

    A ValueError says that it takes too many.
    """
    for count in range(_MOST):
        reached = power_of(count)
        if reached >= power:
            return count, reached
    raise ValueError(too_close)


def mines_needed(pd: float, misses: int, confidence: float = 0.95) -> int:
    """Compute the least number of mines among which so many misses still show a Pd.

    The bound is the one-sided one of Clopper and Pearson.

    Parameters
    ----------
    pd : float
        What is to be shown.
    misses : int
        Mines that are not found.
    confidence : float
        Confidence of the claim.

    Returns
    -------
    int
        Number of mines.

    Raises
    ------
    ValueError
        If a value is out of range.

    Examples
    --------
    >>> from flgpr.trials import mines_needed
    >>> [mines_needed(0.9, misses) for misses in (0, 1, 2)]
    [29, 46, 61]
    """
    _check_open(pd=pd, confidence=confidence)
    if misses < 0:
        raise ValueError(f"misses must not be negative, got {misses}")
    numbers = range(misses + 1, _MOST_MINES)
    is_shown = bisect_left(
        numbers, True, key=lambda mines: _at_most(misses, mines, 1 - pd) <= 1 - confidence
    )
    if is_shown == len(numbers):
        raise ValueError(
            f"pd must be so low that at most {_MOST_MINES:.0e} mines show it, got {pd}"
        )
    return numbers[is_shown]


def area_needed(far: float, false_alarms: int, confidence: float = 0.95) -> float:
    """Compute the least area on which so many false alarms still show a FAR.

    The bound is the one-sided one of a Poisson rate.

    Parameters
    ----------
    far : float
        What is to be shown, per m².
    false_alarms : int
        Number of false alarms.
    confidence : float
        Confidence of the claim.

    Returns
    -------
    float
        The area, m².

    Raises
    ------
    ValueError
        If a value is out of range.

    Examples
    --------
    >>> from flgpr.trials import area_needed
    >>> [round(area_needed(0.01, count)) for count in (0, 1, 2)]  # m²
    [300, 474, 630]
    """
    _check_open(confidence=confidence)
    if not (math.isfinite(far) and far > 0 and false_alarms >= 0):
        raise ValueError(
            f"far must be positive and false_alarms not negative, got {far} and {false_alarms}"
        )
    area = float(special.gammaincinv(false_alarms + 1, confidence)) / float(far)
    if math.isinf(area):
        raise ValueError(f"far must be so high that a finite area shows it, got {far}")
    return area


def emplacement_plan(
    lane: LaneLike, targets: pd.DataFrame, seed: int, *, spacing: float = 3.0, edge: float = 0.5
) -> pd.DataFrame:
    """Draw a randomised plan of where targets go.

    It is uniform over all ground that spacing and edge leave.

    Parameters
    ----------
    lane : Lane, mapping, Series or DataFrame
        The lane or lanes; a target goes to a lane with a chance by its area.
    targets : DataFrame
        One row per sort: ``kind``, ``depth`` (m), ``count``; further columns (soil, radius, ...)
        are copied.
    seed : int
        The same seed gives the same plan.
    spacing, edge : float
        Least distance between two targets, and to the lane's border, m. At a spacing of twice the
        halo radius or more no halos overlap.

    Returns
    -------
    DataFrame
        Truth table: ``target_id``, ``x`` and ``y`` in whole millimetres, ``kind``, ``depth``,
        further columns, ``lane`` if the lanes have names; ordered by lane and y. ``attrs`` hold
        seed, spacing and edge.

    Raises
    ------
    ValueError
        If the targets, the lane or a distance is not valid, or the targets do not fit into the
        lane.
    """
    counts = _check_targets(targets)
    if not (spacing >= 0 and edge >= 0):
        raise ValueError(f"spacing and edge must not be negative, got {spacing} m and {edge} m")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    lanes = as_lanes(lane)
    rng = np.random.default_rng(seed)
    rows = targets.loc[targets.index.repeat(counts)].drop(columns="count").reset_index(drop=True)
    names, points = _draw_points(lanes, len(rows), spacing, edge, rng)
    plan = rows.iloc[rng.permutation(len(rows))].reset_index(drop=True)
    plan = plan.assign(x=points[:, 0], y=points[:, 1])
    if list(lanes) != [""]:
        plan["lane"] = names
    order = ["lane", "y"] if "lane" in plan.columns else ["y"]
    plan = plan.sort_values(order).reset_index(drop=True)
    width = len(str(len(plan)))
    plan.insert(0, "target_id", [f"T{number + 1:0{width}d}" for number in range(len(plan))])
    plan.attrs = {"seed": int(seed), "spacing": float(spacing), "edge": float(edge)}
    return plan


def _check_targets(targets: pd.DataFrame) -> IntArray:
    """Check the table of sorts of targets, and return their counts."""
    missing = [name for name in ("kind", "depth", "count") if name not in targets.columns]
    if missing:
        raise ValueError(
            f"targets must have the columns kind, depth, count; missing: {', '.join(missing)}"
        )
    taken = [name for name in ("target_id", "x", "y", "lane", "book") if name in targets.columns]
    if taken:
        raise ValueError(
            f"targets must not have columns that are drawn here, got {', '.join(taken)}"
        )
    counts = floats(pd.to_numeric(targets["count"], errors="coerce"))
    if len(counts) == 0 or not ((counts >= 1) & (counts == np.floor(counts))).all():
        raise ValueError(f"targets.count must be whole and positive, got {counts.tolist()}")
    if counts.sum() > _MOST:
        raise ValueError(
            f"targets.count must come to at most {_MOST} targets, got {counts.sum():g}"
        )
    for depth in targets["depth"]:
        if not isinstance(depth, Real) or not math.isfinite(depth):
            raise ValueError(f"targets.depth must be finite numbers (m), got {depth!r}")
    for kind in targets["kind"]:
        if not isinstance(kind, str) or not kind.strip():
            raise ValueError(f"targets.kind must say what each target is, got {kind!r}")
    return np.asarray(counts.astype(np.int64))


def _check_open(**probabilities: float) -> None:
    """Refuse a probability that does not lie between 0 and 1."""
    for name, value in probabilities.items():
        if not 0 < value < 1:
            raise ValueError(f"{name} must lie between 0 and 1, got {value}")


def _at_most(count: int, trials: int, chance: float) -> float:
    """Compute the binomial probability of so many successes or fewer.

    It is called often, and the incomplete beta function is much faster than a distribution object.
    """
    if count >= trials:
        return 1.0
    return float(special.betainc(trials - count, count + 1, 1 - chance))


def _draw_points(
    lanes: dict[str, Lane], count: int, spacing: float, edge: float, rng: np.random.Generator
) -> tuple[list[str], FloatArray]:
    """Draw points one after the other, and draw again those too close to an earlier one.

    Returned are the lane of each point, and the points (target, 2), m.
    """
    names = list(lanes)
    corners = []
    sizes = []
    for lane in lanes.values():
        corners.append(np.array([lane.x_min, lane.y_min]) + edge)
        sizes.append((lane.x_max - lane.x_min - 2 * edge, lane.y_max - lane.y_min - 2 * edge))
    areas = np.array([max(0.0, width) * max(0.0, length) for width, length in sizes])
    if not areas.sum() > 0:
        raise ValueError(f"edge must leave ground in the lane, got {edge} m")
    points = np.full((count, 2), math.nan)
    lane_of_point = np.full(count, -1)
    for number in range(count):
        for _ in range(_TRIES):
            chosen = int(rng.choice(len(names), p=areas / areas.sum()))
            corner = corners[chosen]
            size = sizes[chosen]
            rounded = np.round(corner + rng.uniform(size=2) * size, 3)
            point = np.clip(rounded, corner, corner + size)
            in_same_lane = points[:number][lane_of_point[:number] == chosen]
            if len(in_same_lane) == 0:
                break
            if np.hypot(*(in_same_lane - point).T).min() >= spacing:
                break
        else:
            raise ValueError(
                f"targets must fit into the lane with spacing {spacing:g} m and edge {edge:g} m; "
                f"found room for {number} of {count}"
            )
        points[number] = point
        lane_of_point[number] = chosen
    return [names[chosen] for chosen in lane_of_point], points
