"""Findings on Wang et al. 2007 about its ten features, their combinations and sub-bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr_papers.kit.findings import (
    MARGIN,
    SHARE,
    SHARE_DIFFERENCE,
    Finding,
    Interval,
    alike,
    judge,
    less_figure,
    parts_larger,
    share_error,
    spread,
    together,
)
from flgpr_papers.wang2007.analysis import (
    BURIED_METAL,
    BURIED_PLASTIC,
    SIMULANTS,
    SUBBANDS,
    Pool,
    all_forty,
)
from flgpr_papers.wang2007.comparisons import (
    PAPER_MINES,
    limit_less,
    pd_mean_gap,
    retrained_gap,
    retrainings,
    within_finding,
)

FloatArray = NDArray[np.float64]
Searches = Mapping[str, Sequence[SearchStep]]
"""Steps of the forward search by method, A to D (Table II)."""
F1 = tuple(f"{name}_F1" for name in FEATURES)
"""Columns of the ten features in sub-band F1."""
# Claims that mines have more of some features than false alarms, and what the paper says of each.
_MORE_OF = (
    (
        "Mines return less in cross-polarization: higher R_HH_HV and R_VV_HV",
        "observed (III)",
        ("R_HH_HV", "R_VV_HV"),
    ),
    (
        "Mines return more: higher magnitude and local contrast",
        "expected (III)",
        ("M_HH", "M_VV", "C_HH", "C_VV"),
    ),
)
_HARDLY = 0.03  # of PD_mean: a gain below it is called none


class SingleFeatures:
    """PD_mean of single features of F1 by methods A to C, as it is and in bootstrap draws.

    Parameters
    ----------
    pool : Pool
        Alarms of the calibration lanes.
    table : DataFrame
        PD_mean of every feature (column) by method (row), Table I.
    draws : int
        Number of draws in which the discriminants are trained anew.
    """

    def __init__(self, pool: Pool, table: pd.DataFrame, draws: int) -> None:
        self.values: dict[str, FloatArray] = {}
        for method in "ABC":
            self.values[method] = table.loc[method, list(FEATURES)].to_numpy(dtype=np.float64)
        self.drawn = pool.singles_in(F1, "ABC", draws)

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


def feature_findings(
    pool: Pool, table: pd.DataFrame, searches: Searches, draws: int
) -> list[Finding]:
    """Judge what the paper says of single features and their combinations (Tables I and II).

    Parameters
    ----------
    pool : Pool
        Alarms of the calibration lanes.
    table : DataFrame
        PD_mean of every feature (column) by method (row), Table I.
    searches : mapping of str to sequence of SearchStep
        Steps of the forward search by method (Table II).
    draws : int
        Number of bootstrap draws.
    """
    singles = SingleFeatures(pool, table, retrainings(draws))
    return [
        _best_feature_finding(singles),
        _contrast_finding(pool, draws),
        _level_finding(singles),
        *_more_feature_findings(pool, searches, draws),
        _cross_validation_finding(singles),
        parts_larger(
            "Resubstitution and cross-validation part as features grow",
            "0.00 at 1, up to 0.06 at 9 features",
            {"slope per feature": _slope(pool, searches, retrainings(draws))},
            note="Straight line through the difference of the two over the steps of the search.",
        ),
        _weak_feature_finding(singles),
        _single_duplication_finding(singles),
        *_distribution_findings(pool, draws),
    ]


def _best_feature_finding(singles: SingleFeatures) -> Finding:
    """Judge that C_HH is the best single feature (Table I)."""
    gaps = {}
    for name in FEATURES:
        if name != "C_HH":
            gaps[f"less {name}"] = singles.gap("C_HH", name, 9)
    level, _, _ = singles.level("C_HH")
    return parts_larger(
        "C_HH is the best single feature",
        "PD_mean 0.93, the next 0.82",
        gaps,
        note=f"PD_mean of C_HH {level:.2f}.",
    )


def _contrast_finding(pool: Pool, draws: int) -> Finding:
    """Judge that local contrast improves much on the prescreener's magnitude (Fig. 13)."""
    contrast = pool.match_of(pool.confidence(["C_HH_F1"], "A"))
    magnitude = pool.match_of(pool.magnitude())
    gaps = {}
    for kind, subset in (("metal", BURIED_METAL), ("plastic", BURIED_PLASTIC)):
        gap = pd_mean_gap(contrast, magnitude, draws, 2, subset)
        gaps[f"{kind}, C_HH - magnitude"] = gap
    return parts_larger(
        "C_HH improves much on the prescreener's magnitude, for buried metal and for buried "
        "plastic mines",
        "very significant for both (Fig. 13)",
        gaps,
    )


