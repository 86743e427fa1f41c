"""The guides are followed from top to bottom: files that they show are written, programs and commands run in order."""

import os
import shlex
import shutil
import sys
from importlib import resources
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from bag import drive
from flgpr.clutter import Thresholds
from flgpr.commands.app import app
from flgpr.commands.simulate import simulate_lane
from flgpr.model import SPEED_OF_LIGHT, Grid, load_sensor
from flgpr.simulate import Scene
from flgpr.simulate.scene.scene import load_scene
from flgpr.store import open_run, sample_lane
from io_gpr import section, write_dt1
from io_sigmf import stepped, write
from reading import FENCE, ROOT, SHELL, file_shown, read, shell_lines
from take import take_text

pytestmark = pytest.mark.slow("follows whole guides")

TINY = """
length = 8.0
[[draws]]
kind = "metal"
depth = 0.02
count = 2
[surface]
density = 3.0
[track]
step = [4.0, 5.0]
"""
RADAR = """
title = "indoors"
files.data = "radar.npy"
polarization = ["VV"]
signal = {variable = "array", dims = ["scan", "frequency"]}
frequency = {span = [1, 2], unit = "GHz"}
antenna_position = {values = [[0, 0, 0]], unit = "m"}
time = {span = [0.5, 2.5], unit = "s"}
"""
PASSPHRASE = "a long passphrase\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory, demo):
    """What a reader has before a page begins: simulated lanes, of fewer receivers than the array has, and a result."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "tiny.toml").write_text(TINY)
    array = (resources.files("flgpr.model") / "presets" / "sri-array.toml").read_text("utf-8")
    (folder / "array.toml").write_text(
        array.replace("count = 18", "count = 2").replace(
            "step = 2.5e6\ncount = 1024", "step = 5e6\ncount = 512"
        )
    )
    for seed, name in enumerate(("c1", "c2", "lane"), 1):
        simulate_lane(
            folder / "tiny.toml",
            sensor=folder / "array.toml",
            seed=seed,
            output=folder / f"{name}.zarr",
        )
    shutil.copytree(demo[0].folder, folder / "result")
    shutil.copy(sample_lane() / "truth.csv", folder / "truth.csv")
    return folder


def write_rail(path, offset=9.28, bias=0.44):
    """A rail radar of the kind that the guide takes in: two reflectors, another clock, a bias of every range."""
    ranges = 2 + 0.00915 * np.arange(600)
    time = np.linspace(0.0, 10.5, 70)
    clock = np.linspace(0.0, 20.7, 2000)
    along = (
        -5.1 + 0.62 * (clock - 9.0) + 0.3 * np.sin(1.1 * clock)
    )  # never at one speed: else no focus tells the clock
    there = np.interp(time + offset, clock, along)
    recorded = np.zeros((70, 600))
    for x, y, z in ((2.204, -3.874, 0.038), (2.329, 1.038, 0.040)):
        away = np.sqrt(x**2 + (y - there) ** 2 + (z - 0.04) ** 2) + bias
        late = ranges - away[:, None]
        recorded += np.exp(-((late / 0.12) ** 2)) * np.cos(
            4 * np.pi * 3.8e9 / SPEED_OF_LIGHT * late
        )
    recorded += np.random.default_rng(0).normal(0, 0.01, recorded.shape)
    position = np.column_stack([np.zeros(2000), along, np.full(2000, 0.04)])
    np.savez(
        path, scan=(1e5 * recorded).astype(np.int32), t_scan_ms=(2.36e6 + 1e3 * time).astype(np.uint32),
        range_m=ranges, t_mocap_s=clock, pos_mocap_m=position,
    )  # fmt: skip


def take(made, *names):
    for name in names:
        (shutil.copytree if (made / name).is_dir() else shutil.copy)(made / name, name)


def before_exchange(made):
    write_rail("rail_t6.npz")
    write_dt1(Path("line7.DT1"), section(60))
    take(made, "lane.zarr", "result", "truth.csv")
    Path("drive.mcap").write_bytes(drive(iq=lambda k: np.arange(1024) - 500 + k))
    samples, captures = stepped(sweeps=6)
    channels = {"core:num_channels": samples.shape[1]}
    write(Path(), samples.tobytes(), channels, captures, name="drive")
    still = np.tile([0.0, 0.0, 0.0, 1.0], (40, 1))
    Path("take.csv").write_text(
        take_text(0.1 * np.arange(40), np.arange(120).reshape(40, 3), still)
    )
    np.save("radar.npy", np.ones((5, 3), complex))
    Path("radar.toml").write_text(RADAR)


def before_wang(made):
    take(made, "c1.zarr", "c2.zarr", "lane.zarr", "c1-truth.csv", "c2-truth.csv")


def before_scoring(made):
    take(made, "result", "truth.csv")
    with open("sorts.csv", "w") as file:
        file.write("kind,depth,count\nmetal,0.05,5\n")
    with open("lane.toml", "w") as file:
        file.write("x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 160.0\n")
    for vendor in ("acme", "globex"):
        with open(f"{vendor}.csv", "w") as file:
            file.write("x,y,confidence\n0.1,4.2,3.0\n1.2,44.0,2.0\n-1.5,30.1,1.0\n")
    with open("recipe.toml", "w") as file:
        file.write("# a recipe\n")
    with open("alarms.csv", "w") as file:
        file.write("x,y,confidence\n0.1,4.2,3.0\n1.2,44.0,2.0\n-1.5,30.1,1.0\n")
    with open("places.csv", "w") as file:
        file.write("x,y\n0.1,4.2\n1.2,44.0\n")
    with open("others.csv", "w") as file:
        file.write(
            "x;y;confidence\n0,1;4,3;1,0\n"  # as other countries write it
            "1,0;20,0;2,0\n"
        )


def nothing(made):
    """Files that the page shows are all that it takes."""


BEFORE = {
    "exchange": before_exchange,
    "simulation": nothing,
    "imaging": nothing,
    "rvm": nothing,
    "scoring": before_scoring,
    "extending": nothing,
    "cosgrove2004": nothing,
    "fuse2018": nothing,
    "wang2007": before_wang,
}
FOLLOWED = {
    "exchange": (
        "guide/import-mapping",
        "guide/sigmf",
        "guide/vehicle-recordings",
        "guide/gpr-files",
        "guide/recording-to-image",
        "guide/calibrate",
        "guide/export",
        "guide/notebook",
    ),
    "simulation": (
        "guide/simulation",
        "guide/bodies",
        "guide/scene-ground",
        "guide/solver-runs",
    ),
    "imaging": ("reference/imaging",),
    "rvm": ("reference/rvm",),
    "scoring": (
        "guide/scoring",
        "guide/compare-detectors",
        "guide/run-a-test",
    ),
    "extending": ("guide/extending",),
    "cosgrove2004": ("evidence/papers/cosgrove2004",),
    "fuse2018": ("evidence/papers/fuse2018",),
    "wang2007": ("evidence/papers/wang2007",),
}
"""Pages that a reader follows one after the other, in the same folder."""
NOT_HERE = (
    "flgpr info line7",  # tests/exchange/test_picture_lines.py goes from recordings to pictures
    "flgpr import gpr",
    "flgpr prepare",
    "flgpr calibrate permittivity",
    "flgpr calibrate poses",  # tests/commands/test_calibrate.py; the lane here has steps of 4 m
    "flgpr image",
    "flgpr view line7",
    "flgpr detect both.zarr",  # tests/physics/test_rail.py detects on the rail
    "flgpr info own.npz",
    "flgpr info scan_0.npy",  # tests/formats/test_drafting.py drafts for all files of an array
    "flgpr import mapped own.toml",
    "flgpr import mapped drive.toml --data drive.mcap -o vehicle.zarr",
    "flgpr import mapped gotcha.toml",
    "sh decks/run.sh",  # needs gprMax; tests/exchange/test_gprmax_files.py imports what it would write
    "flgpr import gprmax",
    "flgpr simulate scene.toml -o lane.zarr --sensor sri-array",  # half a minute
    "flgpr simulate signature ring.toml",  # minutes; tests/simulate makes tables
    "flgpr benchmark",  # hours; tests/ground makes grounds and enters submissions
    # tests/test_cli.py does; here it is scored at another rate
    "flgpr score result --truth truth.csv   ",
    "flgpr agree",  # tests/viewer/test_verdicts.py has analysts
    "flgpr benchmark compare",  # tests/ground/test_own.py has entries to compare
    "flgpr reproduce",  # minutes; tests/papers has the studies
)


def fill_in(sheet):
    """Tick every target of a crew's sheet as emplaced where it was planned."""
    table = pd.read_csv(sheet, dtype=str)
    table.assign(emplaced="yes").to_csv(sheet, index=False)


