"""What a radar in the field gets wrong: scans late, twice, out of order, damaged, without a pose. All are counted."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.model.plausible import MotionLimits, Sighting, step_between
from flgpr.store import RunDescription, Scan, ScanFileError, decode_frame, scan_of

COUNTS = {
    "received": "frames that came",
    "taken": "scans that entered the run-view",
    "warm_up": "scans from which only the background was learnt",
    "out_of_order": "scans taken after a later one",
    "duplicate": "scans whose number had been taken in before; left out",
    "late": "scans whose ground was passed when they came; left out",
    "still": "scans of a vehicle that had not moved; left out",
    "corrupt": "frames with a wrong checksum, a wrong length or another run's number; left out",
    "masked": "scans with a missing sweep; left out",
    "pose_filled": "scans whose pose was filled in from their neighbours'",
    "pose_missing": "scans without a pose for too long; left out",
    "implausible": "scans with a pose that no vehicle reaches; left out",
    "held": "scans held back at the end, until others agree with their pose",
    "restarts": "times that detection started anew where positions had moved to",
    "clock": "scans whose time is out of order with the scan before; used all the same",
    "refused": "scans whose image could not be used; left out",
    "missing": "numbers between the first and the last scan that never came",
    "senders_refused": "senders on the socket that were refused, because as many as may be were connected",
    "senders_ended": "senders on the socket that were ended, because they sent nothing of use for too long",
}
_KNOWN_POSES = 8
_FORGOTTEN = ("taken", "warm_up", "out_of_order", "late", "still", "refused")
"""What is counted of scans that detection forgets when it begins anew from nothing."""


class Numbers:
    """A set of whole numbers, mostly consecutive, as runs [first, last], ascending."""

    def __init__(self, runs: Iterable[Sequence[int]] = ()) -> None:
        self.runs = [[int(first), int(last)] for first, last in runs]

    def __contains__(self, number: int) -> bool:
        at = bisect.bisect_right(self.runs, [number, 2**63])
        return at > 0 and number <= self.runs[at - 1][1]

    def add(self, number: int) -> None:
        """Take in a number."""
        if number in self:
            return
        at = bisect.bisect_right(self.runs, [number, 2**63])
        self.runs.insert(at, [number, number])
        for i in (at, at - 1):
            if 0 <= i < len(self.runs) - 1 and self.runs[i][1] + 1 == self.runs[i + 1][0]:
                self.runs[i][1] = self.runs.pop(i + 1)[1]

    def near(self, number: int, most: int) -> bool:
        """Tell whether a number lies at most so far outside all of them; any does where there are none."""
        return not self.runs or self.runs[0][0] - most <= number <= self.runs[-1][1] + most

    @property
    def missing(self) -> int:
        """How many lie between the first and the last and are not among them."""
        return sum(after[0] - before[1] - 1 for before, after in itertools.pairwise(self.runs))


class Intake:
    """Decides which scans go on, and counts the others; fills a pose in at most ``longest_gap`` scans away.

    A number counts as come before when its scan went on and was not refused: a bad frame takes no number away.
    """

    def __init__(
        self, description: RunDescription, longest_gap: int = 3, limits: MotionLimits | None = None
    ) -> None:
        self.description = description
        self._longest = longest_gap
        self._limits = limits or MotionLimits()
        self.counts: dict[str, int] = dict.fromkeys(COUNTS, 0)
        self._used = Numbers()
        self._came = Numbers()
        self._poses: list[
            tuple[int, NDArray[np.float64]]
        ] = []  # those that were plausible, ascending
        self._own_poses: list[
            tuple[int, NDArray[np.float64]]
        ] = []  # all that came last, not those that were filled in

    def admit(self, data: bytes, fault: ScanFileError | None = None) -> Scan | None:
        """Give a frame's scan if it is whole, of this run, with a pose and not come before; else count it.

        A ``fault`` that was found before, or one that is found here, is counted and raised.
        """
        self.counts["received"] += 1
        try:
            if fault is not None:
                raise fault
            scan = scan_of(decode_frame(data), self.description)
        except ScanFileError:
            self.counts["corrupt"] += 1
            raise
        if scan.number in self._used:
            self.counts["duplicate"] += 1
            return None
        self._note(scan)
        if not np.isfinite(scan.signal).all():
            self.counts["masked"] += 1
            return None
        if scan.pose is not None:
            return scan
        pose = (
            None if self.counts["held"] else self._fill(scan.number)
        )  # not while it is in doubt where it is
        self.counts["pose_missing" if pose is None else "pose_filled"] += 1
        return None if pose is None else Scan(scan.number, scan.time, pose, scan.signal)

    def judged(self, number: int, outcome: str, newest: int | None) -> None:
        """Count an admitted scan's outcome, "refused" or as LiveUpdate has it; ``newest`` was taken before it.

        What is held back or implausible is counted by :meth:`settled`.
        """
        if outcome in ("held", "implausible"):
            self._poses = [known for known in self._poses if known[0] != number]
            return
        self.counts[outcome.replace("-", "_")] += 1
        if outcome == "duplicate":
            return
        if outcome in ("taken", "warm-up") and newest is not None and number < newest:
            self.counts["out_of_order"] += 1
        if not self._used.runs and not self._came.near(number, self._limits.scans):
            self._came = (
                Numbers()
            )  # what came before was of no use, and its numbers are not this run's
        if outcome != "refused":
            self._used.add(number)
        self._came.add(number)
        self.counts["missing"] = self._came.missing
        for known, pose in self._own_poses:
            if known == number:
                self._poses = _with_pose(self._poses, number, pose)

    def settled(
        self, held: int, left_out: int, anew: bool = False, forgotten: bool = False
    ) -> None:
        """Note how many scans are held back, how many were left out as implausible in all, and a new beginning.

        Where all before was ``forgotten``, so are its counts and numbers.
        """
        self.counts |= {"held": held, "implausible": left_out}
        if anew:
            self._poses = []
        if forgotten:
            self.counts |= dict.fromkeys(_FORGOTTEN, 0)
            self._used = Numbers()
            self._came = Numbers()
        elif anew:
            self.counts["restarts"] += 1

    def state(self) -> dict[str, Any]:
        """Give what JSON can hold of it, for a later :meth:`restore`."""
        poses = [[number, pose.tolist()] for number, pose in self._poses]
        used, came = ([list(run) for run in numbers.runs] for numbers in (self._used, self._came))
        own_poses = [[number, pose.tolist()] for number, pose in self._own_poses]
        return {
            "counts": dict(self.counts),
            "used": used,
            "came": came,
            "poses": poses,
            "own_poses": own_poses,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state that :meth:`state` gave."""
        self.counts = dict.fromkeys(COUNTS, 0) | {
            name: int(n) for name, n in state["counts"].items()
        }
        self._used = Numbers(state["used"])
        self._came = Numbers(state["came"])
        self._poses, self._own_poses = (
            [(int(number), np.asarray(pose, dtype=np.float64)) for number, pose in state[name]]
            for name in ("poses", "own_poses")
        )

    def _note(self, scan: Scan) -> None:
        """Note the number of a scan that came and its pose, if it is plausible; not where it is far from all before."""
        if not self._came.near(scan.number, self._limits.scans):
            return
        self._came.add(scan.number)
        self.counts["missing"] = self._came.missing
        if scan.pose is not None:
            self._own_poses = _with_pose(self._own_poses, scan.number, scan.pose)
            if self._is_plausible(scan.number, scan.pose):
                self._poses = _with_pose(self._poses, scan.number, scan.pose)

    def _is_plausible(self, number: int, pose: NDArray[np.float64]) -> bool:
        """Tell whether a pose is plausible by the one next to it; the first one is."""
        if not self._poses:
            return True
        known, before = min(self._poses, key=lambda other: abs(other[0] - number))
        ends = Sighting(known, math.nan, before), Sighting(number, math.nan, pose)
        return step_between(self._limits, *ends).strain <= 1

    def _fill(self, number: int) -> NDArray[np.float64] | None:
        """Pose on the straight line through the two known neighbours, or beyond the last two."""
        known = [one for one in self._poses if one[0] != number]
        if len(known) < 2:
            return None
        at = min(max(bisect.bisect([n for n, _ in known], number), 1), len(known) - 1)
        (first, before), (last, after) = known[at - 1], known[at]
        if min(abs(number - first), abs(number - last)) > self._longest:
            return None
        share = (number - first) / (last - first)
        step = after - before
        step[3:] = np.angle(np.exp(1j * step[3:]))
        pose: NDArray[np.float64] = before + share * step
        pose[3] = np.angle(np.exp(1j * pose[3]))
        return pose


def _with_pose(
    poses: list[tuple[int, NDArray[np.float64]]], number: int, pose: NDArray[np.float64]
) -> list[tuple[int, NDArray[np.float64]]]:
    """Take in the pose of a number, in place of an older one; the last few are kept, ascending."""
    others = [known for known in poses if known[0] != number]
    return sorted([*others, (number, pose)], key=lambda known: known[0])[-_KNOWN_POSES:]
