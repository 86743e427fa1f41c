"""The page of the study: the paper's figures and statements beside what the simulated lanes give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
import pandas as pd

from flgpr_papers.cosgrove2004.examples import PointResponse
from flgpr_papers.cosgrove2004.findings import PAPER_RATIOS, Case, contrast_table, interval
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.findings import OPEN, Finding
from flgpr_papers.kit.page import bullets, figure_html, findings_table, quick_note, study_html, wide_table

_FIGURES = {
    "figure-1": (
        "Fig. 1, collection geometry",
        "a van with 72 antenna positions across its roof, stopping along the lane.",
    ),
    "figure-2": (
        "Fig. 2, HH image of three mines",
        "mines at 15, 20 and 25 m readily visible. Ours: open dry sand, over the median of each range.",
    ),
    "figure-3": ("Fig. 3, simulated signature", "two humps, HH and VV. Ours: 10 cm deep in dry sand, no clutter."),
    "figure-4": (
        "Fig. 4, range cuts through imaged mines",
        "two humps, varying much. Ours: first seed, one mine of each of three depths, at its brightest place.",
    ),
    "figure-5": ("Fig. 5, the feature vector", "28 samples of HH, then 28 of VV."),
    "figure-6": (
        "Fig. 6, first six eigenvectors",
        "the first shows the double hump in both polarizations. Ours: first seed, whitening undone, magnitudes.",
    ),
    "figure-7": (
        "Fig. 7, ROC at 15 m",
        "deflection above PWF and HH in all three soils; 0.9 at 0.01 per m² at best, least in clay. Ours, bold: first "
        "seed, ending at its lowest non-zero P_FA; dotted: mean over the seeds; shaded: their 10 to 90 %.",
    ),
    "resolution": ("Resolution", "about 10 cm down-range and 40 cm cross-range (Sec. III-A)."),
    "depth": ("Pd over depth", "not shown. Ours: all seeds pooled, thresholds lane by lane."),
}
_WORLDS = {
    "roadside": "with bushes and posts beside the lane, as the catalogue of sites has them",
    "open": "open lanes: the same lanes without what stands beside them",
}


def page_html(
    recipe: StudyRecipe,
    cases: Mapping[str, Mapping[str, Sequence[Case]]],
    tables: Mapping[str, pd.DataFrame],
    found: Mapping[str, Sequence[Finding]],
    responses: Mapping[str, PointResponse],
    pictures: Mapping[str, bytes],
    quick: bool,
) -> str:
    """Write the page, which needs nothing beside it."""
    first = next(iter(cases.values()))
    parts = [
        "<h1>Cosgrove, Milanfar and Kositsky 2004 on simulated lanes</h1>",
        quick_note(quick, "Few seeds and mines"),
        f"<p>{len(first['sand'])} seeds. A verdict compares the 95 % interval of the mean over the seeds with the "
        "statement. The paper does not say what stood beside its lanes, so each lane is seen twice: "
        f"{'; and '.join(_WORLDS[world] for world in cases)}.</p>",
        _sizes(recipe, first),
    ]
    for world in cases:
        chosen = [one for one in found[world] if one.verdict != OPEN]
        parts += [f"<h2>The paper's statements, {escape(_WORLDS[world])}</h2>", findings_table(chosen)]
    for world in cases:
        chosen = [one for one in found[world] if one.verdict == OPEN]
        parts += [f"<h2>Questions it leaves open, tried, {escape(_WORLDS[world])}</h2>", findings_table(chosen)]
    for world, lanes in cases.items():
        parts.append(f"<h2>Detectors side by side, {escape(_WORLDS[world])}</h2>")
        parts += [_detectors(recipe, site, tables[world]) for site in lanes]
        parts += [f"<h2>Mines over clutter in HH, {escape(_WORLDS[world])}</h2>", _contrast(recipe, lanes)]
        parts += [f"<h2>Eigenvalue ratios in dry sand, {escape(_WORLDS[world])}</h2>", _ratios(lanes["sand"])]
    parts += ["<h2>Resolution at 15 m</h2>", _resolution(responses)]
    parts += [_figure(name, picture) for name, picture in pictures.items()]
    parts.append(_choices(recipe))
    return study_html("cosgrove2004", parts)


def _figure(name: str, picture: bytes) -> str:
    world = next((one for one in _WORLDS if name.endswith(one)), "")
    title, paper = _FIGURES[name.removesuffix(f"-{world}") if world else name]
    told = f"{title}, {_WORLDS[world]}" if world else title
    return f"<h2>{escape(told)}</h2>" + figure_html(picture, f"Paper: {paper}", told)


def _sizes(recipe: StudyRecipe, lanes: Mapping[str, Sequence[Case]]) -> str:
    told = [
        f"{escape(recipe.sites[site].title)} {one[0]['training_looks']} training and {one[0]['test_looks']} test images"
        for site, one in lanes.items()
    ]
    paper = "The paper tests on 72 images at site one and 34 in each soil of site two."
    return f"<p class=note>Each seed has {'; '.join(told)}. {paper}</p>"


def _detectors(recipe: StudyRecipe, site: str, table: pd.DataFrame) -> str:
    part = table[table["site"] == site]
    rows = []
    for name in dict.fromkeys(part["detector"]):
        chosen = part[part["detector"] == name]
        row = [str(name)]
        for column in ("pd", "pd_quantile", "pd_rockless", "pd_mean"):
            mean, low, high = interval(chosen[column].to_numpy())
            row.append(f"{mean:.2f} ({max(low, 0):.2f} to {min(high, 1):.2f})")
        rows.append(row)
    head = (
        recipe.sites[site].title, f"Pd at {recipe.score.pfa:g} per m²",
        f"by the {100 * recipe.score.quantile:g} % quantile of boxes", "boxes with rocks left out",
        "mean Pd up to 0.1 per m²",
    )  # fmt: skip
    return wide_table(head, rows)


def _contrast(recipe: StudyRecipe, lanes: Mapping[str, Sequence[Case]]) -> str:
    rows = [
        (
            recipe.sites[str(row["site"])].title,
            f"{100 * row['depth']:.0f} cm",
            row["looks"],
            f"{row['contrast']:.1f} dB",
        )
        for row in contrast_table(lanes).to_dict("records")
    ]
    return wide_table(("site", "depth", "looks, all seeds", "median box peak, mines over clutter"), rows)


def _ratios(lanes: Sequence[Case]) -> str:
    rows = []
    for j, values in enumerate(np.array([case["ratios"] for case in lanes]).T):
        mean, low, high = interval(values)
        rows.append((j + 1, f"{PAPER_RATIOS[j]:g}", f"{mean:.3f}", f"{low:.3f} to {high:.3f}"))
    return wide_table(("j", "paper σj/σ1", "ours", "95 %"), rows)


def _resolution(responses: Mapping[str, PointResponse]) -> str:
    rows = [(name, *(f"{100 * width:.1f} cm" for width in one.resolution)) for name, one in responses.items()]
    rows.append(("paper", "about 10 cm", "about 40 cm"))
    return wide_table(("half-power width of an ideal point", "down-range", "cross-range"), rows)


def _choices(recipe: StudyRecipe) -> str:
    score, cut, training = recipe.score, recipe.cut, recipe.training
    width = recipe.image.x[1] - recipe.image.x[0]
    told = [
        f"H0 boxes tile {width:g} m x {recipe.radar.stop_spacing:g} m about the range of each mine, "
        f"{score.clearance:g} m off the mine's box. P_FA is the share of these boxes above the threshold per box area.",
        "Boxes stand at the surveyed places; refraction, which makes deep mines appear farther, is not corrected.",
        f"Training cuts of {cut.length} samples are taken where the mine is brightest within {training.search:g} m of "
        "its place; 'placed by survey' takes the surveyed place shifted by refraction instead.",
        "Mean and covariance of the clutter come from the training images, off the mines, shrunk by Ledoit and Wolf. "
        "'unshrunk clutter' takes the sample covariance, which is singular but for numerical noise as the cuts have "
        "five samples per resolution cell. Shrinkage was adopted, and lanes without roadside objects were added, "
        "after the first lane had been scored; scatterers and margin were then lowered too, for speed.",
        "From the other direction the same mines and rocks stand there; the rough surface is drawn anew.",
        "'trained on simulation' brings clutter-free signatures of all depths to the energy of the training examples.",
        "'trained on sand' is trained on metal mines in dry sand and whitened by the clutter of the lane under test.",
    ]
    return f"<h2>What was chosen where the paper is silent</h2>{bullets(told)}"
