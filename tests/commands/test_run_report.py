"""Reports of runs and models: coverage, warnings and faults."""

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.run_report import model_info, run_info
from flgpr.model import SPEED_OF_LIGHT
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import open_run, sample_lane, save_run
from small_results import small_result

RUN = str(sample_lane() / "run.zarr")


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_info_warns_of_an_array_that_no_vehicle_carries_or_that_lies_on_the_ground(tmp_path):
    run = open_run(RUN)
    pose = run["pose"].values.copy()
    pose[:, 2] = 0.0
    save_run(
        run.assign(pose=(run["pose"].dims, pose), tx_position=40 * run["tx_position"]),
        tmp_path / "odd.zarr",
    )
    shown = call("info", tmp_path / "odd.zarr", "--plot", tmp_path / "odd.png")
    assert shown.exit_code == 0, shown.output
    words = " ".join(shown.stdout.split())
    assert "72.00 m across" in words
    assert "antennas lie up to 72 m apart, more than 10 m" in words
    assert "m above the ground on average" in words
    assert not run_info(RUN)["warnings"]


def test_coverage_lies_where_the_vehicle_heads(tmp_path):
    run = open_run(RUN)
    pose = run["pose"].values.copy()
    pose[:, [0, 1, 3]] = np.stack([pose[:, 1], 0 * pose[:, 1], 0 * pose[:, 1] + np.pi / 2], axis=1)
    save_run(run.assign(pose=(run["pose"].dims, pose)), tmp_path / "rail.zarr")
    ahead = run_info(RUN)
    across = run_info(tmp_path / "rail.zarr")
    assert across["lane"]["x"] == pytest.approx(ahead["lane"]["y"])
    assert across["lane"]["y"] == pytest.approx(ahead["lane"]["x"])
    assert across["looks"]["unseen_share"] < 0.1


def test_looks_beyond_the_run_view_of_a_recipe_are_none(tmp_path):
    text = recipe_text("demo")
    farthest = parse_recipe(text).run_view.y_max
    near = tmp_path / "near.toml"
    near.write_text(text.replace(f"y_max = {farthest}", f"y_max = {farthest - 4}"))
    assert parse_recipe(near.read_text()).run_view.y_max == farthest - 4
    looks = [run_info(RUN, recipe=recipe)["looks"]["mean"] for recipe in ("demo", near)]
    assert looks[1] < 0.8 * looks[0]


def test_a_run_without_a_complete_scan_is_refused(small_run, tmp_path):
    small_run["signal"].values[:, 0] = np.nan
    run = small_run.assign(valid=np.isfinite(small_run["signal"]).all("frequency"))
    save_run(run, tmp_path / "holes.zarr")
    with pytest.raises(ValueError, match="without missing sweeps, got none among 4"):
        run_info(tmp_path / "holes.zarr")


def test_tones_give_range_and_resolution(small_run, tmp_path):
    save_run(small_run, tmp_path / "run.zarr")
    told = run_info(tmp_path / "run.zarr")
    assert told["uniform_tones"]
    assert told["largest_step_hz"] == pytest.approx(1e7)
    assert told["range_resolution_m"] == pytest.approx(SPEED_OF_LIGHT / (2 * 4e7))
    assert told["unambiguous_path_m"] == pytest.approx(SPEED_OF_LIGHT / 1e7)
    assert told["travelled_m"] == pytest.approx(3.0)
    assert told["scan_spacing_m"] == pytest.approx([1.0, 1.0])


def test_a_result_without_a_model_has_none_to_describe(tmp_path):
    small_result(tmp_path / "result")
    with pytest.raises(ValueError, match=r"its recipe alone decides; `flgpr\.view` shows"):
        model_info(tmp_path / "result")
