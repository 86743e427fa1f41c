"""What Wang et al. 2007 found, and whether simulated lanes show it too.

Differences of PD_mean come from resampling targets, lanes and stretches of lane. Where a
discriminant is trained, it is trained anew in every draw. The paper's Pd are counts of the targets
that it tells: 47 mines, 20 of them buried plastic ones, and 16 simulants on the calibration lanes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from flgpr.chain.classifier import CLASSIFIER_A, CLASSIFIER_B, make_training_set, train
from flgpr.chain.recipe import Recipe
from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.scoring import Match, compare
from flgpr_papers.kit.findings import (
    MARGIN,
    SHARE,
    SHARE_DIFFERENCE,
    Finding,
    Interval,
    alike,
    all_of,
    difference_of_shares,
    judge,
    less_figure,
    parts_larger,
    share_error,
    spread,
    together,
)
from flgpr_papers.kit.page import detections_at, pd_in_words
from flgpr_papers.wang2007.analysis import (
    AREA,
    BURIED_METAL,
    BURIED_PLASTIC,
    MINES,
    SIMULANTS,
    SUBBANDS,
    LaneResult,
    Pool,
    all_forty,
    clutter_levels,
    matched,
    prescreened,
    table_one,
    table_two,
)

FloatArray = NDArray[np.float64]
SETS = {"A": CLASSIFIER_A, "B": CLASSIFIER_B}
PAPER_MINES = 47
PAPER_PLASTIC = 20
PAPER_SIMULANTS = 16
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
F1 = tuple(f"{name}_F1" for name in FEATURES)


def retrainings(draws: int) -> int:
    """Return in how many of the draws a discriminant is trained anew.

    Enough for a standard deviation.
    """
    return max(draws // 5, 20)


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
    """Judge everything."""
    pool = Pool(calibration)
    by_band = {band: table_one(pool, band) for band in ("F0", *SUBBANDS)}
    searches = table_two(pool)
    sets = {}
    for band in SUBBANDS:
        columns = [f"{name}_{band}" for name in FEATURES]
        sets[band] = pool.search(columns, "A", 3)
    sets["all"] = pool.search(all_forty(), "A", 5)
    blind_matches = blind_scores(calibration, blind)
    findings = [
        *prescreener_findings(calibration, recipe, draws),
        *feature_findings(pool, by_band["F1"], searches, draws),
        *band_findings(pool, by_band, sets, draws),
        *curve_findings(pool.match_of(pool.confidence(["C_HH_F1"], "A")), blind_matches),
        *alike_findings(pool, blind_matches, draws),
    ]
    return findings, Tables(pool, by_band, searches, sets, blind_matches)


def blind_scores(
    calibration: Sequence[LaneResult],
    blind: Sequence[LaneResult],
    sets: Mapping[str, tuple[str, ...]] = SETS,
) -> dict[str, Match]:
    """Score the blind lanes with classifiers of sets of features.

    They are trained on all calibration lanes and frozen.
    """
    lanes = [
        (result.name, result.alarms, result.features, result.truth, result.lane)
        for result in calibration
    ]
    scores = {}
    for name, columns in sets.items():
        classifier = train(make_training_set(lanes, columns=columns), columns)
        tables = [
            result.alarms.assign(confidence=classifier.confidence(result.features))
            for result in blind
        ]
        scores[name] = matched(blind, [table.dropna(subset=["confidence"]) for table in tables])
    return scores


def prescreener_findings(
    results: Sequence[LaneResult], recipe: Recipe, draws: int
) -> list[Finding]:
    """Judge the findings about sub-bands at the prescreener stage (Sec. II-C and Fig. 9)."""
    of = {
        (p, b): prescreened(results, p, b, recipe)
        for p in ("HH", "VV", "HV")
        for b in ("F0", *SUBBANDS)
    }
    wide = prescreened(results, "HH", "wide", recipe)
    findings = [
        parts_larger(
            "The lowest sub-band F1 is best for the prescreener (HH)",
            "F1 > F2, F3, F4 (Fig. 9)",
            {f"F1 - {b}": _compare(of["HH", "F1"], of["HH", b], draws, 3) for b in SUBBANDS[1:]},
            note="PD_mean of actual mines; simulants and alarms outside the lane are left out.",
        )
    ]
    findings.append(
        parts_larger(
            "In F1 the polarization HH is best for the prescreener",
            "HH and F1 perform best (II-C, Fig. 9)",
            {f"HH - {p}": _compare(of["HH", "F1"], of[p, "F1"], draws, 2) for p in ("VV", "HV")},
        )
    )
    findings += _clutter_findings(results)
    for p in ("HH", "VV", "HV"):
        steps = {
            f"{a} - {b}": _compare(of[p, a], of[p, b], draws, 3) for a, b in pairwise(SUBBANDS)
        }
        findings.append(
            parts_larger(f"Pd falls from F1 to F4 in {p}", "each lower (Fig. 9)", steps)
        )
    findings.append(
        _share_finding(
            "HH F1 reaches 100 % at FAR <= 0.15 per m²",
            of["HH", "F1"],
            MINES,
            0.15,
            1.0,
            PAPER_MINES,
        )
    )
    return [
        *findings,
        parts_larger(
            "The narrow F1 beats the wide F0 at the prescreener (the paper's thesis)",
            "F1 chosen over F0",
            {"F1 - F0": _compare(of["HH", "F1"], of["HH", "F0"], draws)},
        ),
        parts_larger(
            "Y_max = 16 m beats the full range",
            "better detection with Y_max = 16 m",
            {"16 m - 26 m": _compare(of["HH", "F1"], wide, draws)},
        ),
    ]


def _clutter_findings(results: Sequence[LaneResult]) -> list[Finding]:
    """Judge that F1 has the least clutter (Fig. 8), by stretches of 10 m of lane as the sample."""
    levels = clutter_levels(results)
    intervals = {}
    for polarization in ("VV", "HH"):
        for subband in ("F0", *SUBBANDS[1:]):
            gap = (
                (levels[f"{polarization} {subband}"] - levels[f"{polarization} F1"])
                .dropna()
                .to_numpy()
            )
            intervals[f"{polarization} {subband} - F1"] = _mean_of_stretches(gap, 8)
    return [
        parts_larger(
            "Sub-band F1 has the lowest level of clutter, in VV and HH",
            "appears so, in general (Fig. 8)",
            intervals,
            note="99 % quantile of the run-view away from targets over its median, dB, "
            "by stretches of 10 m.",
        )
    ]


def _mean_of_stretches(values: FloatArray, parts: int) -> Interval:
    """Return the mean over stretches of lane and Student's interval of it.

    It is of so many intervals that hold all together.
    """
    mean = float(values.mean()) if values.size else float("nan")
    if values.size < 2 or np.ptp(values) == 0:
        return mean, -np.inf, np.inf
    error = float(values.std(ddof=1) / np.sqrt(values.size))
    half = float(stdtrit(values.size - 1, (1 + together(parts)) / 2)) * error
    return mean, mean - half, mean + half


def feature_findings(
    pool: Pool, singles: pd.DataFrame, searches: dict[str, list[SearchStep]], draws: int
) -> list[Finding]:
    """Judge the findings about single features and their combinations (Tables I and II)."""
    values = {
        method: singles.loc[method, list(FEATURES)].to_numpy(dtype=np.float64) for method in "ABC"
    }
    drawn = pool.singles_in(F1, "ABC", retrainings(draws))
    a = values["A"]
    c = values["C"]

    def gap(k: int, other: int, parts: int, method: str = "A") -> Interval:
        """Return the difference of two features by A, or of one by A and another method.

        It is of so many that are asked of.
        """
        apart = drawn["A"][:, k] - drawn[method][:, other]
        return spread(float(a[k] - values[method][other]), apart, together(parts), SHARE_DIFFERENCE)

    number = {name: k for k, name in enumerate(FEATURES)}
    own_number = number["C_HH"]
    strong = [k for k, name in enumerate(FEATURES) if name not in ("P_alpha", "P_psi")]
    weak = max(number["P_alpha"], number["P_psi"], key=lambda k: a[k])
    level = spread(float(a[own_number]), drawn["A"][:, own_number], bounds=SHARE)
    less = less_figure(level, 0.93, share_error(0.93, PAPER_MINES), SHARE_DIFFERENCE)
    contrast = pool.match_of(pool.confidence(["C_HH_F1"], "A"))
    findings = [
        parts_larger(
            "C_HH is the best single feature",
            "PD_mean 0.93, the next 0.82",
            {f"less {FEATURES[k]}": gap(own_number, k, 9) for k in range(10) if k != own_number},
            note=f"PD_mean of C_HH {a[own_number]:.2f}.",
        ),
        parts_larger(
            "C_HH improves much on the prescreener's magnitude, for buried metal and for buried "
            "plastic mines",
            "very significant for both (Fig. 13)",
            {
                f"{kind}, C_HH - magnitude": _compare(
                    contrast, pool.match_of(pool.magnitude()), draws, 2, subset
                )
                for kind, subset in (("metal", BURIED_METAL), ("plastic", BURIED_PLASTIC))
            },
        ),
        Finding(
            "PD_mean of C_HH is 0.93",
            "0.93 (resubstitution and cross-validation)",
            f"{level[0]:.2f} ({level[1]:.2f} to {level[2]:.2f}), cross-validation "
            f"{c[own_number]:.2f}; ours less the paper's "
            f"{less[0]:+.2f} ({less[1]:+.2f} to {less[2]:+.2f})",
            alike(*less[1:]),
            "The level depends on soil, mines and clutter, which the paper does not describe.",
            interval=less,
            asks=("alike", MARGIN, share_error(0.93, PAPER_MINES)),
        ),
        *_more_feature_findings(pool, searches, draws),
        _within_finding(
            "Cross-validation is close to resubstitution with duplication (within 0.02, but for "
            "P_psi)",
            "equal",
            {name: gap(k, k, 9, "C") for name, k in number.items() if name != "P_psi"},
            0.02,
        ),
        parts_larger(
            "Resubstitution and cross-validation part as features grow",
            "0.00 at 1, up to 0.06 at 9 features",
            {"slope per feature": _slope(pool, searches, retrainings(draws))},
            note="Straight line through the difference of the two over the steps of the search.",
        ),
        parts_larger(
            "P_alpha and P_psi are the weak ones",
            "0.19 and 0.30, all others at least 0.66",
            {f"{FEATURES[k]} less {FEATURES[weak]}": gap(k, weak, 8) for k in strong},
            note=", ".join(f"{name} {a[number[name]]:.2f}" for name in ("P_alpha", "P_psi")) + ".",
        ),
        _within_finding(
            "Duplication changes single features little by resubstitution (within 0.05)",
            "by up to 0.19 (P_psi: 0.30 and 0.11)",
            {name: gap(k, k, 10, "B") for name, k in number.items()},
            0.05,
            "A discriminant of one feature is monotone in it, so that only its sign can change; "
            "the paper's "
            "larger differences are not explained by its text.",
        ),
    ]
    return [*findings, *_distribution_findings(pool, draws)]


def _best_set(search: Sequence[SearchStep]) -> list[str]:
    """Return the features of F1 up to the step of a search that scores best."""
    best = max(range(len(search)), key=lambda step: search[step].score)
    return [F1[step.feature] for step in search[: best + 1]]


def _more_feature_findings(
    pool: Pool, searches: Mapping[str, list[SearchStep]], draws: int
) -> list[Finding]:
    """Judge what more features give, by every method and for simulants.

    See Table II and the text below Fig. 13.
    """
    note = "The best set of a search was chosen on these lanes: its gain is too favourable."
    sets = {method: _best_set(search) for method, search in searches.items()}
    chosen = {
        f"({method}) {_HARDLY} less the gain": _turned(
            _retrained(pool, sets[method], ["C_HH_F1"], draws, 3, method), _HARDLY
        )
        for method in "ABC"
    }
    unduplicated = _retrained(pool, sets["D"], ["C_HH_F1"], draws, 1, "D")
    value, low, high = _retrained(pool, sets["A"], ["C_HH_F1"], draws, subset=SIMULANTS)
    return [
        parts_larger(
            f"More features than C_HH hardly help by methods A, B and C (less than {_HARDLY})",
            "0.93 to 0.94, 0.90 to 0.91, 0.93 (Table II)",
            chosen,
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
            {f"{_HARDLY} less the gain": _turned((value, low, high), _HARDLY)},
            note=f"PD_mean of simulants with {', '.join(sets['A'])} and with C_HH alone, method A.",
        ),
        *_duplication_findings(pool, searches, draws),
    ]


def _duplication_findings(
    pool: Pool, searches: Mapping[str, list[SearchStep]], draws: int
) -> list[Finding]:
    """Judge where duplication matters more.

    By cross-validation in Table I, by resubstitution in Table II.
    """
    columns = list(F1)
    singles = {method: pool.singles(columns, method) for method in "ABCD"}
    drawn = pool.singles_in(columns, "ABCD", retrainings(draws))
    one_feature = spread(
        _duplication_gap(singles), _duplication_gap(drawn), bounds=SHARE_DIFFERENCE
    )
    steps = {}
    for method, search in searches.items():
        steps[method] = np.array([step.score for step in search])
    searched = pool.searches_in(columns, "ABCD", retrainings(draws))
    value, low, high = spread(
        _duplication_gap(steps), _duplication_gap(searched), bounds=SHARE_DIFFERENCE
    )
    lead = spread(contrast_lead(singles["D"]), contrast_lead(drawn["D"]), bounds=SHARE_DIFFERENCE)
    return [
        parts_larger(
            "Duplication matters more by cross-validation than by resubstitution, single features",
            "0.08 and 0.03 (Table I, mean of |C - D| and |A - B|)",
            {"mean |C - D| less mean |A - B|": one_feature},
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
            {
                f"mean {first} - {second}": spread(
                    float((steps[first] - steps[second]).mean()),
                    (searched[first] - searched[second]).mean(axis=1),
                    together(2),
                    SHARE_DIFFERENCE,
                )
                for first, second in ("AB", "CD")
            },
        ),
        parts_larger(
            "Local contrast is the best single feature by method D, too",
            "C_VV 0.81, C_HH 0.77, the next 0.73 (Table I)",
            {"better of C_VV and C_HH less the best other": lead},
        ),
    ]


def contrast_lead(scores: FloatArray) -> Any:
    """Return C_HH or C_VV, the better, less the best other feature (..., feature)."""
    is_contrast = np.array([name in ("C_HH", "C_VV") for name in FEATURES])
    return scores[..., is_contrast].max(axis=-1) - scores[..., ~is_contrast].max(axis=-1)


def _duplication_gap(scores: Mapping[str, FloatArray]) -> Any:
    """Return mean |C - D| less mean |A - B| over the last axis."""
    by_cross_validation = np.abs(scores["C"] - scores["D"]).mean(axis=-1)
    by_resubstitution = np.abs(scores["A"] - scores["B"]).mean(axis=-1)
    return by_cross_validation - by_resubstitution


def _slope(pool: Pool, searches: Mapping[str, list[SearchStep]], draws: int) -> Interval:
    """Return how resubstitution and cross-validation part as features grow."""
    drawn = pool.searches_in(F1, "AC", draws)
    score_gaps = np.array(
        [a.score - c.score for a, c in zip(searches["A"], searches["C"], strict=True)]
    )
    slopes = np.polyfit(np.arange(10), np.vstack([score_gaps, drawn["A"] - drawn["C"]]).T, 1)[0]
    return spread(float(slopes[0]), slopes[1:])


def _distribution_findings(pool: Pool, draws: int) -> list[Finding]:
    """Judge what the paper says of the features' distributions."""
    findings = []
    note = (
        "The text says a higher P_tau for mines and calls it more symmetric, but by its Eq. 15 tau "
        "is 0 for a "
        "symmetric scatterer: the claim of symmetry is lower tau."
    )
    for name, claim, remark in (
        ("P_H", "Mines have a lower P_H (less random)", ""),
        ("P_tau", "Mines are more symmetric scatterers (lower tau by Eq. 15)", note),
    ):
        value, low, high = spread(*pool.outranks(f"{name}_F1", retrainings(draws)), bounds=SHARE)
        text = f"P(mine > false alarm) = {value:.2f} ({low:.2f} to {high:.2f})"
        rule = (-1.0, 0.5)
        verdict = judge(low, high, rule)
        findings.append(
            Finding(claim, "stated, no figure", text, verdict, remark, "", (value, low, high), rule)
        )
    for claim, paper, names in _MORE_OF:
        level = together(len(names))
        ranks = {
            name: spread(*pool.outranks(f"{name}_F1", retrainings(draws)), level, SHARE)
            for name in names
        }
        findings.append(
            parts_larger(claim, paper, ranks, 0.5, "P(mine > false alarm); 0.5 by chance.")
        )
    return findings


