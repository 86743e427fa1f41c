"""Several writers of one run: one wins, the others are told, and the store is whole."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flgpr import system
from flgpr.store import RunWriter, open_run

FIXED = (np.arange(1.0, 5.0) * 1e9, ["HH"], np.zeros((2, 3)), np.ones((2, 3)))


def begin(path, **options):
    return RunWriter(path, *FIXED, {}, **options)


def write(writer, scans=3):
    with writer:
        for k in range(len(writer), scans):
            writer.append(np.full((1, 2, 4), k + 1), np.zeros(6))


def at_the_next(monkeypatch, owner, name, act):
    """Let ``act`` happen just before the next call of a function, as another process might."""
    real = getattr(owner, name)

    def late(*args, **options):
        monkeypatch.setattr(owner, name, real)
        act()
        return real(*args, **options)

    monkeypatch.setattr(owner, name, late)


@pytest.mark.parametrize(
    "step", [(Path, "mkdir"), (os, "open"), (system, "lock")], ids=lambda step: step[1]
)
def test_a_writer_that_begins_while_another_commits_is_refused(tmp_path, monkeypatch, step):
    first = begin(tmp_path / "a.zarr", resume=True)
    at_the_next(monkeypatch, *step, lambda: write(first))
    with pytest.raises(FileExistsError, match="output must not exist yet"):
        begin(tmp_path / "a.zarr", resume=True)
    assert open_run(tmp_path / "a.zarr")["signal"].load()[-1, 0, 0, 0] == 3
    assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]


def test_a_writer_that_gives_up_takes_nothing_of_the_next_ones(tmp_path, monkeypatch):
    failing = begin(tmp_path / "a.zarr")
    next_one = []
    failing.append(np.ones((1, 2, 4)), np.zeros(6))
    real = Path.rename

    def rename(path, target):
        moved = real(path, target)
        monkeypatch.setattr(Path, "rename", real)
        next_one.append(begin(tmp_path / "a.zarr", resume=True))
        return moved

    monkeypatch.setattr(Path, "rename", rename)
    failing.__exit__(KeyError, KeyError(), None)
    write(next_one[0])
    assert open_run(tmp_path / "a.zarr")["signal"].load()[:, 0, 0, 0].values.tolist() == [1, 2, 3]
    assert [p.name for p in tmp_path.iterdir()] == ["a.zarr"]


RACER = """
import os, sys, time
sys.path.insert(0, sys.argv[1])
from test_run_races import begin, write
import numpy as np
folder, start = sys.argv[2], time.time() + 0.1
own = next((racer for racer in (1, 2) if not os.fork()), 0)
rng = np.random.default_rng(own)
for trial in range(12):
    time.sleep(max(0.0, start + 0.2 * trial + rng.uniform(0, 0.06) - time.time()))
    try:
        write(begin(f"{folder}/{trial}.zarr", resume=True))
        said = "wrote"
    except Exception as error:
        said = error
    print(f"{trial} {said}\\n", end="", flush=True)  # in one piece, for the others write there too
"""


@pytest.mark.slow("runs in processes of its own")
def test_of_processes_that_race_one_writes_and_the_others_are_refused(tmp_path):
    command = [sys.executable, "-c", RACER, str(Path(__file__).parent), str(tmp_path)]
    said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    told = [line.split(" ", 1) for line in said.splitlines()]
    assert len(told) == 36
    for trial in range(12):
        words = [text for number, text in told if int(number) == trial]
        assert words.count("wrote") == 1, words
        assert (
            sum(
                "another process is writing" in w or "output must not exist yet" in w for w in words
            )
            == 2
        ), words
        assert open_run(tmp_path / f"{trial}.zarr").load().sizes["scan"] == 3
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f"{t}.zarr" for t in range(12))
