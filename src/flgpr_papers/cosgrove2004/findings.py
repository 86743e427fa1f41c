"""What the study found.

Pd of every detector over the seeds, and a verdict on each statement of the paper.
"""

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
PAPER_RATIOS = (1, 0.089, 0.075, 0.028, 0.019, 0.014)
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

    It is Student's, cut off at the ``bounds`` of the values. Equal values have no spread that it
    could use. Then, for values within ``bounds``, the share of seeds with another value is below
    ``1 - ((1 - level)/2)^(1/n)``, and each of these may lie at a bound; without bounds nothing is
    known and the ends are infinite.
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
    """ROC of one detector on one lane.

    ``rocks=False`` leaves out clutter boxes with a rock in or near them.
    """
    peaks = case["peaks"][detector]
    suffix = "_quantile" if quantile else ""
    clutter = np.asarray(peaks["clutter" + suffix])
    if not rocks:
        clutter = clutter[~np.asarray(peaks["rock"], dtype=bool)]
    return peak_roc(peaks["target" + suffix], clutter, box**2)


def pd_table(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> pd.DataFrame:
    """Pd at the study's P_FA of every detector on every lane of every seed.

    Columns: site, seed, detector, pd, pd_quantile (high quantile of the boxes), pd_rockless (boxes
    with rocks left out; NaN if none is left), pd_mean (mean Pd up to 0.1 per m²).
    """
    rows = []
    for site, lanes in cases.items():
        for case in lanes:
            for name in case["peaks"]:
                curve = case_curve(case, name, recipe.score.box)
                high = case_curve(case, name, recipe.score.box, quantile=True)
                bare = math.nan
                if not all(case["peaks"][name]["rock"]):
                    bare = pd_at(
                        case_curve(case, name, recipe.score.box, rocks=False), recipe.score.pfa
                    )
                rows.append(
                    {
                        "site": site,
                        "seed": case["seed"],
                        "detector": name,
                        "pd": pd_at(curve, recipe.score.pfa),
                        "pd_quantile": pd_at(high, recipe.score.pfa),
                        "pd_rockless": bare,
                        "pd_mean": pd_mean(curve, 0.1),
                    }
                )
    return pd.DataFrame(rows)


def contrast_table(cases: Mapping[str, Sequence[Case]]) -> pd.DataFrame:
    """Tabulate the HH level of the mines over that of the clutter, all seeds pooled.

    Columns: site, depth (m), looks, contrast (median peak in boxes at mines over that in clutter
    boxes, dB).
    """
    rows = []
    for site, lanes in cases.items():
        peaks = [case["peaks"]["HH"] for case in lanes]
        clutter = np.nanmedian(np.concatenate([entry["clutter"] for entry in peaks]))
        depth = np.concatenate([entry["depth"] for entry in peaks])
        target = np.concatenate([entry["target"] for entry in peaks])
        for entry in np.unique(depth):
            chosen = target[depth == entry]
            level = 10 * math.log10(float(np.nanmedian(chosen) / clutter))
            rows.append(
                {"site": site, "depth": float(entry), "looks": chosen.size, "contrast": level}
            )
    return pd.DataFrame(rows)


def findings(
    recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]], table: pd.DataFrame
) -> list[Finding]:
    """Judge every statement of the paper, then the questions it leaves open."""
    statements = _detector_statements(recipe, table)
    statements += _eigenvalue_statements(cases["sand"])
    statements += premise_findings(recipe, cases)
    return statements + _open_questions(recipe, table)


def _detector_statements(recipe: StudyRecipe, table: pd.DataFrame) -> list[Finding]:
    """Judge what the paper says of Pd (Sec. IV, V)."""
    deflection = f"rank {recipe.detector.rank}"
    pd_name = _pd_name(recipe)
    pds = {
        key: group.sort_values("seed")["pd"].to_numpy()
        for key, group in table.groupby(["site", "detector"])
    }
    titles = {name: site.title for name, site in recipe.sites.items()}
    soils = [soil for soil in SOILS if soil in titles]
    statements = []
    for soil in soils:
        for rival in ("PWF", "HH"):
            statements.append(
                _above(
                    f"The deflection detector outperforms {rival}: {titles[soil]}",
                    "significantly, in all three soils (IV-B)",
                    f"{pd_name}: deflection (M' = {recipe.detector.rank}) less {rival}",
                    pds[soil, deflection] - pds[soil, rival],
                )
            )
    statements.append(_best_pd(recipe, soils, titles, pds))
    for soil in soils:
        statement = _above(
            f"The first eigenvector alone is an excellent candidate: {titles[soil]}",
            "excellent by itself (IV-A)",
            f"{pd_name}: M' = 1 less M' = {recipe.detector.rank}, to lie above -0.05",
            pds[soil, "rank 1"] - pds[soil, deflection],
            -0.05,
        )
        # Two detectors that find nothing are as good as each other.
        if np.mean(pds[soil, deflection]) < _NOTHING:
            statement = replace(statement, verdict=UNDECIDED, asks=None)
        statements.append(statement)
    for better, worse in (("sand", "gravel"), ("sand", "clay"), ("gravel", "clay")):
        if {better, worse} <= set(soils):
            statements.append(
                _above(
                    "Dry sand is the best soil"
                    if better == "sand"
                    else "Wet clay is the worst soil",
                    "best overall performance (IV-B)"
                    if better == "sand"
                    else "worst overall performance (IV-B)",
                    f"{pd_name}: {titles[better]} less {titles[worse]}",
                    pds[better, deflection] - pds[worse, deflection],
                )
            )
    return statements


