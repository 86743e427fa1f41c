"""The highest value of every statistic of a run's health on clean simulated drives: what the limits stand on.

Short drives of all packaged arrays over all packaged sites, each with its own seed, with the errors of the array's
sensors: bursts, interference, drift, missing sweeps and wrong positions are in them, because every clean run has those.
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
from typing import Any

import numpy as np
import xarray as xr

from common import markdown, with_share
from flgpr.health.findings import LIMITS
from flgpr.health.geometry import mean, median
from flgpr.health.judging import LeftOut, judge_motion
from flgpr.health.judging import statistics as statistics_of_sums
from flgpr.health.of_run import geometry_figures, health_of_run, radar_of, read_sums
from flgpr.health.streaming import LiveHealth
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


def statistics(run: xr.Dataset) -> dict[str, float]:
    """Return every statistic that a limit stands on, and whether the run warns."""
    radar = radar_of(run)
    sums, steps, samples = read_sums(run)
    figures = geometry_figures(run, radar, sums, samples, LeftOut())
    motion = judge_motion(steps, np.array(sums.changed))
    return {
        **statistics_of_sums(sums, radar),
        "frozen positions": motion[0].value if motion else 0.0,
        "paths": -median(figures.path_db),
        "receivers": mean(figures.receivers),
        "heading": mean(figures.heading),
        "lag": max(mean(figures.late), mean(figures.early)),
        "warns": float(bool(health_of_run(run).findings)),
    }


def live_warnings(run: xr.Dataset) -> list[str]:
    """Return the names of what is told of a run that comes scan by scan."""
    watch = LiveHealth(radar_of(run))
    told = []
    for number in range(run.sizes["scan"]):
        scan = run.isel(scan=number)
        told += watch.take(scan["signal"].values, scan["pose"].values).findings
    return [finding.name for finding in told]


def table(rows: list[dict[str, Any]]) -> str:
    """Return the highest clean value of every statistic beside its limit."""
    cells = []
    for name, limit in LIMITS.items():
        known = [row for row in rows if np.isfinite(row.get(name, np.nan))]
        if not known:
            continue
        highest = max(known, key=lambda row: row[name])
        cells.append(
            (
                name,
                f"{highest[name]:.3g}",
                highest["drive"],
                f"{limit.most:g} {limit.unit}",
                len(known),
            )
        )
    return markdown(("statistic", "highest clean value", "of", "limit", "drives"), cells)


def main() -> None:
    """Simulate drives, and print the highest clean values."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path, help="folder that keeps the drives")
    parser.add_argument("--seeds", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--seconds", type=float, default=np.inf, help="no new drive after these")
    parser.add_argument("--stored", action="store_true", help="judge the drives that are there")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    rows = []
    for seed, site, array in product(options.seeds, sites(), ARRAYS):
        name = f"{array}-{site}-{seed}"
        is_new = not (options.work / f"{name}.zarr").exists()
        if is_new and (options.stored or time.monotonic() - begun > options.seconds):
            continue
        run = stored_drive(options.work, site, array, seed)
        row = {"drive": name, **statistics(run), "live": live_warnings(run)}
        rows.append(row)
        print(row, flush=True)
    print(table(rows))
    warned = sum(bool(row["warns"]) for row in rows)
    print(f"batch warns on {with_share(warned, len(rows))}")
    print(f"live warns on {with_share(sum(bool(row['live']) for row in rows), len(rows))}")


if __name__ == "__main__":
    main()
