"""Tables I-IV and curves of Wang et al. 2007 from detections and truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.detect import Fold, SearchStep, forward_search, make_fold, single_features
from flgpr.features import FEATURES
from flgpr.method.classifier import count_mines, duplication, label_lanes
from flgpr.model import Lane
from flgpr.scoring import Match, match, pd_mean_interval
from flgpr.scoring.bootstrap import Scores, make_design, make_scores
from flgpr.scoring.lane_roc import AreaRule, far_area
from flgpr.scoring.matching import Subset, select_targets
from flgpr.screen import prescreen
from flgpr.types import AnyArray, Entries, FloatArray, floats

MINES = {"kind": lambda kind: kind != "simulant"}
"""Subset of the targets: actual mines."""
BURIED_METAL = {"kind": "metal", "depth": lambda depth: depth > 0}
BURIED_PLASTIC = {"kind": "plastic", "depth": lambda depth: depth > 0}
SIMULANTS = {"kind": "simulant"}
METHODS = {
    "A": "resubstitution with duplication",
    "B": "resubstitution without duplication",
    "C": "cross-validation with duplication",
    "D": "cross-validation without duplication",
}
SUBBANDS = ("F1", "F2", "F3", "F4")
BANDS = ("F0", *SUBBANDS)
POLARIZATIONS = ("HH", "VV", "HV")
_STRETCH = 10.0  # m of lane in which clutter is looked at
FAR_MAX = 0.1
"""False alarms per m² up to which Pd is averaged."""
AREA: AreaRule = "paper"
"""Area of FAR by the paper's rule 6 (Sec. II-F): lane less N·π·r².

Every halo counts with all of its area, wherever it lies.
"""


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
    area : {"union", "paper"}
        Rule of the FAR's area where nothing is resampled, see :func:`flgpr.scoring.roc`.
    """

    def __init__(
        self,
        reference: Match,
        subset: Subset = None,
        area: AreaRule = AREA,
    ) -> None:
        chosen = select_targets(reference.truth, subset)
        number = np.where(chosen, np.cumsum(chosen) - 1, -1)[reference.pair_target]
        self._alarm = reference.pair_alarm[number >= 0]
        self._pair = number[number >= 0]
        self._targets = np.flatnonzero(chosen)
        self._false = np.flatnonzero(reference.false)
        self.area = far_area(reference, area)

    def __call__(self, confidence: FloatArray, draw: Draw | None = None) -> float:
        """Compute the mean of Pd up to ``FAR_MAX``, as :func:`flgpr.scoring.pd_mean` of the curve.

        An alarm with the confidence -inf is never declared.
        """
        scores, target, weight, area = self._scores(confidence, draw)
        return float(scores.shares(FAR_MAX, weight, area) @ target / target.sum())

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


@dataclass(frozen=True)
class LaneResult:
    """Result of a lane, and its truth."""

    name: str  #: the lane's name
    lane: Lane  #: its borders
    truth: pd.DataFrame  #: its targets
    alarms: pd.DataFrame  #: alarms of the prescreener
    features: pd.DataFrame  #: their features, row by row
    view: xr.DataArray  #: run-view (polarization, subband, y, x)
    #: other run-views (y, x) of the prescreener's channel, by name: over the full range of the
    #: images, and by the largest and the mean look
    other_views: Mapping[str, xr.DataArray]

    @property
    def training(self) -> tuple[str, pd.DataFrame, pd.DataFrame, pd.DataFrame, Lane]:
        """What classifiers are trained with."""
        return self.name, self.alarms, self.features, self.truth, self.lane

    @property
    def length(self) -> float:
        """Length of the lane, m."""
        return self.lane.y_max - self.lane.y_min


