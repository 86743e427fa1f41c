"""One alarm list, scored: everything that the files and the page of a score tell."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pandas as pd

from flgpr.scoring.assignment import assign, label_alarms
from flgpr.scoring.bootstrap import band, pd_mean_interval
from flgpr.scoring.breakdown import DEPTH_EDGES, depth_classes, pd_table
from flgpr.scoring.checks import LaneLike
from flgpr.scoring.curve import operating_row, pd_mean
from flgpr.scoring.lane_roc import roc_of
from flgpr.scoring.matching import Match, match
from flgpr.scoring.refraction import Refraction
from flgpr.scoring.survey import SurveyShare, survey_share

COUNTS = ("n_alarms", "n_targets", "n_known_targets", "area")
_FIRST_POINTS = (0.005, 0.01, 0.02, 0.05, 0.1)


@dataclass(frozen=True, kw_only=True)
class Rules:
    """By which rules an alarm list is scored, and how sure its figures are said to be."""

    #: halo, halo_as, area, refraction, survey_error: as for :func:`flgpr.scoring.roc`
    halo: float = 1.0
    halo_as: Literal["radius", "diameter"] = "radius"
    area: Literal["union", "paper"] = "union"
    refraction: Refraction | None = None
    survey_error: float | None = None
    far: float = 0.01  #: operating point at which targets count as missed and Pd is broken down, per m²
    far_max: float = 0.1  #: end of the FAR axis and of the averaging of PD_mean, per m²
    level: float = 0.95  #: level of all intervals and bands
    #: draws, seed: of the bootstrap
    draws: int = 1000
    seed: int = 0


@dataclass(frozen=True)
class Score:
    """One alarm list, scored."""

    #: name, title: what was scored, for a machine and in words; the main list of a lane is ``main``
    name: str
    title: str
    rules: Rules  #: how
    matched: Match = field(repr=False)  #: alarms and targets
    curve: pd.DataFrame = field(repr=False)  #: ROC with its counts and exact intervals, see :func:`flgpr.scoring.roc`
    #: one row per target as :func:`flgpr.scoring.assign` gives it, and its best alarm's offset ``dx``, ``dy``, m
    outcomes: pd.DataFrame = field(repr=False)
    labels: pd.DataFrame = field(repr=False)  #: one row per alarm as :func:`flgpr.scoring.label_alarms` gives it
    survey: SurveyShare | None  #: what the error of the survey takes of the halo, if it is known

    @cached_property
    def pd_mean(self) -> dict[str, float] | None:
        """PD_mean, ``value``, with ``low`` and ``high`` by bootstrap and ``far_max``; None without targets."""
        if not len(self.matched.truth):
            return None
        far_max = self.rules.far_max
        low, high = pd_mean_interval(self.matched, far_max, **self._bootstrap)
        return {"value": pd_mean(self.curve, far_max), "low": low, "high": high, "far_max": far_max}

    @property
    def _bootstrap(self) -> dict[str, Any]:
        return {name: getattr(self.rules, name) for name in ("area", "level", "draws", "seed")}

    def bands(self, by: Literal["kind", "depth"] | None = None) -> dict[str, tuple[pd.DataFrame, pd.DataFrame]]:
        """Compute curve and simultaneous band of all targets, or of each group of them; none without targets."""
        truth = self.matched.truth
        if not len(truth):
            return {}
        grid = np.linspace(0, self.rules.far_max, 101)
        if by is None:
            return {"all": (self.curve, band(self.matched, None, grid, **self._bootstrap))}
        if by == "kind":
            groups, names = truth["kind"].astype(str), sorted(map(str, truth["kind"].unique()))
        else:
            groups = depth_classes(truth["depth"], DEPTH_EDGES)
            names = list(groups.cat.categories)
        chosen = {str(name): (groups == name).to_numpy() for name in names}
        return {
            name: (
                roc_of(self.matched, rows, area=self.rules.area),
                band(self.matched, rows, grid, **self._bootstrap),
            )
            for name, rows in chosen.items()
        }

    def operating_points(self) -> pd.DataFrame:
        """Read the curve at common false alarm rates, ``far_allowed``, up to ``far_max``."""
        far_max = self.rules.far_max
        allowed = sorted({*(far for far in _FIRST_POINTS if far <= far_max), far_max})
        return self.curve.iloc[operating_row(self.curve, allowed)].assign(far_allowed=allowed)

    def breakdown(self) -> pd.DataFrame:
        """Tabulate Pd by kind, depth and soil, see :func:`flgpr.scoring.pd_table`."""
        return pd_table(self.matched, self.rules.far, area=self.rules.area, level=self.rules.level)

    def missed(self) -> pd.DataFrame:
        """Take the outcomes of the targets that are not found at ``far``, the hardest first."""
        missed = self.outcomes[self.outcomes["far"] > self.rules.far]
        return missed.sort_values("far", ascending=False, kind="stable")

    def worst_false_alarms(self, most: int) -> pd.DataFrame:
        """Take the labels of the most confident false alarms, and ``found_above``, the targets found above each."""
        false = self.labels[self.labels["label"] == "false"]
        worst = false.sort_values("confidence", ascending=False, kind="stable").head(most)
        thresholds, found = self.curve["threshold"].to_numpy(), self.curve["n_detected"].to_numpy()
        row = [int((thresholds > confidence).sum()) - 1 for confidence in worst["confidence"]]
        return worst.assign(found_above=found[row])

    def told_rules(self) -> dict[str, Any]:
        """Tell the convention and all choices, the same for all lists of a lane."""
        convention = {str(name): value for name, value in self.curve.attrs.items() if name not in COUNTS}
        told = {"far": self.rules.far, "bootstrap": {"draws": self.rules.draws, "seed": self.rules.seed}}
        return convention | told | ({} if self.survey is None else {"survey_error": asdict(self.survey)})

    def told(self) -> dict[str, Any]:
        """Tell counts, PD_mean, the points of the curve, and what became of each target."""
        return {
            "title": self.title,
            **{name: self.curve.attrs[name] for name in COUNTS},
            "n_false": self.curve["n_false"].iloc[-1],
            "pd_mean": self.pd_mean,
            "points": self.curve.drop(columns=["n_targets", "area"]).to_dict("records"),
            "targets": self.outcomes.to_dict("records"),
        }


def score(
    alarms: pd.DataFrame,
    truth: pd.DataFrame,
    lane: LaneLike,
    rules: Rules | None = None,
    *,
    name: str = "main",
    title: str = "",
) -> Score:
    """Score an alarm list by the halo rules of Wang et al. 2007.

    Parameters
    ----------
    alarms, truth, lane
        As for :func:`flgpr.scoring.roc`.
    rules : Rules, optional
        Halo, area, operating point, intervals.
    name, title : str
        What the list is called.

    Returns
    -------
    Score
        The score.

    Raises
    ------
    ValueError
        As :func:`flgpr.scoring.roc`.

    Examples
    --------
    >>> import pandas as pd
    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import Rules, score
    >>> alarms = pd.DataFrame({"x": [0.2, 1.0], "y": [10.3, 44.0], "confidence": [3, 2]})
    >>> truth = pd.DataFrame({"target_id": ["a", "b"], "x": [0.0, -1.0], "y": [10.0, 30.0], "kind": "metal"})
    >>> truth["depth"] = 0.05
    >>> scored = score(alarms, truth, Lane(-2.0, 2.0, 0.0, 60.0), Rules(halo=0.5, draws=100))
    >>> scored.outcomes["detected"].tolist(), scored.labels["label"].tolist()
    ([True, False], ['detection', 'false'])
    >>> scored.missed()["target_id"].tolist()
    ['b']
    """
    rules = rules or Rules()
    matched = match(alarms, truth, lane, rules.halo, halo_as=rules.halo_as, refraction=rules.refraction)
    survey = None if rules.survey_error is None else survey_share(rules.survey_error, matched.halo)
    curve = roc_of(matched, area=rules.area, level=rules.level)
    outcomes = assign(matched, rules.area)
    best = outcomes["alarm"].to_numpy(dtype=int)
    for axis in ("x", "y"):
        place = np.append(matched.alarms[axis].to_numpy(dtype=float), np.nan)[best]  # -1, no alarm, takes the NaN
        outcomes["d" + axis] = place - outcomes[axis]
    return Score(name, title, rules, matched, curve, outcomes, label_alarms(matched), survey)
