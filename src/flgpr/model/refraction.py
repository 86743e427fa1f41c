"""Rays and waves at the ground's surface: refracted paths, transmission, attenuation.

Sines are Snell's invariant, that of the angle of incidence in air.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats

_NEWTON_STEPS = 6


class Ray(NamedTuple):
    """Rays to buried points.

    ``path`` is the electrical path, m, ``sine`` that at the surface, and ``entry`` the horizontal
    distance, m, from the place where the ray enters the ground to the point.
    """

    path: FloatArray
    sine: FloatArray
    entry: FloatArray


def refracted_ray(
    distance: ArrayLike,
    height: ArrayLike,
    thickness: Sequence[ArrayLike],
    permittivity: Sequence[float],
) -> Ray:
    """Compute the ray of stationary path (Fermat) through plane layers.

    For one layer this minimises ``sqrt(H² + (x-q)²) + n·sqrt(d² + q²)`` over q. Snell's invariant
    s = sinθ is found by Newton's rule on tanθ; the path is
    ``R_air + s·q + Σ d_i·sqrt(ε_i - s²)``, stationary in s.

    Parameters
    ----------
    distance : array_like
        Horizontal distance x from the antenna to the point, m.
    height : array_like
        Height H of the antenna, m, broadcast with the distance.
    thickness : sequence of array_like
        Thickness of every layer above the point, from the top down, m. It may be zero.
    permittivity : sequence of float
        Real permittivity of every layer.

    Returns
    -------
    Ray
        In the broadcast shape.

    Raises
    ------
    ValueError
        If a height is not positive, a thickness is negative or a permittivity is below 1.
    """
    x, h = np.broadcast_arrays(floats(distance), floats(height))
    layers = []
    for d, eps in zip(thickness, permittivity, strict=True):
        layers.append((floats(d), float(eps)))
    _check_layers(h, layers)
    tangent = x / h
    for _ in range(_NEWTON_STEPS):
        s = tangent / np.sqrt(1 + tangent**2)
        reach = h * tangent
        slope = np.array(h)
        for d, eps in layers:
            vertical = np.sqrt(eps - s**2)
            reach = reach + d * s / vertical
            slope = slope + d * eps / vertical**3 * (1 + tangent**2) ** -1.5
        tangent = np.maximum(tangent - (reach - x) / slope, 0.0)
    s = tangent / np.sqrt(1 + tangent**2)
    path = h * np.sqrt(1 + tangent**2)
    entry = np.zeros_like(path)
    for d, eps in layers:
        vertical = np.sqrt(eps - s**2)
        entry = entry + d * s / vertical
        path = path + d * vertical
    return Ray(path + s * entry, s, entry)


def _check_layers(height: FloatArray, layers: list[tuple[FloatArray, float]]) -> None:
    """Raise a ValueError for heights, thicknesses or permittivities that no ray can have."""
    if not (height > 0).all():
        raise ValueError(f"height must be positive, got {height.min()}")
    for d, eps in layers:
        if (d < 0).any() or eps < 1:
            raise ValueError(
                f"layers must have thickness >= 0 and permittivity >= 1, got {d.min()} m and {eps}"
            )


def apparent_shift(depth: ArrayLike, permittivity: float, sine: ArrayLike) -> FloatArray:
    """Return how far away a buried point shows in an image focused on the surface, m.

    ``d·sqrt(ε - sin²θ)/sinθ``: the delay ``d·sqrt(ε - sin²θ)`` that the soil adds to a one-way
    path, turned into ground range.

    Parameters
    ----------
    depth : array_like
        Depth d below the surface, m.
    permittivity : float
        Real permittivity ε of the soil.
    sine : array_like
        Sine of the angle of incidence in air.
    """
    s = floats(sine)
    return np.asarray(floats(depth) * np.sqrt(permittivity - s**2) / s)


def reflection(
    sine: ArrayLike, above: ArrayLike, below: ArrayLike
) -> tuple[Complex128Array, Complex128Array]:
    """Return the Fresnel reflection of a plane interface for H and V.

    H is that of the electric, V that of the magnetic field. A perfect conductor below gives -1
    and +1.

    Parameters
    ----------
    sine : array_like
        Sine in air, complex for waves that fade.
    above, below : array_like
        Permittivities on the side of incidence and beyond.
    """
    s2 = np.asarray(sine) ** 2
    e1 = np.asarray(above, dtype=np.complex128)
    e2 = np.asarray(below, dtype=np.complex128)
    q1 = np.sqrt(e1 - s2)
    q2 = np.sqrt(e2 - s2)
    horizontal = (q1 - q2) / (q1 + q2)
    vertical = (e2 * q1 - e1 * q2) / (e2 * q1 + e1 * q2)
    return horizontal, vertical


def two_way_transmission(
    sine: ArrayLike, permittivity: ArrayLike
) -> tuple[Complex128Array, Complex128Array]:
    """Return t12·t21 = 1 - R² of plane waves into the ground and out of it, H and V."""
    r_h, r_v = reflection(sine, 1.0, permittivity)
    return 1 - r_h**2, 1 - r_v**2


def ray_divergence(sine: ArrayLike, permittivity: ArrayLike) -> Complex128Array:
    """Return the amplitude of a spherical wave that leaves the ground over a plane wave's.

    It is ``cosθ/sqrt(ε - sin²θ)`` for H and V: seen from air the solid angle grows by
    ``n²·cosθ_t/cosθ``. Together with :func:`two_way_transmission` this is t12², as reciprocity
    demands.
    """
    s2 = floats(sine) ** 2
    return np.asarray(np.sqrt(1 - s2) / np.sqrt(np.asarray(permittivity, dtype=np.complex128) - s2))


def two_way_attenuation(
    depth: ArrayLike, wavenumber: ArrayLike, sine: ArrayLike, permittivity: ArrayLike
) -> FloatArray:
    """Return the two-way loss of amplitude in one layer, ``exp(-2d·|Im(k0·sqrt(ε - sin²θ))|)``.

    Parameters
    ----------
    depth : array_like
        Thickness d of the layer, m.
    wavenumber : array_like
        Wavenumber k0 in air, rad/m.
    sine : array_like
        Sine of the angle of incidence in air.
    permittivity : array_like of complex
        Permittivity ε of the layer.
    """
    s2 = floats(sine) ** 2
    vertical = np.sqrt(np.asarray(permittivity, dtype=np.complex128) - s2)
    rate = floats(wavenumber) * np.abs(vertical.imag)
    return np.asarray(np.exp(-2 * floats(depth) * rate))


def interface_path(sine: ArrayLike, permittivity: float) -> FloatArray:
    """Return the path gained per metre of surface height, one way: ``sqrt(ε - sin²θ) - cosθ``."""
    s2 = floats(sine) ** 2
    return np.asarray(np.sqrt(permittivity - s2) - np.sqrt(1 - s2))
