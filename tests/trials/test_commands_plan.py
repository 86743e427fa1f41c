"""Plans of tests: lanes that are drawn and registered, and sizes of samples."""

import json

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
