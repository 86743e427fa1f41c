"""What the radar adds to the echoes: antennas' errors, self-signature, noise, lost sweeps, poses.

Every antenna has a Jones matrix ``P·(1 + L)`` in transmission and ``(1 + L)·P`` in reception: L
leaks between the polarizations, P holds what the ports do. A pair records
``P_r·(1 + L_r)·S·(1 + L_t)·P_t``.
"""

from __future__ import annotations

import math

import numpy as np

from flgpr.model import SPEED_OF_LIGHT, Sensor
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.scene.draw import stream
from flgpr.simulate.scene.scene import Drive
from flgpr.types import Complex128Array, ComplexArray, FloatArray, IndexArray

_KNOT = 6  # scans between the knots of slow drift
_DRIVE = 1_000_000  # scans from one drive to the next, in the count by which errors are drawn
_SIGNATURE_REACH = 2.2  # of the far edge of the ground in view: just beyond its last echo; assumed


def signature_end(sensor: Sensor) -> float:
    """Return the path at which the simulated self-signature ends, m, there and back.

    A real one fades into the noise. A simulated one stops at once, a little beyond the last echo of
    the ground in view: a B-scan shows a step there.
    """
    return _SIGNATURE_REACH * sensor.ground_in_view[3]


class Impairments:
    """A sensor's errors that its ``errors`` turn on.

    Those of a scan depend on the seed and the scan's number alone.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    seed : int
        Seed of the run.
    drive : int
        Number of the drive: noise, drifts and the navigation's errors are its own.
    change : Drive
        What its table says of the navigation.
    """

    def __init__(
        self, sensor: Sensor, seed: int, drive: int = 1, change: Drive | None = None
    ) -> None:
        self.sensor = sensor
        self.errors = sensor.errors
        self.seed = seed
        self._drive = drive
        self._change = change or Drive()
        self.frequency = sensor.tones.axis()
        self.pairs = sensor.pairs()[0].shape[0]
        self.reference = reference_clutter(sensor)
        self._antennas = AntennaErrors(sensor, seed)
        self._signature = None
        if self.errors.self_signature_db is not None:
            self._signature = self._draw_signature()
        rng = stream(seed, "interference")
        count = min(self.errors.interference_tones, self.frequency.size)
        self._disturbed_tones = rng.choice(self.frequency.size, count, replace=False)
        self._disturbance_db = rng.uniform(*self.errors.interference_db, count)
        self._interference_start = stream(seed, "interference starts").random(count)

    def apply(self, signal: ComplexArray, scan: int) -> ComplexArray:
        """Return a scan's signal with the errors of that scan.

        Parameters
        ----------
        signal : ndarray (4, pair, frequency) of complex64
            HH, HV, VH and VV.
        scan : int
            Number of the scan.
        """
        errors = self.errors
        scan = self._counted(scan)
        rng = stream(self.seed, "scan", scan)
        signal = self._antennas.apply(signal, scan)
        if self._signature is not None:
            signal = signal + self._signature * (1 + self._drift(scan))
        if errors.gain_db > 0:
            signal = signal * np.complex64(10 ** (rng.normal(0, errors.gain_db) / 20))
        if errors.clutter_to_noise_db is not None:
            signal = signal + self._noise(signal.shape, rng, scan)
            if errors.burst_probability > 0:
                signal = signal + self.bursts(scan)
        if errors.missing > 0:
            signal = signal.copy()
            signal[:, rng.random(self.pairs) < errors.missing] = np.nan
        return signal.astype(np.complex64)

    def reported_pose(self, pose: FloatArray) -> FloatArray:
        """Return true poses (scan, 6) with the navigation's errors."""
        rng = stream(self.seed, "navigation", self._drive - 1)
        position = self.errors.position if self._change.position is None else self._change.position
        reported = pose.copy()
        reported[:, :3] += rng.normal(0, 1, (len(pose), 3)) * position
        reported[:, 3] += rng.normal(0, 1, len(pose)) * self.errors.heading
        if self.errors.attitude > 0:
            reported[:, 4:] += rng.normal(0, 1, (len(pose), 2)) * self.errors.attitude
        if self._change.drift > 0:
            for scan, row in enumerate(reported):
                count = self._counted(scan)
                drift = slow_change(self.seed, "navigation drift", count, (2,), _KNOT).real
                row[:2] += math.sqrt(2) * self._change.drift * drift
        return reported

    @property
    def noise_power(self) -> float:
        """Variance of the thermal noise of a sample."""
        level = self.errors.clutter_to_noise_db
        return 0.0 if level is None else float(self.reference / 10 ** (level / 10))

    def _counted(self, scan: int) -> int:
        """Return the number of a scan over all drives, by which its errors are drawn."""
        return _DRIVE * (self._drive - 1) + scan

    def _draw_signature(self) -> ComplexArray:
        """Draw fixed echoes within the vehicle and its antennas (4, pair, frequency).

        They come at every range and decay as the clutter does.
        """
        rng = stream(self.seed, "self-signature")
        tones = self.frequency.size
        span = SPEED_OF_LIGHT / (self.frequency[1] - self.frequency[0])
        path = np.arange(2 * tones) / (2 * tones) * span
        slant = np.maximum(path / 2, 1.2 * self.sensor.height)
        envelope = np.where(
            path < signature_end(self.sensor), (slant / self.errors.noise_range) ** -2.0, 0
        )
        shape = (4, self.pairs, path.size)
        white = rng.normal(size=shape) + 1j * rng.normal(size=shape)
        echo = white / math.sqrt(2) * envelope
        echo[1:3] *= 0.3  # cross-polarized echoes are weaker; assumed
        spectrum = np.fft.fft(echo, axis=-1)[..., :tones] / math.sqrt(2 * tones)
        power = self.reference * 10 ** ((self.errors.self_signature_db or 0.0) / 10)
        return np.asarray(spectrum * math.sqrt(power), dtype=np.complex64)

    def _drift(self, scan: int, name: str = "drift") -> ComplexArray:
        """Return a slow relative change (4, pair, 1), by the name of its random stream."""
        drift = slow_change(self.seed, name, scan, (4, self.pairs, 1), _KNOT)
        return np.asarray(self.errors.self_signature_drift * drift, dtype=np.complex64)

    def bursts(self, scan: int) -> ComplexArray:
        """Return the pulsed interference of a scan (4, pair, frequency).

        It is a row of neighbouring tones, of random phases, in some of the sweeps: a pulse lasts
        for a part of a sweep.
        """
        errors = self.errors
        tones = self.frequency.size
        rng = stream(self.seed, "bursts", scan)
        sweeps = np.flatnonzero(rng.random(self.pairs) < errors.burst_probability)

        shortest, longest = errors.burst_tones
        length = rng.integers(shortest, longest + 1, sweeps.size)
        start = rng.integers(0, np.maximum(tones - length, 0) + 1)
        level_db = rng.uniform(*errors.burst_db, sweeps.size)
        level = np.sqrt(self.noise_power * 10 ** (level_db / 10))
        tone = np.arange(tones)
        inside = (tone >= start[:, None]) & (tone < (start + length)[:, None])

        bursts = np.zeros((4, self.pairs, tones), np.complex64)
        phase = rng.uniform(0, 2 * np.pi, (4, sweeps.size, tones))
        bursts[:, sweeps] = level[:, None] * inside * np.exp(1j * phase)
        return bursts

    def direct_drift(self, scan: int) -> ComplexArray:
        """Return the slow relative change of the direct wave (4, pair, 1)."""
        return self._drift(self._counted(scan), "direct wave")

    def interference_levels(self, scan: int) -> tuple[IndexArray, FloatArray]:
        """Return which tones continuous interference disturbs in a scan, and how strongly.

        Returns
        -------
        tones : ndarray (disturbed,)
            Numbers of the tones, those of an interferer one after the other.
        level_db : ndarray (disturbed,)
            Level over the noise, dB.
        """
        errors = self.errors
        stands = np.ones(self._disturbed_tones.size, bool)
        if errors.interference_scans is not None:
            # Each has periods of its own, so that they do not all change in one scan.
            period = np.floor(scan / errors.interference_scans + self._interference_start)
            for number, count in enumerate(period.astype(int)):
                draw = stream(self.seed, "interference stands", number, int(count))
                stands[number] = draw.random() < 0.5
        width = np.arange(errors.interference_width)
        tones = (self._disturbed_tones[stands, None] + width).ravel()
        level_db = np.repeat(self._disturbance_db[stands], width.size)
        inside = tones < self.frequency.size
        return tones[inside], level_db[inside]

    def _noise(self, shape: tuple[int, ...], rng: np.random.Generator, scan: int) -> ComplexArray:
        """Draw thermal noise and the continuous interference of a scan (4, pair, frequency)."""
        white = rng.standard_normal((*shape, 2), dtype=np.float32).view(np.complex64)[..., 0]
        noise = white * np.float32(math.sqrt(self.noise_power / 2))
        tones, level_db = self.interference_levels(scan)
        if tones.size:
            size = np.sqrt(self.noise_power * 10 ** (level_db / 10))
            phase = rng.uniform(0, 2 * np.pi, (*shape[:2], tones.size))
            disturbance = (size * np.exp(1j * phase)).astype(np.complex64)
            for number, tone in enumerate(tones):  # channels may overlap
                noise[..., tone] += disturbance[..., number]
        return noise


