"""The way into the soil and out again, for many points at once: delay, transmission, loss and growth with frequency."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from flgpr.simulate.echoes import Ground

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_SINES = np.linspace(0.02, 0.999, 128)
_MIDDLE = np.sin(np.radians(67))  # incidence at which the tables are made
_NODES, _DEPTHS = 64, 48


class BuriedSpectra:
    """Spectra of buried points as few functions of frequency, with weights by a point's shape and depth.

    A point of amplitude A at the band's middle, depth d and sine s echoes with
    ``A·t12²(s)·shape(f)·exp(-2jk0·d·(sqrt(ε(f) - s²) - n_c))`` beyond the delay of ``d·n_c``, n_c the root at the
    middle. The exponent is tabulated at one incidence, for to first order in loss and dispersion another incidence is
    another depth, ``d·sqrt(ε - s0²)/sqrt(ε - s²)``. t12² is taken at the band's middle.

    ``shapes`` (shape, frequency) are 1 there; ``cover`` gives the two-way amplitude (3, sine, frequency) of HH, VV and
    cross through what stands over the soil; ``tolerance`` is the part of the spectra's amplitude that the functions,
    ``basis`` (rank, 3, frequency), may leave out.
    """

    def __init__(
        self,
        ground: Ground,
        shapes: FloatArray,
        deepest: float,
        cover: Callable[[FloatArray], FloatArray] | None = None,
        tolerance: float = 0.01,
        ranks: int = 6,
    ) -> None:
        frequency = ground.frequency
        self._ground, self._deepest = ground, deepest
        middle = Ground(ground.soil, None, frequency[frequency.size // 2 : frequency.size // 2 + 1])
        copolar = [[middle.entry_squared(s, layer)[:, 0] for s in _SINES] for layer in range(len(ground.real))]
        h, v = np.moveaxis(np.array(copolar), -1, 0)
        self._entry = np.stack([h, v, np.sqrt(h * v)], axis=-1)
        self._tops = np.cumsum([0.0, *(layer.thickness for layer in ground.soil.layers)])
        depths = deepest * np.linspace(0, 1, _DEPTHS) ** 2
        nodes = np.unique(np.linspace(0, frequency.size - 1, _NODES).round().astype(int))
        loss = np.array([ground.dispersion(_MIDDLE, d)[nodes] for d in depths])
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
            path += np.clip(depth, top, bottom) * np.sqrt(eps - sine**2) - top * np.sqrt(eps - sine**2)
        return path

    def transmission(self, depth: FloatArray, sine: FloatArray) -> ComplexArray:
        """t12² (point, 3) of HH and VV into the layer that holds each depth, and their geometric mean for cross."""
        place = np.clip((sine - _SINES[0]) / (_SINES[1] - _SINES[0]), 0, _SINES.size - 1.001)
        cell = place.astype(int)
        part = (place - cell)[:, None]
        layer = self.layer(depth)
        return np.asarray(self._entry[layer, cell] * (1 - part) + self._entry[layer, cell + 1] * part)

    def weights(self, shape: NDArray[np.intp], depth: FloatArray, sine: FloatArray) -> NDArray[np.complex64]:
        """Weights (point, rank) of the functions."""
        eps = self._ground.real[0]
        steeper = depth * np.sqrt((eps - _MIDDLE**2) / (eps - sine**2))
        place = np.minimum(np.sqrt(steeper / self._deepest), 1.0) * (_DEPTHS - 1.001)
        cell = place.astype(int)
        part = (place - cell).astype(np.float32)[:, None]
        low, high = self._weights[shape, cell], self._weights[shape, cell + 1]
        return np.asarray(low + part * (high - low))
