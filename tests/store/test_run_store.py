import shutil
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr

from archives import read_archive
from flgpr.formats import import_fullwave
from flgpr.model import make_run
from flgpr.store import RunStoreError, RunWriter, open_run, read_table, sample_lane, save_run
from flgpr.store.files import replaced_by
from flgpr.store.journal import JOURNAL


def read_all(path):
    return open_run(path).load()


def test_a_run_comes_back_identical(small_run, tmp_path):
    save_run(small_run, tmp_path / "a.zarr")
    assert read_all(tmp_path / "a.zarr").identical(small_run)


def test_the_store_is_zarr_v3_with_one_checksummed_chunk_per_scan(small_run, tmp_path):
    save_run(small_run, tmp_path / "a.zarr")
    array = zarr.open_group(tmp_path / "a.zarr", mode="r")["signal"]
    assert array.metadata.zarr_format == 3
    assert array.chunks == (1, *array.shape[1:])
    assert "crc32c" in [codec.to_dict()["name"] for codec in array.metadata.codecs]


def test_scans_are_read_one_by_one(small_run, tmp_path):
    save_run(small_run, tmp_path / "a.zarr")
    run = open_run(tmp_path / "a.zarr")
    (tmp_path / "a.zarr" / "signal" / "c" / "2" / "0" / "0" / "0").write_bytes(b"")
    np.testing.assert_array_equal(run["signal"][1].values, small_run["signal"][1].values)
    with pytest.raises(RunStoreError, match="signal/c/2"):
        run["signal"][2].values


def test_a_chunk_of_the_same_length_differs_by_its_checksum(small_run, tmp_path):
    path = save_run(small_run, tmp_path / "a.zarr") / "signal" / "c" / "2" / "0" / "0" / "0"
    data = path.read_bytes()
    path.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    with pytest.raises(RunStoreError, match=r"signal/c/2/.*differs.*its SHA-256 is another"):
        read_all(tmp_path / "a.zarr")
    path.write_bytes(data[:-1])
    with pytest.raises(RunStoreError, match=rf"{len(data) - 1} bytes against {len(data)}"):
        read_all(tmp_path / "a.zarr")


def files_of(path):
    return sorted(p for p in path.rglob("*") if p.is_file())


