"""The figures of Cosgrove et al. 2004 from our lanes, with the paper's numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from flgpr_papers.cosgrove2004.findings import PAPER_PD, PAPER_RATIOS, SOILS, Case, interval
from flgpr_papers.cosgrove2004.images import PointResponse, study_sensor
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.findings import Finding
from flgpr_papers.kit.page import Twin

Rows = Sequence[tuple[str, str, str]]
BESIDE = {"open": "open lanes", "roadside": "beside bushes and posts"}
"""What stands beside a lane, in words."""
_TITLES = {
    "1": ("Collection geometry", "From above and from the side: a van stops along the lane."),
    "2": (
        "HH image of three mines",
        "Open dry sand, over the median of each range. Squares: boxes of 1 m at the mines.",
    ),
    "3": (
        "Simulated signature",
        "A TM-62M 10 cm deep in dry sand without clutter; HH dashed, VV solid.",
    ),
    "4": (
        "Range cuts through three imaged mines",
        "First seed, one mine of each of three depths, at its brightest place.",
    ),
    "5": ("The feature vector", "A range cut of HH, then of VV."),
    "6": ("The first six eigenvectors", "First seed, dry sand; magnitudes, the whitening undone."),
    "7": (
        "ROC at 15 m",
        "Bold: first seed, ending at its lowest non-zero P_FA; dotted: mean over the seeds; "
        "shaded: their 10 to 90 %.",
    ),
}


def paper_twins(
    recipe: StudyRecipe,
    cases: Mapping[str, Mapping[str, Sequence[Case]]],
    tables: Mapping[str, pd.DataFrame],
    found: Mapping[str, Sequence[Finding]],
    pictures: Mapping[str, bytes],
) -> Iterator[Twin]:
    """Yield Fig. 1 to 7, those of detectors and imaged mines with and without a roadside.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    cases : mapping
        Cases of every seed by surroundings and site.
    tables : mapping of str to DataFrame
        Pd of every detector by surroundings.
    found : mapping of str to sequence of Finding
        Findings by surroundings.
    pictures : mapping of str to bytes
        Figures by name, PNG.
    """
    for number, (title, caption) in _TITLES.items():
        heading = f"Fig. {number}"
        for surroundings, lane_title in BESIDE.items():
            rows = _numbers(
                number,
                recipe,
                cases[surroundings],
                tables[surroundings],
                found[surroundings],
            )
            picture = pictures.get(f"figure-{number}-{surroundings}")
            if picture is not None:
                yield Twin(heading, f"{title}, {lane_title}", picture, caption, rows)
            elif surroundings == "open":
                yield Twin(heading, title, pictures[f"figure-{number}"], caption, rows)


def own_twins(
    responses: Mapping[str, PointResponse], pictures: Mapping[str, bytes]
) -> Iterator[Twin]:
    """Yield the figures that the paper does not have."""
    caption = "Half-power widths of an ideal point on the ground at 15 m (Sec. III-A)."
    yield Twin("", "Resolution", pictures["resolution"], caption, _resolution_rows(responses))
    for surroundings, title in BESIDE.items():
        caption = "All seeds pooled, thresholds lane by lane."
        yield Twin("", f"Pd over depth, {title}", pictures[f"depth-{surroundings}"], caption)


def _numbers(
    number: str,
    recipe: StudyRecipe,
    cases: Mapping[str, Sequence[Case]],
    table: pd.DataFrame,
    found: Sequence[Finding],
) -> Rows:
    """Tabulate what the paper says of a figure beside ours."""
    if number == "1":
        return _geometry_rows(recipe)
    if number == "5":
        length = recipe.cut.length
        polarizations = recipe.cut.polarizations
        names = ", then ".join(f"{length} of {name}" for name in polarizations)
        return (
            ("samples", "28 of HH, then 28 of VV", names),
            ("M", "56", str(length * len(polarizations))),
        )
    if number == "6":
        return ratio_rows(cases["sand"])
    if number == "7":
        return _pd_rows(recipe, table)
    claims = {
        "2": ("Three mines are readily visible",),
        "3": ("A simulated mine has a double hump",),
        "4": ("The double hump is evident", "A mine is better correlated"),
    }[number]
    return [
        (f"{finding.claim}: {finding.quantity}", finding.paper, finding.ours)
        for finding in found
        if finding.claim.startswith(claims)
    ]


def _geometry_rows(recipe: StudyRecipe) -> Rows:
    """Tabulate the geometry of the paper and ours."""
    sensor = study_sensor(recipe)
    tx, _ = sensor.pairs()
    tones = sensor.tones.axis()
    return (
        ("antenna positions", "72", str(len(tx))),
        ("across", "the width of the van", f"{np.ptp(tx[:, 0]):.1f} m"),
        ("height", "on the van's top", f"{sensor.height:g} m"),
        (
            "tones that are used",
            "0.3 to 1.9 GHz",
            f"{tones[0] / 1e9:.2g} to {tones[-1] / 1e9:.2g} GHz",
        ),
        ("range", "15 m", f"{recipe.radar.range:g} m"),
    )


def ratio_rows(lanes: Sequence[Case]) -> Rows:
    """Tabulate the ratios of eigenvalues, mean over the seeds with the interval."""
    ratios = np.array([case["ratios"] for case in lanes], dtype=np.float64)
    rows = []
    for j in range(1, min(len(PAPER_RATIOS), ratios.shape[1])):
        mean, low, high = interval(ratios[:, j], bounds=(0.0, 1.0))
        ours = (
            "no example reaches it" if np.isnan(mean) else f"{mean:.3f} ({low:.3f} to {high:.3f})"
        )
        rows.append((f"σ{j + 1}/σ1", f"{PAPER_RATIOS[j]:g}", ours))
    return rows


def _pd_rows(recipe: StudyRecipe, table: pd.DataFrame) -> Rows:
    """Tabulate Pd at the study's P_FA, mean over the seeds, by soil."""
    paper = {
        "sand": f"best, {PAPER_PD:g} by deflection in the best soil; PWF and HH below",
        "gravel": "PWF and HH below deflection",
        "clay": "worst; PWF and HH below deflection",
    }
    names = {f"rank {recipe.detector.rank}": "deflection", "PWF": "PWF", "HH": "HH"}
    rows = []
    for soil in (soil for soil in SOILS if soil in recipe.sites):
        means = table[table["site"] == soil].groupby("detector")["pd"].mean()
        ours = ", ".join(f"{name} {means[detector]:.2f}" for detector, name in names.items())
        rows.append(
            (f"{recipe.sites[soil].title}, Pd at {recipe.score.pfa:g} per m²", paper[soil], ours)
        )
    return rows


def _resolution_rows(responses: Mapping[str, PointResponse]) -> Rows:
    """Tabulate the resolution of the paper and ours."""
    rows = []
    for axis, (name, paper) in enumerate(
        (("down-range", "about 10 cm"), ("cross-range", "about 40 cm"))
    ):
        for filtered, response in responses.items():
            rows.append((f"{name}, {filtered}", paper, f"{100 * response.resolution[axis]:.1f} cm"))
    return rows
