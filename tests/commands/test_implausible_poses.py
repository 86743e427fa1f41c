"""What detect, info and import tell of positions that no vehicle reaches, and that they blind nobody."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.recipe.schema import parse_recipe, seen_lane
from flgpr.results.result import read_result
from flgpr.store import open_run, save_run
from live_lane import make_lane_run, small_recipe

SCANS = 13
WRONG = 6
RUN = make_lane_run(scans=SCANS)
TOLD = "1 of 13 scans have positions that no vehicle reaches, which images leave out: scan 6 after scan 5: "


def call(*arguments):
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code == 0, done.output
    return done.stdout if "--json" in arguments else done.output


def with_pose(by, component=1, scans=(WRONG,)):
    run = RUN.copy(deep=True)
    run["pose"].values[list(scans), component] += by
    return run


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("poses")
    (folder / "recipe.toml").write_text(small_recipe())
    save_run(RUN, folder / "honest.zarr")
    save_run(RUN.isel(scan=[k for k in range(SCANS) if k != WRONG]), folder / "without.zarr")
    for name, by in (("near", 45.0), ("far", 1e6)):
        save_run(with_pose(by), folder / f"{name}.zarr")
    return folder


def detected(home, name):
    words = call(
        "detect",
        home / f"{name}.zarr",
        "--recipe",
        home / "recipe.toml",
        "-o",
        home / f"{name}-result",
    )
    return words, read_result(home / f"{name}-result")


@pytest.fixture(scope="module")
def without(home):
    return detected(home, "without")[1]


@pytest.mark.slow("runs a whole command more than once")
@pytest.mark.parametrize("name", ["near", "far"])
def test_detection_leaves_the_scan_out_and_tells_it(home, without, name):
    words, result = detected(home, name)
    assert (result.folder / "alarms.csv").read_bytes() == (
        without.folder / "alarms.csv"
    ).read_bytes()
    assert len(result.detections[0].alarms) > 5
    assert result.lane == without.lane
    assert TOLD in words.replace("\n", " ")
    told = result.manifest["run"]["motion"]
    assert told["scans"] == [WRONG]
    assert told["notes"][0].startswith(TOLD)
    assert told["steps"][0]["limit"] == "speed"
    assert result.manifest["run"]["masked_scans"] == []
    page = (result.folder / "report.html").read_text()
    assert TOLD in page
    stored = open_run(home / f"{name}.zarr")
    assert stored["valid"].values.all()  # what was measured stays
    assert stored["pose"].values[WRONG, 1] > 40
    assert "identical" in call("replay", result.folder)


@pytest.mark.slow("detects and opens the viewer")
def test_the_viewers_picture_marks_the_scan(home):
    detected(home, "near")
    index = json.loads((home / "near-result" / "view" / "index.json").read_text())
    assert index["scans"]["masked"] == [WRONG]


@pytest.mark.slow("runs a whole command more than once")
def test_honest_runs_are_told_nothing(home):
    words, result = detected(home, "honest")
    assert "motion" not in result.manifest["run"]
    assert "vehicle" not in words
    assert call("info", home / "honest.zarr").count("warning") == 0
    recipe = home / "recipe.toml"
    output = home / "honest-result"
    told = call("detect", home / "honest.zarr", "--recipe", recipe, "-o", output, "--json")
    assert json.loads(told)["implausible_scans"] == []


def test_info_warns_and_looks_at_the_rest(home):
    told = json.loads(call("info", home / "far.zarr", "--json"))
    assert [line for line in told["warnings"] if line.startswith(TOLD)]
    assert told["travelled_m"] < 10
    assert told["lane"]["y"][1] < 50
    honest = json.loads(call("info", home / "without.zarr", "--json"))
    assert told["looks"] == honest["looks"]
    assert "vehicle reaches" in call("info", home / "far.zarr", "--recipe", home / "recipe.toml")


def test_limits_of_the_recipe_hold(home, tmp_path):
    wide = tmp_path / "wide.toml"
    wide.write_text(small_recipe() + "\n[motion]\nspeed = 1000\nacceleration = 1000\n")
    narrow = parse_recipe(small_recipe())
    run = open_run(home / "near.zarr")
    # One scan sees the farther ground: it is seen, though too few looks let it be searched.
    seen = seen_lane(run, parse_recipe(wide.read_text()))
    assert seen.y_max > seen_lane(run, narrow).y_max + 40
    with pytest.raises(
        ValueError, match=r"line \d+: motion\.speed: input should be .* 0\.1, got 0"
    ):
        parse_recipe(small_recipe() + "\n[motion]\nspeed = 0\n")
    with pytest.raises(ValueError, match=r"motion\.sped: no such entry; did you mean speed"):
        parse_recipe(small_recipe() + "\n[motion]\nsped = 3\n")


def test_a_datum_that_moves_is_told_and_nothing_is_left_out(tmp_path):
    save_run(with_pose(500.0, 1, range(8, SCANS)), tmp_path / "moved.zarr")
    told = json.loads(call("info", tmp_path / "moved.zarr", "--json"))
    assert [
        line
        for line in told["warnings"]
        if line.startswith("positions jump once and go on from there: scan 8")
    ]
    assert told["motion"]["scans"] == []


MAPPING = """
title = "a drive"
polarization = ["HH"]
files.data = "data.npz"
[signal]
variable = "signal"
dims = ["scan", "pair", "frequency"]
[frequency]
variable = "frequency"
unit = "Hz"
[time]
variable = "time"
unit = "s"
[pose]
x = "x"
y = "y"
z = 2.0
unit = "m"
heading = 0.0
pitch = 0.0
roll = 0.0
angle_unit = "rad"
[antenna_position]
values = [[0.0, 0.0, 0.0]]
unit = "m"
"""


def test_import_tells_the_steps_and_keeps_them(tmp_path):
    place = np.arange(SCANS, dtype=float)
    place[WRONG] = 9.3e6
    arrays = {
        "x": np.zeros(SCANS),
        "y": place,
        "time": np.arange(SCANS) / 4.2,
        "frequency": np.linspace(1e9, 2e9, 8),
    }
    np.savez(tmp_path / "data.npz", signal=np.ones((SCANS, 1, 8), np.complex64), **arrays)
    (tmp_path / "lane.toml").write_text(MAPPING)
    words = call("import", "mapped", tmp_path / "lane.toml", "-o", tmp_path / "run.zarr").replace(
        "\n", " "
    )
    assert TOLD in words
    assert "m/s, at most 30 m/s (speed)" in words
    run = open_run(tmp_path / "run.zarr")
    assert run["pose"].values[WRONG, 1] == 9.3e6
    assert [note for note in run.attrs["import_notes"] if note.startswith(TOLD)]
