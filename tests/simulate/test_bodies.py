import numpy as np
import pytest

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.bodies import (
    cylinder,
    floor_vertical,
    layered_reflection,
    rim_amplitude,
    visible_rims,
    wedge_coefficients,
)
from flgpr.simulate.refraction import two_way_transmission

SINE_AIR = np.sin(np.radians(67.0))


def physical_optics_flash(a, k, sine):
    """σ_PO of one edge of a disc: (4πA²/λ²)·cos²θ·(2/x)²·(2/πx)/4, x = 2ka·sinθ."""
    x, area, wavelength = 2 * k * a * sine, np.pi * a**2, 2 * np.pi / k
    return 4 * np.pi * area**2 / wavelength**2 * (1 - sine**2) * (2 / x) ** 2 * (2 / (np.pi * x)) / 4


@pytest.mark.parametrize(("near", "hh", "vv"), [(True, 4.7, -0.6), (False, -6.8, 1.9)])
def test_edge_strength_over_physical_optics_at_the_checked_angle(near, hh, vv):
    """ε = 3.2, θ = 67°: HH lead +4.7, trail -6.8; VV lead -0.6, trail +1.9 dB.

    The checked figures are relative to the physical-optics disc without its obliquity factor cos²θ_t (1.3 dB).
    """
    sine = SINE_AIR / np.sqrt(3.2)
    k = 2 * np.pi * 1.05e9 / SPEED_OF_LIGHT * np.sqrt(3.2)
    rim = next(r for r in visible_rims(cylinder(0.16, 0.15), sine) if r.near == near and r.drop == 0)
    size = np.abs(rim_amplitude(rim, k, sine))
    optics = physical_optics_flash(0.16, k, sine) / (1 - sine**2)
    for coefficient, want in ((rim.h, hh), (rim.v, vv)):
        sigma = 4 * np.pi * (size * coefficient) ** 2
        assert 10 * np.log10(sigma / optics) == pytest.approx(want, abs=0.1)


def test_a_flush_metal_mine_at_l_band():
    """Physical optics times the two-way transmission of HH: about -27 dBsm at 1.05 GHz, 12 m ahead."""
    k = 2 * np.pi * 1.05e9 / SPEED_OF_LIGHT * np.sqrt(3.2)
    sigma = (
        physical_optics_flash(0.16, k, SINE_AIR / np.sqrt(3.2)) * np.abs(two_way_transmission(SINE_AIR, 3.2)[0]) ** 2
    )
    assert 10 * np.log10(sigma) == pytest.approx(-27, abs=0.7)


def test_a_right_angle_seen_along_its_bisector_answers_alike_from_both_sides():
    soft, hard = wedge_coefficients(np.pi / 4, 1.5 * np.pi)
    other = wedge_coefficients(1.5 * np.pi - np.pi / 4, 1.5 * np.pi)
    np.testing.assert_allclose((soft, hard), other, rtol=1e-12)


def test_a_thin_plate_is_keller_s_half_plane():
    """n = 2: D_s,h = ½·(-1 ∓ 1/(-cosφ))."""
    for angle in (0.4, 1.0, 2.0):
        soft, hard = wedge_coefficients(angle, 2 * np.pi)
        np.testing.assert_allclose((soft, hard), (0.5 * (-1 + 1 / np.cos(angle)), 0.5 * (-1 - 1 / np.cos(angle))))


def test_slab_reflection_is_the_closed_form():
    k, eps = 2 * np.pi * 1e9 / SPEED_OF_LIGHT, 2.9
    q = k * np.sqrt(eps - SINE_AIR**2)
    top = (np.sqrt(3.4 - SINE_AIR**2) - np.sqrt(eps - SINE_AIR**2)) / (
        np.sqrt(3.4 - SINE_AIR**2) + np.sqrt(eps - SINE_AIR**2)
    )
    want = top * (1 - np.exp(-2j * q * 0.15)) / (1 - top**2 * np.exp(-2j * q * 0.15))
    got = layered_reflection(SINE_AIR, k, [3.4, eps, 3.4], [0.15])[0]
    assert got == pytest.approx(want, abs=1e-12)


def test_an_air_gap_rules_a_plastic_mine_in_dry_sand():
    """With 1.5 cm of air about 12 dB below metal on the mean over L band; a simulant without it is weaker still."""
    k = 2 * np.pi * np.linspace(0.75e9, 1.35e9, 61) / SPEED_OF_LIGHT
    soil, body = np.full(k.size, 3.4), np.full(k.size, 2.9)
    gap = layered_reflection(SINE_AIR, k, [soil, np.ones(k.size), body, soil], [0.015, 0.135])[0]
    solid = layered_reflection(SINE_AIR, k, [soil, body, soil], [0.15])[0]
    with_gap, without = (20 * np.log10(np.sqrt(np.mean(np.abs(r) ** 2))) for r in (gap, solid))
    assert with_gap == pytest.approx(-12, abs=4)
    assert without < with_gap - 3


def test_v_never_falls_under_its_floor():
    h, v = np.array([0.5 + 0j, 0.5]), np.array([0j, 0.4j])
    got = floor_vertical(h, v)
    assert np.abs(got[0]) == pytest.approx(0.5 * 10 ** (-15 / 20))
    assert got[1] == v[1]
