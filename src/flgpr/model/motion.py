"""Which poses of a stored run are plausible: judged one after the other as live, and told in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model.arrays import FloatArray
from flgpr.model.plausible import (
    FLOOR,
    REMEMBERED,
    SHORTEST,
    MotionLimits,
    PoseGate,
    Sighting,
    Step,
    moved,
)

if TYPE_CHECKING:
    import xarray as xr

_LISTED = 3  # steps that are told one by one
_AIRBORNE = 100.0  # m above the ground, from where on a run is no vehicle's


@dataclass(frozen=True, eq=False)
class Motion:
    """How plausible a track is: which poses (scan,) are, and what is told of the others."""

    plausible: NDArray[np.bool_]
    steps: list[Step] = field(default_factory=list)  #: of poses that are not plausible
    restarts: list[Step] = field(default_factory=list)  #: after which positions go on elsewhere
    clock: list[Step] = field(default_factory=list)  #: of times that are not plausible
    fits: bool = True  #: False where the limits do not fit the track, so that nothing is left out

    @property
    def left_out(self) -> list[int]:
        """Numbers of the scans whose pose is not plausible."""
        return [int(scan) for scan in np.flatnonzero(~self.plausible)]

    def notes(self) -> list[str]:
        """Tell what is implausible in lines, the first few with their numbers; none if nothing is."""
        lines = []
        count = self.plausible.size
        if not self.fits:
            lines.append(
                f"{len(self.steps)} of {count} scans lie farther from those before than [motion] allows, too many to "
                f"be faults: all are used; set its limits for this vehicle: {some_steps(self.steps)}"
            )
        elif self.left_out:
            lines.append(
                f"{len(self.left_out)} of {count} scans have positions that no vehicle reaches, which "
                f"images leave out: {some_steps(self.steps)}"
            )
        if self.restarts and self.fits:
            lines.append(
                f"positions jump {_times(self.restarts)} and go on from there: {some_steps(self.restarts)}"
            )
        if self.clock:
            lines.append(
                f"the clock jumps {_times(self.clock)}, positions do not: {some_steps(self.clock)}"
            )
        return lines

    def as_json(self) -> dict[str, Any]:
        """Give it as JSON values."""
        told = {"steps": self.steps, "restarts": self.restarts, "clock": self.clock}
        lists = {name: [one.as_json() for one in steps] for name, steps in told.items()}
        return {"scans": self.left_out, "fits": self.fits} | lists


def some_steps(steps: Sequence[Step]) -> str:
    """Tell the first few steps in words, and how many more there are."""
    more = f"; and {len(steps) - _LISTED} more" if len(steps) > _LISTED else ""
    return "; ".join(one.words for one in steps[:_LISTED]) + more


def _times(steps: Sequence[Step]) -> str:
    return "once" if len(steps) == 1 else f"{len(steps)} times"


def judge_poses(
    pose: ArrayLike,
    time: ArrayLike | None = None,
    limits: MotionLimits | None = None,
    number: ArrayLike | None = None,
) -> Motion:
    """Tell which poses (scan, 6) of a track, with times (scan,) or none, are plausible after those before.

    ``number`` (scan,) are the scans' numbers, ascending, by default from 0 on. Where more than half are not plausible,
    or no ``limits.agree`` in a row agree, the limits are those of another vehicle: then all are taken to be plausible,
    ``fits`` is False, and the steps are told.
    """
    limits = limits or MotionLimits()
    poses = np.asarray(pose, dtype=np.float64)
    times = np.full(len(poses), np.nan) if time is None else np.asarray(time, dtype=np.float64)
    if poses.ndim != 2 or poses.shape[1] != 6 or times.shape != (len(poses),):
        raise ValueError(
            f"pose must be (scan, 6) and time (scan,), got {poses.shape} and {times.shape}"
        )
    numbers = np.arange(len(poses)) if number is None else np.asarray(number, dtype=np.int64)
    doubtful = _doubtful(limits, times, poses, numbers)
    if not doubtful.any():
        return Motion(np.ones(len(poses), bool))
    gate = PoseGate(limits)
    trusted = set[int]()
    faults: dict[int, Step] = {}
    restarts = []
    clock = []
    sightings = list(map(Sighting, numbers.tolist(), times.tolist(), poses))
    at = 0
    while at < len(sightings):
        one = sightings[at]
        if at and not doubtful[at] and gate.is_settled_at(sightings[at - 1].number):
            stop = at + int(
                np.argmax(np.append(doubtful[at:], True))
            )  # all until then follow one from the other
            trusted |= set(numbers[at:stop].tolist())
            gate.trust(sightings[max(stop - REMEMBERED, at) : stop])
            at = stop
            continue
        at += 1
        verdict = gate.judge(one)
        trusted = (trusted - set(verdict.forgotten)) | set(verdict.trusted)
        if verdict.clock is not None:
            clock.append(verdict.clock)
        if verdict.step is not None:
            faults[one.number] = verdict.step
        if verdict.anew and not verdict.forgotten:
            restarts.append(faults[verdict.trusted[0]])
        for forgotten in (
            verdict.forgotten
        ):  # the step away from it is that of the first one that others agree with
            faults[forgotten] = faults[verdict.trusted[0]]
    plausible = np.isin(numbers, list(trusted))
    fits = len(gate.confirmed) >= limits.agree and 2 * np.count_nonzero(plausible) > len(poses)
    if not fits:
        return Motion(np.ones(len(poses), bool), list(faults.values()), restarts, clock, False)
    return Motion(plausible, [faults[number] for number in numbers[~plausible]], restarts, clock)


def _doubtful(
    limits: MotionLimits, times: FloatArray, poses: FloatArray, numbers: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell at once which poses may not be plausible after the two before; the gate looks at these one by one."""
    if not np.isfinite(poses).all():
        return np.ones(len(poses), bool)
    gaps = np.diff(numbers)
    elapsed = np.diff(times)
    doubt = (gaps < 1) | (gaps > limits.scans) | (elapsed < 0) | (elapsed > limits.pause)
    known = elapsed > 0
    seconds = np.where(known, np.maximum(elapsed, SHORTEST), limits.interval * gaps)
    for limit, value in moved(poses[:-1], poses[1:]).items():
        doubt |= value > np.maximum(getattr(limits, limit) * seconds, FLOOR[limit])
    step = np.diff(poses[:, :2], axis=0)
    past = seconds[:-1]
    now = seconds[1:]
    off = np.hypot(*(step[1:] - step[:-1] * (now / past)[:, None]).T)
    most = np.maximum(limits.acceleration * now * (now + past) / 2, FLOOR["acceleration"])
    doubt[1:] |= (off > most) & known[1:] & known[:-1]
    return np.append(False, doubt)


def judge_run(run: xr.Dataset, limits: MotionLimits | None = None) -> Motion:
    """Judge the poses of a run; what flies is not judged by the limits of a ground vehicle, the default."""
    pose = run["pose"].values
    limits = limits or MotionLimits()
    if limits == MotionLimits() and np.median(pose[:, 2]) > _AIRBORNE:
        return Motion(np.ones(len(pose), bool))
    return judge_poses(pose, run["time"].values, limits)


def plausible_run(run: xr.Dataset, limits: MotionLimits | None = None) -> xr.Dataset:
    """Mark the sweeps of scans whose pose is not plausible as missing, so that no image is made of them."""
    plausible = judge_run(run, limits).plausible
    if plausible.all():
        return run
    return run.assign(valid=(run["valid"].dims, run["valid"].values & plausible[:, None, None]))
