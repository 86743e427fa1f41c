"""The file of live events: one JSON object per line, only ever appended to.

It is all that the viewer knows of a live run.

Limits how many events of faults are written.

Of a flood, one event now and then gives the count.
"""

from __future__ import annotations

import base64
import contextlib
import mmap
import os
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import numpy as np

from flgpr.append_log import write_all
from flgpr.door import open_own
from flgpr.health.findings import STOPPING, Finding
from flgpr.json_text import compact_json
from flgpr.live.event_types import (
    AlarmEvent,
    AnewEvent,
    Event,
    GroundEvent,
    HealthEvent,
    LaneBorders,
    PositionEvent,
    ProblemEvent,
    ScanEvent,
    StartEvent,
    VehicleEntries,
    ViewEvent,
)
from flgpr.live.updates import LiveAlarm, LiveUpdate, SettledOutcome
from flgpr.method.look_samples import decibels
from flgpr.method.unlike import Comparison
from flgpr.model.plausible import MotionStep
from flgpr.model.printable import text_bytes
from flgpr.model.vehicle import Vehicle
from flgpr.types import Entries, Float32Array, FloatArray

if TYPE_CHECKING:
    from flgpr.geo import Anchor
    from flgpr.live.detector import LiveDetector
    from flgpr.store import Scan

BURST = 10  # events of a kind that are written one by one
# s between the summaries of a flood; the page reports a missing radar after 0.75 s
_PERIOD = {"problem": 1.0, "counts": 0.25}
_MOST_KINDS = 32


@dataclass
class _Flood:
    """Events of a kind that came without a pause."""

    last: float  # when the last event came, s
    written: float  # when an event was last written, s
    singly: int = 0  # events written one by one
    left_out: int = 0  # events not written since
    event: Event = field(default_factory=dict)  # the last of these


class EventRate:
    """Lets events through, but of a flood of faults only some.

    ``problem`` by what it says, and ``counts``. The first ``burst`` of a kind are let through.
    After that, one ``problem`` a second gives in ``more`` how many came since, with the words of
    the last, and of ``counts`` the newest is let through four times a second, until none came for
    so long.
    """

    def __init__(self, burst: int = BURST, clock: Callable[[], float] = time.monotonic) -> None:
        self._burst = burst
        self._clock = clock
        self._floods: dict[tuple[str, str], _Flood] = {}

    def admit(self, events: Iterable[Event]) -> list[Event]:
        """Return the events that are written, in order, with the summaries that are due."""
        written = self.due()
        for event in events:
            if event["event"] == "end":
                written += self.rest()
            if event["event"] not in _PERIOD or self._is_single(event):
                written.append(event)
        return written

    def due(self) -> list[Event]:
        """Return the summaries of floods whose time has come."""
        now = self._clock()
        return [
            _summary(flood, now)
            for (kind, _), flood in self._floods.items()
            if flood.event and now - flood.written >= _PERIOD[kind]
        ]

    def rest(self) -> list[Event]:
        """Return the summaries of all that was left out so far."""
        now = self._clock()
        return [_summary(flood, now) for flood in self._floods.values() if flood.event]

    def _is_single(self, event: Event) -> bool:
        """Count the event of a fault; return whether it is written by itself."""
        now = self._clock()
        kind = event["event"]
        # The first three words of a problem without numbers identify its kind.
        problem = re.sub(r"\d[\d,.]*", "0", str(event.get("words", ""))[:200])
        gist = " ".join(problem.split()[:3])
        if (kind, gist) not in self._floods and len(self._floods) >= _MOST_KINDS:
            gist = ""  # one collects all others
        flood = self._floods.setdefault((kind, gist), _Flood(now, now))
        if now - flood.last > _PERIOD[kind] and not flood.left_out:
            flood.singly = 0
        flood.last = now
        if flood.singly < self._burst:
            flood.singly += 1
            flood.written = now
            return True
        flood.left_out += 1
        flood.event = event
        return False


def _summary(flood: _Flood, now: float) -> Event:
    """Return the event for what was left out, and begin to count anew."""
    event, left_out = flood.event, flood.left_out
    flood.written = now
    flood.left_out = 0
    flood.event = {}
    if event["event"] == "counts":
        return event
    noun = "problem" if left_out == 1 else "problems"
    summary = f"{left_out:,} more {noun} like this: {event['words']}"
    return {**event, "more": left_out, "words": summary}


AnyAlarm = TypeVar("AnyAlarm", AlarmEvent, Entries)
"""Event of an alarm, or an alarm of a result."""

EVENT_FILE = "live.jsonl"
_DEGREE_DIGITS = 8  # decimals of a degree: about a millimetre


