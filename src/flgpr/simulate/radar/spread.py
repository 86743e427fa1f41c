"""Echoes of many scatterers at once: spread into range profiles, then transformed to tones.

The transpose of range-profile interpolation with a Kaiser-Bessel window (Jackson et al. 1991). A
scatterer's cost does not depend on the number of tones.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import scipy.fft

from flgpr.jit.compiled import njit
from flgpr.jit.threads import shared
from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import AnyArray, ComplexArray, Float32Array, FloatArray, IndexArray

WIDTH = 4  # taps of the window; with twofold oversampling the error is 4e-4, rms
_TABLE = 1024  # steps of the tabulated window in a bin
_CHUNK = 1024  # points that are summed at once
_COSINES = 1024  # steps of a tabulated beam over the cosine off the axis
_LANES = 4  # numbers of lanes are multiples of it
_TURNS = 4096  # places on the unit circle between which carriers are interpolated: right to 3e-7
_CIRCLE = np.exp(-2j * np.pi * np.arange(_TURNS + 1) / _TURNS).astype(np.complex64)
# Cycles at the ends of the band by which points of a sweep in motion may differ and be summed at
# once.
_TURN = 0.04


@dataclass(frozen=True)
class ArrayState:
    """Where the antennas of a scan stand and look, in the lane frame."""

    position: FloatArray  #: (antenna, 3): transmitters before receivers, in a sweep's middle, m
    tx: IndexArray  #: (pair,): antennas that transmit
    rx: IndexArray  #: (pair,): antennas that receive
    boresight: FloatArray  #: (3,): unit vector along the middle of the beams
    horizontal: FloatArray  #: (3,): unit vector along the H dipoles
    vertical: FloatArray  #: (3,): unit vector along the V dipoles
    exponent: float  #: n of a horn's power pattern cos^n, negative for dipoles
    #: growth of a beam that narrows with frequency, ``n = max(growth·f² - 1, 0)``, s²; zero where
    #: ``exponent`` always holds
    growth: float = 0.0
    #: (3,): how far the antennas move during a sweep over all tones, m
    drift: FloatArray = field(default_factory=lambda: np.zeros(3))

    def exponents(self, frequency: FloatArray) -> FloatArray:
        """Return n of a horn's power pattern at frequencies, Hz."""
        if self.growth == 0:
            return np.full(frequency.shape, self.exponent)
        return np.maximum(self.growth * frequency**2 - 1, 0)

    @property
    def channels(self) -> int:
        """Number of sums of a pair: HH, HV, VH and VV of dipoles, else HH, VV and cross."""
        return 4 if self.dipoles else 3

    @property
    def dipoles(self) -> bool:
        """Whether the antennas are dipoles, which mix the directions H and V of each ray."""
        return self.exponent < 0


@njit(cache=True, inline="always")
def _antenna_gain(
    kx: Any, ky: Any, kz: Any, boresight: Any, horizontal: Any, vertical: Any, exponent: Any
) -> Any:
    """Return the gains (H to h, H to v, V to v) of an antenna for the unit ray k leaving it.

    A dipole's gains are its components along the ray's own directions: h along k × z, level, and v
    at right angles to it and to the ray, upwards.
    """
    if exponent >= 0:
        cosine = max(kx * boresight[0] + ky * boresight[1] + kz * boresight[2], 0.0)
        gain = cosine ** (0.5 * exponent)
        return gain, 0.0, gain
    flat = max(math.sqrt(kx * kx + ky * ky), 1e-9)
    to_h = (horizontal[0] * ky - horizontal[1] * kx) / flat
    to_v = (-horizontal[0] * kx * kz - horizontal[1] * ky * kz) / flat + horizontal[2] * flat
    v_to_v = (-vertical[0] * kx * kz - vertical[1] * ky * kz) / flat + vertical[2] * flat
    return to_h, to_v, v_to_v


