"""Classes of one's own on the proving ground: what is refused, what they are given, and the way to a paper."""

import json
import re
import sys

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.proving_ground import (
    compare_entries,
    enter_submissions,
    load_ground,
    open_lane,
    run_benchmark,
    write_leaderboard,
    write_score_tables,
    write_submissions,
)
from flgpr_ground.own import load_own
from grounds import SMALL, looks, write_runnable_ground
from robust import digests
from systems.lanes import small_recipe

ROWS = """
from sklearn.linear_model import LogisticRegression
__author__ = "A. Student"
class PlainRows(LogisticRegression):
    '''Logistic regression.'''
    features = ("C_HH_F1", "M_VV_F1")
    recipe = "{recipe}"
"""
LANES = """
import json
import pandas as pd
class WholeLanes:
    recipe = "{recipe}"
    def fit(self, lanes):
        self.known = sorted(lane.name for lane in lanes)
        assert all(len(lane.truth) for lane in lanes)
        assert all("signal" in lane.run for lane in lanes)
    def detect(self, lane):
        try:
            lane.truth
        except ValueError as error:
            told = str(error)
        with open("{log}", "a") as log:
            log.write(json.dumps([self.known, lane.name, told]) + "\\n")
        hh = lane.image.sel(polarization="HH", subband="F1").fillna(0)
        brightest = hh.stack(place=("y", "x")).to_series().nlargest(5)
        places = brightest.index.to_frame(index=False)
        return pd.DataFrame({{"x": places.x, "y": places.y, "confidence": brightest.to_numpy()}})
class NotATable(WholeLanes):
    def detect(self, lane):
        return None
class Fails(WholeLanes):
    def fit(self, lanes):
        raise RuntimeError("no luck")
class FailsOnGravel(WholeLanes):
    def detect(self, lane):
        if lane.site == "gravel":
            raise RuntimeError("too rough")
        return pd.DataFrame({{"x": [0.0], "y": [9.0], "confidence": [1.0]}})
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Return a function that writes a module into the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    written = []

    def write(name, text):
        (tmp_path / f"{name}.py").write_text(text)
        written.append(name)

    yield write
    for name in written:
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("text", "path", "told"),
    [
        ("", "own-module:Mine", "MODULE:CLASS"),
        ("", "nowhere_at_all:Mine", "module nowhere_at_all must be in the current folder"),
        ("", "Mine:own_module", "module Mine must be in the current folder"),
        ("class Other: pass", "own_module:Mine", "must have Mine, got one with Other"),
        ("import not_there_at_all", "own_module:Mine", "must import, got ModuleNotFoundError.*line 1"),
        ("\n\n1 / 0", "own_module:Mine", r"must import, got ZeroDivisionError.*own_module.py, line 3"),
        ("Mine = 3", "own_module:Mine", "must be a class, .* got int"),
        ("class Mine:\n def __init__(self, n): pass", "own_module:Mine", "made without arguments"),
        (
            "class Mine:\n def detect(self, lane): pass",
            "own_module:Mine",
            r"a Mine without fit \(own_module.py, line 1\)$",
        ),
        ("class Mine:\n def fit(self, X, y): pass", "own_module:Mine", "Mine without decision_function"),
        ("class Mine: pass", "own_module:Mine", "without fit and without decision_function"),
        ("class Mine: pass", "own_module.py:Mine", "MODULE:CLASS without .py, .* got 'own_module.py"),
    ],
)  # fmt: skip
def test_what_is_no_detector_is_told(module, text, path, told):
    module("own_module", text)
    with pytest.raises(ValueError, match=told):
        load_own(path)


def test_a_class_of_rows_scores_by_its_decision_or_by_the_p_of_its_last_class(module):
    module(
        "own_rows",
        """
import numpy as np
class OwnForest2:
    features = "a*"
    def fit(self, X, y): self.mean = X["a1"].mean()
    def predict_proba(self, X): return np.stack([1 - X["a1"], X["a1"]], axis=1)
class Wrong(OwnForest2):
    def decision_function(self, X): return np.full(len(X), np.nan)
