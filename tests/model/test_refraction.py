import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import jv

from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.refraction import (
    apparent_shift,
    interface_path,
    ray_divergence,
    reflection,
    refracted_ray,
    two_way_attenuation,
    two_way_transmission,
)

HEIGHT = 5.0


def fermat(x, h, d, eps):
    """Least optical path over the point of entry, by plain minimisation."""
    path = lambda q: np.hypot(h, x - q) + np.sqrt(eps) * np.hypot(d, q)  # noqa: E731
    return minimize_scalar(path, bounds=(0, x), method="bounded", options={"xatol": 1e-12}).fun


@pytest.mark.parametrize("eps", [1.5, 3.4, 10.7])
@pytest.mark.parametrize("depth", [0.005, 0.1, 0.5])
def test_path_is_fermat_s(eps, depth):
    for x in (0.3, 7.0, 26.0):
        assert refracted_ray(x, HEIGHT, [depth], [eps]).path == pytest.approx(
            fermat(x, HEIGHT, depth, eps), abs=1e-7
        )


def test_two_layers_of_one_soil_are_one():
    one = refracted_ray(12.0, HEIGHT, [0.15], [4.0])
    two = refracted_ray(12.0, HEIGHT, [0.05, 0.1], [4.0, 4.0])
    np.testing.assert_allclose(one, two, atol=1e-10)


@pytest.mark.parametrize(
    ("eps", "shifts"), [(3.4, {7: 0.20, 12: 0.17, 26: 0.16}), (10.7, {7: 0.39, 12: 0.34, 26: 0.32})]
)
def test_a_buried_point_appears_beyond_its_place(eps, shifts):
    """The surface point of equal path, against the closed form and the checked figures, d = 10 cm, H = 5 m."""
    for x, want in shifts.items():
        path = refracted_ray(float(x), HEIGHT, [0.1], [eps]).path
        seen = np.sqrt(path**2 - HEIGHT**2) - x
        sine = x / np.hypot(x, HEIGHT)
        assert seen == pytest.approx(want, abs=0.0075)
        assert apparent_shift(0.1, eps, sine) == pytest.approx(seen, rel=0.03)


@pytest.mark.parametrize(("x", "hh", "vv"), [(7, -2.3, -0.1), (12, -4.1, -0.1), (26, -8.3, -1.7)])
def test_two_way_transmission_at_the_checked_points(x, hh, vv):
    got = two_way_transmission(x / np.hypot(x, HEIGHT), 3.4)
    assert 20 * np.log10(np.abs(got[0])) == pytest.approx(hh, abs=0.1)
    assert 20 * np.log10(np.abs(got[1])) == pytest.approx(vv, abs=0.1)


def test_brewster_s_angle_passes_all_of_v():
    sine = np.sqrt(3.4 / 4.4)
    assert abs(reflection(sine, 1.0, 3.4)[1]) < 1e-12


def test_transmission_with_divergence_is_reciprocal():
    """t12·t21·cosθ/(n·cosθt) = t12², t12 of the field."""
    sine = 0.9
    eps = 6.0
    q1 = np.sqrt(1 - sine**2)
    q2 = np.sqrt(eps - sine**2)
    t_h = 2 * q1 / (q1 + q2)
    t_v = 2 * np.sqrt(eps) * q1 / (eps * q1 + q2)
    both = [t * ray_divergence(sine, eps) for t in two_way_transmission(sine, eps)]
    np.testing.assert_allclose(np.abs(both), [t_h**2, t_v**2], rtol=1e-12)


def field_above(eps, depth, x, z, k0, upright):
    """Field in air of a dipole in the ground, by Sommerfeld's integral, over that of the same dipole in air, far off.

    Horizontal and seen from its side (H), or upright (its vertical field). Angles first, then evanescent waves.
    """
    n = 40_000
    angle = (np.arange(n) + 0.5) / n * np.pi / 2
    decay = (np.arange(n) + 0.5) / n * 2.0
    total = 0j
    for kr, step in (
        (k0 * np.sin(angle), k0 * np.cos(angle) * np.pi / 2 / n),
        (k0 * np.cosh(decay), k0 * np.sinh(decay) * 2 / n),
    ):
        q1, q2 = (np.sqrt(e * k0**2 - kr**2 + 0j) for e in (1.0, eps))
        q1, q2 = (np.where(q.imag > 0, -q, q) for q in (q1, q2))
        wave = kr * step * np.exp(-1j * q1 * z - 1j * q2 * depth)
        if upright:
            total += np.sum(wave * kr**2 / k0**2 * 2 / (eps * q1 + q2) * jv(0, kr * x))
        else:
            zero = jv(0, kr * x)
            one = jv(1, kr * x) / (kr * x)
            total += np.sum(
                wave * 2 * ((zero - one) / (q1 + q2) + one * q1 * q2 / (eps * q1 + q2) / k0**2)
            )
    return -1j * total


@pytest.mark.parametrize("eps", [2.0, 3.43, 5.93 - 0.58j, 10.7])
@pytest.mark.parametrize("depth", [0.01, 0.15])
def test_a_wave_leaves_the_ground_with_t12_not_t21(eps, depth):
    """Exact field 12 m away and 5 m up at 1.05 GHz: the plane wave's t21 alone would be 10 to 18 dB more."""
    k0 = 2 * np.pi * 1.05e9 / SPEED_OF_LIGHT
    sine, entry = refracted_ray(12.0, HEIGHT, [depth], [np.real(eps)])[1:]
    both = [t * ray_divergence(sine, eps) for t in two_way_transmission(sine, eps)]
    lost = np.exp(-k0 * depth * abs(np.sqrt(eps - sine**2 + 0j).imag))
    far = np.hypot(12.0 - entry, HEIGHT)
    # The upright dipole takes the vertical part of the field in the soil and radiates sinθ of it
    # upright.
    for upright, t12, part in (
        (False, np.sqrt(both[0]), 1.0),
        (True, np.sqrt(both[1]), sine**2 / np.sqrt(eps)),
    ):
        exact = abs(field_above(eps, depth, 12.0, HEIGHT, k0, upright)) * far
        assert 20 * np.log10(exact / abs(t12 * part * lost)) == pytest.approx(0, abs=0.1)


def test_x_band_is_nearly_blind_in_mironov_sand_and_not_in_dry_sand():
    """Two-way at 5 cm, 9.4 GHz: about 20 dB against 0.9 dB for tanδ = 0.005."""
    from flgpr.simulate.ground.soil import mironov

    k = 2 * np.pi * 9.4e9 / SPEED_OF_LIGHT
    sine = 0.92
    sand = -20 * np.log10(two_way_attenuation(0.05, k, sine, mironov(9.4e9, 3.0, 0.03).item()))
    dry = -20 * np.log10(two_way_attenuation(0.05, k, sine, 3.4 * (1 - 0.005j)))
    assert sand == pytest.approx(20, abs=3)
    assert dry == pytest.approx(0.9, abs=0.1)


def test_rough_interface_phase_at_x_band():
    """About 2.5 rad² per pass at 9.4 GHz for s = 7 mm."""
    k = 2 * np.pi * 9.4e9 / SPEED_OF_LIGHT
    assert (k * 0.007 * interface_path(0.92, 3.4)) ** 2 == pytest.approx(2.5, rel=0.15)


def test_bad_geometry_is_refused():
    with pytest.raises(ValueError, match="height"):
        refracted_ray(5.0, 0.0, [0.1], [3.0])
    with pytest.raises(ValueError, match="permittivity"):
        refracted_ray(5.0, 1.0, [0.1], [0.5])
