"""Paths into the ground against Fermat's principle, and where buried points focus."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from flgpr.imaging import ImagingOperator
from flgpr.kernels.geometry import antenna_paths
from flgpr.model import SPEED_OF_LIGHT

TONES = 750e6 + 5e6 * np.arange(241)
TX = np.repeat([[-1.5, 0.0, 5.0], [1.5, 0.0, 5.0]], 8, axis=0)
RX = np.tile(np.stack([np.linspace(-2, 2, 8), np.zeros(8), np.full(8, 5.0)], axis=1), (2, 1))


def fermat(antenna, point, permittivity):
    """Least optical path over all points of entry on the line between antenna and point (PHYSICS: Refraction)."""
    across = np.hypot(*(point[:2] - antenna[:2]))
    height = antenna[2]
    depth = -point[2]

    def path(entry):
        return np.hypot(height, across - entry) + np.sqrt(permittivity) * np.hypot(depth, entry)

    if across == 0:
        return path(0.0)
    return minimize_scalar(path, bounds=(0, across), method="bounded", options={"xatol": 1e-10}).fun


@pytest.mark.parametrize("permittivity", [1.0, 1.5, 3.4, 10.7, 30.0])
@pytest.mark.parametrize("depth", [1e-9, 0.05, 0.15, 0.5, 2.0, 5.0])
def test_path_is_the_least_of_all(permittivity, depth):
    points = np.array([[x, 0.3 * x, -depth] for x in (0.0, 0.01, 0.3, 2.0, 7.0, 12.0, 26.0, 80.0)])
    antennas = np.array([[0.0, 0.0, 5.0], [0.7, -0.2, 0.4]])
    paths = np.empty((2, 8))
    antenna_paths(points.T.copy(), antennas, np.array([1.0, np.sqrt(permittivity)]), paths)
    exact = [[fermat(a, p, permittivity) for p in points] for a in antennas]
    assert paths == pytest.approx(np.array(exact), abs=1e-5)


def test_paths_above_ground_are_straight():
    points = np.array([[1.0, 9.0, 0.0], [2.0, 12.0, 0.8]])
    paths = np.empty((1, 2))
    antenna_paths(points.T.copy(), TX[:1], np.array([1.0, 2.0]), paths)
    assert paths[0] == pytest.approx(np.linalg.norm(points - TX[0], axis=1), rel=1e-12)


def buried_echo(point, permittivity):
    """Field of one buried point: exp(-j2πfL/c) with L by Fermat's principle."""
    length = [
        fermat(t, point, permittivity) + fermat(r, point, permittivity)
        for t, r in zip(TX, RX, strict=True)
    ]
    return np.exp(-2j * np.pi * TONES * np.array(length)[:, None] / SPEED_OF_LIGHT)


@pytest.mark.parametrize("y", [7.0, 12.0])
def test_a_buried_point_focuses_where_it_is_and_not_beyond(y):
    depth = 0.10
    permittivity = 3.4
    data = buried_echo(np.array([0.0, y, -depth]), permittivity)[None]
    ahead = y + np.arange(-0.3, 0.5, 0.01)
    line = np.stack([np.zeros_like(ahead), ahead, np.full_like(ahead, -depth)], axis=1)
    refracted = ImagingOperator(
        TONES, TX, RX, line, half_space=permittivity, method="profile"
    ).adjoint(data)
    assert ahead[np.abs(refracted[0, 0]).argmax()] == pytest.approx(y, abs=0.011)
    assert np.abs(refracted).max() == pytest.approx(16 * 241, rel=2e-3)
    surface = ImagingOperator(TONES, TX, RX, line * [1, 1, 0], method="profile").adjoint(data)
    sine = y / np.hypot(y, 5.0)
    beyond = depth * np.sqrt(permittivity - sine**2) / sine
    assert 0.15 < beyond < 0.21
    assert ahead[np.abs(surface[0, 0]).argmax()] - y == pytest.approx(beyond, abs=0.015)


def test_depth_is_found_where_the_view_is_steep_and_wide():
    # Depth and distance trade off along a line seen from afar; close to the array the pair of them
    # is resolved.
    truth = np.array([0.2, 1.0, -0.5])
    permittivity = 3.4
    tx = np.array([[x, y, 2.0] for x in np.linspace(-3, 3, 7) for y in np.linspace(-2, 4, 7)])
    length = [2 * fermat(t, truth, permittivity) for t in tx]
    data = np.exp(-2j * np.pi * TONES * np.array(length)[:, None] / SPEED_OF_LIGHT)
    y, z = np.meshgrid(1 + np.arange(-0.3, 0.31, 0.02), -0.5 + np.arange(-0.3, 0.31, 0.02))
    cut = np.stack([np.full_like(y, 0.2), y, z], axis=-1)
    image = np.abs(
        ImagingOperator(TONES, tx, tx, cut, half_space=permittivity).adjoint(data[None])[0, 0]
    )
    at = np.unravel_index(image.argmax(), image.shape)
    assert (y[at], z[at]) == pytest.approx((1.0, -0.5), abs=0.011)


@pytest.mark.parametrize("method", ["profile", "direct"])
def test_refracted_pair_is_adjoint(method):
    rng = np.random.default_rng(0)
    points = rng.uniform([-3, 7, -0.5], [3, 12, 0.3], size=(200, 3))
    operator = ImagingOperator(TONES, TX, RX, points, half_space=3.4, tolerance=1e-5, method=method)
    data = rng.normal(size=(1, 16, 241)) + 1j * rng.normal(size=(1, 16, 241))
    image = rng.normal(size=(1, 1, 200)) + 1j * rng.normal(size=(1, 1, 200))
    modelled = operator.forward(image).astype(complex)
    imaged = operator.adjoint(data).astype(complex)
    gap = np.vdot(modelled, data) - np.vdot(image, imaged)
    assert abs(gap) < 1e-6 * np.linalg.norm(modelled) * np.linalg.norm(data)
    exact = ImagingOperator(
        TONES, TX, RX, points, half_space=3.4, dtype="complex128", method="direct"
    ).adjoint(data)
    assert np.linalg.norm(imaged - exact) < 1e-5 * np.linalg.norm(exact)


def test_antennas_must_be_above_everything():
    with pytest.raises(
        ValueError, match=r"half_space needs all antennas above all pixels and above z = 0"
    ):
        ImagingOperator(TONES, TX, RX, np.array([[0.0, 7.0, 5.5]]), half_space=3.4)
