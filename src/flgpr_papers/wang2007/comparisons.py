"""Numbers that the statements of Wang et al. 2007 are judged by, with their intervals.

Differences of PD_mean come from resampling targets, lanes and stretches of lane. Where a
discriminant is trained, it is trained anew in every draw.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.scoring import Match, compare
from flgpr_papers.kit.intervals import (
    SHARE,
    SHARE_DIFFERENCE,
    Interval,
    proportion,
    spread,
    together,
)
from flgpr_papers.kit.page import detections_at, pd_in_words
from flgpr_papers.wang2007.analysis import AREA, MINES, Pool

FloatArray = NDArray[np.float64]
Searches = Mapping[str, Sequence[SearchStep]]
"""Steps of the forward search by method, A to D (Table II)."""
F1 = tuple(f"{name}_F1" for name in FEATURES)
"""Columns of the ten features in sub-band F1."""


def retrainings(draws: int) -> int:
    """Return in how many of the draws a discriminant is trained anew.

    They are enough for a standard deviation.
    """
    return max(draws // 5, 20)


def pd_mean_gap(
    first: Match, second: Match, draws: int, parts: int = 1, subset: Any = MINES
) -> Interval:
    """Return PD_mean of a detector less that of another, with frozen detectors.

    Parameters
    ----------
    first, second : Match
        Matched alarms of each.
    draws : int
        Number of bootstrap draws.
    parts : int
        Number of intervals that are to hold all together.
    subset : object
        Targets that count.
    """
    comparison = compare(first, second, subset, area=AREA, draws=draws, level=together(parts))
    return comparison.difference, comparison.low, comparison.high


def retrained_gap(
    pool: Pool,
    first: Sequence[str],
    second: Sequence[str],
    draws: int,
    parts: int = 1,
    method: str = "A",
    subset: Any = MINES,
) -> Interval:
    """Return PD_mean of a set of features less that of another, both trained anew in every draw.

    Parameters
    ----------
    pool : Pool
        Alarms of the calibration lanes.
    first, second : sequence of str
        Columns of each set.
    draws : int
        Number of bootstrap draws, of which :func:`retrainings` are used.
    parts : int
        Number of intervals that are to hold all together.
    method : str
        Method of training and testing, "A" to "D".
    subset : object
        Targets that count.
    """
    score = pool.scorer_of(subset)
    values = [score(pool.confidence(columns, method)) for columns in (first, second)]
    drawn = [
        pool.retrained(columns, method, retrainings(draws), subset) for columns in (first, second)
    ]
    return spread(values[0] - values[1], drawn[0] - drawn[1], together(parts), SHARE_DIFFERENCE)


def limit_less(limit: float, interval: Interval) -> Interval:
    """Return a limit less a number, with its interval: a small number gives a large one."""
    value, low, high = interval
    return limit - value, limit - high, limit - low


def beside_papers_pd(
    matched: Match, subset: Any, far: float, figure: float, count: int | None
) -> dict[str, Any]:
    """Return a Pd and what the paper knows of its own, as a statement takes them.

    Parameters
    ----------
    matched : Match
        Alarms matched to targets.
    subset : object
        Targets that count.
    far : float
        Allowed false alarms per m².
    figure : float
        Pd of the paper.
    count : int or None
        Number of the paper's targets; None where it does not say: as many as here are assumed.
    """
    n_found, targets, chance = detections_at(matched, subset, far, area=AREA)
    paper_targets = targets if count is None else count
    return {
        "interval": proportion(n_found, targets),
        "figure": proportion(round(figure * paper_targets), paper_targets),
        "found": pd_in_words(n_found, targets, chance),
    }


class SingleFeatures:
    """PD_mean of single features of F1 by the four methods, as it is and in bootstrap draws.

    Parameters
    ----------
    pool : Pool
        Alarms of the calibration lanes.
    table : DataFrame
        PD_mean of every feature (column) by method (row), Table I.
    draws : int
        Number of draws in which the discriminants are trained anew.
    """

    def __init__(self, pool: Pool, table: pd.DataFrame, draws: int) -> None:
        self.values = {method: table.loc[method].to_numpy(np.float64) for method in "ABCD"}
        self.drawn = pool.singles_in(F1, "ABCD", draws)

    def level(self, feature: str) -> Interval:
        """Return PD_mean of a feature by method A."""
        k = FEATURES.index(feature)
        return spread(float(self.values["A"][k]), self.drawn["A"][:, k], bounds=SHARE)

    def gap(self, feature: str, other: str, parts: int, method: str = "A") -> Interval:
        """Return PD_mean of a feature by method A less that of another one by a method.

        It is one of ``parts`` intervals that hold all together.
        """
        k = FEATURES.index(feature)
        j = FEATURES.index(other)
        value = float(self.values["A"][k] - self.values[method][j])
        drawn = self.drawn["A"][:, k] - self.drawn[method][:, j]
        return spread(value, drawn, together(parts), SHARE_DIFFERENCE)


def contrast_lead(scores: FloatArray) -> Any:
    """Return the score of C_HH or C_VV, the better, less that of the best other feature.

    Parameters
    ----------
    scores : (..., feature) ndarray
        Scores of the ten features.
    """
    is_contrast = np.array([name in ("C_HH", "C_VV") for name in FEATURES])
    return scores[..., is_contrast].max(axis=-1) - scores[..., ~is_contrast].max(axis=-1)


def duplication_gap(scores: Mapping[str, FloatArray]) -> Any:
    """Return mean |C - D| less mean |A - B| over the last axis."""
    by_cross_validation = np.abs(scores["C"] - scores["D"]).mean(axis=-1)
    by_resubstitution = np.abs(scores["A"] - scores["B"]).mean(axis=-1)
    return by_cross_validation - by_resubstitution


def parting_slope(steps: Mapping[str, FloatArray], drawn: Mapping[str, FloatArray]) -> Interval:
    """Return the slope of resubstitution less cross-validation over the number of features.

    Parameters
    ----------
    steps : mapping of str to (step,) ndarray
        PD_mean of the steps of a search by method.
    drawn : mapping of str to (draw, step) ndarray
        The same in bootstrap draws.
    """
    curves = np.vstack([steps["A"] - steps["C"], drawn["A"] - drawn["C"]])
    slopes = np.polyfit(np.arange(10), curves.T, 1)[0]
    return spread(float(slopes[0]), slopes[1:])
