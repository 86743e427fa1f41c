"""Spectra of all point scatterers by their values at few tones, one set of tones for all of them.

Whatever a point's spectrum times its beam is, it is close to ``Σ_r value(f_r)·H_r(f)`` with few tones f_r: a skeleton
decomposition (Goreinov, Tyrtyshnikov & Zamarashkin 1997). At each f_r the beam of every antenna and the shadow on
every point are plain numbers, so that all layers can be summed over their points at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, qr

from flgpr.simulate.layers import Layer, PointEchoes, View

FloatArray = NDArray[np.float64]
_SAMPLE = 240  # points of a layer by which the tones are chosen
_COSINES = np.linspace(0.35, 1, 14)  # two-way cosines off the axis, for a layer that has no point in view
_TOLERANCE, _MOST = 0.01, 8


class Skeleton:
    """Tones (``nodes``) and functions (rank, frequency) for the spectra of some layers as an array sees them.

    The tones are chosen by a view of some of the layers' scatterers.
    """

    def __init__(self, layers: Iterable[Layer], view: View, frequency: FloatArray) -> None:
        self._array, self._frequency = view.array, frequency
        found = [layer.echoes(view) for layer in layers]
        if frequency.size == 1 or not found:
            self._tones, self.functions = np.array([0]), np.ones((1, frequency.size))
        else:
            self._tones, self.functions = _choose(np.concatenate([self._rows(echoes) for echoes in found]))
        self.nodes = frequency[self._tones]

    def values(self, echoes: PointEchoes) -> NDArray[np.complex64]:
        """Give the amplitudes (point, 3, rank) of a layer's scatterers at the nodes."""
        at_nodes = echoes.basis[:, :, self._tones].astype(np.complex64)
        return np.stack([echoes.coefficient[..., c] @ at_nodes[:, c] for c in range(3)], axis=1)

    def _rows(self, echoes: PointEchoes) -> NDArray[Any]:
        """Spectra times beams (row, frequency) of some points of a layer, each polarization's of mean square one."""
        spectra, cosine = self._samples(echoes)
        rows = spectra * (cosine[:, None] ** (0.5 * self._array.exponents(self._frequency)))[:, None]
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
