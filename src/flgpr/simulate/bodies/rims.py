"""Scattering of bodies of revolution in the ground, by their rims and by their layers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flgpr.model.refraction import reflection
from flgpr.types import ArrayLike, Complex128Array, floats

Profile = Sequence[tuple[float, float]]

# Bound for a face seen at normal incidence, where the ray picture fails and the coefficients have
# a pole.
_LARGEST_COEFFICIENT = 5.0


class Rim(NamedTuple):
    """One visible point of a ring edge, on its near or on its far side."""

    radius: float  #: of the ring, m
    drop: float  #: how far it lies below the top, m
    is_near: bool  #: whether it is on the side of the radar
    h: float  #: coefficient of H
    v: float  #: coefficient of V; those of a plate are equal


def cylinder(radius: float, height: float) -> tuple[tuple[float, float], ...]:
    """Return the profile of an upright cylinder.

    Its corners are (radius, drop below the top), m, from the top's centre to the bottom's.
    """
    return ((0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height))


def wedge_coefficients(angle: float, exterior: float) -> tuple[float, float]:
    """Return Keller's coefficients D_s and D_h of backscatter, without 1/sqrt(2πk).

    Those of a perfectly conducting wedge,
    ``sin(π/n)/n · [1/(cos(π/n) - 1) ∓ 1/(cos(π/n) - cos(2φ/n))]`` (Keller 1962). D_s is that of an
    electric field along the edge.

    Parameters
    ----------
    angle : float
        Angle φ of the ray from the first face, rad.
    exterior : float
        Exterior angle nπ, rad: 3π/2 for a right-angled edge.

    Returns
    -------
    soft, hard : float
        D_s and D_h, bounded where the theory's grow without limit.
    """
    n = exterior / math.pi
    front = math.sin(math.pi / n) / n
    direct = 1 / (math.cos(math.pi / n) - 1)
    gap = math.cos(math.pi / n) - math.cos(2 * angle / n)
    reflected = 1 / gap if abs(gap) > 1e-9 else math.inf
    soft = front * (direct - reflected)
    hard = front * (direct + reflected)
    return _limited(soft), _limited(hard)


def _limited(coefficient: float) -> float:
    """Return a coefficient within its bounds."""
    return max(-_LARGEST_COEFFICIENT, min(_LARGEST_COEFFICIENT, coefficient))


def visible_rims(profile: Profile, sine: float) -> list[Rim]:
    """Return the rims that the radar sees, near ends first, and how each diffracts.

    These are convex corners whose edge is lit.

    Parameters
    ----------
    profile : sequence of (float, float)
        Corners from the top's centre to the bottom's, m.
    sine : float
        Sine of the angle of incidence in the medium around.

    Returns
    -------
    list of Rim
        The rims.
    """
    theta = math.asin(sine)
    rims = []
    for before, corner, after in zip(profile[:-2], profile[1:-1], profile[2:], strict=True):
        if corner[0] <= 0:  # on the axis there is no ring
            continue
        # Directions of the two faces in the plane of axis and ray, counted from the outside.
        first = math.atan2(corner[1] - before[1], before[0] - corner[0])
        second = math.atan2(corner[1] - after[1], after[0] - corner[0])
        exterior = (first - second) % (2 * math.pi)
        if exterior <= math.pi + 1e-9:  # flat or concave
            continue
        for is_near, direction in ((True, math.pi / 2 - theta), (False, math.pi / 2 + theta)):
            angle = (first - direction) % (2 * math.pi)
            if angle < exterior:
                soft, hard = wedge_coefficients(angle, exterior)
                rims.append(Rim(corner[0], corner[1], is_near, -soft, hard))
    return rims


def rim_amplitude(rim: Rim, wavenumber: ArrayLike, sine: ArrayLike) -> Complex128Array:
    """Return the scattering amplitude that multiplies a rim's coefficients, m.

    ``sqrt(a/(4πk·sinθ))`` with the phase of the ring's stationary point; with D = cotθ/2 it is the
    physical-optics disc's.

    Parameters
    ----------
    rim : Rim
        The rim.
    wavenumber : array_like
        In the medium around, rad/m.
    sine : array_like
        Sine of the angle of incidence in the medium around.

    Returns
    -------
    ndarray of complex
        Amplitude, m, in the broadcast shape.
    """
    k = floats(wavenumber)
    s = floats(sine)
    size = np.sqrt(rim.radius / (4 * np.pi * k * s))
    phase = -0.75j * np.pi if rim.is_near else -0.25j * np.pi
    return size * np.exp(phase)


def layered_reflection(
    sine: ArrayLike, wavenumber: ArrayLike, media: Sequence[ArrayLike], thickness: Sequence[float]
) -> tuple[Complex128Array, Complex128Array]:
    """Return the reflection of a stack of plane layers for H and V, by recursion from the bottom.

    Parameters
    ----------
    sine : array_like
        Sine of the angle of incidence in air.
    wavenumber : array_like
        In air, rad/m.
    media : sequence of array_like
        Relative permittivities from the side of incidence down.
    thickness : sequence of float
        Thickness of all layers but the first and the last, m.

    Raises
    ------
    ValueError
        If there are not two more media than thicknesses.
    """
    if len(media) != len(thickness) + 2:
        raise ValueError(
            f"media must be two more than thickness, got {len(media)} and {len(thickness)}"
        )
    k = floats(wavenumber)
    s = floats(sine)
    total_h, total_v = reflection(s, media[-2], media[-1])
    for i in range(len(thickness) - 1, -1, -1):
        q = k * np.sqrt(np.asarray(media[i + 1], dtype=complex) - s**2)
        delay = np.exp(-2j * q * thickness[i])
        top_h, top_v = reflection(s, media[i], media[i + 1])
        total_h = (top_h + total_h * delay) / (1 + top_h * total_h * delay)
        total_v = (top_v + total_v * delay) / (1 + top_v * total_v * delay)
    return total_h, total_v


def layers_strength(
    sine: float, wavenumber: ArrayLike, soil: ArrayLike, layers: Sequence[tuple[float, float]]
) -> Complex128Array:
    """Return the coefficients of the near rim of a body of dielectric layers.

    The volume integral of the body's currents in its layers' own fields (Born's approximation, with
    the normal field raised by continuity of D), its disc pattern taken as that of two flashes:
    ``k0/(4·sinθ)·Σ(ε_l - ε_s)·g·∫e^{-2jqz}dz`` with g = 1 for H and
    ``(q² + (ε_s/ε_l)·k0²·sin²θ)/k_s²`` for V. The far rim has the opposite sign. Unlike the
    specular reflection of a face it has no null at Brewster's angle.

    Parameters
    ----------
    sine : float
        Sine of the angle of incidence in air.
    wavenumber : array_like
        In air, rad/m.
    soil : array_like of complex
        Permittivity of the soil.
    layers : sequence of (float, float)
        Thickness, m, and permittivity from the top down.

    Returns
    -------
    ndarray (2, frequency) of complex
        Of H and V, for :func:`rim_amplitude`.
    """
    k = floats(wavenumber)
    eps = np.asarray(soil, dtype=complex)
    down = k * np.sqrt(eps - sine**2)
    total = np.zeros((2, k.size), complex)
    top = 0.0
    for thickness, inner in layers:
        bottom = top + thickness
        ends = np.exp(-2j * down * top) - np.exp(-2j * down * bottom)
        integral = (inner - eps) * ends / (2j * down)
        raised = ((eps - sine**2) + eps / inner * sine**2) / eps
        total += integral * np.stack([np.ones_like(raised), raised])
        top = bottom
    return np.asarray(k / (4 * sine) * total)
