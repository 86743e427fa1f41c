"""Plans of tests: lanes that are drawn and registered, and sizes of samples."""

import json
import math

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.store import read_table
from flgpr.trials import content_hash
from flgpr_trials.commands.plan import plan_lane, plan_mines
from scored import score_alarms


def test_a_lane_is_planned_once_and_registered_with_its_recipe(scoring_files):
    plan, line = plan_lane(
        scoring_files / "lane.toml",
        scoring_files / "sorts.csv",
        scoring_files / "plan.csv",
        7,
        recipe=scoring_files / "recipe.toml",
    )
    pd.testing.assert_frame_equal(read_table(scoring_files / "plan.csv", "truth"), plan)
    assert line["plan"] == content_hash(scoring_files / "plan.csv")
    assert line["recipe"] == content_hash(scoring_files / "recipe.toml")
    assert "seed" not in line, "who knows the seed has the plan"
    assert plan.attrs["seed"] == 7
    with pytest.raises(FileExistsError, match="drawn once"):
        plan_lane(
            scoring_files / "lane.toml", scoring_files / "sorts.csv", scoring_files / "plan.csv", 8
        )
    book = scoring_files / "plan.csv.register.jsonl"
    score_alarms(
        scoring_files / "alarms.csv",
        scoring_files / "plan.csv",
        scoring_files / "lane.toml",
        scoring_files / "score",
        draws=20,
        recipe=scoring_files / "recipe.toml",
        register=book,
    )
    assert (
        json.loads((scoring_files / "score" / "roc.json").read_text())["notes"]["recipe_registered"]
        == line["time"]
    )


def test_a_sample_size_is_told_in_words():
    assert plan_mines().mines == 29
    words = CliRunner().invoke(app, ["plan", "mines"]).stdout
    assert "29 mines" in words.splitlines()[1]
    believed = ["--true-pd", "0.97", "--true-far", "0.005"]
    words = CliRunner().invoke(app, ["plan", "mines", *believed]).stdout
    assert len(words.splitlines()) == 5
    words = CliRunner().invoke(app, ["plan", "mines", "--far", "10"]).stdout
    assert "  1 m² of ground" in words, "0.3 m² are no 0 m²"


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"far": -1.0}, "far must be positive and finite, got -1"),
        ({"halo": 0.0}, "halo must be positive and finite, got 0"),
        ({"halo": math.nan}, "halo must be positive and finite, got nan"),
    ],
)
def test_rules_by_which_nothing_can_be_scored_are_not_registered(scoring_files, option, words):
    files = [scoring_files / name for name in ("lane.toml", "sorts.csv", "plan.csv")]
    with pytest.raises(ValueError, match=words):
        plan_lane(*files, 7, **option)
    assert not [path for path in scoring_files.iterdir() if path.name.startswith("plan")]


def test_a_plan_of_depths_in_centimetres_is_doubted(scoring_files, caplog):
    caplog.set_level("INFO", "flgpr.notes")
    (scoring_files / "cm.csv").write_text("kind,depth,count\nmetal,5,2\n")
    plan_lane(scoring_files / "lane.toml", scoring_files / "cm.csv", scoring_files / "plan.csv", 7)
    assert "are these centimetres?" in caplog.text


def test_one_anchor_ties_no_two_lanes(scoring_files):
    (scoring_files / "lanes.csv").write_text(
        "lane,x_min,x_max,y_min,y_max\nA,-2,2,0,50\nB,-2,2,0,50\n"
    )
    (scoring_files / "anchor.toml").write_text(
        'crs = "EPSG:4326"\naccuracy = 0.02\nazimuth_deg = 0.0\nazimuth_accuracy_deg = 0.1\n'
        "[[point]]\nlane = [0.0, 0.0]\nlongitude = 15.0\nlatitude = 48.0\n"
    )
    files = [scoring_files / name for name in ("lanes.csv", "sorts.csv", "plan.csv")]
    with pytest.raises(ValueError, match=r"anchor ties one lane .* got rows of 2 lanes \(A, B\)"):
        plan_lane(*files, 7, anchor=scoring_files / "anchor.toml")
    assert not (scoring_files / "plan.csv").exists()
