"""Recipes are ranked for a run by what they found elsewhere, with what the run lacks for the others."""

import json

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.recipe.schema import recipe_names
from flgpr.recipe.suggest import FITS, FITTED, LACKS, MADE, evidence, suggest
from flgpr.store import open_run, sample_lane

RUN = sample_lane() / "run.zarr"


@pytest.fixture(scope="module")
def run():
    return open_run(RUN)


def by_name(suggestions):
    return {one.recipe: one for one in suggestions.ranked}


def test_what_fits_comes_first_and_all_that_fits_by_what_it_found(run):
    ranked = suggest(run).ranked
    order = [(FITS, FITTED, "doubtful", LACKS).index(one.verdict) for one in ranked]
    assert order == sorted(order)
    fits = [one.found.get("prepared", 0) for one in ranked if one.verdict == FITS]
    assert fits == sorted(fits, reverse=True)
    assert {MADE, "demo", "miniature", "fused", "wang2007"} <= set(by_name(suggest(run)))


def test_what_the_run_lacks_is_named(run):
    few = suggest(run.sel(polarization=["HH"]))
    assert "needs HH, HV, VV; this run has HH" in by_name(few)["wang2007"].why
    assert any("this run has 0.4425 to 1.5 GHz" in why for why in by_name(few)["wang2007"].why)
    assert by_name(few)["cosgrove2004"].verdict == LACKS
    assert by_name(few)[MADE].verdict == FITS


def test_a_run_that_nothing_fits_says_so(run):
    low = run.assign(
        pose=(run["pose"].dims, run["pose"].values * [1, 1, 0, 1, 1, 1] - [0, 0, 9, 0, 0, 0])
    )
    suggestions = suggest(low)
    assert suggestions.answer.startswith("No recipe fits")
    assert by_name(suggestions)[MADE].why


def test_the_answer_comes_first_with_the_exact_command():
    shown = CliRunner().invoke(app, ["recipe", "suggest", str(RUN)])
    assert shown.exit_code == 0, shown.output
    first = shown.stdout.splitlines()[0]
    assert first.startswith(f"Begin with `flgpr detect {RUN} -o result`, which needs no training: ")
    assert max(map(len, shown.stdout.splitlines()[1:])) <= 110
    told = json.loads(CliRunner().invoke(app, ["recipe", "suggest", str(RUN), "--json"]).stdout)
    assert told["answer"].replace("RUN", str(RUN)) == first
    assert {"recipe", "verdict", "found", "why", "command"} <= set(told["recipes"][0])


def test_the_packaged_figures_are_of_packaged_recipes_and_tracks():
    table = evidence()
    for name, found in table["found"].items():
        assert name == MADE or name in recipe_names()
        assert set(found) <= set(table["tracks"])
        assert all(count <= table["tracks"][track]["of"] for track, count in found.items())
    assert set(table["p"]) < set(table["found"])
