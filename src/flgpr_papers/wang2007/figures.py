"""The figures of Wang et al. 2007, drawn from simulated lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from flgpr.detect import HistogramNormalizer
from flgpr.method.classifier import make_training_set
from flgpr.model import Sensor
from flgpr.recipe.schema import Recipe
from flgpr.scoring import Match, random_pd, roc_of
from flgpr_papers.kit.figures import decibels, show, subplots
from flgpr_papers.wang2007.analysis import AREA, BANDS, MINES, POLARIZATIONS, LaneResult

_DB = 30.0
_LEAST = 1e-12
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")
Examples = Mapping[str, NDArray[Any]]


def geometry_figure(sensor: Sensor, recipe: Recipe) -> Figure:
    """Draw Fig. 1: the radar and the imaged area, from the side and from above."""
    figure, (side, plan) = subplots(9, 3.2, 1, 2)
    image = recipe.image
    height = sensor.height
    side.plot(0, height, "s", color="k")
    for y in image.y:
        side.plot([0, y], [height, 0], color="#888888", lw=0.8)
    length = 6.0
    arrow_end = length * np.cos(sensor.tilt), height - length * np.sin(sensor.tilt)
    side.annotate("", arrow_end, (0, height), arrowprops={"arrowstyle": "->"})
    side.plot(image.y, [0, 0], lw=4, color="#0072b2")
    side.set(
        xlabel="ahead (m)",
        ylabel="height (m)",
        title=f"tilt {np.degrees(sensor.tilt):.0f}°",
        ylim=(-0.5, height + 1),
    )
    corner = image.y[0], image.x[0]
    imaged = Rectangle(corner, np.ptp(image.y), np.ptp(image.x), fc="#cfe3f2", ec="#0072b2")
    plan.add_patch(imaged)
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
    """Draw Fig. 2: one scan in three polarizations, sub-band F0."""
    figure, axes = subplots(7, 3.7, 1, 3)
    position = examples["place_surface"]
    for axis, polarization in zip(axes, POLARIZATIONS, strict=True):
        image = examples["raw_surface"][_at(examples, polarization, "F0")]
        _scan(axis, image, examples, position, f"{polarization}, F0")
    _scan_axes(figure, axes)
    return figure


def subband_figure(examples: Examples) -> Figure:
    """Draw Fig. 3: one scan in five sub-bands, VV."""
    figure, axes = subplots(8, 3.1, 1, 5)
    for axis, band in zip(axes, BANDS, strict=True):
        image = examples["raw_surface"][_at(examples, "VV", band)]
        _scan(axis, image, examples, examples["place_surface"], f"VV, {band}")
    _scan_axes(figure, axes)
    return figure


def series_figure(examples: Examples) -> Figure:
    """Draw Fig. 4: five consecutive scans, HH, F1: the mine moves, the self-signature stays.

    All share one scale. Its top is the largest of the median over the scans, which holds what stays
    in place: on a scale that reaches up to the mines themselves it would hardly be seen.
    """
    figure, axes = subplots(8, 3.1, 1, 5)
    top = float(decibels(np.median(examples["series"], axis=0), _LEAST).max())
    for k, axis in enumerate(axes):
        image = examples["series"][k]
        position = examples["series_place"][k]
        _scan(axis, image, examples, position, f"scan {k + 1}", top=top)
    _scan_axes(figure, axes, "dB below the largest of what stays")
    return figure


def background_figure(examples: Examples) -> Figure:
    """Draw Fig. 5: background removal and normalisation, HH, F1."""
    figure, axes = subplots(8, 3.1, 1, 5)
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
    """Draw Fig. 6 or 7: 60 m of a calibration lane in pieces of 15 m, with targets or alarms.

    Parameters
    ----------
    result : LaneResult
        The lane.
    alarms : bool
        Whether alarms are marked, or targets.
    length : float
        Length of lane that is shown, m.
    """
    view = result.view.sel(polarization="HH", subband="F1")
    x_extent = float(view.x[0]), float(view.x[-1])
    start = result.lane.y_min
    top = 20 * np.log10(np.nanpercentile(view.values, 99.9))
    marked = result.alarms if alarms else result.truth
    radius = 0.25 if alarms else 0.6
    figure, axes = subplots(6.5, 4.2, 1, 4)
    for k, axis in enumerate(axes):
        low = start + k * length / 4
        high = start + (k + 1) * length / 4
        piece = view.sel(y=slice(low, high))
        if not piece.sizes["y"]:
            axis.set_visible(False)
            continue
        extent = (*x_extent, piece.y[0], piece.y[-1])
        show(axis, decibels(piece.values, _LEAST) - top, extent, -_DB, 0, cmap="gray_r")
        for border in (result.lane.x_min, result.lane.x_max):
            axis.axvline(border, color="#0072b2", lw=0.8)
        in_piece = marked["y"].between(low, high)
        for x, y in marked.loc[in_piece, ["x", "y"]].to_numpy():
            axis.add_patch(Circle((x, y), radius, fill=False, color="#d55e00", lw=1.2))
        axis.set(xlabel="x (m)", ylabel="y (m)" if k == 0 else "")
    _colour_bar(figure, axes, "dB below the brightest thousandth")
    return figure


def clean_bands_figure(examples: Examples) -> Figure:
    """Draw Fig. 8: cleaned scans in five sub-bands, VV of a metal mine and HH of a plastic one."""
    figure, axes = subplots(8, 5.0, 2, 5)
    for row, (name, polarization) in zip(axes, (("metal", "VV"), ("plastic", "HH")), strict=True):
        position = examples[f"place_{name}"]
        for axis, band in zip(row, BANDS, strict=True):
            image = examples[f"clean_{name}"][_at(examples, polarization, band)]
            title = f"{polarization}, {band}"
            _scan(axis, image, examples, position, title, (-3, 3), (8, 16))
    _scan_axes(figure, axes)
    return figure


def prescreener_figure(
    pooled: Mapping[tuple[str, str], Match], one_run: Mapping[tuple[str, str], Match]
) -> Figure:
    """Draw Fig. 9: ROC of the prescreener by polarization and sub-band, of one run over all runs."""
    figure, axes = subplots(9, 3.4, 1, 3)
    for axis, polarization in zip(axes, POLARIZATIONS, strict=True):
        for colour, band in zip(_COLOURS, ("F1", "F2", "F3", "F4", "F0"), strict=True):
            all_runs = roc_of(pooled[polarization, band], MINES, area=AREA)
            axis.step(all_runs["far"], all_runs["pd"], where="post", color=colour, alpha=0.3, lw=1)
            curve = roc_of(one_run[polarization, band], MINES, area=AREA)
            _step(axis, curve, band, colour, ":" if band == "F0" else "-")
        _roc_axes(axis, polarization, 0.3)
    return figure


def patch_figure(examples: Examples) -> Figure:
    """Draw Fig. 10: incoherent patches of three hits and a false alarm."""
    names = ("surface", "shallow", "plastic", "false")
    titles = dict(zip(examples["names"], examples["titles"], strict=True))
    channels = {}
    for polarization in POLARIZATIONS:
        for band in BANDS[1:]:
            channels[f"{polarization} {band}"] = _at(examples, polarization, band)
    widths = [len(examples[f"patches_{name}"]) for name in names]
    figure, axes = subplots(9, 6.8, 1, 4, width_ratios=widths)
    # One scale: that HV is weak, and that a false alarm is, is what the figure shows.
    top = max(1.0, *(decibels(examples[f"patches_{name}"]).max() for name in names))
    shades = mpl.colormaps["gray"].with_extremes(bad="#3b6ea5")
    for axis, letter, name in zip(axes, "abcd", names, strict=True):
        patches = examples[f"patches_{name}"]
        rows = [_patch_row(patches, channel) for channel in channels.values()]
        axis.imshow(np.vstack(rows), cmap=shades, vmin=0, vmax=top, aspect="equal")
        size = rows[0].shape[0]
        row_middles = (np.arange(len(rows)) + 0.5) * size
        column_middles = (np.arange(len(patches)) + 0.5) * size
        distances = [f"{distance:.0f}" for distance in examples[f"distances_{name}"]]
        axis.set_yticks(row_middles, list(channels), fontsize=7)
        axis.set_xticks(column_middles, distances, fontsize=7)
        axis.set_title("\n".join(wrap(f"({letter}) {titles[name]}", 14)), fontsize=7)
        axis.set_xlabel("distance (m)", fontsize=8)
    _colour_bar(figure, axes, "dB over the background")
    return figure


def _patch_row(patches: NDArray[Any], channel: tuple[int, int]) -> NDArray[Any]:
    """Return the framed patches of a channel side by side, dB; NaN beyond the image's border."""
    framed = []
    for patch in patches:
        # As in the scan images, far is up.
        values = np.where(np.isnan(patch[channel]), np.nan, decibels(patch[channel]))
        framed.append(np.pad(values[::-1], 1))
    return np.hstack(framed)


