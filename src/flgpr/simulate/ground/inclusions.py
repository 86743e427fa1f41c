"""Scattering by what lies in the soil: amplitudes in the soil itself, without the way in and out.

An amplitude is the square root of the radar cross section that the body has in an endless soil, m.
It is that at one frequency; its growth with frequency is one of the shapes below. Wavenumbers are
those in air, rad/m.
"""

from __future__ import annotations

import numpy as np

from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats

_FULL = np.sqrt(4 * np.pi)


def stone(
    radius: ArrayLike, body: ArrayLike, soil: ArrayLike, wavenumber: float
) -> tuple[FloatArray, FloatArray]:
    """Return the amplitude of a dielectric sphere in soil, and where it saturates.

    The sphere is a dipole that saturates at the optical cross section. With the sign of the
    contrast the amplitude is ``2√π·f·u²/sqrt(1 + u⁴)`` with the optical
    ``f = a/2·(n - n_s)/(n + n_s)`` and u such that ``f·u²`` is the dipole's
    ``k_s²a³(ε - ε_s)/(ε + 2ε_s)``.

    Parameters
    ----------
    radius : array_like
        Radius a, m.
    body, soil : array_like
        Real permittivities ε of the sphere and ε_s of the soil.
    wavenumber : float
        Wavenumber in air, rad/m.

    Returns
    -------
    amplitude : ndarray
        Amplitude, m.
    corner : ndarray
        Frequency over the given one at which u = 1.
    """
    a = floats(radius)
    er = floats(body)
    es = floats(soil)
    # Contrast of the dipole over the optical one.
    slope = (np.sqrt(er) + np.sqrt(es)) ** 2 / (er + 2 * es)
    contrast = (np.sqrt(er) - np.sqrt(es)) / (np.sqrt(er) + np.sqrt(es))
    u2 = 2 * slope * es * (wavenumber * a) ** 2
    amplitude = _FULL * a / 2 * contrast * u2 / np.sqrt(1 + u2**2)
    corner = 1 / np.sqrt(u2)
    return np.asarray(amplitude), np.asarray(corner)


def stone_shape(u: ArrayLike) -> FloatArray:
    """Return a stone's growth with frequency over its corner frequency, ``u²/sqrt(1 + u⁴)``."""
    u2 = floats(u) ** 2
    return u2 / np.sqrt(1 + u2**2)


