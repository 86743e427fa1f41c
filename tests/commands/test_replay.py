"""A result is made again by its recipe and compared."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.replay import replay
from flgpr.store import save_run


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_replay_says_identical(demo):
    assert "identical" in call("replay", demo[0].folder, "--quiet").stdout


def test_a_result_of_another_run_is_refused(demo, small_run, tmp_path):
    save_run(small_run, tmp_path / "other.zarr")
    with pytest.raises(
        ValueError, match=r"run must be the one the result was made of \(.*other\.zarr"
    ):
        replay(demo[0].folder, run=tmp_path / "other.zarr")
