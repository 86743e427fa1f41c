"""Range profiles against sums written out, and the levels of amplitudes."""

import numpy as np
import pytest

from flgpr.imaging.range_profiles import DelayBins, levels, range_profiles

FREQUENCY = np.array([0.5e9, 0.55e9, 0.62e9, 0.7e9, 0.74e9, 0.8e9])


def slow_profile(sweep, delays):
    """Sum tone by tone, each with its share of the band under a Hann window."""
    count = FREQUENCY.size
    window = np.sin(np.pi * np.arange(1, count + 1) / (count + 1)) ** 2
    weight = window * np.gradient(FREQUENCY)
    total = np.zeros(delays.size, complex)
    for share, value, tone in zip(weight / weight.sum(), sweep, FREQUENCY, strict=True):
        total += share * value * np.exp(2j * np.pi * tone * delays)
    return total


@pytest.fixture
def signal():
    rng = np.random.default_rng(3)
    return rng.normal(size=(4, 6)) + 1j * rng.normal(size=(4, 6))


def test_delays_lie_in_the_middle_of_their_shares():
    bins = DelayBins(-1e-9, 3e-9, 2, 2)
    np.testing.assert_allclose(bins.delays(), [-0.5e-9, 0.5e-9, 1.5e-9, 2.5e-9])


def test_real_parts_are_those_of_the_sum(signal):
    bins = DelayBins(0.0, 20e-9, 7)
    profiles = range_profiles(signal, FREQUENCY, bins, amplitude=False)
    for sweep, profile in zip(signal, profiles, strict=True):
        expected = slow_profile(sweep, bins.delays()).real
        np.testing.assert_allclose(profile, expected, atol=2e-6)


def test_a_bin_holds_its_largest_amplitude(signal):
    bins = DelayBins(0.0, 20e-9, 5, 3)
    profiles = range_profiles(signal, FREQUENCY, bins, amplitude=True)
    expected = np.abs(slow_profile(signal[2], bins.delays())).reshape(5, 3).max(axis=1)
    np.testing.assert_allclose(profiles[2], expected, atol=2e-6)


def test_a_reflector_peaks_at_its_delay_with_its_amplitude():
    sweep = 3.0 * np.exp(-2j * np.pi * FREQUENCY * 9e-9)
    bins = DelayBins(0.0, 18e-9, 181)
    profile = range_profiles(sweep[None], FREQUENCY, bins, amplitude=True)[0]
    assert bins.delays()[profile.argmax()] == pytest.approx(9e-9, abs=1e-11)
    assert profile.max() == pytest.approx(3.0, rel=1e-5)


def test_levels_are_decibels_and_zero_is_the_least():
    np.testing.assert_allclose(levels(np.array([1.0, -10.0, 0.0])), [0.0, 20.0, -999.0])
    assert np.isnan(levels(np.array([np.nan]))).all()