def made(): return OwnForest2()
""",
    )
    own = load_own("own_rows:OwnForest2")
    assert (own.name, own.method, own.authors) == ("own-forest2", "own_rows:OwnForest2", ())
    assert own.columns(["a1", "b1", "a2"]) == ["a1", "a2"]
    with pytest.raises(ValueError, match=r"must be columns of the feature table, b1, got 'a\*'"):
        own.columns(["b1"])
    rows = pd.DataFrame({"a1": [0.25, 0.5]})
    detector = own.fitted(rows, np.array([0, 1]))
    assert own.scores(detector, rows).tolist() == [0.25, 0.5]
    assert own.scores(detector, rows[:0]).size == 0
    assert load_own("own_rows:made").name == "made"
    wrong = load_own("own_rows:Wrong")
    with pytest.raises(ValueError, match="decision_function of own_rows:Wrong must give a finite"):
        wrong.scores(wrong.fitted(rows, None), rows)


def test_a_changed_source_is_another_detector(module):
    module(
        "own_source", "from own_beside import fit\nclass Mine:\n  fit = decision_function = fit\n"
    )
    module("own_beside", "def fit(self, X): pass\n")
    before = load_own("own_source:Mine").digest
    assert load_own("own_source:Mine").digest == before
    module("own_beside", "def fit(self, X): pass  # another\n")
    assert load_own("own_source:Mine").digest != before


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """A small ground on which a recipe, the reference, and two classes of one's own ran."""
    folder = tmp_path_factory.mktemp("own")
    write_runnable_ground(folder, SMALL)
    recipe = folder / "one.toml"
    recipe.write_text(small_recipe("wang2007"))
    for name, text in (("rows_class", ROWS), ("lanes_class", LANES)):
        (folder / f"{name}.py").write_text(text.format(recipe=recipe, log=folder / "seen.jsonl"))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        names = ["rows_class:PlainRows", "lanes_class:WholeLanes", "lanes_class:Fails"]
        names += ["lanes_class:NotATable", "lanes_class:FailsOnGravel", recipe]
        with pytest.warns(UserWarning, match="did not finish") as warned:
            run_benchmark(names, folder / "out", ground=folder / "ground.toml")
    told = "\n".join(str(warning.message) for warning in warned)
    assert "fails did not finish: fit of lanes_class:Fails must not fail" in told
    assert "RuntimeError: no luck (lanes_class.py, line" in told
    assert "not-a-table did not finish: detect of lanes_class:NotATable must return a Data" in told
    assert re.search(
        r"got NoneType \(lanes_class.py, line \d+\) on 2 of 2 lanes: arid-test-1", told
    )
    # A lane on which it fails is no lane without alarms.
    assert re.search(
        r"too rough \(lanes_class.py, line \d+\) on 1 of 2 lanes: gravel-test-1$", told, re.M
    )
    assert not list((folder / "out" / "entries" / "fails-on-gravel").glob("standard/*.csv"))
    write_submissions(folder / "out")
    return folder, write_score_tables([folder / "out"], folder / "out")


@pytest.mark.slow("trains and runs detectors on the lanes of a proving ground")
def test_folds_are_those_of_every_entry_and_truth_is_for_fit_alone(field):
    folder, text = field
    seen = [json.loads(line) for line in (folder / "seen.jsonl").read_text().splitlines()]
    everything = ["arid-known-1", "gravel-known-1"]
    assert [(known, lane) for known, lane, _ in seen] == [
        (everything, "arid-test-1"),
        (everything, "gravel-test-1"),
        (["gravel-known-1"], "arid-test-1"),
        (["arid-known-1"], "gravel-test-1"),
    ]
    assert all("which is sealed" in told for _, _, told in seen)
    first = text.splitlines()[0]
    assert first.startswith(("plain-rows misses", "whole-lanes misses"))
    assert "that one misses (McNemar p = " in first
    assert "nan" not in text


