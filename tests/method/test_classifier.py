"""The classifier of Wang et al. 2007: what it learns from, scores, explains and is written as."""

import json

import numpy as np
import pandas as pd
import pytest

from flgpr.method.classifier import (
    SIMULANT_BETA,
    Classifier,
    TrainingSet,
    count_mines,
    feature_values,
    label_lanes,
    make_training_set,
    train,
)
from flgpr.model import Lane

LANE = Lane(-1.5, 1.5, 0.0, 20.0)
NAMES = ("a", "b")


@pytest.fixture(scope="module")
def examples():
    rng = np.random.default_rng(3)
    label = np.repeat([1, 0], [30, 90])
    features = pd.DataFrame(rng.normal(size=(120, 2)) + 2.0 * label[:, None], columns=list(NAMES))
    weight = np.where(label == 1, 3, 1)
    return TrainingSet(features, label, weight, np.array(["lane"] * 120))


@pytest.fixture(scope="module")
def classifier(examples):
    return train(examples, NAMES)


def test_mines_score_higher_and_a_missing_feature_is_no_score(classifier, examples):
    confidence = classifier.confidence(examples.features)
    mines = confidence[examples.label == 1]
    clutter = confidence[examples.label == 0]
    assert np.median(mines) > classifier.border > np.median(clutter)
    partly = examples.features[:2].assign(b=[np.nan, 1.0])
    assert np.isnan(classifier.confidence(partly)).tolist() == [True, False]
    with pytest.raises(ValueError, match="columns the model reads; missing: b"):
        classifier.confidence(examples.features[["a"]])


def test_contributions_add_up_to_the_confidence(classifier, examples):
    table = classifier.contributions(examples.features)
    assert list(table.columns) == [*NAMES, "threshold"]
    np.testing.assert_allclose(table.sum(axis=1), classifier.confidence(examples.features))
    assert len(classifier.contributions(examples.features[:0])) == 0


def test_what_is_written_is_read_to_the_same_scores(classifier, examples):
    about = json.loads(json.dumps(classifier.about()))
    again = Classifier.restored(about, classifier.arrays(), {})
    np.testing.assert_array_equal(
        again.confidence(examples.features), classifier.confidence(examples.features)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"extra": 1}, "detector must have estimator, features, threshold alone, got 'extra'"),
        ({"features": ["a", "a"]}, "must be a list of different names"),
        ({"features": []}, "must be a list of different names"),
        ({"features": "ab"}, "must be a list of different names"),
    ],
)
def test_entries_that_break_a_rule_are_refused(classifier, change, message):
    with pytest.raises(ValueError, match=message):
        Classifier.restored(classifier.about() | change, classifier.arrays(), {})


def test_knots_that_do_not_rise_are_refused(classifier):
    arrays = classifier.arrays()
    arrays["knots-1"] = arrays["knots-1"][:, ::-1].copy()
    with pytest.raises(ValueError, match="knots of 'b' must rise"):
        Classifier.restored(classifier.about(), arrays, {})


def test_a_class_without_an_example_and_an_unknown_column_are_refused(examples):
    with pytest.raises(ValueError, match="features must be columns of the feature table, got c"):
        train(examples, ("a", "c"))
    no_hits = TrainingSet(examples.features, np.zeros(120, int), examples.weight, examples.lane)
    with pytest.raises(ValueError, match="hits and false alarms, got 0 hits and 120 false alarms"):
        train(no_hits, NAMES)


def lanes():
    """Two lanes of two targets: a mine and a simulant, each hit, a false alarm, and one outside."""
    truth = pd.DataFrame(
        {"target_id": ["T1", "T2"], "kind": ["metal", "simulant"], "x": [0.0, 0.0],
         "y": [5.0, 15.0], "depth": [0.05, 0.05]}
    )  # fmt: skip
    alarms = pd.DataFrame({"x": [0.1, 0.0, 1.0, 4.0], "y": [5.0, 15.2, 10.0, 10.0]})
    alarms["confidence"] = 1.0
    features = pd.DataFrame({"a": [1.0, 2.0, 3.0, 4.0], "b": [1.0, 2.0, np.nan, 4.0]})
    return [(name, alarms, features, truth, LANE) for name in ("first", "second")]


def test_alarms_are_labelled_and_targets_counted_through_all_lanes():
    labels = label_lanes(lanes())
    assert labels["label"].tolist() == ["hit", "hit", "false", "neither"] * 2
    assert labels["target"].tolist() == [0, 1, -1, -1, 2, 3, -1, -1]
    assert labels["beta"].tolist() == [1.0, SIMULANT_BETA, 1.0, 1.0] * 2
    assert labels["lane"].tolist() == ["first"] * 4 + ["second"] * 4
    with pytest.raises(ValueError, match="at least one lane"):
        label_lanes([])


def test_examples_have_all_columns_and_no_target_that_a_stage_has_used():
    both = lanes()
    assert len(make_training_set(both, columns=["a"]).label) == 6
    assert make_training_set(both, columns=["a", "b"]).label.tolist() == [1, 1, 1, 1]
    truth = both[0][3]
    spent = [truth[:1], truth[:0]]
    left = make_training_set(both, columns=["a"], spent=spent)
    assert left.label.tolist() == [1, 0, 1, 1, 0]
    assert left.lane.tolist() == ["first"] * 2 + ["second"] * 3


def test_simulants_are_no_mines_and_values_come_in_the_order_asked_for():
    assert count_mines([truth for *_, truth, _ in lanes()]) == 2
    values, complete = feature_values(lanes()[0][2], ["b", "a"])
    np.testing.assert_array_equal(values[0], [1.0, 1.0])
    assert complete.tolist() == [True, True, False, True]