@shared(cache=True)
def antenna_terms(  # type: ignore[no-untyped-def]
    points,
    antennas,
    boresight,
    horizontal,
    vertical,
    exponent,
    beams,
    wavenumber,
    extra,
    drift,
    distance,
    phasor,
    gain,
    begin,
    end,
):
    """Fill path, carrier phasor and gain over distance of every ray.

    Parameters
    ----------
    points : (point, 3) ndarray
        Scatterers, m.
    antennas : (antenna, 3) ndarray
        Positions of the antennas, m.
    boresight, horizontal, vertical : (3,) ndarray
        Directions of the antennas, as in :class:`ArrayState`.
    exponent : float
        Exponent of the pattern where there are no ``beams``, as in :class:`ArrayState`.
    beams : (cosine, lane) ndarray of float32
        Tabulated patterns of :func:`_beam_table`, or an empty array.
    wavenumber : float
        Carrier over the speed of light, 1/m.
    extra : (point,) ndarray
        Path beyond the straight line, m; it delays and does not spread.
    drift : (3,) ndarray
        How far the antennas move in a sweep, times carrier over bandwidth, m: so much later or
        earlier echoes seem to come.
    distance : (antenna, point) ndarray
        Paths, m, filled.
    phasor : (antenna, point) ndarray of complex64
        Carrier phasors, filled.
    gain : (antenna, point, lane or 3) ndarray of float32
        Gains over distance, filled: of every lane, or H to h, H to v and V to v.
    begin, end : int
        Antennas of this call.
    """
    lanes = beams.shape[1]
    steps = beams.shape[0] - 2
    for a in range(begin, end):
        for i in range(points.shape[0]):
            dx = points[i, 0] - antennas[a, 0]
            dy = points[i, 1] - antennas[a, 1]
            dz = points[i, 2] - antennas[a, 2]
            over = 1 / math.sqrt(dx * dx + dy * dy + dz * dz)
            dx = dx * over
            dy = dy * over
            dz = dz * over
            path = 1 / over + extra[i]
            turns = wavenumber * path
            position = (turns - math.floor(turns)) * _TURNS
            cell = min(int(position), _TURNS - 1)
            fraction = np.float32(position - cell)
            distance[a, i] = path - (dx * drift[0] + dy * drift[1] + dz * drift[2])
            phasor[a, i] = _CIRCLE[cell] + fraction * (_CIRCLE[cell + 1] - _CIRCLE[cell])
            if lanes > 0:
                cosine = dx * boresight[0] + dy * boresight[1] + dz * boresight[2]
                position = min(max(cosine, 0.0), 1.0) * steps
                row = int(position)
                fraction = np.float32(position - row)
                size = np.float32(over)
                low = beams[row]
                high = beams[row + 1]
                out = gain[a, i]
                for g in range(lanes):
                    out[g] = (low[g] + fraction * (high[g] - low[g])) * size
            else:
                hh, hv, vv = _antenna_gain(dx, dy, dz, boresight, horizontal, vertical, exponent)
                gain[a, i, 0] = hh * over
                gain[a, i, 1] = hv * over
                gain[a, i, 2] = vv * over


