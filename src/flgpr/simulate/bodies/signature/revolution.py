"""Scattering by a body of revolution in a homogeneous soil: Maxwell's equations on a Yee grid, mode by mode.

The field scattered by the body obeys ``∇×∇×E_s - k0²ε(r)·E_s = k0²(ε(r) - ε_s)·E_i`` (on metal the
tangential field ``E_s = -E_i``). With ``E ~ e^{jmφ}`` it is a sparse linear system on the half
plane (ρ, z), closed by absorbing layers of complex coordinates (Teixeira & Chew 1997). The body
then radiates as the source ``P = ∇×∇×E_s - k0²ε_s·E_s``, which vanishes outside it, and what a wave
tests of it is ``T = ∫E_test·P dV``: 4π times the scattering amplitude.

The origin of phases is the centre of the body's top face; fields vary as ``e^{+jωt}``.

Signatures take all modes and depths of one frequency and soil, with the surface above to all
orders. A body radiates upgoing waves only above its top, so its answer T to downgoing waves and the
surface's reflection R make the whole: ``S = T + T·R·T + T·R·T·R·T + ...``, summed in closed form
over the horizontal wavenumber κ.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu
from scipy.special import jv

from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.model.refraction import reflection
from flgpr.simulate.bodies.signature.body import Body

_GUARD = 4  # cells between the body and the absorbing layers
_ABSORBER = 9  # cells of each absorbing layer
# imaginary length of an absorbing layer times the wavenumber: e^-12 at normal incidence
_STRETCH = 6.0
_CROWDING = 0.75  # 0 spaces nodes evenly between a body's edges, 1 puts them as a cosine does
_GROWTH = 1.5  # of cells from the body outwards
_RANK = 1e-5  # fields on the body that are weaker than this, relative, are not solved for


@dataclass(frozen=True)
class Grid:
    """Yee grid on the half plane: nodes in complex coordinates, permittivity of every cell."""

    #: rho, z: nodes, m; imaginary parts absorb. ``rho[0]`` is the axis
    rho: ComplexArray
    z: ComplexArray
    permittivity: ComplexArray  #: (rho cell, z cell): NaN in metal
    inside: NDArray[np.bool_]  #: (rho cell, z cell): cells of the body
    # : permittivity without the body: the soil's, and 1 above the surface if the grid holds it
    ground: ComplexArray


def _divided(edges: Sequence[float], cell: float) -> FloatArray:
    """Put nodes on all edges and enough between them, closer near the edges, where fields are singular."""
    nodes = [np.array([edges[0]])]
    middle = 1 - _CROWDING + _CROWDING * math.pi / 2
    for low, high in itertools.pairwise(edges):
        count = max(2, math.ceil(middle * (high - low) / cell - 1e-9))
        even = np.arange(1, count + 1) / count
        nodes.append(
            low
            + (high - low) * ((1 - _CROWDING) * even + _CROWDING * (1 - np.cos(np.pi * even)) / 2)
        )
    return np.concatenate(nodes)


def _absorber(cell: float, first: float, wavenumber: float) -> ComplexArray:
    """Outward steps of guard cells, growing from the body's last cell, and of absorbing cells, m."""
    step = np.minimum(first * _GROWTH ** np.arange(1, 40), cell)
    guard = np.cumsum(step)
    guard = guard[: np.searchsorted(guard, _GUARD * cell) + 1]
    depth = np.arange(1, _ABSORBER + 1) / _ABSORBER
    fade = -1j * _STRETCH / wavenumber * depth**3
    return np.concatenate([guard, guard[-1] + cell * np.arange(1, _ABSORBER + 1) + fade])


def make_grid(
    body: Body,
    soil: complex,
    wavenumber: float,
    cells_per_wavelength: float,
    cover: float | None = None,
) -> Grid:
    """Lay a grid whose lines follow the body; ``cover`` is the soil between it and the air, None soil without end."""
    radii = body.radii()
    drops = body.drops()
    slowest = max(soil.real, body.densest())
    wavelength = 2 * math.pi / (wavenumber * math.sqrt(slowest))
    cell = min(wavelength / cells_per_wavelength, radii[-1] / 6)
    rho = _divided([0.0, *radii], cell)
    z = _divided([*(-d for d in reversed(drops)), *([] if cover is None else [cover])], cell)
    out = _absorber(cell, rho[-1] - rho[-2], wavenumber * math.sqrt(soil.real))
    up = _absorber(
        cell, z[-1] - z[-2], wavenumber * (1.0 if cover is not None else math.sqrt(soil.real))
    )
    down = _absorber(cell, z[1] - z[0], wavenumber * math.sqrt(soil.real))
    rho = np.concatenate([rho, rho[-1] + out])
    z = np.concatenate([(z[0] - down)[::-1], z, z[-1] + up])
    centre_rho = (rho[1:] + rho[:-1]).real / 2
    centre_z = (z[1:] + z[:-1]).real / 2
    ground = np.where(centre_z > (math.inf if cover is None else cover), 1.0, soil)
    inside = body.inside(centre_rho[:, None], -centre_z[None, :])
    permittivity = np.where(
        inside, body.permittivity(centre_rho[:, None], -centre_z[None, :], soil), ground
    )
    return Grid(rho.astype(complex), z.astype(complex), permittivity, inside, ground)


