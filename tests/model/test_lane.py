"""The lane: its border is inside, and what is no lane is refused."""

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane, as_lane


def test_a_point_on_the_border_is_inside():
    lane = Lane(-1.5, 1.5, 0.0, 20.0)
    assert lane.area == 60.0
    assert lane.contains([-1.5, 1.5, 1.6, 0.0], [0.0, 20.0, 5.0, 20.1]).tolist() == [
        True,
        True,
        False,
        False,
    ]


def test_a_lane_is_made_of_a_mapping_or_a_table_of_one_row():
    borders = {"x_min": -1, "x_max": 1, "y_min": 0, "y_max": 5}
    lane = Lane(-1.0, 1.0, 0.0, 5.0)
    assert as_lane(lane) is lane
    assert as_lane(borders) == lane
    assert as_lane(pd.DataFrame([borders])) == lane
    with pytest.raises(ValueError, match="one row, got a table of 2"):
        as_lane(pd.DataFrame([borders, borders]))
    with pytest.raises(ValueError, match="missing: y_max"):
        as_lane({name: borders[name] for name in ("x_min", "x_max", "y_min")})


@pytest.mark.parametrize(
    ("borders", "rule"), [((1, 1, 0, 5), "x_max > x_min"), ((0, np.nan, 0, 5), "finite")]
)
def test_empty_and_endless_lanes_are_refused(borders, rule):
    with pytest.raises(ValueError, match=rule):
        Lane(*borders)


def test_the_distance_of_points_from_a_lane():
    """Zero in it and on its border, to the nearest side elsewhere, and to the corner beyond two."""
    lane = Lane(-1.0, 1.0, 0.0, 10.0)
    x = [0.0, 1.0, 3.0, -1.0, 4.0]
    y = [5.0, 10.0, 5.0, -2.0, 14.0]
    assert lane.distance(x, y).tolist() == [0.0, 0.0, 2.0, 2.0, 5.0]
    assert np.isnan(lane.distance(np.nan, 5.0))
