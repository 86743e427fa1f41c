"""Snapshots of a live run: all that detection and intake have learnt, in one file that is whole or absent."""

from __future__ import annotations

import os
import sys
import threading
from array import array
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.chain.gathering import CleanedScan
from flgpr.live.detector import LiveAlarm, LiveDetector
from flgpr.live.intake import Intake
from flgpr.store import MAX_MEMORY, Bundle, BundleError, Scan, write_bundle

SNAPSHOT_FILE = "snapshot.bundle"
FORMAT = "flgpr-live-snapshot"
VERSION = 6
_NUMBERS = ("passed", "magnitudes")
_SCALARS = ("closed", "seen_area", "named", "left_out")
Snapshot = tuple[dict[str, Any], dict[str, NDArray[Any]]]


class SnapshotError(ValueError):
    """A snapshot is damaged or belongs to another run, recipe or model."""


def take_snapshot(
    detector: LiveDetector, intake: Intake, names: set[str], fingerprint: str
) -> Snapshot:
    """Gather the state, as JSON values and arrays; later scans do not change what was gathered."""
    arrays = {f"background.{name}": value for name, value in detector.background.state().items()}
    arrays |= {f"view.{name}": value for name, value in detector.view.items()}
    for i, one in enumerate(detector.history):
        arrays |= {
            f"scan{i}.{name}": value
            for name, value in vars(one).items()
            if isinstance(value, np.ndarray)
        }
    arrays |= {f"numbers.{name}": np.array(getattr(detector, name)) for name in _NUMBERS}
    arrays |= {f"held{number}.signal": scan.signal for number, scan in detector.held.items()}
    newest = detector.newest
    scalars = {name: getattr(detector, name) for name in _SCALARS}
    words = {
        "format": FORMAT,
        "version": VERSION,
        "fingerprint": fingerprint,
        "run": detector.description.as_json(),
        "names": sorted(names),
        "intake": intake.state(),
        "gate": detector.gate.state(),
        "held": list(detector.held),
        "history": [one.number for one in detector.history],
        "alarms": [asdict(one) for one in detector.alarms.values()],
        "first_pose": None if detector.first_pose is None else detector.first_pose.tolist(),
        "before": None if detector.before is None else detector.before.tolist(),
        "newest": None if newest is None else [newest[0], newest[1].tolist()],
        "scalars": {name: value if np.isfinite(value) else None for name, value in scalars.items()},
    }
    return words, arrays


def write_snapshot(path: Path, snapshot: Snapshot) -> None:
    """Write a snapshot beside its place and rename it when it is whole."""
    words, arrays = snapshot
    write_bundle(path, arrays, words, lasting=True)


def read_snapshot(path: Path) -> Snapshot | None:
    """Read a snapshot; None if there is none."""
    try:
        bundle = Bundle(path, most=MAX_MEMORY)
        words = bundle.about
        arrays = dict(bundle)
    except FileNotFoundError:
        return None
    except BundleError as error:
        raise SnapshotError(f"{error}; --fresh begins anew") from None
    if (words.get("format"), words.get("version")) != (FORMAT, VERSION):
        raise SnapshotError(
            f"{path}: format must be {FORMAT} version {VERSION}; --fresh begins anew"
        )
    return words, arrays


def restore_snapshot(
    snapshot: Snapshot, detector: LiveDetector, intake: Intake, fingerprint: str
) -> set[str]:
    """Bring a new detector and intake, made alike, to a snapshot's state; give the names of the files read."""
    words, arrays = snapshot
    if words.get("fingerprint") != fingerprint:
        raise SnapshotError(
            "the snapshot belongs to another run, recipe, model or setting; --fresh begins anew"
        )
    try:
        return _restored(words, arrays, detector, intake)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise SnapshotError(
            f"the snapshot does not hold what it must ({error!r}); --fresh begins anew"
        ) from None


def _restored(
    words: dict[str, Any], arrays: dict[str, NDArray[Any]], detector: LiveDetector, intake: Intake
) -> set[str]:
    detector.background.restore(_group(arrays, "background."))
    detector.view = _group(arrays, "view.")
    detector.history = [
        CleanedScan(number, **_group(arrays, f"scan{i}."))
        for i, number in enumerate(words["history"])
    ]
    detector.alarms = {one["alarm_id"]: LiveAlarm(**one) for one in words["alarms"]}
    for name in _NUMBERS:
        setattr(detector, name, array("d", arrays[f"numbers.{name}"].tobytes()))
    first = words["first_pose"]
    newest = words["newest"]
    before = words["before"]
    detector.before = None if before is None else np.asarray(before, dtype=np.float64)
    detector.first_pose = None if first is None else np.asarray(first, dtype=np.float64)
    detector.newest = (
        None if newest is None else (newest[0], np.asarray(newest[1], dtype=np.float64))
    )
    for name in _SCALARS:
        value = words["scalars"][name]
        setattr(detector, name, -np.inf if value is None else value)
    detector.gate.restore(words["gate"])
    poses = detector.gate.held
    detector.held = {
        number: Scan(number, poses[number].time, poses[number].pose, arrays[f"held{number}.signal"])
        for number in map(int, words["held"])
    }
    intake.restore(words["intake"])
    return set(words["names"])


class SnapshotWriter:
    """Writes snapshots in a thread of its own, one at a time; while one is being written others are passed over."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._thread: threading.Thread | None = None
        self._error: BaseException | None = None

    def offer(self, snapshot: Snapshot) -> None:
        """Write a snapshot, unless the last one is still being written."""
        if self._thread is None or not self._thread.is_alive():
            self.raise_error()
            self._thread = threading.Thread(
                target=self._write_aside, args=(snapshot,), name="snapshot"
            )
            self._thread.start()

    def last(self, snapshot: Snapshot) -> None:
        """Write the last snapshot and wait until it is written."""
        if self._thread is not None:
            self._thread.join()
        self._write(snapshot)
        self.raise_error()

    def raise_error(self) -> None:
        """Raise what went wrong in the thread."""
        if self._error is not None:
            raise self._error

    def _write_aside(self, snapshot: Snapshot) -> None:
        if sys.platform == "linux":  # where threads have priorities of their own: scans come first
            with suppress(OSError):  # a service may be forbidden to
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
        self._write(snapshot)

    def _write(self, snapshot: Snapshot) -> None:
        try:
            write_snapshot(self._path, snapshot)
        except OSError as error:
            self._error = error


def _group(arrays: dict[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }
