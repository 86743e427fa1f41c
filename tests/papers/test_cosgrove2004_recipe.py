"""The packaged settings of the study."""

import numpy as np
import pytest

from flgpr_papers.cosgrove2004.images import (
    study_sensor,
)
from flgpr_papers.cosgrove2004.recipe import study_recipe

pytestmark = pytest.mark.slow("studies of papers")


def test_packaged_study_has_the_papers_sizes_and_mine():
    recipe = study_recipe()
    assert {site.body for site in recipe.sites.values() if site.kind == "metal"} == {"tm-62m"}
    for site, images in (("sand", 72), ("gravel", 34), ("clay", 34)):
        depth, trains = recipe.sites[site].depths()
        assert 2 * np.count_nonzero(~trains) == images
        assert set(depth[trains]) == ({0.1} if site == "sand" else {0.01})
        assert not set(depth[trains]) & set(depth[~trains])
    assert (recipe.cut.length, recipe.image.spacing[1], recipe.detector.ddof) == (28, 0.02, 1)
    assert study_sensor(recipe).pairs()[0].shape == (72, 3)
    assert recipe.study.seeds >= 12
