"""What each departure of the recipe wang2007 from the letter of the paper costs in PD_mean.

One difference at a time is changed from ``wang2007-printed``, everywhere: on the lanes that train
the classifiers and on those that are scored. Both sides of a difference are drawn alike, lanes,
targets and stretches of lane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from flgpr.features import FEATURES, POLARIMETRIC
from flgpr.scoring import Match
from flgpr.scoring.bootstrap import make_design, make_scores, tails
from flgpr.scoring.lane_roc import AreaRule
from flgpr.scoring.matching import Subset
from flgpr_papers.kit.intervals import SHARE_DIFFERENCE, Interval, clip
from flgpr_papers.wang2007.analysis import AREA, FAR_MAX, MINES, LaneResult, Pool, matched
from flgpr_papers.wang2007.findings import SETS, blind_scores

MEDIAN_STEP = 3
"""``background.median_step`` of the recipe wang2007."""
DETECTORS = {"C_HH": ("C_HH_F1",), **SETS, "all ten": tuple(f"{name}_F1" for name in FEATURES)}
"""Columns of each detector: local contrast alone, the paper's two classifiers, all of F1."""
UNTRAINED = "C_HH"
_GAIN = "shared."
_PSI = "circular."
_LINEAR = "linear."


@dataclass(frozen=True)
class Difference:
    """A way in which the recipe wang2007 departs from wang2007-printed."""

    entry: str  #: entry of the recipe
    printed: str  #: its value in wang2007-printed
    changed: str  #: its value in wang2007
    coarse: bool = False  #: whether the gain background is that of the coarse median
    gain: bool = False  #: whether polarimetric features share one gain
    psi: bool = False  #: whether ψ is averaged as a direction
    area: AreaRule = AREA  #: rule of FAR's area

    def column(self, name: str) -> str:
        """Return the column that stands for one of the printed recipe."""
        feature, _, _ = name.rpartition("_")
        if feature == "P_psi":
            if self.gain:
                return f"{_GAIN}{name}" if self.psi else f"{_GAIN}{_LINEAR}{name}"
            return f"{_PSI}{name}" if self.psi else name
        if self.gain and feature in POLARIMETRIC:
            return f"{_GAIN}{name}"
        return name


PRINTED = Difference("", "", "")
DIFFERENCES = (
    Difference("background.median_step", "1", str(MEDIAN_STEP), coarse=True),
    Difference("features.gain", "own", "shared", gain=True),
    Difference("features.psi", "linear", "circular", psi=True),
    Difference("score.area", "paper", "union", area="union"),
    Difference(
        "all four", "wang2007-printed", "wang2007", coarse=True, gain=True, psi=True, area="union"
    ),
)


class Lanes(NamedTuple):
    """Calibration and blind lanes as a gain background gives them."""

    calibration: Sequence[LaneResult]
    blind: Sequence[LaneResult]


def cost_table(printed: Lanes, coarse: Lanes, draws: int) -> pd.DataFrame:
    """Return what each difference costs every detector, on the calibration and on the blind lanes.

    On the calibration lanes each lane is scored by classifiers of the others (method C of the
    paper), on the blind ones by those of all calibration lanes.

    Parameters
    ----------
    printed, coarse : Lanes
        Results with the printed recipe, and with the coarse median.
    draws : int
        Number of bootstrap draws.

    Returns
    -------
    DataFrame
        ``difference``, ``printed`` and ``changed``, what the entry says; ``detector``, ``lanes``;
        ``targets``; ``alarms`` and ``alarms_changed``, numbers of them; ``pd_mean`` of actual mines
        up to 0.1 per m² as printed and ``pd_mean_changed``; ``cost``, the first less the second,
        with ``low`` and ``high``, its 95 % interval. A positive cost is a loss.
    """
    before = _matches(printed, PRINTED)
    rows = []
    for difference in DIFFERENCES:
        after = _matches(coarse if difference.coarse else printed, difference)
        for (detector, where), first in before.items():
            second = after[detector, where]
            value, low, high = paired_cost(first, second, MINES, AREA, difference.area, draws)
            rows.append(
                {
                    "difference": difference.entry,
                    "printed": difference.printed,
                    "changed": difference.changed,
                    "detector": detector,
                    "lanes": where,
                    "targets": int((first.truth["kind"] != "simulant").sum()),
                    "alarms": len(first.alarms),
                    "alarms_changed": len(second.alarms),
                    "pd_mean": pd_mean_of(first, MINES, AREA),
                    "pd_mean_changed": pd_mean_of(second, MINES, difference.area),
                    "cost": value,
                    "low": low,
                    "high": high,
                }
            )
    return pd.DataFrame(rows)


