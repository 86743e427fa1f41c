"""The surface's scatterers: a fixed random field in the world, made tile by tile where in view."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv, ndtr

from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Patch, Surface
from flgpr.types import Complex128Array, ComplexArray, FloatArray, IntArray

TILE = 1.0
"""Edge of a tile, m."""
TILES_KEPT = 4000
"""Tiles of a field that stay in memory."""


def tiles_between(low: FloatArray, high: FloatArray) -> list[tuple[int, int]]:
    """Return the tiles (ix, iy) that touch a box, row by row.

    Parameters
    ----------
    low, high : ndarray (2,)
        Opposite corners (x, y) of the box in the lane frame, m.
    """
    left, front = np.floor(low / TILE).astype(int).tolist()
    right, back = np.floor(high / TILE).astype(int).tolist()
    rows = range(front, back + 1)
    columns = range(left, right + 1)
    return [(ix, iy) for iy in rows for ix in columns]


def cell_counts(count: float) -> tuple[int, int]:
    """Return the numbers of cells across and along a square, at least ``count`` in all."""
    across = max(1, math.ceil(math.sqrt(count)))
    along = max(1, math.ceil(count / across))
    return across, along


@lru_cache(maxsize=16)
def _cell_corners(cells: tuple[int, int]) -> IntArray:
    """Return the lower corners (cell, 2) of all cells, in cells."""
    across, along = cells
    grid = np.meshgrid(np.arange(across), np.arange(along), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 2)


def jittered(rng: np.random.Generator, cells: tuple[int, int]) -> FloatArray:
    """Return random positions (point, 2) in the unit square, one in each of its cells.

    Jittered positions (Cook 1986) are even although they are few.
    """
    corner = _cell_corners(cells)
    return (corner + rng.random(corner.shape)) / cells


class Scatterers(NamedTuple):
    """Point scatterers on the mean surface, in the lane frame."""

    xy: FloatArray  #: (point, 2) positions, m
    #: (point, 3), to be multiplied by sqrt(σ⁰) of HH, of VV and of HH; its mean square is the area
    #: per scatterer, m²
    amplitude: ComplexArray


class SurfaceField:
    """A random field of scatterers over the whole plane.

    Parameters
    ----------
    surface : Surface
        Statistics of the amplitudes.
    patches : tuple of Patch
        Where the ground scatters more.
    density : float
        Scatterers per m².
    seed : int
        Seed of the world.
    keep : int
        Number of tiles that stay in memory.
    name : str
        Name of the random streams.
    renewed : (float, int)
        Share of the power that comes from scatterers of a drive, and the drive's number.
    """

    def __init__(
        self,
        surface: Surface,
        patches: tuple[Patch, ...],
        density: float,
        seed: int,
        keep: int = TILES_KEPT,
        name: str = "surface",
        renewed: tuple[float, int] = (0.0, 1),
    ) -> None:
        self.surface = surface
        self.patches = patches
        self.seed = seed
        self.name = name
        self.renewed = renewed
        self._cells = cell_counts(density * TILE**2)
        self.per_tile = math.prod(self._cells)
        self.tile = lru_cache(keep)(self._make)
        discs = [(patch.x, patch.y, patch.radius) for patch in patches]
        self._discs = np.array(discs).reshape(-1, 3)
        self._texture = None
        if surface.texture_shape is not None:
            stream_name = "texture" if name == "surface" else f"{name} texture"
            self._texture = _Texture(surface, stream(seed, stream_name))

    def within(self, corners: FloatArray) -> Scatterers:
        """Return the scatterers of every tile that touches the bounding box of some corners.

        Parameters
        ----------
        corners : ndarray (corner, 2)
            Positions in the lane frame, m.

        Returns
        -------
        Scatterers
            All scatterers of these tiles.
        """
        touched = tiles_between(corners.min(axis=0), corners.max(axis=0))
        tiles = [self.tile(ix, iy) for ix, iy in touched]
        xy = np.concatenate([tile.xy for tile in tiles])
        amplitude = np.concatenate([tile.amplitude for tile in tiles])
        return Scatterers(xy, amplitude)

    def _make(self, ix: int, iy: int) -> Scatterers:
        """Make the scatterers of the tile whose lower corner is (ix, iy)·TILE."""
        rng = stream(self.seed, self.name, ix, iy)
        xy = (jittered(rng, self._cells) + [ix, iy]) * TILE
        z = self._unit_amplitudes(rng)
        share, drive = self.renewed
        if share > 0:
            new = self._unit_amplitudes(stream(self.seed, f"{self.name} of drive {drive}", ix, iy))
            z = np.float32(math.sqrt(1 - share)) * z + np.float32(math.sqrt(share)) * new

        area = TILE**2 / self.per_tile
        power = np.full(self.per_tile, area * 10 ** (self.surface.level_db / 10))
        if self._texture is not None:
            power *= self._texture(xy, ix, iy)
        # A tile lies within a circle of less than one tile's edge about its middle.
        x, y, radius = self._discs.T
        touches = np.hypot(x / TILE - ix - 0.5, y / TILE - iy - 0.5) < radius / TILE + 1
        for patch in itertools.compress(self.patches, touches):
            # The gain falls from its full value at half the radius to nothing at the edge.
            distance = np.hypot(xy[:, 0] - patch.x, xy[:, 1] - patch.y) / patch.radius
            power *= 10 ** (patch.gain_db / 10 * np.clip(2 - 2 * distance, 0, 1))
        return Scatterers(xy, z * np.sqrt(power)[:, None].astype(np.float32))

    def _unit_amplitudes(self, rng: np.random.Generator) -> ComplexArray:
        """Draw complex Gaussian amplitudes (point, 3): HH and VV of mean square one, and cross."""
        white = rng.standard_normal((self.per_tile, 6), dtype=np.float32)
        z = white.view(np.complex64) / np.float32(math.sqrt(2))
        rho = self.surface.correlation
        z[:, 1] = rho * z[:, 0] + math.sqrt(1 - rho**2) * z[:, 1]
        z[:, 2] *= 10 ** (self.surface.cross_db / 20)
        return z


class _Texture:
    """Gamma-distributed local power of mean one.

    It is a Gaussian field of the table's correlation length, a sum of plane waves, whose values are
    mapped onto the gamma distribution.
    """

    def __init__(self, surface: Surface, rng: np.random.Generator, modes: int = 256) -> None:
        shape = surface.texture_shape or 1.0
        self._waves = rng.normal(0, math.sqrt(2) / surface.texture_length, (2, modes))
        self._phase = rng.uniform(0, 2 * np.pi, modes)
        self._nodes = max(2, math.ceil(4 * TILE / surface.texture_length)) + 1
        self._grid = np.linspace(-5, 5, 401)
        # Quantiles of that distribution; importing scipy.stats for them takes half a second.
        self._power = gammaincinv(shape, ndtr(self._grid)) * (1 / shape)
        # Tiles of a column share their waves along x, tiles of a row those along y.
        self._along = lru_cache(128)(self._waves_along)

    def __call__(self, xy: FloatArray, ix: int, iy: int) -> FloatArray:
        """Return the power (point,) at positions (point, 2) of the tile (ix, iy)."""
        waves = self._along(iy, 1) @ self._along(ix, 0).T
        nodes = waves.real * math.sqrt(2 / self._phase.size)

        # Bilinear between the nodes of the tile.
        position = (xy - np.array([ix, iy]) * TILE) / TILE * (self._nodes - 1)
        cell = np.minimum(position.astype(int), self._nodes - 2)
        fx, fy = (position - cell).T
        cx, cy = cell.T
        low = nodes[cy, cx] * (1 - fx) + nodes[cy, cx + 1] * fx
        high = nodes[cy + 1, cx] * (1 - fx) + nodes[cy + 1, cx + 1] * fx
        gaussian = low * (1 - fy) + high * fy
        return np.interp(gaussian, self._grid, self._power)

    def _waves_along(self, tile: int, axis: int) -> Complex128Array:
        """Return the waves (node, mode) at the nodes of a tile along x (0) or y (1)."""
        nodes = tile * TILE + np.linspace(0, TILE, self._nodes)
        phase = self._phase if axis == 0 else 0.0
        return np.exp(1j * (nodes[:, None] * self._waves[axis] + phase))
