"""The operator against Eq. 1 of Fuse et al. 2018 written as it stands, in double precision."""

import itertools

import numpy as np
import pytest

from flgpr.imaging import ImagingOperator
from flgpr.model import SPEED_OF_LIGHT

TONES = 442.5e6 + 10e6 * np.arange(140)
BANDS = ((0.5e9, 0.9e9), (0.7e9, 1.4e9), (1.2e9, 1.8e9))
TX = np.repeat([[-1.5, 0.0, 5.0], [1.5, 0.1, 5.2]], 4, axis=0)
RX = np.tile(np.stack([np.linspace(-2, 2, 4), np.zeros(4), np.full(4, 5.1)], axis=1), (2, 1))


def pixels(count=150, seed=2):
    rng = np.random.default_rng(seed)
    return rng.uniform([-6, 7, -0.3], [6, 26, 1.0], size=(count, 3))


def phase(frequency, points, index=1.0, offset=0.0):
    """exp(+j2πfL/c), shape (pair, frequency, pixel)."""
    length = np.linalg.norm(points - TX[:, None], axis=2) + np.linalg.norm(
        points - RX[:, None], axis=2
    )
    length = index * length - np.broadcast_to(offset, 8)[:, None]
    return np.exp(2j * np.pi * frequency[:, None] * length[:, None, :] / SPEED_OF_LIGHT)


def inside(frequency, bands):
    return np.array([(frequency >= lo) & (frequency <= hi) for lo, hi in bands], dtype=float)


def complex_normal(shape, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def relative(value, truth):
    return np.linalg.norm(value - truth) / np.linalg.norm(truth)


def check(operator, truth, weight, tolerance, polarizations=2):
    """Compare both directions and the pair of them with the sums over ``truth`` (pair, frequency, pixel)."""
    data = complex_normal((polarizations, *truth.shape[:2]))
    image = complex_normal((polarizations, len(weight), truth.shape[2]), seed=1)
    adjoint = operator.adjoint(data)
    forward = operator.forward(image)
    exact = np.einsum("cqf,sf,qfp->csp", data, weight, truth, optimize=True)
    assert relative(adjoint, exact) < tolerance
    exact = np.einsum("csp,sf,qfp->cqf", image, weight, truth.conj(), optimize=True)
    assert relative(forward, exact) < tolerance
    gap = np.vdot(forward.astype(complex), data) - np.vdot(image, adjoint.astype(complex))
    assert abs(gap) < 1e-6 * np.linalg.norm(forward) * np.linalg.norm(data)


METHODS = pytest.mark.parametrize("method", ["profile", "direct"])


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5, 1e-7, 1e-10])
@pytest.mark.parametrize("bands", [None, BANDS])
def test_error_stays_below_tolerance(tolerance, bands):
    points = pixels()
    operator = ImagingOperator(TONES, TX, RX, points, bands, tolerance, method="profile")
    weight = inside(TONES, bands or ((0, 1e10),))
    check(operator, phase(TONES, points), weight, tolerance)


@METHODS
def test_gaps_in_the_tones_keep_their_place(method):
    keep = np.random.default_rng(3).random(140) > 0.4
    points = pixels()
    operator = ImagingOperator(TONES[keep], TX, RX, points, BANDS, 1e-4, method=method)
    check(operator, phase(TONES[keep], points), inside(TONES[keep], BANDS), 1e-4)


@METHODS
def test_uneven_tones(method):
    tones = np.sort(np.random.default_rng(4).uniform(0.45e9, 1.8e9, 90))
    points = pixels()
    operator = ImagingOperator(tones, TX, RX, points, BANDS, 1e-4, method=method)
    assert operator.method == method
    check(operator, phase(tones, points), inside(tones, BANDS), 1e-4)


@METHODS
def test_ranges_beyond_the_ambiguous_one_wrap(method):
    points = pixels() * [4, 9, 1]  # paths up to 470 m; c/df is 30 m
    operator = ImagingOperator(TONES, TX, RX, points, None, 1e-4, method=method)
    check(operator, phase(TONES, points), np.ones((1, 140)), 1e-4)


@METHODS
def test_permittivity_and_path_offset(method):
    points = pixels()
    offset = np.linspace(-3, 40, 8)
    operator = ImagingOperator(
        TONES, TX, RX, points, BANDS, 1e-4, permittivity=2.2, path_offset=offset, method=method
    )
    check(operator, phase(TONES, points, np.sqrt(2.2), offset), inside(TONES, BANDS), 1e-4)


@METHODS
def test_antenna_patterns_weigh_both_directions(method):
    def beam(position, points):
        ray = points - position
        return (ray[:, 1] / np.linalg.norm(ray, axis=1)) ** 3 + position[0]

    points = pixels()
    operator = ImagingOperator(
        TONES, TX, RX, points, BANDS, 1e-4, tx_pattern=beam, rx_pattern=beam, method=method
    )
    gain = np.array([beam(t, points) * beam(r, points) for t, r in zip(TX, RX, strict=True)])
    check(operator, phase(TONES, points) * gain[:, None], inside(TONES, BANDS), 1e-4)


@METHODS
@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_tones(method, count):
    tones = TONES[3 : 3 + count]
    points = pixels()
    operator = ImagingOperator(tones, TX, RX, points, None, 1e-4, method=method)
    check(operator, phase(tones, points), np.ones((1, count)), 1e-4)


def test_more_channels_than_a_lane_row():
    points = pixels(70)
    edges = np.linspace(0.45e9, 1.8e9, 20)
    bands = tuple(itertools.pairwise(edges))
    operator = ImagingOperator(TONES, TX, RX, points, bands, 1e-3, method="profile")
    check(operator, phase(TONES, points), inside(TONES, bands), 1e-3, polarizations=3)
    operator = ImagingOperator(TONES, TX, RX, points, bands[:5], 1e-3, method="profile")
    check(operator, phase(TONES, points), inside(TONES, bands[:5]), 1e-3, polarizations=7)


def test_a_long_sparse_band_stays_within_tolerance():
    # Too many steps for 32-bit delays at this tolerance: double precision takes over.
    steps = np.sort(np.random.default_rng(5).choice(5000, 300, replace=False))
    tones = 0.5e9 + 0.3e6 * steps
    points = pixels()
    operator = ImagingOperator(tones, TX, RX, points, None, 1e-5, method="profile")
    assert operator.adjoint(np.zeros((1, 8, 300))).dtype == np.complex64
    check(operator, phase(tones, points), np.ones((1, 300)), 1e-5)


def test_a_tone_at_the_edge_of_the_band_is_within_tolerance():
    points = pixels()
    data = np.zeros((1, 8, 140), complex)
    data[..., 0] = 1
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5):
        operator = ImagingOperator(TONES, TX, RX, points, None, tolerance, method="profile")
        exact = phase(TONES[:1], points).sum(axis=0)[None]
        assert relative(operator.adjoint(data), exact) < tolerance
