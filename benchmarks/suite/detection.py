"""A detection from a stored run to alarms, batch and live, and what a command costs to start."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from flgpr.live.feeding import feed
from flgpr.method.method import detect
from flgpr.recipe.schema import load_recipe
from flgpr.store import lane_text, open_run

from .data import lane_of, size, write_noise_run

SCANS = int(os.environ.get("FLGPR_BENCHMARK_SCANS", size(60, 6)))
"""Scans of the lane: 100 m unless told otherwise."""
RATE = size(4, 20)
"""Scans that come live, per s."""


class Detection:
    """Detection with a packaged recipe on a lane of noise for the ``sri-array``."""

    params = ("wang2007", "demo")
    param_names = ("recipe",)
    number = 1

    def setup_cache(self) -> str:
        """Write the run in a process of its own, so that its memory is not counted."""
        return str(write_noise_run(Path("run.zarr").resolve(), SCANS))

    def setup(self, run: str, recipe: str) -> None:
        self.run = open_run(run)
        self.recipe = load_recipe(recipe)
        self.lane = lane_of(SCANS)

    def time_detect(self, run: str, recipe: str) -> None:
        detect(self.run, self.recipe, self.lane)

    def peakmem_detect(self, run: str, recipe: str) -> None:
        detect(self.run, self.recipe, self.lane)


class Command:
    """A command from its start to its end, kernels compiled before."""

    number = 1

    def setup_cache(self) -> str:
        """Write the run and its lane."""
        home = Path("command").resolve()
        home.mkdir(exist_ok=True)
        write_noise_run(home / "run.zarr", SCANS)
        (home / "lane.toml").write_text(lane_text(lane_of(SCANS)))
        self.detect(home)  # compiles
        return str(home)

    def detect(self, home: Path) -> None:
        """Run ``flgpr detect`` with ``wang2007``."""
        with tempfile.TemporaryDirectory(dir=home) as folder:
            words = ["detect", home / "run.zarr", "--recipe", "wang2007"]
            words += ["--lane", home / "lane.toml", "-o", Path(folder) / "out", "--quiet"]
            flgpr(words)

    def time_detect(self, home: str) -> None:
        self.detect(Path(home))

    def time_help(self, home: str) -> None:
        flgpr(["--help"])

    def time_import(self, home: str) -> None:
        subprocess.run([sys.executable, "-c", "import flgpr"], check=True)


class Live:
    """``flgpr live`` in a process of its own, fed scan by scan at the radar's rate.

    Tracked is the latency from the arrival of a scan's file to its alarms, ms. The feeder runs on
    the same machine.
    """

    params = ("median", "p95", "largest")
    param_names = ("latency",)
    unit = "ms"

    def setup_cache(self) -> dict[str, float]:
        """Drive once, and keep the report's latencies."""
        home = Path("live").resolve()
        home.mkdir(exist_ok=True)
        run = write_noise_run(home / "run.zarr", SCANS)
        incoming = home / "incoming"
        (home / "lane.toml").write_text(lane_text(lane_of(SCANS)))
        words = [incoming, "-o", home / "out", "--lane", home / "lane.toml", "--recipe"]
        words += ["wang2007", "--speed", "15", "--idle", str(size(15, 2)), "--quiet"]
        command = [sys.executable, "-m", "flgpr", "live", *map(str, words)]
        with subprocess.Popen(command) as process:
            feed(run, incoming, RATE, lead=size(8, 1))
            process.wait(300)
        report = json.loads((home / "out" / "live.json").read_text())
        return dict(report["latency_ms"])

    def track_latency(self, latency: dict[str, float], figure: str) -> float:
        return float(latency[figure])


def flgpr(words: list[object]) -> None:
    """Run a command of flgpr to its end."""
    command = [sys.executable, "-m", "flgpr", *map(str, words)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
