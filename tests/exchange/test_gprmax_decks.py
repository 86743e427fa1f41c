"""Results of gprMax, made here in its documented layout: dipoles in air, and one point that scatters."""

import json
import shutil

import h5py
import numpy as np
import pytest

from damage import in_forks
from flgpr.formats import GprmaxRun, explain_file, read_gprmax
from flgpr.store import open_run, read_lane
from flgpr_exchange.commands.importing import import_gprmax_decks
from flgpr_exchange.gprmax.deck_folder import write_gprmax_decks
from io_gprmax import dipole_field, lane_and_sensor, write_output
from robust import digests

TONES = 600e6 + 50e6 * np.arange(15)


@pytest.fixture(scope="module", autouse=True)
def quick_children():
    with in_forks():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Decks of a lane, their results, and where the scattering point is."""
    scene, sensor = lane_and_sensor()
    folder = tmp_path_factory.mktemp("gprmax") / "decks"
    decks = write_gprmax_decks(scene, sensor, 1, folder, cells_per_wavelength=12)
    place = np.array([0.1, 0.7, 0.1])
    for name, text in decks.files.items():
        if name.endswith(".in"):
            scatterer = None if name.startswith("air") else place - decks.manifest["grid"]["origin"]
            write_output(folder / name.replace(".in", ".out"), text, scatterer)
    return folder, place


def test_results_become_a_run_with_the_echo_of_the_point(folder, tmp_path):
    results, place = folder
    import_gprmax_decks(results, tmp_path / "run.zarr")
    run = open_run(tmp_path / "run.zarr")
    np.testing.assert_allclose(run["frequency"], TONES)
    assert run["signal"].shape == (1, 3, 2, 15)
    tx, rx = (run[f"{end}_position"].values + run["pose"].values[0, :3] for end in ("tx", "rx"))
    tilted = np.array([0.0, np.sin(0.3), np.cos(0.3)])
    for row, (send, receive) in enumerate(
        ((np.eye(3)[0], np.eye(3)[0]), (tilted, tilted), (np.eye(3)[0], tilted))
    ):
        for pair in range(2):
            there = [dipole_field(send, place - tx[pair], c, TONES) for c in range(3)]
            back = [sum(receive[k] * dipole_field(np.eye(3)[c], rx[pair] - place, k, TONES) for k in range(3))
                    for c in range(3)]  # fmt: skip
            wanted = 1e-3 * sum(a * b for a, b in zip(there, back, strict=True))
            got = run["signal"].values[0, row, pair]
            assert np.abs(got - wanted).max() < 0.01 * np.abs(wanted).max()
    assert read_lane(tmp_path / "run-lane.toml").y_max == 0.8
    assert (tmp_path / "run-truth.csv").read_text().count("metal") == 1
    assert run.attrs["fullwave"]["omissions"]


def test_decks_that_are_there_with_their_results_stay(folder, tmp_path, caplog):
    copy = shutil.copytree(folder[0], tmp_path / "decks")
    want = digests(copy)
    with caplog.at_level("INFO", "flgpr.outputs"):
        write_gprmax_decks(*lane_and_sensor(), 1, copy, cells_per_wavelength=12)
    assert "decks exists already" in caplog.text
    with pytest.raises(FileExistsError, match="something else"):
        write_gprmax_decks(*lane_and_sensor(), 2, copy, cells_per_wavelength=12)
    assert digests(copy) == want


def test_the_direct_wave_can_be_kept(folder):
    results, _ = folder
    kept = GprmaxRun(results, keep_direct=True).scan(0)
    taken = GprmaxRun(results).scan(0)
    tx = np.array([0.0, 0.0, 0.0])
    rx = np.array([0.38, 0.0, 0.0])
    direct = dipole_field(np.eye(3)[0], rx - tx, 0, TONES)
    np.testing.assert_allclose((kept - taken)[0, 0], direct, atol=0.01 * np.abs(direct).max())


def test_info_explains_a_result(folder):
    results, _ = folder
    told = explain_file(next(results.glob("scan*.out")))
    assert told.kind == "result of gprMax"
    text = "\n".join(told.lines)
    assert "gprMax 3.1.7" in text
    assert "source HertzianDipole at" in text
    assert "receiver r0n0" in text
    assert "manifest.json beside it" in text


def test_missing_and_damaged_results_are_one_clear_error_each(folder, tmp_path):
    copy = shutil.copytree(folder[0], tmp_path / "decks")
    one = next(copy.glob("scan*.out"))
    whole = one.read_bytes()

    def refused(match):
        with pytest.raises(ValueError, match=match):
            import_gprmax_decks(copy, tmp_path / "run.zarr")
        assert not (tmp_path / "run.zarr").exists()

    one.write_bytes(whole[: len(whole) // 2])
    refused("damaged or of another kind")
    one.write_bytes(whole)
    for change, match in (
        (lambda f: f.attrs.pop("dt"), "must have the attribute dt"),
        (lambda f: f.attrs.pop("gprMax"), "must have the attribute gprMax"),
        (lambda f: f.attrs.update({"dx_dy_dz": (0.1, 0.1, 0.1)}), "cells must be"),
        (lambda f: f.pop("rxs/rx1"), "no Ex of a receiver named 'r0n0'"),
        (lambda f: f.attrs.update({"Iterations": 7}), "must hold 7 values"),
    ):
        one.write_bytes(whole)
        with h5py.File(one, "r+") as file:
            change(file)
        refused(match)
    one.unlink()
    refused("1 of 4 results are missing, scan000-tx00-")
    manifest = copy / "manifest.json"
    manifest.write_text(json.dumps({"format": "other"}))
    refused("format must be")
    manifest.unlink()
    refused("must hold the manifest.json")
    with pytest.raises(FileNotFoundError, match="nothing"):
        import_gprmax_decks(tmp_path / "nothing", tmp_path / "run.zarr")
    scene, sensor = lane_and_sensor()
    with pytest.raises(FileExistsError):
        write_gprmax_decks(scene, sensor, 1, copy, cells_per_wavelength=12)  # its manifest is gone


@pytest.mark.slow("is killed, and begins again, several times")
def test_a_stopped_import_goes_on_unless_a_result_has_changed(folder, tmp_path, monkeypatch):
    copy = shutil.copytree(folder[0], tmp_path / "decks")
    manifest = json.loads((copy / "manifest.json").read_text())
    runs = [{**run, "scan": scan} for scan in range(3) for run in manifest["runs"]]
    told = {"runs": runs, "pose": manifest["pose"] * 3, "time": [0.0, 1.0, 2.0]}
    (copy / "manifest.json").write_text(json.dumps(manifest | told))
    whole = import_gprmax_decks(copy, tmp_path / "whole.zarr")
    made = []
    scan = GprmaxRun.scan

    def stopped(run, index):
        made.append(index)
        if made == [0, 1]:
            raise KeyboardInterrupt
        return scan(run, index)

    def begin():
        return import_gprmax_decks(copy, tmp_path / "run.zarr")

    monkeypatch.setattr(GprmaxRun, "scan", stopped)
    with pytest.raises(KeyboardInterrupt):
        begin()
    assert [path.name for path in tmp_path.glob("run*")] == ["run.zarr.partial"]
    assert [path.name.replace("run", "whole") for path in begin()] == [path.name for path in whole]
    assert made == [0, 1, 1, 2]
    assert digests(tmp_path / "run.zarr") == digests(tmp_path / "whole.zarr")
    shutil.rmtree(tmp_path / "run.zarr")
    made.clear()
    with pytest.raises(KeyboardInterrupt):
        begin()
    with h5py.File(next(copy.glob("scan*-H.out")), "r+") as file:
        file["rxs/rx1/Ex"][50] += 1
    begin()
    assert made == [0, 1, 0, 1, 2]


def test_a_result_with_values_that_are_not_finite_is_a_missing_sweep(folder, tmp_path):
    copy = shutil.copytree(folder[0], tmp_path / "decks")
    one = next(copy.glob("scan*-H.out"))
    with h5py.File(one, "r+") as file:
        file["rxs/rx1/Ex"][50] = np.nan
    assert read_gprmax(one).steps > 100
    import_gprmax_decks(copy, tmp_path / "run.zarr")
    valid = open_run(tmp_path / "run.zarr")["valid"].values[0]
    np.testing.assert_array_equal(valid, [[False, True], [True, True], [True, True]])