def _level_finding(singles: SingleFeatures) -> Finding:
    """Judge the paper's PD_mean of C_HH (Table I)."""
    value, low, high = singles.level("C_HH")
    by_cross_validation = singles.values["C"][FEATURES.index("C_HH")]
    error = share_error(0.93, PAPER_MINES)
    gap, gap_low, gap_high = less_figure((value, low, high), 0.93, error, SHARE_DIFFERENCE)
    return Finding(
        claim="PD_mean of C_HH is 0.93",
        paper="0.93 (resubstitution and cross-validation)",
        ours=f"{value:.2f} ({low:.2f} to {high:.2f}), cross-validation "
        f"{by_cross_validation:.2f}; ours less the paper's "
        f"{gap:+.2f} ({gap_low:+.2f} to {gap_high:+.2f})",
        verdict=alike(gap_low, gap_high),
        note="The level depends on soil, mines and clutter, which the paper does not describe.",
        interval=(gap, gap_low, gap_high),
        asks=("alike", MARGIN, error),
    )


def _cross_validation_finding(singles: SingleFeatures) -> Finding:
    """Judge that cross-validation is close to resubstitution (Table I, C and A)."""
    gaps = {}
    for name in FEATURES:
        if name != "P_psi":
            gaps[name] = singles.gap(name, name, 9, "C")
    return within_finding(
        "Cross-validation is close to resubstitution with duplication (within 0.02, but for P_psi)",
        "equal",
        gaps,
        0.02,
    )


def _weak_feature_finding(singles: SingleFeatures) -> Finding:
    """Judge that P_alpha and P_psi are the weak features (Table I)."""
    levels = dict(zip(FEATURES, singles.values["A"], strict=True))
    weak = max("P_alpha", "P_psi", key=lambda name: levels[name])
    gaps = {}
    for name in FEATURES:
        if name not in ("P_alpha", "P_psi"):
            gaps[f"{name} less {weak}"] = singles.gap(name, weak, 8)
    return parts_larger(
        "P_alpha and P_psi are the weak ones",
        "0.19 and 0.30, all others at least 0.66",
        gaps,
        note=f"P_alpha {levels['P_alpha']:.2f}, P_psi {levels['P_psi']:.2f}.",
    )


def _single_duplication_finding(singles: SingleFeatures) -> Finding:
    """Judge that duplication changes single features little (Table I, A and B)."""
    return within_finding(
        "Duplication changes single features little by resubstitution (within 0.05)",
        "by up to 0.19 (P_psi: 0.30 and 0.11)",
        {name: singles.gap(name, name, 10, "B") for name in FEATURES},
        0.05,
        "A discriminant of one feature is monotone in it, so that only its sign can change; the "
        "paper's larger differences are not explained by its text.",
    )


def _best_set(search: Sequence[SearchStep]) -> list[str]:
    """Return the features of F1 up to the step of a search that scores best."""
    best = max(range(len(search)), key=lambda step: search[step].score)
    return [F1[step.feature] for step in search[: best + 1]]


def _more_feature_findings(pool: Pool, searches: Searches, draws: int) -> list[Finding]:
    """Judge what more features give, by every method and for simulants.

    See Table II and the text below Fig. 13.
    """
    note = "The best set of a search was chosen on these lanes: its gain is too favourable."
    best_sets = {method: _best_set(search) for method, search in searches.items()}
    contrast = ["C_HH_F1"]
    gains_below = {}
    for method in "ABC":
        gain = retrained_gap(pool, best_sets[method], contrast, draws, 3, method)
        gains_below[f"({method}) {_HARDLY} less the gain"] = limit_less(gain, _HARDLY)
    unduplicated = retrained_gap(pool, best_sets["D"], contrast, draws, 1, "D")
    of_simulants = retrained_gap(pool, best_sets["A"], contrast, draws, subset=SIMULANTS)
    return [
        parts_larger(
            f"More features than C_HH hardly help by methods A, B and C (less than {_HARDLY})",
            "0.93 to 0.94, 0.90 to 0.91, 0.93 (Table II)",
            gains_below,
            note=note,
        ),
        parts_larger(
            f"More features help by method D, cross-validation without duplication (more than "
            f"{_HARDLY})",
            "0.77 to 0.89 (Tables I and II)",
            {"gain": unduplicated},
            limit=_HARDLY,
            note=note,
        ),
        parts_larger(
            f"More features do not find simulants better (less than {_HARDLY} over C_HH)",
            "no better (III)",
            {f"{_HARDLY} less the gain": limit_less(of_simulants, _HARDLY)},
            note=f"PD_mean of simulants with {', '.join(best_sets['A'])} and with C_HH alone, "
            f"method A.",
        ),
        *_duplication_findings(pool, searches, draws),
    ]


