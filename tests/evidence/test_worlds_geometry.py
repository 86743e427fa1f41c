"""Means over lanes by geometry."""

import pandas as pd
import pytest

from flgpr.scoring import clopper_pearson
from worlds import geometry

pytestmark = pytest.mark.slow("studies of papers")


def test_lanes_that_agree_do_not_make_a_geometry_certain():
    counts = {
        f"{kind}_{far:g}": [5, 5]
        for kind in ("metal", "plastic", "simulant")
        for far in (0.02, 0.07)
    }
    targets = {f"{kind}_targets": [14, 14] for kind in ("metal", "plastic", "simulant")}
    ratios = {f"{kind}_ratio_db": [1.0, 2.0] for kind in ("metal", "plastic", "simulant")}
    place = {"height": [2.0, 2.0], "nearest": [7.0, 7.0], "farthest": [16.0, 16.0]}
    means = geometry.means(pd.DataFrame(place | counts | targets | ratios)).set_index("response")
    low, high = (float(bound) for bound in clopper_pearson(10, 28))
    assert tuple(means.loc["metal 0.02", ["low", "high"]]) == pytest.approx((low, high))
