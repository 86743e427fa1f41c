"""Findings of the study: Pd of every detector over the seeds, and the paper's statements."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from flgpr.scoring import operating_row, pd_at, peak_roc
from flgpr.scoring.curve import held_pd_mean
from flgpr.types import ArrayLike, Entries, FloatArray, floats
from flgpr_papers.cosgrove2004.detect import FORMS, alone, example_name
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.findings import UNDECIDED, WORTH, Finding, Statements, in_words, shows
from flgpr_papers.kit.intervals import (
    SHARE,
    SHARE_DIFFERENCE,
    Bounds,
    Interval,
    difference_of_means,
    paired_shares,
    proportion,
    share_of_looks,
    students,
    together,
)

Case = Entries
"""What was measured on a lane, as JSON can hold it."""
PAPER_RATIOS = (1, 0.089, 0.075, 0.028, 0.019, 0.014)  # eigenvalues over the first (IV-A)
PAPER_PD = 0.9  # at 0.01 false alarms per m²
PAPER_LOOKS = 72  # mine images at site one
_POSITIVE = (0.0, math.inf)  # of counts and widths
_STATEMENTS = Statements("cosgrove2004")
_NOTHING = 0.1  # Pd below which detectors are not compared with each other


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


def found_looks(
    recipe: StudyRecipe, cases: Sequence[Case], detector: str, quantile: bool = False
) -> FloatArray:
    """Return which looks at mines (seed, look) a detector finds at the study's P_FA, as 1 or 0.

    Every seed has the threshold of its own clutter. The parameters are those of
    :func:`case_curve`.
    """
    found = []
    suffix = "_quantile" if quantile else ""
    for case in cases:
        if detector not in case["peaks"]:
            continue  # the sweeps are of the first seeds only
        curve = case_curve(case, detector, recipe.score.box, quantile)
        threshold = curve["threshold"].iloc[int(operating_row(curve, recipe.score.pfa))]
        found.append(np.asarray(case["peaks"][detector]["target" + suffix]) >= threshold)
    return floats(found)


class Looks:
    """Which looks every detector finds, by site.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping of str to sequence of Case
        Cases of every seed by site.
    """

    def __init__(self, recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> None:
        self._recipe = recipe
        self._cases = cases
        self.found = {
            (site, name): found_looks(recipe, lanes, name)
            for site, lanes in cases.items()
            for name in lanes[0]["peaks"]
        }

    def pd(self, site: str, detector: str) -> Interval:
        """Return the Pd of a detector at a site."""
        return share_of_looks(self.found[site, detector])

    def gap(self, site: str, detector: str, rival: str, level: float = 0.95) -> Interval:
        """Return the Pd of a detector at a site less that of another one, on the same looks."""
        first, second = self.found[site, detector], self.found[site, rival]
        seeds = min(len(first), len(second))
        return paired_shares(first[:seeds], second[:seeds], level)

    def room(self, site: str, *detectors: str) -> str:
        """Return a remark where two detectors find all or nothing: neither can be better."""
        pds = [self.pd(site, detector)[0] for detector in detectors]
        if min(pds) > 1 - WORTH:
            return "both find nearly all: there is nothing to gain"
        return "both find next to nothing" if max(pds) < WORTH else ""

    def quantile_gap(self, site: str, detector: str) -> Interval:
        """Return the Pd by a high quantile of the boxes less that by their peaks."""
        by_quantile = found_looks(self._recipe, self._cases[site], detector, quantile=True)
        return paired_shares(by_quantile, self.found[site, detector])

    def seeds(self, site: str, detector: str) -> FloatArray:
        """Return the Pd of every seed."""
        return self.found[site, detector].mean(axis=1)


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
    pfa = recipe.score.pfa
    rows = []
    for site, lanes in cases.items():
        for case in lanes:
            for name, peaks in case["peaks"].items():
                curve_of = partial(case_curve, case, name, recipe.score.box)
                curve = curve_of()
                has_no_rockless = all(peaks["rock"])
                row = {
                    "site": site,
                    "seed": case["seed"],
                    "detector": name,
                    "pd": pd_at(curve, pfa),
                    "pd_quantile": pd_at(curve_of(quantile=True), pfa),
                    "pd_rockless": math.nan
                    if has_no_rockless
                    else pd_at(curve_of(rocks=False), pfa),
                    "pd_mean": held_pd_mean(curve, 0.1),
                }
                rows.append(row)
    return pd.DataFrame(rows)


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
            rows.append((site, float(depth), at_depth.size, contrast))
    return pd.DataFrame(rows, columns=["site", "depth", "looks", "contrast"])


def findings(
    recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]], mines: Case | None = None
) -> list[Finding]:
    """Judge every statement of the paper, then the questions it leaves open.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping of str to sequence of Case
        Cases of every seed by site.
    mines : Case, optional
        What was measured on mines without a lane of a seed; without it nothing is said of them.
    """
    looks = Looks(recipe, cases)
    return [
        *_detector_statements(recipe, looks),
        *_sweep_statements(recipe, looks, cases),
        *_eigenvalue_statements(recipe, cases["sand"]),
        *(_mine_statements(recipe, mines) if mines else ()),
        *_premise_statements(recipe, cases["sand"]),
        *_open_questions(recipe, looks),
    ]


def _judge(
    recipe: StudyRecipe,
    statement: str,
    interval: Interval,
    by_seed: ArrayLike = (),
    **fields: Any,
) -> Finding:
    """Judge a statement by a number, and count the seeds whose own number shows it.

    A seed has as many mines, training and test as the paper.
    """
    finding = _STATEMENTS.number(statement, interval, **{**_words(recipe), **fields})
    values = floats(by_seed)
    values = values[~np.isnan(values)]
    rule = finding.rule
    if rule is None or not values.size:
        return finding
    return replace(finding, shown=(sum(shows(value, rule) for value in values), values.size))


def _words(recipe: StudyRecipe) -> Entries:
    """Return what stands for fields of many statements."""
    return {"pd": f"Pd at {recipe.score.pfa:g} per m²", "rank": recipe.detector.rank}


def _detector_statements(recipe: StudyRecipe, looks: Looks) -> list[Finding]:
    """Judge what the paper says of Pd (Sec. IV, V)."""
    titles = recipe.soils
    ours = recipe.main

    def against(name: str, soil: str, first: str, second: str, **words: str) -> Finding:
        by_seed = looks.seeds(soil, first) - looks.seeds(soil, second)
        gap = looks.gap(soil, first, second)
        finding = _judge(recipe, name, gap, by_seed, soil=titles[soil], **words)
        return replace(finding, note=looks.room(soil, first, second))

    statements = []
    for soil in titles:
        for rival in ("PWF", "HH"):
            statements.append(against("outperforms", soil, ours, rival, rival=rival))
        if (soil, FORMS[1]) in looks.found:
            statements.append(against("few-examples", soil, ours, FORMS[1]))
    best = max(titles, key=lambda soil: looks.pd(soil, ours)[0])
    papers: Entries = {"stated": PAPER_PD, "looks": PAPER_LOOKS, "soil": titles[best]}
    # The paper's Pd is a share of its own number of looks.
    figure = proportion(PAPER_PD * PAPER_LOOKS, PAPER_LOOKS)
    pds = looks.pd(best, ours), looks.seeds(best, ours)
    statements.append(_judge(recipe, "best-pd", *pds, figure=figure, **papers))
    for soil in titles:
        statement = against("first-eigenvector", soil, "rank 1", ours)
        # Two detectors that find nothing are as good as each other.
        if looks.pd(soil, ours)[0] < _NOTHING:
            statement = replace(statement, verdict=UNDECIDED, rule=None, power=None, shown=None)
        statements.append(statement)
    for better, worse, name in (
        ("sand", "gravel", "best-soil"),
        ("sand", "clay", "best-soil"),
        ("gravel", "clay", "worst-soil"),
    ):
        if {better, worse} <= titles.keys():
            gap = difference_of_means(looks.pd(better, ours), looks.pd(worse, ours))
            by_seed = looks.seeds(better, ours) - looks.seeds(worse, ours)
            words = {"better": titles[better], "worse": titles[worse]}
            statements.append(_judge(recipe, name, gap, by_seed, **words))
    return statements


def example_means(recipe: StudyRecipe, cases: Sequence[Case], rank: int) -> dict[str, Interval]:
    """Return the mean Pd up to 0.1 per m² of deflection less Neyman-Pearson, by number of examples.

    It is paired seed by seed, with Student's interval; the parameters are those of
    :func:`found_looks` and the rank of both.
    """
    gaps = {}
    for number in recipe.sweeps.numbers:
        pair = [example_name(form, rank, number) for form in FORMS]
        means = [
            [held_pd_mean(case_curve(case, name, recipe.score.box), 0.1) for name in pair]
            for case in cases
            if pair[0] in case["peaks"]
        ]
        if means:
            gaps[str(number)] = students(-np.diff(means)[:, 0], bounds=SHARE_DIFFERENCE)
    return gaps


def _sweep_statements(
    recipe: StudyRecipe, looks: Looks, cases: Mapping[str, Sequence[Case]]
) -> list[Finding]:
    """Judge what the sweeps show, in the soils that have them (Sec. II-B, III-A, III-C)."""
    best_band, *bands = recipe.sweeps.bands
    singles = {f"{name} alone": alone(name) for name in recipe.cut.polarizations}
    rivals = {
        "two-polarizations": (recipe.main, singles),
        "best-band": (best_band, dict(zip(bands, bands, strict=True))),
    }
    statements = []
    for soil, title in recipe.soils.items():
        for rank in recipe.sweeps.ranks:
            gaps = {}
            remarks = set()
            for number in recipe.sweeps.numbers:
                first, second = [example_name(form, rank, number) for form in FORMS]
                if (soil, first) in looks.found:
                    gaps[str(number)] = looks.gap(soil, first, second)
                    remarks.add(looks.room(soil, first, second))
            if gaps:
                words = {**_words(recipe), "soil": title, "rank": rank}
                finding = _STATEMENTS.by_every("number-of-examples", gaps, **words)
                note = remarks.pop() if len(remarks) == 1 else ""
                means = example_means(recipe, cases[soil], rank)
                ours = "; ".join(
                    f"{number}: {in_words(*mean)}"
                    if math.isfinite(mean[1])
                    else f"{number}: {mean[0]:z.2f} in every seed"
                    for number, mean in means.items()
                )
                fewest = next(iter(means.values()))
                by_mean = _STATEMENTS.number("mean-by-examples", fewest, **words)
                statements += [replace(finding, note=note), replace(by_mean, ours=ours)]
        for name, (best, others) in rivals.items():
            gaps = {
                what: looks.gap(soil, best, rival, together(len(others)))
                for what, rival in others.items()
                if (soil, rival) in looks.found
            }
            if gaps:
                words = {**_words(recipe), "soil": title}
                statements.append(_STATEMENTS.larger(name, gaps, **words))
    return statements


def _eigenvalue_statements(recipe: StudyRecipe, cases: Sequence[Case]) -> list[Finding]:
    """Judge the ratios of eigenvalues (IV-A) within a factor of two.

    A ratio that no seed's examples reach has no number.
    """
    statements = []
    for number, paper, ratio in eigenvalue_ratios_of(cases):
        by_seed = floats([case["ratios"][number - 1] for case in cases])
        words = {"rule": (0.5 * paper, 2 * paper), "ratio": paper, "number": number}
        statements.append(_judge(recipe, "eigenvalue", ratio, by_seed, **words))
    return statements


def eigenvalue_ratios_of(cases: Sequence[Case]) -> list[tuple[int, float, Interval]]:
    """Return the number of every eigenvalue but the first, the paper's ratio to it and ours."""
    ratios = floats([case["ratios"] for case in cases])
    pairs = list(zip(PAPER_RATIOS, ratios.T, strict=False))
    return [
        (number, paper, students(ours, bounds=SHARE))
        for number, (paper, ours) in enumerate(pairs[1:], start=2)
    ]