def follow(page, space):
    """Do what a page says; return what each command printed."""
    text = read(page)
    printed = {}
    for fence in FENCE.finditer(text):
        kind, body = fence.groups()
        if kind in ("toml", "text") and (name := file_shown(text, fence.start())):
            with open(name, "w", encoding="utf-8") as file:
                file.write(body)
        elif kind == "python":
            exec(compile(body, str(page), "exec"), vars(space))
        elif kind in SHELL:
            for line in shell_lines(body):
                if line.startswith("cd "):
                    os.chdir(line.split()[1])
                if line.startswith("flgpr plan survey"):
                    fill_in("plan-sheet.csv")
                if line.startswith("flgpr ") and not line.startswith(NOT_HERE):
                    words = shlex.split(line, comments=True)[1:]
                    told = CliRunner().invoke(app, words, input=2 * PASSPHRASE)
                    assert told.exit_code == 0, f"{line}\n{told.output}\n{told.exception!r}"
                    printed[line.split("#")[0].strip()] = told.output
    return printed


@pytest.fixture
def followed(request, made, tmp_path, monkeypatch):
    """Pages, followed in an empty folder: the names of their programs, what their commands printed, the folder."""
    monkeypatch.chdir(tmp_path)
    space = ModuleType(
        "program_of_the_page"
    )  # a module, so that classes it defines can be found again
    monkeypatch.setitem(sys.modules, space.__name__, space)
    BEFORE[request.param](made)
    printed = {}
    for name in FOLLOWED[request.param]:
        printed |= follow(ROOT / "docs" / f"{name}.md", space)
    return space, printed, tmp_path


