"""What the viewer needs of the chain with features: one more pass over the scans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.model import Lane
from flgpr.pipeline.classifier import Classifier
from flgpr.pipeline.progress import Track
from flgpr.pipeline.recipe import Recipe
from flgpr.pipeline.view_evidence import collect_evidence
from flgpr.pipeline.wang2007 import CleanedRun
from flgpr.screen import RunViewSums, view_array

if TYPE_CHECKING:
    from flgpr.pipeline.detect import Detection


def explain(
    detection: Detection,
    cleaned: CleanedRun,
    run: xr.Dataset,
    recipe: Recipe,
    lane: Lane,
    track: Track,
    classifier: Classifier | None = None,
) -> Detection:
    """Add what explains a detection: evidence, contributions, and the run-view before suppression.

    Parameters
    ----------
    detection : Detection
        What the chain found, with features.
    cleaned : CleanedRun
        The run's cleaned images.
    run : xarray.Dataset
        The run.
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.
    track : Track
        Shows progress.
    classifier : Classifier, optional
        What scored the alarms; default: their local contrast.

    Returns
    -------
    Detection
        The same with evidence, contributions, channel and ``before``.
    """
    grid, reach = recipe.run_view.grid(lane), recipe.run_view.y_max
    sums = RunViewSums(grid, reach)

    def images() -> Iterator[xr.DataArray]:
        scans = zip(cleaned.imager, cleaned.gains, strict=True)
        for image, gain in track(scans, "explaining alarms", len(cleaned)):
            sums.add(np.abs(image.values), cleaned.grid, np.asarray(image.attrs["pose"]))
            yield image.copy(data=cleaned.background.own_coherent(image.values, gain))

    contrast = recipe.contrast
    evidence = collect_evidence(images(), detection.alarms, contrast.patch(), reach, run, contrast.subband)
    labels = {"polarization": run["polarization"].values, "subband": list(recipe.image.subbands)}
    return replace(
        detection,
        channel=(recipe.prescreen.polarization, recipe.prescreen.subband),
        contributions=contributions(detection, recipe, classifier),
        evidence=evidence,
        before=view_array(*sums.result(), grid, labels),
    )


def contributions(detection: Detection, recipe: Recipe, classifier: Classifier | None = None) -> pd.DataFrame:
    """Split confidences into what each feature adds.

    Parameters
    ----------
    detection : Detection
        Alarms and features.
    recipe : Recipe
        The recipe.
    classifier : Classifier, optional
        What scored them; default: their local contrast.

    Returns
    -------
    DataFrame
        One column per feature, and ``threshold``, the discriminant's constant; the row sums are the confidences.
    """
    if classifier is None:
        single = f"C_{recipe.contrast.polarization}_{recipe.contrast.subband}"
        return pd.DataFrame({single: detection.alarms["confidence"].to_numpy()})
    names = list(classifier.features)
    if detection.features is None or not len(detection.features):
        return pd.DataFrame({name: np.zeros(0) for name in [*names, "threshold"]})
    values = classifier.normalizer.transform(detection.features[names].to_numpy(dtype=np.float64))
    table = pd.DataFrame(values * classifier.discriminant.direction_, columns=names)
    return table.assign(threshold=-classifier.discriminant.threshold_)
