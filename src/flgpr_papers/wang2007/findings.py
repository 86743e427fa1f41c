"""Findings of Wang et al. 2007 on simulated lanes: whether they show what the paper found.

The paper's Pd are counts of the targets that it tells of: 47 mines, 20 of them buried plastic ones,
and 16 simulants on the calibration lanes. The findings stand in three modules by what they judge:
the prescreener, the features, and here the final curves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.method.classifier import CLASSIFIER_A, CLASSIFIER_B, make_training_set, train
from flgpr.recipe.schema import Recipe
from flgpr.scoring import Match
from flgpr_papers.kit.findings import MARGIN, Finding, difference_of_shares, parts_larger
from flgpr_papers.kit.page import detections_at
from flgpr_papers.wang2007.analysis import (
    AREA,
    BURIED_METAL,
    BURIED_PLASTIC,
    SIMULANTS,
    SUBBANDS,
    LaneResult,
    Pool,
    all_forty,
    matched,
    table_one,
    table_two,
)
from flgpr_papers.wang2007.comparisons import (
    PAPER_PLASTIC,
    PAPER_SIMULANTS,
    pd_mean_gap,
    share_finding,
    within_finding,
)
from flgpr_papers.wang2007.feature_findings import band_findings, feature_findings
from flgpr_papers.wang2007.prescreener_findings import prescreener_findings

SETS = {"A": CLASSIFIER_A, "B": CLASSIFIER_B}
"""Columns of the paper's two classifiers."""


class Tables(NamedTuple):
    """What the statements are judged by, and the page shows."""

    pool: Pool  #: alarms of the calibration lanes
    by_band: dict[str, pd.DataFrame]  #: Table I of every sub-band
    searches: dict[str, list[SearchStep]]  #: Table II
    sets: dict[str, list[SearchStep]]  #: Tables III and IV ("all")
    blind: dict[str, Match]  #: blind lanes by classifier


def all_findings(
    calibration: Sequence[LaneResult], blind: Sequence[LaneResult], recipe: Recipe, draws: int
) -> tuple[list[Finding], Tables]:
    """Judge all statements of the paper.

    Parameters
    ----------
    calibration, blind : sequence of LaneResult
        Results of the lanes.
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
    tables = Tables(
        pool=pool,
        by_band={band: table_one(pool, band) for band in ("F0", *SUBBANDS)},
        searches=table_two(pool),
        sets=_band_searches(pool),
        blind=blind_scores(calibration, blind),
    )
    contrast = pool.match_of(pool.confidence(["C_HH_F1"], "A"))
    findings = [
        *prescreener_findings(calibration, recipe, draws),
        *feature_findings(pool, tables.by_band["F1"], tables.searches, draws),
        *band_findings(pool, tables.by_band, tables.sets, draws),
        *curve_findings(contrast, tables.blind),
        *alike_findings(pool, tables.blind, draws),
    ]
    return findings, tables


def _band_searches(pool: Pool) -> dict[str, list[SearchStep]]:
    """Search for the best features within every sub-band and, as "all", in all 40 features."""
    searches = {}
    for band in SUBBANDS:
        columns = [f"{name}_{band}" for name in FEATURES]
        searches[band] = pool.search(columns, "A", 3)
    searches["all"] = pool.search(all_forty(), "A", 5)
    return searches


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
    training_lanes = []
    for result in calibration:
        training_lanes.append(
            (result.name, result.alarms, result.features, result.truth, result.lane)
        )
    scores = {}
    for name, columns in sets.items():
        classifier = train(make_training_set(training_lanes, columns=columns), columns)
        tables = []
        for result in blind:
            table = result.alarms.assign(confidence=classifier.confidence(result.features))
            tables.append(table.dropna(subset=["confidence"]))
        scores[name] = matched(blind, tables)
    return scores


def curve_findings(calibration: Match, blind: Mapping[str, Match]) -> list[Finding]:
    """Judge what the paper says of points of the final curves (Sec. III and Fig. 14).

    Parameters
    ----------
    calibration : Match
        Alarms of the calibration lanes by C_HH.
    blind : mapping of str to Match
        Alarms of the blind lanes by classifier.
    """
    points = (
        ("buried plastic mines", BURIED_PLASTIC, PAPER_PLASTIC, 0.02, 0.65),
        ("buried plastic mines", BURIED_PLASTIC, PAPER_PLASTIC, 0.07, 0.90),
        ("simulants", SIMULANTS, PAPER_SIMULANTS, 0.02, 7 / 16),
        ("simulants", SIMULANTS, PAPER_SIMULANTS, 0.07, 9 / 16),
    )
    findings = []
    for targets, subset, count, far, figure in points:
        claim = f"Of the {targets} C_HH finds {figure:.0%} at {far:g} per m² (calibration)"
        findings.append(share_finding(claim, calibration, subset, far, figure, count))
    findings.append(_simulant_finding(calibration))
    for classifier, match in blind.items():
        claim = f"Metal mines: 100 % below 0.01 per m² on the blind lanes, classifier {classifier}"
        note = "The paper does not tell how many there were; as many as here are assumed."
        findings.append(share_finding(claim, match, {"kind": "metal"}, 0.01, 1.0, None, note))
    return findings


def _simulant_finding(calibration: Match) -> Finding:
    """Judge that simulants are found much worse than plastic mines."""
    simulants_found, simulants, _ = detections_at(calibration, SIMULANTS, 0.07, area=AREA)
    mines_found, mines, _ = detections_at(calibration, BURIED_PLASTIC, 0.07, area=AREA)
    gap = difference_of_shares((mines_found, mines), (simulants_found, simulants))
    return parts_larger(
        "Simulants are found much worse than plastic mines",
        "9 of 16 against 90 %",
        {"plastic - simulants at 0.07 per m²": gap},
    )


def alike_findings(pool: Pool, blind: Mapping[str, Match], draws: int) -> list[Finding]:
    """Judge that classifiers A and B are alike, on calibration and blind lanes (Fig. 14).

    Parameters
    ----------
    pool : Pool
        Alarms of the calibration lanes.
    blind : mapping of str to Match
        Alarms of the blind lanes by classifier.
    draws : int
        Number of bootstrap draws.
    """
    calibration = {}
    for name, columns in SETS.items():
        calibration[name] = pool.match_of(pool.confidence(list(columns), "A"))
    intervals = {}
    for lanes, scores in (("calibration", calibration), ("blind", blind)):
        for kind, subset in (("metal", BURIED_METAL), ("plastic", BURIED_PLASTIC)):
            gap = pd_mean_gap(scores["B"], scores["A"], draws, 4, subset)
            intervals[f"{kind}, {lanes}: B - A"] = gap
    claim = (
        f"Classifiers A and B are alike on calibration and blind lanes (PD_mean within {MARGIN})"
    )
    return [within_finding(claim, "similar for both (Fig. 14)", intervals, MARGIN)]
