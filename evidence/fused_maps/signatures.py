"""Simulated bodies alone in the ground, each seen in ten looks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flgpr.imaging import ScanImager
from flgpr.model import SPEED_OF_LIGHT, Grid, lane_to_scan, load_sensor
from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr_ground.oracle import STEP
from fused_maps.lanes import BANDS, HEIGHT, METRES, MIDDLES, NEAREST, Lane

SOILS = ((2.7, 0.01), (4.0, 0.02), (6.0, 0.05), (9.0, 0.1), (14.0, 0.15))
BODIES = {
    "metal": {"kind": "metal"},
    "tm-62p": {"kind": "plastic", "body": "tm-62p"},
    "vs-1.6": {"kind": "plastic", "body": "vs-1.6"},
    "m19": {"kind": "plastic", "body": "m19"},
    "plastic-at": {"kind": "plastic", "body": "plastic-at"},
    "plastic-at-cavity": {"kind": "plastic", "body": "plastic-at-cavity"},
    "pmn": {"kind": "ap", "body": "pmn"},
}
# VS-2.2 and PMA-1 lie in no training lane and are in no class.
CLASSES = {
    "metal": ("metal",),
    "fuzed": ("tm-62p",),
    "air": ("vs-1.6", "m19", "plastic-at", "plastic-at-cavity"),
    "ap": ("pmn",),
}
DEPTHS = {"metal": (-0.15, 0.0, 0.03, 0.06, 0.1, 0.15), "pmn": (0.005, 0.01, 0.02, 0.04)}
OTHER_DEPTHS = (0.0, 0.03, 0.06, 0.09, 0.12)
COPIES = 2
LOOKS = 7.4 + 0.95 * np.arange(10)  # m ahead of a simulated body


@dataclass
class Signatures:
    """Bodies alone in the ground, each seen in ten looks at one place, the phases right."""

    chip: np.ndarray  # (body, look, polarization, sub-band, pixel)
    place: np.ndarray  # (body, look, 2) of the chip's middle in the scan frame, m
    depth: np.ndarray  # (body,)
    soil: np.ndarray  # (body,) number
    beside: np.ndarray  # (body, 2) of the chip's middle from the body, m

    def in_units(self, lane: Lane) -> np.ndarray:
        """Return the chips in units of a lane's background."""
        column = np.round((self.place[..., 0] + 6.0) / 0.05).astype(int)
        row = np.round((self.place[..., 1] - NEAREST) / 0.05).astype(int)
        row = np.clip(row, 0, lane.gain.shape[2] - 1)
        return self.chip / np.moveaxis(lane.gain[:, :, row, column], (0, 1), (2, 3))[..., None]

    def by_metre(self, chips: np.ndarray) -> np.ndarray:
        """Return of chips (body, look, ...) those nearest to the middle of each metre ahead."""
        middles = np.arange(METRES) + NEAREST + 0.5
        nearest = np.abs(self.place[:, None, :, 1] - middles[:, None]).argmin(axis=-1)
        return chips[np.arange(len(chips))[:, None], nearest]

    def moved(self, chips: np.ndarray, ahead: float, bands: Sequence[int]) -> np.ndarray:
        """Return chips (body, look, polarization, sub-band, pixel) as at a place ahead of the body.

        A sub-band's range cell is several times longer than the move: only its phase changes.
        """
        x, y = self.place[..., 0], self.place[..., 1]
        sine = y / np.sqrt(x**2 + y**2 + HEIGHT**2)
        move = (ahead - self.beside[:, None, 1]) * sine
        return chips * phases_of(move, bands)


def phases_of(metres: np.ndarray, bands: Sequence[int]) -> np.ndarray:
    """Return the factors (..., 1, sub-band, 1) of a move along the line of sight, m."""
    angle = 4 * np.pi * MIDDLES[list(bands)] / SPEED_OF_LIGHT * metres[..., None]
    return np.exp(1j * angle)[..., None, :, None]


def simulate_signatures(name: str, out: Path) -> Signatures:
    """Return the signatures of a body in all soils, from the folder if they are there."""
    file = out / "signatures" / f"{name}.npz"
    if not file.is_file():
        file.parent.mkdir(parents=True, exist_ok=True)
        parts = [_in_soil(name, number) for number in range(len(SOILS))]
        joined = [np.concatenate(values) for values in zip(*parts, strict=True)]
        np.savez(
            file, **dict(zip(("chip", "place", "depth", "soil", "beside"), joined, strict=True))
        )
    with np.load(file) as data:
        return Signatures(**data)


def _in_soil(name: str, soil: int) -> tuple[np.ndarray, ...]:
    """Simulate a body in one soil at all depths, every copy alone."""
    rng = np.random.default_rng([31, soil, len(name)])
    depths = np.repeat(DEPTHS.get(name, OTHER_DEPTHS), COPIES)
    count = len(depths)
    apart = 100.0
    x = rng.uniform(-1.4, 1.4, count)
    y = apart * np.arange(count) + 30.0
    lean = rng.normal(0, math.radians(4), (count, 2))
    beside = rng.uniform(-STEP / 2, STEP / 2, (count, 2))
    scans = (y[:, None] - LOOKS - rng.uniform(-0.3, 0.3, (count, len(LOOKS)))).ravel()
    heading = rng.uniform(0, 2 * math.pi, count)
    order = np.argsort(scans)
    targets = []
    for number in range(count):
        target = BODIES[name] | {"x": x[number], "y": y[number], "depth": depths[number]}
        target["tilt"] = math.hypot(*lean[number])
        target["azimuth"] = math.atan2(lean[number, 1], lean[number, 0])
        if name == "m19":
            target["heading"] = heading[number]
        targets.append(target)
    permittivity, loss = SOILS[soil]
    scene = {
        "soil": {"model": "fixed", "permittivity": permittivity, "loss_tangent": loss},
        "length": apart * count, "x_min": -1.5, "x_max": 1.5, "clutter": BARE,
        "track": {"positions": scans[order].tolist()}, "targets": targets, **ALONE,
    }  # fmt: skip
    sensor = load_sensor("sri-array")
    exact = dict.fromkeys(("missing", "position", "heading", "attitude"), 0.0)
    sensor = sensor.model_copy(update={"errors": sensor.errors.model_copy(update=exact)})
    simulator = Simulator(Scene.model_validate(scene), sensor, soil)
    imager = ScanImager(
        simulator.run(bodies=True), Grid.spanning((-6, 6), (7, 26), 0.05), BANDS, "hann", 1e-3
    )
    about = STEP * np.mgrid[-1:2, -1:2].reshape(2, -1)
    pixels = np.column_stack([about[1], about[0], np.zeros(9)])
    chips = np.zeros((len(scans), 3, len(BANDS), 9), np.complex64)
    places = np.zeros((len(scans), 2))
    for scan, number in enumerate(order):
        body = number // len(LOOKS)
        middle = np.array([x[body] + beside[body, 0], y[body] + beside[body, 1], 0.0])
        place = lane_to_scan(middle, simulator.pose[scan])
        operator = imager.operator_on(scan, place + pixels, imager.subbands)
        chips[number] = operator.adjoint(imager.signal(scan))
        places[number] = place[:2]
    shape = (count, len(LOOKS))
    return (
        chips.reshape(*shape, 3, len(BANDS), 9), places.reshape(*shape, 2), depths,
        np.full(count, soil), beside,
    )  # fmt: skip
