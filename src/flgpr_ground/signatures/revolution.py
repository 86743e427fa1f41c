"""Scattering by a body of revolution in a homogeneous soil, on a Yee grid, mode by mode.

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
from scipy.sparse import bmat, diags, identity, kron, lil_matrix
from scipy.sparse.linalg import splu
from scipy.special import jv

from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.refraction import reflection
from flgpr.simulate.bodies.signature.body import Body
from flgpr.types import BoolArray, Complex128Array, FloatArray, IndexArray

_GUARD = 4  # cells between the body and the absorbing layers
_ABSORBER = 9  # cells of each absorbing layer
# Imaginary length of an absorbing layer times the wavenumber: e^-12 at normal incidence.
_STRETCH = 6.0
_CROWDING = 0.75  # 0 spaces nodes evenly between a body's edges, 1 puts them as a cosine does
_GROWTH = 1.5  # of cells from the body outwards
_RANK = 1e-5  # fields on the body that are weaker than this, relative, are not solved for


@dataclass(frozen=True)
class YeeGrid:
    """Yee grid on the half plane: nodes in complex coordinates, permittivity of every cell."""

    #: rho, z: nodes, m; imaginary parts absorb. ``rho[0]`` is the axis
    rho: Complex128Array
    z: Complex128Array
    permittivity: Complex128Array  #: (rho cell, z cell): NaN in metal
    inside: BoolArray  #: (rho cell, z cell): cells of the body
    #: permittivity without the body: the soil's, and 1 above the surface if the grid holds it
    ground: Complex128Array


def _nodes_between(edges: Sequence[float], cell: float) -> FloatArray:
    """Return nodes on all edges and between them, closer near edges, where fields are singular."""
    nodes = [np.array([edges[0]])]
    # Greatest spacing over the mean one.
    widest = 1 - _CROWDING + _CROWDING * math.pi / 2
    for low, high in itertools.pairwise(edges):
        count = max(2, math.ceil(widest * (high - low) / cell - 1e-9))
        even = np.arange(1, count + 1) / count
        crowded = (1 - _CROWDING) * even + _CROWDING * (1 - np.cos(np.pi * even)) / 2
        nodes.append(low + (high - low) * crowded)
    return np.concatenate(nodes)


def _absorber(cell: float, first: float, wavenumber: float) -> Complex128Array:
    """Return the nodes outside the body, from its face outwards, m.

    Guard cells grow from the body's last cell on; absorbing cells come after them.
    """
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
) -> YeeGrid:
    """Return a grid whose lines follow the body.

    Parameters
    ----------
    body : Body
        The body.
    soil : complex
        Permittivity of the soil.
    wavenumber : float
        In air, rad/m.
    cells_per_wavelength : float
        In the denser of soil and body.
    cover : float, optional
        Soil between body and air, m; None is soil without end.

    Returns
    -------
    YeeGrid
        The grid, with its absorbing layers.
    """
    radii = body.radii()
    drops = body.drops()
    slowest = max(soil.real, body.densest())
    wavelength = 2 * math.pi / (wavenumber * math.sqrt(slowest))
    cell = min(wavelength / cells_per_wavelength, radii[-1] / 6)

    # Nodes on the body, and on the surface where there is one.
    levels = [-drop for drop in reversed(drops)]
    if cover is not None:
        levels.append(cover)
    rho = _nodes_between([0.0, *radii], cell)
    z = _nodes_between(levels, cell)

    # Nodes of the absorbing layers outside, above and below.
    in_soil = wavenumber * math.sqrt(soil.real)
    out = _absorber(cell, rho[-1] - rho[-2], in_soil)
    up = _absorber(cell, z[-1] - z[-2], in_soil if cover is None else wavenumber)
    down = _absorber(cell, z[1] - z[0], in_soil)
    rho = np.concatenate([rho, rho[-1] + out])
    z = np.concatenate([(z[0] - down)[::-1], z, z[-1] + up])

    centre_rho = (rho[1:] + rho[:-1]).real / 2
    centre_z = (z[1:] + z[:-1]).real / 2
    surface = math.inf if cover is None else cover
    ground = np.where(centre_z > surface, 1.0, soil)
    place = centre_rho[:, None], -centre_z[None, :]
    inside = body.inside(*place)
    permittivity = np.where(inside, body.permittivity(*place, soil), ground)
    return YeeGrid(rho.astype(complex), z.astype(complex), permittivity, inside, ground)


class ModalSolver:
    """Answer of a body to waves of one azimuthal mode.

    Parameters
    ----------
    grid : YeeGrid
        The grid.
    soil : complex
        Permittivity of the soil.
    wavenumber : float
        In air, rad/m.
    mode : int
        Azimuthal mode m, not negative.
    """

    def __init__(self, grid: YeeGrid, soil: complex, wavenumber: float, mode: int) -> None:
        self.grid = grid
        self.soil = soil
        self.k0 = wavenumber
        self.mode = mode
        self.ks = wavenumber * np.sqrt(complex(soil))
        edges = _Edges(grid, mode)
        self._positions = edges.positions
        self._volume = edges.volume

        # ∇×∇× - k0²ε of the ground alone, whose rows on the body give the source P.
        curl = _curl_curl(grid, mode, edges)
        ground = edges.average(np.broadcast_to(grid.ground, grid.permittivity.shape))
        contrast = edges.average(grid.permittivity) - ground
        outside = (curl - self.k0**2 * diags(ground)).tocsr()
        self._body = np.flatnonzero(edges.touching(grid.inside) & edges.used)
        metal = np.isnan(contrast)
        self._metal = metal[self._body]
        self._contrast = np.where(metal, 0, contrast)[self._body]
        self._outside = outside[self._body]

        # The system is that of all edges off metal, where the field is known.
        solved = np.flatnonzero(edges.used & ~metal)
        self._solved = solved
        self._count = edges.count
        self._to_metal = outside[solved][:, self._body[self._metal]]
        added = diags(self.k0**2 * np.where(metal, 0, contrast)[solved])
        system = outside[solved][:, solved] - added
        self._factor = splu(
            system.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.01,
            options={"SymmetricMode": True},
        )

    def waves(self, transverse: Complex128Array, mode: int) -> Complex128Array:
        """Return the fields of downgoing waves on the body's edges.

        Parameters
        ----------
        transverse : ndarray (wave,) of complex
            Horizontal wavenumbers, rad/m.
        mode : int
            Azimuthal mode; it may be negative.

        Returns
        -------
        ndarray (edge, 2·wave) of complex
            Fields, H before V.
        """
        rho, z, kind = self._positions
        body = self._body
        fields = wave_modes(transverse, self.ks, rho[body], z[body], kind[body], mode)
        return np.concatenate(fields, axis=1)

    def answer(self, transverse: Complex128Array) -> Complex128Array:
        """Return ``T[test, incident]``, m, for all pairs of downgoing waves, H before V.

        Parameters
        ----------
        transverse : ndarray (wave,) of complex
            Horizontal wavenumbers, rad/m.

        Returns
        -------
        ndarray (2·wave, 2·wave) of complex
            T, m.
        """
        # Solved for the few independent fields that the waves have on the body.
        incident = self.waves(transverse, self.mode)
        scale = np.linalg.norm(incident, axis=0)
        scale[scale == 0] = 1.0
        basis, weight, mixing = np.linalg.svd(incident / scale, full_matrices=False)
        strong = (weight > 0) & (weight > _RANK * weight[0])
        source = self._source(basis[:, strong])

        ring = 2 * np.pi * self._volume[self._body]
        test = self.waves(transverse, -self.mode) * ring[:, None]
        return (test.T @ source) @ (weight[strong, None] * mixing[strong] * scale)

    def _source(self, incident: Complex128Array) -> Complex128Array:
        """Return the source P on the body's edges for incident fields there."""
        right = np.zeros((self._count, incident.shape[1]), complex)
        right[self._body] = self.k0**2 * self._contrast[:, None] * incident
        right = right[self._solved] + self._to_metal @ incident[self._metal]
        field = np.zeros((self._count, incident.shape[1]), complex)
        field[self._solved] = self._factor.solve(right)
        field[self._body[self._metal]] = -incident[self._metal]
        return self._outside @ field


