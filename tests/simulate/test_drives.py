"""Later drives over the same simulated road."""

import numpy as np
import pytest

from flgpr.model import Sensor, load_sensor
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.ground.field import SurfaceField
from flgpr.simulate.scene.world import draw_track, draw_world

ROAD = {
    "site": "arid-sand",
    "length": 40.0,
    "clutter": {"rocks": 0.1},
    "track": {"step": [1.0, 2.0], "wander": 0.1},
    "targets": [
        {"kind": "metal", "x": 0.0, "y": 10.0, "depth": 0.05, "lifted": 2},
        {"kind": "metal", "x": 0.5, "y": 20.0, "depth": 0.05},
    ],
    "draws": [{"kind": "plastic", "depth": 0.05, "count": 4, "laid": 2}],
    "holes": {"on": True, "over": 1.0, "empty": 0.0},
}


def road(**drive):
    return Scene.model_validate(ROAD | {"drives": [drive]})


def test_the_first_drive_is_that_of_a_scene_without_later_ones():
    alone = Scene.model_validate(ROAD | {"draws": []})
    first = draw_world(road(beside=1.0, decoys=0.1, rocks=1.0), 3)
    plain = draw_world(alone, 3)
    assert (first.targets, first.objects, first.holes) == (
        plain.targets,
        plain.objects,
        plain.holes,
    )
    np.testing.assert_array_equal(
        draw_track(road(beside=1.0), 5.0, 3)[0], draw_track(alone, 5.0, 3)[0]
    )


def test_targets_are_laid_and_lifted_and_what_is_lifted_leaves_its_hole():
    later = draw_world(road().at_drive(2), 3)
    assert sorted(target.kind for target in later.targets) == ["metal"] + 4 * ["plastic"]
    truth = later.truth()
    assert truth.set_index("kind")["laid"].to_dict() == {"metal": 1, "plastic": 2}
    filled = [hole for hole in later.holes if hole.target is None]
    assert [(hole.x, hole.y) for hole in filled] == [(0.0, 10.0)]
    over = {(hole.x, hole.y) for hole in later.holes if hole.target is not None}
    assert over == {(target.x, target.y) for target in later.targets}
    for hole in later.holes:
        if hole.target is not None:
            assert later.targets[hole.target].y == hole.y


def test_rocks_move_by_the_share_that_is_told():
    first = draw_world(road(rocks=0.3), 3).objects
    later = draw_world(road(rocks=0.3).at_drive(2), 3).objects
    assert len(first) == len(later)
    rocks = [(a, b) for a, b in zip(first, later, strict=True) if a.kind == "rock"]
    moved = np.mean([a != b for a, b in rocks])
    assert len(rocks) > 50
    assert 0.15 < moved < 0.45
    assert all(a == b for a, b in zip(first, later, strict=True) if a.kind != "rock")


def test_decoys_are_holes_with_nothing_in_them():
    later = draw_world(road(decoys=0.2).at_drive(2), 3)
    decoys = [hole for hole in later.holes if hole.target is None]
    assert 10 < len(decoys) < 40  # 24 expected, and one of the lifted mine


def test_the_surface_keeps_the_share_of_its_echo_that_is_not_new():
    surface = road().surface
    field = SurfaceField(surface, (), 400.0, 3).tile(0, 0)
    later = SurfaceField(surface, (), 400.0, 3, renewed=(0.19, 2)).tile(0, 0)
    np.testing.assert_array_equal(field.xy, later.xy)
    a, b = field.amplitude[:, 0], later.amplitude[:, 0]
    coherence = np.abs(np.vdot(a, b)) / (np.linalg.norm(a) * np.linalg.norm(b))
    assert coherence == pytest.approx(0.9, abs=0.03)
    third = SurfaceField(surface, (), 400.0, 3, renewed=(0.19, 3)).tile(0, 0)
    assert not np.array_equal(later.amplitude, third.amplitude)


@pytest.mark.parametrize("model", ["mironov", "fixed"])
def test_wetter_soil_is_slower(model):
    scene = Scene.model_validate(
        {"soil": {"model": model, "moisture": 0.05}, "drives": [{"moisture": 0.02}]}
    )
    frequency = np.array([1e9])
    dry = scene.soil.media(frequency)[0].real
    wet = scene.at_drive(2).soil.media(frequency)[0].real
    assert 0.3 < wet[0] - dry[0] < 1.5


def test_radar_and_navigation_have_noise_of_their_own_in_every_drive():
    radar = load_sensor("sri-array").model_dump()
    sensor = Sensor.model_validate(radar | {"tones": {"start": 0.8e9, "step": 10e6, "count": 40}})
    tables = {
        "length": 4.0,
        "track": {"positions": [0.0, 0.5]},
        "surface": {"density": 4.0},
        "drives": [{"position": 0.5, "beside": 0.2}, {}],
    }
    scene = Scene.model_validate(tables)
    first, second, third = (
        Simulator(scene.at_drive(number), sensor, 1, errors=True) for number in (1, 2, 3)
    )
    np.testing.assert_array_equal(first.scan(0), Simulator(scene, sensor, 1).scan(0))
    np.testing.assert_allclose(second.pose[:, 0] - first.pose[:, 0], 0.2)
    assert np.abs(second.reported_pose() - second.pose)[:, :3].max() > 0.1
    np.testing.assert_array_equal(third.pose, first.pose)
    one, other = (np.nan_to_num(simulator.scan(0)) for simulator in (first, third))
    alike = np.abs(np.vdot(one, other)) / (np.linalg.norm(one) * np.linalg.norm(other))
    assert 0.5 < alike < 0.999  # the same ground and vehicle, another noise


def test_a_drive_that_the_scene_does_not_tell_of_is_refused():
    with pytest.raises(ValueError, match=r"drive must be from 1 to 2, .*got 3"):
        road().at_drive(3)
    with pytest.raises(ValueError, match=r"drive must be at most 1, .*got 2"):
        Scene.model_validate({"drive": 2})
