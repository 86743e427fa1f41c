"""A small lane of point scatterers and a recipe with features that fits it."""

import numpy as np

from flgpr.model import SPEED_OF_LIGHT, Lane, lane_to_scan, make_run, vehicle_to_scan
from flgpr.pipeline.recipe import recipe_text

LANE = Lane(-0.75, 0.75, 3.0, 10.0)
LANE_TOML = "x_min = -0.75\nx_max = 0.75\ny_min = 3.0\ny_max = 10.0\n"
TARGETS = np.array([[0.2, 4.5], [-0.4, 6.3], [0.3, 8.4]])


def small_recipe():
    text = recipe_text("wang2007")
    for old, new in (
        ("x = [-6.0, 6.0]", "x = [-2.0, 2.0]"),
        ("y = [7.0, 26.0]", "y = [2.5, 5.5]"),
        ("F0 = [0.80e9, 2.80e9]\n", ""),
        ("F3 = [1.75e9, 2.35e9]\nF4 = [2.25e9, 2.85e9]\n", ""),
        ("x = [-3.0, 3.0]", "x = [-1.2, 1.2]"),
        ("y_max = 16.0", "y_max = 4.5"),
        ("median_step = 3", "median_step = 1"),
        ("radius = 0.75", "radius = 0.4"),
        ("median = 1.05", "median = 0.55"),
        ("mean = 2.55", "mean = 1.05"),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    return text


def scatterers(rng):
    """Clutter and three targets: places and scattering matrices (HH, VV, HV)."""
    places = np.column_stack([rng.uniform(-2, 2, 200), rng.uniform(1.5, 12, 200), np.zeros(200)])
    clutter = 0.3 * (rng.normal(size=(200, 3)) + 1j * rng.normal(size=(200, 3)))
    mines = np.column_stack([TARGETS, np.zeros(3)])
    return np.vstack([places, mines]), np.vstack([clutter, np.array([[2.0, 1.5, 0.1]] * 3)])


def small_run(scans=13, step=0.6, tones=74):
    """Make a run of eight pairs and three polarizations."""
    rng = np.random.default_rng(12)
    frequency = 0.75e9 + 1.11e9 / tones * np.arange(tones)
    tx = np.repeat([[-0.8, 0.0, 0.0], [0.8, 0.0, 0.0]], 4, axis=0)
    rx = np.tile([[x, 0.0, 0.0] for x in (-1.0, -0.4, 0.4, 1.0)], (2, 1))
    pose = np.zeros((scans, 6))
    pose[:, 0], pose[:, 1], pose[:, 2] = 0.05 * rng.normal(size=scans), step * np.arange(scans) - 0.5, 2.0
    pose[:, 3] = 0.01 * rng.normal(size=scans)
    places, matrix = scatterers(rng)
    signal = np.zeros((scans, 3, 8, frequency.size), complex)
    for k, one in enumerate(pose):
        local = lane_to_scan(places, one)
        a, b = (np.linalg.norm(local - vehicle_to_scan(p, one)[:, None], axis=-1) for p in (tx, rx))
        ahead = ((local[:, 1] > 1) & (local[:, 1] < 7)) / (a * b)
        phase = np.exp(-2j * np.pi * frequency * (a + b)[..., None] / SPEED_OF_LIGHT)
        for c in range(3):
            signal[k, c] = np.einsum("pn,n,pnf->pf", ahead, matrix[:, c], phase)
    signal += 0.02 * (rng.normal(size=signal.shape) + 1j * rng.normal(size=signal.shape))
    return make_run(signal, frequency, ["HH", "VV", "HV"], tx, rx, pose)
