"""Scores of a list of alarms whose confidences change, of lanes and targets as they are or drawn anew.

For searches, and for detectors that are trained anew in every draw of a bootstrap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flgpr.scoring.bootstrap import Scores
from flgpr.scoring.lane_roc import far_area
from flgpr.scoring.matching import Match, Subset, select_targets

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Draw:
    """Lanes, targets and stretches of lane drawn anew: how often each counts."""

    target: FloatArray  #: (target,)
    alarm: FloatArray  #: (alarm,) as often as the target that it hits or the stretch of lane that it stands on
    area: float  #: that the false alarms stand on, m²


class Rescorer:
    """Pd of some targets and its mean as functions of all alarms' confidences; -inf is never declared.

    ``reference`` are the alarms, with any confidences.
    """

    def __init__(self, reference: Match, subset: Subset = None, far_max: float = 0.1) -> None:
        chosen = select_targets(reference.truth, subset)
        number = np.where(chosen, np.cumsum(chosen) - 1, -1)[reference.pair_target]
        self._alarm, self._pair = reference.pair_alarm[number >= 0], number[number >= 0]
        self._targets, self._false = np.flatnonzero(chosen), np.flatnonzero(reference.false)
        self.area, self._far_max = far_area(reference, "union"), far_max

    def __call__(self, confidence: FloatArray, draw: Draw | None = None) -> float:
        """Give the mean of Pd up to ``far_max``, that of :func:`flgpr.scoring.pd_mean` of the curve."""
        scores, target, weight, area = self._scores(confidence, draw)
        return float(scores.shares(self._far_max, weight, area) @ target / target.sum())

    def pd_at(self, confidence: FloatArray, far: FloatArray, draw: Draw | None = None) -> FloatArray:
        """Give Pd at allowed false alarm rates, per m²; NaN in a draw without any of the targets."""
        scores, target, weight, area = self._scores(confidence, draw)
        return scores.pd_at(far, target, weight, area) if target.any() else np.full(len(far), np.nan)

    def _scores(self, confidence: FloatArray, draw: Draw | None) -> tuple[Scores, FloatArray, FloatArray, float]:
        """Scores with every false alarm a block of its own, the weights of targets and false alarms, and the area."""
        best = np.full(len(self._targets), -np.inf)
        np.maximum.at(best, self._pair, confidence[self._alarm])
        row = self._false[np.argsort(-confidence[self._false], kind="stable")]
        false = confidence[row]
        scores = Scores(best, false, np.arange(row.size), np.searchsorted(-false, -best, side="right"))
        if draw is None:
            return scores, np.ones(best.size), np.ones(row.size), self.area
        return scores, draw.target[self._targets], draw.alarm[row], draw.area
