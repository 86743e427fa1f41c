"""Signatures of round bodies: all modes and depths of one frequency and soil."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.signature.body import Body
from flgpr.simulate.signature.multiples import spectral_path, with_surface
from flgpr.simulate.signature.revolution import ModalSolver, make_grid

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def solve_round(
    body: Body,
    frequency: float,
    permittivity: complex,
    sines: FloatArray,
    separations: FloatArray,
    depths: FloatArray,
    cells_per_wavelength: float = 8.0,
) -> ComplexArray:
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
    for mode in range(_modes(k0 * body.radius * float(np.max(sines)))):
        answer = ModalSolver(grid, permittivity, k0, mode).answer(waves)
        for i, depth in enumerate(depths):
            if math.isinf(depth):
                whole = answer[np.ix_(outer, outer)]
            else:
                whole = with_surface(answer, path, mode, permittivity, k0, float(depth))
            out[i] += _share(whole / (4 * np.pi), mode, np.asarray(separations))
    return out


def _modes(reach: float) -> int:
    """Count the azimuthal modes that waves with k·a·sinθ = ``reach`` need."""
    return math.ceil(reach + 1.8 * max(reach, 1.0) ** (1 / 3)) + 1


def _share(whole: ComplexArray, mode: int, separation: FloatArray) -> ComplexArray:
    """Sum the modes ±m (sine, separation, 4): T of HH and VV is even in m, that of HV odd."""
    count = whole.shape[0] // 2
    hh, vv, hv = np.diag(whole[:count, :count]), np.diag(whole[count:, count:]), np.diag(whole[count:, :count])
    even = (1.0 if mode == 0 else 2.0) * np.cos(mode * separation)
    odd = 2j * np.sin(mode * separation)
    return np.stack(
        [np.outer(hh, even), np.outer(vv, even), np.zeros((count, separation.size)), np.outer(hv, odd)], axis=-1
    )
