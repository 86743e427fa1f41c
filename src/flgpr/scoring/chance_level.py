"""Chance level of Pd: what alarms find that know nothing of the targets.

A lane full of alarms finds every mine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from flgpr.model import Lane
from flgpr.scoring.curve import count_at
from flgpr.scoring.matching import Match, Subset, pairs_within, positions, select_targets
from flgpr.types import ArrayLike, FloatArray, IntArray, floats

SHIFTS = 200


@dataclass(frozen=True)
class Chance:
    """Alarms in the halos of targets that are moved to where no target is.

    See :func:`flgpr.scoring.chance`.
    """

    truth: pd.DataFrame  #: the targets, as they stand in the match
    #: (target, shift) highest confidence in the moved halo: -inf where it holds no alarm, NaN where
    #: it would touch the halo of a target
    best: FloatArray

    def at(self, threshold: ArrayLike, subset: Subset = None) -> FloatArray:
        """Compute the chance level of Pd of a subset of the targets.

        It is the share of the moved halos that hold an alarm at or above a threshold.

        Parameters
        ----------
        threshold : array_like
            Thresholds, such as the column of a curve.
        subset : optional
            Targets, see :func:`flgpr.scoring.select_targets`.

        Returns
        -------
        ndarray
            Chance level at each threshold; NaN where no target can be moved clear of all halos.
        """
        moved = self.best[select_targets(self.truth, subset)]
        moved = moved[~np.isnan(moved)]
        levels = floats(threshold)
        if not len(moved):
            return np.full(levels.shape, np.nan)
        return floats(count_at(levels, moved) / len(moved))

    def add_chance_column(self, curve: pd.DataFrame, subset: Subset = None) -> pd.DataFrame:
        """Return a curve with the chance level of its thresholds.

        Parameters
        ----------
        curve : DataFrame
            ROC table of the same match and subset.
        subset : optional
            Targets, see :func:`flgpr.scoring.select_targets`.

        Returns
        -------
        DataFrame
            The curve with the column ``chance``.
        """
        return curve.assign(chance=self.at(curve["threshold"], subset))


def chance(matched: Match, shifts: int = SHIFTS, seed: int = 0) -> Chance:
    """Estimate what the alarms would find if they knew nothing of the targets.

    The targets are moved along their lanes. Each lane is closed to a ring: what leaves its far end
    comes in at the near one. All targets are moved by one shift at a time, drawn at random in each
    of ``shifts`` equal parts of the ring.

    Only alarms in no halo count, those that FAR counts and those outside the lane. A moved halo
    that would overlap that of any target, its own included, is left out, because nothing that
    counts can stand in the overlap. Targets keep their position across the lane and alarms stay.
    Clutter at a lane's edges and alarms that cluster therefore have their own chance level, other
    than :func:`flgpr.scoring.random_pd` assumes.

    Parameters
    ----------
    matched : Match
        Alarms and targets, see :func:`flgpr.scoring.match`.
    shifts, seed : int
        Number of shifts, and the seed that draws them.

    Returns
    -------
    Chance
        The chance level at any threshold, for any subset.

    Raises
    ------
    ValueError
        If there is no shift.

    Examples
    --------
    On 1,200 m² lie 20 mines and 500 alarms that know nothing of them. With halos of 1 m they find
    most mines all the same:

    >>> import numpy as np
    >>> import pandas as pd
    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import chance, match, random_pd, roc_of
    >>> rng = np.random.default_rng(1)
    >>> names = [f"m{i}" for i in range(20)]
    >>> truth = pd.DataFrame({"target_id": names, "x": 0.0, "y": np.linspace(5, 195, 20)})
    >>> truth = truth.assign(kind="metal", depth=0.05)
    >>> rows = rng.uniform([-3, 0, 0], [3, 200, 1], (500, 3))
    >>> alarms = pd.DataFrame(rows, columns=["x", "y", "confidence"])
    >>> matched = match(alarms, truth, Lane(-3.0, 3.0, 0.0, 200.0))
    >>> curve = chance(matched).add_chance_column(roc_of(matched))
    >>> curve[["pd", "far", "chance"]].iloc[-1].round(2).to_dict()
    {'pd': 0.8, 'far': 0.42, 'chance': 0.71}
    >>> round(float(random_pd(0.42, 1.0)), 2)
    0.73
    """
    if shifts < 1:
        raise ValueError(f"shifts must be at least 1, got {shifts}")
    # Each shift as a share of the lane's length.
    shares = (np.arange(shifts) + np.random.default_rng(seed).random(shifts)) / shifts
    best = np.full((len(matched.truth), shifts), np.nan)
    targets = positions(matched.truth)
    alarms = positions(matched.alarms)
    for number, lane in enumerate(matched.lanes.values()):
        in_lane = np.flatnonzero(matched.target_lane == number)
        free = np.flatnonzero((matched.alarm_lane == number) & ~matched.in_halo)
        if len(in_lane):
            best[in_lane] = _best_moved(
                targets[in_lane], alarms[free], matched.confidence[free], lane, matched.halo, shares
            )
    return Chance(matched.truth, best)


def random_pd(far: Any, halo: float) -> Any:
    """Compute what alarms strewn at random and independently would find, 1 - exp(-FAR·π·r²).

    Parameters
    ----------
    far : array_like
        False alarm rates, per m².
    halo : float
        Halo radius r, m.

    Returns
    -------
    ndarray
        Pd at each rate.

    Raises
    ------
    ValueError
        If a rate is negative or the radius is not positive.

    Examples
    --------
    >>> from flgpr.scoring import random_pd
    >>> random_pd([0.01, 0.05, 0.44], halo=1.0).round(2)
    array([0.03, 0.15, 0.75])
    """
    rate = floats(far)
    if not (rate >= 0).all():
        raise ValueError(f"far must not be negative, got {far}")
    if not halo > 0:
        raise ValueError(f"halo must be positive, got {halo} m")
    return -np.expm1(-rate * np.pi * halo**2)


def _best_moved(
    targets: FloatArray,
    alarms: FloatArray,
    confidence: FloatArray,
    lane: Lane,
    halo: float,
    shares: FloatArray,
) -> FloatArray:
    """Find the highest confidence in each target's halo after each shift.

    The shifts are shares of the lane's length. A moved halo that touches one of a target is NaN.
    """
    length = lane.y_max - lane.y_min
    y = lane.y_min + (targets[:, 1, None] - lane.y_min + length * shares) % length
    moved = np.column_stack([np.repeat(targets[:, 0], len(shares)), y.ravel()])

    folded = np.column_stack([targets[:, 0], lane.y_min + (targets[:, 1] - lane.y_min) % length])
    ring_of_targets, _ = _close_ring(folded, lane, 2 * halo)
    distance, _ = cKDTree(ring_of_targets).query(moved, distance_upper_bound=2 * halo)
    is_clear = ~(distance < 2 * halo)

    inside = (alarms[:, 1] >= lane.y_min) & (alarms[:, 1] <= lane.y_max)
    ring_of_alarms, row = _close_ring(alarms[inside], lane, halo)
    moved_halo, alarm, _ = pairs_within(moved[is_clear], ring_of_alarms, halo)
    best_clear = np.full(int(is_clear.sum()), -np.inf)
    np.maximum.at(best_clear, moved_halo, confidence[inside][row[alarm]])
    best = np.full(len(moved), np.nan)
    best[is_clear] = best_clear
    return best.reshape(y.shape)


def _close_ring(points: FloatArray, lane: Lane, reach: float) -> tuple[FloatArray, IntArray]:
    """Repeat points near either end of a lane beyond the other, and return the row of each."""
    length = lane.y_max - lane.y_min
    middle = (lane.y_min + lane.y_max) / 2
    ring = []
    rows = []
    for copy in (points, points + [0, length], points - [0, length]):
        row = np.flatnonzero(np.abs(copy[:, 1] - middle) <= length / 2 + reach)
        ring.append(copy[row])
        rows.append(row)
    return np.concatenate(ring), np.concatenate(rows)
