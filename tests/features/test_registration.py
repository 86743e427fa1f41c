"""The shift of an image is found by its fiducials."""

import numpy as np
import pytest

from flgpr.features import register_fiducials
from flgpr.model import Grid


def test_fiducials_give_shift_and_residual():
    rng = np.random.default_rng(5)
    grid = Grid(-3.0, 0.0, 76, 751, 0.08, 0.04)
    surveyed = np.array([[-2.2, 4.0], [2.2, 4.0], [-2.2, 15.0], [2.2, 15.0], [-2.2, 26.0]])
    shift = np.array([0.11, -0.17])
    noise = rng.normal(0, 0.02, surveyed.shape)
    image = rng.rayleigh(0.05, grid.shape)
    x, y = np.meshgrid(grid.x, grid.y)
    for u, v in surveyed + shift + noise:
        image = image + 10 * np.exp(-(((x - u) / 0.15) ** 2) - ((y - v) / 0.08) ** 2)
    found = register_fiducials(image, grid, surveyed)
    assert found.used == 5
    np.testing.assert_allclose(found.shift, shift, atol=0.03)
    spread = noise - np.median(noise, axis=0)
    assert found.residual == pytest.approx(np.sqrt((spread**2).sum(axis=1).mean()), abs=0.02)
    with pytest.raises(ValueError, match="fiducial"):
        register_fiducials(image, grid, [[50.0, 50.0]])


def test_a_single_false_fiducial_does_not_move_the_shift():
    grid = Grid(-1.0, 0.0, 101, 501, 0.02, 0.02)
    surveyed = np.array([[0.0, 2.0], [0.0, 4.0], [0.0, 6.0], [0.0, 8.0]])
    seen = surveyed + [0.1, 0.0]
    seen[1] += [0.3, 0.3]
    x, y = np.meshgrid(grid.x, grid.y)
    image = sum(np.exp(-((x - u) ** 2 + (y - v) ** 2) / 0.01) for u, v in seen)
    shift = register_fiducials(image, grid, surveyed).shift
    np.testing.assert_allclose(shift, [0.1, 0.0], atol=0.01)
