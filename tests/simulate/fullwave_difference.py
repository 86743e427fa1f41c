"""Echoes of buried bodies: full wave (archives made by difference) against the simulator, image against image.

Levels are absolute: both are fields over the transmitter's current moment, and no common factor is taken out.
"""

import itertools
import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flgpr.imaging import ImagingOperator
from flgpr.model import Sensor
from flgpr.simulate import Scene, Simulator

ARCHIVES = Path(__file__).parent.parent / "data" / "signatures"
KINDS = {"metal": "metal", "gap": "plastic", "solid": "simulant"}
# m about the body's centre, on the flat ground
X = np.arange(-0.4, 0.41, 0.02)
Y = np.arange(-0.9, 1.51, 0.01)
BANDS = ("whole", "low", "middle", "high")


class Case(NamedTuple):
    """One body in one soil: its echo (polarization, pair, frequency) and all that is needed to compute it again."""

    name: str
    signal: np.ndarray
    frequency: np.ndarray
    polarization: tuple
    tx: np.ndarray
    rx: np.ndarray
    about: dict

    @property
    def body(self):
        return self.about["body"]

    @property
    def soil(self):
        return self.about["soil"]


def names():
    return sorted(path.stem for path in ARCHIVES.glob("*.npz"))


def load(name):
    with np.load(ARCHIVES / f"{name}.npz", allow_pickle=False) as file:
        return Case(
            name,
            file["signal_ohm_per_m2"],
            file["frequency_hz"],
            tuple(file["polarization"].tolist()),
            file["tx_position_m"],
            file["rx_position_m"],
            json.loads(str(file["about"])),
        )


def scene(case):
    """The case's soil, without any echo or disturbance of its surface, and its one body."""
    x, y, z = case.body["position_m"]
    target = {
        "kind": KINDS[case.body["name"]],
        "x": x,
        "y": y,
        "depth": -z,
        "radius": case.body["radius_m"],
    }
    return Scene(
        name=case.name,
        length=y + 2.0,
        soil={
            "model": "fixed",
            "permittivity": case.soil["permittivity"],
            "conductivity": case.soil["conductivity_s_per_m"],
        },
        surface={"echo": False, "phase_screen": False},
        track={"positions": (0.0,)},
        targets=(target | {"height": case.body["height_m"]},),
    )


def sensor(case):
    """The case's ideal dipoles, about the transmitter."""
    tones = {
        "start": case.frequency[0],
        "step": np.diff(case.frequency).mean(),
        "count": case.frequency.size,
    }
    return Sensor(
        name="dipoles",
        source="full-wave archive",
        tones=tones,
        polarization=case.polarization,
        tx=[tuple(case.tx[0] - case.tx[0])],
        rx=[tuple(place - case.tx[0]) for place in case.rx],
        height=case.tx[0, 2],
        antenna={"kind": "dipole"},
        direct_wave=False,  # which the difference does not have
    )


def simulated(case):
    """The simulator's echo of the same body, in the shape of the case's signal."""
    return Simulator(scene(case), sensor(case), seed=1, errors=False).scan(0)


def bands(frequency):
    """The whole band and its thirds, Hz."""
    edges = frequency[np.linspace(0, frequency.size - 1, 4).round().astype(int)]
    return [(edges[0], edges[-1]), *itertools.pairwise(edges)]


def images(case, signal):
    """Magnitude (polarization, band, y, x) of images focused on the flat ground about the body."""
    centre = np.array([*case.body["position_m"][:2], 0.0])
    pixels = np.stack([*np.meshgrid(X, Y), np.zeros((Y.size, X.size))], axis=-1) + centre
    operator = ImagingOperator(
        case.frequency,
        case.tx,
        case.rx,
        pixels,
        bands(case.frequency),
        tolerance=1e-4,
        window="hann",
    )
    return np.abs(operator.adjoint(signal))


def peaks(image):
    """Level (polarization, band), dB, of the peak of images, and its ground range behind the body's centre, m."""
    flat = image.reshape(*image.shape[:2], -1)
    return 20 * np.log10(flat.max(axis=-1)), Y[flat.argmax(axis=-1) // image.shape[-1]]


class Comparison(NamedTuple):
    """Of HH and VV (rows) in the whole band and its thirds (columns).

    ``level`` is full wave over simulated (dB) of the image's peak, ``power`` of the rms over band and pairs, ``apart``
    the peak's ground range, full wave less simulated (m), ``coherence`` that of the two over band and pairs. ``there``
    is the simulated image within 5 cm of the full wave's peak over its own peak (dB): near 0 where two flashes are so
    alike that the peak may be either.
    """

    full_level: np.ndarray
    full_place: np.ndarray
    level: np.ndarray
    apart: np.ndarray
    power: np.ndarray
    coherence: np.ndarray
    there: np.ndarray

    @property
    def full_ratio(self):
        """VV over HH of the full wave, dB (band)."""
        return self.full_level[1] - self.full_level[0]

    @property
    def ratio(self):
        """VV over HH, full wave less simulated, dB (band)."""
        return self.level[1] - self.level[0]


def compare(case, signal):
    """Compare a case with a signal (polarization, pair, frequency) that should be the same."""
    rows = [case.polarization.index(label) for label in ("HH", "VV")]
    full = case.signal[rows]
    other = np.asarray(signal)[rows]
    image = images(case, other)
    (level, place), (other_level, other_place) = peaks(images(case, full)), peaks(image)
    near = np.abs(Y[:, None] - place[..., None, None]) < 0.051  # (polarization, band, y, 1)
    there = 20 * np.log10((image * near).max(axis=(2, 3))) - other_level
    power = np.zeros_like(level)
    coherence = np.zeros_like(level)
    for k, (low, high) in enumerate(bands(case.frequency)):
        within = (case.frequency >= low) & (case.frequency <= high)
        a = full[..., within].reshape(2, -1)
        b = other[..., within].reshape(2, -1)
        norms = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
        power[:, k] = 20 * np.log10(norms[0] / norms[1])
        coherence[:, k] = np.abs((a * b.conj()).sum(axis=1)) / (norms[0] * norms[1])
    return Comparison(
        level, place, level - other_level, place - other_place, power, coherence, there
    )


def misses(name, comparison, level=2.0, place=0.05):
    """What is off by more than ``level`` (dB) or ``place`` (m): value by (name, quantity, polarization, band)."""
    table = {"level": comparison.level, "apart": comparison.apart}
    found = {
        (name, quantity, row, band): value
        for quantity, values in table.items()
        for row, line in zip(("HH", "VV"), values.tolist(), strict=True)
        for band, value in zip(BANDS, line, strict=True)
        if abs(value) > (level if quantity == "level" else place + 1e-3)
    }
    ratios = zip(BANDS, comparison.ratio.tolist(), strict=True)
    return found | {
        (name, "ratio", "VV/HH", band): value for band, value in ratios if abs(value) > level
    }
