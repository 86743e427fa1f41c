"""Figures of the reproduction of Fuse et al. 2018."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from flgpr.clutter import TABLE_II
from flgpr.scoring import random_pd
from flgpr_papers.fuse2018.findings import PAPER_DB
from flgpr_papers.fuse2018.fullwave import FullwaveStudy
from flgpr_papers.fuse2018.lanes import FuseRecipe, band_sensor
from flgpr_papers.fuse2018.matches import CONVENTIONS, scored
from flgpr_papers.fuse2018.poses import PoseStudy
from flgpr_papers.fuse2018.powers import power_db, strongest_boxes
from flgpr_papers.fuse2018.process import LaneResult
from flgpr_papers.fuse2018.suppression import VARIANTS
from flgpr_papers.kit.figures import show, subplots
from flgpr_papers.kit.intervals import clustered

Arrays = Mapping[str, NDArray[Any]]
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


BANDS = {"vv": "L band VV", "vh": "L band VH", "x": "X band"}
"""Images of Fig. 3 to 5, and what they are of."""
MIXED = {"fundamental": "(a) fundamental part", "extended": "(b) extended part"}
"""Masks of Fig. 6."""
READINGS = {
    "fundamental": "intersected pixel by pixel",
    "fundamental by region": "by connected region",
}
"""The fundamental part by the two readings of "the intersection"."""
STAGES = {"stage #1": "(a) #1", "stage #3": "(b) #3", "stage #4": "(c) #4", "stage #6": "(d) #6"}
"""Averages of Fig. 7."""
CLEANED = {f"variant {name}": name for name in VARIANTS}
"""The example frame as every variant leaves it."""


def mask_figure(example: Arrays, band: str, title: str) -> Figure:
    """Draw an image of the example frame beside its binary mask, as Fig. 3 to 5."""
    figure, (left, right) = subplots(8.6, 3.1, 1, 2, sharey=True)
    shown = _image(left, example, example[band])
    figure.colorbar(shown, ax=[left, right], label="dB", shrink=0.7)
    left.set_title(f"{title}: (a) SAR image", fontsize=10)
    _mask(right, example, example[f"mask {band}"], "(b) binary mask, fundamental part")
    for axes in (left, right):
        _dress(axes, example, band == "vv")
    return figure


def geometry_figure(recipe: FuseRecipe) -> Figure:
    """Draw the antennas of both bands, the imaged ground and the path of Eq. 2, as Fig. 1."""
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    for band, colour in (("l", "C0"), ("x", "C1")):
        sensor = band_sensor(recipe, band)
        height = np.array([0.0, 0.0, sensor.height])
        for side, mark in (("tx", "^"), ("rx", "v")):
            tx, rx = sensor.pairs()
            positions = np.unique(tx if side == "tx" else rx, axis=0) + height
            antennas = "transmitters" if side == "tx" else "receivers"
            axes.plot(
                *positions.T,
                mark,
                color=colour,
                ms=4,
                mfc=colour if side == "tx" else "none",
                label=f"{band.upper()} band, {len(positions)} {antennas}",
            )
    x_min, x_max = recipe.image.x
    y_min, y_max = recipe.image.y
    x_corners = [x_min, x_max, x_max, x_min, x_min]
    y_corners = [y_min, y_min, y_max, y_max, y_min]
    axes.plot(x_corners, y_corners, 0, "k-", lw=1, label="imaged ground")
    for edge in recipe.image.edges[1:-1]:
        axes.plot([x_min, x_max], [edge, edge], 0, "k:", lw=0.8)
    # The path of the X band's first transmitter and last receiver.
    all_tx, all_rx = sensor.pairs()
    tx = all_tx[0] + height
    rx = all_rx[-1] + height
    pixel = np.array([3.0, 9.0, 0.0])
    axes.plot(*np.array([tx, pixel, rx]).T, "C3-", lw=1.2, label="path L of Eq. 2")
    axes.plot(*pixel, "C3s", ms=5)
    axes.set(
        xlabel="x, cross-range (m)",
        ylabel="y, range (m)",
        zlabel="z (m)",
        zlim=(0, 4),
        zticks=(0, 2, 4),
    )
    axes.view_init(24, -62)
    axes.set_box_aspect((20, 15, 5), zoom=1.15)
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(-0.05, 1.02), ncols=2)
    return figure


def procedure_figure(example: Arrays) -> Figure:
    """Draw how the fundamental and the extended mask are made, as Fig. 2."""
    figure, panels = subplots(9.0, 4.4, 3, 4, sharex=True, sharey=True)
    vv = example["mask vv"]
    vh = example["mask vh"]
    x = example.get("mask x")
    none = np.zeros_like(vv)
    x_and_vv = none if x is None else vv & x
    rows: tuple[Arrays, ...] = (
        {
            "(a) VV": vv,
            "VH": vh,
            "VV \u2229 VH": vv & vh,
            "union: fundamental part": example["fundamental"],
        },
        {"VV": vv, "X": none if x is None else x, "VV \u2229 X": x_and_vv},
        {
            "(b) VV low": example["mask vv low"],
            "VH low": example["mask vh low"],
            "VV low \u2229 VH low": example["mask vv low"] & example["mask vh low"],
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
    figure.supxlabel("cross-range, m", fontsize=9)
    figure.supylabel("ahead of the array, m", fontsize=9)
    return figure


def masks_figure(example: Arrays, titles: Mapping[str, str]) -> Figure:
    """Draw two masks of the example frame side by side, as Fig. 6."""
    figure, panels = subplots(8.6, 3.1, 1, 2, sharey=True)
    for axes, (name, title) in zip(panels, titles.items(), strict=True):
        _mask(axes, example, example[name], title)
        _dress(axes, example)
    return figure


def images_figure(
    example: Arrays, titles: Mapping[str, str], size: tuple[float, float], columns: int
) -> Figure:
    """Draw those images of the example frame that there are in columns, on one scale."""
    chosen = {name: title for name, title in titles.items() if name in example}
    rows = -(-len(chosen) // columns)
    figure, grid = subplots(*size, rows, columns, sharex=True, sharey=True, squeeze=False)
    panels = grid.ravel()
    top = float(example["vv"].max())
    for axes, (name, title) in zip(panels, chosen.items(), strict=False):
        shown = _image(axes, example, example[name], top)
        axes.set_title(title, fontsize=10)
        _dress(axes, example, True)
    for axes in panels[len(chosen) :]:
        axes.set_visible(False)
    figure.colorbar(shown, ax=panels.tolist(), label="dB under the original's peak")
    return figure


def power_figure(lanes: Sequence[LaneResult], example: Arrays, recipe: FuseRecipe) -> Figure:
    """Draw the clutter power against iterations and combinations, as Fig. 8."""
    figure, all_axes = subplots(8.6, 3.5, 1, 2, sharey=True)
    boxes = strongest_boxes(lanes)
    named_boxes = strongest_boxes(lanes[:1])
    named_boxes = named_boxes[named_boxes["frame"] == int(example["frame"])]
    singles = {i: f"iteration {i}" for i in range(recipe.suppress.iterations + 1)}
    averages = {i: f"#{i}" for i in TABLE_II}
    panels = (
        ("(a) without averaging", "iteration", singles),
        ("(b) with averaging", "combination # (Table II)", averages),
    )
    for axes, (title, label, stages) in zip(all_axes, panels, strict=True):
        numbers = list(stages)
        for row in named_boxes.to_dict("records"):
            box = pd.DataFrame([row])
            levels = [power_db(box, stage)[0] for stage in stages.values()]
            axes.plot(numbers, levels, "o-", label=f"box, {row['side']}")
        intervals = []
        for stage in stages.values():
            intervals.append(clustered(power_db(boxes, stage), boxes["cluster"], 500))
        mean, low, high = np.array(intervals).T
        mean_label = f"mean of {len(boxes)} boxes, lanes A and B"
        axes.plot(numbers, mean, "k-", lw=2, label=mean_label)
        axes.fill_between(numbers, low, high, color="0.6", alpha=0.4)
        axes.axhline(-PAPER_DB, color="C3", ls=":", label=f"paper, #6: {-PAPER_DB:g} dB")
        axes.set(title=title, xlabel=label, xticks=numbers)
        axes.grid(alpha=0.3)
    left = figure.axes[0]
    left.set_ylabel("clutter power, dB re original")
    left.legend(fontsize=8)
    return figure


def roc_figure(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Figure:
    """Draw the ROC curves of both lanes with and without processing, as Fig. 9.

    Every frame counts its area.
    """
    figure, panels = subplots(8.6, 3.5, 1, len(lanes), sharey=True)
    styles = {"iteration": ("--", "with processing"), "original": ("-", "without processing")}
    for axes, letter, lane in zip(panels, "ab", lanes, strict=True):
        for name, (dash, label) in styles.items():
            _, curve, _ = scored(lane, name, recipe, "frames")
            axes.step(curve["far"], curve["pd"], "k", where="post", ls=dash, lw=1.6, label=label)
        _chance(axes, recipe)
        axes.set(title=f"({letter}) lane {lane.name}", xlabel="false alarms per m² of all frames")
    figure.axes[0].set_ylabel("Pd")
    figure.axes[0].legend(fontsize=8, loc="lower right")
    return figure


def variants_roc_figure(lanes: Sequence[LaneResult], recipe: FuseRecipe) -> Figure:
    """Draw the ROC curves of all variants on both lanes by both conventions."""
    shared = {"sharex": True, "sharey": True, "squeeze": False}
    figure, panels = subplots(8.6, 6.4, len(CONVENTIONS), len(lanes), **shared)
    for row, (convention, title) in zip(panels, CONVENTIONS.items(), strict=True):
        for axes, lane in zip(row, lanes, strict=True):
            for name, (colour, dash) in COMPARED.items():
                _, curve, _ = scored(lane, name, recipe, convention)
                width = 2.2 if name in ("original", "iteration") else 1.2
                axes.step(
                    curve["far"],
                    curve["pd"],
                    where="post",
                    color=colour,
                    ls=dash,
                    lw=width,
                    label=name,
                )
            _chance(axes, recipe)
            axes.set_title(f"lane {lane.name}, {title}", fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("false alarms per m²")
    for axes in panels[:, 0]:
        axes.set_ylabel("Pd")
    panels[0, 0].legend(fontsize=8, loc="lower right")
    return figure


def _chance(axes: Axes, recipe: FuseRecipe) -> None:
    """Draw Pd of alarms strewn at random."""
    rates = np.linspace(0, 0.3, 101)
    by_chance = random_pd(rates, recipe.score.halo / 2)
    axes.plot(rates, by_chance, color="0.5", ls=":", lw=1, label="chance")
    axes.set(xlim=(0, 0.3), ylim=(0, 1.02))
    axes.grid(alpha=0.3)


def pose_figure(study: PoseStudy, lanes: Sequence[LaneResult], loose: LaneResult) -> Figure:
    """Draw the loss of the coherent sum against the poses' error: formula, reflectors, lanes."""
    figure, (left, right) = subplots(8.6, 3.1, 1, 2)
    errors = 1000 * np.asarray(study.errors)
    for band, dash in (("l", "-"), ("x", "--")):
        left.plot(
            errors,
            study.predicted[band],
            dash,
            color="0.2",
            label=f"formula, {band.upper()} band, many frames",
        )
    low, middle, high = np.quantile(study.measured, (0.05, 0.5, 0.95), axis=1)
    bars = np.array([middle - low, high - middle])
    left.errorbar(
        errors, middle, bars, fmt="o", color="C3", capsize=4, label="reflectors, L band (5 to 95 %)"
    )
    left.set(
        xlabel="error of the position in each axis, mm rms",
        ylabel="loss of the coherent sum, dB",
        ylim=(-0.5, 15),
    )
    left.legend(fontsize=8)
    bins = np.linspace(0, 10, 41).tolist()
    tight = pd.concat([lane.coherence for lane in lanes])["loss_db"]
    right.hist(tight, bins, density=True, alpha=0.6, label="lanes A and B")
    right.hist(
        loose.coherence["loss_db"],
        bins,
        density=True,
        histtype="step",
        color="C3",
        lw=2,
        label="looser poses",
    )
    right.set(xlabel="loss at the 20 strongest pixels of a frame, dB", ylabel="density")
    right.legend(fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure


def fullwave_figure(study: FullwaveStudy) -> Figure:
    """Draw the full-wave lane before and after, with its masks."""
    rules = sorted({name.split("/")[0] for name in study.images if "/" in name}, reverse=True)
    figure, panels = subplots(9.5, 5.8, len(rules), 4, sharex=True, sharey=True)
    top = study.images["VV"].max()
    x = study.images["x"]
    y = study.images["y"]
    extent = (x[0], x[-1], y[0], y[-1])
    for row, rule in zip(panels, rules, strict=True):
        show(row[0], study.images[f"{rule}/mask"], extent, 0, 1, cmap="gray")
        row[0].set_title(f"mask, roadside {rule}", fontsize=9)
        for axes, method in zip(row[1:], ("none", "iteration", "least squares"), strict=True):
            level = 20 * np.log10(np.maximum(study.images[f"{rule}/{method}"] / top, 1e-6))
            shown = show(axes, level, extent, -_RANGE, 0, cmap="viridis")
            axes.set_title("VV as it is" if method == "none" else f"VV, {method}", fontsize=9)
        for axes in row:
            for mark, (px, py) in zip("^^^xs", study.images["places"], strict=True):
                edge = "C2" if mark == "^" else "C3"
                axes.plot(px, py, mark, mfc="none", mec=edge, color="C3", ms=9)
        row[0].set_ylabel("y (m)")
    for axes in panels[-1]:
        axes.set_xlabel("x (m)")
    figure.colorbar(shown, ax=panels.ravel().tolist(), label="dB under the VV peak")
    return figure


def _image(axes: Axes, example: Arrays, magnitude: NDArray[Any], top: float | None = None) -> Any:
    """Draw a magnitude in dB under its top."""
    level = 20 * np.log10(np.maximum(magnitude / (top or magnitude.max()), 1e-8))
    return show(axes, level, _extent(example), -_DEEP, 0, cmap="viridis")


def _mask(axes: Axes, example: Arrays, mask: NDArray[Any], title: str) -> None:
    """Draw a mask."""
    show(axes, mask, _extent(example), 0, 1, cmap="gray")
    axes.set_title(title, fontsize=10)


def _extent(example: Arrays) -> tuple[float, float, float, float]:
    """Return the edges of an example's images, m."""
    x = example["x_axis"]
    y = example["y_axis"]
    return float(x[0]), float(x[-1]), float(y[0]), float(y[-1])


def _dress(axes: Axes, example: Arrays, boxes: bool = False) -> None:
    """Mark mines, and the boxes if wanted, on an image."""
    x_min, x_max, y_min, y_max = _extent(example)
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
