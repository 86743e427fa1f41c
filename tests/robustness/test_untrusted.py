"""Stores and results from anywhere: nothing outside them is reached, nothing is decoded before it is checked."""

import json
import os
import shutil
import tracemalloc
import warnings
import zipfile

import h5py
import numpy as np
import pytest
import zarr
from zarr.codecs import BytesCodec, Crc32cCodec

import flgpr
from flgpr.commands.imports import import_fullwave
from flgpr.formats.arrays import open_arrays
from flgpr.json_text import canonical_json
from flgpr.method.memory import parse_size
from flgpr.method.sections import plan_sections
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe
from flgpr.results.manifest import ResultError
from flgpr.results.result import read_result
from flgpr.store import (
    RunStoreError,
    json_with_digest,
    open_run,
    parse_with_digest,
    sample_lane,
    save_run,
    sha256,
)


def forge(store, change):
    """Change a store's manifest and give it the digests it should have."""
    manifest = json.loads((store / "commit.json").read_bytes())
    del manifest["sha256"]
    change(manifest["files"])
    for key, entry in manifest["files"].items():
        if (store / key).is_file():
            data = (store / key).read_bytes()
            entry.update(sha256=sha256(data), bytes=len(data))
    manifest["sha256"] = sha256(canonical_json(manifest))
    (store / "commit.json").write_bytes(json.dumps(manifest, indent=1, sort_keys=True).encode())


def declare(store, name, **changes):
    """Change what an array declares, digests and all."""
    path = store / name / "zarr.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))
    forge(store, lambda files: None)


@pytest.fixture
def store(small_run, tmp_path):
    return save_run(small_run, tmp_path / "run.zarr")


def test_a_forged_manifest_that_is_consistent_opens(store):
    forge(store, lambda files: None)
    assert open_run(store).load().sizes["scan"] == 4


@pytest.mark.parametrize(
    "key", ["../secret", "/etc/passwd", "signal/../../secret", "a\\..\\b", "", "signal/c/\0"]
)
def test_keys_cannot_lead_out_of_the_store(store, key):
    (store.parent / "secret").write_text("secret")
    forge(store, lambda files: files.update({key: {"sha256": "0" * 64, "bytes": 6}}))
    with pytest.raises(RunStoreError, match=r"inside|missing|run store"):
        open_run(store)


def test_symbolic_links_cannot_lead_out_of_the_store(store, small_run, tmp_path):
    chunk = store / "signal" / "c" / "1" / "0" / "0" / "0"
    outside = tmp_path / "outside"
    shutil.copy(chunk, outside)
    chunk.unlink()
    chunk.symlink_to(outside)
    with pytest.raises(RunStoreError, match="must be a regular file, got a symbolic link"):
        open_run(store)
    chunk.unlink()
    chunk.symlink_to(chunk)
    with pytest.raises(RunStoreError, match="link"):
        open_run(store)
    shutil.rmtree(store)
    good = save_run(small_run, tmp_path / "good.zarr")
    store.symlink_to(good)
    assert open_run(store).sizes["scan"] == 4


def test_a_result_cannot_reach_out(lane, tmp_path):
    folder = tmp_path / "result"
    shutil.copytree(lane.result.folder, folder)
    shutil.copy(folder / "alarms.csv", tmp_path / "outside.csv")
    (folder / "alarms.csv").unlink()
    (folder / "alarms.csv").symlink_to(tmp_path / "outside.csv")
    with pytest.raises(ResultError, match="must be a regular file, got a symbolic link"):
        read_result(folder)
    (folder / "alarms.csv").unlink()
    shutil.copy(tmp_path / "outside.csv", folder / "alarms.csv")
    manifest = parse_with_digest((folder / "manifest.json").read_bytes())
    del manifest["sha256"]
    manifest["files"]["../outside.csv"] = sha256((tmp_path / "outside.csv").read_bytes())
    (folder / "manifest.json").write_bytes(json_with_digest(manifest))
    with pytest.raises(ResultError, match="inside"):
        read_result(folder)


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("signal", {"shape": [10**9, 2, 2, 5]}, "needs 1000000000 files"),
        ("signal", {"shape": [5, 2, 2, 5]}, "signal/c/4/0/0/0 must be among"),
        ("signal", {"shape": [4, 2, 2, -5]}, "positive whole numbers"),
        ("signal", {"shape": [4, 2, 2, 10**18]}, "positive whole numbers"),
        ("signal", {"shape": "all"}, "positive whole numbers"),
        ("signal", {"data_type": "float64"}, "must be complex64"),
        ("signal", {"codecs": [{"name": "bytes"}, {"name": "zstd"}]}, "nothing that expands"),
        ("signal", {"chunk_grid": None}, "chunk shape"),
        (
            "signal",
            {
                "chunk_grid": {
                    "name": "regular",
                    "configuration": {"chunk_shape": [1, 2, 2, 10**10]},
                }
            },
            "max_memory = 2 GB",
        ),
        (
            "signal",
            {"chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [1, 2, 2, 6]}}},
            "must have 196 bytes",
        ),
        ("signal", {"chunk_key_encoding": {"name": "v2"}}, "default names"),
        (
            "signal",
            {"dimension_names": ["pair", "polarization", "scan", "frequency"]},
            "its dimensions must be",
        ),
        (
            "signal",
            {"codecs": [{"name": "bytes", "configuration": {"endian": "both"}}]},
            "little or big",
        ),
        ("signal", {"node_type": "group"}, "must describe a Zarr v3 array"),
        ("time", {"shape": [10**9]}, "dimension scan"),
        ("pose", {"shape": [4, 7]}, "component"),
    ],
)
def test_what_a_store_declares_is_checked_before_it_is_decoded(store, name, changes, words):
    declare(store, name, **changes)
    tracemalloc.start()
    with pytest.raises(RunStoreError, match=words):
        open_run(store)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6