class ModalSolver:
    """Answer of a body to waves of one azimuthal mode, not negative."""

    def __init__(self, grid: Grid, soil: complex, wavenumber: float, mode: int) -> None:
        self.grid = grid
        self.soil = soil
        self.k0 = wavenumber
        self.mode = mode
        self.ks = wavenumber * np.sqrt(complex(soil))
        edges = _Edges(grid, mode)
        self._places = edges.places
        self._volume = edges.volume
        curl = _curl_curl(grid, mode, edges)
        ground = edges.average(np.broadcast_to(grid.ground, grid.permittivity.shape))
        contrast = edges.average(grid.permittivity) - ground
        outside = (curl - self.k0**2 * sp.diags(ground)).tocsr()
        self._body = np.flatnonzero(edges.touching(grid.inside) & edges.used)
        metal = np.isnan(contrast)
        self._metal = metal[self._body]
        self._contrast = np.where(metal, 0, contrast)[self._body]
        self._outside = outside[self._body]
        solved = np.flatnonzero(edges.used & ~metal)
        self._solved = solved
        self._count = edges.count
        self._to_metal = outside[solved][:, self._body[self._metal]]
        system = outside[solved][:, solved] - sp.diags(
            self.k0**2 * np.where(metal, 0, contrast)[solved]
        )
        self._factor = splu(
            system.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.01,
            options={"SymmetricMode": True},
        )

    def waves(self, transverse: ComplexArray, mode: int) -> ComplexArray:
        """Fields of downgoing waves on the body's edges, H first then V, (edge, 2·wave)."""
        rho, z, kind = self._places
        here = rho[self._body], z[self._body], kind[self._body]
        return np.concatenate(wave_modes(transverse, self.ks, *here, mode), axis=1)

    def answer(self, transverse: ComplexArray) -> ComplexArray:
        """``T[test, incident]``, m, for all pairs of downgoing waves of these horizontal wavenumbers, H before V."""
        incident = self.waves(transverse, self.mode)
        scale = np.linalg.norm(incident, axis=0)
        scale[scale == 0] = 1.0
        basis, weight, mixing = np.linalg.svd(incident / scale, full_matrices=False)
        kept = weight > _RANK * weight[0] if weight[0] > 0 else np.zeros(weight.size, bool)
        source = self._source(basis[:, kept])
        test = self.waves(transverse, -self.mode) * (2 * np.pi * self._volume[self._body])[:, None]
        return (test.T @ source) @ (weight[kept, None] * mixing[kept] * scale)

    def _source(self, incident: ComplexArray) -> ComplexArray:
        """P on the body's edges for incident fields given there."""
        right = np.zeros((self._count, incident.shape[1]), complex)
        right[self._body] = self.k0**2 * self._contrast[:, None] * incident
        right = right[self._solved] + self._to_metal @ incident[self._metal]
        field = np.zeros((self._count, incident.shape[1]), complex)
        field[self._solved] = self._factor.solve(right)
        field[self._body[self._metal]] = -incident[self._metal]
        return np.asarray(self._outside @ field)


def wave_modes(
    transverse: ComplexArray,
    wavenumber: complex,
    rho: FloatArray,
    z: FloatArray,
    kind: NDArray[np.intp],
    mode: int,
) -> tuple[ComplexArray, ComplexArray]:
    """Azimuthal mode of downgoing plane waves along x, as components on edges: h and v, (edge, wave).

    ``e^{-jκρcosφ} = Σ(-j)^n J_n(κρ)e^{jnφ}``; H is along y, V along (q, 0, κ)/k, with ``q = sqrt(k²
    - κ²)``. ``kind`` is 0, 1, 2 for components along ρ, φ, z; the mode may be negative.
    """
    order = abs(mode)
    radius, which_rho = np.unique(rho, return_inverse=True)
    level, which_z = np.unique(z, return_inverse=True)
    down = np.sqrt(wavenumber**2 - transverse**2)
    x = transverse * radius[:, None]
    before, bessel, after = (jv(n, x) for n in (order - 1, order, order + 1))
    # J' and n·J/x
    slope = (before - after) / 2
    over = (before + after) / 2
    over = math.copysign(1.0, mode) * over if order else np.zeros_like(x)
    phase = (-1j) ** order * np.exp(1j * down * level[:, None])
    none = np.zeros_like(x)
    h_parts = np.stack([over, 1j * slope, none])
    v_parts = np.stack([1j * down * slope, -down * over, transverse * bessel]) / wavenumber
    phase = phase[which_z]
    return h_parts[kind, which_rho] * phase, v_parts[kind, which_rho] * phase