def band_findings(
    pool: Pool, by_band: dict[str, pd.DataFrame], sets: dict[str, list[SearchStep]], draws: int
) -> list[Finding]:
    """Judge the findings about features of other sub-bands (the paper's Tables III and IV)."""
    three = {}
    for band in SUBBANDS:
        three[band] = [f"{FEATURES[step.feature]}_{band}" for step in sets[band]]
    forty = [f"{name}_{b}" for b in SUBBANDS for name in FEATURES]
    five = [forty[step.feature] for step in sets["all"]]
    more = _retrained(pool, five, five[:1], draws)
    findings = [
        parts_larger(
            "Three features of F1 beat three of any other sub-band",
            "0.94 against 0.72, 0.74, 0.64",
            {f"F1 - {b}": _retrained(pool, three["F1"], three[b], draws, 3) for b in SUBBANDS[1:]},
        ),
        parts_larger(
            "Features of other sub-bands add little (less than 0.03 for the best five of 40)",
            "0.93 to 0.94",
            {"0.03 less the gain": _turned(more, 0.03)},
        ),
    ]
    for pol in ("HH", "VV"):
        name = f"R_{pol}_HV"
        score = ", ".join(f"{b} {float(by_band[b][name]['A']):.2f}" for b in SUBBANDS)
        findings.append(
            parts_larger(
                f"The co/cross ratio {name} works best at low sub-bands",
                "more valid at lower bands (Fig. 10)",
                {"F1 - F4": _retrained(pool, [f"{name}_F1"], [f"{name}_F4"], draws)},
                note=f"PD_mean {score}.",
            )
        )
    findings.append(
        parts_larger(
            "C_HH of F1 beats C_HH of the wide band F0 at the same alarms (the paper's thesis)",
            "not tabulated",
            {"F1 - F0": _retrained(pool, ["C_HH_F1"], ["C_HH_F0"], draws)},
        )
    )
    return findings


