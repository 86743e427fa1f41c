"""The lanes of the study hold what the paper says."""

import numpy as np
import pytest

from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.simulate import draw_world
from flgpr_papers.wang2007 import lanes

pytestmark = pytest.mark.slow("studies of papers")


def test_the_lanes_hold_what_the_paper_says():
    kinds = {"surface": 0, "metal": 0, "plastic": 0, "simulant": 0}
    for scene, seed in lanes.calibration_scenes().values():
        assert 300 <= scene.length <= 340
        truth = draw_world(scene, seed).truth()
        for kind, depth in zip(truth["kind"], truth["depth"], strict=True):
            kinds["surface" if depth < 0 else kind] += 1
    assert kinds == {"surface": 15, "metal": 12, "plastic": 20, "simulant": 16}
    blind = lanes.blind_scenes()
    assert [scene.length for scene, _ in blind.values()] == [1200.0] * 4
    for scene, seed in blind.values():
        truth = draw_world(scene, seed).truth()
        assert np.abs(truth["depth"] - 0.075).max() < 0.03
    assert len({seed for _, seed in [*lanes.calibration_scenes().values(), *blind.values()]}) == 7


def test_the_recipe_of_f1_has_one_sub_band():
    recipe = parse_recipe(lanes.f1_alone(recipe_text("wang2007")))
    assert list(recipe.image.subbands) == ["F1"]