def reference_clutter(sensor: Sensor) -> float:
    """Return the variance of white noise that equals the clutter of reference soil in the image.

    The image of a cell of clutter has the power ``σ⁰·A·g²·(P·K)²`` (P pairs, K tones, A the cell's
    area, g the two-way amplitude of a unit scatterer), that of white noise ``P·K`` times its
    variance. Range and band are those in the sensor's ``errors``; the soil has ε = 3.4, s = 5 mm,
    l = 5 cm, and HH counts.

    Parameters
    ----------
    sensor : Sensor
        The sensor.

    Returns
    -------
    float
        Variance of a sample, in units of the squared signal.

    Raises
    ------
    ValueError
        If the sensor's ``noise_band`` holds fewer than two tones.
    """
    low, high = sensor.errors.noise_band
    axis = sensor.tones.axis()
    band = axis[(axis >= low) & (axis <= high)]
    if band.size < 2:
        raise ValueError(f"noise_band must hold at least two tones, got {low:g} to {high:g} Hz")
    centre = float(band.mean())
    slant = math.hypot(sensor.errors.noise_range, sensor.height)
    sine = sensor.errors.noise_range / slant
    sigma = surface_backscatter(centre, sine, 3.4, 0.005, 0.05)[0]

    tx, rx = sensor.pairs()
    aperture = float(np.ptp(tx[:, 0]) + np.ptp(rx[:, 0]))
    down_range = SPEED_OF_LIGHT / (2 * (high - low) * sine)
    # In this order: another one would change the last bit of every noise sample.
    cell = down_range * SPEED_OF_LIGHT / centre * slant / max(aperture, 0.1)

    amplitude = _unit_amplitude(sensor, centre, slant)
    return float(sigma * cell * amplitude**2 * tx.shape[0] * band.size)


