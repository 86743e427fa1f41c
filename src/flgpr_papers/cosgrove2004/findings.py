"""Findings of the study: Pd of every detector over the seeds, and the paper's statements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from flgpr.scoring import pd_at, pd_mean, peak_roc
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.findings import (
    MARGIN,
    UNDECIDED,
    Finding,
    alike,
    larger,
    less_figure,
    measured,
    share_error,
)

FloatArray = NDArray[np.float64]
Case = dict[str, Any]
"""What was measured on a lane, as JSON can hold it."""
PAPER_RATIOS = (1, 0.089, 0.075, 0.028, 0.019, 0.014)  # eigenvalues over the first (IV-A)
PAPER_PD = 0.9  # at 0.01 false alarms per m²
PAPER_LOOKS = 72  # mine images at site one
SOILS = ("sand", "gravel", "clay")
_SHARE = (0.0, 1.0)
_DIFFERENCE = (-1.0, 1.0)  # of two shares
_POSITIVE = (0.0, math.inf)  # of counts and widths
_REMAINS = "remains to be seen (V)"
_NOTHING = 0.1  # Pd below which detectors are not compared with each other


def interval(
    values: Sequence[float] | FloatArray,
    level: float = 0.95,
    bounds: tuple[float, float] | None = None,
) -> tuple[float, float, float]:
    """Return the mean over seeds and its interval; seeds without a value (NaN) are left out.

    The interval is Student's, cut off at the ``bounds`` of the values. Equal values have no spread
    that it could use. Then, for values within ``bounds``, the share of seeds with another value is
    below ``1 - ((1 - level)/2)^(1/n)``, and each of these may lie at a bound; without bounds
    nothing is known and the ends are infinite.

    Parameters
    ----------
    values : (n,) array_like
        A value for each seed.
    level : float
        Probability of the interval.
    bounds : tuple of float, optional
        Least and largest possible value.
    """
    sample = np.asarray(values, dtype=np.float64)
    sample = sample[~np.isnan(sample)]
    mean = float(sample.mean()) if sample.size else math.nan
    low, high = bounds or (-math.inf, math.inf)
    if sample.size < 2:
        return mean, low, high
    if np.ptp(sample) == 0:
        if bounds is None:
            return mean, low, high
        widening = 1 - ((1 - level) / 2) ** (1 / sample.size)
        return mean, mean - widening * (mean - low), mean + widening * (high - mean)
    half = float(
        stdtrit(sample.size - 1, (1 + level) / 2) * sample.std(ddof=1) / math.sqrt(sample.size)
    )
    return mean, max(mean - half, low), min(mean + half, high)


def case_curve(
    case: Case, detector: str, box: float, quantile: bool = False, rocks: bool = True
) -> pd.DataFrame:
    """Compute the ROC of one detector on one lane.

    Parameters
    ----------
    case : Case
        What was measured on the lane.
    detector : str
        Name of the detector.
    box : float
        Side of the boxes, m.
    quantile : bool
        Whether a box counts by its high quantile (footnote 4) and not by its peak.
    rocks : bool
        False leaves out clutter boxes with a rock in or near them.
    """
    peaks = case["peaks"][detector]
    suffix = "_quantile" if quantile else ""
    clutter = np.asarray(peaks["clutter" + suffix])
    if not rocks:
        clutter = clutter[~np.asarray(peaks["rock"], dtype=bool)]
    return peak_roc(peaks["target" + suffix], clutter, box**2)


def pd_table(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> pd.DataFrame:
    """Compute Pd at the study's P_FA, of every detector on every lane of every seed.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping of str to sequence of Case
        Cases of every seed by site.

    Returns
    -------
    DataFrame
        ``site``, ``seed``, ``detector``, ``pd``, ``pd_quantile`` (high quantile of the boxes),
        ``pd_rockless`` (boxes with rocks left out; NaN if none is left), ``pd_mean`` (mean Pd up to
        0.1 per m²).
    """
    rows = []
    for site, lanes in cases.items():
        for case in lanes:
            for name in case["peaks"]:
                rows.append({"site": site, "seed": case["seed"], **_pd_row(recipe, case, name)})
    return pd.DataFrame(rows)


def _pd_row(recipe: StudyRecipe, case: Case, detector: str) -> dict[str, Any]:
    """Return the columns of :func:`pd_table` of a detector on a lane."""
    box = recipe.score.box
    pfa = recipe.score.pfa
    curve = case_curve(case, detector, box)
    quantile_curve = case_curve(case, detector, box, quantile=True)
    pd_rockless = math.nan
    if not all(case["peaks"][detector]["rock"]):
        pd_rockless = pd_at(case_curve(case, detector, box, rocks=False), pfa)
    return {
        "detector": detector,
        "pd": pd_at(curve, pfa),
        "pd_quantile": pd_at(quantile_curve, pfa),
        "pd_rockless": pd_rockless,
        "pd_mean": pd_mean(curve, 0.1),
    }


def contrast_table(cases: Mapping[str, Sequence[Case]]) -> pd.DataFrame:
    """Compute the HH level of the mines over that of the clutter, all seeds pooled.

    Parameters
    ----------
    cases : mapping of str to sequence of Case
        Cases of every seed by site.

    Returns
    -------
    DataFrame
        ``site``, ``depth`` (m), ``looks`` (their number), ``contrast`` (median peak in boxes at
        mines over that in clutter boxes, dB).
    """
    rows = []
    for site, lanes in cases.items():
        peaks = [case["peaks"]["HH"] for case in lanes]
        clutter = np.nanmedian(np.concatenate([lane["clutter"] for lane in peaks]))
        depths = np.concatenate([lane["depth"] for lane in peaks])
        targets = np.concatenate([lane["target"] for lane in peaks])
        for depth in np.unique(depths):
            at_depth = targets[depths == depth]
            contrast = 10 * math.log10(float(np.nanmedian(at_depth) / clutter))
            row = {"site": site, "depth": float(depth), "looks": at_depth.size}
            rows.append(row | {"contrast": contrast})
    return pd.DataFrame(rows)


def findings(
    recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]], table: pd.DataFrame
) -> list[Finding]:
    """Judge every statement of the paper, then the questions it leaves open.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping of str to sequence of Case
        Cases of every seed by site.
    table : DataFrame
        As :func:`pd_table` returns it.
    """
    return [
        *_detector_statements(recipe, table),
        *_eigenvalue_statements(cases["sand"]),
        *premise_findings(recipe, cases["sand"]),
        *_open_questions(recipe, table),
    ]


def _pd_by_seed(table: pd.DataFrame, column: str = "pd") -> dict[Any, FloatArray]:
    """Return a column of :func:`pd_table` in the order of the seeds, by site and detector."""
    values = {}
    for key, group in table.groupby(["site", "detector"]):
        values[key] = group.sort_values("seed")[column].to_numpy()
    return values


def _detector_statements(recipe: StudyRecipe, table: pd.DataFrame) -> list[Finding]:
    """Judge what the paper says of Pd (Sec. IV, V)."""
    pds = _pd_by_seed(table)
    soils = [soil for soil in SOILS if soil in recipe.sites]
    return [
        *_rival_statements(recipe, soils, pds),
        _best_pd(recipe, soils, pds),
        *_first_eigenvector_statements(recipe, soils, pds),
        *_soil_statements(recipe, soils, pds),
    ]


def _rival_statements(
    recipe: StudyRecipe, soils: Sequence[str], pds: Mapping[Any, FloatArray]
) -> list[Finding]:
    """Judge that the deflection detector is better than PWF and HH in every soil (IV-B)."""
    rank = recipe.detector.rank
    statements = []
    for soil in soils:
        for rival in ("PWF", "HH"):
            statement = _above(
                f"The deflection detector outperforms {rival}: {recipe.sites[soil].title}",
                "significantly, in all three soils (IV-B)",
                f"{_pd_name(recipe)}: deflection (M' = {rank}) less {rival}",
                pds[soil, f"rank {rank}"] - pds[soil, rival],
            )
            statements.append(statement)
    return statements


def _first_eigenvector_statements(
    recipe: StudyRecipe, soils: Sequence[str], pds: Mapping[Any, FloatArray]
) -> list[Finding]:
    """Judge that the first eigenvector is an excellent detector by itself (IV-A)."""
    rank = recipe.detector.rank
    statements = []
    for soil in soils:
        pds_of_rank = pds[soil, f"rank {rank}"]
        statement = _above(
            f"The first eigenvector alone is an excellent candidate: {recipe.sites[soil].title}",
            "excellent by itself (IV-A)",
            f"{_pd_name(recipe)}: M' = 1 less M' = {rank}, to lie above -0.05",
            pds[soil, "rank 1"] - pds_of_rank,
            -0.05,
        )
        # Two detectors that find nothing are as good as each other.
        if np.mean(pds_of_rank) < _NOTHING:
            statement = replace(statement, verdict=UNDECIDED, asks=None)
        statements.append(statement)
    return statements


def _soil_statements(
    recipe: StudyRecipe, soils: Sequence[str], pds: Mapping[Any, FloatArray]
) -> list[Finding]:
    """Judge the order of the soils by Pd of the deflection detector (IV-B)."""
    detector = f"rank {recipe.detector.rank}"
    best_claim = ("Dry sand is the best soil", "best overall performance (IV-B)")
    worst_claim = ("Wet clay is the worst soil", "worst overall performance (IV-B)")
    pairs = (
        ("sand", "gravel", best_claim),
        ("sand", "clay", best_claim),
        ("gravel", "clay", worst_claim),
    )
    statements = []
    for better, worse, (claim, paper) in pairs:
        if better in soils and worse in soils:
            titles = f"{recipe.sites[better].title} less {recipe.sites[worse].title}"
            gap = pds[better, detector] - pds[worse, detector]
            statements.append(_above(claim, paper, f"{_pd_name(recipe)}: {titles}", gap))
    return statements


def _best_pd(recipe: StudyRecipe, soils: Sequence[str], pds: Mapping[Any, FloatArray]) -> Finding:
    """Judge the Pd of the best soil against the paper's, a share of its own number of looks."""
    detector = f"rank {recipe.detector.rank}"
    best = max(soils, key=lambda soil: float(np.mean(pds[soil, detector])))
    ours = interval(pds[best, detector], bounds=_SHARE)
    error = share_error(PAPER_PD, PAPER_LOOKS)
    gap = less_figure(ours, PAPER_PD, error)
    return measured(
        f"Pd is about {PAPER_PD} in the best soil (ours: {recipe.sites[best].title})",
        f"{PAPER_PD} at 0.01 per m² (V)",
        f"{_pd_name(recipe)}: ours less {PAPER_PD} of {PAPER_LOOKS} looks",
        gap,
        verdict=alike(*gap[1:]),
        asks=("alike", MARGIN, error),
    )


