"""Layers of point scatterers, grass among them: what the sum over pairs takes from the ground.

Whatever a point's spectrum times its beam is, it is close to ``Σ_r value(f_r)·H_r(f)`` with few
tones f_r, one set for all points: a skeleton decomposition (Goreinov, Tyrtyshnikov & Zamarashkin
1997). At each f_r the beam of every antenna and the shadow on every point are plain numbers, so
that all layers can be summed over their points at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from scipy.linalg import lstsq, qr

from flgpr.model import heading_matrix
from flgpr.simulate.ground.field import Scatterers, SurfaceField
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.radar.spread import ArrayState, Spreader
from flgpr.simulate.scene import scene_tables as tables
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Surface
from flgpr.types import AnyArray, ArrayLike, BoolArray, ComplexArray, FloatArray, IndexArray, floats

if TYPE_CHECKING:
    from flgpr.simulate.ground.shadow import Shadows

_SAMPLE = 240  # points of a layer by which the tones are chosen
# Two-way cosines off the axis, for a layer that has no point in view.
_COSINES = np.linspace(0.35, 1, 14)
# Two-way cosine, whatever its sign, down to which dipoles' samples weigh ever more. Their pattern
# does not depend on frequency, so that any weight would do; this one keeps lanes as they were made.
_LEAST_OF_DIPOLES = 1e-3
_TOLERANCE = 0.01  # of the spectra's norm that the chosen tones may leave out
_CANDIDATES = 96  # tones among which they are chosen
_MOST_TONES = 8


class PointEchoes(NamedTuple):
    """Point scatterers as one scan sees them.

    ``points`` (point, 3) are in the lane frame with z counted from the ground; a buried scatterer
    stands at the surface above it. ``extra`` is the electrical path that the way to each antenna
    has beyond its straight line, m: of a buried scatterer ``d·sqrt(ε - sin²θ)``, zero on the
    surface. It delays; spreading and antenna patterns stay geometric. ``coefficient`` (point, rank,
    3) are the amplitudes HH, VV and cross (square root of the cross section, m) for every spectral
    function of ``basis`` (rank, 3, frequency).
    """

    points: FloatArray
    extra: FloatArray
    coefficient: ComplexArray
    basis: AnyArray


class ScanView:
    """What one scan sees, for layers to choose and weigh their scatterers by.

    Parameters
    ----------
    footprint : tuple of float
        Least and greatest x, then y, of the ground in view, in the vehicle's frame, m.
    pose : ndarray (6,)
        True pose of the scan.
    array : ArrayState
        The antennas.
    terrain : TerrainHeights, optional
        Without it the ground is flat.
    shadows : Shadows, optional
        Without them nothing throws a shadow.

    Attributes
    ----------
    corners : ndarray (4, 2)
        Corners of the footprint in the lane frame, m.
    centre : ndarray (3,)
        Mean place of the antennas in the lane frame, m.
    """

    def __init__(
        self,
        footprint: tuple[float, float, float, float],
        pose: FloatArray,
        array: ArrayState,
        terrain: TerrainHeights | None = None,
        shadows: Shadows | None = None,
    ) -> None:
        x_min, x_max, y_min, y_max = footprint
        self.terrain = None if terrain is None or terrain.flat else terrain
        self.shadows = shadows
        self.footprint = footprint
        self.pose = pose
        self.array = array
        self._turn = heading_matrix(pose[3])[:2, :2]
        in_vehicle = np.array([[x_min, y_min], [x_max, y_min], [x_min, y_max], [x_max, y_max]])
        self.corners = in_vehicle @ self._turn.T + pose[:2]
        self.centre = array.position.mean(axis=0)

    def inside(self, xy: FloatArray) -> BoolArray:
        """Return which places (point, 2) of the lane frame lie in the footprint."""
        in_vehicle = (xy - self.pose[:2]) @ self._turn
        x = in_vehicle[:, 0]
        y = in_vehicle[:, 1]
        x_min, x_max, y_min, y_max = self.footprint
        return (x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max)

    def towards(self, xy: FloatArray) -> FloatArray:
        """Return the level directions (point, 2) from places (point, 2) to the array's centre."""
        offset = self.centre[:2] - xy
        return offset / np.hypot(offset[:, 0], offset[:, 1])[:, None]

    def sine(self, points: FloatArray) -> FloatArray:
        """Return the sines (point,) of the angles of incidence from the array's centre.

        Points (point, 3) count z from the ground.
        """
        if self.terrain is not None:
            return self.terrain.local_sine(points, self.centre)
        offset = points - self.centre
        return np.hypot(offset[:, 0], offset[:, 1]) / np.linalg.norm(offset, axis=1)


