"""Files of a score: depth classes, JSON, and the truth that a result was scored with."""

import json

import numpy as np
import pandas as pd
import pytest

from flgpr.results.result import add_files, read_result
from flgpr.results.score import (
    depth_class_bounds,
    depth_labels,
    expected_shift,
    read_scored_truth,
    roc_json,
    score_detections,
    view_score,
)
from flgpr.store.view_format import VIEW_SCORE
from small_results import small_result


def test_depth_classes_hold_every_target_once():
    few = pd.DataFrame({"depth": [0.0, 0.05, 0.05, 0.1, np.nan]})
    assert [label for label, _ in depth_class_bounds(few)] == ["0 cm", "5 cm", "10 cm"]
    assert depth_labels(few, depth_class_bounds(few)) == ["0 cm", "5 cm", "5 cm", "10 cm", None]
    many = pd.DataFrame({"depth": np.linspace(0, 0.2, 41)})
    classes = depth_class_bounds(many)
    labels = depth_labels(many, classes)
    assert len(classes) == 4
    assert None not in labels
    assert sorted(labels.count(label) for label, _ in classes) == [10, 10, 10, 11]
    assert depth_class_bounds(few.iloc[:0]) == []


def score_of(folder):
    result = read_result(small_result(folder))
    truth = pd.DataFrame(
        {
            "target_id": ["t1", "t2"],
            "kind": ["metal", "plastic"],
            "depth": [0.05, np.nan],
            "x": [0.1, -0.9],
            "y": [3.0, 2.1],
        }
    )
    return result, score_detections(result, truth)


def test_a_score_is_written_with_nulls_in_place_of_infinities(tmp_path):
    _, scored = score_of(tmp_path / "result")
    content = json.loads(roc_json(scored, {"by": "me"}))
    assert (content["format"], content["notes"]) == ("flgpr-score", {"by": "me"})
    assert content["detections"]["main"]["points"][0]["threshold"] is None
    assert content["detections"]["main"]["n_targets"] == 2


def test_the_truth_of_a_score_is_read_back_and_a_foreign_one_refused(tmp_path):
    result, scored = score_of(tmp_path / "result")
    assert read_scored_truth(result) is None
    add_files(result.folder, {VIEW_SCORE: view_score(result, scored)})
    truth, objects = read_scored_truth(result)
    assert truth["target_id"].tolist() == ["t1", "t2"]
    assert objects is None
    other = tmp_path / "other"
    (other / "view").mkdir(parents=True)
    text = (result.folder / VIEW_SCORE).read_text()
    (other / VIEW_SCORE).write_text(text.replace("t1", "t3", 1))
    with pytest.raises(ValueError, match=r"differs from what was written; run `flgpr.score` again"):
        read_scored_truth(result, other)


def test_without_soil_no_shift_is_expected(tmp_path):
    _, scored = score_of(tmp_path / "result")
    truth = scored[0].matched.truth
    for described in (
        {},
        {"soil": 5},
        {"soil": [{}]},
        {"soil": {}},
        {"soil": {"permittivity": "4"}},
    ):
        assert np.isnan(expected_shift(truth, described)).all()
    run = {"soil": {"permittivity": 4.0}, "pose": [[0.0, -8.0, 3.0, 0.0, 0.0, 0.0]]}
    shift = expected_shift(truth, run)
    assert 0 < shift[0] < 0.3
    assert np.isnan(shift[1])  # its depth is not known
