"""Plays the recorded events of a live detection again, at the radar's pace.

Nothing is detected: places, probabilities and the times that detection took are those of the
recording; only the clock is that of today.
"""

from __future__ import annotations

import gzip
import io
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from flgpr.budget import Budget
from flgpr.door import check_expansion, read_named
from flgpr.json_text import count_values, parse_json
from flgpr.live.event_types import Event
from flgpr.live.events import EVENT_FILE, EventFile
from flgpr.types import Entries, PathLike

_BEAT = 0.1  # s between signs of life while nothing comes, as in live detection


@dataclass
class RecordedScan:
    """A scan, the time that its alarms took (s), and the events of both."""

    latency: float
    events: list[Event] = field(default_factory=list)


def read_recording(path: PathLike) -> tuple[list[Event], list[RecordedScan], list[Event]]:
    """Return the events of a recording: those before the first scan, of each scan, and of the end.

    Parameters
    ----------
    path : path
        Lines of JSON, compressed by gzip.

    Returns
    -------
    before, scans, end
        Events before the first scan, those of each scan with its latency, and those of the end.

    Raises
    ------
    ValueError
        If the file would expand too far or holds no scans.
    """
    packed = read_named(path)
    # The last four bytes of a gzip file are the size of what it holds, or of the last part of it.
    most = int.from_bytes(packed[-4:], "little")
    check_expansion(str(path), most, len(packed))
    with gzip.GzipFile(fileobj=io.BytesIO(packed)) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"{path} must unpack to the {most} bytes that it states, got more")
    budget = Budget(str(path))
    budget.spend_values(count_values(data) + data.count(b"\n"))
    lines = data.decode("utf-8").splitlines()
    before: list[Event] = []
    scans: list[RecordedScan] = []
    after: list[Event] = []
    for line in lines:
        event: Entries = parse_json(line)
        if event["event"] == "scan":
            scans.append(RecordedScan(float(event["latency_ms"]) / 1e3))
        if event["event"] == "end":
            after.append(event)
        elif scans:
            scans[-1].events.append(event)
        else:
            before.append(event)
    if not scans:
        raise ValueError(f"recording must hold scans, got {path} without any")
    return before, scans, after


def play_recording(
    path: PathLike,
    folder: PathLike,
    rate: float = 4.2,
    wait: Callable[[float], bool] | None = None,
) -> int:
    """Write the events of a recording as live detection would, and return the number of scans.

    Parameters
    ----------
    path : path
        The recording, see :func:`read_recording`.
    folder : path
        Folder for the file of events, which is begun anew; it is made if need be.
    rate : float
        Scans per second.
    wait : callable, optional
        Waits for so many seconds, and returns whether to stop; by default it sleeps.

    Returns
    -------
    int
        The number of scans.

    Raises
    ------
    ValueError
        If the rate is not positive or the recording cannot be read.
    """
    if not rate > 0:
        raise ValueError(f"rate must be positive, got {rate}")
    wait = wait or _sleep
    before, scans, after = read_recording(path)
    Path(folder).mkdir(parents=True, exist_ok=True)
    begin = time.time()
    with EventFile(Path(folder) / EVENT_FILE, fresh=True) as file:
        file.append(before)
        for number, scan in enumerate(scans):
            arrived = begin + number / rate
            if _wait_until(arrived + scan.latency, file, wait):
                return number
            file.append(
                ({**event, "arrived": round(arrived, 3)} if event["event"] == "scan" else event)
                for event in scan.events
            )
        file.append(after)
    return len(scans)


def _sleep(seconds: float) -> bool:
    """Sleep, and stop never."""
    time.sleep(seconds)
    return False


def _wait_until(moment: float, file: EventFile, wait: Callable[[float], bool]) -> bool:
    """Wait until a moment, s since 1970, with signs of life; return whether to stop."""
    left = moment - time.time()
    while left > 0:
        if wait(min(left, _BEAT)):
            return True
        file.beat()
        left = moment - time.time()
    return False
