"""The journal of a run store that is being written: what it is, and which scans are safely on disk.

It has a line per scan, written after the scan's chunk was flushed. Each line has the digest of its
own text, so that a line that a killed process left half-written is found and dropped.

The record of what a run store was made of, by which the same call knows it again.

It lies in the store and is no part of the run: readers of runs ignore it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flgpr.append_log import AppendLog, LogHeldError
from flgpr.door import MOST_JSON, Folder, refuse_links
from flgpr.json_text import canonical_json, parse_json, sha256
from flgpr.store.run_store import CommittedFiles, read_manifest
from flgpr.types import BoolArray, FloatArray

JOURNAL = "journal.jsonl"
_FORMAT = "flgpr-journal-1"
_DIGEST = re.compile(r"[0-9a-f]{64}")


class WrittenScan(NamedTuple):
    """A scan that is on disk, or waits for others to be written with it."""

    sha256: str  #: digest of its chunk; empty while it waits
    pose: FloatArray  #: (6,): x, y, z, m, and heading, pitch, roll, rad
    time: float  #: s; NaN where unknown
    valid: BoolArray  #: (polarization, pair): whether all tones are finite


class JournalError(ValueError):
    """A journal belongs to another run, or another process holds it.

    The message does not name the folder, which is a temporary one: the writer names its output.
    """


class OtherRunError(JournalError):
    """A journal belongs to another run."""


class Journal:
    """The journal in a folder, held by one process at a time.

    Parameters
    ----------
    folder : Path
        Folder of the unfinished store.
    about : dict
        Description of the run, JSON values.
    resume : bool
        Keep the scans of a journal with the same description; otherwise the journal is emptied.

    Raises
    ------
    FileExistsError
        If the journal is a symbolic link.
    OtherRunError
        If the journal that is to be resumed has another description.
    JournalError
        If another process holds it.
    """

    def __init__(self, folder: Path, about: dict[str, Any], resume: bool) -> None:
        self.path = folder / JOURNAL
        refuse_links(self.path)
        try:
            self._log = AppendLog(self.path)
        except LogHeldError:
            raise JournalError(
                "another process is writing this run: wait until it is done, "
                "or choose another output"
            ) from None
        self.scans: list[WrittenScan] = []
        try:
            self._load(about, resume)
        except BaseException:
            self.close()
            raise

    def append(self, scan: WrittenScan, settled: bool = True) -> None:
        """Add a scan whose chunk is on disk; see :meth:`flgpr.append_log.AppendLog.append`."""
        time = None if math.isnan(scan.time) else scan.time
        self._write(
            {
                "sha256": scan.sha256,
                "pose": scan.pose.tolist(),
                "time": time,
                "valid": scan.valid.tolist(),
            },
            settled,
        )
        self.scans.append(scan)

    def keep(self, count: int) -> None:
        """Drop all scans but the first ``count``."""
        self._log.keep(count + 1)  # the first line is the description
        del self.scans[count:]

    def close(self) -> None:
        """Close the journal, which another process may then hold."""
        self._log.close()

    def _load(self, about: dict[str, Any], resume: bool) -> None:
        """Read the scans of a journal that is resumed, or begin a new one."""
        contents = self._contents() if resume else []
        if not contents or contents[0].get("format") != _FORMAT:
            self._log.keep(0)
            self._write({"format": _FORMAT, "about": about})
            return
        different = difference(contents[0]["about"], parse_json(canonical_json(about)))
        if different:
            raise OtherRunError(f"another unfinished run is there: {different}")
        for content in contents[1:]:
            try:
                time = math.nan if content["time"] is None else float(content["time"])
                pose = np.array(content["pose"], dtype=np.float64)
                valid = np.array(content["valid"], bool)
                self.scans.append(WrittenScan(content["sha256"], pose, time, valid))
            except (KeyError, TypeError, ValueError):  # a complete line, but not of a scan
                break
        self.keep(len(self.scans))

    def _contents(self) -> list[dict[str, Any]]:
        """Return the contents of the lines before the first whose digest does not match."""
        contents = []
        for line in self._log.lines:
            digest, _, text = line.partition(b" ")
            if sha256(text).encode() != digest:
                break
            contents.append(parse_json(text))
        return contents

    def _write(self, value: dict[str, Any], settled: bool = True) -> None:
        """Append a line with its digest."""
        text = canonical_json(value)
        self._log.append(sha256(text).encode() + b" " + text, settled)


def difference(old: dict[str, Any], new: dict[str, Any]) -> str:
    """Return a description of the first entry in which two dicts differ; empty if none does.

    Of an entry in a nested dict only the last name is given: it is the one that a user knows.

    Parameters
    ----------
    old, new : dict
        Descriptions of runs, JSON values.

    Returns
    -------
    str
        What differs, for a message; empty if nothing does.
    """
    for key in sorted({*old, *new}):
        old_entry = old.get(key)
        new_entry = new.get(key)
        if old_entry == new_entry:
            continue
        if isinstance(old_entry, dict) and isinstance(new_entry, dict):
            return difference(old_entry, new_entry)
        if _is_digest(old_entry) or _is_digest(new_entry):
            return f"it has another {key.removesuffix('_sha256')}"
        return f"its {key} is {_short(old_entry)}, this one's {_short(new_entry)}"
    return ""


def _is_digest(value: Any) -> bool:
    """Return whether a value is a SHA-256, which tells a user nothing."""
    return isinstance(value, str) and _DIGEST.fullmatch(value) is not None


def _short(value: Any) -> str:
    """Return a value as text short enough for a message."""
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


MADE_OF = "made-of.json"
"""File that records what a store's scans depend on, by which the same call knows it again."""


