"""The figures of Wang et al. 2007 from our lanes, in the paper's order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.design.point_spread import PointSpread
from flgpr.method.classifier import CLASSIFIER_A, CLASSIFIER_B, count_mines, make_training_set
from flgpr.model import Sensor
from flgpr.recipe.schema import Recipe
from flgpr.scoring import Match, pd_mean, roc_of
from flgpr_papers.kit.page import detections_at
from flgpr_papers.wang2007 import figures
from flgpr_papers.wang2007.analysis import (
    AREA,
    BURIED_METAL,
    BURIED_PLASTIC,
    MINES,
    SIMULANTS,
    SUBBANDS,
    LaneResult,
    Pool,
    clutter_levels,
    prescreened,
)

Rows = Sequence[tuple[str, str, str]]
_BANDS = ("F0", *SUBBANDS)
_POLARIZATIONS = ("HH", "VV", "HV")
_BAND_DRAWS = 200
_NOT_GIVEN = "not given"


@dataclass(frozen=True)
class Shown:
    """What the figures are drawn from."""

    recipe: Recipe
    radar: Sensor
    calibration: Sequence[LaneResult]
    pool: Pool  #: alarms of the calibration lanes
    examples: Mapping[str, NDArray[Any]]  #: scan images and patches of Figs. 2-5, 8 and 10
    blind: Mapping[str, Match]  #: blind lanes by classifier

    @cached_property
    def prescreener(self) -> dict[tuple[str, str], Match]:
        """Alarms of the prescreener in every polarization and sub-band."""
        return {
            (polarization, band): prescreened(self.calibration, polarization, band, self.recipe)
            for polarization in _POLARIZATIONS
            for band in _BANDS
        }

    @cached_property
    def classifiers(self) -> dict[str, Match]:
        """Calibration lanes by classifiers A and B, trained and tested on all three."""
        return {
            name: self.pool.match_of(self.pool.confidence(list(columns), "A"))
            for name, columns in (("A", CLASSIFIER_A), ("B", CLASSIFIER_B))
        }

    def example(self, name: str) -> str:
        """Return in words which target or false alarm an example is."""
        return str(dict(zip(self.examples["names"], self.examples["titles"], strict=True))[name])


class Drawing(NamedTuple):
    """A figure, and what stands beside it on the page."""

    number: str  #: of the paper's figure
    title: str
    caption: str
    figure: Figure
    numbers: Rows  #: quantity, paper, here


def drawings(shown: Shown) -> Iterator[Drawing]:
    """Draw Fig. 1 to 14, one at a time."""
    yield _geometry(shown)
    yield _polarizations(shown)
    yield _subbands(shown)
    yield _series(shown)
    yield _background(shown)
    yield _run_view(shown)
    yield _alarms(shown)
    yield _clean_bands(shown)
    yield _prescreener(shown)
    yield _patches(shown)
    yield _regions(shown)
    yield _normalisation(shown)
    yield _best_feature(shown)
    yield _classifiers(shown)


def _geometry(shown: Shown) -> Drawing:
    """Return the twin of the array's geometry."""
    sensor = shown.radar
    image = shown.recipe.image
    tones = shown.radar.tones.axis()
    numbers = (
        ("transmitters, receivers", "2, 18", f"{len(sensor.tx)}, {len(sensor.rx)}"),
        ("height", "about 5 m", f"{sensor.height:g} m"),
        ("tilt", "15°", f"{np.degrees(sensor.tilt):.0f}°"),
        (
            "tones",
            "1024, 442.5 MHz to 3 GHz",
            f"{tones.size}, {tones[0] / 1e6:g} MHz to {tones[-1] / 1e9:g} GHz",
        ),
        (
            "imaged area",
            "7 to 26 m ahead, 12 m wide",
            f"{image.y[0]:g} to {image.y[1]:g} m, {np.ptp(image.x):g} m wide",
        ),
    )
    caption = "From the side and from above; the paper draws a view in perspective."
    return Drawing(
        "Fig. 1",
        "Radar system and imaged area",
        caption,
        figures.geometry_figure(sensor, shown.recipe),
        numbers,
    )


