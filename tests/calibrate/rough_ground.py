"""An array that drives towards scatterers all over the ground."""

import numpy as np

from calibrate.echoes import echo
from flgpr.model import make_run
from flgpr.model.frames import vehicle_to_lane

HEIGHT = 3.0


def drive(scans=7, step=1.0, seed=1, per_area=12.0, deep=0.02):
    """Return a run at its true poses over ground that scatters from some centimetres deep."""
    rng = np.random.default_rng(seed)
    end = scans * step + 12.0
    count = round(per_area * 8.0 * (end - 2.5))
    x, y = rng.uniform(-4.0, 4.0, count), rng.uniform(2.5, end, count)
    ground = np.column_stack([x, y, rng.normal(-deep, 0.01, count)])
    strength = rng.normal(size=count) + 1j * rng.normal(size=count)
    rx = np.column_stack([np.linspace(-1.0, 1.0, 9), np.zeros(9), np.zeros(9)])
    tx = np.zeros((9, 3))
    pose = np.zeros((scans, 6))
    pose[:, 0] = rng.normal(0, 0.05, scans)
    pose[:, 1] = step * np.arange(scans)
    pose[:, 2] = HEIGHT
    pose[:, 3] = rng.normal(0, 0.01, scans)
    frequency = 0.5e9 + 12e6 * np.arange(70)
    signal = []
    for one in pose:
        ends = vehicle_to_lane(tx, one), vehicle_to_lane(rx, one)
        near = np.linalg.norm(ground - ends[0][0], axis=1) < 12.0  # before ranges repeat
        signal.append(echo(*ends, ground[near], frequency, strength[near]))
    return make_run(np.array(signal)[:, None], frequency, ["VV"], tx, rx, pose)
