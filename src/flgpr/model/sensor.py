"""Sensors: the antenna array, its tones, polarizations and errors, as TOML presets."""

from __future__ import annotations

import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from flgpr.model.bounds import (
    LARGEST,
    Angle,
    AtLeastOne,
    Decibels,
    Entries,
    Hertz,
    Largest,
    Moderate,
    NotNegative,
    Positive,
    Share,
)
from flgpr.model.constants import POLARIZATIONS
from flgpr.model.faults import load_preset, preset_names
from flgpr.types import FloatArray, IndexArray, floats

_PRESETS = resources.files("flgpr.model") / "presets"
Position = tuple[float, float, float]
Footprint = tuple[float, float, float, float]
MOST_ANTENNAS = 10_000
"""Most antennas on one side of an array."""
LOW_ARRAY = 3.0
"""Height of an array, m, below which it is low.

The echo of the ground below a low array comes so shortly before that of the first ground ahead
that it is not left out unless a sensor says so: the rule is ours.
"""
# Heights of the antennas to which ground counts: as far aside and ahead as that of sri-array.
_GROUND_ASIDE = 1.0
_GROUND_AHEAD = 5.6
_GROUND_BEHIND = 1.0  # of dipoles; behind it stands the vehicle: assumed


class Tones(Entries):
    """Uniform stepped-frequency tones."""

    start: Annotated[float, Field(ge=1e6), Largest(1e12)]  #: first tone, Hz
    step: Hertz  #: spacing, Hz
    count: Annotated[int, Field(ge=1, le=100_000)]

    def axis(self) -> FloatArray:
        """Tones, Hz, shape (count,)."""
        return floats(self.start + self.step * np.arange(self.count))


class Antenna(Entries):
    """Directivity of the antennas."""

    #: a horn has the power pattern cos^n about its axis, a gain that grows as f² (constant
    #: aperture) and receives waves; H and V are the horizontal and vertical directions across each
    #: ray. A dipole is ideal and short, along x for H and along z for V, and records the field at
    #: the receiver over the transmitter's current moment
    kind: Literal["horn", "dipole"] = "horn"
    gain_db: Decibels = 7.8  #: gain of a horn on its axis, dBi
    gain_frequency: Hertz = 1e9  #: frequency of that gain, Hz
    #: n of a horn's cos^n at ``gain_frequency``
    exponent: Annotated[float, Field(ge=0, le=1000)] = 2.0
    #: whether n is the same at all frequencies, or grows as the gain of a constant aperture does,
    #: so that the beam narrows as 1/f
    beam: Literal["constant", "aperture"] = "constant"
    #: level over the axis below which a horn's pattern does not fall, beside and behind it, dB:
    #: assumed, and used for the direct wave and the specular echo alone
    side_db: Decibels = -20.0

    def exponents(self, frequency: FloatArray) -> FloatArray:
        """Return n of a horn's power pattern cos^n at every frequency.

        Its directivity is ``2(n + 1)``: a constant aperture has ``n + 1`` grow as f². Where that
        would make n negative the aperture is too small for any beam: n stays 0, and the gain that
        f² lacks there is mismatch.
        """
        if self.beam == "constant":
            return np.full(np.shape(frequency), self.exponent)
        return np.maximum((self.exponent + 1) * (frequency / self.gain_frequency) ** 2 - 1, 0)


