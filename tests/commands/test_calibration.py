"""The calibration commands on a radar whose clock and range bias are known."""

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from calibrate.echoes import echo
from flgpr.calibrate import remove_range_bias
from flgpr.commands.app import app
from flgpr.model import make_run
from flgpr.model.track import make_track
from flgpr.store import open_run, save_run, write_table

FREQUENCY = np.linspace(1.0e9, 2.5e9, 40)
TARGETS = np.array([[-0.6, 6.0, 0.0], [0.9, 7.5, 0.0]])
OFFSET = 3.37
BIAS = 0.21


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A stored run of one antenna that goes sideways at uneven speed, its track and its reflectors."""
    folder = tmp_path_factory.mktemp("rail")
    stamp = np.linspace(0, 14, 300)
    way = -1.5 + 3.0 / (1 + np.exp(-(stamp - 7.5) / 0.8))
    track = make_track(stamp, np.stack([way, np.zeros_like(way), np.full_like(way, 1.5)], axis=1))
    time = np.arange(0, 9, 0.1)
    place = np.stack([np.interp(time + OFFSET, stamp, track[n]) for n in "xyz"], axis=1)
    signal = echo(place, place, TARGETS, FREQUENCY) * np.exp(
        -2j * np.pi * FREQUENCY * 2 * BIAS / 299_792_458.0
    )
    pose = np.zeros((time.size, 6))
    save_run(
        make_run(signal[:, None, None], FREQUENCY, ["VV"], [[0, 0, 0]], [[0, 0, 0]], pose, time),
        folder / "run.zarr",
    )
    write_table(track, folder / "run-track.csv")
    (folder / "reflectors.csv").write_text(
        "x_m,y_m,z_m\n" + "".join(f"{x},{y},{z}\n" for x, y, z in TARGETS)
    )
    return folder


def flgpr(*words):
    return CliRunner().invoke(app, ["calibrate", *map(str, words)])


AREA = ("--area", -1.5, 1.8, 5.5, 8.5, "--spacing", 0.08)


def test_clock_then_range_bias_puts_the_echoes_on_the_reflectors(folder):
    clock = flgpr(
        "clock",
        folder / "run.zarr",
        *AREA,
        "--offsets",
        3.0,
        3.8,
        "--step",
        0.1,
        "-o",
        folder / "a.zarr",
        "--json",
    )
    assert clock.exit_code == 0, clock.stderr
    found = json.loads(clock.stdout)
    assert found["clock_offset_s"] == pytest.approx(OFFSET, abs=0.02)
    assert found["sharpness"] > 1.3 * found["least_sharpness"]
    places = ("--reflectors", folder / "reflectors.csv")
    bias = flgpr("range-bias", folder / "a.zarr", *places, "-o", folder / "b.zarr")
    assert bias.exit_code == 0, bias.stderr
    assert "wrote" in bias.stdout
    told = open_run(folder / "b.zarr").attrs["calibration"]
    assert told["range_bias_m"] == pytest.approx(BIAS, abs=0.01)
    assert told["clock_offset_s"] == found["clock_offset_s"]
    words = ("range-bias", folder / "b.zarr", *places, "-o", folder / "c.zarr", "--json")
    again = json.loads(flgpr(*words).stdout)
    assert again["range_bias_m"] == pytest.approx(0, abs=0.005)
    both = open_run(folder / "c.zarr").attrs["calibration"]  # what was removed in all
    assert both["range_bias_m"] == pytest.approx(told["range_bias_m"] + again["range_bias_m"])
    for row in again["reflectors"]:
        assert np.hypot(row["x_peak"] - row["x"], row["y_peak"] - row["y"]) < 0.05


def biased(folder, tmp_path, bias):
    """Store the run with another bias, and its track beside it."""
    run = remove_range_bias(open_run(folder / "run.zarr").compute(), BIAS - bias)
    save_run(run, tmp_path / "run.zarr")
    shutil.copy(folder / "run-track.csv", tmp_path)
    return tmp_path / "run.zarr"


def test_both_together_are_found_where_one_after_the_other_fails(folder, tmp_path):
    run = biased(folder, tmp_path, 1.5)
    places = ("--reflectors", folder / "reflectors.csv")
    words = ("joint", run, *places, "--offsets", 2.6, 4.2, "--step", 0.1, "--biases", -1.9, 1.9)
    made = flgpr(*words, "-o", tmp_path / "ready.zarr")
    assert made.exit_code == 0, made.stderr
    for told in (
        "clock offset 3.3",
        "range bias 1.5",
        "one standard deviation",
        "moved sideways",
        "left out",
        "wrote",
    ):
        assert told in made.stdout
    ready = open_run(tmp_path / "ready.zarr")
    assert ready.attrs["calibration"]["range_bias_m"] == pytest.approx(1.5, abs=0.01)
    assert ready.attrs["calibration"]["clock_offset_s"] == pytest.approx(OFFSET, abs=0.02)
    again = flgpr("range-bias", tmp_path / "ready.zarr", *places, "--json")
    assert json.loads(again.stdout)["range_bias_m"] == pytest.approx(0.0, abs=0.005)
    figures = json.loads(flgpr(*words, "--json").stdout)
    assert figures["over_runner_up_db"] > 4
    assert figures["over_moved_db"] > 4
    assert 0 < figures["range_bias_sigma_m"] < 0.02
    assert 0 < figures["clock_offset_sigma_s"] < 0.02
    assert figures["searched_m"] == [-1.9, 1.9]
    assert figures["standing_part_removed"]
    kept = json.loads(flgpr(*words, "--keep-standing", "--json").stdout)
    assert not kept["standing_part_removed"]


def test_a_rate_at_the_edge_and_offsets_off_the_track_are_told(folder):
    asked = ("clock", folder / "run.zarr", *AREA, "--offsets", 3.0, 5.4, "--step", 0.2)
    told = flgpr(*asked, "--rate", 1, "--rate", 1.01)
    assert told.exit_code == 0, told.stderr
    assert "rate 1 lies at the edge of those tried" in told.stdout
    assert "4 offsets were not tried: they put scans outside the track" in told.stdout
    alone = json.loads(flgpr(*asked, "--json").stdout)
    assert not alone["clock_rate_at_edge"]
    assert alone["offsets_not_tried"] == 2
    within = flgpr(*asked, "--rate", 0.9, "--rate", 1, "--rate", 1.1)
    assert "edge" not in within.stdout


def test_an_answer_not_to_be_trusted_is_refused_and_nothing_written(folder, tmp_path):
    def refused(match, *words):
        told = flgpr(*words, "-o", tmp_path / "no.zarr")
        assert told.exit_code == 2
        assert match in told.stderr
        assert str(words[1]) in told.stderr
        assert not (tmp_path / "no.zarr").exists()

    run = folder / "run.zarr"
    places = ("--reflectors", folder / "reflectors.csv")
    refused("edge of those tried", "clock", run, *AREA, "--offsets", 3.5, 4.0, "--step", 0.1)
    refused("", "range-bias", run, *places)  # the clock is not right yet
    refused(
        "edge of those tried", "joint", run, *places, "--offsets", 3.45, 4.0, "--biases", -1.9, 1.9
    )
    refused(
        "",
        "joint",
        biased(folder, tmp_path, 1.5),
        *places,
        "--offsets",
        3.0,
        3.8,
        "--biases",
        -1.0,
        1.0,
    )


def test_faults_are_told(folder, tmp_path):
    def refused(match, *words):
        told = flgpr(*words)
        assert told.exit_code == 2
        assert match in told.stderr

    run = folder / "run.zarr"
    offsets = ("--offsets", 3.0, 3.8)
    refused("x_max > x_min", "clock", run, "--area", 1, 0, 0, 1, *offsets)
    refused("at most 2,000,000 pixels", "clock", run, "--area", 0, 900, 0, 900, *offsets)
    refused("track not found", "clock", run, *AREA, *offsets, "--track", tmp_path / "none.csv")
    refused("must not exist", "clock", run, *AREA, *offsets, "-o", run)
    refused("reflectors not found", "range-bias", run, "--reflectors", tmp_path / "none.csv")
    (tmp_path / "bad.csv").write_text("x_m,y_m\n1,2\n")
    refused("missing: z_m", "range-bias", run, "--reflectors", tmp_path / "bad.csv")
    (tmp_path / "bad.csv").write_text("x_m,y_m,z_m\n1,2,0\n1,,0\n")
    refused("for reflector 2", "range-bias", run, "--reflectors", tmp_path / "bad.csv")
    (tmp_path / "bad.csv").write_text("")
    refused(
        "bad.csv: there is no line", "joint", run, "--reflectors", tmp_path / "bad.csv", *offsets
    )
    places = ("--reflectors", folder / "reflectors.csv")
    refused("ranges of this run repeat", "range-bias", run, *places, "--search", 3)
    refused("search must be positive", "range-bias", run, *places, "--search", -3)
    refused("offsets must be at most 10,000", "joint", run, *places, "--offsets", 0, 1e9)
