"""Layers of point scatterers, grass among them: what the ground and all that fills it hand to the sum over pairs.

Whatever a point's spectrum times its beam is, it is close to ``Σ_r value(f_r)·H_r(f)`` with few tones f_r, one set for
all points: a skeleton decomposition (Goreinov, Tyrtyshnikov & Zamarashkin 1997). At each f_r the beam of every antenna
and the shadow on every point are plain numbers, so that all layers can be summed over their points at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lstsq, qr

from flgpr.model import heading_matrix
from flgpr.model.arrays import FloatArray
from flgpr.simulate.ground.field import Scatterers, SurfaceField
from flgpr.simulate.ground.terrain import Terrain
from flgpr.simulate.radar.spread import ArrayState, Spreader
from flgpr.simulate.scene import scene_tables as tables
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Surface

if TYPE_CHECKING:
    from flgpr.simulate.ground.shadow import Shadows

_SAMPLE = 240  # points of a layer by which the tones are chosen
_COSINES = np.linspace(
    0.35, 1, 14
)  # two-way cosines off the axis, for a layer that has no point in view
_TOLERANCE = 0.01
_MOST = 8


class PointEchoes(NamedTuple):
    """Point scatterers as one scan sees them.

    ``points`` (point, 3) are in the lane frame with z counted from the ground; a buried scatterer stands at the surface
    above it. ``extra`` is the electrical path that the way to each antenna has beyond its straight line, m: of a buried
    scatterer ``d·sqrt(ε - sin²θ)``, zero on the surface. It delays; spreading and antenna patterns stay geometric.
    ``coefficient`` (point, rank, 3) are the amplitudes HH, VV and cross (square root of the cross section, m) for every
    spectral function of ``basis`` (rank, 3, frequency).
    """

    points: FloatArray
    extra: FloatArray
    coefficient: NDArray[np.complex64]
    basis: NDArray[Any]


class View:
    """What one scan sees, for layers to choose and weigh their scatterers by.

    ``footprint`` is least and greatest x and y in the vehicle's frame, ``corners`` (4, 2) the same in the lane frame,
    and ``centre`` the mean place of the antennas. The pose is the true one; without terrain the ground is flat.
    """

    def __init__(
        self, footprint: tuple[float, float, float, float], pose: FloatArray, array: ArrayState,
        terrain: Terrain | None = None, shadows: Shadows | None = None,
    ) -> None:  # fmt: skip
        x_min, x_max, y_min, y_max = footprint
        self.terrain = None if terrain is None or terrain.flat else terrain
        self.shadows = shadows
        self.footprint = footprint
        self.pose = pose
        self.array = array
        self._turn = heading_matrix(pose[3])[:2, :2]
        own = np.array([[x_min, y_min], [x_max, y_min], [x_min, y_max], [x_max, y_max]])
        self.corners = own @ self._turn.T + pose[:2]
        self.centre = array.position.mean(axis=0)

    def inside(self, xy: FloatArray) -> NDArray[np.bool_]:
        """Tell which places (point, 2) of the lane frame lie in the footprint."""
        local = (xy - self.pose[:2]) @ self._turn
        x_min, x_max, y_min, y_max = self.footprint
        x, y = local[:, 0], local[:, 1]
        return np.asarray((x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max))

    def sine(self, points: FloatArray) -> FloatArray:
        """Sine of the array's centre's angle of incidence on the ground at points (point, 3) that count z from it."""
        if self.terrain is not None:
            return self.terrain.local_sine(points, self.centre)
        offset = points - self.centre
        return np.asarray(np.hypot(offset[:, 0], offset[:, 1]) / np.linalg.norm(offset, axis=1))


class Layer(Protocol):
    """A set of point scatterers fixed in the world."""

    def echoes(self, view: View) -> PointEchoes:
        """Give the scatterers that ``view`` sees; the same for the same view, whatever was asked before."""
        ...


class SineSpectra:
    """Spectra by incidence as few functions of frequency, ``basis`` (rank, 3, frequency), with weights by its sine.

    ``spectra`` (3, sine, frequency) are amplitudes of HH, VV and cross at uniform sines.
    """

    def __init__(self, sines: FloatArray, spectra: FloatArray, ranks: int) -> None:
        self._sines = sines
        self._weights = np.zeros((sines.size, ranks, 3))
        self.basis = np.zeros((ranks, 3, spectra.shape[-1]))
        parts = [np.linalg.svd(spectrum, full_matrices=False) for spectrum in spectra[:2]]
        same = np.array_equal(spectra[2], spectra[0])
        parts.append(parts[0] if same else np.linalg.svd(spectra[2], full_matrices=False))
        for channel, (u, s, vt) in enumerate(parts):
            kept = min(ranks, s.size)
            self._weights[:, :kept, channel] = u[:, :kept] * s[:kept]
            self.basis[:kept, channel] = vt[:kept]

    def weights(self, sine: FloatArray) -> FloatArray:
        """Weights (point, rank, 3) of the functions at sines (point,)."""
        step = self._sines[1] - self._sines[0]
        position = np.clip((sine - self._sines[0]) / step, 0, self._sines.size - 1.001)
        cell = position.astype(int)
        part = (position - cell)[:, None, None]
        return np.asarray(self._weights[cell] * (1 - part) + self._weights[cell + 1] * part)


class SurfaceLayer:
    """The rough surface's scatterers; the spectra are the square root of σ⁰."""

    def __init__(self, field: SurfaceField, spectra: SineSpectra) -> None:
        self._field = field
        self._spectra = spectra

    def echoes(self, view: View) -> PointEchoes:
        """Give the scatterers in view."""
        scatterers = self._field.within(view.corners)
        inside = view.inside(scatterers.xy)
        points = np.zeros((np.count_nonzero(inside), 3))
        points[:, :2] = scatterers.xy[inside]
        weight = self._spectra.weights(view.sine(points))
        coefficient = (weight * scatterers.amplitude[inside][:, None, :]).astype(np.complex64)
        return PointEchoes(points, np.zeros(len(points)), coefficient, self._spectra.basis)


