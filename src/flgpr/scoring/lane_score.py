"""The score of one alarm list: all that the files and the page of a score show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np
import pandas as pd

from flgpr.scoring.bootstrap import band, pd_mean_interval
from flgpr.scoring.breakdown import DEPTH_EDGES, depth_classes, pd_table
from flgpr.scoring.chance_level import SHIFTS, Chance, chance, random_pd
from flgpr.scoring.curve import held_pd_mean, operating_row, pd_mean_by_chance
from flgpr.scoring.lane_roc import assign, label_alarms, roc_of
from flgpr.scoring.matching import LaneLike, Match, Subset, match
from flgpr.scoring.places import Refraction, SurveyShare, survey_share
from flgpr.scoring.score_entries import (
    CurvePoint,
    DetectionEntries,
    KindEntries,
    KindPoint,
    MeanPd,
    MeanPdInterval,
    OperatingPoint,
    RulesEntries,
    TargetOutcome,
)
from flgpr.types import BoolArray, Entries

COUNTS = ("n_alarms", "n_targets", "n_known_targets", "area")
_SAME_IN_ALL_ROWS = ("n_targets", "area")
_FEW_HALOS = 20
_COMMON_RATES = (0.005, 0.01, 0.02, 0.05, 0.1)
_MINES = {"metal", "plastic"}  # kinds of target that are mines; simulants are not
_MOST_NAMED = 3  # missed targets that a sentence names


@dataclass(frozen=True, kw_only=True)
class Rules:
    """Scoring rules and confidence level."""

    #: halo, halo_as, area, frame_area, refraction, survey_error: as for :func:`flgpr.scoring.roc`
    halo: float = 1.0
    halo_as: Literal["radius", "diameter"] = "radius"
    area: Literal["union", "paper", "frames"] = "union"
    frame_area: float | None = None
    refraction: Refraction | None = None
    survey_error: float | None = None
    #: operating point at which targets count as found or missed and Pd is broken down, per m²
    far: float = 0.05
    far_max: float = 0.1  #: end of the FAR axis and of the averaging of PD_mean, per m²
    level: float = 0.95  #: level of all intervals and bands
    draws: int = 1000  #: draws of the bootstrap
    #: shifts of the targets for the chance level, see :func:`flgpr.scoring.chance`
    shifts: int = SHIFTS
    seed: int = 0  #: seed of both
    #: block, cluster: what the bootstrap draws together, see :func:`flgpr.scoring.band`
    block: float = 10.0
    cluster: str | None = None


@dataclass(frozen=True)
class Score:
    """The score of one alarm list."""

    #: name, title: what was scored, for a machine and in words; the main list of a lane is ``main``
    name: str
    title: str
    rules: Rules  #: scoring rules
    matched: Match = field(repr=False)  #: alarms and targets
    #: ROC with its counts and exact intervals, see :func:`flgpr.scoring.roc`, and the Pd that
    #: ``chance`` gives
    curve: pd.DataFrame = field(repr=False)
    # : operating point, per m²: that of the rules, or one false alarm where the lane cannot tell
    # less
    far: float
    #: one row per target as :func:`flgpr.scoring.assign` gives it, its best alarm's offset ``dx``,
    #: ``dy``, m, and whether it is ``found`` at the operating point
    outcomes: pd.DataFrame = field(repr=False)
    #: one row per alarm as :func:`flgpr.scoring.label_alarms` gives it
    labels: pd.DataFrame = field(repr=False)
    chance: Chance = field(repr=False)  #: what alarms that know nothing of the targets find
    survey: SurveyShare | None  #: what the error of the survey takes of the halo, if it is known

    @cached_property
    def pd_mean(self) -> MeanPdInterval | None:
        """PD_mean with its bootstrap interval and chance level; None without targets.

        The entries are ``value``, ``low``, ``high``, ``chance`` and ``far_max``, per m².
        """
        if not len(self.matched.truth):
            return None
        far_max = self.rules.far_max
        low, high = pd_mean_interval(self.matched, far_max, **self._bootstrap)
        value = held_pd_mean(self.curve, far_max)
        by_chance = pd_mean_by_chance(self.curve, far_max)
        return {"value": value, "low": low, "high": high, "chance": by_chance, "far_max": far_max}

    @property
    def _bootstrap(self) -> Entries:
        """The rules that the bootstrap takes."""
        names = ("area", "frame_area", "level", "draws", "seed", "block", "cluster")
        return {name: getattr(self.rules, name) for name in names}

    @property
    def too_small(self) -> bool:
        """Whether the operating point of the rules allows less than one false alarm on the lane."""
        return self.far > self.rules.far

    @property
    def few_halos(self) -> float | None:
        """Number of halos that the area of the FAR has room for, if it is small; else None.

        With few, the chance level by moved targets is a rough one.
        """
        halos = float(self.curve.attrs["area"]) / (math.pi * self.matched.halo**2)
        return halos if halos < _FEW_HALOS else None

    @property
    def point(self) -> Entries:
        """The curve's row at the operating point.

        Its entry ``random`` is the Pd of alarms strewn at random at the same FAR.
        """
        row = self.curve.iloc[[int(operating_row(self.curve, self.far))]]
        entries = {str(name): values[0] for name, values in row.to_dict("list").items()}
        return entries | {"random": float(random_pd(entries["far"], self.matched.halo))}

    def in_words(self) -> str:
        """Return a sentence on what is found at the operating point and what chance finds there."""
        point = self.point
        if not point["n_targets"]:
            last = self.curve.iloc[-1]
            return f"no targets, {last['n_false']:.0f} false alarms on {last['area']:.2f} m²"
        allowed = f"{self.far:g} false alarms per m²"
        if self.too_small:
            reason = f"{point['area']:.2f} m² are too small for {self.rules.far:g}"
            allowed = f"one false alarm ({self.far:.2g} per m²; {reason})"
        by_chance = "not known" if math.isnan(point["chance"]) else f"{point['chance']:.2f}"
        if self.few_halos is not None:
            by_chance += f" (strewn at random {point['random']:.2f})"
        return (
            f"{point['n_detected']:.0f} of {point['n_targets']:.0f} targets found at {allowed}: "
            f"Pd {point['pd']:.2f}, {100 * self.rules.level:g} % interval "
            f"{point['pd_low']:.2f} to {point['pd_high']:.2f}, chance {by_chance}"
        )

    @property
    def noun(self) -> str:
        """What the targets are called: "mine" where all of them are mines, else "target"."""
        kinds = set(self.matched.truth["kind"].astype(str))
        return "mine" if kinds and kinds <= _MINES else "target"

    def in_plain_words(self, when: str = "") -> str:
        """Return a sentence on what is found and missed that asks for no knowledge of scoring.

        Parameters
        ----------
        when : str
            What is said of when they were found, such as " before the vehicle reached them".
        """
        point = self.point
        n_targets = int(point["n_targets"])
        if not n_targets:
            last = self.curve.iloc[-1]
            false_alarms = _counted(int(last["n_false"]), "false alarm")
            return f"There was nothing to find: {false_alarms} on {_square_metres(last['area'])}"
        sentence = (
            f"{point['n_detected']:.0f} of {_counted(n_targets, self.noun)} "
            f"{'was' if n_targets == 1 else 'were'} found{when}, "
            f"with {_counted(int(point['n_false']), 'false alarm')}"
        )
        if point["area"] > 0:
            sentence += f" on {_square_metres(point['area'])} of other ground"
        as_many = self.curve[self.curve["n_detected"] == point["n_detected"]]
        fewest = int(as_many["n_false"].min())
        if point["n_detected"] > 0 and fewest < point["n_false"]:
            sentence += f" (as many with {fewest or 'none'})"
        missed = self.missed()
        if 0 < len(missed) <= _MOST_NAMED:
            sentence += f"; missed: {', '.join(map(_named, missed.to_dict('records')))}"
        return sentence

    def kinds(self) -> dict[str, pd.DataFrame]:
        """Compute the curve of each kind of target, and the Pd that chance gives for it."""
        kinds = self.matched.truth["kind"].astype(str)
        curves = {}
        for name in sorted(kinds.unique()):
            curves[name] = self.curve_of((kinds == name).to_numpy())
        return curves

    def curve_of(self, rows: BoolArray | None) -> pd.DataFrame:
        """Compute the curve of some targets, or of all, with the Pd that chance gives."""
        return curve_by(self.rules, self.matched, self.chance, rows)

    def bands(
        self, by: Literal["kind", "depth"] | None = None
    ) -> dict[str, tuple[pd.DataFrame, pd.DataFrame]]:
        """Compute curve and simultaneous band of all targets, or of each group of them.

        Parameters
        ----------
        by : {"kind", "depth"}, optional
            Property that forms the groups; by default all targets are one group, ``all``.

        Returns
        -------
        dict of str to (DataFrame, DataFrame)
            Curve and band by group; none without targets.
        """
        truth = self.matched.truth
        if not len(truth):
            return {}
        grid = np.linspace(0, self.rules.far_max, 101)
        if by is None:
            return {"all": (self.curve, band(self.matched, None, grid, **self._bootstrap))}
        if by == "kind":
            groups = truth["kind"].astype(str)
            names = sorted(groups.unique())
        else:
            groups = depth_classes(truth["depth"], DEPTH_EDGES)
            names = list(groups.cat.categories)
        bands = {}
        for name in names:
            rows = (groups == name).to_numpy()
            band_of_rows = band(self.matched, rows, grid, **self._bootstrap)
            bands[name] = (self.curve_of(rows), band_of_rows)
        return bands

    def operating_points(self, curve: pd.DataFrame | None = None) -> pd.DataFrame:
        """Return the rows of a curve at common false alarm rates and at the operating point.

        Parameters
        ----------
        curve : DataFrame, optional
            ROC table, by default that of all targets.

        Returns
        -------
        DataFrame
            Rows of the curve with ``far_allowed``, the rate of each, per m².
        """
        curve = self.curve if curve is None else curve
        far_max = self.rules.far_max
        common = [far for far in _COMMON_RATES if far <= far_max]
        allowed = sorted({*common, far_max, self.far})
        return curve.iloc[operating_row(curve, allowed)].assign(far_allowed=allowed)

    def breakdown(self) -> pd.DataFrame:
        """Tabulate Pd by kind, depth and soil, see :func:`flgpr.scoring.pd_table`."""
        return pd_table(
            self.matched,
            self.far,
            area=self.rules.area,
            frame_area=self.rules.frame_area,
            level=self.rules.level,
            chance=self.chance,
        )

    def missed(self) -> pd.DataFrame:
        """Return the outcomes of targets not found at the operating point, the hardest first."""
        missed = self.outcomes[~self.outcomes["found"]]
        return missed.sort_values("far", ascending=False, kind="stable")

    def worst_false_alarms(self, most: int) -> pd.DataFrame:
        """Return the labels of the most confident false alarms.

        Parameters
        ----------
        most : int
            Number of alarms.

        Returns
        -------
        DataFrame
            Rows of ``labels`` with ``found_above``, the number of targets found above each.
        """
        false = self.labels[self.labels["label"] == "false"]
        worst = false.sort_values("confidence", ascending=False, kind="stable").head(most)
        thresholds = self.curve["threshold"].to_numpy()
        n_detected = self.curve["n_detected"].to_numpy()
        row = [int((thresholds > confidence).sum()) - 1 for confidence in worst["confidence"]]
        return worst.assign(found_above=n_detected[row])

    def rules_summary(self) -> RulesEntries:
        """Return the convention and all choices, which are the same for all lists of a lane."""
        stated = {}
        for name, value in self.curve.attrs.items():
            if name not in COUNTS:
                stated[str(name)] = value
        stated["far"] = self.rules.far
        stated["bootstrap"] = {"draws": self.rules.draws, "seed": self.rules.seed}
        stated["chance"] = {"shifts": self.rules.shifts, "seed": self.rules.seed}
        if self.survey is not None:
            stated["survey_error"] = asdict(self.survey)
        return cast(RulesEntries, stated)

    def summary(self) -> DetectionEntries:
        """Return counts, operating point, PD_mean, curve, kinds and outcomes as nested entries."""
        counts = self.curve.attrs
        operating_point = {"far_asked": self.rules.far, "far_allowed": self.far, **self.point}
        points = self.curve.drop(columns=list(_SAME_IN_ALL_ROWS)).to_dict("records")
        return {
            "title": self.title,
            "n_alarms": counts["n_alarms"],
            "n_targets": counts["n_targets"],
            "n_known_targets": counts["n_known_targets"],
            "area": counts["area"],
            "n_false": self.curve["n_false"].iloc[-1],
            "operating_point": cast(OperatingPoint, operating_point),
            "pd_mean": self.pd_mean,
            "points": cast(list[CurvePoint], points),
            "kinds": {name: self._kind_summary(curve) for name, curve in self.kinds().items()},
            "targets": cast(list[TargetOutcome], self.outcomes.to_dict("records")),
        }

    def _kind_summary(self, curve: pd.DataFrame) -> KindEntries:
        """Return targets, PD_mean and operating points of the curve of one kind of target."""
        far_max = self.rules.far_max
        mean: MeanPd = {
            "value": held_pd_mean(curve, far_max),
            "chance": pd_mean_by_chance(curve, far_max),
        }
        points = self.operating_points(curve).drop(columns=["threshold", *_SAME_IN_ALL_ROWS])
        return {
            "n_targets": curve.attrs["n_targets"],
            "pd_mean": mean,
            "points": cast(list[KindPoint], points.to_dict("records")),
        }


def _counted(count: int, noun: str) -> str:
    """Return a number and what is counted, in the singular or plural."""
    return f"{count or 'no'} {noun}{'' if count == 1 else 's'}"


def _square_metres(area: float) -> str:
    """Return an area, m², to three digits or to the square metre."""
    return f"{area:.0f} m²" if area >= 100 else f"{area:.3g} m²"


def _named(target: Mapping[Any, Any]) -> str:
    """Return a target by its kind and depth."""
    depth = 100 * target["depth"]
    if math.isnan(depth):
        return f"{target['kind']}"
    if depth <= 0:
        return f"{target['kind']} on the ground"
    return f"{target['kind']} {depth:.3g} cm deep"


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
        Tables and lane, as for :func:`flgpr.scoring.roc`.
    rules : Rules, optional
        Scoring rules and confidence level.
    name, title : str
        What the list is called, for a machine and in words.

    Returns
    -------
    Score
        The score.

    Raises
    ------
    ValueError
        If a table, the lane or a rule is not valid.

    Examples
    --------
    >>> import pandas as pd
    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import Rules, score
    >>> alarms = pd.DataFrame({"x": [0.2, 1.0], "y": [10.3, 44.0], "confidence": [3, 2]})
    >>> truth = pd.DataFrame({"target_id": ["a", "b"], "x": [0.0, -1.0], "y": [10.0, 30.0]})
    >>> truth = truth.assign(kind="metal", depth=0.05)
    >>> scored = score(alarms, truth, Lane(-2.0, 2.0, 0.0, 60.0), Rules(halo=0.5, draws=100))
    >>> scored.outcomes["detected"].tolist(), scored.labels["label"].tolist()
    ([True, False], ['detection', 'false'])
    >>> scored.in_words().split(": ")[1]
    'Pd 0.50, 95 % interval 0.01 to 0.99, chance 0.00'
    """
    rules = rules or Rules()
    if not (math.isfinite(rules.far) and rules.far > 0):
        raise ValueError(f"far must be a positive number of false alarms per m², got {rules.far}")
    matched = match(
        alarms, truth, lane, rules.halo, halo_as=rules.halo_as, refraction=rules.refraction
    )
    survey = None if rules.survey_error is None else survey_share(rules.survey_error, matched.halo)
    level = chance(matched, rules.shifts, rules.seed)
    curve = curve_by(rules, matched, level)
    far = max(rules.far, 1 / curve.attrs["area"])
    return Score(
        name=name,
        title=title,
        rules=rules,
        matched=matched,
        curve=curve,
        far=far,
        outcomes=_outcomes(matched, rules, far),
        labels=label_alarms(matched),
        chance=level,
        survey=survey,
    )


def curve_by(rules: Rules, matched: Match, level: Chance, subset: Subset = None) -> pd.DataFrame:
    """Compute the curve of some targets, or of all, with the Pd that chance gives."""
    curve = roc_of(matched, subset, area=rules.area, frame_area=rules.frame_area, level=rules.level)
    return level.add_chance_column(curve, subset)


def _outcomes(matched: Match, rules: Rules, far: float) -> pd.DataFrame:
    """Return the best alarm of every target, its offset, and whether it is found at ``far``."""
    outcomes = assign(matched, rules.area, rules.frame_area)
    best = outcomes["alarm"].to_numpy(dtype=int)
    for axis in ("x", "y"):
        # The NaN at the end is what a target without an alarm, -1, takes.
        positions = np.append(matched.alarms[axis], np.nan)
        outcomes["d" + axis] = positions[best] - outcomes[axis]
    outcomes["found"] = outcomes["far"] <= far
    return outcomes
