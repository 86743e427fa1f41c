"""Scattering by a penetrable body in a homogeneous soil: coupled dipoles on a lattice with two planes of symmetry.

Every cell of the lattice carries a dipole; they answer to the incident wave and to each other.
Interaction and polarizability are those of filtered coupled dipoles (Gay-Balmaz & Martin 2002;
Piller & Martin 1998): waves that the lattice cannot carry, of wavenumbers above π/cell, are left
out of the Green tensor. Sums over the lattice are convolutions and done in the spectral domain. A
body that is its own mirror image in x and in y lets the fields be parted into four classes, even or
odd in either, each of them known by a quarter of the lattice; cosines and sines then do the part of
the Fourier transform, as matrix products that need not touch the padding: on lattices of this size
quicker than fast transforms.

All waves of a class are solved for together, with least residuals, in one block Krylov space. As
the system is symmetric, scattering amplitudes can be written so that their error is quadratic in
the residuals.

Fields vary as ``e^{+jωt}``. The origin of phases is the centre of the lattice's top face, z points
up.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import sici
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.bodies.signature.body import Body

SingleArray = NDArray[np.complex64]

# directions of all waves together that are weaker than this, relative to one wave, are not solved
# for
_RANK = 3e-2
# relative residual at which a direction counts as solved: its square is the error of the amplitudes
_RESIDUAL = 5e-2
_BLOCKS = 30  # of the Krylov space at most
_SAMPLE = 2000  # unknowns on which the waves' common directions are found


class Lattice(NamedTuple):
    """Quarter ``x > 0, y > 0`` of a body on a cubic lattice, from the axis outwards and from the top down.

    ``permittivity`` (x, y, z, 3) is that for fields along x, y, z; the soil's where there is no
    body.
    """

    cell: float
    permittivity: ComplexArray


class Waves(NamedTuple):
    """Downgoing plane waves, H and V each, of horizontal wavenumber κ towards ``azimuth``, from x towards y."""

    transverse: FloatArray
    azimuth: FloatArray


def scattering_amplitudes(
    lattice: Lattice, soil: complex, wavenumber: float, waves: Waves
) -> ComplexArray:
    """Give scattering amplitudes F (2, wave, 2, wave) of a body, m: H, V and wave of receiver, then transmitter.

    A wave ``E = e·e^{-jk·r}`` has the wave vector ``k = (κcosφ, κsinφ, -q)``, ``q = sqrt(ε_s·k0² -
    κ²)``, complex in a soil with loss (imaginary part of ε_s not positive). Its unit vector is ``h
    = z × κ/|κ|`` or ``v = (qcosφ, qsinφ, κ)/k_s``. What goes back to a receiver is described by the
    wave that it would send, with the same unit vectors (backscatter alignment): ``F = k0²/(4π)·∫(ε
    - ε_s)·E_receive·E dV``, so that ``E_s = F·e^{-jk_s·r}/r`` where the soil has no loss.
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
    return np.asarray(4 * k**2 * lattice.cell**3 * total).reshape(2, half, 2, half)


def _dipole_scale(lattice: Lattice, soil: complex, k: complex) -> SingleArray:
    """Square root of the polarizability over the cell's volume, (3, x, y, z)."""
    size = k * lattice.cell
    ratio = np.moveaxis(lattice.permittivity, -1, 0) / soil
    static = 3 / (4 * np.pi) * (ratio - 1) / (ratio + 2)
    radiation = 4 / 3 * size**2 + 2 / 3 * size**3 * (
        np.log((np.pi - size) / (np.pi + size)) / np.pi - 1j
    )
    return np.ascontiguousarray(np.sqrt(static / (1 - static * radiation)), dtype=np.complex64)


