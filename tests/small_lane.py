"""A small lane of point scatterers and a recipe with features that fits it."""

import numpy as np

from flgpr.model import SPEED_OF_LIGHT, Lane, lane_to_scan, make_run, vehicle_to_scan
from flgpr.recipe.schema import recipe_text

LANE = Lane(-0.75, 0.75, 3.0, 10.0)
LANE_TOML = "x_min = -0.75\nx_max = 0.75\ny_min = 3.0\ny_max = 10.0\n"
TARGETS = np.array([[0.2, 4.5], [-0.4, 6.3], [0.3, 8.4]])
TX = np.repeat([[-0.8, 0.0, 0.0], [0.8, 0.0, 0.0]], 4, axis=0)
RX = np.tile([[x, 0.0, 0.0] for x in (-1.0, -0.4, 0.4, 1.0)], (2, 1))


def cut_down(text, changes):
    """Change entries of a recipe; each must be there."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def small_recipe(median_step=1):
    text = recipe_text("wang2007").replace("[features]\n", "[features]\nvariants = true\n")
    changes = (
        ("x = [-6.0, 6.0]", "x = [-2.0, 2.0]"),
        ("y = [7.0, 26.0]", "y = [2.5, 5.5]"),
        ("F0 = [0.80e9, 2.80e9]\n", ""),
        ("F3 = [1.75e9, 2.35e9]\nF4 = [2.25e9, 2.85e9]\n", ""),
        ("x = [-3.0, 3.0]", "x = [-1.2, 1.2]"),
        ("y_max = 16.0", "y_max = 4.5"),
        ("median_step = 3", f"median_step = {median_step}"),
        ("radius = 0.75", "radius = 0.4"),
        ("median = 1.05", "median = 0.55"),
        ("mean = 2.55", "mean = 1.05"),
    )
    return cut_down(text, changes)


def course(rng, y, sway):
    """Make the poses of a vehicle that sways by so many metres (standard deviation) and yaws a little."""
    pose = np.zeros((len(y), 6))
    pose[:, 0] = sway * rng.normal(size=len(y))
    pose[:, 1] = y
    pose[:, 2] = 2.0
    pose[:, 3] = 0.01 * rng.normal(size=len(y))
    return pose


def scatterers(rng, targets=TARGETS, count=200, ground=(1.5, 12)):
    """Clutter and targets: places and scattering matrices (HH, VV, HV)."""
    places = np.column_stack(
        [rng.uniform(-2, 2, count), rng.uniform(*ground, count), np.zeros(count)]
    )
    clutter = 0.3 * (rng.normal(size=(count, 3)) + 1j * rng.normal(size=(count, 3)))
    mines = np.column_stack([targets, np.zeros(len(targets))])
    return np.vstack([places, mines]), np.vstack(
        [clutter, np.array([[2.0, 1.5, 0.1]] * len(targets))]
    )


def echoes(rng, frequency, pose, places, matrix):
    """Add up the echoes of what lies 1 to 7 m ahead, and noise."""
    signal = np.zeros((len(pose), 3, 8, frequency.size), complex)
    for k, one in enumerate(pose):
        local = lane_to_scan(places, one)
        a, b = (np.linalg.norm(local - vehicle_to_scan(p, one)[:, None], axis=-1) for p in (TX, RX))
        ahead = ((local[:, 1] > 1) & (local[:, 1] < 7)) / (a * b)
        phase = np.exp(-2j * np.pi * frequency * (a + b)[..., None] / SPEED_OF_LIGHT)
        signal[k] = ((ahead[:, None] * matrix.T) @ phase).swapaxes(0, 1)
    return signal + 0.02 * (rng.normal(size=signal.shape) + 1j * rng.normal(size=signal.shape))


def small_run(scans=13, step=0.6, tones=74):
    """Make a run of eight pairs and three polarizations."""
    rng = np.random.default_rng(12)
    frequency = 0.75e9 + 1.11e9 / tones * np.arange(tones)
    pose = course(rng, step * np.arange(scans) - 0.5, 0.05)
    signal = echoes(rng, frequency, pose, *scatterers(rng))
    return make_run(signal, frequency, ["HH", "VV", "HV"], TX, RX, pose)
