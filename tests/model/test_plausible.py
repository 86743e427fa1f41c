"""Which poses a vehicle can have reached: honest drives are believed, faults of positioning are found one by one."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from damage import MACHINE
from flgpr.model.motion import judge_poses
from flgpr.model.plausible import MotionLimits, PoseGate, Sighting, clock_step, step_between

SCANS = 13
RATE = 4.2  # scans per second


def straight(step=1.0, scans=SCANS):
    pose = np.zeros((scans, 6))
    pose[:, 1] = step * np.arange(scans)
    pose[:, 2] = 2.0
    return pose


def with_headings(turn, scans=SCANS):
    pose = np.zeros((scans, 6))
    pose[:, 3] = np.angle(np.exp(1j * turn * np.arange(scans)))
    return pose


def clock(scans=SCANS, rate=RATE):
    return np.arange(scans) / rate


def paused():
    time = clock()
    time[7:] += 3600.0
    return time


def stamped_late():
    """Stamps of a recorder that wrote pairs of scans at once."""
    return (
        np.repeat(2 * clock(SCANS // 2 + 1), 2)[:SCANS]
        + np.tile([0.0, 1e-3], SCANS // 2 + 1)[:SCANS]
    )


def noisy(deviation):
    pose = straight()
    pose[:, :3] += np.random.default_rng(3).normal(0, deviation, (SCANS, 3))
    return pose


def reversed_drive():
    pose = straight()
    pose[:, 1] = np.abs(np.arange(SCANS) - 6.0)
    return pose


def parts_without_times():
    time = clock()
    time[4:8] = np.nan
    return time


def braking():
    """Hard on the brakes, 9 m/s² from 20 m/s, to a stand."""
    time = clock()
    moving = np.minimum(time, 20 / 9)
    pose = straight()
    pose[:, 1] = 20 * moving - 4.5 * moving**2
    return pose


HONEST = {
    "a van that stops every 5 m, without times": (straight(5.0), None),
    "a van that stops every 5 m for 20 s": (straight(5.0), clock(rate=1 / 20)),
    "the speed of a road": (straight(25 / RATE), clock()),
    "hard on the brakes": (braking(), clock()),
    "slow": (straight(0.01), clock()),
    "a pause of an hour": (straight(), paused()),
    "backwards after a while": (reversed_drive(), clock()),
    "far from the lane's origin": (straight() + [3e5, 5e6, 400, 0, 0, 0], clock()),
    "turning on a spot": (with_headings(2.5 / RATE), clock()),
    "turning on a spot by right angles, without times": (with_headings(1.4), None),
    "an inaccurate receiver": (noisy(0.2), clock()),
    "a clock of whole seconds": (straight(), np.floor(clock())),
    "stamps in pairs": (straight(), stamped_late()),
    "times that are missing in between": (straight(), parts_without_times()),
    "one scan": (straight(scans=1), None),
    "standing": (straight(0.0), clock()),
    "standing, by a clock that stands": (straight(0.0), clock() * 0),
}


@pytest.mark.parametrize("name", HONEST)
def test_honest_drives_are_believed(name):
    pose, time = HONEST[name]
    motion = judge_poses(pose, time)
    assert motion.plausible.all()
    assert motion.notes() == []


def test_scans_that_are_lost_widen_what_is_allowed():
    pose = straight(1.0)
    number = np.array([0, 1, 2, 3, 4, 5, 6, 7, 60, 61, 62, 63, 64])
    pose[8:, 1] += 600
    assert judge_poses(pose, None, number=number).notes() == []
    assert judge_poses(pose).notes() != []


FAULTS = {
    "speed": [(0, 45.0), (1, 45.0), (1, -60.0), (1, 1e6), (0, -8.0)],
    "acceleration": [(1, 3.0), (0, 5.0)],
    "climb": [(2, 45.0), (2, -3.0)],
    "turn": [(3, 2.0), (3, -1.0)],
    "tilt": [(4, 0.5), (5, -0.5)],
    "finite": [(1, np.nan), (3, np.inf)],
}


@pytest.mark.parametrize(
    ("limit", "component", "by"), [(name, *one) for name, some in FAULTS.items() for one in some]
)
@pytest.mark.parametrize("at", [6, SCANS - 1])
def test_one_wrong_pose_is_found_and_no_other(limit, component, by, at):
    pose = straight()
    pose[at, component] += by
    motion = judge_poses(pose, clock())
    assert motion.left_out == [at]
    (step,) = motion.steps
    assert (step.scan, step.since, step.limit) == (at, at - 1, limit)
    assert step.strain > 1
    assert f"scan {at} after scan {at - 1}" in motion.notes()[0]


def test_without_times_steps_and_turns_are_limited():
    for component, by, limit in [
        (1, 45.0, "speed"),
        (3, 2.0, "turn"),
        (2, 10.0, "climb"),
        (4, 0.8, "tilt"),
    ]:
        pose = straight()
        pose[6, component] += by
        motion = judge_poses(pose)
        assert motion.left_out == [6]
        assert motion.steps[0].limit == limit
        assert motion.steps[0].seconds is None


def test_the_numbers_of_a_step_are_those_of_the_drive():
    pose = straight()
    pose[6, 1] += 45
    (step,) = judge_poses(pose, clock()).steps
    assert step.value == pytest.approx(46)  # the step of a metre and the fault
    assert step.seconds == pytest.approx(1 / RATE)
    assert step.most == pytest.approx(30 / RATE)
    assert (
        step.words == "scan 6 after scan 5: 46 m away in 0.238 s, 193.2 m/s, at most 30 m/s (speed)"
    )


@pytest.mark.parametrize("wrong", [[0], [0, 1], [6, 7], [0, 6], [6, 8], [5, 6, 9], [11, 12]])
@pytest.mark.parametrize("by", [45.0, 1e6])
def test_wrong_ones_first_last_and_in_a_row_are_found(wrong, by):
    pose = straight()
    pose[wrong, 1] += by
    assert judge_poses(pose, clock()).left_out == wrong


def test_a_first_pose_that_is_wrong_is_found_without_times():
    """Lost scans widen what is allowed, but not so that the wrong pose is believed again after some scans."""
    pose = straight()
    pose[0, 1] += 45
    assert judge_poses(pose).left_out == [0]


def test_a_pose_a_little_off_a_fast_drive_is_left_out_alone():
    pose = straight(20 / RATE)
    pose[6, 1] += 2.5  # the next one lies nearer to it than to the one before
    assert judge_poses(pose, clock()).left_out == [6]


def test_two_wrong_ones_are_found_though_a_lost_scan_would_explain_them():
    pose = straight()
    pose[[6, 7], 1] += 20
    assert judge_poses(pose).left_out == [6, 7]


@pytest.mark.parametrize("by", [500.0, -500.0, 1e6])
def test_positions_that_moved_for_good_are_followed(by):
    pose = straight()
    pose[6:, 1] += by
    motion = judge_poses(pose, clock())
    assert motion.left_out == []
    assert [step.scan for step in motion.restarts] == [6]
    assert motion.notes()[0].startswith(
        "positions jump once and go on from there: scan 6 after scan 5"
    )


def test_a_move_with_a_fault_in_it_costs_that_scan_alone():
    pose = straight()
    pose[6:, 1] += 500
    pose[7, 0] += 80
    assert judge_poses(pose, clock()).left_out == [7]


@pytest.mark.parametrize("jump", [1e6, -100.0])
def test_a_clock_that_jumps_is_told_and_poses_are_not_blamed(jump):
    time = clock()
    time[6:] += jump
    motion = judge_poses(straight(), time)
    assert motion.left_out == []
    assert [(step.scan, step.limit) for step in motion.clock] == [(6, "pause")]
    assert motion.notes()[0].startswith(
        "the clock jumps once, positions do not: clock at scan 6 after scan 5"
    )
    time = clock()
    time[6] += jump  # one stamp alone
    motion = judge_poses(straight(), time)
    assert motion.left_out == []
    assert [step.scan for step in motion.clock] == (
        [6, 7] if jump > 0 else [6]
    )  # ahead again is a pause


@pytest.mark.parametrize("since", [0, 3])
def test_a_clock_that_stands_still_is_told_once_and_poses_are_not_blamed(since):
    time = np.minimum(clock(30), since / RATE)
    motion = judge_poses(straight(scans=30), time)
    assert motion.left_out == []
    assert [(step.scan, step.since) for step in motion.clock] == [(since + 8, since)]
    assert motion.notes() == [
        f"the clock stands still, positions do not: clock at scan {since + 8} after scan {since} "
        "stands still: no speed is known"
    ]


def test_a_wrong_pose_is_found_while_the_clock_jumps():
    pose = straight()
    time = clock()
    pose[6, 1] += 45
    time[6:] -= 50
    motion = judge_poses(pose, time)
    assert motion.left_out == [6]
    assert motion.steps[0].seconds is None


def test_limits_have_bounds():
    for name in MotionLimits.model_fields:
        with pytest.raises(ValueError, match=name):
            MotionLimits(**{name: 0})


def gate_alone(pose, time, limits):
    """The obvious twin: every pose judged by the gate, none passed over."""
    gate = PoseGate(limits)
    trusted = set()
    for number in range(len(pose)):
        verdict = gate.judge(Sighting(number, float(time[number]), pose[number]))
        trusted -= set(verdict.forgotten)
        trusted |= set(verdict.trusted)
        assert not trusted & set(verdict.dropped)
    return sorted(set(range(len(pose))) - trusted)


@st.composite
def drives(draw):
    pose = np.cumsum(np.full((30, 6), [0.1, 1.0, 0, 0.05, 0, 0]), axis=0)
    time = clock(30)
    for at in draw(st.lists(st.integers(0, 29), max_size=6)):
        stop = at + draw(st.sampled_from([1, 2, 4, 30]))
        component, by = draw(
            st.sampled_from([(0, 45.0), (1, -60.0), (1, 5.0), (3, 1.5), (2, 30.0), (1, np.nan)])
        )
        pose[at:stop, component] += by
    if draw(st.booleans()):
        time[draw(st.integers(1, 29)) :] += draw(st.sampled_from([1e6, -30.0, 20.0, np.nan]))
    if draw(st.booleans()):
        time[draw(st.integers(0, 29)) :] = 1.0
    return pose, time


@given(drive=drives())
@settings(MACHINE)
def test_passing_over_what_is_in_order_changes_nothing(drive):
    pose, time = drive
    left_out = gate_alone(pose, time, MotionLimits())
    motion = judge_poses(pose, time)
    if motion.fits:
        assert motion.left_out == left_out
        assert len(motion.steps) == len(left_out)


@given(drive=drives(), at=st.integers(0, 29))
@settings(MACHINE)
def test_a_gate_goes_on_from_its_state(drive, at):
    pose, time = drive
    sightings = [
        Sighting(k, float(time[k]), pose[k]) for k in range(30) if np.isfinite(pose[k]).all()
    ]
    first = PoseGate(MotionLimits())
    second = PoseGate(MotionLimits())
    for one in sightings[:at]:
        first.judge(one)
    second.restore(json.loads(json.dumps(first.state(), allow_nan=False)))
    for one in sightings[at:]:
        assert first.judge(one) == second.judge(one)
    assert first.state() == second.state()


def test_what_is_held_back_is_bounded():
    gate = PoseGate(MotionLimits())
    gate.judge(Sighting(0, np.nan, np.zeros(6)))
    dropped = []
    for number in range(1, 40):
        place = np.array([1e3 * number**2, 0, 0, 0, 0, 0])
        dropped += gate.judge(Sighting(number, np.nan, place)).dropped
        assert len(gate.held) <= 2 * gate.limits.agree
    assert sorted([*dropped, *gate.held]) == list(range(1, 40))


def test_a_number_that_comes_again_takes_the_place_of_the_first():
    gate = PoseGate(MotionLimits())
    pose = straight()
    for number in range(6):
        gate.judge(Sighting(number, number / RATE, pose[number]))
    for number, place in ((6, 500.0), (7, 501.0), (6, 9000.0), (8, 502.0)):
        verdict = gate.judge(Sighting(number, number / RATE, np.array([place, 0, 0, 0, 0, 0])))
        assert not verdict.anew  # the first 6 is gone: 7 and 8 alone agree
    assert gate.judge(Sighting(9, 9 / RATE, np.array([503.0, 0, 0, 0, 0, 0]))).trusted == [7, 8, 9]


def test_a_late_scan_is_judged_by_its_neighbours():
    pose = straight()
    limits = MotionLimits()
    gate = PoseGate(limits)
    for number in (0, 1, 2, 4, 5):
        gate.judge(Sighting(number, number / RATE, pose[number]))
    assert gate.judge(Sighting(3, 3 / RATE, pose[3] + [45, 0, 0, 0, 0, 0])).step.limit == "speed"
    assert gate.judge(Sighting(3, 3 / RATE, pose[3])).trusted == [3]
    assert not gate.held


def test_a_number_far_ahead_is_no_scan_of_this_drive():
    limits = MotionLimits()
    before = Sighting(5, 1.0, np.zeros(6))
    after = Sighting(5000, 1.2, np.zeros(6))
    step = step_between(limits, before, after)
    assert (step.limit, step.value) == ("scans", 4995)
    assert clock_step(limits, before, after) is None