def spheroid(stretch: ArrayLike, body: ArrayLike, soil: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return a small spheroid's polarizability over that of the sphere of equal volume.

    Depolarization factors of Bohren & Huffman 1983, Sec. 5.3.

    Parameters
    ----------
    stretch : array_like
        Axis of revolution over the other two.
    body, soil : array_like
        Real permittivities of the spheroid and of the soil.

    Returns
    -------
    along, across : ndarray
        For fields along and across the axis of revolution.
    """
    q, er, es = np.broadcast_arrays(
        floats(stretch),
        floats(body),
        floats(soil),
    )
    # Near the sphere both formulas are 0/0: there the first terms of their series hold.
    nearly_round = np.abs(q - 1) < 1e-3
    e2 = np.abs(1 - 1 / np.where(nearly_round, 2.0, q) ** 2)
    e = np.sqrt(e2)
    prolate = (1 - e2) / e2 * (np.arctanh(np.minimum(e, 0.999999)) / e - 1)
    oblate = (1 + e2) / e2 * (1 - np.arctan(e) / e)
    factor = np.where(nearly_round, 1 / 3 - 4 / 15 * (q - 1), np.where(q > 1, prolate, oblate))
    sphere = (er + 2 * es) / 3
    along = sphere / (es + factor * (er - es))
    across = sphere / (es + (1 - factor) / 2 * (er - es))
    return along, across


def root(
    radius: ArrayLike, body: complex, soil: ArrayLike, wavenumber: float
) -> tuple[Complex128Array, Complex128Array, FloatArray]:
    """Return a thin cylinder's amplitude in soil per metre of length, and where it saturates.

    Born's integral with the field inside a thin cylinder: unchanged along it, ``2ε_s/(ε + ε_s)``
    across it. It saturates at the echo of a thick cylinder, ``sqrt(k_s·a/4π)`` times the reflection
    of its face.

    Parameters
    ----------
    radius : array_like
        Radius a, m.
    body : complex
        Permittivity ε of the cylinder.
    soil : array_like
        Real permittivity ε_s of the soil.
    wavenumber : float
        Wavenumber in air, rad/m.

    Returns
    -------
    along, across : ndarray of complex
        Amplitudes for fields along and across the cylinder.
    corner : ndarray
        Frequency over the given one at which the amplitude along the cylinder saturates.
    """
    a = floats(radius)
    es = floats(soil)
    thin = wavenumber**2 / (4 * np.pi) * np.pi * a**2 * (body - es)
    index = np.sqrt(complex(body))
    face = np.abs((index - np.sqrt(es)) / (index + np.sqrt(es)))
    thick = np.sqrt(wavenumber * np.sqrt(es) * a / (4 * np.pi)) * face
    u3 = np.abs(thin / thick) ** 2
    along = _FULL * thin / np.sqrt(1 + u3)
    across = along * 2 * es / (body + es)
    corner = u3 ** (-1 / 3)
    return np.asarray(along), np.asarray(across), np.asarray(corner)


def root_shape(u: ArrayLike) -> FloatArray:
    """Return a root's growth with frequency over its corner frequency, ``u²/sqrt(1 + u³)``."""
    u = floats(u)
    return u**2 / np.sqrt(1 + u**3)


def volume_backscatter(
    wavenumber: ArrayLike,
    sine: ArrayLike,
    soil: ArrayLike,
    deviation: float,
    horizontal: float,
    vertical: float,
) -> FloatArray:
    """Return the radar cross section per volume of a soil whose permittivity fluctuates, 1/m.

    First-order Born in the soil. For correlation ``s²·exp(-sqrt(r²/L_h² + z²/L_v²))`` of δε it is
    ``k0⁴/4π·W(2k_s)`` with the spectrum ``W(K) = 8π·s²·L_h²·L_v/(1 + K_h²L_h² + K_z²L_v²)²`` and
    ``K = 2k0·(sinθ, sqrt(ε - sin²θ))``. HH = VV, no HV (Tsang, Kong & Shin 1985, Sec. 5; Ishimaru
    1978, ch. 16).

    Parameters
    ----------
    wavenumber : array_like
        Wavenumber k0 in air, rad/m.
    sine : array_like
        Sine of the angle of incidence in air.
    soil : array_like
        Real mean permittivity ε of the soil.
    deviation : float
        Standard deviation s of the permittivity.
    horizontal, vertical : float
        Correlation lengths L_h and L_v, m.
    """
    k = floats(wavenumber)
    s2 = floats(sine) ** 2
    stretch = 4 * k**2 * (s2 * horizontal**2 + (floats(soil) - s2) * vertical**2)
    spectrum = 8 * np.pi * deviation**2 * horizontal**2 * vertical / (1 + stretch) ** 2
    return k**4 / (4 * np.pi) * spectrum


def disc_flash(
    radius: ArrayLike, wavenumber: float, sine: ArrayLike = 1.0, side: float = 1.0
) -> Complex128Array:
    """Return one flash of a level disc's transform ``2J_1(x)/x``, x = 2k0·a·sinθ, for large x.

    Parameters
    ----------
    radius : array_like
        Radius a, m.
    wavenumber : float
        Wavenumber k0 in air, rad/m.
    sine : array_like
        Sine of the angle of incidence in air.
    side : float
        1 for the near, -1 for the far flash.
    """
    x = 2 * wavenumber * floats(radius) * floats(sine)
    return np.sqrt(2 / (np.pi * x**3)) * np.exp(-0.75j * np.pi * side)


def lens(
    radius: ArrayLike, contrast: ArrayLike, thickness: float, wavenumber: float
) -> Complex128Array:
    """Return the amplitude of a thin flat disc's near flash at sinθ = 1 (Born), m.

    That of the far flash is its conjugate. Radius and thickness are in m; the contrast is the
    difference of permittivity, the wavenumber that in air.
    """
    a = floats(radius)
    difference = floats(contrast)
    volume_factor = _FULL * wavenumber**2 / 4 * difference * a**2 * thickness
    return volume_factor * disc_flash(a, wavenumber)