def _unit_amplitude(sensor: Sensor, frequency: float, slant: float) -> float:
    """Return the two-way amplitude g of a unit scatterer on the ground at a slant range, m.

    A horn has the gain G of its axis times its pattern, and g = G·λ/((4π)^1.5·R²); a dipole of
    unit moment sees the field ωμ0/(4πR), and g = ωμ0/((4π)^1.5·R²).
    """
    if sensor.antenna.kind == "dipole":
        return 2 * np.pi * frequency * 4e-7 * np.pi / (4 * np.pi) ** 1.5 / slant**2
    antenna = sensor.antenna
    gain = 10 ** (antenna.gain_db / 10) * (frequency / antenna.gain_frequency) ** 2
    off_axis = math.asin(sensor.height / slant) - sensor.tilt
    exponent = float(antenna.exponents(np.array([frequency]))[0])
    pattern = math.cos(off_axis) ** exponent
    return gain * pattern * SPEED_OF_LIGHT / frequency / (4 * np.pi) ** 1.5 / slant**2


_TAPS = 32  # delays of which a leakage in frequency is made
# Scans between the knots of the antennas' drift: a minute or two, as temperatures take.
_ANTENNA_KNOT = 60


class AntennaErrors:
    """The antennas' errors that the sensor's ``errors`` turn on.

    Those of a scan depend on the seed and the scan's number alone.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    seed : int
        Seed of the run.
    """

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self.errors = sensor.errors
        self.seed = seed
        self.frequency = sensor.tones.axis()
        self._first, self._second = sensor.pair_indices()
        self._shape = (2, max(len(sensor.tx), len(sensor.rx)), 2)  # side, antenna, port
        self._leak = None
        if self.errors.isolation_db is not None:
            self._leak = self._draw_leakage()
        self._fixed_transfer = self._draw_imbalance() * self._draw_ringing()
        errors = self.errors
        level = np.array([errors.antenna_gain_db, errors.antenna_phase, errors.antenna_delay])
        self._level = level.reshape(3, 1, 1, 1)

    def apply(self, signal: ComplexArray, scan: int) -> ComplexArray:
        """Return the channels HH, HV, VH, VV (4, pair, frequency) as the antennas pass them on."""
        if self._leak is not None:
            signal = self._mix(signal)
        ports = self.ports(scan)
        if ports is None:
            return signal
        sent = ports[0][self._first].astype(np.complex64)
        taken = ports[1][self._second].astype(np.complex64)
        channels = []
        for i in range(2):
            for j in range(2):
                channels.append(signal[2 * i + j] * sent[:, i] * taken[:, j])
        return np.stack(channels)

    def ports(self, scan: int) -> Complex128Array | None:
        """Return the transfer of the ports in a scan, None where there is no error.

        Returns
        -------
        ndarray (side, antenna, port, frequency) of complex or None
            Side is transmission or reception, port H or V.
        """
        if not self._level.any():
            return self._fixed_transfer if self._fixed_transfer.size > 1 else None
        rng = stream(self.seed, "antennas")
        shape = (3, *self._shape)  # gain, phase and delay of every port
        error = rng.normal(size=shape)
        if self.errors.antenna_drift > 0:
            drift = slow_change(self.seed, "antenna-drift", scan, shape, _ANTENNA_KNOT).real
            # The real part has half of the variance.
            error = error + self.errors.antenna_drift * math.sqrt(2) * drift
        gain_db, phase, delay = (self._level * error)[..., None]
        turned = np.exp(1j * (phase - 2 * np.pi * self.frequency * delay))
        return self._fixed_transfer * 10 ** (gain_db / 20) * turned

    def _mix(self, signal: ComplexArray) -> ComplexArray:
        """Return the channels with the leakages of every antenna between its polarizations."""
        leak = np.asarray(self._leak)
        # V radiated when H is fed, and H when V is.
        t_hv, t_vh = leak[0][self._first].swapaxes(0, 1)
        # V taken up by the H port, and H by the V port.
        r_hv, r_vh = leak[1][self._second].swapaxes(0, 1)
        hh, hv, vh, vv = signal

        # What comes back in H and V when the H port is fed, and when the V port is.
        h_of_h = hh + t_hv * vh
        v_of_h = hv + t_hv * vv
        h_of_v = vh + t_vh * hh
        v_of_v = vv + t_vh * hv
        mixed = []
        for h, v in ((h_of_h, v_of_h), (h_of_v, v_of_v)):
            mixed.append(h + r_hv * v)
            mixed.append(v + r_vh * h)
        return np.stack(mixed).astype(np.complex64)

    def _draw_leakage(self) -> Complex128Array:
        """Draw the leakages (side, antenna, port, frequency).

        Where they do not depend on frequency the last axis has one entry.
        """
        level = 10 ** ((self.errors.isolation_db or 0.0) / 20)
        rng = stream(self.seed, "isolation")
        bandwidth = self.errors.isolation_bandwidth
        if bandwidth is None:
            phase = 2j * np.pi * rng.random(self._shape)
            return np.asarray(level * np.exp(phase))[..., None]
        return level * random_response(rng, self._shape, self.frequency, bandwidth)

    def _draw_imbalance(self) -> Complex128Array:
        """Draw V over H that all transmitting, and that all receiving, antennas have in common.

        Each port has half of it.
        """
        errors = self.errors
        if errors.imbalance_db == 0 and errors.imbalance_phase == 0:
            return np.ones((1, 1, 1, 1), complex)
        level = [[errors.imbalance_db], [errors.imbalance_phase]]
        db, phase = stream(self.seed, "imbalance").normal(size=(2, 2)) * level
        half = np.sqrt(10 ** (db / 20) * np.exp(1j * phase))
        ports = np.stack([1 / half, half], axis=1)
        return np.broadcast_to(ports[:, None, :, None], (*self._shape, 1))

    def _draw_ringing(self) -> Complex128Array:
        """Draw the response of every port's resonances (side, antenna, port, frequency)."""
        errors = self.errors
        if errors.ringing_db is None or not errors.ringing_frequencies:
            return np.ones((1, 1, 1, 1), complex)
        rng = stream(self.seed, "ringing")
        count = len(errors.ringing_frequencies)
        shape = (*self._shape, count)
        # Antennas of a kind differ by 2 %; assumed.
        centre = np.array(errors.ringing_frequencies) * (1 + 0.02 * rng.normal(size=shape))
        phase = 2j * np.pi * rng.random(shape)
        size = 10 ** (errors.ringing_db / 20) * np.exp(phase)
        resonances = resonance(self.frequency, centre[..., None], errors.ringing_q)
        return 1 + (size[..., None] * resonances).sum(axis=-2)


