import numpy as np
import pytest

from flgpr.model import Grid, lane_to_scan, scan_to_lane, vehicle_to_lane, vehicle_to_scan
from flgpr.model.frames import steps_of, wrapped


def test_heading_turns_clockwise_from_down_track():
    ahead = vehicle_to_lane([0.0, 10.0, 0.0], [1.0, 2.0, 3.0, np.pi / 2, 0, 0])
    np.testing.assert_allclose(ahead, [11.0, 2.0, 3.0], atol=1e-12)


def test_positive_pitch_raises_the_nose_and_positive_roll_drops_the_right_side():
    pose = [0, 0, 2.0, 0, 0.1, 0]
    assert vehicle_to_lane([0, 1.0, 0], pose)[2] == pytest.approx(2 + np.sin(0.1))
    pose = [0, 0, 2.0, 0, 0, 0.1]
    assert vehicle_to_lane([1.0, 0, 0], pose)[2] == pytest.approx(2 - np.sin(0.1))


def test_pitch_is_applied_after_roll():
    pose = [0, 0, 0, 0, 0.2, 0.3]
    got = vehicle_to_lane([1.0, 0, 0], pose)
    rolled = np.array([np.cos(0.3), 0, -np.sin(0.3)])
    want = [rolled[0], -np.sin(0.2) * rolled[2], np.cos(0.2) * rolled[2]]
    np.testing.assert_allclose(got, want, atol=1e-12)


def test_scan_frame_round_trip():
    pose = [3.0, 40.0, 5.0, 0.3, 0.1, -0.2]
    points = np.random.default_rng(1).normal(size=(7, 3))
    np.testing.assert_allclose(lane_to_scan(scan_to_lane(points, pose), pose), points, atol=1e-12)


@pytest.mark.parametrize("take", [vehicle_to_lane, vehicle_to_scan, scan_to_lane, lane_to_scan])
def test_many_poses_at_once_are_each_pose_by_itself_to_the_bit(take):
    rng = np.random.default_rng(2)
    points = rng.normal(size=(4, 7, 3))
    poses = rng.normal(size=(5, 6))
    want = [[take(some, pose) for pose in poses] for some in points]
    np.testing.assert_array_equal(take(points[:, None], poses), want)


def test_grid_spans_its_limits():
    grid = Grid.spanning((-1.0, 1.0), (2.0, 3.0), 0.1)
    assert grid.shape == (11, 21)
    assert grid.points()[-1, -1].tolist() == pytest.approx([1.0, 3.0, 0.0])
    assert grid.extent() == pytest.approx((-1.05, 1.05, 1.95, 3.05))


@pytest.mark.parametrize("bad", [{"spacing": 0}, {"x": (1, 1)}, {"y": (3, 2)}])
def test_bad_grids_are_refused(bad):
    with pytest.raises(ValueError, match=r"spacing|limits"):
        Grid.spanning(**({"x": (0, 1), "y": (0, 1), "spacing": 0.1} | bad))


def test_angles_are_wrapped_to_half_a_turn_and_steps_are_level():
    np.testing.assert_allclose(wrapped([1.5 * np.pi, 0.1]), [-0.5 * np.pi, 0.1], atol=1e-12)
    assert steps_of(np.array([[0.0, 0.0, 9.0], [3.0, 4.0, 0.0]])).tolist() == [5.0]
