"""Scores of the same alarms with other confidences, many times over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flgpr.scoring.bootstrap import Scores
from flgpr.scoring.lane_roc import AreaRule, far_area
from flgpr.scoring.matching import Match, Subset, select_targets
from flgpr.types import FloatArray


@dataclass(frozen=True)
class Draw:
    """A resampling of lanes, targets and stretches of lane: how often each counts."""

    target: FloatArray  #: (target,) weight of each target
    #: (alarm,) weight of the target that an alarm hits, or of the stretch of lane that it stands on
    alarm: FloatArray
    area: float  #: area that false alarms can stand on, m²


class Rescorer:
    """Pd of some targets and its mean as functions of the confidences of all alarms.

    Parameters
    ----------
    reference : Match
        The alarms and targets, with any confidences.
    subset : optional
        Targets to score, see :func:`flgpr.scoring.select_targets`.
    far_max : float
        End of the averaging of Pd, per m².
    area : {"union", "paper"}
        Rule of the FAR's area where nothing is resampled, see :func:`flgpr.scoring.roc`.
    """

    def __init__(
        self,
        reference: Match,
        subset: Subset = None,
        far_max: float = 0.1,
        area: AreaRule = "union",
    ) -> None:
        chosen = select_targets(reference.truth, subset)
        number = np.where(chosen, np.cumsum(chosen) - 1, -1)[reference.pair_target]
        self._alarm = reference.pair_alarm[number >= 0]
        self._pair = number[number >= 0]
        self._targets = np.flatnonzero(chosen)
        self._false = np.flatnonzero(reference.false)
        self.area = far_area(reference, area)
        self._far_max = far_max

    def __call__(self, confidence: FloatArray, draw: Draw | None = None) -> float:
        """Compute the mean of Pd up to ``far_max``, as :func:`flgpr.scoring.pd_mean` of the curve.

        An alarm with the confidence -inf is never declared.
        """
        scores, target, weight, area = self._scores(confidence, draw)
        return float(scores.shares(self._far_max, weight, area) @ target / target.sum())

    def pd_at(
        self, confidence: FloatArray, far: FloatArray, draw: Draw | None = None
    ) -> FloatArray:
        """Compute Pd at allowed false alarm rates, per m²; NaN in a draw without any target."""
        scores, target, weight, area = self._scores(confidence, draw)
        if not target.any():
            return np.full(len(far), np.nan)
        return scores.pd_at(far, target, weight, area)

    def _scores(
        self, confidence: FloatArray, draw: Draw | None
    ) -> tuple[Scores, FloatArray, FloatArray, float]:
        """Return scores, weights of targets and of false alarms, and the area, m².

        In the scores every false alarm is a block of its own.
        """
        best = np.full(len(self._targets), -np.inf)
        np.maximum.at(best, self._pair, confidence[self._alarm])
        row = self._false[np.argsort(-confidence[self._false], kind="stable")]
        false = confidence[row]
        above = np.searchsorted(-false, -best, side="right")
        scores = Scores(best, false, np.arange(row.size), above)
        if draw is None:
            return scores, np.ones(best.size), np.ones(row.size), self.area
        return scores, draw.target[self._targets], draw.alarm[row], draw.area