def resonance(frequency: FloatArray, centre: FloatArray, quality: float) -> Complex128Array:
    """Return the response of a damped resonance, one at its centre f0 (narrow-band).

    It rings as ``exp(-π·f0·t/Q)``.

    Parameters
    ----------
    frequency : ndarray (frequency,)
        Tones, Hz.
    centre : ndarray (..., 1)
        Centres f0, Hz.
    quality : float
        Quality Q.

    Returns
    -------
    ndarray (..., frequency) of complex
        Responses.
    """
    return np.asarray(1 / (1 + 2j * quality * (frequency - centre) / centre))


def random_response(
    rng: np.random.Generator, shape: tuple[int, ...], frequency: FloatArray, bandwidth: float
) -> Complex128Array:
    """Draw smooth complex Gaussian functions of frequency with mean square one.

    They are sums of echoes whose delays are distributed exponentially, so that the correlation
    between tones Δf apart is ``1/(1 + jΔf/bandwidth)``; the coherence, its square, is one half at
    ``bandwidth``.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the echoes.
    shape : tuple of int
        How many functions.
    frequency : ndarray (frequency,)
        Tones, Hz.
    bandwidth : float
        Hz.

    Returns
    -------
    ndarray (*shape, frequency) of complex
        The functions.
    """
    delay = rng.exponential(1 / (2 * np.pi * bandwidth), (*shape, _TAPS, 1))
    size = rng.normal(size=delay.shape) + 1j * rng.normal(size=delay.shape)
    total = np.zeros((*shape, frequency.size), complex)
    for tap in range(_TAPS):
        total += size[..., tap, :] * np.exp(-2j * np.pi * delay[..., tap, :] * frequency)
    return np.asarray(total / math.sqrt(2 * _TAPS))


def slow_change(
    seed: int, name: str, scan: int, shape: tuple[int, ...], knot: int
) -> Complex128Array:
    """Return complex Gaussian numbers of mean square one that change slowly from scan to scan.

    Parameters
    ----------
    seed : int
        Seed of the run.
    name : str
        Name of the random stream.
    scan : int
        Number of the scan.
    shape : tuple of int
        How many numbers.
    knot : int
        Scans in which they turn from one value to the next.
    """
    first, since_knot = divmod(scan, knot)
    ends = []
    for k in (first, first + 1):
        rng = stream(seed, name, k)
        white = rng.normal(size=shape) + 1j * rng.normal(size=shape)
        ends.append(white / math.sqrt(2))
    # Weights on a circle: their squares sum to one, and with them the variance stays.
    angle = since_knot / knot * math.pi / 2
    return np.asarray(math.cos(angle) * ends[0] + math.sin(angle) * ends[1])