def _polarizations(shown: Shown) -> Drawing:
    """Return the twin of a scan in all polarizations."""
    numbers = (
        ("polarizations", "HH, VV, HV", ", ".join(_POLARIZATIONS)),
        ("sub-band", "F0", "F0"),
        ("in the circle (2 m)", "surface-laid plastic mine", shown.example("surface")),
    )
    figure = figures.polarization_figure(shown.examples)
    return Drawing(
        "Fig. 2",
        "One scan in three polarizations",
        "Scan images as they are made, F0.",
        figure,
        numbers,
    )


def _subbands(shown: Shown) -> Drawing:
    """Return the twin of a scan in all sub-bands."""
    numbers = [("polarization", "VV", "VV")]
    middle = float(np.mean(shown.recipe.image.y))
    for name in _BANDS:
        band = shown.recipe.image.subbands[name]
        down, _ = PointSpread(shown.radar, band, shown.recipe.image.window).widths(
            (0.0, middle, 0.0)
        )
        stated = "about 25 cm" if name != "F0" else _NOT_GIVEN
        numbers.append((f"range resolution, {name}", stated, f"{100 * down:.0f} cm"))
    caption = (
        "The scan of Fig. 2 in VV. "
        f"Resolution: half-power width of a point on the ground {middle:g} m ahead."
    )
    return Drawing(
        "Fig. 3",
        "One scan in five sub-bands",
        caption,
        figures.subband_figure(shown.examples),
        numbers,
    )


def _series(shown: Shown) -> Drawing:
    """Return the twin of a series of scans."""
    ahead = shown.examples["series_place"][:, 1]
    steps = np.abs(np.diff(ahead))
    numbers = (
        ("channel", "HH, F1", "HH, F1"),
        ("step between scans", "1 to 3 m", f"{steps.min():.1f} to {steps.max():.1f} m"),
        (
            "background patterns",
            "stationary",
            f"correlation of neighbours {likeness(shown.examples['series']):.2f}",
        ),
    )
    caption = (
        "The mine (circle) moves through the image, the self-signature stays. All panels share one "
        "scale, whose top is "
        "the largest of what stays in place. Correlation: of neighbouring scans' levels, dB, over "
        "all pixels."
    )
    return Drawing(
        "Fig. 4", "Five consecutive scans", caption, figures.series_figure(shown.examples), numbers
    )


def likeness(series: NDArray[Any]) -> float:
    """Return the mean correlation of neighbouring images of a series, of their levels in dB.

    Parameters
    ----------
    series : (image, y, x) ndarray
        Magnitudes.
    """
    levels = np.log(np.maximum(series.reshape(len(series), -1).astype(np.float64), 1e-30))
    pairs = [np.corrcoef(first, second)[0, 1] for first, second in pairwise(levels)]
    return float(np.mean(pairs))


def _background(shown: Shown) -> Drawing:
    """Return the twin of self-signature and gain background."""
    median, mean, step = shown.recipe.smoothing
    every = "" if step == 1 else f", at every {step}th both ways"
    numbers = (
        ("channel", "HH, F1", "HH, F1"),
        ("median filter", "21 x 21 pixels", f"{median[0]} x {median[1]} pixels{every}"),
        ("averaging filter", "51 x 51 pixels", f"{mean[0]} x {mean[1]} pixels"),
    )
    caption = (
        "(a) scan, (b) self-signature, (c) the scan less it, (d) gain background, "
        "(e) the one over the other."
    )
    figure = figures.background_figure(shown.examples)
    return Drawing("Fig. 5", "Background removal and normalisation", caption, figure, numbers)


