"""The tables of a scene's preview hold the world that the simulation draws."""

import numpy as np
import pytest

from flgpr.simulate import Scene, draw_world
from flgpr.simulate.preview import preview_scene


@pytest.fixture
def scene():
    return Scene(
        site="arid-sand",
        length=12.0,
        draws=[
            {"kind": "metal", "depth": 0.05, "count": 2},
            {"kind": "plastic", "depth": 0.1, "count": 1},
        ],
    )


def test_the_preview_shows_the_world_of_the_simulation(scene):
    preview = preview_scene(scene, 5)
    world = draw_world(scene, 5)
    assert preview.targets["kind"].tolist() == [target.kind for target in world.targets]
    assert preview.targets["x"].tolist() == [target.x for target in world.targets]
    heights = [target.height for target in world.targets]
    np.testing.assert_allclose(preview.targets["bottom"] - preview.targets["top"], heights)
    assert len(preview.objects) == len(world.objects)
    assert preview.patches.shape == (len(world.patches), 3)
    assert preview.title.endswith(", seed 5")


def test_the_drawing_reaches_beyond_roadside_and_lane(scene):
    preview = preview_scene(scene, 5)
    assert preview.half_width > scene.clutter.roadside[1]
    assert preview.half_width > scene.lane.x_max


def test_a_scene_of_very_many_objects_is_refused(scene):
    crowded = scene.model_copy(update={"clutter": scene.clutter.model_copy(update={"rocks": 1e7})})
    with pytest.raises(ValueError, match="must take at most"):
        preview_scene(crowded, 5)
