"""Compare one worker with two on a lane of 300 m, and say what pieces of work cost: the plan for many workers.

The run is noise on the geometry of the ``sri-array`` with the recipe ``wang2007``, see ``wang2007.py``. Usage::

    python benchmarks/workers.py [--scans 180] [--rounds 3] [--folder DIR] [--json FILE]

Every round detects with one worker process and with two, each of one thread, in turn changing the order; medians of
the rounds count. The time is that of ``flgpr detect`` from the stored run to the result folder without the page. The
efficiency is T1 / (2·T2); the share of processor time tells whether the machine was free: near 1 it was.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from flgpr.pipeline import tasks
from wang2007 import STEP, write_noise_run


def once(store: Path, lane: Path, output: Path, workers: int) -> dict[str, Any]:
    """Detect once and return the time, the reports and the digests of the result."""
    reports: list[dict[str, Any]] = []
    begun = time.perf_counter()
    result = tasks.detect_run(store, "wang2007", output, lane, report=False, workers=workers, note=reports.append)
    wall = time.perf_counter() - begun
    return {
        "wall": wall,
        "reports": reports,
        "files": result.manifest["files"],
        "alarms": len(result.detections[0].alarms),
    }


def plan(reports: list[dict[str, Any]], scans: int) -> list[str]:
    """Say what the pieces of every stage cost."""
    rows: dict[tuple[str, bool], list[dict[str, Any]]] = defaultdict(list)
    for report in reports:
        rows[report["stage"], report["block"] >= 0].append(report)
    lines = [f"{'stage':10s} {'piece':6s} {'pieces':>6s} {'s each':>8s} {'MB each':>8s} {'s in all':>8s}"]
    for (stage, is_block), some in rows.items():
        seconds, size = [one["seconds"] for one in some], [one["bytes"] / 1e6 for one in some]
        lines.append(
            f"{stage:10s} {'block' if is_block else 'fold':6s} {len(some):6d} {median(seconds):8.3f} "
            f"{median(size):8.2f} {sum(seconds):8.2f}"
        )
    total, pieces = sum(one["seconds"] for one in reports), len(reports)
    size = sum(one["bytes"] for one in reports) / 1e6
    lines.append(f"per scan: {1e3 * total / scans:.0f} ms, {pieces / scans:.2f} pieces, {size / scans:.2f} MB written")
    return lines


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=180)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--json", type=Path, default=None)
    options = parser.parse_args()
    found: dict[int, list[dict[str, Any]]] = {1: [], 2: []}
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        home = Path(folder)
        store = write_noise_run(home / "run.zarr", options.scans)
        lane = home / "lane.toml"
        lane.write_text(f"x_min = -1.5\nx_max = 1.5\ny_min = 0.0\ny_max = {STEP * options.scans - 5}\n")
        for number in range(options.rounds):
            for workers in (1, 2) if number % 2 == 0 else (2, 1):
                one = once(store, lane, home / "result", workers)
                found[workers].append(one)
                print(f"round {number + 1}, {workers} workers: {one['wall']:.1f} s", flush=True)
    same = all(one["files"] == found[1][0]["files"] for some in found.values() for one in some)
    walls = {workers: median(one["wall"] for one in some) for workers, some in found.items()}
    work = {w: median(sum(r["seconds"] for r in one["reports"]) for one in some) for w, some in found.items()}
    efficiency = [a["wall"] / (2 * b["wall"]) for a, b in zip(found[1], found[2], strict=True)]
    print(f"{options.scans} scans, {found[1][0]['alarms']} alarms, {os.cpu_count()} cores, load {load:.1f} before")
    print(f"1 worker {walls[1]:.1f} s, 2 workers {walls[2]:.1f} s, the same bytes: {same}")
    print(f"efficiency {walls[1] / (2 * walls[2]):.2f} (rounds: {', '.join(f'{value:.2f}' for value in efficiency)})")
    print(f"seconds in pieces of work: {work[1]:.1f} with 1 worker, {work[2]:.1f} with 2")
    print("\n".join(plan(found[1][int(np.argmin([one["wall"] for one in found[1]]))]["reports"], options.scans)))
    if options.json is not None:
        options.json.write_text(json.dumps({"walls": {w: [o["wall"] for o in s] for w, s in found.items()}}))


if __name__ == "__main__":
    main()
