"""Scattering of bodies of revolution in the ground: diffraction by their rims, reflection by their layers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flgpr.model.arrays import ComplexArray
from flgpr.model.refraction import reflection

Profile = Sequence[tuple[float, float]]

# keeps a face seen at normal incidence, where the ray picture fails, from growing at will
_LARGEST_COEFFICIENT = 5.0


class Rim(NamedTuple):
    """One visible point of a ring edge, near or far, ``drop`` below the top; of a plate the coefficients have h = v."""

    radius: float
    drop: float
    near: bool
    h: float
    v: float


def cylinder(radius: float, height: float) -> tuple[tuple[float, float], ...]:
    """Profile of an upright cylinder: (radius, drop below the top) from the top's centre to the bottom's, m."""
    return ((0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height))


def wedge_coefficients(angle: float, exterior: float) -> tuple[float, float]:
    """Keller's coefficients D_s and D_h of backscatter from a perfectly conducting wedge, without 1/sqrt(2πk).

    ``sin(π/n)/n · [1/(cos(π/n) - 1) ∓ 1/(cos(π/n) - cos(2φ/n))]`` (Keller 1962). The ray comes at
    ``angle`` φ from the first face, ``exterior`` is nπ: 3π/2 for a right-angled edge. D_s is that
    of an electric field along the edge.
    """
    n = exterior / math.pi
    front = math.sin(math.pi / n) / n
    direct = 1 / (math.cos(math.pi / n) - 1)
    gap = math.cos(math.pi / n) - math.cos(2 * angle / n)
    reflected = 1 / gap if abs(gap) > 1e-9 else math.inf
    limit = _LARGEST_COEFFICIENT
    soft = front * (direct - reflected)
    hard = front * (direct + reflected)
    return max(-limit, min(limit, soft)), max(-limit, min(limit, hard))


def visible_rims(profile: Profile, sine: float) -> list[Rim]:
    """List the rims that the radar sees, convex corners whose edge is lit, near ends first, and how each diffracts.

    Corners go from the top's centre to the bottom's, the sine is that in the medium around.
    """
    theta = math.asin(sine)
    rims = []
    for before, corner, after in zip(profile[:-2], profile[1:-1], profile[2:], strict=True):
        if corner[0] <= 0:
            continue
        first = math.atan2(corner[1] - before[1], before[0] - corner[0])
        second = math.atan2(corner[1] - after[1], after[0] - corner[0])
        exterior = (first - second) % (2 * math.pi)
        if exterior <= math.pi + 1e-9:
            continue
        for near, direction in ((True, math.pi / 2 - theta), (False, math.pi / 2 + theta)):
            angle = (first - direction) % (2 * math.pi)
            if angle < exterior:
                soft, hard = wedge_coefficients(angle, exterior)
                rims.append(Rim(corner[0], corner[1], near, -soft, hard))
    return rims


def rim_amplitude(rim: Rim, wavenumber: ArrayLike, sine: ArrayLike) -> ComplexArray:
    """Scattering amplitude, m, that multiplies a rim's coefficients; wavenumber and sine in the medium around.

    ``sqrt(a/(4πk·sinθ))`` with the phase of the ring's stationary point; with D = cotθ/2 it is the
    physical-optics disc's.
    """
    k = np.asarray(wavenumber, dtype=float)
    s = np.asarray(sine, dtype=float)
    size = np.sqrt(rim.radius / (4 * np.pi * k * s))
    return np.asarray(size * np.exp(-0.75j * np.pi if rim.near else -0.25j * np.pi))


def layered_reflection(
    sine: ArrayLike, wavenumber: ArrayLike, media: Sequence[ArrayLike], thickness: Sequence[float]
) -> tuple[ComplexArray, ComplexArray]:
    """Reflection of a stack of plane layers for H and V, by recursion from the bottom.

    ``media`` are relative permittivities from the side of incidence down, two more than there are
    thicknesses; sine and wavenumber are those in air.
    """
    if len(media) != len(thickness) + 2:
        raise ValueError(
            f"media must be two more than thickness, got {len(media)} and {len(thickness)}"
        )
    k = np.asarray(wavenumber, dtype=float)
    s = np.asarray(sine, dtype=float)
    total = list(reflection(s, media[-2], media[-1]))
    for i in range(len(thickness) - 1, -1, -1):
        q = k * np.sqrt(np.asarray(media[i + 1], dtype=complex) - s**2)
        delay = np.exp(-2j * q * thickness[i])
        top = reflection(s, media[i], media[i + 1])
        total = [(r + g * delay) / (1 + r * g * delay) for r, g in zip(top, total, strict=True)]
    return total[0], total[1]


def layers_strength(
    sine: float, wavenumber: ArrayLike, soil: ArrayLike, layers: Sequence[tuple[float, float]]
) -> ComplexArray:
    """Coefficients (H and V, frequency) of the near rim of a body of dielectric layers, for :func:`rim_amplitude`.

    The volume integral of the body's currents in its layers' own fields (Born's approximation, with
    the normal field raised by continuity of D), its disc pattern taken as that of two flashes:
    ``k0/(4·sinθ)·Σ(ε_l - ε_s)·g·∫e^{-2jqz}dz`` with g = 1 for H and ``(q² +
    (ε_s/ε_l)·k0²·sin²θ)/k_s²`` for V. The far rim has the opposite sign. Unlike the specular
    reflection of a face it has no null at Brewster's angle. Layers are (thickness, permittivity)
    from the top down; sine and wavenumber are those in air.
    """
    k = np.asarray(wavenumber, dtype=float)
    eps = np.asarray(soil, dtype=complex)
    down = k * np.sqrt(eps - sine**2)
    total = np.zeros((2, k.size), complex)
    top = 0.0
    for thickness, inner in layers:
        bottom = top + thickness
        share = (
            (inner - eps) * (np.exp(-2j * down * top) - np.exp(-2j * down * bottom)) / (2j * down)
        )
        raised = ((eps - sine**2) + eps / inner * sine**2) / eps
        total += share * np.stack([np.ones_like(raised), raised])
        top = bottom
    return np.asarray(k / (4 * sine) * total)