def wave_modes(
    transverse: Complex128Array,
    wavenumber: complex,
    rho: FloatArray,
    z: FloatArray,
    kind: IndexArray,
    mode: int,
) -> tuple[Complex128Array, Complex128Array]:
    """Return one azimuthal mode of downgoing plane waves along x, as components on edges.

    ``e^{-jκρcosφ} = Σ(-j)^n J_n(κρ)e^{jnφ}``; H is along y, V along (q, 0, κ)/k, with
    ``q = sqrt(k² - κ²)``.

    Parameters
    ----------
    transverse : ndarray (wave,) of complex
        Horizontal wavenumbers κ, rad/m.
    wavenumber : complex
        Wavenumber k in the soil, rad/m.
    rho, z : ndarray (edge,)
        Positions of the edges, m.
    kind : ndarray (edge,) of int
        0, 1, 2 for components along ρ, φ, z.
    mode : int
        Azimuthal mode; it may be negative.

    Returns
    -------
    h, v : ndarray (edge, wave) of complex
        Fields of the H and of the V waves.
    """
    order = abs(mode)
    radius, which_rho = np.unique(rho, return_inverse=True)
    level, which_z = np.unique(z, return_inverse=True)
    down = np.sqrt(wavenumber**2 - transverse**2)
    x = transverse * radius[:, None]
    before = jv(order - 1, x)
    bessel = jv(order, x)
    after = jv(order + 1, x)
    # J' and n·J/x.
    slope = (before - after) / 2
    over = np.zeros_like(x)
    if order:
        over = math.copysign(1.0, mode) * ((before + after) / 2)
    phase = (-1j) ** order * np.exp(1j * down * level[:, None])
    zero = np.zeros_like(x)
    h_components = np.stack([over, 1j * slope, zero])
    v_components = np.stack([1j * down * slope, -down * over, transverse * bessel]) / wavenumber
    h, v = (parts[kind, which_rho] * phase[which_z] for parts in (h_components, v_components))
    return h, v


