"""Waves between a buried body and the surface above it, to all orders.

A body radiates upgoing waves only above its top, so its answer T to downgoing waves and the surface's reflection R make
the whole of it: ``S = T + T·R·T + T·R·T·R·T + ...``, summed in closed form over the horizontal wavenumber κ.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.simulate.refraction import reflection

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_DETOUR = 0.25  # height of the path over the real axis, relative to the wavenumber in the soil
_TURN, _END = 1.4, 3.0  # where the path comes back to the real axis and where it ends, relative to the same


class Path(NamedTuple):
    """Nodes of the integral over horizontal wavenumbers κ, and weights of dκ."""

    transverse: ComplexArray
    weight: ComplexArray


def spectral_path(wavenumber: complex, radius: float) -> Path:
    """Path around the branch points and poles on and below the real axis: the wider the body, the more nodes."""
    size = wavenumber.real
    height = min(_DETOUR * size, 1.5 / radius)
    t, w = np.polynomial.legendre.leggauss(12 + math.ceil(0.75 * size * radius))
    t, w = (t + 1) / 2, w / 2
    arc = _TURN * size * t + 1j * height * np.sin(np.pi * t)
    slope = _TURN * size + 1j * height * np.pi * np.cos(np.pi * t)
    u, v = np.polynomial.legendre.leggauss(6 + math.ceil(0.15 * size * radius))
    span = (_END - _TURN) * size
    tail = _TURN * size + span * (u + 1) / 2 + 1e-9j * size  # on the side where square roots decay
    return Path(np.concatenate([arc, tail]), np.concatenate([w * slope, v * span / 2 + 0j]))


def with_surface(
    answer: ComplexArray, path: Path, mode: int, soil: complex, wavenumber: float, depth: float
) -> ComplexArray:
    """Add the surface to a body's answer T of one azimuthal mode, for the path's nodes and then the waves of interest.

    All H stand before all V. What comes out is S for the waves of interest, without the factor ``t12²·e^{-2jqd}`` of
    ways in and out; ``depth`` is the soil above the body's top.

    Notes
    -----
    With Weyl's integral an upgoing wave of the body meets the surface, comes back with the reflection r_p and
    ``e^{-2jqd}`` and goes once more through T: ``K = (-j/4π)·κ·dκ/q·(-1)^m·s_p·r_p·e^{-2jqd}``, s = -1 for H and +1
    for V by the alignment of backscatter, and ``S = T + T_n·(K^-1 - T_nn)^-1·T_n``.
    """
    nodes, count = path.transverse.size, answer.shape[0] // 2
    inner = np.concatenate([np.arange(nodes), count + np.arange(nodes)])
    outer = np.setdiff1d(np.arange(2 * count), inner)
    down = np.sqrt(wavenumber**2 * soil - path.transverse**2)
    r_h, r_v = reflection(path.transverse / wavenumber, soil, 1.0)
    share = -0.25j / np.pi * path.transverse * path.weight / down * (-1) ** mode * np.exp(-2j * down * depth)
    bounce = np.concatenate([-share * r_h, share * r_v])
    system = np.identity(2 * nodes) - answer[np.ix_(inner, inner)] * bounce
    again = np.linalg.solve(system, answer[np.ix_(inner, outer)])
    return np.asarray(answer[np.ix_(outer, outer)] + answer[np.ix_(outer, inner)] * bounce @ again)