class FixedParts(NamedTuple):
    """What all scans of a run share, in the order in which a run is made of it."""

    frequency: FloatArray  #: tones, Hz
    polarization: list[str]  #: labels of the polarizations
    tx_position: FloatArray  #: (pair, 3): positions of the transmitters, m
    rx_position: FloatArray  #: (pair, 3): those of the receivers


def describe_inputs(
    fixed: FixedParts, attrs: dict[str, Any], inputs: dict[str, Any] | None
) -> dict[str, Any]:
    """Return a description of all that the scans of a store depend on.

    Parameters
    ----------
    fixed : FixedParts
        What the scans share.
    attrs : dict
        Attributes of the run.
    inputs : dict or None
        What else the scans depend on, such as digests of files.

    Returns
    -------
    dict
        The description, as JSON holds it.
    """
    return {
        "frequency": sha256(fixed.frequency.tobytes()),
        "polarization": fixed.polarization,
        "tx_position": sha256(fixed.tx_position.tobytes()),
        "rx_position": sha256(fixed.rx_position.tobytes()),
        "attrs": attrs,
        "inputs": inputs or {},
    }


def _read_record(root: Path, manifest: Mapping[str, Any]) -> Any:
    """Return the record of what a store was made of; None if it is of another commit."""
    stored = parse_json(Folder(root).read(MADE_OF, MOST_JSON))
    return stored if stored["commit"] == manifest["sha256"] else None


def read_limits(root: str | Path) -> dict[str, Any]:
    """Return what ends in a store's scans because of how they were made.

    Parameters
    ----------
    root : str or path
        The store.

    Returns
    -------
    dict
        As given to :class:`flgpr.store.RunWriter`; empty where the store does not record it, or records it for
        other scans.
    """
    try:
        stored = _read_record(Path(root), read_manifest(root))
        limits = {} if stored is None else stored["limits"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return limits if isinstance(limits, dict) else {}


def difference_from_stored(root: Path, about: dict[str, Any]) -> str | None:
    """Return the first difference between what a store was made of and ``about``.

    Parameters
    ----------
    root : Path
        The store.
    about : dict
        What :func:`describe_inputs` returned.

    Returns
    -------
    str or None
        The difference, empty if there is none; None if the store is incomplete or does not record
        it.
    """
    try:
        manifest = read_manifest(root)
        stored = _read_record(root, manifest)
        CommittedFiles(root, manifest["files"]).check_sizes()
        if stored is None:
            return None
        return difference(stored["about"], parse_json(canonical_json(about)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
