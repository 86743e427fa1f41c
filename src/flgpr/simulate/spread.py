"""Echoes of many scatterers at once: spread into range profiles of every pair, then transformed to tones.

The transpose of range-profile interpolation with a Kaiser-Bessel window (Jackson et al. 1991). A scatterer's cost does
not depend on the number of tones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.fft
from numba import njit, prange
from numpy.typing import NDArray

from flgpr.model import SPEED_OF_LIGHT

FloatArray = NDArray[np.float64]
WIDTH = 6  # taps of the window; with twofold oversampling the error is about 1e-5
_TABLE = 1024
_CHUNK = 8192
_COSINES = 4096  # steps of a tabulated beam over the cosine off the axis
_TURN = 0.04  # cycles at the ends of the band by which points of a sweep in motion may differ and be summed at once


@dataclass(frozen=True)
class ArrayState:
    """Where the antennas of a scan are and where they look, in the lane frame.

    Attributes
    ----------
    position : (antenna, 3) ndarray
        Transmitters, then receivers, m.
    tx, rx : (pair,) ndarray of int
        Antennas of each pair.
    boresight, horizontal, vertical : (3,) ndarray
        Unit vectors: the antennas' axis, the H dipoles' axis, the V dipoles' axis.
    exponent : float
        n of a horn's power pattern cos^n; negative for dipoles.
    growth : float
        Of a beam that narrows with frequency: ``n = max(growth·f² - 1, 0)``, s²; zero where ``exponent`` always holds.
    drift : (3,) ndarray
        How far the antennas move during a sweep over all tones, m; they stand at ``position`` in its middle.
    """

    position: FloatArray
    tx: NDArray[np.intp]
    rx: NDArray[np.intp]
    boresight: FloatArray
    horizontal: FloatArray
    vertical: FloatArray
    exponent: float
    growth: float = 0.0
    drift: FloatArray = field(default_factory=lambda: np.zeros(3))

    def exponents(self, frequency: FloatArray) -> FloatArray:
        """Give n of a horn's power pattern at frequencies, Hz."""
        if self.growth == 0:
            return np.full(frequency.shape, self.exponent)
        return np.maximum(self.growth * frequency**2 - 1, 0)

    @property
    def dipoles(self) -> bool:
        """Whether the antennas are dipoles, which mix the directions H and V of each ray."""
        return self.exponent < 0


@njit(cache=True, inline="always")
def _antenna_gain(kx: Any, ky: Any, kz: Any, boresight: Any, horizontal: Any, vertical: Any, exponent: Any) -> Any:
    """Answer (H to h, H to v, V to v) of an antenna for the unit ray k leaving it."""
    if exponent >= 0:
        cosine = max(kx * boresight[0] + ky * boresight[1] + kz * boresight[2], 0.0)
        gain = cosine ** (0.5 * exponent)
        return gain, 0.0, gain
    flat = max(math.sqrt(kx * kx + ky * ky), 1e-9)
    to_h = (horizontal[0] * ky - horizontal[1] * kx) / flat
    to_v = (-horizontal[0] * kx * kz - horizontal[1] * ky * kz) / flat + horizontal[2] * flat
    v_to_v = (-vertical[0] * kx * kz - vertical[1] * ky * kz) / flat + vertical[2] * flat
    return to_h, to_v, v_to_v


