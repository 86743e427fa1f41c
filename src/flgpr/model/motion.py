"""Plausible poses of a stored run, judged one after the other as live, and what to say of them.

The limits, and the gate that judges a pose, are in ``plausible.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from flgpr.model.plausible import (
    FLOOR,
    REMEMBERED,
    SHORTEST,
    MotionLimits,
    MotionStep,
    PoseGate,
    Sighting,
    moved,
)
from flgpr.types import ArrayLike, BoolArray, FloatArray, IntArray, floats

if TYPE_CHECKING:
    import xarray as xr

_LISTED = 3  # steps that are listed one by one
_AIRBORNE = 100.0  # m above the ground, from where on a run is no ground vehicle's


@dataclass(frozen=True, eq=False)
class Motion:
    """Plausibility of a track."""

    plausible: BoolArray  #: (scan,): poses that are plausible
    steps: list[MotionStep] = field(default_factory=list)  #: of poses that are not plausible
    restarts: list[MotionStep] = field(
        default_factory=list
    )  #: after which positions continue elsewhere
    clock: list[MotionStep] = field(default_factory=list)  #: of times that are not plausible
    fits: bool = True  #: False where the limits do not fit the track, so that nothing is left out

    @property
    def left_out(self) -> list[int]:
        """Numbers of the scans whose pose is not plausible."""
        return [int(scan) for scan in np.flatnonzero(~self.plausible)]

    def notes(self) -> list[str]:
        """Return lines on what is implausible, with the first few numbers; none if nothing is."""
        lines = []
        count = self.plausible.size
        if not self.fits:
            lines.append(
                f"{len(self.steps)} of {count} scans lie farther from those before than [motion] "
                "allows, too many to be faults: all are used; set its limits for this vehicle: "
                f"{some_steps(self.steps)}"
            )
        elif self.left_out:
            lines.append(
                f"{len(self.left_out)} of {count} scans have positions that no vehicle reaches, "
                f"which images leave out: {some_steps(self.steps)}"
            )
        if self.restarts and self.fits:
            lines.append(
                f"positions jump {_times(self.restarts)} and go on from there: "
                f"{some_steps(self.restarts)}"
            )
        if self.clock:
            jumps = [step for step in self.clock if step.value]
            what = f"the clock jumps {_times(jumps)}" if jumps else "the clock stands still"
            lines.append(f"{what}, positions do not: {some_steps(self.clock)}")
        return lines

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "scans": self.left_out,
            "fits": self.fits,
            "steps": [step.as_json() for step in self.steps],
            "restarts": [step.as_json() for step in self.restarts],
            "clock": [step.as_json() for step in self.clock],
        }


def some_steps(steps: Sequence[MotionStep]) -> str:
    """Return a text on the first few steps, and how many more there are."""
    more = f"; and {len(steps) - _LISTED} more" if len(steps) > _LISTED else ""
    return "; ".join(step.words for step in steps[:_LISTED]) + more


def _times(steps: Sequence[MotionStep]) -> str:
    """Return "once" or the number of times."""
    return "once" if len(steps) == 1 else f"{len(steps)} times"


def judge_poses(
    pose: ArrayLike,
    time: ArrayLike | None = None,
    limits: MotionLimits | None = None,
    number: ArrayLike | None = None,
) -> Motion:
    """Judge which poses of a track are plausible after those before.

    If more than half are not plausible, or no ``limits.agree`` in a row agree, the limits are those
    of another vehicle: then all are taken to be plausible, ``fits`` is False, and the steps are
    listed.

    Parameters
    ----------
    pose : (scan, 6) array_like
        Poses, m and rad.
    time : (scan,) array_like, optional
        Times, s; by default unknown.
    limits : MotionLimits, optional
        Limits of the vehicle; default a ground vehicle.
    number : (scan,) array_like of int, optional
        Ascending numbers of the scans, by default from 0 on.

    Returns
    -------
    Motion
        The plausible poses, and the steps to the others.

    Raises
    ------
    ValueError
        If the shapes do not agree.
    """
    limits = limits or MotionLimits()
    poses = floats(pose)
    times = np.full(len(poses), np.nan) if time is None else floats(time)
    if poses.ndim != 2 or poses.shape[1] != 6 or times.shape != (len(poses),):
        raise ValueError(
            f"pose must be (scan, 6) and time (scan,), got {poses.shape} and {times.shape}"
        )
    numbers = np.arange(len(poses)) if number is None else np.asarray(number, dtype=np.int64)
    doubtful = _doubtful(limits, times, poses, numbers)
    if not doubtful.any():
        return Motion(np.ones(len(poses), bool))

    judged = _JudgedTrack(limits)
    sightings = list(map(Sighting, numbers.tolist(), times.tolist(), poses))
    scan = 0
    while scan < len(sightings):
        if scan and not doubtful[scan] and judged.gate.is_settled_at(sightings[scan - 1].number):
            # Up to the next doubtful pose each follows from the one before.
            stop = scan + int(np.argmax(np.append(doubtful[scan:], True)))
            judged.trust(sightings[scan:stop])
            scan = stop
        else:
            judged.judge(sightings[scan])
            scan += 1

    plausible = np.isin(numbers, list(judged.trusted))
    faults = judged.faults
    is_confirmed = len(judged.gate.confirmed) >= limits.agree
    fits = is_confirmed and 2 * np.count_nonzero(plausible) > len(poses)
    if not fits:
        all_plausible = np.ones(len(poses), bool)
        return Motion(all_plausible, list(faults.values()), judged.restarts, judged.clock, False)
    steps = [faults[number] for number in numbers[~plausible]]
    return Motion(plausible, steps, judged.restarts, judged.clock)


class _JudgedTrack:
    """Verdicts on the poses of a track so far."""

    def __init__(self, limits: MotionLimits) -> None:
        self.gate = PoseGate(limits)
        self.trusted = set[int]()  # numbers of the scans
        self.faults: dict[int, MotionStep] = {}  # by number, why a pose is not plausible
        self.restarts: list[MotionStep] = []
        self.clock: list[MotionStep] = []

    def trust(self, sightings: list[Sighting]) -> None:
        """Trust sightings that follow from one another."""
        self.trusted |= {sighting.number for sighting in sightings}
        self.gate.trust(sightings[-REMEMBERED:])

    def judge(self, sighting: Sighting) -> None:
        """Let the gate judge the next sighting."""
        verdict = self.gate.judge(sighting)
        self.trusted = (self.trusted - set(verdict.forgotten)) | set(verdict.trusted)
        if verdict.clock is not None:
            self.clock.append(verdict.clock)
        if verdict.step is not None:
            self.faults[sighting.number] = verdict.step
        if verdict.anew and not verdict.forgotten:
            self.restarts.append(self.faults[verdict.trusted[0]])
        # The step away from a forgotten pose is that of the first one that others agree with.
        for forgotten in verdict.forgotten:
            self.faults[forgotten] = self.faults[verdict.trusted[0]]


def _doubtful(
    limits: MotionLimits, times: FloatArray, poses: FloatArray, numbers: IntArray
) -> BoolArray:
    """Mark poses that may not be plausible after the two before, for the gate to judge."""
    if not np.isfinite(poses).all():
        return np.ones(len(poses), bool)
    gaps = np.diff(numbers)
    elapsed = np.diff(times)
    doubt = (gaps < 1) | (gaps > limits.scans) | (elapsed < 0) | (elapsed > limits.pause)
    known = elapsed > 0
    seconds = np.where(known, np.maximum(elapsed, SHORTEST), limits.interval * gaps)
    for limit, value in moved(poses[:-1], poses[1:]).items():
        doubt |= value > np.maximum(getattr(limits, limit) * seconds, FLOOR[limit])
    # How far a pose lies from where the step before, at its speed, would have led.
    step = np.diff(poses[:, :2], axis=0)
    past = seconds[:-1]
    now = seconds[1:]
    continued = step[:-1] * (now / past)[:, None]
    swerve = np.hypot(*(step[1:] - continued).T)
    most = np.maximum(limits.acceleration * now * (now + past) / 2, FLOOR["acceleration"])
    doubt[1:] |= (swerve > most) & known[1:] & known[:-1]
    doubt[REMEMBERED - 1 :] |= times[REMEMBERED:] == times[:-REMEMBERED]  # a clock may stand
    return np.append(False, doubt)


def judge_run(run: xr.Dataset, limits: MotionLimits | None = None) -> Motion:
    """Judge the poses of a run, see :func:`judge_poses`.

    An aircraft is not judged by the default limits, which are those of a ground vehicle.
    """
    pose = run["pose"].values
    limits = limits or MotionLimits()
    if limits == MotionLimits() and np.median(pose[:, 2]) > _AIRBORNE:
        return Motion(np.ones(len(pose), bool))
    return judge_poses(pose, run["time"].values, limits)


def plausible_run(run: xr.Dataset, limits: MotionLimits | None = None) -> xr.Dataset:
    """Return a run that lacks the sweeps of scans without a plausible pose: they have no image."""
    plausible = judge_run(run, limits).plausible
    if plausible.all():
        return run
    return run.assign(valid=(run["valid"].dims, run["valid"].values & plausible[:, None, None]))
