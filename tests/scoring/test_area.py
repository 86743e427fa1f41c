import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_scoring import chord_area

from flgpr.model import Lane
from flgpr.scoring import union_area

LANE = Lane(-2.0, 2.0, 0.0, 10.0)


@pytest.mark.parametrize(
    ("centres", "want"),
    [
        ([], 0.0),
        ([[0, 5]], math.pi),
        ([[0, 0]], math.pi / 2),
        ([[2, 10]], math.pi / 4),
        ([[0, 5], [0, 5]], math.pi),
        ([[0, 4], [0, 6]], 2 * math.pi),  # touching
        (
            [[0, 5], [1, 5]],
            2 * math.pi - (2 * math.acos(0.5) - 0.5 * math.sqrt(3)),
        ),  # less one lens
        ([[3, 5]], 0.0),  # touches the border from outside
        ([[50, 5]], 0.0),
    ],
)
def test_area_of_figures_known_in_closed_form(centres, want):
    assert union_area(centres, 1.0, LANE) == pytest.approx(want, abs=1e-12)


def test_discs_over_the_whole_lane_cover_exactly_the_lane():
    centres = [[x, y] for x in np.arange(-2, 2.5, 0.5) for y in np.arange(0, 10.5, 0.5)]
    assert union_area(centres, 1.0, LANE) == pytest.approx(LANE.area, abs=1e-9)
    assert union_area([[0, 5]], 40.0, LANE) == pytest.approx(LANE.area, abs=1e-9)


coordinate = st.one_of(st.integers(-8, 24).map(lambda k: k / 2), st.floats(-4, 12))


@settings(max_examples=120, deadline=None)
@given(
    st.lists(st.tuples(coordinate, coordinate), max_size=7), st.sampled_from([0.5, 1.0, 2.5, 7.0])
)
def test_union_area_is_the_integral_of_its_chords(centres, radius):
    assert union_area(np.array(centres).reshape(-1, 2), radius, LANE) == pytest.approx(
        chord_area(centres, radius, LANE), abs=1e-6
    )


def test_many_discs_far_from_the_origin_agree_with_the_chords():
    rng = np.random.default_rng(1)
    lane = Lane(-2.0, 2.0, 1000.0, 1010.0)
    centres = rng.uniform([-2.5, 999], [2.5, 1011], size=(40, 2))
    assert union_area(centres, 0.6, lane) == pytest.approx(
        chord_area(centres.tolist(), 0.6, lane), abs=1e-7
    )


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_a_radius_must_be_positive(radius):
    with pytest.raises(ValueError, match="radius must be positive"):
        union_area([[0, 5]], radius, LANE)


def test_centres_must_be_finite_positions():
    with pytest.raises(ValueError, match="centre must be finite"):
        union_area([[0, math.nan]], 1.0, LANE)
