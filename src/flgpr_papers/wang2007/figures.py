"""The figures of Wang et al. 2007, drawn from simulated lanes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from textwrap import wrap
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import MaxNLocator

from flgpr.detect import HistogramNormalizer
from flgpr.method.classifier import make_training_set
from flgpr.model import Sensor
from flgpr.recipe.schema import Recipe
from flgpr.scoring import Match, roc_of
from flgpr.types import AnyArray, Arrays, BoolArray, Entries
from flgpr_papers.kit.figures import Figures, Panels, chance_line, colour_bar, decibels, show, steps
from flgpr_papers.kit.settings import Span
from flgpr_papers.wang2007.analysis import (
    AREA,
    BANDS,
    MINES,
    POLARIZATIONS,
    SUBBANDS,
    LaneResult,
)
from flgpr_papers.wang2007.findings import BURIED, SETS, Tables

_DB = 30.0
_BAND_DRAWS = 200
_LEAST = 1e-12
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")
Examples = Arrays
PATCHES = ("surface", "shallow", "plastic", "false")
"""Examples of Fig. 10."""
_figure = Figures("wang2007")


@dataclass(frozen=True)
class Measured:
    """What the study has measured, for its figures and its page."""

    recipe: Recipe  #: recipe of the study
    radar: Sensor  #: the array
    calibration: Sequence[LaneResult]  #: results of the calibration lanes
    blind: Sequence[LaneResult]  #: results of the blind lanes
    tables: Tables  #: what the statements are judged by
    examples: Examples  #: scan images and patches of Figs. 2-5, 8 and 10


@_figure
def geometry_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 1: the radar and the imaged area, from the side and from above."""
    sensor, image = measured.radar, measured.recipe.image
    side, plan = panels
    height = sensor.height
    side.plot(0, height, "s", color="k")
    for y in image.y:
        side.plot([0, y], [height, 0], color="#888888", lw=0.8)
    length = 6.0
    arrow_end = length * np.cos(sensor.tilt), height - length * np.sin(sensor.tilt)
    side.annotate("", arrow_end, (0, height), arrowprops={"arrowstyle": "->"})
    side.plot(image.y, [0, 0], lw=4, color="#0072b2")
    side.set(title=f"tilt {np.degrees(sensor.tilt):.0f}°", ylim=(-0.5, height + 1))
    corner = image.y[0], image.x[0]
    imaged = Rectangle(corner, np.ptp(image.y), np.ptp(image.x), fc="#cfe3f2", ec="#0072b2")
    plan.add_patch(imaged)
    for style, positions in (("v", sensor.tx), ("|", sensor.rx)):
        plan.plot(*np.asarray(positions)[:, [1, 0]].T, style, color="k", ms=7)
    for border in (-1.5, 1.5):
        plan.axhline(border, color="#888888", lw=0.8)


@_figure
def polarization_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 2: one scan in three polarizations, sub-band F0."""
    examples = measured.examples
    channels = [(polarization, "F0") for polarization in POLARIZATIONS]
    _channels(panels, examples, "surface", "raw", channels)
    _scan_axes(panels)


@_figure
def subband_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 3: one scan in five sub-bands, VV."""
    examples = measured.examples
    _channels(panels, examples, "surface", "raw", [("VV", band) for band in BANDS])
    _scan_axes(panels)


def _channels(
    panels: Panels,
    examples: Examples,
    name: str,
    kind: str,
    channels: Sequence[tuple[str, str]],
    *limits: Any,
) -> None:
    """Draw an example's images of several channels within limits, a panel each."""
    for axis, channel in zip(panels, channels, strict=True):
        image = examples[f"{kind}_{name}"][_at(examples, *channel)]
        _scan(axis, image, examples, examples[f"place_{name}"], ", ".join(channel), *limits)


@_figure
def series_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 4: five consecutive scans, HH, F1: the mine moves, the self-signature stays.

    All share one scale. Its top is the largest of the median over the scans, which holds what stays
    in place: on a scale that reaches up to the mines themselves it would hardly be seen.
    """
    examples = measured.examples
    top = float(decibels(np.median(examples["series"], axis=0), _LEAST).max())
    shown = zip(panels, examples["series"], examples["series_place"], strict=True)
    for number, (axis, image, position) in enumerate(shown, start=1):
        _scan(axis, image, examples, position, f"scan {number}", top=top)
    _scan_axes(panels, "dB below the largest of what stays")


@_figure
def background_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 5: background removal and normalisation, HH, F1."""
    examples = measured.examples
    channel = _at(examples, "HH", "F1")
    clean = examples["clean_surface"][channel]
    images = {
        "(a) scan": examples["raw_surface"][channel],
        "(b) self-signature": examples["signature"],
        "(c) less (b)": clean * examples["gain"],
        "(d) gain background": examples["gain"],
        "(e) (c) over (d)": clean,
    }
    for axis, (title, image) in zip(panels, images.items(), strict=True):
        _scan(axis, image, examples, examples["place_surface"], title)
    _scan_axes(panels)


