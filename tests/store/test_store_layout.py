"""What a run store may declare: anything else is refused before a chunk is read."""

import json

import pytest

from flgpr.store import open_run, save_run
from flgpr.store.run_store import CommittedFiles, RunStoreError, read_manifest
from flgpr.store.store_layout import DIMS, check_declared


@pytest.fixture
def declared(small_run, tmp_path):
    """Return the files of a small store, and their contents, which a test may alter."""
    root = save_run(small_run, tmp_path / "a.zarr")
    files = CommittedFiles(root, read_manifest(root)["files"])
    contents = {name: files.read(name) for name in files.files if name.endswith("zarr.json")}
    return files.files, contents


def alter(contents, name, **entries):
    contents[name] = json.dumps({**json.loads(contents[name]), **entries}).encode()


def test_the_layout_of_what_we_write(declared, small_run):
    files, contents = declared
    layouts = check_declared(files, contents.get)
    assert set(layouts) == set(DIMS)
    assert layouts["signal"].shape == small_run["signal"].shape
    assert layouts["signal"].chunks == (1, *small_run["signal"].shape[1:])
    assert not layouts["signal"].big_endian


@pytest.mark.parametrize(
    ("name", "entries", "rule"),
    [
        ("signal", {"shape": [4, 2, 2]}, "its shape must be 4 positive whole numbers"),
        ("signal", {"shape": [4, 2, 2, -5]}, "its shape must be 4 positive whole numbers"),
        ("signal", {"chunk_grid": None}, "its chunk shape must be 4 positive whole numbers"),
        ("signal", {"data_type": "complex128"}, "its type must be complex64, got complex128"),
        ("pose", {"dimension_names": ["scan", "axis"]}, "its dimensions must be"),
        ("pose", {"codecs": [{"name": "blosc"}]}, "nothing that expands"),
        ("pose", {"chunk_key_encoding": {"name": "v2"}}, "must have the default names"),
        ("pose", {"node_type": "group"}, "must describe a Zarr v3 array"),
        ("pose", {"shape": [5, 6]}, "dimension scan must have the length 4 everywhere, got 5"),
        ("signal", {"shape": [400, 2, 2, 5]}, "needs 400 files, got less"),
    ],
)
def test_another_declaration_is_refused(declared, name, entries, rule):
    files, contents = declared
    alter(contents, f"{name}/zarr.json", **entries)
    with pytest.raises(ValueError, match=rule):
        check_declared(files, contents.get)


def test_a_chunk_of_another_size_is_refused(declared):
    files, contents = declared
    altered = {**files, "signal/c/0/0/0/0": {"bytes": 1}}
    with pytest.raises(ValueError, match="signal/c/0/0/0/0 must have 164 bytes"):
        check_declared(altered, contents.get)


def test_memory_is_bounded_before_anything_is_read(small_run, tmp_path):
    root = save_run(small_run, tmp_path / "b.zarr")
    with pytest.raises(RunStoreError, match="the run must fit into max_memory"):
        open_run(root, max_memory=100)
