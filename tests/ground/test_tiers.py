"""A proving ground with tiers in small: run tier by tier, sealed, scored apart, and shown side by side."""

import importlib.util
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.proving_ground import (
    load_ground,
    run_benchmark,
    run_oracle,
    score_entries,
    write_score_tables,
)
from flgpr.simulate import draw_world
from flgpr.trials import open_truth, read_register
from flgpr_ground.figures import tiers_figure
from flgpr_ground.lanes import PRINTS, SEALED, passphrase
from flgpr_ground.running import ALARMS
from grounds import TIERED, write_runnable_ground
from robust import digests
from systems.lanes import small_recipe

pytestmark = pytest.mark.slow("trains and runs detectors on lanes of both tiers")

LADDER = Path(__file__).parents[2] / "evidence" / "ladder.py"
TIERS = ("smooth", "rough")
LIST = pd.DataFrame({"x": [0.0], "y": [3.0], "confidence": [1.0]})


def write_ground(folder):
    (folder / "one.toml").write_text(small_recipe("wang2007"))
    return write_runnable_ground(folder, TIERED)


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """A folder with the ground, a recipe and what it gave on one tier first and then on all."""
    folder = tmp_path_factory.mktemp("tiers")
    ground = write_ground(folder)
    out = folder / "out"
    run_benchmark([folder / "one.toml"], out, ground=ground, tier="smooth")
    (folder / "first").mkdir()
    shutil.copytree(out / "entries", folder / "first" / "entries")
    shutil.copy(out / "lanes" / PRINTS, folder / "first" / PRINTS)
    run_benchmark([folder / "one.toml"], out, ground=ground, tier="all")
    return folder


def test_a_tier_runs_alone_and_all_go_on_from_there(field):
    first = field / "first"
    out = field / "out"
    assert [path.name for path in sorted((first / "entries" / "one").iterdir())] == ["smooth"]
    assert list(pd.read_csv(first / PRINTS)["lane"]) == [
        f"smooth-sand-{name}-1" for name in ("known", "test", "bare")
    ]
    assert sorted(path.name for path in (out / "entries" / "one").iterdir()) == sorted(TIERS)
    whole = list(load_ground(False, field / "ground.toml").lanes)
    assert list(pd.read_csv(out / "lanes" / PRINTS)["lane"]) == whole
    assert digests(first / "entries" / "one" / "smooth") == digests(
        out / "entries" / "one" / "smooth"
    )
    about = json.loads((out / "entries" / "one" / "rough" / "entry.json").read_text("utf-8"))
    assert about["tier"] == "rough"


def test_lanes_of_tiers_are_of_one_design_and_alarms_of_their_own_lanes(field):
    ground = load_ground(False, field / "ground.toml")
    smooth, rough = ground.chosen_tiers()
    assert [lane.name_in_tier for lane in smooth.lanes.values()] == [
        lane.name_in_tier for lane in rough.lanes.values()
    ]
    assert set(ground.lanes) == {*smooth.lanes, *rough.lanes}
    for tier in (smooth, rough):
        alarms = pd.read_csv(field / "out" / "entries" / "one" / tier.tier / "standard" / ALARMS)
        assert set(alarms["lane"]) <= {lane.name for lane in tier.tested("standard")}
        assert len(alarms)


def test_a_tier_changes_the_surface_of_a_design_and_of_no_other(field):
    lanes = load_ground(False, field / "ground.toml").lanes
    unevenness = {name: lane.scene.surface.unevenness for name, lane in lanes.items()}
    assert unevenness["smooth-sand-known-1"] == 128e-6
    assert unevenness["smooth-sand-test-1"] == 64e-6  # the site's own
    assert unevenness["rough-sand-known-1"] == 1024e-6


def test_the_truth_of_both_tiers_is_sealed_before_either_runs(field):
    ground = load_ground(False, field / "ground.toml")
    lanes = field / "out" / "lanes"
    files = {path.name for path in lanes.iterdir()}
    for name, lane in ground.lanes.items():
        assert (f"{name}-truth.csv" in files) == (lane.part == "train")
    sealed = (lanes / SEALED).read_text("utf-8")
    truth, _, _ = open_truth(lanes / SEALED, passphrase(ground), log=field / "own.log")
    assert set(truth["lane"]) == {"smooth-sand-test-1", "rough-sand-test-1"}
    assert not [place for place in truth["y"].map("{:.2f}".format) if place in sealed]
    lane = ground.lanes["rough-sand-test-1"]
    world = draw_world(lane.scene, lane.seed)
    own = truth[truth["lane"] == lane.name]
    assert list(own["body"]) == [target.body or "" for target in world.targets]
    assert sorted(own["body"]) == ["", "", "", "pmn", "vs-1.6"]


