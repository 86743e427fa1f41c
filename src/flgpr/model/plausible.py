"""Limits of a vehicle's motion, and which poses of a track are trusted.

A positioning system that fails gives poses that no vehicle can have reached: a fix at 0 N 0 E, a
jump to the next street, a reversed heading. :class:`PoseGate` judges poses one after the other,
live and in a stored run alike.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from pydantic import Field
from typing_extensions import TypedDict

from flgpr.model.bounds import AtLeastOne, Entries, Largest
from flgpr.model.frames import wrapped
from flgpr.types import ArrayLike, FloatArray, floats

REMEMBERED = 8
"""Number of trusted poses that a gate remembers, for scans that come late."""
SHORTEST = 0.1
"""Shortest time between scans that makes a speed, s: a burst of stamps does not."""
FLOOR = {"speed": 1.0, "climb": 1.5, "turn": 0.5, "tilt": 0.25, "acceleration": 2.0}
"""Error of positioning itself from scan to scan, m and rad: a smaller step is always plausible."""
# A pose must agree by so much better with a single one held back than with the trusted ones.
_SINGLE_FACTOR = 4.0
_UNIT = {
    "speed": "m",
    "climb": "m",
    "turn": "rad",
    "tilt": "rad",
    "acceleration": "m",
    "pause": "s",
    "scans": "scans",
}
_WORDS = {
    "speed": "{value:.4g} m away",
    "climb": "{value:.4g} m higher or lower",
    "turn": "turned by {value:.3g} rad",
    "tilt": "pitch or roll {value:.3g} rad apart",
    "acceleration": "{value:.4g} m from where its speed takes it",
    "scans": "its number {value:.0f} after it",
}


class MotionLimits(Entries):
    """Limits of a vehicle's motion from scan to scan; by default those of a ground vehicle."""

    speed: Annotated[float, Field(ge=0.1, le=1000)] = 30.0  #: most, m/s
    #: most, m/s²: how far a pose may lie from where those before lead. It counts only between scans
    #: with times
    acceleration: Annotated[float, Field(ge=0.1, le=1000)] = 10.0
    climb: Annotated[float, Field(ge=0.1, le=1000)] = 5.0  #: most, up or down, m/s
    #: most of the heading, rad/s; some vehicles turn on a spot
    turn: Annotated[float, Field(ge=0.1, le=100)] = 3.0
    tilt: Annotated[float, Field(ge=0.1, le=100)] = 1.0  #: most of pitch and roll, rad/s
    #: duration of a scan where no times are known, s: a step of 15 m and a turn of 1.5 rad by
    #: default
    interval: Annotated[float, Field(ge=1e-3, le=3600)] = 0.5
    #: longest time between two scans, s
    pause: Annotated[float, Field(ge=1), Largest(1e9)] = 86_400.0
    scans: AtLeastOne = 1000  #: most scans that may be lost in a row
    #: number of poses that agree with one another, from which on they are trusted
    agree: Annotated[int, Field(ge=2, le=100)] = 3


@dataclass(frozen=True, eq=False)
class Sighting:
    """A pose of the vehicle in a scan."""

    number: int  #: of the scan
    time: float  #: s, NaN where unknown
    pose: FloatArray  #: (6,), m and rad


class StepEntries(TypedDict):
    """A :class:`MotionStep` as JSON values."""

    scan: int  #: scan after the step
    since: int  #: scan before the step
    limit: str  #: name of the limit
    value: float | None  #: value of the step, in ``unit``; null where it is not finite
    most: float  #: largest value that the limit allows, in ``unit``
    unit: str  #: m, rad, s or scans
    seconds: float | None  #: duration of the step; null where times do not tell it


