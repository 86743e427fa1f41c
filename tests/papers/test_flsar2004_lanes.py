"""Settings, lanes and lane images of flsar2004."""

import numpy as np
import pytest

from flgpr.model import Grid, load_sensor
from flgpr.simulate.simulator import Simulator
from flgpr_papers.flsar2004.lanes import Mines, _scene, lane_images, load_settings

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture(scope="module")
def settings():
    return load_settings()


def test_settings_are_the_papers(settings):
    metal, plastic = (
        sum(getattr(m, kind) for m in settings.mines) for kind in ("metal", "plastic")
    )
    shallow = sum(m.metal + m.plastic for m in settings.mines if m.depth <= 0.05)
    assert (metal, plastic) == (60, 30)
    assert shallow / 90 == pytest.approx(0.7, abs=0.02)
    assert settings.ranges == (10.0, 15.0, 20.0)
    assert load_settings(quick=True).length < settings.length / 2


def test_lane_images_show_a_mine_where_it_is():
    settings = load_settings().model_copy(
        update={"mines": (Mines(depth=-0.15, metal=1, plastic=0),), "pitch": 8.0}
    )
    sensor = load_sensor("sri-van")
    tones = sensor.tones.model_copy(update={"start": 5e8, "step": 1e7, "count": 81})
    sensor = sensor.model_copy(update={"tones": tones, "footprint": (-3.0, 3.0, 6.5, 24.5)})
    scene = _scene(settings, "arid")
    quiet = scene.surface.model_copy(update={"echo": False, "phase_screen": False})
    none = scene.clutter.model_copy(update={"rocks": 0, "bushes": 0, "posts": 0, "patches": 0})
    scene = scene.model_copy(update={"surface": quiet, "clutter": none, "objects": ()})
    simulator = Simulator(scene, sensor, 0, errors=False)
    grid = Grid(-2.0, -1.0, 51, 251, 0.08, 0.04)
    image = np.abs(
        lane_images(settings, simulator, sensor, grid, range(len(simulator.reported_pose())))
    )
    mine = simulator.truth.iloc[0]
    for p, r in np.ndindex(2, 3):
        row, column = np.unravel_index(image[p, r].argmax(), grid.shape)
        assert grid.x[column] == pytest.approx(mine["x"], abs=0.3)
        assert grid.y[row] == pytest.approx(mine["y"], abs=0.5)
