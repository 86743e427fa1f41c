"""Signatures of round bodies: all modes and depths of one frequency and soil, with the surface above to all orders.

A body radiates upgoing waves only above its top, so its answer T to downgoing waves and the surface's reflection R make
the whole of it: ``S = T + T·R·T + T·R·T·R·T + ...``, summed in closed form over the horizontal wavenumber κ.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.refraction import reflection
from flgpr.simulate.signature.body import Body
from flgpr.simulate.signature.revolution import ModalSolver, make_grid

_DETOUR = 0.25  # height of the path over the real axis, relative to the wavenumber in the soil
_TURN, _END = 1.4, 3.0  # where the path comes back to the real axis and where it ends, relative to the same


def solve_round(
    body: Body, frequency: float, permittivity: complex, sines: FloatArray, separations: FloatArray,
    depths: FloatArray, cells_per_wavelength: float = 8.0,
) -> ComplexArray:  # fmt: skip
    """Scattering amplitudes (depth, sine, separation, 4) of a round body in the ground, m.

    They are HH, VV, (HV + VH)/2, which is zero, and (HV - VH)/2 ("HV" transmits H and receives V; the receiver stands
    counterclockwise of the transmitter as seen from above). The field in air is
    ``t12²·e^{-2jqd}·F·e^{-jk(R_t+R_r)}/(R_t·R_r)`` by the alignment of backscatter, in which a level plate has HH = VV.
    Phases refer to the centre of the top. Sines are those in air, the same for transmitter and receiver; separations
    the azimuth between them as seen from the body; depths the soil over its top, infinity soil without a surface. Cells
    are counted per wavelength in the denser of soil and body.
    """
    k0 = 2 * math.pi * frequency / SPEED_OF_LIGHT
    path = spectral_path(k0 * np.sqrt(complex(permittivity)), body.radius)
    waves = np.concatenate([path.transverse, k0 * np.asarray(sines, dtype=complex)])
    grid = make_grid(body, permittivity, k0, cells_per_wavelength)
    nodes, count = path.transverse.size, len(sines)
    outer = np.concatenate([nodes + np.arange(count), waves.size + nodes + np.arange(count)])
    out = np.zeros((len(depths), count, len(separations), 4), complex)
    reach = k0 * body.radius * float(np.max(sines))
    for mode in range(math.ceil(reach + 1.8 * max(reach, 1.0) ** (1 / 3)) + 1):
        answer = ModalSolver(grid, permittivity, k0, mode).answer(waves)
        for i, depth in enumerate(depths):
            if math.isinf(depth):
                whole = answer[np.ix_(outer, outer)]
            else:
                whole = with_surface(answer, path, mode, permittivity, k0, float(depth))
            out[i] += _share(whole / (4 * np.pi), mode, np.asarray(separations))
    return out


def _share(whole: ComplexArray, mode: int, separation: FloatArray) -> ComplexArray:
    """Sum the modes ±m (sine, separation, 4): T of HH and VV is even in m, that of HV odd."""
    count = whole.shape[0] // 2
    hh, vv, hv = np.diag(whole[:count, :count]), np.diag(whole[count:, count:]), np.diag(whole[count:, :count])
    even = (1.0 if mode == 0 else 2.0) * np.cos(mode * separation)
    odd = 2j * np.sin(mode * separation)
    return np.stack(
        [np.outer(hh, even), np.outer(vv, even), np.zeros((count, separation.size)), np.outer(hv, odd)], axis=-1
    )


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
    ways in and out; ``depth`` is the soil above the body's top. With Weyl's integral an upgoing wave of the body meets
    the surface, comes back with the reflection r_p and ``e^{-2jqd}`` and goes once more through T: ``K =
    (-j/4π)·κ·dκ/q·(-1)^m·s_p·r_p·e^{-2jqd}``, s = -1 for H and +1 for V by the alignment of backscatter, and ``S = T +
    T_n·(K^-1 - T_nn)^-1·T_n``.
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