def test_scores_and_costs_are_told_by_tier(field, tmp_path):
    scores, costs = score_entries([field / "out"])
    assert list(dict.fromkeys(scores["tier"])) == list(TIERS)
    assert list(costs["tier"]) == list(TIERS)
    mines = scores[(scores["group"] == "mines") & (scores["far_allowed"] == 0.1)].set_index("tier")
    assert list(mines["n_targets"]) == [4, 4]
    assert set(scores["group"]) == {
        "mines",
        "metal",
        "plastic",
        "ap",
        "simulant",
        "sand",
        "body pmn",
        "body vs-1.6",
    }
    # A tier's score is that of its own alarms: it is the same where the other tier was never run.
    shutil.copytree(field / "first" / "entries", tmp_path / "alone" / "entries")
    shutil.copytree(
        field / "out" / "lanes",
        tmp_path / "alone" / "lanes",
        ignore=shutil.ignore_patterns("rough-*"),
    )
    for name in ("ground.toml", "ground.json"):
        shutil.copy(field / "out" / name, tmp_path / "alone" / name)
    alone, _ = score_entries([tmp_path / "alone"])
    pd.testing.assert_frame_equal(alone, scores[scores["tier"] == "smooth"].reset_index(drop=True))


def test_looks_at_the_truth_are_counted_for_each_tier(field):
    score_entries([field / "out"])
    log = f"{field / 'out' / 'lanes' / SEALED}.log.jsonl"
    before = len(read_register(log))
    score_entries([field / "out"])
    assert len(read_register(log)) == before >= 2


def test_the_page_opens_with_one_figure_and_tells_the_tiers_apart(field, tmp_path):
    text = write_score_tables([field / "out"], tmp_path)
    assert text.index("TIER smooth: a lane that was rolled") < text.index(
        "TIER rough: a lane as found"
    )
    page = (tmp_path / "index.html").read_text("utf-8")
    body = page[page.index("<body>") :]
    assert body.index("<picture>") < body.index("<p>")
    assert body.count("<picture>") == 1
    assert 'media="(max-width: 640px)"' in body
    assert body.index('id="tier-smooth"') < body.index('id="tier-rough"')
    table = pd.read_csv(tmp_path / "scores.csv")
    assert set(table["tier"]) == set(TIERS)


@pytest.mark.parametrize("narrow", [False, True])
def test_the_figure_shows_what_the_scores_say(field, narrow):
    scores, _ = score_entries([field / "out"])
    other = scores.assign(entry="oracle", pd=0.5, pd_low=0.4, pd_high=0.6)
    scores = pd.concat([other, scores], ignore_index=True)
    ground = load_ground(False, field / "ground.toml")
    figure = tiers_figure(ground, scores, narrow)
    panels = [panel for panel in figure.axes if panel.axison]
    assert [panel.get_title() for panel in panels] == [
        "metal (2 | 2)",
        "plastic (1 | 1)",
        "AP (1 | 1)",
        "simulant (1 | 1)",
    ]
    assert [label.get_text() for label in panels[0].get_yticklabels()] == ["one", "oracle"]
    at = scores[(scores["group"] == "metal") & (scores["far_allowed"] == 0.1)].set_index(
        ["tier", "entry"]
    )
    marks = [line for line in panels[0].get_lines() if line.get_marker() in {"o", "s"}]
    for tier, line in zip(TIERS, marks, strict=True):
        np.testing.assert_allclose(
            line.get_xdata(), [at.loc[(tier, name), "pd"] for name in ("one", "oracle")]
        )


