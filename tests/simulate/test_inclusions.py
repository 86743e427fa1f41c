"""Scattering by single bodies in the soil, in the limits of small and large."""

import numpy as np
import pytest
from scipy.integrate import quad

from flgpr.simulate.ground import inclusions


def test_a_stone_is_a_dipole_when_small_and_optical_when_large():
    k = 20.0
    es = 4.0
    er = 7.0
    amplitude, _ = inclusions.stone([0.002, 3.0], er, es, k)
    dipole = k**2 * es * 0.002**3 * (er - es) / (er + 2 * es)
    assert amplitude[0] ** 2 == pytest.approx(4 * np.pi * dipole**2, rel=0.01)
    face = (np.sqrt(er) - np.sqrt(es)) / (np.sqrt(er) + np.sqrt(es))
    assert amplitude[1] ** 2 == pytest.approx(np.pi * 3.0**2 * face**2, rel=0.01)
    assert inclusions.stone(0.03, es, es, k)[0] == 0  # a stone like its soil is not there
    assert inclusions.stone(0.03, 3.0, es, k)[0] < 0


def test_spheroids_have_the_polarizability_of_their_limits():
    along, across = inclusions.spheroid([1.0, 1.0005, 1e-4, 200.0], 6.0, 3.0)
    np.testing.assert_allclose(along[:2], 1, atol=1e-3)
    np.testing.assert_allclose(across[:2], 1, atol=1e-3)
    sphere = (6 + 2 * 3) / 3
    assert along[2] == pytest.approx(sphere / 6, rel=1e-3)  # a flat disc hides its inside: N = 1
    assert across[2] == pytest.approx(sphere / 3, rel=1e-3)
    assert along[3] == pytest.approx(sphere / 3, rel=1e-3)  # a needle: N = 0
    assert across[3] == pytest.approx(sphere / 4.5, rel=1e-3)  # N = 1/2
    prolate, _ = inclusions.spheroid(2.0, 6.0, 3.0)
    assert sphere / prolate - 3 == pytest.approx(
        0.1736 * 3, rel=1e-3
    )  # tabulated depolarization factor of 2:1


def test_the_spectrum_of_the_uneven_soil_is_that_of_its_correlation():
    """Along one axis of isotropic soil the transform is 4π/K·∫ C(r)·r·sin(Kr) dr."""
    k = 12.0
    s = 0.9
    length = 0.03
    deviation = 0.4
    soil = 4.0
    wave = 2 * k * np.sqrt(soil)
    integral = quad(lambda r: r * np.exp(-r / length), 0, np.inf, weight="sin", wvar=wave)[0]
    want = k**4 / (4 * np.pi) * deviation**2 * 4 * np.pi / wave * integral
    got = inclusions.volume_backscatter(k, s, soil, deviation, length, length)
    assert got == pytest.approx(want, rel=1e-3)
