"""What the study found: Pd of every detector over the seeds, and a verdict on each statement of the paper."""

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
from flgpr_papers.kit.findings import MARGIN, UNDECIDED, Finding, alike, larger, less_figure, measured, share_error

FloatArray = NDArray[np.float64]
Case = dict[str, Any]
PAPER_RATIOS = (1, 0.089, 0.075, 0.028, 0.019, 0.014)
PAPER_LOOKS = 72  # mine images at site one
SOILS = ("sand", "gravel", "clay")
_NOTHING = 0.1  # Pd below which detectors are not compared with each other


def interval(values: Sequence[float] | FloatArray, level: float = 0.95) -> tuple[float, float, float]:
    """Mean over seeds and Student's interval of it; seeds without a value (NaN) are left out."""
    sample = np.asarray(values, dtype=np.float64)
    sample = sample[~np.isnan(sample)]
    mean = float(sample.mean()) if sample.size else math.nan
    if sample.size < 2:
        return mean, -math.inf, math.inf
    half = float(stdtrit(sample.size - 1, (1 + level) / 2) * sample.std(ddof=1) / math.sqrt(sample.size))
    return mean, mean - half, mean + half


def case_curve(case: Case, detector: str, box: float, quantile: bool = False, rocks: bool = True) -> pd.DataFrame:
    """ROC of one detector on one lane; ``rocks=False`` leaves out clutter boxes with a rock in or near them."""
    peaks = case["peaks"][detector]
    suffix = "_quantile" if quantile else ""
    clutter = np.asarray(peaks["clutter" + suffix])
    if not rocks:
        clutter = clutter[~np.asarray(peaks["rock"], dtype=bool)]
    return peak_roc(peaks["target" + suffix], clutter, box**2)


