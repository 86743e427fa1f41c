"""Spectra of what lies in the soil: growth with frequency, change with incidence, loss with depth."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.ground import inclusions
from flgpr.simulate.ground.layers import PointEchoes
from flgpr.simulate.scene.scene import Scene
from flgpr.types import AnyArray, Complex128Array, ComplexArray, FloatArray, IndexArray

# Corner frequencies over the band's middle for which shapes of growth are made.
_CORNERS = np.geomspace(0.02, 50.0, 28)
# Numbers of the shapes: those of stones and of roots by corner frequency, and four single ones.
STONE = 0
ROOT = _CORNERS.size
VOLUME = 2 * _CORNERS.size
LENS = VOLUME + 1
WALL = VOLUME + 2
CAP = VOLUME + 3
LEVEL = math.sin(math.radians(67))
"""Sine of incidence at which shapes and tables are made."""
_SINES = np.linspace(0.02, 0.999, 128)  # of the table of transmissions
# Tones and depths of the table of losses.
_NODES = 64
_DEPTHS = 48


def shape_index(first: int, corner: FloatArray) -> IndexArray:
    """Return the number of the shape whose corner frequency is nearest, from ``first`` on."""
    step = math.log(_CORNERS[1] / _CORNERS[0])
    nearest = np.round(np.log(corner / _CORNERS[0]) / step)
    return first + np.clip(nearest, 0, _CORNERS.size - 1).astype(np.intp)


def spectral_shapes(scene: Scene, ground: LayeredGround) -> FloatArray:
    """Return the growth with frequency of all that lies in the soil.

    Returns
    -------
    ndarray (shape, frequency)
        Amplitudes over those at the band's middle.
    """
    k = ground.wavenumber
    u = k / k[ground.middle]
    soil = ground.real[-1]
    uneven = scene.heterogeneity
    power = inclusions.volume_backscatter(k, LEVEL, soil, 1.0, uneven.horizontal, uneven.vertical)
    thick = np.sinc(k * math.sqrt(soil - LEVEL**2) * scene.lenses.thickness / np.pi)
    shapes = [inclusions.stone_shape(u / corner) for corner in _CORNERS]
    shapes += [inclusions.root_shape(u / corner) for corner in _CORNERS]
    volume = np.sqrt(power)
    lens = u**0.5 * thick
    wall = u**-0.5 * np.exp(-0.5 * (2 * k * LEVEL * scene.holes.wall) ** 2)
    cap = u**-0.5
    shapes += [volume, lens, wall, cap]
    return np.array([shape / shape[ground.middle] for shape in shapes])


def incidence_laws(scene: Scene, ground: LayeredGround) -> FloatArray:
    """Return the change of each shape's amplitude with the sine of incidence.

    Returns
    -------
    ndarray (shape, sine)
        At uniform sines from 0 to 1.
    """
    sine = np.linspace(0, 1, 256)
    laws = np.ones((CAP + 1, sine.size))
    uneven = scene.heterogeneity
    k = ground.wavenumber[ground.middle]

    def volume(s: FloatArray | float) -> FloatArray:
        """Return the cross section per volume at a sine, for a deviation of one."""
        return inclusions.volume_backscatter(
            k, s, ground.real[-1], 1.0, uneven.horizontal, uneven.vertical
        )

    laws[VOLUME] = np.sqrt(volume(sine) / volume(LEVEL))
    laws[LENS] = np.maximum(sine, 0.05) ** -1.5
    return laws


class BuriedSpectra:
    """Spectra of buried points as few functions of frequency, weighted by shape and depth.

    A point of amplitude A at the band's middle, depth d and sine s echoes with
    ``A·t12²(s)·shape(f)·exp(-2jk0·d·(sqrt(ε(f) - s²) - n_c))`` beyond the delay of ``d·n_c``, n_c
    the root at the middle. The exponent is tabulated at one incidence, for to first order in loss
    and dispersion another incidence is another depth, ``d·sqrt(ε - s0²)/sqrt(ε - s²)``. t12² is
    taken at the band's middle.

    Parameters
    ----------
    ground : LayeredGround
        The soil and the tones.
    shapes : ndarray (shape, frequency)
        Growth with frequency, 1 at the band's middle.
    deepest : float
        Greatest depth of a point, m.
    cover : callable, optional
        Two-way amplitude (3, sine, frequency) of HH, VV and cross through what stands over the
        soil, for sines.
    tolerance : float
        Share of the spectra's amplitude that the functions may leave out.
    ranks : int
        Most functions.

    Attributes
    ----------
    basis : ndarray (rank, 3, frequency)
        The functions.
    """

    def __init__(
        self,
        ground: LayeredGround,
        shapes: FloatArray,
        deepest: float,
        cover: Callable[[FloatArray], FloatArray] | None = None,
        tolerance: float = 0.01,
        ranks: int = 6,
    ) -> None:
        frequency = ground.frequency
        self._ground = ground
        self._deepest = deepest
        self._entry = _entry_table(ground)
        # Depths lie closer where they are small, as losses change fastest there.
        depths = deepest * np.linspace(0, 1, _DEPTHS) ** 2
        nodes = np.unique(np.linspace(0, frequency.size - 1, _NODES).round().astype(int))
        loss = np.array([ground.dispersion(LEVEL, d)[nodes] for d in depths])
        rows = shapes[:, None, nodes] * loss
        if cover is not None:
            middle = ground.middle
            over = cover(_SINES)
            self._entry *= over[:, :, middle].T
            growth = over.mean(axis=(0, 1))
            rows *= growth[nodes] / growth[middle]
        _, s, vt = np.linalg.svd(rows.reshape(-1, nodes.size), full_matrices=False)
        # Relative amplitude of each rank and all after it.
        remaining = np.sqrt(np.cumsum((s**2)[::-1])[::-1] / np.sum(s**2))
        count = min(ranks, max(1, int(np.count_nonzero(remaining > tolerance))))
        self._weights = (rows @ vt[:count].conj().T).astype(np.complex64)
        functions = vt[:count]
        if nodes.size < frequency.size:
            functions = CubicSpline(frequency[nodes], functions, axis=1)(frequency)
        self.basis = np.repeat(functions[:, None], 3, axis=1)

    def permittivity(self, depth: FloatArray) -> FloatArray:
        """Return the real permittivity at the band's middle at each depth, m."""
        return np.array(self._ground.real)[self._ground.layer(depth)]

    def delay(self, depth: FloatArray, sine: FloatArray) -> FloatArray:
        """Return the electrical path from the surface to depths, ``Σ d_i·sqrt(ε_i - sin²θ)``, m."""
        tops = self._ground.tops
        bottoms = [*tops[1:], np.inf]
        path = np.zeros_like(depth)
        for top, bottom, eps in zip(tops, bottoms, self._ground.real, strict=True):
            vertical = np.sqrt(eps - sine**2)
            path += np.clip(depth, top, bottom) * vertical - top * vertical
        return path

    def transmission(self, depth: FloatArray, sine: FloatArray) -> Complex128Array:
        """Return t12² into the layer that holds each depth.

        Returns
        -------
        ndarray (point, 3) of complex
            Of HH, VV, and their geometric mean for cross.
        """
        position = (sine - _SINES[0]) / (_SINES[1] - _SINES[0])
        position = np.clip(position, 0, _SINES.size - 1.001)
        cell = position.astype(int)
        fraction = (position - cell)[:, None]
        layer = self._ground.layer(depth)
        low = self._entry[layer, cell]
        high = self._entry[layer, cell + 1]
        return low * (1 - fraction) + high * fraction

    def weights(self, shape: IndexArray, depth: FloatArray, sine: FloatArray) -> ComplexArray:
        """Return the weights (point, rank) of the functions."""
        eps = self._ground.real[0]
        # The depth at which the tabulated incidence has the same loss.
        equivalent = depth * np.sqrt((eps - LEVEL**2) / (eps - sine**2))
        position = np.minimum(np.sqrt(equivalent / self._deepest), 1.0) * (_DEPTHS - 1.001)
        cell = position.astype(int)
        fraction = (position - cell).astype(np.float32)[:, None]
        low = self._weights[shape, cell]
        high = self._weights[shape, cell + 1]
        return low + fraction * (high - low)

    def point_echoes(
        self,
        points: FloatArray,
        shape: IndexArray,
        depth: FloatArray,
        sine: FloatArray,
        amplitude: AnyArray,
    ) -> PointEchoes:
        """Return the echoes of points whose amplitudes (point, 3) and places above are given."""
        weights = self.weights(shape, depth, sine)
        coefficient = (weights[:, :, None] * amplitude[:, None]).astype(np.complex64)
        return PointEchoes(points, self.delay(depth, sine), coefficient, self.basis)


def _entry_table(ground: LayeredGround) -> Complex128Array:
    """Return t12² (layer, sine, 3) at the band's middle: of HH, VV and their geometric mean."""
    middle_tone = ground.frequency[ground.middle : ground.middle + 1]
    at_middle = LayeredGround(ground.soil, None, middle_tone)
    copolar = []
    for layer in range(len(ground.real)):
        entries = [at_middle.entry_squared(sine, layer)[:, 0] for sine in _SINES]
        copolar.append(entries)
    h, v = np.moveaxis(np.array(copolar), -1, 0)
    return np.stack([h, v, np.sqrt(h * v)], axis=-1)
