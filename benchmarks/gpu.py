"""Measure all that a CUDA device does here, by one command in less than ten minutes.

    python benchmarks/gpu.py [-o gpu.json] [--rounds 7] [--scans 60]

1. The imaging sums: ``python benchmarks/imaging_speed --device cuda --peers`` (15 images and one channel,
  single scans and batches,
   from host to host, on the device and the interpolation alone; cuFINUFFT where it is installed;
   errors).
2. ``wang2007`` on a lane of noise, images on the processor and on the device: seconds per
  kilometre.
3. The tests of the CUDA engine, on the device.

Without a device it says so and ends with 2. What is measured is printed, and written as JSON with ``-o``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from flgpr.imaging import ImagingOperator
from flgpr.method.method import detect
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import open_run, write_whole
from imaging_speed.speed import bench_imaging, format_bench
from suite.data import lane_of, write_noise_run

TESTS = Path(__file__).parents[1] / "tests/imaging/cuda_simulated.py"


def seconds_per_kilometre(store: Path, scans: int, device: str) -> tuple[float, int]:
    """Detect with images made on a device and give the seconds per kilometre and the number of alarms."""
    text = recipe_text("wang2007").replace("[image]\n", f'[image]\ndevice = "{device}"\n')
    lane = lane_of(scans)
    begun = time.perf_counter()
    found = detect(open_run(store), parse_recipe(text), lane)
    return (time.perf_counter() - begun) * 1000 / lane.y_max, len(found.alarms)


def device_name() -> str:
    """Name the device."""
    from numba import cuda

    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


def run_tests() -> dict[str, object]:
    """Run the engine's tests on the device."""
    environment = {
        name: value for name, value in os.environ.items() if name != "NUMBA_ENABLE_CUDASIM"
    }
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(TESTS)]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=240, check=False
    )
    return {"passed": done.returncode == 0, "told": done.stdout.strip().splitlines()[-1:]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--scans", type=int, default=60)
    options = parser.parse_args()
    place = [[0.0, 0.0, 5.0]]
    try:
        ImagingOperator([1e9, 1.1e9], place, place, [[0.0, 8.0, 0.0]], device="cuda")
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    table = bench_imaging(True, options.rounds, "cuda")
    name = device_name()
    print(f"{name}\n\n{format_bench(table)}\n", flush=True)
    kilometre = {}
    with tempfile.TemporaryDirectory() as folder:
        store = write_noise_run(Path(folder) / "run.zarr", options.scans)
        for device in ("cpu", "cuda"):
            seconds_per_kilometre(store, options.scans, device)  # compiles
            seconds, alarms = seconds_per_kilometre(store, options.scans, device)
            kilometre[device] = {"seconds": seconds, "alarms": alarms}
            print(
                f"wang2007, images on {device}: {seconds:.1f} s per kilometre, {alarms} alarms",
                flush=True,
            )
    tests = run_tests()
    print(f"tests: {tests['told']}")
    if options.output:
        whole = {
            "device": name, "imaging": json.loads(table.to_json(orient="records")), "missing": table.attrs["missing"],
            "kilometre": kilometre, "tests": tests,
        }  # fmt: skip
        write_whole(options.output, json.dumps(whole, indent=1) + "\n")
    if not tests["passed"]:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