def _best_pd(
    recipe: StudyRecipe,
    soils: Sequence[str],
    titles: Mapping[str, str],
    pds: Mapping[Any, FloatArray],
) -> Finding:
    """Judge the Pd of the best soil against the paper's, a share of its own number of looks."""
    deflection = f"rank {recipe.detector.rank}"
    best = max(soils, key=lambda soil: float(np.mean(pds[soil, deflection])))
    ours = interval(pds[best, deflection], bounds=_SHARE)
    error = share_error(PAPER_PD, PAPER_LOOKS)
    gap = less_figure(ours, PAPER_PD, error)
    return measured(
        f"Pd is about {PAPER_PD} in the best soil (ours: {titles[best]})",
        f"{PAPER_PD} at 0.01 per m² (V)",
        f"{_pd_name(recipe)}: ours less {PAPER_PD} of {PAPER_LOOKS} looks",
        gap,
        verdict=alike(*gap[1:]),
        asks=("alike", MARGIN, error),
    )


def _eigenvalue_statements(cases: Sequence[Case]) -> list[Finding]:
    """Judge the ratios of eigenvalues (IV-A) within a factor of two.

    What no example reaches has none.
    """
    ratios = np.array([case["ratios"] for case in cases], dtype=np.float64)
    statements = []
    for j in range(1, min(len(PAPER_RATIOS), ratios.shape[1])):
        paper = PAPER_RATIOS[j]
        low, high = 0.5 * paper, 2 * paper
        statements.append(
            measured(
                f"Eigenvalue {j + 1} is {paper} of the first (dry sand)",
                f"{paper} (IV-A)",
                f"σ{j + 1}/σ1, to lie in {low:.3g} to {high:.3g}",
                interval(ratios[:, j], bounds=_SHARE),
                (low, high),
            )
        )
    return statements


def _open_questions(recipe: StudyRecipe, table: pd.DataFrame) -> list[Finding]:
    """Return our own questions about the detectors' Pd, which have no verdict."""
    deflection = f"rank {recipe.detector.rank}"
    pd_name = _pd_name(recipe)
    titles = {name: site.title for name, site in recipe.sites.items()}
    groups = {key: group.sort_values("seed") for key, group in table.groupby(["site", "detector"])}
    questions = []
    for site in titles:
        of_site = groups[site, deflection]
        text = f"A high quantile of each box in place of its peak (footnote 4): {titles[site]}"
        gain = of_site["pd_quantile"].to_numpy() - of_site["pd"].to_numpy()
        questions.append(
            _open(text, "would perhaps be better", f"{pd_name}: quantile less peak", gain)
        )
    if "plastic" in titles:
        base = groups["plastic", deflection]["pd"].to_numpy()
        ours = interval(base, bounds=_SHARE)
        questions.append(
            measured("Plastic mines, detector trained on plastic mines", _REMAINS, pd_name, ours)
        )
        for rival in ("PWF", "trained on sand"):
            if ("plastic", rival) in groups:
                name = (
                    "the detector trained on metal mines" if rival == "trained on sand" else rival
                )
                gain = base - groups["plastic", rival]["pd"].to_numpy()
                questions.append(
                    _open("Plastic mines", _REMAINS, f"{pd_name}: deflection less {name}", gain)
                )
    for name, text in recipe.questions.items():
        for site in SOILS:
            if (site, name) in groups:
                gain = (
                    groups[site, name]["pd"].to_numpy() - groups[site, deflection]["pd"].to_numpy()
                )
                quantity = f"{pd_name}: less that of the deflection detector"
                questions.append(_open(f"{text}: {titles[site]}", "not tried", quantity, gain))
    return questions