def _run_view(shown: Shown) -> Drawing:
    """Return the twin of the run-view."""
    view = shown.recipe.run_view
    numbers = (
        ("channel", "HH, F1", "HH, F1"),
        ("width", "6 m", f"{np.ptp(view.x):g} m"),
        ("pixel", "10 cm", f"{100 * view.spacing:g} cm"),
        ("farthest look, Y_max", "16 m", f"{view.y_max:g} m"),
    )
    caption = (
        "60 m of a calibration lane in pieces of 15 m; circles: targets; lines: the lane's borders."
    )
    figure = figures.run_view_figure(shown.calibration[0], False)
    return Drawing("Fig. 6", "Run-view image", caption, figure, numbers)


def _alarms(shown: Shown) -> Drawing:
    """Return the twin of the prescreener's alarms."""
    screen = shown.recipe.prescreen
    lanes = shown.calibration
    area = sum(
        np.ptp(shown.recipe.run_view.x) * (result.lane.y_max - result.lane.y_min)
        for result in lanes
    )
    density = sum(len(result.alarms) for result in lanes) * np.pi * screen.radius**2 / area
    numbers = (
        ("radius, r_alarm", "0.75 m", f"{screen.radius:g} m"),
        ("alarms per π·r_alarm², ρ", "0.75", f"{density:.2f}"),
    )
    figure = figures.run_view_figure(lanes[0], True)
    return Drawing(
        "Fig. 7",
        "Alarms in the same 60 m",
        "Circles: alarms, in the lane and beside it.",
        figure,
        numbers,
    )


def _clean_bands(shown: Shown) -> Drawing:
    """Return the twin of cleaned images by sub-band."""
    levels = clutter_levels(shown.calibration)
    numbers = [
        ("top row, VV", "metal mine, 15 cm", shown.example("metal")),
        ("bottom row, HH", "plastic mine, 5 cm", shown.example("plastic")),
    ]
    for polarization in ("VV", "HH"):
        text = ", ".join(f"{band} {levels[f'{polarization} {band}'].mean():.1f}" for band in _BANDS)
        numbers.append((f"clutter, {polarization}, dB", "lowest in F1", text))
    caption = (
        "After removal of the background. Circles: the mines. Clutter: the 99 % quantile of the "
        "run-view away from "
        "targets over its median."
    )
    figure = figures.clean_bands_figure(shown.examples)
    return Drawing("Fig. 8", "Scan images of five sub-bands", caption, figure, numbers)


def _prescreener(shown: Shown) -> Drawing:
    """Return the twin of the prescreener's ROC."""
    numbers = [
        ("Pd of HH F1 at 0.15 per m²", "100 %", _pd(shown.prescreener["HH", "F1"], MINES, 0.15))
    ]
    for polarization in _POLARIZATIONS:
        curves = {
            band: roc_of(shown.prescreener[polarization, band], MINES, area=AREA) for band in _BANDS
        }
        text = ", ".join(f"{band} {pd_mean(curve):.2f}" for band, curve in curves.items())
        numbers.append((f"PD_mean, {polarization}", "falls from F1 to F4", text))
    caption = (
        "Actual mines of the calibration lanes, all pooled; the paper shows one calibration run."
    )
    figure = figures.prescreener_figure(shown.prescreener, MINES)
    return Drawing("Fig. 9", "ROC at the prescreener stage", caption, figure, numbers)


def _patches(shown: Shown) -> Drawing:
    """Return the twin of patches at alarms."""
    patch = shown.recipe.contrast
    numbers = (
        (
            "patch",
            "25 x 25 pixels of 10 cm",
            f"{patch.size} x {patch.size} of {100 * patch.spacing:g} cm",
        ),
        ("(a)", "surface-laid mine", shown.example("surface")),
        ("(b)", "metal mine, 5 cm", shown.example("shallow")),
        ("(c)", "plastic mine, 5 cm", shown.example("plastic")),
        ("(d)", "false alarm", shown.example("false")),
    )
    caption = (
        "Patches at the alarms, from near to far, up to Y_max; every row over its largest value. "
        "Black: beyond the "
        "image's border."
    )
    return Drawing(
        "Fig. 10", "Patches of four alarms", caption, figures.patch_figure(shown.examples), numbers
    )


