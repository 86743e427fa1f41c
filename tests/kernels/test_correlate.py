"""Correlation with a bank of filters against the loops that define it."""

import numpy as np
import pytest

from flgpr.kernels.correlate import chips, correlate_bank

RNG = np.random.default_rng(2)


@pytest.mark.parametrize("shape", [(5, 1), (3, 4)])
def test_the_bank_is_correlated_term_by_term(shape):
    v, u = shape
    image = RNG.normal(size=(2, 12, 9)) + 1j * RNG.normal(size=(2, 12, 9))
    bank = RNG.normal(size=(3, 2, v, u)) + 1j * RNG.normal(size=(3, 2, v, u))
    got = correlate_bank(image, bank)
    assert got.shape == (3, 12 - v + 1, 9 - u + 1)
    for j, y, x in np.ndindex(got.shape):
        expected = (bank[j].conj() * image[:, y : y + v, x : x + u]).sum()
        assert got[j, y, x] == pytest.approx(expected, abs=1e-10)


def test_chips_are_views_of_the_image():
    image = RNG.normal(size=(2, 6, 5))
    got = chips(image, (3, 2))
    assert got.shape == (4, 4, 2, 3, 2)
    np.testing.assert_array_equal(got[1, 2], image[:, 1:4, 2:4])
    assert np.shares_memory(got, image)
