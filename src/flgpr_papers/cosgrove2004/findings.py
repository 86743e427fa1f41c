"""Findings of the study: Pd of every detector over the seeds, and the paper's statements."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from flgpr.scoring import pd_at, pd_mean, peak_roc
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.findings import (
    SHARE,
    SHARE_DIFFERENCE,
    UNDECIDED,
    Bounds,
    Finding,
    Interval,
    less_figure,
    share_error,
)
from flgpr_papers.kit.statements import Statements

FloatArray = NDArray[np.float64]
Case = dict[str, Any]
"""What was measured on a lane, as JSON can hold it."""
PAPER_RATIOS = (1, 0.089, 0.075, 0.028, 0.019, 0.014)  # eigenvalues over the first (IV-A)
PAPER_PD = 0.9  # at 0.01 false alarms per m²
PAPER_LOOKS = 72  # mine images at site one
SOILS = ("sand", "gravel", "clay")
_POSITIVE = (0.0, math.inf)  # of counts and widths
_STATEMENTS = Statements("cosgrove2004")
_NOTHING = 0.1  # Pd below which detectors are not compared with each other


def interval(
    values: Sequence[float] | FloatArray,
    level: float = 0.95,
    bounds: tuple[float, float] | None = None,
) -> Interval:
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
    pds = _pd_by_seed(table)
    return [
        *_detector_statements(recipe, pds),
        *_eigenvalue_statements(cases["sand"]),
        *_premise_statements(recipe, cases["sand"]),
        *_open_questions(recipe, pds, _pd_by_seed(table, "pd_quantile")),
    ]


def _pd_by_seed(table: pd.DataFrame, column: str = "pd") -> dict[Any, FloatArray]:
    """Return a column of :func:`pd_table` in the order of the seeds, by site and detector."""
    values = {}
    for key, group in table.groupby(["site", "detector"]):
        values[key] = group.sort_values("seed")[column].to_numpy()
    return values


def _gap(statement: str, recipe: StudyRecipe, values: FloatArray, **fields: Any) -> Finding:
    """Judge a statement by differences of Pd or of other shares, a value for each seed."""
    fields |= {"pd": f"Pd at {recipe.score.pfa:g} per m²", "rank": recipe.detector.rank}
    return _STATEMENTS.number(statement, interval(values, bounds=SHARE_DIFFERENCE), **fields)


def _detector_statements(recipe: StudyRecipe, pds: Mapping[Any, FloatArray]) -> list[Finding]:
    """Judge what the paper says of Pd (Sec. IV, V)."""
    titles = {soil: recipe.sites[soil].title for soil in SOILS if soil in recipe.sites}
    ours = {soil: pds[soil, f"rank {recipe.detector.rank}"] for soil in titles}
    statements = []
    for soil, title in titles.items():
        for rival in ("PWF", "HH"):
            gap = ours[soil] - pds[soil, rival]
            statements.append(_gap("outperforms", recipe, gap, soil=title, rival=rival))
    statements.append(_best_pd(recipe, ours))
    for soil, title in titles.items():
        gap = pds[soil, "rank 1"] - ours[soil]
        statement = _gap("first-eigenvector", recipe, gap, soil=title)
        # Two detectors that find nothing are as good as each other.
        if np.mean(ours[soil]) < _NOTHING:
            statement = replace(statement, verdict=UNDECIDED, asks=None)
        statements.append(statement)
    for better, worse, name in (
        ("sand", "gravel", "best-soil"),
        ("sand", "clay", "best-soil"),
        ("gravel", "clay", "worst-soil"),
    ):
        if better in titles and worse in titles:
            gap = ours[better] - ours[worse]
            words = {"better": titles[better], "worse": titles[worse]}
            statements.append(_gap(name, recipe, gap, **words))
    return statements


def _best_pd(recipe: StudyRecipe, ours: Mapping[str, FloatArray]) -> Finding:
    """Judge the Pd of the best soil against the paper's, a share of its own number of looks."""
    best = max(ours, key=lambda soil: float(np.mean(ours[soil])))
    error = share_error(PAPER_PD, PAPER_LOOKS)
    return _STATEMENTS.number(
        "best-pd",
        less_figure(interval(ours[best], bounds=SHARE), PAPER_PD, error),
        error,
        figure=PAPER_PD,
        looks=PAPER_LOOKS,
        soil=recipe.sites[best].title,
        pd=f"Pd at {recipe.score.pfa:g} per m²",
    )


