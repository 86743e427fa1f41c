"""Sums over all biases against a loop over points, sweeps and biases."""

import numpy as np

from flgpr.kernels.biases import sum_over_biases


def test_profiles_are_read_between_their_bins_at_every_bias():
    rng = np.random.default_rng(7)
    biases, size, first, step, turns = 5, 32, -2, 0.25, 3.0
    profile = (rng.normal(size=(2, 3, size)) + 1j * rng.normal(size=(2, 3, size))).astype(
        np.complex64
    )
    table = np.concatenate([profile, profile[..., : biases + 1]], axis=-1)
    tx, rx = rng.uniform(-1, 1, (2, 3, 3))
    share = rng.random(3)
    points = rng.uniform(1, 4, (2, 3))
    total = np.zeros((2, 2, biases), np.complex64)
    sum_over_biases(table, tx, rx, share, points, step, turns, first, total)
    expected = np.zeros(total.shape, complex)
    for n, point in enumerate(points):
        for s in range(3):
            path = np.linalg.norm(tx[s] - point) + np.linalg.norm(rx[s] - point)
            for b in range(biases):
                position = path / step + first + b
                low = int(np.floor(position))
                high = position - low
                value = (1 - high) * profile[:, s, low % size] + high * profile[
                    :, s, (low + 1) % size
                ]
                expected[n, :, b] += share[s] * np.exp(2j * np.pi * turns * path) * value
    np.testing.assert_allclose(total, expected, rtol=1e-4, atol=1e-4)
