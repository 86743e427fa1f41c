"""Images of mines and points as the study makes them."""

import numpy as np
import pytest

from flgpr_papers.cosgrove2004.images import (
    point_response,
    signature_cuts,
)
from flgpr_papers.cosgrove2004.recipe import study_recipe

pytestmark = pytest.mark.slow("studies of papers")


def test_plain_cylinder_without_clutter_shows_two_humps_32_cm_apart_behind_its_place():
    recipe = study_recipe()
    plain = recipe.sites["sand"].model_copy(update={"body": None})
    away, cuts = signature_cuts(recipe.model_copy(update={"sites": {"sand": plain}}))
    for cut in cuts:
        level = np.abs(cut)
        peaks = [k for k in range(1, level.size - 1) if level[k] > max(level[k - 1], level[k + 1])]
        near = max((k for k in peaks if -0.15 < away[k] < 0.15), key=lambda k: level[k])
        far = max((k for k in peaks if 0.25 < away[k] < 0.45), key=lambda k: level[k])
        assert away[far] - away[near] == pytest.approx(0.32, abs=0.04)
        assert min(level[near], level[far]) > 0.25 * level.max()  # HH far: spread by the cover


def test_resolution_is_near_the_papers():
    width = point_response(study_recipe(), filtered=True).resolution
    assert width[0] == pytest.approx(0.10, abs=0.02)
    assert width[1] == pytest.approx(0.40, abs=0.05)
