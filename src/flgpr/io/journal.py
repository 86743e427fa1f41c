"""The journal of a run store that is being written: what it is, and which scans are safely on disk.

A line per scan, written after the scan's chunk was flushed, each with the digest of its own text: whatever a killed
process left half-written is seen and dropped.
"""

from __future__ import annotations

import fcntl
import json
import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.io.files import canonical_json, sha256, sync_directory, write_all

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
        self._file = _hold(self.path)
        self.scans: list[WrittenScan] = []
        try:
            self._take_up(about, resume)
        except BaseException:
            self.close()
            raise

    def append(self, scan: WrittenScan) -> None:
        """Add a scan whose chunk is on disk."""
        time = None if math.isnan(scan.time) else scan.time
        line = {"sha256": scan.sha256, "pose": scan.pose.tolist(), "time": time, "valid": scan.valid.tolist()}
        self._write(line)
        self.scans.append(scan)

    def keep(self, count: int) -> None:
        """Forget all scans but the first ``count``."""
        self._file.truncate(self._ends[count])
        os.fsync(self._file.fileno())
        del self.scans[count:], self._ends[count + 1 :]

    def close(self) -> None:
        """Let go of the journal."""
        self._file.close()

    def _take_up(self, about: dict[str, Any], resume: bool) -> None:
        self._file.seek(0)
        texts = self._file.read().split(b"\n")[:-1] if resume else []
        lines = []
        for text in texts:
            digest, _, content = text.partition(b" ")
            if sha256(content).encode() != digest:
                break
            lines.append(json.loads(content))
        if lines and lines[0].get("format") == _FORMAT:
            different = difference(lines[0]["about"], json.loads(canonical_json(about)))
            if different:
                raise OtherRunError(f"{self.path.parent} holds another unfinished run: {different}")
            for line in lines[1:]:
                try:
                    self.scans.append(_scan(line))
                except (KeyError, TypeError, ValueError):  # whole, but not what a journal goes on with
                    break
            self._ends = np.cumsum([len(text) + 1 for text in texts[: len(lines)]]).tolist()
            self.keep(len(self.scans))
            return
        self._file.truncate(0)
        self._ends = []
        self._write({"format": _FORMAT, "about": about})
        sync_directory(self.path.parent)

    def _write(self, value: dict[str, Any]) -> None:
        content = canonical_json(value)
        try:
            write_all(self._file, sha256(content).encode() + b" " + content + b"\n")
            os.fsync(self._file.fileno())
        except BaseException:  # half a line, as of a full disk, would spoil the next one
            self._file.truncate(self._ends[-1] if self._ends else 0)
            raise
        self._ends.append(self._file.seek(0, os.SEEK_END))


def _hold(path: Path) -> BinaryIO:
    """Open and lock the journal of this name; begin again where a writer that commits takes its folder away."""
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            file = path.open("ab+", buffering=0)
        except FileNotFoundError:
            continue
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            raise JournalError(
                f"{path.parent}: another process is writing this run: wait until it is done, or choose another output"
            ) from None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                return file
        file.close()


def _scan(line: dict[str, Any]) -> WrittenScan:
    time = math.nan if line["time"] is None else float(line["time"])
    return WrittenScan(line["sha256"], np.array(line["pose"], dtype=np.float64), time, np.array(line["valid"], bool))


def difference(old: dict[str, Any], new: dict[str, Any], where: str = "") -> str:
    """Tell the first entry in which two descriptions differ; empty if none does."""
    for key in sorted({*old, *new}):
        before, now = old.get(key), new.get(key)
        if before != now:
            if isinstance(before, dict) and isinstance(now, dict):
                return difference(before, now, f"{where}{key}.")
            return f"its {where}{key} is {_short(before)}, this one's {_short(now)}"
    return ""


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
