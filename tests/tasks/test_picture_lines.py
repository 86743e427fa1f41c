"""From commercial recordings to a focused section, by commands alone."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr import tasks
from flgpr.cli import app
from flgpr.io import open_run, save_run
from flgpr.model import SPEED_OF_LIGHT
from io_gpr import REFLECTORS, SPEED, section, write_dt1, write_dzt, write_segy

TRUE = (SPEED_OF_LIGHT / SPEED) ** 2
WRITERS = {
    "line.DZT": lambda path, counts: write_dzt(path, counts[:, None]),
    "line.sgy": write_segy,
}


def run(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.mark.parametrize("name", WRITERS)
def test_four_commands_take_a_recording_to_its_reflectors(name, tmp_path):
    WRITERS[name](tmp_path / name, section(60))
    line, ready, picture = (tmp_path / one for one in ("line.zarr", "ready.zarr", "line.png"))
    told = ["--time-zero", 4, "--band", "1.25e8", "1e9"]
    told += ["--separation", 0.2] + (["--step", 0.05] if name == "line.sgy" else [])
    run("import", "gpr", tmp_path / name, "-o", line, *told, "--quiet")
    run("prepare", line, "-o", ready, "--background")
    found = json.loads(run("calibrate", "permittivity", ready, "--json"))
    assert found["permittivity"] == pytest.approx(TRUE, rel=0.05)
    peaks = json.loads(run("image", ready, "-o", picture, "--permittivity", found["permittivity"], "--json"))["peaks"]
    places = sorted((peak["y"], -peak["z"]) for peak in peaks[:2])
    np.testing.assert_allclose(places, REFLECTORS, atol=0.04)
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.fixture
def line(tmp_path):
    write_dt1(tmp_path / "a.dt1", section(40))
    tasks.import_gpr(tmp_path / "a.dt1", tmp_path / "a.zarr")
    return tmp_path / "a.zarr"


def test_antennas_on_the_ground_ask_for_its_permittivity(line):
    with pytest.raises(ValueError, match="permittivity must be told for antennas that are coupled to the ground"):
        tasks.make_picture(line)


def test_noise_tells_no_permittivity_and_an_edge_is_none(line, tmp_path):
    held = open_run(line).compute()
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, *held["signal"].shape))
    save_run(
        held.assign(signal=(held["signal"].dims, (noise[0] + 1j * noise[1]).astype("c8"))), tmp_path / "noise.zarr"
    )
    with pytest.raises(ValueError, match=r"stands out|the edge"):
        tasks.find_permittivity(tmp_path / "noise.zarr")
    with pytest.raises(ValueError, match="at or beyond the edge of what was tried, 12 to 20"):
        tasks.find_permittivity(line, trials=np.linspace(12, 20, 9))