@pytest.mark.slow("trains and runs detectors on the lanes of a proving ground")
def test_the_rows_are_scored_as_the_recipes_own_detector_would(field):
    """The alarms are those of the recipe, and the confidences those of a fit by hand."""
    from flgpr_ground.running import ALARMS

    folder, _ = field
    entries = folder / "out" / "entries"
    of_class = pd.read_csv(entries / "plain-rows" / "standard" / ALARMS)
    of_recipe = pd.read_csv(entries / "one" / "standard" / ALARMS)
    places = [table.sort_values(["lane", "x", "y"])[["x", "y"]] for table in (of_class, of_recipe)]
    np.testing.assert_array_equal(*places)
    assert not np.allclose(of_class["confidence"], of_recipe["confidence"])


@pytest.mark.slow("trains and runs detectors on the lanes of a proving ground")
def test_what_ran_enters_as_it_is_and_a_changed_class_does_not(field, tmp_path):
    folder, text = field
    out = folder / "out"
    submission = out / "submissions" / "plain-rows"
    assert 'authors = ["A. Student"]' in (submission / "submission.toml").read_text()
    assert not (out / "submissions" / "one").exists()
    ground = folder / "ground.toml"
    before = looks(out)
    entered = enter_submissions([submission], out, ground)
    # Costs are measured, and kept with fewer digits: one that lies between two numbers may round up.
    assert re.sub(r" +\d+$", "", entered, flags=re.M) == re.sub(r" +\d+$", "", text, flags=re.M)
    assert looks(out) == before  # the same alarms are scored once
    assert "plain-rows" in enter_submissions([submission], tmp_path / "keeper", ground)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        sys.modules.pop("rows_class")
        source = folder / "rows_class.py"
        source.write_text(source.read_text() + "# changed\n")
        with pytest.warns(UserWarning, match="plain-rows must be the detector that was entered"):
            run_benchmark(["rows_class:PlainRows"], out, ground=ground)


@pytest.mark.slow("trains and runs detectors on the lanes of a proving ground")
def test_two_entries_are_compared_mine_by_mine(field, tmp_path):
    folder, _ = field
    out = folder / "out"
    scores = pd.read_csv(out / "scores.csv")
    before = looks(out)
    page, answers = compare_entries(out, "whole-lanes", output=tmp_path / "page")
    assert looks(out) == [*before, "open"]
    mines = scores[(scores["group"] == "mines") & (scores["far_allowed"] == 0.1)]
    at_far = mines[(mines["entry"] == "whole-lanes") & (mines["split"] == "standard")].iloc[0]
    assert f"misses {at_far['reference_only']:.0f} mine" in answers[0]
    assert (
        f"finds {at_far['only']:.0f} that one misses (McNemar p = {at_far['p']:.2g})" in answers[0]
    )
    targets = pd.read_csv(tmp_path / "page" / "targets.csv")
    assert (targets["far_1"] <= 0.1).sum() == at_far["n_detected"]
    assert not {"x", "y"} & set(targets.columns)
    text = page.read_text("utf-8")
    # A chip of each of the four polarizations of every mine, the figure, and no other file.
    assert text.count("data:image/png") == 4 * len(targets) + 1
    assert "http" not in text.replace("data:image", "")
    table = (tmp_path / "page" / "table.tex").read_text()
    assert table.count(r"\\") == 1 + scores["entry"].nunique()
    assert (tmp_path / "page" / "cite.bib").read_text().count(
        "@"
    ) == 2  # the ground is no packaged one
    assert (tmp_path / "page" / "roc.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(
        ValueError, match=r"both entries must have run on a tier.*in .* are fails, "
    ):
        compare_entries(out, "not-there")
    with pytest.raises(
        ValueError, match=r"fails did not finish: fit of lanes_class:Fails must not"
    ):
        compare_entries(out, "fails")
    assert "  fails " not in write_score_tables([out], tmp_path / "table")  # it cost nothing
    assert "<b>whole-lanes</b>: lanes_class:WholeLanes." in text
    with pytest.raises(ValueError, match="another entry"):
        compare_entries(out, "one")
    # What is made after somebody saw the test lanes says so.
    card = out / "submissions" / "whole-lanes" / "submission.toml"
    assert "test_lanes_seen = false" in card.read_text()
    card.unlink()
    write_submissions(out)
    assert "test_lanes_seen = true" in card.read_text()


