"""Range profiles in time and frequency: against short-time transforms of SciPy, and echoes that are known."""

import numpy as np
import pytest
from scipy.signal import ShortTimeFFT

from flgpr.features import range_wavenumbers, reflection_features, spectrograms
from flgpr.imaging import ScanImager
from flgpr.model import SPEED_OF_LIGHT, Grid, make_run, vehicle_to_scan

OFFSETS = 0.05 * np.arange(-14, 15)
BAND = (0.8e9, 2.8e9)
FREQUENCY = np.linspace(*BAND, 16)
TX = np.repeat([[-1.5, 0.0, 0.0], [1.5, 0.0, 0.0]], 5, axis=0)
RX = np.tile([[x, 0.0, 0.0] for x in (-1.8, -0.9, 0.0, 0.9, 1.8)], (2, 1))
POSE = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
PLACE = np.array([[0.0, 10.0]])
TONES = np.arange(0.8e9, 2.8e9, 20e6)


def profile(*echoes, band=BAND):
    """The image down-track through point scatterers (y, strength) ahead of an array 5 m high."""
    tx, rx = (vehicle_to_scan(antennas, POSE) for antennas in (TX, RX))
    signal = 0
    for y, strength in echoes:
        place = np.array([0.0, y, 0.0])
        path = np.linalg.norm(place - tx, axis=1) + np.linalg.norm(place - rx, axis=1)
        signal = signal + strength * np.exp(-2j * np.pi * TONES * path[:, None] / SPEED_OF_LIGHT)
    run = make_run(signal[None, None], TONES, ["HH"], TX, RX, POSE[None])
    grid = Grid.spanning((-0.5, 0.5), (9.0, 11.0), 0.05)
    image = ScanImager(run, grid, {"band": band}).image(0)
    return image.values[0, 0, 20 - 14 : 20 + 15, 10][None].astype(complex)


def wavenumbers():
    return range_wavenumbers(PLACE, vehicle_to_scan(TX, POSE), vehicle_to_scan(RX, POSE), FREQUENCY)


def features(*echoes, **more):
    energy = spectrograms(profile(*echoes, **more), OFFSETS, wavenumbers(), 0.06)
    return reflection_features(energy, OFFSETS, FREQUENCY, 0.25, (0.1, 0.35))


def test_the_phase_turns_as_the_path_grows():
    antenna = np.array([[0.0, 0.0, 3.0]])
    turned = range_wavenumbers(np.array([[0.0, 4.0]]), antenna, antenna, np.array([1e9]))
    # There and back, 4 of 5 m of the slant lie along the ground.
    assert turned[0, 0] == pytest.approx(2 * np.pi * 1e9 / SPEED_OF_LIGHT * 2 * 4 / 5)


def test_energies_are_those_of_a_short_time_transform():
    rng = np.random.default_rng(1)
    signal = rng.normal(size=64) + 1j * rng.normal(size=64)
    window = np.exp(-((np.arange(-32, 33) * 0.05) ** 2) / (2 * 0.06**2))
    transform = ShortTimeFFT(
        window / window.sum(), hop=1, fs=20.0, fft_mode="twosided", mfft=65, phase_shift=None
    )
    theirs = np.abs(transform.stft(signal, p0=20, p1=44)) ** 2
    offsets = 0.05 * np.arange(64)
    ours = spectrograms(signal[None], offsets, 2 * np.pi * transform.f[None], 0.06)[0]
    # Beyond the ends there is nothing, and the windows there are whole.
    np.testing.assert_allclose(ours[20:44], theirs.T, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(("low", "high"), [(0.8e9, 1.4e9), (1.25e9, 1.85e9), (2.0e9, 2.8e9)])
def test_the_frequencies_of_a_sub_band_lie_where_it_lies(low, high):
    energy = spectrograms(profile((10.0, 1.0), band=(low, high)), OFFSETS, wavenumbers(), 0.3)
    strongest = FREQUENCY[energy[0, 14].argmax()]
    assert low - 0.15e9 <= strongest <= high + 0.15e9


def test_a_second_reflection_is_found_where_it_is():
    one = features((10.0, 1.0))
    two = features((10.0, 1.0), (10.2, 0.7))
    assert two.second[0] > one.second[0] + 3
    assert two.distance[0] == pytest.approx(0.2)
    assert two.second[0] == pytest.approx(20 * np.log10(0.7), abs=1.0)
    assert two.entropy[0] > one.entropy[0] + 0.4
    assert two.level[0] == pytest.approx(one.level[0], abs=1.0)


def test_one_more_part_as_strong_is_one_bit():
    far_apart = np.zeros((1, 29, 16))
    far_apart[0, 5, 3] = 1.0
    single = reflection_features(far_apart, OFFSETS, FREQUENCY, 0.25, (0.1, 0.35)).entropy[0]
    far_apart[0, 25, 12] = 1.0
    double = reflection_features(far_apart, OFFSETS, FREQUENCY, 0.25, (0.1, 0.35)).entropy[0]
    assert single == pytest.approx(0)
    assert double == pytest.approx(1)


def test_frequencies_of_both_reflections_are_compared():
    energy = np.zeros((1, 29, 16))
    energy[0, 14, [4, 8]] = 2.0, 2.0
    energy[0, 18, 5] = 1.0
    found = reflection_features(energy, OFFSETS, FREQUENCY, 0.25, (0.1, 0.35))
    step = FREQUENCY[1] - FREQUENCY[0]
    assert found.distance[0] == pytest.approx(0.2)
    assert found.second[0] == pytest.approx(10 * np.log10(1 / 4))
    assert found.shift[0] == pytest.approx(-step)
    assert found.bandwidth[0] == pytest.approx(2 * step)
    assert found.level[0] == pytest.approx(10 * np.log10(4 / 16))


def test_nothing_to_see_is_finite_and_a_short_profile_is_refused():
    nothing = reflection_features(np.zeros((2, 29, 16)), OFFSETS, FREQUENCY, 0.25, (0.1, 0.35))
    assert all(np.isfinite(values).all() for values in nothing)
    none = reflection_features(np.zeros((0, 29, 16)), OFFSETS, FREQUENCY, 0.25, (0.1, 0.35))
    assert none.level.shape == (0,)
    with pytest.raises(ValueError, match=r"offsets must reach search \+ gate = 0.9 m, got 0.7 m"):
        reflection_features(np.zeros((1, 29, 16)), OFFSETS, FREQUENCY, 0.25, (0.1, 0.65))
