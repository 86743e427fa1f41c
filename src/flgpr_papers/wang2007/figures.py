"""The figures of Wang et al. 2007, drawn from simulated lanes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from flgpr.chain.recipe import Recipe
from flgpr.detect import HistogramNormalizer
from flgpr.model import Sensor
from flgpr.scoring import Match, random_pd, roc_of
from flgpr_papers.wang2007.analysis import AREA, LaneResult

_DB = 30.0
_POLARIZATIONS = ("HH", "VV", "HV")
_BANDS = ("F0", "F1", "F2", "F3", "F4")
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")
Examples = Mapping[str, NDArray[Any]]


def geometry_figure(sensor: Sensor, recipe: Recipe) -> Figure:
    """Fig. 1: the radar and the imaged area, from the side and from above."""
    figure, (side, plan) = _figure(9, 3.2, 1, 2)
    image = recipe.image
    height = sensor.height
    side.plot(0, height, "s", color="k")
    for y in image.y:
        side.plot([0, y], [height, 0], color="#888888", lw=0.8)
    length = 6.0
    side.annotate(
        "",
        (length * np.cos(sensor.tilt), height - length * np.sin(sensor.tilt)),
        (0, height),
        arrowprops={"arrowstyle": "->"},
    )
    side.plot(image.y, [0, 0], lw=4, color="#0072b2")
    side.set(
        xlabel="ahead (m)",
        ylabel="height (m)",
        title=f"tilt {np.degrees(sensor.tilt):.0f}°",
        ylim=(-0.5, height + 1),
    )
    plan.add_patch(
        Rectangle(
            (image.y[0], image.x[0]), np.ptp(image.y), np.ptp(image.x), fc="#cfe3f2", ec="#0072b2"
        )
    )
    for style, positions in (("v", sensor.tx), ("|", sensor.rx)):
        plan.plot(*np.asarray(positions)[:, [1, 0]].T, style, color="k", ms=7)
    plan.axhline(-1.5, color="#888888", lw=0.8)
    plan.axhline(1.5, color="#888888", lw=0.8)
    plan.set(
        xlabel="ahead (m)",
        ylabel="cross-track (m)",
        title="2 transmitters, 18 receivers, imaged area",
        aspect="equal",
    )
    return figure


def polarization_figure(examples: Examples) -> Figure:
    """Fig. 2: one scan in three polarizations, sub-band F0."""
    figure, axes = _figure(7, 3.7, 1, 3)
    for axis, pol in zip(axes, _POLARIZATIONS, strict=True):
        _scan(
            axis,
            examples["raw_surface"][_at(examples, pol, "F0")],
            examples,
            examples["place_surface"],
            f"{pol}, F0",
        )
    _scan_axes(figure, axes)
    return figure


def subband_figure(examples: Examples) -> Figure:
    """Fig. 3: one scan in five sub-bands, VV."""
    figure, axes = _figure(8, 3.1, 1, 5)
    for axis, band in zip(axes, _BANDS, strict=True):
        image = examples["raw_surface"][_at(examples, "VV", band)]
        _scan(axis, image, examples, examples["place_surface"], f"VV, {band}")
    _scan_axes(figure, axes)
    return figure


def series_figure(examples: Examples) -> Figure:
    """Fig. 4: five consecutive scans, HH, F1: the mine moves, the self-signature stays.

    All share one scale. Its top is the largest of the median over the scans, which holds what stays
    in place: on a scale that reaches up to the mines themselves it would hardly be seen.
    """
    figure, axes = _figure(8, 3.1, 1, 5)
    top = float(_decibel(np.median(examples["series"], axis=0)).max())
    for k, axis in enumerate(axes):
        _scan(
            axis,
            examples["series"][k],
            examples,
            examples["series_place"][k],
            f"scan {k + 1}",
            top=top,
        )
    _scan_axes(figure, axes, "dB below the largest of what stays")
    return figure


def background_figure(examples: Examples) -> Figure:
    """Fig. 5: background removal and normalisation, HH, F1."""
    figure, axes = _figure(8, 3.1, 1, 5)
    channel = _at(examples, "HH", "F1")
    position = examples["place_surface"]
    clean = examples["clean_surface"][channel]
    panels = (
        (examples["raw_surface"][channel], "(a) scan"),
        (examples["signature"], "(b) self-signature"),
        (clean * examples["gain"], "(c) less (b)"),
        (examples["gain"], "(d) gain background"),
        (clean, "(e) (c) over (d)"),
    )
    for axis, (image, title) in zip(axes, panels, strict=True):
        _scan(axis, image, examples, position, title)
    _scan_axes(figure, axes)
    return figure


def run_view_figure(result: LaneResult, alarms: bool, length: float = 60.0) -> Figure:
    """Fig. 6 and 7: 60 m of a calibration lane in pieces of 15 m, with targets or with alarms."""
    view = result.view.sel(polarization="HH", subband="F1")
    start = result.lane.y_min
    figure, axes = _figure(6.5, 4.2, 1, 4)
    top = 20 * np.log10(np.nanpercentile(view.values, 99.9))
    for k, axis in enumerate(axes):
        low, high = start + k * length / 4, start + (k + 1) * length / 4
        piece = view.sel(y=slice(low, high))
        if not piece.sizes["y"]:
            axis.set_visible(False)
            continue
        extent = (float(view.x[0]), float(view.x[-1]), float(piece.y[0]), float(piece.y[-1]))
        axis.imshow(
            _decibel(piece.values) - top,
            origin="lower",
            extent=extent,
            vmin=-_DB,
            vmax=0,
            cmap="gray_r",
        )
        for x in (result.lane.x_min, result.lane.x_max):
            axis.axvline(x, color="#0072b2", lw=0.8)
        table, radius = (result.alarms, 0.25) if alarms else (result.truth, 0.6)
        for x, y in table.loc[table["y"].between(low, high), ["x", "y"]].to_numpy():
            axis.add_patch(Circle((x, y), radius, fill=False, color="#d55e00", lw=1.2))
        axis.set(xlabel="x (m)", ylabel="y (m)" if k == 0 else "")
    _colour_bar(figure, axes, "dB below the brightest thousandth")
    return figure


def clean_bands_figure(examples: Examples) -> Figure:
    """Fig. 8.

    Cleaned scan images in five sub-bands, VV over a metal mine and HH over a plastic one.
    """
    figure, axes = _figure(8, 5.0, 2, 5)
    for row, (name, pol) in zip(axes, (("metal", "VV"), ("plastic", "HH")), strict=True):
        for axis, band in zip(row, _BANDS, strict=True):
            image = examples[f"clean_{name}"][_at(examples, pol, band)]
            _scan(
                axis, image, examples, examples[f"place_{name}"], f"{pol}, {band}", (-3, 3), (8, 16)
            )
    _scan_axes(figure, axes)
    return figure


def prescreener_figure(matches: Mapping[tuple[str, str], Match], mines: Any) -> Figure:
    """Fig. 9: ROC of the prescreener for every polarization and sub-band."""
    figure, axes = _figure(9, 3.4, 1, 3)
    for axis, pol in zip(axes, _POLARIZATIONS, strict=True):
        for colour, band in zip(_COLOURS, ("F1", "F2", "F3", "F4", "F0"), strict=True):
            _step(
                axis,
                roc_of(matches[pol, band], mines, area=AREA),
                band,
                colour,
                ":" if band == "F0" else "-",
            )
        _roc_axes(axis, pol, 0.3)
    return figure


def patch_figure(examples: Examples) -> Figure:
    """Fig. 10: incoherent patches of three hits and a false alarm."""
    names = ("surface", "shallow", "plastic", "false")
    titles = dict(zip(examples["names"], examples["titles"], strict=True))
    figure = Figure(figsize=(9, 6.6), layout="constrained")
    axes = figure.subplots(1, 4, width_ratios=[len(examples[f"patches_{name}"]) for name in names])
    for axis, letter, name in zip(axes, "abcd", names, strict=True):
        title = f"({letter}) {titles[name]}"
        patches = examples[f"patches_{name}"]
        order = [_at(examples, pol, band) for pol in _POLARIZATIONS for band in _BANDS[1:]]
        # As in the scan images, far is up.
        scaled = []
        for channel in order:
            framed = [np.pad(np.nan_to_num(patch[channel][::-1]), 1) for patch in patches]
            row = np.hstack(framed)
            scaled.append(row / np.nanmax(row))
        axis.imshow(np.vstack(scaled), cmap="gray", vmin=0, vmax=1, aspect="equal")
        size = scaled[0].shape[0]
        labels = [f"{pol} {band}" for pol in _POLARIZATIONS for band in _BANDS[1:]]
        axis.set_yticks((np.arange(len(labels)) + 0.5) * size, labels, fontsize=7)
        axis.set_xticks(
            (np.arange(len(patches)) + 0.5) * size,
            [f"{d:.0f}" for d in examples[f"distances_{name}"]],
            fontsize=7,
        )
        axis.set_title(title, fontsize=8)
        axis.set_xlabel("distance (m)", fontsize=8)
    _colour_bar(figure, axes, "magnitude over the row's largest")
    return figure


def region_figure(recipe: Recipe) -> Figure:
    """Fig. 11: regions of an incoherent patch."""
    patch = recipe.contrast.patch()
    codes = np.where(patch.region(patch.guard), 1, 2) - patch.region(patch.inner)
    figure, axis = _figure(3.4, 3.4, 1, 1)
    axis.pcolormesh(codes, cmap="Blues", edgecolors="white", linewidth=0.4)
    axis.set(aspect="equal", xlabel="cross-track", ylabel="down-track", xticks=[], yticks=[])
    axis.set_title("white: inner, middle: guard, dark: outer", fontsize=8)
    return figure


def normalisation_figure(values: NDArray[np.float64], weight: NDArray[np.int64]) -> Figure:
    """Fig. 12: histogram of M_HH before and after duplication and after normalisation."""
    figure, axes = _figure(9, 2.8, 1, 3)
    normal = (
        HistogramNormalizer()
        .fit(values[:, None], sample_weight=weight)
        .transform(values[:, None])[:, 0]
    )
    titles = ("(a) alarms", "(b) with duplication", "(c) normalised")
    for axis, data, w, title in zip(
        axes, (values, values, normal), (np.ones_like(weight), weight, weight), titles, strict=True
    ):
        axis.hist(data, bins=40, weights=w, color="#0072b2")
        axis.set_title(title, fontsize=9)
        axis.set_xlabel("M_HH", fontsize=8)
    return figure


Band = tuple[NDArray[np.float64], NDArray[np.float64]]
BAND_FAR = np.linspace(0, 0.1, 51)
"""False alarm rates at which bands are drawn, per m²."""


def classifier_figure(
    panels: Mapping[str, Mapping[str, Match]],
    subsets: Mapping[str, Any],
    bands: Mapping[str, Band] | None = None,
) -> Figure:
    """Fig. 13 and 14: ROC of classifiers by data set.

    ``bands`` add those of one as it is and trained anew.
    """
    shown = dict(bands or {})
    columns = len(panels)
    rows = 1 + -(-len(shown) // columns)
    figure, grid = _figure(4.4 * columns, 3.6 * rows, rows, columns)
    axes = np.ravel(grid)
    last = list(next(iter(panels.values())).items())[-1]
    for axis, (kind, (trained, anew)), colour in zip(
        axes[columns:], shown.items(), _COLOURS, strict=False
    ):
        axis.fill_between(
            BAND_FAR,
            *anew,
            color=colour,
            alpha=0.15,
            lw=0,
            label="95 %, trained anew in every draw",
        )
        axis.fill_between(
            BAND_FAR, *trained, color=colour, alpha=0.3, lw=0, label="95 %, as trained"
        )
        _step(axis, roc_of(last[1], subsets[kind], area=AREA), f"{last[0]}, {kind}", colour, "-")
        _roc_axes(axis, f"{kind} mines with bands", 0.1)
    for axis, (title, matches) in zip(axes, panels.items(), strict=False):
        for colour, (name, match) in zip(_COLOURS, matches.items(), strict=False):
            for dash, (kind, subset) in zip(("-", "--"), subsets.items(), strict=False):
                _step(axis, roc_of(match, subset, area=AREA), f"{name}, {kind}", colour, dash)
        _roc_axes(axis, title, 0.1)
    return figure


def _figure(width: float, height: float, rows: int, columns: int) -> tuple[Figure, Any]:
    """Return a figure of so many inches, and its panels."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns)


