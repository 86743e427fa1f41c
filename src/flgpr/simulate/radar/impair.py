"""What the radar adds to the echoes: antennas' errors, self-signature, noise, interference, lost sweeps, poses.

Every antenna has a Jones matrix ``P·(1 + L)`` in transmission and ``(1 + L)·P`` in reception: L
leaks between the polarizations, P holds what the ports do. A pair records ``P_r·(1 + L_r)·S·(1 +
L_t)·P_t``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flgpr.model import SPEED_OF_LIGHT, Sensor
from flgpr.model.arrays import ComplexArray, FloatArray
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.scene.draw import stream

_KNOT = 6  # scans between the knots of slow drift


class Impairments:
    """A sensor's errors that its ``errors`` turn on; each scan's depend on the seed and the scan's number alone."""

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self.sensor = sensor
        self.errors = sensor.errors
        self.seed = seed
        self.frequency = sensor.tones.axis()
        self.pairs = sensor.pairs()[0].shape[0]
        self.reference = reference_clutter(sensor)
        self._antennas = AntennaErrors(sensor, seed)
        self._signature = None if self.errors.self_signature_db is None else self._draw_signature()
        rng = stream(seed, "interference")
        tones = min(self.errors.interference_tones, self.frequency.size)
        self._hit = rng.choice(self.frequency.size, tones, replace=False)
        self._hit_db = rng.uniform(*self.errors.interference_db, tones)

    def apply(self, signal: NDArray[np.complex64], scan: int) -> NDArray[np.complex64]:
        """Add the errors of a scan to the four channels HH, HV, VH, VV (4, pair, frequency)."""
        errors = self.errors
        rng = stream(self.seed, "scan", scan)
        signal = self._antennas.apply(signal, scan)
        if self._signature is not None:
            signal = signal + self._signature * (1 + self._drift(scan))
        if errors.gain_db > 0:
            signal = signal * np.complex64(10 ** (rng.normal(0, errors.gain_db) / 20))
        if errors.clutter_to_noise_db is not None:
            signal = signal + self._noise(signal.shape, rng)
            if errors.burst_probability > 0:
                signal = signal + self.bursts(scan)
        if errors.missing > 0:
            signal = signal.copy()
            signal[:, rng.random(self.pairs) < errors.missing] = np.nan
        return signal.astype(np.complex64)

    def reported_pose(self, pose: FloatArray) -> FloatArray:
        """Add the navigation's errors to true poses (scan, 6)."""
        rng = stream(self.seed, "navigation")
        reported = pose.copy()
        reported[:, :3] += rng.normal(0, 1, (len(pose), 3)) * self.errors.position
        reported[:, 3] += rng.normal(0, 1, len(pose)) * self.errors.heading
        if self.errors.attitude > 0:
            reported[:, 4:] += rng.normal(0, 1, (len(pose), 2)) * self.errors.attitude
        return reported

    @property
    def noise_power(self) -> float:
        """Variance of the thermal noise of a sample."""
        level = self.errors.clutter_to_noise_db
        return 0.0 if level is None else float(self.reference / 10 ** (level / 10))

    def _draw_signature(self) -> NDArray[np.complex64]:
        """Draw fixed echoes within the vehicle and its antennas, at every range, decaying as the clutter does."""
        rng = stream(self.seed, "self-signature")
        tones = self.frequency.size
        span = SPEED_OF_LIGHT / (self.frequency[1] - self.frequency[0])
        path = np.arange(2 * tones) / (2 * tones) * span
        slant = np.maximum(path / 2, 1.2 * self.sensor.height)
        envelope = np.where(
            path < 2.2 * self.sensor.footprint[3], (slant / self.errors.noise_range) ** -2.0, 0
        )
        shape = (4, self.pairs, path.size)
        echo = (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / math.sqrt(2) * envelope
        echo[1:3] *= 0.3
        spectrum = np.fft.fft(echo, axis=-1)[..., :tones] / math.sqrt(2 * tones)
        profile = self.reference * 10 ** ((self.errors.self_signature_db or 0.0) / 10)
        return np.asarray(spectrum * math.sqrt(profile), dtype=np.complex64)

    def _drift(self, scan: int) -> NDArray[np.complex64]:
        """Slow relative change of the self-signature, per channel and pair."""
        drift = slow_change(self.seed, "drift", scan, (4, self.pairs, 1), _KNOT)
        return np.asarray(self.errors.self_signature_drift * drift, dtype=np.complex64)

    def bursts(self, scan: int) -> NDArray[np.complex64]:
        """Pulsed interference of a scan (4, pair, frequency): a run of tones, in no phase, in some of the sweeps."""
        errors = self.errors
        tones = self.frequency.size
        rng = stream(self.seed, "bursts", scan)
        hit = np.flatnonzero(rng.random(self.pairs) < errors.burst_probability)
        length = rng.integers(errors.burst_tones[0], errors.burst_tones[1] + 1, hit.size)
        start = rng.integers(0, np.maximum(tones - length, 0) + 1)
        level = np.sqrt(self.noise_power * 10 ** (rng.uniform(*errors.burst_db, hit.size) / 10))
        tone = np.arange(tones)
        inside = (tone >= start[:, None]) & (tone < (start + length)[:, None])
        total = np.zeros((4, self.pairs, tones), np.complex64)
        phase = rng.uniform(0, 2 * np.pi, (4, hit.size, tones))
        total[:, hit] = level[:, None] * inside * np.exp(1j * phase)
        return total

    def _noise(self, shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.complex64]:
        white = rng.standard_normal((*shape, 2), dtype=np.float32).view(np.complex64)[..., 0]
        noise = white * np.float32(math.sqrt(self.noise_power / 2))
        if self._hit.size:
            size = np.sqrt(self.noise_power * 10 ** (self._hit_db / 10))
            phase = rng.uniform(0, 2 * np.pi, (*shape[:2], self._hit.size))
            noise[..., self._hit] += (size * np.exp(1j * phase)).astype(np.complex64)
        return noise


def reference_clutter(sensor: Sensor) -> float:
    """Variance of white noise that would equal the clutter of reference soil in the image.

    The image of a cell of clutter has the power ``σ⁰·A·g²·(P·K)²`` (P pairs, K tones, A the cell's
    area, g the two-way amplitude of a unit scatterer), that of white noise ``P·K`` times its
    variance. Range and band are those in the sensor's ``errors``; the soil has ε = 3.4, s = 5 mm, l
    = 5 cm, and HH counts.
    """
    low, high = sensor.errors.noise_band
    axis = sensor.tones.axis()
    band = axis[(axis >= low) & (axis <= high)]
    if band.size < 2:
        raise ValueError(f"noise_band must hold at least two tones, got {low:g} to {high:g} Hz")
    distance = sensor.errors.noise_range
    centre = float(band.mean())
    slant = math.hypot(distance, sensor.height)
    sine = distance / slant
    sigma = surface_backscatter(centre, sine, 3.4, 0.005, 0.05)[0]
    tx, rx = sensor.pairs()
    aperture = float(np.ptp(tx[:, 0]) + np.ptp(rx[:, 0]))
    cell = (
        SPEED_OF_LIGHT
        / (2 * (high - low) * sine)
        * SPEED_OF_LIGHT
        / centre
        * slant
        / max(aperture, 0.1)
    )
    if sensor.antenna.kind == "dipole":
        amplitude = 2 * np.pi * centre * 4e-7 * np.pi / (4 * np.pi) ** 1.5 / slant**2
    else:
        gain = 10 ** (sensor.antenna.gain_db / 10) * (centre / sensor.antenna.gain_frequency) ** 2
        off_axis = math.asin(sensor.height / slant) - sensor.tilt
        pattern = math.cos(off_axis) ** float(sensor.antenna.exponents(np.array([centre]))[0])
        amplitude = gain * pattern * SPEED_OF_LIGHT / centre / (4 * np.pi) ** 1.5 / slant**2
    return float(sigma * cell * amplitude**2 * tx.shape[0] * band.size)


_TAPS = 32  # delays of which a leakage in frequency is made
# scans between the knots of the antennas' drift: a minute or two, as temperatures take
_SETTLING = 60


class AntennaErrors:
    """The antennas' errors that the sensor's ``errors`` turn on; each scan's depend on seed and scan number alone."""

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self.errors = sensor.errors
        self.seed = seed
        self.frequency = sensor.tones.axis()
        self._first, self._second = sensor.pair_indices()
        self._shape = (2, max(len(sensor.tx), len(sensor.rx)), 2)  # side, antenna, port
        self._leak = None if self.errors.isolation_db is None else self._draw_leakage()
        self._still = self._draw_imbalance() * self._draw_ringing()
        level = np.array(
            [self.errors.antenna_gain_db, self.errors.antenna_phase, self.errors.antenna_delay]
        )
        self._level = level.reshape(3, 1, 1, 1)

    def apply(self, signal: NDArray[np.complex64], scan: int) -> NDArray[np.complex64]:
        """Pass the four channels HH, HV, VH, VV (4, pair, frequency) through the antennas."""
        if self._leak is not None:
            signal = self._mix(signal)
        ports = self.ports(scan)
        if ports is None:
            return signal
        sent = ports[0][self._first].astype(np.complex64)
        taken = ports[1][self._second].astype(np.complex64)
        return np.stack(
            [signal[2 * i + j] * sent[:, i] * taken[:, j] for i in range(2) for j in range(2)]
        )

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
        t_hv, t_vh = leak[0][self._first].swapaxes(
            0, 1
        )  # V radiated when H is fed, and H when V is
        r_hv, r_vh = leak[1][self._second].swapaxes(
            0, 1
        )  # V taken up by the H port, and H by the V port
        hh, hv, vh, vv = signal
        h_fed = (hh + t_hv * vh, hv + t_hv * vv)
        v_fed = (vh + t_vh * hh, vv + t_vh * hv)
        mixed = [part for h, v in (h_fed, v_fed) for part in (h + r_hv * v, v + r_vh * h)]
        return np.stack(mixed).astype(np.complex64)

    def _draw_leakage(self) -> ComplexArray:
        """Leakages (side, antenna, port, frequency), or (..., 1) where they do not depend on frequency."""
        level = 10 ** ((self.errors.isolation_db or 0.0) / 20)
        rng = stream(self.seed, "isolation")
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
        return np.broadcast_to(
            np.stack([1 / half, half], axis=1)[:, None, :, None], (*self._shape, 1)
        )

    def _draw_ringing(self) -> ComplexArray:
        errors = self.errors
        if errors.ringing_db is None or not errors.ringing_frequencies:
            return np.ones((1, 1, 1, 1), complex)
        rng = stream(self.seed, "ringing")
        count = len(errors.ringing_frequencies)
        place = np.array(errors.ringing_frequencies) * (
            1 + 0.02 * rng.normal(size=(*self._shape, count))
        )
        size = 10 ** (errors.ringing_db / 20) * np.exp(
            2j * np.pi * rng.random((*self._shape, count))
        )
        return 1 + (
            size[..., None] * resonance(self.frequency, place[..., None], errors.ringing_q)
        ).sum(axis=-2)


def resonance(frequency: FloatArray, centre: FloatArray, quality: float) -> ComplexArray:
    """Response of a damped resonance, one at its centre f0, that rings as ``exp(-π·f0·t/Q)`` (narrow-band)."""
    return np.asarray(1 / (1 + 2j * quality * (frequency - centre) / centre))


def random_response(
    rng: np.random.Generator, shape: tuple[int, ...], frequency: FloatArray, bandwidth: float
) -> ComplexArray:
    """Draw smooth complex Gaussian functions of frequency with mean square one, (*shape, frequency).

    They are sums of echoes whose delays are distributed exponentially, so that the correlation
    between tones Δf apart is ``1/(1 + jΔf/bandwidth)``; the coherence, its square, is one half at
    ``bandwidth``.
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