def test_every_file_missing_truncated_or_altered_is_an_error(small_run, tmp_path):
    good = save_run(small_run, tmp_path / "good.zarr")
    names = [p.relative_to(good) for p in files_of(good)]
    assert len(names) > 15
    for name in names:
        for damage in ("delete", "truncate", "flip", "grow"):
            bad = tmp_path / "bad.zarr"
            shutil.rmtree(bad, ignore_errors=True)
            shutil.copytree(good, bad)
            data = bytearray((bad / name).read_bytes())
            if damage == "delete":
                (bad / name).unlink()
            elif damage == "truncate":
                (bad / name).write_bytes(data[: len(data) // 2])
            elif damage == "grow":
                (bad / name).write_bytes(bytes(data) + b" ")
            else:
                data[len(data) // 3] ^= 0x04
                (bad / name).write_bytes(data)
            with pytest.raises(RunStoreError):
                read_all(bad)


def test_an_interrupted_write_leaves_no_run(small_run, tmp_path):
    fixed = [
        small_run[n].values for n in ("frequency", "polarization", "tx_position", "rx_position")
    ]

    def write_one_scan_and_stop():
        with RunWriter(tmp_path / "a.zarr", *fixed) as writer:
            writer.append(small_run["signal"][0].values, small_run["pose"][0].values)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_one_scan_and_stop()
    assert list(tmp_path.iterdir()) == []


def parts(run):
    return [run[n].values for n in ("frequency", "polarization", "tx_position", "rx_position")]


def stop_after(run, path, scans, **options):
    def write():
        with RunWriter(path, *parts(run), run.attrs, resume=True, **options) as writer:
            append(writer, run, range(scans))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()


def append(writer, run, scans):
    for k in scans:
        writer.append(run["signal"][k].values, run["pose"][k].values, float(run["time"][k]))


def bytes_of(path):
    return {
        str(f.relative_to(path)): f.read_bytes() for f in sorted(path.rglob("*")) if f.is_file()
    }


@pytest.mark.parametrize(
    "damage", ["none", "torn journal line", "altered chunk", "missing chunk", "stray file"]
)
def test_a_stopped_writer_goes_on_and_the_bytes_are_the_same(small_run, tmp_path, damage):
    stop_after(small_run, tmp_path / "a.zarr", 3)
    left = tmp_path / "a.zarr.partial"
    journal = left / "journal.jsonl"
    chunk = left / "signal" / "c" / "1" / "0" / "0" / "0"
    if damage == "torn journal line":
        journal.write_bytes(journal.read_bytes()[:-7])
    elif damage == "altered chunk":
        chunk.write_bytes(chunk.read_bytes()[:-1] + b"x")
    elif damage == "missing chunk":
        chunk.unlink()
    elif damage == "stray file":
        (left / "signal" / "c" / "3").mkdir()
        (left / "signal" / "c" / "3" / "half.partial").write_bytes(b"half")
    with RunWriter(tmp_path / "a.zarr", *parts(small_run), small_run.attrs, resume=True) as writer:
        assert len(writer) == {"none": 3, "stray file": 3, "torn journal line": 2}.get(damage, 1)
        append(writer, small_run, range(len(writer), small_run.sizes["scan"]))
    save_run(small_run, tmp_path / "whole.zarr")
    assert bytes_of(tmp_path / "a.zarr") == bytes_of(tmp_path / "whole.zarr")
    assert not left.exists()


@pytest.mark.parametrize("ahead", [1, 3, 4, 64])
def test_bytes_do_not_hang_on_how_far_ahead_the_array_grows(
    ahead, small_run, tmp_path, monkeypatch
):
    want = bytes_of(save_run(small_run, tmp_path / "a.zarr", resume=True))
    monkeypatch.setattr("flgpr.store.run_writer._SCANS_PER_GROWTH", ahead)
    stop_after(small_run, tmp_path / "b.zarr", 2)
    assert bytes_of(save_run(small_run, tmp_path / "b.zarr", resume=True)) == want
    assert (
        zarr.open_group(tmp_path / "b.zarr", mode="r")["signal"].shape[0] == small_run.sizes["scan"]
    )


def test_another_run_is_not_gone_on_with(small_run, tmp_path):
    same = (tmp_path / "a.zarr", *parts(small_run), small_run.attrs)
    stop_after(small_run, tmp_path / "a.zarr", 2, inputs={"scene": "one"})
    with pytest.raises(RunStoreError, match=r'its scene is "one", this one\'s "two"'):
        RunWriter(*same, resume=True, inputs={"scene": "two"})
    with RunWriter(
        tmp_path / "a.zarr",
        *parts(small_run),
        small_run.attrs,
        resume=True,
        inputs={"scene": "one"},
    ) as two:
        assert len(two) == 2
        with pytest.raises(RunStoreError, match="another process is writing"):
            RunWriter(*same)
    assert open_run(tmp_path / "a.zarr").sizes["scan"] == 2
    stop_after(small_run, tmp_path / "b.zarr", 2)
    with RunWriter(tmp_path / "b.zarr", *parts(small_run)) as anew:
        assert len(anew) == 0
        append(anew, small_run, range(1))
    assert open_run(tmp_path / "b.zarr").sizes["scan"] == 1


def test_a_store_that_was_never_committed_says_so(small_run, tmp_path):
    save_run(small_run, tmp_path / "a.zarr")
    (tmp_path / "a.zarr").rename(tmp_path / "a.zarr.partial")
    with pytest.raises(RunStoreError, match="stopped before"):
        open_run(tmp_path / "a.zarr")
    with pytest.raises(FileNotFoundError, match="nothing"):
        open_run(tmp_path / "nothing")


def test_an_existing_run_is_kept_unless_told(small_run, tmp_path):
    save_run(small_run, tmp_path / "a.zarr")
    with pytest.raises(FileExistsError, match="must not exist yet"):
        save_run(small_run, tmp_path / "a.zarr")
    save_run(small_run.isel(scan=slice(0, 2)), tmp_path / "a.zarr", overwrite=True)
    assert open_run(tmp_path / "a.zarr").sizes["scan"] == 2
    assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]


def leave_as_a_kill_after_naming(monkeypatch, run, path):
    """Write a store as a process does that is killed when the store has its name and the journal still lies in it."""
    unlink = Path.unlink

    def killed_at_the_journal(file, *arguments, **options):
        if file != path / JOURNAL:
            unlink(file, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", killed_at_the_journal)
        save_run(run, path, resume=True)
    assert (path / JOURNAL).is_file()
    discarded = path.with_name(f".discarded-{path.name}-abc")
    for left in (discarded, replaced_by(path)):
        left.mkdir()
        (left / "zarr.json").write_text("{")


def test_a_whole_store_with_the_journal_of_a_killed_writer_reads_well_and_the_next_writer_tidies(
    small_run, tmp_path, monkeypatch
):
    want = bytes_of(save_run(small_run, tmp_path / "w.zarr", resume=True))
    (tmp_path / "b.zarr.old").mkdir()  # somebody's copy
    leave_as_a_kill_after_naming(monkeypatch, small_run, tmp_path / "b.zarr")
    xr.testing.assert_identical(open_run(tmp_path / "b.zarr").load(), small_run)
    save_run(small_run, tmp_path / "b.zarr", resume=True)
    assert bytes_of(tmp_path / "b.zarr") == want
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.zarr", "b.zarr.old", "w.zarr"]


def test_a_store_of_the_same_run_is_left_as_it_is_and_one_of_another_is_refused(
    small_run, tmp_path, caplog
):
    path = save_run(small_run, tmp_path / "a.zarr", resume=True)
    times = {p: p.stat().st_mtime_ns for p in files_of(path)}
    with caplog.at_level("INFO", "flgpr.outputs"):
        assert save_run(small_run, path, resume=True) == path
    assert "a.zarr exists already" in caplog.text
    for other, difference in (
        (small_run.assign(signal=2 * small_run["signal"]), "it has another signal"),
        (small_run.assign_attrs(site="field"), r'its site is "yard", this one\'s "field"'),
        (small_run.isel(scan=slice(0, 2)), "it has another "),
    ):
        with pytest.raises(FileExistsError, match=difference):
            save_run(other, path, resume=True)
    assert {p: p.stat().st_mtime_ns for p in files_of(path)} == times
    (path / "signal/c/1/0/0/0").unlink()
    with pytest.raises(FileExistsError, match="a damaged store"):
        save_run(small_run, path, resume=True)


def test_missing_sweeps_survive_the_store(small_run, tmp_path):
    small_run["signal"][1, 0, 1, 2] = np.nan
    small_run["signal"][3] = np.nan
    small_run["valid"][1, 0, 1] = False
    small_run["valid"][3] = False
    save_run(small_run, tmp_path / "a.zarr")
    assert read_all(tmp_path / "a.zarr").identical(small_run)


def test_attributes_must_fit_json(small_run, tmp_path):
    small_run.attrs["bad"] = object()
    with pytest.raises(ValueError, match="JSON"):
        save_run(small_run, tmp_path / "a.zarr")


def test_the_packaged_lane_is_what_the_importer_makes(fullwave_archive):
    lane = import_fullwave(fullwave_archive)
    assert read_all(sample_lane() / "run.zarr").identical(lane.run)
    for kind, table in (("truth", lane.truth), ("objects", lane.objects)):
        assert read_table(sample_lane() / f"{kind}.csv", kind).equals(table)


def test_the_importer_places_antennas_where_the_archive_has_them(fullwave_archive):
    from flgpr.model import vehicle_to_lane

    run = import_fullwave(fullwave_archive).run
    archive = read_archive(fullwave_archive)
    for scan in range(3):
        tx = vehicle_to_lane(run["tx_position"].values, run["pose"].values[scan]).reshape(2, 16, 3)
        rx = vehicle_to_lane(run["rx_position"].values, run["pose"].values[scan]).reshape(2, 16, 3)
        np.testing.assert_allclose(tx[:, 5], archive["tx_xyz_m"][scan], atol=1e-12)
        np.testing.assert_allclose(rx[1], archive["rx_xyz_m"][scan], atol=1e-12)
    got = run["signal"].values[2, 1].reshape(2, 16, 142)
    np.testing.assert_array_equal(got, archive["data"][2, :, :, 1])


def rewrite(archive, path, **changes):
    arrays = read_archive(archive)
    arrays.update(changes)
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    return path


def test_an_archive_without_truth_has_none(fullwave_archive, tmp_path):
    lane = import_fullwave(rewrite(fullwave_archive, tmp_path / "b.npz", truth=None))
    assert lane.truth is None
    assert lane.objects is None


def test_damaged_archives_are_refused(fullwave_archive, tmp_path):
    (tmp_path / "cut.npz").write_bytes(fullwave_archive.read_bytes()[:50_000])
    with pytest.raises(ValueError, match=r"cut\.npz"):
        import_fullwave(tmp_path / "cut.npz")
    with pytest.raises(ValueError, match="missing: rx_xyz_m"):
        import_fullwave(rewrite(fullwave_archive, tmp_path / "b.npz", rx_xyz_m=None))
    arrays = read_archive(fullwave_archive)
    with pytest.raises(ValueError, match="hertz"):
        import_fullwave(
            rewrite(fullwave_archive, tmp_path / "c.npz", frequency_hz=arrays["frequency_hz"] / 1e9)
        )
    moved = arrays["tx_xyz_m"].copy()
    moved[1, 0, 0] += 0.01
    with pytest.raises(ValueError, match="keep its form"):
        import_fullwave(rewrite(fullwave_archive, tmp_path / "d.npz", tx_xyz_m=moved))


def test_a_stopped_save_goes_on_with_the_same_run_and_throws_away_another(
    small_run, tmp_path, monkeypatch
):
    want = bytes_of(save_run(small_run, tmp_path / "w", resume=True))
    append = RunWriter.append
    seen = []

    def stopping(writer, *scan):
        if len(seen) == 2:
            raise KeyboardInterrupt
        seen.append(len(writer))
        append(writer, *scan)

    monkeypatch.setattr(RunWriter, "append", stopping)
    with pytest.raises(KeyboardInterrupt):
        save_run(small_run.assign(signal=2 * small_run["signal"]), tmp_path / "a", resume=True)
    seen.clear()
    with pytest.raises(KeyboardInterrupt):
        save_run(small_run, tmp_path / "a", resume=True)
    assert seen == [0, 1]
    seen[:] = [None] * 3
    save_run(small_run, tmp_path / "a", resume=True)
    assert seen == [None, None, None, 2, 3]
    assert bytes_of(tmp_path / "a") == want
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "w"]


def test_zarr_itself_does_not_make_zeros_of_a_scan_that_is_gone(small_run, tmp_path):
    """Other programs open runs with it: NaN, or an error where its version can be asked for one."""
    store = save_run(small_run, tmp_path / "run.zarr")
    (store / "signal" / "c" / "2" / "0" / "0" / "0").unlink()
    signal = zarr.open_group(store, mode="r")["signal"]
    assert np.isnan(signal[2]).all()
    assert np.isfinite(signal[1]).all()
    if "read_missing_chunks" in zarr.config.get("array"):
        with (
            zarr.config.set({"array.read_missing_chunks": False}),
            pytest.raises(Exception, match="chunk"),
        ):
            zarr.open_group(store, mode="r")["signal"][2]


def test_what_could_not_be_committed_is_refused_when_it_comes(small_run, tmp_path):
    fixed = [
        small_run[name].values
        for name in ("frequency", "polarization", "tx_position", "rx_position")
    ]
    with pytest.raises(ValueError, match="must increase strictly"):
        RunWriter(tmp_path / "run.zarr", fixed[0][::-1], *fixed[1:])
    assert not list(tmp_path.iterdir())
    with RunWriter(tmp_path / "run.zarr", *fixed) as writer:
        signal = small_run["signal"].values
        for pose, match in (
            ([0, 0, 1.5, 90.0, 0, 0], "in degrees"),
            ([0, 0, 1.5], "shape"),
            ([np.nan] * 6, "finite"),
        ):
            with pytest.raises(ValueError, match=match):
                writer.append(signal[0], pose, 5.0)
        writer.append(signal[0], np.zeros(6), 5.0)
        with pytest.raises(
            ValueError, match=r"time must .* not decrease from scan to scan, got 4 after 5"
        ):
            writer.append(signal[0], np.zeros(6), 4.0)
        writer.append(signal[1], np.zeros(6))
    assert open_run(tmp_path / "run.zarr").sizes["scan"] == 2


def test_committing_takes_no_memory_for_the_signal(tmp_path):
    tones = 1e9 + 1e5 * np.arange(5000)
    with RunWriter(
        tmp_path / "run.zarr", tones, ["VV"], np.zeros((4, 3)), np.zeros((4, 3))
    ) as writer:
        for scan in range(50):
            signal = np.full((1, 4, 5000), np.nan if scan == 7 else 1j)
            writer.append(signal, [0.0, scan, 2.0, 0.0, 0.0, 0.0], float(scan))
        tracemalloc.start()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2e6  # the signal has 8 MB
    run = open_run(tmp_path / "run.zarr")
    np.testing.assert_array_equal(run["frequency"].values, tones)
    np.testing.assert_array_equal(np.flatnonzero(~run["valid"].values.all(axis=(1, 2))), [7])


@pytest.mark.parametrize("silent", [[1], [0, 1, 2, 3]])
def test_scans_of_zeros_are_flagged_in_a_store_as_in_a_run(small_run, tmp_path, silent):
    signal = small_run["signal"].values.copy()
    signal[silent] = 0
    run = make_run(
        signal,
        *(small_run[name].values for name in ("frequency", "polarization", "tx_position")),
        *(small_run[name].values for name in ("rx_position", "pose", "time")),
    )
    save_run(run, tmp_path / "a.zarr")
    assert read_all(tmp_path / "a.zarr").identical(run)
    missing = np.flatnonzero(~run["valid"].values.any(axis=(1, 2)))
    np.testing.assert_array_equal(missing, silent if len(silent) < 4 else [])


def test_variables_of_a_run_have_units_and_names_in_memory_and_in_its_store(small_run, tmp_path):
    """The digest of a store covers what its arrays say of themselves; opened they say the same."""
    save_run(small_run, tmp_path / "a.zarr")
    read = open_run(tmp_path / "a.zarr")
    assert read["frequency"].attrs["units"] == "Hz"
    assert read["pose"].attrs["units"] == "m m m rad rad rad"
    for name in ("signal", "tx_position", "time", "polarization"):
        assert read[name].attrs == small_run[name].attrs
        assert read[name].attrs["long_name"]
    bare = small_run.copy()
    for name in bare.variables:
        bare[name].attrs = {}
    save_run(bare, tmp_path / "b.zarr")
    assert bytes_of(tmp_path / "a.zarr") == bytes_of(tmp_path / "b.zarr")