def _eigenvalue_statements(cases: Sequence[Case]) -> list[Finding]:
    """Judge the ratios of eigenvalues (IV-A) within a factor of two.

    A ratio that no seed's examples reach has no number.
    """
    ratios = np.array([case["ratios"] for case in cases], dtype=np.float64)
    statements = []
    for j in range(1, min(len(PAPER_RATIOS), ratios.shape[1])):
        paper = PAPER_RATIOS[j]
        low = 0.5 * paper
        high = 2 * paper
        statement = measured(
            f"Eigenvalue {j + 1} is {paper} of the first (dry sand)",
            f"{paper} (IV-A)",
            f"σ{j + 1}/σ1, to lie in {low:.3g} to {high:.3g}",
            interval(ratios[:, j], bounds=_SHARE),
            (low, high),
        )
        statements.append(statement)
    return statements


def _open_questions(recipe: StudyRecipe, table: pd.DataFrame) -> list[Finding]:
    """Return our own questions about the detectors' Pd, which have no verdict."""
    pds = _pd_by_seed(table)
    quantile_pds = _pd_by_seed(table, "pd_quantile")
    detector = f"rank {recipe.detector.rank}"
    questions = []
    for name, site in recipe.sites.items():
        question = _open(
            f"A high quantile of each box in place of its peak (footnote 4): {site.title}",
            "would perhaps be better",
            f"{_pd_name(recipe)}: quantile less peak",
            quantile_pds[name, detector] - pds[name, detector],
        )
        questions.append(question)
    if "plastic" in recipe.sites:
        questions += _plastic_questions(recipe, pds)
    for rival, text in recipe.questions.items():
        for soil in SOILS:
            if (soil, rival) in pds:
                question = _open(
                    f"{text}: {recipe.sites[soil].title}",
                    "not tried",
                    f"{_pd_name(recipe)}: less that of the deflection detector",
                    pds[soil, rival] - pds[soil, detector],
                )
                questions.append(question)
    return questions


