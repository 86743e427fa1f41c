import numpy as np
import pandas as pd
import pytest

from calibrate.echoes import echo
from flgpr.calibrate import estimate_lever_arm, remove_in_scan_motion, vehicle_velocity
from flgpr.model import make_run
from flgpr.model.track import attitudes, course, make_track, poses_at, reference_track

FREQUENCY = np.linspace(1e9, 3e9, 40)
TX = np.array([[-1.0, 0, 0], [-0.3, 0, 0], [0.3, 0, 0], [1.0, 0, 0]])
RX = TX[::-1] + [0, 0, -0.2]
FOCUS = np.array([0.2, 10.0, -1.5])
PAIR_TIME = 0.01 * np.arange(4)
TONE_TIME = 0.0002 * np.arange(40)


def driven(target, speed):
    """A point seen while the vehicle drives, every pair and tone from where the antennas were then."""
    velocity = np.array([0.02 * speed, speed, 0.0])
    data = np.zeros((1, 1, 4, 40), complex)
    for pair in range(4):
        for tone in range(40):
            off = velocity * (PAIR_TIME[pair] + TONE_TIME[tone])
            data[0, 0, pair, tone] = echo(
                TX[pair] + off, RX[pair] + off, target, FREQUENCY[tone : tone + 1]
            )[0]
    pose = np.array([[0, 0, 1.5, 0, 0, 0.0]])
    return make_run(data, FREQUENCY, ["HH"], TX, RX, pose), velocity


def test_at_the_focus_the_vehicle_seems_to_stand():
    run, velocity = driven(FOCUS, 3.0)
    still = echo(TX, RX, FOCUS, FREQUENCY)
    assert np.abs(np.angle(run["signal"].values[0, 0] / still)).max() > 1.0
    clean = remove_in_scan_motion(run, FOCUS, PAIR_TIME, TONE_TIME, velocity[None])
    np.testing.assert_allclose(clean["signal"].values[0, 0], still, atol=1e-5)


def test_away_from_the_focus_the_error_is_as_stated():
    target = np.array([2.0, 13.0, -1.5])
    run, velocity = driven(target, 3.0)
    clean = remove_in_scan_motion(run, FOCUS, PAIR_TIME, TONE_TIME, velocity[None])
    error = np.abs(np.angle(clean["signal"].values[0, 0] / echo(TX, RX, target, FREQUENCY)))
    way = np.linalg.norm(velocity) * (PAIR_TIME.max() + TONE_TIME.max())
    centre = (TX + RX).mean(axis=0) / 2
    units = [(p - centre) / np.linalg.norm(p - centre) for p in (FOCUS, target)]
    along = abs((units[1] - units[0]) @ velocity / np.linalg.norm(velocity))
    bound = 2 * np.pi * FREQUENCY.max() * 2 * way * along / 299_792_458.0
    assert 0.3 * bound < error.max() < 2 * bound


def test_velocity_is_in_the_vehicle_frame():
    pose = np.zeros((5, 6))
    pose[:, 0] = 2.0 * np.arange(5)
    pose[:, 3] = np.pi / 2
    run = make_run(
        np.ones((5, 1, 1, 1)), [1e9], ["HH"], [[0, 0, 0]], [[0, 0, 0]], pose, np.arange(5.0)
    )
    np.testing.assert_allclose(vehicle_velocity(run), np.tile([0, 2.0, 0], (5, 1)), atol=1e-12)
    with pytest.raises(ValueError, match="increasing times"):
        vehicle_velocity(run.assign_coords(time=("scan", np.full(5, np.nan))))
    with pytest.raises(ValueError, match="pair_time"):
        remove_in_scan_motion(run, FOCUS, [0.0, 1.0], [0.0])


def drive(count=400):
    """Curves at changing speed."""
    time = np.linspace(0, 40, count)
    way = 1.2 * time + 2 * np.sin(0.5 * time)
    heading = 0.5 * np.sin(way / 6)
    step = np.diff(way, prepend=0)
    place = np.stack(
        [np.cumsum(step * np.sin(heading)), np.cumsum(step * np.cos(heading)), 1.5 + 0 * way],
        axis=1,
    )
    return make_track(time, place, heading, 0.02 * np.sin(time), 0.03 * np.cos(time))


LEVER = np.array([0.4, -1.1, 0.8])
LATENCY = 0.18


def antenna_track(reference):
    place = reference[["x", "y", "z"]].to_numpy() + attitudes(reference) @ LEVER
    return make_track(reference["time"] + LATENCY, place)


def test_lever_arm_and_latency_are_found_together():
    reference = drive()
    fit = estimate_lever_arm(antenna_track(reference), reference, np.linspace(-0.5, 0.5, 21))
    assert fit.latency == pytest.approx(LATENCY, abs=0.002)
    np.testing.assert_allclose(fit.lever_arm, LEVER, atol=0.01)
    assert fit.rms < 0.01


def test_the_reference_track_undoes_both():
    reference = drive()
    antenna = antenna_track(reference)
    antenna[["heading", "pitch", "roll"]] = reference[["heading", "pitch", "roll"]]
    pd.testing.assert_frame_equal(reference_track(antenna, LEVER, LATENCY), reference, atol=1e-9)


def test_a_straight_drive_tells_no_latency():
    time = np.arange(50.0)
    track = make_track(time, np.stack([0 * time, time, 0 * time], axis=1))
    with pytest.raises(ValueError, match="must turn"):
        estimate_lever_arm(track, track, [-0.1, 0.0, 0.1])


def test_poses_between_fixes_and_across_north():
    track = make_track(
        [0.0, 1.0, 2.0], [[0, 0, 1], [0, 2, 1], [2, 2, 1]], heading=[3.1, -3.1, -3.0]
    )
    pose = poses_at(track, [0.5, 1.5])
    np.testing.assert_allclose(pose[0, :3], [0, 1, 1])
    assert abs(pose[0, 3]) == pytest.approx(np.pi, abs=1e-9)
    with pytest.raises(ValueError, match=r"gap over 0\.5"):
        poses_at(track, [0.5], max_gap=0.5)
    with pytest.raises(ValueError, match="missing time"):
        poses_at(track, [np.nan])
    with pytest.raises(ValueError, match="increase strictly"):
        make_track([0.0, 0.0], np.zeros((2, 3)))
    with pytest.raises(ValueError, match="finite"):
        make_track([0.0, 1.0], [[0, 0, 0], [0, np.nan, 0]])


def test_heading_from_the_way():
    square = np.array([[0, 0], [0, 1], [0, 2], [1, 2], [2, 2], [2, 2], [2, 1]], float)
    heading = course(square)
    assert heading[0] == pytest.approx(0)
    assert heading[3] == pytest.approx(np.pi / 2)
    assert heading[-1] == pytest.approx(np.pi)
    with pytest.raises(ValueError, match="must move"):
        course(np.zeros((4, 2)))
