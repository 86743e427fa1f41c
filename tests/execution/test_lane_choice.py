"""Which lane a stored run is searched in: given, of the recipe, beside the run, or seen."""

import pytest
from typer.testing import CliRunner

from flgpr.chain.recipe import parse_recipe
from flgpr.commands.app import app
from flgpr.execution.lane_choice import choose_lane
from flgpr.results.result import read_result
from flgpr.store import save_run
from flgpr.store.tables import lane_file_of
from small_lane import LANE, LANE_TOML, small_recipe, small_run

OWN_LANE = "\n[lane]\nx_min = -0.7\nx_max = 0.7\ny_min = 3.0\ny_max = 9.0\n"


def test_the_order_of_lanes(tmp_path):
    run = tmp_path / "road.zarr"
    recipe = parse_recipe(small_recipe())
    assert choose_lane(run, None, recipe) == (None, "")

    lane_file_of(run).write_text(LANE_TOML)
    assert lane_file_of(run) == tmp_path / "road-lane.toml"
    assert choose_lane(run, None, recipe) == (LANE, "road-lane.toml beside the run")

    with_lane = parse_recipe(small_recipe() + OWN_LANE)
    assert choose_lane(run, None, with_lane) == (None, "")

    given = tmp_path / "given.toml"
    given.write_text(LANE_TOML)
    assert choose_lane(run, given, with_lane) == (LANE, "given.toml, as given")
    assert choose_lane(run, LANE, with_lane) == (LANE, "as given")


def test_a_file_beside_the_run_that_is_no_lane_is_named(tmp_path):
    (tmp_path / "road-lane.toml").write_text("x_min = 1.0\n")
    with pytest.raises(ValueError, match=r"road-lane\.toml"):
        choose_lane(tmp_path / "road.zarr", None, None)


def test_detect_takes_the_lane_beside_the_run_and_says_so(tmp_path):
    save_run(small_run(), tmp_path / "road.zarr")
    (tmp_path / "road-lane.toml").write_text(LANE_TOML)
    (tmp_path / "own.toml").write_text(small_recipe())
    output = tmp_path / "out"
    words = ["detect", tmp_path / "road.zarr", "--recipe", tmp_path / "own.toml", "-o", output]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "searched: x -0.75 to 0.75 m, y 3.0 to 10.0 m (road-lane.toml beside the run)" in said
    result = read_result(output)
    assert result.lane == LANE
    assert result.manifest["run"]["searched"]["source"] == "road-lane.toml beside the run"
    assert "Searched: x -0.75 to 0.75 m" in (output / "report.html").read_text()
