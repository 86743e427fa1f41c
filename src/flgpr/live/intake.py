"""Decides which frames become scans, and fills in missing poses.

Whether a pose that is there is believed is judged by the gate (``model/plausible.py``) of the
detector (``live/detector.py``), which holds such a scan back or leaves it out. Scans that are late,
repeated, out of order, damaged, without a pose or with a bad one are all counted.
"""

from __future__ import annotations

import bisect
import itertools
import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flgpr.health.findings import Finding, finding
from flgpr.health.judging import Radar
from flgpr.health.streaming import LiveHealth
from flgpr.model.frames import wrapped
from flgpr.model.plausible import MotionLimits, Sighting, step_between
from flgpr.store import RunDescription, Scan, ScanFileError, decode_frame, scan_of
from flgpr.store.scan_file import Frame, pose_fault
from flgpr.types import Entries, FloatArray, floats

NumberedPoses = dict[int, FloatArray]

COUNTS = {
    "received": "frames that came",
    "taken": "scans that entered the run-view",
    "warm_up": "scans from which only the background was learnt",
    "out_of_order": "scans taken after a later one",
    "duplicate": "scans whose number had been taken in before; left out",
    "late": "scans whose ground was passed when they came; left out",
    "still": "scans of a vehicle that had not moved; left out",
    "corrupt": "frames with a wrong checksum, a wrong length or another run's number, "
    "and what has the name of a scan but is no file; left out",
    "masked": "scans with a missing sweep; left out",
    "pose_filled": "scans whose pose was filled in from their neighbours'",
    "pose_missing": "scans without a pose for too long; left out",
    "implausible": "scans with a pose that no vehicle reaches; left out",
    "held": "scans held back at the end, until others agree with their pose",
    "restarts": "times that detection started anew where positions had moved to",
    "clock": "scans whose time is out of order with the scan before; used all the same",
    "without_earlier": "scans that no earlier drive lies near; nothing was subtracted from them",
    "refused": "scans whose image could not be used; left out",
    "missing": "numbers between the first and the last scan that never came",
    "senders_refused": "senders on the socket that were refused, "
    "because as many as may be were connected",
    "senders_ended": "senders on the socket that were ended, "
    "because they sent nothing of use for too long, or began with something else than a frame",
}
_KNOWN_POSES = 8
_FIRST_NUMBERS = 16  # of a series, whose contents are remembered: a radar begins again with them
_RESTARTED = 2  # scans in a row with such a number and another content, from which on it has
_FORGOTTEN = ("taken", "warm_up", "out_of_order", "late", "still", "refused")
"""Counts of scans that detection forgets when it begins anew from nothing."""
_LARGEST = 2**63  # beyond any number of a scan


class Numbers:
    """A set of whole numbers, mostly consecutive, as runs [first, last], ascending."""

    def __init__(self, runs: Iterable[Sequence[int]] = ()) -> None:
        self.runs = [[int(first), int(last)] for first, last in runs]

    def __contains__(self, number: int) -> bool:
        after = self._next_run(number)
        return after > 0 and number <= self.runs[after - 1][1]

    def _next_run(self, number: int) -> int:
        """Return the index of the first run that begins after a number."""
        return bisect.bisect_right(self.runs, [number, _LARGEST])

    def add(self, number: int) -> None:
        """Take in a number."""
        if number in self:
            return
        index = self._next_run(number)
        self.runs.insert(index, [number, number])
        for i in (index, index - 1):
            has_next = 0 <= i < len(self.runs) - 1
            if has_next and self.runs[i][1] + 1 == self.runs[i + 1][0]:
                self.runs[i][1] = self.runs.pop(i + 1)[1]

    def near(self, number: int, most: int) -> bool:
        """Return whether a number lies at most ``most`` outside all of them.

        Always true of an empty set.
        """
        if not self.runs:
            return True
        return self.runs[0][0] - most <= number <= self.runs[-1][1] + most

    def __len__(self) -> int:
        return sum(last - first + 1 for first, last in self.runs)

    @property
    def missing(self) -> int:
        """How many lie between the first and the last and are not among them."""
        return sum(after[0] - before[1] - 1 for before, after in itertools.pairwise(self.runs))


