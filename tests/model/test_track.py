"""Tracks: interpolation, gaps, the lever arm, and headings from motion."""

import numpy as np
import pytest

from flgpr.model.track import bridged, check_track, course, make_track, poses_at, reference_track

TIME = np.arange(5.0)
POSITION = np.column_stack([np.zeros(5), 2.0 * TIME, np.full(5, 1.5)])


def test_poses_are_interpolated_on_the_clock_of_the_track():
    track = make_track(TIME, POSITION, heading=np.linspace(3.0, 3.4, 5))
    pose = poses_at(track, [0.5, 1.0], clock_offset=1.0, clock_rate=2.0)
    np.testing.assert_allclose(pose[:, 1], [4.0, 6.0])
    np.testing.assert_allclose(pose[:, 3], [3.2 - 2 * np.pi, 3.3 - 2 * np.pi])
    with pytest.raises(ValueError, match="within the track"):
        poses_at(track, [9.0])
    with pytest.raises(ValueError, match=r"no gap over 0\.5 s"):
        poses_at(track, [1.0], max_gap=0.5)


def test_the_lever_arm_and_the_latency_are_removed():
    track = make_track(TIME, POSITION, heading=np.pi / 2)  # along +x
    reference = reference_track(track, (0.0, 1.0, 0.2), latency=0.1)
    np.testing.assert_allclose(reference["time"], TIME - 0.1)
    np.testing.assert_allclose(reference[["x", "y", "z"]], POSITION - [1.0, 0.0, 0.2], atol=1e-12)


def test_the_heading_follows_the_motion_also_while_the_vehicle_waits():
    position = [[0, 0], [0, 1], [0, 1.001], [1, 1.001], [2, 1.001]]
    heading = course(position)
    assert heading[0] == pytest.approx(0.0, abs=0.01)
    assert heading[-1] == pytest.approx(np.pi / 2, abs=0.01)
    with pytest.raises(ValueError, match="must move by at least"):
        course(np.zeros((4, 2)))


def test_missing_fixes_are_bridged_and_counted():
    pose = np.zeros((5, 6))
    pose[2] = np.nan
    finite, notes = bridged(TIME, pose)
    assert finite.tolist() == [True, True, False, True, True]
    assert notes == ["1 of 5 fixes of the track not finite, bridged"]
    with pytest.raises(ValueError, match="at least every max_gap = 1 s"):
        bridged(TIME, pose, 1.0)


def test_time_must_increase():
    with pytest.raises(ValueError, match=r"track.time must increase strictly, got 1 s, 1 s"):
        check_track(make_track(TIME, POSITION).assign(time=[0, 1, 1, 2, 3]))
