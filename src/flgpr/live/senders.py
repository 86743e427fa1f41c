"""The sockets on which scans arrive, Unix or TCP, and the programs that send them.

Cuts the bytes that a sender sends over a socket into frames.
"""

from __future__ import annotations

import contextlib
import math
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from flgpr.live.sockets import (
    ANSWER_BYTES,
    TcpAddress,
    challenge,
    is_answer,
    listening_tcp,
    listening_unix,
)
from flgpr.live.source import SOCKET, Arrival, Inbox, Source
from flgpr.store import RunDescription, ScanFileError, canonical_json, decode_frame
from flgpr.store.scan_file import (
    LARGEST_FRAME,
    MAGIC,
    TruncatedFrameError,
    frame_size,
    head_size,
    parse_description,
)

_LARGEST_DESCRIPTION = 2**22 + 2**10  # bytes of the frame of the longest header
_HEADER_ROOM = 2**16  # bytes for the header of a scan
_CANDIDATES = 16  # beginnings of frames that are tried within a frame that may be damaged


def largest_frame(description: RunDescription) -> int:
    """Return the most bytes that a frame of a run may have.

    A frame is a scan, or the description, perhaps written with more digits than ours.

    Parameters
    ----------
    description : RunDescription
        The run.

    Returns
    -------
    int
        Bytes.
    """
    scan_size = 8 * math.prod(description.shape)
    description_size = len(canonical_json(description.as_json()))
    return min(2 * max(scan_size, description_size) + _HEADER_ROOM, LARGEST_FRAME)


class FrameStream:
    """Cuts the bytes of a sender into frames.

    After a bad one it continues where the next frame begins. ``largest`` is the most bytes that a
    frame may have, None while the run is not known: then a description may come, and after it scans
    of the size that it states.
    """

    def __init__(self, largest: int | None = None) -> None:
        self.largest = largest
        self._described = (
            _LARGEST_DESCRIPTION  # as ``largest``, by the description that the sender sent
        )
        self._buffer = bytearray()
        self._run_id = ""  # of the run that the sender described or sent a scan of last
        self._usual = 0  # bytes of the largest good frame so far
        # whether we are between a bad frame, which was reported, and the next beginning
        self._lost = False

    @property
    def waiting(self) -> int:
        """Bytes of a frame that is not complete."""
        return len(self._buffer)

    def take(self, data: bytes, over: bool) -> Iterator[Arrival]:
        """Yield the frames that are complete or bad.

        With ``over`` nothing more comes of the last frame.
        """
        self._buffer += data
        while self._buffer:
            if self._lost and not self._find_beginning():
                break
            try:
                arrival, size = self._first_frame()
            except TruncatedFrameError as error:
                if not over:
                    return
                yield self._bad(error)
            except ScanFileError as error:
                yield self._bad(error)
            else:
                del self._buffer[:size]
                yield arrival
        if self._lost and over:  # a bad frame after a pause is reported anew
            self._buffer.clear()
            self._lost = False

    def _first_frame(self) -> tuple[Arrival, int]:
        """Return the arrival at the beginning of the buffer, and its bytes."""
        size = self._checked_size()
        data = bytes(self._buffer[:size])
        frame = decode_frame(data)
        now = time.time()
        self._usual = max(self._usual, size)
        if frame.kind == "run":
            description = {key: value for key, value in frame.header.items() if key != "kind"}
            # A description that is not valid is reported by whoever takes it.
            with contextlib.suppress(ScanFileError):
                run = parse_description(description)
                self._described = max(largest_frame(run), _LARGEST_DESCRIPTION)
                self._run_id = run.run_id
            return Arrival("run", SOCKET, now, value=description), size
        if frame.kind == "end":
            return Arrival("end", SOCKET, now, canonical_json(frame.header), self._run_id), size
        self._run_id = str(frame.header.get("run", ""))
        return Arrival("frame", SOCKET, now, data), size

    def _checked_size(self) -> int:
        """Return the bytes of the first frame; refuse one that is not complete or too large."""
        beginning = bytes(self._buffer[: len(MAGIC)])
        if not MAGIC.startswith(beginning):
            raise ScanFileError(f"frame must begin with {MAGIC.decode()}, got {beginning!r}")
        size = frame_size(bytes(self._buffer[: head_size()]))
        most = self._described if self.largest is None else self.largest
        if size > most:
            raise ScanFileError(f"frame must have at most {most} bytes, got {size}")
        is_short = len(self._buffer) < size
        is_unusual = 0 < 2 * self._usual < size
        if is_short and is_unusual and self._holds_complete_frame():
            raise ScanFileError(
                f"frame must have {size} bytes, got {len(self._buffer)} before the next one begins"
            )
        if is_short:
            raise TruncatedFrameError(f"frame must have {size} bytes, got {len(self._buffer)}")
        return size

    def _holds_complete_frame(self) -> bool:
        """Return whether a complete frame lies in the buffer after its beginning."""
        start = self._buffer.find(MAGIC, 1)
        # Without a limit a sender of beginnings alone would keep a processor busy.
        for _ in range(_CANDIDATES):
            if start < 0:
                return False
            with contextlib.suppress(ScanFileError):
                size = frame_size(bytes(self._buffer[start : start + head_size()]))
                decode_frame(bytes(self._buffer[start : start + size]))
                return True
            start = self._buffer.find(MAGIC, start + 1)
        return False

    def _bad(self, error: ScanFileError) -> Arrival:
        """Return the arrival of a bad frame, and look for the next frame within it.

        The length that it states cannot be trusted.
        """
        del self._buffer[:1]
        self._lost = True
        return Arrival("frame", SOCKET, time.time(), value=error)

    def _find_beginning(self) -> bool:
        """Delete what comes before the beginning of a frame; return whether there is one."""
        start = self._buffer.find(MAGIC)
        self._lost = start < 0
        if self._lost:
            # The last bytes may be the first of a beginning.
            start = max(len(self._buffer) - len(MAGIC) + 1, 0)
        del self._buffer[:start]
        return not self._lost


