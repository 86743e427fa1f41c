"""The seven figures of Cosgrove et al. 2004, from simulated lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from flgpr.scoring import pd_at
from flgpr_papers.cosgrove2004.findings import SOILS, Case, case_curve, example_means
from flgpr_papers.cosgrove2004.images import PointResponse, study_sensor
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.figures import decibels, show, subplots

_STYLE = {"HH": ("#c1440e", "--"), "VV": ("#1b5e9b", "-")}
_ZOOMED = 0.9  # Pd; a panel whose curves all lie above it is enlarged
_CURVES = {"deflection": "#1b1b1b", "PWF": "#1b5e9b", "HH": "#c1440e"}


def geometry(recipe: StudyRecipe) -> Figure:
    """Draw the collection geometry in plan and from the side (Fig. 1)."""
    sensor = study_sensor(recipe)
    tx, _ = sensor.pairs()
    far = recipe.radar.range
    x0, x1 = recipe.image.x
    y0, y1 = recipe.image.y
    figure, (plan, side) = subplots(9, 4.6, 2, 1, sharex=True, height_ratios=[2, 1])
    antennas = f"{len(tx)} positions of the antenna pair"
    plan.plot(tx[:, 1], tx[:, 0], ".", ms=3, color="#1b5e9b", label=antennas)
    image = Rectangle((y0, x0), y1 - y0, x1 - x0, fill=False, color="#1b1b1b", label="image")
    plan.add_patch(image)
    half = recipe.radar.stop_spacing / 2
    corner = far - half, x0
    searched = Rectangle(corner, 2 * half, x1 - x0, color="#ddd", label="boxes are taken here")
    plan.add_patch(searched)
    plan.plot([far], [0], "s", color="#c1440e", label="mine")
    plan.set(ylabel="cross-track (m)", ylim=(-3.5, 3.5))
    plan.legend(loc="upper left", fontsize=8, ncols=2)
    side.plot([0], [sensor.height], "o", color="#1b5e9b")
    side.plot([0, far], [sensor.height, 0], "-", lw=0.8, color="#1b5e9b")
    side.axhline(0, color="#8a6d3b")
    side.plot([far], [-0.1], "s", color="#c1440e")
    side.set(
        xlabel="down-track from the stop (m)",
        ylabel="height (m)",
        xlim=(-1, 20),
        ylim=(-0.8, sensor.height + 1),
    )
    return figure


def sample_image(image: xr.DataArray) -> Figure:
    """Show the HH image of three mines (Fig. 2)."""
    figure, axes = subplots(8.5, 4.2)
    x = image["x"].values
    y = image["y"].values
    magnitude = np.abs(image.sel(polarization="HH").values).astype(np.float64)
    level = decibels(magnitude / np.median(magnitude, axis=1, keepdims=True))
    shown = show(axes, level.T, (y[0], y[-1], x[0], x[-1]), 0, 25, cmap="gray")
    figure.colorbar(shown, ax=axes, label="dB over the median of the range", shrink=0.8)
    for at, (px, py) in enumerate(((-0.6, 15), (0.5, 20), (0.0, 25))):
        axes.add_patch(Rectangle((py - 0.5, px - 0.5), 1, 1, fill=False, color="#ffb347", lw=1))
        axes.text(py, px + 0.6, f"mine {at + 1}", color="#ffb347", ha="center", fontsize=8)
    axes.set(xlabel="down-track (m)", ylabel="cross-track (m)")
    return figure


def simulated_signature(offset: NDArray[np.float64], cuts: NDArray[np.complex64]) -> Figure:
    """Show range cuts through a mine without clutter (Fig. 3)."""
    figure, axes = subplots(6, 3.4)
    for name, cut in zip(("HH", "VV"), cuts, strict=True):
        colour, dash = _STYLE[name]
        level = np.abs(cut) / np.abs(cuts).max()
        axes.plot(offset, level, dash, color=colour, label=name)
    axes.set(
        xlabel="behind the mine's centre (m)", ylabel="magnitude", xlim=(-0.6, 1.0), ylim=(0, None)
    )
    axes.legend()
    return figure


def imaged_signatures(recipe: StudyRecipe, cuts: Sequence[Mapping[str, Any]]) -> Figure:
    """Show range cuts through three imaged mines, HH and VV back to back (Fig. 4)."""
    figure, axes = subplots(7, 3.6)
    for cut, style in zip(cuts, ("-", "--", ":"), strict=False):
        axes.plot(
            cut["magnitude"], style, color="#1b1b1b", label=f"{100 * cut['depth']:.0f} cm deep"
        )
    _stacked(axes, recipe)
    axes.set(xlabel="sample", ylabel="magnitude", ylim=(0, None))
    axes.legend(fontsize=8)
    return figure


def feature_vector(recipe: StudyRecipe, image: xr.DataArray) -> Figure:
    """Show how a feature vector is taken from the image (Fig. 5)."""
    figure, (hh, vv, vector) = subplots(9, 3.6, 1, 3, width_ratios=[1, 1, 2.2])
    y = image["y"].values
    length = recipe.cut.length
    stretch = image.isel(y=slice(int(np.searchsorted(y, 14.2)), int(np.searchsorted(y, 16.2))))
    power = (np.abs(stretch.values) ** 2).sum(axis=0)
    power = uniform_filter1d(power, length, axis=0)
    inner = power[length:-length, 30:-30]
    row, column = (int(k) for k in np.unravel_index(int(np.argmax(inner)), inner.shape))
    row, column = row + length, column + 30
    cuts = []
    for axes, name in ((hh, "HH"), (vv, "VV")):
        stack = np.abs(stretch.sel(polarization=name).values)
        x = stretch["x"].values
        down = stretch["y"].values
        extent = (x[0], x[-1], down[0], down[-1])
        top = float(np.abs(stretch.values).max())
        shown = show(axes, stack, extent, 0, top, cmap="gray", aspect="auto")
        axes.set(xlim=(x[column] - 0.8, x[column] + 0.8), xlabel="x (m)", title=name)
        low = row - length // 2
        height = down[low + length - 1] - down[low]
        axes.add_patch(
            Rectangle((x[column] - 0.03, down[low]), 0.06, height, fill=False, color="#ffb347")
        )
        cuts.append(stack[low : low + length, column])
    hh.set_ylabel("y (m)")
    figure.colorbar(shown, ax=[hh, vv], label="magnitude", shrink=0.8)
    vector.plot(np.concatenate(cuts), color="#1b1b1b")
    _stacked(vector, recipe)
    vector.set(xlabel="sample", ylabel="magnitude")
    return figure


def eigenvector_figure(recipe: StudyRecipe, case: Case) -> Figure:
    """Show the magnitudes of the first six eigenvectors of a lane (Fig. 6)."""
    magnitudes = np.array(case["eigenvectors"])
    ratios = np.array(case["ratios"])
    figure, grid = subplots(9, 4.6, 2, 3, sharex=True, sharey=True)
    for j, axes in enumerate(grid.ravel()):
        reached = j < len(magnitudes) and np.isfinite(ratios[j])
        if reached:
            axes.plot(magnitudes[j], color="#1b1b1b")
        axes.set_title(
            f"σ{j + 1}/σ1 = {ratios[j]:.3f}" if reached else "no example reaches it",
            fontsize=9,
            pad=14,
        )
        _stacked(axes, recipe)
    for axes in grid[1]:
        axes.set_xlabel("sample")
    for axes in grid[:, 0]:
        axes.set_ylabel("magnitude")
    return figure


def roc_figure(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> Figure:
    """Draw the ROC of deflection, PWF and HH on every soil (Fig. 7).

    The first seed's curve is drawn over the spread of all seeds.
    """
    soils = [soil for soil in SOILS if soil in cases]
    figure, row = subplots(9, 3.6, 1, len(soils), sharey=True, squeeze=False)
    names = {f"rank {recipe.detector.rank}": "deflection", "PWF": "PWF", "HH": "HH"}
    grid = np.logspace(-3, 0, 61)
    for axes, soil in zip(row[0], soils, strict=True):
        panels = [axes]
        all_curves = {
            label: [case_curve(case, name, recipe.score.box) for case in cases[soil]]
            for name, label in names.items()
        }
        means = [
            np.mean([pd_at(one, recipe.score.pfa) for one in of]) for of in all_curves.values()
        ]
        if min(means) > _ZOOMED:
            # All find nearly all: what is left of a difference is drawn larger.
            inset = axes.inset_axes((0.3, 0.3, 0.65, 0.4))
            inset.set(xscale="log", xlim=(1e-3, 1), ylim=(_ZOOMED, 1.005), title="enlarged")
            inset.title.set_fontsize(7)
            inset.tick_params(labelsize=7)
            panels.append(inset)
        # The later curves are narrower: those that coincide show beside each other.
        for (label, curves), width in zip(all_curves.items(), (3.2, 2.0, 1.0), strict=True):
            colour = _CURVES[label]
            pds = np.array([pd_at(curve, grid) for curve in curves])
            low, high = np.quantile(pds, [0.1, 0.9], axis=0)
            first = curves[0][curves[0]["far"] > 0]
            style = {"color": colour, "lw": width, "label": label, "drawstyle": "steps-post"}
            for panel in panels:
                panel.fill_between(grid, low, high, color=colour, alpha=0.15, lw=0)
                panel.plot(grid, pds.mean(axis=0), ":", color=colour, lw=1)
                panel.plot(first["far"], first["pd"], **style)
        axes.axvline(recipe.score.pfa, color="#999", lw=0.8)
        axes.set(
            xscale="log",
            xlim=(1e-3, 1),
            ylim=(0, 1.02),
            xlabel="P_FA per m²",
            title=recipe.sites[soil].title,
        )
    figure.axes[0].set_ylabel("Pd")
    figure.axes[0].legend(loc="lower right", fontsize=8)
    return figure


def point_figure(responses: Mapping[str, PointResponse]) -> Figure:
    """Draw the response to a point with and without the ramp."""
    figure, (down, cross) = subplots(9, 3.4, 1, 2, sharey=True)
    for (name, response), style in zip(responses.items(), ("-", "--"), strict=True):
        down_width, cross_width = response.resolution
        down_label = f"{name}: {100 * down_width:.1f} cm"
        cross_label = f"{name}: {100 * cross_width:.1f} cm"
        down.plot(response.down, decibels(response.down_level), style, label=down_label)
        cross.plot(response.cross, decibels(response.cross_level), style, label=cross_label)
    down.set(xlabel="down-track (m)", ylabel="dB", ylim=(-40, 1), xlim=(-0.6, 0.6))
    cross.set(xlabel="cross-track (m)", xlim=(-1, 1))
    for axes in (down, cross):
        axes.axhline(-3.01, color="#999", lw=0.8)
        axes.legend(fontsize=8)
    return figure


def examples_figure(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> Figure:
    """Draw mean Pd of deflection less that of Neyman-Pearson over the examples, by rank."""
    soils = [soil for soil in SOILS if soil in cases]
    figure, row = subplots(9, 3.6, 1, len(soils), sharex=True, sharey=True, squeeze=False)
    for axes, soil in zip(row[0], soils, strict=True):
        for place, rank in enumerate(recipe.sweeps.ranks):
            gaps = example_means(recipe, cases[soil], rank)
            # A little to the right of one another, so that the bars are told apart.
            numbers = [int(number) * 1.05 ** (place - 1) for number in gaps]
            value, low, high = np.array([*gaps.values()]).reshape(-1, 3).T
            label = f"M' = {rank}" + (" (all)" if rank == recipe.sweeps.ranks[-1] else "")
            bars = np.nan_to_num([value - low, high - value], posinf=0.0)
            axes.errorbar(numbers, value, bars, capsize=2, label=label)
        axes.axhline(0, color="#999", lw=0.8)
        axes.set(xscale="log", xlabel="examples", title=recipe.sites[soil].title)
        ticks = recipe.sweeps.numbers
        axes.set_xticks(ticks, [str(number) for number in ticks])
        axes.minorticks_off()
    figure.axes[0].set_ylabel("mean Pd: deflection\nless Neyman-Pearson")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def depth_figure(recipe: StudyRecipe, cases: Mapping[str, Sequence[Case]]) -> Figure:
    """Draw Pd at the study's P_FA over depth, all seeds pooled."""
    figure, axes = subplots(6, 3.4)
    name = f"rank {recipe.detector.rank}"
    for site, marker in zip(cases, "os^D", strict=False):
        detected: dict[float, list[bool]] = {}
        for case in cases[site]:
            curve = case_curve(case, name, recipe.score.box)
            is_allowed = curve["far"].to_numpy() <= recipe.score.pfa
            threshold = curve["threshold"].to_numpy()[is_allowed].min()
            peaks = case["peaks"][name]
            for depth, value in zip(peaks["depth"], peaks["target"], strict=True):
                detected.setdefault(depth, []).append(value >= threshold)
        depths = sorted(detected)
        depths_cm = [100 * depth for depth in depths]
        pds = [np.mean(detected[depth]) for depth in depths]
        axes.plot(depths_cm, pds, marker + "-", label=recipe.sites[site].title)
    axes.set(xlabel="depth (cm)", ylabel=f"Pd at {recipe.score.pfa:g} per m²", ylim=(0, 1.02))
    axes.legend(fontsize=8)
    return figure


def _stacked(axes: Axes, recipe: StudyRecipe) -> None:
    """Label the polarizations of a feature vector and separate them."""
    length = recipe.cut.length
    axes.axvline(length - 0.5, color="#999", lw=0.8)
    for k, name in enumerate(recipe.cut.polarizations):
        transform = axes.get_xaxis_transform()
        axes.text(
            (k + 0.5) * length,
            1.01,
            name,
            ha="center",
            va="bottom",
            color="#666",
            fontsize=8,
            transform=transform,
        )
    axes.set(xlim=(0, length * len(recipe.cut.polarizations) - 1))
