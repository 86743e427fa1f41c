"""Whether a vehicle can have gone from one pose to the next: limits of motion, and which poses of a track are trusted.

A positioning system that fails gives poses that no vehicle can have reached: a fix at 0 N 0 E, a jump to the next
street, a heading turned round. :class:`PoseGate` judges poses one after the other, live and in a stored run alike.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flgpr.model.arrays import FloatArray
from flgpr.model.bounds import Entries, Largest

REMEMBERED = 8
"""How many trusted poses a gate knows, for scans that come late."""
SHORTEST = 0.1
"""Time to which those of scans are known, s: a burst of stamps is no speed."""
FLOOR = {"speed": 1.0, "climb": 1.5, "turn": 0.5, "tilt": 0.25, "acceleration": 2.0}
"""What positioning itself may be off from scan to scan, m and rad: a smaller step is never too large."""
# times that a pose must agree better with a single one held back than with the trusted ones
_ALONE = 4.0
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
    """How a vehicle can move from scan to scan; the defaults are those of a ground vehicle, on a road or off it."""

    speed: Annotated[float, Field(ge=0.1, le=1000)] = 30.0  #: most, m/s
    #: most, m/s²: how far a pose may lie from where those before lead. It counts only between scans with times
    acceleration: Annotated[float, Field(ge=0.1, le=1000)] = 10.0
    climb: Annotated[float, Field(ge=0.1, le=1000)] = 5.0  #: most, up or down, m/s
    turn: Annotated[float, Field(ge=0.1, le=100)] = (
        3.0  #: most of the heading, rad/s; some vehicles turn on a spot
    )
    tilt: Annotated[float, Field(ge=0.1, le=100)] = 1.0  #: most of pitch and roll, rad/s
    #: time that a scan is taken to last where no times are known, s: a step of 15 m and a turn of 1.5 rad by default
    interval: Annotated[float, Field(ge=1e-3, le=3600)] = 0.5
    pause: Annotated[float, Field(ge=1), Largest(1e9)] = (
        86_400.0  #: longest time between two scans, s
    )
    scans: Annotated[int, Field(ge=1)] = 1000  #: most scans that may be lost in a row
    agree: Annotated[int, Field(ge=2, le=100)] = (
        3  #: poses that agree with one another, from which on they are trusted
    )


@dataclass(frozen=True, eq=False)
class Sighting:
    """Where the vehicle was: number of the scan, time (s, NaN where unknown), pose (6,) in m and rad."""

    number: int
    time: float
    pose: FloatArray


@dataclass(frozen=True)
class Step:
    """The step from scan ``since`` to ``scan`` and the limit that it strains most.

    ``value`` was found where ``most`` is allowed, in ``unit``, within ``seconds`` (None where the times do not tell).
    """

    scan: int
    since: int
    limit: str
    value: float
    most: float
    seconds: float | None = None

    @property
    def strain(self) -> float:
        """The value as a share of what is allowed: above 1 it is not plausible."""
        return self.value / self.most if math.isfinite(self.value) else math.inf

    @property
    def unit(self) -> str:
        """Unit of ``value`` and ``most``."""
        return _UNIT.get(self.limit, "")

    @property
    def words(self) -> str:
        """Tell what is wrong, with the numbers and the entry of ``[motion]``."""
        since = f"scan {self.scan} after scan {self.since}"
        if self.limit == "finite":
            return f"{since}: its pose is not finite"
        if self.limit == "pause":
            went = (
                f"goes back by {-self.value:.6g} s"
                if self.value < 0
                else f"jumps ahead by {self.value:.6g} s"
            )
            return f"clock at {since} {went}" + (
                f", at most {self.most:g} s (pause)" if self.value > 0 else ""
            )
        found = _WORDS[self.limit].format(value=self.value)
        if self.limit == "scans" or self.seconds is None:
            return f"{since}: {found}, at most {self.most:.4g} {self.unit} ({self.limit})"
        found += f" in {self.seconds:.3g} s"
        if self.limit == "acceleration":
            return f"{since}: {found}, at most {self.most:.4g} m ({self.limit})"
        rate = self.value / self.seconds
        most = self.most / self.seconds
        return f"{since}: {found}, {rate:.4g} {self.unit}/s, at most {most:.4g} {self.unit}/s ({self.limit})"

    def as_json(self) -> dict[str, Any]:
        """Give it as JSON values; what is not finite is null."""
        value = self.value if math.isfinite(self.value) else None
        numbers = {"value": value, "most": self.most, "unit": self.unit, "seconds": self.seconds}
        return {"scan": self.scan, "since": self.since, "limit": self.limit} | numbers


def moved(before: ArrayLike, after: ArrayLike) -> dict[str, FloatArray]:
    """Tell how far poses (..., 6) lie apart: across the ground and in height, m, in heading and in attitude, rad."""
    step = np.asarray(after, dtype=np.float64) - np.asarray(before, dtype=np.float64)
    angles = np.abs(np.angle(np.exp(1j * step[..., 3:])))
    return {
        "speed": np.hypot(step[..., 0], step[..., 1]),
        "climb": np.abs(step[..., 2]),
        "turn": angles[..., 0],
        "tilt": angles[..., 1:].max(axis=-1),
    }


def clock_step(limits: MotionLimits, before: Sighting, after: Sighting) -> Step | None:
    """Give the step of the clock if it goes back, or ahead by more than a pause; None if it is in order or unknown."""
    elapsed = after.time - before.time
    forward = elapsed if after.number >= before.number else -elapsed
    if not math.isfinite(elapsed) or 0 <= forward <= limits.pause:
        return None
    return Step(after.number, before.number, "pause", forward, limits.pause)


def step_between(
    limits: MotionLimits, before: Sighting, after: Sighting, earlier: Sequence[Sighting] = ()
) -> Step:
    """Give the step between two poses by the limit that it strains most; above a strain of 1 it is not plausible.

    Scans that are missing in between, and time, widen what is allowed. Without times, or where the clock is out of
    order, every scan is taken to last ``limits.interval``. ``earlier``, poses before ``before``, tell the speed.
    """
    ends = after.number, before.number
    if not np.isfinite(after.pose).all():
        return Step(*ends, "finite", math.nan, 0.0)
    gap = max(abs(after.number - before.number), 1)
    if gap > limits.scans:
        return Step(*ends, "scans", float(gap), float(limits.scans))
    seconds = _elapsed(limits, before, after)
    length = limits.interval * gap if seconds is None else seconds
    steps = []
    for limit, value in moved(before.pose, after.pose).items():
        most = max(getattr(limits, limit) * length, FLOOR[limit])
        steps.append(Step(*ends, limit, float(value), most, seconds))
    worst = max(steps, key=lambda one: one.strain)
    swerve = _swerve(limits, [*earlier, before][-3:], after)
    return worst if swerve is None or worst.strain > min(swerve.strain, 1.0) else swerve


def _swerve(limits: MotionLimits, known: Sequence[Sighting], after: Sighting) -> Step | None:
    """Give how far a pose lies from where those known lead, None where times do not tell a speed.

    Of the speeds between the last three poses the one that leads nearest counts: one pose that is off by a little less
    than is allowed spoils two of them. The speed may change by the acceleration times half of both times.
    """
    steps = []
    for earlier, before in itertools.pairwise(known):
        past = _elapsed(limits, earlier, before)
        seconds = _elapsed(limits, before, after)
        if past is not None and seconds is not None:
            ahead = before.pose[:2] + (before.pose[:2] - earlier.pose[:2]) * (seconds / past)
            most = max(limits.acceleration * seconds * (seconds + past) / 2, FLOOR["acceleration"])
            off = float(np.hypot(*(after.pose[:2] - ahead)))
            steps.append(Step(after.number, before.number, "acceleration", off, most, seconds))
    least = min(steps, key=lambda one: one.strain, default=None)
    return (
        least if least is None or least.strain <= 1 else steps[-1]
    )  # what is told is off the latest way


def _elapsed(limits: MotionLimits, before: Sighting, after: Sighting) -> float | None:
    """Time between two scans, s; None where times do not tell it."""
    elapsed = abs(after.time - before.time)
    if not elapsed > 0 or clock_step(limits, before, after) is not None:
        return None
    return max(elapsed, SHORTEST)


@dataclass(frozen=True)
class Verdict:
    """What became of a pose, and of those held back before it."""

    #: numbers that may be used now, those held back before this scan's, in order
    trusted: list[int] = field(default_factory=list)
    #: numbers that were held back and are left out for good
    dropped: list[int] = field(default_factory=list)
    #: whether this pose is held back; one that is neither trusted nor held is left out
    held: bool = False
    step: Step | None = None  #: why this pose is not plausible
    clock: Step | None = None  #: why its time is not
    anew: bool = False  #: whether what is trusted begins anew, away from all before
    #: numbers trusted before that were never confirmed: the first poses were the wrong ones
    forgotten: list[int] = field(default_factory=list)


class PoseGate:
    """Judges poses one after the other by those trusted before.

    The first is trusted. One that is not plausible is held back. If a later pose is plausible after the trusted ones it
    is left out for good; if ``limits.agree`` poses in a row agree with one another instead, the positions have moved,
    and what is trusted begins anew with them. Where fewer than that were trusted before, these are forgotten: a first
    pose that was wrong is no better than another.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self.trusted: list[Sighting] = []  # the last ones, by number
        self.confirmed: list[
            int
        ] = []  # numbers of the first that were trusted since it began, up to limits.agree
        self.held: dict[int, Sighting] = {}  # by number, as they came
        self._links: dict[
            int, int
        ] = {}  # from a pose held back to the one before that it agrees with

    @property
    def _is_confirmed(self) -> bool:
        return len(self.confirmed) >= self.limits.agree

    def is_settled_at(self, number: int) -> bool:
        """Tell whether a pose of this number is trusted, the latest, and none is held back: others follow it alone."""
        return self._is_confirmed and not self.held and self.trusted[-1].number == number

    def trust(self, sightings: Iterable[Sighting]) -> None:
        """Take in poses that are known to be plausible one after the other."""
        for one in sightings:
            self._trust(one)

    def judge(self, one: Sighting) -> Verdict:
        """Judge a pose: it is trusted, held back or left out, which may settle those held back before."""
        if not np.isfinite(one.pose).all():
            since = self.trusted[-1].number if self.trusted else one.number
            return Verdict(step=Step(one.number, since, "finite", math.nan, 0.0))
        if not self.trusted:
            self._trust(one)
            return Verdict([one.number])
        newest = self.trusted[-1]
        if one.number <= newest.number:
            return self._judge_late(one)
        clock = clock_step(self.limits, newest, one)
        step = step_between(
            self.limits, newest, one, self.trusted[:-1] if self._is_confirmed else ()
        )
        strain, link = self._link(one)
        # Lost scans widen what is allowed after the trusted ones until anything is. A pose that
        # agrees far better with those held back is theirs; one of these alone must do so by much,
        # for it may be a little off the true way.
        alone = link is not None and len(self._chain(link)) == 1
        if step.strain <= 1 and step.strain <= strain * (_ALONE if alone else 1):
            dropped = list(self.held)
            self.held = {}
            self._links = {}
            self._trust(one)
            return Verdict([one.number], dropped, clock=clock)
        dropped = self._hold(one, link)
        chain = self._chain(one.number)
        if len(chain) < self.limits.agree:
            return Verdict([], dropped, True, step, clock)
        dropped += [number for number in self.held if number not in chain]
        forgotten = [] if self._is_confirmed else self.confirmed
        self._begin_with([self.held[number] for number in chain])
        return Verdict(chain, dropped, False, step, clock, True, forgotten)

    def _judge_late(self, one: Sighting) -> Verdict:
        """Judge a scan that comes after a later one, by the trusted pose next to it."""
        nearest = min(self.trusted, key=lambda known: abs(known.number - one.number))
        clock = clock_step(self.limits, nearest, one)
        step = step_between(self.limits, nearest, one)
        if step.strain > 1:
            return Verdict(step=step, clock=clock)
        self._trust(one)
        return Verdict([one.number], clock=clock)

    def _link(self, one: Sighting) -> tuple[float, int | None]:
        """Find the pose held back that a new one agrees with: how much that strains, and its number.

        Of several it is that which most others agree with already.
        """
        best: tuple[float, int | None] = math.inf, None
        longest = 0
        for number, held in self.held.items():
            strain = step_between(self.limits, held, one).strain
            length = len(self._chain(number))
            if number < one.number and strain <= 1 and (length, -strain) > (longest, -best[0]):
                best = (strain, number)
                longest = length
        return best

    def _hold(self, one: Sighting, link: int | None) -> list[int]:
        """Hold a pose back in place of another of its number; give the numbers that make room for it."""
        most = 2 * self.limits.agree
        leaving = [number for number in self.held if number == one.number]
        others = [number for number in self.held if number != one.number]
        leaving += others[: max(len(others) + 1 - most, 0)]
        for number in leaving:
            del self.held[number]
        self._links = {
            after: before
            for after, before in self._links.items()
            if not {after, before} & {*leaving}
        }
        self.held[one.number] = one
        if link is not None:
            self._links[one.number] = link
        return leaving

    def _chain(self, last: int) -> list[int]:
        """List the numbers of the poses held back that agree one with the next up to the last."""
        chain = [last]
        while self._links.get(chain[0]) in self.held:
            chain.insert(0, self._links[chain[0]])
        return chain

    def _begin_with(self, chain: Sequence[Sighting]) -> None:
        self.trusted = []
        self.confirmed = []
        self.held = {}
        self._links = {}
        self.trust(chain)

    def _trust(self, one: Sighting) -> None:
        known = [old for old in self.trusted if old.number != one.number]
        self.trusted = sorted([*known, one], key=lambda old: old.number)[-REMEMBERED:]
        if len(self.confirmed) < self.limits.agree:
            self.confirmed = [*self.confirmed, one.number]

    def state(self) -> dict[str, Any]:
        """Give what JSON can hold of it, for a later :meth:`restore`."""
        return {
            "trusted": [_as_json(one) for one in self.trusted],
            "confirmed": list(self.confirmed),
            "held": [_as_json(one) for one in self.held.values()],
            "links": [list(link) for link in self._links.items()],
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state that :meth:`state` gave."""
        self.trusted = [_from_json(one) for one in state["trusted"]]
        self.confirmed = [int(number) for number in state["confirmed"]]
        self.held = {one.number: one for one in map(_from_json, state["held"])}
        self._links = {int(number): int(before) for number, before in state["links"]}


def _as_json(one: Sighting) -> list[Any]:
    return [one.number, one.time if math.isfinite(one.time) else None, one.pose.tolist()]


def _from_json(one: list[Any]) -> Sighting:
    number, time, pose = one
    return Sighting(
        int(number), math.nan if time is None else float(time), np.asarray(pose, dtype=np.float64)
    )
