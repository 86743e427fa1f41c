"""A live run without a recipe makes one for the run, as a batch detection does."""

import json

import numpy as np
import pytest

from flgpr.live.begin_and_end import RECIPE_FILE
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.live.state import SNAPSHOT_FILE
from flgpr.recipe.schema import parse_recipe
from flgpr.store import save_run
from live_lane import make_lane_run


@pytest.fixture(scope="module")
def hh_run(tmp_path_factory):
    """A run of an array with HH alone, which the packaged recipes refuse."""
    run = make_lane_run(scans=14).sel(polarization=["HH"])
    store = tmp_path_factory.mktemp("hh") / "road.zarr"
    save_run(run, store)
    return store


def play(store, incoming, **options):
    feed(store, incoming, rate=np.inf, **options)
    return incoming


def drive(output, incoming):
    return LiveRun(LiveOptions(None, output, incoming, idle=0.5, snapshot=4)).run()


def test_an_array_with_one_polarization_is_driven_without_a_recipe(hh_run, tmp_path):
    report = drive(tmp_path / "out", play(hh_run, tmp_path / "incoming"))
    assert report.counts["received"] == 14
    assert report.counts["taken"] + report.counts["warm_up"] == 14
    recipe = parse_recipe((tmp_path / "out" / RECIPE_FILE).read_text())
    assert recipe.lane is None, "a drive that only begins has no end yet"
    assert recipe.prescreen.polarization == "HH"
    lines = (tmp_path / "out" / "live.jsonl").read_text().splitlines()
    events = [json.loads(line) for line in lines]
    told = [event for event in events if event.get("name") == RECIPE_FILE]
    assert len(told) == 1
    assert "no recipe was given" in told[0]["words"]
    assert json.loads((tmp_path / "out" / "live.json").read_text())["recipe"] == recipe.name


def test_a_drive_that_goes_on_takes_the_recipe_that_was_made(hh_run, tmp_path):
    once = drive(tmp_path / "once", play(hh_run, tmp_path / "all"))

    incoming = play(hh_run, tmp_path / "parts", count=8)
    drive(tmp_path / "twice", incoming)
    text = (tmp_path / "twice" / RECIPE_FILE).read_bytes()
    play(hh_run, incoming, first=8)
    twice = drive(tmp_path / "twice", incoming)

    assert (tmp_path / "twice" / RECIPE_FILE).read_bytes() == text
    assert twice.counts["received"] == once.counts["received"]
    alarms = [(tmp_path / name / "alarms.csv").read_bytes() for name in ("once", "twice")]
    assert alarms[0] == alarms[1]


def test_a_snapshot_without_its_recipe_is_told(hh_run, tmp_path):
    incoming = play(hh_run, tmp_path / "incoming")
    drive(tmp_path / "out", incoming)
    assert (tmp_path / "out" / SNAPSHOT_FILE).exists()
    (tmp_path / "out" / RECIPE_FILE).unlink()
    with pytest.raises(ValueError, match=r"recipe must be given .* recipe\.toml; `fresh`"):
        drive(tmp_path / "out", incoming)


def test_a_model_needs_its_recipe(tmp_path):
    with pytest.raises(ValueError, match="recipe must be given with a model"):
        LiveRun(LiveOptions(None, tmp_path / "out", tmp_path / "in", model=tmp_path / "model"))