def premise_findings(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> list[Finding]:
    """Judge the paper's premises about mines and clutter in dry sand.

    The measures are those of ``signature``.
    """
    premises = recipe.premises
    sand = cases["sand"]
    statements = []
    for name in recipe.cut.polarizations:
        # The signatures are the same for every seed: their mines are the sample.
        counts = np.array(sand[0]["signature_humps"][name], dtype=np.float64)
        statements.append(
            measured(
                f"A simulated mine has a double hump along range, {name}",
                "should exhibit it (III-B, Fig. 3)",
                f"humps of clutter-free signatures in {name}, mean, {_within(premises.humps)}",
                interval(counts, bounds=_POSITIVE),
                premises.humps,
            )
        )
    for name in recipe.cut.polarizations:
        mines = _seed_means(sand, "mine", name)
        statements.append(
            measured(
                f"The double hump is evident in the data, {name}",
                "evident (III-B, Fig. 4)",
                f"humps of imaged mines in {name}, mean, {_within(premises.humps)}",
                interval(mines, bounds=_POSITIVE),
                premises.humps,
            )
        )
        double = _double_share(sand, "mine", name) - _double_share(sand, "clutter", name)
        statements.append(
            _above(
                f"The double hump appears to be the distinguishing feature of a mine, {name}",
                "appears to be (III-B)",
                f"share of cuts in {name} with two humps: mines less clutter",
                double,
            )
        )
    visible = [float(np.mean(case["visible"])) for case in sand if case["visible"]]
    if visible:
        statements.append(
            measured(
                "Three mines are readily visible at 15, 20 and 25 m (HH)",
                "readily visible (Fig. 2)",
                f"share above {premises.visible:.0%} of the clutter boxes, "
                f"{_within(premises.visible_mines)}",
                interval(visible, bounds=_SHARE),
                premises.visible_mines,
            )
        )
    correlated = _seed_means(sand, "mine", "correlation") - _seed_means(
        sand, "clutter", "correlation"
    )
    statements.append(
        _above(
            "A mine is better correlated between HH and VV than clutter",
            "mine well, clutter at least partially not (III-C)",
            "correlation along the cut: mines less clutter",
            correlated,
        )
    )
    statements.append(
        measured(
            "Clutter may be modelled as complex Gaussian after whitening",
            "arguably (II-A)",
            f"E|z|⁴/(E|z|²)² of whitened clutter, 2 if Gaussian, {_within(premises.fourth_moment)}",
            interval(
                [case["premises"]["fourth_moment_ratio"] for case in sand], bounds=(1.0, math.inf)
            ),
            premises.fourth_moment,
        )
    )
    humps_across = np.array([np.mean(case["premises"]["across"]["humps"]) for case in sand])
    statements.append(
        measured(
            "There is little observable cross-range structure",
            "little (III-B)",
            f"humps across mines in HH, mean, {_within(premises.humps_across)}",
            interval(humps_across, bounds=_POSITIVE),
            premises.humps_across,
        )
    )
    widths = [_mean(case["premises"]["across"]["width"]) / case["point_width"] for case in sand]
    ours = interval(widths, bounds=_POSITIVE)
    statements.append(
        measured(
            "A mine appears at least as wide as the cross-range resolution",
            "at least as wide (III-B)",
            f"half-power width across, in widths of an ideal point, to lie above "
            f"{premises.width_across:g}",
            ours,
            verdict=larger(*ours[1:], premises.width_across),
            asks=("larger", premises.width_across, 0.0),
        )
    )
    return statements


def _within(rule: tuple[float, float]) -> str:
    """Return a rule in words."""
    return f"to lie in {rule[0]:g} to {rule[1]:g}"


def _seed_means(cases: Sequence[Case], kind: str, measure: str) -> FloatArray:
    """Return the mean of a measure of mines or clutter in every seed."""
    return np.array([_mean(case["premises"][kind][measure]) for case in cases])


def _double_share(cases: Sequence[Case], kind: str, name: str) -> FloatArray:
    """Return the share of cuts with exactly two humps in every seed."""
    return np.array([float(np.mean(np.array(case["premises"][kind][name]) == 2)) for case in cases])


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
    """Make the finding that differences of shares lie above a limit."""
    ours = interval(values, bounds=_DIFFERENCE)
    return measured(
        statement,
        paper,
        quantity,
        ours,
        verdict=larger(*ours[1:], limit),
        asks=("larger", limit, 0.0),
    )


def _open(statement: str, paper: str, quantity: str, values: FloatArray) -> Finding:
    """Make the finding of a question that the paper does not answer, by differences of shares."""
    return measured(statement, paper, quantity, interval(values, bounds=_DIFFERENCE))
