"""Figures of the reproduction of Fuse et al. 2018."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

from flgpr.clutter import TABLE_II
from flgpr.types import AnyArray, Arrays, Entries
from flgpr_papers.fuse2018.findings import CONVENTIONS, PAPER_DB, power_db, scored, strongest_boxes
from flgpr_papers.fuse2018.lanes import FuseRecipe, band_sensor
from flgpr_papers.fuse2018.process import LaneResult
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration
from flgpr_papers.kit.figures import Figures, Panels, chance_line, colour_bar, show, steps
from flgpr_papers.kit.intervals import clustered

_figure = Figures("fuse2018")
_RANGE = 40.0  # dB shown
_RING = 0.5  # m, radius of the rings about mines: the halo of the ROC
_DEEP = 55.0  # dB, where a mine must show beside a post
COMPARED = {
    "original": ("0.25", "-"),
    "iteration": ("C3", "-"),
    "shared": ("C0", "--"),
    "least squares": ("C1", "-."),
    "least squares spared": ("C5", "-."),
    "least squares per frame": ("C2", ":"),
    "L band alone": ("C4", (0, (1, 2))),
}


STAGES = {"stage #1": "(a) #1", "stage #3": "(b) #3", "stage #4": "(c) #4", "stage #6": "(d) #6"}
"""Averages of Fig. 7."""
CLEANED = {f"variant {name}": name for name in VARIANTS}
"""The example frame as every variant leaves it."""


@dataclass(frozen=True)
class Measured:
    """What the study has measured, for its figures and its page."""

    recipe: FuseRecipe  #: the study
    lanes: Sequence[LaneResult]  #: results of lanes A and B
    loose: LaneResult  #: result of lane A with the presets' looser navigation
    calibration: Calibration  #: what the calibration lane teaches
    example: Arrays  #: what the figures show of one aperture


def _rows(measured: Measured, titles: Mapping[str, str], columns: int) -> Entries:
    """Return rows and columns of panels for those images of the example that there are."""
    there = titles.keys() & measured.example.keys()
    return {"rows": -(-len(there) // columns), "columns": columns}


def _columns(measured: Measured) -> Entries:
    """Return a column of panels for every lane."""
    return {"columns": len(measured.lanes)}


@_figure
def mask_figure(panels: Panels, measured: Measured, band: str, title: str) -> None:
    """Draw an image of the example frame beside its binary mask, as Fig. 3 to 5."""
    example = measured.example
    left, right = panels
    colour_bar(panels, _image(left, example, example[band]), "dB", shrink=0.7)
    left.set_title(f"{title}: (a) SAR image", fontsize=10)
    _mask(right, example, example[f"mask {band}"], "(b) binary mask, fundamental part")
    for axes in panels:
        _dress(axes, example, band == "vv")


@_figure
def geometry_figure(axes: Any, measured: Measured) -> None:
    """Draw the antennas of both bands, the imaged ground and the path of Eq. 2, as Fig. 1."""
    recipe = measured.recipe
    for band, colour in (("l", "C0"), ("x", "C1")):
        sensor = band_sensor(recipe, band)
        tx, rx = [side + [0.0, 0.0, sensor.height] for side in sensor.pairs()]
        for side, mark, fill, name in (
            (tx, "^", colour, "transmitters"),
            (rx, "v", "none", "receivers"),
        ):
            positions = np.unique(side, axis=0)
            label = f"{band.upper()} band, {len(positions)} {name}"
            axes.plot(*positions.T, mark, color=colour, ms=4, mfc=fill, label=label)
    x_min, x_max = recipe.image.x
    y_min, y_max = recipe.image.y
    x_corners = [x_min, x_max, x_max, x_min, x_min]
    y_corners = [y_min, y_min, y_max, y_max, y_min]
    axes.plot(x_corners, y_corners, 0, "k-", lw=1, label="imaged ground")
    for edge in recipe.image.edges[1:-1]:
        axes.plot([x_min, x_max], [edge, edge], 0, "k:", lw=0.8)
    # The path of the X band's first transmitter and last receiver.
    pixel = np.array([3.0, 9.0, 0.0])
    axes.plot(*np.array([tx[0], pixel, rx[-1]]).T, "C3-", lw=1.2, label="path L of Eq. 2")
    axes.plot(*pixel, "C3s", ms=5)
    axes.view_init(24, -62)
    axes.set_box_aspect((20, 15, 5), zoom=1.15)


@_figure
def procedure_figure(panels: Panels, measured: Measured) -> None:
    """Draw how the fundamental and the extended mask are made, as Fig. 2."""
    example = measured.example
    vv, vh, vv_low, vh_low = [example[f"mask {n}"] for n in ("vv", "vh", "vv low", "vh low")]
    none = np.zeros_like(vv)
    x = example.get("mask x", none)
    rows: tuple[Arrays, ...] = (
        {
            "(a) VV": vv,
            "VH": vh,
            "VV \u2229 VH": vv & vh,
            "union: fundamental part": example["fundamental"],
        },
        {"VV": vv, "X": x, "VV \u2229 X": vv & x},
        {
            "(b) VV low": vv_low,
            "VH low": vh_low,
            "VV low \u2229 VH low": vv_low & vh_low,
            "\u222a VH low, roadside: extended part": example["extended"],
        },
    )
    for row, images in zip(panels, rows, strict=True):
        for axes, (title, mask) in zip(row, images.items(), strict=False):
            _mask(axes, example, mask, title)
            axes.title.set_fontsize(8)
            axes.tick_params(labelsize=7)
        for axes in row[len(images) :]:
            axes.set_visible(False)
    figure = panels[0, 0].figure
    figure.supxlabel("cross-range, m", fontsize=9)
    figure.supylabel("ahead of the array, m", fontsize=9)


@_figure
def masks_figure(panels: Panels, measured: Measured, titles: Mapping[str, str]) -> None:
    """Draw two masks of the example frame side by side, as Fig. 6."""
    example = measured.example
    for axes, (name, title) in zip(panels, titles.items(), strict=True):
        _mask(axes, example, example[name], title)
        _dress(axes, example)


@_figure.sized(lambda measured: _rows(measured, STAGES, 2))
def averages_figure(panels: Panels, measured: Measured) -> None:
    """Draw the example frame averaged by several combinations, as Fig. 7."""
    _images(panels, measured.example, STAGES)


@_figure.sized(lambda measured: _rows(measured, CLEANED, 3))
def cleaned_figure(panels: Panels, measured: Measured) -> None:
    """Draw the example frame as every variant leaves it."""
    _images(panels, measured.example, CLEANED)


def _images(panels: Panels, example: Arrays, titles: Mapping[str, str]) -> None:
    """Draw those images of the example frame that there are, on one scale."""
    chosen = {name: title for name, title in titles.items() if name in example}
    top = float(example["vv"].max())
    for axes, (name, title) in zip(panels.flat, chosen.items(), strict=False):
        shown = _image(axes, example, example[name], top)
        axes.set_title(title, fontsize=10)
        _dress(axes, example, True)
    for axes in panels.ravel()[len(chosen) :]:
        axes.set_visible(False)
    colour_bar(panels, shown, "dB under the original's peak")


@_figure
def power_figure(panels: Panels, measured: Measured) -> None:
    """Draw the clutter power against iterations and combinations, as Fig. 8."""
    recipe, lanes, example = measured.recipe, measured.lanes, measured.example
    boxes = strongest_boxes(lanes)
    named_boxes = strongest_boxes(lanes[:1])
    named_boxes = named_boxes[named_boxes["frame"] == int(example["frame"])]
    singles = {i: f"iteration {i}" for i in range(recipe.suppress.iterations + 1)}
    averages = {i: f"#{i}" for i in TABLE_II}
    for axes, stages in zip(panels, (singles, averages), strict=True):
        numbers = list(stages)
        powers = np.array([power_db(named_boxes, stage) for stage in stages.values()])
        for side, levels in zip(named_boxes["side"], powers.T, strict=True):
            axes.plot(numbers, levels, "o-", label=f"box, {side}")
        intervals = [
            clustered(power_db(boxes, stage), boxes["cluster"], 500) for stage in stages.values()
        ]
        mean, low, high = np.array(intervals).T
        mean_label = f"mean of {len(boxes)} boxes, lanes A and B"
        axes.plot(numbers, mean, "k-", lw=2, label=mean_label)
        axes.fill_between(numbers, low, high, color="0.6", alpha=0.4)
        axes.axhline(-PAPER_DB, color="C3", ls=":", label=f"paper, #6: {-PAPER_DB:g} dB")
        axes.set_xticks(numbers)


@_figure.sized(_columns)
def roc_figure(panels: Panels, measured: Measured) -> None:
    """Draw the ROC curves of both lanes with and without processing, as Fig. 9.

    Every frame counts its area.
    """
    recipe, lanes = measured.recipe, measured.lanes
    styles = {"iteration": ("--", "with processing"), "original": ("-", "without processing")}
    for axes, letter, lane in zip(panels, "ab", lanes, strict=True):
        for name, (dash, label) in styles.items():
            curve = scored(lane, name, recipe, "frames")[1]
            steps(axes, curve, label, color="k", ls=dash, lw=1.6)
        chance_line(axes, 0.3, recipe.score.halo / 2)
        axes.set_title(f"({letter}) lane {lane.name}")


@_figure.sized(_columns)
def variants_roc_figure(panels: Panels, measured: Measured) -> None:
    """Draw the ROC curves of all variants on both lanes by both conventions."""
    recipe, lanes = measured.recipe, measured.lanes
    cases = product(CONVENTIONS.items(), lanes)
    for axes, ((convention, title), lane) in zip(panels.flat, cases, strict=True):
        for name, (colour, dash) in COMPARED.items():
            curve = scored(lane, name, recipe, convention)[1]
            width = 2.2 if name in ("original", "iteration") else 1.2
            steps(axes, curve, name, color=colour, ls=dash, lw=width)
        chance_line(axes, 0.3, recipe.score.halo / 2)
        axes.set_title(f"lane {lane.name}, {title}", fontsize=9)


def _image(axes: Axes, example: Arrays, magnitude: AnyArray, top: float | None = None) -> Any:
    """Draw a magnitude in dB under its top."""
    level = 20 * np.log10(np.maximum(magnitude / (top or magnitude.max()), 1e-8))
    return show(axes, level, example["x_axis"], example["y_axis"], -_DEEP, 0, cmap="viridis")


def _mask(axes: Axes, example: Arrays, mask: AnyArray, title: str) -> None:
    """Draw a mask."""
    show(axes, mask, example["x_axis"], example["y_axis"], 0, 1, cmap="gray")
    axes.set_title(title, fontsize=10)


def _dress(axes: Axes, example: Arrays, boxes: bool = False) -> None:
    """Mark mines, and the boxes if wanted, on an image."""
    x_min, x_max = example["x_axis"][[0, -1]]
    y_min, y_max = example["y_axis"][[0, -1]]
    for x, y in example["mines"]:
        if x_min <= x <= x_max and y_min <= y <= y_max:
            # A ring of the halo leaves the mine to be seen; a black rim shows on bright ground.
            for width, colour in ((3.0, "black"), (1.3, "#37d67a")):
                axes.add_patch(Circle((x, y), _RING, fill=False, ec=colour, lw=width))
    if boxes:
        side = float(example["box side"])
        for x, y in example["boxes"]:
            corner = x - side / 2, y - side / 2
            axes.add_patch(Rectangle(corner, side, side, fill=False, ec="#9dff57", lw=1.4))
    axes.set(
        xlim=(x_min, x_max),
        ylim=(y_min, y_max),
        xlabel="cross-range, m",
        ylabel="ahead of the array, m",
    )
    axes.label_outer()