def filtered_green(size: complex, count: int) -> tuple[ComplexArray, ComplexArray]:
    """Give the filtered Green tensor ``A·1 + B·RR/R²`` of a unit lattice: A and B where R² = 0, 1, 2, ... cells.

    Both are zero at R = 0, which the polarizability includes; ``size`` is wavenumber times cell.
    With ``g = e^{-jkR}/R`` and the delta function δ without the wavenumbers above π: ``A = k²g +
    g'/R + 4π/3·δ``, ``B = g'' - g'/R``.
    """
    r = np.sqrt(np.arange(1, count))
    sine = np.sin(size * r)
    cosine = np.cos(size * r)
    (si_minus, ci_minus), (si_plus, ci_plus) = (sici((np.pi + sign * size) * r) for sign in (-1, 1))
    si = si_minus + si_plus
    ci = ci_minus - ci_plus - 1j * np.pi
    g = (cosine * si + sine * ci) / (np.pi * r)
    edge_sine = np.sin(np.pi * r)
    edge_cosine = np.pi * r * np.cos(np.pi * r)
    slope = (size * (cosine * ci - sine * si) + 2 * edge_sine / r) / (np.pi * r) - g / r
    curve = -(size**2) * g + 2 * (edge_cosine - edge_sine) / (np.pi * r**3) - 2 * slope / r
    delta = (edge_sine - edge_cosine) / (2 * np.pi**2 * r**3)
    zero = np.zeros(1)
    return (
        np.concatenate([zero, size**2 * g + slope / r + 4 * np.pi / 3 * delta]),
        np.concatenate([zero, curve - slope / r]),
    )


def green_symbols(shape: tuple[int, ...], size: complex) -> list[list[SingleArray]]:
    """Fourier transform of the Green tensor over the lags of a lattice whose quarter has this shape.

    3 x 3 arrays (2·x + 1, 2·y + 1, 2·z - 1) over cosines or sines in x and y (sines where the
    component is odd), exponentials in z.
    """
    lags = [np.arange(2 * n) for n in shape[:2]] + [np.arange(shape[2])]
    grid = np.meshgrid(*lags, indexing="ij", sparse=True)
    square = grid[0] ** 2 + grid[1] ** 2 + grid[2] ** 2
    table = filtered_green(size, int(square.max()) + 1)
    everywhere = table[0][square]
    line = table[1][square] / np.maximum(square, 1)
    out: list[list[SingleArray]] = [[None] * 3 for _ in range(3)]  # type: ignore[list-item]
    for a in range(3):
        for b in range(a, 3):
            part = line * grid[a] * grid[b] + (everywhere if a == b else 0)
            odd = [(a == axis) != (b == axis) for axis in range(3)]
            out[a][b] = out[b][a] = _symbol(part, shape, odd)
    return out


def _symbol(part: ComplexArray, shape: tuple[int, ...], odd: list[bool]) -> SingleArray:
    """Transform one component, given for lags that are not negative; z is counted downwards."""
    for axis in range(2):
        period = 2 * shape[axis]
        angle = np.pi / period * np.outer(np.arange(period + 1), np.arange(period))
        part = np.moveaxis(
            np.tensordot(_lag_sum(angle, odd[axis]).astype(complex), part, (1, axis)), 0, axis
        )
    angle = (
        2 * np.pi / (2 * shape[2] - 1) * np.outer(np.arange(2 * shape[2] - 1), np.arange(shape[2]))
    )
    matrix = _lag_sum(angle, odd[2]) * (1j if odd[2] else 1)
    return np.ascontiguousarray(part @ matrix.T, dtype=np.complex64)


def _lag_sum(angle: NDArray[Any], odd: bool) -> FloatArray:
    """Matrix that sums a function of lags of either sign from those that are not negative."""
    matrix = 2 * (np.sin(angle) if odd else np.cos(angle))
    matrix[:, 0] /= 2
    return matrix


