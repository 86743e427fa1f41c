import json
import signal
import subprocess
import sys
import time

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.simulation import preview_figure
from flgpr.model import Sensor, load_sensor
from flgpr.simulate import Scene


@pytest.fixture
def small():
    data = load_sensor("sri-array").model_dump()
    data["rx"] = data["rx"][::6]
    data["tones"] = {"start": 600e6, "step": 5e6, "count": 64}
    scene = Scene(
        site="arid-sand",
        length=12.0,
        surface={"density": 5.0},
        draws=[{"kind": "metal", "depth": 0.05, "count": 2}],
        track={"positions": (0.0, 1.5, 3.0)},
    )
    return scene, Sensor.model_validate(data)


def test_the_preview_draws_every_target(small, tmp_path):
    scene, _ = small
    figure = preview_figure(scene, 5)
    figure.savefig(tmp_path / "preview.png")
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "metal (2)" in labels


def wait_for_scans(journal, wanted, process):
    """Wait until the journal holds some scans and the process still runs."""
    until = time.monotonic() + 120
    while time.monotonic() < until and process.poll() is None:
        if journal.exists() and journal.read_bytes().count(b"\n") > wanted:
            return
        time.sleep(0.002)
    raise AssertionError(f"no {wanted} scans were written: {process.stderr.read()}")


@pytest.mark.slow("is killed, and begins again, several times")
def test_a_killed_simulation_goes_on_to_the_same_bits(small, tmp_path):
    """With grass, holes, shadows, all that lies in the soil, and an array that is not ideal."""
    _, sensor = small
    errors = sensor.errors
    assert all(
        [errors.antenna_drift, errors.isolation_db, errors.sweep_time, errors.burst_probability]
    )
    positions = [0.05 * k for k in range(16)]
    (tmp_path / "scene.toml").write_text(
        f'site = "temperate"\nlength = 12.0\nsurface.density = 5.0\ntrack.positions = {positions}\n'
        '[[draws]]\nkind = "metal"\ndepth = 0.05\ncount = 2\n'
    )
    (tmp_path / "sensor.toml").write_text(sensor_toml(sensor))
    lane = tmp_path / "lane.zarr"
    command = [
        "simulate",
        str(tmp_path / "scene.toml"),
        "--sensor",
        str(tmp_path / "sensor.toml"),
        "--quiet",
        "-o",
    ]
    with subprocess.Popen(
        [sys.executable, "-m", "flgpr", *command, str(lane)], stderr=subprocess.PIPE, text=True
    ) as process:
        wait_for_scans(tmp_path / "lane.zarr.partial" / "journal.jsonl", 2, process)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    assert not lane.exists()
    other = CliRunner().invoke(app, [*command, str(lane), "--seed", "2"])
    assert other.exit_code == 2
    assert "its seed is 1, this one's 2; --restart begins again" in other.stderr
    assert CliRunner().invoke(app, [*command, str(lane)]).exit_code == 0
    whole = tmp_path / "elsewhere" / "lane.zarr"
    whole.parent.mkdir()
    assert CliRunner().invoke(app, [*command, str(whole)]).exit_code == 0
    assert contents(lane.parent) == contents(whole.parent)


def sensor_toml(sensor):
    """Write a sensor as TOML: its JSON has only tables, lists, strings, numbers and booleans, and no value is null."""
    data = json.loads(sensor.model_dump_json(exclude_none=True))
    lines = [
        f"{key} = {json.dumps(value)}" for key, value in data.items() if not isinstance(value, dict)
    ]
    for key, table in data.items():
        if isinstance(table, dict):
            lines += [
                f"[{key}]",
                *(f"{name} = {json.dumps(value)}" for name, value in table.items()),
            ]
    return "\n".join(lines)


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.relative_to(folder).parts[0].startswith("lane")
    }
