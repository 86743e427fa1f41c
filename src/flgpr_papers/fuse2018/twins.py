"""The figures of Fuse et al. 2018 from our lanes, in the paper's order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.scoring import pd_at
from flgpr_papers.fuse2018 import figures
from flgpr_papers.fuse2018.findings import (
    BY_MEAN,
    COVERS,
    FALL,
    KEPT,
    PAPER_DB,
    PAPER_MEAN_DB,
)
from flgpr_papers.fuse2018.fullwave import FullwaveStudy
from flgpr_papers.fuse2018.lanes import FuseRecipe
from flgpr_papers.fuse2018.matches import scored
from flgpr_papers.fuse2018.poses import PoseStudy
from flgpr_papers.fuse2018.results import LaneResult
from flgpr_papers.kit.findings import Finding

Rows = Sequence[tuple[str, str, str]]
_MASKS = {"Fig. 3": ("vv", "L band VV"), "Fig. 4": ("vh", "L band VH"), "Fig. 5": ("x", "X band")}
_NOTHING = "nothing to measure"


@dataclass(frozen=True)
class Shown:
    """What the figures are drawn from."""

    recipe: FuseRecipe
    lanes: Sequence[LaneResult]
    loose: LaneResult
    example: Mapping[str, NDArray[Any]]
    poses: PoseStudy
    fullwave: FullwaveStudy
    found: Sequence[Finding]

    def ours(self, claim: str) -> str:
        """Return what we have of a claim, with its interval."""
        return next((finding.ours for finding in self.found if finding.claim == claim), _NOTHING)


class Drawing(NamedTuple):
    """A figure, and what stands beside it on the page."""

    name: str  #: of its file
    number: str  #: of the paper's figure; empty where it has none
    title: str
    caption: str
    figure: Figure
    numbers: Rows = ()  #: quantity, paper, here


def paper_drawings(shown: Shown) -> Iterator[Drawing]:
    """Draw Fig. 1 to 9."""
    yield _geometry(shown)
    yield _procedure(shown)
    yield from _images(shown)
    yield _mixed(shown)
    yield _averages(shown)
    yield _clutter_power(shown)
    yield _roc(shown)


def own_drawings(shown: Shown) -> Iterator[Drawing]:
    """Draw what the paper does not have."""
    caption = "The frame of Fig. 3 to 7, in dB under the peak of the original."
    yield Drawing(
        "variants", "", "One frame, every variant", caption, figures.variants_figure(shown.example)
    )
    caption = 'Sec. 2.4: "each region ... is compared ... and the intersection is selected".'
    yield Drawing(
        "regions",
        "",
        "Two readings of the intersection",
        caption,
        figures.regions_figure(shown.example),
    )
    figure = figures.variants_roc_figure(shown.lanes, shown.recipe)
    yield Drawing("variants-roc", "", "ROC of the variants", "By both conventions of FAR.", figure)
    figure = figures.pose_figure(shown.poses, shown.lanes, shown.loose)
    yield Drawing(
        "poses",
        "",
        "What poses cost the coherent sum (Eq. 4)",
        "Formula, reflectors, lanes.",
        figure,
    )
    caption = "Triangles: mines; cross: rock; square: post."
    yield Drawing(
        "fullwave", "", "The full-wave lane", caption, figures.fullwave_figure(shown.fullwave)
    )


def _geometry(shown: Shown) -> Drawing:
    """Return the twin of the paper's geometry."""
    image = shown.recipe.image
    step = shown.recipe.lanes.step
    borders = ", ".join(f"{edge:g}" for edge in image.edges)
    numbers = [
        ("frames", "several, summed in range (Eq. 4)", f"{image.frames}, {_span(step)} m apart"),
        (
            "imaged ground",
            "-10 to 10 m across (Sec. 2.4)",
            f"{_span(image.x)} m, {_span(image.y)} m ahead",
        ),
        ("sub-regions in range", "four", f"{len(image.edges) - 1}, borders at {borders} m"),
    ]
    caption = "Antennas of both bands at their places; dotted: borders of the sub-regions."
    figure = figures.geometry_figure(shown.recipe)
    return Drawing("figure-1", "Fig. 1", "Imaging system geometry", caption, figure, numbers)


def _procedure(shown: Shown) -> Drawing:
    """Return the twin of the paper's procedure."""
    numbers = [
        ("roadside", "4 to 10 m on either side", f"{_span(shown.recipe.mask.roadside)} m"),
        (
            "thresholds, fundamental",
            "calibration cases, as low as possible",
            "calibration lane, see the table",
        ),
        ("threshold, extended", "average at the roadside in a frame of the test lane", "the same"),
    ]
    caption = (
        "(a) Fundamental part, two rows that are united; (b) extended part. Masks of the frame of "
        "Fig. 3 stand for the "
        "paper's sketches. VV low has the mean of |VV| at the roadside for a threshold; it changes "
        "nothing."
    )
    figure = figures.procedure_figure(shown.example)
    return Drawing("figure-2", "Fig. 2", "Procedure of the mask creation", caption, figure, numbers)


