import numpy as np
import pytest

from flgpr.kernels.kaiser import best_shape, design_window, polynomials, tone_errors, transform
from flgpr.kernels.profiles import polynomial_degree


def kaiser_bessel(width, beta, distance):
    inside = np.abs(distance) <= width / 2
    return (
        inside
        * np.i0(beta * np.sqrt(np.clip(1 - (2 * distance / width) ** 2, 0, None)))
        / np.i0(beta)
    )


@pytest.mark.parametrize("width", [2, 3, 4, 5, 8, 13])
def test_transform_is_the_fourier_integral_of_the_window(width):
    beta = 2.3 * width
    frequency = np.linspace(0, 1.7, 12)
    distance = np.linspace(-width / 2, width / 2, 20001)
    value = kaiser_bessel(width, beta, distance)
    integral = np.trapezoid(
        value * np.cos(2 * np.pi * frequency[:, None] * distance), distance, axis=1
    )
    assert transform(width, beta, frequency) == pytest.approx(integral, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("width", [2, 3, 4, 5, 6, 7, 8])
def test_polynomials_are_the_window_to_single_precision(width):
    window = design_window(1000, best_shape(width, 2.048)[1] * 1.001, pixels=1e9)
    fraction = np.linspace(0, 1, 51)
    taps = np.arange(window.width)[:, None] + 1 - window.width / 2 - fraction
    powers = (fraction - 0.5) ** np.arange(polynomial_degree(window.width) + 1)[:, None]
    weights = polynomials(window, polynomial_degree(window.width)) @ powers
    exact = kaiser_bessel(
        window.width, window.beta, np.clip(taps, -window.width / 2, window.width / 2)
    )
    assert np.abs(weights - exact).max() < 0.2 * window.error
    assert weights == pytest.approx(weights[::-1, ::-1], abs=1e-9)


def test_interpolating_a_tone_errs_as_predicted():
    window = design_window(100, 1e-3)
    size = window.size
    width = window.width
    place = 40 / size
    t = np.random.default_rng(1).uniform(20, 30, 4000)
    first = np.ceil(t - width / 2)
    bins = first[:, None] + np.arange(width)
    weights = kaiser_bessel(width, window.beta, bins - t[:, None])
    samples = np.exp(2j * np.pi * place * bins) / transform(width, window.beta, np.array([place]))
    error = np.sqrt(
        np.mean(np.abs((weights * samples).sum(axis=1) - np.exp(2j * np.pi * place * t)) ** 2)
    )
    assert error == pytest.approx(tone_errors(width, window.beta, np.array([place]))[0], rel=0.1)
    assert error <= window.error <= 1e-3


def test_tighter_tolerances_cost_wider_windows():
    widths = [design_window(1000, 10.0**-k).width for k in range(2, 12)]
    assert widths == sorted(widths)
    assert widths[-1] > widths[0] + 5


def test_impossible_tolerance_is_refused():
    with pytest.raises(ValueError, match=r"tolerance must be at least 1e-13, got 1e-15"):
        design_window(1000, 1e-15)