def _at(examples: Examples, polarization: str, subband: str) -> tuple[int, int]:
    """Return the indices of a polarization and a sub-band."""
    return list(examples["polarization"]).index(polarization), list(examples["subband"]).index(
        subband
    )


def _decibel(image: NDArray[Any]) -> NDArray[np.float64]:
    """Return an image in dB, at least -240."""
    return np.asarray(
        20 * np.log10(np.maximum(np.nan_to_num(np.asarray(image, np.float64)), 1e-12))
    )


def _scan(
    axis: Axes,
    image: NDArray[Any],
    examples: Examples,
    position: NDArray[np.float64],
    title: str,
    x: tuple[float, float] | None = None,
    y: tuple[float, float] | None = None,
    top: float | None = None,
) -> None:
    """Draw a scan image in dB below ``top``, by default the largest level of what is shown."""
    values = _decibel(image)
    extent = (examples["x"][0], examples["x"][-1], examples["y"][0], examples["y"][-1])
    if top is None:
        top = values.max()
    if x and y:
        rows, columns = (
            np.abs(examples[n] - sum(lim) / 2) <= np.ptp(lim) / 2 for n, lim in (("y", y), ("x", x))
        )
        top = values[np.ix_(rows, columns)].max()
    axis.imshow(
        values - top,
        origin="lower",
        extent=extent,
        vmin=-_DB,
        vmax=0,
        cmap="gray_r",
        aspect="equal",
    )
    axis.add_patch(
        Circle((float(position[0]), float(position[1])), 1.0, fill=False, color="#d55e00", lw=1.0)
    )
    axis.set(xlim=x, ylim=y)
    axis.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
    axis.set_title(title, fontsize=9)
    axis.tick_params(labelsize=7)


