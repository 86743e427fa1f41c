"""The packaged recipe and the lanes' runs."""

import pytest

from flgpr.recipe.schema import load_recipe

pytestmark = pytest.mark.slow("studies of papers")


def test_the_packaged_recipe_is_the_papers_form():
    """Sec. 2.3: the same mask in each frame; Sec. 2.4: the roadside's average of a frame of the test lane."""
    (masks,) = (one.settings for one in load_recipe("fuse2018").clutter if one.stage == "masks")
    assert (masks.method, masks.low_threshold) == ("iteration-per-frame", "frame")
    assert (masks.iterations, masks.combination, masks.roadside) == (7, 6, (4.0, 10.0))
