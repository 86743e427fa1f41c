"""Ways around the register: each is refused before the truth is looked at, and the honest way is open."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.trials import content_hash, open_truth, read_register, register, require_registered
from flgpr_trials.commands.plan import plan_lane, register_recipe
from scored import compare_alarms, score_alarms, score_result
from scored_blind import score_sealed, seal_truth_file

PHRASE = "correct horse battery"
LANE = "x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 60.0\n"


def nobody():
    raise AssertionError("a passphrase was asked for in vain")


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A planned lane, a registered recipe and one that is not, two alarm lists."""
    home = tmp_path_factory.mktemp("planned")
    (home / "lane.toml").write_text(LANE)
    (home / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,5\nplastic,0.1,3\n")
    for name in ("mine", "other"):
        (home / f"{name}.toml").write_text(f"name = '{name}'\n")
    plan, _ = plan_lane(
        home / "lane.toml", home / "sorts.csv", home / "plan.csv", 7, recipe=home / "mine.toml"
    )
    near = plan[["x", "y"]] + 0.1
    near.assign(confidence=np.arange(len(plan))).to_csv(home / "a.csv", index=False)
    near[:4].assign(confidence=np.arange(4)).to_csv(home / "b.csv", index=False)
    return home


@pytest.fixture
def trial(planned, tmp_path):
    return shutil.copytree(planned, tmp_path / "trial")


@pytest.fixture
def book(trial):
    return trial / "plan.csv.register.jsonl"


@pytest.fixture
def sealed(trial):
    pytest.importorskip("cryptography")
    return seal_truth_file(trial / "plan.csv", trial / "lane.toml", trial / "sealed", PHRASE)


def openly(trial, truth="plan.csv", lane="lane.toml", **how):
    options = {"recipe": trial / "mine.toml", "draws": 20, **how}
    return score_alarms(trial / "a.csv", trial / truth, trial / lane, trial / "score", **options)


def blindly(trial, book, recipe="mine.toml", phrase=PHRASE, **how):
    return score_sealed(
        trial / "a.csv",
        trial / "sealed",
        phrase,
        trial / "blind",
        recipe=trial / recipe,
        register=book,
        **how,
    )


def looks(trial):
    log = trial / "sealed.log.jsonl"
    return len(read_register(log))


def test_the_honest_way_is_open(trial, book, sealed):
    told = blindly(trial, book)
    assert told.registered["recipe"] == content_hash(trial / "mine.toml")
    notes = json.loads((trial / "blind" / "roc.json").read_text())["notes"]
    assert notes["recipe_registered"] == told.registered["time"]
    assert [line["event"] for line in read_register(book)] == ["plan", "sealed", "truth opened"]
    openly(trial)
    assert read_register(book)[-1]["truth"] == content_hash(trial / "plan.csv")


def test_a_recipe_that_was_never_registered_is_refused_before_the_passphrase(trial, book, sealed):
    with pytest.raises(
        ValueError,
        match=r"what fixes the detector must be registered in .* before the truth is opened",
    ):
        blindly(trial, book, "other.toml", nobody)
    with pytest.raises(ValueError, match="what fixes the detector must be registered"):
        openly(trial, recipe=trial / "other.toml")
    assert looks(trial) == 0
    assert not (trial / "blind").exists()
    assert len(read_register(book)) == 2


def test_a_planned_truth_asks_for_recipe_and_register_by_itself(trial, book, sealed):
    with pytest.raises(
        ValueError, match=r"must stand in the register .*: name what fixes it by `recipe`"
    ):
        openly(trial, recipe=None)
    with pytest.raises(
        ValueError, match="sealed with a register: give it by `book`, and by `recipe` what fixes"
    ):
        score_sealed(trial / "a.csv", sealed, PHRASE)
    with pytest.raises(ValueError, match="`recipe` needs a register: give it by `book`"):
        score_sealed(trial / "a.csv", sealed, nobody, recipe=trial / "mine.toml")
    with pytest.raises(
        ValueError, match=r"must stand in the register .*: name what fixes it by `recipe`"
    ):
        score_sealed(trial / "a.csv", sealed, nobody, register=book)
    assert looks(trial) == 0


def test_a_register_that_is_gone_or_made_anew_opens_nothing(trial, book, sealed):
    book.rename(trial / "away")
    for call in (openly, lambda home: blindly(home, book, phrase=nobody)):
        with pytest.raises(FileNotFoundError, match="register not found"):
            call(trial)
    register(book, recipe=content_hash(trial / "other.toml"))
    with pytest.raises(ValueError, match="truth must be the plan"):
        openly(trial, recipe=trial / "other.toml")
    with pytest.raises(ValueError, match=r"must be the register that .* was sealed with"):
        blindly(trial, book, "other.toml")
    assert looks(trial) == 0
    openly(trial, register=trial / "away")  # under another name it is the same


def test_an_altered_register_opens_nothing(trial, book, sealed):
    lines = [json.loads(line) for line in book.read_text().splitlines()]
    lines[0]["recipe"] = content_hash(trial / "other.toml")
    book.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(ValueError, match="must be unaltered, got a line 1"):
        blindly(trial, book, "other.toml", nobody)
    book.unlink()
    for line in lines:  # all hashes made anew
        register(
            book,
            **{
                name: line[name]
                for name in line
                if name not in ("time", "number", "previous", "hash")
            },
        )
    with pytest.raises(ValueError, match=r"must be the register that .* was sealed with"):
        blindly(trial, book, "other.toml")


def test_another_lanes_register_opens_nothing(trial, book, sealed):
    (trial / "far.toml").write_text(LANE.replace("60", "80"))
    plan_lane(
        trial / "far.toml", trial / "sorts.csv", trial / "far.csv", 8, recipe=trial / "other.toml"
    )
    strange = trial / "far.csv.register.jsonl"
    with pytest.raises(ValueError, match="must be the register that"):
        blindly(trial, strange, "other.toml")
    with pytest.raises(ValueError, match="truth must be the plan"):
        openly(trial, recipe=trial / "other.toml", register=strange)
    with pytest.raises(ValueError, match="lane must be as planned"):
        openly(trial, lane="far.toml")
    with pytest.raises(ValueError, match="lane must be as planned"):
        seal_truth_file(trial / "plan.csv", trial / "far.toml", trial / "again", nobody)


def test_what_is_registered_after_a_look_is_too_late(trial, book, sealed):
    copy = trial / "copy.jsonl"
    shutil.copy(book, copy)
    blindly(trial, book)
    with pytest.raises(ValueError, match="before the truth is opened; line 3 is an opening"):
        register_recipe(trial / "other.toml", book)
    register(book, recipe=content_hash(trial / "other.toml"))
    with pytest.raises(ValueError, match="in line 4, after the look in line 3"):
        blindly(trial, book, "other.toml", nobody)
    with pytest.raises(ValueError, match="in line 4, after the look in line 3"):
        openly(trial, recipe=trial / "other.toml")
    register(
        copy, recipe=content_hash(trial / "other.toml")
    )  # a register as it was before the look
    with pytest.raises(ValueError, match=r"before the first look at .*sealed"):
        blindly(trial, copy, "other.toml")
    assert blindly(trial, book).looks == 2


def test_looks_cannot_be_forgotten(trial, book, sealed):
    blindly(trial, book)
    (trial / "sealed.log.jsonl").unlink()
    with pytest.raises(ValueError, match=r"log of .* must have every look"):
        blindly(trial, book)
    shutil.copy(sealed, trial / "renamed")
    with pytest.raises(ValueError, match=r"log of .* must have every look"):
        score_sealed(
            trial / "a.csv", trial / "renamed", PHRASE, recipe=trial / "mine.toml", register=book
        )


def test_opening_a_sealed_truth_ends_registration(trial, book, sealed):
    open_truth(sealed, PHRASE)
    register_recipe(trial / "other.toml", book)
    with pytest.raises(ValueError, match="before the first look"):
        blindly(trial, book, "other.toml")
    blindly(trial, book)


def test_links_and_other_names_lead_to_the_same_register(trial, book, sealed, tmp_path):
    away = tmp_path / "away"
    away.mkdir()
    (away / "truth.csv").symlink_to(trial / "plan.csv")
    with pytest.raises(ValueError, match="what fixes the detector must be registered"):
        openly(trial, truth=away / "truth.csv", recipe=trial / "other.toml")
    shutil.copy(trial / "plan.csv", away / "copied.csv")
    with pytest.raises(FileNotFoundError, match="register not found"):
        openly(trial, truth=away / "copied.csv")
    openly(trial, truth=away / "copied.csv", register=book)
    (away / "linked").symlink_to(sealed)
    (away / "book").symlink_to(book)
    told = score_sealed(
        trial / "a.csv", away / "linked", PHRASE, recipe=trial / "mine.toml", register=away / "book"
    )
    assert (told.looks, looks(trial)) == (1, 1)
    bare = pd.read_csv(trial / "plan.csv").drop(columns="book")
    bare.to_csv(trial / "bare.csv", index=False)
    with pytest.raises(ValueError, match="truth must be the plan"):
        openly(trial, truth="bare.csv", register=book)
    old = trial / "old.csv"
    bare.to_csv(old, index=False)
    register(
        f"{old}.register.jsonl", event="plan", plan="1", lanes={}
    )  # a register beside it is its own, too
    with pytest.raises(
        ValueError, match=r"must stand in the register .*: name what fixes it by `recipe`"
    ):
        openly(trial, truth="old.csv", recipe=None)


def test_the_rules_of_the_plan_hold(trial, book, sealed):
    for change, message in (
        ({"halo": 2.0}, "halo must be 1 as planned"),
        ({"far": 0.1}, "far must be 0.05 as"),
    ):
        with pytest.raises(ValueError, match=message):
            openly(trial, **change)
    with pytest.raises(ValueError, match="halo must be 1 as planned"):
        seal_truth_file(trial / "plan.csv", trial / "lane.toml", trial / "again", nobody, halo=2.0)
    with pytest.raises(ValueError, match="halo must be 1 as planned"):
        compare_alarms(
            [trial / "a.csv", trial / "b.csv"], trial / "plan.csv", trial / "c", trial / "lane.toml", halo=2.0,
            recipes=[trial / "mine.toml"] * 2,
        )  # fmt: skip
    assert len(read_register(book)) == 2


@pytest.mark.parametrize("what", ["--halo", "--far", "--lane", "--truth", "--objects", "--show"])
def test_options_that_a_sealed_truth_has_no_use_for_are_refused(what, trial, sealed):
    value = {"--halo": "0.5", "--far": "0.1", "--show": "targets"}.get(
        what, str(trial / "lane.toml")
    )
    given = ["score", str(trial / "a.csv"), "--sealed", str(sealed), what, value]
    told = CliRunner().invoke(app, given)
    assert told.exit_code == 2
    assert (
        told.output
        == f"error: --sealed scores by the rules that the truth was sealed with, got {what}\n"
    )
    assert looks(trial) == 0


def test_options_of_open_scores_are_never_dropped(demo, trial):
    folder = demo[0].folder
    truth = str(trial / "plan.csv")
    for given, message in (
        (
            [str(folder), "--truth", truth, "--halo", "2"],
            "a result is scored by the halo of its recipe, got --halo",
        ),
        (
            [str(trial / "a.csv"), "--truth", truth, "--show", "curve"],
            "--show goes with --seal, got --show",
        ),
        (
            [str(trial / "a.csv"), "--seal", "--far", "1"],
            "--seal seals a truth with its lane and halo, got --far",
        ),
    ):
        told = CliRunner().invoke(app, ["score", *given])
        assert told.exit_code == 2
        assert message in told.stderr


@pytest.mark.slow("runs a whole command more than once")
def test_a_result_is_held_to_its_own_recipe_and_model(demo, trial, tmp_path):
    """A registered recipe vouches for no alarms but its own, nor for a model that was not registered with it."""
    folder = tmp_path / "result"
    shutil.copytree(demo[0].folder, folder)
    truth = tmp_path / "truth.csv"
    truth.write_text("target_id,x,y,kind,depth\na,0,4,metal,0\n")
    book = tmp_path / "book.jsonl"
    register(book, recipe=content_hash(trial / "mine.toml"))
    how = {"output": tmp_path / "score", "register": book}
    with pytest.raises(
        ValueError, match=r"recipe must be the one that .*result was made with, got .*mine.toml"
    ):
        score_result(folder, truth, recipe=trial / "mine.toml", **how)
    with pytest.raises(ValueError, match="what fixes the detector must be registered"):
        score_result(folder, truth, **how)
    with pytest.raises(ValueError, match=r"`recipe` needs a register: .*truth.csv names none"):
        score_result(folder, truth, recipe="demo", output=tmp_path / "score")
    register_recipe("demo", book)
    assert score_result(folder, truth, **how)
    alarms = folder / "alarms.csv"
    (trial / "here.toml").write_text("x_min = -2\nx_max = 2\ny_min = 0\ny_max = 20\n")
    alarms.write_text(alarms.read_text() + "\n")
    with pytest.raises(ValueError, match=r"alarms.csv differs from what was written"):
        score_alarms(alarms, truth, trial / "here.toml", tmp_path / "score", register=book)


def test_a_model_is_registered_with_its_recipe(tmp_path):
    book = tmp_path / "book.jsonl"
    recipe = content_hash("recipe")
    (tmp_path / "recipe").write_text("recipe")
    model = tmp_path / "model"
    model.mkdir()
    (model / "model.bundle").write_bytes(b"weights")
    register(book, event="begin")
    register_recipe(tmp_path / "recipe", book, model)
    assert require_registered(book, recipe, content_hash(b"weights"))["number"] == 2
    with pytest.raises(ValueError, match="the detector must be registered with its model"):
        require_registered(book, recipe, content_hash(b"other weights"))
    with pytest.raises(ValueError, match=r"got the folder .*model; is it a model"):
        register_recipe(model, book)
    with pytest.raises(FileNotFoundError, match="model not found"):
        register_recipe(tmp_path / "recipe", book, tmp_path)
    with pytest.raises(FileNotFoundError, match="recipe file not found: nothing"):
        register_recipe("nothing", book)


def test_every_list_of_a_comparison_needs_its_recipe(trial, book):
    lists = [trial / "a.csv", trial / "b.csv"]
    for recipes, message in (
        ([], "name what fixes it by `recipe`"),
        ([trial / "mine.toml"], "once per alarm list, got 1 for 2"),
        ([trial / "mine.toml", trial / "other.toml"], "what fixes the detector must be registered"),
    ):
        with pytest.raises(ValueError, match=message):
            compare_alarms(
                lists, trial / "plan.csv", trial / "c", trial / "lane.toml", recipes=recipes
            )
    assert len(read_register(book)) == 1
    files = (trial / "plan.csv", trial / "c", trial / "lane.toml")
    compare_alarms(lists, *files, recipes=[trial / "mine.toml"] * 2, draws=20)
    page = (trial / "c" / "comparison.html").read_text()
    assert "lines 3, head " in page, "the register in words"
    assert "{&#39;" not in page


def test_a_truth_without_a_plan_is_free(trial, tmp_path):
    free = tmp_path / "free.csv"
    pd.read_csv(trial / "plan.csv").drop(columns="book").to_csv(free, index=False)
    assert openly(trial, truth=free, recipe=None, halo=2.0)
