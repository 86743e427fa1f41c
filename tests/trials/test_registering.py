"""Alarm lists, their recipes by hash, and the registers that hold them."""

import pandas as pd
import pytest

from flgpr.recipe.schema import recipe_text
from flgpr.trials import content_hash, head_of, read_register, register
from flgpr_trials.commands.scores import (
    default_register,
    enter_recipe,
    heads_of_reports,
    read_existing_register,
    recipe_hash,
    recipe_of,
    registered_entrant,
)
from scored import find_entrant
from small_results import small_result

ALARMS = "x,y,confidence\n0.1,3,2\n"


@pytest.fixture
def alarms(tmp_path):
    path = tmp_path / "alarms-of-mine.csv"
    path.write_text(ALARMS)
    return path


def test_a_list_of_a_file_has_a_recipe_only_if_it_is_named(alarms, tmp_path):
    recipe = tmp_path / "recipe.toml"
    recipe.write_text("name = 'x'\n")
    book = tmp_path / "book.jsonl"
    line = register(book, recipe=content_hash(recipe))
    assert recipe_of(find_entrant(alarms)) is None
    entrant = find_entrant(alarms, recipe)
    assert recipe_of(entrant) == content_hash(recipe)
    assert entrant.table()["confidence"].tolist() == [2.0]
    unregistered = registered_entrant(find_entrant(alarms), None)
    assert unregistered == (None, {"alarms_sha256": content_hash(alarms)})
    _, told = registered_entrant(entrant, book)
    assert told["recipe_told_by"] == "whoever gave the list"
    assert told["recipe_registered"] == line["time"]


def test_a_result_states_its_recipe_and_another_is_refused(tmp_path):
    small_result(tmp_path / "result")
    entrant = find_entrant(tmp_path / "result")
    assert entrant.of_result
    assert recipe_of(entrant) == content_hash(recipe_text("wang2007"))
    assert recipe_of(find_entrant(tmp_path / "result", "wang2007")) == entrant.recipe
    with pytest.raises(ValueError, match=r"recipe must be the one that .*result was made with"):
        recipe_of(find_entrant(tmp_path / "result", "demo"))
    (tmp_path / "result" / "alarms.csv").write_text(ALARMS)
    with pytest.raises(ValueError, match="a changed list is scored under a name of its own"):
        find_entrant(tmp_path / "result")


def test_ends_of_lines_change_the_file_but_not_the_text(tmp_path):
    recipe = tmp_path / "recipe.toml"
    recipe.write_bytes(b"name = 'x'\r\nhalo = 1\r\n")
    hashes = recipe_hash(recipe)
    assert hashes.of_text == content_hash("name = 'x'\nhalo = 1\n")
    assert hashes.of_file != hashes.of_text
    with pytest.raises(ValueError, match=r"got the folder .*; is it a model"):
        recipe_hash(tmp_path)


def test_the_register_of_a_truth_is_named_in_it_or_lies_beside_it(tmp_path):
    truth = tmp_path / "truth.csv"
    assert default_register(truth, pd.DataFrame({"x": [1.0]})) is None
    (tmp_path / "truth.csv.register.jsonl").write_text("")
    assert default_register(truth, pd.DataFrame({"x": [1.0]})).name == "truth.csv.register.jsonl"
    named = pd.DataFrame({"book": ["plan.jsonl", "plan.jsonl"]})
    assert default_register(truth, named) == tmp_path.resolve() / "plan.jsonl"
    for names in (["a.jsonl", "b.jsonl"], ["../a.jsonl", "../a.jsonl"]):
        with pytest.raises(ValueError, match="must be the name of one register in every row"):
            default_register(truth, pd.DataFrame({"book": names}))


def test_a_recipe_is_entered_once_and_not_after_an_opening(tmp_path):
    book = tmp_path / "book.jsonl"
    with pytest.raises(FileNotFoundError, match="register not found"):
        enter_recipe("demo", book)
    register(book, event="recipe", recipe=content_hash("another"))
    line = enter_recipe("demo", book)
    assert line["recipe"] == content_hash(recipe_text("demo"))
    assert enter_recipe("demo", book) == line
    assert len(read_register(book)) == 2
    register(book, event="truth opened", truth=content_hash("truth"))
    assert enter_recipe("demo", book) == line, "it was there before"
    with pytest.raises(ValueError, match="before the truth is opened; line 3 is an opening"):
        enter_recipe("miniature", book)
    assert len(read_existing_register(book)) == 3


def test_a_recipe_and_a_register_go_together(alarms, tmp_path):
    assert registered_entrant(find_entrant(alarms), None)[0] is None
    with pytest.raises(ValueError, match="`recipe` needs a register: give it by `book`"):
        registered_entrant(find_entrant(alarms, "demo"), None)
    book = tmp_path / "book.jsonl"
    with pytest.raises(
        ValueError, match=r"detector of .*alarms-of-mine.* must stand in the register"
    ):
        registered_entrant(find_entrant(alarms), book)
    register(book, event="recipe", recipe=content_hash("another"))
    with pytest.raises(ValueError, match="what fixes the detector must be registered"):
        registered_entrant(find_entrant(alarms, "demo"), book)
    enter_recipe("demo", book)
    _, told = registered_entrant(find_entrant(alarms, "demo"), book)
    assert told["recipe_registered"] == read_register(book)[1]["time"]


def test_a_report_without_a_head_of_a_register_is_refused(tmp_path):
    book = tmp_path / "book.jsonl"
    register(book, event="recipe", recipe=content_hash("another"))
    lines = read_register(book)
    report = tmp_path / "roc.json"
    report.write_text('{"notes": {}}')
    with pytest.raises(ValueError, match=r"made with a register, got .*roc\.json"):
        heads_of_reports(lines, book, [report])
    head = head_of(lines)
    report.write_text(f'{{"notes": {{"register": {{"lines": 1, "head": "{head["head"]}"}}}}}}')
    assert heads_of_reports(lines, book, [report]) == {report: head}
