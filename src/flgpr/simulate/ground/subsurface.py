"""Clutter under the surface: stones, roots, moisture lenses, uneven soil and refilled holes, as layers of points."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.bodies.echoes import Ground
from flgpr.simulate.ground import inclusions
from flgpr.simulate.ground.field import TILE, TILES_KEPT, cells_of, jittered, tiles_between
from flgpr.simulate.ground.holes import Hole, cap_flash, wall_flash
from flgpr.simulate.ground.layers import Layer, PointEchoes, View, through_grass
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Scene
from flgpr.simulate.scene.scene_tables import Roots, Stones

_CORNERS = np.geomspace(
    0.02, 50.0, 28
)  # corner frequencies over the band's middle for which shapes are made
_STONE = 0
_ROOT = _CORNERS.size
_VOLUME, _LENS, _WALL, _CAP = (2 * _CORNERS.size + i for i in range(4))
_ROOT_STEP = 0.02  # m between the points of a root
_COPOLAR = np.array([1.0, 1.0, 0.0])
_LEVEL = math.sin(math.radians(67))  # incidence at which shapes and tables are made
_SINES = np.linspace(0.02, 0.999, 128)
# of those tables
_NODES = 64
_DEPTHS = 48


class Buried(NamedTuple):
    """Points in the soil at ``xy`` (point, 2) and ``depth``, with unit vectors ``axis`` (point, 3).

    ``round`` is the amplitude for every field direction, ``axial`` what is added for fields along ``axis``, m;
    ``shape`` says which growth with frequency. ``reach`` is how far towards the radar the point stands from ``xy``: the
    near (+) and far (-) flash of a disc, m.
    """

    xy: FloatArray
    depth: FloatArray
    round: NDArray[np.complex64]
    axial: NDArray[np.complex64]
    axis: FloatArray
    shape: NDArray[np.intp]
    reach: FloatArray


def strewn(scene: Scene) -> list[str]:
    """Tell which of the tables of what is strewn through the soil are on."""
    amounts = {
        "stones": scene.stones.density,
        "roots": scene.roots.density,
        "lenses": scene.lenses.density,
        "heterogeneity": scene.heterogeneity.deviation,
    }
    return [name for name, amount in amounts.items() if getattr(scene, name).on and amount > 0]


def shapes(scene: Scene, ground: Ground) -> FloatArray:
    """Growth with frequency (shape, frequency) of all that lies in the soil, 1 at the band's middle."""
    k = ground.wavenumber
    middle = k.size // 2
    u = k / k[middle]
    soil = ground.real[-1]
    uneven = scene.heterogeneity
    volume = np.sqrt(
        inclusions.volume_backscatter(k, _LEVEL, soil, 1.0, uneven.horizontal, uneven.vertical)
    )
    thick = np.sinc(k * math.sqrt(soil - _LEVEL**2) * scene.lenses.thickness / np.pi)
    wall = u**-0.5 * np.exp(-0.5 * (2 * k * _LEVEL * scene.holes.wall) ** 2)
    grown = [inclusions.stone_shape(u / c) for c in _CORNERS] + [
        inclusions.root_shape(u / c) for c in _CORNERS
    ]
    grown += [volume, u**0.5 * thick, wall, u**-0.5]
    return np.array([g / g[middle] for g in grown])


