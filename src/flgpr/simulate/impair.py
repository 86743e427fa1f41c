"""What the radar adds to the echoes: antennas' errors, self-signature, noise, interference, lost sweeps, poses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flgpr.model import SPEED_OF_LIGHT, Sensor
from flgpr.model.arrays import FloatArray
from flgpr.simulate.antennas import AntennaErrors, slow_change
from flgpr.simulate.draw import stream
from flgpr.simulate.roughness import surface_backscatter

_KNOT = 6  # scans between the knots of slow drift


class Impairments:
    """A sensor's errors that its ``errors`` turn on; each scan's depend on the seed and the scan's number alone."""

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self.sensor, self.errors, self.seed = sensor, sensor.errors, seed
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
        envelope = np.where(path < 2.2 * self.sensor.footprint[3], (slant / self.errors.noise_range) ** -2.0, 0)
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
        errors, tones = self.errors, self.frequency.size
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

    The image of a cell of clutter has the power ``σ⁰·A·g²·(P·K)²`` (P pairs, K tones, A the cell's area, g the two-way
    amplitude of a unit scatterer), that of white noise ``P·K`` times its variance. Range and band are those in the
    sensor's ``errors``; the soil has ε = 3.4, s = 5 mm, l = 5 cm, and HH counts.
    """
    low, high = sensor.errors.noise_band
    axis = sensor.tones.axis()
    band = axis[(axis >= low) & (axis <= high)]
    if band.size < 2:
        raise ValueError(f"noise_band must hold at least two tones, got {low:g} to {high:g} Hz")
    distance, centre = sensor.errors.noise_range, float(band.mean())
    slant = math.hypot(distance, sensor.height)
    sine = distance / slant
    sigma = surface_backscatter(centre, sine, 3.4, 0.005, 0.05)[0]
    tx, rx = sensor.pairs()
    aperture = float(np.ptp(tx[:, 0]) + np.ptp(rx[:, 0]))
    cell = SPEED_OF_LIGHT / (2 * (high - low) * sine) * SPEED_OF_LIGHT / centre * slant / max(aperture, 0.1)
    if sensor.antenna.kind == "dipole":
        amplitude = 2 * np.pi * centre * 4e-7 * np.pi / (4 * np.pi) ** 1.5 / slant**2
    else:
        gain = 10 ** (sensor.antenna.gain_db / 10) * (centre / sensor.antenna.gain_frequency) ** 2
        off_axis = math.asin(sensor.height / slant) - sensor.tilt
        pattern = math.cos(off_axis) ** float(sensor.antenna.exponents(np.array([centre]))[0])
        amplitude = gain * pattern * SPEED_OF_LIGHT / centre / (4 * np.pi) ** 1.5 / slant**2
    return float(sigma * cell * amplitude**2 * tx.shape[0] * band.size)