def matched(results: Sequence[LaneResult], tables: Sequence[pd.DataFrame]) -> Match:
    """Match alarms of several lanes to their targets with the paper's halo of 1 m.

    Parameters
    ----------
    results : sequence of LaneResult
        The lanes.
    tables : sequence of DataFrame
        Alarms of each lane, with the confidence that counts.
    """
    alarms = []
    truth = []
    for result, table in zip(results, tables, strict=True):
        alarms.append(table[["x", "y", "confidence"]].assign(lane=result.name))
        target_id = result.name + "-" + result.truth["target_id"]
        truth.append(result.truth.assign(lane=result.name, target_id=target_id))
    lanes = {result.name: result.lane for result in results}
    return match(pd.concat(alarms, ignore_index=True), pd.concat(truth, ignore_index=True), lanes)


def ranked(results: Sequence[LaneResult], confidences: Sequence[Any]) -> Match:
    """Match alarms with other confidences (alarm,), lane by lane; unknown ones are left out."""
    tables = []
    for result, confidence in zip(results, confidences, strict=True):
        table = result.alarms.assign(confidence=confidence)
        tables.append(table[np.isfinite(table["confidence"])])
    return matched(results, tables)


class Pool:
    """All alarms of the calibration lanes, labelled, for training and testing.

    Parameters
    ----------
    results : sequence of LaneResult
        The calibration lanes.
    """

    def __init__(self, results: Sequence[LaneResult]) -> None:
        self.results = list(results)
        self.features = pd.concat([result.features for result in results], ignore_index=True)
        self.labels = label_lanes([result.training for result in results])
        self.reference = matched(results, [result.alarms for result in results])
        self.scorer = Rescorer(self.reference, MINES)
        self.lanes = [result.name for result in results]

    def draws(self, count: int, seed: int = 0, subset: Any = MINES) -> Iterator[Draw]:
        """Yield bootstrap draws of lanes, targets and stretches of lane.

        A draw holds two lanes at least, so that one can be left out, and a mine and a target of the
        subset at least.

        Parameters
        ----------
        count : int
            Number of draws.
        seed : int
            Seed of the draws.
        subset : object
            Targets of which a draw has to hold one.
        """
        design = make_design(self.reference, area=AREA)
        rng = np.random.default_rng(seed)
        false = np.flatnonzero(self.reference.false)
        false = false[np.argsort(-self.reference.confidence[false], kind="stable")]
        block = make_scores(self.reference, design).block
        hit = self.labels["target"].to_numpy()
        mines = select_targets(self.reference.truth, MINES)
        of_subset = select_targets(self.reference.truth, subset)
        while count:
            target, weight = design.draw(rng)
            drawn_lanes = np.unique(design.target_lane[target > 0])
            can_leave_one_out = len(drawn_lanes) > 1 or len(self.lanes) == 1
            if can_leave_one_out and target[mines].any() and target[of_subset].any():
                alarm = np.where(hit >= 0, target[hit], 1.0)
                alarm[false] = weight[block]
                count -= 1
                yield Draw(target, alarm, float((weight * design.block_area).sum()))

    def folds(
        self,
        columns: Sequence[str],
        cross: bool,
        duplicate: bool,
        only: Sequence[str] | None = None,
        draw: Draw | None = None,
    ) -> list[Fold]:
        """Return the folds of a method.

        Parameters
        ----------
        columns : sequence of str
            Columns of the features; alarms that lack one are left out.
        cross : bool
            Whether a lane at a time is tested, with training on the others.
        duplicate : bool
            Whether examples are duplicated, so that every mine counts alike.
        only : sequence of str, optional
            Lanes that are used at all.
        draw : Draw, optional
            Weights of the examples.
        """
        known = np.isfinite(floats(self.features[list(columns)])).all(axis=1)
        lane = self.labels["lane"].to_numpy()
        on_lane = known & np.isin(lane, list(only or self.lanes))
        if not cross:
            return [self._fold(columns, on_lane, on_lane, duplicate, draw)]
        return [
            self._fold(columns, on_lane & (lane != name), on_lane & (lane == name), duplicate, draw)
            for name in only or self.lanes
        ]

    def _fold(
        self,
        columns: Sequence[str],
        train: Any,
        test: Any,
        duplicate: bool,
        draw: Draw | None = None,
    ) -> Fold:
        """Return a fold of lanes; a draw weighs its examples."""
        labels = self.labels
        use = train & (labels["label"] != "neither").to_numpy()
        training_lanes = set(labels["lane"][train])
        mines = count_mines(
            result.truth for result in self.results if result.name in training_lanes
        )
        weight = np.ones(len(labels), np.int64)
        if duplicate:
            weight[use] = duplication(labels[use], mines)
        if draw is not None:
            use = use & (draw.alarm > 0)
            weight = weight * draw.alarm.astype(np.int64)
        hit = (labels["label"] == "hit").to_numpy().astype(np.int64)
        return make_fold(
            np.nan_to_num(floats(self.features[list(columns)])), hit, weight, use, test
        )

    def singles(self, columns: Sequence[str], method: str) -> FloatArray:
        """Return PD_mean (feature,) of every feature on its own by a method A-D."""
        folds = self.folds(columns, *_settings(method))
        return single_features(folds, len(self.labels), self.scorer)

    def search(
        self, columns: Sequence[str], method: str, steps: int | None = None
    ) -> list[SearchStep]:
        """Search forward for the best features by a method A-D."""
        folds = self.folds(columns, *_settings(method))
        return forward_search(folds, len(self.labels), self.scorer, steps)

    def confidence(
        self, columns: Sequence[str], method: str, draw: Draw | None = None
    ) -> FloatArray:
        """Return confidences (alarm,) with a fixed set of features by a method A-D.

        They are -inf where a feature is missing. A draw weighs the examples.
        """
        folds = self.folds(columns, *_settings(method), draw=draw)
        return _refit(folds, len(self.labels))

    def in_draws(
        self, score: Callable[..., Any], columns: Sequence[str], methods: str, draws: int
    ) -> dict[str, FloatArray]:
        """Return the scores (draw, ...) of folds by methods A-D in every draw."""
        scores: dict[str, list[Any]] = {method: [] for method in methods}
        for draw in self.draws(draws):
            scorer = partial(self.scorer, draw=draw)
            for method, rows in scores.items():
                folds = self.folds(columns, *_settings(method), draw=draw)
                rows.append(score(folds, len(self.labels), scorer))
        return {method: np.array(rows) for method, rows in scores.items()}

    def scorer_of(self, subset: Any) -> Rescorer:
        """Return a function of confidences that computes PD_mean of some of the targets.

        That of mines is the attribute ``scorer``.
        """
        return Rescorer(self.reference, subset)

    def retrained(
        self, columns: Sequence[str], method: str, draws: int, subset: Any = MINES
    ) -> FloatArray:
        """Return PD_mean (draw,) of some targets by fixed features and a method A-D.

        It is trained anew in every draw.
        """
        score = self.scorer_of(subset)
        drawn = self.draws(draws, subset=subset)
        return np.array([score(self.confidence(columns, method, draw), draw) for draw in drawn])

    def bands(
        self, columns: Sequence[str], method: str, subset: Any, far: FloatArray, draws: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return the 95 % bands (2, far) of a ROC, and those with training in every draw.

        Parameters
        ----------
        columns : sequence of str
            Columns of the features.
        method : str
            Method, "A" to "D".
        subset : object
            Targets that count.
        far : (far,) ndarray
            False alarms per m².
        draws : int
            Number of bootstrap draws.
        """
        scorer = self.scorer_of(subset)
        confidence = self.confidence(columns, method)
        curves = []
        for draw in self.draws(draws):
            again = self.confidence(columns, method, draw)
            curves.append([scorer.pd_at(values, far, draw) for values in (confidence, again)])
        trained, anew = np.swapaxes(np.nanquantile(np.array(curves), (0.025, 0.975), axis=0), 0, 1)
        return trained, anew

    def outranks(self, column: str, draws: int) -> tuple[float, FloatArray]:
        """Return how often a hit on a mine has more of a feature than a false alarm, and in draws.

        Draws without such a pair, whose mines raised no alarm, are left out.

        Parameters
        ----------
        column : str
            Column of the feature.
        draws : int
            Number of bootstrap draws.
        """
        values = floats(self.features[column])
        labels = self.labels
        is_known = np.isfinite(values)
        hit = is_known & ((labels["label"] == "hit") & (labels["beta"] == 1)).to_numpy()
        false = is_known & (labels["label"] == "false").to_numpy()
        wins = (np.sign(values[hit][:, None] - values[false][None]) + 1) / 2
        if not wins.size:
            return float("nan"), np.full(draws, np.nan)
        shares = []
        for draw in self.draws(draws):
            hits = draw.alarm[hit]
            falses = draw.alarm[false]
            if hits.any() and falses.any():
                shares.append(hits @ wins @ falses / (hits.sum() * falses.sum()))
        return float(wins.mean()), np.array(shares)

    def magnitude(self) -> FloatArray:
        """Return the magnitude of all alarms, which is what the prescreener goes by."""
        magnitudes = [result.alarms["magnitude"] for result in self.results]
        return floats(np.concatenate(magnitudes))

    def nested(
        self, columns: Sequence[str], steps: int
    ) -> tuple[float, FloatArray, list[list[str]]]:
        """Return PD_mean, confidences and features of nested searches.

        Each lane is scored with features that a search without it has chosen.

        Parameters
        ----------
        columns : sequence of str
            Columns of the features.
        steps : int
            Steps of a search at the most.
        """
        confidence = np.full(len(self.labels), -np.inf)
        lane = self.labels["lane"].to_numpy()
        chosen = []
        for name in self.lanes:
            names = self._search_without(name, columns, steps)
            is_known = np.isfinite(floats(self.features[names])).all(axis=1)
            fold = self._fold(names, is_known & (lane != name), is_known & (lane == name), True)
            confidence[fold.samples] = _refit([fold], len(self.labels))[fold.samples]
            chosen.append(names)
        return self.scorer(confidence), confidence, chosen

    def _search_without(self, name: str, columns: Sequence[str], steps: int) -> list[str]:
        """Return the features that a search without a lane scores best with."""
        other_lanes = [lane for lane in self.lanes if lane != name]
        folds = self.folds(columns, len(other_lanes) > 1, True, other_lanes)
        results = [result for result in self.results if result.name in other_lanes]
        reference = matched(results, [result.alarms for result in results])
        scorer = Rescorer(reference, MINES)
        rows = np.flatnonzero(np.isin(self.labels["lane"], other_lanes))

        search = forward_search(
            folds, len(self.labels), lambda confidence: scorer(confidence[rows]), steps
        )
        best = int(np.argmax([step.score for step in search])) + 1
        return [columns[step.feature] for step in search[:best]]

    def match_of(self, confidence: FloatArray) -> Match:
        """Match the alarms with other confidences (alarm,); unknown ones are left out."""
        lane = self.labels["lane"].to_numpy()
        return ranked(self.results, [confidence[lane == name] for name in self.lanes])

    def interval(self, confidence: FloatArray, draws: int = 1000) -> tuple[float, float]:
        """Return the 95 % interval of PD_mean of actual mines.

        Targets, lanes and stretches of lane are drawn anew.
        """
        return pd_mean_interval(self.match_of(confidence), FAR_MAX, MINES, area=AREA, draws=draws)


def prescreened(
    results: Sequence[LaneResult], polarization: str, subband: str, recipe: Any
) -> Match:
    """Return the alarms of another channel's run-view by the same prescreener.

    Their confidence is the magnitude.

    Parameters
    ----------
    results : sequence of LaneResult
        The lanes.
    polarization, subband : str
        The channel; other run-views of the prescreener's are named as if they were sub-bands.
    recipe : Recipe
        Recipe of the study.

    Raises
    ------
    ValueError
        If a lane has no such run-view.
    """
    tables = []
    for result in results:
        if subband in BANDS:
            view = result.view.sel(polarization=polarization, subband=subband)
        elif subband in result.other_views:
            view = result.other_views[subband]
        else:
            raise ValueError(
                f"lane {result.name} must have a run-view {subband!r}, got {list(result.other_views)}"
            )
        screen = recipe.prescreen
        alarms = prescreen(view, result.lane, screen.radius, screen.density, screen.count)
        tables.append(alarms.assign(confidence=alarms["magnitude"]))
    return matched(results, tables)


def clutter_levels(results: Sequence[LaneResult], clear: float = 1.5) -> pd.DataFrame:
    """Return how far clutter stands out in the run-views, by stretches of lane (Fig. 8).

    Images are in units of their background, so that their mean level tells nothing. The level of a
    channel is the 99 % quantile of its magnitude over the median, dB, away from every target.

    Parameters
    ----------
    results : sequence of LaneResult
        The lanes.
    clear : float
        Least distance of the pixels from a target, m.

    Returns
    -------
    DataFrame
        ``lane``, ``stretch`` (number of a piece of lane 10 m long) and the level (dB) of
        every channel, named ``HH F1`` and so on.
    """
    rows = []
    for result in results:
        view = result.view
        is_clear = _target_distance(result) > clear
        number = ((view["y"].values - result.lane.y_min) // _STRETCH).astype(int)
        for k in np.unique(number):
            chosen = is_clear & (number == k)[:, None]
            row: Entries = {"lane": result.name, "stretch": int(k)}
            for polarization in view["polarization"].values:
                for subband in view["subband"].values:
                    channel = view.sel(polarization=polarization, subband=subband).values
                    row[f"{polarization} {subband}"] = stands_out(channel[chosen])
            rows.append(row)
    return pd.DataFrame(rows)


def _target_distance(result: LaneResult) -> FloatArray:
    """Return the distance (y, x) of every pixel of a run-view from the nearest target, m."""
    x = result.view["x"].values
    y = result.view["y"].values[:, None]
    distance = np.full((y.size, x.size), np.inf)
    for target_x, target_y in floats(result.truth[["x", "y"]]):
        distance = np.minimum(distance, np.hypot(x - target_x, y - target_y))
    return distance


def stands_out(magnitude: AnyArray) -> float:
    """Return the 99 % quantile of magnitudes over their median, dB; NaN for fewer than 100."""
    finite = magnitude[np.isfinite(magnitude)]
    if finite.size < 100:
        return float("nan")
    median, high = np.quantile(floats(finite), (0.5, 0.99))
    return float(20 * np.log10(high / median))


def table_one(pool: Pool, subband: str = "F1") -> pd.DataFrame:
    """Return PD_mean of every feature of a sub-band (column) by the methods A-D (row)."""
    columns = [f"{name}_{subband}" for name in FEATURES]
    return pd.DataFrame(
        {method: pool.singles(columns, method) for method in METHODS}, index=list(FEATURES)
    ).T


def table_two(pool: Pool) -> dict[str, list[SearchStep]]:
    """Search forward in the ten features of sub-band F1 by the methods A-D."""
    columns = [f"{name}_F1" for name in FEATURES]
    return {method: pool.search(columns, method) for method in METHODS}


def all_forty() -> list[str]:
    """Return the names of the 40 features of the four sub-bands, #1 to #40."""
    return [f"{name}_{subband}" for subband in SUBBANDS for name in FEATURES]


def _settings(method: str) -> tuple[bool, bool]:
    """Return whether a method cross-validates, and whether it duplicates mines."""
    return method in "CD", method in "AC"


def _refit(folds: Sequence[Fold], samples: int) -> FloatArray:
    """Return confidences by discriminants trained anew in every fold."""
    confidence = np.full(samples, -np.inf)
    for fold in folds:
        direction = np.linalg.lstsq(fold.scatter, fold.difference, rcond=1e-12)[0]
        confidence[fold.samples] = fold.values @ direction
    return confidence
