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


@pytest.mark.parametrize(
    ("outcome", "line", "status"),
    [
        ({"identical": True, "agrees": True}, "identical: every file has the same bytes", 0),
        (
            {"identical": False, "agrees": True, "files": ["a.npz", "b.csv"], "difference": 2e-6},
            "agrees: run-views differ by 2.0e-06; other bytes in a.npz, b.csv",
            0,
        ),
        (
            {"identical": False, "agrees": False, "files": ["a.npz"], "difference": 0.5},
            "DIFFERS: run-views differ by 5.0e-01; other bytes in a.npz",
            1,
        ),
    ],
)
def test_the_line_and_the_status_say_whether_results_agree(outcome, line, status):
    described = replay.__dict__["command"]
    assert list(described.lines(outcome, None)) == [line]
    assert described.status(outcome) == status
