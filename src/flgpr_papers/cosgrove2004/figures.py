"""The seven figures of Cosgrove et al. 2004, from simulated lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from scipy.ndimage import uniform_filter1d

from flgpr.scoring import pd_at
from flgpr.types import Entries, floats
from flgpr_papers.cosgrove2004.findings import Case, case_curve, example_means, found_looks
from flgpr_papers.cosgrove2004.images import (
    WIDE_MINES,
    PointResponse,
    signature_cuts,
    study_sensor,
)
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.figures import Figures, Panels, colour_bar, decibels, show

_figure = Figures("cosgrove2004")
_STYLE = {"HH": ("#c1440e", "--"), "VV": ("#1b5e9b", "-")}
_ZOOMED = 0.9  # Pd; a panel whose curves all lie above it is enlarged
_CURVES = {"deflection": "#1b1b1b", "PWF": "#1b5e9b", "HH": "#c1440e"}


@dataclass(frozen=True)
class Measured:
    """What the study has measured, for its figures."""

    recipe: StudyRecipe  #: the study
    #: cases of every seed by surroundings and site
    cases: Mapping[str, Mapping[str, Sequence[Case]]]
    responses: Mapping[str, PointResponse]  #: to a point, with and without the ramp
    image: xr.DataArray  #: of three mines in dry sand, first seed


def _columns(measured: Measured, _: str) -> Entries:
    """Return a column of panels for every soil."""
    return {"columns": len(measured.recipe.soils)}


@_figure
def geometry(panels: Panels, measured: Measured) -> None:
    """Draw the collection geometry in plan and from the side (Fig. 1)."""
    plan, side = panels
    recipe = measured.recipe
    sensor = study_sensor(recipe)
    tx, _ = sensor.pairs()
    far = recipe.radar.range
    x0, x1 = recipe.image.x
    y0, y1 = recipe.image.y
    antennas = f"{len(tx)} positions of the antenna pair"
    plan.plot(tx[:, 1], tx[:, 0], ".", ms=3, color="#1b5e9b", label=antennas)
    image = Rectangle((y0, x0), y1 - y0, x1 - x0, fill=False, color="#1b1b1b", label="image")
    plan.add_patch(image)
    width = recipe.radar.stop_spacing
    corner = far - width / 2, x0
    searched = Rectangle(corner, width, x1 - x0, color="#ddd", label="boxes are taken here")
    plan.add_patch(searched)
    plan.plot([far], [0], "s", color="#c1440e", label="mine")
    side.plot([0], [sensor.height], "o", color="#1b5e9b")
    side.plot([0, far], [sensor.height, 0], "-", lw=0.8, color="#1b5e9b")
    side.axhline(0, color="#8a6d3b")
    side.plot([far], [-0.1], "s", color="#c1440e")
    side.set_ylim(-0.8, sensor.height + 1)


@_figure
def sample_image(axes: Axes, measured: Measured) -> None:
    """Show the HH image of three mines (Fig. 2)."""
    image = measured.image
    x = image["x"].values
    y = image["y"].values
    magnitude = floats(np.abs(image.sel(polarization="HH").values))
    level = decibels(magnitude / np.median(magnitude, axis=1, keepdims=True))
    shown = show(axes, level.T, y, x, 0, 25, cmap="gray")
    colour_bar(axes, shown, "dB over the median of the range", shrink=0.8)
    for number, (px, py) in enumerate(WIDE_MINES, start=1):
        axes.add_patch(Rectangle((py - 0.5, px - 0.5), 1, 1, fill=False, color="#ffb347", lw=1))
        axes.text(py, px + 0.6, f"mine {number}", color="#ffb347", ha="center", fontsize=8)


@_figure
def simulated_signature(axes: Axes, measured: Measured) -> None:
    """Show range cuts through a mine without clutter (Fig. 3)."""
    offset, cuts = signature_cuts(measured.recipe)
    for (name, (colour, dash)), cut in zip(_STYLE.items(), cuts, strict=True):
        axes.plot(offset, np.abs(cut) / np.abs(cuts).max(), dash, color=colour, label=name)


@_figure
def imaged_signatures(axes: Axes, measured: Measured, name: str) -> None:
    """Show range cuts through three imaged mines, HH and VV back to back (Fig. 4)."""
    cuts = measured.cases[name]["sand"][0]["cuts"]
    for cut, style in zip(cuts, ("-", "--", ":"), strict=False):
        label = f"{100 * cut['depth']:.0f} cm deep"
        axes.plot(cut["magnitude"], style, color="#1b1b1b", label=label)
    _stacked(axes, measured.recipe)


@_figure
def feature_vector(panels: Panels, measured: Measured) -> None:
    """Show how a feature vector is taken from the image (Fig. 5)."""
    *pair, vector = panels
    image = measured.image
    length = measured.recipe.cut.length
    first, last = np.searchsorted(image["y"].values, (14.2, 16.2))
    stretch = image.isel(y=slice(first, last))
    stretch = stretch.copy(data=np.abs(stretch.values))
    power = uniform_filter1d((stretch.values**2).sum(axis=0), length, axis=0)
    inner = power[length:-length, 30:-30]
    row, column = (int(k) for k in np.unravel_index(int(np.argmax(inner)), inner.shape))
    low, column = row + length - length // 2, column + 30
    x = stretch["x"].values
    down = stretch["y"].values
    height = down[low + length - 1] - down[low]
    cuts = []
    for axes, name in zip(pair, ("HH", "VV"), strict=True):
        stack = stretch.sel(polarization=name).values
        shown = show(axes, stack, x, down, 0, float(stretch.max()), cmap="gray", aspect="auto")
        axes.set_xlim(x[column] - 0.8, x[column] + 0.8)
        corner = x[column] - 0.03, down[low]
        axes.add_patch(Rectangle(corner, 0.06, height, fill=False, color="#ffb347"))
        cuts.append(stack[low : low + length, column])
    colour_bar(pair, shown, "magnitude", shrink=0.8)
    vector.plot(np.concatenate(cuts), color="#1b1b1b")
    _stacked(vector, measured.recipe)


@_figure
def eigenvector_figure(panels: Panels, measured: Measured, name: str) -> None:
    """Show the magnitudes of the first six eigenvectors of a lane (Fig. 6)."""
    case = measured.cases[name]["sand"][0]
    magnitudes = np.array(case["eigenvectors"])
    ratios = np.array(case["ratios"])
    for j, axes in enumerate(panels.ravel()):
        title = "no example reaches it"
        if j < len(magnitudes) and np.isfinite(ratios[j]):
            axes.plot(magnitudes[j], color="#1b1b1b")
            title = f"σ{j + 1}/σ1 = {ratios[j]:.3f}"
        axes.set_title(title, fontsize=9, pad=14)
        _stacked(axes, measured.recipe)


@_figure.sized(_columns)
def roc_figure(panels: Panels, measured: Measured, name: str) -> None:
    """Draw the ROC of deflection, PWF and HH on every soil (Fig. 7).

    The first seed's curve is drawn over the spread of all seeds.
    """
    recipe, cases = measured.recipe, measured.cases[name]
    names = {"deflection": recipe.main, "PWF": "PWF", "HH": "HH"}
    grid = np.logspace(-3, 0, 61)
    for axes, (soil, title) in zip(panels[0], recipe.soils.items(), strict=True):
        both = [axes]
        all_curves = {
            label: [case_curve(case, detector, recipe.score.box) for case in cases[soil]]
            for label, detector in names.items()
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
            both.append(inset)
        # The later curves are narrower: those that coincide show beside each other.
        for (label, curves), width in zip(all_curves.items(), (3.2, 2.0, 1.0), strict=True):
            colour = _CURVES[label]
            pds = np.array([pd_at(curve, grid) for curve in curves])
            low, high = np.quantile(pds, [0.1, 0.9], axis=0)
            first = curves[0][curves[0]["far"] > 0]
            style = {"color": colour, "lw": width, "label": label, "drawstyle": "steps-post"}
            for panel in both:
                panel.fill_between(grid, low, high, color=colour, alpha=0.15, lw=0)
                panel.plot(grid, pds.mean(axis=0), ":", color=colour, lw=1)
                panel.plot(first["far"], first["pd"], **style)
        axes.axvline(recipe.score.pfa, color="#999", lw=0.8)
        axes.set_title(title)


@_figure
def point_figure(panels: Panels, measured: Measured) -> None:
    """Draw the response to a point with and without the ramp."""
    responses = measured.responses
    for (name, response), style in zip(responses.items(), ("-", "--"), strict=True):
        levels = response.down, response.cross
        for axes, level, width in zip(panels, levels, response.resolution, strict=True):
            label = f"{name}: {100 * width:.1f} cm"
            axes.plot(response.offset, decibels(level), style, label=label)
    for axes in panels:
        axes.axhline(-3.01, color="#999", lw=0.8)


@_figure.sized(_columns)
def examples_figure(panels: Panels, measured: Measured, name: str) -> None:
    """Draw mean Pd of deflection less that of Neyman-Pearson over the examples, by rank."""
    recipe, cases = measured.recipe, measured.cases[name]
    ticks = recipe.sweeps.numbers
    for axes, (soil, title) in zip(panels[0], recipe.soils.items(), strict=True):
        for place, rank in enumerate(recipe.sweeps.ranks):
            gaps = example_means(recipe, cases[soil], rank)
            # A little to the right of one another, so that the bars are told apart.
            numbers = [int(number) * 1.05 ** (place - 1) for number in gaps]
            value, low, high = np.array([*gaps.values()]).reshape(-1, 3).T
            label = f"M' = {rank}" + (" (all)" if rank == recipe.sweeps.ranks[-1] else "")
            bars = np.nan_to_num([value - low, high - value], posinf=0.0)
            axes.errorbar(numbers, value, bars, capsize=2, label=label)
        axes.axhline(0, color="#999", lw=0.8)
        axes.set(xscale="log", title=title)
        axes.set_xticks(ticks, list(map(str, ticks)))
        axes.minorticks_off()
    labels = panels[0, 0].get_legend_handles_labels()
    panels[0, 0].figure.legend(*labels, loc="outside lower center", ncols=4)


@_figure
def depth_figure(axes: Axes, measured: Measured, name: str) -> None:
    """Draw Pd at the study's P_FA over depth, all seeds pooled."""
    recipe, cases = measured.recipe, measured.cases[name]
    for site, marker in zip(cases, "os^D", strict=False):
        tables = []
        for case, found in zip(
            cases[site], found_looks(recipe, cases[site], recipe.main), strict=True
        ):
            depths = case["peaks"][recipe.main]["depth"]
            tables.append(pd.DataFrame({"cm": 100 * np.array(depths), "found": found}))
        pds = pd.concat(tables).groupby("cm")["found"].mean()
        axes.plot(pds.index, pds, marker + "-", label=recipe.sites[site].title)
    axes.set_ylabel(f"Pd at {recipe.score.pfa:g} per m²")


def _stacked(axes: Axes, recipe: StudyRecipe) -> None:
    """Label the polarizations of a feature vector and separate them."""
    length = recipe.cut.length
    axes.axvline(length - 0.5, color="#999", lw=0.8)
    style: Entries = {"ha": "center", "va": "bottom", "color": "#666", "fontsize": 8}
    for k, name in enumerate(recipe.cut.polarizations):
        axes.text((k + 0.5) * length, 1.01, name, transform=axes.get_xaxis_transform(), **style)
    axes.set(xlim=(0, length * len(recipe.cut.polarizations) - 1))
