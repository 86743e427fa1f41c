"""Permittivity of soils: mixing models for the complex relative permittivity.

Fields vary as exp(+jωt), so that a loss is a negative imaginary part.
"""

from __future__ import annotations

import math

import numpy as np

from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats

VACUUM_PERMITTIVITY = 8.8541878128e-12
"""Permittivity of vacuum, F/m."""


def mironov(frequency: ArrayLike, clay: float, moisture: float) -> Complex128Array:
    """Return the permittivity ε' - jε'' of a mineral soil with bound and free water.

    The refractive mixing model of Mironov, Kosolapova & Fomin 2009, for 0.045-26.5 GHz, 0-76 % clay
    and 20-22 °C.

    Parameters
    ----------
    frequency : array_like
        Frequencies, Hz.
    clay : float
        Clay by weight, per cent, 0 to 76.
    moisture : float
        Water by volume, m³/m³, 0 to 0.5.

    Returns
    -------
    ndarray of complex
        Relative permittivity, in the shape of ``frequency``.

    Raises
    ------
    ValueError
        If ``clay`` or ``moisture`` is outside the model's range.

    Examples
    --------
    >>> from flgpr.simulate.ground.soil import mironov
    >>> mironov([0.5e9, 1e9, 2.5e9], clay=3, moisture=0.03).round(2)  # dry sand
    array([3.43-0.23j, 3.43-0.21j, 3.42-0.23j])
    """
    _in_range("clay", clay, 0.0, 76.0)
    _in_range("moisture", moisture, 0.0, 0.5)
    f = floats(frequency)
    dry_n = 1.634 - 0.539e-2 * clay + 0.2748e-4 * clay**2
    dry_k = 0.03952 - 0.04038e-2 * clay
    # Up to this moisture the clay binds all water.
    bound_limit = 0.02863 + 0.30673e-2 * clay
    bound_static = 79.8 - 85.4e-2 * clay + 32.7e-4 * clay**2
    bound_relaxation = 1.062e-11 + 3.45e-14 * clay
    bound_conductivity = 0.3112 + 0.467e-2 * clay
    bound = _water_index(f, bound_static, bound_relaxation, bound_conductivity)
    free_conductivity = 0.3631 + 1.217e-2 * clay
    free = _water_index(f, 100.0, 8.5e-12, free_conductivity)
    dry = dry_n - 1j * dry_k
    bound_moisture = min(moisture, bound_limit)
    free_moisture = max(moisture - bound_limit, 0.0)
    index = dry + (bound - 1) * bound_moisture + (free - 1) * free_moisture
    return index**2


def _water_index(
    f: FloatArray, static: float, relaxation: float, conductivity: float
) -> Complex128Array:
    """Return the refractive index n - jk of soil water: a Debye relaxation and ohmic loss."""
    omega = 2 * np.pi * f
    debye = 4.9 + (static - 4.9) / (1 + 1j * omega * relaxation)
    return np.sqrt(debye - 1j * conductivity / (omega * VACUUM_PERMITTIVITY))


def topp(moisture: float, loss_tangent: float = 0.05) -> complex:
    """Return a soil's permittivity from its moisture alone (Topp, Davis & Annan 1980).

    Parameters
    ----------
    moisture : float
        Water by volume, m³/m³, 0 to 0.55.
    loss_tangent : float
        Loss, which the model does not give: the default is assumed.

    Raises
    ------
    ValueError
        If ``moisture`` is outside the model's range.
    """
    _in_range("moisture", moisture, 0.0, 0.55)
    real = 3.03 + 9.3 * moisture + 146.0 * moisture**2 - 76.7 * moisture**3
    return complex(real, -real * loss_tangent)


