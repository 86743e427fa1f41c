"""The file of live events: one JSON object per line, only ever appended to; all that the viewer knows of a live run."""

from __future__ import annotations

import base64
import contextlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.append_log import write_all
from flgpr.chain.evidence import decibels
from flgpr.door import open_own
from flgpr.live.detector import LiveAlarm, LiveUpdate
from flgpr.live.event_rate import BURST, Event, EventRate
from flgpr.live.vehicle import Vehicle

EVENT_FILE = "live.jsonl"


class EventFile:
    """Appends events, or begins the file anew; a line that an earlier run left unfinished is cut off first.

    Of a flood of faults only some events are written: ``burst`` of a kind, and after them what
    :class:`flgpr.live.event_rate.EventRate` makes of the others.
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
        text = "".join(as_line(event) for event in events)
        write_all(self._file, text.encode())

    def beat(self) -> None:
        """Give the file a new time stamp: whoever shows it sees that detection runs though nothing comes."""
        self._write(self._rate.due())
        with contextlib.suppress(OSError):  # whoever moved the file away does not stop detection
            os.utime(self.path)


def as_line(event: Mapping[str, Any]) -> str:
    """Write an event, JSON values and finite numbers, as a line with its end."""
    return json.dumps(event, separators=(",", ":"), allow_nan=False) + "\n"


def alarm_event(
    alarm: LiveAlarm, scan: int, pose: NDArray[np.float64], vehicle: Vehicle, latency: float
) -> dict[str, Any]:
    """Tell an alarm that ``scan`` raised or changed, ``latency`` s after it arrived; the pose is the newest scan's.

    ``left_m`` was left to the vehicle's front then; ``in_time`` tells whether it can stop, ``margin_m`` by how much.
    """
    left = vehicle.left(alarm.x, alarm.y, pose)
    event: Event = {
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
        event |= {"in_time": margin >= 0, "margin_m": round(margin, 3)}
    return event


def position_events(name: str, update: LiveUpdate) -> list[Event]:
    """Tell that a pose is not plausible ("pose"), or a time ("clock"), with the numbers, of a frame called ``name``."""
    beyond = (
        update.step is not None and update.step.strain > 1
    )  # else it agrees better with those held back
    kinds = [("pose", update.step if beyond else None), ("clock", update.clock)]
    return [
        {"event": "problem", "name": name, "words": step.words, "kind": kind} | step.as_json()
        for kind, step in kinds
        if step is not None
    ]


def anew_event(scan: int, update: LiveUpdate, where: NDArray[np.float64]) -> Event:
    """Tell that detection started anew with ``scan`` and those held back before it, at the pose of the newest.

    ``forgotten`` tells whether all before was given up, because too few poses had agreed on it.
    """
    numbers = [held.number for held, _ in update.released]
    pose = [round(float(value), 4) for value in where]
    return {
        "event": "anew",
        "scan": scan,
        "held": numbers,
        "pose": pose,
        "forgotten": update.forgotten,
    }


def view_event(row: int, view: NDArray[np.float32]) -> Event:
    """Tell rows of the run-view (y, x) over the background as ``halves``: dB, little-endian half floats in base64."""
    skip = max(-row, 0)
    values = decibels(view[skip:])
    seen = values[np.isfinite(values)]
    median = float(np.median(seen.astype(np.float32))) if seen.size else 0.0
    data = base64.b64encode(values.astype("<f2").tobytes()).decode()
    return {
        "event": "view",
        "row": row + skip,
        "rows": len(values),
        "median_db": round(median, 2),
        "halves": data,
    }


def _drop_unfinished(path: Path) -> None:
    with open(path, "r+b", opener=open_own) as file:
        size = file.seek(0, os.SEEK_END)
        end = size
        while end > 0:
            start = max(end - 65536, 0)
            file.seek(start)
            at = file.read(end - start).rfind(b"\n")
            if at >= 0:
                end = start + at + 1
                break
            end = start
        if end < size:
            file.truncate(end)
