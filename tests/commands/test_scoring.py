"""Alarm lists of any detector are scored against an open truth, from Python and by command."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.entrants import entrant_names, find_entrants
from flgpr.commands.scoring import Scored, read_lanes
from flgpr.model import Lane
from flgpr.scoring import pd_mean, roc
from flgpr.store import read_table
from flgpr.trials import content_hash, read_register, register
from scored import compare_alarms, score_alarms

PHRASE = "correct horse battery"


def test_an_alarm_list_is_scored_without_a_result_folder(scoring_files):
    (scored,) = score_alarms(
        scoring_files / "alarms.csv",
        scoring_files / "truth.csv",
        scoring_files / "lane.toml",
        scoring_files / "score",
        draws=20,
    )
    told = json.loads((scoring_files / "score" / "roc.json").read_text())
    curve = roc(
        read_table(scoring_files / "alarms.csv", "alarms"),
        read_table(scoring_files / "truth.csv", "truth"),
        Lane(-2, 2, 0, 60),
    )
    assert (
        scored.pd_mean["value"] == pd_mean(curve) == told["detections"]["main"]["pd_mean"]["value"]
    )
    assert told["notes"]["alarms_sha256"] == content_hash(scoring_files / "alarms.csv")
    for name in ("report.html", "roc.json", "roc.png", "roc.pdf"):
        assert (scoring_files / "score" / name).stat().st_size > 0


@pytest.mark.slow("draws all figures of a score")
def test_the_command_line_tells_what_is_found_at_the_operating_point(scoring_files):
    truth, lane, home = (str(scoring_files / name) for name in ("truth.csv", "lane.toml", "score"))
    given = [
        "score",
        str(scoring_files / "alarms.csv"),
        "--truth",
        truth,
        "--lane",
        lane,
        "-o",
        home,
    ]
    told = CliRunner().invoke(app, given).stdout
    assert re.search(r"b: plastic, 5.0 cm +│ found +│ +0.0043 ", told)
    assert (
        "main: 2 of 2 targets found at 0.05 false alarms per m²: Pd 1.00, 95 % interval 0.16 to 1.00, chance 0."
        in told
    )
    refused = CliRunner().invoke(app, [*given, "--far", "0.001"])
    assert refused.exit_code == 2
    assert "--overwrite makes it again" in refused.stderr
    given.append("--overwrite")
    told = CliRunner().invoke(app, [*given, "--far", "0.001"]).stdout
    assert re.search(r"b: plastic, 5.0 cm +│ found", told)
    assert "at one false alarm (0.0043 per m²; 233.72 m² are too small for 0.001)" in told
    summary = json.loads(CliRunner().invoke(app, [*given, "--far", "0.02", "--json"]).stdout)
    assert (summary["found"], summary["false_alarms"]) == (2, 1)
    assert summary["operating_point"]["far_asked"] == summary["rules"]["far"] == 0.02
    assert [row["found"] for row in summary["outcomes"]] == [True, True]
    refused = CliRunner().invoke(app, [*given, "--far", "0"])
    assert refused.exit_code == 2
    assert "far must be a positive number of false alarms per m², got 0" in refused.stderr


def test_the_truth_stays_closed_until_the_recipe_is_registered(scoring_files):
    book = scoring_files / "book.jsonl"
    arguments = (
        scoring_files / "alarms.csv",
        scoring_files / "truth.csv",
        scoring_files / "lane.toml",
        scoring_files / "score",
    )
    with pytest.raises(FileNotFoundError, match="register not found"):
        score_alarms(*arguments, recipe=scoring_files / "recipe.toml", register=book)
    register(book, recipe=content_hash("another"))
    with pytest.raises(ValueError, match="what fixes the detector must be registered"):
        score_alarms(*arguments, recipe=scoring_files / "recipe.toml", register=book)
    with pytest.raises(ValueError, match=r"`recipe` needs a register: .* give it by `book`"):
        score_alarms(*arguments, recipe=scoring_files / "recipe.toml")
    register(book, recipe=content_hash(scoring_files / "recipe.toml"))
    assert not (scoring_files / "score").exists()
    score_alarms(*arguments, recipe=scoring_files / "recipe.toml", register=book, draws=20)
    assert read_register(book)[-1]["event"] == "truth opened"


def test_lanes_come_as_toml_or_csv_one_or_several(scoring_files):
    assert read_lanes(scoring_files / "lane.toml") == Lane(-2, 2, 0, 60)
    lane = (scoring_files / "lane.toml").read_text()
    two = scoring_files / "two.toml"
    two.write_text("[a]\n" + lane + "[b]\n" + lane)
    assert read_lanes(two) == {"a": Lane(-2, 2, 0, 60), "b": Lane(-2, 2, 0, 60)}
    table = scoring_files / "lanes.csv"
    table.write_text("lane,x_min,x_max,y_min,y_max\na,-2,2,0,60\n")
    assert read_lanes(table) == {"a": Lane(-2, 2, 0, 60)}
    two.write_text("x_min = 1\n")
    with pytest.raises(ValueError, match=r"two.toml: lane must hold"):
        read_lanes(two)
    two.write_text("a = 1\n")
    with pytest.raises(ValueError, match=r"two.toml"):
        read_lanes(two)
    with pytest.raises(FileNotFoundError, match="lane file not found"):
        read_lanes(scoring_files / "none.toml")


def test_lists_are_named_by_file_or_by_path_where_files_have_one_name(scoring_files):
    (scoring_files / "b").mkdir()
    paths = [scoring_files / "alarms.csv", scoring_files / "other.csv"]
    paths.append(scoring_files / "b" / "alarms.csv")
    for path in paths[1:]:
        path.write_text("x,y,confidence\n0,10,1\n")
    assert entrant_names(find_entrants(paths[:2], [])) == ["alarms", "other"]
    assert entrant_names(find_entrants(paths, [])) == [str(path) for path in paths]
    with pytest.raises(ValueError, match="alarms must be different lists to be compared"):
        entrant_names(find_entrants([paths[0], paths[0]], []))
    with pytest.raises(ValueError, match="once per alarm list, got 1 for 2 lists"):
        find_entrants(paths[:2], ["demo"])


def test_lists_are_compared_on_a_lane_that_is_given(scoring_files):
    other = scoring_files / "other.csv"
    other.write_text("x,y,confidence\n0,10,1\n")
    lists = [scoring_files / "alarms.csv", other]
    arguments = (lists, scoring_files / "truth.csv", scoring_files / "both")
    with pytest.raises(ValueError, match=r"alarm lists need `lane` to be compared, .* got 0 lanes"):
        compare_alarms(*arguments)
    assert not (scoring_files / "both").exists()
    compare_alarms(*arguments, lane=scoring_files / "lane.toml")
    told = json.loads((scoring_files / "both" / "comparison.json").read_text())
    assert set(told["notes"]) == {"alarms", "other"}
    assert told["notes"]["other"]["alarms_sha256"] == content_hash(other)


def test_outcomes_have_a_row_for_each_target(scoring_files):
    scores = score_alarms(
        scoring_files / "alarms.csv",
        scoring_files / "truth.csv",
        scoring_files / "lane.toml",
        scoring_files / "score",
        draws=20,
    )
    outcomes = Scored(scoring_files, scores).outcomes()
    assert outcomes["target_id"].tolist() == ["a", "b"]
    assert outcomes["detected"].all()
    assert outcomes["distance"].tolist() == pytest.approx([np.hypot(0.1, 0.2), 0.0])
    assert set(outcomes["detection"]) == {scores[0].name}


def test_without_the_package_of_trials_open_truths_alone_are_scored(scoring_files, monkeypatch):
    monkeypatch.setattr("flgpr.commands.trials.entry_points", lambda group: [])
    truth, lane = scoring_files / "truth.csv", scoring_files / "lane.toml"
    arguments = (scoring_files / "alarms.csv", truth, lane, scoring_files / "score")
    assert score_alarms(*arguments, draws=20)
    notes = json.loads((scoring_files / "score" / "roc.json").read_text())["notes"]
    assert list(notes) == ["alarms_sha256", "truth_sha256"]
    with pytest.raises(ValueError, match="flgpr_trials is needed for `recipe` and `book`, and is"):
        score_alarms(*arguments, recipe="demo", register=scoring_files / "book.jsonl")
    read_table(truth, "truth").assign(book="plan.jsonl").to_csv(truth, index=False)
    with pytest.raises(ValueError, match=r"needed for .*truth.csv, which names a register, and is"):
        score_alarms(*arguments)
    given = ["score", str(arguments[0]), "--sealed", str(truth), "-o", str(scoring_files / "s")]
    refused = CliRunner().invoke(app, given)
    assert refused.stderr.count("\n") == 1
    assert "flgpr_trials is needed for --sealed" in refused.stderr


def test_an_earlier_spelling_is_told_once_on_the_error_stream(scoring_files):
    alarms, truth, lane = (
        str(scoring_files / name) for name in ("alarms.csv", "truth.csv", "lane.toml")
    )
    (scoring_files / "other.csv").write_text("x,y,confidence\n0,10,1\n")
    given = [alarms, str(scoring_files / "other.csv"), "--truth", truth, "--lane", lane, "-o"]
    now = CliRunner().invoke(app, ["compare", *given, str(scoring_files / "now")])
    before = CliRunner().invoke(app, ["score", *given, str(scoring_files / "before")])
    assert before.stdout.replace("before/", "now/") == now.stdout
    assert now.stderr == ""
    assert before.stderr == "`flgpr score` of several lists is `flgpr compare` now\n"
    quiet = CliRunner().invoke(app, ["score", *given, str(scoring_files / "before"), "--quiet"])
    assert (quiet.exit_code, quiet.stderr) == (0, "")
    files = ("comparison.html", "comparison.json")
    for name in files:
        told = [(scoring_files / home / name).read_bytes() for home in ("now", "before")]
        assert told[0] == told[1]
    asked = CliRunner().invoke(
        app, ["compare", *given, str(scoring_files / "now"), "--far", "0.1", "--overwrite"]
    )
    answer = asked.stdout.splitlines()[-2]
    assert answer.startswith("At 0.1 false alarms per m²: alarms 2 of 2, other ")
    assert f"<b>{answer}</b>" in (scoring_files / "now" / "comparison.html").read_text()
    folder = scoring_files / "now"
    refused = CliRunner().invoke(app, ["compare", alarms, str(folder), *given[2:], str(folder)])
    assert f"a folder must be a result of `flgpr detect`, got {folder}" in refused.stderr
    refused = CliRunner().invoke(app, ["compare", alarms, given[1]])
    assert "--truth is needed" in refused.stderr
    refused = CliRunner().invoke(app, ["compare", alarms, "--truth", truth, "--lane", lane])
    assert "alarms must be two or more to be compared, got 1" in refused.stderr