@_figure
def run_view_figure(panels: Panels, measured: Measured, alarms: bool, length: float = 60.0) -> None:
    """Draw Fig. 6 or 7: 60 m of a calibration lane in pieces of 15 m, with targets or alarms.

    Parameters
    ----------
    panels : ndarray of Axes
        A panel for each piece.
    measured : Measured
        The study, of which the first lane is shown.
    alarms : bool
        Whether alarms are marked, or targets.
    length : float
        Length of lane that is shown, m.
    """
    result = measured.calibration[0]
    view = result.view.sel(polarization="HH", subband="F1")
    top = 20 * np.log10(np.nanpercentile(view.values, 99.9))
    marked = result.alarms if alarms else result.truth
    radius = 0.25 if alarms else 0.6
    borders = result.lane.y_min + np.arange(5) * length / 4
    for axis, (low, high) in zip(panels, pairwise(borders), strict=True):
        piece = view.sel(y=slice(low, high))
        if not piece.sizes["y"]:
            axis.set_visible(False)
            continue
        level = decibels(piece.values, _LEAST) - top
        show(axis, level, view.x, piece.y, -_DB, 0, cmap="gray_r")
        for border in (result.lane.x_min, result.lane.x_max):
            axis.axvline(border, color="#0072b2", lw=0.8)
        for x, y in marked.loc[marked["y"].between(low, high), ["x", "y"]].to_numpy():
            axis.add_patch(Circle((x, y), radius, fill=False, color="#d55e00", lw=1.2))
    _colour_bar(panels, "dB below the brightest thousandth")


@_figure
def clean_bands_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 8: cleaned scans in five sub-bands, VV of a metal mine and HH of a plastic one."""
    examples = measured.examples
    for row, name, polarization in zip(panels, ("metal", "plastic"), ("VV", "HH"), strict=True):
        channels = [(polarization, band) for band in BANDS]
        _channels(row, examples, name, "clean", channels, (-3, 3), (8, 16))
    _scan_axes(panels)


@_figure
def prescreener_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 9: ROC of the prescreener by polarization and sub-band, of one run over all runs."""
    pooled, one_run = measured.tables.channels, measured.tables.first_run
    for axis, polarization in zip(panels, POLARIZATIONS, strict=True):
        for colour, band in zip(_COLOURS, (*SUBBANDS, "F0"), strict=True):
            channel = polarization, band
            all_runs = roc_of(pooled[channel], MINES, area=AREA)
            axis.step(all_runs["far"], all_runs["pd"], where="post", color=colour, alpha=0.3, lw=1)
            dash = ":" if band == "F0" else "-"
            _roc(axis, one_run[channel], MINES, band, color=colour, ls=dash)
        _roc_axes(axis, polarization, 0.3)


def _widths(measured: Measured) -> Entries:
    """Return the widths of the panels of Fig. 10, by their numbers of patches."""
    return {"width_ratios": [len(measured.examples[f"patches_{name}"]) for name in PATCHES]}


@_figure.sized(_widths)
def patch_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 10: incoherent patches of three hits and a false alarm."""
    examples = measured.examples
    titles = dict(zip(examples["names"], examples["titles"], strict=True))
    channels = {
        f"{polarization} {band}": _at(examples, polarization, band)
        for polarization, band in product(POLARIZATIONS, SUBBANDS)
    }
    # One scale: that HV is weak, and that a false alarm is, is what the figure shows.
    top = max(1.0, *(decibels(examples[f"patches_{name}"]).max() for name in PATCHES))
    shades = mpl.colormaps["gray"].with_extremes(bad="#3b6ea5")
    for axis, letter, name in zip(panels, "abcd", PATCHES, strict=True):
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
    _colour_bar(panels, "dB over the background")


def _patch_row(patches: AnyArray, channel: tuple[int, int]) -> AnyArray:
    """Return the framed patches of a channel side by side, dB; NaN beyond the image's border."""
    framed = []
    for patch in patches:
        # As in the scan images, far is up.
        values = np.where(np.isnan(patch[channel]), np.nan, decibels(patch[channel]))
        framed.append(np.pad(values[::-1], 1))
    return np.hstack(framed)


@_figure
def region_figure(axis: Axes, measured: Measured) -> None:
    """Draw Fig. 11: regions of an incoherent patch."""
    patch = measured.recipe.contrast.patch()
    codes = np.where(patch.region(patch.guard), 1, 2) - patch.region(patch.inner)
    axis.pcolormesh(codes, cmap="Blues", edgecolors="white", linewidth=0.4)
    axis.set_title("white: inner, middle: guard, dark: outer", fontsize=8)