@dataclass(frozen=True)
class MotionStep:
    """The step between two scans, and the limit that it strains most."""

    scan: int  #: scan after the step
    since: int  #: scan before the step
    limit: str  #: name of the limit
    value: float  #: value of the step, in ``unit``
    most: float  #: largest value that the limit allows, in ``unit``
    seconds: float | None = None  #: duration of the step; None where times do not tell it

    @property
    def strain(self) -> float:
        """Value over the largest one allowed: above 1 it is not plausible."""
        return self.value / self.most if math.isfinite(self.value) else math.inf

    @property
    def unit(self) -> str:
        """Unit of ``value`` and ``most``."""
        return _UNIT.get(self.limit, "")

    @property
    def words(self) -> str:
        """What is wrong, with the numbers and the entry of ``[motion]``."""
        scans = f"scan {self.scan} after scan {self.since}"
        if self.limit == "finite":
            return f"{scans}: its pose is not finite"
        if self.limit == "pause":
            if self.value < 0:
                return f"clock at {scans} goes back by {-self.value:.6g} s"
            if self.value == 0:
                return f"clock at {scans} stands still: no speed is known"
            jump = f"clock at {scans} jumps ahead by {self.value:.6g} s"
            return f"{jump}, at most {self.most:g} s (pause)" if self.value > 0 else jump
        text = f"{scans}: {_WORDS[self.limit].format(value=self.value)}"
        if self.limit == "scans" or self.seconds is None:
            return f"{text}, at most {self.most:.4g} {self.unit} ({self.limit})"
        text += f" in {self.seconds:.3g} s"
        if self.limit == "acceleration":
            return f"{text}, at most {self.most:.4g} m ({self.limit})"
        rate = self.value / self.seconds
        most = self.most / self.seconds
        unit = f"{self.unit}/s"
        return f"{text}, {rate:.4g} {unit}, at most {most:.4g} {unit} ({self.limit})"

    def as_json(self) -> StepEntries:
        """Return it as JSON values; what is not finite is null."""
        return {
            "scan": self.scan,
            "since": self.since,
            "limit": self.limit,
            "value": self.value if math.isfinite(self.value) else None,
            "most": self.most,
            "unit": self.unit,
            "seconds": self.seconds,
        }


def moved(before: ArrayLike, after: ArrayLike) -> dict[str, FloatArray]:
    """Return the steps between poses (..., 6) by the limit that applies.

    They are across the ground and in height, m, in heading and in attitude, rad.
    """
    step = floats(after) - floats(before)
    angles = np.abs(wrapped(step[..., 3:]))
    return {
        "speed": np.hypot(step[..., 0], step[..., 1]),
        "climb": np.abs(step[..., 2]),
        "turn": angles[..., 0],
        "tilt": angles[..., 1:].max(axis=-1),
    }


def clock_step(limits: MotionLimits, before: Sighting, after: Sighting) -> MotionStep | None:
    """Return the step of a clock that goes back, or ahead by more than a pause.

    It is None if the clock is in order or unknown.
    """
    elapsed = after.time - before.time
    forward = elapsed if after.number >= before.number else -elapsed
    if not math.isfinite(elapsed) or 0 <= forward <= limits.pause:
        return None
    return MotionStep(after.number, before.number, "pause", forward, limits.pause)


def step_between(
    limits: MotionLimits, before: Sighting, after: Sighting, earlier: Sequence[Sighting] = ()
) -> MotionStep:
    """Return the step between two poses by the limit that it strains most.

    Above a strain of 1 it is not plausible. Missing scans in between, and time, widen what is
    allowed. Without times, or where the clock is out of order, every scan is taken to last
    ``limits.interval``.

    Parameters
    ----------
    limits : MotionLimits
        Limits of the vehicle.
    before, after : Sighting
        The two poses.
    earlier : sequence of Sighting
        Poses before ``before``, which tell the speed.

    Returns
    -------
    MotionStep
        The step.
    """
    scan = after.number
    since = before.number
    if not np.isfinite(after.pose).all():
        return MotionStep(scan, since, "finite", math.nan, 0.0)
    gap = max(abs(scan - since), 1)
    if gap > limits.scans:
        return MotionStep(scan, since, "scans", float(gap), float(limits.scans))
    seconds = _elapsed(limits, before, after)
    duration = limits.interval * gap if seconds is None else seconds
    steps = []
    for limit, value in moved(before.pose, after.pose).items():
        most = max(getattr(limits, limit) * duration, FLOOR[limit])
        steps.append(MotionStep(scan, since, limit, float(value), most, seconds))
    worst = max(steps, key=lambda step: step.strain)
    swerve = _swerve(limits, [*earlier, before][-3:], after)
    if swerve is None or worst.strain > min(swerve.strain, 1.0):
        return worst
    return swerve


def _swerve(limits: MotionLimits, known: Sequence[Sighting], after: Sighting) -> MotionStep | None:
    """Return how far a pose lies from where those known lead; None where times do not tell a speed.

    Of the speeds between the last three poses the one that leads nearest counts: a pose that is off
    by a little less than is allowed spoils two of them. The speed may change by the acceleration
    times half of both times.
    """
    steps = []
    for earlier, before in itertools.pairwise(known):
        past = _elapsed(limits, earlier, before)
        seconds = _elapsed(limits, before, after)
        if past is not None and seconds is not None:
            ahead = before.pose[:2] + (before.pose[:2] - earlier.pose[:2]) * (seconds / past)
            most = max(limits.acceleration * seconds * (seconds + past) / 2, FLOOR["acceleration"])
            distance = float(np.hypot(*(after.pose[:2] - ahead)))
            steps.append(
                MotionStep(after.number, before.number, "acceleration", distance, most, seconds)
            )
    if not steps:
        return None
    least = min(steps, key=lambda step: step.strain)
    # A message is about the latest speed.
    return least if least.strain <= 1 else steps[-1]