class EventFile:
    """Appends events to a file, or begins it anew.

    A line that an earlier run left unfinished is cut off first. Of a flood of faults only some
    events are written: ``burst`` of a kind, and after them what
    :class:`flgpr.live.events.EventRate` makes of the others.
    """

    def __init__(self, path: Path, fresh: bool, burst: int = BURST) -> None:
        self.path = path
        self._rate = EventRate(burst)
        if not fresh and path.is_file():
            _drop_unfinished(path)
        self._file = open(path, "wb" if fresh else "ab", buffering=0, opener=open_own)  # noqa: SIM115

    def __enter__(self) -> EventFile:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._write(self._rate.rest())
        finally:
            self._file.close()

    def append(self, events: Iterable[Event]) -> None:
        """Write events in one piece, after what is due of a flood."""
        self._write(self._rate.admit(events))

    def _write(self, events: Iterable[Event]) -> None:
        """Append events to the file in one piece."""
        text = "".join(as_line(event) for event in events)
        write_all(self._file, text_bytes(text))

    def beat(self) -> None:
        """Set a new time stamp on the file: it shows that detection runs though nothing comes."""
        self._write(self._rate.due())
        with contextlib.suppress(OSError):  # whoever moved the file away does not stop detection
            os.utime(self.path)


def as_line(event: Event) -> str:
    """Return an event, JSON values and finite numbers, as a line with its end."""
    return compact_json(event) + "\n"


def alarm_event(
    alarm: LiveAlarm, scan: int, pose: FloatArray, vehicle: Vehicle, latency: float
) -> AlarmEvent:
    """Return the event of an alarm that a scan raised or changed.

    Parameters
    ----------
    alarm : LiveAlarm
        The alarm as it stands.
    scan : int
        Number of the scan.
    pose : (6,) ndarray of float
        Pose of the newest scan, m and rad.
    vehicle : Vehicle
        Speed, brakes and front.
    latency : float
        Time from the arrival of the scan to the event, s.

    Returns
    -------
    dict
        ``left_m`` is the distance left to the vehicle's front then. Where a speed is known,
        ``in_time`` is whether the vehicle can stop before the alarm, and ``margin_m`` by how much.
    """
    left = vehicle.left(alarm.x, alarm.y, pose)
    event: AlarmEvent = {
        "event": "alarm",
        "alarm_id": alarm.alarm_id,
        "state": alarm.state,
        "scan": scan,
        "x": round(alarm.x, 4),
        "y": round(alarm.y, 4),
        "confidence": float(f"{alarm.confidence:.9g}"),
        "magnitude": float(f"{alarm.magnitude:.6g}"),
        "scans": alarm.scans,
        "left_m": round(left, 3),
        "raised_left_m": round(alarm.first_left - vehicle.front, 3),
        "latency_ms": round(1e3 * latency, 1),
    }
    margin = vehicle.margin(left, latency)
    if margin is not None:
        event["in_time"] = margin >= 0
        event["margin_m"] = round(margin, 3)
    return event


def add_places_on_earth(events: Sequence[AnyAlarm], anchor: Anchor) -> None:
    """Add ``latitude`` and ``longitude`` (WGS 84, degrees) to the events of alarms.

    Parameters
    ----------
    events : sequence of dict
        Events of :func:`alarm_event`, or alarms of a result, with x and y on the ground of their
        lane, m.
    anchor : Anchor
        Where the lane lies. All places are found at once, which takes as long as one.
    """
    if not events:
        return
    in_lane = [[event["x"], event["y"], 0.0] for event in events]
    on_earth = anchor.to_geodetic(in_lane)
    for event, (longitude, latitude, _) in zip(events, on_earth, strict=True):
        event["latitude"] = round(float(latitude), _DEGREE_DIGITS)
        event["longitude"] = round(float(longitude), _DEGREE_DIGITS)


def start_event(detector: LiveDetector, georeference: Any, vehicle: Vehicle) -> StartEvent:
    """Return the event that detection starts.

    Parameters
    ----------
    detector : LiveDetector
        The detector, with its recipe, lane and grid, and the run's description.
    georeference : dict or None
        Where the lane lies on Earth.
    vehicle : Vehicle
        What the driver's screen decides by.

    Returns
    -------
    StartEvent
        The event.
    """
    screen = detector.recipe.prescreen
    lane = detector.lane
    stated_vehicle = vehicle.model_dump(exclude={"threshold"})
    stated_vehicle["stopping_distance"] = vehicle.stopping_distance
    event: StartEvent = {
        "event": "start",
        "title": detector.description.title,
        "recipe": detector.recipe.name,
        "lane": None if lane is None else cast("LaneBorders", asdict(lane)),
        "grid": detector.view_grid(),
        "channel": [screen.polarization, screen.subband],
        "georeference": georeference,
        "threshold": vehicle.threshold,
        "vehicle": cast("VehicleEntries", stated_vehicle),
    }
    if detector.earlier is not None:
        event["notes"] = [detector.earlier.stage.changes]
    return event


