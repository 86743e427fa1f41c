"""What 8 to 256 workers would take, calculated from what ``workers.py`` measured: see there for the usage.

Pieces are handed out as flgpr does it: all blocks of a lane's pass, then its merge, then the next pass, then the
result, some lanes at once. Four things are simulated, each with its measured cost: workers that take the next piece in
order, the scheduler that hands out one piece after the other, the way there and back that a lane waits for between two
steps, and the driver, which opens one lane after the other. Longer lanes have longer merges, in proportion.
Not simulated: a file system that gives less than the bytes told, processors of different speed, lost workers.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

KEPT = Path(__file__).with_name("workers.json")
WORKERS = (1, 2, 8, 16, 32, 64, 128, 256, 512, 1024)
SCANS_PER_KM = 600
BLOCK = 16
LANE_BLOCKS = 45  # 1.2 km


def keep(**measured: Any) -> None:
    """Add what was measured to what is known."""
    known = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    KEPT.write_text(json.dumps(known | measured, indent=1) + "\n")


@dataclass(frozen=True)
class Costs:
    """Seconds of the pieces of a lane, pass by pass, and of what they share."""

    blocks: list[list[float]]  #: of every pass that has blocks, each measured block
    merges: list[float]  #: per block of the lane, of every pass
    finish: float  #: per block of the lane
    driver: float  #: per lane
    scheduler: float  #: per piece
    latency: float  #: between a piece's end and the next step's beginning
    start: float  #: before the first piece

    def lane(self, blocks: int) -> list[list[float]]:
        """List the steps of a lane, each the pieces that may be done side by side."""
        steps = []
        for some, merge in zip(self.blocks, self.merges, strict=True):
            steps += [
                [some[k % len(some)] for k in range(blocks)] if some else [],
                [merge * blocks],
            ]
        return [step for step in [*steps, [self.finish * blocks]] if step]


def read_costs(measured: dict[str, Any]) -> Costs:
    """Take the costs from what was measured."""
    pieces = [one for one in measured["pieces"] if one["stage"] != "finish"]
    stages = list(dict.fromkeys(one["stage"] for one in pieces))
    full = (
        BLOCK * max(one["block"] + 1 for one in pieces) / measured["scans"]
    )  # the measured blocks are a bit shorter
    blocks = [
        [full * p["processor_seconds"] for p in pieces if p["stage"] == s and p["block"] >= 0]
        for s in stages
    ]
    merges = [
        sum(p["processor_seconds"] for p in pieces if p["stage"] == s and p["block"] < 0)
        for s in stages
    ]
    count = max(map(len, blocks))
    finish = (
        sum(p["processor_seconds"] for p in measured["pieces"] if p["stage"] == "finish") / count
    )
    work = sum(p["processor_seconds"] for p in measured["pieces"])
    return Costs(
        blocks, [merge / count for merge in merges], finish, measured["driver"], measured["scheduler_seconds"],
        measured["there_and_back"], max(0.0, measured["wall"]["1"] - work - measured["driver"]),
    )  # fmt: skip


def simulate(costs: Costs, lanes: Sequence[int], workers: int, at_once: int) -> float:
    """Simulate lanes of so many blocks each and give the seconds they take."""
    free = [0.0] * workers
    scheduler = 0.0
    driver = 0.0
    last = 0.0
    waiting = list(enumerate(lanes))[::-1]
    events = []
    steps: dict[int, list[list[float]]] = {}

    def open_lane(now: float) -> None:
        nonlocal driver
        if waiting:
            number, blocks = waiting.pop()
            steps[number] = costs.lane(blocks)[::-1]
            driver = max(now, driver) + costs.driver
            heapq.heappush(events, (driver, number))

    for _ in range(at_once):
        open_lane(0.0)
    while events:
        now, number = heapq.heappop(events)
        if not steps[number]:
            last = max(last, now)
            open_lane(now)
            continue
        done = now
        for seconds in steps[number].pop():
            scheduler = max(now, scheduler) + costs.scheduler
            end = max(scheduler, heapq.heappop(free)) + seconds
            heapq.heappush(free, end)
            done = max(done, end)
        heapq.heappush(events, (done + costs.latency, number))
    return costs.start + last


def bounds(costs: Costs, lanes: Sequence[int], at_once: int) -> dict[str, float]:
    """Tell the least seconds that each limit but the work alone leaves."""
    every = [costs.lane(blocks) for blocks in lanes]
    longest = [sum(max(step) + costs.latency for step in steps) for steps in every]
    return {
        "a lane's own order": max(max(longest), sum(longest) / at_once),
        "scheduler": costs.scheduler * sum(sum(map(len, steps)) for steps in every),
        "driver": costs.driver * len(lanes),
    }


def tell(figure: Path | None) -> None:
    """Print the tables and draw the figure."""
    measured = json.loads(KEPT.read_text())
    costs = read_costs(measured)
    pieces = measured["pieces"]
    scans = measured["scans"]
    passes = sum(map(bool, costs.blocks))
    work = SCANS_PER_KM * sum(one["processor_seconds"] for one in pieces) / scans
    run = measured["run_bytes"] / scans
    written = sum(one["bytes"] for one in pieces) / scans
    parts = sum(one["bytes"] for one in pieces if one["block"] >= 0) / scans
    stored, noted, between = (SCANS_PER_KM * size / 1e9 for size in (run, written, parts))
    print(
        f"a kilometre ({SCANS_PER_KM} scans): {work:.0f} s of a core; {stored:.2f} GB of run, read {passes} times;"
    )
    print(f"{noted:.2f} GB written, of it {between:.2f} GB parts, which a merge reads again")
    print(f"a thousand kilometres: {work / 3.6:.0f} core-hours, {stored:.2f} TB of runs")
    print(
        f"driver {costs.driver:.2f} s a lane, scheduler {1e3 * costs.scheduler:.2f} ms a piece, ",
        end="",
    )
    print(f"{1e3 * costs.latency:.0f} ms between steps, start {costs.start:.1f} s")
    surveys = {
        "one lane of 1.2 km": [LANE_BLOCKS],
        "1000 km in lanes of 1.2 km": [LANE_BLOCKS] * 834,
    }
    curves: dict[str, list[float]] = {}
    for name, lanes in surveys.items():
        print(
            f"\n{name}\n\n| workers | lanes at once | s | speed-up | efficiency | next limit | GB/s read, written |"
        )
        print("|---|---|---|---|---|---|---|")
        alone = simulate(costs, lanes, 1, 1)
        for workers in WORKERS:
            at_once = min(len(lanes), max(4, workers // 4))
            seconds = simulate(costs, lanes, workers, at_once)
            gain = alone / seconds
            curves.setdefault(name, []).append(gain)
            others = bounds(costs, lanes, at_once)
            limit = max(others, key=others.__getitem__)
            read, write = (
                sum(lanes) * BLOCK * size / 1e9 / seconds
                for size in (passes * run + parts, written)
            )
            row = (workers, at_once, f"{seconds:.0f}", f"{gain:.1f}", f"{gain / workers:.2f}")
            ends = f"{limit}, {others[limit]:.0f} s | {read:.2f}, {write:.2f} |"
            print("| " + " | ".join(map(str, row)) + " | " + ends)
    if figure:
        draw(curves, figure)


def draw(curves: dict[str, list[float]], path: Path) -> None:
    """Draw speed-up against workers."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator

    figure = Figure((6, 4.2), layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log", xlabel="workers", ylabel="speed-up")
    axes.plot(WORKERS, WORKERS, color="0.6", linestyle="--", label="ideal")
    for (name, values), marker in zip(curves.items(), "os", strict=True):
        axes.plot(WORKERS, values, marker=marker, label=name)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks(WORKERS, [str(one) for one in WORKERS])
        axis.set_minor_locator(NullLocator())
    axes.set_title("Calculated from measured pieces")
    axes.legend()
    axes.grid(color="0.9")
    figure.savefig(path, dpi=120)