class ScattererLayer(Protocol):
    """A set of point scatterers fixed in the world."""

    def echoes(self, view: ScanView) -> PointEchoes:
        """Return the scatterers in a view, the same whatever was asked before."""
        ...


class SineSpectra:
    """Spectra by incidence, as few functions of frequency with weights by the sine.

    Parameters
    ----------
    sines : ndarray (sine,)
        Uniform sines of the angle of incidence.
    spectra : ndarray (3, sine, frequency)
        Amplitudes of HH, VV and cross.
    ranks : int
        Number of functions for each of the three.

    Attributes
    ----------
    basis : ndarray (rank, 3, frequency)
        The functions.
    """

    def __init__(self, sines: FloatArray, spectra: FloatArray, ranks: int) -> None:
        self._sines = sines
        self._weights = np.zeros((sines.size, ranks, 3))
        self.basis = np.zeros((ranks, 3, spectra.shape[-1]))
        factors = [np.linalg.svd(spectrum, full_matrices=False) for spectrum in spectra[:2]]
        if np.array_equal(spectra[2], spectra[0]):
            factors.append(factors[0])
        else:
            factors.append(np.linalg.svd(spectra[2], full_matrices=False))
        for channel, (u, s, vt) in enumerate(factors):
            count = min(ranks, s.size)
            self._weights[:, :count, channel] = u[:, :count] * s[:count]
            self.basis[:count, channel] = vt[:count]

    def weights(self, sine: FloatArray) -> FloatArray:
        """Return the weights (point, rank, 3) of the functions at sines (point,)."""
        step = self._sines[1] - self._sines[0]
        position = np.clip((sine - self._sines[0]) / step, 0, self._sines.size - 1.001)
        cell = position.astype(int)
        fraction = (position - cell)[:, None, None]
        low = self._weights[cell]
        high = self._weights[cell + 1]
        return low * (1 - fraction) + high * fraction


class SurfaceLayer:
    """The rough surface's scatterers; the spectra are the square root of σ⁰."""

    def __init__(self, field: SurfaceField, spectra: SineSpectra) -> None:
        self._field = field
        self._spectra = spectra

    def echoes(self, view: ScanView) -> PointEchoes:
        """Return the scatterers in view."""
        scatterers = self._field.within(view.corners)
        inside = view.inside(scatterers.xy)
        points = np.zeros((np.count_nonzero(inside), 3))
        points[:, :2] = scatterers.xy[inside]
        weight = self._spectra.weights(view.sine(points))
        coefficient = (weight * scatterers.amplitude[inside][:, None, :]).astype(np.complex64)
        return PointEchoes(points, np.zeros(len(points)), coefficient, self._spectra.basis)


class Skeleton:
    """Few tones, and functions of frequency, that carry the spectra of all layers.

    Parameters
    ----------
    layers : iterable of ScattererLayer
        The layers to be summed.
    view : ScanView
        Its scatterers decide which tones are chosen.
    frequency : ndarray (frequency,)
        All tones, Hz.

    Attributes
    ----------
    nodes : ndarray (rank,)
        The chosen tones, Hz.
    functions : ndarray (rank, frequency)
        H_r, by which the values at the nodes are carried to all tones.
    """

    def __init__(
        self, layers: Iterable[ScattererLayer], view: ScanView, frequency: FloatArray
    ) -> None:
        self._array = view.array
        self._frequency = frequency
        layer_echoes = [layer.echoes(view) for layer in layers]
        if frequency.size == 1 or not layer_echoes:
            self._tones = np.array([0])
            self.functions = np.ones((1, frequency.size))
        else:
            rows = np.concatenate([self._rows(echoes) for echoes in layer_echoes])
            self._tones, self.functions = _choose_tones(rows)
        self.nodes = frequency[self._tones]

    def values(self, echoes: PointEchoes) -> ComplexArray:
        """Return the amplitudes (point, 3, rank) of a layer's scatterers at the nodes."""
        at_nodes = echoes.basis[:, :, self._tones].astype(np.complex64)
        channels = [echoes.coefficient[..., c] @ at_nodes[:, c] for c in range(3)]
        return np.stack(channels, axis=1)

    def _rows(self, echoes: PointEchoes) -> AnyArray:
        """Return spectra times beams (row, frequency) of some points of a layer.

        The rows of each polarization have mean square one.
        """
        spectra, cosine = self._samples(echoes)
        beam = cosine[:, None] ** (0.5 * self._array.exponents(self._frequency))
        rows = spectra * beam[:, None]
        size = np.sqrt(np.mean(np.abs(rows) ** 2, axis=(0, 2), keepdims=True))
        return (rows / (size + 1e-300)).reshape(-1, self._frequency.size)

    def _samples(self, echoes: PointEchoes) -> tuple[AnyArray, FloatArray]:
        """Return spectra (sample, 3, frequency) and two-way cosines (sample,) off the axis.

        Samples take one pair after the other.
        """
        array = self._array
        if len(echoes.points) < _SAMPLE // 4:
            ranks = len(echoes.basis)
            return np.repeat(echoes.basis, _COSINES.size, axis=0), np.tile(_COSINES, ranks)
        chosen = np.linspace(0, len(echoes.points) - 1, _SAMPLE).astype(int)
        pair = np.arange(_SAMPLE) % array.tx.size
        cosine = np.ones(_SAMPLE)
        for side in (array.tx, array.rx):
            ray = echoes.points[chosen] - array.position[side[pair]]
            off_axis = ray @ array.boresight / np.linalg.norm(ray, axis=1)
            cosine *= off_axis if array.dipoles else np.maximum(off_axis, 0.0)
        if array.dipoles:  # which see the ground behind them, too
            cosine = np.maximum(np.abs(cosine), _LEAST_OF_DIPOLES)
        return np.einsum("irc,rcf->icf", echoes.coefficient[chosen], echoes.basis), cosine