@njit(parallel=True, cache=True, error_model="numpy")
def antenna_terms(
    points: Any,
    antennas: Any,
    boresight: Any,
    horizontal: Any,
    vertical: Any,
    exponent: Any,
    beams: Any,
    wavenumber: Any,
    extra: Any,
    drift: Any,
    distance: Any,
    phasor: Any,
    gain: Any,
) -> None:
    """Fill path (antenna, point) m, carrier phasor, and gain over distance (antenna, 3 or beam, point) of every ray.

    ``extra`` (point,) is path beyond the straight line, m; it delays and does not spread. ``drift`` (3,) is how far
    the antennas move in a sweep times carrier over bandwidth, m: so much later or earlier echoes seem to come.
    ``beams`` (cosine, beam) are tabulated patterns; where there is none, ``exponent`` holds.
    """
    tabulated, steps = beams.shape[1], beams.shape[0] - 2
    for a in prange(antennas.shape[0]):
        for i in range(points.shape[0]):
            dx, dy = points[i, 0] - antennas[a, 0], points[i, 1] - antennas[a, 1]
            dz = points[i, 2] - antennas[a, 2]
            r = math.sqrt(dx * dx + dy * dy + dz * dz)
            path = r + extra[i]
            turns = wavenumber * path
            angle = -2 * math.pi * (turns - math.floor(turns))
            distance[a, i] = path - (dx * drift[0] + dy * drift[1] + dz * drift[2]) / r
            phasor[a, i] = complex(math.cos(angle), math.sin(angle))
            if tabulated > 0:
                cosine = (dx * boresight[0] + dy * boresight[1] + dz * boresight[2]) / r
                place = min(max(cosine, 0.0), 1.0) * steps
                row = int(place)
                for g in range(tabulated):
                    gain[a, g, i] = (beams[row, g] + (place - row) * (beams[row + 1, g] - beams[row, g])) / r
            else:
                hh, hv, vv = _antenna_gain(dx / r, dy / r, dz / r, boresight, horizontal, vertical, exponent)
                gain[a, 0, i], gain[a, 1, i], gain[a, 2, i] = hh / r, hv / r, vv / r


@njit(parallel=True, cache=True, fastmath=True, error_model="numpy")
def _spread_chunk(
    count: Any,
    coefficient: Any,
    ranks: Any,
    mixed: Any,
    beamed: Any,
    distance: Any,
    phasor: Any,
    gain: Any,
    tx: Any,
    rx: Any,
    per_metre: Any,
    bins: Any,
    table: Any,
    profile: Any,
) -> Any:
    """Add ``count`` points to the profiles (pair, bin, 2·channel): real parts first, then imaginary parts.

    ``coefficient`` (point, 3·rank) holds h, v and cross for each rank; channels are the same three for horns, and
    HH, HV, VH, VV for dipoles. Where ``beamed``, every rank has a gain of its own.
    """
    channels = (4 if mixed else 3) * ranks
    taps = table.shape[1]
    steps = table.shape[0] - 2
    for q in prange(tx.shape[0]):
        value = np.empty(2 * channels, np.float32)
        a, b = tx[q], rx[q]
        for i in range(count):
            where = (distance[a, i] + distance[b, i]) * per_metre
            base = math.floor(where)
            place = (where - base) * steps
            row = int(place)
            part = np.float32(place - row)
            carrier = phasor[a, i] * phasor[b, i]
            if mixed:
                for r in range(ranks):
                    h, v, x = coefficient[i, 3 * r], coefficient[i, 3 * r + 1], coefficient[i, 3 * r + 2]
                    ah, av, aw = gain[a, 0, i], gain[a, 1, i], gain[a, 2, i]
                    bh, bv, bw = gain[b, 0, i], gain[b, 1, i], gain[b, 2, i]
                    hh = (ah * bh * h + (ah * bv + av * bh) * x + av * bv * v) * carrier
                    hv = (ah * bw * x + av * bw * v) * carrier
                    vh = (aw * bh * x + aw * bv * v) * carrier
                    vv = aw * bw * v * carrier
                    o = 4 * r
                    value[o], value[o + 1], value[o + 2], value[o + 3] = hh.real, hv.real, vh.real, vv.real
                    o += channels
                    value[o], value[o + 1], value[o + 2], value[o + 3] = hh.imag, hv.imag, vh.imag, vv.imag
            elif beamed:
                for r in range(ranks):
                    seen = carrier * (gain[a, r, i] * gain[b, r, i])
                    for c in range(3 * r, 3 * r + 3):
                        z = coefficient[i, c] * seen
                        value[c], value[channels + c] = z.real, z.imag
            else:
                carrier *= gain[a, 0, i] * gain[b, 0, i]
                for c in range(channels):
                    z = coefficient[i, c] * carrier
                    value[c], value[channels + c] = z.real, z.imag
            start = int(base) % bins
            for t in range(taps):
                weight = table[row, t] + part * (table[row + 1, t] - table[row, t])
                for c in range(2 * channels):
                    profile[q, start + t, c] += weight * value[c]


