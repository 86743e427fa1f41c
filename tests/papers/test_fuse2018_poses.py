"""Poses that are wrong, and what they cost."""

import numpy as np
import pytest

from flgpr_papers.fuse2018.lanes import (
    fuse_recipe,
)
from flgpr_papers.fuse2018.poses import pose_study

pytestmark = pytest.mark.slow("studies of papers")

RECIPE = fuse_recipe(True)


RECIPE = RECIPE.model_copy(
    update={
        "image": RECIPE.image.model_copy(update={"frames": 2, "spacing": 0.2}),
        "study": RECIPE.study.model_copy(update={"every": 2, "loose_every": 2}),
        "lanes": RECIPE.lanes.model_copy(update={"length": 16.0}),
    }
)


def test_reflectors_lose_what_the_formula_says():
    study = pose_study(
        RECIPE.model_copy(update={"image": RECIPE.image.model_copy(update={"frames": 5})}), draws=12
    )
    measured = np.median(study.measured, axis=1)
    assert measured[0] < 0.1
    near = np.asarray(study.errors) <= 0.005
    np.testing.assert_allclose(measured[near], study.predicted["l"][near], atol=0.5)
    assert (study.predicted["x"][1:] > study.predicted["l"][1:]).all()
    assert study.needed["x"] < study.needed["l"]
