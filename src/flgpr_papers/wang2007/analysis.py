"""Tables I-IV and curves of Wang et al. 2007 from detections and truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.classifier import count_mines, duplication, label_lanes
from flgpr.detect import Fold, SearchStep, forward_search, make_fold, single_features
from flgpr.features import FEATURES
from flgpr.model import Lane
from flgpr.scoring import Match, match, pd_mean_interval
from flgpr.scoring.bootstrap import Draw, Rescorer, make_design, make_scores
from flgpr.scoring.lane_roc import AreaRule
from flgpr.scoring.matching import select_targets
from flgpr.screen import prescreen

MINES = {"kind": lambda kind: kind != "simulant"}
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
FAR_MAX = 0.1
AREA: AreaRule = "paper"
"""Area of FAR by the paper's rule 6 (Sec. II-F): lane less N·π·r², halos counted whole wherever they lie."""
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LaneResult:
    """What was found in a lane, and what is there."""

    name: str  #: the lane's name
    lane: Lane  #: its borders
    truth: pd.DataFrame  #: its targets
    #: alarms, features: alarms of the prescreener and their features, row by row
    alarms: pd.DataFrame
    features: pd.DataFrame
    view: xr.DataArray  #: run-view (polarization, subband, y, x)
    #: run-view (y, x) of the prescreener's channel over the full range of the images, where it was asked for
    wide_view: xr.DataArray | None


def matched(results: Sequence[LaneResult], tables: Sequence[pd.DataFrame]) -> Match:
    """Match alarms of several lanes to their targets with the paper's halo of 1 m."""
    alarms = [
        table[["x", "y", "confidence"]].assign(lane=one.name)
        for one, table in zip(results, tables, strict=True)
    ]
    truth = [
        one.truth.assign(lane=one.name, target_id=one.name + "-" + one.truth["target_id"])
        for one in results
    ]
    lanes = {one.name: one.lane for one in results}
    return match(pd.concat(alarms, ignore_index=True), pd.concat(truth, ignore_index=True), lanes)


