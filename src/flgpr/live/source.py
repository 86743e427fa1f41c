"""Where scans come from: what arrived and was not taken yet, and the threads that bring it."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from abc import abstractmethod
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Literal

_MOST_WAITING = 32
_MOST_BYTES_WAITING = 2**28
SOCKET = "socket"
"""Name of arrivals over the socket."""


@dataclass(frozen=True)
class Arrival:
    """A description, a frame, the end, or an error that ends the watch.

    It came from ``name`` at ``when``, s since 1970. A frame that breaks the format has its
    ScanFileError as ``value`` in place of ``data``.
    """

    kind: Literal["run", "frame", "end", "failed"]
    name: str
    when: float
    data: bytes = b""
    value: Any = None


class ArrivalQueue(queue.Queue[Arrival]):
    """Arrivals in their order; the queue is full with so many of them, or with so many bytes."""

    def __init__(self, most: int = _MOST_WAITING, most_bytes: int = _MOST_BYTES_WAITING) -> None:
        super().__init__(most)
        self._most_bytes = most_bytes
        self._bytes = 0

    def _put(self, item: Arrival) -> None:
        """Add an arrival and count its bytes."""
        super()._put(item)
        self._bytes += len(item.data)

    def _get(self) -> Arrival:
        """Remove an arrival and its bytes."""
        item = super()._get()
        self._bytes -= len(item.data)
        return item

    def _qsize(self) -> int:
        """Return the number of arrivals; the largest one if there are too many bytes."""
        if self._bytes >= self._most_bytes:
            return self.maxsize
        return super()._qsize()


@dataclass
class Inbox:
    """What arrived and was not taken yet, and whether the run ends.

    A source waits rather than filling the memory.
    """

    arrivals: queue.Queue[Arrival] = field(default_factory=ArrivalQueue)
    stop: threading.Event = field(default_factory=threading.Event)
    awaited: bool = False  #: whether the next arrival is taken at once
    #: most bytes that a frame of the run may have; None while the run is not known
    largest: int | None = None
    _senders: Counter[str] = field(default_factory=Counter)
    _counting: threading.Lock = field(default_factory=threading.Lock)

    def put(self, arrival: Arrival) -> bool:
        """Hand an arrival over; return False if the run ended before there was room."""
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
        """Return how many senders were refused or ended since the last call."""
        with self._counting:
            counts = self._senders
            self._senders = Counter()
        return counts


class Source(threading.Thread):
    """Brings arrivals to the inbox of a live run, until the run ends.

    A folder that is watched, a socket that is listened on and a recording that is played are
    subclasses. An error that ends a source reaches the run as an arrival, under the source's name.
    """

    def __init__(self, name: str, inbox: Inbox) -> None:
        super().__init__(name=name, daemon=True)
        self.inbox = inbox

    def run(self) -> None:
        """Bring what comes."""
        try:
            self.bring()
        except (OSError, ValueError) as error:
            self.inbox.put(Arrival("failed", self.name, time.time(), value=error))

    @abstractmethod
    def bring(self) -> None:
        """Put into the inbox what comes, until its ``stop`` is set or nothing more comes."""
