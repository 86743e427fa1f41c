"""The interpolation window of the profiles: design from a tolerance, polynomial form, transform.

A profile is the band-limited range response sampled at ``size`` bins over the unambiguous range.
Its value between two bins is a weighted sum of ``width`` neighbours with Kaiser-Bessel weights,
after each tone is divided by the window's transform, as in a non-uniform FFT.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import i0e

from flgpr.types import FloatArray

MAX_WIDTH = 16


@dataclass(frozen=True)
class Window:
    """A Kaiser-Bessel window and its error."""

    width: int  #: bins under the window
    beta: float  #: shape
    size: int  #: bins of the unambiguous range, a power of two
    error: float  #: largest relative error of a tone


def transform(width: int, beta: float, frequency: FloatArray) -> FloatArray:
    """Return the Fourier transform of the window (Kaiser & Schafer 1980).

    With r² = β² - (πwf)² it is w/I0(β) · sinh(r)/r, and w/I0(β) · sin(|r|)/|r| where r² < 0.

    Parameters
    ----------
    width : int
        Width w, bins.
    beta : float
        Shape β.
    frequency : ndarray
        Frequency f, cycles per bin.

    Returns
    -------
    ndarray
        Transform, bins, in the shape of the frequency.
    """
    argument = beta**2 - (math.pi * width * frequency) ** 2
    root = np.sqrt(np.abs(argument))
    near_zero = root < 1e-6  # where sinh(r)/r is one
    safe_root = np.where(near_zero, 1.0, root)

    # The window is one at its centre; I0(beta) and sinh are both scaled by exp(-beta) to stay in
    # range.
    grow = np.exp(np.where(argument > 0, safe_root, 0.0) - beta)
    sinh = (grow - np.exp(-2 * beta) / np.maximum(grow, 1e-300)) / 2
    sine = np.sin(safe_root) * np.exp(-beta)
    ratio = np.where(argument > 0, sinh, sine) / safe_root
    ratio = np.where(near_zero, np.exp(-beta), ratio)
    return width * ratio / i0e(beta)


def tone_errors(width: int, beta: float, frequency: FloatArray) -> FloatArray:
    """Return the relative interpolation error of tones at ``frequency`` cycles per bin.

    It is the root of the summed squared aliases, of the 40 nearest on either side.
    """
    aliases = np.concatenate([np.arange(-40, 0), np.arange(1, 41)])
    alias_power = transform(width, beta, frequency[:, None] + aliases) ** 2
    power = alias_power.sum(axis=1)
    tone = np.abs(transform(width, beta, frequency))
    return np.sqrt(power) / tone


@lru_cache(maxsize=256)
def best_shape(width: int, oversampling: float) -> tuple[float, float]:
    """Return the shape of the window with the least worst error, and that error.

    It holds for tones up to ``0.5/oversampling`` cycles per bin. Shapes are searched about the one
    whose main lobe, where r² > 0 in :func:`transform`, ends at the nearest alias of these tones.
    """
    frequency = np.linspace(0, 0.5 / oversampling, 9)
    guess = math.pi * width * (1 - 0.5 / oversampling)
    shapes = guess * np.linspace(0.8, 1.02, 45)
    errors = []
    for beta in shapes:
        worst = tone_errors(width, beta, frequency).max()
        errors.append(float(worst))
    best = int(np.argmin(errors))
    return float(shapes[best]), errors[best]


def design_window(tones: int, tolerance: float, pixels: float = 1e5) -> Window:
    """Return the cheapest window that images neighbouring tones to a tolerance.

    Parameters
    ----------
    tones : int
        Steps of the uniform spectrum from the first to the last tone, both included.
    tolerance : float
        Largest relative error of a tone, at least 1e-13.
    pixels : float
        Values that are interpolated in each profile. Their number decides between a wide window on
        short profiles and a narrow one on long profiles.

    Returns
    -------
    Window
        Window of the least cost in arithmetic.

    Raises
    ------
    ValueError
        If the tolerance is too small for double precision.
    """
    if tolerance < 1e-13:
        raise ValueError(f"tolerance must be at least 1e-13, got {tolerance:g}")
    shortest = 1 << max(5, math.ceil(math.log2(1.25 * tones)))
    candidates: list[tuple[float, Window]] = []
    for size in (shortest, 2 * shortest, 4 * shortest, 8 * shortest):
        # Rounded down to thousandths, so that nearly equal spectra share the stored shapes.
        oversampling = math.floor(1000 * size / tones) / 1000
        for width in range(2, MAX_WIDTH + 1):
            beta, error = best_shape(width, oversampling)
            if error <= tolerance:
                interpolation_cost = pixels * (10 + 1.5 * width)
                transform_cost = 5 * size * math.log2(size)
                window = Window(width, beta, size, error)
                candidates.append((interpolation_cost + transform_cost, window))
                break
    return min(candidates, key=lambda item: item[0])[1]


@lru_cache(maxsize=256)
def polynomials(window: Window, degree: int) -> FloatArray:
    """Return the weights of the taps as polynomials in the fraction of a bin less one half.

    Tap ``a`` weighs the bin ``a`` after the first one covered; the weight of tap ``width - 1 - a``
    is that of tap ``a`` with the argument's sign changed.

    Parameters
    ----------
    window : Window
        Kaiser-Bessel window.
    degree : int
        Degree of the polynomials.

    Returns
    -------
    (width, degree + 1) ndarray
        Coefficients, lowest power first.
    """
    # Chebyshev nodes make the fit nearly the one with the least worst error.
    nodes = np.cos(np.pi * (np.arange(4 * degree) + 0.5) / (4 * degree)) / 2
    distance = np.arange(window.width)[:, None] - window.width / 2 + 0.5 - nodes
    shape = np.sqrt(np.clip(1 - (2 * distance / window.width) ** 2, 0, None))
    values = np.i0(window.beta * shape) / np.i0(window.beta)
    fit = np.polynomial.chebyshev.chebfit(2 * nodes, values.T, degree)

    power = np.zeros((window.width, degree + 1))
    for row, column in zip(power, fit.T, strict=True):
        terms = np.polynomial.chebyshev.cheb2poly(column)
        row[: terms.size] = terms
    # The fit is in twice the fraction, which reaches from -1 to 1.
    return power * 2.0 ** np.arange(degree + 1)