def laws(scene: Scene, ground: Ground) -> FloatArray:
    """Change of each shape's amplitude (shape, sine) with the sine of incidence, at uniform sines from 0 to 1."""
    sine = np.linspace(0, 1, 256)
    law = np.ones((_CAP + 1, sine.size))
    uneven = scene.heterogeneity
    k = ground.wavenumber[ground.wavenumber.size // 2]

    def volume(s: FloatArray | float) -> FloatArray:
        return inclusions.volume_backscatter(
            k, s, ground.real[-1], 1.0, uneven.horizontal, uneven.vertical
        )

    law[_VOLUME] = np.sqrt(volume(sine) / volume(_LEVEL))
    law[_LENS] = np.maximum(sine, 0.05) ** -1.5
    return law


class BuriedSpectra:
    """Spectra of buried points as few functions of frequency, with weights by a point's shape and depth.

    A point of amplitude A at the band's middle, depth d and sine s echoes with
    ``A·t12²(s)·shape(f)·exp(-2jk0·d·(sqrt(ε(f) - s²) - n_c))`` beyond the delay of ``d·n_c``, n_c
    the root at the middle. The exponent is tabulated at one incidence, for to first order in loss
    and dispersion another incidence is another depth, ``d·sqrt(ε - s0²)/sqrt(ε - s²)``. t12² is
    taken at the band's middle.

    ``shapes`` (shape, frequency) are 1 there; ``cover`` gives the two-way amplitude (3, sine, frequency) of HH, VV and
    cross through what stands over the soil; ``tolerance`` is the part of the spectra's amplitude that the functions,
    ``basis`` (rank, 3, frequency), may leave out.
    """

    def __init__(
        self, ground: Ground, shapes: FloatArray, deepest: float,
        cover: Callable[[FloatArray], FloatArray] | None = None, tolerance: float = 0.01, ranks: int = 6,
    ) -> None:  # fmt: skip
        frequency = ground.frequency
        self._ground = ground
        self._deepest = deepest
        middle = Ground(ground.soil, None, frequency[frequency.size // 2 : frequency.size // 2 + 1])
        copolar = [
            [middle.entry_squared(s, layer)[:, 0] for s in _SINES]
            for layer in range(len(ground.real))
        ]
        h, v = np.moveaxis(np.array(copolar), -1, 0)
        self._entry = np.stack([h, v, np.sqrt(h * v)], axis=-1)
        self._tops = np.cumsum([0.0, *(layer.thickness for layer in ground.soil.layers)])
        depths = deepest * np.linspace(0, 1, _DEPTHS) ** 2
        nodes = np.unique(np.linspace(0, frequency.size - 1, _NODES).round().astype(int))
        loss = np.array([ground.dispersion(_LEVEL, d)[nodes] for d in depths])
        rows = shapes[:, None, nodes] * loss
        if cover is not None:
            over = cover(_SINES)
            self._entry *= over[:, :, frequency.size // 2].T
            growth = over.mean(axis=(0, 1))
            rows *= growth[nodes] / growth[frequency.size // 2]
        _, s, vt = np.linalg.svd(rows.reshape(-1, nodes.size), full_matrices=False)
        left = np.sqrt(np.cumsum((s**2)[::-1])[::-1] / np.sum(s**2))  # energy from each rank on
        kept = min(ranks, max(1, int(np.count_nonzero(left > tolerance))))
        self._weights = (rows @ vt[:kept].conj().T).astype(np.complex64)
        functions = vt[:kept]
        if nodes.size < frequency.size:
            functions = CubicSpline(frequency[nodes], functions, axis=1)(frequency)
        self.basis = np.repeat(functions[:, None], 3, axis=1)

    def layer(self, depth: FloatArray) -> NDArray[np.intp]:
        """Index of the soil's layer that holds each depth."""
        return np.searchsorted(self._tops[1:], depth, side="left").astype(np.intp)

    def permittivity(self, depth: FloatArray) -> FloatArray:
        """Real permittivity at the band's middle at each depth."""
        return np.asarray(np.array(self._ground.real)[self.layer(depth)])

    def delay(self, depth: FloatArray, sine: FloatArray) -> FloatArray:
        """Electrical path from the surface to each depth, ``Σ d_i·sqrt(ε_i - sin²θ)``, m."""
        bottoms = [*self._tops[1:], np.inf]
        path = np.zeros_like(depth)
        for top, bottom, eps in zip(self._tops, bottoms, self._ground.real, strict=True):
            path += np.clip(depth, top, bottom) * np.sqrt(eps - sine**2) - top * np.sqrt(
                eps - sine**2
            )
        return path

    def transmission(self, depth: FloatArray, sine: FloatArray) -> ComplexArray:
        """t12² (point, 3) of HH and VV into the layer that holds each depth, and their geometric mean for cross."""
        place = np.clip((sine - _SINES[0]) / (_SINES[1] - _SINES[0]), 0, _SINES.size - 1.001)
        cell = place.astype(int)
        part = (place - cell)[:, None]
        layer = self.layer(depth)
        return np.asarray(
            self._entry[layer, cell] * (1 - part) + self._entry[layer, cell + 1] * part
        )

    def weights(
        self, shape: NDArray[np.intp], depth: FloatArray, sine: FloatArray
    ) -> NDArray[np.complex64]:
        """Weights (point, rank) of the functions."""
        eps = self._ground.real[0]
        steeper = depth * np.sqrt((eps - _LEVEL**2) / (eps - sine**2))
        place = np.minimum(np.sqrt(steeper / self._deepest), 1.0) * (_DEPTHS - 1.001)
        cell = place.astype(int)
        part = (place - cell).astype(np.float32)[:, None]
        low, high = self._weights[shape, cell], self._weights[shape, cell + 1]
        return np.asarray(low + part * (high - low))


class SubsurfaceField:
    """What is strewn through the soil, drawn tile by tile, for the wavenumber in air at the band's middle.

    ``density`` is points of the uneven soil per m², unless the scene says.
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
        self._parts: list[Callable[[int, int], Buried]] = [
            getattr(self, name) for name in strewn(scene)
        ]

    def within(self, corners: FloatArray) -> Buried:
        """Points of every tile that touches the bounding box of ``corners``, a metre wider for what reaches over."""
        tiles = tiles_between(corners.min(axis=0) - 1, corners.max(axis=0) + 1)
        return _joined([self.tile(ix, iy) for ix, iy in tiles])

    def _make(self, ix: int, iy: int) -> Buried:
        """Make the points of the tile whose lower corner is (ix, iy)·TILE."""
        return _joined([make(ix, iy) for make in self._parts])

    def stones(self, ix: int, iy: int) -> Buried:
        """Stones of a tile, spheroids in every direction."""
        table = self._scene.stones
        rng = stream(self._seed, "stones", ix, iy)
        count = rng.poisson(table.density * TILE**2)
        xy = _place(rng, count, ix, iy)
        radius = stone_radii(table, rng.random(count))
        depth = radius + rng.random(count) * np.maximum(table.depth - radius, 0)
        body = rng.uniform(*table.permittivity, count)
        stretch = table.stretch ** rng.uniform(-1, 1, count)
        soil = self._spectra.permittivity(depth)
        size, corner = inclusions.stone(radius, body, soil, self._k)
        along, across = inclusions.spheroid(stretch, body, soil)
        axial = size * (along - across)
        axis = _directions(rng, count)
        return _points(xy, depth, size * across, _shape(_STONE, corner), axial, axis)

    def roots(self, ix: int, iy: int) -> Buried:
        """Roots that begin around a tile's points, as chains of points along their winding way."""
        table = self._scene.roots
        rng = stream(self._seed, "roots", ix, iy)
        count = rng.poisson(table.density * TILE**2)
        return _joined([self._root(table, rng, ix, iy) for _ in range(count)])

    def _root(self, table: Roots, rng: np.random.Generator, ix: int, iy: int) -> Buried:
        steps = max(1, round(table.length / _ROOT_STEP))
        radius = float(np.exp(rng.uniform(*np.log(np.maximum(table.radius, 1e-4)))))
        # A winding way: the direction wanders by about half a radian over ten centimetres.
        azimuth = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.22, steps))
        plunge = rng.normal(0, table.plunge)
        level = math.cos(plunge)
        axis = np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), np.full(steps, math.sin(plunge))],
            axis=1,
        )
        way = np.cumsum(axis, axis=0) - axis / 2 + (rng.random(steps) - 0.5)[:, None] * axis
        way *= table.length / steps
        start = _place(rng, 1, ix, iy)
        depth = radius + rng.exponential(table.depth) - way[:, 2] + way[steps // 2, 2]
        xy = start + way[:, :2] - way[steps // 2, :2]
        kept = depth > radius
        xy = xy[kept]
        depth = depth[kept]
        axis = axis[kept]
        body = table.permittivity * (1 - 1j * table.loss_tangent)
        along, across, corner = inclusions.root(
            radius, body, self._spectra.permittivity(depth), self._k
        )
        step = table.length / steps
        return _points(
            xy, depth, across * step, _shape(_ROOT, corner), (along - across) * step, axis
        )

    def lenses(self, ix: int, iy: int) -> Buried:
        """Moisture lenses of a tile: the near and the far flash of each."""
        table = self._scene.lenses
        rng = stream(self._seed, "lenses", ix, iy)
        count = rng.poisson(table.density * TILE**2)
        xy = _place(rng, count, ix, iy)
        radius = rng.uniform(*table.radius, count)
        depth = rng.uniform(*table.depth, count)
        contrast = rng.normal(0, table.contrast, count)
        soil = self._spectra.permittivity(depth)
        size = inclusions.lens(radius, contrast, table.thickness, self._k)
        size = size * np.sinc(self._k * np.sqrt(soil - _LEVEL**2) * table.thickness / np.pi)
        shape = np.full(2 * count, _LENS)
        both = np.concatenate([size, size.conj()])
        return _points(
            np.tile(xy, (2, 1)),
            np.tile(depth, 2),
            both,
            shape,
            reach=np.concatenate([radius, -radius]),
        )

    def heterogeneity(self, ix: int, iy: int) -> Buried:
        """Points of the uneven soil, each for its share of the volume; more of them where less loss lies above."""
        table = self._scene.heterogeneity
        rng = stream(self._seed, "heterogeneity", ix, iy)
        cells = cells_of(self._density * TILE**2)
        count = math.prod(cells)
        xy = (jittered(rng, cells) + [ix, iy]) * TILE
        root = rng.random(count)
        depth = table.depth * root**2
        volume = (
            TILE**2 / count * 2 * table.depth * root
        )  # over the probability density of the depth
        strength = inclusions.volume_backscatter(
            self._k,
            _LEVEL,
            self._spectra.permittivity(depth),
            table.deviation,
            table.horizontal,
            table.vertical,
        )
        z = rng.standard_normal((count, 2)).view(np.complex128)[:, 0] / math.sqrt(2)
        return _points(xy, depth, z * np.sqrt(strength * volume), np.full(count, _VOLUME))


def stone_radii(table: Stones, chance: FloatArray) -> FloatArray:
    """Radii (m) at the given chances: power law ``N(>r) ~ r^-D`` between the bounds."""
    low, high = table.radius
    rest = 1 - (low / high) ** table.exponent
    return np.asarray(low * (1 - chance * rest) ** (-1 / table.exponent))


def _place(rng: np.random.Generator, count: int, ix: int, iy: int) -> FloatArray:
    return (rng.random((count, 2)) + np.array([ix, iy])) * TILE


def _directions(rng: np.random.Generator, count: int) -> FloatArray:
    some = rng.standard_normal((count, 3))
    return np.asarray(some / np.linalg.norm(some, axis=1, keepdims=True))


def _shape(first: int, corner: FloatArray) -> NDArray[np.intp]:
    """Index of the shape whose corner frequency is nearest."""
    step = math.log(_CORNERS[1] / _CORNERS[0])
    nearest = np.round(np.log(corner / _CORNERS[0]) / step)
    return first + np.clip(nearest, 0, _CORNERS.size - 1).astype(np.intp)


def _points(
    xy: FloatArray, depth: FloatArray, amplitude: ComplexArray | FloatArray, shape: NDArray[np.intp],
    axial: ComplexArray | FloatArray | None = None, axis: FloatArray | None = None, reach: FloatArray | None = None,
) -> Buried:  # fmt: skip
    count = len(xy)
    return Buried(
        xy,
        depth,
        amplitude.astype(np.complex64),
        np.zeros(count, np.complex64) if axial is None else axial.astype(np.complex64),
        np.zeros((count, 3)) if axis is None else axis,
        shape,
        np.zeros(count) if reach is None else reach,
    )


_NOTHING = _points(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0, np.intp))


def _joined(parts: list[Buried]) -> Buried:
    return Buried._make(
        np.concatenate(column) for column in zip(*(parts or [_NOTHING]), strict=True)
    )


class SubsurfaceLayer:
    """What is strewn through the soil, as a scan sees it; ``laws`` (shape, sine from 0 to 1) multiply amplitudes."""

    def __init__(self, field: SubsurfaceField, spectra: BuriedSpectra, laws: FloatArray) -> None:
        self._field = field
        self._spectra = spectra
        self._laws = laws.astype(np.float32)

    def echoes(self, view: View) -> PointEchoes:
        """Give the points in view, each at the surface above it."""
        buried = self._field.within(view.corners)
        inside = view.inside(buried.xy)
        buried = Buried._make(column[inside] for column in buried)
        points = np.zeros((len(buried.xy), 3))
        away = view.centre[:2] - buried.xy
        towards = away / np.hypot(away[:, 0], away[:, 1])[:, None]
        points[:, :2] = buried.xy + buried.reach[:, None] * towards
        sine = view.sine(points)
        law = self._laws[buried.shape, np.round(sine * (self._laws.shape[1] - 1)).astype(np.intp)]
        amplitude = _polarized(buried, towards, sine, self._spectra) * law[:, None]
        weights = self._spectra.weights(buried.shape, buried.depth, sine)
        extra = self._spectra.delay(buried.depth, sine)
        return PointEchoes(
            points, extra, weights[:, :, None] * amplitude[:, None, :], self._spectra.basis
        )


def _polarized(
    buried: Buried, towards: FloatArray, sine: FloatArray, spectra: BuriedSpectra
) -> NDArray[np.complex64]:
    """Amplitude (point, 3) of HH, VV and cross: the axis's part by its direction across the ray, and t12² of each."""
    amplitude = np.zeros((len(sine), 3), np.complex64)
    amplitude[:, 0] = amplitude[:, 1] = buried.round
    some = np.flatnonzero(buried.axial)
    inside = sine[some] / np.sqrt(spectra.permittivity(buried.depth[some]))  # sine in the soil
    axis = buried.axis[some]
    look = towards[some]
    along_h = axis[:, 1] * look[:, 0] - axis[:, 0] * look[:, 1]
    along_v = axis[:, 2] * inside - (axis[:, :2] * look).sum(axis=1) * np.sqrt(1 - inside**2)
    dyad = np.stack([along_h**2, along_v**2, along_h * along_v], axis=1)
    amplitude[some] += (buried.axial[some, None] * dyad).astype(np.complex64)
    return np.asarray(amplitude * spectra.transmission(buried.depth, sine).astype(np.complex64))


class HoleLayer:
    """Edges of refilled holes, near and far flash each: ends of the wall, ``wall`` m uneven, and of the cap."""

    def __init__(
        self, holes: tuple[Hole, ...], wall: float, ground: Ground, spectra: BuriedSpectra
    ) -> None:
        self._holes = holes
        self._wall = wall
        self._spectra = spectra
        middle = ground.frequency.size // 2
        self._k = float(ground.wavenumber[middle])
        self._soil = complex(ground.media[0][middle])
        self._contrast = [
            h.fill(ground.media[0], ground.frequency)[middle] - self._soil for h in holes
        ]
        self._xy = np.array([[h.x, h.y] for h in holes]).reshape(-1, 2)

    def echoes(self, view: View) -> PointEchoes:
        """Give the edges in view: six points a hole."""
        seen = np.flatnonzero(view.inside(self._xy))
        points = np.zeros((seen.size, 6, 3))
        amplitude = np.zeros((seen.size, 6, 3), complex)
        depth = np.zeros((seen.size, 6))
        middle = np.zeros((seen.size, 3))
        middle[:, :2] = self._xy[seen]
        away = view.centre[:2] - middle[:, :2]
        towards = away / np.hypot(away[:, 0], away[:, 1])[:, None]
        sine = view.sine(middle)
        for row, index in enumerate(seen):
            hole = self._holes[index]
            s = float(sine[row])
            entry = self._spectra.transmission(np.zeros(1), sine[row : row + 1])[0]
            for side, first in ((1.0, 0), (-1.0, 3)):
                wall = wall_flash(
                    hole, self._contrast[index], self._soil.real, self._wall, s, self._k, side
                )
                amplitude[row, first] = wall * entry * _COPOLAR
                amplitude[row, first + 1] = -wall * entry * _COPOLAR
                amplitude[row, first + 2, :2] = cap_flash(hole, self._soil, s, self._k, side)
                depth[row, first + 1] = hole.depth
                points[row, first : first + 3, :2] = (
                    middle[row, :2] + side * hole.radius * towards[row]
                )
        flat = depth.ravel()
        level = np.repeat(sine, 6)
        weights = self._spectra.weights(np.tile([_WALL, _WALL, _CAP], 2 * seen.size), flat, level)
        coefficient = (weights[:, :, None] * amplitude.reshape(-1, 1, 3)).astype(np.complex64)
        extra = self._spectra.delay(flat, level)
        return PointEchoes(points.reshape(-1, 3), extra, coefficient, self._spectra.basis)


def subsurface_layers(
    scene: Scene, holes: tuple[Hole, ...], ground: Ground, density: float, seed: int
) -> list[Layer]:
    """Make the layers under the surface, none for what is off; the scene may say another ``density`` per m²."""
    if not holes and not strewn(scene):
        return []
    middle = ground.frequency.size // 2
    deepest = max(scene.stones.depth, scene.heterogeneity.depth, scene.lenses.depth[1], 0.4)
    cover = (
        (lambda sine: through_grass(scene.grass, ground.frequency, sine))
        if scene.grass.grown
        else None
    )
    spectra = BuriedSpectra(ground, shapes(scene, ground), deepest, cover)
    field = SubsurfaceField(scene, spectra, float(ground.wavenumber[middle]), density, seed)
    layers: list[Layer] = []
    if strewn(scene):
        layers.append(SubsurfaceLayer(field, spectra, laws(scene, ground)))
    if holes:
        layers.append(HoleLayer(holes, scene.holes.wall, ground, spectra))
    return layers