def peplinski(
    frequency: ArrayLike, sand: float, clay: float, moisture: float, bulk_density: float = 1.5
) -> Complex128Array:
    """Return a soil's permittivity by the semi-empirical model of Peplinski, Ulaby & Dobson 1995.

    It holds from 0.3 to 1.3 GHz. Its effective conductivity turns negative for sand with little
    clay; there the loss is clipped at zero and the model should not be used.

    Parameters
    ----------
    frequency : array_like
        Frequencies, Hz.
    sand, clay : float
        By weight, per cent, together at most 100.
    moisture : float
        Water by volume, m³/m³, 0 to 0.55.
    bulk_density : float
        Of the dry soil, g/cm³.

    Returns
    -------
    ndarray of complex
        Relative permittivity, in the shape of ``frequency``.

    Raises
    ------
    ValueError
        If ``sand``, ``clay`` or ``moisture`` is outside its range.
    """
    _in_range("sand", sand, 0.0, 100.0)
    _in_range("clay", clay, 0.0, 100.0 - sand)
    _in_range("moisture", moisture, 0.0, 0.55)
    f = floats(frequency)
    grain = 2.66  # density of the solids, g/cm³
    alpha = 0.65
    s = sand / 100
    c = clay / 100
    mineral = (1.01 + 0.44 * grain) ** 2 - 0.062  # permittivity of the solids
    beta_real = 1.2748 - 0.519 * s - 0.152 * c
    beta_imag = 1.33797 - 0.603 * s - 0.166 * c

    # Free water after Debye, with 80.1 at rest, 4.9 at high frequency, and 0.58e-10 s for 2πτ.
    omega = 2 * np.pi * f
    relaxation = 0.58e-10 / (2 * np.pi)
    water_real = 4.9 + (80.1 - 4.9) / (1 + (omega * relaxation) ** 2)

    solids = bulk_density / grain * (mineral**alpha - 1)
    wet = moisture**beta_real * water_real**alpha
    real = (1 + solids + wet - moisture) ** (1 / alpha)
    # The linear adjustment of the paper to 0.3-1.3 GHz.
    real = 1.15 * real - 0.68
    if moisture == 0:
        return real + 0j
    debye_loss = omega * relaxation * (80.1 - 4.9) / (1 + (omega * relaxation) ** 2)
    conductivity = peplinski_conductivity(sand, clay, bulk_density)
    ohmic = conductivity * (grain - bulk_density) / (omega * VACUUM_PERMITTIVITY * grain * moisture)
    water_loss = np.maximum(debye_loss + ohmic, 0.0)
    return real - 1j * (moisture**beta_imag * water_loss**alpha) ** (1 / alpha)


def peplinski_conductivity(sand: float, clay: float, bulk_density: float = 1.5) -> float:
    """Return the effective conductivity of the soil solution, S/m, below 1.3 GHz.

    It is negative for arid sand (Peplinski, Ulaby & Dobson 1995). Sand and clay are by weight, per
    cent, the bulk density in g/cm³.
    """
    return 0.0467 + 0.2204 * bulk_density - 0.4111 * sand / 100 + 0.6614 * clay / 100


def fixed(
    frequency: ArrayLike, permittivity: float, loss_tangent: float, conductivity: float
) -> Complex128Array:
    """Return the permittivity for a given ε', loss tangent and ohmic conductivity.

    Parameters
    ----------
    frequency : array_like
        Frequencies, Hz.
    permittivity, loss_tangent : float
        ε' and tanδ, the same at all frequencies.
    conductivity : float
        Ohmic conductivity, S/m.
    """
    f = floats(frequency)
    loss = permittivity * loss_tangent + conductivity / (2 * np.pi * f * VACUUM_PERMITTIVITY)
    return np.asarray(permittivity - 1j * loss)


def one_way_loss(frequency: float, permittivity: complex) -> float:
    """Return the attenuation of a plane wave in a medium, dB/m.

    It is about 91·f_GHz·sqrt(ε')·tanδ for small losses.
    """
    wavenumber = 2 * math.pi * frequency / 299_792_458.0
    return float(20 * math.log10(math.e) * wavenumber * abs(np.sqrt(complex(permittivity)).imag))


def _in_range(name: str, value: float, low: float, high: float) -> None:
    """Raise a ValueError if a parameter lies outside its range."""
    if not low <= value <= high:
        raise ValueError(f"{name} must lie between {low:g} and {high:g}, got {value!r}")
