"""Recordings in MCAP of live runs and of results, for Foxglove and other programs that play them.

The recording of a live run is made of its file of events, so that the same file gives the same
bytes, while it is written or long after.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.commands.exports import Wish
from flgpr.door import Folder
from flgpr.geo import own_anchor, read_anchor
from flgpr.geo.points import STATEMENT
from flgpr.json_text import compact_json, parse_json
from flgpr.live.events import EVENT_FILE, add_places_on_earth
from flgpr.method.detection import MAIN, Detection
from flgpr.method.look_samples import decibels
from flgpr.model import POSE_COMPONENTS
from flgpr.results.result import Result, read_result
from flgpr.store.notes import log_note
from flgpr.store.outputs import atomic_output
from flgpr.types import Entries
from flgpr_exchange.bags import foxglove
from flgpr_exchange.bags.writer import McapWriter, mcap_file
from flgpr_exchange.commands.exporting import (
    alarm_channel,
    channel_levels,
    moment_of,
    named_detection,
    output_of,
)

PathLike = str | Path
TOPICS = {
    "/flgpr/pose": "foxglove.PoseInFrame",
    "/flgpr/transform": "foxglove.FrameTransform",
    "/flgpr/run_view": "foxglove.Grid",
    "/flgpr/run_view_of_lane": "foxglove.Grid",
    "/flgpr/alarms": "foxglove.SceneUpdate",
    "/flgpr/map": "foxglove.GeoJSON",
}
"""Topics of a recording and their schemas."""
_SECOND = 10**9  # ns
_FROM_1970 = ", from 1970 on"
_LATEST = 2**63 // _SECOND  # s since 1970; later times do not fit
_MOST_LINE = 64 * 2**20  # bytes of an event
_MOST_EVENTS = 2**40  # bytes of the file of events
_MOST_CELLS = 2**24  # of the run-view of the lane that is written at the end
_WIDEST = 2**16  # pixels across a run-view
_FARTHEST_ROW = 2**31
_ALARM_MEMBERS = (
    "alarm_id",
    "state",
    "scan",
    "x",
    "y",
    "confidence",
    "magnitude",
    "scans",
    "left_m",
    "in_time",
    "margin_m",
    "p",
    "latitude",
    "longitude",
)
_UNTIMED_SPACING = _SECOND  # from scan to scan of a result, which has no times


def export_recording(wish: Wish) -> Path:
    """Write a recording in MCAP of a live run or of a result; a live run has its own times."""
    target = output_of(wish, "time", "detection")
    is_live = wish.replace or (Path(wish.source) / EVENT_FILE).is_file()
    if not is_live:
        return _record_result(wish, target)
    if wish.anchor is not None or wish.time is not None or wish.detection is not None:
        raise ValueError(
            "anchor, time and detection go with a result; "
            f"{wish.source} is a live run, whose events have times and places"
        )
    with (
        Folder(wish.source).open(EVENT_FILE, _MOST_EVENTS) as events,
        atomic_output(target, replace=wish.replace) as partial,
        mcap_file(partial, TOPICS) as writer,
    ):
        recorder = LiveRecorder(writer)
        while line := events.readline(_MOST_LINE):
            recorder.take_line(line)
        recorder.finish()
    if recorder.left_out:
        log_note(f"{recorder.left_out} lines of {EVENT_FILE} are no events that are known")
    return target


class LiveRecorder:
    """Turns the events of a live run into messages, in their order.

    Every message has the time at which the scan that it comes from arrived.

    Parameters
    ----------
    writer : McapWriter
        Takes the messages.

    Attributes
    ----------
    left_out : int
        Lines that are damaged, and are left out.
    """

    def __init__(self, writer: McapWriter) -> None:
        self._writer = writer
        self.left_out = 0
        self._now = 0  # ns since 1970, of the newest scan
        self._grid: dict[str, float] = {}
        self._rows: dict[int, NDArray[np.float16]] = {}  # of the run-view, by number
        self._median_db = 0.0
        self._on_earth: dict[str, Entries] = {}  # alarms with a place there, by name
        self._scan_alarms: list[Entries] = []  # events of alarms since the last scan
        self._kinds: dict[str, Callable[[Mapping[str, Any]], None]] = {
            "start": self._start,
            "scan": self._scan,
            "view": self._view,
            "alarm": self._alarm,
        }

    def take_line(self, line: bytes) -> None:
        """Take a line of the file of events; what is damaged is counted and left out."""
        if not line.strip():
            return
        try:
            event = parse_json(line)
            take = self._kinds.get(event["event"])
            if take is not None:
                take(event)
        except (ValueError, KeyError, TypeError, OverflowError):
            self.left_out += 1

    def finish(self) -> None:
        """Write the alarms of the last scan, and what stands at the end."""
        self._write_alarms()
        self._write_lane()
        if self._on_earth:
            self._write_map(list(self._on_earth.values()))
        self._writer.describe("flgpr", {"source": "live run", "statement": STATEMENT})

    def _start(self, event: Mapping[str, Any]) -> None:
        """Take the lattice of the run-view; a new one begins where positions have moved to."""
        grid = event["grid"]
        values = {name: float(grid[name]) for name in ("x", "y", "dx", "dy")}
        if not all(map(math.isfinite, values.values())):
            raise ValueError("grid must have finite numbers")
        columns = int(grid["nx"])
        if not 0 < columns <= _WIDEST:
            raise ValueError(f"grid must have 1 to {_WIDEST} columns, got {columns}")
        self._write_lane()
        self._rows = {}
        self._grid = values | {"nx": columns}

    def _scan(self, event: Mapping[str, Any]) -> None:
        """Write the pose of a scan, and first the alarms of the scan before."""
        arrived = float(event["arrived"])
        if not 0 <= arrived < _LATEST:
            raise ValueError(f"arrived must be a time since 1970, got {arrived}")
        self._write_alarms()
        # Files may arrive in another order than their times; a recording is played in one order.
        self._now = max(self._now, _nanoseconds(arrived))
        pose = [float(value) for value in event["pose"]]
        if len(pose) == len(POSE_COMPONENTS) and all(map(math.isfinite, pose)):
            for topic, message in _pose_messages(self._now, pose):
                self._add(topic, message)

    def _view(self, event: Mapping[str, Any]) -> None:
        """Write the rows of the run-view that a scan changed, and keep them."""
        first = int(event["row"])
        count = int(event["rows"])
        if not 0 <= first < _FARTHEST_ROW:
            raise ValueError(f"row must be 0 to {_FARTHEST_ROW}, got {first}")
        data = base64.b64decode(event["halves"], validate=True)
        rows = np.frombuffer(data, "<f2").reshape(count, int(self._grid["nx"]))
        self._median_db = float(event["median_db"])
        if not math.isfinite(self._median_db):
            raise ValueError("median_db must be finite")
        if count:
            self._write_grid("/flgpr/run_view", first, rows)
            self._rows |= dict(enumerate(rows, start=first))

    def _alarm(self, event: Mapping[str, Any]) -> None:
        """Keep an alarm that changed until all of its scan have come."""
        alarm = {name: event[name] for name in _ALARM_MEMBERS if name in event}
        if not isinstance(alarm["alarm_id"], str) or not isinstance(alarm["state"], str):
            raise TypeError("alarm_id and state must be texts")
        alarm |= {name: float(alarm[name]) for name in ("x", "y", "confidence")}
        compact_json(alarm)  # refuses numbers that are not finite
        self._scan_alarms.append(alarm)

    def _write_alarms(self) -> None:
        """Write the alarms that the last scan changed."""
        if not self._scan_alarms:
            return
        changed = []
        withdrawn = []
        for alarm in self._scan_alarms:
            alarm_id = alarm["alarm_id"]
            if alarm["state"] == "withdrawn":
                withdrawn.append(alarm_id)
                self._on_earth.pop(alarm_id, None)
                continue
            changed.append(alarm)
            if "latitude" in alarm and "longitude" in alarm:
                self._on_earth[alarm_id] = alarm
        self._scan_alarms = []
        self._add("/flgpr/alarms", foxglove.alarms_message(self._now, changed, withdrawn))
        if self._on_earth:
            ahead = [alarm for alarm in self._on_earth.values() if alarm["state"] != "final"]
            self._write_map(ahead)

    def _write_map(self, alarms: list[Entries]) -> None:
        """Write alarms as points of a map, in place of those before."""
        self._add("/flgpr/map", foxglove.geojson_message(alarms, STATEMENT))

    def _write_lane(self) -> None:
        """Write the run-view of all ground that was seen, where it is not too large."""
        if not self._rows:
            return
        first = min(self._rows)
        count = max(self._rows) + 1 - first
        columns = int(self._grid["nx"])
        if count * columns > _MOST_CELLS:
            log_note(
                f"the run-view of the lane has {count * columns} pixels, more than {_MOST_CELLS}: "
                "only that of each scan is in the recording"
            )
            return
        rows = np.full((count, columns), np.nan, np.float16)
        for number, row in self._rows.items():
            rows[number - first] = row
        self._write_grid("/flgpr/run_view_of_lane", first, rows)

    def _write_grid(self, topic: str, first: int, rows: NDArray[np.float16]) -> None:
        """Write rows of the run-view, counted from the lane's first."""
        grid = self._grid
        begin = grid["y"] + first * grid["dy"]
        message = foxglove.grid_message(
            self._now, rows, (grid["x"], begin), (grid["dx"], grid["dy"]), self._median_db
        )
        self._add(topic, message)

    def _add(self, topic: str, message: foxglove.Message) -> None:
        """Write a message."""
        self._writer.add(topic, self._now, message)


