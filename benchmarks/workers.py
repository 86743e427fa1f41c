"""Compare one worker with two on a lane of 300 m, and say what pieces of work cost: the plan for many workers.

The run is noise on the geometry of the ``sri-array`` with the recipe ``wang2007``, see
``suite/data.py``. Usage::

    NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 python benchmarks/workers.py [--scans 180] [--rounds 3]
    python benchmarks/workers.py --scheduler-load 2000
    python benchmarks/workers.py --model [--figure docs/images/workers.png]

Every round detects with one worker process and with two, each of one thread, in turn changing the order; medians of
the rounds count. The time is that of ``flgpr detect`` from the stored run to the result folder without the page. The
efficiency is T1 / (2·T2). The processor seconds of the pieces say what sharing costs whatever else the machine does:
with two workers they must be those of one. With ``--scheduler-load`` a Dask scheduler with two workers hands out that
many pieces that do nothing, and its own processor time per piece is told. Both leave what they measured in
``workers.json`` beside this file, from which ``--model`` calculates what 8 to 256 workers would take: see
``scaling.py``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from statistics import median
from typing import Any

import numba
import numpy as np

import flgpr
import scaling
from flgpr.jobs.job import LaneJob, code_versions
from flgpr.jobs.pieces import do_block
from flgpr.jobs.workers import Cluster
from flgpr.recipe.schema import recipe_text
from flgpr.store import lane_text
from suite.data import lane_of, write_noise_run


def once(store: Path, lane: Path, output: Path, workers: int) -> dict[str, Any]:
    """Detect once and return the time, the reports and the digests of the result."""
    reports: list[dict[str, Any]] = []
    begun = time.perf_counter()
    driver = time.process_time()
    result = flgpr.detect(
        store, "wang2007", output, lane, report=False, workers=workers, note=reports.append
    )
    wall = time.perf_counter() - begun
    driver = time.process_time() - driver
    return {
        "wall": wall,
        "driver": driver,
        "reports": reports,
        "files": result.manifest["files"],
        "alarms": len(result.detections[0].alarms),
    }


def plan(reports: list[dict[str, Any]], scans: int) -> list[str]:
    """Say what the pieces of every stage cost."""
    rows: dict[tuple[str, bool], list[dict[str, Any]]] = defaultdict(list)
    for report in reports:
        rows[report["stage"], report["block"] >= 0].append(report)
    lines = [
        f"{'stage':10s} {'piece':6s} {'pieces':>6s} {'s each':>8s} {'MB each':>8s} {'s in all':>8s}   (processor)"
    ]
    for (stage, is_block), some in rows.items():
        seconds = [one["processor_seconds"] for one in some]
        size = [one["bytes"] / 1e6 for one in some]
        lines.append(
            f"{stage:10s} {'block' if is_block else 'merge':6s} {len(some):6d} {median(seconds):8.3f} "
            f"{median(size):8.2f} {sum(seconds):8.2f}"
        )
    total = processor(reports)
    size = sum(one["bytes"] for one in reports) / 1e6
    lines.append(
        f"per scan: {1e3 * total / scans:.0f} ms, {len(reports) / scans:.2f} pieces, {size / scans:.2f} MB written"
    )
    return lines


def processor(reports: list[dict[str, Any]]) -> float:
    """Sum the processor time of pieces."""
    return sum(one["processor_seconds"] for one in reports)


def nothing(job: LaneJob, stage: str, number: int) -> dict[str, Any]:
    """Do nothing with the arguments of a piece and report as one does."""
    return {
        "lane": job.output,
        "stage": stage,
        "block": number,
        "seconds": 0.0,
        "bytes": 0,
        "worker": "",
        "cpu": "",
    }


def scheduler_load(pieces: int) -> None:
    """Measure what a Dask scheduler costs per piece."""
    import psutil
    from distributed.protocol import serialize_bytes

    job = LaneJob("/data/lane.zarr", recipe_text("wang2007"), (-1.5, 1.5, 0.0, 300.0), None, "/data/out", False,
                  "0" * 64, "", code_versions(), "x86_64", 2 * 10**9)  # fmt: skip
    dask = [sys.executable, "-m", "dask"]
    environment = {
        **os.environ,
        "PYTHONPATH": f"{os.environ.get('PYTHONPATH', '')}:{Path(__file__).parent}",
    }
    with tempfile.TemporaryDirectory() as folder:
        note = Path(folder) / "scheduler.json"
        head = subprocess.Popen(
            [*dask, "scheduler", "--no-dashboard", "--port", "0", "--scheduler-file", str(note)]
        )
        hands = []
        try:
            while not note.exists():
                time.sleep(0.1)
            address = json.loads(note.read_text())["address"]
            options = [
                "--no-nanny",
                "--nthreads",
                "1",
                "--no-dashboard",
                "--local-directory",
                folder,
            ]
            hands = [
                subprocess.Popen([*dask, "worker", address, *options], env=environment)
                for _ in range(2)
            ]
            with Cluster(address) as cluster:
                list(cluster.run(nothing, [(job, "signature", number) for number in range(20)]))
                before = psutil.Process(head.pid).cpu_times()
                begun = time.perf_counter()
                done = len(
                    list(
                        cluster.run(
                            nothing, [(job, "signature", number) for number in range(pieces)]
                        )
                    )
                )
                after = psutil.Process(head.pid).cpu_times()
                wall = time.perf_counter() - begun
                begun = time.perf_counter()
                for number in range(50):
                    list(cluster.run(nothing, [(job, "signature", number)]))
                there_and_back = (time.perf_counter() - begun) / 50
        finally:
            for process in [*hands, head]:
                process.kill()
                process.wait()
    cost = (after.user + after.system - before.user - before.system) / done
    size = len(serialize_bytes((do_block, job, "signature", 3)))
    print(
        f"{done} pieces, each {1e3 * cost:.2f} ms of the scheduler's processor, {1e3 * wall / done:.2f} ms on the clock"
    )
    print(
        f"message of a piece {size} bytes, report {len(serialize_bytes(nothing(job, 'signature', 3)))} bytes"
    )
    print(f"one piece alone, there and back: {1e3 * there_and_back:.1f} ms")
    scaling.keep(scheduler_seconds=cost, there_and_back=there_and_back)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scans", type=int, default=180)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scheduler-load", type=int, default=0)
    parser.add_argument("--model", action="store_true")
    parser.add_argument("--figure", type=Path, default=None)
    options = parser.parse_args()
    if options.model:
        scaling.tell(options.figure)
        return
    if options.scheduler_load:
        scheduler_load(options.scheduler_load)
        return
    if numba.config.NUMBA_NUM_THREADS != 1:
        parser.error(
            "a worker must have one thread to compare one with two: set NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1"
        )
    found: dict[int, list[dict[str, Any]]] = {1: [], 2: []}
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        store = write_noise_run(home / "run.zarr", options.scans)
        lane = home / "lane.toml"
        lane.write_text(lane_text(lane_of(options.scans)))
        for number in range(options.rounds):
            for workers in (1, 2) if number % 2 == 0 else (2, 1):
                one = once(store, lane, home / "result", workers)
                found[workers].append(one)
                print(f"round {number + 1}, {workers} workers: {one['wall']:.1f} s", flush=True)
    same = all(one["files"] == found[1][0]["files"] for some in found.values() for one in some)
    walls = {workers: median(one["wall"] for one in some) for workers, some in found.items()}
    work = {
        workers: median(processor(one["reports"]) for one in some)
        for workers, some in found.items()
    }
    efficiency = [a["wall"] / (2 * b["wall"]) for a, b in zip(found[1], found[2], strict=True)]
    print(
        f"{options.scans} scans, {found[1][0]['alarms']} alarms, {os.cpu_count()} cores, load {load:.1f} before"
    )
    print(f"1 worker {walls[1]:.1f} s, 2 workers {walls[2]:.1f} s, the same bytes: {same}")
    print(
        f"efficiency {walls[1] / (2 * walls[2]):.2f} (rounds: {', '.join(f'{value:.2f}' for value in efficiency)})"
    )
    print(f"processor seconds of the pieces: {work[1]:.1f} with 1 worker, {work[2]:.1f} with 2")
    peak = max(r["peak_bytes"] for some in found.values() for one in some for r in one["reports"])
    print(f"largest memory of a worker {peak / 1e9:.2f} GB")
    best = found[1][int(np.argmin([one["wall"] for one in found[1]]))]["reports"]
    scaling.keep(
        scans=options.scans, wall=walls, efficiency=median(efficiency), driver=median(o["driver"] for o in found[2]),
        pieces=[{name: one[name] for name in ("stage", "block", "processor_seconds", "bytes")} for one in best],
        run_bytes=sum(file.stat().st_size for file in store.rglob("*") if file.is_file()),
    )  # fmt: skip
    print("\n".join(plan(best, options.scans)))


if __name__ == "__main__":
    main()