def curve_findings(calibration: Match, blind: dict[str, Match]) -> list[Finding]:
    """Judge the findings about points of the final curves (the paper's Sec. III and Fig. 14)."""
    findings = []
    points = (
        ("buried plastic mines", BURIED_PLASTIC, PAPER_PLASTIC, ((0.02, 0.65), (0.07, 0.90))),
        ("simulants", SIMULANTS, PAPER_SIMULANTS, ((0.02, 7 / 16), (0.07, 9 / 16))),
    )
    for what, subset, count, expected in points:
        for far, figure in expected:
            claim = f"Of the {what} C_HH finds {figure:.0%} at {far:g} per m² (calibration)"
            findings.append(_share_finding(claim, calibration, subset, far, figure, count))
    n, simulants, _ = detections_at(calibration, SIMULANTS, 0.07, area=AREA)
    m, mines, _ = detections_at(calibration, BURIED_PLASTIC, 0.07, area=AREA)
    gap = {"plastic - simulants at 0.07 per m²": difference_of_shares((m, mines), (n, simulants))}
    findings.append(
        parts_larger(
            "Simulants are found much worse than plastic mines", "9 of 16 against 90 %", gap
        )
    )
    for name, match in blind.items():
        claim = f"Metal mines: 100 % below 0.01 per m² on the blind lanes, classifier {name}"
        note = "The paper does not tell how many there were; as many as here are assumed."
        findings.append(_share_finding(claim, match, {"kind": "metal"}, 0.01, 1.0, None, note))
    return findings


