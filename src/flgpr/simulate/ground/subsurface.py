"""Clutter under the surface, as layers of points: stones, roots, lenses, uneven soil, holes."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.ground import inclusions
from flgpr.simulate.ground.buried_spectra import (
    CAP,
    LENS,
    LEVEL,
    ROOT,
    STONE,
    VOLUME,
    WALL,
    BuriedSpectra,
    incidence_laws,
    shape_index,
    spectral_shapes,
)
from flgpr.simulate.ground.field import TILE, TILES_KEPT, cell_counts, jittered, tiles_between
from flgpr.simulate.ground.holes import Hole, cap_flash, wall_flash
from flgpr.simulate.ground.layers import PointEchoes, ScanView, ScattererLayer, through_grass
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Scene
from flgpr.simulate.scene.scene_tables import Roots, Stones
from flgpr.types import Complex128Array, ComplexArray, FloatArray, IndexArray

_ROOT_STEP = 0.02  # m between the points of a root
_COPOLAR = np.array([1.0, 1.0, 0.0])


class Buried(NamedTuple):
    """Points in the soil at ``xy`` (point, 2) and ``depth``, with unit vectors ``axis`` (point, 3).

    ``round`` is the amplitude for every field direction, ``axial`` what is added for fields along
    ``axis``, m; ``shape`` says which growth with frequency. ``reach`` is how far towards the radar
    the point stands from ``xy``: the near (+) and far (-) flash of a disc, m.
    """

    xy: FloatArray
    depth: FloatArray
    round: ComplexArray
    axial: ComplexArray
    axis: FloatArray
    shape: IndexArray
    reach: FloatArray


def buried_clutter(scene: Scene) -> list[str]:
    """Return the names of the scene's tables that put clutter into the soil and are on."""
    amounts = {
        "stones": scene.stones.density,
        "roots": scene.roots.density,
        "lenses": scene.lenses.density,
        "heterogeneity": scene.heterogeneity.deviation,
    }
    return [name for name, amount in amounts.items() if getattr(scene, name).on and amount > 0]


