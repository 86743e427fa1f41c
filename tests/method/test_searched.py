"""The ground that is searched without a lane, and what is told of it."""

import numpy as np
import pytest

from flgpr.method.sections import SEEN, describe_searched
from flgpr.model import Lane
from flgpr.recipe.fit import area_of
from flgpr.recipe.schema import farthest_seen, lane_of, parse_recipe, seen_lane
from small_lane import small_recipe, small_run


@pytest.fixture(scope="module")
def run():
    return small_run()


@pytest.fixture(scope="module")
def recipe():
    return parse_recipe(small_recipe())


def test_the_ground_that_two_scans_use_is_searched_to_its_end(run, recipe):
    """Scans use ground from 2.5 m, the image's nearest row, to 4.5 m, the run-view's farthest."""
    y = np.sort(run["pose"].values[:, 1])
    lane = lane_of(run, recipe)
    assert lane.y_min == pytest.approx(y[0] + 2.5)
    assert lane.y_max == pytest.approx(y[-2] + 4.5)
    assert seen_lane(run, recipe).y_max == pytest.approx(y[-1] + 4.5)


def test_a_scan_with_missing_sweeps_sees_nothing(run, recipe):
    y = np.sort(run["pose"].values[:, 1])
    last = int(np.argmax(run["pose"].values[:, 1]))
    damaged = run.copy(deep=True)
    damaged["valid"][last] = False
    assert lane_of(damaged, recipe).y_max == pytest.approx(y[-3] + 4.5)
    damaged["valid"][:] = False
    with pytest.raises(ValueError, match=f"without missing sweeps, got none among {len(y)}"):
        lane_of(damaged, recipe)


def test_a_single_scan_searches_what_it_sees(recipe):
    poses = np.array([[0.0, 1.0, 2.0, 0.0, 0.0, 0.0]])
    assert farthest_seen(recipe, poses, 2) == pytest.approx(5.5)


def test_what_is_searched_and_what_is_only_seen_is_told(run, recipe):
    ground = describe_searched(run, recipe, lane_of(run, recipe), "")
    assert ground["source"] == SEEN
    y = np.sort(run["pose"].values[:, 1])
    notes = ground["notes"]
    assert notes[0].endswith("(the ground that 2 scans or more see)")
    assert notes[1] == f"seen and not searched: y {y[-2] + 4.5:.1f} to {y[-1] + 4.5:.1f} m"
    # A lane of 3 m is wider than this run-view.
    assert notes[2:] == ["in the lane and outside the run-view: x -1.5 to -1.2 m and 1.2 to 1.5 m"]


def test_ground_of_the_lane_that_nobody_sees_is_told(run, recipe):
    seen = seen_lane(run, recipe)
    lane = Lane(-2.0, 0.5, seen.y_min - 3, seen.y_max + 10)
    notes = describe_searched(run, recipe, lane, "lane.toml, as given")["notes"]
    assert notes[0].startswith("searched: x -2.00 to 0.50 m")
    assert notes[0].endswith("(lane.toml, as given)")
    unseen = f"{lane.y_min:.1f} to {seen.y_min:.1f} m and {seen.y_max:.1f} to {lane.y_max:.1f} m"
    assert notes[1] == f"in the lane and seen by no scan: y {unseen}"
    assert notes[2] == "in the lane and outside the run-view: x -2.0 to -1.2 m"


def test_a_lane_of_the_recipe_is_its_source(run, recipe):
    text = small_recipe() + "\n[lane]\nx_min = -0.7\nx_max = 0.7\ny_min = 3.0\ny_max = 9.0\n"
    own = parse_recipe(text)
    lane = lane_of(run, own)
    assert lane == Lane(-0.7, 0.7, 3.0, 9.0)
    assert describe_searched(run, own, lane, "")["source"] == "the recipe's lane"


def test_a_lane_beside_the_run_view_is_refused(run, recipe):
    left, right = recipe.run_view.x
    for x_min, x_max in ((right, right + 2), (left - 2, left)):
        with pytest.raises(ValueError, match="lane must reach into the run-view, x"):
            area_of(run, recipe, Lane(x_min, x_max, 2.0, 6.0))
    touching = Lane(right - 0.1, right + 2, 2.0, 6.0)
    assert area_of(run, recipe, touching) == touching
