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
from flgpr.scoring import Match, roc_of
from flgpr.scoring.bootstrap import make_design, make_scores, tails
from flgpr.scoring.curve import held_pd_mean
from flgpr.scoring.lane_roc import AreaRule
from flgpr.scoring.matching import Subset
from flgpr_papers.kit.intervals import SHARE_DIFFERENCE, Interval, clip, percentiles
from flgpr_papers.wang2007.analysis import (
    AREA,
    FAR_MAX,
    MINES,
    FloatArray,
    LaneResult,
    Pool,
    ranked,
)
from flgpr_papers.wang2007.findings import SETS, blind_scores

MEDIAN_STEP = 3
"""``background.median_step`` of the recipe wang2007."""
DETECTORS = {"C_HH": ("C_HH_F1",), **SETS, "all ten": tuple(f"{name}_F1" for name in FEATURES)}
"""Columns of each detector: local contrast alone, the paper's two classifiers, all of F1."""
UNTRAINED = "C_HH"


@dataclass(frozen=True)
class Difference:
    """A way in which the recipe wang2007 departs from wang2007-printed."""

    entry: str  #: entry of the recipe
    printed: str  #: its value in wang2007-printed
    changed: str  #: its value in wang2007
    coarse: bool = False  #: whether the gain background is that of the coarse median
    area: AreaRule = AREA  #: rule of FAR's area
    #: what stands before the names of the columns of polarimetric features, and of ψ: with one gain
    #: for all polarizations, and averaged as a direction
    polarimetric: str = ""
    psi: str = ""

    def column(self, name: str) -> str:
        """Return the column that stands for one of the printed recipe."""
        feature, _, _ = name.rpartition("_")
        if feature == "P_psi":
            return f"{self.psi}{name}"
        return f"{self.polarimetric}{name}" if feature in POLARIMETRIC else name


PRINTED = Difference("", "", "")
DIFFERENCES = (
    Difference("background.median_step", "1", str(MEDIAN_STEP), coarse=True),
    Difference("features.gain", "own", "shared", polarimetric="shared.", psi="shared.linear."),
    Difference("features.psi", "linear", "circular", psi="circular."),
    Difference("score.area", "paper", "union", area="union"),
    Difference("all four", "wang2007-printed", "wang2007", True, "union", "shared.", "shared."),
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
                    "pd_mean": held_pd_mean(roc_of(first, MINES, area=AREA), FAR_MAX),
                    "pd_mean_changed": held_pd_mean(
                        roc_of(second, MINES, area=difference.area), FAR_MAX
                    ),
                    "cost": value,
                    "low": low,
                    "high": high,
                }
            )
    return pd.DataFrame(rows)


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
    designs = [
        make_design(one, subset, area=area)
        for one, area in ((first, first_area), (second, second_area))
    ]
    scores = [
        make_scores(one, design, subset)
        for one, design in zip((first, second), designs, strict=True)
    ]

    def difference(target: FloatArray, block: FloatArray) -> float:
        shares = [
            one.shares(FAR_MAX, block, float((block * design.block_area).sum()))
            for one, design in zip(scores, designs, strict=True)
        ]
        return float((target * (shares[0] - shares[1])).sum() / target.sum())

    design = designs[0]
    value = difference(np.ones(len(scores[0].target)), np.ones(len(design.block_lane)))
    rng = np.random.default_rng(0)
    drawn = [difference(*design.draw(rng)) for _ in range(draws)]
    interval = percentiles(value, drawn, tails(0.95, design.clusters))
    return clip(interval, SHARE_DIFFERENCE)


def _matches(lanes: Lanes, difference: Difference) -> dict[tuple[str, str], Match]:
    """Match the alarms of every detector on both kinds of lanes as a difference has them."""
    calibration, blind = [[_renamed(result, difference) for result in results] for results in lanes]
    pool = Pool(calibration)
    trained = {name: columns for name, columns in DETECTORS.items() if name != UNTRAINED}
    on_blind = blind_scores(calibration, blind, trained)
    (contrast,) = DETECTORS[UNTRAINED]
    on_blind[UNTRAINED] = ranked(blind, [result.features[contrast] for result in blind])
    matches = {}
    for name, columns in DETECTORS.items():
        is_trained = name in trained
        values = pool.confidence(columns, "C") if is_trained else pool.features[contrast].to_numpy()
        matches[name, "calibration"] = pool.match_of(values)
    return matches | {(name, "blind"): on_blind[name] for name in DETECTORS}


def _renamed(result: LaneResult, difference: Difference) -> LaneResult:
    """Return the columns that a difference reads under the names of the printed ones."""
    columns = {
        name: result.features[difference.column(name)]
        for names in DETECTORS.values()
        for name in names
    }
    return replace(result, features=pd.DataFrame(columns))
