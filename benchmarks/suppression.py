"""Time model-based suppression on one L-band frame.

The frame has 64 pairs, 500 tones, 4 polarizations and 400 x 300 pixels. Timed is all that is done to it once the
masks' thresholds are known: imaging the four polarizations, the mask, seven iterations of Eq. 5 to 8 of Fuse et al.
2018 in all four polarizations, the average of the last two and its image. Beside it the least-squares form with as
many iterations.
"""

from __future__ import annotations

import os
import platform
import time

import numpy as np

from flgpr.clutter import (
    Thresholds,
    averaged,
    iterate_suppression,
    mixed_mask,
    subregions,
    suppress_by_model,
)
from flgpr.imaging import ImagingOperator
from flgpr.model import Grid, load_sensor

ROUNDS = 7
GRID = Grid(-10.0, 5.0, 400, 300, 0.05, 0.05)


def frame():
    """Make data of 400 scatterers of any strength at random places."""
    rng = np.random.default_rng(5)
    sensor = load_sensor("dual-band-l")
    tx, rx = (side + [0, 0, sensor.height] for side in sensor.pairs())
    frequency = 750e6 + 4.9e6 * np.arange(500)
    places = rng.uniform((-10, 5, 0), (10, 20, 0.5), (400, 3))
    strength = rng.exponential(size=(4, 1, 400)) * np.exp(2j * np.pi * rng.random((4, 1, 400)))
    data = ImagingOperator(frequency, tx, rx, places, tolerance=1e-3).forward(strength)
    return frequency, tx, rx, data


def main() -> None:
    frequency, tx, rx, data = frame()
    pixels = GRID.points()
    region = subregions(pixels[..., 1], (5, 8.75, 12.5, 16.25, 20))

    def operator_on(points):
        return ImagingOperator(frequency, tx, rx, points, tolerance=1e-3)

    image = operator_on(pixels).adjoint(data)[:, 0]
    vv = np.abs(image[3])
    vh = np.abs(image[2])
    levels = [np.quantile(vv, 0.85), np.quantile(vh, 0.85), np.quantile(vh, 0.95)]
    thresholds = Thresholds(*(np.full(4, level) for level in levels))
    walls = {}
    cpus = {}
    for _ in range(ROUNDS + 1):
        for name in ("iteration", "least squares"):
            wall = time.perf_counter()
            cpu = time.process_time()
            whole = operator_on(pixels)
            image = whole.adjoint(data)[:, 0]
            mask = mixed_mask(image[3], image[2], thresholds, region, pixels[..., 0])
            if name == "iteration":
                course = iterate_suppression(data, operator_on, pixels, mask, region, 7)
                cleaned = averaged(course, 6)
            else:
                cleaned = suppress_by_model(data, operator_on(pixels[mask]), 7).data
            whole.adjoint(cleaned)
            walls.setdefault(name, []).append(time.perf_counter() - wall)
            cpus.setdefault(name, []).append(time.process_time() - cpu)
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"{mask.mean():.1%} of {mask.size} pixels under the mask; {course.told()}")
    print("| form | wall, median (least to most), s | CPU, median, s |\n|---|---|---|")
    for name in walls:
        w = walls[name][1:]
        c = cpus[name][1:]
        print(
            f"| {name} | {np.median(w):.2f} ({min(w):.2f} to {max(w):.2f}) | {np.median(c):.2f} |"
        )


if __name__ == "__main__":
    main()
