"""Scores of 100,000 alarms and 1,000 targets on ten kilometres."""

from __future__ import annotations

import numpy as np

from flgpr.model import Lane
from flgpr.scoring import band, match, pd_mean_interval, roc

from .data import alarms_and_truth, size

DRAWS = size(1000, 20)
"""Resamplings of an interval."""


class Scoring:
    """Curve, band and interval of the mean Pd."""

    def setup(self) -> None:
        targets = size(1000, 20)
        length = 10.0 * targets
        rng = np.random.default_rng(0)
        self.alarms, self.truth = alarms_and_truth(targets, size(108_500, 2000), length, rng)
        self.lane = Lane(0.0, 4.0, 0.0, length)
        self.matched = match(self.alarms, self.truth, self.lane)

    def time_roc(self) -> None:
        roc(self.alarms, self.truth, self.lane)

    def time_band(self) -> None:
        band(self.matched, draws=DRAWS)

    def time_pd_mean_interval(self) -> None:
        pd_mean_interval(self.matched, draws=DRAWS)