def _choose_tones(rows: AnyArray) -> tuple[IndexArray, AnyArray]:
    """Return tones (rank,) and functions (rank, frequency) that carry rows to the tolerance.

    ``rows`` are (row, frequency).
    """
    candidates = np.linspace(0, rows.shape[1] - 1, _CANDIDATES).round().astype(int)
    candidates = np.unique(candidates)
    columns = rows[:, candidates]
    order = qr(columns, mode="r", pivoting=True)[1]
    for count in range(1, min(_MOST_TONES, candidates.size) + 1):
        chosen = np.sort(order[:count])
        residual = columns - columns[:, chosen] @ lstsq(columns[:, chosen], columns)[0]
        if np.linalg.norm(residual) < _TOLERANCE * np.linalg.norm(columns):
            break
    tones = candidates[chosen]
    return tones, lstsq(rows[:, tones], rows)[0]


def sum_layers(
    layers: Iterable[ScattererLayer], view: ScanView, spreader: Spreader, skeleton: Skeleton
) -> ComplexArray:
    """Sum the echoes of all layers over pairs and tones.

    Parameters
    ----------
    layers : iterable of ScattererLayer
        The layers.
    view : ScanView
        What the scan sees.
    spreader : Spreader
        Sums the points.
    skeleton : Skeleton
        The tones at which spectra, beams and shadows are taken.

    Returns
    -------
    ndarray (channel, pair, frequency) of complex64
        HH, VV and cross of horns, HH, HV, VH and VV of dipoles.
    """
    layer_echoes = [layer.echoes(view) for layer in layers]
    if not layer_echoes:
        return np.zeros((view.array.channels, view.array.tx.size, spreader.count), np.complex64)
    points = np.concatenate([echoes.points for echoes in layer_echoes])
    extra = np.concatenate([echoes.extra for echoes in layer_echoes])
    values = np.concatenate([skeleton.values(echoes) for echoes in layer_echoes])
    if view.terrain is not None:
        points[:, 2] += view.terrain.relief(points[:, :2])[:, 0]
    if view.shadows is not None:
        view.shadows.darken(values, points, skeleton.nodes)
    return spreader(points, values, skeleton.functions, view.array, extra, skeleton.nodes)


_RANKS = 2
# Slants of a ray through the grass, times the height that lies over a scatterer.
_SLANTS = np.linspace(0.0, 15.0, 128)
_LEAST_COSINE = 0.05


def slants(grass: tables.Grass, sine: ArrayLike) -> FloatArray:
    """Return the optical depth of the grass along a ray over that of H at nadir.

    ``1/cosθ`` of H, ``(cos²θ + upright·sin²θ)/cosθ`` of V (Wigneron et al. 2017).

    Parameters
    ----------
    grass : Grass
        The scene's table.
    sine : array_like
        Sines of the angle of incidence.

    Returns
    -------
    ndarray (3, ...)
        Of H, of V, and their mean for cross.
    """
    sine = floats(sine)
    cosine = np.sqrt(np.maximum(1 - sine**2, _LEAST_COSINE**2))
    h = 1 / cosine
    v = (cosine**2 + grass.upright * sine**2) / cosine
    return np.stack([h, v, (h + v) / 2])