class SystemErrors(Entries):
    """What the radar adds to the echoes; the default of an entry, zero or None, switches it off."""

    #: leakage between an antenna's polarizations, dB, -20 to -25 for quad-ridge horns
    isolation_db: Decibels | None = None
    #: spacing of tones at which the leakage's coherence is one half, Hz; None is a leakage that is
    #: the same at all
    isolation_bandwidth: Annotated[float | None, Field(gt=0), Largest(1e12)] = None
    #: antenna_gain_db, antenna_phase, antenna_delay: rms error of every antenna's H and V port, dB,
    #: rad and s
    antenna_gain_db: Moderate = 0.0
    antenna_phase: NotNegative = 0.0
    antenna_delay: NotNegative = 0.0
    #: slow change of these errors over their fixed part, rms
    antenna_drift: NotNegative = 0.0
    #: imbalance_db, imbalance_phase: rms gain, dB, and phase, rad, of V over H that all
    #: transmitting, and that all receiving antennas share
    imbalance_db: Moderate = 0.0
    imbalance_phase: NotNegative = 0.0
    #: response of an antenna's resonances over its direct one, each at its own frequency, dB
    ringing_db: Decibels | None = None
    #: their quality factor: they ring as ``exp(-π·f·t/Q)``
    ringing_q: Positive = 15.0
    #: their frequencies, Hz; every port's differ from them by 2 % rms
    ringing_frequencies: Annotated[tuple[Positive, ...], Largest(1e12)] = ()
    #: time of a sweep over all tones, s, in which the vehicle drives on; the pose is that of its
    #: middle
    sweep_time: NotNegative = 0.0
    #: level of the self-signature over the clutter in the image, dB
    self_signature_db: Decibels | None = None
    #: its relative change from scan to scan, and that of the direct wave, rms
    self_signature_drift: NotNegative = 0.0
    #: change of the gain from scan to scan, dB rms
    gain_db: Moderate = 0.0
    #: mean clutter over thermal noise in the image at ``noise_range`` within ``noise_band``, dB
    clutter_to_noise_db: Decibels | None = None
    noise_range: Positive = 16.0  #: distance ahead of the array, m
    #: band of that image, Hz
    noise_band: Annotated[tuple[float, float], Largest(1e12)] = (0.75e9, 1.35e9)
    #: number of tones with interference
    interference_tones: Annotated[int, Field(ge=0, le=100_000)] = 0
    #: least and greatest level of the interference over the noise, dB
    interference_db: tuple[Decibels, Decibels] = (10.0, 30.0)
    #: neighbouring tones that each of them disturbs, from its own upwards: the width of a channel
    interference_width: Annotated[int, Field(ge=1, le=100_000)] = 1
    #: scans for which each stands, or is silent, by chance in equal parts; None is all scans
    interference_scans: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    #: fraction of sweeps that pulsed interference hits
    burst_probability: Share = 0.0
    #: least and greatest number of consecutive tones that it hits
    burst_tones: tuple[AtLeastOne, AtLeastOne] = (5, 40)
    #: least and greatest level of it over the noise, dB
    burst_db: tuple[Decibels, Decibels] = (10.0, 30.0)
    #: position, heading, attitude: rms error of the reported position in each axis, m, of the
    #: reported heading, and of pitch and roll, rad
    position: NotNegative = 0.0
    heading: NotNegative = 0.0
    attitude: NotNegative = 0.0
    missing: Annotated[float, Field(ge=0, lt=1)] = 0.0  #: fraction of sweeps that are lost

    @model_validator(mode="after")
    def _check_order(self) -> SystemErrors:
        for name in ("interference_db", "burst_tones", "burst_db"):
            low, high = getattr(self, name)
            if not low <= high:
                raise ValueError(
                    f"{name} must be the least and the greatest value, got {low:g} and {high:g}"
                )
        return self


_GOES_WITH = {
    "isolation_bandwidth": ("isolation_db",),
    "antenna_drift": ("antenna_gain_db", "antenna_phase", "antenna_delay"),
    "ringing_db": ("ringing_frequencies",),
    "ringing_q": ("ringing_db",),
    "ringing_frequencies": ("ringing_db",),
    "noise_range": ("clutter_to_noise_db", "self_signature_db"),
    "noise_band": ("clutter_to_noise_db", "self_signature_db"),
    "interference_tones": ("clutter_to_noise_db",),
    "interference_db": ("interference_tones",),
    "interference_width": ("interference_tones",),
    "interference_scans": ("interference_tones",),
    "burst_probability": ("clutter_to_noise_db",),
    "burst_tones": ("burst_probability",),
    "burst_db": ("burst_probability",),
}
"""Entries of the errors that do nothing unless one of others is on."""