class Skeleton:
    """Tones (``nodes``) and functions (rank, frequency) for layers' spectra, chosen by a view of some scatterers."""

    def __init__(self, layers: Iterable[Layer], view: View, frequency: FloatArray) -> None:
        self._array = view.array
        self._frequency = frequency
        found = [layer.echoes(view) for layer in layers]
        if frequency.size == 1 or not found:
            self._tones = np.array([0])
            self.functions = np.ones((1, frequency.size))
        else:
            self._tones, self.functions = _choose(
                np.concatenate([self._rows(echoes) for echoes in found])
            )
        self.nodes = frequency[self._tones]

    def values(self, echoes: PointEchoes) -> NDArray[np.complex64]:
        """Give the amplitudes (point, 3, rank) of a layer's scatterers at the nodes."""
        at_nodes = echoes.basis[:, :, self._tones].astype(np.complex64)
        return np.stack([echoes.coefficient[..., c] @ at_nodes[:, c] for c in range(3)], axis=1)

    def _rows(self, echoes: PointEchoes) -> NDArray[Any]:
        """Spectra times beams (row, frequency) of some points of a layer, each polarization's of mean square one."""
        spectra, cosine = self._samples(echoes)
        rows = (
            spectra * (cosine[:, None] ** (0.5 * self._array.exponents(self._frequency)))[:, None]
        )
        size = np.sqrt(np.mean(np.abs(rows) ** 2, axis=(0, 2), keepdims=True))
        return (rows / (size + 1e-300)).reshape(-1, self._frequency.size)

    def _samples(self, echoes: PointEchoes) -> tuple[NDArray[Any], FloatArray]:
        """Spectra (sample, 3, frequency) and two-way cosines (sample,) off the axis, for one pair after the other."""
        array = self._array
        if len(echoes.points) < _SAMPLE // 4:
            ranks = len(echoes.basis)
            return np.repeat(echoes.basis, _COSINES.size, axis=0), np.tile(_COSINES, ranks)
        chosen = np.linspace(0, len(echoes.points) - 1, _SAMPLE).astype(int)
        pair = np.arange(_SAMPLE) % array.tx.size
        cosine = np.ones(_SAMPLE)
        for side in (array.tx, array.rx):
            ray = echoes.points[chosen] - array.position[side[pair]]
            cosine *= np.maximum(ray @ array.boresight / np.linalg.norm(ray, axis=1), 0.0)
        return np.einsum("irc,rcf->icf", echoes.coefficient[chosen], echoes.basis), cosine


def _choose(rows: NDArray[Any]) -> tuple[NDArray[np.intp], NDArray[Any]]:
    """Tones (rank,) and functions (rank, frequency) that carry rows (row, frequency) to the tolerance."""
    some = np.unique(np.linspace(0, rows.shape[1] - 1, 96).round().astype(int))
    flat = rows[:, some]
    order = qr(flat, mode="r", pivoting=True)[1]
    for count in range(1, min(_MOST, some.size) + 1):
        kept = np.sort(order[:count])
        left = flat - flat[:, kept] @ lstsq(flat[:, kept], flat)[0]
        if np.linalg.norm(left) < _TOLERANCE * np.linalg.norm(flat):
            break
    tones = some[kept]
    return tones, lstsq(rows[:, tones], rows)[0]


def sum_layers(
    layers: Iterable[Layer], view: View, spreader: Spreader, skeleton: Skeleton
) -> NDArray[np.complex64]:
    """Sum the echoes of all layers, taken at the skeleton's tones, over pairs and tones, as the Spreader does."""
    every = [layer.echoes(view) for layer in layers]
    if not every:
        return np.zeros(
            (4 if view.array.dipoles else 3, view.array.tx.size, spreader.count), np.complex64
        )
    points = np.concatenate([echoes.points for echoes in every])
    extra = np.concatenate([echoes.extra for echoes in every])
    values = np.concatenate([skeleton.values(echoes) for echoes in every])
    if view.terrain is not None:
        points[:, 2] += view.terrain.relief(points[:, :2])[:, 0]
    if view.shadows is not None:
        view.shadows.darken(values, points, skeleton.nodes)
    return spreader(points, values, skeleton.functions, view.array, extra, skeleton.nodes)


