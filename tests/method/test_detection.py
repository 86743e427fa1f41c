"""Ranked alarms: their order, their names, and their features in step."""

import numpy as np
import pandas as pd

from flgpr.method.detection import rank


def test_alarms_are_sorted_named_and_kept_in_step_with_their_features():
    alarms = pd.DataFrame(
        {"x": [0.0, 1, 2, 3], "y": [0.0, 1, 2, 3], "confidence": [0.5, np.nan, 0.9, 0.5]}
    )
    features = pd.DataFrame({"a": [10.0, 11, 12, 13]})
    ranked = rank(alarms, features)
    assert ranked.alarms["alarm_id"].tolist() == ["alarm-1", "alarm-2", "alarm-3"]
    assert ranked.alarms["x"].tolist() == [2, 0, 3]  # equal ones stay in their order
    assert ranked.features["a"].tolist() == [12, 10, 13]
    assert ranked.rows.tolist() == [2, 0, 3]


def test_no_alarm_with_a_confidence_is_an_empty_table_with_its_columns():
    alarms = pd.DataFrame({"x": [0.0], "y": [0.0], "confidence": [np.nan]})
    ranked = rank(alarms, pd.DataFrame({"a": [1.0]}))
    assert len(ranked.alarms) == len(ranked.features) == len(ranked.rows) == 0
    assert {"alarm_id", "x", "y", "confidence"} <= set(ranked.alarms.columns)
