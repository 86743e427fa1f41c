"""Drives over one small lane of point scatterers, between which targets are laid."""

import numpy as np

from flgpr.model import make_run
from small_lane import RX, TARGETS, TX, course, echoes, scatterers

FREQUENCY = 0.75e9 + 1.11e9 / 74 * np.arange(74)
OLD = TARGETS[:1]


def drive(
    seed, targets, offset=0.0, scans=13, frequency=FREQUENCY, step=0.6, count=200, ground=(1.5, 12)
):
    """Make a drive over the same ground, with poses and noise of its own."""
    rng = np.random.default_rng(seed)
    pose = course(rng, step * np.arange(scans) - 0.5 + step / 3 * rng.random(scans), 0.05)
    places, matrix = scatterers(np.random.default_rng(12), targets, count, ground)
    matrix = matrix.copy()
    matrix[: len(matrix) - len(targets)] *= 3  # clutter in which single looks find little
    signal = echoes(rng, frequency, pose, places, matrix)
    pose[:, 0] += offset
    time = np.arange(scans) / 4.2
    return make_run(signal, frequency, ["HH", "VV", "HV"], TX, RX, pose, time, {"title": "lane"})
