"""How accurate poses must be for the coherent sum over frames, by formula and by reflectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flgpr.clutter import accuracy_needed, coherent_loss_db, measured_coherence
from flgpr.imaging import ImagingOperator
from flgpr.model import Grid, vehicle_to_lane
from flgpr.simulate import Scene, Simulator
from flgpr_papers.fuse2018.lanes import FuseRecipe, band_sensor

ERRORS = (0.0, 0.0015, 0.003, 0.005, 0.01)
_PLACES = ((-6.0, 7.0), (0.0, 9.0), (5.0, 12.0))
_HALF = 0.35
_STEP = 0.025


@dataclass(frozen=True)
class PoseStudy:
    """Loss of the coherent sum at reflectors on the ground."""

    errors: tuple[float, ...]  #: (error,) deviation of the position in each axis, m
    predicted: dict[
        str, NDArray[np.float64]
    ]  #: by band, :func:`flgpr.clutter.coherent_loss_db` for many frames, dB
    measured: NDArray[
        np.float64
    ]  #: (error, draw * place) L band, as many frames as the study sums, dB
    needed: dict[str, float]  #: by band, the accuracy for a loss of 1 dB, m


def pose_study(recipe: FuseRecipe, draws: int) -> PoseStudy:
    """Sum frames of simulated corner reflectors with wrong poses."""
    sensor = band_sensor(recipe, "l")
    count = recipe.image.frames
    scene = Scene.model_validate(
        {
            "name": "reflectors",
            "surface": {"echo": False},
            "objects": [{"kind": "fiducial", "x": x, "y": y, "rcs_db": 0.0} for x, y in _PLACES],
            "track": {"positions": tuple(float(y) for y in range(1 - count, 1))},
        }
    )
    simulator = Simulator(scene, sensor, 1, errors=False)
    vv = sensor.polarization.index("VV")
    data = np.stack([scan[vv : vv + 1] for scan in simulator.scans()])
    patches = [
        Grid.spanning((x - _HALF, x + _HALF), (y - _HALF, y + _HALF), _STEP) for x, y in _PLACES
    ]
    pixels = np.stack([patch.points() for patch in patches])
    tx, rx = sensor.pairs()
    rng = np.random.default_rng(4)
    measured = []
    for error in ERRORS:
        losses = []
        for _ in range(draws if error else 1):
            images = []
            for pose, b in zip(simulator.pose, data, strict=True):
                wrong = pose.copy()
                wrong[:3] += rng.normal(0, error, 3)
                operator = ImagingOperator(
                    sensor.tones.axis(),
                    vehicle_to_lane(tx, wrong),
                    vehicle_to_lane(rx, wrong),
                    pixels,
                    tolerance=1e-2,
                )
                images.append(operator.adjoint(b)[0, 0])
            stack = np.stack(images)
            losses += [
                measured_coherence(stack[:, i], reach=4, most=1).loss_db[0]
                for i in range(len(_PLACES))
            ]
        measured.append(np.resize(losses, draws * len(_PLACES)))
    tones = {band: band_sensor(recipe, band).tones.axis() for band in ("l", "x")}
    return PoseStudy(
        ERRORS,
        {band: coherent_loss_db(ERRORS, axis) for band, axis in tones.items()},
        np.asarray(measured),
        {band: accuracy_needed(axis, 1.0) for band, axis in tones.items()},
    )
