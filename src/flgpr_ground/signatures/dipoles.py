"""Scattering by a penetrable body in a homogeneous soil: coupled dipoles on a lattice.

Every cell of the lattice carries a dipole; they answer to the incident wave and to each other.
Interaction and polarizability are those of filtered coupled dipoles (Gay-Balmaz & Martin 2002;
Piller & Martin 1998): waves that the lattice cannot carry, of wavenumbers above π/cell, are left
out of the Green tensor. Sums over the lattice are convolutions and done in the spectral domain. A
body that is its own mirror image in x and in y lets the fields be split into four classes, even or
odd in either, each of them known by a quarter of the lattice; cosines and sines then take the place
of the Fourier transform, as matrix products that need not touch the padding: on lattices of this
size quicker than fast transforms.

All waves of a class are solved for together, with least residuals, in one block Krylov space. As
the system is symmetric, scattering amplitudes can be written so that their error is quadratic in
the residuals.

Fields vary as ``e^{+jωt}``. The origin of phases is the centre of the lattice's top face, z points
up.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import sici
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.bodies.signature.body import Body
from flgpr.types import (
    AnyArray,
    ArrayLike,
    Complex128Array,
    ComplexArray,
    Float32Array,
    FloatArray,
    floats,
)

# Directions of all waves together that are weaker than this, relative to a single wave, are not
# solved for.
_RANK = 3e-2
# Relative residual at which a direction counts as solved: its square is the error of the
# amplitudes.
_RESIDUAL = 5e-2
_BLOCKS = 30  # of the Krylov space at most
_SAMPLE = 2000  # unknowns on which the waves' common directions are found


class Lattice(NamedTuple):
    """Quarter ``x > 0, y > 0`` of a body on a cubic lattice.

    Cells go from the axis outwards and from the top down.
    """

    cell: float  #: edge of a cell, m
    #: (x, y, z, 3): that for fields along x, y and z; the soil's where there is no body
    permittivity: Complex128Array


class Waves(NamedTuple):
    """Downgoing plane waves, H and V each."""

    transverse: FloatArray  #: (wave,): horizontal wavenumbers κ, rad/m
    azimuth: FloatArray  #: (wave,): where they go to, from x towards y, rad


def scattering_amplitudes(
    lattice: Lattice, soil: complex, wavenumber: float, waves: Waves
) -> Complex128Array:
    """Return the scattering amplitudes F of a body, m.

    A wave ``E = e·e^{-jk·r}`` has the wave vector ``k = (κcosφ, κsinφ, -q)``,
    ``q = sqrt(ε_s·k0² - κ²)``, complex in a soil with loss. Its unit vector is ``h = z × κ/|κ|`` or
    ``v = (qcosφ, qsinφ, κ)/k_s``. What goes back to a receiver is described by the wave that it
    would send, with the same unit vectors (backscatter alignment):
    ``F = k0²/(4π)·∫(ε - ε_s)·E_receive·E dV``, so that ``E_s = F·e^{-jk_s·r}/r`` where the soil has
    no loss.

    Parameters
    ----------
    lattice : Lattice
        The body.
    soil : complex
        Permittivity ε_s, its imaginary part not positive.
    wavenumber : float
        Wavenumber k0 in air, rad/m.
    waves : Waves
        Waves of transmitters and receivers.

    Returns
    -------
    ndarray (2, wave, 2, wave) of complex
        H or V and wave of the receiver, then of the transmitter.
    """
    k = wavenumber * np.sqrt(complex(soil))
    scale = _dipole_scale(lattice, soil, k)
    symbols = green_symbols(lattice.permittivity.shape[:3], k * lattice.cell)
    count = 2 * waves.transverse.size
    total = np.zeros((count, count), complex)
    for parity in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        system = ClassSystem(scale, symbols, parity)
        total += _project(system, _wave_columns(lattice, scale, k, waves, parity))
    half = count // 2
    return (4 * k**2 * lattice.cell**3 * total).reshape(2, half, 2, half)


def _dipole_scale(lattice: Lattice, soil: complex, k: complex) -> ComplexArray:
    """Return the square root of the polarizability over the cell's volume (3, x, y, z).

    It is that of Clausius and Mossotti, with the radiative reaction of a filtered cell (Gay-Balmaz
    & Martin 2002).
    """
    size = k * lattice.cell
    ratio = np.moveaxis(lattice.permittivity, -1, 0) / soil
    static = 3 / (4 * np.pi) * (ratio - 1) / (ratio + 2)
    filtered = np.log((np.pi - size) / (np.pi + size)) / np.pi - 1j
    radiation = 4 / 3 * size**2 + 2 / 3 * size**3 * filtered
    polarizability = static / (1 - static * radiation)
    return np.ascontiguousarray(np.sqrt(polarizability), dtype=np.complex64)


def filtered_green(size: complex, count: int) -> tuple[Complex128Array, Complex128Array]:
    """Return the filtered Green tensor ``A·1 + B·RR/R²`` of a unit lattice.

    With ``g = e^{-jkR}/R`` and the delta function δ without the wavenumbers above π:
    ``A = k²g + g'/R + 4π/3·δ``, ``B = g'' - g'/R``. Both are zero at R = 0, which the
    polarizability includes.

    Parameters
    ----------
    size : complex
        Wavenumber times cell.
    count : int
        Number of squared distances.

    Returns
    -------
    isotropic, radial : ndarray (count,) of complex
        A and B where R² = 0, 1, 2, ... cells.
    """
    r = np.sqrt(np.arange(1, count))

    # g of the wavenumbers below π: the integral ends in sine and cosine integrals.
    sine = np.sin(size * r)
    cosine = np.cos(size * r)
    si_minus, ci_minus = sici((np.pi - size) * r)
    si_plus, ci_plus = sici((np.pi + size) * r)
    si = si_minus + si_plus
    ci = ci_minus - ci_plus - 1j * np.pi
    g = (cosine * si + sine * ci) / (np.pi * r)

    # g', and g'' by the wave equation, with the terms of the edge at π.
    edge_sine = np.sin(np.pi * r)
    edge_cosine = np.pi * r * np.cos(np.pi * r)
    slope = (size * (cosine * ci - sine * si) + 2 * edge_sine / r) / (np.pi * r) - g / r
    curve = -(size**2) * g + 2 * (edge_cosine - edge_sine) / (np.pi * r**3) - 2 * slope / r

    delta = (edge_sine - edge_cosine) / (2 * np.pi**2 * r**3)
    at_zero = np.zeros(1)
    isotropic = size**2 * g + slope / r + 4 * np.pi / 3 * delta
    radial = curve - slope / r
    return np.concatenate([at_zero, isotropic]), np.concatenate([at_zero, radial])


def green_symbols(shape: tuple[int, ...], size: complex) -> list[list[ComplexArray]]:
    """Return the Fourier transform of the Green tensor over the lags of a lattice.

    Parameters
    ----------
    shape : tuple of int
        Cells of the lattice's quarter, (x, y, z).
    size : complex
        Wavenumber times cell.

    Returns
    -------
    list of list of ndarray (2·x + 1, 2·y + 1, 2·z - 1)
        3 x 3 components over cosines or sines in x and y (sines where the component is odd),
        exponentials in z.
    """
    lags = [np.arange(2 * n) for n in shape[:2]] + [np.arange(shape[2])]
    grid = np.meshgrid(*lags, indexing="ij", sparse=True)
    square = grid[0] ** 2 + grid[1] ** 2 + grid[2] ** 2
    isotropic, radial = filtered_green(size, int(square.max()) + 1)
    diagonal = isotropic[square]
    line = radial[square] / np.maximum(square, 1)
    out: list[list[ComplexArray]] = [[None] * 3 for _ in range(3)]  # type: ignore[list-item]
    for a in range(3):
        for b in range(a, 3):
            component = line * grid[a] * grid[b]
            component = component + (diagonal if a == b else 0)
            # xy is odd in x and in y, xx in neither.
            odd = [(a == axis) != (b == axis) for axis in range(3)]
            symbol = _symbol(component, shape, odd)
            out[a][b] = symbol
            out[b][a] = symbol
    return out


def _symbol(component: Complex128Array, shape: tuple[int, ...], odd: list[bool]) -> ComplexArray:
    """Return the transform of one component, given for lags that are not negative.

    z is counted downwards.
    """
    for axis in range(2):
        period = 2 * shape[axis]
        angle = np.pi / period * np.outer(np.arange(period + 1), np.arange(period))
        matrix = _lag_sum(angle, odd[axis]).astype(complex)
        component = np.moveaxis(np.tensordot(matrix, component, (1, axis)), 0, axis)
    period = 2 * shape[2] - 1
    angle = 2 * np.pi / period * np.outer(np.arange(period), np.arange(shape[2]))
    matrix = _lag_sum(angle, odd[2]) * (1j if odd[2] else 1)
    return np.ascontiguousarray(component @ matrix.T, dtype=np.complex64)


def _lag_sum(angle: AnyArray, odd: bool) -> FloatArray:
    """Return the matrix that sums a function over lags of either sign.

    The function is given at lags that are not negative, and even or odd.
    """
    matrix = 2 * (np.sin(angle) if odd else np.cos(angle))
    matrix[:, 0] /= 2
    return matrix


class ClassSystem:
    """Equations ``(1 - s·G·s)·y = s·E`` of the dipoles in one symmetry class.

    Parameters
    ----------
    scale : ndarray (3, x, y, z)
        s, whose square is the polarizability.
    symbols : list of list of ndarray
        Transform of the Green tensor, from :func:`green_symbols`.
    parity : tuple of int
        Whether the vertical component is even (1) or odd (-1) in x and in y.
    """

    def __init__(
        self, scale: ComplexArray, symbols: list[list[ComplexArray]], parity: tuple[int, int]
    ) -> None:
        self.scale = scale
        self.symbols = symbols
        self.shape = scale.shape
        # Signs with which a component's spectrum enters another's: an odd kernel makes -cos of sin,
        # but sin of cos.
        in_x, in_y = parity
        self._coupling = [[1, -in_x * in_y, in_x], [-in_x * in_y, 1, in_y], [-in_x, -in_y, 1]]
        self._forward = [_transforms(scale.shape[1 + axis], parity[axis]) for axis in range(2)]
        length = 2 * scale.shape[3] - 1
        angle = 2j * np.pi / length * np.outer(np.arange(scale.shape[3]), np.arange(length))
        self._down = np.exp(-angle).astype(np.complex64)
        self._up = (np.exp(angle.T) / length).astype(np.complex64)

    def apply(self, vector: ComplexArray) -> ComplexArray:
        """Return the left-hand side for one vector (3·x·y·z,)."""
        field = vector.reshape(self.shape) * self.scale
        spectra = [self._spectrum(field[b], b) for b in range(3)]
        out = np.empty_like(field)
        for a in range(3):
            first = spectra[0] if self._coupling[a][0] > 0 else -spectra[0]
            total = first * self.symbols[a][0]
            for b in (1, 2):
                total += self._coupling[a][b] * (self.symbols[a][b] * spectra[b])
            out[a] = self._field(total, a)
        return vector - (out * self.scale).ravel()

    def _spectrum(self, field: ComplexArray, component: int) -> ComplexArray:
        """Return the spectrum of one component of a field; real matrices act on real views."""
        nx, ny, nz = field.shape
        in_x = self._forward[0][component == 0][0] @ field.reshape(nx, -1).view(np.float32)
        in_y = self._forward[1][component == 1][0] @ in_x.reshape(-1, ny, 2 * nz)
        return in_y.view(np.complex64) @ self._down

    def _field(self, spectrum: ComplexArray, component: int) -> ComplexArray:
        """Return the field of one component of a spectrum."""
        in_z = (spectrum @ self._up).view(np.float32)
        in_y = self._forward[1][component == 1][1] @ in_z
        in_x = self._forward[0][component == 0][1] @ in_y.reshape(in_y.shape[0], -1)
        return in_x.view(np.complex64).reshape(self.shape[1:])


def _transforms(count: int, parity: int) -> list[tuple[Float32Array, Float32Array]]:
    """Return the matrices to and from the spectrum along an axis.

    The first two are for components of this parity, the others for those of the other.
    """
    order = np.arange(2 * count + 1)
    angle = np.pi / (2 * count) * np.outer(order, np.arange(count) + 0.5)
    weight = np.where((order == 0) | (order == 2 * count), 1, 2) / (4 * count)
    matrices = []
    for even in (parity > 0, parity < 0):
        wave = np.cos(angle) if even else np.sin(angle)
        forward = (2 * wave).astype(np.float32)
        backward = np.ascontiguousarray((wave * weight[:, None]).T, np.float32)
        matrices.append((forward, backward))
    return matrices


def _wave_columns(
    lattice: Lattice, scale: ComplexArray, k: complex, waves: Waves, parity: tuple[int, int]
) -> ComplexArray:
    """Return what of each wave belongs to a class, times s: (3·x·y·z, 2·wave), H before V."""
    nx, ny, nz = scale.shape[1:]
    kappa = waves.transverse
    down = np.sqrt(k**2 - waves.transverse**2)
    cosine = np.cos(waves.azimuth)
    sine = np.sin(waves.azimuth)
    x, y, z = ((np.arange(count) + 0.5) * lattice.cell for count in (nx, ny, nz))
    in_x = _by_parity(kappa * cosine, x, parity[0])
    in_y = _by_parity(kappa * sine, y, parity[1])
    in_z = np.exp(-1j * np.outer(z, down)).astype(np.complex64)

    # Unit vectors h and v, by components.
    unit = [[-sine, down / k * cosine], [cosine, down / k * sine], [0 * sine, kappa / k]]
    out = np.empty((*scale.shape, 2, kappa.size), np.complex64)
    for c in range(3):
        # The horizontal components have the other parity along their own axis.
        plane = in_x[c == 0][:, None, None, :] * (in_y[c == 1][:, None, :] * in_z)
        plane *= scale[c][..., None]
        for polarization in range(2):
            component = unit[c][polarization].astype(np.complex64)
            np.multiply(plane, component, out=out[c, :, :, :, polarization])
    return out.reshape(scale.size, -1)


def _by_parity(wavenumber: AnyArray, coordinate: AnyArray, parity: int) -> list[ComplexArray]:
    """Return what of ``e^{-jkx}`` has this parity, then the other (coordinate, wave)."""
    phase = np.outer(coordinate, wavenumber)
    even = np.cos(phase).astype(np.complex64)
    odd = (-1j * np.sin(phase)).astype(np.complex64)
    return [even, odd] if parity > 0 else [odd, even]


def _project(system: ClassSystem, columns: ComplexArray) -> Complex128Array:
    """Return ``aᵀ·M⁻¹·a`` of all columns, from one block Krylov space.

    The space grows until all residuals are small. With ``x ≈ M⁻¹·a`` of least residual the value is
    ``aᵀ·x + xᵀ·a - xᵀ·M·x``, stationary as M is symmetric.
    """
    # Fewer directions that nearly span the columns, each as long as it matters.
    sample = columns[:: max(1, columns.shape[0] // _SAMPLE)].astype(complex)
    power, mixing = np.linalg.eigh(sample.conj().T @ sample)
    strong = power > (_RANK * np.linalg.norm(sample, axis=0).max()) ** 2
    start = residual = columns @ mixing[:, strong].astype(np.complex64)
    norm = float(np.linalg.norm(columns, axis=0).max())
    basis = start[:, :0]
    image = start[:, :0]
    gram = np.zeros((0, 0), complex)
    sources = np.zeros((0, start.shape[1]), complex)
    for _ in range(_BLOCKS):
        # Orthonormal directions of the residual outside the basis, longer than it may stay.
        for _ in range(2):  # once more for what rounding leaves
            residual = residual - basis @ (basis.conj().T @ residual)
        weight, mixing = np.linalg.eigh((residual.conj().T @ residual).astype(complex))
        long = weight > (_RESIDUAL * norm) ** 2
        fresh = residual @ (mixing[:, long] / np.sqrt(weight[long])).astype(np.complex64)
        if fresh.shape[1] == 0:
            break
        answer = np.stack([system.apply(v) for v in fresh.T.copy()], axis=1)
        # Normal equations of the least residual, of the old directions and the new ones.
        adjoint = answer.conj().T
        mixed = adjoint @ image
        gram = np.block([[gram, mixed.conj().T], [mixed, adjoint @ answer]])
        sources = np.concatenate([sources, adjoint @ start])
        basis = np.concatenate([basis, fresh], axis=1)
        image = np.concatenate([image, answer], axis=1)
        coefficients = np.linalg.solve(gram, sources).astype(np.complex64)
        residual = start - image @ coefficients
    solution = np.linalg.solve(gram, image.conj().T @ columns)
    once = solution.T @ (basis.T @ columns)
    twice = solution.T @ (basis.T @ image) @ solution
    return once + once.T - (twice + twice.T) / 2


_LAYER_CELLS = 2  # at least, in the thinnest layer


def solve_box(
    body: Body,
    frequency: float,
    permittivity: complex,
    sines: ArrayLike,
    aspects: ArrayLike,
    separations: ArrayLike = (0.0,),
    cells_per_wavelength: float = 9.0,
    most_cells: int = 400_000,
) -> Complex128Array:
    """Return the scattering amplitudes of a box in homogeneous soil, m, for waves from the air.

    A wave that comes at θ from the vertical in air has the horizontal wavenumber ``k0·sinθ`` in the
    soil, too. What the interface does to it is not included, nor are waves that go to and fro
    between body and interface, for the contrast of plastic to soil is weak. Origin of phases, unit
    vectors and F are those of :func:`scattering_amplitudes`.

    Parameters
    ----------
    body : Body
        A box without metal, its long side along x.
    frequency : float
        Tone, Hz.
    permittivity : complex
        Permittivity of the soil.
    sines : array_like (sine,)
        Sines of the angle of incidence in air.
    aspects, separations : array_like
        Transmitter and receiver stand at the azimuths ``aspect ∓ separation/2`` from x as seen from
        the body, rad; it is quickest where these are few. Of a square box, aspects from 0 to π/4
        say all: F does not change when it turns by π/2, and its mirror image has -HV and -VH.
    cells_per_wavelength : float
        In the denser of soil and body; at least two cells lie in the thinnest layer.
    most_cells : int
        Cells are coarser where there would be more than these.

    Returns
    -------
    ndarray (sine, aspect, separation, 4) of complex
        HH, HV, VH and VV; "HV" transmits H.

    Raises
    ------
    ValueError
        If the body is no box without metal, or a number is outside its range.
    """
    s, aspect, separation = (
        np.atleast_1d(floats(values)) for values in (sines, aspects, separations)
    )
    eps = complex(permittivity)
    for fits, rule, got in (
        (body.shape == "box" and not body.metal, "body must be a box without metal", body.name),
        (frequency > 0, "frequency must be positive", frequency),
        (
            eps.real >= 1 and eps.imag <= 0,
            "permittivity must be of real part >= 1 and imaginary part <= 0",
            permittivity,
        ),
        (((s >= 0) & (s < 1)).all(), "sines must be from 0 to below 1", s),
        (
            cells_per_wavelength >= 4,
            "cells_per_wavelength must be at least 4",
            cells_per_wavelength,
        ),
    ):
        if not fits:
            raise ValueError(f"{rule}, got {got}")
    wavenumber = 2 * math.pi * frequency / SPEED_OF_LIGHT

    sent = aspect[:, None] - separation / 2
    # Rounded, so that equal azimuths are found to be equal.
    azimuths = np.round([sent, sent + separation], 9)
    azimuth, index = np.unique(azimuths, return_inverse=True)
    kappa = np.repeat(wavenumber * s, azimuth.size)
    waves = Waves(kappa, np.tile(azimuth, s.size))

    cell = choose_cell(body, permittivity, wavenumber, cells_per_wavelength, most_cells)
    lattice = lattice_of(body, permittivity, cell)
    with threadpool_limits(1):
        full = scattering_amplitudes(lattice, permittivity, wavenumber, waves)

    full = full.reshape(2, s.size, azimuth.size, 2, s.size, azimuth.size)
    sine = np.arange(s.size)[:, None, None]
    transmit, receive = index.reshape(2, *sent.shape)
    # Axes: sine, aspect, separation, receiver, transmitter.
    pairs = full[:, sine, receive, :, sine, transmit]
    return np.ascontiguousarray(np.swapaxes(pairs, -1, -2).reshape(*pairs.shape[:3], 4))


def choose_cell(
    body: Body,
    permittivity: complex,
    wavenumber: float,
    cells_per_wavelength: float,
    most_cells: int,
) -> float:
    """Return the edge of the lattice's cells, m; parameters are those of :func:`solve_box`."""
    slowest = math.sqrt(max(complex(permittivity).real, body.densest()))
    thinnest = min(layer.thickness for layer in body.layers)
    for_waves = 2 * math.pi / (wavenumber * slowest * cells_per_wavelength)
    cell = min(for_waves, thinnest / _LAYER_CELLS)
    volume = 4 * body.radius**2 * body.elongation * body.height
    return max(cell, (volume / most_cells) ** (1 / 3))