def page(name):
    return pytest.mark.parametrize("followed", [name], indirect=True)


@page("exchange")
def test_a_file_of_somebody_else_arrives_calibrated_and_leaves_on_earth(followed):
    space, printed, folder = followed
    (clock,) = [text for line, text in printed.items() if "calibrate clock" in line]
    assert float(clock.split("offset ")[1].split(" s")[0]) == pytest.approx(9.28, abs=0.05)
    (bias,) = [text for line, text in printed.items() if "range-bias" in line]
    assert float(bias.split("range bias ")[1].split(" m")[0]) == pytest.approx(
        0.44, abs=0.05
    )  # half a wavelength is 0.04
    (both,) = [text for line, text in printed.items() if "calibrate joint" in line]
    assert float(both.split("offset ")[1].split(" s")[0]) == pytest.approx(9.28, abs=0.02)
    assert float(both.split("range bias ")[1].split(" m")[0]) == pytest.approx(0.44, abs=0.02)
    assert space.arrived.run.sizes["scan"] == 70
    assert dict(open_run(folder / "drive.zarr").sizes)["frequency"] == 256
    assert open_run(folder / "run.zarr").sizes["scan"] == 5
    wrote = {
        "ready.zarr",
        "surveyed.toml",
        "lane.geojson",
        "tied.zarr",
        "alarms.geojson",
        "view.tif",
        "truth.kml",
    }
    assert wrote < {path.name for path in folder.iterdir()}


@page("simulation")
def test_the_scenes_can_be_simulated_and_written_for_a_solver(followed):
    _, printed, folder = followed
    assert {"scene.png", "ours.zarr", "decks"} < {path.name for path in folder.iterdir()}
    assert load_scene(folder / "scene.toml") != Scene()
    (told,) = [text for line, text in printed.items() if "gprmax" in line]
    assert "4 runs and 4 of air alone" in told


@page("scoring")
def test_alarms_are_scored_openly_and_blind(followed):
    space, printed, _ = followed
    assert space.pd_at(space.curve, 0.01) == 1.0
    assert "not told apart (p = 1); neither shows Pd >= 0.9" in printed["flgpr trial verdict ."]
    (blind,) = [text for line, text in printed.items() if "alarms.csv --sealed sealed" in line]
    assert "look 1" in blind
    (both,) = [text for line, text in printed.items() if line.endswith("--lane lane.toml -o both")]
    assert "McNemar's p = " in both


@page("wang2007")
def test_detect_train_and_detect_again(followed):
    _, _, folder = followed
    assert (folder / "trained" / "alarms.csv").read_text() != (
        folder / "plain" / "alarms.csv"
    ).read_text()


@page("fuse2018")
def test_a_frame_is_suppressed(followed):
    space, _, _ = followed
    sensor = load_sensor("dual-band-l")
    tx, rx = (side + [0.0, 0.0, sensor.height] for side in sensor.pairs())
    frequency = sensor.tones.axis()[::20]
    pixels = Grid(-6.0, 5.5, 49, 37, 0.25, 0.25).points()
    bush = space.ImagingOperator(frequency, tx, rx, np.array([[[5.0, 9.0, 0.0]]]))
    data = bush.forward(np.ones((1, 1, 1, 1), np.complex64))
    image = space.ImagingOperator(frequency, tx, rx, pixels).adjoint(data)[0, 0]
    level = np.full(4, np.abs(image).max() / 3)
    wanted = Thresholds(vv=level, vh=level, low_vh=level)
    cleaned = space.suppress(data, frequency, tx, rx, pixels, image, image, wanted)
    assert np.abs(cleaned).max() < 0.5 * np.abs(image).max()


@pytest.mark.parametrize("followed", ["imaging", "rvm", "extending", "cosgrove2004"], indirect=True)
def test_programs_run(followed):
    space, _, _ = followed
    assert len(vars(space)) > 10
