"""Snapshots of a live run.

All that detection and intake have learnt, in one file that is complete or absent.
"""

from __future__ import annotations

import os
import sys
import threading
from array import array
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict
from pathlib import Path

import numpy as np

from flgpr.engine import bundle_groups, group_of
from flgpr.json_text import check_format
from flgpr.live.detector import LiveDetector
from flgpr.live.intake import Intake
from flgpr.live.updates import LiveAlarm
from flgpr.method.steps import CleanedImages
from flgpr.store import MAX_MEMORY, Bundle, BundleError, Scan, write_bundle
from flgpr.types import Arrays, Entries, FloatArray, floats

SNAPSHOT_FILE = "snapshot.bundle"
FORMAT = "flgpr-live-snapshot"
VERSION = 6
# Scalars of the detector, by these names in the file.
_SCALARS = ("closed", "left_out")
Snapshot = tuple[Entries, Arrays]


class SnapshotError(ValueError):
    """A snapshot is damaged or belongs to another run, recipe or model."""


def take_snapshot(
    detector: LiveDetector, intake: Intake, names: set[str], fingerprint: str
) -> Snapshot:
    """Return the state as JSON values and arrays; later scans do not change them.

    Parameters
    ----------
    detector : LiveDetector
        The detector.
    intake : Intake
        What counts the scans.
    names : set of str
        Files that were read.
    fingerprint : str
        Digest of the run, recipe, model and settings.

    Returns
    -------
    header, arrays
        The state, as :func:`write_snapshot` takes it.
    """
    newest = None
    if detector.newest is not None:
        newest = [detector.newest[0], detector.newest[1].tolist()]
    scalars: dict[str, float | None] = {
        "named": detector.alarms.count,
        "seen_area": detector.density.final_area,
    }
    for name in _SCALARS:
        value = getattr(detector, name)
        scalars[name] = value if np.isfinite(value) else None
    header: Entries = {
        "format": FORMAT,
        "version": VERSION,
        "fingerprint": fingerprint,
        "run": detector.description.as_json(),
        "names": sorted(names),
        "intake": intake.state(),
        "gate": detector.gate.state(),
        "held": list(detector.held),
        "history": [scan.number for scan in detector.history],
        "alarms": [asdict(alarm) for alarm in detector.alarms.open.values()],
        "first_pose": None if detector.first_pose is None else detector.first_pose.tolist(),
        "before": None if detector.previous_pose is None else detector.previous_pose.tolist(),
        "newest": newest,
        "scalars": scalars,
    }
    header["health"], of_health = intake.health.state()
    # Copies, or such as are never changed in place.
    groups: dict[str, Arrays] = {
        "background": detector.background.state(),
        "view": detector.view,
    }
    for position, scan in enumerate(detector.history):
        of_scan = {
            name: value for name, value in vars(scan).items() if isinstance(value, np.ndarray)
        }
        groups[f"scan{position}"] = of_scan
    groups["numbers"] = {
        "passed": np.array(detector.alarms.passed),
        "magnitudes": np.array(detector.density.magnitudes),
    }
    if detector.ground is not None:
        groups["ground"] = detector.ground.state()
    if detector.earlier is not None:
        groups["earlier"] = detector.earlier.state()
    for number, held_scan in detector.held.items():
        groups[f"held{number}"] = {"signal": held_scan.signal}
    groups["health"] = of_health
    return header, bundle_groups(groups, ".")


def write_snapshot(path: Path, snapshot: Snapshot) -> None:
    """Write a snapshot to a temporary file and rename it when it is complete.

    Parameters
    ----------
    path : Path
        The file; one that exists is replaced.
    snapshot : tuple
        As :func:`take_snapshot` returns it.
    """
    header, arrays = snapshot
    write_bundle(path, arrays, header, lasting=True)


def read_snapshot(path: Path) -> Snapshot | None:
    """Read a snapshot.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    tuple or None
        The snapshot; None if there is no file.

    Raises
    ------
    SnapshotError
        If the file is damaged or of another format.
    """
    try:
        bundle = Bundle(path, most=MAX_MEMORY)
        header = bundle.about
        arrays = dict(bundle)
    except FileNotFoundError:
        return None
    except BundleError as error:
        raise SnapshotError(f"{error}; `fresh` begins anew") from None
    try:
        check_format(header, FORMAT, VERSION)
    except ValueError as error:
        raise SnapshotError(f"{path}: {error}; `fresh` begins anew") from None
    return header, arrays


