"""Where scans come from: what arrived and was not taken yet, and the threads that bring it.

Scans that a radar writes into a folder as files.

A recorded run as a source of live scans: one after the other, in the order of their times.
"""

from __future__ import annotations

import contextlib
import math
import os
import queue
import threading
import time
from abc import abstractmethod
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from flgpr.door import DoorError, Folder
from flgpr.json_text import parse_json
from flgpr.store import ScanFileError, describe_for_live, encode_scan, read_description
from flgpr.store.scan_file import (
    END_FILE,
    LARGEST_FRAME,
    SCAN_SUFFIX,
    TruncatedFrameError,
    frame_size,
    head_size,
    scan_name,
    stored_scan,
)
from flgpr.types import FloatArray

_MOST_WAITING = 32
_MOST_BYTES_WAITING = 2**28
SOCKET = "socket"
"""Name of arrivals over the socket."""


@dataclass(frozen=True)
class Arrival:
    """A description, a frame, the end, or an error that ends the watch.

    It came from ``name`` at ``when``, s since 1970. A frame that breaks the format has its
    ScanFileError as ``value`` in place of ``data``; the end has what it says as JSON, and by a
    sender the ``run_id`` of the run that it described.
    """

    kind: Literal["run", "frame", "end", "failed"]
    name: str
    when: float
    data: bytes = b""
    value: Any = None

    @property
    def stated_scans(self) -> int:
        """Number of scans that an end states, 0 where it states none."""
        with contextlib.suppress(ValueError, TypeError, KeyError):
            scans = parse_json(self.data)["scans"]
            return scans if isinstance(scans, int) else 0
        return 0


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


# s between checks of a folder, while a scan is processed and while the next one is awaited
_CHECK_BUSY = 0.004
_CHECK_AWAITED = 0.001
_SETTLED = 0.05  # s after which a folder's time stamp shows every change
_PATIENCE = 1.0  # s that a file may stay shorter than its header states
_UNREADABLE = -2  # in place of the size of a file that cannot be read
_MOST_FILE = 2**63  # of a file larger than a frame only the head is read


class FolderWatch(Source):
    """Watches a folder, which may be made later.

    It reads ``run.json``, then ``*.scan`` in the order of names, then ``end.json``.
    """

    def __init__(self, folder: Path, inbox: Inbox, known: set[str] | None = None) -> None:
        super().__init__(str(folder), inbox)
        self._folder = folder
        self._known = set(known or ())
        self._began = time.time()
        self._growing: dict[str, tuple[int, float]] = {}
        self._cut: dict[str, int] = {}  # when files last changed that were handed over incomplete
        self._described = False
        self._ended = False
        self._stamp = -1

    def bring(self) -> None:
        """Check the folder until the run ends."""
        while not self.inbox.stop.is_set():
            if not self._check():
                pause = _CHECK_AWAITED if self.inbox.awaited else _CHECK_BUSY
                self.inbox.stop.wait(pause)

    def _check(self) -> bool:
        """Check the folder once; return whether a scan came."""
        try:
            stamp = self._folder.stat().st_mtime_ns
        except FileNotFoundError:
            return False
        is_settled = time.time_ns() - stamp > _SETTLED * 1e9
        # The end of a file that comes late changes nothing about its folder.
        is_complete = not self._growing and not self._cut
        if stamp == self._stamp and is_settled and is_complete:
            return False
        if not self._described and not self._describe():
            return False
        names = set(os.listdir(self._folder))
        self._forget_removed(names)
        self._take_up_grown()
        unread = [name for name in names - self._known if name.endswith(SCAN_SUFFIX)]
        n_read = 0
        for name in sorted(unread):
            n_read += self._read(name)
        # The end may be written before the last scans can be read: it is passed on after them.
        if END_FILE in names and not self._ended and not n_read and not self._growing:
            self._ended = True
            data = b""
            with contextlib.suppress(OSError, DoorError):
                data = Folder(self._folder).read(END_FILE)
            self.inbox.put(Arrival("end", END_FILE, time.time(), data))
        self._stamp = stamp if is_settled and not n_read else -1
        return n_read > 0

    def _describe(self) -> bool:
        """Hand the description of the run over; return False if it is not there yet."""
        description = read_description(self._folder)
        if description is None:
            return False
        self._described = True
        source = str(self._folder)
        self.inbox.put(Arrival("run", source, time.time(), value=description.as_json()))
        return True

    def _forget_removed(self, names: set[str]) -> None:
        """Forget files that the radar removed; ``names`` are those in the folder."""
        self._known &= names
        for files in (self._growing, self._cut):
            for name in list(files):
                if name not in names:
                    del files[name]

    def _take_up_grown(self) -> None:
        """Read files once more that were incomplete for a while, and then grew or were filled."""
        for name, changed in list(self._cut.items()):
            with contextlib.suppress(OSError):
                if os.lstat(self._folder / name).st_mtime_ns != changed:
                    del self._cut[name]
                    self._known.discard(name)

    def _read(self, name: str) -> bool:
        """Hand a file over; return False if it still grows or cannot be a scan."""
        try:
            with Folder(self._folder).open(name, _MOST_FILE) as file:
                status = os.fstat(file.fileno())
                fits = status.st_size <= LARGEST_FRAME
                data = file.read(LARGEST_FRAME if fits else head_size())
        except FileNotFoundError:
            return False
        except DoorError as error:  # links, folders and pipes are no scans: told, and counted
            self._known.add(name)
            return self.inbox.put(Arrival("frame", name, time.time(), value=ScanFileError(error)))
        except OSError as error:
            # The radar may give the right to read it after it has written it.
            now = time.time()
            size, since = self._growing.get(name, (_UNREADABLE, now))
            if size != _UNREADABLE:
                since = now
            if now - since < _PATIENCE:
                self._growing[name] = (_UNREADABLE, since)
                return False
            self._growing.pop(name, None)
            self._known.add(name)
            fault = ScanFileError(f"file must be readable, got {error.strerror or error}")
            return self.inbox.put(Arrival("frame", name, now, value=fault))
        if self._grows(name, data, status.st_size):
            return False
        self._known.add(name)
        if _is_short(data, status.st_size):
            self._cut[name] = status.st_mtime_ns
        when = max(status.st_ctime, self._began)
        return self.inbox.put(Arrival("frame", name, when, data))

    def _grows(self, name: str, data: bytes, size: int) -> bool:
        """Return whether a file is shorter than its header states and may still be completed."""
        is_short = _is_short(data, size)
        previous_size, since = self._growing.get(name, (-1, 0.0))
        now = time.time()
        if size != previous_size:
            since = now
        if is_short and (size != previous_size or now - since < _PATIENCE):
            self._growing[name] = (size, since)
            return True
        self._growing.pop(name, None)
        return False


