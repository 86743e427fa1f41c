"""A small lane of point scatterers for live detection, and a recipe that fits it."""

import functools

import numpy as np

import small_lane
from flgpr.model import Lane, make_run

LANE = Lane(-0.75, 0.75, 2.0, 20.0)
TARGETS = np.array([[0.2, 9.5], [-0.4, 11.4], [0.3, 13.3], [-0.3, 15.2], [0.1, 17.1]])
SCANS = 42
STEP = 0.4


def small_recipe():
    return small_lane.small_recipe(median_step=2)


def make_lane_run(seed=12, scans=SCANS):
    return _made(seed, scans).copy(deep=True)


@functools.cache
def _made(seed, scans):
    rng = np.random.default_rng(seed)
    frequency = np.arange(0.75e9, 1.86e9, 1.5e7)
    pose = small_lane.course(rng, STEP * np.arange(scans) - 1.0, 0.03)
    signal = small_lane.echoes(
        rng, frequency, pose, *small_lane.scatterers(rng, TARGETS, 500, (0.5, 24))
    )
    time = np.arange(scans) / 4.2
    polarizations = ["HH", "VV", "HV"]
    return make_run(
        signal,
        frequency,
        polarizations,
        small_lane.TX,
        small_lane.RX,
        pose,
        time,
        {"title": "small lane"},
    )