class _Edges:
    """Numbers, positions and volumes of the electric field's edges: along ρ, then φ, then z."""

    def __init__(self, grid: YeeGrid, mode: int) -> None:
        rho = grid.rho
        z = grid.z
        self.shape = nr, nz = rho.size, z.size
        self.sizes = ((nr - 1) * nz, nr * nz, nr * (nz - 1))
        self.count = sum(self.sizes)
        half_rho = (rho[1:] + rho[:-1]) / 2
        half_z = (z[1:] + z[:-1]) / 2
        dual_rho = _dual(rho)
        dual_z = _dual(z)
        dual_area = rho * dual_rho
        dual_area[0] = half_rho[0] ** 2 / 2
        edge_rho = [np.repeat(half_rho, nz), np.repeat(rho, nz), np.repeat(rho, nz - 1)]
        edge_z = [np.tile(z, nr - 1), np.tile(z, nr), np.tile(half_z, nr)]
        kind = np.repeat(np.arange(3), self.sizes)
        self.positions = (np.concatenate(edge_rho).real, np.concatenate(edge_z).real, kind)
        self._width_rho = np.pad(np.diff(rho.real), 1, mode="edge")[:, None]
        self._width_z = np.pad(np.diff(z.real), 1, mode="edge")
        volumes = [
            np.outer(half_rho * np.diff(rho), dual_z),
            np.outer(dual_area, dual_z),
            np.outer(dual_area, np.diff(z)),
        ]
        self.volume = np.concatenate([volume.ravel() for volume in volumes]).real
        # Fields along the outer boundary are zero, and so are those of the axis but of mode 0
        # along it.
        along, around, upright = (np.zeros(volume.shape, bool) for volume in volumes)
        along[:, 1:-1] = True
        around[1:-1, 1:-1] = True
        upright[0 if mode == 0 else 1 : -1] = True
        self.used = np.concatenate([along.ravel(), around.ravel(), upright.ravel()])

    def average(self, cells: Complex128Array) -> Complex128Array:
        """Return the mean of a quantity over the cells around each edge, weighted by area.

        It is NaN where any of the cells is.
        """
        dr = self._width_rho
        dz = self._width_z
        padded = np.pad(cells, 1, mode="edge")

        def over_rho(values: Complex128Array) -> Complex128Array:
            """Return the means of neighbours along ρ."""
            return (values[:-1] * dr[:-1] + values[1:] * dr[1:]) / (dr[:-1] + dr[1:])

        level = (padded[:, :-1] * dz[:-1] + padded[:, 1:] * dz[1:]) / (dz[:-1] + dz[1:])
        means = (level[1:-1], over_rho(level), over_rho(padded)[:, 1:-1])
        return np.concatenate([mean.ravel() for mean in means])

    def touching(self, cells: BoolArray) -> BoolArray:
        """Return the edges with at least one of these cells around them."""
        return self.average(cells.astype(complex)).real > 0


def _dual(nodes: Complex128Array) -> Complex128Array:
    """Return the width of the dual cell about every node."""
    step = np.diff(nodes)
    return np.concatenate([step[:1] / 2, (step[1:] + step[:-1]) / 2, step[-1:] / 2])


def _difference(nodes: Complex128Array) -> Any:
    """Return the matrix of difference quotients from nodes to cells."""
    step = 1 / np.diff(nodes)
    return diags([-step, step], [0, 1], shape=(step.size, nodes.size))


