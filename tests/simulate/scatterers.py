"""Scatterers at random places, and their slow sum."""

import numpy as np

from flgpr.simulate.simulator import array_state
from reference import slow_simulation

POSE = np.array(
    [0.3, 1.0, 5.0, 0.0, 0.0, 0.0]
)  # level: the slow twin's dipoles stand along x and z


def cloud(count, seed=0):
    rng = np.random.default_rng(seed)
    points = np.column_stack(
        [rng.uniform(-6, 6, count), rng.uniform(7, 26, count), rng.uniform(0, 0.5, count)]
    )
    return points, rng.normal(size=(count, 2, 3)) + 1j * rng.normal(size=(count, 2, 3))


def slow(sensor, points, spectrum, frequency):
    state = array_state(sensor, POSE)
    tx = state.position[state.tx]
    rx = state.position[state.rx]
    if sensor.antenna.kind == "dipole":
        return slow_simulation.sum_dipoles(points, spectrum, frequency, tx, rx)
    return slow_simulation.sum_points(
        points, spectrum, frequency, tx, rx, state.boresight, sensor.antenna.exponent
    )