@cache
def _spreading(lanes: int, dipoles: bool) -> Any:
    """Return the kernel for a number of lanes.

    The compiler knows the number, so that it sums several at once. For horns the lanes are h, v and
    cross, each for all ranks, and each lane has a gain of its own; for dipoles they are HH, HV, VH
    and VV, each for all ranks.
    """

    @shared(cache=True, fastmath=True)
    def spread(  # type: ignore[no-untyped-def]
        coefficient, ranks, distance, phasor, gain, tx, rx, per_metre, table, profile, begin, end
    ):
        """Add points to the profiles of pairs.

        Parameters
        ----------
        coefficient : (point, lane) ndarray of complex64
            Amplitudes h, v and cross, each for all ranks.
        ranks : int
            Number of functions of frequency.
        distance, phasor, gain
            As :func:`antenna_terms` fills them.
        tx, rx : (pair,) ndarray of int
            Antennas of every pair.
        per_metre : float
            Bins of a metre of path.
        table : (step, tap) ndarray of float32
            Taps of the window by fraction of a bin.
        profile : (pair, bin + tap, 2·lane) ndarray of float32
            Profiles, real parts before imaginary parts.
        begin, end : int
            Pairs of this call.
        """
        steps = table.shape[0] - 2
        bins = profile.shape[1] - table.shape[1]
        turns = 1.0 / bins
        for q in range(begin, end):
            value = np.zeros(2 * lanes, np.float32)
            # An index that cannot be negative needs no test of its sign.
            a = np.uint64(tx[q])
            b = np.uint64(rx[q])
            for i in range(np.uint64(coefficient.shape[0])):
                bin_position = (distance[a, i] + distance[b, i]) * per_metre
                bin_position -= bins * math.floor(bin_position * turns)
                start = np.uint64(min(int(bin_position), bins - 1))
                position = (bin_position - start) * steps
                row = np.uint64(position)
                fraction = np.float32(position - row)
                carrier = phasor[a, i] * phasor[b, i]
                sent = gain[a, i]
                taken = gain[b, i]
                z = coefficient[i]
                if dipoles:
                    for r in range(ranks):
                        h = z[r] * carrier
                        v = z[ranks + r] * carrier
                        x = z[2 * ranks + r] * carrier
                        hh = sent[0] * taken[0] * h + (sent[0] * taken[1] + sent[1] * taken[0]) * x
                        hh += sent[1] * taken[1] * v
                        hv = sent[0] * taken[2] * x + sent[1] * taken[2] * v
                        vh = sent[2] * taken[0] * x + sent[2] * taken[1] * v
                        vv = sent[2] * taken[2] * v
                        o = r
                        m = lanes + r
                        value[o] = hh.real
                        value[ranks + o] = hv.real
                        value[2 * ranks + o] = vh.real
                        value[3 * ranks + o] = vv.real
                        value[m] = hh.imag
                        value[ranks + m] = hv.imag
                        value[2 * ranks + m] = vh.imag
                        value[3 * ranks + m] = vv.imag
                else:
                    real = carrier.real
                    imag = carrier.imag
                    for k in range(lanes):
                        both_ways = sent[k] * taken[k]
                        value[k] = both_ways * (z[k].real * real - z[k].imag * imag)
                        value[lanes + k] = both_ways * (z[k].real * imag + z[k].imag * real)
                low = table[row]
                high = table[row + 1]
                w0 = low[0] + fraction * (high[0] - low[0])
                w1 = low[1] + fraction * (high[1] - low[1])
                w2 = low[2] + fraction * (high[2] - low[2])
                w3 = low[3] + fraction * (high[3] - low[3])
                taps = profile[q, start : start + 4]
                for k in range(2 * lanes):
                    taps[0, k] += w0 * value[k]
                    taps[1, k] += w1 * value[k]
                    taps[2, k] += w2 * value[k]
                    taps[3, k] += w3 * value[k]

    return spread