SENDERS = {
    "refused": "as many as may be are connected",
    "ended": "they sent nothing of use for too long, began with something else than a frame, or "
    "did not know the secret",
}
"""Why senders are refused or ended."""
_CHECK = 0.2  # s between checks whether the run has ended
_BACKLOG = 64  # senders that wait to be accepted; the system makes a further one try again
_CHUNK = 2**20  # bytes that are taken from a sender at once


@dataclass(frozen=True)
class SenderLimits:
    """How many senders may be connected, and how long one of them may send nothing of use, s."""

    senders: int = 16
    pause: float = 1.0  #: within a frame
    frame: float = 10.0  #: from the beginning of a frame to its end
    silence: float = 10.0  #: of a sender that sent something, but no good frame yet


class _Sender(threading.Thread):
    """Takes frames from a sender, until it leaves or is closed."""

    def __init__(self, connection: socket.socket, watch: _SenderWatch) -> None:
        super().__init__(name="sender", daemon=True)
        self._watch = watch
        # Bytes that the first ones must be, as far as they have not come yet. A web page in a
        # browser can send to a TCP port of its own machine, but only behind the head of a request.
        self._greeting = b"" if watch.path is not None else MAGIC
        self._connection = connection
        self._stream = FrameStream()
        #: whether it sent anything, and the answer to a challenge before
        self.has_sent = False
        self.has_sent_good = False
        self.useful = time.monotonic()  #: when a good frame came, or else when it connected
        self.held_back = False  #: whether one of its frames waits to be taken

    def run(self) -> None:
        """Ask for the secret, if there is one, and take frames."""
        self._connection.settimeout(_CHECK)
        with self._connection:
            knows_secret = self._watch.secret is None or self._answers(self._watch.secret)
            if knows_secret:
                self._take_frames()
            elif knows_secret is not None:
                self._watch.inbox.count_sender("ended")

    def _take_frames(self) -> None:
        """Take frames until the sender leaves, is closed or sends nothing of use for too long."""
        heard = time.monotonic()
        begun = heard
        is_open = True
        while is_open and not self._watch.inbox.stop.is_set():
            data = self._receive()
            is_open = data != b""
            now = time.monotonic()
            if data:
                heard = now
                self.has_sent = True
                # The first bytes must be those of a frame, where a sender has to greet with one.
                length = min(len(self._greeting), len(data))
                begins = data[:length] == self._greeting[:length]
                self._greeting = self._greeting[length:]
                if not begins:
                    self._watch.inbox.count_sender("ended")
                    return
            paused = now - heard > self._watch.limits.pause
            taken = self._hand_over(data or b"", paused or not is_open)
            if taken:
                # The time for which the frames were held back does not count.
                heard = time.monotonic()
                begun = heard
            elif not self._stream.waiting:
                begun = now
            elif now - begun > self._watch.limits.frame:
                self._hand_over(b"", over=True)
                begun = time.monotonic()
            useless = self.has_sent and not self.has_sent_good
            if is_open and useless and now - heard > self._watch.limits.silence:
                self._watch.inbox.count_sender("ended")
                return

    def _answers(self, secret: bytes) -> bool | None:
        """Send a challenge, and return whether the right answer comes in time.

        None where the sender leaves or is closed before.
        """
        asked = challenge()
        given = b""
        last = time.monotonic() + self._watch.limits.silence
        try:
            self._connection.sendall(asked)
        except OSError:
            return None
        while len(given) < ANSWER_BYTES and time.monotonic() < last:
            data = self._receive(ANSWER_BYTES - len(given))
            if data == b"" or self._watch.inbox.stop.is_set():
                return None
            given += data or b""
        self.has_sent = is_answer(secret, asked, given)
        return self.has_sent

    def close(self) -> None:
        """Let the thread end, as if the sender had left."""
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def _receive(self, most: int = _CHUNK) -> bytes | None:
        """Return what came; None if nothing did for a moment, no bytes if nothing more comes."""
        try:
            return self._connection.recv(most)
        except TimeoutError:
            return None
        except OSError:
            return b""

    def _hand_over(self, data: bytes, over: bool) -> int:
        """Hand over the frames that are complete or bad, and return their number."""
        self._stream.largest = self._watch.inbox.largest
        taken = 0
        for arrival in self._stream.take(data, over):
            taken += 1
            if arrival.kind != "frame" or arrival.value is None:
                self.has_sent_good = True
                self.useful = time.monotonic()
            self.held_back = True
            is_put = self._watch.inbox.put(arrival)
            self.held_back = False
            if not is_put:
                break
        return taken