class SubsurfaceField:
    """The clutter in the soil, drawn tile by tile.

    Parameters
    ----------
    scene : Scene
        Its tables say what lies in the soil.
    spectra : BuriedSpectra
        Permittivities of the layers.
    wavenumber : float
        In air at the band's middle, rad/m.
    density : float
        Points of the uneven soil per m², unless the scene says.
    seed : int
        Seed of the world.
    """

    def __init__(
        self, scene: Scene, spectra: BuriedSpectra, wavenumber: float, density: float, seed: int
    ) -> None:
        self._scene = scene
        self._spectra = spectra
        self._k = wavenumber
        self._seed = seed
        self._density = scene.heterogeneity.density or density
        self.tile = lru_cache(TILES_KEPT)(self._make)
        # Every table's clutter is drawn by the method of its name.
        self._makers: list[Callable[[int, int], Buried]] = [
            getattr(self, name) for name in buried_clutter(scene)
        ]

    def within(self, corners: FloatArray) -> Buried:
        """Return the points of every tile that touches the bounding box of some corners.

        The box is a metre wider than ``corners`` (corner, 2), for what reaches over.
        """
        tiles = tiles_between(corners.min(axis=0) - 1, corners.max(axis=0) + 1)
        return _concatenate([self.tile(ix, iy) for ix, iy in tiles])

    def _make(self, ix: int, iy: int) -> Buried:
        """Make the points of the tile whose lower corner is (ix, iy)·TILE."""
        return _concatenate([make(ix, iy) for make in self._makers])

    def stones(self, ix: int, iy: int) -> Buried:
        """Draw the stones of a tile, spheroids in every direction."""
        table = self._scene.stones
        rng = stream(self._seed, "stones", ix, iy)
        count = rng.poisson(table.density * TILE**2)
        xy = _draw_places(rng, count, ix, iy)
        radius = stone_radii(table, rng.random(count))
        depth = radius + rng.random(count) * np.maximum(table.depth - radius, 0)
        body = rng.uniform(*table.permittivity, count)
        stretch = table.stretch ** rng.uniform(-1, 1, count)
        soil = self._spectra.permittivity(depth)
        size, corner = inclusions.stone(radius, body, soil, self._k)
        along, across = inclusions.spheroid(stretch, body, soil)
        axial = size * (along - across)
        vectors = rng.standard_normal((count, 3))  # even over the sphere
        axis = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        return _points(xy, depth, size * across, shape_index(STONE, corner), axial, axis)

    def roots(self, ix: int, iy: int) -> Buried:
        """Draw the roots that begin in a tile, as chains of points along their winding lines."""
        table = self._scene.roots
        rng = stream(self._seed, "roots", ix, iy)
        count = rng.poisson(table.density * TILE**2)
        return _concatenate([self._root(table, rng, ix, iy) for _ in range(count)])

    def _root(self, table: Roots, rng: np.random.Generator, ix: int, iy: int) -> Buried:
        """Draw one root; the order of the random numbers fixes the world."""
        steps = max(1, round(table.length / _ROOT_STEP))
        radius = float(np.exp(rng.uniform(*np.log(np.maximum(table.radius, 1e-4)))))
        # The direction wanders by about half a radian over ten centimetres.
        azimuth = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.22, steps))
        plunge = rng.normal(0, table.plunge)
        level = math.cos(plunge)
        sunk = np.full(steps, math.sin(plunge))
        axis = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), sunk], axis=1)
        jitter = (rng.random(steps) - 0.5)[:, None] * axis
        line = np.cumsum(axis, axis=0) - axis / 2 + jitter
        step = table.length / steps
        line *= step
        middle = line[steps // 2]
        start = _draw_places(rng, 1, ix, iy)
        depth = radius + rng.exponential(table.depth) - line[:, 2] + middle[2]
        xy = start + line[:, :2] - middle[:2]
        below_surface = depth > radius
        xy = xy[below_surface]
        depth = depth[below_surface]
        axis = axis[below_surface]
        body = table.permittivity * (1 - 1j * table.loss_tangent)
        soil = self._spectra.permittivity(depth)
        along, across, corner = inclusions.root(radius, body, soil, self._k)
        shape = shape_index(ROOT, corner)
        return _points(xy, depth, across * step, shape, (along - across) * step, axis)

    def lenses(self, ix: int, iy: int) -> Buried:
        """Draw the moisture lenses of a tile: the near and the far flash of each."""
        table = self._scene.lenses
        rng = stream(self._seed, "lenses", ix, iy)
        count = rng.poisson(table.density * TILE**2)
        xy = _draw_places(rng, count, ix, iy)
        radius = rng.uniform(*table.radius, count)
        depth = rng.uniform(*table.depth, count)
        contrast = rng.normal(0, table.contrast, count)
        soil = self._spectra.permittivity(depth)
        size = inclusions.lens(radius, contrast, table.thickness, self._k)
        size = size * np.sinc(self._k * np.sqrt(soil - LEVEL**2) * table.thickness / np.pi)
        return _points(
            np.tile(xy, (2, 1)),
            np.tile(depth, 2),
            np.concatenate([size, size.conj()]),
            np.full(2 * count, LENS),
            reach=np.concatenate([radius, -radius]),
        )

    def heterogeneity(self, ix: int, iy: int) -> Buried:
        """Draw the points of the uneven soil, each for its share of the volume.

        There are more of them where less loss lies above.
        """
        table = self._scene.heterogeneity
        rng = stream(self._seed, "heterogeneity", ix, iy)
        cells = cell_counts(self._density * TILE**2)
        count = math.prod(cells)
        xy = (jittered(rng, cells) + [ix, iy]) * TILE
        root = rng.random(count)
        depth = table.depth * root**2
        # Of each point: the tile's area over the probability density of the depth.
        volume = TILE**2 / count * 2 * table.depth * root
        soil = self._spectra.permittivity(depth)
        strength = inclusions.volume_backscatter(
            self._k, LEVEL, soil, table.deviation, table.horizontal, table.vertical
        )
        z = rng.standard_normal((count, 2)).view(np.complex128)[:, 0] / math.sqrt(2)
        return _points(xy, depth, z * np.sqrt(strength * volume), np.full(count, VOLUME))


def stone_radii(table: Stones, chance: FloatArray) -> FloatArray:
    """Return radii, m, at the given chances: power law ``N(>r) ~ r^-D`` between the bounds."""
    low, high = table.radius
    span = 1 - (low / high) ** table.exponent
    return low * (1 - chance * span) ** (-1 / table.exponent)


def _draw_places(rng: np.random.Generator, count: int, ix: int, iy: int) -> FloatArray:
    """Draw places (point, 2) in a tile, m."""
    return (rng.random((count, 2)) + np.array([ix, iy])) * TILE


def _points(
    xy: FloatArray,
    depth: FloatArray,
    amplitude: Complex128Array | FloatArray,
    shape: IndexArray,
    axial: Complex128Array | FloatArray | None = None,
    axis: FloatArray | None = None,
    reach: FloatArray | None = None,
) -> Buried:
    """Return buried points; what is not given is zero."""
    count = len(xy)
    if axial is None:
        axial = np.zeros(count)
    if axis is None:
        axis = np.zeros((count, 3))
    if reach is None:
        reach = np.zeros(count)
    round_amplitude = amplitude.astype(np.complex64)
    return Buried(xy, depth, round_amplitude, axial.astype(np.complex64), axis, shape, reach)


_NOTHING = _points(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0, np.intp))