class Intake:
    """Decides which frames become scans, and counts the others.

    A pose that is there is judged by :meth:`flgpr.live.detector.LiveDetector.add`. A missing pose
    is filled in on the line through two known ones, or beyond the last two, where the nearer is at
    most ``longest_gap`` scans away. A number counts as used when
    its scan went on and was not refused: a bad frame uses up no number.
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
        # Those that missing ones are filled in from, ascending.
        self._poses: NumberedPoses = {}
        # the last that came, plausible or not, without those that were filled in
        self._own_poses: NumberedPoses = {}
        #: why the pose in the last frame cannot be one, and what became of its scan; "" if it can,
        #: or if the frame states that it has none
        self.pose_report = ""
        radar = Radar(
            tuple(description.polarization),
            floats(description.frequency),
            floats(description.tx_position),
            floats(description.rx_position),
        )
        self.health = LiveHealth(radar)
        #: what was found with the last frame and not told before
        self.findings: list[Finding] = []
        #: number of the last scan that was looked at
        self.newest = 0
        # What the first scans of this series held, by number as sent; and which came otherwise.
        self._first_contents: dict[int, int] = {}
        self._again: list[int] = []
        # What is added to the numbers of a radar that was started again.
        self._offset = 0

    def admit(self, data: bytes, fault: ScanFileError | None = None) -> Scan | None:
        """Return a frame's scan; None, and a count, if it cannot be used.

        A scan is used if it is complete, of this run, not used before, and has a pose or one can be
        filled in.

        Parameters
        ----------
        data : bytes
            The frame.
        fault : ScanFileError, optional
            What was found to be wrong with the frame before; it is counted and raised.

        Raises
        ------
        ScanFileError
            If the frame is damaged or of another run.
        """
        self.counts["received"] += 1
        self.pose_report = ""
        self.findings = []
        try:
            if fault is not None:
                raise fault
            frame = decode_frame(data)
            scan = scan_of(frame, self.description)
        except ScanFileError:
            self.counts["corrupt"] += 1
            raise
        if np.isfinite(scan.signal).all():  # what lacks values may come again with them
            self._follow_series(scan.number, zlib.adler32(scan.signal.tobytes()))
        scan = replace(scan, number=scan.number + self._offset)
        if scan.number in self._used:
            self.counts["duplicate"] += 1
            return None
        self._record(scan)
        if scan.number == self.newest:  # it comes again, perhaps with its pose: it repeats none
            self.health.sums.gap()
        checked = self.health.take(scan.signal, scan.pose, scan.number == self.newest + 1)
        self.newest = scan.number
        self.findings += checked.findings
        if checked.signal is None:
            self.counts["refused" if checked.repeated else "masked"] += 1
            return None
        scan = replace(scan, signal=checked.signal)
        if scan.pose is not None:
            return scan
        # While scans are held back it is in doubt where the vehicle is.
        pose = None if self.counts["held"] else self._fill(scan.number)
        self._note_pose_fault(scan.number, frame, filled=pose is not None)
        if pose is None:
            self.counts["pose_missing"] += 1
            return None
        self.counts["pose_filled"] += 1
        return replace(scan, pose=pose)

    def _follow_series(self, sent: int, content: int) -> None:
        """Find from the number of a scan whether its radar was started again.

        It then begins with the numbers that it began with before, and other data: its scans are a
        new series, which is counted on.
        """
        known = self._first_contents.get(sent)
        if known is None or known == content:
            self._again = []
            if len(self._first_contents) < _FIRST_NUMBERS and known is None:
                self._first_contents[sent] = content
        else:
            self._again.append(sent)
            last = self._came.runs[-1][1] if self._came.runs else -1
            in_row = self._again[-_RESTARTED:]
            ascending = all(after > before for before, after in itertools.pairwise(in_row))
            if len(in_row) == _RESTARTED and ascending and last - self._offset > sent:
                self._offset = last + 1 - sent
                self._first_contents = {sent: content}
                self._again = []
                done = f"its scans are counted on from {last + 1}"
                self.findings.append(finding("restart", 1.0, str(in_row[0])).acted(done))

    def _note_pose_fault(self, number: int, frame: Frame, *, filled: bool) -> None:
        """Note in words what is wrong with the pose in a frame."""
        fault = pose_fault(frame)
        if fault:
            outcome = "it was filled in from its neighbours'" if filled else "the scan was left out"
            self.pose_report = f"scan {number}: {fault}; {outcome}"

    def lacking(self, stated: int) -> str:
        """Return in words how many of the scans that a sender states at its end never came."""
        came = len(self._came)
        if came >= stated:
            return ""
        return f"the sender states {stated} scans, {came} came: {stated - came} missing"

    def judged(self, number: int, outcome: str, newest: int | None) -> None:
        """Count the outcome of an admitted scan.

        Scans that are held back or implausible are counted by :meth:`settled`.

        Parameters
        ----------
        number : int
            Number of the scan.
        outcome : str
            "refused" or an outcome of ``LiveUpdate``.
        newest : int or None
            Number of the newest scan that was taken before it.
        """
        if outcome in ("held", "implausible"):
            self._poses.pop(number, None)
            return
        self.counts[outcome.replace("-", "_")] += 1
        if outcome == "duplicate":
            return
        if outcome in ("taken", "warm-up") and newest is not None and number < newest:
            self.counts["out_of_order"] += 1
        if not self._used.runs and not self._came.near(number, self._limits.scans):
            # No scan before could be used, and their numbers are not this run's.
            self._came = Numbers()
        if outcome != "refused":
            self._used.add(number)
        self._came.add(number)
        self.counts["missing"] = self._came.missing
        if number in self._own_poses:
            self._poses = _with_pose(self._poses, number, self._own_poses[number])

    def settled(
        self, held: int, left_out: int, anew: bool = False, forgotten: bool = False
    ) -> None:
        """Record how many scans are held back or were left out, and whether detection started anew.

        Parameters
        ----------
        held : int
            Scans that are held back now.
        left_out : int
            Scans left out as implausible in all.
        anew : bool
            Whether detection started anew.
        forgotten : bool
            Whether all scans before were forgotten; then so are their counts and numbers.
        """
        self.counts |= {"held": held, "implausible": left_out}
        if anew:
            self._poses = {}
        if forgotten:
            self.counts |= dict.fromkeys(_FORGOTTEN, 0)
            self._used = Numbers()
            self._came = Numbers()
        elif anew:
            self.counts["restarts"] += 1

    def state(self) -> Entries:
        """Return the state as JSON values, for a later :meth:`restore`."""
        return {
            "counts": dict(self.counts),
            "used": [list(run) for run in self._used.runs],
            "came": [list(run) for run in self._came.runs],
            "poses": _poses_as_json(self._poses),
            "own_poses": _poses_as_json(self._own_poses),
            "first_contents": [list(item) for item in self._first_contents.items()],
            "again": list(self._again),
            "offset": self._offset,
        }

    def restore(self, state: Entries) -> None:
        """Continue from a state that :meth:`state` returned."""
        self.counts = dict.fromkeys(COUNTS, 0)
        for name, count in state["counts"].items():
            self.counts[name] = int(count)
        self._used = Numbers(state["used"])
        self._came = Numbers(state["came"])
        self._poses = _poses_from_json(state["poses"])
        self._own_poses = _poses_from_json(state["own_poses"])
        # A snapshot of a version before has none of these.
        self._first_contents = {int(k): int(v) for k, v in state.get("first_contents", [])}
        self._again = [int(number) for number in state.get("again", [])]
        self._offset = int(state.get("offset", 0))

    def _record(self, scan: Scan) -> None:
        """Record the number of a scan that came, and its pose if others are filled in from it.

        A number far from all before is not recorded: it may be damaged.
        """
        if not self._came.near(scan.number, self._limits.scans):
            return
        self._came.add(scan.number)
        self.counts["missing"] = self._came.missing
        if scan.pose is not None:
            self._own_poses = _with_pose(self._own_poses, scan.number, scan.pose)
            if self._fits_known_poses(scan.number, scan.pose):
                self._poses = _with_pose(self._poses, scan.number, scan.pose)

    def _fits_known_poses(self, number: int, pose: FloatArray) -> bool:
        """Return whether missing poses may be filled in from a pose; from the first they may.

        No scan is held back or left out for this: that is up to the detector's gate.
        """
        if not self._poses:
            return True
        nearest = min(self._poses, key=lambda known: abs(known - number))
        start = Sighting(nearest, math.nan, self._poses[nearest])
        end = Sighting(number, math.nan, pose)
        return step_between(self._limits, start, end).strain <= 1

    def _fill(self, number: int) -> FloatArray | None:
        """Return the pose on the line through two known neighbours, or beyond the last two."""
        numbers = [known for known in self._poses if known != number]
        if len(numbers) < 2:
            return None
        index = min(max(bisect.bisect(numbers, number), 1), len(numbers) - 1)
        first, last = numbers[index - 1 : index + 1]
        gap = min(abs(number - first), abs(number - last))
        if gap > self._longest:
            return None
        share = (number - first) / (last - first)
        step = self._poses[last] - self._poses[first]
        # Angles go the shorter way round, and the heading stays between -π and π.
        step[3:] = wrapped(step[3:])
        pose: FloatArray = self._poses[first] + share * step
        pose[3] = wrapped(pose[3])
        return pose


def _with_pose(poses: NumberedPoses, number: int, pose: FloatArray) -> NumberedPoses:
    """Return poses with that of a number, in place of an older one.

    Only the last few, ascending.
    """
    with_it = poses | {number: pose}
    return {known: with_it[known] for known in sorted(with_it)[-_KNOWN_POSES:]}


def _poses_as_json(poses: NumberedPoses) -> list[list[Any]]:
    """Return numbered poses as JSON values."""
    return [[number, pose.tolist()] for number, pose in poses.items()]


def _poses_from_json(entries: list[list[Any]]) -> NumberedPoses:
    """Return numbered poses from JSON values."""
    return {int(number): floats(pose) for number, pose in entries}
