"""``flgpr live`` on a recording in MCAP."""

import json

import numpy as np
import pytest
from mcap.writer import Writer
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.live import live
from flgpr.commands.positions import read_recorded
from flgpr.live.feeding import feed
from flgpr.store import save_run
from live_lane import make_lane_run, small_recipe

SCANS = 8
RUN = make_lane_run(scans=SCANS)
MAPPING = f"""
title = "small lane"
polarization = ["HH", "VV", "HV"]

[signal]
variable = "/radar/iq"
interleaved = true
shape = [-1, 3, 8, 74]
dims = ["scan", "polarization", "pair", "frequency"]

[frequency]
span = [{RUN["frequency"].values[0]}, {RUN["frequency"].values[-1]}]
unit = "Hz"

[tx_position]
values = {RUN["tx_position"].values.tolist()}
unit = "m"

[rx_position]
values = {RUN["rx_position"].values.tolist()}
unit = "m"

[time]
variable = "/radar/time"
unit = "s"

[pose]
position = {{variable = "/radar/pose", unit = "m"}}
angle_unit = "rad"
"""


def write_recording(path):
    """Write a drive whose messages come two by two in the wrong order."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/radar", "json", 0)
        for scan in [number + 1 - 2 * (number % 2) for number in range(SCANS)]:
            samples = RUN["signal"].values[scan].astype(np.complex64)
            message = {
                "iq": samples.view(np.float32).ravel().astype(float).tolist(),
                "pose": RUN["pose"].values[scan].tolist(),
                "time": float(RUN["time"].values[scan]),
            }
            moment = 10**18 + round(1e9 * message["time"])
            writer.add_message(channel, moment, json.dumps(message).encode(), moment)
        writer.finish()


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    write_recording(folder / "drive.mcap")
    (folder / "drive.toml").write_text(MAPPING)
    (folder / "recipe.toml").write_text(small_recipe())
    return folder


def test_a_recording_is_read_by_the_mapping_beside_it(home):
    run = read_recorded(home / "drive.mcap")
    np.testing.assert_array_equal(run["signal"].values, RUN["signal"].values.astype(np.complex64))
    np.testing.assert_allclose(run["pose"].values, RUN["pose"].values)
    np.testing.assert_allclose(run["time"].values, RUN["time"].values)
    (home / "other.toml").write_text('files.data = "drive.mcap"\n' + MAPPING)
    assert read_recorded(home / "other.toml").identical(run)


def test_its_scans_raise_the_alarms_of_a_drive(home, tmp_path):
    out = tmp_path / "out"
    words = ["live", str(home / "drive.mcap"), "--recipe", str(home / "recipe.toml"), "--rate", "0"]
    done = CliRunner().invoke(app, [*words, "-o", str(out)])
    assert done.exit_code == 0, done.output
    events = [json.loads(line) for line in (out / "live.jsonl").read_text().splitlines()]
    scans = [event["scan"] for event in events if event["event"] == "scan"]
    assert scans == list(range(SCANS))

    save_run(read_recorded(home / "drive.mcap"), tmp_path / "run.zarr")
    feed(tmp_path / "run.zarr", tmp_path / "incoming", float("inf"))
    report = live(tmp_path / "incoming", str(home / "recipe.toml"), output=tmp_path / "watched")
    assert report.alarms > 0
    table = (tmp_path / "watched" / "alarms.csv").read_bytes()
    assert (out / "alarms.csv").read_bytes() == table


def test_a_recording_without_a_mapping_is_refused_with_what_to_do(home, tmp_path):
    write_recording(tmp_path / "bare.mcap")
    with pytest.raises(ValueError, match=r"bare\.toml, which does not exist: flgpr info .*bare"):
        live(tmp_path / "bare.mcap", output=tmp_path / "out")
    (tmp_path / "drive.txt").write_text("no recording")
    with pytest.raises(ValueError, match="incoming must be a folder that a radar writes into, a"):
        live(tmp_path / "drive.txt", output=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_rate_goes_with_a_recording(tmp_path):
    with pytest.raises(ValueError, match="rate goes with a recording that is played, got 3"):
        live(tmp_path / "incoming", "wang2007", output=tmp_path / "out", rate=3.0)