def optical_depth(grass: tables.Grass, frequency: ArrayLike) -> FloatArray:
    """Return the one-way optical depth of H at nadir, nepers of power: ``b·W·f/1.4 GHz``."""
    return grass.loss * grass.water * floats(frequency) / 1.4e9


def through_grass(
    grass: tables.Grass, frequency: ArrayLike, sine: ArrayLike, above: float = 1.0
) -> FloatArray:
    """Return the two-way factor of the amplitude of what stands in or under the grass.

    Parameters
    ----------
    grass : Grass
        The scene's table.
    frequency : array_like (frequency,)
        Frequencies, Hz.
    sine : array_like
        Sines of the angle of incidence.
    above : float
        Share of the grass's height that lies over the scatterer.

    Returns
    -------
    ndarray (3, ..., frequency)
        Of HH, VV and cross.
    """
    slant = slants(grass, sine)[..., None]
    if not grass.grown:
        return np.ones(slant.shape[:-1] + np.shape(frequency))
    return np.exp(-above * optical_depth(grass, frequency) * slant)


def albedo(grass: tables.Grass, frequency: ArrayLike) -> FloatArray:
    """Return the single-scattering albedo at frequencies in Hz, at most 1."""
    f = floats(frequency)
    unlimited = grass.albedo * (f / 1.4e9) ** grass.growth
    return np.minimum(unlimited, 1.0)


class GrassField(SurfaceField):
    """Scatterers with a third coordinate, their height as a share of the grass's."""

    def _make(self, ix: int, iy: int) -> Scatterers:
        """Make the scatterers of a tile, each at a random height in the grass."""
        flat = super()._make(ix, iy)
        height = stream(self.seed, "grass height", ix, iy).random(self.per_tile)
        return Scatterers(np.column_stack([flat.xy, height]), flat.amplitude)


class GrassLayer:
    """The grass's own scatterers.

    Each has ``1.5·ω·κ_p(f, θ)`` of its volume, weakened by the grass above it; over the layer that
    sums to ``σ⁰ = 0.75·ω·cosθ·(1 - exp(-2τ_p/cosθ))``, the echo of a layer of small particles
    (Ulaby & Long 2014, Sec. 11-5).

    Parameters
    ----------
    grass : Grass
        The scene's table.
    density : float
        Scatterers per m² of ground.
    seed : int
        Seed of the world.
    frequency : ndarray (frequency,)
        Tones, Hz.
    renewed : (float, int)
        As of :class:`~flgpr.simulate.ground.field.SurfaceField`.
    """

    def __init__(
        self,
        grass: tables.Grass,
        density: float,
        seed: int,
        frequency: FloatArray,
        renewed: tuple[float, int] = (0.0, 1),
    ) -> None:
        self.grass = grass
        statistics = Surface(
            cross_db=grass.cross_db,
            correlation=grass.correlation,
            texture_shape=grass.texture_shape,
            texture_length=grass.texture_length,
        )
        self._field = GrassField(statistics, (), density, seed, name="grass", renewed=renewed)
        depth = optical_depth(grass, frequency)
        strength = np.sqrt(1.5 * albedo(grass, frequency) * depth)
        spectra = strength * np.exp(-np.outer(_SLANTS, depth))
        u, s, vt = np.linalg.svd(spectra, full_matrices=False)
        ranks = min(_RANKS, s.size)
        self._weights = (u[:, :ranks] * s[:ranks]).T
        self.basis = np.repeat(vt[:ranks, None], 3, axis=1)

    def echoes(self, view: ScanView) -> PointEchoes:
        """Return the scatterers in view."""
        scatterers = self._field.within(view.corners)
        inside = view.inside(scatterers.xy[:, :2])
        points = scatterers.xy[inside]
        amplitude = scatterers.amplitude[inside]
        above = 1 - points[:, 2]
        points[:, 2] *= self.grass.height
        sine = view.sine(points)
        slant = slants(self.grass, sine)
        # Extinction κ_p over that of H; cross_db counts from HH.
        thicker = slant * np.sqrt(np.maximum(1 - sine**2, _LEAST_COSINE**2))
        thicker[2] = 1.0
        weight = np.empty((len(points), len(self._weights), 3), np.float32)
        for channel in range(3):
            for rank, row in enumerate(self._weights):
                weight[:, rank, channel] = np.interp(slant[channel] * above, _SLANTS, row)
        coefficient = weight * (amplitude * np.sqrt(thicker).T)[:, None, :]
        extra = np.zeros(len(points))
        return PointEchoes(points, extra, coefficient.astype(np.complex64), self.basis)
