"""Where scans come from: the inbox of what came, and a folder that is looked at in a thread of its own."""

from __future__ import annotations

import contextlib
import os
import queue
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from flgpr.door import DoorError, Folder
from flgpr.store import ScanFileError, read_description
from flgpr.store.scan_file import END_FILE, SCAN_SUFFIX, TruncatedFrameError, frame_size, head_size

# s between looks at a folder, while a scan is in hand and while one is waited for
_LOOK = 0.004
_GLANCE = 0.001
_SETTLED = 0.05  # s after which a folder's time stamp tells of every change
_PATIENCE = 1.0  # s that a file may stay shorter than it says
_MOST_WAITING = 32
_MOST_BYTES_WAITING = 2**28
_MOST_FILE = 2**63  # of a file larger than a frame only the head is read
LARGEST_FRAME = 2**28
"""Bytes that a frame may have, whatever its run is."""
SOCKET = "socket"
"""Name of what came over the socket."""


@dataclass(frozen=True)
class Arrival:
    """A description, a frame, the end, or an error that ends the watch, from ``name`` at ``when``, s since 1970.

    A frame that breaks the format has its ScanFileError as ``value`` in place of ``data``.
    """

    kind: Literal["run", "frame", "end", "failed"]
    name: str
    when: float
    data: bytes = b""
    value: Any = None


class ArrivalQueue(queue.Queue[Arrival]):
    """Arrivals in their order; full with so many of them, or with so many bytes."""

    def __init__(self, most: int = _MOST_WAITING, most_bytes: int = _MOST_BYTES_WAITING) -> None:
        super().__init__(most)
        self._most_bytes = most_bytes
        self._bytes = 0

    def _put(self, item: Arrival) -> None:
        super()._put(item)
        self._bytes += len(item.data)

    def _get(self) -> Arrival:
        item = super()._get()
        self._bytes -= len(item.data)
        return item

    def _qsize(self) -> int:
        return self.maxsize if self._bytes >= self._most_bytes else super()._qsize()


@dataclass
class Inbox:
    """What came and was not taken yet, and whether it is over; a source waits rather than filling the memory."""

    arrivals: queue.Queue[Arrival] = field(default_factory=ArrivalQueue)
    stop: threading.Event = field(default_factory=threading.Event)
    awaited: bool = False  #: whether what comes is taken at once
    #: bytes that a frame of the run may have; None while the run is not known
    largest: int | None = None
    _senders: Counter[str] = field(default_factory=Counter)
    _counting: threading.Lock = field(default_factory=threading.Lock)

    def put(self, arrival: Arrival) -> bool:
        """Hand something over and tell whether it was; give up when it is over."""
        while not self.stop.is_set():
            with contextlib.suppress(queue.Full):
                self.arrivals.put(arrival, timeout=0.1)
                return True
        return False

    def count_sender(self, outcome: Literal["refused", "ended"]) -> None:
        """Count a sender on the socket that was refused when it connected, or ended later."""
        with self._counting:
            self._senders[outcome] += 1

    def take_senders(self) -> Counter[str]:
        """Give how many senders were refused or ended since this was last asked."""
        with self._counting:
            taken = self._senders
            self._senders = Counter()
        return taken


class FolderWatch(threading.Thread):
    """Watches a folder, made now or later: ``run.json``, then ``*.scan`` in the order of names, then ``end.json``."""

    def __init__(self, folder: Path, inbox: Inbox, known: set[str] | None = None) -> None:
        super().__init__(name=f"watch {folder}", daemon=True)
        self._folder = folder
        self._inbox = inbox
        self._known = set(known or ())
        self._began = time.time()
        self._growing: dict[str, tuple[int, float]] = {}
        self._described = self._ended = False
        self._stamp = -1

    def run(self) -> None:
        """Look until it is over."""
        while not self._inbox.stop.is_set():
            try:
                busy = self._look()
            except (OSError, ScanFileError) as error:
                self._inbox.put(Arrival("failed", str(self._folder), time.time(), value=error))
                return
            if not busy:
                self._inbox.stop.wait(_GLANCE if self._inbox.awaited else _LOOK)

    def _look(self) -> bool:
        """Look once; tell whether something came."""
        try:
            stamp = self._folder.stat().st_mtime_ns
        except FileNotFoundError:
            return False
        settled = time.time_ns() - stamp > _SETTLED * 1e9
        if stamp == self._stamp and settled and not self._growing:
            return False
        if not self._described:
            description = read_description(self._folder)
            if description is None:
                return False
            self._described = True
            self._inbox.put(
                Arrival("run", str(self._folder), time.time(), value=description.as_json())
            )
        names = set(os.listdir(self._folder))
        self._known &= names  # a radar that takes away what was read lets us forget it
        self._growing = {name: seen for name, seen in self._growing.items() if name in names}
        new = sorted(name for name in names - self._known if name.endswith(SCAN_SUFFIX))
        found = [name for name in new if self._read(name)]
        if END_FILE in names and not self._ended and not found and not self._growing:
            self._ended = True
            self._inbox.put(Arrival("end", END_FILE, time.time()))
        self._stamp = stamp if settled and not found else -1
        return bool(found)

    def _read(self, name: str) -> bool:
        """Hand a file over, unless it still grows."""
        try:
            with Folder(self._folder).open(name, _MOST_FILE) as file:
                state = os.fstat(file.fileno())
                data = (
                    file.read(LARGEST_FRAME)
                    if state.st_size <= LARGEST_FRAME
                    else file.read(head_size())
                )
        except FileNotFoundError:
            return False
        except DoorError:
            self._known.add(name)  # links, folders and pipes are no scans
            return False
        if self._grows(name, data, state.st_size):
            return False
        self._known.add(name)
        when = max(state.st_ctime, self._began)
        return self._inbox.put(Arrival("frame", name, when, data))

    def _grows(self, name: str, data: bytes, size: int) -> bool:
        """Tell whether a file is shorter than it says and may still be completed."""
        try:
            short = frame_size(data) > size
        except TruncatedFrameError:
            short = True
        except ScanFileError:
            short = False
        before, since = self._growing.get(name, (-1, 0.0))
        now = time.time()
        if short and (size != before or now - since < _PATIENCE):
            self._growing[name] = (size, now if size != before else since)
            return True
        self._growing.pop(name, None)
        return False
