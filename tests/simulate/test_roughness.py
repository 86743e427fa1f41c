import numpy as np
import pytest

from flgpr.simulate.roughness import HeightField, surface_backscatter

SINE = np.sin(np.radians(67.0))


@pytest.mark.parametrize(("frequency", "hh", "vv"), [(1.05e9, -41, -33), (2.55e9, -36, -28), (9.4e9, -30, -22)])
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


def test_heights_have_their_rms_and_exponential_correlation():
    grid = np.linspace(0, 30, 60)
    x, y = np.meshgrid(grid, grid)
    covariance = {0.0: [], 0.05: [], 0.1: []}
    for seed in range(30):
        surface = HeightField(0.01, 0.1, np.random.default_rng(seed))
        here = surface(x, y)
        for lag in covariance:
            covariance[lag].append(np.mean(here * surface(x + lag, y)))
    for lag, values in covariance.items():
        error = 3 * np.std(values) / np.sqrt(len(values))
        assert np.mean(values) == pytest.approx(1e-4 * np.exp(-lag / 0.1), abs=error + 2e-6)
