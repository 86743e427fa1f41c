"""Examples the figures of the study show: one image, signatures without clutter, the point response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.design.array import half_power
from flgpr.imaging import ImagingOperator, ScanImager
from flgpr.kernels.windows import ramp
from flgpr.model import SPEED_OF_LIGHT, Grid, Sensor, make_run
from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr_papers.cosgrove2004.images import BAND, study_sensor, tone_weight
from flgpr_papers.cosgrove2004.recipe import StudyRecipe

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class PointResponse:
    """Image of a point on the ground at the study's range."""

    #: down, cross: (n,) distance from the point down-track and cross-track, m
    down: FloatArray
    cross: FloatArray
    #: down_level, cross_level: (n,) magnitude along them over the peak
    down_level: FloatArray
    cross_level: FloatArray

    @property
    def resolution(self) -> tuple[float, float]:
        """Width between the half-power points down-track and cross-track, m."""
        return half_power(self.down, self.down_level), half_power(self.cross, self.cross_level)


def point_response(recipe: StudyRecipe, filtered: bool) -> PointResponse:
    """Image an ideal point: flat spectrum, no pattern, no spreading."""
    sensor = study_sensor(recipe)
    frequency = sensor.tones.axis()
    tx, rx = (p + [0.0, 0.0, sensor.height] for p in sensor.pairs())
    point = np.array([0.0, recipe.radar.range, 0.0])
    path = np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1)
    data = np.exp(-2j * np.pi * np.outer(path, frequency) / SPEED_OF_LIGHT)[None]
    away = np.linspace(-1, 1, 801)
    lines = np.zeros((2, away.size, 3)) + point
    lines[0, :, 1] += away
    lines[1, :, 0] += away
    window = ramp(frequency) if filtered else None
    image = np.abs(ImagingOperator(frequency, tx, rx, lines, window=window).adjoint(data)[0, 0]).astype(np.float64)
    return PointResponse(away, away, image[0] / image[0].max(), image[1] / image[1].max())


def signature_cuts(recipe: StudyRecipe) -> tuple[FloatArray, NDArray[np.complex64]]:
    """Range cut through one mine in dry sand without clutter and errors, as the paper's Fig. 3.

    Gives the distance behind the mine's centre (m) and the image along the cut of each polarization.
    """
    ahead = recipe.radar.range
    scene = Scene.model_validate(
        {
            "site": recipe.sites["sand"].scene,
            "length": 2 * ahead,
            "targets": [{"kind": "metal", "x": 0.0, "y": ahead, "depth": 0.1}],
            "clutter": BARE,
            "track": {"positions": [0.0]},
            **ALONE,
            "surface": {"echo": False, "phase_screen": False},
        }
    )
    sensor = study_sensor(recipe)
    grid = Grid(0.0, ahead - 1.0, 1, 101, 0.05, 0.02)
    image = _image(recipe, sensor, scene, 1, grid, errors=False)
    return image["y"].values - ahead, image.values[:, :, 0]


def wide_image(recipe: StudyRecipe, seed: int) -> xr.DataArray:
    """Image (polarization, y, x) of three mines 15, 20 and 25 m ahead in dry sand, as the paper's Fig. 2."""
    scene = Scene.model_validate(
        {
            "site": recipe.sites["sand"].scene,
            "x_min": -2.0,
            "x_max": 2.0,
            "length": 40.0,
            "targets": [
                {"kind": "metal", "x": x, "y": y, "depth": 0.05} for x, y in ((-0.6, 15), (0.5, 20), (0.0, 25))
            ],
            "surface": {"density": recipe.radar.scatterers},
            "clutter": {"bushes": 0.0, "posts": 0.0},
            "track": {"positions": [0.0]},
        }
    )
    sensor = study_sensor(recipe).model_copy(update={"footprint": (-4.5, 4.5, 10.0, 29.0)})
    return _image(recipe, sensor, scene, seed, Grid(-4.0, 11.0, 161, 851, 0.05, 0.02), errors=True)


def _image(recipe: StudyRecipe, sensor: Sensor, scene: Scene, seed: int, grid: Grid, errors: bool) -> xr.DataArray:
    quiet = sensor.errors.model_copy(update={"self_signature_db": None})
    simulator = Simulator(scene, sensor.model_copy(update={"errors": quiet}), seed, errors)
    tx, rx = sensor.pairs()
    signal = simulator.scan(0)[None]
    run = make_run(signal, simulator.frequency, list(sensor.polarization), tx, rx, simulator.reported_pose())
    imager = ScanImager(run, grid, {BAND: recipe.image.band}, window=tone_weight(recipe, sensor))
    return imager.image(0).isel(subband=0, drop=True)
