"""The page of the reproduction: findings, tables and figures of the paper beside ours."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

import flgpr
from flgpr.detect import SearchStep
from flgpr.features import FEATURES
from flgpr.model import Sensor
from flgpr.pipeline.classifier import CLASSIFIER_A, CLASSIFIER_B, make_training_set, train
from flgpr.pipeline.progress import Track
from flgpr.pipeline.recipe import Recipe
from flgpr.scoring import Match
from flgpr_papers.kit.cache import read_arrays
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.page import draw, figure_html, findings_table, quick_note, study_html, wide_table
from flgpr_papers.wang2007 import figures
from flgpr_papers.wang2007.analysis import (
    BURIED_METAL,
    BURIED_PLASTIC,
    METHODS,
    MINES,
    SUBBANDS,
    LaneResult,
    Pool,
    all_forty,
    matched,
    prescreened,
    table_one,
    table_two,
)
from flgpr_papers.wang2007.findings import (
    band_findings,
    curve_findings,
    feature_findings,
    prescreener_findings,
)
from flgpr_papers.wang2007.lanes import SITE

PAPER_ONE = {
    "A": (0.75, 0.82, 0.71, 0.69, 0.93, 0.77, 0.66, 0.19, 0.76, 0.30),
    "B": (0.75, 0.80, 0.68, 0.69, 0.90, 0.77, 0.65, 0.14, 0.76, 0.11),
    "C": (0.75, 0.82, 0.71, 0.69, 0.93, 0.77, 0.66, 0.19, 0.76, 0.21),
    "D": (0.73, 0.81, 0.65, 0.60, 0.77, 0.59, 0.66, 0.12, 0.65, 0.13),
}
PAPER_TWO = {
    "A": ((5, 8, 1, 4, 3, 2, 6, 10, 7, 9), (0.93, 0.93, 0.94, 0.94, 0.94, 0.94, 0.94, 0.94, 0.93, 0.85)),
    "B": ((5, 4, 8, 10, 7, 2, 3, 9, 1, 6), (0.90, 0.91, 0.90, 0.90, 0.89, 0.88, 0.87, 0.86, 0.84, 0.82)),
    "C": ((5, 10, 8, 2, 4, 1, 7, 6, 9, 3), (0.93, 0.93, 0.92, 0.89, 0.90, 0.89, 0.89, 0.88, 0.88, 0.87)),
    "D": ((2, 5, 4, 9, 6, 10, 1, 3, 7, 8), (0.81, 0.86, 0.89, 0.88, 0.88, 0.87, 0.87, 0.85, 0.84, 0.82)),
}
PAPER_THREE = {"F1": ("5, 8, 1", 0.94), "F2": ("2, 7, 10", 0.72), "F3": ("5, 1, 6", 0.74), "F4": ("1, 2, 3", 0.64)}
PAPER_FOUR = ((5, 8, 29, 31, 18), (0.93, 0.93, 0.94, 0.94, 0.94))

_RULES = (
    "Intervals are 95 %: exact binomial for a Pd, resampled over targets, lanes and stretches of lane for PD_mean and "
    "its differences. A claim that something is larger agrees if the interval of the difference lies above zero, "
    "disagrees if below, and is undecided otherwise; a figure agrees if it lies in our interval. The simulated world "
    "was not adjusted to agree."
)


def page_html(
    folder: Path,
    calibration: Sequence[LaneResult],
    blind: Sequence[LaneResult],
    recipe: Recipe,
    radar: Sensor,
    quick: bool,
    track: Track,
) -> tuple[str, list[Finding]]:
    """Judge the findings and write the page, which needs nothing beside it."""
    draws = 100 if quick else 1000
    pool = Pool(calibration)
    by_band = {band: table_one(pool, band) for band in ("F0", *SUBBANDS)}
    searches = table_two(pool)
    sets = {b: pool.search([f"{n}_{b}" for n in FEATURES], "A", 3) for b in SUBBANDS}
    sets["all"] = pool.search(all_forty(), "A", 5)
    blind_matches = blind_scores(calibration, blind) if blind else None
    findings = prescreener_findings(calibration, recipe, draws)
    findings += feature_findings(pool, by_band["F1"], searches, draws)
    findings += band_findings(pool, by_band, sets, draws)
    findings += curve_findings(pool.match_of(pool.confidence(["C_HH_F1"], "A")), blind_matches)
    nested = pool.nested(all_forty()[:10], 5)
    parts = [
        "<h1>Wang, Keller, Gader &amp; Sjahputera 2007 on simulated lanes</h1>",
        quick_note(quick, "A few targets on short lanes with thinned surface clutter"),
        _lanes_text(calibration, blind, radar),
        "<h2>Findings</h2>",
        findings_table(findings, _RULES),
        "<h2>Tables</h2>",
        *_tables(pool, by_band, searches, sets, nested, draws),
        "<h2>Figures</h2>",
    ]
    drawn = all_figures(folder, calibration, pool, recipe, radar, blind_matches)
    for (number, text), figure in track(zip(figures.captions(), drawn, strict=True), "drawing the page", 14):
        parts.append(figure_html(draw(figure, quick, 100), f"Fig. {number}. {text}", f"Fig. {number}"))
    return study_html("Wang et al. 2007, reproduced", parts), findings


def blind_scores(calibration: Sequence[LaneResult], blind: Sequence[LaneResult]) -> dict[str, Match]:
    """Score the blind lanes with classifiers A and B, trained on all calibration lanes and frozen."""
    lanes = [(one.name, one.alarms, one.features, one.truth, one.lane) for one in calibration]
    scores = {}
    for name, columns in (("A", CLASSIFIER_A), ("B", CLASSIFIER_B)):
        classifier = train(make_training_set(lanes, columns=columns), columns)
        tables = [one.alarms.assign(confidence=classifier.confidence(one.features)) for one in blind]
        scores[name] = matched(blind, [table.dropna(subset=["confidence"]) for table in tables])
    return scores


def all_figures(
    folder: Path,
    calibration: Sequence[LaneResult],
    pool: Pool,
    recipe: Recipe,
    radar: Sensor,
    blind: dict[str, Match] | None,
) -> Iterator[Figure]:
    """Draw the figures 1 to 14, one at a time."""
    examples = read_arrays(folder / "results" / "examples.npz")
    yield figures.geometry_figure(radar, recipe)
    for shown in (
        figures.polarization_figure,
        figures.subband_figure,
        figures.series_figure,
        figures.background_figure,
    ):
        yield shown(examples)
    yield figures.run_view_figure(calibration[0], False)
    yield figures.run_view_figure(calibration[0], True)
    yield figures.clean_bands_figure(examples)
    bands = ("F0", *SUBBANDS)
    of = {(p, b): prescreened(calibration, p, b, recipe) for p in ("HH", "VV", "HV") for b in bands}
    yield figures.prescreener_figure(of, MINES)
    yield figures.patch_figure(examples)
    yield figures.region_figure(recipe)
    lanes = [(one.name, one.alarms, one.features, one.truth, one.lane) for one in calibration]
    known = make_training_set(lanes, columns=["M_HH_F1"])
    yield figures.normalisation_figure(known.features["M_HH_F1"].to_numpy(), known.weight)
    subsets = {"metal": BURIED_METAL, "plastic": BURIED_PLASTIC}
    a, b = (pool.match_of(pool.confidence(list(columns), "A")) for columns in (CLASSIFIER_A, CLASSIFIER_B))
    yield figures.classifier_figure({"calibration": {"prescreener": of["HH", "F1"], "C_HH": a}}, subsets)
    panels = {"calibration": {"A": a, "B": b}}
    yield figures.classifier_figure(panels | ({"blind": blind} if blind else {}), subsets)


def _lanes_text(calibration: Sequence[LaneResult], blind: Sequence[LaneResult], radar: Sensor) -> str:
    rows = []
    for one in (*calibration, *blind):
        depth = one.truth["depth"]
        count = {kind: int((one.truth["kind"] == kind).sum()) for kind in ("metal", "plastic", "simulant")}
        rows.append(
            [one.name, f"{one.lane.y_max - one.lane.y_min:.0f} m", count["metal"], count["plastic"], count["simulant"],
             int((depth < 0).sum()), len(one.alarms), f"{len(one.alarms) / 6 / (one.lane.y_max - one.lane.y_min):.2f}"]
        )  # fmt: skip
    head = [
        "lane",
        "length",
        "metal",
        "plastic",
        "simulants",
        "of these on the surface",
        "alarms",
        "per m² of run-view",
    ]
    later = "" if blind else "<p><b>The blind lanes are still to be run; what they show is missing below.</b></p>"
    return (
        f"<p>flgpr {escape(flgpr.__version__)}; sensor {escape(radar.name)} ({escape(radar.source)}); recipe wang2007. "
        f"The paper does not describe soil, clutter or the mines' types and places; here the site is "
        f"<code>{SITE}</code>, targets are spread evenly with jitter, and the blind lanes hold as many mines, "
        "all at 7.5 cm, as the table says. All this was fixed before anything was scored. FAR areas are lane less the "
        "exact union of halos; halo radius 1 m; no correction of refraction. Classifier C of the paper "
        "(time-frequency features of another group) is not reproduced.</p>" + later + wide_table(head, rows)
    )


def _tables(
    pool: Pool,
    by_band: dict[str, pd.DataFrame],
    searches: dict[str, list[SearchStep]],
    sets: dict[str, list[SearchStep]],
    nested: tuple[float, Any, list[list[str]]],
    draws: int,
) -> Iterator[str]:
    head = ["method", "", *[f"#{i + 1} {name}" for i, name in enumerate(FEATURES)]]
    rows = []
    for method in METHODS:
        rows.append([f"({method}) {METHODS[method]}", "paper", *[f"{v:.2f}" for v in PAPER_ONE[method]]])
        rows.append(["", "here", *[f"{v:.2f}" for v in by_band["F1"].loc[method]]])
    yield "<h3>Table I. PD_mean of single features of F1</h3>" + wide_table(head, rows)
    yield "<p>The same with cross-track and down-track exchanged in all regions, and the polarimetric ones as the "
    yield "paper normalises and averages them (method A):</p>" + wide_table(["variant", *FEATURES], _variant_rows(pool))
    yield "<p>Method A for every sub-band, the wide one included:</p>" + wide_table(
        ["sub-band", *FEATURES], [[band, *[f"{v:.2f}" for v in table.loc["A"]]] for band, table in by_band.items()]
    )
    rows = []
    for method in METHODS:
        order, score = PAPER_TWO[method]
        rows.append([f"({method})", "paper", *[f"({f}) {s:.2f}" for f, s in zip(order, score, strict=True)]])
        rows.append(["", "here", *[f"({step.feature + 1}) {step.score:.2f}" for step in searches[method]]])
    yield "<h3>Table II. Sequential forward search in F1</h3>" + wide_table(
        ["method", "", *map(str, range(1, 11))], rows
    )
    low, high = pool.interval(nested[1], draws)
    chosen = "; ".join(", ".join(names) for names in nested[2])
    yield (
        f"<p>Nested cross-validation (features chosen by a search that has not seen the lane, at most five): PD_mean "
        f"{nested[0]:.2f} ({low:.2f} to {high:.2f}); chosen: {escape(chosen)}. The searches above are scored on what "
        "chose the features and are too favourable.</p>"
    )
    rows = []
    for band in SUBBANDS:
        here = ", ".join(str(step.feature + 1) for step in sets[band])
        rows.append([band, PAPER_THREE[band][0], f"{PAPER_THREE[band][1]:.2f}", here, f"{sets[band][-1].score:.2f}"])
    yield "<h3>Table III. Three features per sub-band</h3>" + wide_table(
        ["sub-band", "paper's features", "PD_mean", "ours", "PD_mean"], rows
    )
    rows = [
        ["paper", *[f"({f}) {s:.2f}" for f, s in zip(*PAPER_FOUR, strict=True)]],
        ["here", *[f"({step.feature + 1}) {step.score:.2f}" for step in sets["all"]]],
    ]
    yield "<h3>Table IV. Search over all 40 features</h3>" + wide_table(["", *map(str, range(1, 6))], rows)


def _variant_rows(pool: Pool) -> list[list[str]]:
    rows = [["regions exchanged", *[f"{v:.2f}" for v in table_one(pool, "F1", "swapped.").loc["A"]]]]
    columns = [f"paper.{name}_F1" for name in FEATURES[6:]]
    values = [f"{v:.2f}" for v in pool.singles(columns, "A")]
    return [*rows, ["own gain per polarization, linear mean of psi", *[""] * 6, *values]]