class Sensor(Entries):
    """An antenna array: every transmitter with every receiver, or the pairs of a scanned head."""

    name: str
    source: str  #: where the figures come from
    tones: Tones
    polarization: tuple[str, ...]  #: polarizations in the order of the data
    #: tx, rx: antenna positions in the vehicle frame, m. The vehicle frame's origin is the array's
    #: reference point
    tx: tuple[Position, ...]
    rx: tuple[Position, ...]
    #: height of the reference point over the mean ground, m
    height: Annotated[float, Field(gt=0, le=1000)]
    tilt: Angle = 0.0  #: downward tilt of the antennas' axes, rad
    #: whether one pair is moved over the positions, so that transmitter i goes with receiver i
    #: alone
    scanned: bool = False
    #: ground that the simulator fills with clutter, m, in the scan frame: least and greatest x,
    #: then y; wider than what is imaged. "auto" follows from the array, see ``ground_in_view``
    footprint: Footprint | Literal["auto"] = "auto"
    #: whether the simulator has the echo of the mean surface below the array; "auto" is where the
    #: array is low
    specular_echo: bool | Literal["auto"] = "auto"
    #: whether it has the wave that goes straight from transmitter to receiver; "auto" as there
    direct_wave: bool | Literal["auto"] = "auto"
    antenna: Antenna = Antenna()
    errors: SystemErrors = SystemErrors()  #: what the radar adds to the echoes

    @model_validator(mode="before")
    @classmethod
    def _spread_lines(cls, data: Any) -> Any:
        """Replace an array along a line, {first, last, count}, by all its positions."""
        if not isinstance(data, dict):
            return data
        data = dict(data)
        for side in ("tx", "rx"):
            line = data.get(side)
            if isinstance(line, dict):
                data[side] = _positions_on_line(side, line)
        return data

    @model_validator(mode="after")
    def _check(self) -> Sensor:
        labels = set(self.polarization)
        known = labels <= set(POLARIZATIONS)
        if not known or not labels or len(labels) != len(self.polarization):
            raise ValueError(
                f"polarization must be different ones of {POLARIZATIONS}, got {self.polarization}"
            )
        if not self.tx or not self.rx:
            raise ValueError("tx and rx must each hold at least one antenna")
        if self.scanned and len(self.tx) != len(self.rx):
            raise ValueError(
                "a scanned pair needs as many tx as rx positions, "
                f"got {len(self.tx)} and {len(self.rx)}"
            )
        x_min, x_max, y_min, y_max = self.ground_in_view
        if not (x_max > x_min and y_max > y_min):
            raise ValueError(
                f"footprint must have x_max > x_min and y_max > y_min, got {self.footprint}"
            )
        return self

    @property
    def is_low(self) -> bool:
        """Whether the array is lower than ``LOW_ARRAY``."""
        return self.height < LOW_ARRAY

    @property
    def has_specular_echo(self) -> bool:
        """Whether the ground below the array mirrors its transmitters."""
        return self.is_low if self.specular_echo == "auto" else self.specular_echo

    @property
    def has_direct_wave(self) -> bool:
        """Whether waves go straight from transmitters to receivers."""
        return self.is_low if self.direct_wave == "auto" else self.direct_wave

    def idle_errors(self) -> list[str]:
        """Return a line on each entry of ``errors`` that does nothing without another one."""
        default = SystemErrors()
        partners = dict(_GOES_WITH)
        if not self.has_direct_wave:  # which drifts, too
            partners["self_signature_drift"] = ("self_signature_db",)
        is_on = {
            name: getattr(self.errors, name) != getattr(default, name) for name in vars(default)
        }
        lines = []
        for name, others in partners.items():
            if is_on[name] and not any(is_on[other] for other in others):
                value = getattr(self.errors, name)
                lines.append(f"errors.{name} = {value} does nothing without {' or '.join(others)}")
        return lines

    @property
    def ground_in_view(self) -> Footprint:
        """Ground that scatters, m: least and greatest x, then y, in the scan frame.

        Where ``footprint`` is "auto" it reaches a height of the antennas beyond the outermost ones
        to either side and 5.6 heights ahead. It begins where the pattern of horns does, below them
        or, tilted, a little behind; that of dipoles a height behind the array.
        """
        if self.footprint != "auto":
            return self.footprint
        places = np.array([*self.tx, *self.rx], dtype=float)
        height = self.height + float(places[:, 2].mean())
        behind = _GROUND_BEHIND
        if self.antenna.kind == "horn":
            # cos^n ends at right angles to the axis; a horn that looks down has all ground below.
            behind = math.tan(min(max(self.tilt, 0.0), math.pi / 4))
        aside = float(np.abs(places[:, 0]).max()) + _GROUND_ASIDE * height
        ahead = float(places[:, 1].max()) + _GROUND_AHEAD * height
        return (-aside, aside, float(places[:, 1].min()) - behind * height, ahead)

    def pairs(self) -> tuple[FloatArray, FloatArray]:
        """Return the positions (pair, 3), m, of every pair's transmitter and receiver.

        They are in the vehicle frame; the pairs of a transmitter follow one another.
        """
        tx = np.asarray(self.tx, dtype=float)
        rx = np.asarray(self.rx, dtype=float)
        first, second = self.pair_indices()
        return tx[first], rx[second]

    def pair_indices(self) -> tuple[IndexArray, IndexArray]:
        """Return the indices (pair,) of transmitters in ``tx`` and receivers in ``rx``."""
        transmitters = np.arange(len(self.tx))
        receivers = np.arange(len(self.rx))
        if self.scanned:
            return transmitters, receivers
        return np.repeat(transmitters, len(receivers)), np.tile(receivers, len(transmitters))


def _positions_on_line(side: str, line: dict[str, Any]) -> list[tuple[float, ...]]:
    """Return the positions of an array written as {first, last, count}."""
    try:
        ends = np.asarray([line["first"], line["last"]], dtype=float)
        count = int(line["count"])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError(
            f"{side} must be a list of positions or hold first, last and count"
        ) from None
    if not 0 <= count <= MOST_ANTENNAS or not (np.abs(ends) <= LARGEST).all():
        raise ValueError(f"{side} must hold finite places, count up to {MOST_ANTENNAS}, got {line}")
    return [tuple(position) for position in np.linspace(ends[0], ends[1], count).tolist()]


def sensor_presets() -> list[str]:
    """Return the names of the packaged sensors."""
    return preset_names(_PRESETS)


def load_sensor(name: str | Path) -> Sensor:
    """Load a sensor from a preset's name or a TOML file.

    An entry that breaks a rule is a ValueError that names it.

    Examples
    --------
    >>> from flgpr.model import load_sensor, sensor_presets
    >>> sensor_presets()
    ['dual-band-l', 'dual-band-x', 'full-wave', 'full-wave-echo', 'sri-array', 'sri-van']
    >>> sensor = load_sensor("sri-array")
    >>> tx, rx = sensor.pairs()
    >>> tones = sensor.tones.axis()
    >>> print(f"{len(tx)} pairs, {tones[0] / 1e9:.4f} to {tones[-1] / 1e9:.4f} GHz")
    36 pairs, 0.4425 to 3.0000 GHz
    """
    return load_preset(Sensor, "sensor", name, _PRESETS)