_RANKS = 2
_SLANTS = np.linspace(
    0.0, 15.0, 128
)  # of a ray's way through the grass, over its height, times what V suffers more
_LEAST_COSINE = 0.05


def slants(grass: tables.Grass, sine: ArrayLike) -> FloatArray:
    """Optical depth (3, ...) of the whole layer along a ray over that of H at nadir: H, V, and their mean for cross.

    ``1/cosθ`` of H, ``(cos²θ + upright·sin²θ)/cosθ`` of V (Wigneron et al. 2017).
    """
    sine = np.asarray(sine, dtype=float)
    cosine = np.sqrt(np.maximum(1 - sine**2, _LEAST_COSINE**2))
    h = 1 / cosine
    v = (cosine**2 + grass.upright * sine**2) / cosine
    return np.stack([h, v, (h + v) / 2])


def optical_depth(grass: tables.Grass, frequency: ArrayLike) -> FloatArray:
    """One-way optical depth of H at nadir, nepers of power: ``b·W·f/1.4 GHz`` for frequencies in Hz."""
    return np.asarray(grass.loss * grass.water * np.asarray(frequency, dtype=float) / 1.4e9)


def through_grass(
    grass: tables.Grass, frequency: ArrayLike, sine: ArrayLike, above: float = 1.0
) -> FloatArray:
    """Two-way factor (3, ..., frequency) of HH, VV and cross of what has the part ``above`` of the grass over it."""
    way = slants(grass, sine)[..., None]
    if not grass.grown:
        return np.ones(way.shape[:-1] + np.shape(frequency))
    return np.asarray(np.exp(-above * optical_depth(grass, frequency) * way))


def albedo(grass: tables.Grass, frequency: ArrayLike) -> FloatArray:
    """Single-scattering albedo at frequencies in Hz, at most 1."""
    grown = grass.albedo * (np.asarray(frequency, dtype=float) / 1.4e9) ** grass.growth
    return np.asarray(np.minimum(grown, 1.0))


class GrassField(SurfaceField):
    """Scatterers with a third coordinate, their height as a part of the grass's."""

    def _make(self, ix: int, iy: int) -> Scatterers:
        flat = super()._make(ix, iy)
        height = stream(self.seed, "grass height", ix, iy).random(self.per_tile)
        return Scatterers(np.column_stack([flat.xy, height]), flat.amplitude)


class GrassLayer:
    """The grass's own scatterers, ``density`` per m².

    Each gives ``1.5·ω·κ_p(f, θ)`` of its volume, weakened by the grass above it; over the layer that sums to
    ``σ⁰ = 0.75·ω·cosθ·(1 - exp(-2τ_p/cosθ))``, the echo of a layer of small particles (Ulaby & Long 2014, Sec. 11-5).
    """

    def __init__(
        self, grass: tables.Grass, density: float, seed: int, frequency: FloatArray
    ) -> None:
        self.grass = grass
        like = {
            name: getattr(grass, name)
            for name in ("cross_db", "correlation", "texture_shape", "texture_length")
        }
        self._field = GrassField(Surface(**like), (), density, seed, name="grass")
        depth = optical_depth(grass, frequency)
        u, s, vt = np.linalg.svd(
            np.sqrt(1.5 * albedo(grass, frequency) * depth) * np.exp(-np.outer(_SLANTS, depth)),
            False,
        )
        ranks = min(_RANKS, s.size)
        self._weights = (u[:, :ranks] * s[:ranks]).T
        self.basis = np.repeat(vt[:ranks, None], 3, axis=1)

    def echoes(self, view: View) -> PointEchoes:
        """Give the scatterers in view."""
        found = self._field.within(view.corners)
        inside = view.inside(found.xy[:, :2])
        points = found.xy[inside]
        amplitude = found.amplitude[inside]
        above = 1 - points[:, 2]
        points[:, 2] *= self.grass.height
        sine = view.sine(points)
        way = slants(self.grass, sine)
        thicker = way * np.sqrt(np.maximum(1 - sine**2, _LEAST_COSINE**2))  # κ_p over that of H
        thicker[2] = 1.0  # cross_db counts from HH
        weight = np.empty((len(points), len(self._weights), 3), np.float32)
        for channel in range(3):
            for rank, row in enumerate(self._weights):
                weight[:, rank, channel] = np.interp(way[channel] * above, _SLANTS, row)
        coefficient = weight * (amplitude * np.sqrt(thicker).T)[:, None, :]
        return PointEchoes(
            points, np.zeros(len(points)), coefficient.astype(np.complex64), self.basis
        )