class ClassSystem:
    """Equations ``(1 - s·G·s)·y = s·E`` of the dipoles in one symmetry class, s² their polarizability (3, x, y, z).

    ``parity`` is whether the vertical component is even (1) or odd (-1) in x and in y.
    """

    def __init__(
        self, scale: SingleArray, symbols: list[list[SingleArray]], parity: tuple[int, int]
    ) -> None:
        self.scale = scale
        self.symbols = symbols
        self.shape = scale.shape
        self._coupling = _couplings(parity)
        self._forward = [_transforms(scale.shape[1 + axis], parity[axis]) for axis in range(2)]
        length = 2 * scale.shape[3] - 1
        angle = 2j * np.pi / length * np.outer(np.arange(scale.shape[3]), np.arange(length))
        self._down = np.exp(-angle).astype(np.complex64)
        self._up = (np.exp(angle.T) / length).astype(np.complex64)

    def apply(self, vector: SingleArray) -> SingleArray:
        """Left-hand side for one vector (3·x·y·z,)."""
        field = vector.reshape(self.shape) * self.scale
        spectra = [self._spectrum(field[b], b) for b in range(3)]
        out = np.empty_like(field)
        for a in range(3):
            total = (
                spectra[0] * self.symbols[a][0]
                if self._coupling[a][0] > 0
                else -spectra[0] * self.symbols[a][0]
            )
            for b in (1, 2):
                total += self._coupling[a][b] * (self.symbols[a][b] * spectra[b])
            out[a] = self._field(total, a)
        return vector - (out * self.scale).ravel()

    def _spectrum(self, field: SingleArray, component: int) -> SingleArray:
        nx, ny, nz = field.shape
        in_x = self._forward[0][component == 0][0] @ field.reshape(nx, -1).view(np.float32)
        in_y = self._forward[1][component == 1][0] @ in_x.reshape(-1, ny, 2 * nz)
        return np.asarray(in_y.view(np.complex64) @ self._down)

    def _field(self, spectrum: SingleArray, component: int) -> SingleArray:
        in_z = (spectrum @ self._up).view(np.float32)
        in_y = self._forward[1][component == 1][1] @ in_z
        in_x = self._forward[0][component == 0][1] @ in_y.reshape(in_y.shape[0], -1)
        return np.asarray(in_x.view(np.complex64).reshape(self.shape[1:]))


