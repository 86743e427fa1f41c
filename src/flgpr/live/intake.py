"""What a radar in the field gets wrong: scans late, twice, out of order, damaged, without a pose. All are counted."""

from __future__ import annotations

import bisect
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.io import RunDescription, Scan, ScanFileError, decode_frame, scan_of

COUNTS = {
    "received": "frames that came",
    "taken": "scans that entered the run-view",
    "warm_up": "scans from which only the background was learnt",
    "out_of_order": "scans taken after a later one",
    "duplicate": "scans whose number had come before; left out",
    "late": "scans whose ground was passed when they came; left out",
    "still": "scans of a vehicle that had not moved; left out",
    "corrupt": "frames with a wrong checksum, a wrong length or another run's number; left out",
    "masked": "scans with a missing sweep; left out",
    "pose_filled": "scans whose pose was filled in from their neighbours'",
    "pose_missing": "scans without a pose for too long; left out",
    "refused": "scans whose image could not be used; left out",
    "missing": "numbers between the first and the last scan that never came",
    "senders_refused": "senders on the socket that were refused, because as many as may be were connected",
    "senders_ended": "senders on the socket that were ended, because they sent nothing of use for too long",
}
_KNOWN_POSES = 8


class Intake:
    """Decides which scans go on, and counts the others; fills a pose in at most ``longest_gap`` scans away."""

    def __init__(self, description: RunDescription, longest_gap: int = 3) -> None:
        self.description, self._longest = description, longest_gap
        self.counts: dict[str, int] = dict.fromkeys(COUNTS, 0)
        self._seen: list[list[int]] = []  # runs of numbers [first, last], ascending
        self._poses: list[tuple[int, NDArray[np.float64]]] = []

    def admit(self, data: bytes, fault: ScanFileError | None = None) -> Scan | None:
        """Give a frame's scan if it is whole, of this run, with a pose and the first of its number; else count it.

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
        if not self._is_new(scan.number):
            self.counts["duplicate"] += 1
            return None
        whole = bool(np.isfinite(scan.signal).all())
        if scan.pose is not None:
            self._poses = sorted([*self._poses, (scan.number, scan.pose)], key=lambda one: one[0])[-_KNOWN_POSES:]
        if not whole:
            self.counts["masked"] += 1
            return None
        if scan.pose is not None:
            return scan
        pose = self._fill(scan.number)
        self.counts["pose_missing" if pose is None else "pose_filled"] += 1
        return None if pose is None else Scan(scan.number, scan.time, pose, scan.signal)

    def judged(self, number: int, outcome: str, newest: int | None) -> None:
        """Count an admitted scan's outcome, "refused" or as LiveUpdate has it; ``newest`` was taken before it."""
        self.counts[outcome.replace("-", "_")] += 1
        if outcome in ("taken", "warm-up") and newest is not None and number < newest:
            self.counts["out_of_order"] += 1

    def state(self) -> dict[str, Any]:
        """Give what JSON can hold of it, for a later :meth:`restore`."""
        poses = [[number, pose.tolist()] for number, pose in self._poses]
        return {"counts": dict(self.counts), "seen": [list(run) for run in self._seen], "poses": poses}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state that :meth:`state` gave."""
        self.counts = dict.fromkeys(COUNTS, 0) | {name: int(n) for name, n in state["counts"].items()}
        self._seen = [[int(first), int(last)] for first, last in state["seen"]]
        self._poses = [(int(number), np.asarray(pose, dtype=np.float64)) for number, pose in state["poses"]]

    def _is_new(self, number: int) -> bool:
        """Note a number; tell whether it is the first of its kind."""
        at = bisect.bisect_right(self._seen, [number, 2**63])
        if at and number <= self._seen[at - 1][1]:
            return False
        self._seen.insert(at, [number, number])
        for i in (at, at - 1):
            if 0 <= i < len(self._seen) - 1 and self._seen[i][1] + 1 == self._seen[i + 1][0]:
                self._seen[i][1] = self._seen.pop(i + 1)[1]
        self.counts["missing"] = sum(b[0] - a[1] - 1 for a, b in zip(self._seen, self._seen[1:], strict=False))
        return True

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