class Pool:
    """All alarms of the calibration lanes, labelled, for training and testing."""

    def __init__(self, results: Sequence[LaneResult]) -> None:
        self.results = list(results)
        self.features = pd.concat([one.features for one in results], ignore_index=True)
        self.labels = label_lanes([(one.name, one.alarms, one.truth, one.lane) for one in results])
        self.reference = matched(results, [one.alarms for one in results])
        self.scorer = Rescorer(self.reference, MINES, FAR_MAX, AREA)
        self.lanes = [one.name for one in results]

    def draws(self, count: int, seed: int = 0, subset: Any = MINES) -> Iterator[Draw]:
        """Draw lanes, targets and stretches of lane.

        A draw holds two lanes at least, so that one can be left out, and a mine and a target of ``subset`` at least.
        """
        design = make_design(self.reference, area=AREA)
        rng = np.random.default_rng(seed)
        false = np.flatnonzero(self.reference.false)
        false = false[np.argsort(-self.reference.confidence[false], kind="stable")]
        block = make_scores(self.reference, design).block
        hit = self.labels["target"].to_numpy()
        mines, wanted = (
            select_targets(self.reference.truth, targets) for targets in (MINES, subset)
        )
        while count:
            target, weight = design.draw(rng)
            several = len(np.unique(design.target_lane[target > 0])) > 1 or len(self.lanes) == 1
            if several and target[mines].any() and target[wanted].any():
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
        """Make the folds of a method; ``only`` leaves other lanes out of training and testing altogether."""
        known = np.isfinite(self.features[list(columns)].to_numpy(dtype=np.float64)).all(axis=1)
        lane = self.labels["lane"].to_numpy()
        here = known & np.isin(lane, list(only or self.lanes))
        if not cross:
            return [self._fold(columns, here, here, duplicate, draw)]
        names = list(only or self.lanes)
        return [
            self._fold(columns, here & (lane != name), here & (lane == name), duplicate, draw)
            for name in names
        ]

    def _fold(
        self,
        columns: Sequence[str],
        train: Any,
        test: Any,
        duplicate: bool,
        draw: Draw | None = None,
    ) -> Fold:
        labels = self.labels
        use = train & (labels["label"] != "neither").to_numpy()
        training_lanes = set(labels["lane"][train])
        mines = count_mines(one.truth for one in self.results if one.name in training_lanes)
        weight = np.ones(len(labels), np.int64)
        if duplicate:
            weight[use] = duplication(labels[use], mines)
        if draw is not None:
            use = use & (draw.alarm > 0)
            weight = weight * draw.alarm.astype(np.int64)
        hit = (labels["label"] == "hit").to_numpy().astype(np.int64)
        return make_fold(
            np.nan_to_num(self.features[list(columns)].to_numpy(float)), hit, weight, use, test
        )

    def singles(self, columns: Sequence[str], method: str) -> FloatArray:
        """PD_mean of every feature on its own by a method A-D."""
        return single_features(
            self.folds(columns, *_settings(method)), len(self.labels), self.scorer
        )

    def search(
        self, columns: Sequence[str], method: str, steps: int | None = None
    ) -> list[SearchStep]:
        """Forward search by a method A-D."""
        return forward_search(
            self.folds(columns, *_settings(method)), len(self.labels), self.scorer, steps
        )

    def confidence(self, columns: Sequence[str], method: str) -> FloatArray:
        """Confidences of all alarms with a fixed set of features by a method A-D; -inf where a feature is missing."""
        folds = self.folds(columns, *_settings(method))
        return _refit(folds, len(self.labels))

    def singles_in(self, columns: Sequence[str], methods: str, draws: int) -> dict[str, FloatArray]:
        """PD_mean (draw, feature) of every feature on its own by methods A-D, trained anew in every draw."""
        found: dict[str, list[FloatArray]] = {method: [] for method in methods}
        for draw in self.draws(draws):
            scorer = partial(self.scorer, draw=draw)
            for method, rows in found.items():
                folds = self.folds(columns, *_settings(method), draw=draw)
                rows.append(single_features(folds, len(self.labels), scorer))
        return {method: np.array(rows) for method, rows in found.items()}

    def searches_in(
        self, columns: Sequence[str], methods: str, draws: int
    ) -> dict[str, FloatArray]:
        """PD_mean (draw, step) of forward searches by methods A-D, searched anew in every draw."""
        found: dict[str, list[list[float]]] = {method: [] for method in methods}
        for draw in self.draws(draws):
            scorer = partial(self.scorer, draw=draw)
            for method, rows in found.items():
                folds = self.folds(columns, *_settings(method), draw=draw)
                rows.append(
                    [step.score for step in forward_search(folds, len(self.labels), scorer)]
                )
        return {method: np.array(rows) for method, rows in found.items()}

    def scorer_of(self, subset: Any) -> Rescorer:
        """Make what gives PD_mean of some of the targets; that of mines is at hand as ``scorer``."""
        return Rescorer(self.reference, subset, FAR_MAX, AREA)

    def retrained(
        self, columns: Sequence[str], method: str, draws: int, subset: Any = MINES
    ) -> FloatArray:
        """PD_mean (draw,) of some targets by a fixed set of features and a method A-D, trained anew in every draw."""
        cross, duplicate = _settings(method)
        score = self.scorer_of(subset)
        values = []
        for draw in self.draws(draws, subset=subset):
            confidence = _refit(self.folds(columns, cross, duplicate, draw=draw), len(self.labels))
            values.append(score(confidence, draw))
        return np.array(values)

    def bands(
        self, columns: Sequence[str], method: str, subset: Any, far: FloatArray, draws: int
    ) -> tuple[FloatArray, FloatArray]:
        """Give 95 % bands (2, far) of a ROC: of the classifier as it is, and trained anew in every draw."""
        scorer = Rescorer(self.reference, subset, area=AREA)
        cross, duplicate = _settings(method)
        confidence = self.confidence(columns, method)
        curves = []
        for draw in self.draws(draws):
            again = _refit(self.folds(columns, cross, duplicate, draw=draw), len(self.labels))
            curves.append([scorer.pd_at(one, far, draw) for one in (confidence, again)])
        kept, anew = np.swapaxes(np.nanquantile(np.array(curves), (0.025, 0.975), axis=0), 0, 1)
        return kept, anew

    def outranks(self, column: str, draws: int) -> tuple[float, FloatArray]:
        """Share of pairs in which a hit on a mine has more of a feature than a false alarm has; here and in draws.

        Draws without such a pair, whose mines raised no alarm, are left out.
        """
        values = self.features[column].to_numpy(dtype=np.float64)
        labels = self.labels
        hit = np.isfinite(values) & ((labels["label"] == "hit") & (labels["beta"] == 1)).to_numpy()
        false = np.isfinite(values) & (labels["label"] == "false").to_numpy()
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
        """Magnitude of all alarms: what the prescreener goes by."""
        return np.concatenate(
            [one.alarms["magnitude"].to_numpy(dtype=np.float64) for one in self.results]
        )

    def nested(
        self, columns: Sequence[str], steps: int
    ) -> tuple[float, FloatArray, list[list[str]]]:
        """PD_mean, confidences and features, each lane scored with features that a search without it has chosen."""
        confidence = np.full(len(self.labels), -np.inf)
        chosen = []
        for name in self.lanes:
            others = [lane for lane in self.lanes if lane != name]
            folds = self.folds(columns, len(others) > 1, True, others)
            left = [one for one in self.results if one.name in others]
            scorer = Rescorer(matched(left, [one.alarms for one in left]), MINES, FAR_MAX, AREA)
            rows = np.flatnonzero(np.isin(self.labels["lane"], others))
            inner = forward_search(
                folds,
                len(self.labels),
                lambda c, r=rows, s=scorer: s(c[r]),  # type: ignore[misc]
                steps,
            )
            best = int(np.argmax([step.score for step in inner])) + 1
            names = [columns[step.feature] for step in inner[:best]]
            known = np.isfinite(self.features[names].to_numpy(float)).all(axis=1)
            lane = self.labels["lane"].to_numpy()
            fold = self._fold(names, known & (lane != name), known & (lane == name), True)
            confidence[fold.samples] = _refit([fold], len(self.labels))[fold.samples]
            chosen.append(names)
        return self.scorer(confidence), confidence, chosen

    def match_of(self, confidence: FloatArray) -> Match:
        """Match with other confidences; alarms with -inf are left out."""
        tables = []
        lane = self.labels["lane"].to_numpy()
        for one in self.results:
            table = one.alarms.assign(confidence=confidence[lane == one.name])
            tables.append(table[np.isfinite(table["confidence"])])
        return matched(self.results, tables)

    def interval(self, confidence: FloatArray, draws: int = 1000) -> tuple[float, float]:
        """95 % interval of PD_mean of actual mines by resampling targets, lanes and stretches of lane."""
        return pd_mean_interval(self.match_of(confidence), FAR_MAX, MINES, area=AREA, draws=draws)