def _regions(shown: Shown) -> Drawing:
    """Return the twin of the contrast's regions."""
    patch = shown.recipe.contrast
    inner, guard = ("{} x {} pixels".format(*size) for size in (patch.inner, patch.guard))
    numbers = (
        ("inner region", "5 x 3 pixels", inner),
        ("inner and guard region", "9 x 7 pixels", guard),
    )
    caption = "Cross-track x down-track, which the paper leaves open."
    return Drawing(
        "Fig. 11", "Regions of a patch", caption, figures.region_figure(shown.recipe), numbers
    )


def _normalisation(shown: Shown) -> Drawing:
    """Return the twin of the normalised features."""
    lanes = [
        (result.name, result.alarms, result.features, result.truth, result.lane)
        for result in shown.calibration
    ]
    known = make_training_set(lanes, columns=["M_HH_F1"])
    false_alarms = int((shown.pool.labels["label"] == "false").sum())
    mines = count_mines(result.truth for result in shown.calibration)
    numbers = (
        ("false alarms per actual mine, W0", "about 30", f"{false_alarms / max(mines, 1):.0f}"),
        (
            "alarms before and after duplication",
            _NOT_GIVEN,
            f"{known.weight.size} and {known.weight.sum()}",
        ),
    )
    caption = "(a) all alarms, (b) after duplication, (c) after normalisation."
    figure = figures.normalisation_figure(known.features["M_HH_F1"].to_numpy(), known.weight)
    return Drawing("Fig. 12", "Duplication and normalisation of M_HH", caption, figure, numbers)


def _best_feature(shown: Shown) -> Drawing:
    """Return the twin of the best feature's ROC."""
    contrast = shown.classifiers["A"]
    numbers = [
        ("C_HH over the prescreener", "very significant, metal and plastic", "see the statements")
    ]
    for kind, subset, stated in (
        ("buried plastic", BURIED_PLASTIC, ("65 %", "90 %")),
        ("simulants", SIMULANTS, ("7 of 16", "9 of 16")),
    ):
        for far, paper in zip((0.02, 0.07), stated, strict=True):
            numbers.append(
                (f"C_HH, {kind}, Pd at {far:g} per m²", paper, _pd(contrast, subset, far))
            )
    subsets = {"metal": BURIED_METAL, "plastic": BURIED_PLASTIC}
    panels = {"calibration": {"prescreener": shown.prescreener["HH", "F1"], "C_HH": contrast}}
    caption = "Buried mines of the calibration lanes."
    figure = figures.classifier_figure(panels, subsets)
    return Drawing("Fig. 13", "Prescreener and best feature", caption, figure, numbers)


def _classifiers(shown: Shown) -> Drawing:
    """Return the twin of the classifiers' ROC."""
    numbers = []
    for name, match in shown.blind.items():
        numbers.append(
            (f"{name}, blind metal, Pd at 0.01 per m²", "100 %", _pd(match, BURIED_METAL, 0.01))
        )
        numbers.append(
            (
                f"{name}, blind plastic, Pd at 0.05 per m²",
                "25 to 30 % over C",
                _pd(match, BURIED_PLASTIC, 0.05),
            )
        )
    subsets = {"metal": BURIED_METAL, "plastic": BURIED_PLASTIC}
    panels = {"calibration": shown.classifiers, "blind": shown.blind}
    bands = {
        kind: shown.pool.bands(CLASSIFIER_B, "A", subset, figures.BAND_FAR, _BAND_DRAWS)
        for kind, subset in subsets.items()
    }
    caption = (
        "A: C_HH; B: C_HH, M_VV and P_alpha. The panels with bands are ours. C, another group's "
        "algorithm, is not "
        "reproduced."
    )
    figure = figures.classifier_figure(panels, subsets, bands)
    return Drawing(
        "Fig. 14", "Classifiers on calibration and blind lanes", caption, figure, numbers
    )


def _pd(matched: Match, subset: Any, far: float) -> str:
    """Write a Pd as counts, with the chance level."""
    n_found, targets, by_chance = detections_at(matched, subset, far, area=AREA)
    return f"{n_found} of {targets}, chance {by_chance:.0%}"