def _is_short(data: bytes, size: int) -> bool:
    """Return whether a file of so many bytes is shorter than the header in its data states.

    One that ends in zeros, where its checksum belongs, is still filled in place.
    """
    if len(data) == size and not any(data[-4:]):
        return True
    try:
        return frame_size(data) > size
    except TruncatedFrameError:
        return True
    except ScanFileError:
        return False


RECORDING = "recording"
"""Name of arrivals of a recording that are no scans."""


def in_time_order(run: xr.Dataset) -> xr.Dataset:
    """Return a run whose scans follow one another in time.

    Parameters
    ----------
    run : Dataset
        A run. Scans of the same time keep their order, as do all where a time is not known.

    Returns
    -------
    Dataset
        The same scans.
    """
    moments = run["time"].values
    if not np.isfinite(moments).all():
        return run
    return run.isel(scan=np.argsort(moments, kind="stable"))


def due_times(run: xr.Dataset, rate: float | None) -> FloatArray:
    """Return when each scan of a run is due, s after the first.

    Parameters
    ----------
    run : Dataset
        A run in the order of its times.
    rate : float or None
        Scans per second, infinity for all at once; None takes the run's own times.

    Returns
    -------
    (scan,) ndarray
        Times, ascending.

    Raises
    ------
    ValueError
        If the rate is not positive, or there is none and the run has no times.
    """
    count = run.sizes["scan"]
    if rate is None:
        moments = np.asarray(run["time"].values, np.float64)
        if not np.isfinite(moments).all():
            raise ValueError("rate must be given for a recording without times of its scans")
        return moments - moments[0]
    if not rate > 0:
        raise ValueError(f"rate must be positive, got {rate}")
    if math.isinf(rate):
        return np.zeros(count)
    return np.arange(count) / rate


class RunPlayer(Source):
    """Plays a run into the inbox of a live run, without the scans that are ``known``.

    Parameters
    ----------
    run : Dataset
        The run, see :func:`in_time_order`.
    inbox : Inbox
        Takes the scans.
    rate : float, optional
        As for :func:`due_times`.
    known : set of str, optional
        Names of scans that an earlier process took: the drive begins behind them.

    Raises
    ------
    ValueError
        If the rate is not valid.
    """

    def __init__(
        self,
        run: xr.Dataset,
        inbox: Inbox,
        rate: float | None = None,
        known: set[str] | None = None,
    ) -> None:
        super().__init__(RECORDING, inbox)
        self._run = in_time_order(run)
        self._due = due_times(self._run, rate)
        names = [scan_name(number) for number in range(self._run.sizes["scan"])]
        self._numbers = [number for number, name in enumerate(names) if name not in (known or ())]

    def bring(self) -> None:
        """Hand over the description, then every scan when it is due, then the end."""
        description = describe_for_live(self._run)
        self.inbox.put(Arrival("run", RECORDING, time.time(), value=description.as_json()))
        start = time.monotonic()
        for number in self._numbers:
            due = start + self._due[number] - self._due[self._numbers[0]]
            # Every wait ends at once where the live run stops.
            if self.inbox.stop.wait(max(due - time.monotonic(), 0.0)):
                return
            scan = stored_scan(self._run, number)
            frame = encode_scan(number, scan.signal, scan.pose, scan.time, description.run_id)
            self.inbox.put(Arrival("frame", scan_name(number), time.time(), frame))
        self.inbox.put(Arrival("end", RECORDING, time.time()))