def region_figure(recipe: Recipe) -> Figure:
    """Draw Fig. 11: regions of an incoherent patch."""
    patch = recipe.contrast.patch()
    codes = np.where(patch.region(patch.guard), 1, 2) - patch.region(patch.inner)
    figure, axis = subplots(3.4, 3.4, 1, 1)
    axis.pcolormesh(codes, cmap="Blues", edgecolors="white", linewidth=0.4)
    axis.set(aspect="equal", xlabel="cross-track", ylabel="down-track", xticks=[], yticks=[])
    axis.set_title("white: inner, middle: guard, dark: outer", fontsize=8)
    return figure


def normalisation_figure(calibration: Sequence[LaneResult]) -> Figure:
    """Draw Fig. 12: histogram of M_HH before and after duplication and after normalisation."""
    known = make_training_set([result.training for result in calibration], columns=["M_HH_F1"])
    values = known.features["M_HH_F1"].to_numpy()
    weight = known.weight
    normalizer = HistogramNormalizer().fit(values[:, None], sample_weight=weight)
    normal = normalizer.transform(values[:, None])[:, 0]
    panels = (
        ("(a) alarms", values, np.ones_like(weight)),
        ("(b) with duplication", values, weight),
        ("(c) normalised", normal, weight),
    )
    figure, axes = subplots(9, 2.8, 1, 3)
    for axis, (title, data, weights) in zip(axes, panels, strict=True):
        axis.hist(data, bins=40, weights=weights, color="#0072b2")
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
    """Draw Fig. 13 or 14: ROC of classifiers by data set.

    Parameters
    ----------
    panels : mapping
        Matched alarms by the title of the panel and the name of the classifier.
    subsets : mapping
        Subsets of the targets by name.
    bands : mapping, optional
        Bands of the last classifier of the first panel by subset: as it is, and trained anew.
    """
    shown = dict(bands or {})
    columns = len(panels)
    rows = 1 + -(-len(shown) // columns)
    figure, grid = subplots(4.4 * columns, 3.6 * rows, rows, columns)
    axes = np.ravel(grid)
    for axis, (title, matches) in zip(axes, panels.items(), strict=False):
        for colour, (name, match) in zip(_COLOURS, matches.items(), strict=False):
            for dash, (kind, subset) in zip(("-", "--"), subsets.items(), strict=False):
                curve = roc_of(match, subset, area=AREA)
                _step(axis, curve, f"{name}, {kind}", colour, dash)
        _roc_axes(axis, title, 0.1)
    first_panel = next(iter(panels.values()))
    last_name, last_match = list(first_panel.items())[-1]
    for axis, (kind, band), colour in zip(axes[columns:], shown.items(), _COLOURS, strict=False):
        _fill_bands(axis, band, colour)
        curve = roc_of(last_match, subsets[kind], area=AREA)
        _step(axis, curve, f"{last_name}, {kind}", colour, "-")
        _roc_axes(axis, f"{kind} mines with bands", 0.1)
    return figure


def _fill_bands(axis: Axes, band: Band, colour: str) -> None:
    """Draw the bands of a classifier as it is, and trained anew in every draw."""
    trained, retrained = band
    label = "95 %, trained anew in every draw"
    axis.fill_between(BAND_FAR, *retrained, color=colour, alpha=0.15, lw=0, label=label)
    axis.fill_between(BAND_FAR, *trained, color=colour, alpha=0.3, lw=0, label="95 %, as trained")


def _at(examples: Examples, polarization: str, subband: str) -> tuple[int, int]:
    """Return the indices of a polarization and a sub-band."""
    polarizations = list(examples["polarization"])
    subbands = list(examples["subband"])
    return polarizations.index(polarization), subbands.index(subband)


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
    level = decibels(image, _LEAST)
    extent = (examples["x"][0], examples["x"][-1], examples["y"][0], examples["y"][-1])
    if x and y:
        rows = _is_within(examples["y"], y)
        columns = _is_within(examples["x"], x)
        top = level[np.ix_(rows, columns)].max()
    elif top is None:
        top = level.max()
    show(axis, level - top, extent, -_DB, 0, cmap="gray_r")
    centre = float(position[0]), float(position[1])
    axis.add_patch(Circle(centre, 1.0, fill=False, color="#d55e00", lw=1.0))
    axis.set(xlim=x, ylim=y)
    axis.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
    axis.set_title(title, fontsize=9)
    axis.tick_params(labelsize=7)


def _is_within(axis: NDArray[Any], limits: tuple[float, float]) -> NDArray[np.bool_]:
    """Return which positions of an axis lie within limits."""
    middle = sum(limits) / 2
    return np.asarray(np.abs(axis - middle) <= np.ptp(limits) / 2)


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
