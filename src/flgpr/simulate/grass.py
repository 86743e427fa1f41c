"""Grass: a layer of scatterers over the ground, and its loss for all that lies below."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flgpr.model.arrays import FloatArray
from flgpr.simulate import tables
from flgpr.simulate.draw import stream
from flgpr.simulate.field import Scatterers, SurfaceField
from flgpr.simulate.layers import PointEchoes, View
from flgpr.simulate.scene import Surface

_RANKS = 2
_SLANTS = np.linspace(0.0, 15.0, 128)  # of a ray's way through the grass, over its height, times what V suffers more
_LEAST_COSINE = 0.05


def slants(grass: tables.Grass, sine: ArrayLike) -> FloatArray:
    """Optical depth (3, ...) of the whole layer along a ray over that of H at nadir: H, V, and their mean for cross.

    ``1/cosθ`` of H, ``(cos²θ + upright·sin²θ)/cosθ`` of V (Wigneron et al. 2017).
    """
    sine = np.asarray(sine, dtype=float)
    cosine = np.sqrt(np.maximum(1 - sine**2, _LEAST_COSINE**2))
    h, v = 1 / cosine, (cosine**2 + grass.upright * sine**2) / cosine
    return np.stack([h, v, (h + v) / 2])


def optical_depth(grass: tables.Grass, frequency: ArrayLike) -> FloatArray:
    """One-way optical depth of H at nadir, nepers of power: ``b·W·f/1.4 GHz`` for frequencies in Hz."""
    return np.asarray(grass.loss * grass.water * np.asarray(frequency, dtype=float) / 1.4e9)


def through_grass(grass: tables.Grass, frequency: ArrayLike, sine: ArrayLike, above: float = 1.0) -> FloatArray:
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

    def __init__(self, grass: tables.Grass, density: float, seed: int, frequency: FloatArray) -> None:
        self.grass = grass
        like = {name: getattr(grass, name) for name in ("cross_db", "correlation", "texture_shape", "texture_length")}
        self._field = GrassField(Surface(**like), (), density, seed, name="grass")
        depth = optical_depth(grass, frequency)
        u, s, vt = np.linalg.svd(
            np.sqrt(1.5 * albedo(grass, frequency) * depth) * np.exp(-np.outer(_SLANTS, depth)), False
        )
        ranks = min(_RANKS, s.size)
        self._weights = (u[:, :ranks] * s[:ranks]).T
        self.basis = np.repeat(vt[:ranks, None], 3, axis=1)

    def echoes(self, view: View) -> PointEchoes:
        """Give the scatterers in view."""
        found = self._field.within(view.corners)
        inside = view.inside(found.xy[:, :2])
        points, amplitude = found.xy[inside], found.amplitude[inside]
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
        return PointEchoes(points, np.zeros(len(points)), coefficient.astype(np.complex64), self.basis)