def _scan_axes(figure: Figure, axes: Any, label: str = "dB below the image's largest") -> None:
    """Name the axes of scan images at the figure's edges, and add the bar of their common scale."""
    grid = np.atleast_2d(axes)
    for axis in grid[-1]:
        axis.set_xlabel("cross-track (m)", fontsize=8)
    for axis in grid[:, 0]:
        axis.set_ylabel("down-track (m)", fontsize=8)
    _colour_bar(figure, axes, label)


def _colour_bar(figure: Figure, axes: Any, label: str) -> None:
    """Add one colour bar for all panels, which share their scale."""
    shown = [axis for axis in np.ravel(axes) if axis.get_visible()]
    bar = figure.colorbar(shown[0].images[0], ax=list(np.ravel(axes)), shrink=0.8, pad=0.01)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7)


def _step(axis: Axes, curve: pd.DataFrame, label: str, colour: str, dash: str) -> None:
    """Draw a ROC as steps."""
    axis.step(curve["far"], curve["pd"], where="post", label=label, color=colour, ls=dash, lw=1.3)


def _roc_axes(axis: Axes, title: str, far_max: float) -> None:
    """Draw chance and label the axes of a ROC."""
    rates = np.linspace(0, far_max, 101)
    axis.plot(rates, random_pd(rates, 1.0), color="0.5", ls=":", lw=1, label="chance")
    axis.set(xlim=(0, far_max), ylim=(0, 1.02), xlabel="FAR (per m²)", ylabel="Pd")
    axis.set_title(title, fontsize=10)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
