"""Layers of point scatterers: what the ground, and all that fills it, hands to the sum over pairs and tones."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flgpr.model import heading_matrix
from flgpr.simulate.field import SurfaceField
from flgpr.simulate.spread import ArrayState, Spreader
from flgpr.simulate.terrain import Terrain

if TYPE_CHECKING:
    from flgpr.simulate.shadow import Shadows
    from flgpr.simulate.skeleton import Skeleton

FloatArray = NDArray[np.float64]


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
        self,
        footprint: tuple[float, float, float, float],
        pose: FloatArray,
        array: ArrayState,
        terrain: Terrain | None = None,
        shadows: Shadows | None = None,
    ) -> None:
        x_min, x_max, y_min, y_max = footprint
        self.terrain = None if terrain is None or terrain.flat else terrain
        self.shadows = shadows
        self.footprint, self.pose, self.array = footprint, pose, array
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
    """Spectra that depend on the angle of incidence as few functions of frequency with weights by its sine.

    ``spectra`` (3, sine, frequency) are amplitudes of HH, VV and cross at uniform sines, ``basis`` is (rank, 3,
    frequency).
    """

    def __init__(self, sines: FloatArray, spectra: FloatArray, ranks: int) -> None:
        self._sines = sines
        self._weights = np.zeros((sines.size, ranks, 3))
        self.basis = np.zeros((ranks, 3, spectra.shape[-1]))
        for channel, spectrum in enumerate(spectra):
            u, s, vt = np.linalg.svd(spectrum, full_matrices=False)
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
        self._field, self._spectra = field, spectra

    def echoes(self, view: View) -> PointEchoes:
        """Give the scatterers in view."""
        scatterers = self._field.within(view.corners)
        inside = view.inside(scatterers.xy)
        points = np.zeros((np.count_nonzero(inside), 3))
        points[:, :2] = scatterers.xy[inside]
        weight = self._spectra.weights(view.sine(points))
        coefficient = (weight * scatterers.amplitude[inside][:, None, :]).astype(np.complex64)
        return PointEchoes(points, np.zeros(len(points)), coefficient, self._spectra.basis)


def sum_layers(layers: Iterable[Layer], view: View, spreader: Spreader, skeleton: Skeleton) -> NDArray[np.complex64]:
    """Sum the echoes of all layers over pairs and tones, in the channels that the Spreader gives.

    The skeleton has the tones at which the layers' spectra are taken.
    """
    every = [layer.echoes(view) for layer in layers]
    if not every:
        return np.zeros((4 if view.array.dipoles else 3, view.array.tx.size, spreader.count), np.complex64)
    points = np.concatenate([echoes.points for echoes in every])
    extra = np.concatenate([echoes.extra for echoes in every])
    values = np.concatenate([skeleton.values(echoes) for echoes in every])
    if view.terrain is not None:
        points[:, 2] += view.terrain.relief(points[:, :2])[:, 0]
    if view.shadows is not None:
        view.shadows.darken(values, points, skeleton.nodes)
    return spreader(points, values, skeleton.functions, view.array, extra, skeleton.nodes)
