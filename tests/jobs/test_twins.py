"""Twins of an array's lanes: mines far apart in lanes that the array sees, the same for the same seed."""

import itertools

import numpy as np
import pytest

from flgpr.jobs.check_on_twins import APART, draw_scene, plan_twins, simulate_twin, twins_for
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import load_recipe, parse_recipe
from recipe.test_recipe_for_run import bare_run

TONES = 0.45e9 + 15e6 * np.arange(60)


def planned(step=1.0, scans=6, height=1.5, **options):
    run = bare_run(height, ("HH",), TONES, scans=scans, step=step, **options)
    recipe = parse_recipe(fit_recipe(run, like="fused"))
    return plan_twins(run, recipe), recipe


@pytest.mark.parametrize(("step", "scans"), [(1.0, 6), (0.5, 2)], ids=["drives", "two stops"])
def test_mines_lie_in_the_lane_two_metres_apart(step, scans):
    plan, recipe = planned(step, scans)
    bodies = set()
    for number in range(6):
        scene = draw_scene(plan, number, seed=1)
        places = np.array([(target.x, target.y) for target in scene.targets])
        assert len(places) == plan.mines
        assert scene.lane.contains(places[:, 0], places[:, 1]).all()
        for one, other in itertools.combinations(places, 2):
            assert np.hypot(*(one - other)) >= APART
        bodies |= {target.body for target in scene.targets}
    assert bodies == {"metal-at", "tm-62p", "plastic-at"}
    left, right = recipe.run_view.x
    assert left < scene.x_min < scene.x_max < right


def test_a_lane_is_what_all_stops_see():
    plan, recipe = planned(0.5, 2)
    near, far = recipe.image.y[0], recipe.run_view.y_max
    assert plan.positions == pytest.approx((-near - 0.5, -near))
    assert plan.length == pytest.approx(far - near - 0.5)
    with pytest.raises(
        ValueError, match=r"a lane of 0\.\d+ m that all scans see is too short for a mine"
    ):
        planned(2.1, 3)


def test_a_drive_sees_every_place_ten_times_at_most():
    slow, recipe = planned(0.01, 400)
    assert slow.step == pytest.approx((recipe.run_view.y_max - recipe.image.y[0]) / 10)
    fast, _ = planned(1.3)
    assert fast.step == pytest.approx(1.3)
    assert twins_for(fast, 24) == 24 // fast.mines


def test_the_same_seed_gives_the_same_lane_beside_the_axis_of_the_course():
    plan, recipe = planned(0.5, 2, course=40.0)
    first, again = simulate_twin(plan, 3, seed=5), simulate_twin(plan, 3, seed=5)
    np.testing.assert_array_equal(first.run["signal"], again.run["signal"])
    assert not np.array_equal(first.run["signal"], simulate_twin(plan, 3, seed=6).run["signal"])
    assert 40.0 == pytest.approx(sum(recipe.run_view.x) / 2) == pytest.approx(plan.middle)
    assert first.run["pose"].values[:, 0] == pytest.approx(40.0, abs=0.2)
    assert np.abs(first.truth["x"] - 40.0).max() < 1.5


def test_low_arrays_have_the_grounds_echo_and_others_where_it_is_asked_for():
    for height, echo in ((1.5, True), (5.0, False)):
        run = bare_run(height, ("HH",), 0.45e9 + 5e6 * np.arange(180))
        recipe = parse_recipe(fit_recipe(run, like="fused"))
        sensor = plan_twins(run, recipe).sensor
        assert sensor.has_specular_echo is sensor.has_direct_wave is echo
        assert (sensor.ground_in_view[2] < 0) is echo
        assert sensor.ground_in_view[3] > recipe.image.y[1]
        for asked in (True, False):
            assert plan_twins(run, recipe, echoes=asked).sensor.has_specular_echo is asked


def test_a_recipe_without_simulated_signatures_has_no_twins():
    with pytest.raises(ValueError, match="must have a map of simulated signatures, got wang2007"):
        plan_twins(bare_run(), load_recipe("wang2007"))