def _duplication_findings(pool: Pool, searches: Searches, draws: int) -> list[Finding]:
    """Judge where duplication of examples matters more.

    The paper says: by cross-validation in Table I, by resubstitution in Table II.
    """
    columns = list(F1)
    singles = {method: pool.singles(columns, method) for method in "ABCD"}
    singles_drawn = pool.singles_in(columns, "ABCD", retrainings(draws))
    single_gap = spread(
        _duplication_gap(singles), _duplication_gap(singles_drawn), bounds=SHARE_DIFFERENCE
    )
    steps = {}
    for method, search in searches.items():
        steps[method] = np.array([step.score for step in search])
    steps_drawn = pool.searches_in(columns, "ABCD", retrainings(draws))
    search_gap = spread(
        _duplication_gap(steps), _duplication_gap(steps_drawn), bounds=SHARE_DIFFERENCE
    )
    lead = spread(
        contrast_lead(singles["D"]), contrast_lead(singles_drawn["D"]), bounds=SHARE_DIFFERENCE
    )
    gains = {}
    for first, second in ("AB", "CD"):
        gain = float((steps[first] - steps[second]).mean())
        drawn = (steps_drawn[first] - steps_drawn[second]).mean(axis=1)
        gains[f"mean {first} - {second}"] = spread(gain, drawn, together(2), SHARE_DIFFERENCE)
    value, low, high = search_gap
    return [
        parts_larger(
            "Duplication matters more by cross-validation than by resubstitution, single features",
            "0.08 and 0.03 (Table I, mean of |C - D| and |A - B|)",
            {"mean |C - D| less mean |A - B|": single_gap},
        ),
        parts_larger(
            "Duplication matters more by resubstitution than by cross-validation, combinations",
            "0.05 and 0.04 (Table II, mean of |A - B| and |C - D|)",
            {"mean |A - B| less mean |C - D|": (-value, -high, -low)},
        ),
        parts_larger(
            "Duplication gives somewhat better results",
            "0.05 by resubstitution, 0.04 by cross-validation (Table II, mean of A - B and of C - "
            "D)",
            gains,
        ),
        parts_larger(
            "Local contrast is the best single feature by method D, too",
            "C_VV 0.81, C_HH 0.77, the next 0.73 (Table I)",
            {"better of C_VV and C_HH less the best other": lead},
        ),
    ]


def contrast_lead(scores: FloatArray) -> Any:
    """Return the score of C_HH or C_VV, the better, less that of the best other feature.

    Parameters
    ----------
    scores : (..., feature) ndarray
        Scores of the ten features.
    """
    is_contrast = np.array([name in ("C_HH", "C_VV") for name in FEATURES])
    return scores[..., is_contrast].max(axis=-1) - scores[..., ~is_contrast].max(axis=-1)


def _duplication_gap(scores: Mapping[str, FloatArray]) -> Any:
    """Return mean |C - D| less mean |A - B| over the last axis."""
    by_cross_validation = np.abs(scores["C"] - scores["D"]).mean(axis=-1)
    by_resubstitution = np.abs(scores["A"] - scores["B"]).mean(axis=-1)
    return by_cross_validation - by_resubstitution


def _slope(pool: Pool, searches: Searches, draws: int) -> Interval:
    """Return the slope of resubstitution less cross-validation over the number of features."""
    drawn = pool.searches_in(F1, "AC", draws)
    gaps = []
    for a, c in zip(searches["A"], searches["C"], strict=True):
        gaps.append(a.score - c.score)
    curves = np.vstack([np.array(gaps), drawn["A"] - drawn["C"]])
    slopes = np.polyfit(np.arange(10), curves.T, 1)[0]
    return spread(float(slopes[0]), slopes[1:])