class _Edges:
    """Numbers, places and volumes of the electric field's edges: along ρ, then φ, then z."""

    def __init__(self, grid: Grid, mode: int) -> None:
        rho = grid.rho
        z = grid.z
        self.shape = rho.size, z.size
        nr, nz = self.shape
        self.sizes = ((nr - 1) * nz, nr * nz, nr * (nz - 1))
        self.count = sum(self.sizes)
        half_rho = (rho[1:] + rho[:-1]) / 2
        half_z = (z[1:] + z[:-1]) / 2
        dual_rho = _dual(rho)
        dual_z = _dual(z)
        dual_area = rho * dual_rho
        dual_area[0] = half_rho[0] ** 2 / 2
        self.places = (
            np.concatenate(
                [np.repeat(half_rho, nz), np.repeat(rho, nz), np.repeat(rho, nz - 1)]
            ).real,
            np.concatenate([np.tile(z, nr - 1), np.tile(z, nr), np.tile(half_z, nr)]).real,
            np.repeat(np.arange(3), self.sizes),
        )
        self._widths = (
            np.pad(np.diff(rho.real), 1, mode="edge")[:, None],
            np.pad(np.diff(z.real), 1, mode="edge"),
        )
        sides = (half_rho * np.diff(rho), dual_z), (dual_area, dual_z), (dual_area, np.diff(z))
        self.volume = np.concatenate([np.outer(*pair).ravel() for pair in sides]).real
        along, around, upright = (np.zeros((a.size, b.size), bool) for a, b in sides)
        along[:, 1:-1] = True
        around[1:-1, 1:-1] = True
        upright[0 if mode == 0 else 1 : -1] = True
        self.used = np.concatenate([along.ravel(), around.ravel(), upright.ravel()])

    def average(self, cells: ComplexArray) -> ComplexArray:
        """Mean of a cell's quantity over the cells around each edge, weighted by area; NaN where any is NaN."""
        dr, dz = self._widths
        wide = np.pad(cells, 1, mode="edge")
        level = (wide[:, :-1] * dz[:-1] + wide[:, 1:] * dz[1:]) / (dz[:-1] + dz[1:])
        upright = ((wide[:-1] * dr[:-1] + wide[1:] * dr[1:]) / (dr[:-1] + dr[1:]))[:, 1:-1]
        around = (level[:-1] * dr[:-1] + level[1:] * dr[1:]) / (dr[:-1] + dr[1:])
        return np.concatenate([level[1:-1].ravel(), around.ravel(), upright.ravel()])

    def touching(self, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Edges with at least one of these cells around them."""
        return self.average(cells.astype(complex)).real > 0


def _dual(nodes: ComplexArray) -> ComplexArray:
    step = np.diff(nodes)
    return np.concatenate([step[:1] / 2, (step[1:] + step[:-1]) / 2, step[-1:] / 2])


def _difference(nodes: ComplexArray) -> Any:
    """Difference quotient from nodes to cells."""
    step = 1 / np.diff(nodes)
    return sp.diags([-step, step], [0, 1], shape=(step.size, nodes.size))


def _curl_curl(grid: Grid, mode: int, edges: _Edges) -> Any:
    """Matrix of ∇×∇× on all edges; rows of edges on the outer boundary and the axis mean nothing."""
    rho = grid.rho
    z = grid.z
    nr, nz = edges.shape
    half = (rho[1:] + rho[:-1]) / 2
    over_rho = np.zeros(nr, complex)
    over_rho[1:] = 1 / rho[1:]
    m = 1j * mode
    eye_r, eye_z, eye_hr, eye_hz = (sp.identity(n) for n in (nr, nz, nr - 1, nz - 1))
    d_r = _difference(rho)
    d_z = _difference(z)
    # Curl of E, on the faces' middles.
    b_rho = [None, -sp.kron(eye_r, d_z), sp.kron(sp.diags(m * over_rho), eye_hz)]
    b_phi = [sp.kron(eye_hr, d_z), None, -sp.kron(d_r, eye_hz)]
    b_z = [
        sp.kron(sp.diags(-m / half), eye_z),
        sp.kron(sp.diags(1 / half) @ d_r @ sp.diags(rho), eye_z),
        None,
    ]
    # Curl of that, back on the edges: differences over the dual cells.
    back_r = sp.diags(1 / _dual(rho)) @ _flux(nr)
    back_z = sp.diags(1 / _dual(z)) @ _flux(nz)
    ring = sp.diags(over_rho / _dual(rho)) @ _flux(nr) @ sp.diags(half)
    if mode == 0:
        ring = sp.lil_matrix(ring)
        ring[0, 0] = 2 / half[0]  # Stokes' theorem on the disc about the axis
    curl = [
        [None, -sp.kron(eye_hr, back_z), sp.kron(sp.diags(m / half), eye_z)],
        [sp.kron(eye_r, back_z), None, -sp.kron(back_r, eye_z)],
        [sp.kron(sp.diags(-m * over_rho), eye_hz), sp.kron(ring, eye_hz), None],
    ]
    return (sp.bmat(curl, format="csr") @ sp.bmat([b_rho, b_phi, b_z], format="csr")).tocsr()


def _flux(nodes: int) -> Any:
    """Cell after a node less the cell before it."""
    return sp.diags([np.ones(nodes - 1), -np.ones(nodes - 1)], [0, -1], shape=(nodes, nodes - 1))


_DETOUR = 0.25  # height of the path over the real axis, relative to the wavenumber in the soil
# where the path comes back to the real axis and where it ends, relative to the same
_TURN = 1.4
_END = 3.0


def solve_round(
    body: Body, frequency: float, permittivity: complex, sines: FloatArray, separations: FloatArray,
    depths: FloatArray, cells_per_wavelength: float = 8.0,
) -> ComplexArray:  # fmt: skip
    """Scattering amplitudes (depth, sine, separation, 4) of a round body in the ground, m.

    They are HH, VV, (HV + VH)/2, which is zero, and (HV - VH)/2 ("HV" transmits H and receives V;
    the receiver stands counterclockwise of the transmitter as seen from above). The field in air is
    ``t12²·e^{-2jqd}·F·e^{-jk(R_t+R_r)}/(R_t·R_r)`` by the alignment of backscatter, in which a
    level plate has HH = VV. Phases refer to the centre of the top. Sines are those in air, the same
    for transmitter and receiver; separations the azimuth between them as seen from the body; depths
    the soil over its top, infinity soil without a surface. Cells are counted per wavelength in the
    denser of soil and body.
    """
    k0 = 2 * math.pi * frequency / SPEED_OF_LIGHT
    path = spectral_path(k0 * np.sqrt(complex(permittivity)), body.radius)
    waves = np.concatenate([path.transverse, k0 * np.asarray(sines, dtype=complex)])
    grid = make_grid(body, permittivity, k0, cells_per_wavelength)
    nodes = path.transverse.size
    count = len(sines)
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
    hh = np.diag(whole[:count, :count])
    vv = np.diag(whole[count:, count:])
    hv = np.diag(whole[count:, :count])
    even = (1.0 if mode == 0 else 2.0) * np.cos(mode * separation)
    odd = 2j * np.sin(mode * separation)
    return np.stack(
        [
            np.outer(hh, even),
            np.outer(vv, even),
            np.zeros((count, separation.size)),
            np.outer(hv, odd),
        ],
        axis=-1,
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
    t = (t + 1) / 2
    w = w / 2
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

    All H stand before all V. What comes out is S for the waves of interest, without the factor
    ``t12²·e^{-2jqd}`` of ways in and out; ``depth`` is the soil above the body's top. With Weyl's
    integral an upgoing wave of the body meets the surface, comes back with the reflection r_p and
    ``e^{-2jqd}`` and goes once more through T: ``K = (-j/4π)·κ·dκ/q·(-1)^m·s_p·r_p·e^{-2jqd}``, s =
    -1 for H and +1 for V by the alignment of backscatter, and ``S = T + T_n·(K^-1 - T_nn)^-1·T_n``.
    """
    nodes = path.transverse.size
    count = answer.shape[0] // 2
    inner = np.concatenate([np.arange(nodes), count + np.arange(nodes)])
    outer = np.setdiff1d(np.arange(2 * count), inner)
    down = np.sqrt(wavenumber**2 * soil - path.transverse**2)
    r_h, r_v = reflection(path.transverse / wavenumber, soil, 1.0)
    share = (
        -0.25j
        / np.pi
        * path.transverse
        * path.weight
        / down
        * (-1) ** mode
        * np.exp(-2j * down * depth)
    )
    bounce = np.concatenate([-share * r_h, share * r_v])
    system = np.identity(2 * nodes) - answer[np.ix_(inner, inner)] * bounce
    again = np.linalg.solve(system, answer[np.ix_(inner, outer)])
    return np.asarray(answer[np.ix_(outer, outer)] + answer[np.ix_(outer, inner)] * bounce @ again)
