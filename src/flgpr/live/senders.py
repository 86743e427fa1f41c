"""A local socket that is listened on, and the programs that send scans over it."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import stat
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from flgpr.live.stream import FrameStream
from flgpr.live.watch import Inbox

SENDERS = {
    "refused": "as many as may be are connected",
    "ended": "they sent nothing of use for too long",
}
"""Why senders are refused or ended."""
_LOOK = 0.2  # s between looks at whether it is over
_BACKLOG = 64  # senders that wait to be accepted; a further one is told by the system to try again
_PART = 2**20  # bytes that are taken from a sender at once


@dataclass(frozen=True)
class SenderLimits:
    """How many senders may be connected, and how long they may hold something up, s."""

    senders: int = 8
    pause: float = 1.0  #: within a frame
    frame: float = 10.0  #: from the beginning of a frame to its end
    silence: float = 10.0  #: of a sender that sent something, but no good frame


class _Sender(threading.Thread):
    """Takes frames from a sender, until it leaves or is closed."""

    def __init__(self, connection: socket.socket, inbox: Inbox, limits: SenderLimits) -> None:
        super().__init__(name="sender", daemon=True)
        self._connection = connection
        self._inbox = inbox
        self._limits = limits
        self._stream = FrameStream()
        self._has_sent = False
        self.has_sent_good = False
        self.useful = time.monotonic()  #: when a good frame came, or else when it connected
        self.held_back = False  #: whether a frame of it waits to be taken

    def run(self) -> None:
        """Take frames."""
        self._connection.settimeout(_LOOK)
        heard = begun = time.monotonic()
        is_open = True
        with self._connection:
            while is_open and not self._inbox.stop.is_set():
                part = self._receive()
                is_open = part != b""
                now = time.monotonic()
                if part:
                    heard = now
                    self._has_sent = True
                paused = now - heard > self._limits.pause
                taken = self._hand_over(part or b"", paused or not is_open)
                if taken:
                    heard = begun = (
                        time.monotonic()
                    )  # the time for which it was held back does not count
                elif not self._stream.waiting:
                    begun = now
                elif now - begun > self._limits.frame:
                    self._hand_over(b"", over=True)
                    begun = time.monotonic()
                useless = self._has_sent and not self.has_sent_good
                if is_open and useless and now - heard > self._limits.silence:
                    self._inbox.count_sender("ended")
                    return

    def close(self) -> None:
        """Let it end, as if the sender had left."""
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def _receive(self) -> bytes | None:
        """Give what came, None if nothing did for a moment, no bytes if nothing more comes."""
        try:
            return self._connection.recv(_PART)
        except TimeoutError:
            return None
        except OSError:
            return b""

    def _hand_over(self, part: bytes, over: bool) -> int:
        """Hand over what is whole or bad, and give its number."""
        self._stream.largest = self._inbox.largest
        taken = 0
        for arrival in self._stream.take(part, over):
            taken += 1
            if arrival.kind != "frame" or arrival.value is None:
                self.has_sent_good = True
                self.useful = time.monotonic()
            self.held_back = True
            is_put = self._inbox.put(arrival)
            self.held_back = False
            if not is_put:
                break
        return taken


class SocketWatch(threading.Thread):
    """Listens on a Unix socket of this user alone for frames, one after the other; several senders may come."""

    def __init__(self, path: Path, inbox: Inbox, limits: SenderLimits | None = None) -> None:
        super().__init__(name=f"listen {path}", daemon=True)
        self._path = path
        self._inbox = inbox
        self._limits = limits or SenderLimits()
        self._senders: list[_Sender] = []
        _make_room(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o177)
        try:
            self._socket.bind(str(path))
        except OSError as error:
            self._socket.close()
            raise ValueError(
                f"socket must be a path that can be made, got {path}: {_reason(error)}"
            ) from None
        finally:
            os.umask(before)
        self._socket.listen(_BACKLOG)
        self._socket.settimeout(_LOOK)

    def run(self) -> None:
        """Listen until it is over."""
        with self._socket:
            while not self._inbox.stop.is_set():
                try:
                    connection, _ = self._socket.accept()
                except TimeoutError:
                    continue
                except OSError:  # the system opens no more files: who connects waits
                    self._inbox.stop.wait(_LOOK)
                    continue
                self._admit(connection)
        self._path.unlink(missing_ok=True)
        for sender in self._senders:
            sender.join(1.0)

    def _admit(self, connection: socket.socket) -> None:
        """Listen to a new sender, in place of the least useful one if there are as many as may be, or refuse it."""
        self._senders = [sender for sender in self._senders if sender.is_alive()]
        if len(self._senders) >= self._limits.senders and not self._give_way():
            self._inbox.count_sender("refused")
            connection.close()
            return
        sender = _Sender(connection, self._inbox, self._limits)
        try:
            sender.start()
        except RuntimeError:  # the system starts no more threads
            self._inbox.count_sender("refused")
            connection.close()
            return
        self._senders.append(sender)

    def _give_way(self) -> bool:
        """End the sender that is the least use, unless it may still be of some; tell whether one was ended.

        Those that never sent a good frame come first, then those whose last one is the longest ago. A radar that
        stands still is silent, too: it gives way only where all others have sent good frames.
        """
        strangers = [sender for sender in self._senders if not sender.has_sent_good]
        last = time.monotonic() - self._limits.pause
        idle = [
            sender
            for sender in strangers or self._senders
            if not sender.held_back and sender.useful < last
        ]
        if not idle:
            return False
        longest = min(idle, key=lambda sender: sender.useful)
        longest.close()
        self._inbox.count_sender("ended")
        self._senders.remove(longest)
        return True


def _reason(error: OSError) -> str:
    """Say why a path cannot be listened on."""
    reasons = {
        errno.ENOENT: "its folder does not exist",
        errno.ENOTDIR: "its folder is none",
        errno.EACCES: "this user may not write into its folder",
        errno.EROFS: "its disk cannot be written to",
        errno.EADDRINUSE: "another program listens on it",
    }
    if error.errno is None:
        return "it is too long; about 100 characters are possible"
    return reasons.get(error.errno, error.strerror or "the system refuses it")


def _make_room(path: Path) -> None:
    """Take away a socket that nobody listens on."""
    if not path.exists() and not path.is_symlink():
        return
    if not stat.S_ISSOCK(path.lstat().st_mode):
        raise ValueError(f"socket must be a new path, got {path}, where something else lies")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except FileNotFoundError:
            return
        except OSError:  # it may listen, and not to us
            pass
    raise ValueError(
        f"socket must be free, got {path}, on which another program listens: give another path"
    )
