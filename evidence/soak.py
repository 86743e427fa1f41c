"""Drive `flgpr live` for hours, quicker than the clock, with what a radar gets wrong, and watch what it costs.

A cheap sensor (eight pairs, one polarization, 40 tones) drives over ground that repeats every lap,
so that scans for any number of hours need no storage and the same 24 mines lie in each. Scans are
lost, alone and in bursts, late, sent twice, damaged, NaN, or without a pose; in the first third of
the drive the process is killed now and then and started again. Files are taken away some 2000 scans
after they came. Usage::

    OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 nice -n 15 python evidence/soak.py [--hours 8] [--speed
    10] [--kills 6]
        [--record soak.json] [--figure soak.png]

Ctrl-C ends the drive before its time and judges what there is.
Prints, every minute, memory, lag and latency, and at the end: memory over the drive, the lag behind the radar's clock,
the counts of the faults against those that were made, and the mines without an alarm, lap by lap. A drive that
would fall farther behind than 1500 scans is slowed down, and the speed that was held is told.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from flgpr.model import SPEED_OF_LIGHT, make_run
from flgpr.store import RunDescription, Scan, describe_for_live, encode_scan, write_description
from flgpr.store.scan_file import scan_name

# scans/s of the radar, m from scan to scan, scans of a lap
RATE = 4.2
STEP = 0.4
LAP = 400
HALO = 0.3  # m
FREQUENCY = 0.75e9 + 15e6 * np.arange(40)
TX = np.repeat([[-0.8, 0.0, 0.0], [0.8, 0.0, 0.0]], 4, axis=0)
RX = np.tile([[x, 0.0, 0.0] for x in (-1.0, -0.4, 0.4, 1.0)], (2, 1))
SHAPE = (1, len(TX), FREQUENCY.size)
FAULTS = {
    "lost": 0.005,
    "late": 0.01,
    "duplicate": 0.005,
    "corrupt": 0.002,
    "masked": 0.005,
    "pose": 0.005,
}
BURST = 1e-4  # chance per scan that it and the next 30 are lost
# scans
TAKEN_AWAY = 2000
FARTHEST = 1500
RECIPE = """
name = "soak"
description = "A cheap recipe for hours of scans"
[image]
x = [-1.6, 1.6]
y = [2.5, 5.5]
spacing = 0.1
[image.subbands]
F1 = [0.75e9, 1.335e9]
[background]
self_signature = "mean"
median = 0.6
mean = 1.0
[run_view]
x = [-1.2, 1.2]
spacing = 0.1
y_max = 4.5
[prescreen]
polarization = "HH"
subband = "F1"
radius = 0.4
density = 0.25
[contrast]
polarization = "HH"
subband = "F1"
size = 25
spacing = 0.1
inner = [5, 3]
guard = [9, 7]
[score]
halo = 0.3
"""


class World:
    """Scans of a drive without end over ground that repeats."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        lap = LAP * STEP
        self.targets = targets = np.column_stack(
            [rng.uniform(-0.6, 0.6, 24), np.arange(24) * lap / 24 + rng.uniform(1, 5, 24)]
        )
        places = np.vstack(
            [np.column_stack([rng.uniform(-2, 2, 2000), rng.uniform(0, lap, 2000)]), targets]
        )
        echo = np.append(
            0.3 * (rng.normal(size=2000) + 1j * rng.normal(size=2000)), np.full(24, 2.0)
        )
        self.signal = np.zeros((LAP, *SHAPE), np.complex64)
        self.pose = np.zeros((LAP, 6))
        self.pose[:, 0] = 0.03 * rng.normal(size=LAP)
        self.pose[:, 1] = STEP * np.arange(LAP)
        self.pose[:, 2] = 2.0
        for k, pose in enumerate(self.pose):
            local = np.column_stack(
                [places[:, 0] - pose[0], (places[:, 1] - pose[1]) % lap, np.full(len(places), -2.0)]
            )
            near = (local[:, 1] > 1) & (local[:, 1] < 7)
            a, b = (np.linalg.norm(local[near] - p[:, None], axis=-1) for p in (TX, RX))
            phase = np.exp(-2j * np.pi * FREQUENCY * (a + b)[..., None] / SPEED_OF_LIGHT)
            self.signal[k, 0] = np.einsum("pn,n,pnf->pf", 1 / (a * b), echo[near], phase)
        self._seed = seed

    def scan(self, number: int) -> Scan:
        """Make a scan, with noise of its own."""
        rng = np.random.default_rng((self._seed, number))
        noise = rng.standard_normal((2, *SHAPE), dtype=np.float32)
        pose = self.pose[number % LAP] + np.array([0, number // LAP * LAP * STEP, 0, 0, 0, 0])
        signal = self.signal[number % LAP] + (0.02 * noise[0] + 0.02j * noise[1]).astype(
            np.complex64
        )
        return Scan(number, number / RATE, pose, signal)

    def description(self) -> RunDescription:
        """Say what the scans have in common."""
        pose = np.zeros((1, 6))
        return describe_for_live(
            make_run(np.zeros((1, *SHAPE)), FREQUENCY, ["HH"], TX, RX, pose, [0.0])
        )


def frames(
    world: World, scans: int, seed: int, made: Counter[str], gaps: set[int]
) -> Iterator[list[tuple[str, bytes]]]:
    """Give scan after scan the files that the radar writes then, and count what was made wrong of it."""
    rng = np.random.default_rng(seed + 1)
    run = world.description().run_id
    waiting: dict[int, tuple[str, bytes]] = {}
    burst = 0
    for number in range(scans):
        scan = world.scan(number)
        chance = rng.random()
        burst = 30 if burst == 0 and rng.random() < BURST else max(burst - 1, 0)
        ends = np.cumsum(list(FAULTS.values()))
        at = int(np.searchsorted(ends, chance))
        fault = "lost" if burst else [*FAULTS, ""][at]
        name = scan_name(number)
        now = []
        signal = scan.signal
        pose = scan.pose
        if fault == "masked":
            signal = signal.copy()
            signal[0, 3, 5] = np.nan
        frame = encode_scan(number, signal, None if fault == "pose" else pose, scan.time, run)
        if fault == "corrupt":
            frame = frame[:200] + bytes([frame[200] ^ 1]) + frame[201:]
        if fault == "late":
            waiting[number + int(rng.choice([1, 2, 3, 5, 40]))] = name, frame
        elif fault != "lost":
            now = [(name, frame)]
        if fault == "duplicate":
            now.append((name.replace(".", "-again."), frame))
        if fault in ("lost", "corrupt", "masked"):
            gaps.add(number)
        made.update([fault] if fault else [])
        yield now + [waiting.pop(when) for when in sorted(waiting) if when <= number]


@dataclass
class Watched:
    """What is seen of the live process from outside: its file of events, read as it grows, and its memory."""

    events: Path
    read: int = 0
    newest: int = -1
    latency: deque[float] = field(default_factory=lambda: deque(maxlen=2000))
    rest: bytes = b""

    def look(self) -> None:
        """Read what was told since."""
        if not self.events.is_file():
            return
        with self.events.open("rb") as file:
            file.seek(self.read)
            text = file.read()
        self.read += len(text)
        *lines, self.rest = (self.rest + text).split(b"\n")
        for line in lines:
            if line.startswith(b'{"event":"scan"'):
                told = json.loads(line)
                self.newest = max(self.newest, told["scan"])
                self.latency.append(told["latency_ms"])


def memory(process: subprocess.Popen[bytes]) -> float:
    """Memory that a process holds now, MB."""
    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    return next(
        (int(line.split()[1]) / 1e3 for line in lines if line.startswith("VmRSS")), math.nan
    )


def drive(world: World, home: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Drive with faults; give the record, minute by minute, and what came of it."""
    incoming = home / "incoming"
    output = home / "out"
    incoming.mkdir()
    write_description(world.description(), incoming)
    words = [incoming, "--recipe", home / "soak.toml", "-o", output, "--quiet"]
    command = [sys.executable, "-m", "flgpr", "live", *map(str, words)]
    scans = round(options.hours * 3600 * RATE)
    rate = RATE * options.speed
    rng = np.random.default_rng(options.seed + 2)
    kills = sorted(rng.integers(0, scans // 3, options.kills).tolist(), reverse=True)
    made: Counter[str] = Counter()
    gaps: set[int] = set()
    watched = Watched(output / "live.jsonl")
    rows = []
    lying: deque[tuple[int, str]] = deque()
    process = subprocess.Popen(command)
    start = time.monotonic()
    held = 0.0
    due = 60.0 / options.speed
    number = 0
    try:
        for number, files in enumerate(frames(world, scans, options.seed, made, gaps)):
            wait = start + held + number / rate - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            for name, frame in files:
                (incoming / (name + ".new")).write_bytes(frame)
                (incoming / (name + ".new")).rename(incoming / name)
                lying.append((number, name))
            while lying and lying[0][0] < number - TAKEN_AWAY:
                (incoming / lying.popleft()[1]).unlink()
            if number % 20 == 0:
                watched.look()
            if kills and number >= kills[-1]:
                kills.pop()
                process.kill()
                process.wait()
                process = subprocess.Popen(command)
            began = time.monotonic()
            while number - watched.newest > FARTHEST:
                if process.poll() is not None:
                    raise RuntimeError(f"live ended with {process.returncode} at scan {number}")
                time.sleep(0.1)
                watched.look()
            held += time.monotonic() - began
            if number / RATE >= due:
                due += 60.0
                latency = np.percentile(watched.latency or [math.nan], [50, 95])
                rows.append(
                    {"hour": number / RATE / 3600, "memory_mb": memory(process), "lag_scans": number - watched.newest,
                     "median_ms": latency[0], "p95_ms": latency[1], "files": len(lying),
                     "wall_s": time.monotonic() - start, "late_s": time.monotonic() - start - number / rate}
                )  # fmt: skip
                print(
                    "  ".join(f"{name} {value:.5g}" for name, value in rows[-1].items()), flush=True
                )
                if options.record:
                    options.record.write_text(json.dumps({"rows": rows, "made": made}))
    except KeyboardInterrupt:
        print("ended early", flush=True)
    (incoming / "end.json").write_text("{}")
    process.wait(600)
    report = json.loads((output / "live.json").read_text())
    wall = time.monotonic() - start
    scans = number + 1
    return {
        "rows": rows,
        "made": dict(made),
        "gaps": sorted(gaps),
        "report": report,
        "scans": scans,
        "wall_s": wall,
    }


def lost(alarms: Any, want: np.ndarray, gaps: list[int], laps: range) -> tuple[int, int, int]:
    """Mines that were passed, those without an alarm, and of these the ones whose ground lost three or more scans."""
    places = cKDTree(alarms[["x", "y"]])
    holes = np.asarray(gaps)
    due = missing = excused = 0
    for lap in laps:
        here = want + [0.0, lap * LAP * STEP]
        away = places.query(here)[0] > HALO
        due = due + len(here)
        missing = missing + int(away.sum())
        for _, y in here[away]:
            first, last = (y - 5.0) / STEP, (y - 2.0) / STEP
            excused += int(((holes >= first) & (holes <= last)).sum() >= 3)
    return due, missing, excused


def draw(record: dict[str, Any], path: Path) -> None:
    """Draw memory and speed over the hours of the drive."""
    from matplotlib.figure import Figure

    rows = record["rows"]
    hour = [row["hour"] for row in rows]
    figure = Figure(figsize=(6.4, 3.4), dpi=100, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(hour, [row["memory_mb"] for row in rows], color="tab:blue", linewidth=1.2)
    above.set_ylabel("memory (MB)")
    between = np.diff([row["wall_s"] for row in rows])
    below.plot(hour[1:], 3600 * np.diff(hour) / between, color="tab:orange", linewidth=1.2)
    below.set_ylabel("speed (times the clock)")
    below.set_xlabel("hours of the radar")
    for axes in (above, below):
        axes.set_ylim(bottom=0)
    figure.savefig(path)
    try:
        from PIL import Image
    except ImportError:
        return
    Image.open(path).quantize(32).save(path, optimize=True)


def main() -> None:
    """Run the soak."""
    from flgpr.store import read_table

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=8.0, help="of the radar's clock")
    parser.add_argument(
        "--speed", type=float, default=10.0, help="times quicker than the radar's clock"
    )
    parser.add_argument("--kills", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--record", type=Path, default=None, help="JSON of what was seen, written as it goes"
    )
    parser.add_argument("--figure", type=Path, default=None, help="PNG of memory and speed")
    options = parser.parse_args()
    world = World(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        (home / "soak.toml").write_text(RECIPE)
        record = drive(world, home, options)
        alarms = read_table(home / "out" / "alarms.csv", "alarms")
        laps = range(2, record["scans"] // LAP - 1)
        due, missing, excused = lost(alarms, world.targets, record["gaps"], laps)
        record |= {"due": due, "missing": missing, "excused": excused, "alarms": len(alarms)}
    settled = [row for row in record["rows"] if row["hour"] > options.hours * 0.4] or record["rows"]
    slope, first = np.polyfit(
        [row["hour"] for row in settled], [row["memory_mb"] for row in settled], 1
    )
    record |= {
        "memory_slope_mb_per_hour": slope,
        "speed": record["scans"] / RATE / record["wall_s"],
    }
    if options.record:
        options.record.write_text(json.dumps(record))
    if options.figure:
        draw(record, options.figure)
    print(f"made: {record['made']}\ncounted: {record['report']['counts']}")
    print(
        f"{record['scans']} scans at {record['speed']:.1f} times the clock; {len(alarms)} alarms; of {due} mines "
        f"{missing} have none, {excused} of them where three scans or more were lost\n"
        f"memory {first + slope * settled[0]['hour']:.0f} MB after the last restart, {slope:+.2f} MB per hour; "
        f"{settled[-1]['late_s']:.1f} s behind the schedule at the end, {settled[-1]['lag_scans']} scans in hand"
    )


if __name__ == "__main__":
    main()
