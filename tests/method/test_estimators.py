"""Detectors that are shown only what is no mine: what is unlike it scores high, in memory and from a file."""

import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from alone import needs
from flgpr.detect.estimator_table import trained_class
from flgpr.method.classifier import TrainingSet
from flgpr.method.estimators import TrainedEstimator, probability, train_estimator
from flgpr.method.model import Model, load_model, save_model
from flgpr.recipe.tables import DetectorTable

RIVAL = needs("flgpr_ground")

COLUMNS = ["a", "b"]


@pytest.fixture
def examples():
    rng = np.random.default_rng(3)
    features = pd.DataFrame(
        np.concatenate([rng.normal(0, 1, (200, 2)), rng.normal(4, 1, (20, 2))]), columns=COLUMNS
    )
    label = np.repeat([0, 1], [200, 20])
    return TrainingSet(features, label, np.ones(220, int), np.repeat("lane", 220))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("isolation-forest", marks=RIVAL),
        "one-class-svm",
        pytest.param("ecod", marks=RIVAL),
        pytest.param("copod", marks=RIVAL),
        pytest.param("knn", marks=RIVAL),
    ],
)
def test_mines_score_high_though_none_was_shown(examples, name, tmp_path):
    options = {"random_state": 0} if name == "isolation-forest" else {}
    table = DetectorTable(estimator=name, features=COLUMNS, on="clutter", options=options)
    made = train_estimator(examples, table, COLUMNS)
    score = made.confidence(examples.features)
    assert np.median(score[examples.label == 1]) > np.quantile(score[examples.label == 0], 0.9)
    other = examples.features.copy()
    other.loc[examples.label == 1] = 50.0
    again = train_estimator(replace(examples, features=other), table, COLUMNS)
    np.testing.assert_array_equal(
        again.confidence(examples.features), score
    )  # the mines did not enter
    save_model(Model(detector=made), tmp_path / "model", {})
    kept = load_model(tmp_path / "model").detector
    assert isinstance(kept, TrainedEstimator)
    np.testing.assert_array_equal(kept.confidence(examples.features), score)


@pytest.mark.parametrize(
    ("name", "on", "mine"),
    [
        pytest.param("isolation-forest", "clutter", -1, marks=RIVAL),
        ("one-class-svm", "clutter", -1),
        ("one-class-svm", "mines", 1),
        pytest.param("mixture", "mines", 1, marks=RIVAL),
        pytest.param("ecod", "clutter", 1, marks=RIVAL),
        pytest.param("knn", "clutter", 1, marks=RIVAL),
        ("svm", "all", 1),
        ("logistic", "all", 1),
        ("lda", "all", 1),
        ("rvm", "all", 1),
        pytest.param("random-forest", "all", 1, marks=RIVAL),
    ],
)
def test_the_border_is_where_the_estimator_itself_decides(examples, name, on, mine):
    made = train_estimator(
        examples, DetectorTable(estimator=name, features=COLUMNS, on=on), COLUMNS
    )
    values = (examples.features.to_numpy() - made.centre) / made.scale
    shown = {
        "all": values,
        "mines": values[examples.label == 1],
        "clutter": values[examples.label == 0],
    }[on]
    options = (
        {"random_state": 0} if name in ("isolation-forest", "random-forest", "mixture") else {}
    )
    made = train_estimator(
        examples, DetectorTable(estimator=name, features=COLUMNS, on=on, options=options), COLUMNS
    )
    estimator = trained_class(name)(**options)
    estimator.fit(shown, *((examples.label,) if on == "all" else ()))
    decided = estimator.predict(values) == mine
    score = made.confidence(examples.features)
    clear = np.abs(score - made.border) > 1e-9
    np.testing.assert_array_equal((score > made.border)[clear], decided[clear])
    assert 0 < decided.sum() < len(decided)


@RIVAL
def test_a_lane_without_clutter_cannot_train_it(examples):
    mines = examples.label == 1
    only = TrainingSet(
        examples.features[mines],
        examples.label[mines],
        examples.weight[mines],
        examples.lane[mines],
    )
    table = DetectorTable(estimator="isolation-forest", features=COLUMNS, on="clutter")
    with pytest.raises(ValueError, match="needs false alarms, got 20 hits and 0 false alarms"):
        train_estimator(only, table, COLUMNS)


@RIVAL
def test_without_pyod_its_estimators_say_what_they_need(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyod.models.ecod", None)
    with pytest.raises(
        ModuleNotFoundError, match=r"ecod needs PyOD: pip install 'flgpr\[benchmark\]'"
    ):
        trained_class("ecod")


@pytest.fixture
def wide_examples():
    rng = np.random.default_rng(5)
    label = np.repeat([0, 1], [90, 30])
    values = rng.normal(size=(120, 3)) + np.outer(label, [2.0, 1.0, 0.0])
    features = pd.DataFrame(values, columns=["C_F1", "C_F2", "M_F1"])
    return TrainingSet(features, label, np.ones(120, int), np.repeat("lane", 120))


@RIVAL
def test_every_entry_of_the_features_is_a_kernel_of_its_own(wide_examples, tmp_path):
    table = DetectorTable(estimator="mkl", features=["C_*", "M_*"])
    columns = list(wide_examples.features)
    made = train_estimator(wide_examples, table, columns)
    assert made.scorer.group.tolist() == [0, 0, 1]
    assert made.scorer.kernel_weight[0] > made.scorer.kernel_weight[1]
    score = made.confidence(wide_examples.features)
    assert score[wide_examples.label == 1].mean() > score[wide_examples.label == 0].mean() + 1
    save_model(Model(detector=made), tmp_path / "model", {})
    kept = load_model(tmp_path / "model").detector
    np.testing.assert_array_equal(kept.confidence(wide_examples.features), score)
    again = train_estimator(wide_examples, table, columns)
    for name, array in made.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)


@RIVAL
def test_a_column_belongs_to_the_first_entry_that_names_it_or_to_itself(wide_examples):
    columns = list(wide_examples.features)
    for entries, groups in (
        (["*_F1", "C_*"], [0, 1, 2]),  # M_F1 does not follow C_F1
        (["*"], [0, 0, 0]),
        (["C_F1"], [0, 1, 2]),
    ):
        table = DetectorTable(estimator="mkl", features=entries)
        made = train_estimator(wide_examples, table, columns)
        assert made.scorer.group.tolist() == groups, entries


@RIVAL
def test_groups_are_no_option(wide_examples):
    table = DetectorTable(estimator="mkl", features=["C_*"], options={"groups": "3"})
    with pytest.raises(ValueError, match=r"options of mkl must not hold groups, .* got '3'"):
        train_estimator(wide_examples, table, list(wide_examples.features))


def test_log_odds_are_a_probability_within_its_bounds():
    assert probability(0.0) == 0.5
    assert probability(np.log(9)) == pytest.approx(0.9)
    assert 0 < probability(-1e4) < 1e-12 < 1 - 1e-12 < probability(1e4) <= 1
