"""Images of a scan and their adjoint, and model-based suppression."""

from __future__ import annotations

import numpy as np

from flgpr.clutter import (
    Thresholds,
    averaged,
    iterate_suppression,
    mixed_mask,
    subregions,
    suppress_by_model,
)
from flgpr.imaging import ImagingOperator
from flgpr.model import Grid, load_sensor

from .data import complex_noise, size


class Imaging:
    """A scan of the ``sri-array`` on 91,200 pixels: 36 pairs, 1024 tones, three polarizations.

    ``python benchmarks/imaging_speed --peers`` sets the same work beside other codes and the machine's limits.
    """

    def setup(self) -> None:
        sensor = load_sensor("sri-array")
        height = np.array([0.0, 0.0, sensor.height])
        tx, rx = (np.asarray(position) + height for position in sensor.pairs())
        tones = sensor.tones.axis()
        pixels = Grid(-6.0, 7.0, size(240, 24), size(380, 38), 0.05, 0.05).points().reshape(-1, 3)
        rng = np.random.default_rng(0)
        self.data = complex_noise(rng, (3, len(tx), tones.size)).astype(np.complex64)
        self.image = complex_noise(rng, (3, 1, len(pixels))).astype(np.complex64)
        self.operator = ImagingOperator(tones, tx, rx, pixels, tolerance=1e-3)
        self.operator.adjoint(self.data)  # compiles
        self.operator.forward(self.image)

    def time_adjoint(self) -> None:
        self.operator.adjoint(self.data)

    def time_forward(self) -> None:
        self.operator.forward(self.image)

    def peakmem_adjoint(self) -> None:
        self.operator.adjoint(self.data)


class Suppression:
    """One L-band frame of ``dual-band-l``: 64 pairs, 500 tones, four polarizations, 120,000 pixels.

    Timed is all that is done once the masks' thresholds are known: images of the four
    polarizations, the mask, seven iterations of Eq. 5 to 8 of Fuse et al. 2018 (or as many of
    least squares), and the images of what is left.
    """

    params = ("iteration", "least squares")
    param_names = ("form",)

    def setup(self, form: str) -> None:
        rng = np.random.default_rng(5)
        sensor = load_sensor("dual-band-l")
        self.tx, self.rx = (side + [0, 0, sensor.height] for side in sensor.pairs())
        self.frequency = 750e6 + 4.9e6 * np.arange(size(500, 100))
        grid = Grid(-10.0, 5.0, size(400, 100), size(300, 75), size(1, 4) * 0.05, size(1, 4) * 0.05)
        self.pixels = grid.points()
        self.region = subregions(self.pixels[..., 1], (5, 8.75, 12.5, 16.25, 20))
        scatterers = rng.uniform((-10, 5, 0), (10, 20, 0.5), (400, 3))
        phase = np.exp(2j * np.pi * rng.random((4, 1, 400)))
        strength = rng.exponential(size=(4, 1, 400)) * phase
        self.data = self.operator_on(scatterers).forward(strength)
        image = self.operator_on(self.pixels).adjoint(self.data)[:, 0]
        vv = np.abs(image[3])
        vh = np.abs(image[2])
        levels = [np.quantile(vv, 0.85), np.quantile(vh, 0.85), np.quantile(vh, 0.95)]
        self.thresholds = Thresholds(*(np.full(4, level) for level in levels))
        self.time_suppression(form)  # compiles

    def operator_on(self, points: np.ndarray) -> ImagingOperator:
        """Return the operator between the frame's data and points (..., 3)."""
        return ImagingOperator(self.frequency, self.tx, self.rx, points, tolerance=1e-3)

    def time_suppression(self, form: str) -> None:
        operator = self.operator_on(self.pixels)
        image = operator.adjoint(self.data)[:, 0]
        across = self.pixels[..., 0]
        mask = mixed_mask(image[3], image[2], self.thresholds, self.region, across)
        if form == "iteration":
            course = iterate_suppression(
                self.data, self.operator_on, self.pixels, mask, self.region, 7
            )
            cleaned = averaged(course, 6)
        else:
            masked = self.operator_on(self.pixels[mask])
            cleaned = suppress_by_model(self.data, masked, 7).data
        operator.adjoint(cleaned)