@_figure
def normalisation_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 12: histogram of M_HH before and after duplication and after normalisation."""
    known = make_training_set([one.training for one in measured.calibration], columns=["M_HH_F1"])
    values = known.features["M_HH_F1"].to_numpy()
    weight = known.weight
    normalizer = HistogramNormalizer().fit(values[:, None], sample_weight=weight)
    histograms = {
        "(a) alarms": (values, np.ones_like(weight)),
        "(b) with duplication": (values, weight),
        "(c) normalised": (normalizer.transform(values[:, None])[:, 0], weight),
    }
    for axis, (title, (data, weights)) in zip(panels, histograms.items(), strict=True):
        axis.hist(data, bins=40, weights=weights, color="#0072b2")
        axis.set_title(title, fontsize=9)
        axis.set_xlabel("M_HH", fontsize=8)


BAND_FAR = np.linspace(0, 0.1, 51)
"""False alarm rates at which bands are drawn, per m²."""


def _trained(measured: Measured) -> dict[str, Match]:
    """Return the calibration lanes by classifier, trained on them."""
    pool = measured.tables.pool
    return {name: pool.match_of(pool.confidence(columns, "A")) for name, columns in SETS.items()}


@_figure
def best_figure(axis: Axes, measured: Measured) -> None:
    """Draw Fig. 13: ROC of prescreener and best feature by the kind of mines."""
    best = {
        "prescreener": measured.tables.channels["HH", "F1"],
        "C_HH": _trained(measured)["A"],
    }
    _kinds(axis, best, "calibration")


@_figure
def classifier_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 14: ROC of classifiers by set of lanes, and of B with bands.

    The bands, by kind of mines, are those of the classifier as it is, and trained anew.
    """
    pool = measured.tables.pool
    trained = _trained(measured)
    _kinds(panels[0, 0], trained, "calibration")
    _kinds(panels[0, 1], measured.tables.blind, "blind")
    for axis, (kind, subset), colour in zip(panels[1], BURIED.items(), _COLOURS, strict=False):
        frozen, anew = pool.bands(SETS["B"], "A", subset, BAND_FAR, _BAND_DRAWS)
        for band, alpha, label in (
            (anew, 0.15, "95 %, trained anew in every draw"),
            (frozen, 0.3, "95 %, as trained"),
        ):
            axis.fill_between(BAND_FAR, *band, color=colour, alpha=alpha, lw=0, label=label)
        _roc(axis, trained["B"], subset, f"B, {kind}", color=colour, ls="-")
        _roc_axes(axis, f"{kind} mines with bands", 0.1)


def _kinds(axis: Axes, matches: Mapping[str, Match], title: str) -> None:
    """Draw the ROC of several detectors by the kind of mines."""
    for colour, (name, match) in zip(_COLOURS, matches.items(), strict=False):
        for dash, (kind, subset) in zip(("-", "--"), BURIED.items(), strict=True):
            _roc(axis, match, subset, f"{name}, {kind}", color=colour, ls=dash)
    _roc_axes(axis, title, 0.1)


def _at(examples: Examples, polarization: str, subband: str) -> tuple[int, int]:
    """Return the indices of a polarization and a sub-band."""
    axes = ("polarization", polarization), ("subband", subband)
    p, b = [list(examples[name]).index(label) for name, label in axes]
    return p, b


def _scan(
    axis: Axes,
    image: AnyArray,
    examples: Examples,
    position: Any,
    title: str,
    x: Span | None = None,
    y: Span | None = None,
    top: float | None = None,
) -> None:
    """Draw a scan image in dB below ``top``, by default the largest level of what is shown."""
    level = decibels(image, _LEAST)
    if x and y:
        inside = np.ix_(_is_within(examples["y"], y), _is_within(examples["x"], x))
        top = level[inside].max()
    elif top is None:
        top = level.max()
    show(axis, level - top, examples["x"], examples["y"], -_DB, 0, cmap="gray_r")
    axis.add_patch(Circle(position, 1.0, fill=False, color="#d55e00", lw=1.0))
    axis.set(xlim=x, ylim=y)
    axis.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
    axis.set_title(title, fontsize=9)
    axis.tick_params(labelsize=7)


def _is_within(axis: AnyArray, limits: Span) -> BoolArray:
    """Return which positions of an axis lie within limits."""
    middle = sum(limits) / 2
    return np.abs(axis - middle) <= np.ptp(limits) / 2


def _scan_axes(panels: Panels, label: str = "dB below the image's largest") -> None:
    """Name the axes of scan images at the figure's edges, and add the bar of their common scale."""
    grid = np.atleast_2d(panels)
    for axis in grid[-1]:
        axis.set_xlabel("cross-track (m)", fontsize=8)
    for axis in grid[:, 0]:
        axis.set_ylabel("down-track (m)", fontsize=8)
    _colour_bar(panels, label)


def _colour_bar(panels: Panels, label: str) -> None:
    """Add one colour bar for all panels, which share their scale."""
    shown = [axis for axis in panels.ravel() if axis.get_visible()]
    bar = colour_bar(panels, shown[0].images[0], "", shrink=0.8, pad=0.01)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7)


def _roc(axis: Axes, match: Match, subset: Any, label: str, **style: Any) -> None:
    """Draw the ROC of some targets."""
    steps(axis, roc_of(match, subset, area=AREA), label, lw=1.3, **style)


def _roc_axes(axis: Axes, title: str, far_max: float) -> None:
    """Draw chance and name a panel of ROCs."""
    chance_line(axis, far_max, 1.0)
    axis.set_title(title, fontsize=10)