def _record_result(wish: Wish, target: Path) -> Path:
    """Write a result as a recording in MCAP: run-view, alarms, map, and the poses of the scans.

    A result has no times of its scans: they are put one second apart, the first at the time of the
    data, or in 1970. Without an anchor, its own or another, there is no map.
    """
    begin = 0
    if wish.time is not None:
        seconds = moment_of(wish.time, _FROM_1970).timestamp()
        if seconds < 0:
            raise ValueError(
                f"time must be ISO 8601 with a time zone{_FROM_1970}, got {wish.time!r}"
            )
        begin = _nanoseconds(seconds)
    loaded = read_result(wish.source)
    chosen = named_detection(loaded, wish.detection or MAIN)
    alarms = _alarms_of(loaded, chosen, wish.anchor)
    with atomic_output(target) as partial, mcap_file(partial, TOPICS) as writer:
        for topic, message in _result_messages(loaded, chosen, alarms, begin):
            writer.add(topic, begin, message)
        for number, pose in enumerate(loaded.manifest["run"].get("pose", ())):
            moment = begin + number * _UNTIMED_SPACING
            for topic, message in _pose_messages(moment, pose):
                writer.add(topic, moment, message)
        writer.describe("flgpr", {"source": "result", "statement": STATEMENT})
    return target


