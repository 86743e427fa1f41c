"""A beam that narrows with frequency, for layers of many points: their spectra by values at few tones.

Whatever a point's spectrum times its beam is, it is close to ``Σ_r value(f_r)·H_r(f)`` with few tones f_r: a skeleton
decomposition (Goreinov, Tyrtyshnikov & Zamarashkin 1997). At each f_r the beam of every antenna is one number, so that
the sum over points stays as it is, with a gain for every rank.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, qr

from flgpr.simulate.layers import Layer, PointEchoes, View

FloatArray = NDArray[np.float64]
_SAMPLE = 240  # points by which the tones are chosen
_COSINES = np.linspace(0.35, 1, 14)  # two-way cosines off the axis, for a layer that has no point in view
_TOLERANCE, _MOST = 0.005, 8


class NarrowingBeam:
    """Spectra of layers, rewritten for a beam that narrows with frequency.

    Parameters
    ----------
    layers : iterable of Layer
        The layers.
    view : View
        A view of some of their scatterers, by which the tones are chosen.
    frequency : (frequency,) ndarray
        Tones, Hz.
    """

    def __init__(self, layers: Iterable[Layer], view: View, frequency: FloatArray) -> None:
        self.frequency, self._array = frequency, view.array
        self._known: dict[int, tuple[NDArray[np.intp], NDArray[Any], NDArray[Any]]] = {}
        for layer in layers:
            echoes = layer.echoes(view)
            if id(echoes.basis) not in self._known:
                self._known[id(echoes.basis)] = (*self._choose(echoes), echoes.basis)

    def __call__(self, echoes: PointEchoes) -> PointEchoes:
        """Give the same scatterers with the values of their spectra at ``nodes`` as coefficients."""
        if echoes.nodes is not None:
            return echoes
        tones, functions, basis = self._known[id(echoes.basis)]
        values = np.stack([echoes.coefficient[..., c] @ basis[:, c, tones].astype(np.complex64) for c in range(3)], -1)
        return echoes._replace(coefficient=values, basis=functions, nodes=self.frequency[tones])

    def _choose(self, echoes: PointEchoes) -> tuple[NDArray[np.intp], NDArray[Any]]:
        """Tones (rank,) and functions (rank, 3, frequency) that carry a layer's spectra times their beams."""
        spectra, cosine = self._samples(echoes)
        beam = cosine[:, None] ** (0.5 * self._array.exponents(self.frequency))
        rows = spectra * beam[:, None]
        rows /= np.sqrt(np.mean(np.abs(rows) ** 2, axis=(0, 2), keepdims=True)) + 1e-300
        some = np.unique(np.linspace(0, self.frequency.size - 1, 96).round().astype(int))
        flat = rows[:, :, some].reshape(-1, some.size)
        order = qr(flat, mode="r", pivoting=True)[1]
        for count in range(1, _MOST + 1):
            kept = np.sort(order[:count])
            left = flat - flat[:, kept] @ lstsq(flat[:, kept], flat)[0]
            if np.linalg.norm(left) < _TOLERANCE * np.linalg.norm(flat):
                break
        tones = some[kept]
        return tones, np.stack([lstsq(rows[:, c, tones], rows[:, c])[0] for c in range(3)], axis=1)

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
