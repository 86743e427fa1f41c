"""One alarm list, scored: everything that the files and the page of a score tell."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.scoring.bootstrap import band, pd_mean_interval
from flgpr.scoring.breakdown import DEPTH_EDGES, depth_classes, pd_table
from flgpr.scoring.chance_level import SHIFTS, Chance, chance, random_pd
from flgpr.scoring.curve import operating_row, pd_mean, pd_mean_by_chance
from flgpr.scoring.lane_roc import assign, label_alarms, roc_of
from flgpr.scoring.matching import LaneLike, Match, match
from flgpr.scoring.places import Refraction, SurveyShare, survey_share

COUNTS = ("n_alarms", "n_targets", "n_known_targets", "area")
_COUNTED = ("n_targets", "area")  # the same in all rows of a curve
_FEW_HALOS = 20
_FIRST_POINTS = (0.005, 0.01, 0.02, 0.05, 0.1)


@dataclass(frozen=True, kw_only=True)
class Rules:
    """By which rules an alarm list is scored, and how sure its figures are said to be."""

    #: halo, halo_as, area, frame_area, refraction, survey_error: as for :func:`flgpr.scoring.roc`
    halo: float = 1.0
    halo_as: Literal["radius", "diameter"] = "radius"
    area: Literal["union", "paper", "frames"] = "union"
    frame_area: float | None = None
    refraction: Refraction | None = None
    survey_error: float | None = None
    # : operating point at which targets count as found or missed and Pd is broken down, per m²
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
    """One alarm list, scored."""

    #: name, title: what was scored, for a machine and in words; the main list of a lane is ``main``
    name: str
    title: str
    rules: Rules  #: how
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
    labels: pd.DataFrame = field(
        repr=False
    )  #: one row per alarm as :func:`flgpr.scoring.label_alarms` gives it
    chance: Chance = field(repr=False)  #: what alarms that know nothing of the targets find
    survey: SurveyShare | None  #: what the error of the survey takes of the halo, if it is known

    @cached_property
    def pd_mean(self) -> dict[str, float] | None:
        """PD_mean, ``value``, ``low`` and ``high`` by bootstrap, ``chance`` and ``far_max``; None without targets."""
        if not len(self.matched.truth):
            return None
        far_max = self.rules.far_max
        low, high = pd_mean_interval(self.matched, far_max, **self._bootstrap)
        value = pd_mean(self.curve, far_max)
        by_chance = pd_mean_by_chance(self.curve, far_max)
        return {"value": value, "low": low, "high": high, "chance": by_chance, "far_max": far_max}

    @property
    def _bootstrap(self) -> dict[str, Any]:
        return {
            name: getattr(self.rules, name)
            for name in ("area", "frame_area", "level", "draws", "seed", "block", "cluster")
        }

    @property
    def too_small(self) -> bool:
        """Whether the lane is too small for the operating point of the rules: it allows less than one false alarm."""
        return self.far > self.rules.far

    @property
    def few_halos(self) -> float | None:
        """How many halos the ground of the FAR has room for, if so few that moved targets tell chance but roughly."""
        room = float(self.curve.attrs["area"]) / (math.pi * self.matched.halo**2)
        return room if room < _FEW_HALOS else None

    @property
    def point(self) -> dict[str, Any]:
        """The curve's row at the operating point, and ``random``, the Pd of alarms strewn at random at its FAR."""
        row = self.curve.iloc[[int(operating_row(self.curve, self.far))]]
        told = {str(name): values[0] for name, values in row.to_dict("list").items()}
        return told | {"random": float(random_pd(told["far"], self.matched.halo))}

    def in_words(self) -> str:
        """Say in a sentence what is found at the operating point, and what chance gives there."""
        point = self.point
        if not point["n_targets"]:
            last = self.curve.iloc[-1]
            return f"no targets, {last['n_false']:.0f} false alarms on {last['area']:.2f} m²"
        where = f"{self.far:g} false alarms per m²"
        if self.too_small:
            small = f"{point['area']:.2f} m² are too small for {self.rules.far:g}"
            where = f"one false alarm ({self.far:.2g} per m²; {small})"
        by_chance = "not known" if math.isnan(point["chance"]) else f"{point['chance']:.2f}"
        if self.few_halos is not None:
            by_chance += f" (strewn at random {point['random']:.2f})"
        return (
            f"{point['n_detected']:.0f} of {point['n_targets']:.0f} targets found at {where}: Pd {point['pd']:.2f}, "
            f"{100 * self.rules.level:g} % interval {point['pd_low']:.2f} to {point['pd_high']:.2f}, chance {by_chance}"
        )

    def kinds(self) -> dict[str, pd.DataFrame]:
        """Compute the curve of each kind of target, and the Pd that chance gives for it."""
        kinds = self.matched.truth["kind"].astype(str)
        return {name: self._curve_of((kinds == name).to_numpy()) for name in sorted(kinds.unique())}

    def _curve_of(self, rows: NDArray[np.bool_]) -> pd.DataFrame:
        options = {
            "area": self.rules.area,
            "frame_area": self.rules.frame_area,
            "level": self.rules.level,
        }
        return self.chance.add_chance_column(roc_of(self.matched, rows, **options), rows)  # type: ignore[arg-type]

    def bands(
        self, by: Literal["kind", "depth"] | None = None
    ) -> dict[str, tuple[pd.DataFrame, pd.DataFrame]]:
        """Compute curve and simultaneous band of all targets, or of each group of them; none without targets."""
        truth = self.matched.truth
        if not len(truth):
            return {}
        grid = np.linspace(0, self.rules.far_max, 101)
        if by is None:
            return {"all": (self.curve, band(self.matched, None, grid, **self._bootstrap))}
        if by == "kind":
            groups = truth["kind"].astype(str)
            names = sorted(map(str, truth["kind"].unique()))
        else:
            groups = depth_classes(truth["depth"], DEPTH_EDGES)
            names = list(groups.cat.categories)
        chosen = {str(name): (groups == name).to_numpy() for name in names}
        return {
            name: (self._curve_of(rows), band(self.matched, rows, grid, **self._bootstrap))
            for name, rows in chosen.items()
        }

    def operating_points(self, curve: pd.DataFrame | None = None) -> pd.DataFrame:
        """Read the curve, or another of this score, at common false alarm rates, ``far_allowed``, and at ``far``."""
        curve = self.curve if curve is None else curve
        far_max = self.rules.far_max
        allowed = sorted({*(far for far in _FIRST_POINTS if far <= far_max), far_max, self.far})
        return curve.iloc[operating_row(curve, allowed)].assign(far_allowed=allowed)

    def breakdown(self) -> pd.DataFrame:
        """Tabulate Pd by kind, depth and soil, see :func:`flgpr.scoring.pd_table`."""
        options: dict[str, Any] = {"area": self.rules.area, "frame_area": self.rules.frame_area}
        return pd_table(
            self.matched, self.far, level=self.rules.level, chance=self.chance, **options
        )

    def missed(self) -> pd.DataFrame:
        """Take the outcomes of the targets that are not found at the operating point, the hardest first."""
        missed = self.outcomes[~self.outcomes["found"]]
        return missed.sort_values("far", ascending=False, kind="stable")

    def worst_false_alarms(self, most: int) -> pd.DataFrame:
        """Take the labels of the most confident false alarms, and ``found_above``, the targets found above each."""
        false = self.labels[self.labels["label"] == "false"]
        worst = false.sort_values("confidence", ascending=False, kind="stable").head(most)
        thresholds = self.curve["threshold"].to_numpy()
        found = self.curve["n_detected"].to_numpy()
        row = [int((thresholds > confidence).sum()) - 1 for confidence in worst["confidence"]]
        return worst.assign(found_above=found[row])

    def rules_summary(self) -> dict[str, Any]:
        """Tell the convention and all choices, the same for all lists of a lane."""
        convention = {
            str(name): value for name, value in self.curve.attrs.items() if name not in COUNTS
        }
        seed = {"seed": self.rules.seed}
        draws: dict[str, Any] = {
            "bootstrap": {"draws": self.rules.draws} | seed, "chance": {"shifts": self.rules.shifts} | seed,
        }  # fmt: skip
        survey = {} if self.survey is None else {"survey_error": asdict(self.survey)}
        return convention | {"far": self.rules.far} | draws | survey

    def summary(self) -> dict[str, Any]:
        """Tell counts, operating point, PD_mean, the points of the curve, kinds, and what became of each target."""
        return {
            "title": self.title,
            **{name: self.curve.attrs[name] for name in COUNTS},
            "n_false": self.curve["n_false"].iloc[-1],
            "operating_point": {"far_asked": self.rules.far, "far_allowed": self.far, **self.point},
            "pd_mean": self.pd_mean,
            "points": self.curve.drop(columns=list(_COUNTED)).to_dict("records"),
            "kinds": {name: self._told_kind(curve) for name, curve in self.kinds().items()},
            "targets": self.outcomes.to_dict("records"),
        }

    def _told_kind(self, curve: pd.DataFrame) -> dict[str, Any]:
        far_max = self.rules.far_max
        mean = {"value": pd_mean(curve, far_max), "chance": pd_mean_by_chance(curve, far_max)}
        points = self.operating_points(curve).drop(columns=["threshold", *_COUNTED])
        return {
            "n_targets": curve.attrs["n_targets"],
            "pd_mean": mean,
            "points": points.to_dict("records"),
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

    Tables and lane are as for :func:`flgpr.scoring.roc`; name and title say what the list is
    called.

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
    >>> scored.in_words()
    '1 of 2 targets found at 0.05 false alarms per m²: Pd 0.50, 95 % interval 0.01 to 0.99, chance
    0.00'
    """
    rules = rules or Rules()
    if not (math.isfinite(rules.far) and rules.far > 0):
        raise ValueError(f"far must be a positive number of false alarms per m², got {rules.far}")
    matched = match(
        alarms, truth, lane, rules.halo, halo_as=rules.halo_as, refraction=rules.refraction
    )
    survey = None if rules.survey_error is None else survey_share(rules.survey_error, matched.halo)
    level = chance(matched, rules.shifts, rules.seed)
    curve = level.add_chance_column(
        roc_of(matched, area=rules.area, frame_area=rules.frame_area, level=rules.level)
    )
    far = max(rules.far, 1 / curve.attrs["area"])
    outcomes = assign(matched, rules.area, rules.frame_area)
    best = outcomes["alarm"].to_numpy(dtype=int)
    for axis in ("x", "y"):
        place = np.append(matched.alarms[axis].to_numpy(dtype=float), np.nan)[
            best
        ]  # -1, no alarm, takes the NaN
        outcomes["d" + axis] = place - outcomes[axis]
    outcomes["found"] = outcomes["far"] <= far
    return Score(
        name, title, rules, matched, curve, far, outcomes, label_alarms(matched), level, survey
    )