def pd_table(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> pd.DataFrame:
    """Pd at the study's P_FA of every detector on every lane of every seed.

    Columns: site, seed, detector, pd, pd_quantile (high quantile of the boxes), pd_rockless (boxes with rocks left out;
    NaN if none is left), pd_mean (mean Pd up to 0.1 per m²).
    """
    rows = []
    for site, lanes in cases.items():
        for case in lanes:
            for name in case["peaks"]:
                curve = case_curve(case, name, recipe.score.box)
                high = case_curve(case, name, recipe.score.box, quantile=True)
                bare = math.nan
                if not all(case["peaks"][name]["rock"]):
                    bare = pd_at(case_curve(case, name, recipe.score.box, rocks=False), recipe.score.pfa)
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

    Columns: site, depth (m), looks, contrast (median peak in boxes at mines over that in clutter boxes, dB).
    """
    rows = []
    for site, lanes in cases.items():
        peaks = [case["peaks"]["HH"] for case in lanes]
        clutter = np.nanmedian(np.concatenate([one["clutter"] for one in peaks]))
        depth = np.concatenate([one["depth"] for one in peaks])
        target = np.concatenate([one["target"] for one in peaks])
        for one in np.unique(depth):
            chosen = target[depth == one]
            level = 10 * math.log10(float(np.nanmedian(chosen) / clutter))
            rows.append({"site": site, "depth": float(one), "looks": chosen.size, "contrast": level})
    return pd.DataFrame(rows)


def findings(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]], table: pd.DataFrame) -> list[Finding]:
    """Judge every statement of the paper, then the questions it leaves open."""
    rank, pfa = f"rank {recipe.detector.rank}", f"Pd at {recipe.score.pfa:g} per m²"
    pds = {key: group.sort_values("seed")["pd"].to_numpy() for key, group in table.groupby(["site", "detector"])}
    titles = {name: site.title for name, site in recipe.sites.items()}
    soils = [soil for soil in SOILS if soil in titles]
    found = []
    for soil in soils:
        for rival in ("PWF", "HH"):
            found.append(
                _above(
                    f"The deflection detector outperforms {rival}: {titles[soil]}",
                    f"{pfa}: deflection (M' = {recipe.detector.rank}) less {rival}",
                    pds[soil, rank] - pds[soil, rival],
                )
            )
    best = max(soils, key=lambda soil: float(np.mean(pds[soil, rank])))
    asks = ("alike", MARGIN, share_error(0.9, PAPER_LOOKS))
    gap = less_figure(interval(pds[best, rank]), 0.9, asks[2])
    statement = f"Pd is about 0.9 in the best soil (ours: {titles[best]})"
    quantity = f"{pfa}: ours less 0.9 of {PAPER_LOOKS} looks"
    found.append(measured(statement, "", quantity, gap, verdict=alike(*gap[1:]), asks=asks))
    for soil in soils:
        one = _above(
            f"The first eigenvector alone is an excellent candidate: {titles[soil]}",
            f"{pfa}: M' = 1 less M' = {recipe.detector.rank}, to lie above -0.05",
            pds[soil, "rank 1"] - pds[soil, rank],
            -0.05,
        )
        # Two detectors that find nothing are as good as each other.
        found.append(replace(one, verdict=UNDECIDED, asks=None) if np.mean(pds[soil, rank]) < _NOTHING else one)
    for better, worse in (("sand", "gravel"), ("sand", "clay"), ("gravel", "clay")):
        if not {better, worse} <= set(soils):
            continue
        statement = "Dry sand is the best soil" if better == "sand" else "Wet clay is the worst soil"
        quantity = f"{pfa}: {titles[better]} less {titles[worse]}"
        found.append(_above(statement, quantity, pds[better, rank] - pds[worse, rank]))
    ratios = np.array([case["ratios"] for case in cases["sand"]])
    for j in range(1, min(len(PAPER_RATIOS), ratios.shape[1])):
        text = f"Eigenvalue {j + 1} is {PAPER_RATIOS[j]} of the first (dry sand)"
        low, high = 0.5 * PAPER_RATIOS[j], 2 * PAPER_RATIOS[j]
        quantity = f"σ{j + 1}/σ1, to lie in {low:.3g} to {high:.3g}"
        found.append(measured(text, "", quantity, interval(ratios[:, j]), (low, high)))
    return found + _open_questions(recipe, table, titles)


def _open_questions(recipe: StudyRecipe, table: pd.DataFrame, titles: Mapping[str, str]) -> list[Finding]:
    rank, pfa = f"rank {recipe.detector.rank}", f"Pd at {recipe.score.pfa:g} per m²"
    groups = {key: group.sort_values("seed") for key, group in table.groupby(["site", "detector"])}
    found = []
    for site in titles:
        of = groups[site, rank]
        text = f"A high quantile of each box in place of its peak (footnote 4): {titles[site]}"
        found.append(_open(text, f"{pfa}: quantile less peak", of["pd_quantile"].to_numpy() - of["pd"].to_numpy()))
    if "plastic" in titles:
        base = groups["plastic", rank]["pd"].to_numpy()
        found.append(_open("Plastic mines, detector trained on plastic mines", pfa, base))
        for rival in ("PWF", "trained on sand"):
            if ("plastic", rival) in groups:
                name = "the detector trained on metal mines" if rival == "trained on sand" else rival
                values = base - groups["plastic", rival]["pd"].to_numpy()
                found.append(_open("Plastic mines", f"{pfa}: deflection less {name}", values))
    for name, text in recipe.questions.items():
        for site in SOILS:
            if (site, name) in groups:
                values = groups[site, name]["pd"].to_numpy() - groups[site, rank]["pd"].to_numpy()
                found.append(_open(f"{text}: {titles[site]}", f"{pfa}: less that of the deflection detector", values))
    return found


def _above(statement: str, quantity: str, values: FloatArray, limit: float = 0.0) -> Finding:
    found = interval(values)
    return measured(statement, "", quantity, found, verdict=larger(*found[1:], limit), asks=("larger", limit, 0.0))


def _open(statement: str, quantity: str, values: FloatArray) -> Finding:
    return measured(statement, "", quantity, interval(values))