class _SenderWatch(Source):
    """Listens for senders on a socket; several may connect.

    With ``greets`` the first bytes of a sender must be those of a frame; else it is ended. The file
    at ``path``, if any, goes when the socket is closed.
    """

    def __init__(
        self,
        name: str,
        listener: socket.socket,
        inbox: Inbox,
        limits: SenderLimits | None,
        path: Path | None = None,
        secret: bytes | None = None,
    ) -> None:
        super().__init__(name, inbox)
        self.path = path  #: of a Unix socket, which no web page reaches
        self.secret = secret
        self.limits = limits or SenderLimits()
        self._senders: list[_Sender] = []
        self._socket = listener
        self._socket.settimeout(_CHECK)

    def bring(self) -> None:
        """Listen until the run ends."""
        with self._socket:
            while not self.inbox.stop.is_set():
                try:
                    connection, _ = self._socket.accept()
                except TimeoutError:
                    continue
                except OSError:  # the system opens no more files: who connects waits
                    self.inbox.stop.wait(_CHECK)
                    continue
                self._admit(connection)
        if self.path is not None:
            self.path.unlink(missing_ok=True)
        for sender in self._senders:
            sender.join(1.0)

    def _admit(self, connection: socket.socket) -> None:
        """Listen to a new sender, or refuse it.

        If as many senders as may be are connected, it takes the place of the least useful one.
        """
        self._senders = [sender for sender in self._senders if sender.is_alive()]
        is_full = len(self._senders) >= self.limits.senders
        if is_full and not self._end_least_useful():
            self.inbox.count_sender("refused")
            connection.close()
            return
        sender = _Sender(connection, self)
        try:
            sender.start()
        except RuntimeError:  # the system starts no more threads
            self.inbox.count_sender("refused")
            connection.close()
            return
        self._senders.append(sender)

    def _end_least_useful(self) -> bool:
        """End the sender that is the least use.

        Return False where every sender may still be of use. Senders that never sent a good frame
        are ended first, however short they have been there, because connections that come one
        after another must not keep a radar out: those that sent nothing, then the oldest. Where all
        have sent good frames, the one whose last is the longest ago is ended. A radar that stands
        still is silent, too: it is ended only where all others have sent good frames.
        """
        candidates = [sender for sender in self._senders if not sender.has_sent_good]
        if not candidates:
            limit = time.monotonic() - self.limits.pause
            candidates = [sender for sender in self._senders if sender.useful < limit]
        candidates = [sender for sender in candidates if not sender.held_back]
        if not candidates:
            return False
        least_useful = min(candidates, key=lambda sender: (sender.has_sent, sender.useful))
        least_useful.close()
        self.inbox.count_sender("ended")
        self._senders.remove(least_useful)
        return True


class SocketWatch(_SenderWatch):
    """Listens for frames on a Unix socket that only this user may open.

    Several senders may connect.

    Raises
    ------
    ValueError
        If the path cannot be made a socket, another program listens on it, or this system has no
        Unix sockets.
    """

    def __init__(self, path: Path, inbox: Inbox, limits: SenderLimits | None = None) -> None:
        listener = listening_unix(path, _BACKLOG)
        super().__init__(str(path), listener, inbox, limits, path)


class TcpWatch(_SenderWatch):
    """Listens for frames on a TCP address.

    Several senders may connect, under the limits of a Unix socket. Whoever reaches the address may
    send: by default these are the programs of this machine, whichever user started them. With a
    ``secret`` only those may that know it (:mod:`flgpr.live.sockets`). A connection whose first
    bytes are not those of a frame, such as a web page's, is ended.

    Attributes
    ----------
    address : TcpAddress
        Where it listens, with the port that was free where 0 was asked for.

    Raises
    ------
    ValueError
        If the address cannot be listened on.
    """

    def __init__(
        self,
        address: TcpAddress,
        inbox: Inbox,
        limits: SenderLimits | None = None,
        secret: bytes | None = None,
    ) -> None:
        listener = listening_tcp(address, _BACKLOG)
        self.address = TcpAddress(address.host, listener.getsockname()[1])
        super().__init__(str(self.address), listener, inbox, limits, secret=secret)