def test_the_oracle_looks_at_every_tier_on_its_own_ground(field, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(field / "out", out, ignore=shutil.ignore_patterns("kept"))
    recipe = field / "one.toml"
    found = run_oracle(out, recipe)
    assert sorted(path.name for path in out.glob("oracle*.csv")) == [
        "oracle-rough.csv",
        "oracle-smooth.csv",
    ]
    assert list(dict.fromkeys(found["tier"])) == list(TIERS)
    assert list(found.groupby("tier", sort=False).size()) == [5, 5]
    before = (out / "oracle-smooth.csv").read_bytes()
    (out / "oracle-rough.csv").unlink()
    run_oracle(out, recipe, tier="rough")
    assert (out / "oracle-rough.csv").is_file()
    assert (out / "oracle-smooth.csv").read_bytes() == before
    scores, _ = score_entries([out])
    own = scores[
        (scores["entry"] == "oracle")
        & (scores["group"] == "mines")
        & (scores["far_allowed"] == 0.1)
    ]
    assert list(own["tier"]) == list(TIERS)
    for tier, pd_found in zip(TIERS, own["pd"], strict=True):
        mines = found[(found["tier"] == tier) & (found["kind"] != "simulant")]
        assert pd_found == (mines["far"] <= 0.1).mean()


def test_the_ladder_has_the_oracle_as_one_of_its_rungs(field, tmp_path):
    spec = importlib.util.spec_from_file_location("ladder", LADDER)
    ladder = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(ladder)
    recipe = field / "one.toml"
    oracle = run_oracle(field / "out", recipe, tier="smooth").set_index("target_id")
    figure = tmp_path / "ladder.png"
    ladder.RECIPE = str(recipe)
    ladder.main([str(field / "out"), str(tmp_path), "--tier", "smooth", "--figure", str(figure)])
    found = pd.read_csv(tmp_path / "ladder-smooth-sand.csv").set_index("target_id")
    assert sorted(found.index) == sorted(oracle.index)
    for rung, column in (("oracle", "far"), ("phases", "far_phase")):
        np.testing.assert_allclose(found[rung], oracle.loc[found.index, column], atol=1e-6)
    rows = pd.read_csv(tmp_path / "ladder.csv").set_index(["group", "rung"])
    assert set(ladder.RUNGS) == set(rows.loc["metal"].index)
    assert rows.loc[("mines", "oracle"), "mines"] == 4  # a simulant is no mine
    assert figure.stat().st_size > 0
    assert len(read_register(tmp_path / "looks.jsonl")) == 1


def test_the_oracle_needs_the_lanes_of_its_tier(field, tmp_path):
    shutil.copytree(
        field / "out", tmp_path / "out", ignore=shutil.ignore_patterns("kept", "rough-sand-bare*")
    )
    before = digests(tmp_path / "out")
    with pytest.raises(ValueError, match="not there: rough-sand-bare-1"):
        run_oracle(tmp_path / "out", field / "one.toml", tier="rough")
    assert digests(tmp_path / "out") == before


def test_alarm_lists_may_be_of_one_tier_or_of_both(field, tmp_path):
    out = tmp_path / "out"
    given = tmp_path / "given"
    shutil.copytree(field / "out", out, ignore=shutil.ignore_patterns("kept"))
    given.mkdir()
    LIST.assign(lane="rough-sand-test-1").to_csv(given / "standard.csv", index=False)
    run_benchmark([given], out, ground=field / "ground.toml")
    scores, _ = score_entries([out])
    assert set(scores.loc[scores["entry"] == "given", "tier"]) == {"rough"}
    lanes = ["rough-sand-test-1", "smooth-sand-test-1"]
    pd.concat([LIST.assign(lane=lane) for lane in lanes]).to_csv(
        given / "standard.csv", index=False
    )
    run_benchmark([given], out, ground=field / "ground.toml")
    scores, _ = score_entries([out])
    own = scores[
        (scores["entry"] == "given") & (scores["group"] == "mines") & (scores["far_allowed"] == 0.1)
    ]
    assert list(own["tier"]) == list(TIERS)
    assert (own["n_false"] + own["n_detected"] <= 1).all()
    LIST.assign(lane="sand-test-1").to_csv(given / "standard.csv", index=False)
    with pytest.raises(
        ValueError, match=r"standard\.csv must name the lanes of standard .*rough-sand-test-1"
    ):
        run_benchmark([given], out, ground=field / "ground.toml")


def test_the_command_takes_a_tier_and_refuses_one_that_is_not_there(field):
    out = field / "out"
    ground = field / "ground.toml"
    before = digests(out)
    run = ["benchmark", "run", str(field / "one.toml"), "-o", str(out), "--ground", str(ground)]
    result = CliRunner().invoke(app, [*run, "--tier", "muddy"])
    assert result.exit_code == 2
    assert "tier must be one of those of tiers-1, smooth, rough, all, got 'muddy'" in " ".join(
        result.output.split()
    )
    assert digests(out) == before
    result = CliRunner().invoke(app, [*run, "--tier", "rough"])
    assert result.exit_code == 0, result.output
    assert "TIER rough" in result.output
    result = CliRunner().invoke(
        app, ["benchmark", "run", "wang2007", "--ground", "full-wave-1", "--tier", "prepared"]
    )
    assert result.exit_code == 2
    assert "full-wave-1" in result.output


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('sand = "arid-sand"', 'mud = "arid-sand"', "same sites"),
        ("[tiers.rough]", "[tiers.all]", "must not be called 'all'"),
        (
            "[tiers.smooth.surface.known]",
            "[tiers.smooth.surface.unknown]",
            "must name designs of lanes, got unknown",
        ),
        ("[sorts]", '[sites]\nsand = "arid-sand"\n[sorts]', "not both"),
    ],
)
def test_tiers_that_are_not_of_one_design_are_refused(tmp_path, old, new, match):
    text = write_ground(tmp_path).read_text("utf-8").replace(old, new)
    if new == "[tiers.all]":
        text = text.replace("[tiers.rough.sites]", "[tiers.all.sites]")
    (tmp_path / "ground.toml").write_text(text)
    with pytest.raises(ValueError, match=match):
        load_ground(False, tmp_path / "ground.toml")
