"""The drawn world and the vehicle's track: what a seed decides and what the scene does."""

import numpy as np
import pytest

from flgpr.simulate import Scene, draw_world, world_description
from flgpr.simulate.scene.world import MARGIN, draw_track

BUSY = {
    "length": 40.0,
    "clutter": {"rocks": 0.05, "bushes": 0.1, "posts": 0.1, "patches": 0.01},
    "holes": {"over": 0.5, "empty": 0.1},
    "draws": ({"kind": "metal", "depth": 0.05, "count": 10},),
    "targets": ({"kind": "plastic", "x": 0.5, "y": 3.0, "depth": 0.1},),
}


def track_of(**track):
    return draw_track(Scene(length=40.0, track=track), 2.0, 1)


def test_what_is_given_stands_before_what_is_drawn():
    world = draw_world(Scene(**BUSY), 3)
    assert len(world.targets) == 11
    assert (world.targets[0].x, world.targets[0].y) == (0.5, 3.0)


def test_drawn_targets_lie_in_the_lane_in_their_order_along_it():
    scene = Scene(**{**BUSY, "targets": ()})
    world = draw_world(scene, 3)
    assert all(abs(target.x) <= 1.5 - 0.16 - 0.1 for target in world.targets)
    along = [target.y for target in world.targets]
    assert along == sorted(along)
    assert along[0] > 0
    assert along[-1] < scene.length
    assert len(world.truth()) == 10


def test_rocks_and_the_roadside_lie_where_the_scene_says():
    scene = Scene(**BUSY)
    objects = draw_world(scene, 3).objects
    assert {one.kind for one in objects} == {"rock", "bush", "post"}
    for one in objects:
        assert -MARGIN <= one.y <= scene.length + MARGIN
        if one.kind == "rock":
            assert abs(one.x) <= 7.0
        else:
            assert 3.5 <= abs(one.x) <= 7.0


def test_empty_holes_are_objects_and_those_over_targets_are_not():
    world = draw_world(Scene(**BUSY), 3)
    empty = [hole for hole in world.holes if hole.target is None]
    assert 0 < len(empty) < len(world.holes)
    table = world.objects_table()
    assert (table["kind"] == "hole").sum() == len(empty)


def test_a_described_world_is_the_same_for_every_seed():
    described = Scene.model_validate(world_description(Scene(**BUSY, terrain={"on": False}), 3))
    want = draw_world(Scene(**BUSY), 3)
    got = draw_world(described, 4)
    assert got.targets == want.targets
    assert got.objects == want.objects


def test_a_vehicle_drives_at_two_metres_a_second_by_its_steps():
    pose, time = track_of(step=(1.0, 3.0))
    strides = np.diff(pose[:, 1])
    assert strides.min() >= 1.0
    assert strides.max() <= 3.0
    np.testing.assert_allclose(np.diff(time), strides / 2)
    assert pose[0, 1] == -20.0
    assert pose[-1, 1] <= 35.0
    np.testing.assert_array_equal(pose[:, 2], 2.0)


def test_a_standing_vehicle_takes_a_scan_a_second():
    pose, time = track_of(step=(2.0, 2.0), stops=((0.0, 3),))
    standing = np.flatnonzero(pose[:, 1] == 0.0)
    assert standing.size == 4
    np.testing.assert_allclose(np.diff(time[standing]), 1.0)


def test_no_scan_is_taken_while_the_vehicle_is_off_the_lane():
    pose, time = track_of(step=(1.0, 1.0), departures=({"start": 4.5, "length": 6.0},))
    y = pose[:, 1]
    assert not ((y >= 4.5) & (y < 10.5)).any()
    after = int(np.flatnonzero(y >= 10.5)[0])
    # It drives on to the departure, along it, and takes the next scan at its end.
    assert y[after] == 10.5
    assert time[after] - time[after - 1] == pytest.approx((1.0 + 6.0) / 2)


def test_wandering_has_its_rms_and_the_heading_follows_it():
    scene = Scene(length=4000.0, track={"wander": 0.2, "step": (0.5, 0.5)})
    pose, _ = draw_track(scene, 2.0, 1)
    assert pose[:, 0].std() == pytest.approx(0.2, rel=0.05)
    slope = np.gradient(pose[:, 0], pose[:, 1])
    np.testing.assert_allclose(np.tan(pose[:, 3])[1:-1], slope[1:-1], atol=2e-3)


def test_exact_positions_are_those_of_the_scans():
    pose, time = track_of(positions=(1.0, 4.0, 2.5))
    np.testing.assert_array_equal(pose[:, 1], [1.0, 4.0, 2.5])
    np.testing.assert_array_equal(time, [0.0, 1.0, 2.0])


def test_a_track_without_a_scan_is_refused():
    with pytest.raises(ValueError, match="track must hold at least one scan, got none from 50 m"):
        track_of(start=50.0)
