"""The parts of the oracle on numbers that are known."""

from types import SimpleNamespace

import numpy as np

from flgpr.model import Grid
from flgpr_ground.oracle import (
    RADIUS,
    STEP,
    chips_at,
    count_maxima,
    divided_by_rms,
    inverse_covariance,
    log_likelihoods,
    oracle_file,
)


def test_a_file_per_tier():
    assert oracle_file(SimpleNamespace(tier="")) == "oracle.csv"
    assert oracle_file(SimpleNamespace(tier="dry")) == "oracle-dry.csv"


def test_of_maxima_nearer_than_the_radius_the_largest_counts():
    values = np.zeros((20, 20))
    values[5, 5] = 3.0
    values[5, 7] = 2.0  # 0.4 m off
    values[15, 15] = 2.0
    assert count_maxima(values, 1.0) == 2
    assert count_maxima(values, 2.5) == 1
    assert round(RADIUS / STEP) < 10


def test_a_known_phase_counts_and_an_unknown_one_does_not():
    looks = np.array([[2.0 + 0j, 1.0 + 0j], [2j, 1j]])
    unknown, known = log_likelihoods(looks)
    np.testing.assert_allclose(known, [6.0, 0.0], atol=1e-12)
    assert unknown[0] == unknown[1] > 0


def test_evened_chips_have_unit_power_in_whitened_clutter():
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(4, 4)) + 1j * rng.normal(size=(4, 4))
    noise = rng.normal(size=(4000, 4)) + 1j * rng.normal(size=(4000, 4))
    chips = (noise @ mixing.T).astype(np.complex64)
    inverse = inverse_covariance(chips)
    evened = divided_by_rms(5 * chips, inverse)
    power = np.einsum("kc,cd,kd->k", evened.conj(), inverse, evened).real / 4
    np.testing.assert_allclose(power, 1, rtol=1e-3)


def test_chips_hold_the_nine_pixels_about_a_place():
    grid = Grid(-1.0, 2.0, 21, 31, 0.1, 0.1)
    image = np.arange(2 * 31 * 21).reshape(2, 1, 31, 21).astype(np.complex64)
    chips = chips_at(image, grid, np.array([[0.01, 3.02]]))
    row, column = 10, 10
    rows = row + np.array([-2, 0, 2])
    columns = column + np.array([-2, 0, 2])
    expected = image[:, :, rows[:, None], columns].reshape(1, -1)
    np.testing.assert_array_equal(chips, expected)
