"""The page of the study: the paper's figures and statements beside what the simulated lanes give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from flgpr.pipeline.figures import data_url
from flgpr.pipeline.reproduce.cosgrove2004_examples import PointResponse
from flgpr.pipeline.reproduce.cosgrove2004_findings import PAPER_RATIOS, Case, Finding, interval
from flgpr.pipeline.reproduce.cosgrove2004_recipe import StudyRecipe

_CSS = """body { font: 15px/1.5 system-ui, sans-serif; color: #1d232b; max-width: 1080px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ccd3dc; }
img { max-width: 100%; } table { border-collapse: collapse; font-size: 14px; margin: .6rem 0; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #e3e7ec; text-align: right; } th { background: #f3f5f8; }
td.t, th.t { text-align: left; } .note { color: #4a5563; } .quick { background: #fff3cd; padding: .6rem 1rem; }"""

_PAPER = {
    "figure-1": (
        "Fig. 1, collection geometry",
        "a van with 72 antenna positions across its roof, stopping along the lane",
    ),
    "figure-2": ("Fig. 2, HH image of three mines", "mines at 15, 20 and 25 m readily visible"),
    "figure-3": ("Fig. 3, simulated signature", "physical optics: two humps, HH and VV"),
    "figure-4": ("Fig. 4, range cuts through imaged mines", "two humps, varying much from mine to mine"),
    "figure-5": ("Fig. 5, the feature vector", "28 samples of HH, then 28 of VV"),
    "figure-6": ("Fig. 6, first six eigenvectors", "the first shows the double hump in both polarizations"),
    "figure-7": (
        "Fig. 7, ROC at 15 m",
        "deflection above PWF above or near HH in all three soils; up to 0.9 at 0.01 per m² in dry sand, least in clay",
    ),
    "resolution": ("Resolution", "about 10 cm down-range and 40 cm cross-range (Sec. III-A)"),
    "depth": ("Pd over depth", "not shown in the paper"),
}
_ABOUT = {
    "figure-7": "Bold: first seed, ending at its lowest non-zero P_FA. Dotted: mean over the seeds; shaded: their 10 to 90 %.",
    "figure-6": "First seed, magnitudes, whitened.",
    "figure-4": "First seed; one mine of each of three depths, each at its brightest place within 0.5 m.",
    "depth": "All seeds pooled, thresholds lane by lane.",
}


def page_html(
    recipe: StudyRecipe,
    cases: Mapping[str, Sequence[Case]],
    table: pd.DataFrame,
    found: Sequence[Finding],
    responses: Mapping[str, PointResponse],
    drawn: Mapping[str, Figure],
    quick: bool,
) -> str:
    """Write the page, which needs nothing beside it."""
    seeds = len(next(iter(cases.values())))
    parts = ["<h1>Cosgrove, Milanfar and Kositsky 2004 on simulated lanes</h1>"]
    if quick:
        parts.append(
            "<p class=quick>Quick run: few seeds and mines. Its figures show that the chain works, no more.</p>"
        )
    parts += [
        f"<p>{seeds} seeds. A verdict compares the 95 % interval of the mean over the seeds with the statement. Nothing in "
        "the study was set so that it agrees; where it disagrees, the page says so.</p>",
        "<h2>The paper's statements</h2>",
        _findings([one for one in found if one.verdict != "open"]),
        "<h2>Questions it leaves open, tried</h2>",
        _findings([one for one in found if one.verdict == "open"]),
        "<h2>Detectors side by side</h2>",
        _sizes(recipe, cases),
        *[_detectors(recipe, site, table) for site in cases],
        "<h2>Eigenvalue ratios, dry sand</h2>",
        _ratios(cases["sand"]),
        "<h2>Resolution at 15 m</h2>",
        _resolution(responses),
    ]
    for name, figure in drawn.items():
        title, paper = _PAPER[name]
        parts.append(
            f"<h2>{escape(title)}</h2><p class=note>Paper: {escape(paper)}. {escape(_ABOUT.get(name, ''))}</p>"
        )
        parts.append(f'<img src="{data_url(figure)}" alt="{escape(title)}">')
    parts.append(_choices(recipe))
    body = "\n".join(parts)
    return f'<!doctype html><html lang=en><head><meta charset="utf-8"><title>cosgrove2004</title><style>{_CSS}</style></head><body>{body}</body></html>\n'


def _findings(found: Sequence[Finding]) -> str:
    rows = [
        f"<tr><td class=t>{escape(one.statement)}</td><td class=t>{escape(one.quantity)}</td><td>{one.mean:.3f}</td>"
        f"<td>{one.low:.3f} to {one.high:.3f}</td><td class=t>{escape(one.verdict)}</td></tr>"
        for one in found
    ]
    head = "<tr><th class=t>statement<th class=t>measured<th>mean<th>95 %<th class=t>verdict</tr>"
    return f"<table>{head}{''.join(rows)}</table>"


def _sizes(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> str:
    told = [
        f"{escape(recipe.sites[site].title)}: {lanes[0]['training_looks']} training and {lanes[0]['test_looks']} test images"
        for site, lanes in cases.items()
    ]
    return f"<p class=note>Per seed: {'; '.join(told)}. The paper tests on 72 images at site one and 34 in each soil of site two.</p>"


def _detectors(recipe: StudyRecipe, site: str, table: pd.DataFrame) -> str:
    columns = ("pd", "pd_quantile", "pd_rockless", "pd_mean")
    part = table[table["site"] == site]
    rows = []
    for name in dict.fromkeys(part["detector"]):
        chosen = part[part["detector"] == name]
        cells = []
        for column in columns:
            mean, low, high = interval(chosen[column].to_numpy())
            cells.append(f"<td>{mean:.2f} ({max(low, 0):.2f} to {min(high, 1):.2f})</td>")
        rows.append(f"<tr><td class=t>{escape(str(name))}</td>{''.join(cells)}</tr>")
    pfa = f"{recipe.score.pfa:g}"
    head = (
        f"<tr><th class=t>{escape(recipe.sites[site].title)}<th>Pd at {pfa} per m²<th>by the "
        f"{100 * recipe.score.quantile:g} % quantile of boxes<th>without boxes with rocks<th>mean Pd up to 0.1 per m²</tr>"
    )
    return f"<table>{head}{''.join(rows)}</table>"


def _ratios(lanes: Sequence[Case]) -> str:
    ratios = np.array([case["ratios"] for case in lanes])
    rows = []
    for j in range(ratios.shape[1]):
        mean, low, high = interval(ratios[:, j])
        rows.append(
            f"<tr><td>{j + 1}</td><td>{PAPER_RATIOS[j]:g}</td><td>{mean:.3f}</td><td>{low:.3f} to {high:.3f}</td></tr>"
        )
    return f"<table><tr><th>j<th>paper σj/σ1<th>ours<th>95 %</tr>{''.join(rows)}</table>"


def _resolution(responses: Mapping[str, PointResponse]) -> str:
    rows = [
        f"<tr><td class=t>{escape(name)}</td><td>{100 * one.resolution[0]:.1f} cm</td><td>{100 * one.resolution[1]:.1f} cm</td></tr>"
        for name, one in responses.items()
    ]
    head = "<tr><th class=t>half-power width of an ideal point<th>down-range<th>cross-range</tr>"
    paper = "<tr><td class=t>paper</td><td>about 10 cm</td><td>about 40 cm</td></tr>"
    return f"<table>{head}{''.join(rows)}{paper}</table>"


def _choices(recipe: StudyRecipe) -> str:
    score, cut = recipe.score, recipe.cut
    return (
        "<h2>What was chosen where the paper is silent</h2><ul>"
        f"<li>H0 boxes tile the {recipe.image.x[1] - recipe.image.x[0]:g} m x {recipe.radar.stop_spacing:g} m around each mine's "
        f"range, {score.clearance:g} m off the mine's box. P_FA is the share of these boxes above the threshold, per box area.</li>"
        "<li>Boxes stand at the surveyed places; refraction, which makes deep mines appear farther, is not corrected.</li>"
        f"<li>Training cuts of {cut.length} samples are taken where the mine is brightest within {recipe.training.search:g} m of its "
        "place; the row 'placed by survey' uses the surveyed place shifted by refraction instead.</li>"
        "<li>The clutter's mean and covariance come from the training images, off the mines.</li>"
        "<li>From the other direction the same mines and rocks stand there; the rough surface is drawn anew.</li>"
        "<li>'trained on simulation' scales clutter-free signatures of all depths to the energy of the training examples.</li></ul>"
    )
