"""How many targets and alarms each step before a detector left, and what is advised."""

import numpy as np
import pandas as pd
import pytest

from flgpr.method.alarm_steps import count_alarm_steps
from flgpr.method.classifier import make_training_set
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.stages.too_few import TooFewExamplesError

AREA = Lane(-1.5, 1.5, 0.0, 10.0)


def targets(*places, kind="metal"):
    rows = [(f"T{number}", x, y, kind, -0.1) for number, (x, y) in enumerate(places)]
    return pd.DataFrame(rows, columns=["target_id", "x", "y", "kind", "depth"])


THREE = targets((0.0, 2.0), (0.5, 5.0), (-0.5, 8.0))


def alarm_lane(feature):
    """Seven alarms: two hits on the first of three mines, one on the second, three false, one outside the lane."""
    alarms = pd.DataFrame([(0.0, 2.0), (0.1, 2.1), (0.5, 5.1), (1.0, 3.6), (0.0, 6.6), (0.0, 9.5), (8.0, 1.0)],
                          columns=["x", "y"])  # fmt: skip
    return "lane", alarms, pd.DataFrame(feature), THREE, AREA


FULL = {"a": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]}


NAN = np.nan


def steps_of(feature, spent=None):
    taken = {"screen.clusters": [THREE.iloc[[0]]]} if spent is None else spent
    return count_alarm_steps([alarm_lane(feature)], 9, taken, list(feature), 1.0)


def test_the_steps_are_those_that_the_training_set_takes():
    features = {"a": FULL["a"], "b": [1.0, 1.0, NAN, 1.0, NAN, 1.0, 1.0]}
    steps = steps_of(features)
    counts = {one.what: one.number for one in steps.counts(parse_recipe(recipe_text("flsar2004")))}
    assert counts == {
        "targets in the truth (3 metal)": 3,
        "taken by screen.clusters": 1,
        "targets left for the detector": 2,
        "alarms raised by screen.clusters": 9,
        "of these without a confidence, left out": 2,
        "hits, within 1 m of a target": 3,
        "false alarms": 3,
        "outside the lane, neither": 1,
        "hits on targets left for the detector": 1,
        "alarms without the feature b": 2,
        "hits with all features": 0,
        "false alarms with all features": 2,
    }
    made = make_training_set([alarm_lane(features)], 1.0, list(features), [THREE.iloc[[0]]])
    assert steps.complete == (int(made.label.sum()), int((made.label == 0).sum()))


@pytest.mark.parametrize(
    ("features", "spent", "shown", "lost", "advice"),
    [
        (
            FULL | {"b": [1, 1, NAN, 1, 1, 1, 1]},
            None,
            "all",
            "no hit has all features (b)",
            'features = ["a"] in [detector] (now ["T_*"])',
        ),
        (
            FULL | {"b": [1, 1, 1, NAN, NAN, NAN, 1]},
            None,
            "all",
            "no false alarm has all features (b)",
            'features = ["a"] in [detector] (now ["T_*"])',
        ),
        (
            FULL | {"b": [1, 1, NAN, 1, 1, 1, 1]},
            None,
            "mines",
            "no hit has all features (b)",
            'features = ["a"] in [detector] (now ["T_*"])',
        ),
        (
            FULL,
            {"screen.clusters": [THREE.iloc[[0, 1]]]},
            "mines",
            "screen.clusters raised no alarm at the targets left for the detector",
            'rule = "or" in [screen] (now "and-or")',
        ),
        (FULL, {"screen.clusters": [THREE]}, "all", "screen.clusters took all targets", None),
    ],
)
def test_where_hits_or_false_alarms_ran_out_decides_what_is_advised(
    features, spent, shown, lost, advice
):
    recipe = parse_recipe(recipe_text("flsar2004"))
    error = TooFewExamplesError("hits, got none")
    message = str(steps_of(features, spent).error(error, recipe, shown))
    assert message.startswith(
        f"detector cannot be trained: it needs hits, got none: {lost}. Step by step: "
    )
    assert (
        (f"Set {advice}; or give" in message)
        if advice
        else message.endswith(". Give more lanes with mines.")
    )
