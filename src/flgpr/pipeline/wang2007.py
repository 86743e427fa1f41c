"""The chain of Wang et al. 2007 for runs of any length: passes over the scans that hold one scan at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.clutter import Background, BackgroundEstimator
from flgpr.features import POLARIMETRIC, FeatureSettings, FeatureSums
from flgpr.imaging import ScanImager
from flgpr.model import Grid, Lane
from flgpr.pipeline.classifier import Classifier
from flgpr.pipeline.progress import Track
from flgpr.pipeline.recipe import FeaturesTable, Recipe
from flgpr.screen import RunViewSums, prescreen, select, view_array

SWAPPED, PAPER = "swapped.", "paper."
"""Prefixes of the columns of the two variants."""
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Found:
    """What the chain found in a run.

    Attributes
    ----------
    alarms : DataFrame
        x, y, magnitude, confidence, scans.
    features : DataFrame
        Their features, with the same index.
    view : xarray.DataArray
        Run-view (polarization, subband, y, x).
    notes : dict
        Figures worth reporting.
    """

    alarms: pd.DataFrame
    features: pd.DataFrame
    view: xr.DataArray
    notes: dict[str, Any]


class CleanedRun:
    """A run's cleaned images, made anew on every pass.

    Two passes estimate the background when the object is made; each iteration is one more. Images end at the distance
    that counts, so that later passes make only what they need.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    recipe : Recipe
        Recipe with the table features.
    track : Track
        Shows progress.
    """

    def __init__(self, run: xr.Dataset, recipe: Recipe, track: Track) -> None:
        table, whole = recipe.image, recipe.image.grid()
        settings = (table.subbands, table.window, table.tolerance)
        imager = ScanImager(run, whole, *settings)
        median, mean = recipe.background.windows(table.spacing)
        estimator = BackgroundEstimator(median, mean, recipe.background.median_step)
        for image in track(imager, "self-signature", len(imager)):
            estimator.add_signature(image.values)
        for image in track(imager, "gain background", len(imager)):
            estimator.add_gain(image.values)
        self.gains = estimator.gains
        reach = recipe.run_view.y_max + recipe.contrast.size * recipe.contrast.spacing / 2 + table.spacing
        rows = min(whole.ny, int(np.ceil((reach - whole.y_min) / whole.dy)) + 1)
        self.grid = Grid(whole.x_min, whole.y_min, whole.nx, rows, whole.dx, whole.dy)
        self.imager = ScanImager(run, self.grid, *settings)
        self.whole_background = estimator.result()
        self.background: Background = self.whole_background.cropped(rows)

    def __len__(self) -> int:
        return len(self.imager)

    def __iter__(self) -> Iterator[tuple[NDArray[np.complex64], FloatArray, FloatArray]]:
        """Yield every scan's image, gains and pose."""
        for image, gain in zip(self.imager, self.gains, strict=True):
            yield image.values, gain, np.asarray(image.attrs["pose"])


def detect_with_features(
    run: xr.Dataset,
    recipe: Recipe,
    lane: Lane,
    track: Track,
    classifier: Classifier | None = None,
    cleaned: CleanedRun | None = None,
) -> Found:
    """Find alarms and compute their features (Wang et al. 2007, Sec. II).

    Parameters
    ----------
    run : xarray.Dataset
        A run with HH, VV and HV or VH.
    recipe : Recipe
        Recipe with the table features.
    lane : Lane
        The lane.
    track : Track
        Shows progress.
    classifier : Classifier, optional
        Scores the alarms; default: their local contrast.
    cleaned : CleanedRun, optional
        The run's cleaned images, if they are at hand.

    Returns
    -------
    Found
        Alarms with features; the confidence of an alarm that no scan shows whole is NaN.

    Raises
    ------
    ValueError
        If the run does not fit the recipe.
    """
    if recipe.features is None:
        raise ValueError("recipe must have the table features")
    cleaned = cleaned or CleanedRun(run, recipe, track)
    view = _view(cleaned, run, recipe, lane, track)
    screen = recipe.prescreen
    chosen = select(view, screen.polarization, screen.subband)
    alarms = prescreen(chosen, lane, screen.radius, screen.density, screen.count)
    features = alarm_features(cleaned, run, recipe, alarms, track)
    single = f"C_{recipe.contrast.polarization}_{recipe.contrast.subband}"
    confidence = features[single] if classifier is None else classifier.confidence(features)
    notes = {"confidence": single if classifier is None else " + ".join(classifier.features)}
    return Found(alarms.assign(confidence=confidence, scans=features["scans"]), features, view, notes)


def alarm_features(
    cleaned: CleanedRun, run: xr.Dataset, recipe: Recipe, alarms: pd.DataFrame, track: Track
) -> pd.DataFrame:
    """Compute the features of alarms in one pass.

    Parameters
    ----------
    cleaned : CleanedRun
        The run's cleaned images.
    run : xarray.Dataset
        The run.
    recipe : Recipe
        Recipe with the table features.
    alarms : DataFrame
        x, y in the lane frame, m.
    track : Track
        Shows progress.

    Returns
    -------
    DataFrame
        ``scans`` and the features of every sub-band, see :class:`flgpr.features.FeatureSums`; those of the variants
        under the prefixes ``SWAPPED`` (all) and ``PAPER`` (the polarimetric ones).
    """
    table = recipe.features or FeaturesTable()
    channels = ([str(label) for label in run["polarization"].values], list(recipe.image.subbands), cleaned.grid)
    main = FeatureSettings(recipe.contrast.patch(), table.inner, recipe.run_view.y_max, table.psi)
    sums = {"": FeatureSums(alarms, *channels, main)}
    if table.variants:
        linear = FeatureSettings(main.patch, main.inner, main.y_max, "linear")
        sums |= {SWAPPED: FeatureSums(alarms, *channels, main.swapped()), PAPER: FeatureSums(alarms, *channels, linear)}
    for image, gain, pose in track(cleaned, "features", len(cleaned)):
        magnitude = cleaned.background.magnitude(image, gain)
        coherent = cleaned.background.coherent(image, gain)
        for name, one in sums.items():
            own = cleaned.background.own_coherent(image, gain) if name == PAPER else coherent
            one.add(magnitude, own, pose)
    tables = []
    for name, one in sums.items():
        columns = one.table()
        if name == PAPER:
            columns = columns[[f"{p}_{band}" for band in recipe.image.subbands for p in POLARIMETRIC]]
        tables.append(columns.drop(columns="scans").add_prefix(name) if name == SWAPPED else columns.add_prefix(name))
    return pd.concat(tables, axis=1)


def _view(cleaned: CleanedRun, run: xr.Dataset, recipe: Recipe, lane: Lane, track: Track) -> xr.DataArray:
    grid = recipe.run_view.grid(lane)
    sums = RunViewSums(grid, recipe.run_view.y_max)
    for image, gain, pose in track(cleaned, "run-view", len(cleaned)):
        sums.add(cleaned.background.magnitude(image, gain), cleaned.grid, pose)
    labels = {"polarization": run["polarization"].values, "subband": list(recipe.image.subbands)}
    return view_array(*sums.result(), grid, labels)
