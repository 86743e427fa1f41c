"""Atomic files, canonical JSON and manifests: what a later reader relies on."""

import json
import math
import os

import pytest

from flgpr.door import DoorError, listed_files
from flgpr.json_text import canonical_json, json_with_digest, parse_with_digest, sha256
from flgpr.store.files import check_free_folder, existing, merge_tables, replace_folder, write_whole


def test_canonical_json_does_not_depend_on_the_order_of_keys():
    assert canonical_json({"b": [1, 2.5], "a": "é"}) == b'{"a":"\\u00e9","b":[1,2.5]}'
    with pytest.raises(ValueError, match="JSON"):
        canonical_json({"a": math.nan})


def test_a_sealed_object_comes_back_and_an_altered_one_does_not():
    data = json_with_digest({"a": 1, "b": [None, "x"]})
    assert parse_with_digest(data) == {
        "a": 1,
        "b": [None, "x"],
        "sha256": json.loads(data)["sha256"],
    }
    with pytest.raises(ValueError, match="differs from what was written"):
        parse_with_digest(data.replace(b'"a": 1', b'"a": 2'))
    with pytest.raises(ValueError, match="cannot be read"):
        parse_with_digest(b"[1]")
    with pytest.raises(ValueError, match="must not hold the entry sha256"):
        json_with_digest({"sha256": ""})


def test_nested_tables_are_merged_entry_by_entry():
    tables = {"a": {"x": 1, "y": 2}, "b": 3}
    merged = merge_tables(tables, {"a": {"y": 5}, "b": {"z": 1}, "c": 4})
    assert merged == {"a": {"x": 1, "y": 5}, "b": {"z": 1}, "c": 4}
    assert tables == {"a": {"x": 1, "y": 2}, "b": 3}


def test_a_file_of_the_same_bytes_is_left_as_it_is(tmp_path):
    path = tmp_path / "a"
    write_whole(path, "text")
    os.utime(path, (1, 1))
    write_whole(path, b"text")
    assert path.stat().st_mtime == 1
    write_whole(path, "other")
    assert path.read_text() == "other"
    assert [file.name for file in tmp_path.iterdir()] == ["a"]


def test_a_folder_replaces_an_older_one(tmp_path):
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    replace_folder(tmp_path / "new", tmp_path / "old")
    assert [file.name for file in (tmp_path / "old").iterdir()] == ["new"]
    assert [folder.name for folder in tmp_path.iterdir()] == ["old"]


def test_an_output_folder_may_be_new_empty_or_older_output(tmp_path):
    folder = tmp_path / "out"
    assert check_free_folder(folder, ["mark"], "result") == folder
    folder.mkdir()
    check_free_folder(folder, ["mark"], "result")
    (folder / "notes.txt").touch()
    with pytest.raises(FileExistsError, match=r"an older result, got .* which holds other files"):
        check_free_folder(folder, ["mark"], "result")
    (folder / "mark").touch()
    check_free_folder(folder, ["mark"], "result")


def test_a_pointer_of_git_lfs_is_no_file(tmp_path):
    path = tmp_path / "a"
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1234\n")
    with pytest.raises(ValueError, match="pointer of Git LFS to a file of 1234 bytes"):
        existing(path, "run")
    with pytest.raises(FileNotFoundError, match="run not found"):
        existing(tmp_path, "run")


def test_a_manifest_lists_what_is_read(tmp_path):
    (tmp_path / "a").write_bytes(b"1")
    (tmp_path / "b").write_bytes(b"2")
    manifest = {
        "files": {"a": sha256(b"1")},
        "sizes": {"a": 1},
        "added": {"c": [sha256(b"3"), None]},
    }
    folder = listed_files(tmp_path, manifest)
    assert folder.read("a") == b"1"
    assert folder.read_if_listed("c") is None  # may be absent
    with pytest.raises(DoorError, match="b is not among the files"):
        folder.read("b")
    with pytest.raises(ValueError, match="its list of files cannot be read"):
        listed_files(tmp_path, {"files": {"a": 1}})