def _curl_curl(grid: YeeGrid, mode: int, edges: _Edges) -> Any:
    """Return the matrix of ∇×∇× on all edges.

    Rows of edges on the outer boundary and the axis have no meaning.
    """
    rho = grid.rho
    z = grid.z
    nr, nz = edges.shape
    half = (rho[1:] + rho[:-1]) / 2
    over_rho = np.zeros(nr, complex)
    over_rho[1:] = 1 / rho[1:]
    m = 1j * mode
    eye_r, eye_z, eye_hr, eye_hz = (identity(size) for size in (nr, nz, nr - 1, nz - 1))
    d_r = _difference(rho)
    d_z = _difference(z)
    # Curl of E, on the faces' middles.
    b_rho = [None, -kron(eye_r, d_z), kron(diags(m * over_rho), eye_hz)]
    b_phi = [kron(eye_hr, d_z), None, -kron(d_r, eye_hz)]
    b_z = [
        kron(diags(-m / half), eye_z),
        kron(diags(1 / half) @ d_r @ diags(rho), eye_z),
        None,
    ]
    # Curl of that, back on the edges: differences over the dual cells.
    back_r = diags(1 / _dual(rho)) @ _flux(nr)
    back_z = diags(1 / _dual(z)) @ _flux(nz)
    ring = diags(over_rho / _dual(rho)) @ _flux(nr) @ diags(half)
    if mode == 0:
        ring = lil_matrix(ring)
        ring[0, 0] = 2 / half[0]  # Stokes' theorem on the disc about the axis
    curl = [
        [None, -kron(eye_hr, back_z), kron(diags(m / half), eye_z)],
        [kron(eye_r, back_z), None, -kron(back_r, eye_z)],
        [kron(diags(-m * over_rho), eye_hz), kron(ring, eye_hz), None],
    ]
    return (bmat(curl, format="csr") @ bmat([b_rho, b_phi, b_z], format="csr")).tocsr()


def _flux(nodes: int) -> Any:
    """Return the matrix of the cell after a node less the cell before it."""
    return diags([np.ones(nodes - 1), -np.ones(nodes - 1)], [0, -1], shape=(nodes, nodes - 1))


_DETOUR = 0.25  # height of the path over the real axis, relative to the wavenumber in the soil
# Where the path comes back to the real axis and where it ends, relative to the same.
_TURN = 1.4
_END = 3.0


def solve_round(
    body: Body,
    frequency: float,
    permittivity: complex,
    sines: FloatArray,
    separations: FloatArray,
    depths: FloatArray,
    cells_per_wavelength: float = 8.0,
) -> Complex128Array:
    """Return the scattering amplitudes of a round body in the ground, m.

    The field in air is ``t12²·e^{-2jqd}·F·e^{-jk(R_t+R_r)}/(R_t·R_r)`` by the alignment of
    backscatter, in which a level plate has HH = VV. Phases refer to the centre of the top.

    Parameters
    ----------
    body : Body
        The body.
    frequency : float
        Tone, Hz.
    permittivity : complex
        Permittivity of the soil.
    sines : ndarray (sine,)
        Sines of the angle of incidence in air, the same for transmitter and receiver.
    separations : ndarray (separation,)
        Azimuth between them as seen from the body, rad.
    depths : ndarray (depth,)
        Soil over the top, m; infinity is soil without a surface.
    cells_per_wavelength : float
        In the denser of soil and body.

    Returns
    -------
    ndarray (depth, sine, separation, 4) of complex
        HH, VV, (HV + VH)/2, which is zero, and (HV - VH)/2. "HV" transmits H and receives V; the
        receiver stands counterclockwise of the transmitter as seen from above.
    """
    k0 = 2 * math.pi * frequency / SPEED_OF_LIGHT
    path = spectral_path(k0 * np.sqrt(complex(permittivity)), body.radius)
    waves = np.concatenate([path.transverse, k0 * np.asarray(sines, dtype=complex)])
    grid = make_grid(body, permittivity, k0, cells_per_wavelength)

    nodes = path.transverse.size
    count = len(sines)
    of_sines = nodes + np.arange(count)
    outer = np.concatenate([of_sines, waves.size + of_sines])  # H and V
    out = np.zeros((len(depths), count, len(separations), 4), complex)
    reach = k0 * body.radius * float(np.max(sines))
    # Beyond this order the Bessel functions are negligible over the body.
    highest_mode = math.ceil(reach + 1.8 * max(reach, 1.0) ** (1 / 3))
    for mode in range(highest_mode + 1):
        answer = ModalSolver(grid, permittivity, k0, mode).answer(waves)
        for i, depth in enumerate(depths):
            if math.isinf(depth):
                scattered = answer[np.ix_(outer, outer)]
            else:
                scattered = with_surface(answer, path, mode, permittivity, k0, float(depth))
            out[i] += _modes_sum(scattered / (4 * np.pi), mode, np.asarray(separations))
    return out


