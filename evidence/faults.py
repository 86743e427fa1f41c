"""What faults of a radar and of its poses cost, and whether they are told: batch and live.

The drive is declared in ``faults.toml``: 80 m of ``sri-array`` over 16 metal mines, in 96 scans. One fault at a time is
put into its data or its poses, and the recipe is run on what comes out. A mine counts as found where one of the 32 most
confident alarms lies within 1 m of it. A recipe that learns is trained on the drive of another seed. Usage::

    python evidence/faults.py WORK_FOLDER [--recipe wang2007] [--only NAME ...] [--roads batch live]
        [--again] [--table] [--costs]

What was run is kept in ``WORK_FOLDER/faults-RECIPE.jsonl``; a second call runs the rest. It writes all rows of all
recipes to ``docs/evidence/faults.csv`` and prints the table; ``--table`` does this alone, without rows from the file.
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

from common import markdown
from flgpr.commands.detect import detect
from flgpr.commands.simulate import simulate_lane
from flgpr.commands.train import train
from flgpr.health.of_run import health_of_run, radar_of
from flgpr.health.streaming import LiveHealth
from flgpr.live.intake import COUNTS
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model import make_run
from flgpr.recipe.schema import load_recipe
from flgpr.results.result import read_result
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

CSV = Path(__file__).parents[1] / "docs" / "evidence" / "faults.csv"
SEED = 1
TRAINING_SEED = 2  # of the drive that a recipe that learns is trained on
MINES = 16
STRONGEST = 32  # alarms that count, two a mine
HALO = 1.0  # m
_HARMLESS = ("received", "taken", "warm_up")  # of the counts of live
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


def _one_in(count: int, change: Callable[[np.ndarray, np.random.Generator], Any]) -> Any:
    """Return what a change does that befalls one scan in so many, as a new value for each."""

    def apply(signal: np.ndarray, rng: np.random.Generator) -> None:
        for number in range(count // 2, len(signal), count):
            signal[number] = change(signal[number], rng)

    return on_signal(apply)


def _bursts(signal: np.ndarray, rng: np.random.Generator) -> None:
    tones = rng.choice(signal.shape[-1], 3, replace=False)
    part = signal[2::5, ..., tones]
    signal[2::5, ..., tones] = part + _noise(rng, part.shape, 1e4 * mean_power(signal))


def _band(signal: np.ndarray, rng: np.random.Generator) -> None:
    part = signal[..., 300:360]
    part += _noise(rng, part.shape, 1e2 * mean_power(signal))


def _reversed_receivers(signal: np.ndarray, _: np.random.Generator) -> np.ndarray:
    by_transmitter = signal.reshape(*signal.shape[:2], 2, 18, -1)
    return by_transmitter[..., ::-1, :].reshape(signal.shape)


def _swapped_transmitters(signal: np.ndarray, _: np.random.Generator) -> np.ndarray:
    return np.roll(signal, 18, axis=2)


def swapped(axis: int, first: int, second: int) -> Callable[..., Arrays]:
    """Return a fault that swaps two entries of an axis of the signal."""

    def change(signal: np.ndarray, _: np.random.Generator) -> np.ndarray:
        order = np.arange(signal.shape[axis])
        order[[first, second]] = order[[second, first]]
        return np.take(signal, order, axis=axis)

    return on_signal(change)


def _late_pair(signal: np.ndarray, _: np.random.Generator) -> None:
    tones = 442.5e6 + 2.5e6 * np.arange(signal.shape[-1])
    signal[:, :, 7] *= np.exp(-2j * np.pi * 1e-9 * tones).astype(np.complex64)


def _drifting_zero(signal: np.ndarray, _: np.random.Generator) -> np.ndarray:
    tones = 442.5e6 + 2.5e6 * np.arange(signal.shape[-1])
    delay = np.linspace(0, 1e-9, len(signal))
    turn = np.exp(-2j * np.pi * delay[:, None] * tones).astype(np.complex64)
    return signal * turn[:, None, None]


def _jumping_gain(signal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    gain = 10 ** (rng.normal(0, 3, len(signal)) / 20)
    return signal * gain[:, None, None, None].astype(np.float32)


def _clipped(signal: np.ndarray, _: np.random.Generator) -> np.ndarray:
    most = 0.1 * np.nanmax(np.abs(signal))
    size = np.abs(signal)
    return signal * np.minimum(1, most / np.maximum(size, 1e-30)).astype(np.float32)


def _coarse(signal: np.ndarray, _: np.random.Generator) -> np.ndarray:
    step = np.nanmax(np.abs(signal)) / 32
    return (np.round(signal.real / step) + 1j * np.round(signal.imag / step)) * step


def _frozen_pair(signal: np.ndarray, _: np.random.Generator) -> None:
    signal[:, :, 7] = signal[0, :, 7]


def _swaying(pose: np.ndarray) -> np.ndarray:
    pose[:, :2] += 0.1 * np.random.default_rng(6).standard_normal((len(pose), 2))
    return pose


def _leaping(pose: np.ndarray) -> np.ndarray:
    pose[5::10, 1] += 5.0
    return pose


def _rounded(pose: np.ndarray) -> np.ndarray:
    pose[:, :2] = np.round(pose[:, :2])
    return pose


def _drifting_aside(pose: np.ndarray) -> np.ndarray:
    pose[:, 0] += np.linspace(0, 2, len(pose))
    return pose


def added(*offset: float) -> Callable[..., Arrays]:
    """Return a fault that adds the same to every pose: x, y, z (m), heading, pitch, roll (rad)."""
    return on_pose(lambda pose: pose + np.array(offset))


def _shifted(pose: np.ndarray, scans: int) -> np.ndarray:
    """Return poses of so many scans earlier; later where negative."""
    return pose[np.clip(np.arange(len(pose)) - scans, 0, len(pose) - 1)]


EVERY = slice(None)
FAULTS: dict[str, Callable[..., Arrays]] = {
    "clean": on_pose(lambda pose: pose),
    "3 tones disturbed, 30 dB": interference(30.0),
    "3 tones disturbed, 50 dB": interference(50.0),
    "conjugated": on_signal(lambda signal, _: signal.conj()),
    "tones in reverse order": on_signal(lambda signal, _: signal[..., ::-1].copy()),
    "receivers in reverse order": on_signal(_reversed_receivers),
    "poses one scan late": on_pose(lambda pose: _shifted(pose, 1)),
    "datum 2 m aside": added(2.0, 0, 0, 0, 0, 0),
    "datum 2 m ahead": added(0, 2.0, 0, 0, 0, 0),
    "heading turned by 180 degrees": added(0, 0, 0, np.pi, 0, 0),
    "sign of 9 pairs turned": scaled((EVERY, EVERY, slice(0, None, 4)), -1.0),
    "time zero jumps by 100 ps": jitter(100e-12),
    "time zero jumps by 300 ps": jitter(300e-12),
    "130 tones noisy": on_signal(_noisy_tones),
    "100 tones zero": put((EVERY, EVERY, EVERY, slice(400, 500)), 0.0),
    "all scans the same": on_signal(
        lambda signal, _: np.broadcast_to(signal[:1], signal.shape).copy()
    ),
    "noise alone": on_signal(lambda signal, rng: _noise(rng, signal.shape, mean_power(signal))),
    "one tone NaN in one pair": put((EVERY, EVERY, 7, 500), np.nan),
    "one pair NaN": put((EVERY, EVERY, 7), np.nan),
    "one pair NaN from the middle on": put((slice(48, None), EVERY, 7), np.nan),
    "one pair 80 dB hot": scaled((EVERY, EVERY, 7), 1e4),
    "one pair dead": scaled((EVERY, EVERY, 7), 1e-4),
    "signal frozen from the middle on": on_signal(_frozen_signal),
    "positions freeze in the middle": on_pose(_frozen_pose),
    "positions freeze and sway by 1 cm": on_pose(lambda pose: _frozen_pose(pose, 0.01)),
    "10 tones disturbed, 30 dB": interference(30.0, 10),
    "3 tones disturbed in one scan of 5, 40 dB": on_signal(_bursts),
    "60 tones in a row disturbed, 20 dB": on_signal(_band),
    "one pair 30 dB hot": scaled((EVERY, EVERY, 7), 10**1.5),
    "one pair 10 dB hot": scaled((EVERY, EVERY, 7), 10**0.5),
    "9 pairs dead": scaled((EVERY, EVERY, slice(0, None, 4)), 1e-4),
    "24 pairs dead": scaled((EVERY, EVERY, slice(0, 24)), 1e-4),
    "one pair stuck": on_signal(_frozen_pair),
    "VV dead": scaled((EVERY, 1), 1e-4),
    "sign of one pair turned": scaled((EVERY, EVERY, 7), -1.0),
    "one pair late by 1 ns": on_signal(_late_pair),
    "two pairs swapped": swapped(2, 3, 14),
    "transmitters swapped": on_signal(_swapped_transmitters),
    "HH and VV swapped": swapped(1, 0, 1),
    "every second tone zero": put((EVERY, EVERY, EVERY, slice(0, None, 2)), 0.0),
    "clipped at a tenth of the peak": on_signal(_clipped),
    "rounded to a 32nd of the peak": on_signal(_coarse),
    "gain jumps by 3 dB from scan to scan": on_signal(_jumping_gain),
    "time zero drifts by 1 ns": on_signal(_drifting_zero),
    "noise 10 dB under the mean": on_signal(
        lambda signal, rng: signal + _noise(rng, signal.shape, 0.1 * mean_power(signal))
    ),
    "one scan in 10 noise": _one_in(
        10, lambda scan, rng: _noise(rng, scan.shape, mean_power(scan))
    ),
    "one scan in 10 NaN": _one_in(10, lambda scan, _: np.full_like(scan, np.nan)),
    "one scan in 10 zero": _one_in(10, lambda scan, _: np.zeros_like(scan)),
    "poses two scans late": on_pose(lambda pose: _shifted(pose, 2)),
    "poses one scan early": on_pose(lambda pose: _shifted(pose, -1)),
    "datum 0.5 m aside": added(0.5, 0, 0, 0, 0, 0),
    "height 0.3 m too large": added(0, 0, 0.3, 0, 0, 0),
    "heading off by 5 degrees": added(0, 0, 0, np.deg2rad(5), 0, 0),
    "heading off by 20 degrees": added(0, 0, 0, np.deg2rad(20), 0, 0),
    "pitch off by 3 degrees": added(0, 0, 0, 0, np.deg2rad(3), 0),
    "roll off by 3 degrees": added(0, 0, 0, 0, 0, np.deg2rad(3)),
    "positions sway by 10 cm": on_pose(_swaying),
    "positions rounded to 1 m": on_pose(_rounded),
    "positions drift aside by 2 m": on_pose(_drifting_aside),
    "one position in 10 5 m ahead": on_pose(_leaping),
    "positions in feet": on_pose(lambda pose: pose * [1 / 0.3048, 1 / 0.3048, 1, 1, 1, 1]),
    "x and y swapped": on_pose(lambda pose: pose[:, [1, 0, 2, 3, 4, 5]]),
}
"""Faults of data and poses."""
LIVE_FAULTS = (
    "scan numbers begin again",
    "positions are null from the middle on",
    "every second position is null",
    "every fourth scan is lost",
    "neighbouring scans change places",
    "one frame in 10 damaged",
)
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


def drive(folder: Path, name: str = "drive", seed: int = SEED) -> Path:
    """Simulate the drive, unless an earlier call did."""
    path = folder / f"{name}.zarr"
    if not path.exists():
        scene = Path(__file__).with_name("faults.toml")
        simulate_lane(scene, sensor="sri-array", seed=seed, output=path)
    return path


def model_of(folder: Path, recipe: str) -> Path | None:
    """Train a recipe that learns on another drive, without a fault; None if it does not learn."""
    if not load_recipe(recipe).learning():
        return None
    path = folder / f"model-{Path(recipe).stem}"
    if not path.exists():
        other = drive(folder, "training", TRAINING_SEED)
        truth = folder / "training-truth.csv"
        lane = folder / "training-lane.toml"
        train([other], [truth], recipe, path, lanes=[lane], check=False, workers=1)
    return path


@dataclass(frozen=True)
class Outcome:
    """What a recipe found on a run with a fault, and what was said."""

    found: int
    alarms: int
    told: list[str]
    acted: list[str]
    counted: dict[str, int]  #: scans left out or filled in, by kind
    seconds: float


def found_of(alarms: pd.DataFrame, truth: pd.DataFrame) -> int:
    """Return how many targets have one of the strongest alarms within the halo."""
    best = alarms.sort_values("confidence", ascending=False, kind="stable").head(STRONGEST)
    if best.empty:
        return 0
    offset = best[["x", "y"]].to_numpy()[:, None] - truth[["x", "y"]].to_numpy()
    return int((np.hypot(*np.moveaxis(offset, -1, 0)).min(axis=0) <= HALO).sum())


def batch(
    folder: Path, path: Path, recipe: str, truth: pd.DataFrame, model: Path | None
) -> Outcome:
    """Detect on a stored run."""
    lane = folder / "drive-lane.toml"
    begun = time.monotonic()
    output = folder / f"batch-out-{Path(recipe).stem}"
    try:
        detect(path, recipe, output, lane=lane, model=model, report=False, overwrite=True)
    except ValueError as error:
        return Outcome(0, 0, [f"refused: {error}"], [], {}, time.monotonic() - begun)
    result = read_result(output)
    manifest = result.manifest["run"]
    findings = manifest.get("health", [])
    told = [finding["name"] for finding in findings]
    counted = {
        "masked": len(manifest["masked_scans"]),
        "implausible": len(manifest.get("motion", {}).get("scans", [])),
    }
    done = [finding["done"] for finding in findings if "done" in finding]
    seconds = time.monotonic() - begun
    found = found_of(result.alarms, truth)
    return Outcome(found, len(result.alarms), told, done, counted, seconds)


def live(
    folder: Path, path: Path, recipe: str, truth: pd.DataFrame, model: Path | None, name: str
) -> Outcome:
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
    lane = folder / "drive-lane.toml"
    options = LiveOptions(recipe, output, incoming, lane=lane, model=model, fresh=True)
    LiveRun(options).run()
    seconds = time.monotonic() - begun
    events = [json.loads(line) for line in (output / "live.jsonl").read_text().splitlines()]
    problems = [event for event in events if event["event"] == "problem"]
    alarms = read_table(output / "alarms.csv", "alarms")
    told = list(
        dict.fromkeys(event.get("finding", event.get("kind", "problem")) for event in problems)
    )
    acted = list(dict.fromkeys(event["done"] for event in problems if "done" in event))
    counted = {name: events[-1][name] for name in COUNTS if name not in _HARMLESS}
    return Outcome(found_of(alarms, truth), len(alarms), told, acted, counted, seconds)


def _frames(run: xr.Dataset, name: str, run_id: str) -> Iterator[bytes]:
    """Yield the frames of a run as a radar with the fault sends them."""
    scans = run.sizes["scan"]
    order = np.arange(scans)
    if name == "neighbouring scans change places":
        order[: scans // 2 * 2] = order[: scans // 2 * 2].reshape(-1, 2)[:, ::-1].ravel()
    for place in order.tolist():
        scan = stored_scan(run, place)
        number = scan.number
        pose = scan.pose
        if place >= scans // 2:
            if name == "scan numbers begin again":
                number -= scans // 2
            elif name == "positions are null from the middle on":
                pose = None
        if name == "every second position is null" and place % 2:
            pose = None
        if name == "every fourth scan is lost" and place % 4 == 3:
            continue
        frame = encode_scan(number, scan.signal, pose, scan.time, run_id)
        if name == "one frame in 10 damaged" and place % 10 == 5:
            frame = frame[:-9] + bytes([frame[-9] ^ 1]) + frame[-8:]
        yield frame


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


def said(row: dict[str, Any], clean: dict[str, Any] | None) -> str:
    """Return what was told of a fault: findings, and counts that the clean drive does not have."""
    usual = clean["counted"] if clean else {}
    more = [
        f"{count} {name}" for name, count in row["counted"].items() if count > usual.get(name, 0)
    ]
    return "; ".join([*row["told"], *more])


def as_frame(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Return what was run, a row for each fault, recipe and road."""
    clean = {(row["recipe"], row["road"]): row for row in rows if row["fault"] == "clean"}
    lines = []
    for row in rows:
        lines.append(
            {
                "fault": row["fault"],
                "recipe": row["recipe"],
                "road": row["road"],
                "found": row["found"],
                "of": MINES,
                "alarms": row["alarms"],
                "told": said(row, clean.get((row["recipe"], row["road"]))),
                "acted": "; ".join(row["acted"]),
            }
        )
    return pd.DataFrame(lines)


