"""Time the simulator: scans over bare rough ground, and of the sri-array over a temperate site with all there is."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Simulator, simulator


def seconds_of(scan: Callable[[int], Any], rounds: int) -> float:
    """Median over ``rounds`` scans; one before them fills the caches."""
    seconds = []
    for number in range(rounds + 1):
        start = time.perf_counter()
        scan(number)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[1:])


def measure_bare(preset: str, scatterers: int, rounds: int = 5) -> None:
    sensor = load_sensor(preset)
    x_min, x_max, y_min, y_max = sensor.footprint
    density = 1.02 * scatterers / ((x_max - x_min) * (y_max - y_min))
    track = {"positions": tuple(float(y) for y in np.arange(rounds + 1))}
    bare = Simulator(
        Scene(surface={"density": density}, track=track, length=60.0), sensor, 1, errors=False
    )
    seen = round(density * (x_max - x_min) * (y_max - y_min))
    seconds = seconds_of(bare.scan, rounds)
    print(
        f"| {preset} | {seen:,} | {len(sensor.pairs()[0])} | {sensor.tones.count} | {seconds:.2f} |"
    )


def measure_all(rounds: int = 9) -> None:
    """Time a scan, and its parts, with the site's own clutter and density, mines, objects and all errors."""
    draws = [{"kind": kind, "depth": 0.05, "count": 6} for kind in ("metal", "plastic")]
    track = {"positions": tuple(2.0 * y for y in range(rounds + 1))}
    scene = Scene(site="temperate", length=60.0, draws=draws, track=track)
    full = Simulator(scene, load_sensor("sri-array"), 1)
    spent: dict[str, list[float]] = {}
    parts = [
        (full, "_single_echoes"),
        (simulator, "sum_echoes"),
        (simulator, "sum_layers"),
        (full._errors, "apply"),
    ]
    parts += [(layer, "echoes") for layer in full._layers]
    for owner, name in parts:
        label = name if name != "echoes" else f"of sum_layers: {type(owner).__name__}.echoes"
        setattr(owner, name, timed(getattr(owner, name), spent.setdefault(label, [])))
    count = f"{len(full.world.targets)} targets, {len(full.world.objects)} objects"
    print(f"\nsri-array, temperate, {count}")
    print("\n| part | s per scan |\n|---|---|")
    print(f"| all | {seconds_of(full.scan, rounds):.2f} |")
    for label, calls in spent.items():
        each = np.reshape(calls, (rounds + 1, -1)).sum(axis=1)
        print(f"| {label.lstrip('_')} | {statistics.median(each[1:]):.3f} |")


def timed(function: Callable[..., Any], seconds: list[float]) -> Callable[..., Any]:
    def run(*args: Any, **options: Any) -> Any:
        start = time.perf_counter()
        try:
            return function(*args, **options)
        finally:
            seconds.append(time.perf_counter() - start)

    return run


def main() -> None:
    print("| sensor | scatterers in view | pairs | tones | s per scan |")
    print("|---|---|---|---|---|")
    measure_bare("sri-array", 100_000)
    measure_bare("dual-band-l", 100_000)
    measure_bare("dual-band-x", 300_000)
    measure_all()


if __name__ == "__main__":
    main()
