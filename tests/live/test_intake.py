import json

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from damage import MACHINE
from flgpr.live.intake import Intake
from flgpr.model import make_run
from flgpr.store import (
    ScanFileError,
    describe_for_live,
    encode_scan,
)
from live_lane import make_lane_run

"""The intake of scans: what is used, counted and filled in, in any order of faults."""


TINY = describe_for_live(
    make_run(np.zeros((1, 1, 1, 2)), [1e9, 2e9], ["HH"], [[0, 0, 0]], [[1, 0, 0]], np.zeros((1, 6)))
)
NUMBERS = st.integers(0, 30)
FEW = st.integers(0, 4)


class IntakeMachine(RuleBasedStateMachine):
    """A number is used once at most, the counts add up, and a pose that was filled in lies on its neighbours' line."""

    def __init__(self):
        super().__init__()
        self.intake = Intake(TINY)
        self.known = set()
        self.went = []
        self.poses = {}
        self.kept = None
        self.frames = self.bad = 0

    def frame(self, number, pose=True, whole=True, run=TINY.run_id):
        signal = np.full(TINY.shape, 1.0 + number if whole else np.nan)
        where = [np.sin(number), 0.4 * number, 2.0, 0.02 * number, 0, 0] if pose else None
        return encode_scan(number, signal, where, run_id=run), where

    @rule(
        number=NUMBERS,
        pose=st.sampled_from([True, True, True, False]),
        whole=st.sampled_from([True, True, False]),
    )
    def give(self, number, pose, whole):
        data, where = self.frame(number, pose, whole)
        scan = self.intake.admit(data)
        new = number not in self.went
        self.frames += 1
        if new:
            self.known.add(number)
        if new and pose:
            self.poses[number] = np.array(where)
        if not (new and whole):
            assert scan is None
        elif pose:
            assert scan.pose.tolist() == where
        else:
            self.check_filled(number, scan)
        if scan is not None:
            assert scan.number == number
            assert number not in self.went
            self.went.append(number)
            self.intake.judged(number, "taken", None)

    def check_filled(self, number, scan):
        near = [
            known for known in sorted(self.poses)[-8:] if known != number
        ]  # its own came with a bad signal
        before = ([n for n in near if n < number] or [None])[-1]
        after = ([n for n in near if n > number] or [None])[0]
        pair = (
            (before, after)
            if None not in (before, after)
            else tuple(near[-2:] if after is None else near[:2])
        )
        if len(near) < 2 or min(abs(number - n) for n in pair) > 3:
            assert scan is None
            return
        (a, b), share = (self.poses[n] for n in pair), (number - pair[0]) / (pair[1] - pair[0])
        np.testing.assert_allclose(scan.pose, a + share * (b - a), atol=1e-12)

    @rule(number=NUMBERS, at=st.integers(0, 10**6), other=st.booleans())
    def give_what_is_bad(self, number, at, other):
        data, _ = self.frame(number, run="0123456789abcdef" if other else TINY.run_id)
        raw = bytearray(data)
        raw[at % len(raw)] ^= 0 if other else 8
        self.frames = self.frames + 1
        self.bad = self.bad + 1
        with pytest.raises(ScanFileError, match=r"frame|scan"):
            self.intake.admit(bytes(raw))

    @rule()
    def keep(self):
        model = set(self.known), list(self.went), dict(self.poses), self.frames, self.bad
        self.kept = json.loads(json.dumps(self.intake.state())), model

    @precondition(lambda self: self.kept)
    @rule()
    def go_on_from_what_was_kept(self):
        state, (known, went, poses, self.frames, self.bad) = self.kept
        self.known = set(known)
        self.went = list(went)
        self.poses = dict(poses)
        self.intake = Intake(TINY)
        self.intake.restore(state)

    @invariant()
    def counts_add_up(self):
        counts = self.intake.counts
        assert counts["received"] == self.frames
        assert counts["corrupt"] == self.bad
        assert counts["taken"] == len(self.went)
        left_out = ("duplicate", "masked", "pose_missing", "corrupt")
        assert counts["taken"] + sum(counts[name] for name in left_out) == self.frames
        span = max(self.known) - min(self.known) + 1 if self.known else 0
        assert counts["missing"] == span - len(self.known)


TestIntake = IntakeMachine.TestCase
TestIntake.settings = MACHINE


@pytest.mark.parametrize("neighbours", [(4, 3), (0,)])
def test_a_pose_that_came_with_a_bad_signal_fills_no_scan_of_its_own_number(neighbours):
    machine = IntakeMachine()
    for number in neighbours:
        machine.give(number, pose=True, whole=True)
    machine.give(2, pose=True, whole=False)
    machine.give(2, pose=False, whole=True)
    machine.counts_add_up()


def test_a_pose_that_cannot_be_one_is_told_with_what_became_of_its_scan():
    description = describe_for_live(make_lane_run(scans=1))
    intake = Intake(description, longest_gap=1)
    samples = np.ones(description.shape)
    bad = [0, 2, 2, 0, 9, 0]

    def give(number, pose):
        intake.admit(encode_scan(number, samples, pose))
        return intake.pose_report

    assert give(0, [0, 0, 2, 0, 0, 0]) == ""
    left_out = give(5, bad)
    assert left_out.startswith("scan 5: pose must have pitch and roll within a quarter turn, got [")
    assert left_out.endswith("the scan was left out")
    assert give(1, [0, 1, 2, 0, 0, 0]) == ""
    assert give(2, bad).endswith("it was filled in from its neighbours'")
    assert give(3, None) == ""
    assert intake.counts["pose_filled"] + intake.counts["pose_missing"] == 3


def test_poses_are_filled_in_on_the_straight_line():
    description = describe_for_live(make_lane_run(scans=1))
    intake = Intake(description, longest_gap=2)
    samples = np.ones(description.shape)

    def give(number, pose):
        return intake.admit(encode_scan(number, samples, pose))

    give(0, [0, 0, 2, 3.1, 0, 0])
    give(1, [0, 1, 2, -3.1, 0, 0])
    filled = give(2, None)
    np.testing.assert_allclose(filled.pose[:3], [0, 2, 2])
    assert filled.pose[3] == pytest.approx(-3.1 + 2 * np.pi - 6.2)
    assert give(3, None) is not None
    assert give(4, None) is None
    give(8, [0, 8, 2, 0, 0, 0])
    np.testing.assert_allclose(give(7, None).pose[1], 7)
    assert intake.counts["pose_filled"] == 3
    assert intake.counts["pose_missing"] == 1
    assert intake.counts["missing"] == 2
    assert give(6, None) is not None
    assert intake.counts["missing"] == 1
    again = Intake(description, longest_gap=2)
    again.restore(json.loads(json.dumps(intake.state())))
    assert again.state() == intake.state()


def test_a_scan_that_comes_again_with_its_pose_is_not_taken_for_a_repeated_one():
    intake = Intake(TINY)
    signal = np.ones(TINY.shape)
    pose = [0.0, 0.4, 2.0, 0.0, 0.0, 0.0]
    intake.admit(encode_scan(0, 2 * signal, [0.0] * 6, run_id=TINY.run_id))
    assert intake.admit(encode_scan(1, signal, None, run_id=TINY.run_id)) is None
    again = intake.admit(encode_scan(1, signal, pose, run_id=TINY.run_id))
    assert again is not None
    assert again.pose.tolist() == pose
    assert (
        intake.admit(encode_scan(2, signal, [0.0, 0.8, 2.0, 0, 0, 0], run_id=TINY.run_id)) is None
    )
    assert intake.counts["refused"] == 1
