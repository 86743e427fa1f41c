import numpy as np
import pytest

from flgpr.formats.impulse import impulse_to_frequency

CARRIER = 1e9
RATE = 32e6  # samples a second
FREQUENCY = CARRIER + 1e6 * np.arange(-16, 16)
DELAY = 17e-9 + np.arange(32) / RATE


def baseband(tau):
    """Return samples of an echo at a delay, as a receiver records that mixes the carrier to zero."""
    spectrum = np.exp(-2j * np.pi * FREQUENCY * tau)
    turns = np.exp(2j * np.pi * np.outer(DELAY, FREQUENCY - CARRIER))
    return turns @ spectrum / FREQUENCY.size


@pytest.mark.parametrize("tau", [0.0, 120e-9, 333e-9])
def test_samples_at_baseband_become_the_tones_about_the_carrier(tau):
    signal, tones = impulse_to_frequency(baseband(tau), DELAY, (0.985e9, 1.015e9), carrier=CARRIER)
    np.testing.assert_allclose(tones, 1e9 + 1e6 * np.arange(-15, 16))
    np.testing.assert_allclose(signal, np.exp(-2j * np.pi * tones * tau), atol=1e-9)


def test_padding_makes_the_tones_about_a_carrier_denser():
    _, tones = impulse_to_frequency(baseband(0.0), DELAY, (0.99e9, 1.01e9), 2, CARRIER)
    np.testing.assert_allclose(tones, 0.99e9 + 0.5e6 * np.arange(41))


@pytest.mark.parametrize(
    ("samples", "band", "rule"),
    [
        (baseband(0.0), (0.98e9, 1.01e9), "band must lie between 9.84e.08 and 1.016e.09 Hz"),
        (baseband(0.0), (0.99e9, 1.02e9), "band must lie between 9.84e.08 and 1.016e.09 Hz"),
        (baseband(0.0).real, (0.99e9, 1.01e9), "carrier is for complex samples"),
    ],
)
def test_what_the_samples_do_not_hold_is_refused(samples, band, rule):
    with pytest.raises(ValueError, match=rule):
        impulse_to_frequency(samples, DELAY, band, carrier=CARRIER)
