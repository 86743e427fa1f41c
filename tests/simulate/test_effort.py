"""What a simulation takes is estimated before anything is drawn, and refused where it is too much."""

import pytest

from flgpr.model import load_sensor
from flgpr.simulate import Scene
from flgpr.simulate.effort import check_effort, drawing_effort, simulation_effort


@pytest.fixture(scope="module")
def sensor():
    return load_sensor("sri-array")


@pytest.mark.parametrize(
    "more",
    [
        {"surface": {"density": 1e5}},
        {"length": 1e5},
        {"clutter": {"rocks": 100.0}},
        {"stones": {"density": 1e4}},
        {"draws": [{"kind": "metal", "depth": 0.1, "count": 100_000}]},
        {"holes": {"empty": 1e3}},
        {"track": {"step": (0.001, 0.002)}},
        {"track": {"stops": [(0.0, 10**6)]}},
    ],
    ids=lambda more: next(iter(more)),
)
def test_the_estimate_grows_with_what_costs(more, sensor):
    usual = simulation_effort(Scene(), sensor)
    assert 0 < usual.seconds < 3600
    assert usual.memory < 2e9
    effort = simulation_effort(Scene.model_validate(more), sensor)
    assert max(effort.seconds / usual.seconds, effort.memory / usual.memory) > 10


def test_switched_off_nothing_costs(sensor):
    tables = {"density": 1e4, "on": False}
    scene = Scene(stones=tables, roots=tables, holes={"empty": 1e3, "on": False})
    assert simulation_effort(scene, sensor) == simulation_effort(Scene(), sensor)


def test_objects_are_counted_by_their_mean():
    scene = Scene(
        length=30.0,
        targets=[{"kind": "metal", "x": 0.0, "y": 5.0}],
        draws=[{"kind": "metal", "depth": 0.1, "count": 4}],
        clutter={"posts": 0.5},
    )
    assert drawing_effort(scene).objects == 5 + 0.5 * (30.0 + 70.0)


def test_too_much_is_refused_with_its_figures_unless_it_is_forced(sensor):
    scene = Scene(name="vast", length=1e5, stones={"density": 1e4})
    with pytest.raises(ValueError, match=r"scene 'vast' must take at most 4 GB and 48 hours, got"):
        check_effort(scene, sensor)
    check_effort(scene, sensor, force=True)
    check_effort(scene)