def _plastic_questions(recipe: StudyRecipe, pds: Mapping[Any, FloatArray]) -> list[Finding]:
    """Return how plastic mines are found, which the paper leaves open (V)."""
    pd_name = _pd_name(recipe)
    pds_of_plastic = pds["plastic", f"rank {recipe.detector.rank}"]
    questions = [
        measured(
            "Plastic mines, detector trained on plastic mines",
            _REMAINS,
            pd_name,
            interval(pds_of_plastic, bounds=_SHARE),
        )
    ]
    rivals = {"PWF": "PWF", "trained on sand": "the detector trained on metal mines"}
    for rival, title in rivals.items():
        if ("plastic", rival) in pds:
            quantity = f"{pd_name}: deflection less {title}"
            gain = pds_of_plastic - pds["plastic", rival]
            questions.append(_open("Plastic mines", _REMAINS, quantity, gain))
    return questions


def premise_findings(recipe: StudyRecipe, sand: Sequence[Case]) -> list[Finding]:
    """Judge the paper's premises about mines and clutter in dry sand.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    sand : sequence of Case
        Cases of dry sand, seed by seed, with the measures of
        :mod:`flgpr_papers.cosgrove2004.signature`.
    """
    return [
        *_signature_statements(recipe, sand),
        *_double_hump_statements(recipe, sand),
        *_visibility_statements(recipe, sand),
        _correlation_statement(sand),
        _gaussian_statement(recipe, sand),
        *_cross_range_statements(recipe, sand),
    ]