def _images(shown: Shown) -> Iterator[Drawing]:
    """Yield the twins of the images and masks of both bands."""
    for number, (band, title) in _MASKS.items():
        if band not in shown.example:
            continue
        caption = (
            "(a) SAR image; (b) binary mask for the fundamental part. Triangles: buried targets."
        )
        if band == "vv":
            caption += (
                " Rectangles: the two clutter regions of Fig. 8, "
                "the strongest object at either roadside."
            )
        figure = figures.mask_figure(shown.example, band, f"mask {band}", title, boxes=band == "vv")
        numbers = [("pixels of the mask", "not told", _percent(shown.example[f"mask {band}"]))]
        name = number.lower().replace(". ", "ure-")
        yield Drawing(name, number, f"{title} result", caption, figure, numbers)


def _mixed(shown: Shown) -> Drawing:
    """Return the twin of the mixed mask."""
    numbers = [
        (
            "targets under the mask",
            "covers just the clutter area",
            f"share of the looks {shown.ours(COVERS)}",
        ),
        ("pixels, fundamental part", "not told", _percent(shown.example["fundamental"])),
        ("pixels, extended part", "not told", _percent(shown.example["extended"])),
    ]
    figure = figures.mixed_figure(shown.example)
    return Drawing(
        "figure-6", "Fig. 6", "Mixed binary mask", "Triangles: buried targets.", figure, numbers
    )


def _averages(shown: Shown) -> Drawing:
    """Return the twin of the averaged images."""
    numbers = [("targets' own peaks", "signals still remain", shown.ours(KEPT))]
    caption = "(a) #1, (b) #3, (c) #4, (d) #6, in dB under the peak of Fig. 3(a)."
    figure = figures.stages_figure(shown.example)
    return Drawing(
        "figure-7", "Fig. 7", "Averaging images to reduce clutter", caption, figure, numbers
    )


def _clutter_power(shown: Shown) -> Drawing:
    """Return the twin of the clutter power over iterations."""
    numbers = [
        ("fall of the clutter, #6", f"{PAPER_DB:g} dB", shown.ours(FALL)),
        ("of it by averaging", f"{PAPER_MEAN_DB:g} dB", shown.ours(BY_MEAN)),
        ("iterations", "up to 7", f"{shown.recipe.suppress.iterations}"),
    ]
    caption = (
        "Coloured: the two regions of Fig. 3(a); black: the mean over the strongest boxes of all "
        "frames, shaded: its "
        "95 % interval. (a) and (b) as in the paper's caption; its text exchanges them."
    )
    figure = figures.power_figure(shown.lanes, shown.example, shown.recipe)
    return Drawing(
        "figure-8",
        "Fig. 8",
        "Clutter signal by iteration and combination",
        caption,
        figure,
        numbers,
    )


def _roc(shown: Shown) -> Drawing:
    """Return the twin of the ROC."""
    score = shown.recipe.score
    numbers = [
        (
            "detection area of a frame",
            "-7 to 7 m, 5 to 10 m ahead",
            f"{_span(score.x)} m, {_span(score.y)} m ahead",
        ),
        ("halo, diameter", "1 m", f"{score.halo:g} m"),
    ]
    for lane in shown.lanes:
        for far in (0.05, 0.1):
            curves = [
                scored(lane, name, shown.recipe, "frames")[1] for name in ("original", "iteration")
            ]
            text = " and ".join(f"{pd_at(curve, far):.2f}" for curve in curves)
            numbers.append(
                (
                    f"Pd, lane {lane.name}, {far:g} per m², without and with",
                    "not told in numbers",
                    text,
                )
            )
    caption = (
        "(a) Lane A, (b) lane B. Every frame counts its area, the same ground again in each. "
        "Dotted: chance."
    )
    return Drawing(
        "figure-9",
        "Fig. 9",
        "ROC results",
        caption,
        figures.roc_figure(shown.lanes, shown.recipe),
        numbers,
    )


def _percent(mask: NDArray[Any]) -> str:
    """Return the share of a mask in percent."""
    return f"{100 * np.mean(mask):.1f} %"


def _span(limits: Sequence[float]) -> str:
    """Return two limits in words."""
    return f"{limits[0]:g} to {limits[1]:g}"