def _eigenvalue_statements(cases: Sequence[Case]) -> list[Finding]:
    """Judge the ratios of eigenvalues (IV-A) within a factor of two.

    A ratio that no seed's examples reach has no number.
    """
    statements = []
    for number, paper, ratio in eigenvalue_ratios_of(cases):
        rule = (0.5 * paper, 2 * paper)
        statements.append(
            _STATEMENTS.number("eigenvalue", ratio, rule=rule, number=number, ratio=paper)
        )
    return statements


def eigenvalue_ratios_of(cases: Sequence[Case]) -> list[tuple[int, float, Interval]]:
    """Return the number of every eigenvalue but the first, the paper's ratio to it and ours."""
    ratios = np.array([case["ratios"] for case in cases], dtype=np.float64)
    return [
        (j + 1, PAPER_RATIOS[j], interval(ratios[:, j], bounds=SHARE))
        for j in range(1, min(len(PAPER_RATIOS), ratios.shape[1]))
    ]


def _open_questions(
    recipe: StudyRecipe, pds: Mapping[Any, FloatArray], quantile_pds: Mapping[Any, FloatArray]
) -> list[Finding]:
    """Return our own questions about the detectors' Pd, which have no verdict."""
    detector = f"rank {recipe.detector.rank}"
    questions = []
    for name, site in recipe.sites.items():
        gap = quantile_pds[name, detector] - pds[name, detector]
        questions.append(_gap("quantile", recipe, gap, soil=site.title))
    if "plastic" in recipe.sites:
        ours = pds["plastic", detector]
        pd_name = f"Pd at {recipe.score.pfa:g} per m²"
        questions.append(_STATEMENTS.number("plastic", interval(ours, bounds=SHARE), pd=pd_name))
        rivals = {"PWF": "PWF", "trained on sand": "the detector trained on metal mines"}
        for rival, title in rivals.items():
            if ("plastic", rival) in pds:
                gap = ours - pds["plastic", rival]
                questions.append(_gap("plastic-rival", recipe, gap, rival=title))
    for rival, text in recipe.questions.items():
        for soil in SOILS:
            if (soil, rival) in pds:
                gap = pds[soil, rival] - pds[soil, detector]
                title = recipe.sites[soil].title
                questions.append(_gap("tried", recipe, gap, question=text, soil=title))
    return questions


def _premise_statements(recipe: StudyRecipe, sand: Sequence[Case]) -> list[Finding]:
    """Judge the paper's premises about mines and clutter in dry sand.

    The cases have the measures of :mod:`flgpr_papers.cosgrove2004.signature`.
    """
    premises = recipe.premises
    measures = [case["premises"] for case in sand]

    def within(
        name: str, values: Sequence[float], rule: Bounds, bounds: Bounds = _POSITIVE, **fields: Any
    ) -> Finding:
        return _STATEMENTS.number(name, interval(values, bounds=bounds), rule=rule, **fields)

    def of_both(measure: Callable[[Any], float], name: str) -> FloatArray:
        """Return a measure of mines less that of clutter in every seed."""
        mines, clutter = [
            np.array([measure(of_seed[kind][name]) for of_seed in measures])
            for kind in ("mine", "clutter")
        ]
        return np.asarray(mines - clutter)

    statements = []
    for name in recipe.cut.polarizations:
        # The signatures are the same for every seed: their mines are the sample.
        counts = sand[0]["signature_humps"][name]
        statements.append(within("signature", counts, premises.humps, polarization=name))
    for name in recipe.cut.polarizations:
        humps = [_mean(of_seed["mine"][name]) for of_seed in measures]
        statements.append(within("evident", humps, premises.humps, polarization=name))
        gap = of_both(_double_share, name)
        statements.append(_gap("distinguishing", recipe, gap, polarization=name))
    visible = [float(np.mean(case["visible"])) for case in sand if case["visible"]]
    if visible:
        rule = premises.visible_mines
        statements.append(within("visible", visible, rule, SHARE, share=premises.visible))
    moments = [of_seed["fourth_moment_ratio"] for of_seed in measures]
    humps = [float(np.mean(of_seed["across"]["humps"])) for of_seed in measures]
    widths = [_mean(case["premises"]["across"]["width"]) / case["point_width"] for case in sand]
    return [
        *statements,
        _gap("correlated", recipe, of_both(_mean, "correlation")),
        within("gaussian", moments, premises.fourth_moment, (1.0, math.inf)),
        within("across", humps, premises.humps_across),
        _STATEMENTS.number("wide", interval(widths, bounds=_POSITIVE), above=premises.width_across),
    ]


def _double_share(humps: Sequence[int]) -> float:
    """Return the share of cuts with exactly two humps."""
    return float(np.mean(np.array(humps) == 2))


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the values that are known, NaN without one."""
    known = [value for value in values if not math.isnan(value)]
    return float(np.mean(known)) if known else math.nan
