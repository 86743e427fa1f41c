"""Scattering by what lies in the soil: amplitudes in the soil itself, before the way in and out is put on them.

An amplitude is the square root of the radar cross section that the body has in an endless soil, m. It is given at one
frequency; its growth with frequency is one of the shapes below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flgpr.model.arrays import ComplexArray, FloatArray

_FULL = np.sqrt(4 * np.pi)


def stone(
    radius: ArrayLike, body: ArrayLike, soil: ArrayLike, wavenumber: float
) -> tuple[FloatArray, FloatArray]:
    """Amplitude, m, of a dielectric sphere in soil: its dipole, which saturates at the optical cross section.

    With the sign of the contrast it is ``2√π·f·u²/sqrt(1 + u⁴)`` with the optical ``f = a/2·(n - n_s)/(n + n_s)`` and u
    such that ``f·u²`` is the dipole's ``k_s²a³(ε - ε_s)/(ε + 2ε_s)``. The second value is the frequency, over the given
    one, at which u = 1. Permittivities are real, the wavenumber is that in air.
    """
    a, er, es = (np.asarray(v, dtype=float) for v in (radius, body, soil))
    slope = (np.sqrt(er) + np.sqrt(es)) ** 2 / (
        er + 2 * es
    )  # contrast of the dipole over the optical one
    contrast = (np.sqrt(er) - np.sqrt(es)) / (np.sqrt(er) + np.sqrt(es))
    u2 = 2 * slope * es * (wavenumber * a) ** 2
    return np.asarray(_FULL * a / 2 * contrast * u2 / np.sqrt(1 + u2**2)), np.asarray(
        1 / np.sqrt(u2)
    )


def stone_shape(u: ArrayLike) -> FloatArray:
    """Growth of a stone's amplitude with frequency over its corner frequency, ``u²/sqrt(1 + u⁴)``."""
    u2 = np.asarray(u, dtype=float) ** 2
    return np.asarray(u2 / np.sqrt(1 + u2**2))


def spheroid(stretch: ArrayLike, body: ArrayLike, soil: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Polarizability of a small spheroid along and across its axis, over that of the sphere of equal volume.

    ``stretch`` is the axis over the other two; depolarization factors of Bohren & Huffman 1983, Sec. 5.3.
    """
    q, er, es = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (stretch, body, soil)))
    e2 = np.abs(1 - 1 / np.where(np.abs(q - 1) < 1e-3, 2.0, q) ** 2)
    e = np.sqrt(e2)
    prolate = (1 - e2) / e2 * (np.arctanh(np.minimum(e, 0.999999)) / e - 1)
    oblate = (1 + e2) / e2 * (1 - np.arctan(e) / e)
    along = np.where(
        np.abs(q - 1) < 1e-3, 1 / 3 - 4 / 15 * (q - 1), np.where(q > 1, prolate, oblate)
    )
    sphere = (er + 2 * es) / 3
    return sphere / (es + along * (er - es)), sphere / (es + (1 - along) / 2 * (er - es))


def root(
    radius: ArrayLike, body: complex, soil: ArrayLike, wavenumber: float
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """Amplitude per metre of a thin cylinder in soil, for fields along and across it, and where it saturates.

    Born's integral with the field inside a thin cylinder: unchanged along it, ``2ε_s/(ε + ε_s)`` across it. It
    saturates at the echo of a thick cylinder, ``sqrt(k_s·a/4π)`` times the reflection of its face; the corner is the
    frequency, over the given one, at which that of the field along it does. The wavenumber is that in air.
    """
    a = np.asarray(radius, dtype=float)
    es = np.asarray(soil, dtype=float)
    thin = wavenumber**2 / (4 * np.pi) * np.pi * a**2 * (body - es)
    index = np.sqrt(complex(body))
    thick = np.sqrt(wavenumber * np.sqrt(es) * a / (4 * np.pi)) * np.abs(
        (index - np.sqrt(es)) / (index + np.sqrt(es))
    )
    u3 = np.abs(thin / thick) ** 2
    along = _FULL * thin / np.sqrt(1 + u3)
    return np.asarray(along), np.asarray(along * 2 * es / (body + es)), np.asarray(u3 ** (-1 / 3))


def root_shape(u: ArrayLike) -> FloatArray:
    """Growth of a root's amplitude with frequency over its corner frequency, ``u²/sqrt(1 + u³)``."""
    u = np.asarray(u, dtype=float)
    return np.asarray(u**2 / np.sqrt(1 + u**3))


def volume_backscatter(
    wavenumber: ArrayLike,
    sine: ArrayLike,
    soil: ArrayLike,
    deviation: float,
    horizontal: float,
    vertical: float,
) -> FloatArray:
    """Radar cross section per volume, 1/m, of a soil whose permittivity fluctuates, in the soil (first-order Born).

    For correlation ``s²·exp(-sqrt(r²/L_h² + z²/L_v²))`` of δε it is ``k0⁴/4π·W(2k_s)`` with the spectrum
    ``W(K) = 8π·s²·L_h²·L_v/(1 + K_h²L_h² + K_z²L_v²)²`` and ``K = 2k0·(sinθ, sqrt(ε - sin²θ))``. HH = VV, no HV (Tsang,
    Kong & Shin 1985, Sec. 5; Ishimaru 1978, ch. 16).
    """
    k = np.asarray(wavenumber, dtype=float)
    s2 = np.asarray(sine, dtype=float) ** 2
    stretch = 4 * k**2 * (s2 * horizontal**2 + (np.asarray(soil, dtype=float) - s2) * vertical**2)
    spectrum = 8 * np.pi * deviation**2 * horizontal**2 * vertical / (1 + stretch) ** 2
    return np.asarray(k**4 / (4 * np.pi) * spectrum)


def disc_flash(
    radius: ArrayLike, wavenumber: float, sine: ArrayLike = 1.0, side: float = 1.0
) -> ComplexArray:
    """Flash of a level disc's transform ``2J_1(x)/x``, x = 2k0·a·sinθ, for large x: near (``side`` 1) or far (-1)."""
    x = 2 * wavenumber * np.asarray(radius, dtype=float) * np.asarray(sine, dtype=float)
    return np.asarray(np.sqrt(2 / (np.pi * x**3)) * np.exp(-0.75j * np.pi * side))


def lens(
    radius: ArrayLike, contrast: ArrayLike, thickness: float, wavenumber: float
) -> ComplexArray:
    """Amplitude, m, of a thin flat disc's near flash (Born) at sinθ = 1; that of the far one is its conjugate."""
    a = np.asarray(radius, dtype=float)
    d = np.asarray(contrast, dtype=float)
    return np.asarray(_FULL * wavenumber**2 / 4 * d * a**2 * thickness * disc_flash(a, wavenumber))
