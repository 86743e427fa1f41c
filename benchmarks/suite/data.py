"""Data that benchmarks work on: noise on real geometries, whose cost is that of real ground.

What detection does for a scan does not depend on what the scan shows, and the density rule fixes
the number of alarms. ``FLGPR_BENCHMARK_SIZE=small`` makes everything small, to try the suite out.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.model import Lane, load_sensor
from flgpr.store import RunWriter

SMALL = os.environ.get("FLGPR_BENCHMARK_SIZE") == "small"
STEP = 1000 / 600
"""Way between scans, m: 600 scans a kilometre."""


def size(full: int, small: int) -> int:
    """Return the size of a benchmark: the full one, or the small one if asked for."""
    return small if SMALL else full


def complex_noise(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.complex128]:
    """Draw complex normal numbers of unit variance in either part."""
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def lane_of(scans: int) -> Lane:
    """Return the lane that so many scans search."""
    return Lane(-1.5, 1.5, 0.0, STEP * scans - 5)


def write_noise_run(path: Path, scans: int) -> Path:
    """Store a run of noise on the geometry of ``sri-array``, 1.4 MB a scan, and return its path."""
    sensor = load_sensor("sri-array")
    rng = np.random.default_rng(1)
    tones = 442.5e6 + 2.5e6 * np.arange(1024)
    tx, rx = sensor.pairs()
    shape = (3, len(tx), tones.size)
    with RunWriter(path, tones, list(sensor.polarization), tx, rx) as writer:
        for scan in range(scans):
            noise = rng.standard_normal((2, *shape), dtype=np.float32)
            attitude = 0.004 * rng.standard_normal(2)
            pose = [0.0, STEP * scan - 20, 5.0, 0.0, *attitude]
            writer.append(noise[0] + 1j * noise[1], pose, float(scan))
    return path


def written_elsewhere(path: Path, scans: int) -> Path:
    """Store such a run by a process of its own, so that its memory is not counted in this one."""
    with ProcessPoolExecutor(1, get_context("spawn")) as other:
        return other.submit(write_noise_run, path, scans).result()


def ripley(count: int, seed: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Draw examples and labels of Ripley's mixture: two classes of two normals, variance 0.03."""
    rng = np.random.default_rng(seed)
    label = rng.integers(0, 2, count)
    side = rng.integers(0, 2, count)
    centre = np.array([[[-0.7, 0.3], [0.3, 0.3]], [[-0.3, 0.7], [0.4, 0.7]]])
    return centre[label, side] + np.sqrt(0.03) * rng.standard_normal((count, 2)), label


def alarms_and_truth(
    targets: int, noise: int, length: float, rng: np.random.Generator
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Draw a 4 m wide lane with an alarm at every target and ``noise`` others all over it.

    Targets stand in the middle of the lane at equal distances. Alarms within a metre of one are
    left out. Confidences are N(2, 1) at targets and N(0, 1) elsewhere.
    """
    spacing = length / targets
    truth = pd.DataFrame({"x": 2.0, "y": (np.arange(targets) + 0.5) * spacing})
    truth["kind"] = "metal"
    truth["depth"] = 0.05
    truth["target_id"] = [f"m{number}" for number in range(targets)]
    places = rng.uniform([0, 0], [4, length], size=(noise, 2))
    near = np.hypot(places[:, 0] - 2, places[:, 1] % spacing - spacing / 2) <= 1
    false = places[~near]
    alarms = pd.DataFrame(np.concatenate([truth[["x", "y"]], false]), columns=["x", "y"])
    at_targets = rng.normal(2, 1, targets)
    elsewhere = rng.normal(size=len(false))
    return alarms.assign(confidence=np.concatenate([at_targets, elsewhere])), truth
