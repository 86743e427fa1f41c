"""The exact field of cylinders against Born's approximation of weak ones, and against reciprocity."""

import numpy as np
from scipy.special import hankel2

from reference.cylinders import SPEED, scattered

FREQUENCY = 3e9
PAIR = ((0.0, 0.0, 0.03, 1.45), (-0.05, 0.01, 0.015, 3.0))
ANGLE = np.radians([10.0, 95.0, 170.0, 300.0])
PLACES = 1.2 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)


def test_source_and_receiver_may_change_places():
    field = scattered(PAIR, FREQUENCY, PLACES, PLACES[:3])
    back = scattered(PAIR, FREQUENCY, PLACES[:3], PLACES)
    np.testing.assert_allclose(field, back.T, rtol=1e-9)


def test_weak_cylinders_scatter_as_born_has_it():
    """The field is the integral of the source's field times the contrast times that of a line source in its place."""
    weak = [(x, y, radius, 1 + 1e-4) for x, y, radius, _ in PAIR]
    step = 1e-3
    side = np.arange(-0.08, 0.08, step) + step / 3
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    inside = np.zeros(len(grid), bool)
    for x, y, radius, _ in weak:
        inside |= np.hypot(*(grid - [x, y]).T) <= radius
    wavenumber = 2 * np.pi * FREQUENCY / SPEED
    away = np.linalg.norm(PLACES[:, None] - grid[inside], axis=-1)
    wave = hankel2(0, wavenumber * away)
    born = -0.25j * wavenumber**2 * 1e-4 * step**2 * (wave @ wave.T)
    exact = scattered(weak, FREQUENCY, PLACES, PLACES)
    np.testing.assert_allclose(exact, born, atol=0.02 * np.abs(exact).max())