def prescreened(
    results: Sequence[LaneResult], polarization: str, subband: str, recipe: Any
) -> Match:
    """Alarms of another channel's run-view by the same prescreener, confidence being the magnitude."""
    tables = []
    for one in results:
        wide = subband == "wide"
        view = one.wide_view if wide else one.view.sel(polarization=polarization, subband=subband)
        if view is None:
            raise ValueError(f"lane {one.name} must have a run-view over the full range")
        screen = recipe.prescreen
        alarms = prescreen(view, one.lane, screen.radius, screen.density, screen.count)
        tables.append(alarms.assign(confidence=alarms["magnitude"]))
    return matched(results, tables)


def clutter_levels(
    results: Sequence[LaneResult], clear: float = 1.5, stretch: float = 10.0
) -> pd.DataFrame:
    """Tell how far clutter stands out of the background in the run-views, by stretches of lane (the paper's Fig. 8).

    Images are in units of their background, so that their mean level tells nothing. The level of a
    channel is the 99 % quantile of its magnitude over the median, dB, of the pixels farther than
    ``clear`` (m) from every target.

    Returns
    -------
    DataFrame
        ``lane``, ``stretch`` (number of a piece of lane ``stretch`` m long) and the level (dB) of
        every channel, named ``HH F1`` and so on.
    """
    rows = []
    for one in results:
        x, y = np.meshgrid(one.view["x"].values, one.view["y"].values)
        away = np.full(x.shape, np.inf)
        for target_x, target_y in one.truth[["x", "y"]].to_numpy(dtype=np.float64):
            away = np.minimum(away, np.hypot(x - target_x, y - target_y))
        number = ((one.view["y"].values - one.lane.y_min) // stretch).astype(int)
        for k in np.unique(number):
            chosen = (away > clear) & (number == k)[:, None]
            row: dict[str, Any] = {"lane": one.name, "stretch": int(k)}
            for polarization in one.view["polarization"].values:
                for subband in one.view["subband"].values:
                    values = one.view.sel(polarization=polarization, subband=subband).values[chosen]
                    row[f"{polarization} {subband}"] = stands_out(values)
            rows.append(row)
    return pd.DataFrame(rows)


def stands_out(magnitude: NDArray[Any]) -> float:
    """Return the 99 % quantile over the median, dB; NaN for fewer than 100 pixels that were seen."""
    seen = magnitude[np.isfinite(magnitude)]
    if seen.size < 100:
        return float("nan")
    median, high = np.quantile(seen.astype(np.float64), (0.5, 0.99))
    return float(20 * np.log10(high / median))


def table_one(pool: Pool, subband: str = "F1", prefix: str = "") -> pd.DataFrame:
    """PD_mean of every feature on its own by the methods A-D."""
    columns = [f"{prefix}{name}_{subband}" for name in FEATURES]
    return pd.DataFrame(
        {method: pool.singles(columns, method) for method in METHODS}, index=list(FEATURES)
    ).T


def table_two(pool: Pool) -> dict[str, list[SearchStep]]:
    """Forward searches over the ten features of the whole band by the methods A-D."""
    columns = [f"{name}_F1" for name in FEATURES]
    return {method: pool.search(columns, method) for method in METHODS}


def all_forty() -> list[str]:
    """Names of the 40 features of the four sub-bands, #1 to #40."""
    return [f"{name}_{subband}" for subband in SUBBANDS for name in FEATURES]


def _settings(method: str) -> tuple[bool, bool]:
    return method in "CD", method in "AC"


def _refit(folds: Sequence[Fold], samples: int) -> FloatArray:
    confidence = np.full(samples, -np.inf)
    for fold in folds:
        direction = np.linalg.lstsq(fold.scatter, fold.difference, rcond=1e-12)[0]
        confidence[fold.samples] = fold.values @ direction
    return confidence