@pytest.mark.slow("simulates a lane")
def test_a_lane_is_a_line_of_python(tmp_path):
    path = write_runnable_ground(tmp_path, SMALL)
    lane = open_lane("arid-known-1", tmp_path / "out", ground=path)
    assert lane.run["signal"].dims == ("scan", "polarization", "pair", "frequency")
    known = load_ground(False, path).lanes["arid-known-1"]
    np.testing.assert_allclose(lane.truth["y"], known.truth()["y"])
    before = digests(tmp_path / "out")
    assert open_lane("arid-known-1", tmp_path / "out", ground=path).lane == known.lane
    assert digests(tmp_path / "out") == before
    tested = open_lane("arid-test-1", tmp_path / "out", ground=path)
    with pytest.raises(ValueError, match="arid-test-1, which is sealed"):
        _ = tested.truth
    with pytest.raises(ValueError, match=r"must be that of a lane of small-3, .* got 'nowhere'"):
        open_lane("nowhere", tmp_path / "out", ground=path)


@pytest.mark.slow("runs the template on the quick form of the packaged ground")
def test_from_the_template_to_the_leaderboard(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))

    def call(*words):
        done = CliRunner().invoke(app, ["benchmark", *words])
        assert done.exit_code == 0, done.output
        return done.stdout

    printed = call("template")
    call("template")
    source = tmp_path / "my_detector.py"
    source.write_text(source.read_text() + "# changed\n")
    again = CliRunner().invoke(app, ["benchmark", "template"])
    assert again.exit_code == 2
    [line] = [line for line in source.read_text().splitlines() if line.startswith("flgpr ")]
    assert printed == f"wrote my_detector.py\nnext: {line}\n"
    words = line.split()
    assert words[:2] == ["flgpr", "benchmark"]
    text = call(*words[2:])
    assert text.startswith("prepared: my-detector misses ")
    entered = call("enter", "proving-ground/submissions/my-detector")
    assert "\nentered: proving-ground/submissions/my-detector\npage: " in entered
    board = tmp_path / "proving-ground" / "leaderboard.html"
    assert "Logistic regression on local contrasts" in board.read_text("utf-8")
    write_leaderboard([tmp_path / "proving-ground"], tmp_path / "board.html")
    compared = call("compare", "my-detector")
    assert "my-detector misses" in compared
    assert compared.endswith("for a paper, beside it: cite.bib, roc-prepared.pdf, table.tex\n")
    paper = tmp_path / "proving-ground" / "compared" / "my-detector-wang2007"
    assert (
        "% difference from wang2007, C_HH in the sub-band F1" in (paper / "table.tex").read_text()
    )
    assert "<b>wang2007</b>: C_HH in the sub-band F1" in (paper / "index.html").read_text("utf-8")


def test_a_ground_without_features_says_so_before_lanes_are_made(module, tmp_path):
    module(
        "own_rows_only",
        "class Mine:\n def fit(self, X, y): pass\n def predict_proba(self, X): pass",
    )
    with pytest.raises(ValueError, match="wang2007 on full-wave-2, which has none"):
        run_benchmark(["own_rows_only:Mine"], tmp_path / "out", ground="full-wave-2")
    assert not (tmp_path / "out").exists()


def test_two_classes_of_one_name_and_names_of_packaged_entries_are_refused(module, tmp_path):
    module("own_twice", "class Mine:\n def fit(self, lanes): pass\n def detect(self, lane): pass\n")
    module("own_again", "from own_twice import Mine\nclass RandomForest(Mine): pass\n")
    with pytest.raises(ValueError, match="must have names of their own, got mine, mine"):
        run_benchmark(["own_twice:Mine", "own_again:Mine"], tmp_path / "out", quick=True)
    with pytest.raises(ValueError, match="name of a packaged entry, got random-forest"):
        run_benchmark(["own_again:RandomForest"], tmp_path / "out", quick=True)
    assert not (tmp_path / "out").exists()
