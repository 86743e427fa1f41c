"""Findings of Wang et al. 2007 on simulated lanes: whether they show what the paper found.

The statements and their rules are declared in ``statements.toml``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from flgpr.detect import Fold, SearchStep, forward_search, single_features
from flgpr.features import FEATURES
from flgpr.method.classifier import CLASSIFIER_A, CLASSIFIER_B, make_training_set, train
from flgpr.recipe.schema import Recipe
from flgpr.scoring import Match, compare
from flgpr.types import Entries, FloatArray, floats
from flgpr_papers.kit.findings import Finding, Statements
from flgpr_papers.kit.intervals import (
    SHARE,
    SHARE_DIFFERENCE,
    Interval,
    difference_of_shares,
    proportion,
    spread,
    students,
    together,
)
from flgpr_papers.kit.page import detections_at, pd_in_words
from flgpr_papers.wang2007.analysis import (
    AREA,
    BANDS,
    BURIED_METAL,
    BURIED_PLASTIC,
    MINES,
    POLARIZATIONS,
    SIMULANTS,
    SUBBANDS,
    LaneResult,
    Pool,
    all_forty,
    clutter_levels,
    prescreened,
    ranked,
    table_one,
    table_two,
)

"""Steps of the forward search by method, A to D (Table II)."""
F1 = tuple(f"{name}_F1" for name in FEATURES)
"""Columns of the ten features in sub-band F1."""


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


def limit_less(limit: float, interval: Interval) -> Interval:
    """Return a limit less a number, with its interval: a small number gives a large one."""
    value, low, high = interval
    return limit - value, limit - high, limit - low


def beside_papers_pd(
    matched: Match, subset: Any, far: float, figure: float, count: int | None
) -> Entries:
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
    tables : Tables
        What the statements are judged by.
    """

    def __init__(self, tables: Tables) -> None:
        table = tables.by_band["F1"]
        self.values = {method: floats(table.loc[method]) for method in "ABCD"}
        self.drawn = tables.pool.in_draws(single_features, F1, "ABCD", tables.retrainings)

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


SETS = {"A": CLASSIFIER_A, "B": CLASSIFIER_B}
"""Columns of the paper's two classifiers."""
Channels = Mapping[tuple[str, str], Match]
"""Alarms of the prescreener by polarization and sub-band."""
_PAPER_MINES = 47
_PAPER_PLASTIC = 20
_PAPER_SIMULANTS = 16
BURIED = {"metal": BURIED_METAL, "plastic": BURIED_PLASTIC}
_CONTRAST = ["C_HH_F1"]
_HARDLY = 0.03  # of PD_mean: a gain below it is called none
_STATEMENTS = Statements("wang2007")


