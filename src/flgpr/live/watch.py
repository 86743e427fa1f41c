"""Scans that a radar writes into a folder as files."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

from flgpr.door import DoorError, Folder
from flgpr.live.source import Arrival, Inbox, Source
from flgpr.store import ScanFileError, read_description
from flgpr.store.scan_file import (
    END_FILE,
    LARGEST_FRAME,
    SCAN_SUFFIX,
    TruncatedFrameError,
    frame_size,
    head_size,
)

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
        self._cut: dict[str, int] = {}  # sizes of files that were handed over shorter than stated
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
            self.inbox.put(Arrival("end", END_FILE, time.time()))
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
        """Read files once more that were too short for a while, and then grew."""
        for name, size in list(self._cut.items()):
            with contextlib.suppress(OSError):
                if os.lstat(self._folder / name).st_size != size:
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
            return self._cannot_read(name, error)
        if self._grows(name, data, status.st_size):
            return False
        self._known.add(name)
        if _is_short(data, status.st_size):
            self._cut[name] = status.st_size
        when = max(status.st_ctime, self._began)
        return self.inbox.put(Arrival("frame", name, when, data))

    def _cannot_read(self, name: str, error: OSError) -> bool:
        """Hand a file over as bad that cannot be read; return False while that may change.

        The radar may give the right to read it after it has written it.
        """
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
    """Return whether a file of so many bytes is shorter than the header in its data states."""
    try:
        return frame_size(data) > size
    except TruncatedFrameError:
        return True
    except ScanFileError:
        return False
