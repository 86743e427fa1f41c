"""Time two checkouts side by side: is the new one slower, does it find the same.

Usage::

    python benchmarks/old_and_new.py OLD NEW [--rounds 5] [--only detect] [--by processor]

``OLD`` and ``NEW`` are checkouts, such as worktrees of git. ``simulate`` makes a lane for the
``sri-array``, ``detect`` and ``live`` run the recipe ``wang2007`` on it, each by
``python -m flgpr`` in a process of its own, from start to end. The lane and the scans that come
live are made once, by ``OLD``. Each round times both checkouts, and rounds change who begins. A
round before them, which does not count, leaves kernels compiled and files in memory.

Printed are medians of the seconds on the clock and on the processor, their ratio new/old, and the
least and largest ratio of a round, and whether both wrote the same bytes. On a machine that does
other work as well, the processor's seconds say more. The exit code is 1 if a ratio of medians is
larger than ``--most``, or results differ.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

SCENE = """name = "old and new"
site = "arid-sand"
x_min = -1.5
x_max = 1.5
length = {length}
[[draws]]
kind = "metal"
depth = 0.05
count = 6
[track]
step = [1.0, 1.0]
"""
SIDES = ("old", "new")
OUTPUT = "OUTPUT"
VERSIONED = (
    "live.json", "live.jsonl", "made-of.json", "manifest.json", "report.html", "snapshot.bundle",
)  # fmt: skip
"""Files with versions, paths, times or words, which may differ."""


@dataclass(frozen=True)
class Seconds:
    """What a process took."""

    clock: float
    processor: float


@dataclass(frozen=True)
class Comparison:
    """Medians of both sides, s, their ratio new/old, and the least and largest ratio of a round."""

    old: float
    new: float
    ratio: float
    least: float
    largest: float


def compare(old: Sequence[float], new: Sequence[float]) -> Comparison:
    """Compare the seconds of two sides, a pair for each round."""
    ratios = [after / before for before, after in zip(old, new, strict=True)]
    before = median(old)
    after = median(new)
    return Comparison(before, after, after / before, min(ratios), max(ratios))


def order_of(round_number: int) -> tuple[str, str]:
    """Return who is timed first in a round, and who second."""
    return SIDES if round_number % 2 == 0 else (SIDES[1], SIDES[0])


def run(checkout: Path, words: Sequence[object]) -> Seconds:
    """Run a command of a checkout to its end and return what it took; a failure ends all."""
    environment = {**os.environ, "PYTHONPATH": str(checkout / "src")}
    command = [sys.executable, "-m", "flgpr", *map(str, words)]
    begun = time.perf_counter()
    process = subprocess.Popen(command, env=environment)
    _, status, used = os.wait4(process.pid, 0)
    clock = time.perf_counter() - begun
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{checkout}: flgpr {' '.join(map(str, words))} failed")
    return Seconds(clock, used.ru_utime + used.ru_stime)


def content(folder: Path) -> dict[str, str]:
    """Return digests of what a command wrote, but for files that may differ."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in VERSIONED
    }


def tasks(home: Path, recipe: str) -> dict[str, list[object]]:
    """Return the words of each task's command, with ``OUTPUT`` for what it makes."""
    lane = home / "lane.zarr"
    return {
        "simulate": ["simulate", home / "scene.toml", "-o", OUTPUT],
        "detect": ["detect", lane, "--recipe", recipe, "-o", OUTPUT],
        "live": ["live", home / "incoming", "--recipe", recipe, "-o", OUTPUT],
    }


def measure(
    words: list[object], checkouts: dict[str, Path], home: Path, rounds: int
) -> tuple[dict[str, list[Seconds]], list[str]]:
    """Time a task in both checkouts by turns; return the seconds, and files that differ."""
    seconds: dict[str, list[Seconds]] = {side: [] for side in SIDES}
    written = []
    for number in range(-1, rounds):
        for side in order_of(number):
            output = home / "output"
            output.mkdir()
            made = [output / "made" if word == OUTPUT else word for word in words]
            took = run(checkouts[side], [*made, "--quiet"])
            written.append(content(output))
            shutil.rmtree(output)
            if number >= 0:
                seconds[side].append(took)
    return seconds, differing(written)


def differing(written: Sequence[dict[str, str]]) -> list[str]:
    """Name the files that are not the same, or not there, in all folders that were written."""
    names = {name for one in written for name in one}
    return sorted(name for name in names if len({one.get(name) for one in written}) > 1)


def main() -> None:
    """Time what is asked for and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--length", type=float, default=12.0, help="of the lane, m")
    parser.add_argument("--recipe", default="wang2007")
    parser.add_argument("--only", nargs="+", choices=("simulate", "detect", "live"), default=None)
    parser.add_argument("--by", choices=("clock", "processor"), default="clock")
    parser.add_argument("--most", type=float, default=1.03, help="largest ratio that is let pass")
    wanted = parser.parse_args()
    checkouts = {side: getattr(wanted, side).resolve() for side in SIDES}
    for checkout in checkouts.values():
        if not (checkout / "src" / "flgpr" / "__main__.py").is_file():
            parser.error(f"old and new must be checkouts with src/flgpr, got {checkout}")
    passed = True
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        (home / "scene.toml").write_text(SCENE.format(length=wanted.length))
        lane = home / "lane.zarr"
        run(checkouts["old"], ["simulate", home / "scene.toml", "-o", lane, "--quiet"])
        feed = ["feed", lane, home / "incoming", "--rate", 0, "--lead", 0, "--quiet"]
        run(checkouts["old"], feed)
        head = f"{'old s':>8} {'new s':>8} {'new/old':>8} {'rounds':>16}  bytes"
        print(f"{'task':10} {'by':10} {head}", flush=True)
        for name, words in tasks(home, wanted.recipe).items():
            if wanted.only and name not in wanted.only:
                continue
            seconds, others = measure(words, checkouts, home, wanted.rounds)
            for kind in ("clock", "processor"):
                old, new = ([getattr(one, kind) for one in seconds[side]] for side in SIDES)
                found = compare(old, new)
                print(
                    f"{name:10} {kind:10} {found.old:8.3f} {found.new:8.3f} {found.ratio:8.3f} "
                    f"{found.least:7.3f} to {found.largest:5.3f}  {'DIFFER' if others else 'same'}",
                    flush=True,
                )
                passed &= kind != wanted.by or found.ratio <= wanted.most
            if others:
                print(f"{name:10} {len(others)} files differ: {', '.join(others[:8])}")
            passed &= not others
    if not passed:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