def _signature_statements(recipe: StudyRecipe, sand: Sequence[Case]) -> list[Finding]:
    """Judge that a simulated mine has a double hump along range (Fig. 3)."""
    humps = recipe.premises.humps
    statements = []
    for name in recipe.cut.polarizations:
        # The signatures are the same for every seed: their mines are the sample.
        counts = np.array(sand[0]["signature_humps"][name], dtype=np.float64)
        statement = measured(
            f"A simulated mine has a double hump along range, {name}",
            "should exhibit it (III-B, Fig. 3)",
            f"humps of clutter-free signatures in {name}, mean, {_within(humps)}",
            interval(counts, bounds=_POSITIVE),
            humps,
        )
        statements.append(statement)
    return statements


def _double_hump_statements(recipe: StudyRecipe, sand: Sequence[Case]) -> list[Finding]:
    """Judge that imaged mines have a double hump, and that clutter has not (III-B, Fig. 4)."""
    humps = recipe.premises.humps
    statements = []
    for name in recipe.cut.polarizations:
        evident = measured(
            f"The double hump is evident in the data, {name}",
            "evident (III-B, Fig. 4)",
            f"humps of imaged mines in {name}, mean, {_within(humps)}",
            interval(_seed_means(sand, "mine", name), bounds=_POSITIVE),
            humps,
        )
        distinguishing = _above(
            f"The double hump appears to be the distinguishing feature of a mine, {name}",
            "appears to be (III-B)",
            f"share of cuts in {name} with two humps: mines less clutter",
            _double_share(sand, "mine", name) - _double_share(sand, "clutter", name),
        )
        statements += [evident, distinguishing]
    return statements


def _visibility_statements(recipe: StudyRecipe, sand: Sequence[Case]) -> list[Finding]:
    """Judge that mines at 15, 20 and 25 m are readily visible (Fig. 2), if they were imaged."""
    premises = recipe.premises
    shares = []
    for case in sand:
        if case["visible"]:
            shares.append(float(np.mean(case["visible"])))
    if not shares:
        return []
    return [
        measured(
            "Three mines are readily visible at 15, 20 and 25 m (HH)",
            "readily visible (Fig. 2)",
            f"share above {premises.visible:.0%} of the clutter boxes, "
            f"{_within(premises.visible_mines)}",
            interval(shares, bounds=_SHARE),
            premises.visible_mines,
        )
    ]


