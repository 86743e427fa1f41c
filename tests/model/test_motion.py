"""Plausible poses of a stored run: what is left out, what is said of it, and limits that do not fit."""

import numpy as np

from flgpr.model import make_run
from flgpr.model.motion import judge_poses, judge_run, plausible_run
from flgpr.model.plausible import MotionLimits

SCANS = 13


RATE = 4.2  # scans per second


def straight(step=1.0, scans=SCANS):
    pose = np.zeros((scans, 6))
    pose[:, 1] = step * np.arange(scans)
    pose[:, 2] = 2.0
    return pose


def clock(scans=SCANS, rate=RATE):
    return np.arange(scans) / rate


def test_limits_that_do_not_fit_leave_nothing_out():
    """An aircraft by a vehicle's limits, and two scans of which neither tells on the other."""
    for pose in (straight(60.0), straight(100.0, scans=2)):
        motion = judge_poses(pose, clock(len(pose)))
        assert motion.plausible.all()
        assert not motion.fits
        assert "set its limits for this vehicle" in motion.notes()[0]
    assert judge_poses(straight(60.0), clock(), MotionLimits(speed=300)).fits


def test_many_steps_are_counted_and_the_first_told():
    pose = straight(scans=40)
    pose[5:35:3, 0] += 50
    note = judge_poses(pose, clock(40)).notes()[0]
    assert note.startswith("10 of 40 scans")
    assert note.endswith("and 7 more")
    assert note.count("after scan") == 3


def run_of(pose, time=None):
    signal = np.ones((len(pose), 1, 1, 4))
    return make_run(signal, [1e9, 2e9, 3e9, 4e9], ["HH"], [[0, 0, 0]], [[0, 0, 0]], pose, time)


def test_a_run_keeps_what_was_measured_and_images_leave_it_out():
    pose = straight()
    pose[6, 1] += 45
    run = run_of(pose, clock())
    used = plausible_run(run)
    assert np.flatnonzero(~used["valid"].values[:, 0, 0]).tolist() == [6]
    assert run["valid"].values.all()
    assert used["pose"].equals(run["pose"])
    honest = run_of(straight(), clock())
    assert plausible_run(honest) is honest


def test_what_flies_is_not_judged_by_the_limits_of_a_vehicle():
    pose = straight(60.0)
    pose[:, 2] = 7000.0
    run = run_of(pose, clock())
    assert judge_run(run).notes() == []
    assert judge_run(run, MotionLimits(speed=10)).notes() != []
