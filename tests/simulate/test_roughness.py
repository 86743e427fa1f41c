import numpy as np
import pytest
from scipy.integrate import quad

from flgpr.simulate.ground.roughness import (
    UNEVEN_LENGTH,
    HeightField,
    surface_backscatter,
    uneven_height,
)
from flgpr.simulate.scene.scene import Scene

SINE = np.sin(np.radians(67.0))


@pytest.mark.parametrize(
    ("frequency", "hh", "vv"), [(1.05e9, -41, -33), (2.55e9, -36, -28), (9.4e9, -30, -22)]
)
def test_backscatter_at_the_reference_levels(frequency, hh, vv):
    """θ = 67°, ε = 3.4, s = 5 mm, l = 5 cm; the larger scale adds little."""
    single = 10 * np.log10(surface_backscatter(frequency, SINE, 3.4, 0.005, 0.05))
    tilted = 10 * np.log10(surface_backscatter(frequency, SINE, 3.4, 0.005, 0.05, np.radians(5)))
    np.testing.assert_allclose(single, [hh, vv], atol=0.5)
    assert (tilted - single > 0).all()
    assert (tilted - single < 1.0).all()


def test_backscatter_grows_as_k4_for_short_and_as_k_for_long_correlation():
    def exponent(length, f):
        a, b = (surface_backscatter(x, SINE, 3.4, 0.001, length)[0] for x in (f, 1.01 * f))
        return np.log(b / a) / np.log(1.01)

    assert exponent(0.001, 0.3e9) == pytest.approx(4, abs=0.05)
    assert exponent(1.0, 5e9) == pytest.approx(1, abs=0.05)


@pytest.mark.slow("repeats a draw until its statistics stand")
def test_heights_have_their_rms_and_exponential_correlation():
    grid = np.linspace(0, 30, 40)
    x, y = np.meshgrid(grid, grid)
    covariance = {0.0: [], 0.05: [], 0.1: []}
    for seed in range(30):
        surface = HeightField(0.01, 0.1, np.random.default_rng(seed))
        here = surface(x, y)
        for lag in covariance:
            covariance[lag].append(np.mean(here * (surface(x + lag, y) if lag else here)))
    for lag, values in covariance.items():
        error = 3 * np.std(values) / np.sqrt(len(values))
        assert np.mean(values) == pytest.approx(1e-4 * np.exp(-lag / 0.1), abs=error + 2e-6)


def profile_density(unevenness, waviness, cycles):
    """One-sided spectrum of a profile, m³: the isotropic spectrum integrated across the profile's direction."""
    hurst = (waviness - 1) / 2
    k = 2 * np.pi * cycles
    power = 4 * np.pi * hurst * uneven_height(unevenness, waviness) ** 2 * UNEVEN_LENGTH**2
    isotropic = lambda across: power * (1 + (k**2 + across**2) * UNEVEN_LENGTH**2) ** -(1 + hurst)  # noqa: E731
    return 4 * np.pi * 2 * quad(isotropic, 0, np.inf)[0] / (2 * np.pi) ** 2


@pytest.mark.parametrize("waviness", [1.6, 2.0, 2.5])
def test_uneven_ground_has_the_profile_of_iso_8608(waviness):
    """G(n) = G0·(n/0.1)^-w over the wavelengths that scatter, 10 to 50 cm."""
    for cycles in (2.0, 4.0, 10.0):
        want = 1024e-6 * (cycles / 0.1) ** -waviness
        assert profile_density(1024e-6, waviness, cycles) == pytest.approx(want, rel=0.05)


def test_backscatter_without_unevenness_is_that_of_exponential_correlation():
    f = np.array([0.44e9, 1.05e9, 2.55e9])
    s = 0.005
    length = 0.05
    k = 2 * np.pi * f / 299_792_458.0
    cosine = np.sqrt(1 - SINE**2)
    alpha = 2.4 / (cosine + np.sqrt(3.4 - SINE**2)) ** 2
    closed = (
        8
        * k**4
        * s**2
        * cosine**4
        * alpha**2
        * length**2
        * (1 + (2 * k * length * SINE) ** 2) ** -1.5
    )
    np.testing.assert_allclose(surface_backscatter(f, SINE, 3.4, s, length)[0], closed, rtol=1e-12)
    np.testing.assert_allclose(
        surface_backscatter(f, SINE, 3.4, s, length, waviness=2.7)[0], closed, rtol=1e-12
    )


@pytest.mark.parametrize("waviness", [1.5, 2.0, 2.5])
def test_uneven_ground_scatters_as_f_to_the_3_minus_w(waviness):
    """A short part alone grows as f⁴ where its correlation length is short; the uneven part is added to it."""

    def exponent(rms, unevenness):
        a, b = (
            surface_backscatter(f, SINE, 3.4, rms, 0.001, 0.0, unevenness, waviness)[1]
            for f in (1e9, 1.01e9)
        )
        return np.log(b / a) / np.log(1.01)

    assert exponent(0.0, 1e-3) == pytest.approx(3 - waviness, abs=0.02)
    assert exponent(0.005, 0.0) == pytest.approx(4, abs=0.02)
    parts = [
        surface_backscatter(1e9, SINE, 3.4, *part)[0]
        for part in ((0.005, 0.05), (0.0, 0.05, 0.0, 1e-3))
    ]
    both = surface_backscatter(1e9, SINE, 3.4, 0.005, 0.05, 0.0, 1e-3)[0]
    assert both == pytest.approx(sum(parts), rel=1e-12)


@pytest.mark.slow("repeats a draw until its statistics stand")
def test_uneven_heights_hold_both_parts():
    """Variance and covariance of the sum at waviness 2, both parts then exponential."""
    grid = np.linspace(0, 60, 30)
    x, y = np.meshgrid(grid, grid)
    long = uneven_height(1024e-6)
    covariance = {0.0: [], 0.1: [], 0.5: []}
    for seed in range(40):
        surface = HeightField(0.005, 0.05, np.random.default_rng(seed), unevenness=1024e-6)
        here = surface(x, y)
        for lag in covariance:
            covariance[lag].append(np.mean(here * (surface(x + lag, y) if lag else here)))
    for lag, values in covariance.items():
        want = 0.005**2 * np.exp(-lag / 0.05) + long**2 * np.exp(-lag / UNEVEN_LENGTH)
        error = 3 * np.std(values) / np.sqrt(len(values))
        assert np.mean(values) == pytest.approx(want, abs=error + 2e-6)
    assert long == pytest.approx(
        np.sqrt(np.pi**2 * 1024e-8 * UNEVEN_LENGTH), rel=1e-9
    )  # s²/l = π²·n0²·G0 at w = 2


def test_a_scene_without_a_site_has_no_unevenness():
    assert Scene().surface.unevenness == 0


@pytest.mark.parametrize(
    ("unevenness", "waviness", "told"), [(-1e-6, 2.0, "unevenness"), (1e-3, 3.0, "waviness")]
)
def test_impossible_unevenness_is_refused(unevenness, waviness, told):
    with pytest.raises(ValueError, match=f"{told} must .*got"):
        uneven_height(unevenness, waviness)