def together(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Return rows in the order of the faults: those of ``after``, and others from ``before``."""
    keys = ["fault", "recipe", "road"]
    rows = pd.concat([before, after]).drop_duplicates(keys, keep="last")
    order = {name: place for place, name in enumerate([*FAULTS, *LIVE_FAULTS])}
    return rows.sort_values("fault", key=lambda names: names.map(order), kind="stable")


def read_rows(path: str | Path) -> pd.DataFrame:
    """Read rows that were written before."""
    return pd.read_csv(path, keep_default_na=False)


def costly(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the clean drive and of faults that lose more than one mine in a run."""
    lowest = frame.groupby("fault")["found"].transform("min")
    return frame[(lowest < MINES - 1) | (frame["fault"] == "clean")]


def told_names(row: pd.Series) -> str:
    """Return what was told of a row by name; counts only where nothing has a name."""
    parts = str(row["told"]).split("; ") if row["told"] else []
    named = [part for part in parts if not part[0].isdigit()]
    return ", ".join(sorted(named or parts)) or "**nothing**"


def table(frame: pd.DataFrame) -> str:
    """Return the table of what was run: found of 16 by recipe and road, told, and whether acted."""
    roads = [("wang2007", "batch"), ("wang2007", "live"), ("fused", "batch")]
    cells = []
    for fault, rows in frame.groupby("fault", sort=False):
        found = []
        words: dict[str, list[str]] = {}
        for recipe, road in roads:
            row = rows[(rows["recipe"] == recipe) & (rows["road"] == road)]
            found.append("–" if row.empty else str(row["found"].iloc[0]))
            if not row.empty and recipe == "wang2007":
                words.setdefault(told_names(row.iloc[0]), []).append(road)
        told = "; ".join(f"{road[0]}: {what}" for what, road in words.items())
        if len(words) == 1:
            [told] = words
        acted = "yes" if (rows["acted"] != "").any() else ""
        cells.append([str(fault), *found, told, acted])
    return markdown(("fault", "batch", "live", "`fused`", "told", "acted"), cells)


def rows_of(log: Path) -> list[dict[str, Any]]:
    """Return what earlier calls ran with a recipe; the last of each fault and road counts."""
    rows = {}
    for line in log.read_text().splitlines() if log.exists() else []:
        row = json.loads(line)
        rows[row["fault"], row["road"]] = row | {"recipe": log.stem.removeprefix("faults-")}
    return list(rows.values())


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
    parser.add_argument("--again", action="store_true", help="run what was run before, too")
    parser.add_argument("--csv", default=CSV, help="file for what was run")
    parser.add_argument("--costs", action="store_true")
    options = parser.parse_args()
    folder = options.work
    folder.mkdir(parents=True, exist_ok=True)
    if options.costs:
        print(costs(folder, options.recipe))
        return
    log = folder / f"faults-{Path(options.recipe).stem}.jsonl"
    if not options.table:
        run_faults(folder, log, options)
    everything = [row for kept in sorted(folder.glob("faults-*.jsonl")) for row in rows_of(kept)]
    if everything:
        rows = as_frame(everything)
        if Path(options.csv).exists():
            rows = together(read_rows(options.csv), rows)
        rows.to_csv(Path(options.csv), index=False)
    print(table(costly(read_rows(options.csv))))


def run_faults(folder: Path, log: Path, options: argparse.Namespace) -> None:
    """Run the faults that were asked for and did not run before, and write each down."""
    clean = open_run(drive(folder))
    truth = read_table(folder / "drive-truth.csv", "truth")
    model = model_of(folder, options.recipe)
    done = set() if options.again else {(row["fault"], row["road"]) for row in rows_of(log)}
    for name in options.only:
        roads = [road for road in options.roads if (name, road) not in done]
        if name in LIVE_FAULTS:
            roads = [road for road in roads if road == "live"]
        if not roads:
            continue
        path = folder / f"faulty-{log.stem}.zarr"
        shutil.rmtree(path, ignore_errors=True)
        save_run(faulty(clean, name), path)
        for road in roads:
            if road == "batch":
                outcome = batch(folder, path, options.recipe, truth, model)
            else:
                outcome = live(folder, path, options.recipe, truth, model, name)
            entries = {"fault": name, "road": road, **vars(outcome)}
            write_down(log, entries)
            print(entries, flush=True)


if __name__ == "__main__":
    main()