def lattice_of(body: Body, permittivity: complex, cell: float) -> Lattice:
    """Return a quarter of a box on a lattice of cells of an edge, m, in soil of a permittivity.

    In a cell that a face cuts, the field along an axis meets the harmonic mean along that axis of
    the arithmetic means across it: what the continuity of the field along a face, and of the
    displacement through it, asks for.
    """
    widths = [0.0, *body.radii()]
    lengths = [body.elongation * width for width in widths]
    edges = lengths, widths, body.drops()
    x, y, z = (np.array([(low + high) / 2 for low, high in pairwise(axis)]) for axis in edges)
    half_width = np.maximum(x[:, None] / body.elongation, y)
    media = body.permittivity(half_width[..., None], z, permittivity)
    media = np.pad(media, [(0, 1)] * 3, constant_values=permittivity)
    shares = [_shares(axis, cell) for axis in edges]
    by_axis = [_average(media, shares, axis) for axis in range(3)]
    return Lattice(cell, np.stack(by_axis, axis=-1))


def _shares(edges: list[float], cell: float) -> FloatArray:
    """Return the share of each cell (row) that each interval, and all beyond the last, takes."""
    count = math.ceil(edges[-1] / cell - 1e-6)
    borders = np.array([*edges, math.inf])
    low = np.arange(count)[:, None] * cell
    overlap = np.minimum(borders[1:], low + cell) - np.maximum(borders[:-1], low)
    return np.maximum(overlap, 0) / cell


def _average(media: Complex128Array, shares: list[FloatArray], along: int) -> Complex128Array:
    """Return the harmonic mean along one axis of the arithmetic means over the others."""
    for axis in range(3):
        if axis != along:
            media = _weigh(shares[axis], media, axis)
    return 1 / _weigh(shares[along], 1 / media, along)


def _weigh(share: FloatArray, values: Complex128Array, axis: int) -> Complex128Array:
    """Return the means of values along an axis, by the shares of every cell."""
    return np.moveaxis(np.tensordot(share, values, (1, axis)), 0, axis)