def _correlation_statement(sand: Sequence[Case]) -> Finding:
    """Judge that mines are better correlated between HH and VV than clutter (III-C)."""
    mines = _seed_means(sand, "mine", "correlation")
    clutter = _seed_means(sand, "clutter", "correlation")
    return _above(
        "A mine is better correlated between HH and VV than clutter",
        "mine well, clutter at least partially not (III-C)",
        "correlation along the cut: mines less clutter",
        mines - clutter,
    )


def _gaussian_statement(recipe: StudyRecipe, sand: Sequence[Case]) -> Finding:
    """Judge that whitened clutter is complex Gaussian (II-A)."""
    rule = recipe.premises.fourth_moment
    moments = [case["premises"]["fourth_moment_ratio"] for case in sand]
    return measured(
        "Clutter may be modelled as complex Gaussian after whitening",
        "arguably (II-A)",
        f"E|z|⁴/(E|z|²)² of whitened clutter, 2 if Gaussian, {_within(rule)}",
        interval(moments, bounds=(1.0, math.inf)),
        rule,
    )


def _cross_range_statements(recipe: StudyRecipe, sand: Sequence[Case]) -> list[Finding]:
    """Judge what the paper says of mines across range (III-B): no structure, and their width."""
    premises = recipe.premises
    humps = []
    widths = []
    for case in sand:
        across = case["premises"]["across"]
        humps.append(np.mean(across["humps"]))
        widths.append(_mean(across["width"]) / case["point_width"])
    value, low, high = interval(widths, bounds=_POSITIVE)
    return [
        measured(
            "There is little observable cross-range structure",
            "little (III-B)",
            f"humps across mines in HH, mean, {_within(premises.humps_across)}",
            interval(np.array(humps), bounds=_POSITIVE),
            premises.humps_across,
        ),
        measured(
            "A mine appears at least as wide as the cross-range resolution",
            "at least as wide (III-B)",
            f"half-power width across, in widths of an ideal point, to lie above "
            f"{premises.width_across:g}",
            (value, low, high),
            verdict=larger(low, high, premises.width_across),
            asks=("larger", premises.width_across, 0.0),
        ),
    ]


def _within(rule: tuple[float, float]) -> str:
    """Format a rule in words."""
    return f"to lie in {rule[0]:g} to {rule[1]:g}"


def _seed_means(cases: Sequence[Case], kind: str, measure: str) -> FloatArray:
    """Return the mean of a measure of mines or clutter in every seed."""
    return np.array([_mean(case["premises"][kind][measure]) for case in cases])


def _double_share(cases: Sequence[Case], kind: str, polarization: str) -> FloatArray:
    """Return the share of cuts with exactly two humps in every seed."""
    shares = []
    for case in cases:
        humps = np.array(case["premises"][kind][polarization])
        shares.append(float(np.mean(humps == 2)))
    return np.array(shares)


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the values that are known, NaN without one."""
    known = [value for value in values if not math.isnan(value)]
    return float(np.mean(known)) if known else math.nan


def _pd_name(recipe: StudyRecipe) -> str:
    """Return the name of Pd at the study's P_FA."""
    return f"Pd at {recipe.score.pfa:g} per m²"


def _above(
    statement: str, paper: str, quantity: str, values: FloatArray, limit: float = 0.0
) -> Finding:
    """Return the finding that differences of shares lie above a limit."""
    value, low, high = interval(values, bounds=_DIFFERENCE)
    return measured(
        statement,
        paper,
        quantity,
        (value, low, high),
        verdict=larger(low, high, limit),
        asks=("larger", limit, 0.0),
    )


def _open(statement: str, paper: str, quantity: str, values: FloatArray) -> Finding:
    """Return the finding of a question that the paper does not answer, by differences of shares."""
    return measured(statement, paper, quantity, interval(values, bounds=_DIFFERENCE))
