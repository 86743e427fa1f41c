"""Twins of the full-wave lane, evidence/full_wave_twins.py."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "evidence"))
import full_wave_twins as lanes

pytestmark = pytest.mark.slow("of a script, whose numbers stand on a page")


def test_a_twin_has_the_targets_of_the_lane_and_another_surface():
    real = lanes.full_wave()
    scene = lanes.twin_scene((0.009, 0.10))
    assert scene.surface.rms_height == 0.009
    places = [(target.x, target.y) for target in scene.targets]
    np.testing.assert_allclose(places, real.targets[["x", "y"]])
    assert not lanes.twin_scene((0.009, 0.10), targets=False).targets
