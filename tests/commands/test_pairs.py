"""Several numbers of an option are typed as words of their own, or as one with commas."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app, split_numbers
from flgpr.store import sample_lane

COUNTS = {"--x": 2, "--area": 4}


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        (["--x", "-3,3"], ["--x", "-3", "3"]),
        (["--x=-3,3"], ["--x", "-3", "3"]),
        (["--x", "-3", "3"], ["--x", "-3", "3"]),
        (["--area", "-1,1,5.5,8e0", "-o", "a,b"], ["--area", "-1", "1", "5.5", "8e0", "-o", "a,b"]),
        (["--x", "1,2,3"], ["--x", "1,2,3"]),
        (["--axes", "x,-z,y", "1,2"], ["--axes", "x,-z,y", "1,2"]),
        (["--x", "1,2", "3,4"], ["--x", "1", "2", "3,4"]),
        (["--", "--x", "1,2"], ["--", "--x", "1,2"]),
    ],
)
def test_numbers_behind_an_option_of_several_are_split(typed, words):
    assert split_numbers(typed, COUNTS) == words


def test_a_picture_is_the_same_in_either_form(tmp_path):
    run = str(sample_lane() / "run.zarr")
    common = ["image", run, "--spacing", "0.4", "--json"]
    commas = ["--x", "-1,1", "--y=3,6", "-o", str(tmp_path / "a.npz")]
    words = ["--x", "-1", "1", "--y", "3", "6", "-o", str(tmp_path / "b.npz")]
    first = CliRunner().invoke(app, [*common, *commas])
    second = CliRunner().invoke(app, [*common, *words])
    assert first.exit_code == 0, first.output
    assert first.stdout == second.stdout
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_too_few_numbers_are_refused():
    refused = CliRunner().invoke(app, ["image", "run.zarr", "-o", "a.png", "--x", "1,2,3"])
    assert refused.exit_code == 2
