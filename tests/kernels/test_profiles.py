"""Delays and phasors of the profile kernels against the paths that they stand for."""

import numpy as np
import pytest

from flgpr.kernels.layout import BLOCK
from flgpr.kernels.profiles import Geometry, locate

PER_TURN = 10e6 / 299792458.0
CARRIER = 1e9 / 299792458.0


def geometry(medium, gain=None):
    rng = np.random.default_rng(1)
    pixels = np.concatenate([rng.uniform(-5, 5, (2, BLOCK)), rng.uniform(-0.5, -0.1, (1, BLOCK))])
    antenna = np.array([[0.0, -9.0, 2.0], [1.0, -9.0, 3.0]])
    size = 2 * BLOCK
    return Geometry(
        tx=np.array([0]),
        rx=np.array([1]),
        antenna=antenna,
        pixels=pixels,
        pixel_count=BLOCK,
        medium=np.array(medium),
        per_turn=PER_TURN,
        carrier=CARRIER,
        origin=0,
        shift=20,
        gain=np.empty((2, 0), np.float32) if gain is None else gain,
        weight=np.zeros(1, np.float32),
        delay=np.zeros(size, np.uint32),
        cosine=np.zeros(size, np.float32),
        sine=np.zeros(size, np.float32),
    )


def straight(made):
    return np.linalg.norm(made.pixels.T[None] - made.antenna[:, None], axis=-1)


def check(made, path, gain=1.0):
    """Whether delays are fractions of a turn in 32 bits, and phasors those of the carrier."""
    locate(made, 0, 1)
    turns = made.delay.reshape(2, BLOCK) / 2.0**32
    missed = (turns - path * PER_TURN + 0.5) % 1 - 0.5
    assert np.abs(missed).max() < 1e-6
    phasor = (made.cosine + 1j * made.sine).reshape(2, BLOCK)
    np.testing.assert_allclose(phasor, gain * np.exp(2j * np.pi * path * CARRIER), atol=1e-3)


@pytest.mark.parametrize("index", [1.0, 1.7])
def test_delays_and_phasors_are_those_of_the_straight_path(index):
    made = geometry([index, 0.0])
    check(made, index * straight(made))


def test_under_a_surface_they_are_those_of_the_shortest_path():
    made = geometry([1.0, 2.0])
    depth = -made.pixels[2]
    across = np.linalg.norm(made.pixels.T[None, :, :2] - made.antenna[:, None, :2], axis=-1)
    height = made.antenna[:, 2, None]
    share = np.linspace(0, 1, 4001)[:, None, None]
    air = np.hypot(height, share * across)
    soil = np.hypot(depth, (1 - share) * across)
    # Fermat's principle, by trying entries: a wrong one of a grid this fine costs micrometres.
    check(made, (air + 2.0 * soil).min(axis=0))


def test_gains_scale_the_phasors():
    gain = np.random.default_rng(2).uniform(0.5, 2, (2, BLOCK)).astype(np.float32)
    made = geometry([1.0, 0.0], gain)
    check(made, straight(made), gain)
