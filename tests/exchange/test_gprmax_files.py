"""Anybody's gprMax results, made here in the documented layout: a dipole and two receivers in air, two scans."""

from functools import cache

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from damage import in_forks
from flgpr.commands.app import app
from flgpr.store import open_run
from flgpr_exchange.gprmax.output import pulse
from io_gprmax import SPEED, dipole_field

CELL = 0.01
STEP = 1.9e-11
STEPS = 700
CENTRE = 1e9
OFFSETS = np.array([[0.4, 0.0, 0.0], [-0.3, 0.2, 0.0]])


def spectrum_of(current, frequency):
    time = STEP * (np.arange(current.size) + 0.5)
    return np.exp(-2j * np.pi * np.outer(frequency, time)) @ current * STEP


@cache
def driven():
    """Frequencies of a long record, the current at the source and the spectrum of its moment."""
    f = np.fft.rfftfreq(4 * STEPS, STEP)[1:]
    current = pulse("ricker", CENTRE, STEP * (np.arange(4 * STEPS) + 0.5))
    return f, current, spectrum_of(current, f) / STEP * CELL


def write_scan(path, place, samples=False):
    f, current, moment = driven()
    with h5py.File(path, "w") as file:
        file.attrs.update(
            {"gprMax": "3.1.7", "Title": "two receivers", "Iterations": STEPS, "dt": STEP}
        )
        file.attrs["dx_dy_dz"] = (CELL, CELL, CELL)
        source = file.create_group("srcs/src1")
        source.attrs.update({"Type": "HertzianDipole", "Position": place})
        if samples:
            group = source.create_group("excitation")
            group["samples"] = current[:STEPS]
            group.attrs.update({"Units": "A", "TimeSampleOffset": STEP / 2, "SpatialScale": CELL})
        for n, offset in enumerate(OFFSETS):
            group = file.create_group(f"rxs/rx{n + 1}")
            group.attrs.update({"Name": f"Rx{n}", "Position": place + offset})
            for axis, name in enumerate(("Ex", "Ey", "Ez")):
                field = -1j * dipole_field(np.eye(3)[0], offset, axis, f) * moment
                group[name] = np.fft.irfft(np.concatenate([[0], field]))[:STEPS]


@pytest.fixture(scope="module", autouse=True)
def quick_children():
    with in_forks():
        yield


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / f"model{k + 1}.out" for k in range(2)]
    for k, path in enumerate(paths):
        write_scan(path, np.array([1.0, 1.0 + 0.1 * k, 1.5]))
    return paths


def flgpr(paths, output, *words):
    return CliRunner().invoke(
        app, ["import", "gprmax", *map(str, paths), "-o", str(output), *map(str, words)]
    )


TOLD = ("--band", 5e8, 1.5e9, "--transmit", "H", "--ground", 0.5)
PULSE = ("--waveform", "ricker", "--centre", CENTRE)


def test_files_become_the_scans_of_a_run(files, tmp_path):
    told = flgpr(files, tmp_path / "run.zarr", *TOLD, *PULSE)
    assert told.exit_code == 0, told.stderr
    run = open_run(tmp_path / "run.zarr")
    assert run["polarization"].values.tolist() == ["HH", "HV"]
    np.testing.assert_allclose(run["pose"].values[:, :3], [[1, 1, 1], [1, 1.1, 1]])
    np.testing.assert_allclose(run["rx_position"].values, OFFSETS)
    tones = run["frequency"].values
    np.testing.assert_allclose(np.diff(tones), 1 / (STEP * STEPS))
    for pair, offset in enumerate(OFFSETS):
        wanted = dipole_field(np.eye(3)[0], offset, 0, tones)
        np.testing.assert_allclose(run["signal"].values[1, 0, pair], wanted, rtol=0.01)
    delay = np.polyfit(2 * np.pi * tones, np.unwrap(np.angle(run["signal"].values[0, 0, 1])), 1)[0]
    assert -delay * SPEED == pytest.approx(np.linalg.norm(OFFSETS[1]), abs=0.03)


def test_the_samples_of_gprmax_4_need_no_waveform(files, tmp_path):
    flgpr(files, tmp_path / "three.zarr", *TOLD, *PULSE)
    assert "must be told" in flgpr(files, tmp_path / "no.zarr", *TOLD).stderr
    for k, path in enumerate(files):
        write_scan(path, np.array([1.0, 1.0 + 0.1 * k, 1.5]), samples=True)
    assert flgpr(files, tmp_path / "four.zarr", *TOLD).exit_code == 0
    three, four = (
        open_run(tmp_path / name)["signal"].values for name in ("three.zarr", "four.zarr")
    )
    np.testing.assert_allclose(three, four, rtol=1e-4)


def test_faults_are_told(files, tmp_path):
    def refused(match, paths, *words):
        told = flgpr(paths, tmp_path / "run.zarr", *words)
        assert told.exit_code == 2
        assert match in told.stderr
        assert not (tmp_path / "run.zarr").exists()

    refused("need --band, --transmit and --ground", files)
    refused("transmit must be H or V", files, *TOLD[:-3], "x", "--ground", 0, *PULSE)
    refused("band must increase", files, "--band", 5e9, 1e9, *TOLD[3:], *PULSE)
    refused("band must hold two tones", files, "--band", 1.00e9, 1.01e9, *TOLD[3:], *PULSE)
    refused("two of x, y and z", files, *TOLD, *PULSE, "--v", "x")
    refused("go together", files, *TOLD, "--waveform", "ricker")
    refused("the waveform must be", files, *TOLD, "--waveform", "square", "--centre", 1e9)
    refused("file not found", [tmp_path / "none.out"], *TOLD)

    def changed(change, match):
        write_scan(files[1], np.array([1.0, 1.1, 1.5]))
        with h5py.File(files[1], "r+") as file:
            change(file)
        refused(match, files, *TOLD, *PULSE)

    changed(
        lambda f: f["rxs/rx1"].attrs.update({"Position": (0.0, 0.0, 0.0)}),
        "receivers must stand about the source",
    )
    changed(lambda f: f.attrs.update({"dt": 1e-11}), "steps of")
    changed(lambda f: f.pop("srcs"), "must hold one source, got 0")
    changed(lambda f: f.pop("rxs"), "holds no array")

    def merge(file):
        values = file["rxs/rx1/Ex"][()]
        del file["rxs/rx1/Ex"]
        file["rxs/rx1/Ex"] = np.stack([values, values], axis=1)

    def claim(size):
        """Say that an array has so many values, none of which the file holds."""

        def change(file):
            del file["rxs/rx1/Ex"]
            file.create_dataset("rxs/rx1/Ex", shape=(size,), chunks=(2**20,), dtype="f4")
            file.attrs["Iterations"] = size

        return change

    changed(claim(2**40), "/rxs/rx1/Ex must hold at most")
    changed(claim(2**28), "/rxs/rx1/Ex takes 0 bytes of the file and would expand to")
    changed(merge, "this is a merged B-scan: give the scans' own results")
