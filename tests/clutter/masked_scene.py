"""A small array, its ground and its operators, for tests of suppression under a mask."""

import numpy as np

from flgpr.imaging import ImagingOperator
from flgpr.model import Grid

FREQUENCY = 0.75e9 + 25e6 * np.arange(99)
TX = np.repeat([[-0.9, 0, 1.5], [0.9, 0, 1.5]], 8, axis=0)
RX = np.tile(np.column_stack([np.linspace(-1, 1, 8), np.zeros(8), np.full(8, 1.5)]), (2, 1))
GRID = Grid.spanning((-2, 2), (2.5, 6), 0.05)
PIXELS = GRID.points()
REGION = (PIXELS[..., 1] > 4.25).astype(np.int64)
RNG = np.random.default_rng(8)


def operator_on(points, behind=0.0):
    shift = np.array([0, -behind, 0])
    return ImagingOperator(FREQUENCY, TX + shift, RX + shift, points, tolerance=1e-5)


def data(x, y, amplitude=1.0, behind=0.0):
    return amplitude * operator_on([[x, y, 0.0]], behind).forward(np.ones((1, 1, 1)))


def disc(x, y, radius=0.3):
    return np.hypot(PIXELS[..., 0] - x, PIXELS[..., 1] - y) <= radius


def noise(*shape):
    return (RNG.normal(size=shape) + 1j * RNG.normal(size=shape)).astype(np.complex64)
