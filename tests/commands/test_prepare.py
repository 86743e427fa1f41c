"""The options of ``flgpr prepare`` become steps in the usual order of processing."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.prepare import prepare
from flgpr.store import open_run, save_run


@pytest.fixture
def stored(small_run, tmp_path):
    return save_run(small_run, tmp_path / "run.zarr")


def test_steps_follow_the_order_of_processing_not_of_the_options(stored, tmp_path):
    run = prepare(
        stored, tmp_path / "a.zarr", agc=30.0, background=True, gate=(2.0, 60.0), time_zero=1.0
    )
    expected = [
        {"do": "time-zero", "delay_ns": 1.0},
        {"do": "gate", "start_ns": 2.0, "stop_ns": 60.0, "ramp_ns": 0.5},
        {"do": "background"},
        {"do": "agc", "window_ns": 30.0},
    ]
    assert run.attrs["history"] == expected
    assert open_run(tmp_path / "a.zarr").attrs["history"] == expected


def test_a_background_over_scans_is_a_step_by_itself(stored, tmp_path):
    run = prepare(stored, tmp_path / "a.zarr", background_scans=3)
    assert run.attrs["history"] == [{"do": "background", "scans": 3}]


def test_no_scans_of_a_background_are_refused_and_a_gate_without_an_end_is_stored(stored, tmp_path):
    with pytest.raises(
        ValueError, match=r"scans: input should be greater than or equal to 3, got 0"
    ):
        prepare(stored, tmp_path / "a.zarr", dewow=1.0, background_scans=0)
    run = prepare(stored, tmp_path / "b.zarr", steps=[{"do": "gate", "start_ns": 0.5}])
    assert run.attrs["history"] == [{"do": "gate", "start_ns": 0.5, "ramp_ns": 0.5}]


def test_a_run_that_is_subtracted_from_itself_leaves_nothing(stored, tmp_path):
    done = CliRunner().invoke(
        app, ["prepare", str(stored), "-o", str(tmp_path / "a.zarr"), "--subtract", str(stored)]
    )
    assert done.exit_code == 0, done.output
    assert f"wrote {tmp_path / 'a.zarr'}" in done.output
    assert abs(open_run(tmp_path / "a.zarr")["signal"].values).max() == 0


def test_steps_of_a_list_or_a_file_stand_alone(stored, tmp_path):
    run = prepare(stored, tmp_path / "a.zarr", steps=[{"do": "time-zero", "delay_ns": 2.0}])
    assert [step["do"] for step in run.attrs["history"]] == ["time-zero"]
    with pytest.raises(ValueError, match=r"steps must stand alone, got steps\.toml and dewow, agc"):
        prepare(stored, tmp_path / "b.zarr", steps="steps.toml", dewow=9.0, agc=9.0)
    assert not (tmp_path / "b.zarr").exists()


def test_no_step_and_too_little_memory_are_refused(stored, tmp_path):
    with pytest.raises(ValueError, match="prepare needs at least one step, got none"):
        prepare(stored, tmp_path / "a.zarr")
    with pytest.raises(ValueError, match="run must fit into max-memory = 1e-07 GB"):
        prepare(stored, tmp_path / "a.zarr", time_zero=1.0, max_memory=100)
    assert not (tmp_path / "a.zarr").exists()
