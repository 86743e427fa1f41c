"""What each departure of the recipe wang2007 from the letter of the paper costs in PD_mean.

One difference at a time is changed from ``wang2007-printed``, everywhere: on the lanes that train
the classifiers and on those that are scored. Both sides of a difference are drawn alike, lanes,
targets and stretches of lane. The numbers are the table ``wang2007/costs.csv`` of the docs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.features import FEATURES, POLARIMETRIC
from flgpr.progress import Track
from flgpr.scoring import Match
from flgpr.scoring.bootstrap import make_design, make_scores, tails
from flgpr.scoring.lane_roc import AreaRule
from flgpr_papers.kit.intervals import SHARE_DIFFERENCE, Interval, clip, percentiles
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.wang2007.analysis import AREA, FAR_MAX, MINES, LaneResult, Pool, ranked
from flgpr_papers.wang2007.findings import SETS, blind_scores
from flgpr_papers.wang2007.lanes import F1_BAND, f1_alone, sensor
from flgpr_papers.wang2007.study import lane_result, lane_scenes, make_part
from reasons.trials import Question, Trial

CLAIM = "wang2007 finds as many mines as wang2007-printed"
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


def cost_trials(folder: Path, quick: bool, world: str, track: Track) -> list[Trial]:
    """Score the study's lanes by both recipes; a lane's result that is on disk is used.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    quick, world, track
        As the study runs.
    """
    scenes = lane_scenes(quick, world)
    text = f1_alone(packaged_text("wang2007"))
    coarse_text = text.replace("median_step = 1\n", f"median_step = {MEDIAN_STEP}\n")
    calibration, blind = scenes
    printed = Lanes(
        *[[make_part(folder, name, quick, world, track) for name in one] for one in scenes]
    )
    coarse: dict[str, LaneResult] = {}
    for name, (scene, seed) in (calibration | blind).items():
        radar = sensor() if name in calibration else sensor(F1_BAND)
        coarse[name] = lane_result(
            folder, scene, seed, radar, coarse_text, track, wide=False, suffix="-coarse"
        )
    coarse_lanes = Lanes(*[[coarse[name] for name in one] for one in scenes])
    return table_trials(printed, coarse_lanes, 100 if quick else 1000)


def table_trials(printed: Lanes, coarse: Lanes, draws: int) -> list[Trial]:
    """Return what each difference costs every detector, on the calibration and on the blind lanes.

    On the calibration lanes each lane is scored by classifiers of the others (method C of the
    paper), on the blind ones by those of all calibration lanes. A positive cost is a loss.

    Parameters
    ----------
    printed, coarse : Lanes
        Results with the printed recipe, and with the coarse median.
    draws : int
        Number of bootstrap draws.
    """
    before = matches(printed, PRINTED)
    trials = []
    for difference in DIFFERENCES:
        changed = f"{difference.entry}: {difference.printed} to {difference.changed}"
        after = matches(coarse if difference.coarse else printed, difference)
        for (detector, where), first in before.items():
            second = after[detector, where]
            cost = paired_cost(first, second, difference.area, draws)
            mines = int((first.truth["kind"] != "simulant").sum())
            quantity = f"PD_mean as printed less that with the change, {detector}, {where} lanes"
            trials.append(Question(CLAIM, quantity, f"{mines} mines").shown(changed, cost))
    return trials


def paired_cost(first: Match, second: Match, area: AreaRule, draws: int) -> Interval:
    """Return PD_mean of mines of one list of alarms less that of another, and its 95 % interval.

    Lanes, targets and stretches of lane are drawn alike for both. As of
    :func:`flgpr.scoring.compare`, percentiles are expanded for few mines.

    Parameters
    ----------
    first, second : Match
        Alarms matched to the same truth on the same lanes.
    area : {"union", "paper"}
        Rule of FAR's area of the second; that of the first is the paper's.
    draws : int
        Number of resamplings.
    """
    designs = [make_design(first, MINES, area=AREA), make_design(second, MINES, area=area)]
    scores = [make_scores(first, designs[0], MINES), make_scores(second, designs[1], MINES)]

    def difference(target: NDArray[np.float64], block: NDArray[np.float64]) -> float:
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


def matches(lanes: Lanes, difference: Difference) -> dict[tuple[str, str], Match]:
    """Match the alarms of every detector on both kinds of lanes as a difference has them."""
    calibration, blind = [[_renamed(result, difference) for result in results] for results in lanes]
    pool = Pool(calibration)
    trained = {name: columns for name, columns in DETECTORS.items() if name != UNTRAINED}
    on_blind = blind_scores(calibration, blind, trained)
    (contrast,) = DETECTORS[UNTRAINED]
    on_blind[UNTRAINED] = ranked(blind, [result.features[contrast] for result in blind])
    of_detector = {}
    for name, columns in DETECTORS.items():
        is_trained = name in trained
        values = pool.confidence(columns, "C") if is_trained else pool.features[contrast].to_numpy()
        of_detector[name, "calibration"] = pool.match_of(values)
    return of_detector | {(name, "blind"): on_blind[name] for name in DETECTORS}


def _renamed(result: LaneResult, difference: Difference) -> LaneResult:
    """Return the columns that a difference reads under the names of the printed ones."""
    columns = {
        name: result.features[difference.column(name)]
        for names in DETECTORS.values()
        for name in names
    }
    return replace(result, features=pd.DataFrame(columns))
