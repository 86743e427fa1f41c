"""Time the simulator: one sri-array scan and one X-band frame over bare rough ground, medians of several scans."""

from __future__ import annotations

import statistics
import time

import numpy as np

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Simulator


def measure(preset: str, scatterers: int, rounds: int = 5) -> None:
    sensor = load_sensor(preset)
    x_min, x_max, y_min, y_max = sensor.footprint
    density = 1.02 * scatterers / ((x_max - x_min) * (y_max - y_min))
    track = {"positions": tuple(float(y) for y in np.arange(rounds + 1))}
    simulator = Simulator(Scene(surface={"density": density}, track=track, length=60.0), sensor, 1, errors=False)
    seconds = []
    for scan in range(rounds + 1):
        start = time.perf_counter()
        simulator.scan(scan)
        seconds.append(time.perf_counter() - start)
    seen = round(density * (x_max - x_min) * (y_max - y_min))
    pairs, middle = len(sensor.pairs()[0]), statistics.median(seconds[1:])
    print(f"| {preset} | {seen:,} | {pairs} | {sensor.tones.count} | {middle:.2f} |")


def main() -> None:
    print("| sensor | scatterers in view | pairs | tones | s per scan |")
    print("|---|---|---|---|---|")
    measure("sri-array", 100_000)
    measure("dual-band-l", 100_000)
    measure("dual-band-x", 300_000)


if __name__ == "__main__":
    main()
