import json
import re

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.plan import plan_lane, plan_mines
from flgpr.commands.scoring import read_lanes, score_alarms
from flgpr.commands.sealed_scoring import score_sealed, seal_truth_file
from flgpr.model import Lane
from flgpr.scoring import pd_mean, roc
from flgpr.store import read_table
from flgpr.trials import content_hash, head_of, read_register, register

LANE = "x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 60.0\n"
PHRASE = "correct horse battery"


@pytest.fixture
def files(tmp_path):
    (tmp_path / "lane.toml").write_text(LANE)
    (tmp_path / "recipe.toml").write_text("name = 'x'\n")
    (tmp_path / "truth.csv").write_text(
        "target_id,x,y,kind,depth\na,0,10,metal,0\nb,1,30,plastic,0.05\n"
    )
    (tmp_path / "alarms.csv").write_text("x,y,confidence\n0.1,10.2,3\n-1,50,2\n1,30,1\n")
    (tmp_path / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,5\nplastic,0.1,3\n")
    return tmp_path


def test_an_alarm_list_is_scored_without_a_result_folder(files):
    (scored,) = score_alarms(
        files / "alarms.csv", files / "truth.csv", files / "lane.toml", files / "score", draws=20
    )  # fmt: skip
    told = json.loads((files / "score" / "roc.json").read_text())
    curve = roc(
        read_table(files / "alarms.csv", "alarms"),
        read_table(files / "truth.csv", "truth"),
        Lane(-2, 2, 0, 60),
    )
    assert (
        scored.pd_mean["value"] == pd_mean(curve) == told["detections"]["main"]["pd_mean"]["value"]
    )
    assert told["notes"]["alarms_sha256"] == content_hash(files / "alarms.csv")
    for name in ("report.html", "roc.json", "roc.png", "roc.pdf"):
        assert (files / "score" / name).stat().st_size > 0


def test_the_command_line_tells_what_is_found_at_the_operating_point(files):
    truth, lane, home = (str(files / name) for name in ("truth.csv", "lane.toml", "score"))
    given = ["score", str(files / "alarms.csv"), "--truth", truth, "--lane", lane, "-o", home]
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


def test_the_truth_stays_closed_until_the_recipe_is_registered(files):
    book = files / "book.jsonl"
    arguments = (files / "alarms.csv", files / "truth.csv", files / "lane.toml", files / "score")
    with pytest.raises(FileNotFoundError, match="register not found"):
        score_alarms(*arguments, recipe=files / "recipe.toml", register=book)
    register(book, recipe=content_hash("another"))
    with pytest.raises(ValueError, match="recipe must be registered"):
        score_alarms(*arguments, recipe=files / "recipe.toml", register=book)
    with pytest.raises(ValueError, match="must be given together"):
        score_alarms(*arguments, recipe=files / "recipe.toml")
    register(book, recipe=content_hash(files / "recipe.toml"))
    assert not (files / "score").exists()
    score_alarms(*arguments, recipe=files / "recipe.toml", register=book, draws=20)
    assert read_register(book)[-1]["event"] == "truth opened"


def test_a_truth_is_sealed_and_scored_blind(files):
    pytest.importorskip("cryptography")
    sealed = seal_truth_file(files / "truth.csv", files / "lane.toml", files / "sealed", PHRASE)
    score = score_sealed(files / "alarms.csv", sealed, PHRASE, files / "blind")
    assert score.counts["n_targets"] == 2
    told = json.loads((files / "blind" / "roc.json").read_text())
    assert told["notes"] == {
        "looks": 1, "lists": 1, "alarms_sha256": content_hash(files / "alarms.csv"),
        "sealed_sha256": content_hash(sealed), "log": head_of(read_register(f"{sealed}.log.jsonl")),
    }  # fmt: skip
    assert "threshold" not in told["detections"]["main"]["points"][0]
    assert "targets" not in told["detections"]["main"]
    with pytest.raises(FileNotFoundError, match="sealed truth not found"):
        score_sealed(files / "alarms.csv", files / "none", PHRASE)


def test_a_lane_is_planned_once_and_registered_with_its_recipe(files):
    plan, line = plan_lane(files / "lane.toml", files / "sorts.csv", files / "plan.csv", 7, recipe=files / "recipe.toml"
    )  # fmt: skip
    pd.testing.assert_frame_equal(read_table(files / "plan.csv", "truth"), plan)
    assert line["plan"] == content_hash(files / "plan.csv")
    assert line["recipe"] == content_hash(files / "recipe.toml")
    assert "seed" not in line, "who knows the seed has the plan"
    assert plan.attrs["seed"] == 7
    with pytest.raises(FileExistsError, match="drawn once"):
        plan_lane(files / "lane.toml", files / "sorts.csv", files / "plan.csv", 8)
    book = files / "plan.csv.register.jsonl"
    score_alarms(
        files / "alarms.csv", files / "plan.csv", files / "lane.toml", files / "score", draws=20,
        recipe=files / "recipe.toml", register=book,
    )  # fmt: skip
    assert (
        json.loads((files / "score" / "roc.json").read_text())["notes"]["recipe_registered"]
        == line["time"]
    )


def test_a_sample_size_is_told_in_words():
    assert plan_mines().mines == 29
    words = CliRunner().invoke(app, ["plan", "mines"]).stdout
    assert "29 mines" in words.splitlines()[1]
    believed = ["--true-pd", "0.97", "--true-far", "0.005"]
    words = CliRunner().invoke(app, ["plan", "mines", *believed]).stdout
    assert len(words.splitlines()) == 5


def test_lanes_come_as_toml_or_csv_one_or_several(files):
    assert read_lanes(files / "lane.toml") == Lane(-2, 2, 0, 60)
    two = files / "two.toml"
    two.write_text("[a]\n" + LANE + "[b]\n" + LANE)
    assert read_lanes(two) == {"a": Lane(-2, 2, 0, 60), "b": Lane(-2, 2, 0, 60)}
    table = files / "lanes.csv"
    table.write_text("lane,x_min,x_max,y_min,y_max\na,-2,2,0,60\n")
    assert read_lanes(table) == {"a": Lane(-2, 2, 0, 60)}
    two.write_text("x_min = 1\n")
    with pytest.raises(ValueError, match=r"two.toml: lane must hold"):
        read_lanes(two)
    two.write_text("a = 1\n")
    with pytest.raises(ValueError, match=r"two.toml"):
        read_lanes(two)
    with pytest.raises(FileNotFoundError, match="lane file not found"):
        read_lanes(files / "none.toml")
