"""Time the wang2007 chain from a stored run to scored alarms, pass by pass.

The run is noise on the geometry of the ``sri-array``: what the chain does per scan does not depend
on what the scan shows, and the density rule fixes the number of alarms. Usage::

    python evidence/detection_passes.py [--scans 600]

Prints one line per pass (wall and processor seconds, the latter of all threads), the sum and the peak memory. Wall
times mean something only on an idle machine; processor times nearly always.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numba
import numpy as np
import pandas as pd

from flgpr.method.method import detect
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe
from flgpr.scoring import pd_mean, roc
from flgpr.store import open_run

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from suite.data import lane_of, write_noise_run, written_elsewhere


class Clock:
    """A track that keeps the times of every pass."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, float, float]] = []

    def __call__(self, items: Iterable, label: str, total: int) -> Iterator:  # noqa: ARG002
        """Pass items through and time them."""
        wall = time.perf_counter()
        cpu = time.process_time()
        yield from items
        self.rows.append((label, time.perf_counter() - wall, time.process_time() - cpu))


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scans", type=int, default=600)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        small = write_noise_run(Path(folder) / "warm.zarr", 3)
        store = written_elsewhere(Path(folder) / "run.zarr", options.scans)
        recipe = load_recipe("wang2007")
        lane = lane_of(options.scans)
        detect(open_run(small), recipe, Lane(-1.5, 1.5, -13.0, 0.0))  # compile
        places = np.linspace(5, lane.y_max - 5, max(2, options.scans // 12))
        truth = pd.DataFrame(
            {
                "target_id": [f"T{i}" for i in range(places.size)],
                "x": 0.0,
                "y": places,
                "depth": 0.05,
            }
        )
        truth["kind"] = "metal"
        clock = Clock()
        wall = time.perf_counter()
        cpu = time.process_time()
        found = detect(open_run(store), recipe, lane, clock)
        score = pd_mean(roc(found.alarms, truth, lane))
        total = ("all", time.perf_counter() - wall, time.process_time() - cpu)
    columns = found.features.shape[1] - 1
    print(
        f"{options.scans} scans, {len(found.alarms)} alarms, {columns} feature columns, PD_mean {score:.2f}"
    )
    print(
        f"{os.cpu_count()} cores, {numba.get_num_threads()} threads, load average {os.getloadavg()[0]:.1f} at the end"
    )
    for label, seconds, work in (*clock.rows, total):
        print(
            f"{label:16s} {seconds:8.1f} s wall {work:8.1f} s processor {1e3 * work / options.scans:7.1f} ms per scan"
        )
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