def restore_snapshot(
    snapshot: Snapshot, detector: LiveDetector, intake: Intake, fingerprint: str
) -> set[str]:
    """Bring a new detector and intake to a snapshot's state; return the files that were read.

    Parameters
    ----------
    snapshot : tuple
        As :func:`take_snapshot` returns it.
    detector : LiveDetector
        New, and of the same run, recipe, model and settings.
    intake : Intake
        New, of the same run.
    fingerprint : str
        Digest of the run, recipe, model and settings.

    Returns
    -------
    set of str
        Names of the files that were read.

    Raises
    ------
    SnapshotError
        If the fingerprint differs or the snapshot is incomplete.
    """
    header, arrays = snapshot
    if header.get("fingerprint") != fingerprint:
        raise SnapshotError(
            "the snapshot belongs to another run, recipe, model or setting; `fresh` begins anew"
        )
    try:
        _restore(header, arrays, detector, intake)
        return set(header["names"])
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise SnapshotError(
            f"the snapshot does not hold what it must ({error!r}); `fresh` begins anew"
        ) from None


def _restore(header: Entries, arrays: Arrays, detector: LiveDetector, intake: Intake) -> None:
    """Set the state of a detector and its intake."""

    def group(name: str) -> Arrays:
        return group_of(arrays, name, ".")

    def pose_of(values: list[float] | None) -> FloatArray | None:
        return None if values is None else floats(values)

    detector.background.restore(group("background"))
    detector.view = group("view")
    if detector.ground is not None:
        detector.ground.restore(group("ground"))
    if detector.earlier is not None:
        detector.earlier.restore(group("earlier"))
    detector.history = []
    for position, number in enumerate(header["history"]):
        detector.history.append(CleanedImages(number, **group(f"scan{position}")))
    detector.alarms.open = {}
    for entries in header["alarms"]:
        alarm = LiveAlarm(**entries)
        detector.alarms.open[alarm.alarm_id] = alarm
    detector.alarms.passed = array("d", arrays["numbers.passed"].tobytes())
    detector.alarms.count = header["scalars"]["named"]
    detector.density.magnitudes = array("d", arrays["numbers.magnitudes"].tobytes())
    detector.density.final_area = float(header["scalars"]["seen_area"])
    detector.previous_pose = pose_of(header["before"])
    detector.first_pose = pose_of(header["first_pose"])
    detector.saw_lane = detector.saw_lane or detector.first_pose is not None
    detector.newest = None
    if header["newest"] is not None:
        number, pose = header["newest"]
        detector.newest = (number, floats(pose))
    for name in _SCALARS:
        value = header["scalars"][name]
        setattr(detector, name, -np.inf if value is None else value)
    detector.gate.restore(header["gate"])
    sightings = detector.gate.held
    detector.held = {}
    for entry in header["held"]:
        number = int(entry)
        sighting = sightings[number]
        signal = arrays[f"held{number}.signal"]
        detector.held[number] = Scan(number, sighting.time, sighting.pose, signal)
    intake.restore(header["intake"])
    if "health" in header:  # a snapshot of a version before has none
        intake.health.restore(header["health"], group("health"))


class SnapshotWriter(AbstractContextManager["SnapshotWriter"]):
    """Writes snapshots in a thread of its own, one at a time; its end waits for the last.

    Those offered meanwhile are skipped. An error is raised at the next call.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pool = ThreadPoolExecutor(1, "snapshot", _work_last)
        self._writing: Future[None] | None = None

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def offer(self, snapshot: Snapshot) -> None:
        """Write a snapshot, unless the last one is still being written."""
        if self._writing is not None:
            if not self._writing.done():
                return
            self._writing.result()
        self._writing = self._pool.submit(write_snapshot, self._path, snapshot)

    def last(self, snapshot: Snapshot) -> None:
        """Write the last snapshot and wait until it is written."""
        self._pool.shutdown()
        write_snapshot(self._path, snapshot)
        if self._writing is not None:
            self._writing.result()


def _work_last() -> None:
    """Give this thread the lowest priority: on Linux threads have their own, and scans come first."""
    if sys.platform == "linux":
        with suppress(OSError):  # a service may be forbidden to
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
