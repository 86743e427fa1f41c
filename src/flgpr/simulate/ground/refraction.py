"""Rays through the ground's surface: refracted paths, transmission, attenuation and the rough interface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flgpr.model.arrays import ComplexArray, FloatArray


class Ray(NamedTuple):
    """Rays to buried points: electrical path, m, sine at the surface, and how far before the point they enter, m."""

    path: FloatArray
    sine: FloatArray
    entry: FloatArray


def refracted_ray(
    distance: ArrayLike,
    height: ArrayLike,
    thickness: Sequence[ArrayLike],
    permittivity: Sequence[float],
) -> Ray:
    """Find the ray of stationary path (Fermat) through plane layers, given from the top down with real permittivities.

    For one layer this minimises ``sqrt(H² + (x-q)²) + n·sqrt(d² + q²)`` over q. Snell's invariant s
    = sinθ is found by Newton's rule on tanθ; the path is ``R_air + s·q + Σ d_i·sqrt(ε_i - s²)``,
    stationary in s. A thickness may be zero.
    """
    x, h = np.broadcast_arrays(
        np.asarray(distance, dtype=np.float64), np.asarray(height, dtype=np.float64)
    )
    layers = [
        (np.asarray(d, dtype=np.float64), float(e))
        for d, e in zip(thickness, permittivity, strict=True)
    ]
    if not (h > 0).all():
        raise ValueError(f"height must be positive, got {h.min()}")
    for d, eps in layers:
        if (d < 0).any() or eps < 1:
            raise ValueError(
                f"layers must have thickness >= 0 and permittivity >= 1, got {d.min()} m and {eps}"
            )
    tangent = x / h
    for _ in range(6):
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


def apparent_shift(depth: ArrayLike, permittivity: float, sine: ArrayLike) -> FloatArray:
    """How far away a buried point appears in an image focused on the surface: ``d·sqrt(ε - sin²θ)/sinθ``, m."""
    s = np.asarray(sine, dtype=np.float64)
    return np.asarray(np.asarray(depth, dtype=np.float64) * np.sqrt(permittivity - s**2) / s)


def reflection(sine: ArrayLike, above: ArrayLike, below: ArrayLike) -> tuple[ComplexArray, ...]:
    """Fresnel reflection of the electric field (H) and of the magnetic field (V) at a plane interface.

    The sine is Snell's invariant, that in air, complex for waves that fade. A perfect conductor
    below gives -1 and +1.
    """
    s2 = np.asarray(sine) ** 2
    e1 = np.asarray(above, dtype=np.complex128)
    e2 = np.asarray(below, dtype=np.complex128)
    q1 = np.sqrt(e1 - s2)
    q2 = np.sqrt(e2 - s2)
    return (q1 - q2) / (q1 + q2), (e2 * q1 - e1 * q2) / (e2 * q1 + e1 * q2)


def two_way_transmission(sine: ArrayLike, permittivity: ArrayLike) -> tuple[ComplexArray, ...]:
    """Product t12·t21 = 1 - R² of the transmission of plane waves into and out of the ground, H and V; sine in air."""
    r_h, r_v = reflection(sine, 1.0, permittivity)
    return 1 - r_h**2, 1 - r_v**2


def ray_divergence(sine: ArrayLike, permittivity: ArrayLike) -> ComplexArray:
    """Amplitude of a spherical wave that leaves the ground over a plane wave's, H and V: ``cosθ/sqrt(ε - sin²θ)``.

    Seen from air the solid angle grows by ``n²·cosθ_t/cosθ``. Together with
    :func:`two_way_transmission` this is t12², as reciprocity demands.
    """
    s2 = np.asarray(sine, dtype=np.float64) ** 2
    return np.asarray(np.sqrt(1 - s2) / np.sqrt(np.asarray(permittivity, dtype=np.complex128) - s2))


def two_way_attenuation(
    depth: ArrayLike, wavenumber: ArrayLike, sine: ArrayLike, permittivity: ArrayLike
) -> FloatArray:
    """Two-way amplitude loss ``exp(-2d·|Im(k0·sqrt(ε - sin²θ))|)`` in one layer; wavenumber and sine in air."""
    s2 = np.asarray(sine, dtype=np.float64) ** 2
    vertical = np.sqrt(np.asarray(permittivity, dtype=np.complex128) - s2)
    rate = np.asarray(wavenumber, dtype=np.float64) * np.abs(vertical.imag)
    return np.asarray(np.exp(-2 * np.asarray(depth, dtype=np.float64) * rate))


def interface_path(sine: ArrayLike, permittivity: float) -> FloatArray:
    """Path gained per metre of surface height, one way: ``sqrt(ε - sin²θ) - cosθ``."""
    s2 = np.asarray(sine, dtype=np.float64) ** 2
    return np.asarray(np.sqrt(permittivity - s2) - np.sqrt(1 - s2))