def _modes_sum(answer: Complex128Array, mode: int, separation: FloatArray) -> Complex128Array:
    """Return the sum of the modes ±m (sine, separation, 4).

    T of HH and VV is even in m, that of HV odd.
    """
    count = answer.shape[0] // 2
    hh = np.diag(answer[:count, :count])
    vv = np.diag(answer[count:, count:])
    hv = np.diag(answer[count:, :count])
    even = (1.0 if mode == 0 else 2.0) * np.cos(mode * separation)
    odd = 2j * np.sin(mode * separation)
    no_mean = np.zeros((count, separation.size))
    return np.stack([np.outer(hh, even), np.outer(vv, even), no_mean, np.outer(hv, odd)], axis=-1)


class Path(NamedTuple):
    """Nodes of the integral over horizontal wavenumbers κ, rad/m, and weights of dκ."""

    transverse: Complex128Array
    weight: Complex128Array


def spectral_path(wavenumber: complex, radius: float) -> Path:
    """Return a path around the branch points and poles on and below the real axis.

    Parameters
    ----------
    wavenumber : complex
        In the soil, rad/m.
    radius : float
        Of the body, m: the wider, the more nodes.

    Returns
    -------
    Path
        Nodes of Gauss and Legendre, and their weights.
    """
    # Half a sine above the axis up to _TURN.
    size = wavenumber.real
    height = min(_DETOUR * size, 1.5 / radius)
    t, w = np.polynomial.legendre.leggauss(12 + math.ceil(0.75 * size * radius))
    t = (t + 1) / 2
    w = w / 2
    arc = _TURN * size * t + 1j * height * np.sin(np.pi * t)
    slope = _TURN * size + 1j * height * np.pi * np.cos(np.pi * t)

    # Along the axis from there to _END.
    u, v = np.polynomial.legendre.leggauss(6 + math.ceil(0.15 * size * radius))
    span = (_END - _TURN) * size
    tail = _TURN * size + span * (u + 1) / 2 + 1e-9j * size  # on the side where square roots decay
    return Path(np.concatenate([arc, tail]), np.concatenate([w * slope, v * span / 2 + 0j]))


def with_surface(
    answer: Complex128Array, path: Path, mode: int, soil: complex, wavenumber: float, depth: float
) -> Complex128Array:
    """Return a body's answer S with the surface above it, for one azimuthal mode.

    With Weyl's integral an upgoing wave of the body meets the surface, comes back with the
    reflection r_p and ``e^{-2jqd}`` and goes once more through T:
    ``K = (-j/4π)·κ·dκ/q·(-1)^m·s_p·r_p·e^{-2jqd}``, s = -1 for H and +1 for V by the alignment of
    backscatter, and ``S = T + T_n·(K^-1 - T_nn)^-1·T_n``.

    Parameters
    ----------
    answer : ndarray (2·wave, 2·wave) of complex
        T of the path's nodes and then of the waves of interest; all H stand before all V.
    path : Path
        The nodes.
    mode : int
        Azimuthal mode m.
    soil : complex
        Permittivity of the soil.
    wavenumber : float
        In air, rad/m.
    depth : float
        Soil above the body's top, m.

    Returns
    -------
    ndarray (2·interest, 2·interest) of complex
        S of the waves of interest, without the factor ``t12²·e^{-2jqd}`` of ways in and out.
    """
    nodes = path.transverse.size
    count = answer.shape[0] // 2
    inner = np.concatenate([np.arange(nodes), count + np.arange(nodes)])
    outer = np.setdiff1d(np.arange(2 * count), inner)

    # K by Weyl's integral, a factor for every node.
    down = np.sqrt(wavenumber**2 * soil - path.transverse**2)
    r_h, r_v = reflection(path.transverse / wavenumber, soil, 1.0)
    measure = -0.25j / np.pi * path.transverse * path.weight / down
    share = measure * (-1) ** mode * np.exp(-2j * down * depth)
    bounce = np.concatenate([-share * r_h, share * r_v])

    # S = T + T_n·K·(1 - T_nn·K)^-1·T_n
    system = np.identity(2 * nodes) - answer[np.ix_(inner, inner)] * bounce
    repeated = np.linalg.solve(system, answer[np.ix_(inner, outer)])
    direct = answer[np.ix_(outer, outer)]
    return direct + answer[np.ix_(outer, inner)] * bounce @ repeated
