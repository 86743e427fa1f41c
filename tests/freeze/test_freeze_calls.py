"""A call of each command writes the files, ends and says what it did."""

import pytest

from freeze import calls
from freeze.commands import walk
from freeze.frozen import read_json

SLOW = {
    "benchmark run": "makes lanes, detects and scores",
    "demo": "a whole detection with its report",
    "design": "computes resolution and clutter of an array",
    "detect a survey": "two detections",
    "detect in sections": "two detections",
    "import gprmax": "loads the library of HDF5 files",
    "reproduce": "a study for every paper",
    "reproduce reasons": "a study for every paper",
    "reproduce worlds": "a study for every paper",
    "simulate gprmax": "cuts a lane into decks",
}
"""Calls of a second or more, and why."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    calls.make_inputs(folder)
    return folder


def test_every_command_is_called():
    leaves = {" ".join(words) for words, command in walk() if not hasattr(command, "commands")}
    called = {leaf for leaf in leaves for name in calls.CALLS if f"{name} ".startswith(f"{leaf} ")}
    assert called == leaves
    assert sorted(calls.CALLS) == sorted(read_json(calls.TABLE)["calls"])


def _marked(name):
    return pytest.param(name, marks=pytest.mark.slow(SLOW[name])) if name in SLOW else name


@pytest.mark.parametrize("name", [_marked(name) for name in calls.CALLS])
def test_a_call_writes_and_says_what_it_did(name, inputs, tmp_path, monkeypatch):
    found = calls.call(name, inputs, tmp_path / "out", monkeypatch.setattr)
    frozen = calls.frozen_call(name)
    assert sorted(found["files"]) == sorted(frozen["files"])
    assert found == frozen
