"""What faults of a radar and of its poses cost, and whether they are told: batch and live.

The drive is declared in ``faults.toml``: 80 m of ``sri-array`` over 16 metal mines, in 96 scans. One fault at a time is
put into its data or its poses, and the recipe is run on what comes out. A mine counts as found where one of the 32 most
confident alarms lies within 1 m of it. Usage::

    python evidence/faults.py WORK_FOLDER [--recipe wang2007] [--only NAME ...] [--roads batch live] [--table]

What was run is kept in ``WORK_FOLDER/faults.jsonl``; a second call runs the rest. ``--table`` prints the table alone.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from common import markdown, with_share
from flgpr.commands.detect import detect
from flgpr.commands.simulate import simulate_lane
from flgpr.health.of_run import health_of_run, radar_of
from flgpr.health.streaming import LiveHealth
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model import make_run
from flgpr.store import (
    describe_for_live,
    encode_scan,
    open_run,
    read_lane,
    read_table,
    save_run,
    write_description,
)
from flgpr.store.scan_file import END_FILE, stored_scan

SEED = 1
STRONGEST = 32  # alarms that count, two a mine
HALO = 1.0  # m
Arrays = tuple[np.ndarray, np.ndarray]
"""Signal (scan, polarization, pair, frequency) and pose (scan, 6)."""


def _noise(rng: np.random.Generator, shape: tuple[int, ...], power: float) -> np.ndarray:
    """Return complex noise of a mean power."""
    parts = rng.standard_normal((2, *shape), dtype=np.float32)
    return np.sqrt(power / 2).astype(np.float32) * (parts[0] + 1j * parts[1])


def mean_power(signal: np.ndarray) -> float:
    """Return the mean power of the values that are finite."""
    return float(np.nanmean(np.abs(signal) ** 2))


def interference(level: float, tones: int = 3) -> Callable[..., Arrays]:
    """Return what something that transmits on a few tones adds, dB over the mean power."""

    def apply(signal: np.ndarray, pose: np.ndarray, rng: np.random.Generator) -> Arrays:
        chosen = rng.choice(signal.shape[-1], tones, replace=False)
        power = mean_power(signal) * 10 ** (level / 10)
        signal[..., chosen] += _noise(rng, (*signal.shape[:3], tones), power)
        return signal, pose

    return apply


def jitter(seconds: float, step: float = 2.5e6) -> Callable[..., Arrays]:
    """Return what a time zero does that jumps from scan to scan; ``step`` is that of the tones, Hz."""

    def apply(signal: np.ndarray, pose: np.ndarray, rng: np.random.Generator) -> Arrays:
        delay = seconds * rng.standard_normal(len(signal))
        tones = 442.5e6 + step * np.arange(signal.shape[-1])
        turn = np.exp(-2j * np.pi * delay[:, None] * tones).astype(np.complex64)
        return signal * turn[:, None, None], pose

    return apply


def on_signal(
    change: Callable[[np.ndarray, np.random.Generator], np.ndarray | None],
) -> Callable[..., Arrays]:
    """Return a fault that changes the signal, in place or as a new one."""

    def apply(signal: np.ndarray, pose: np.ndarray, rng: np.random.Generator) -> Arrays:
        changed = change(signal, rng)
        return (signal if changed is None else changed), pose

    return apply


def on_pose(change: Callable[[np.ndarray], np.ndarray]) -> Callable[..., Arrays]:
    """Return a fault that changes the poses."""
    return lambda signal, pose, _: (signal, change(pose))


def put(place: tuple[Any, ...], value: complex) -> Callable[..., Arrays]:
    """Return a fault that overwrites a part of the signal."""

    def change(signal: np.ndarray, _: np.random.Generator) -> None:
        signal[place] = value

    return on_signal(change)


def scaled(place: tuple[Any, ...], factor: float) -> Callable[..., Arrays]:
    """Return a fault that multiplies a part of the signal."""

    def change(signal: np.ndarray, _: np.random.Generator) -> None:
        signal[place] *= factor

    return on_signal(change)


def _noisy_tones(signal: np.ndarray, rng: np.random.Generator) -> None:
    part = signal[..., 400:530]
    part += _noise(rng, part.shape, mean_power(signal))


def _frozen_signal(signal: np.ndarray, _: np.random.Generator) -> None:
    middle = len(signal) // 2
    signal[middle:] = signal[middle]


def _frozen_pose(pose: np.ndarray, sway: float = 0.0) -> np.ndarray:
    middle = len(pose) // 2
    pose[middle:] = pose[middle]
    pose[middle:, :2] += sway * np.random.default_rng(5).standard_normal((len(pose) - middle, 2))
    return pose


EVERY = slice(None)
FAULTS: dict[str, Callable[..., Arrays]] = {
    "clean": on_pose(lambda pose: pose),
    "3 tones disturbed, 30 dB": interference(30.0),
    "3 tones disturbed, 50 dB": interference(50.0),
    "one tone NaN in one pair": put((EVERY, EVERY, 7, 500), np.nan),
    "one pair NaN": put((EVERY, EVERY, 7), np.nan),
    "one pair NaN from the middle on": put((slice(40, None), EVERY, 7), np.nan),
    "one pair 80 dB hot": scaled((EVERY, EVERY, 7), 1e4),
    "one pair dead": scaled((EVERY, EVERY, 7), 1e-4),
    "conjugated": on_signal(lambda signal, _: signal.conj()),
    "tones in reverse order": on_signal(lambda signal, _: signal[..., ::-1].copy()),
    "receivers in reverse order": on_signal(
        lambda signal, _: signal.reshape(*signal.shape[:2], 2, 18, -1)[..., ::-1, :].reshape(
            signal.shape
        )
    ),
    "sign of 9 pairs turned": scaled((EVERY, EVERY, slice(0, None, 4)), -1.0),
    "time zero jumps by 100 ps": jitter(100e-12),
    "time zero jumps by 300 ps": jitter(300e-12),
    "130 tones noisy": on_signal(_noisy_tones),
    "100 tones zero": put((EVERY, EVERY, EVERY, slice(400, 500)), 0.0),
    "all scans the same": on_signal(
        lambda signal, _: np.broadcast_to(signal[:1], signal.shape).copy()
    ),
    "noise alone": on_signal(lambda signal, rng: _noise(rng, signal.shape, mean_power(signal))),
    "signal frozen from the middle on": on_signal(_frozen_signal),
    "poses one scan late": on_pose(lambda pose: np.vstack([pose[:1], pose[:-1]])),
    "datum 2 m aside": on_pose(lambda pose: pose + [2.0, 0, 0, 0, 0, 0]),
    "datum 2 m ahead": on_pose(lambda pose: pose + [0, 2.0, 0, 0, 0, 0]),
    "heading turned by 180 degrees": on_pose(lambda pose: pose + [0, 0, 0, np.pi, 0, 0]),
    "positions freeze in the middle": on_pose(_frozen_pose),
    "positions freeze and sway by 1 cm": on_pose(lambda pose: _frozen_pose(pose, 0.01)),
}
"""Faults of data and poses."""
LIVE_FAULTS = ("scan numbers begin again", "positions are null from the middle on")
"""What only a radar that sends can get wrong."""


def faulty(run: xr.Dataset, name: str) -> xr.Dataset:
    """Return a run with a fault; one that is live alone leaves it as it is."""
    rng = np.random.default_rng([SEED, len(name)])
    signal = run["signal"].values.copy()
    pose = run["pose"].values.copy()
    if name in FAULTS:
        signal, pose = FAULTS[name](signal, pose, rng)
    return make_run(
        np.asarray(signal, np.complex64),
        run["frequency"].values,
        run["polarization"].values,
        run["tx_position"].values,
        run["rx_position"].values,
        pose,
        run["time"].values,
        {"title": name},
    )


def drive(folder: Path) -> Path:
    """Simulate the drive, unless an earlier call did."""
    path = folder / "drive.zarr"
    if not path.exists():
        scene = Path(__file__).with_name("faults.toml")
        simulate_lane(scene, sensor="sri-array", seed=SEED, output=path)
    return path


@dataclass(frozen=True)
class Outcome:
    """What a recipe found on a run with a fault, and what was said."""

    found: int
    alarms: int
    told: list[str]
    acted: list[str]
    seconds: float


def found_of(alarms: pd.DataFrame, truth: pd.DataFrame) -> int:
    """Return how many targets have one of the strongest alarms within the halo."""
    best = alarms.sort_values("confidence", ascending=False, kind="stable").head(STRONGEST)
    if best.empty:
        return 0
    offset = best[["x", "y"]].to_numpy()[:, None] - truth[["x", "y"]].to_numpy()
    return int((np.hypot(*np.moveaxis(offset, -1, 0)).min(axis=0) <= HALO).sum())


def batch(folder: Path, path: Path, recipe: str, truth: pd.DataFrame) -> Outcome:
    """Detect on a stored run."""
    lane = folder / "drive-lane.toml"
    begun = time.monotonic()
    output = folder / "batch-out"
    result = detect(path, recipe, output, lane=lane, report=False, overwrite=True)
    findings = result.manifest["run"].get("health", [])
    return Outcome(
        found_of(result.alarms, truth),
        len(result.alarms),
        [finding["name"] for finding in findings],
        [finding["done"] for finding in findings if "done" in finding],
        time.monotonic() - begun,
    )


def live(folder: Path, path: Path, recipe: str, truth: pd.DataFrame, name: str) -> Outcome:
    """Detect on a run that comes scan by scan."""
    run = open_run(path)
    incoming = folder / "incoming"
    output = folder / "live-out"
    for old in (incoming, output):
        shutil.rmtree(old, ignore_errors=True)
    incoming.mkdir()
    description = describe_for_live(run)
    write_description(description, incoming)
    for place, data in enumerate(_frames(run, name, description.run_id)):
        (incoming / f"{place:06d}.scan").write_bytes(data)
    (incoming / END_FILE).write_text(json.dumps({"scans": run.sizes["scan"]}) + "\n")
    begun = time.monotonic()
    options = LiveOptions(recipe, output, incoming, lane=folder / "drive-lane.toml", fresh=True)
    LiveRun(options).run()
    seconds = time.monotonic() - begun
    events = [json.loads(line) for line in (output / "live.jsonl").read_text().splitlines()]
    problems = [event for event in events if event["event"] == "problem"]
    alarms = read_table(output / "alarms.csv", "alarms")
    told = list(
        dict.fromkeys(event.get("finding", event.get("kind", "problem")) for event in problems)
    )
    acted = list(dict.fromkeys(event["done"] for event in problems if "done" in event))
    return Outcome(found_of(alarms, truth), len(alarms), told, acted, seconds)


def _frames(run: xr.Dataset, name: str, run_id: str) -> Iterator[bytes]:
    """Yield the frames of a run as a radar with the fault sends them."""
    scans = run.sizes["scan"]
    for place in range(scans):
        scan = stored_scan(run, place)
        number = scan.number
        pose = scan.pose
        if place >= scans // 2:
            if name == "scan numbers begin again":
                number -= scans // 2
            elif name.startswith("positions are null"):
                pose = None
        yield encode_scan(number, scan.signal, pose, scan.time, run_id)


def costs(folder: Path, recipe: str) -> str:
    """Return the processor time of the health of the drive beside that of a detection, medians of three.

    In live it is that of all scans together.
    """
    run = open_run(folder / "drive.zarr")
    lane = folder / "drive-lane.toml"
    seconds: dict[str, list[float]] = {"health": [], "detection": [], "live health": []}
    for _ in range(3):
        begun = time.process_time()
        health_of_run(run, read_lane(lane))
        seconds["health"].append(time.process_time() - begun)
        begun = time.process_time()
        detect(
            folder / "drive.zarr", recipe, folder / "costs", lane=lane, report=False, overwrite=True
        )
        seconds["detection"].append(time.process_time() - begun)
        loaded = run["signal"].values
        watch = LiveHealth(radar_of(run))
        begun = time.process_time()
        for signal, pose in zip(loaded, run["pose"].values, strict=True):
            watch.take(signal, pose)
        seconds["live health"].append(time.process_time() - begun)
    medians = {name: float(np.median(values)) for name, values in seconds.items()}
    share = medians["health"] / medians["detection"]
    per_scan = 1e3 * medians["live health"] / run.sizes["scan"]
    return f"{medians}: {share:.1%} of a detection, live {per_scan:.1f} ms a scan"


def write_down(path: Path, entries: dict[str, Any]) -> None:
    """Add a line to what was run."""
    with path.open("a") as file:
        file.write(json.dumps(entries) + "\n")


def table(rows: list[dict[str, Any]]) -> str:
    """Return the table of what was run."""
    by_name: dict[str, dict[str, Any]] = {}
    for row in rows:
        by_name.setdefault(row["fault"], {})[row["road"]] = row
    cells = []
    for name, roads in by_name.items():
        line: list[str] = [name]
        for road in ("batch", "live"):
            row = roads.get(road)
            if row is None:
                line += ["–", "–"]
                continue
            said = ", ".join(row["told"]) or "nothing"
            done = f"; {'; '.join(row['acted'])}" if row["acted"] else ""
            line += [with_share(row["found"], 16), f"{said}{done}"]
        cells.append(line)
    return markdown(("fault", "batch", "told", "live", "told"), cells)


def main() -> None:
    """Run faults, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("work", type=Path, help="folder for the drive and what is run on it")
    parser.add_argument("--recipe", default="wang2007")
    parser.add_argument("--only", nargs="*", default=[*FAULTS, *LIVE_FAULTS])
    parser.add_argument("--roads", nargs="*", default=["batch", "live"])
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--costs", action="store_true")
    options = parser.parse_args()
    folder = options.work
    folder.mkdir(parents=True, exist_ok=True)
    if options.costs:
        print(costs(folder, options.recipe))
        return
    log = folder / f"faults-{Path(options.recipe).stem}.jsonl"
    rows = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    if not options.table:
        clean = open_run(drive(folder))
        truth = read_table(folder / "drive-truth.csv", "truth")
        done = {(row["fault"], row["road"]) for row in rows}
        for name in options.only:
            roads = [road for road in options.roads if (name, road) not in done]
            if name in LIVE_FAULTS:
                roads = [road for road in roads if road == "live"]
            if not roads:
                continue
            path = folder / "faulty.zarr"
            shutil.rmtree(path, ignore_errors=True)
            save_run(faulty(clean, name), path)
            for road in roads:
                if road == "batch":
                    outcome = batch(folder, path, options.recipe, truth)
                else:
                    outcome = live(folder, path, options.recipe, truth, name)
                entries = {"fault": name, "road": road, **vars(outcome)}
                write_down(log, entries)
                rows.append(entries)
                print(entries, flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
