"""The journal of a run store that is being written: what it is, and which scans are safely on disk.

A line per scan, written after the scan's chunk was flushed, each with the digest of its own text: whatever a killed
process left half-written is seen and dropped.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.append_log import AppendLog, LogHeldError
from flgpr.door import parse_json
from flgpr.store.files import canonical_json, sha256

JOURNAL = "journal.jsonl"
_FORMAT = "flgpr-journal-1"


class WrittenScan(NamedTuple):
    """A scan that is on disk: its chunk's digest, pose, time (NaN where unknown), and which sweeps are finite."""

    sha256: str
    pose: NDArray[np.float64]
    time: float
    valid: NDArray[np.bool_]


class JournalError(ValueError):
    """What was begun is something else, or another process is at it."""


class OtherRunError(JournalError):
    """What was begun is another run."""


class Journal:
    """The journal in a folder, held by one process; a later one must bring the same ``about``, or empty it."""

    def __init__(self, folder: Path, about: dict[str, Any], resume: bool) -> None:
        self.path = folder / JOURNAL
        try:
            self._log = AppendLog(self.path)
        except LogHeldError:
            raise JournalError(
                f"{folder}: another process is writing this run: wait until it is done, or choose another output"
            ) from None
        self.scans: list[WrittenScan] = []
        try:
            self._take_up(about, resume)
        except BaseException:
            self.close()
            raise

    def append(self, scan: WrittenScan) -> None:
        """Add a scan whose chunk is on disk."""
        time = None if math.isnan(scan.time) else scan.time
        self._write(
            {
                "sha256": scan.sha256,
                "pose": scan.pose.tolist(),
                "time": time,
                "valid": scan.valid.tolist(),
            }
        )
        self.scans.append(scan)

    def keep(self, count: int) -> None:
        """Forget all scans but the first ``count``."""
        self._log.keep(count + 1)  # the first line is the description
        del self.scans[count:]

    def close(self) -> None:
        """Let go of the journal."""
        self._log.close()

    def _take_up(self, about: dict[str, Any], resume: bool) -> None:
        contents = self._contents() if resume else []
        if not contents or contents[0].get("format") != _FORMAT:
            self._log.keep(0)
            self._write({"format": _FORMAT, "about": about})
            return
        different = difference(contents[0]["about"], parse_json(canonical_json(about)))
        if different:
            raise OtherRunError(f"{self.path.parent} holds another unfinished run: {different}")
        for content in contents[1:]:
            try:
                self.scans.append(_scan(content))
            except (KeyError, TypeError, ValueError):  # whole, but not what a journal goes on with
                break
        self.keep(len(self.scans))

    def _contents(self) -> list[dict[str, Any]]:
        """Read what the lines hold, up to the first whose digest is not that of its text."""
        contents = []
        for line in self._log.lines:
            digest, _, text = line.partition(b" ")
            if sha256(text).encode() != digest:
                break
            contents.append(parse_json(text))
        return contents

    def _write(self, value: dict[str, Any]) -> None:
        text = canonical_json(value)
        self._log.append(sha256(text).encode() + b" " + text)


def _scan(line: dict[str, Any]) -> WrittenScan:
    time = math.nan if line["time"] is None else float(line["time"])
    return WrittenScan(
        line["sha256"],
        np.array(line["pose"], dtype=np.float64),
        time,
        np.array(line["valid"], bool),
    )


def difference(old: dict[str, Any], new: dict[str, Any], where: str = "") -> str:
    """Tell the first entry in which two descriptions differ; empty if none does."""
    for key in sorted({*old, *new}):
        before = old.get(key)
        now = new.get(key)
        if before != now:
            if isinstance(before, dict) and isinstance(now, dict):
                return difference(before, now, f"{where}{key}.")
            return f"its {where}{key} is {_short(before)}, this one's {_short(now)}"
    return ""


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