def pd_mean_of(matched: Match, subset: Subset, area: AreaRule) -> float:
    """Return PD_mean up to 0.1 per m² of some targets, by a rule of FAR's area."""
    design = make_design(matched, subset, area=area)
    scores = make_scores(matched, design, subset)
    return float(scores.shares(FAR_MAX, np.ones(len(design.block_lane)), design.area).mean())


def paired_cost(
    first: Match,
    second: Match,
    subset: Subset,
    first_area: AreaRule,
    second_area: AreaRule,
    draws: int,
) -> Interval:
    """Return PD_mean of one list of alarms less that of another, and its 95 % bootstrap interval.

    Lanes, targets and stretches of lane are drawn alike for both, which may have different rules of
    FAR's area. As of :func:`flgpr.scoring.compare`, percentiles are expanded for few mines.

    Parameters
    ----------
    first, second : Match
        Alarms matched to the same truth on the same lanes.
    subset : dict or mask
        The targets that count.
    first_area, second_area : {"union", "paper"}
        Rule of the area of each.
    draws : int
        Number of resamplings.
    """
    first_design = make_design(first, subset, area=first_area)
    second_design = make_design(second, subset, area=second_area)
    first_scores = make_scores(first, first_design, subset)
    second_scores = make_scores(second, second_design, subset)

    def difference(target: np.ndarray, block: np.ndarray) -> float:
        first_ground = float((block * first_design.block_area).sum())
        second_ground = float((block * second_design.block_area).sum())
        first_shares = first_scores.shares(FAR_MAX, block, first_ground)
        second_shares = second_scores.shares(FAR_MAX, block, second_ground)
        return float((target * (first_shares - second_shares)).sum() / target.sum())

    value = difference(np.ones(len(first_scores.target)), np.ones(len(first_design.block_lane)))
    rng = np.random.default_rng(0)
    drawn = [difference(*first_design.draw(rng)) for _ in range(draws)]
    low, high = np.quantile(drawn, tails(0.95, first_design.clusters))
    return clip((value, float(low), float(high)), SHARE_DIFFERENCE)


def _matches(lanes: Lanes, difference: Difference) -> dict[tuple[str, str], Match]:
    """Match the alarms of every detector on both kinds of lanes as a difference has them."""
    calibration = [_renamed(result, difference) for result in lanes.calibration]
    blind = [_renamed(result, difference) for result in lanes.blind]
    pool = Pool(calibration)
    matches = {}
    for name, columns in DETECTORS.items():
        if name == UNTRAINED:
            confidence = pool.features[columns[0]].to_numpy(dtype=np.float64)
            confidence = np.where(np.isfinite(confidence), confidence, -np.inf)
        else:
            confidence = pool.confidence(list(columns), "C")
        matches[name, "calibration"] = pool.match_of(confidence)
    trained = {name: columns for name, columns in DETECTORS.items() if name != UNTRAINED}
    for name, match in blind_scores(calibration, blind, trained).items():
        matches[name, "blind"] = match
    (contrast,) = DETECTORS[UNTRAINED]
    tables = []
    for result in blind:
        table = result.alarms.assign(confidence=result.features[contrast])
        tables.append(table.dropna(subset=["confidence"]))
    matches[UNTRAINED, "blind"] = matched(blind, tables)
    order = [(name, where) for where in ("calibration", "blind") for name in DETECTORS]
    return {key: matches[key] for key in order}


def _renamed(result: LaneResult, difference: Difference) -> LaneResult:
    """Return the columns that a difference reads under the names of the printed ones."""
    columns = {}
    for names in DETECTORS.values():
        for name in names:
            columns[name] = result.features[difference.column(name)]
    return replace(result, features=pd.DataFrame(columns))