def _transforms(count: int, parity: int) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Matrices to and from the spectrum, for components of this parity along an axis and for those of the other."""
    order = np.arange(2 * count + 1)
    angle = np.pi / (2 * count) * np.outer(order, np.arange(count) + 0.5)
    weight = np.where((order == 0) | (order == 2 * count), 1, 2) / (4 * count)
    pairs = []
    for even in (parity > 0, parity < 0):
        wave = np.cos(angle) if even else np.sin(angle)
        pairs.append(
            (
                (2 * wave).astype(np.float32),
                np.ascontiguousarray((wave * weight[:, None]).T, np.float32),
            )
        )
    return pairs


def _couplings(parity: tuple[int, int]) -> list[list[int]]:
    """Sign with which a component's spectrum enters another's: an odd kernel makes -cos of sin, but sin of cos."""
    in_x, in_y = parity
    return [[1, -in_x * in_y, in_x], [-in_x * in_y, 1, in_y], [-in_x, -in_y, 1]]


def _wave_columns(
    lattice: Lattice, scale: SingleArray, k: complex, waves: Waves, parity: tuple[int, int]
) -> SingleArray:
    """Part of each wave that belongs to a class, times s: (3·x·y·z, 2·wave), H before V."""
    nx, ny, nz = scale.shape[1:]
    kappa = waves.transverse
    down = np.sqrt(k**2 - waves.transverse**2)
    cosine = np.cos(waves.azimuth)
    sine = np.sin(waves.azimuth)
    in_x = _parts(kappa * cosine, (np.arange(nx) + 0.5) * lattice.cell, parity[0])
    in_y = _parts(kappa * sine, (np.arange(ny) + 0.5) * lattice.cell, parity[1])
    in_z = np.exp(-1j * np.outer((np.arange(nz) + 0.5) * lattice.cell, down)).astype(np.complex64)
    unit = [[-sine, down / k * cosine], [cosine, down / k * sine], [0 * sine, kappa / k]]
    out = np.empty((*scale.shape, 2, kappa.size), np.complex64)
    for c in range(3):
        plane = in_x[c == 0][:, None, None, :] * (in_y[c == 1][:, None, :] * in_z)
        plane *= scale[c][..., None]
        for polarization in range(2):
            np.multiply(
                plane, unit[c][polarization].astype(np.complex64), out=out[c, :, :, :, polarization]
            )
    return out.reshape(scale.size, -1)


def _parts(wavenumber: NDArray[Any], place: NDArray[Any], parity: int) -> list[SingleArray]:
    """Part of ``e^{-jkx}`` of this parity, then of the other, (place, wave)."""
    phase = np.outer(place, wavenumber)
    both = [np.cos(phase).astype(np.complex64), (-1j * np.sin(phase)).astype(np.complex64)]
    return both if parity > 0 else both[::-1]


def _project(system: ClassSystem, columns: SingleArray) -> ComplexArray:
    """Compute ``aᵀ·M⁻¹·a`` of all columns from one block Krylov space that grows until all residuals are small.

    With ``x ≈ M⁻¹·a`` of least residual the value is ``aᵀ·x + xᵀ·a - xᵀ·M·x``, stationary as M is
    symmetric.
    """
    start = residual = _directions(columns)
    norm = float(np.linalg.norm(columns, axis=0).max())
    basis = image = start[:, :0]
    gram = np.zeros((0, 0), complex)
    sources = np.zeros((0, start.shape[1]), complex)
    for _ in range(_BLOCKS):
        fresh = _orthonormal(residual, basis, _RESIDUAL * norm)
        if fresh.shape[1] == 0:
            break
        answer = np.stack([system.apply(v) for v in fresh.T.copy()], axis=1)
        adjoint = answer.conj().T
        mixed = adjoint @ image
        gram = np.block([[gram, mixed.conj().T], [mixed, adjoint @ answer]])
        sources = np.concatenate([sources, adjoint @ start])
        basis = np.concatenate([basis, fresh], axis=1)
        image = np.concatenate([image, answer], axis=1)
        residual = start - image @ np.linalg.solve(gram, sources).astype(np.complex64)
    solution = np.linalg.solve(gram, image.conj().T @ columns)
    once = solution.T @ (basis.T @ columns)
    twice = solution.T @ (basis.T @ image) @ solution
    return np.asarray(once + once.T - (twice + twice.T) / 2)


def _directions(columns: SingleArray) -> SingleArray:
    """Combine the columns into fewer that nearly span them, each as long as it matters."""
    some = columns[:: max(1, columns.shape[0] // _SAMPLE)].astype(complex)
    power, mixing = np.linalg.eigh(some.conj().T @ some)
    norm = np.linalg.norm(some, axis=0).max()
    return np.asarray(columns @ mixing[:, power > (_RANK * norm) ** 2].astype(np.complex64))


def _orthonormal(block: SingleArray, basis: SingleArray, least: float) -> SingleArray:
    """Orthonormal directions of a block, outside a basis, that are longer than ``least``."""
    for _ in range(2):
        block = block - basis @ (basis.conj().T @ block)
    weight, mixing = np.linalg.eigh((block.conj().T @ block).astype(complex))
    kept = weight > least**2
    return np.asarray(block @ (mixing[:, kept] / np.sqrt(weight[kept])).astype(np.complex64))


_LAYER_CELLS = 2  # at least, in the thinnest layer


def solve_box(
    body: Body, frequency: float, permittivity: complex, sines: ArrayLike, aspects: ArrayLike,
    separations: ArrayLike = (0.0,), cells_per_wavelength: float = 9.0, most_cells: int = 400_000,
) -> ComplexArray:  # fmt: skip
    """Scattering matrix (sine, aspect, separation, 4) of a box in homogeneous soil for waves that come from the air, m.

    A wave that comes at θ from the vertical in air has the horizontal wavenumber ``k0·sinθ`` in the
    soil, too. What the interface does to it is not included, nor are waves that go to and fro
    between body and interface, for the contrast of plastic to soil is weak. The box is without
    metal, its long side along x.

    Origin of phases, unit vectors and F (HH, HV, VH, VV; "HV" transmits H) are those of
    ``dipoles.scattering_amplitudes``. Transmitter and receiver stand at the azimuths ``aspect ∓
    separation/2`` from x as seen from the body; it is quickest where these are few. Of a square
    box, aspects from 0 to π/4 tell all: F does not change when it turns by π/2, and its mirror
    image has -HV and -VH. Cells are those of the denser of soil and body, at least two in the
    thinnest layer, and coarser where there would be more than ``most_cells``.
    """
    s, aspect, separation = (
        np.atleast_1d(np.asarray(x, dtype=float)) for x in (sines, aspects, separations)
    )
    _check(body, frequency, permittivity, s, cells_per_wavelength)
    wavenumber = 2 * math.pi * frequency / SPEED_OF_LIGHT
    sent = aspect[:, None] - separation / 2
    # Rounded, so that equal azimuths are found to be equal.
    azimuth, place = np.unique(np.round([sent, sent + separation], 9), return_inverse=True)
    kappa = np.repeat(wavenumber * s, azimuth.size)
    waves = Waves(kappa, np.tile(azimuth, s.size))
    cell = choose_cell(body, permittivity, wavenumber, cells_per_wavelength, most_cells)
    with threadpool_limits(1):
        full = scattering_amplitudes(
            lattice_of(body, permittivity, cell), permittivity, wavenumber, waves
        )
    full = full.reshape(2, s.size, azimuth.size, 2, s.size, azimuth.size)
    each = np.arange(s.size)[:, None, None]
    transmit, receive = place.reshape(2, *sent.shape)
    pairs = full[
        :, each, receive, :, each, transmit
    ]  # (sine, aspect, separation, receiver, transmitter)
    return np.ascontiguousarray(np.swapaxes(pairs, -1, -2).reshape(*pairs.shape[:3], 4))


def _check(
    body: Body, frequency: float, permittivity: complex, sines: FloatArray, cells: float
) -> None:
    eps = complex(permittivity)
    rules: list[tuple[str, str, bool, Any]] = [
        ("body", "a box without metal", body.shape == "box" and not body.metal, body.name),
        ("frequency", "positive", frequency > 0, frequency),
        (
            "permittivity",
            "of real part >= 1 and imaginary part <= 0",
            eps.real >= 1 and eps.imag <= 0,
            permittivity,
        ),
        ("sines", "from 0 to below 1", bool(((sines >= 0) & (sines < 1)).all()), sines),
        ("cells_per_wavelength", "at least 4", cells >= 4, cells),
    ]
    for name, rule, holds, value in rules:
        if not holds:
            raise ValueError(f"{name} must be {rule}, got {value}")


def choose_cell(
    body: Body,
    permittivity: complex,
    wavenumber: float,
    cells_per_wavelength: float,
    most_cells: int,
) -> float:
    """Choose the lattice's cell, m."""
    slowest = math.sqrt(max(complex(permittivity).real, body.densest()))
    thinnest = min(layer.thickness for layer in body.layers)
    cell = min(2 * math.pi / (wavenumber * slowest * cells_per_wavelength), thinnest / _LAYER_CELLS)
    volume = 4 * body.radius**2 * body.elongation * body.height
    return max(cell, (volume / most_cells) ** (1 / 3))


def lattice_of(body: Body, permittivity: complex, cell: float) -> Lattice:
    """Lay a quarter of a box on a lattice.

    In a cell that a face cuts, the field along an axis meets the harmonic mean along that axis of
    the arithmetic means across it: what the continuity of the field along a face, and of the
    displacement through it, asks for.
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