class Spreader:
    """Sums the echoes of point scatterers over all pairs and uniform tones.

    Parameters
    ----------
    start, step : float
        First tone and spacing, Hz.
    count : int
        Number of tones.
    """

    def __init__(self, start: float, step: float, count: int) -> None:
        self.count = count
        self.bins = int(scipy.fft.next_fast_len(max(2 * count, 4 * WIDTH)))
        self.centre = count // 2
        self.wavenumber = (start + self.centre * step) / SPEED_OF_LIGHT
        self.per_metre = self.bins * step / SPEED_OF_LIGHT
        self._table, self._correction = _window(self.bins, np.arange(count) - self.centre)

    def __call__(
        self,
        points: FloatArray,
        coefficient: NDArray[np.complex64],
        basis: NDArray[Any],
        array: ArrayState,
        extra: FloatArray | None = None,
        nodes: FloatArray | None = None,
    ) -> NDArray[np.complex64]:
        """Sum ``Σ_i g_t·g_r/(R_t·R_r)·Σ_r coefficient·basis_r(f)·exp(-j2πf(R_t + R_r + 2·extra)/c)``.

        Parameters
        ----------
        points : (point, 3) ndarray
            Scatterers in the lane frame, m.
        coefficient : (point, rank, 3) ndarray of complex64
            Amplitudes HH, VV and cross of every scatterer for every spectral function.
        basis : (rank, 3, frequency) ndarray
            The spectral functions, real or complex.
        array : ArrayState
            The antennas.
        extra : (point,) ndarray or None
            Electrical path beyond the straight line to each antenna, m; None is none.
        nodes : (rank,) ndarray or None
            Frequencies at which the horns' beam is taken for every spectral function, Hz, where the functions
            interpolate between values at these; None takes the beam of ``array.exponent`` for all.

        Returns
        -------
        (3 or 4, pair, frequency) ndarray of complex64
            For horns the channels HH, VV and cross of the rays' own directions, for dipoles HH, HV, VH and VV.
        """
        extra = np.zeros(len(points)) if extra is None else extra
        if not array.drift.any():
            return self._sum(points, coefficient, basis, array, extra, nodes)
        # Echoes of an array in motion have a quadratic phase over the sweep that nearby ones have in common.
        rate = _rates(points, array.position.mean(axis=0), array.drift)
        turn = 2 * np.ptp(rate) * self.bandwidth / 4 / SPEED_OF_LIGHT if rate.size else 0.0
        parts = max(1, math.ceil(turn / _TURN))
        edges = np.linspace(rate.min(), rate.max(), parts + 1)[1:-1]
        group = np.searchsorted(edges, rate)
        total = np.zeros((4 if array.dipoles else 3, array.tx.size, self.count), np.complex64)
        for g in range(len(edges) + 1):
            some = group == g
            part = self._sum(points[some], coefficient[some], basis, array, extra[some], nodes)
            total += part * self._swept(points[some], array)
        return total

    @property
    def bandwidth(self) -> float:
        """Number of tones times their spacing, Hz."""
        return self.per_metre * SPEED_OF_LIGHT / self.bins * self.count

    def _swept(self, points: FloatArray, array: ArrayState) -> NDArray[np.complex64]:
        """Phase (pair, frequency) that the rate of the path leaves beyond a delay: ``κ²·Δf·ΔL/(K·c)`` cycles.

        The rate is the mean over points by the power that arrives of them, (R_t·R_r)⁻².
        """
        points = points[:: max(1, len(points) // 500)]
        if not len(points):
            return np.ones((1, 1), np.complex64)
        weight = np.sum((points - array.position.mean(axis=0)) ** 2, axis=1) ** -2.0
        rate = np.array([np.average(_rates(points, a, array.drift), weights=weight) for a in array.position])
        cycles = (np.arange(self.count) - self.centre) ** 2 * self.bandwidth / self.count**2 / SPEED_OF_LIGHT
        return np.exp(-2j * np.pi * np.outer(rate[array.tx] + rate[array.rx], cycles)).astype(np.complex64)

    def _sum(
        self,
        points: FloatArray,
        coefficient: NDArray[np.complex64],
        basis: NDArray[Any],
        array: ArrayState,
        extra: FloatArray,
        nodes: FloatArray | None,
    ) -> NDArray[np.complex64]:
        ranks, mixed = basis.shape[0], array.dipoles
        if mixed and not np.allclose(basis, basis[:, :1]):
            # Dipoles mix the directions after spreading, so their basis must be common to all: use each one apart.
            return sum(
                (
                    self._sum(
                        points, _only(coefficient, c), np.repeat(basis[:, c : c + 1], 3, axis=1), array, extra, nodes
                    )
                    for c in range(3)
                ),
                start=np.zeros((4, array.tx.size, self.count), np.complex64),
            )
        kinds = 4 if mixed else 3
        beamed = nodes is not None and array.growth > 0
        beams = _beam_table(array.exponents(nodes)) if nodes is not None and beamed else np.empty((0, 0), np.float32)
        profile = np.zeros((array.tx.size, self.bins + WIDTH, 2 * kinds * ranks), np.float32)
        flat = np.ascontiguousarray(coefficient.reshape(len(points), 3 * ranks), dtype=np.complex64)
        antennas = len(array.position)
        shape = (antennas, min(_CHUNK, len(points)))
        distance, phasor = np.empty(shape), np.empty(shape, np.complex64)
        gain = np.empty((antennas, max(3, ranks), shape[1]), np.float32)
        drift = array.drift * (self.wavenumber * SPEED_OF_LIGHT / self.bandwidth)
        look = (array.boresight, array.horizontal, array.vertical, array.exponent, beams, self.wavenumber)
        for first in range(0, len(points), _CHUNK):
            some, late = points[first : first + _CHUNK], extra[first : first + _CHUNK]
            antenna_terms(some, array.position, *look, late, drift, distance, phasor, gain)
            part = flat[first : first + _CHUNK]
            where = (self.per_metre, self.bins, self._table, profile)
            _spread_chunk(len(some), part, ranks, mixed, beamed, distance, phasor, gain, array.tx, array.rx, *where)
        return self._to_tones(profile, ranks, kinds, basis)

    def _to_tones(
        self, profile: NDArray[np.float32], ranks: int, kinds: int, basis: NDArray[Any]
    ) -> NDArray[np.complex64]:
        folded = profile[:, : self.bins]
        folded[:, :WIDTH] += profile[:, self.bins :]
        channels = ranks * kinds
        tones = (np.arange(self.count) - self.centre) % self.bins
        out = np.zeros((kinds, len(profile), self.count), np.complex64)
        for c in range(channels):
            row = np.roll(folded[..., c] + 1j * folded[..., channels + c], 1 - WIDTH // 2, axis=-1)
            spectrum = scipy.fft.fft(row, axis=-1, overwrite_x=True)[:, tones]
            weight = self._correction * basis[c // kinds, c % kinds if kinds == 3 else 0]
            out[c % kinds] += spectrum * weight.astype(np.complex64 if np.iscomplexobj(weight) else np.float32)
        return out


def _rates(points: FloatArray, antenna: FloatArray, drift: FloatArray) -> FloatArray:
    """How much longer the way from an antenna to points (point, 3) gets while it moves by ``drift``, m."""
    ray = points - antenna
    return np.asarray(-(ray @ drift) / np.linalg.norm(ray, axis=1))


def _beam_table(exponents: FloatArray) -> NDArray[np.float32]:
    """Amplitude cos^(n/2) over the cosine from 0 to 1 in ``_COSINES`` steps, and one more, for every n."""
    cosine = np.minimum(np.arange(_COSINES + 2) / _COSINES, 1.0)
    return (cosine[:, None] ** (0.5 * exponents)).astype(np.float32)


def _only(coefficient: NDArray[np.complex64], channel: int) -> NDArray[np.complex64]:
    kept = np.zeros_like(coefficient)
    kept[..., channel] = coefficient[..., channel]
    return kept


def _window(bins: int, tone: NDArray[np.intp]) -> tuple[NDArray[np.float32], FloatArray]:
    """Kaiser-Bessel taps by fraction of a bin, and the spectrum's correction for every tone."""
    ratio = bins / tone.size
    beta = math.pi * math.sqrt((WIDTH / ratio) ** 2 * (ratio - 0.5) ** 2 - 0.8)
    fraction = np.arange(_TABLE + 2) / _TABLE
    offset = np.arange(WIDTH) - (WIDTH // 2 - 1)
    inside = np.maximum(1 - ((offset - fraction[:, None]) / (WIDTH / 2)) ** 2, 0)
    taps = np.where(inside > 0, np.i0(beta * np.sqrt(inside)), 0)
    root = np.sqrt(beta**2 - (np.pi * WIDTH * tone / bins) ** 2 + 0j)
    correction = 1 / (WIDTH * np.sinh(root) / root).real
    return taps.astype(np.float32), correction
