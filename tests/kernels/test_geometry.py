"""Optical paths: straight lines, and rays that Snell's law refracts, against a minimum by search."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from flgpr.kernels.geometry import antenna_paths

ANTENNAS = np.array([[0.0, 0.0, 1.5], [0.8, -0.2, 2.0]])
PIXELS = np.array([[0.1, 4.0, 0.0], [-1.0, 6.0, -0.3], [0.5, 3.0, -1.0], [0.0, 5.0, 0.4]])


def paths(index, ground):
    out = np.empty((len(ANTENNAS), len(PIXELS)))
    antenna_paths(np.ascontiguousarray(PIXELS.T), ANTENNAS, np.array([index, ground]), out)
    return out


def test_without_ground_paths_are_straight_lines_times_the_index():
    distance = np.linalg.norm(PIXELS[None] - ANTENNAS[:, None], axis=-1)
    np.testing.assert_allclose(paths(1.3, 0.0), 1.3 * distance, rtol=1e-14)


@pytest.mark.parametrize("ground", [1.5, 3.0])
def test_rays_into_the_ground_have_the_shortest_optical_path(ground):
    got = paths(1.0, ground)
    for a, (ax, ay, az) in enumerate(ANTENNAS):
        for p, (x, y, z) in enumerate(PIXELS):
            across = np.hypot(x - ax, y - ay)
            depth = max(-z, 0.0)
            height = az - max(z, 0.0)

            def length(entry, across=across, depth=depth, height=height):
                return np.hypot(height, across - entry) + ground * np.hypot(depth, entry)

            least = minimize_scalar(length, bounds=(0, across), options={"xatol": 1e-12})
            assert got[a, p] == pytest.approx(min(least.fun, length(0.0)), rel=1e-9)
