"""Tones on a uniform spectrum, the swath of paths, and antennas that pairs share."""

import numpy as np
import pytest

from flgpr.imaging.plan import lay_out, place_tones

TX = np.array([[0.0, 0.0, 1.5], [0.0, 0.0, 1.5], [1.0, 0.0, 1.5]])
RX = np.array([[0.5, 0.0, 1.5], [-0.5, 0.0, 1.5], [0.5, 0.0, 1.5]])
PIXELS = np.random.default_rng(0).uniform((-1, 3, 0), (1, 6, 0.2), (100, 3))


def test_even_tones_and_their_gaps_keep_their_own_spectrum():
    frequency = 1e9 + 5e6 * np.delete(np.arange(20), [3, 4, 11])
    tones = place_tones(frequency, (4.0, 20.0), 1e-3)
    assert tones.uniform
    assert tones.step == pytest.approx(5e6)
    np.testing.assert_allclose(tones.carrier + tones.step * tones.position, frequency)


def test_uneven_tones_lie_between_the_slots_of_a_spectrum_of_the_swath():
    frequency = 1e9 + 5e6 * np.arange(20) + np.random.default_rng(1).uniform(0, 2e6, 20)
    tones = place_tones(frequency, (4.0, 20.0), 1e-3)
    assert not tones.uniform
    assert 299_792_458.0 / tones.step > 3 * 16.0
    np.testing.assert_allclose(tones.carrier + tones.step * tones.position, frequency)


def test_every_antenna_is_there_once_and_the_last_pixel_fills_a_block():
    layout = lay_out(TX, RX, PIXELS, (1.0, 0.0), (None, None))
    assert len(layout.antenna) == 4
    np.testing.assert_array_equal(layout.antenna[layout.tx], TX)
    np.testing.assert_array_equal(layout.antenna[layout.rx], RX)
    assert layout.pixels.shape == (3, 128)
    np.testing.assert_array_equal(layout.pixels[:, 100:], PIXELS[-1][:, None].repeat(28, 1))


def test_the_swath_holds_all_paths():
    layout = lay_out(TX, RX, PIXELS, (1.0, 0.0), (None, None))
    path = np.linalg.norm(PIXELS - TX[:, None], axis=-1)
    path += np.linalg.norm(PIXELS - RX[:, None], axis=-1)
    low, high = layout.swath()
    assert low <= path.min()
    assert path.max() <= high < path.max() + 2


def test_a_pattern_is_asked_once_per_antenna_and_must_be_a_number_per_pixel():
    asked = []

    def pattern(position, pixels):
        asked.append(tuple(position))
        return np.full(len(pixels), 2.0)

    layout = lay_out(TX, RX, PIXELS, (1.0, 0.0), (pattern, None))
    assert sorted(asked) == [(0.0, 0.0, 1.5), (1.0, 0.0, 1.5)]
    np.testing.assert_array_equal(layout.gain[:2, :100], 2.0)
    np.testing.assert_array_equal(layout.gain[2:], 1.0)
    with pytest.raises(ValueError, match="rx_pattern must return one finite amplitude per pixel"):
        lay_out(TX, RX, PIXELS, (1.0, 0.0), (None, lambda position, pixels: np.ones(3)))
