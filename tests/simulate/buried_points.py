"""Points in the soil that tests of buried clutter look at, and what a radar sees of them."""

import numpy as np

from flgpr.simulate import Scene
from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.ground.buried_spectra import BuriedSpectra, incidence_laws
from flgpr.simulate.ground.layers import ScanView
from flgpr.simulate.ground.subsurface import Buried, SubsurfaceLayer
from flgpr.simulate.simulator import array_state

DRY = {"model": "fixed", "permittivity": 3.4, "conductivity": 0.0}
MOIST = {"model": "mironov", "clay": 20.0, "moisture": 0.12}
POSE = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])


class Given:
    """A field that holds the given points."""

    def __init__(self, points):
        self.points = points

    def within(self, corners):
        return self.points


def given(xy, depth, size=1.0, axial=0.0, axis=(0.0, 0.0, 1.0), shape=0, reach=0.0):
    count = len(xy)
    return Buried(
        np.array(xy, dtype=float),
        np.full(count, depth, dtype=float),
        np.full(count, size, np.complex64),
        np.full(count, axial, np.complex64),
        np.tile(np.array(axis, dtype=float), (count, 1)),
        np.full(count, shape),
        np.full(count, reach, dtype=float),
    )


def ground_of(soil, sensor):
    return LayeredGround(Scene(soil=soil).soil, None, sensor.tones.axis())


def flat_layer(points, soil, sensor, scene=None):
    """Give the layer that holds the points with spectra that do not grow, and the soil."""
    ground = ground_of(soil, sensor)
    spectra = BuriedSpectra(ground, np.ones((60, ground.frequency.size)), 0.5)
    return SubsurfaceLayer(
        Given(points), spectra, incidence_laws(scene or Scene(soil=soil), ground)
    ), ground


def view_of(sensor):
    return ScanView(sensor.footprint, POSE, array_state(sensor, POSE))


def spectra_of(echoes):
    """Spectra (point, 3, frequency) of all points."""
    return np.einsum("irc,rcf->icf", echoes.coefficient, echoes.basis)


def sine_at(xy):
    return np.hypot(*np.transpose(xy)) / np.sqrt(np.hypot(*np.transpose(xy)) ** 2 + POSE[2] ** 2)
