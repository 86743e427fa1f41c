"""What the viewer needs of a chain: the confidences, split into what each feature adds."""

from __future__ import annotations

import numpy as np
import pandas as pd

from flgpr.chain.classifier import Classifier


def contributions(
    alarms: pd.DataFrame, features: pd.DataFrame | None, single: str, classifier: Classifier | None = None
) -> pd.DataFrame:
    """Split confidences into what each feature adds.

    Parameters
    ----------
    alarms, features : DataFrame
        Alarms with their confidence, and their features in the same order.
    single : str
        Name of the feature that is the confidence where nothing was trained.
    classifier : Classifier, optional
        What scored them.

    Returns
    -------
    DataFrame
        One column per feature, and ``threshold``, the discriminant's constant; the row sums are the confidences.
    """
    if classifier is None:
        return pd.DataFrame({single: alarms["confidence"].to_numpy()})
    names = list(classifier.features)
    if features is None or not len(features):
        return pd.DataFrame({name: np.zeros(0) for name in [*names, "threshold"]})
    values = classifier.normalizer.transform(features[names].to_numpy(dtype=np.float64))
    table = pd.DataFrame(values * classifier.discriminant.direction_, columns=names)
    return table.assign(threshold=-classifier.discriminant.threshold_)