def _concatenate(groups: list[Buried]) -> Buried:
    """Return the points of all groups one after the other."""
    columns = zip(*(groups or [_NOTHING]), strict=True)
    return Buried._make(np.concatenate(column) for column in columns)


class SubsurfaceLayer:
    """The clutter in the soil, as a scan sees it.

    Parameters
    ----------
    field : SubsurfaceField
        The clutter.
    spectra : BuriedSpectra
        Its spectra.
    laws : ndarray (shape, sine)
        Factors of the amplitudes, at uniform sines from 0 to 1.
    """

    def __init__(self, field: SubsurfaceField, spectra: BuriedSpectra, laws: FloatArray) -> None:
        self._field = field
        self._spectra = spectra
        self._laws = laws.astype(np.float32)

    def echoes(self, view: ScanView) -> PointEchoes:
        """Return the points in view, each at the surface above it."""
        buried = self._field.within(view.corners)
        inside = view.inside(buried.xy)
        buried = Buried._make(column[inside] for column in buried)
        points = np.zeros((len(buried.xy), 3))
        towards = view.towards(buried.xy)
        points[:, :2] = buried.xy + buried.reach[:, None] * towards
        sine = view.sine(points)
        nearest = np.round(sine * (self._laws.shape[1] - 1)).astype(np.intp)
        law = self._laws[buried.shape, nearest]
        amplitude = _polarized(buried, towards, sine, self._spectra) * law[:, None]
        return self._spectra.point_echoes(points, buried.shape, buried.depth, sine, amplitude)


def _polarized(
    buried: Buried, towards: FloatArray, sine: FloatArray, spectra: BuriedSpectra
) -> ComplexArray:
    """Return amplitudes (point, 3) of HH, VV and cross, with t12² of each.

    The axial amplitude counts by the axis's direction across the ray in the soil.
    """
    amplitude = np.zeros((len(sine), 3), np.complex64)
    amplitude[:, 0] = buried.round
    amplitude[:, 1] = buried.round
    with_axis = np.flatnonzero(buried.axial)
    sine_in_soil = sine[with_axis] / np.sqrt(spectra.permittivity(buried.depth[with_axis]))
    axis = buried.axis[with_axis]
    view_direction = towards[with_axis]
    along_h = axis[:, 1] * view_direction[:, 0] - axis[:, 0] * view_direction[:, 1]
    level = (axis[:, :2] * view_direction).sum(axis=1)
    along_v = axis[:, 2] * sine_in_soil - level * np.sqrt(1 - sine_in_soil**2)
    dyad = np.stack([along_h**2, along_v**2, along_h * along_v], axis=1)
    amplitude[with_axis] += (buried.axial[with_axis, None] * dyad).astype(np.complex64)
    # The factor has a name: NumPy multiplies a large nameless array in place, by another loop whose
    # last bits differ, and a point's echo would depend on how many points are in view.
    entry = spectra.transmission(buried.depth, sine).astype(np.complex64)
    return amplitude * entry


