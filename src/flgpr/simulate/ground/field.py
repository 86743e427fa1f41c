"""The surface's scatterers: a fixed random field in the world, made tile by tile when it is looked at."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, ndtr

from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Patch, Surface

# m, and how many stay in memory
TILE = 1.0
TILES_KEPT = 4000


def tiles_between(low: FloatArray, high: FloatArray) -> list[tuple[int, int]]:
    """Tiles (ix, iy) that touch the box from one corner (x, y) to the other, m, row by row."""
    (left, near), (right, far) = (
        np.floor(corner / TILE).astype(int).tolist() for corner in (low, high)
    )
    return [(ix, iy) for iy in range(near, far + 1) for ix in range(left, right + 1)]


def cells_of(count: float) -> tuple[int, int]:
    """Cells across and along a square, at least ``count`` in all."""
    across = max(1, math.ceil(math.sqrt(count)))
    return across, max(1, math.ceil(count / across))


@lru_cache(maxsize=16)
def _corners(cells: tuple[int, int]) -> NDArray[np.int64]:
    return np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 2)


def jittered(rng: np.random.Generator, cells: tuple[int, int]) -> FloatArray:
    """Places (point, 2) in the unit square, each in a cell of its own (jittered, Cook 1986), so that few are even."""
    corner = _corners(cells)
    return np.asarray((corner + rng.random(corner.shape)) / cells)


class Scatterers(NamedTuple):
    """Point scatterers on the mean surface: places (point, 2) in the lane frame and amplitudes (point, 3).

    They are to be multiplied by sqrt(σ⁰) of HH, of VV, of HH; their mean square is the area per scatterer, m².
    """

    xy: FloatArray
    amplitude: NDArray[np.complex64]


class SurfaceField:
    """A field of ``density`` scatterers per m² over the whole plane, of which ``keep`` tiles stay in memory.

    ``patches`` are where the ground scatters more; ``name`` is that of the random numbers.
    """

    def __init__(
        self, surface: Surface, patches: tuple[Patch, ...], density: float, seed: int, keep: int = TILES_KEPT,
        name: str = "surface",
    ) -> None:  # fmt: skip
        self.surface = surface
        self.patches = patches
        self.seed = seed
        self.name = name
        self._cells = cells_of(density * TILE**2)
        self.per_tile = math.prod(self._cells)
        self.tile = lru_cache(keep)(self._make)
        textures = "texture" if name == "surface" else f"{name} texture"
        self._discs = np.array([(patch.x, patch.y, patch.radius) for patch in patches]).reshape(
            -1, 3
        )
        self._texture = (
            None if surface.texture_shape is None else _Texture(surface, stream(seed, textures))
        )

    def within(self, corners: FloatArray) -> Scatterers:
        """Scatterers of every tile that touches the bounding box of ``corners`` (corner, 2), m."""
        tiles = [
            self.tile(ix, iy) for ix, iy in tiles_between(corners.min(axis=0), corners.max(axis=0))
        ]
        return Scatterers._make(np.concatenate(column) for column in zip(*tiles, strict=True))

    def _make(self, ix: int, iy: int) -> Scatterers:
        """Make the scatterers of the tile whose lower corner is (ix, iy)·TILE."""
        rng = stream(self.seed, self.name, ix, iy)
        xy = (jittered(rng, self._cells) + [ix, iy]) * TILE
        z = rng.standard_normal((self.per_tile, 6), dtype=np.float32).view(
            np.complex64
        ) / np.float32(math.sqrt(2))
        rho = self.surface.correlation
        z[:, 1] = rho * z[:, 0] + math.sqrt(1 - rho**2) * z[:, 1]
        z[:, 2] *= 10 ** (self.surface.cross_db / 20)
        power = np.full(self.per_tile, TILE**2 / self.per_tile * 10 ** (self.surface.level_db / 10))
        if self._texture is not None:
            power *= self._texture(xy, ix, iy)
        x, y, radius = self._discs.T
        near = np.hypot(x / TILE - ix - 0.5, y / TILE - iy - 0.5) < radius / TILE + 1
        for patch in itertools.compress(self.patches, near):
            reach = np.hypot(xy[:, 0] - patch.x, xy[:, 1] - patch.y) / patch.radius
            power *= 10 ** (patch.gain_db / 10 * np.clip(2 - 2 * reach, 0, 1))
        return Scatterers(xy, z * np.sqrt(power)[:, None].astype(np.float32))


class _Texture:
    """Gamma-distributed local power of mean one: a Gaussian field of given correlation length, mapped."""

    def __init__(self, surface: Surface, rng: np.random.Generator, modes: int = 256) -> None:
        shape = surface.texture_shape or 1.0
        self._waves = rng.normal(0, math.sqrt(2) / surface.texture_length, (2, modes))
        self._phase = rng.uniform(0, 2 * np.pi, modes)
        self._nodes = max(2, math.ceil(4 * TILE / surface.texture_length)) + 1
        self._grid = np.linspace(-5, 5, 401)
        # Quantiles of that distribution; importing scipy.stats for them takes half a second.
        self._power = gammaincinv(shape, ndtr(self._grid)) * (1 / shape)
        # Tiles of a column share their waves along x, tiles of a row those along y.
        self._column = lru_cache(64)(lambda ix: self._along(ix, self._waves[0], self._phase))
        self._row = lru_cache(64)(lambda iy: self._along(iy, self._waves[1], 0.0))

    def __call__(self, xy: FloatArray, ix: int, iy: int) -> FloatArray:
        nodes = (self._row(iy) @ self._column(ix).T).real * math.sqrt(2 / self._phase.size)
        where = (xy - np.array([ix, iy]) * TILE) / TILE * (self._nodes - 1)
        cell = np.minimum(where.astype(int), self._nodes - 2)
        (fx, fy), (cx, cy) = (where - cell).T, cell.T
        low = nodes[cy, cx] * (1 - fx) + nodes[cy, cx + 1] * fx
        high = nodes[cy + 1, cx] * (1 - fx) + nodes[cy + 1, cx + 1] * fx
        return np.asarray(np.interp(low * (1 - fy) + high * fy, self._grid, self._power))

    def _along(self, tile: int, waves: FloatArray, phase: FloatArray | float) -> ComplexArray:
        return np.exp(
            1j * ((tile * TILE + np.linspace(0, TILE, self._nodes))[:, None] * waves + phase)
        )
