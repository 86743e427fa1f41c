"""What the antennas and their cables do to a wave: gain, phase and delay of every port, cross-talk, ringing.

Every antenna has a Jones matrix ``P·(1 + L)`` in transmission and ``(1 + L)·P`` in reception: L leaks between the
polarizations, P holds what the ports do. A pair records ``P_r·(1 + L_r)·S·(1 + L_t)·P_t``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flgpr.model import Sensor
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.draw import stream

_TAPS = 32  # delays of which a leakage in frequency is made
_SETTLING = 60  # scans between the knots of the antennas' drift: a minute or two, as temperatures take


class AntennaErrors:
    """The antennas' errors that the sensor's ``errors`` turn on; each scan's depend on seed and scan number alone."""

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self.errors, self.seed = sensor.errors, seed
        self.frequency = sensor.tones.axis()
        self._first, self._second = sensor.pair_indices()
        self._shape = (2, max(len(sensor.tx), len(sensor.rx)), 2)  # side, antenna, port
        self._leak = None if self.errors.isolation_db is None else self._draw_leakage()
        self._still = self._draw_imbalance() * self._draw_ringing()
        level = np.array([self.errors.antenna_gain_db, self.errors.antenna_phase, self.errors.antenna_delay])
        self._level = level.reshape(3, 1, 1, 1)

    def apply(self, signal: NDArray[np.complex64], scan: int) -> NDArray[np.complex64]:
        """Pass the four channels HH, HV, VH, VV (4, pair, frequency) through the antennas."""
        if self._leak is not None:
            signal = self._mix(signal)
        ports = self.ports(scan)
        if ports is None:
            return signal
        sent, taken = ports[0][self._first].astype(np.complex64), ports[1][self._second].astype(np.complex64)
        return np.stack([signal[2 * i + j] * sent[:, i] * taken[:, j] for i in range(2) for j in range(2)])

    def ports(self, scan: int) -> ComplexArray | None:
        """Transfer (side, antenna, port, frequency) of the ports in a scan: side sends or takes, port is H or V."""
        if not self._level.any():
            return self._still if self._still.size > 1 else None
        rng = stream(self.seed, "antennas")
        error = rng.normal(size=(3, *self._shape))
        if self.errors.antenna_drift > 0:
            drift = slow_change(self.seed, "antenna-drift", scan, (3, *self._shape), _SETTLING).real
            error = error + self.errors.antenna_drift * math.sqrt(2) * drift
        gain_db, phase, delay = (self._level * error)[..., None]
        turned = np.exp(1j * (phase - 2 * np.pi * self.frequency * delay))
        return np.asarray(self._still * 10 ** (gain_db / 20) * turned)

    def _mix(self, signal: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Mix the polarizations by the leakages of every antenna."""
        leak = np.asarray(self._leak)
        t_hv, t_vh = leak[0][self._first].swapaxes(0, 1)  # V radiated when H is fed, and H when V is
        r_hv, r_vh = leak[1][self._second].swapaxes(0, 1)  # V taken up by the H port, and H by the V port
        hh, hv, vh, vv = signal
        h_fed = (hh + t_hv * vh, hv + t_hv * vv)
        v_fed = (vh + t_vh * hh, vv + t_vh * hv)
        mixed = [part for h, v in (h_fed, v_fed) for part in (h + r_hv * v, v + r_vh * h)]
        return np.stack(mixed).astype(np.complex64)

    def _draw_leakage(self) -> ComplexArray:
        """Leakages (side, antenna, port, frequency), or (..., 1) where they do not depend on frequency."""
        level, rng = 10 ** ((self.errors.isolation_db or 0.0) / 20), stream(self.seed, "isolation")
        bandwidth = self.errors.isolation_bandwidth
        if bandwidth is None:
            return np.asarray(level * np.exp(2j * np.pi * rng.random(self._shape)))[..., None]
        return level * random_response(rng, self._shape, self.frequency, bandwidth)

    def _draw_imbalance(self) -> ComplexArray:
        """V over H that all transmitting and that all receiving antennas have in common, shared out evenly."""
        errors = self.errors
        if errors.imbalance_db == 0 and errors.imbalance_phase == 0:
            return np.ones((1, 1, 1, 1), complex)
        db, phase = stream(self.seed, "imbalance").normal(size=(2, 2)) * [
            [errors.imbalance_db],
            [errors.imbalance_phase],
        ]
        half = np.sqrt(10 ** (db / 20) * np.exp(1j * phase))
        return np.broadcast_to(np.stack([1 / half, half], axis=1)[:, None, :, None], (*self._shape, 1))

    def _draw_ringing(self) -> ComplexArray:
        errors = self.errors
        if errors.ringing_db is None or not errors.ringing_frequencies:
            return np.ones((1, 1, 1, 1), complex)
        rng = stream(self.seed, "ringing")
        count = len(errors.ringing_frequencies)
        place = np.array(errors.ringing_frequencies) * (1 + 0.02 * rng.normal(size=(*self._shape, count)))
        size = 10 ** (errors.ringing_db / 20) * np.exp(2j * np.pi * rng.random((*self._shape, count)))
        return 1 + (size[..., None] * resonance(self.frequency, place[..., None], errors.ringing_q)).sum(axis=-2)


def resonance(frequency: FloatArray, centre: FloatArray, quality: float) -> ComplexArray:
    """Response of a damped resonance, one at its centre f0, that rings as ``exp(-π·f0·t/Q)`` (narrow-band)."""
    return np.asarray(1 / (1 + 2j * quality * (frequency - centre) / centre))


def random_response(
    rng: np.random.Generator, shape: tuple[int, ...], frequency: FloatArray, bandwidth: float
) -> ComplexArray:
    """Draw smooth complex Gaussian functions of frequency with mean square one, (*shape, frequency).

    They are sums of echoes whose delays are distributed exponentially, so that the correlation between tones Δf apart
    is ``1/(1 + jΔf/bandwidth)``; the coherence, its square, is one half at ``bandwidth``.
    """
    delay = rng.exponential(1 / (2 * np.pi * bandwidth), (*shape, _TAPS, 1))
    size = rng.normal(size=delay.shape) + 1j * rng.normal(size=delay.shape)
    total = np.zeros((*shape, frequency.size), complex)
    for tap in range(_TAPS):
        total += size[..., tap, :] * np.exp(-2j * np.pi * delay[..., tap, :] * frequency)
    return np.asarray(total / math.sqrt(2 * _TAPS))


def slow_change(seed: int, name: str, scan: int, shape: tuple[int, ...], knot: int) -> ComplexArray:
    """Give complex Gaussian numbers of mean square one that turn from one value to the next in ``knot`` scans."""
    first, part = divmod(scan, knot)
    ends = []
    for k in (first, first + 1):
        rng = stream(seed, name, k)
        ends.append((rng.normal(size=shape) + 1j * rng.normal(size=shape)) / math.sqrt(2))
    angle = part / knot * math.pi / 2
    return np.asarray(math.cos(angle) * ends[0] + math.sin(angle) * ends[1])
