import math

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.screen import label_training_alarms

LANE = Lane(-1.5, 1.5, 0.0, 20.0)
TRUTH = pd.DataFrame(
    {
        "target_id": ["a", "b", "c"],
        "x": [0.0, 0.8, 1.4],
        "y": [5.0, 5.0, 12.0],
        "kind": ["metal", "plastic", "simulant"],
        "depth": [0.0, 0.05, 0.1],
    }
)


def test_labels_by_hand():
    alarms = pd.DataFrame(
        {"x": [0.3, 0.5, 2.2, 0.0, 2.5, 1.5], "y": [5.0, 5.0, 12.5, 15.0, 15.0, 20.0]},
        index=[9, 8, 7, 6, 5, 4],
    )
    got = label_training_alarms(alarms, TRUTH, LANE)
    assert got.index.tolist() == [9, 8, 7, 6, 5, 4]
    assert got["label"].tolist() == ["hit", "hit", "hit", "false", "neither", "false"]
    assert got["target"].tolist() == [0, 1, 2, -1, -1, -1]


def test_labels_by_loops():
    rng = np.random.default_rng(0)
    alarms = pd.DataFrame({"x": rng.uniform(-3, 3, 200), "y": rng.uniform(0, 20, 200)})
    got = label_training_alarms(alarms, TRUTH, LANE, 0.7)
    for i, (x, y) in enumerate(zip(alarms["x"], alarms["y"], strict=True)):
        away = [math.hypot(x - a, y - b) for a, b in zip(TRUTH["x"], TRUTH["y"], strict=True)]
        near = min(away)
        want = "hit" if near <= 0.7 else "false" if abs(x) <= 1.5 else "neither"
        assert (got["label"][i], got["target"][i]) == (
            want,
            away.index(near) if want == "hit" else -1,
        )
        assert got["distance"][i] == pytest.approx(near)


def test_nothing_there():
    alarms = pd.DataFrame({"x": [0.0], "y": [1.0]})
    assert label_training_alarms(alarms, TRUTH.iloc[:0], LANE)["label"].tolist() == ["false"]
    assert label_training_alarms(alarms.iloc[:0], TRUTH, LANE).empty
    with pytest.raises(ValueError, match="radius"):
        label_training_alarms(alarms, TRUTH, LANE, 0)