def _open_questions(recipe: StudyRecipe, looks: Looks) -> list[Finding]:
    """Return our own questions about the detectors' Pd, which have no verdict."""
    detector = recipe.main
    questions = [
        _judge(recipe, "quantile", looks.quantile_gap(name, detector), soil=site.title)
        for name, site in recipe.sites.items()
    ]
    if "plastic" in recipe.sites:
        questions.append(_judge(recipe, "plastic", looks.pd("plastic", detector)))
        rivals = {"PWF": "PWF", "trained on sand": "the detector trained on metal mines"}
        for rival, title in rivals.items():
            if ("plastic", rival) in looks.found:
                gap = looks.gap("plastic", detector, rival)
                questions.append(_judge(recipe, "plastic-rival", gap, rival=title))
    for rival, text in recipe.questions.items():
        for soil, title in recipe.soils.items():
            if (soil, rival) in looks.found:
                gap = looks.gap(soil, rival, detector)
                questions.append(_judge(recipe, "tried", gap, question=text, soil=title))
    return questions


def _of_looks(recipe: StudyRecipe, name: str, looks: Sequence[Any], **fields: Any) -> Finding:
    """Judge a statement by the share of looks for which something holds, seed by seed."""
    table = floats(looks)
    return _judge(recipe, name, share_of_looks(table), table.mean(axis=1), **fields)


