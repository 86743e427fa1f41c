"""A detector of one's own for the proving ground: change it, and run it in its folder.

flgpr benchmark run my_detector:MyDetector --quick --tier prepared

It is trained on the training lanes of every fold, frozen, and tried on sealed test lanes.
"""

import numpy as np
import pandas as pd
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

__author__ = "not stated"  # stands on the card of the submission


class MyDetector:
    """Logistic regression on local contrasts and entropy."""  # the card says so, too

    # Columns of the table of features that it reads, as patterns; without this entry all 50 of
    # Wang et al. 2007: C contrast, M magnitude, R ratio of ranges, P polarimetry, in F0 to F4.
    features = ("C_*", "P_H_*", "P_alpha_*")
    # An entry ``recipe`` names the recipe whose alarms and features it reads, by default wang2007.

    def fit(self, X: pd.DataFrame, y: np.ndarray) -> "MyDetector":
        """Learn from alarms of training lanes: a row each, y is 1 on a mine and 0 elsewhere."""
        self.machine_ = make_pipeline(StandardScaler(), LogisticRegression(class_weight="balanced"))
        self.machine_.fit(X, y)
        return self

    def decision_function(self, X: pd.DataFrame) -> np.ndarray:
        """Return the confidence of every alarm, more for what is more like a mine."""
        return self.machine_.decision_function(X)


# In place of fit(X, y) and decision_function(X) a class may look at whole lanes:
#
#     def fit(self, lanes):        # lane.run, lane.image (xarray), lane.truth (x, y, kind, depth)
#     def detect(self, lane):      # returns a DataFrame with x, y (m) and confidence
#
# An image has magnitudes over the background by (polarization, subband, y, x), coordinates in m.
