"""What the viewer needs of the chain with features: the confidences, split into what each feature adds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flgpr.pipeline.classifier import Classifier
from flgpr.pipeline.recipe import Recipe

if TYPE_CHECKING:
    from flgpr.pipeline.detect import Detection


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