class Tables(NamedTuple):
    """What the statements are judged by, and the page shows."""

    pool: Pool  #: alarms of the calibration lanes
    channels: Channels  #: alarms of the prescreener on the calibration lanes
    first_run: Channels  #: the same on the first of them
    by_band: dict[str, pd.DataFrame]  #: Table I of every sub-band
    searches: dict[str, list[SearchStep]]  #: Table II
    sets: dict[str, list[SearchStep]]  #: Tables III and IV ("all")
    blind: dict[str, Match]  #: blind lanes by classifier
    draws: int  #: number of bootstrap draws

    @property
    def retrainings(self) -> int:
        """In how many of the draws a discriminant is trained anew: enough for a deviation."""
        return max(self.draws // 5, 20)

    def gap(
        self,
        first: Sequence[str],
        second: Sequence[str],
        parts: int = 1,
        method: str = "A",
        subset: Any = MINES,
    ) -> Interval:
        """Return PD_mean of a set of features less that of another, both trained in every draw.

        Parameters
        ----------
        first, second : sequence of str
            Columns of each set.
        parts : int
            Number of intervals that are to hold all together.
        method : str
            Method of training and testing, "A" to "D".
        subset : object
            Targets that count.
        """
        score = self.pool.scorer_of(subset)
        values = []
        drawn = []
        for columns in (first, second):
            values.append(score(self.pool.confidence(columns, method)))
            drawn.append(self.pool.retrained(columns, method, self.retrainings, subset))
        return spread(values[0] - values[1], drawn[0] - drawn[1], together(parts), SHARE_DIFFERENCE)


def all_findings(
    calibration: Sequence[LaneResult], blind: Sequence[LaneResult], recipe: Recipe, draws: int
) -> tuple[list[Finding], Tables]:
    """Judge all statements of the paper.

    Parameters
    ----------
    calibration, blind : sequence of LaneResult
        Results of the lanes; without blind ones their statements are left out.
    recipe : Recipe
        Recipe of the study.
    draws : int
        Number of bootstrap draws.

    Returns
    -------
    findings : list of Finding
        In the order of the page.
    tables : Tables
        What they are judged by.
    """
    pool = Pool(calibration)
    channels, first_run = [
        {
            (polarization, band): prescreened(lanes, polarization, band, recipe)
            for polarization in POLARIZATIONS
            for band in BANDS
        }
        for lanes in (calibration, calibration[:1])
    ]
    tables = Tables(
        pool=pool,
        channels=channels,
        first_run=first_run,
        by_band={band: table_one(pool, band) for band in BANDS},
        searches=table_two(pool),
        sets={band: pool.search([f"{f}_{band}" for f in FEATURES], "A", 3) for band in SUBBANDS}
        | {"all": pool.search(all_forty(), "A", 5)},
        blind=blind_scores(calibration, blind) if blind else {},
        draws=draws,
    )
    views = {
        name: prescreened(calibration, "HH", name, recipe) for name in ("wide", "largest", "mean")
    }
    findings = [
        *_prescreener_findings(tables, views, clutter_levels(calibration)),
        *_feature_findings(tables),
        *_band_findings(tables),
        *_curve_findings(tables),
    ]
    return findings, tables


def blind_scores(
    calibration: Sequence[LaneResult],
    blind: Sequence[LaneResult],
    sets: Mapping[str, tuple[str, ...]] = SETS,
) -> dict[str, Match]:
    """Score the blind lanes with classifiers that were trained on the calibration lanes.

    Parameters
    ----------
    calibration, blind : sequence of LaneResult
        Results of the lanes.
    sets : mapping of str to tuple of str
        Columns of each classifier by its name.

    Returns
    -------
    dict of Match
        Alarms of the blind lanes by classifier; alarms that lack a feature are left out.
    """
    training_lanes = [result.training for result in calibration]
    scores = {}
    for name, columns in sets.items():
        classifier = train(make_training_set(training_lanes, columns=columns), columns)
        scores[name] = ranked(blind, [classifier.confidence(one.features) for one in blind])
    return scores


def _prescreener_findings(
    tables: Tables, views: Mapping[str, Match], levels: pd.DataFrame
) -> list[Finding]:
    """Judge what the paper says of the prescreener's channel (Sec. II-C, Fig. 8 and 9)."""
    matches = {" ".join(channel): match for channel, match in tables.channels.items()} | dict(views)

    def compared(name: str, **words: str) -> dict[str, Interval]:
        """Return PD_mean of every declared pair of run-views, the first less the second."""
        gaps = {}
        pairs = _STATEMENTS.declared[name]["pairs"]
        for title, *views in pairs:
            first, second = [matches[view.format(**words)] for view in views]
            gaps[title] = pd_mean_gap(first, second, tables.draws, len(pairs))
        return gaps

    clutter = {}
    for name in ("VV", "HH"):
        for band in ("F0", *SUBBANDS[1:]):
            gap = levels[f"{name} {band}"] - levels[f"{name} F1"]
            clutter[f"{name} {band} - F1"] = students(gap, together(8))
    found = beside_papers_pd(matches["HH F1"], MINES, 0.15, 1.0, _PAPER_MINES)
    words = [{"polarization": name} for name in POLARIZATIONS]
    (mean,) = compared("mean-look").values()
    return [
        *[_STATEMENTS.larger(name, compared(name)) for name in ("subband", "polarization")],
        _STATEMENTS.larger("clutter", clutter),
        *[_STATEMENTS.larger("order", compared("order", **one), **one) for one in words],
        _STATEMENTS.number("all-found", **found),
        *[_STATEMENTS.larger(n, compared(n)) for n in ("narrow", "range", "second-largest")],
        _STATEMENTS.number("mean-look", mean),
    ]


def _feature_findings(tables: Tables) -> list[Finding]:
    """Judge what the paper says of single features and their combinations (Tables I and II)."""
    pool = tables.pool
    singles = SingleFeatures(tables)
    steps = {
        name: np.array([step.score for step in found]) for name, found in tables.searches.items()
    }
    drawn_steps = pool.in_draws(_scores_by_step, F1, "ABCD", tables.retrainings)
    contrast = pool.match_of(pool.confidence(_CONTRAST, "A"))
    magnitude = pool.match_of(pool.magnitude())
    gains = {
        f"{kind}, C_HH - magnitude": pd_mean_gap(contrast, magnitude, tables.draws, 2, subset)
        for kind, subset in BURIED.items()
    }
    levels = dict(zip(FEATURES, singles.values["A"], strict=True))
    best = {f"less {f}": singles.gap("C_HH", f, 9) for f in FEATURES if f != "C_HH"}
    weak = max("P_alpha", "P_psi", key=lambda name: levels[name])
    others = [name for name in FEATURES if name not in ("P_alpha", "P_psi")]
    stronger = {f"{name} less {weak}": singles.gap(name, weak, 8) for name in others}
    validated = {name: singles.gap(name, name, 9, "C") for name in FEATURES if name != "P_psi"}
    duplicated = {name: singles.gap(name, name, 10, "B") for name in FEATURES}
    slope = {"slope per feature": parting_slope(steps, drawn_steps)}
    return [
        _STATEMENTS.larger("best-feature", best, level=levels["C_HH"]),
        _STATEMENTS.larger("contrast", gains),
        _level_finding(singles),
        *_more_feature_findings(tables),
        *_duplication_findings(singles, steps, drawn_steps),
        _STATEMENTS.within("validation", validated),
        _STATEMENTS.larger("parting", slope),
        _STATEMENTS.larger("weak", stronger, alpha=levels["P_alpha"], psi=levels["P_psi"]),
        _STATEMENTS.within("single-duplication", duplicated),
        *_distribution_findings(tables),
    ]


def _scores_by_step(folds: list[Fold], samples: int, scorer: Any) -> list[float]:
    """Return PD_mean after every step of a forward search."""
    return [step.score for step in forward_search(folds, samples, scorer)]


def _level_finding(singles: SingleFeatures) -> Finding:
    """Judge the paper's PD_mean of C_HH (Table I)."""
    level = singles.level("C_HH")
    validated = singles.values["C"][FEATURES.index("C_HH")]
    # A mean of numbers from 0 to 1 has at most the error of a share.
    figure = proportion(0.93 * _PAPER_MINES, _PAPER_MINES)
    return _STATEMENTS.number("level", level, figure=figure, validated=validated)


def _more_feature_findings(tables: Tables) -> list[Finding]:
    """Judge what more features give, by every method and for simulants.

    See Table II and the text below Fig. 13.
    """
    best_sets = {}
    for method, search in tables.searches.items():
        best = int(np.argmax([step.score for step in search]))
        best_sets[method] = [F1[step.feature] for step in search[: best + 1]]
    below = {}
    for method in "ABC":
        gain = tables.gap(best_sets[method], _CONTRAST, 3, method)
        below[f"({method}) {_HARDLY} less the gain"] = limit_less(_HARDLY, gain)
    gain = tables.gap(best_sets["D"], _CONTRAST, 1, "D")
    of_simulants = tables.gap(best_sets["A"], _CONTRAST, subset=SIMULANTS)
    simulants = {f"{_HARDLY} less the gain": limit_less(_HARDLY, of_simulants)}
    features = ", ".join(best_sets["A"])
    return [
        _STATEMENTS.larger("more-features", below),
        _STATEMENTS.larger("more-features-d", {"gain": gain}),
        _STATEMENTS.larger("more-simulants", simulants, features=features),
    ]


def _duplication_findings(
    singles: SingleFeatures, steps: Mapping[str, FloatArray], drawn: Mapping[str, FloatArray]
) -> list[Finding]:
    """Judge where duplication of examples matters more, and that it gives better results.

    The paper says: by cross-validation in Table I, by resubstitution in Table II.
    """
    single_gap, search_gap = [
        spread(duplication_gap(scores), duplication_gap(in_draws), bounds=SHARE_DIFFERENCE)
        for scores, in_draws in ((singles.values, singles.drawn), (steps, drawn))
    ]
    lead = spread(
        contrast_lead(singles.values["D"]),
        contrast_lead(singles.drawn["D"]),
        bounds=SHARE_DIFFERENCE,
    )
    gains = {}
    for first, second in ("AB", "CD"):
        gain = float((steps[first] - steps[second]).mean())
        gain_drawn = (drawn[first] - drawn[second]).mean(axis=1)
        interval = spread(gain, gain_drawn, together(2), SHARE_DIFFERENCE)
        gains[f"mean {first} - {second}"] = interval
    less = limit_less(0.0, search_gap)
    return [
        _STATEMENTS.larger("duplication-singles", {"mean |C - D| less mean |A - B|": single_gap}),
        _STATEMENTS.larger("duplication-sets", {"mean |A - B| less mean |C - D|": less}),
        _STATEMENTS.larger("duplication-better", gains),
        _STATEMENTS.larger("contrast-d", {"better of C_VV and C_HH less the best other": lead}),
    ]


def _distribution_findings(tables: Tables) -> list[Finding]:
    """Judge what the paper says of the features' distributions."""

    def rank(feature: str, parts: int) -> Interval:
        value, drawn = tables.pool.outranks(f"{feature}_F1", tables.retrainings)
        return spread(value, drawn, together(parts), SHARE)

    findings = [
        _STATEMENTS.number("less-random", rank("P_H", 1)),
        _STATEMENTS.number("symmetric", rank("P_tau", 1)),
    ]
    for name, features in (
        ("cross-polarization", ("R_HH_HV", "R_VV_HV")),
        ("magnitude", ("M_HH", "M_VV", "C_HH", "C_VV")),
    ):
        ranks = {feature: rank(feature, len(features)) for feature in features}
        findings.append(_STATEMENTS.larger(name, ranks))
    return findings


def _band_findings(tables: Tables) -> list[Finding]:
    """Judge what the paper says of features of other sub-bands (Tables III and IV)."""
    three = {}
    for band in SUBBANDS:
        three[band] = [f"{FEATURES[step.feature]}_{band}" for step in tables.sets[band]]
    gaps = {f"F1 - {band}": tables.gap(three["F1"], three[band], 3) for band in SUBBANDS[1:]}
    five = [all_forty()[step.feature] for step in tables.sets["all"]]
    gain = tables.gap(five, five[:1])
    ratios = []
    for feature in ("R_HH_HV", "R_VV_HV"):
        scores = [f"{band} {tables.by_band[band][feature]['A']:.2f}" for band in SUBBANDS]
        gap = tables.gap([f"{feature}_F1"], [f"{feature}_F4"])
        words = {"feature": feature, "scores": ", ".join(scores)}
        ratios.append(_STATEMENTS.larger("ratio", {"F1 - F4": gap}, **words))
    wide = tables.gap(_CONTRAST, ["C_HH_F0"])
    return [
        _STATEMENTS.larger("three-features", gaps),
        _STATEMENTS.larger("other-subbands", {"0.03 less the gain": limit_less(0.03, gain)}),
        *ratios,
        _STATEMENTS.larger("thesis", {"F1 - F0": wide}),
    ]


def _curve_findings(tables: Tables) -> list[Finding]:
    """Judge what the paper says of points of the final curves (Sec. III and Fig. 14)."""
    pool = tables.pool
    contrast = pool.match_of(pool.confidence(_CONTRAST, "A"))
    findings = []
    for targets, subset, count, far, share in (
        ("buried plastic mines", BURIED_PLASTIC, _PAPER_PLASTIC, 0.02, 0.65),
        ("buried plastic mines", BURIED_PLASTIC, _PAPER_PLASTIC, 0.07, 0.90),
        ("simulants", SIMULANTS, _PAPER_SIMULANTS, 0.02, 7 / 16),
        ("simulants", SIMULANTS, _PAPER_SIMULANTS, 0.07, 9 / 16),
    ):
        words = beside_papers_pd(contrast, subset, far, share, count)
        words |= {"targets": targets, "share": share, "far": far}
        findings.append(_STATEMENTS.number("pd-calibration", **words))
    plastic, simulants = [
        detections_at(contrast, subset, 0.07, area=AREA)[:2]
        for subset in (BURIED_PLASTIC, SIMULANTS)
    ]
    gap = difference_of_shares(plastic, simulants)
    findings.append(_STATEMENTS.larger("simulants", {"plastic - simulants at 0.07 per m²": gap}))
    for name, match in tables.blind.items():
        less = beside_papers_pd(match, {"kind": "metal"}, 0.01, 1.0, None)
        findings.append(_STATEMENTS.number("pd-blind", **less, classifier=name))
    calibration = {
        name: pool.match_of(pool.confidence(columns, "A")) for name, columns in SETS.items()
    }
    gaps = {}
    for lanes, scores in (("calibration", calibration), ("blind", tables.blind)):
        for kind, subset in BURIED.items() if scores else ():
            gap = pd_mean_gap(scores["B"], scores["A"], tables.draws, 4, subset)
            gaps[f"{kind}, {lanes}: B - A"] = gap
    return [*findings, _STATEMENTS.within("classifiers", gaps)]