def test_chunks_of_any_form_and_byte_order_are_read_as_zarr_reads_them(store):
    before = open_run(store).load()
    group = zarr.open_group(store, mode="a")
    for name, chunks in (("signal", (3, 2, 1, 2)), ("pose", (3, 4))):
        held = group[name]
        del group[name]
        array = group.create_array(
            name, shape=held.shape, chunks=chunks, dtype=held.dtype, dimension_names=held.metadata.dimension_names,
            serializer=BytesCodec(endian="big"), compressors=[Crc32cCodec()], config={"write_empty_chunks": True},
        )  # fmt: skip
        array[...] = before[name].values
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that no specification of Zarr has it yet
        zarr.consolidate_metadata(store)
    files = [path.relative_to(store).as_posix() for path in store.rglob("*") if path.is_file()]
    forge(
        store,
        lambda told: (
            told.clear(),
            told.update({name: {} for name in files if name != "commit.json"}),
        ),
    )
    assert open_run(store).load().identical(before)
    some = {"scan": [3, 0], "pair": 1, "frequency": slice(4, None, -2)}
    np.testing.assert_array_equal(open_run(store)["signal"].isel(some), before["signal"].isel(some))


def test_a_checksum_that_is_wrong_is_refused(store):
    chunk = store / "pose" / "c" / "0" / "0"
    chunk.write_bytes(bytes([1]) + chunk.read_bytes()[1:])
    forge(store, lambda files: None)
    with pytest.raises(RunStoreError, match="wrong checksum"):
        open_run(store)


def test_a_run_larger_than_the_memory_is_refused(store):
    with pytest.raises(RunStoreError, match="max_memory"):
        open_run(store, max_memory=500)
    assert open_run(store, max_memory=10_000).sizes["scan"] == 4


def test_memory_does_not_grow_with_scans_and_too_little_is_refused(tmp_path):
    recipe = load_recipe("demo")
    lane = Lane(-1.0, 1.0, 2.0, 6.2)
    sizes = {"polarization": 3, "pair": 14, "frequency": 106, "scan": 3}
    assert len(plan_sections(sizes, recipe, lane)) == 1
    assert len(plan_sections(sizes | {"scan": 500_000}, recipe, lane)) == 1
    assert len(plan_sections(sizes, recipe, lane, longest=1.0)) == 5
    with pytest.raises(ValueError, match="max-memory"):
        flgpr.detect(sample_lane() / "run.zarr", "demo", tmp_path / "result", max_memory=10**8)
    with pytest.raises(ValueError, match="max-memory"):
        flgpr.detect(
            [sample_lane() / "run.zarr", tmp_path / "other.zarr"],
            "demo",
            tmp_path / "several",
            max_memory=10**8,
        )
    assert list(tmp_path.iterdir()) == []


def test_a_detection_that_takes_too_much_memory_writes_nothing(lane, tmp_path):
    with pytest.raises(ValueError, match="max-memory"):
        flgpr.detect(*lane.arguments, tmp_path / "result", lane.area, max_memory=10**8)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "size"),
    [("2GB", 2 * 10**9), ("1.5 GiB", 1.5 * 2**30), ("500mb", 5 * 10**8), ("12", 12)],
)
def test_sizes(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "GB", "-1GB", "2 parsecs", "0"])
def test_what_is_no_size(text):
    with pytest.raises(ValueError, match="max-memory"):
        parse_size(text)


def test_archives_that_expand_are_refused_before_they_do(tmp_path):
    kind = zipfile.ZIP_DEFLATED
    shape = (100 * 2**20,)
    with (
        zipfile.ZipFile(tmp_path / "bomb.npz", "w", kind) as archive,
        archive.open("data.npy", "w") as member,
    ):
        np.lib.format.write_array_header_1_0(
            member, {"descr": "|u1", "fortran_order": False, "shape": shape}
        )
        for _ in range(100):
            member.write(bytes(2**20))
    with h5py.File(tmp_path / "bomb.h5", "w") as file:
        file.create_dataset("data", shape=(2**27,), dtype="f8", chunks=(2**20,), compression="gzip")
    assert os.path.getsize(tmp_path / "bomb.npz") < 200_000
    tracemalloc.start()
    for name in ("bomb.npz", "bomb.h5"):
        with pytest.raises(ValueError, match=r"bomb.*would expand"):
            open_arrays(tmp_path / name).read("data")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


@pytest.mark.slow("runs in processes of its own")
def test_archives_cannot_write_anywhere(fullwave_archive, tmp_path):
    """Members with paths that lead out are names of arrays, never files."""
    shutil.copy(fullwave_archive, tmp_path / "a.npz")
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "a") as archive,
        archive.open("../../evil.npy", "w") as member,
    ):
        np.lib.format.write_array(member, np.zeros(3))
    import_fullwave(tmp_path / "a.npz", tmp_path / "out" / "run.zarr")
    assert not list(tmp_path.parent.rglob("evil*"))
