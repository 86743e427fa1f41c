"""The journal of an unfinished store: what it resumes, and what it refuses."""

import math

import numpy as np
import pytest

from flgpr.store.journal import Journal, OtherRunError, WrittenScan, difference

ABOUT = {"frequency": "aa", "inputs": {"scene": "one"}}


def scan(number, time=0.5):
    pose = np.arange(6.0) + number
    return WrittenScan(f"{number:064d}", pose, time, np.array([[True, False]]))


@pytest.fixture
def folder(tmp_path):
    journal = Journal(tmp_path, ABOUT, False)
    journal.append(scan(0, math.nan))
    journal.append(scan(1))
    journal.close()
    return tmp_path


def resumed(folder, about=ABOUT, resume=True):
    journal = Journal(folder, about, resume)
    journal.close()
    return journal.scans


def test_scans_come_back(folder):
    first, second = resumed(folder)
    assert math.isnan(first.time)
    assert (second.sha256, second.time) == (scan(1).sha256, 0.5)
    np.testing.assert_array_equal(second.pose, scan(1).pose)
    np.testing.assert_array_equal(second.valid, scan(1).valid)


def test_without_resuming_it_begins_anew(folder):
    assert resumed(folder, resume=False) == []
    assert resumed(folder) == []


def test_another_run_is_named_by_what_differs(folder):
    with pytest.raises(OtherRunError, match=r"its scene is"):
        resumed(folder, {**ABOUT, "inputs": {"scene": "two"}})


def test_from_an_altered_line_on_nothing_counts(folder):
    path = folder / "journal.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(lines[0] + lines[1].replace(b"0", b"9", 1) + lines[2])
    assert resumed(folder) == []


def test_the_first_difference_of_nested_entries_is_named():
    assert difference({"a": 1}, {"a": 1}) == ""
    assert difference({"a": {"b": 1}}, {"a": {"b": 2}}) == "its b is 1, this one's 2"
    assert difference({"c": {"scene_sha256": "a" * 64}}, {"c": {}}) == "it has another scene"
    assert difference({}, {"z": "new"}) == 'its z is null, this one\'s "new"'
