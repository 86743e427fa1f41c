"""Diffraction at a strip by integrating its Huygens sources over exact distances, without the Fresnel integral."""

import numpy as np
from scipy.integrate import quad


def part_of_the_wave(low, high, before, behind, wavelength):
    """Share of the field that comes through from ``low`` to ``high`` (m) of a line across the ray (Born & Wolf, 8.2).

    ``before`` and ``behind`` are the distances to the source and the receiver, m.
    """
    wavenumber = 2 * np.pi / wavelength

    def excess(x):
        return wavenumber * (np.hypot(before, x) - before + np.hypot(behind, x) - behind)

    width = 1e-3 * np.sqrt(wavelength * before * behind / (before + behind))
    x = np.arange(low, high + width, width)
    value = np.trapezoid(np.exp(-1j * excess(x)), x)
    return value * np.sqrt(1j * (before + behind) / (wavelength * before * behind))


def fresnel(v):
    """``∫_{-∞}^{v} exp(-jπt²/2) dt/(1 - j)`` by quadrature."""
    real = quad(lambda t: np.cos(np.pi * t * t / 2), 0, v, limit=500)[0]
    imaginary = quad(lambda t: np.sin(np.pi * t * t / 2), 0, v, limit=500)[0]
    return 0.5 + (real - 1j * imaginary) / (1 - 1j)
