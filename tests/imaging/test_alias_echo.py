"""A simulated echo from under the vehicle appears in an image where the steps of the tones say, and only then."""

import numpy as np
import pytest

from aliases import alias_paths
from flgpr.imaging import ImagingOperator
from flgpr.model import Grid, Sensor, load_sensor, unambiguous_path
from flgpr.simulate import Scene, Simulator

HEIGHT = 3.5
# m: a corner reflector under the van
AHEAD = 0.6
UP = 0.3
GRID = Grid.spanning((-0.5, 0.5), (10.0, 24.0), 0.04)


def image_of(step, count):
    """Magnitude (y, x) of the image of nothing but the reflector, seen by nine places of the van's pair."""
    places = [(x, 0.0, 0.0) for x in np.linspace(-0.2, 0.2, 9)]
    parts = {
        "tx": places,
        "rx": places,
        "polarization": ["HH"],
        "tones": {"start": 300e6, "step": step, "count": count},
    }
    sensor = Sensor.model_validate(load_sensor("sri-van").model_dump() | parts)
    scene = Scene.model_validate(
        {
            "length": 40.0,
            "surface": {"echo": False, "phase_screen": False},
            "clutter": {"rocks": 0, "bushes": 0, "posts": 0, "patches": 0},
            "objects": [{"kind": "fiducial", "x": 0.0, "y": AHEAD, "height": UP, "rcs_db": 0.0}],
            "track": {"positions": [0.0]},
        }
    )
    simulator = Simulator(scene, sensor, 1, errors=False)
    tx, rx = (side + [0.0, 0.0, HEIGHT] for side in sensor.pairs())
    operator = ImagingOperator(simulator.frequency, tx, rx, GRID.points(), window="hann")
    return np.abs(operator.adjoint(simulator.scan(0))[0, 0]), unambiguous_path(simulator.frequency)


@pytest.fixture(scope="module")
def coarse():
    return image_of(8e6, 169)


def test_the_alias_lies_exactly_where_the_steps_say(coarse):
    image, unambiguous = coarse
    path = 2 * np.hypot(AHEAD, HEIGHT - UP)
    (alias,) = alias_paths(
        path, unambiguous, 2 * np.hypot(GRID.y[0], HEIGHT), 2 * np.hypot(GRID.y[-1], HEIGHT)
    )
    expected = np.sqrt((alias / 2) ** 2 - HEIGHT**2)
    row, _ = np.unravel_index(image.argmax(), image.shape)
    assert GRID.y[row] == pytest.approx(expected, abs=0.05)
    assert image.max() > 30 * np.median(image)


def test_finer_steps_over_the_same_band_keep_it_out(coarse):
    image, unambiguous = image_of(6e6, 225)
    assert 2 * np.hypot(AHEAD, HEIGHT - UP) + unambiguous > 2 * np.hypot(GRID.y[-1], HEIGHT)
    assert image.max() / 225 < 0.01 * coarse[0].max() / 169
