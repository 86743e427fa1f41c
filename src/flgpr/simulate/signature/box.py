"""Scattering matrix of a box in the soil, by aspect."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.signature.body import Body
from flgpr.simulate.signature.dipoles import Lattice, Waves, scattering_amplitudes

_LAYER_CELLS = 2  # at least, in the thinnest layer


def solve_box(
    body: Body, frequency: float, permittivity: complex, sines: ArrayLike, aspects: ArrayLike,
    separations: ArrayLike = (0.0,), cells_per_wavelength: float = 9.0, most_cells: int = 400_000,
) -> ComplexArray:  # fmt: skip
    """Scattering matrix (sine, aspect, separation, 4) of a box in homogeneous soil for waves that come from the air, m.

    A wave that comes at θ from the vertical in air has the horizontal wavenumber ``k0·sinθ`` in the soil, too. What the
    interface does to it is not included, nor are waves that go to and fro between body and interface, for the contrast
    of plastic to soil is weak. The box is without metal, its long side along x.

    Origin of phases, unit vectors and F (HH, HV, VH, VV; "HV" transmits H) are those of
    ``dipoles.scattering_amplitudes``. Transmitter and receiver stand at the azimuths ``aspect ∓ separation/2`` from x
    as seen from the body; it is quickest where these are few. Of a square box, aspects from 0 to π/4 tell all: F does
    not change when it turns by π/2, and its mirror image has -HV and -VH. Cells are those of the denser of soil and
    body, at least two in the thinnest layer, and coarser where there would be more than ``most_cells``.
    """
    s, aspect, separation = (np.atleast_1d(np.asarray(x, dtype=float)) for x in (sines, aspects, separations))
    _check(body, frequency, permittivity, s, cells_per_wavelength)
    wavenumber = 2 * math.pi * frequency / SPEED_OF_LIGHT
    sent = aspect[:, None] - separation / 2
    # Rounded, so that equal azimuths are found to be equal.
    azimuth, place = np.unique(np.round([sent, sent + separation], 9), return_inverse=True)
    kappa = np.repeat(wavenumber * s, azimuth.size)
    waves = Waves(kappa, np.tile(azimuth, s.size))
    cell = choose_cell(body, permittivity, wavenumber, cells_per_wavelength, most_cells)
    with threadpool_limits(1):
        full = scattering_amplitudes(lattice_of(body, permittivity, cell), permittivity, wavenumber, waves)
    full = full.reshape(2, s.size, azimuth.size, 2, s.size, azimuth.size)
    each = np.arange(s.size)[:, None, None]
    transmit, receive = place.reshape(2, *sent.shape)
    pairs = full[:, each, receive, :, each, transmit]  # (sine, aspect, separation, receiver, transmitter)
    return np.ascontiguousarray(np.swapaxes(pairs, -1, -2).reshape(*pairs.shape[:3], 4))


def _check(body: Body, frequency: float, permittivity: complex, sines: FloatArray, cells: float) -> None:
    eps = complex(permittivity)
    rules: list[tuple[str, str, bool, Any]] = [
        ("body", "a box without metal", body.shape == "box" and not body.metal, body.name),
        ("frequency", "positive", frequency > 0, frequency),
        ("permittivity", "of real part >= 1 and imaginary part <= 0", eps.real >= 1 and eps.imag <= 0, permittivity),
        ("sines", "from 0 to below 1", bool(((sines >= 0) & (sines < 1)).all()), sines),
        ("cells_per_wavelength", "at least 4", cells >= 4, cells),
    ]
    for name, rule, holds, value in rules:
        if not holds:
            raise ValueError(f"{name} must be {rule}, got {value}")


def choose_cell(
    body: Body, permittivity: complex, wavenumber: float, cells_per_wavelength: float, most_cells: int
) -> float:
    """Choose the lattice's cell, m."""
    slowest = math.sqrt(max(complex(permittivity).real, body.densest()))
    thinnest = min(layer.thickness for layer in body.layers)
    cell = min(2 * math.pi / (wavenumber * slowest * cells_per_wavelength), thinnest / _LAYER_CELLS)
    volume = 4 * body.radius**2 * body.elongation * body.height
    return max(cell, (volume / most_cells) ** (1 / 3))


def lattice_of(body: Body, permittivity: complex, cell: float) -> Lattice:
    """Lay a quarter of a box on a lattice.

    In a cell that a face cuts, the field along an axis meets the harmonic mean along that axis of the arithmetic means
    across it: what the continuity of the field along a face, and of the displacement through it, asks for.
    """
    widths = [0.0, *body.radii()]
    edges = [[body.elongation * w for w in widths], widths, body.drops()]
    middles = [[(a + b) / 2 for a, b in pairwise(e)] for e in edges]
    across = np.maximum(np.array(middles[0])[:, None] / body.elongation, np.array(middles[1]))
    media = body.permittivity(across[..., None], np.array(middles[2]), permittivity)
    media = np.pad(media, [(0, 1)] * 3, constant_values=permittivity)
    shares = [_shares(e, cell) for e in edges]
    return Lattice(cell, np.stack([_average(media, shares, axis) for axis in range(3)], axis=-1))


def _shares(edges: list[float], cell: float) -> FloatArray:
    """Share of each cell (row) that each interval, and all beyond the last, takes."""
    count = math.ceil(edges[-1] / cell - 1e-6)
    borders = np.array([*edges, math.inf])
    low = np.arange(count)[:, None] * cell
    overlap = np.minimum(borders[1:], low + cell) - np.maximum(borders[:-1], low)
    return np.maximum(overlap, 0) / cell


def _average(media: ComplexArray, shares: list[FloatArray], along: int) -> ComplexArray:
    """Harmonic mean along one axis of the arithmetic means over the others."""
    for axis in range(3):
        if axis != along:
            media = _weigh(shares[axis], media, axis)
    return np.asarray(1 / _weigh(shares[along], 1 / media, along))


def _weigh(share: FloatArray, values: ComplexArray, axis: int) -> ComplexArray:
    return np.moveaxis(np.tensordot(share, values, (1, axis)), 0, axis)