def _mine_statements(recipe: StudyRecipe, mines: Case) -> list[Finding]:
    """Judge the paper's premises about mines in dry sand: the double hump (Fig. 3) and Fig. 2."""
    premises = recipe.premises
    statements = []
    for name in recipe.cut.polarizations:
        humps = students(mines["signature_humps"][name], bounds=_POSITIVE)
        words: Entries = {"rule": premises.humps, "polarization": name}
        statements.append(_judge(recipe, "signature", humps, **words))
    words = {"rule": premises.visible_mines, "share": premises.visible}
    return [*statements, _of_looks(recipe, "visible", mines["visible"], **words)]


def _premise_statements(recipe: StudyRecipe, sand: Sequence[Case]) -> list[Finding]:
    """Judge the paper's premises about mines and clutter in dry sand.

    The cases have the measures of :mod:`flgpr_papers.cosgrove2004.signature`.
    """
    premises = recipe.premises
    measures = [case["premises"] for case in sand]

    def judged(name: str, values: Sequence[float], bounds: Bounds, **fields: Any) -> Finding:
        """Judge by a number of every seed."""
        return _judge(recipe, name, students(values, bounds=bounds), values, **fields)

    def of_both(name: str, measure: Callable[[Any], float], values: str, **fields: Any) -> Finding:
        """Judge by a measure of mines less that of clutter in every seed."""
        mines, clutter = [
            np.array([measure(of_seed[kind][values]) for of_seed in measures])
            for kind in ("mine", "clutter")
        ]
        return judged(name, mines - clutter, SHARE_DIFFERENCE, **fields)

    words: Entries
    statements = []
    for name in recipe.cut.polarizations:
        means = [_mean(of_seed["mine"][name]) for of_seed in measures]
        words = {"rule": premises.humps, "polarization": name}
        statements.append(judged("evident", means, _POSITIVE, **words))
        statements.append(of_both("distinguishing", _double_share, name, polarization=name))
    moments = [of_seed["fourth_moment_ratio"] for of_seed in measures]
    most = premises.humps_across[1]
    one_hump = [np.array(of_seed["across"]["humps"]) <= most for of_seed in measures]
    widths = [_mean(case["premises"]["across"]["width"]) / case["point_width"] for case in sand]
    return [
        *statements,
        of_both("correlated", _mean, "correlation"),
        judged("gaussian", moments, _POSITIVE, rule=premises.fourth_moment),
        _of_looks(recipe, "across", one_hump),
        judged("wide", widths, _POSITIVE, above=premises.width_across),
    ]


def _double_share(humps: Sequence[int]) -> float:
    """Return the share of cuts with exactly two humps."""
    return float(np.mean(np.array(humps) == 2))


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the values that are known, NaN without one."""
    known = [value for value in values if not math.isnan(value)]
    return float(np.mean(known)) if known else math.nan
