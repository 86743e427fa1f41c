"""The JSON of scores keeps to the published schemas, and altered ones do not."""

import copy
import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.model import Lane
from flgpr.results.result import read_result
from flgpr.results.score import (
    comparison_json,
    roc_json,
    score_detections,
)
from flgpr.scoring import Rules, match, score, score_frames, side_by_side
from published_schemas import check, keeps_to
from small_results import LANE, small_result

TRUTH = pd.DataFrame(
    {
        "target_id": ["t1", "t2"],
        "kind": ["metal", "plastic"],
        "depth": [0.05, np.nan],
        "x": [0.1, -0.9],
        "y": [3.0, 2.1],
    }
)
ALARMS = pd.DataFrame({"x": [0.1, -0.7, 0.9], "y": [3.0, 3.5, 2.2], "confidence": [9.0, 4.0, 2.5]})
FEW = Rules(halo=0.25, draws=20, shifts=10)


def scored_json(scored):
    return json.loads(roc_json([scored], {"by": "me"}))


def test_the_command_writes_and_prints_what_the_schemas_say(tmp_path):
    ALARMS.to_csv(tmp_path / "alarms.csv", index=False)
    TRUTH.to_csv(tmp_path / "truth.csv", index=False)
    (tmp_path / "lane.toml").write_text("x_min = -1.0\nx_max = 1.0\ny_min = 2.0\ny_max = 4.0\n")
    words = [
        "score", tmp_path / "alarms.csv", "--truth", tmp_path / "truth.csv",
        "--lane", tmp_path / "lane.toml", "--halo", 0.25, "-o", tmp_path / "score", "--json",
    ]  # fmt: skip
    ran = CliRunner().invoke(app, [str(word) for word in words])
    assert ran.exit_code == 0, ran.output
    summary = json.loads(ran.stdout)
    check("score-summary", summary)
    check("score", json.loads((tmp_path / "score" / "roc.json").read_text()))
    assert not keeps_to("score-summary", summary | {"area_m2": "wide"})
    assert not keeps_to("score-summary", summary | {"found": None})


@pytest.mark.parametrize(
    "rules",
    [FEW, Rules(halo=0.25, draws=20, shifts=10, survey_error=0.05, area="paper")],
    ids=["plain", "survey"],
)
def test_a_score_keeps_to_the_schema(rules):
    content = scored_json(score(ALARMS, TRUTH.assign(soil="sand"), LANE, rules))
    check("score", content)
    assert ("survey_error" in content["rules"]) == (rules.survey_error is not None)


def test_a_score_of_a_lane_without_targets_keeps_to_the_schema():
    content = scored_json(score(ALARMS, TRUTH.iloc[:0], LANE, FEW))
    assert content["detections"]["main"]["pd_mean"] is None
    check("score", content)


def test_a_score_by_frames_keeps_to_the_schema():
    poses = {0: [0, 0, 3, 0, 0, 0], 1: [0, 2, 3, 0, 0, 0]}
    alarms = pd.DataFrame({"frame": [0, 1], "across": [-4.0, 1.1], "ahead": [7.0, 6.0]})
    truth = TRUTH.iloc[:1].assign(x=1.0, y=8.0)
    area = Lane(-7.0, 7.0, 5.0, 10.0)
    check(
        "score", scored_json(score_frames(alarms.assign(confidence=1.0), poses, truth, area, FEW))
    )


def altered(content, path, value):
    """Return a copy of a document in which a member has another value; ``...`` takes it away."""
    changed = copy.deepcopy(content)
    inner = changed
    for step in path[:-1]:
        inner = inner[step]
    if value is ...:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return changed


MAIN = ("detections", "main")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["format"], "flgpr-scores"),
        (["version"], 2),
        (["nonsense"], 1),
        (["notes"], ...),
        (["rules", "area_rule"], "halo"),
        (["rules", "bootstrap", "seed"], ...),
        ([*MAIN, "n_targets"], -1),
        ([*MAIN, "points", 0, "pd"], 1.5),
        ([*MAIN, "points", 0, "threshold"], ...),
        ([*MAIN, "operating_point", "far_asked"], "0.05"),
        ([*MAIN, "pd_mean", "low"], "none"),
        ([*MAIN, "kinds", "metal", "points", 0, "threshold"], 3.0),
        ([*MAIN, "targets", 0, "found"], 1),
        ([*MAIN, "targets", 0, "kind"], ...),
        ([*MAIN, "targets", 0, "x"], None),
    ],
    ids=lambda value: ".".join(map(str, value)) if isinstance(value, list) else None,
)
def test_an_altered_score_is_refused(tmp_path, path, value):
    content = scored_json(score(ALARMS, TRUTH, LANE, FEW))
    assert keeps_to("score", content)
    assert not keeps_to("score", altered(content, path, value))


@pytest.mark.parametrize("show", ["curve", "targets"])
def test_a_blind_score_keeps_to_the_schema_and_shows_no_more(tmp_path, show):
    pytest.importorskip("cryptography")
    from flgpr.trials import score_blind, seal_truth
    from flgpr_trials.commands.scores import blind_roc_json

    phrase = "correct horse battery"
    sealed = seal_truth(TRUTH, LANE, tmp_path / "sealed", phrase, halo=0.25, show=show)
    blind = score_blind(ALARMS, sealed, phrase)
    content = json.loads(blind_roc_json(blind, {"sealed_sha256": "0" * 64}))
    check("score", content)
    assert ("targets" in content["detections"]["main"]) == (show == "targets")
    assert not keeps_to("score", altered(content, [*MAIN, "points", 0, "threshold"], 3.0))
    assert not keeps_to("score", altered(content, ["notes", "looks"], 0))


def test_a_comparison_keeps_to_the_schema():
    matches = {"a": match(ALARMS, TRUTH, LANE, 0.25), "b": match(ALARMS[1:], TRUTH, LANE, 0.25)}
    compared = side_by_side(matches, [0.05, 0.5], FEW)
    stated = score(ALARMS, TRUTH, LANE, FEW).rules_summary()
    rules = {**stated, "far_max": FEW.far_max}
    content = json.loads(comparison_json(compared, rules, {"a": {}, "b": {"vendor": "v"}}))
    check("comparison", content)
    points_only = side_by_side(matches, [0.05], FEW, means=False)
    sealed_rules = {"halo_radius": 0.25, "area_rule": "union", "level": 0.95, "far_max": 0.1}
    check("comparison", json.loads(comparison_json(points_only, sealed_rules, {})))
    assert not keeps_to("comparison", altered(content, ["pairs", 0, "p"], 1.1))
    assert not keeps_to("comparison", altered(content, ["points", 0, "detector"], ...))
    assert not keeps_to("comparison", altered(content, ["means", 0, "low"], None))


def test_every_detection_of_a_result_is_in_its_score(tmp_path):
    scored = score_detections(read_result(small_result(tmp_path / "result")), TRUTH)
    content = json.loads(roc_json(scored, {}))
    check("score", content)
    assert "expected_shift" in content["detections"]["main"]["targets"][0]