class Spreader:
    """Sum of the echoes of point scatterers over all pairs and uniform tones.

    Parameters
    ----------
    start, step : float
        First tone and spacing of the tones, Hz.
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
        values: ComplexArray,
        functions: AnyArray,
        array: ArrayState,
        extra: FloatArray | None = None,
        nodes: FloatArray | None = None,
    ) -> ComplexArray:
        """Return ``Σ_i g_t·g_r/(R_t·R_r)·Σ_r value_r·H_r(f)·exp(-j2πf(R_t + R_r + 2·extra)/c)``.

        Parameters
        ----------
        points : ndarray (point, 3)
            Positions in the lane frame, m.
        values : ndarray (point, 3, rank) of complex64
            Amplitudes HH, VV and cross for every function H_r, m.
        functions : ndarray (rank, frequency)
            H_r.
        array : ArrayState
            The antennas.
        extra : ndarray (point,), optional
            Electrical path beyond the straight line to each antenna, m.
        nodes : ndarray (rank,), optional
            Frequencies, Hz, at which the horns' beam is taken for every function; without them it
            is that of ``array.exponent`` for all.

        Returns
        -------
        ndarray (channel, pair, frequency) of complex64
            For horns HH, VV and cross of the rays' own directions, for dipoles HH, HV, VH and VV.
        """
        if extra is None:
            extra = np.zeros(len(points))
        exponents = np.full(len(functions), array.exponent)
        if nodes is not None:
            exponents = array.exponents(nodes)
        total = np.zeros((array.channels, array.tx.size, self.count), np.complex64)
        for chosen in self._groups_of_equal_rate(points, array):
            echoes = self._sum(points, values, functions, array, extra, exponents, chosen)
            total += echoes * self._sweep_phase(points[chosen], array)
        return total

    def _groups_of_equal_rate(self, points: FloatArray, array: ArrayState) -> Iterator[IndexArray]:
        """Yield the indices of points whose echoes share the quadratic phase of a sweep in motion.

        At rest these are all points at once.
        """
        if not array.drift.any() or not len(points):
            yield np.arange(len(points))
            return
        rate = _path_rates(points, array.position.mean(axis=0), array.drift)
        # Cycles by which the phases of the extreme rates differ at the ends of the band, both ways.
        turn = 2 * np.ptp(rate) * self.bandwidth / 4 / SPEED_OF_LIGHT
        groups = max(1, math.ceil(turn / _TURN))
        edges = np.linspace(rate.min(), rate.max(), groups + 1)
        for low, high in itertools.pairwise(edges):
            yield np.flatnonzero((rate >= low) & ((rate < high) | (high == edges[-1])))

    @property
    def bandwidth(self) -> float:
        """Number of tones times their spacing, Hz."""
        return self.per_metre * SPEED_OF_LIGHT / self.bins * self.count

    def _sweep_phase(self, points: FloatArray, array: ArrayState) -> ComplexArray:
        """Return the phase (pair, frequency) that the mean rate of the path leaves beyond a delay.

        It is ``κ²·Δf·ΔL/(K·c)`` cycles, κ counting tones from the middle one.
        """
        points = points[:: max(1, len(points) // 500)]
        if not array.drift.any() or not len(points):
            return np.ones((1, 1), np.complex64)
        # Near points count more, as their echoes are stronger.
        weight = np.sum((points - array.position.mean(axis=0)) ** 2, axis=1) ** -2.0
        rates = []
        for antenna in array.position:
            of_points = _path_rates(points, antenna, array.drift)
            rates.append(np.average(of_points, weights=weight))
        rate = np.array(rates)
        square = (np.arange(self.count) - self.centre) ** 2
        cycles = square * self.bandwidth / self.count**2 / SPEED_OF_LIGHT
        phase = np.outer(rate[array.tx] + rate[array.rx], cycles)
        return np.exp(-2j * np.pi * phase).astype(np.complex64)

    def _sum(
        self,
        points: FloatArray,
        values: ComplexArray,
        functions: AnyArray,
        array: ArrayState,
        extra: FloatArray,
        exponents: FloatArray,
        chosen: IndexArray,
    ) -> ComplexArray:
        """Return the sum over the chosen points, without the phase of a sweep in motion."""
        ranks = len(functions)
        lanes = -(-array.channels * ranks // _LANES) * _LANES
        spread = _spreading(lanes, array.dipoles)
        beams = np.empty((0, 0), np.float32) if array.dipoles else _beam_table(exponents, lanes)
        profile = np.zeros((array.tx.size, self.bins + WIDTH, 2 * lanes), np.float32)
        flat = values.reshape(len(points), 3 * ranks)
        coefficient = np.zeros((_CHUNK, lanes), np.complex64)
        shape = (len(array.position), _CHUNK)
        distance = np.empty(shape)
        phasor = np.empty(shape, np.complex64)
        gain = np.empty((*shape, 3 if array.dipoles else lanes), np.float32)
        drift = array.drift * (self.wavenumber * SPEED_OF_LIGHT / self.bandwidth)
        # Chunks bound the memory of the rays.
        for first in range(0, len(chosen), _CHUNK):
            chunk = chosen[first : first + _CHUNK]
            coefficient[: len(chunk), : 3 * ranks] = flat[chunk]
            antenna_terms(
                points[chunk],
                array.position,
                array.boresight,
                array.horizontal,
                array.vertical,
                array.exponent,
                beams,
                self.wavenumber,
                extra[chunk],
                drift,
                distance,
                phasor,
                gain,
            )
            spread(
                coefficient[: len(chunk)],
                ranks,
                distance,
                phasor,
                gain,
                array.tx,
                array.rx,
                self.per_metre,
                self._table,
                profile,
            )
        return self._to_tones(profile, array.channels, functions)

    def _to_tones(self, profile: Float32Array, kinds: int, functions: AnyArray) -> ComplexArray:
        """Return the spectra (kind, pair, frequency) of profiles (pair, bin, 2·lane).

        Each rank's tones are multiplied by their function.
        """
        spectra = np.empty((kinds * len(functions), len(profile), self.bins), np.complex64)
        _fold(WIDTH, spectra, profile)
        spectra = scipy.fft.fft(spectra, axis=-1, overwrite_x=True, workers=2)

        # The first tap lies WIDTH/2 - 1 bins before the bin of a path.
        tones = np.arange(self.count) - self.centre
        shift = np.exp(2j * np.pi * tones * (WIDTH // 2 - 1) / self.bins) * self._correction
        weight = (functions * shift).astype(np.complex64)

        out = np.zeros((kinds, len(profile), self.count), np.complex64)
        below = self.centre  # tones below the middle lie at the end of a spectrum
        for lane, spectrum in enumerate(spectra):
            kind, rank = divmod(lane, len(functions))
            out[kind, :, :below] += spectrum[:, self.bins - below :] * weight[rank, :below]
            out[kind, :, below:] += spectrum[:, : self.count - below] * weight[rank, below:]
        return out


@shared(cache=True)
def _fold(taps, out, profile, begin, end):  # type: ignore[no-untyped-def]
    """Fill complex profiles (lane, pair, bin), wrapped round at the end.

    ``profile`` (pair, bin + taps, 2·lane) has real parts before imaginary ones.
    """
    lanes = profile.shape[2] // 2
    bins = out.shape[2]
    for q in range(begin, end):
        for k in range(taps):
            # Whole rows would be checked for their shapes, which takes long to compile.
            for c in range(2 * lanes):
                profile[q, k, c] += profile[q, bins + k, c]
        for c in range(out.shape[0]):
            for k in range(bins):
                out[c, q, k] = complex(profile[q, k, c], profile[q, k, lanes + c])


def _path_rates(points: FloatArray, antenna: FloatArray, drift: FloatArray) -> FloatArray:
    """Return how much longer paths to points (point, 3) get as an antenna moves by a drift, m."""
    ray = points - antenna
    return -(ray @ drift) / np.linalg.norm(ray, axis=1)


def _beam_table(exponents: FloatArray, lanes: int) -> Float32Array:
    """Return amplitudes cos^(n/2) over the cosine from 0 to 1 and one step more (step, lane).

    The exponents are repeated over the lanes.
    """
    cosine = np.minimum(np.arange(_COSINES + 2) / _COSINES, 1.0)
    half_exponent = 0.5 * np.resize(exponents, lanes)
    return (cosine[:, None] ** half_exponent).astype(np.float32)


def _window(bins: int, tone: IndexArray) -> tuple[Float32Array, FloatArray]:
    """Return Kaiser-Bessel taps by fraction of a bin, and the correction of every tone."""
    ratio = bins / tone.size
    # Beatty, Nishimura & Pauly 2005: the best β for this width and oversampling.
    beta = math.pi * math.sqrt((WIDTH / ratio) ** 2 * (ratio - 0.5) ** 2 - 0.8)

    # Window I0(β·sqrt(1 - (2x/w)²)) at the taps' distances x; its transform is w·sinh(r)/r.
    fraction = np.arange(_TABLE + 2) / _TABLE
    offset = np.arange(WIDTH) - (WIDTH // 2 - 1)
    distance = offset - fraction[:, None]
    inside = np.maximum(1 - (distance / (WIDTH / 2)) ** 2, 0)
    taps = np.where(inside > 0, np.i0(beta * np.sqrt(inside)), 0)
    root = np.sqrt(beta**2 - (np.pi * WIDTH * tone / bins) ** 2 + 0j)
    correction = 1 / (WIDTH * np.sinh(root) / root).real
    return taps.astype(np.float32), correction