def _pose_messages(moment: int, pose: Sequence[float]) -> Iterator[tuple[str, foxglove.Message]]:
    """Yield the messages of a pose at a time, ns: the pose, and the transform it stands for."""
    yield "/flgpr/pose", foxglove.pose_message(moment, pose)
    yield "/flgpr/transform", foxglove.transform_message(moment, pose)


def _nanoseconds(seconds: float) -> int:
    """Return a time in s as ns, of whole ms."""
    return round(seconds * 1000) * (_SECOND // 1000)


def _alarms_of(result: Result, detection: Detection, anchor: PathLike | None) -> list[Entries]:
    """Return the alarms of a detection, with places on the Earth where it is known."""
    alarms = []
    for row in detection.alarms.to_dict("records"):
        places = {name: float(row[name]) for name in ("x", "y", "confidence")}
        alarms.append({"alarm_id": str(row["alarm_id"]), **places})
    reference = result.manifest["run"].get("georeference")
    if anchor is not None:
        add_places_on_earth(alarms, read_anchor(anchor))
    elif reference is not None:
        add_places_on_earth(alarms, own_anchor(reference))
    return alarms


def _result_messages(
    result: Result, detection: Detection, alarms: list[Entries], begin: int
) -> Iterator[tuple[str, foxglove.Message]]:
    """Yield the messages that stand from the beginning: run-view, alarms and map."""
    levels = decibels(channel_levels(detection, alarm_channel(result, detection)))
    # The colours of players are relative to the median of the ground that was seen.
    measured = levels[np.isfinite(levels)]
    median_db = float(np.median(measured.astype(np.float32))) if measured.size else 0.0
    x, y = (detection.view[axis].values for axis in "xy")
    spacing = (float(x[1] - x[0]), float(y[1] - y[0]))
    first = (float(x[0]), float(y[0]))
    grid = foxglove.grid_message(begin, levels, first, spacing, median_db)
    yield "/flgpr/run_view_of_lane", grid
    yield "/flgpr/alarms", foxglove.alarms_message(begin, alarms)
    if alarms and "latitude" in alarms[0]:
        yield "/flgpr/map", foxglove.geojson_message(alarms, STATEMENT)