class HoleLayer:
    """Edges of refilled holes: the near and far flash of the wall's ends and of the cap.

    Parameters
    ----------
    holes : tuple of Hole
        The holes.
    wall : float
        Rms unevenness of their walls, m.
    ground : LayeredGround
        The soil and the tones.
    spectra : BuriedSpectra
        Spectra of buried points.
    """

    def __init__(
        self, holes: tuple[Hole, ...], wall: float, ground: LayeredGround, spectra: BuriedSpectra
    ) -> None:
        self._holes = holes
        self._wall = wall
        self._spectra = spectra
        self._k = float(ground.wavenumber[ground.middle])
        self._soil = complex(ground.media[0][ground.middle])
        self._contrast = []
        for hole in holes:
            fill = hole.fill(ground.media[0], ground.frequency)
            self._contrast.append(fill[ground.middle] - self._soil)
        self._xy = np.array([[h.x, h.y] for h in holes]).reshape(-1, 2)

    def echoes(self, view: ScanView) -> PointEchoes:
        """Return the edges in view: six points a hole, the three near ones first."""
        visible = np.flatnonzero(view.inside(self._xy))
        count = visible.size
        points = np.zeros((count, 6, 3))
        amplitude = np.zeros((count, 6, 3), complex)
        depth = np.zeros((count, 6))
        middle = np.zeros((count, 3))
        middle[:, :2] = self._xy[visible]
        towards = view.towards(self._xy[visible])
        sine = view.sine(middle)
        for row, index in enumerate(visible):
            hole = self._holes[index]
            entry = self._spectra.transmission(np.zeros(1), sine[row : row + 1])[0]
            for side, first in ((1.0, 0), (-1.0, 3)):
                edges = slice(first, first + 3)
                amplitude[row, edges] = self._edge_amplitudes(
                    int(index), float(sine[row]), entry, side
                )
                # Upper end of the wall, lower end of the wall, cap.
                depth[row, first + 1] = hole.depth
                points[row, edges, :2] = middle[row, :2] + side * hole.radius * towards[row]
        return self._spectra.point_echoes(
            points.reshape(-1, 3),
            np.tile([WALL, WALL, CAP], 2 * count),
            depth.ravel(),
            np.repeat(sine, 6),
            amplitude.reshape(-1, 3),
        )

    def _edge_amplitudes(
        self, index: int, sine: float, entry: Complex128Array, side: float
    ) -> Complex128Array:
        """Return amplitudes (3, 3) of one side's edges: both ends of the wall, and the cap."""
        hole = self._holes[index]
        contrast = self._contrast[index]
        wall = wall_flash(hole, contrast, self._soil.real, self._wall, sine, self._k, side)
        amplitude = np.zeros((3, 3), complex)
        amplitude[0] = wall * entry * _COPOLAR
        amplitude[1] = -wall * entry * _COPOLAR
        amplitude[2, :2] = cap_flash(hole, self._soil, sine, self._k, side)
        return amplitude


def subsurface_layers(
    scene: Scene, holes: tuple[Hole, ...], ground: LayeredGround, density: float, seed: int
) -> list[ScattererLayer]:
    """Return the layers under the surface, none for what is off.

    Parameters
    ----------
    scene : Scene
        Its tables say what lies in the soil.
    holes : tuple of Hole
        The world's holes.
    ground : LayeredGround
        The soil and the tones.
    density : float
        Points of the uneven soil per m², unless the scene says.
    seed : int
        Seed of the world.
    """
    clutter = buried_clutter(scene)
    if not holes and not clutter:
        return []
    deepest = max(scene.stones.depth, scene.heterogeneity.depth, scene.lenses.depth[1], 0.4)

    cover = None
    if scene.grass.grown:
        cover = partial(through_grass, scene.grass, ground.frequency)
    spectra = BuriedSpectra(ground, spectral_shapes(scene, ground), deepest, cover)
    field = SubsurfaceField(scene, spectra, float(ground.wavenumber[ground.middle]), density, seed)
    layers: list[ScattererLayer] = []
    if clutter:
        layers.append(SubsurfaceLayer(field, spectra, incidence_laws(scene, ground)))
    if holes:
        layers.append(HoleLayer(holes, scene.holes.wall, ground, spectra))
    return layers