def _elapsed(limits: MotionLimits, before: Sighting, after: Sighting) -> float | None:
    """Return the time between two scans, s; None where times do not tell it."""
    elapsed = abs(after.time - before.time)
    if not elapsed > 0 or clock_step(limits, before, after) is not None:
        return None
    return max(elapsed, SHORTEST)


@dataclass(frozen=True)
class Verdict:
    """Verdict on a pose, and on those held back before it."""

    #: numbers that may be used now, those held back before this scan's, in order
    trusted: list[int] = field(default_factory=list)
    #: numbers that were held back and are left out for good
    dropped: list[int] = field(default_factory=list)
    #: whether this pose is held back; one that is neither trusted nor held is left out
    held: bool = False
    step: MotionStep | None = None  #: why this pose is not plausible
    clock: MotionStep | None = None  #: why its time is not
    anew: bool = False  #: whether what is trusted begins anew, away from all before
    #: numbers trusted before that were never confirmed: the first poses were the wrong ones
    forgotten: list[int] = field(default_factory=list)


class PoseGate:
    """Judge poses one after the other by those trusted before.

    The first is trusted. One that is not plausible is held back. If a later pose is plausible after
    the trusted ones it is left out for good; if ``limits.agree`` poses in a row agree with one
    another instead, the positions have moved, and what is trusted begins anew with them. If fewer
    than that were trusted before, these are forgotten: a first pose that was wrong is no better
    than another.

    Parameters
    ----------
    limits : MotionLimits
        Limits of the vehicle.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self.trusted: list[Sighting] = []  # the last ones, by number
        # Numbers of the first that were trusted since it began, up to limits.agree.
        self.confirmed: list[int] = []
        self.held: dict[int, Sighting] = {}  # by number, as they came
        # From a pose held back to the one before that it agrees with.
        self._links: dict[int, int] = {}
        self._stood = False  # whether the clock did, which is told once

    @property
    def _is_confirmed(self) -> bool:
        return len(self.confirmed) >= self.limits.agree

    def is_settled_at(self, number: int) -> bool:
        """Whether the latest trusted pose has this number, and none is held back.

        Those after it then follow from it alone.
        """
        return self._is_confirmed and not self.held and self.trusted[-1].number == number

    def trust(self, sightings: Iterable[Sighting]) -> None:
        """Add poses that are known to be plausible one after the other."""
        for sighting in sightings:
            self._trust(sighting)

    def judge(self, sighting: Sighting) -> Verdict:
        """Judge a pose, which may settle those held back before.

        Parameters
        ----------
        sighting : Sighting
            The pose.

        Returns
        -------
        Verdict
            Whether it is trusted, held back or left out.
        """
        number = sighting.number
        if not np.isfinite(sighting.pose).all():
            since = self.trusted[-1].number if self.trusted else number
            return Verdict(step=MotionStep(number, since, "finite", math.nan, 0.0))
        if not self.trusted:
            self._trust(sighting)
            return Verdict([number])
        newest = self.trusted[-1]
        if number <= newest.number:
            return self._judge_late(sighting)
        clock = clock_step(self.limits, newest, sighting) or self._standing_clock(sighting)
        earlier = self.trusted[:-1] if self._is_confirmed else ()
        step = step_between(self.limits, newest, sighting, earlier)
        strain, link = self._link(sighting)
        # Lost scans widen what is allowed after the trusted ones until anything is. A pose that
        # agrees far better with those held back belongs to them; with a single one it must agree
        # by much, for that one may be a little off the true track.
        is_single = link is not None and len(self._chain(link)) == 1
        if step.strain <= 1 and step.strain <= strain * (_SINGLE_FACTOR if is_single else 1):
            dropped = list(self.held)
            self.held = {}
            self._links = {}
            self._trust(sighting)
            return Verdict([number], dropped, clock=clock)
        dropped = self._hold(sighting, link)
        chain = self._chain(number)
        if len(chain) < self.limits.agree:
            return Verdict([], dropped, True, step, clock)
        dropped += [earlier for earlier in self.held if earlier not in chain]
        forgotten = [] if self._is_confirmed else self.confirmed
        self._begin_with([self.held[member] for member in chain])
        return Verdict(chain, dropped, False, step, clock, True, forgotten)

    def _standing_clock(self, sighting: Sighting) -> MotionStep | None:
        """Return the step of a clock that stood still over all that is remembered of a drive."""
        since = self.trusted[0]
        stands = all(known.time == sighting.time for known in self.trusted)
        way = float(moved(since.pose, sighting.pose)["speed"])
        if self._stood or len(self.trusted) < REMEMBERED or not stands or way < FLOOR["speed"]:
            return None
        self._stood = True
        return MotionStep(sighting.number, since.number, "pause", 0.0, self.limits.pause)

    def _judge_late(self, sighting: Sighting) -> Verdict:
        """Judge a scan that comes after a later one, by the trusted pose next to it."""
        nearest = min(self.trusted, key=lambda known: abs(known.number - sighting.number))
        clock = clock_step(self.limits, nearest, sighting)
        step = step_between(self.limits, nearest, sighting)
        if step.strain > 1:
            return Verdict(step=step, clock=clock)
        self._trust(sighting)
        return Verdict([sighting.number], clock=clock)

    def _link(self, sighting: Sighting) -> tuple[float, int | None]:
        """Return the strain and the number of the pose held back that a new one agrees with.

        Of several it is the one with which most others agree already.
        """
        least_strain = math.inf
        best = None
        longest = 0
        for number, held_pose in self.held.items():
            strain = step_between(self.limits, held_pose, sighting).strain
            length = len(self._chain(number))
            if number >= sighting.number or not strain <= 1:
                continue
            if (length, -strain) > (longest, -least_strain):
                least_strain = strain
                best = number
                longest = length
        return least_strain, best

    def _hold(self, sighting: Sighting, link: int | None) -> list[int]:
        """Hold a pose back instead of another of its number; return the dropped numbers."""
        most = 2 * self.limits.agree
        leaving = [number for number in self.held if number == sighting.number]
        remaining = [number for number in self.held if number != sighting.number]
        leaving += remaining[: max(len(remaining) + 1 - most, 0)]
        for number in leaving:
            del self.held[number]
        for after, before in list(self._links.items()):
            if after in leaving or before in leaving:
                del self._links[after]
        self.held[sighting.number] = sighting
        if link is not None:
            self._links[sighting.number] = link
        return leaving

    def _chain(self, last: int) -> list[int]:
        """Return the numbers of the poses held back that agree in a row up to the last."""
        chain = [last]
        while self._links.get(chain[0]) in self.held:
            chain.insert(0, self._links[chain[0]])
        return chain

    def _begin_with(self, chain: Sequence[Sighting]) -> None:
        """Trust poses that agree, and forget all others."""
        self.trusted = []
        self.confirmed = []
        self.held = {}
        self._links = {}
        self.trust(chain)

    def _trust(self, sighting: Sighting) -> None:
        """Add a pose to the trusted ones, instead of another of its number."""
        known = [old for old in self.trusted if old.number != sighting.number]
        self.trusted = sorted([*known, sighting], key=lambda old: old.number)[-REMEMBERED:]
        if len(self.confirmed) < self.limits.agree:
            self.confirmed = [*self.confirmed, sighting.number]

    def state(self) -> dict[str, Any]:
        """Return the state as JSON values, for a later :meth:`restore`."""
        return {
            "trusted": [_as_json(sighting) for sighting in self.trusted],
            "confirmed": list(self.confirmed),
            "held": [_as_json(sighting) for sighting in self.held.values()],
            "links": [list(link) for link in self._links.items()],
            "stood": self._stood,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a :meth:`state`."""
        held_back = [_from_json(values) for values in state["held"]]
        self.trusted = [_from_json(values) for values in state["trusted"]]
        self.confirmed = [int(number) for number in state["confirmed"]]
        self.held = {sighting.number: sighting for sighting in held_back}
        self._links = {int(number): int(before) for number, before in state["links"]}
        self._stood = bool(state.get("stood"))  # a snapshot of a version before has none


def _as_json(sighting: Sighting) -> list[Any]:
    """Return number, time and pose as JSON values."""
    time = sighting.time if math.isfinite(sighting.time) else None
    return [sighting.number, time, sighting.pose.tolist()]


def _from_json(values: list[Any]) -> Sighting:
    """Return the sighting of number, time and pose."""
    number, time, pose = values
    seconds = math.nan if time is None else float(time)
    return Sighting(int(number), seconds, floats(pose))
