"""The highest value of every statistic of a run's health on clean simulated drives: what the limits stand on.

Short drives of all packaged arrays over all packaged sites, each with its own seed, with the errors of the array's
sensors: bursts, interference, drift, missing sweeps and wrong positions are in them, because every clean run has those.
Usage::

    python evidence/health_limits.py WORK_FOLDER [--seeds 1 2 ...] [--draws 5] [--seconds S] [--table]

The echoes of a drive take most of the time. So every drive can be taken with several ``--draws`` of the errors: gains,
drifts, noise, interference, lost sweeps and positions. Draws of a drive share their ground and track, which the
interval of the share of warnings knows (Korn and Graubard 1998).

A drive is simulated, judged and forgotten: ``WORK_FOLDER/drives.jsonl`` holds a line for each. A second call goes on:
it can be left to run, and stopped at any time. Prints, for every statistic, its highest clean value and its limit, and
how many drives warn, with the 95 % interval of their share.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from common import markdown
from flgpr.health.findings import LIMITS
from flgpr.health.hypotheses import first_gains
from flgpr.health.judging import statistics
from flgpr.health.of_run import examined, taken_of_run
from flgpr.health.streaming import LiveHealth
from flgpr.model import load_sensor
from flgpr.model.sensor import SystemErrors
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.scene.scene import sites
from flgpr_papers.kit.intervals import share_of_looks

ARRAYS = ("sri-array", "full-wave", "dual-band-l", "sri-van", "dual-band-x")
SCANS = 14
HIGH = 3.0  # m, from where on an array looks far enough ahead for a step of 0.5 to 1 m; lower ones take half
MINES = 4


def drives(site: str, array: str, seed: int, draws: int) -> Iterator[xr.Dataset]:
    """Yield a short clean drive over a few mines as often as its radar's errors are drawn.

    A radar without errors drives over other ground every time.
    """
    seeds = [seed] + [100_000 * draw + seed for draw in range(1, draws)]
    if load_sensor(array).errors == SystemErrors():
        yield from (simulator(site, array, each).run() for each in seeds)
        return
    first = simulator(site, array, seed)
    echoes = [first.echoes(index) for index in range(len(first))]
    yield first.run(echoes=echoes)
    for each in seeds[1:]:
        yield first.with_other_errors(each).run(echoes=echoes)


def simulator(site: str, array: str, seed: int) -> Simulator:
    """Return the simulator of a short drive over a few mines."""
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
    return Simulator(scene, sensor, seed)


def judged(run: xr.Dataset) -> dict[str, Any]:
    """Return every statistic that a limit stands on, and the names of what is told, batch and live.

    That of a way to take the run is how much better it is at the first look.
    """
    seen = examined(run)
    health = seen.health
    figures = {**statistics(seen.sums, seen.radar), "frozen positions": 0.0}
    scans = taken_of_run(run, seen.sums.mean, seen.radar, health.left_out, first=True)
    for one, gain in first_gains(scans):
        figures[one.question] = max(gain, figures.get(one.question, -np.inf))
    figures |= {finding.name: finding.value for finding in health.findings}
    watch = LiveHealth(seen.radar)
    live = []
    for signal, pose in zip(run["signal"].values, run["pose"].values, strict=True):
        live += [finding.name for finding in watch.take(signal, pose).findings]
    batch = [finding.name for finding in health.findings]
    return {"statistics": figures, "batch": batch, "live": live}


def table(rows: list[dict[str, Any]]) -> str:
    """Return the highest clean value of every statistic beside its limit."""
    cells = []
    for name, limit in LIMITS.items():
        known = [row for row in rows if np.isfinite(row["statistics"].get(name, np.nan))]
        if not known:
            continue
        highest = max(known, key=lambda row: row["statistics"][name])
        cells.append(
            (
                name,
                f"{highest['statistics'][name]:.3g}",
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
    parser.add_argument("work", type=Path, help="folder for what is found")
    parser.add_argument("--seeds", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--draws", type=int, default=1, help="of the errors, over the same ground")
    parser.add_argument("--seconds", type=float, default=np.inf, help="no new drive after these")
    parser.add_argument("--table", action="store_true", help="print the table alone")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    log = options.work / "drives.jsonl"
    begun = time.monotonic()
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    done = {row["drive"] for row in rows}
    for seed, site, array in product(options.seeds, sites(), ARRAYS):
        place = f"{array}-{site}-{seed}"
        names = [f"{place}+{draw}" if draw else place for draw in range(options.draws)]
        if options.table or done.issuperset(names) or time.monotonic() - begun > options.seconds:
            continue
        for name, run in zip(names, drives(site, array, seed, options.draws), strict=True):
            if name in done:
                continue
            rows.append({"drive": name, **judged(run)})
            with log.open("a") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(table(rows))
    print(*warned(rows), sep="\n")


def warned(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield how many drives warn, batch and live, and which."""
    places: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        places.setdefault(row["drive"].partition("+")[0], []).append(row)
    draws = min(map(len, places.values()))
    for road in ("batch", "live"):
        warns = [[bool(row[road]) for row in of_place[:draws]] for of_place in places.values()]
        share, low, high = share_of_looks(warns)
        yield f"{road} warns on {share:.4f} ({low:.4f} to {high:.4f}) of {len(places)} x {draws}"
        yield from (f"{row['drive']}: {', '.join(row[road])}" for row in rows if row[road])


if __name__ == "__main__":
    main()
