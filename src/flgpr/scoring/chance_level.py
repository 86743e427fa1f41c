"""What alarms find that know nothing of the targets: a lane full of alarms finds every mine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from flgpr.model import Lane
from flgpr.scoring.curve import count_at
from flgpr.scoring.matching import Match, Subset, pairs_within, select_targets

FloatArray = NDArray[np.float64]
SHIFTS = 200


@dataclass(frozen=True)
class Chance:
    """What stands in the halos of targets that are moved to where no target is; see :func:`flgpr.scoring.chance`."""

    truth: pd.DataFrame  #: the targets, as they stand in the match
    #: (target, shift) highest confidence in the moved halo: -inf where it holds no alarm, NaN where it would touch the
    #: halo of a target
    best: FloatArray

    def at(self, threshold: ArrayLike, subset: Subset = None) -> FloatArray:
        """Compute the chance level of Pd of a subset of the targets at thresholds, such as the column of a curve.

        It is the share of the moved halos that hold an alarm at or above each threshold; NaN where no target can be
        moved clear of all halos.
        """
        moved = self.best[select_targets(self.truth, subset)]
        moved = moved[~np.isnan(moved)]
        levels = np.asarray(threshold, dtype=np.float64)
        if not len(moved):
            return np.full(levels.shape, np.nan)
        return np.asarray(count_at(levels, moved) / len(moved), dtype=np.float64)

    def add_chance_column(self, curve: pd.DataFrame, subset: Subset = None) -> pd.DataFrame:
        """Put the chance level beside a curve of the same match and subset, as the column ``chance``."""
        return curve.assign(chance=self.at(curve["threshold"], subset))


def chance(matched: Match, shifts: int = SHIFTS, seed: int = 0) -> Chance:
    """Move the targets along their lanes to learn what the alarms would find if they knew nothing of the targets.

    Each lane is closed to a ring: what leaves its far end comes in at the near one. All targets are moved by one shift
    at a time, drawn at random in each of ``shifts`` equal parts of the ring. Only alarms in no halo count, those that
    FAR counts and those beside the lane; a moved halo that would overlap that of any target, its own included, is left
    out, for nothing that counts can stand in the overlap. Targets keep their place across the lane and alarms stand
    where they do, so that clutter at a lane's edges and alarms that cluster have their own chance level, of which
    :func:`flgpr.scoring.random_pd` knows nothing. The result tells the level at any threshold, for any subset.

    Examples
    --------
    On 1,200 m² lie 20 mines and 500 alarms that know nothing of them; halos of 1 m find most mines all the same:

    >>> import numpy as np
    >>> import pandas as pd
    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import chance, match, random_pd, roc_of
    >>> rng = np.random.default_rng(1)
    >>> truth = pd.DataFrame({"target_id": [f"m{i}" for i in range(20)], "x": 0.0, "y": np.linspace(5, 195, 20)})
    >>> truth = truth.assign(kind="metal", depth=0.05)
    >>> alarms = pd.DataFrame(rng.uniform([-3, 0, 0], [3, 200, 1], (500, 3)), columns=["x", "y", "confidence"])
    >>> matched = match(alarms, truth, Lane(-3.0, 3.0, 0.0, 200.0))
    >>> curve = chance(matched).add_chance_column(roc_of(matched))
    >>> curve[["pd", "far", "chance"]].iloc[-1].round(2).to_dict()
    {'pd': 0.8, 'far': 0.42, 'chance': 0.71}
    >>> round(float(random_pd(0.42, 1.0)), 2)
    0.73
    """
    if shifts < 1:
        raise ValueError(f"shifts must be at least 1, got {shifts}")
    parts = (np.arange(shifts) + np.random.default_rng(seed).random(shifts)) / shifts
    best = np.full((len(matched.truth), shifts), np.nan)
    targets, alarms = (
        table[["x", "y"]].to_numpy(dtype=float) for table in (matched.truth, matched.alarms)
    )
    for number, lane in enumerate(matched.lanes.values()):
        own = np.flatnonzero(matched.target_lane == number)
        free = np.flatnonzero((matched.alarm_lane == number) & ~matched.in_halo)
        if len(own):
            best[own] = _best_moved(
                targets[own], alarms[free], matched.confidence[free], lane, matched.halo, parts
            )
    return Chance(matched.truth, best)


def random_pd(far: Any, halo: float) -> Any:
    """Compute what alarms strewn at random and independently would find: ``1 - exp(-FAR·π·r²)``.

    FAR is per m², the halo radius r in m.

    Examples
    --------
    >>> from flgpr.scoring import random_pd
    >>> random_pd([0.01, 0.05, 0.44], halo=1.0).round(2)
    array([0.03, 0.15, 0.75])
    """
    rate = np.asarray(far, dtype=np.float64)
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
    parts: FloatArray,
) -> FloatArray:
    """Find the highest confidence in each target's halo after each shift, given in parts of the lane's length."""
    length = lane.y_max - lane.y_min
    y = lane.y_min + (targets[:, 1, None] - lane.y_min + length * parts) % length
    moved = np.column_stack([np.repeat(targets[:, 0], len(parts)), y.ravel()])
    folded = np.column_stack([targets[:, 0], lane.y_min + (targets[:, 1] - lane.y_min) % length])
    known = cKDTree(_closed(folded, lane, 2 * halo)[0])
    touching = known.query(moved, distance_upper_bound=2 * halo)[0] < 2 * halo
    inside = (alarms[:, 1] >= lane.y_min) & (alarms[:, 1] <= lane.y_max)
    ring, row = _closed(alarms[inside], lane, halo)
    place, alarm, _ = pairs_within(moved[~touching], ring, halo)
    clear = np.full(int((~touching).sum()), -np.inf)
    np.maximum.at(clear, place, confidence[inside][row[alarm]])
    best = np.full(len(moved), np.nan)
    best[~touching] = clear
    return best.reshape(y.shape)


def _closed(points: FloatArray, lane: Lane, reach: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Repeat points near either end of a lane beyond the other; tells which row each of them was."""
    length = lane.y_max - lane.y_min
    copies = [points, points + [0, length], points - [0, length]]
    near = [
        np.abs(one[:, 1] - (lane.y_min + lane.y_max) / 2) <= length / 2 + reach for one in copies
    ]
    rows = [np.flatnonzero(one) for one in near]
    return np.concatenate(
        [one[row] for one, row in zip(copies, rows, strict=True)]
    ), np.concatenate(rows)
