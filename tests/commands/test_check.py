"""``flgpr check`` ends in an answer: one sentence first, then every question, and a status."""

import json

import numpy as np
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.check import check
from flgpr.model import make_run
from flgpr.store import sample_lane, save_run

RUN = str(sample_lane() / "run.zarr")


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_the_answer_comes_first_and_json_says_the_same():
    shown = call("check", RUN)
    assert shown.exit_code == 0
    told = json.loads(call("check", RUN, "--json").stdout)
    first, blank, *rows = shown.stdout.splitlines()
    assert first == told["answer"] == check(RUN).answer
    assert first.startswith("Doubtful: ")  # three scans say nothing of how they fit
    assert blank == ""
    assert {one["verdict"] for one in told["checks"]} >= {
        "doubtful",
        "looks right",
        "not observable",
    }
    assert [row for row in rows if row.startswith("looks right")]
    assert max(map(len, rows)) <= 80


def test_what_is_wrong_has_the_status_1(tmp_path):
    signal = np.ones((8, 1, 4, 40), complex) * [[1], [1], [1], [1e4]]
    places = np.column_stack([np.arange(4), np.zeros(4), np.zeros(4)])
    pose = np.zeros((8, 6))
    pose[:, 2] = 2.0
    save_run(
        make_run(signal, 1e9 + 1e7 * np.arange(40), ["VV"], places, places, pose),
        tmp_path / "n.zarr",
    )
    (tmp_path / "n-lane.toml").write_text("x_min = 20.0\nx_max = 24.0\ny_min = -1.0\ny_max = 8.0\n")
    shown = call("check", tmp_path / "n.zarr")
    assert shown.exit_code == 1
    assert shown.stdout.startswith("Wrong: pair 3 of VV: 80 dB over the median pair")
    assert "beside the middle of the lane" in shown.stdout  # of that beside the run


def test_a_run_that_cannot_be_read_has_the_status_2(tmp_path):
    assert call("check", tmp_path / "none.zarr").exit_code == 2


def test_info_names_it():
    assert f"flgpr check {RUN}" in call("info", RUN).stdout