def alike_findings(pool: Pool, blind: dict[str, Match], draws: int) -> list[Finding]:
    """Judge that classifiers A and B are alike, on calibration and blind lanes (Fig. 14)."""
    calibration = {
        name: pool.match_of(pool.confidence(list(columns), "A")) for name, columns in SETS.items()
    }
    subsets = {"metal": BURIED_METAL, "plastic": BURIED_PLASTIC}
    intervals = {}
    for lanes, scores in (("calibration", calibration), ("blind", blind)):
        for kind, subset in subsets.items():
            intervals[f"{kind}, {lanes}: B - A"] = _compare(
                scores["B"], scores["A"], draws, 4, subset
            )
    claim = (
        f"Classifiers A and B are alike on calibration and blind lanes (PD_mean within {MARGIN})"
    )
    return [_within_finding(claim, "similar for both (Fig. 14)", intervals, MARGIN)]


def _share_finding(
    claim: str,
    matched: Match,
    subset: Any,
    far: float,
    figure: float,
    count: int | None,
    note: str = "",
) -> Finding:
    """Compare a Pd with that of the paper, of so many targets (None: as many as here)."""
    n_found, targets, chance = detections_at(matched, subset, far, area=AREA)
    n = targets if count is None else count
    gap = difference_of_shares((n_found, targets), (round(figure * n), n))
    text = (
        f"{pd_in_words(n_found, targets, chance)}; less {round(figure * n)} of {n}: {gap[0]:+.2f}"
    )
    ours = f"{text} ({gap[1]:+.2f} to {gap[2]:+.2f})"
    asks = ("alike", MARGIN, share_error(figure, n))
    return Finding(claim, f"{figure:.0%}", ours, alike(*gap[1:]), note, interval=gap, asks=asks)


