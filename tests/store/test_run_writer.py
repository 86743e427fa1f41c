"""The writer of run stores: what it refuses at once, and what it resumes."""

import numpy as np
import pytest

from flgpr.model import make_run
from flgpr.store import RunStoreError, RunWriter, open_run, save_run
from flgpr.store.run_writer import RunExistsError, is_stored


@pytest.fixture
def fixed(small_run):
    names = ("frequency", "polarization", "tx_position", "rx_position")
    return [small_run[name].values for name in names]


def append(writer, run, scan):
    writer.append(run["signal"][scan].values, run["pose"].values[scan], float(scan))


def stop_after_a_scan(run, *arguments, **options):
    """Write a scan of a run and leave the writer by an exception."""
    try:
        with RunWriter(*arguments, **options) as writer:
            append(writer, run, 0)
            raise RuntimeError
    except RuntimeError:
        return


def test_a_stopped_writer_resumes_after_its_last_scan(small_run, fixed, tmp_path):
    path = tmp_path / "a.zarr"
    stop_after_a_scan(small_run, path, *fixed, resume=True)
    assert not path.exists()
    with RunWriter(path, *fixed, resume=True) as writer:
        assert len(writer) == 1
        append(writer, small_run, 1)
    np.testing.assert_array_equal(open_run(path)["signal"], small_run["signal"][:2])


def test_a_stopped_writer_leaves_nothing_unless_it_resumes(small_run, fixed, tmp_path):
    stop_after_a_scan(small_run, tmp_path / "a.zarr", *fixed)
    assert not list(tmp_path.iterdir())


def test_another_unfinished_run_is_not_resumed(small_run, fixed, tmp_path):
    path = tmp_path / "a.zarr"
    stop_after_a_scan(small_run, path, *fixed, resume=True)
    with pytest.raises(RunStoreError, match=r"another unfinished run is there: its seed is null"):
        RunWriter(path, *fixed, resume=True, inputs={"seed": 1})
    with RunWriter.resumed(path, *fixed, inputs={"seed": 1}) as writer:
        assert len(writer) == 0
        append(writer, small_run, 0)


def test_times_do_not_decrease(small_run, fixed, tmp_path):
    with RunWriter(tmp_path / "a.zarr", *fixed) as writer:
        append(writer, small_run, 2)
        with pytest.raises(ValueError, match="not decrease from scan to scan, got 1 after 2"):
            append(writer, small_run, 1)
        with pytest.raises(ValueError, match="time must be finite, or NaN"):
            writer.append(small_run["signal"][3].values, small_run["pose"].values[3], np.inf)


def test_the_same_run_is_known_again(small_run, tmp_path):
    path = tmp_path / "a.zarr"
    assert not is_stored(small_run, path)
    save_run(small_run, path, resume=True)
    assert is_stored(small_run, path)
    with pytest.raises(RunExistsError, match="which holds another run") as caught:
        is_stored(small_run.assign_attrs(site="field"), path)
    assert not caught.value.same


def test_a_run_needs_a_scan_and_attributes_that_json_can_hold(fixed, tmp_path):
    with (
        pytest.raises(ValueError, match="at least one scan, got none"),
        RunWriter(tmp_path / "a.zarr", *fixed),
    ):
        pass
    with pytest.raises(ValueError, match="attrs must be writable as JSON"):
        RunWriter(tmp_path / "b.zarr", *fixed, {"site": {1, 2}})


def raster_run(count):
    rng = np.random.default_rng(0)
    signal = rng.normal(size=(count, 1, 1, 6)) + 1j * rng.normal(size=(count, 1, 1, 6))
    place = np.zeros((1, 3))
    pose = np.zeros((count, 6))
    pose[:, 0] = np.arange(count)
    return make_run(signal, 1e9 + 1e7 * np.arange(6), ["VV"], place, place, pose, np.arange(count))


def test_small_scans_share_files_and_are_read_one_by_one(tmp_path):
    run = raster_run(3000)
    path = save_run(run, tmp_path / "a.zarr", share_files=True)
    assert len([one for one in path.rglob("*") if one.is_file()]) < 30
    stored = open_run(path)
    np.testing.assert_array_equal(stored["signal"].values, run["signal"].values)
    one = open_run(path)["signal"][1999].values
    np.testing.assert_array_equal(one, run["signal"].values[1999])
    np.testing.assert_array_equal(stored["pose"].values, run["pose"].values)


def test_a_stopped_writer_of_shared_files_goes_on_after_the_last_whole_one(tmp_path):
    run = raster_run(25)
    fixed = (
        tmp_path / "a.zarr",
        run["frequency"].values,
        ["VV"],
        np.zeros((1, 3)),
        np.zeros((1, 3)),
    )
    options = {"inputs": {"a": 1}, "together": 10}
    writer = RunWriter.resumed(*fixed, **options)
    for scan in range(17):
        writer.append(run["signal"].values[scan], run["pose"].values[scan], scan)
    writer.__exit__(RuntimeError, RuntimeError(), None)
    with RunWriter.resumed(*fixed, **options) as writer:
        assert len(writer) == 10
        for scan in range(len(writer), 25):
            writer.append(run["signal"].values[scan], run["pose"].values[scan], scan)
    stored = open_run(tmp_path / "a.zarr")
    np.testing.assert_array_equal(stored["signal"].values, run["signal"].values)
    np.testing.assert_array_equal(stored["time"].values, np.arange(25))
    whole = save_run(run, tmp_path / "b.zarr")
    np.testing.assert_array_equal(open_run(whole)["signal"].values, run["signal"].values)
