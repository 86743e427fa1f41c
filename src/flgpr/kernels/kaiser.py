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
from numpy.typing import NDArray
from scipy.special import i0e

FloatArray = NDArray[np.float64]

MAX_WIDTH = 16


@dataclass(frozen=True)
class Window:
    """A Kaiser-Bessel window over ``width`` of ``size`` bins, a power of two, and its error."""

    width: int
    beta: float
    size: int
    error: float


def transform(width: int, beta: float, frequency: FloatArray) -> FloatArray:
    """Return the Fourier transform of the window at ``frequency`` in cycles per bin."""
    argument = beta**2 - (math.pi * width * frequency) ** 2
    root = np.sqrt(np.abs(argument))
    safe = np.where(root < 1e-6, 1.0, root)
    # The window is one at its centre; I0(beta) and sinh are both scaled by exp(-beta) to stay in
    # range.
    grow = np.exp(np.where(argument > 0, safe, 0.0) - beta)
    wide = (grow - np.exp(-2 * beta) / np.maximum(grow, 1e-300)) / 2
    value = np.where(argument > 0, wide, np.sin(safe) * np.exp(-beta)) / safe
    return np.asarray(
        width * np.where(root < 1e-6, np.exp(-beta), value) / i0e(beta), dtype=np.float64
    )


def tone_errors(width: int, beta: float, frequency: FloatArray) -> FloatArray:
    """Return the relative interpolation error of tones at ``frequency`` cycles per bin.

    It is the root of the summed squared aliases.
    """
    aliases = np.concatenate([np.arange(-40, 0), np.arange(1, 41)])
    power = (transform(width, beta, frequency[:, None] + aliases) ** 2).sum(axis=1)
    return np.asarray(np.sqrt(power) / np.abs(transform(width, beta, frequency)), dtype=np.float64)


@lru_cache(maxsize=256)
def best_shape(width: int, oversampling: float) -> tuple[float, float]:
    """Return the shape of the window with the least worst error, and that error.

    It holds for tones up to ``0.5/oversampling`` cycles per bin.
    """
    edge = np.linspace(0, 0.5 / oversampling, 9)
    guess = math.pi * width * (1 - 0.5 / oversampling)
    shapes = guess * np.linspace(0.8, 1.02, 45)
    errors = [float(tone_errors(width, beta, edge).max()) for beta in shapes]
    best = int(np.argmin(errors))
    return float(shapes[best]), errors[best]


def design(tones: int, tolerance: float, pixels: float = 1e5) -> Window:
    """Return the cheapest window that images all of ``tones`` neighbouring tones to a tolerance.

    ``pixels`` counts the values that are interpolated in each profile: it decides between a wide
    window on short profiles and a narrow one on long profiles.
    """
    if tolerance < 1e-13:
        raise ValueError(f"tolerance must be at least 1e-13, got {tolerance:g}")
    shortest = 1 << max(5, math.ceil(math.log2(1.25 * tones)))
    candidates: list[tuple[float, Window]] = []
    for size in (shortest, 2 * shortest, 4 * shortest, 8 * shortest):
        for width in range(2, MAX_WIDTH + 1):
            beta, error = best_shape(width, math.floor(1000 * size / tones) / 1000)
            if error <= tolerance:
                cost = pixels * (10 + 1.5 * width) + 5 * size * math.log2(size)
                candidates.append((cost, Window(width, beta, size, error)))
                break
    return min(candidates, key=lambda item: item[0])[1]


@lru_cache(maxsize=256)
def polynomials(window: Window, degree: int) -> FloatArray:
    """Return the weights of the taps as polynomials in the fraction of a bin less one half.

    Returns (width, degree + 1), lowest power first. Tap ``a`` weighs the bin ``a`` after the first
    one covered; the weight of tap ``width - 1 - a`` is that of tap ``a`` with the argument's sign
    changed.
    """
    nodes = np.cos(np.pi * (np.arange(4 * degree) + 0.5) / (4 * degree)) / 2
    distance = np.arange(window.width)[:, None] - window.width / 2 + 0.5 - nodes
    shape = np.sqrt(np.clip(1 - (2 * distance / window.width) ** 2, 0, None))
    values = np.i0(window.beta * shape) / np.i0(window.beta)
    fit = np.polynomial.chebyshev.chebfit(2 * nodes, values.T, degree)
    power = np.zeros((window.width, degree + 1))
    for row, column in zip(power, fit.T, strict=True):
        terms = np.polynomial.chebyshev.cheb2poly(column)
        row[: terms.size] = terms
    return np.asarray(power * 2.0 ** np.arange(degree + 1), dtype=np.float64)
