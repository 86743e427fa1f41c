"""Scores in the viewer's form: open, blind and compared ones, without positions."""

import json

import pytest

from flgpr.viewer.scores import ScoreFiles, score_file

NAMES = ("pd", "pd_low", "pd_high", "chance", "far", "far_low", "far_high")


def row(far, **more):
    return dict.fromkeys(NAMES, 0.5) | {"far": far, "n_detected": 1, "n_false": 2} | more


def written(folder, **content):
    folder.mkdir()
    head = {"format": "flgpr-score", "version": 1, "rules": {"level": 0.9, "halo_radius": 1.0}}
    (folder / "roc.json").write_text(json.dumps(head | {"notes": {}} | content))
    return folder / "roc.json"


def test_an_open_score_has_its_curve_and_points_by_kind(tmp_path):
    kinds = {"metal": {"n_targets": 1, "points": [row(0.1, far_allowed=0.1)]}}
    entry = {
        "points": [row(0.0, threshold=None), row(0.02, threshold=3.0), row(0.2, threshold=1.0)],
        "n_targets": 2,
        "area": 50.0,
        "kinds": kinds,
        "operating_point": {"far_asked": 0.05, "far_allowed": 0.05},
        "targets": [{"target_id": "t", "kind": "metal", "depth": 0.1, "x": 3.0, "far": 0.02}],
    }
    path = written(tmp_path / "score", detections={"main": entry}, notes={"truth_sha256": "d"})
    score = json.loads(ScoreFiles(path).score_bytes())
    main = score["detections"]["main"]
    assert main["curves"][0]["threshold"] == [None, 3.0, 1.0]
    assert main["curves"][0]["point"]["row"] == 1  # the last row that is allowed
    groups = [(point["group"], point["far_allowed"]) for point in main["points"]]
    assert groups == [("all", 0.05), ("all", 0.1), ("metal", 0.1)]
    assert main["targets"] == [
        {"target_id": "t", "kind": "metal", "depth": 0.1, "far": 0.02, "confidence": None}
    ]
    assert score["rules"]["truth"] == "d"


def test_a_blind_score_has_points_only(tmp_path):
    points = [row(0.1, far_allowed=0.1, n_targets=4, group=group) for group in ("all", "metal")]
    path = written(tmp_path / "score", detections={"main": {"points": points}})
    files = ScoreFiles(path)
    main = json.loads(files.score_bytes())["detections"]["main"]
    assert main["curves"][0]["allowed"] == [0.1]
    assert [point["group"] for point in main["points"]] == ["all", "metal"]
    assert (files.tile(0, 0, 0), files.evidence(0, 0)) == (None, None)
    assert json.loads(files.index_bytes())["layers"] == []


def test_a_comparison_has_a_detection_per_detector(tmp_path):
    points = []
    for detector in ("b", "a", "b"):
        points.append(row(0.1, far_allowed=0.1, n_targets=4, detector=detector))
    path = written(tmp_path / "score", format="flgpr-comparison", points=points)
    detections = json.loads(ScoreFiles(path).score_bytes())["detections"]
    assert {name: len(entry["points"]) for name, entry in detections.items()} == {"b": 2, "a": 1}


def test_a_score_is_found_in_its_folder_or_by_its_file(tmp_path):
    path = written(tmp_path / "score")
    assert score_file(tmp_path / "score") == path
    assert score_file(path) == path
    assert score_file(tmp_path) is None


def test_what_is_no_score_is_refused(tmp_path):
    path = written(tmp_path / "score", version=2)
    with pytest.raises(ValueError, match=r"not a score that can be shown .*version 1"):
        ScoreFiles(path)