def scan_event(scan: Scan, outcome: SettledOutcome, arrived: float, latency: float) -> ScanEvent:
    """Return the event of what became of a scan.

    Parameters
    ----------
    scan : Scan
        The scan.
    outcome : str
        What became of it.
    arrived : float
        When it arrived, s since 1970.
    latency : float
        Time from its arrival to the event, s.

    Returns
    -------
    ScanEvent
        The event.
    """
    return {
        "event": "scan",
        "scan": scan.number,
        "pose": [] if scan.pose is None else _rounded(scan.pose),
        "outcome": outcome,
        "arrived": round(arrived, 3),
        "latency_ms": round(1e3 * latency, 1),
    }


def _rounded(pose: FloatArray) -> list[float]:
    """Return a pose to a tenth of a millimetre, and of a milliradian."""
    return [round(float(value), 4) for value in pose]


def problem_event(name: str, words: str) -> ProblemEvent:
    """Return the event that something is wrong with a file or the socket.

    Parameters
    ----------
    name : str
        The file, or the socket.
    words : str
        What is wrong, a sentence.

    Returns
    -------
    ProblemEvent
        The event.
    """
    return {"event": "problem", "name": name, "words": words}


def position_events(name: str, update: LiveUpdate) -> list[PositionEvent]:
    """Return the events of a frame whose pose ("pose") or time ("clock") is not plausible.

    Parameters
    ----------
    name : str
        The frame's file, or the socket.
    update : LiveUpdate
        What became of its scan.

    Returns
    -------
    list of PositionEvent
        The events; none where both are plausible.
    """
    faults: list[tuple[Literal["pose", "clock"], MotionStep]] = []
    # A strain up to 1 is plausible by itself: the pose only agrees better with those held back.
    if update.step is not None and update.step.strain > 1:
        faults.append(("pose", update.step))
    if update.clock is not None:
        faults.append(("clock", update.clock))
    events = []
    for kind, step in faults:
        problem = problem_event(name, step.words)
        event: PositionEvent = {**problem, "kind": kind, **step.as_json()}
        events.append(event)
    return events


def ground_event(scan: int, comparison: Comparison) -> GroundEvent:
    """Return the event that the ground begins to be unlike the training, or is like it again.

    Parameters
    ----------
    scan : int
        Number of the scan.
    comparison : Comparison
        With which the verdict changed.

    Returns
    -------
    GroundEvent
        The event.
    """
    words = comparison.notes() or ["this ground is like the training again: the confidences hold"]
    return {"event": "ground", "scan": scan, "unlike": comparison.unlike, "words": words}


def health_events(name: str, findings: Iterable[Finding], scan: int) -> list[HealthEvent]:
    """Return the events of what is wrong with the radar or its positions.

    Parameters
    ----------
    name : str
        The frame's file, or the socket.
    findings : iterable of Finding
        What was found.
    scan : int
        Number of the scan with which it was found.

    Returns
    -------
    list of HealthEvent
        The events.
    """
    events = []
    for finding in findings:
        entries = finding.as_json()
        entries["finding"] = entries.pop("name")
        entries["words"] = entries.pop("sentence")
        stop = finding.name in STOPPING
        event = {
            "event": "problem",
            "name": name,
            "kind": "health",
            "scan": scan,
            "stop": stop,
            **entries,
        }
        events.append(cast("HealthEvent", event))
    return events


def anew_event(scan: int, update: LiveUpdate, pose: FloatArray) -> AnewEvent:
    """Return the event that detection started anew with a scan and those held back before it.

    Parameters
    ----------
    scan : int
        Number of the scan.
    update : LiveUpdate
        What became of it; ``forgotten`` in the event is whether all before was given up, because
        too few poses agreed on it.
    pose : (6,) ndarray of float
        Pose of the newest scan, m and rad.

    Returns
    -------
    AnewEvent
        The event.
    """
    return {
        "event": "anew",
        "scan": scan,
        "held": [held_scan.number for held_scan, _ in update.released],
        "pose": _rounded(pose),
        "forgotten": update.forgotten,
    }


def view_event(row: int, view: Float32Array) -> ViewEvent:
    """Return the event of rows of the run-view.

    ``halves`` holds dB over the background as little-endian half floats in base64. Rows before the
    lane's first are left out.

    Parameters
    ----------
    row : int
        Number of the first row, from the lane's first.
    view : (y, x) ndarray of float
        The rows, magnitude over background.

    Returns
    -------
    ViewEvent
        The event.
    """
    skip = max(-row, 0)
    values = decibels(view[skip:])
    finite = values[np.isfinite(values)]
    median = float(np.median(finite.astype(np.float32))) if finite.size else 0.0
    data = base64.b64encode(values.astype("<f2").tobytes()).decode()
    return {
        "event": "view",
        "row": row + skip,
        "rows": len(values),
        "median_db": round(median, 2),
        "halves": data,
    }


def _drop_unfinished(path: Path) -> None:
    """Cut a file off after the end of its last whole line."""
    with open(path, "r+b", opener=open_own) as file:
        if not file.seek(0, os.SEEK_END):
            return  # an empty file cannot be mapped
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            end = content.rfind(b"\n") + 1
        file.truncate(end)