def _distribution_findings(pool: Pool, draws: int) -> list[Finding]:
    """Judge what the paper says of the features' distributions."""
    symmetry_note = (
        "The text says a higher P_tau for mines and calls it more symmetric, but by its Eq. 15 tau "
        "is 0 for a symmetric scatterer: the claim of symmetry is lower tau."
    )
    findings = [
        _lower_finding(pool, "P_H", "Mines have a lower P_H (less random)", "", draws),
        _lower_finding(
            pool,
            "P_tau",
            "Mines are more symmetric scatterers (lower tau by Eq. 15)",
            symmetry_note,
            draws,
        ),
    ]
    for claim, paper, names in _MORE_OF:
        level = together(len(names))
        ranks = {}
        for name in names:
            value, drawn = pool.outranks(f"{name}_F1", retrainings(draws))
            ranks[name] = spread(value, drawn, level, SHARE)
        note = "P(mine > false alarm); 0.5 by chance."
        findings.append(parts_larger(claim, paper, ranks, 0.5, note))
    return findings


def _lower_finding(pool: Pool, feature: str, claim: str, note: str, draws: int) -> Finding:
    """Judge that mines have less of a feature than false alarms."""
    value, drawn = pool.outranks(f"{feature}_F1", retrainings(draws))
    share, low, high = spread(value, drawn, bounds=SHARE)
    rule = (-1.0, 0.5)
    return Finding(
        claim=claim,
        paper="stated, no figure",
        ours=f"P(mine > false alarm) = {share:.2f} ({low:.2f} to {high:.2f})",
        verdict=judge(low, high, rule),
        note=note,
        interval=(share, low, high),
        rule=rule,
    )


def band_findings(
    pool: Pool, by_band: Mapping[str, pd.DataFrame], sets: Searches, draws: int
) -> list[Finding]:
    """Judge what the paper says of features of other sub-bands (Tables III and IV).

    Parameters
    ----------
    pool : Pool
        Alarms of the calibration lanes.
    by_band : mapping of str to DataFrame
        Table I of every sub-band.
    sets : mapping of str to sequence of SearchStep
        Searches within every sub-band, and "all", the search in all 40 features.
    draws : int
        Number of bootstrap draws.
    """
    best_three = {}
    for band in SUBBANDS:
        best_three[band] = [f"{FEATURES[step.feature]}_{band}" for step in sets[band]]
    gaps = {}
    for band in SUBBANDS[1:]:
        gap = retrained_gap(pool, best_three["F1"], best_three[band], draws, 3)
        gaps[f"F1 - {band}"] = gap
    forty = all_forty()
    best_five = [forty[step.feature] for step in sets["all"]]
    gain = retrained_gap(pool, best_five, best_five[:1], draws)
    wide_gap = retrained_gap(pool, ["C_HH_F1"], ["C_HH_F0"], draws)
    return [
        parts_larger(
            "Three features of F1 beat three of any other sub-band",
            "0.94 against 0.72, 0.74, 0.64",
            gaps,
        ),
        parts_larger(
            "Features of other sub-bands add little (less than 0.03 for the best five of 40)",
            "0.93 to 0.94",
            {"0.03 less the gain": limit_less(gain, 0.03)},
        ),
        _ratio_finding(pool, "R_HH_HV", by_band, draws),
        _ratio_finding(pool, "R_VV_HV", by_band, draws),
        parts_larger(
            "C_HH of F1 beats C_HH of the wide band F0 at the same alarms (the paper's thesis)",
            "not tabulated",
            {"F1 - F0": wide_gap},
        ),
    ]


def _ratio_finding(
    pool: Pool, feature: str, by_band: Mapping[str, pd.DataFrame], draws: int
) -> Finding:
    """Judge that a ratio of co- to cross-polarization works best at low sub-bands (Fig. 10)."""
    scores = []
    for band in SUBBANDS:
        score = float(by_band[band][feature]["A"])
        scores.append(f"{band} {score:.2f}")
    return parts_larger(
        f"The co/cross ratio {feature} works best at low sub-bands",
        "more valid at lower bands (Fig. 10)",
        {"F1 - F4": retrained_gap(pool, [f"{feature}_F1"], [f"{feature}_F4"], draws)},
        note=f"PD_mean {', '.join(scores)}.",
    )
