"""Where scans come from: a folder that is looked at, a local socket that is listened on. Each in its own thread."""

from __future__ import annotations

import contextlib
import os
import queue
import socket
import stat
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from flgpr.door import DoorError, Folder
from flgpr.io import ScanFileError, decode_frame, read_description
from flgpr.io.scan_file import END_FILE, MAGIC, SCAN_SUFFIX, TruncatedFrameError, frame_size, head_size

_LOOK, _GLANCE = 0.004, 0.001  # s between looks at a folder, while a scan is in hand and while one is waited for
_SETTLED = 0.05  # s after which a folder's time stamp tells of every change
_PATIENCE = 1.0  # s that a file may stay shorter than it says, and a sender may pause within a frame
_MOST_WAITING = 32
_LARGEST, _MOST_FILE = 2**28, 2**63
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


@dataclass
class Inbox:
    """What came and was not taken yet, and whether it is over; a source waits rather than filling the memory."""

    arrivals: queue.Queue[Arrival] = field(default_factory=lambda: queue.Queue(_MOST_WAITING))
    stop: threading.Event = field(default_factory=threading.Event)
    awaited: bool = False  #: whether what comes is taken at once

    def put(self, arrival: Arrival) -> bool:
        """Hand something over and tell whether it was; give up when it is over."""
        while not self.stop.is_set():
            with contextlib.suppress(queue.Full):
                self.arrivals.put(arrival, timeout=0.1)
                return True
        return False


class FolderWatch(threading.Thread):
    """Watches a folder, made now or later: ``run.json``, then ``*.scan`` in the order of names, then ``end.json``."""

    def __init__(self, folder: Path, inbox: Inbox, known: set[str] | None = None) -> None:
        super().__init__(name=f"watch {folder}", daemon=True)
        self._folder, self._inbox, self._known = folder, inbox, set(known or ())
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
            self._inbox.put(Arrival("run", str(self._folder), time.time(), value=description.as_json()))
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
                data = file.read(_LARGEST) if state.st_size <= _LARGEST else file.read(head_size())
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


class SocketWatch(threading.Thread):
    """Listens on a Unix socket of this user alone for frames, one after the other; several senders may come."""

    def __init__(self, path: Path, inbox: Inbox) -> None:
        super().__init__(name=f"listen {path}", daemon=True)
        self._path, self._inbox = path, inbox
        _make_room(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o177)
        try:
            self._socket.bind(str(path))
        except OSError as error:
            self._socket.close()
            raise ValueError(f"socket must be a path that can be made, got {path}: {error}") from None
        finally:
            os.umask(before)
        self._socket.listen(4)
        self._socket.settimeout(0.2)

    def run(self) -> None:
        """Listen until it is over."""
        senders: list[threading.Thread] = []
        with self._socket:
            while not self._inbox.stop.is_set():
                with contextlib.suppress(TimeoutError):
                    sender, _ = self._socket.accept()
                    senders.append(threading.Thread(target=self._listen, args=(sender,), daemon=True))
                    senders[-1].start()
        self._path.unlink(missing_ok=True)
        for one in senders:
            one.join(1.0)

    def _listen(self, sender: socket.socket) -> None:
        sender.settimeout(0.2)
        stream, since, closed = _Stream(), time.monotonic(), False
        with sender:
            while not closed and not self._inbox.stop.is_set():
                try:
                    part = sender.recv(2**20)
                    since, closed = time.monotonic(), not part
                except TimeoutError:
                    part = b""
                except OSError:
                    part, closed = b"", True
                over = closed or time.monotonic() - since > _PATIENCE
                if not all(self._inbox.put(arrival) for arrival in stream.take(part, over)):
                    return


class _Stream:
    """Cuts what a sender sends into frames; after a bad one it goes on where the next frame begins."""

    def __init__(self) -> None:
        self._kept = bytearray()
        self._usual = 0  # bytes of the largest good frame so far
        self._lost = False  # between a bad frame, which was told, and the next beginning

    def take(self, data: bytes, over: bool) -> Iterator[Arrival]:
        """Give what is whole or bad; with ``over`` nothing more comes of the last frame."""
        self._kept += data
        while self._kept:
            if self._lost and not self._find():
                break
            try:
                arrival, size = self._first()
            except TruncatedFrameError as error:
                if not over:
                    return
                yield self._bad(error)
            except ScanFileError as error:
                yield self._bad(error)
            else:
                del self._kept[:size]
                yield arrival
        if self._lost and over:  # what comes after a pause is told anew
            self._kept.clear()
            self._lost = False

    def _first(self) -> tuple[Arrival, int]:
        if not MAGIC.startswith(self._kept[: len(MAGIC)]):
            raise ScanFileError(f"frame must begin with {MAGIC.decode()}, got {bytes(self._kept[: len(MAGIC)])!r}")
        size, now = frame_size(bytes(self._kept[: head_size()])), time.time()
        if size > _LARGEST:
            raise ScanFileError(f"frame must have at most {_LARGEST} bytes, got {size}")
        if len(self._kept) < size and 0 < 2 * self._usual < size and self._within():
            raise ScanFileError(f"frame must have {size} bytes, got {len(self._kept)} before the next one begins")
        if len(self._kept) < size:
            raise TruncatedFrameError(f"frame must have {size} bytes, got {len(self._kept)}")
        data = bytes(self._kept[:size])
        frame = decode_frame(data)
        self._usual = max(self._usual, size)
        if frame.kind == "run":
            return Arrival("run", SOCKET, now, value={k: v for k, v in frame.header.items() if k != "kind"}), size
        return (Arrival("end", SOCKET, now) if frame.kind == "end" else Arrival("frame", SOCKET, now, data)), size

    def _within(self) -> bool:
        """Tell whether a whole frame lies in what is kept, after its beginning."""
        at = self._kept.find(MAGIC, 1)
        while at >= 0:
            with contextlib.suppress(ScanFileError):
                size = frame_size(bytes(self._kept[at : at + head_size()]))
                decode_frame(bytes(self._kept[at : at + size]))
                return True
            at = self._kept.find(MAGIC, at + 1)
        return False

    def _bad(self, error: ScanFileError) -> Arrival:
        del self._kept[:1]  # its length cannot be trusted: the next frame is looked for within it
        self._lost = True
        return Arrival("frame", SOCKET, time.time(), value=error)

    def _find(self) -> bool:
        """Leave out what comes before the beginning of a frame; tell whether there is one."""
        at = self._kept.find(MAGIC)
        self._lost = at < 0
        del self._kept[: at if at >= 0 else max(len(self._kept) - len(MAGIC) + 1, 0)]
        return at >= 0


def _make_room(path: Path) -> None:
    """Take away a socket that nobody listens on."""
    if not path.exists() and not path.is_symlink():
        return
    if not stat.S_ISSOCK(path.lstat().st_mode):
        raise ValueError(f"socket must be a new path, got {path}, where something else lies")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            path.unlink()
            return
    raise ValueError(f"socket must be free, got {path}, on which another program listens")