def _within_finding(
    claim: str, paper: str, parts: Mapping[str, Interval], limit: float, note: str = ""
) -> Finding:
    """Judge a claim that several differences are small; its number is the largest of them."""
    verdict = all_of([judge(low, high, (-limit, limit)) for _, low, high in parts.values()])
    name = max(parts, key=lambda key: max(abs(parts[key][1]), abs(parts[key][2])))
    value, low, high = parts[name]
    ours = f"widest {name} {value:+.3f} ({low:+.3f} to {high:+.3f})"
    values = tuple(value for value, _, _ in parts.values())
    return Finding(
        claim, paper, ours, verdict, note, interval=parts[name], rule=(-limit, limit), parts=values
    )


def _compare(
    first: Match, second: Match, draws: int, parts: int = 1, subset: Any = MINES
) -> Interval:
    """Return the difference of PD_mean of two sets of features by a method A-D.

    Both are trained anew in every draw.
    """
    comparison = compare(first, second, subset, area=AREA, draws=draws, level=together(parts))
    return comparison.difference, comparison.low, comparison.high


def _retrained(
    pool: Pool,
    first: Sequence[str],
    second: Sequence[str],
    draws: int,
    parts: int = 1,
    method: str = "A",
    subset: Any = MINES,
) -> Interval:
    """Return the difference of PD_mean of two sets of features by a method A-D.

    Both are trained anew in every draw.
    """
    scorer = pool.scorer_of(subset)
    scores = [scorer(pool.confidence(list(columns), method)) for columns in (first, second)]
    drawn = [
        pool.retrained(list(columns), method, retrainings(draws), subset)
        for columns in (first, second)
    ]
    return spread(scores[0] - scores[1], drawn[0] - drawn[1], together(parts), SHARE_DIFFERENCE)


def _turned(interval: Interval, limit: float) -> Interval:
    """Return a limit less an interval."""
    value, low, high = interval
    return limit - value, limit - high, limit - low
