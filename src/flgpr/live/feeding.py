"""Plays a stored run as a radar would hand it over: scan by scan into a folder, or to a socket."""

from __future__ import annotations

import json
import math
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flgpr.door import Folder
from flgpr.live.sockets import (
    answer_challenge,
    connected_tcp,
    connected_unix,
    live_secret,
    parse_tcp,
)
from flgpr.store import (
    RunDescription,
    describe_for_live,
    encode_frame,
    encode_scan,
    open_run,
    write_description,
    write_whole,
)
from flgpr.store.notes import log_note
from flgpr.store.scan_file import (
    END_FILE,
    RUN_FILE,
    SCAN_SUFFIX,
    description_text,
    scan_name,
    stored_scan,
)
from flgpr.types import PathLike

_LONGEST_WAIT = 86_400.0  # s, before a scan
FAULTS = ("lost", "late", "twice", "nan", "jump")
_JUMP = 45.0  # m along the lane, by which a position is wrong that jumps


@dataclass(frozen=True)
class Fault:
    """What goes wrong from a scan on.

    ``count`` scans are lost, come twice, have a sweep of NaN or a pose that is 45 m off. A scan
    that is "late" comes ``count`` scans later.
    """

    kind: str
    scan: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Fault:
        """Return the fault that a text such as ``lost:40:13`` describes.

        The text is ``KIND:SCAN`` or ``KIND:SCAN:COUNT``.

        Raises
        ------
        ValueError
            If the kind is not one of ``FAULTS`` or a number is none.
        """
        kind, _, rest = text.partition(":")
        numbers = rest.split(":")
        are_numbers = all(number.isascii() and number.isdigit() for number in numbers)
        if kind not in FAULTS or len(numbers) > 2 or not are_numbers:
            raise ValueError(
                f"fault must be {', '.join(FAULTS)} with a scan and a number, "
                f"as lost:40:5, got {text!r}"
            )
        count = int(numbers[1]) if len(numbers) == 2 else 1
        if count < 1:
            raise ValueError(f"fault must be of a scan or more, got {text!r}")
        return cls(kind, int(numbers[0]), count)

    def covers(self, scan: int) -> bool:
        """Return whether a scan is one of those that the fault concerns."""
        return self.scan <= scan < self.scan + self.count


class _PlayedFrame(NamedTuple):
    """A frame in the order of playing."""

    moment: float  # when, in scans
    scan: int
    is_repeat: bool
    kinds: frozenset[str]  # of faults


def feed(
    run: PathLike,
    folder: PathLike | None = None,
    rate: float = 4.2,
    socket_path: PathLike | None = None,
    first: int = 0,
    count: int | None = None,
    lead: float = 0.0,
    wait: Callable[[float], None] = time.sleep,
    faults: Sequence[str] = (),
    tcp: str | None = None,
    secret_file: PathLike | None = None,
) -> int:
    """Play a stored run into a folder or to a socket, and return the number of frames played.

    Parameters
    ----------
    run : path
        Run store.
    folder : path, optional
        Folder to play into; it is made if need be. One of folder, ``socket_path`` and ``tcp`` is
        needed.
    rate : float, default 4.2
        Scans per second; infinity plays as fast as possible.
    socket_path : path, optional
        Unix socket that is listened on.
    first : int, default 0
        First scan that is played.
    count : int, optional
        Number of scans; None plays to the end. The end is announced only after the run's last scan.
    lead : float, default 0
        Time between description and first scan, s, as when a radar is switched on.
    wait : callable
        Waits for so many seconds.
    faults : sequence of str
        What a radar gets wrong, see :class:`Fault`. The vehicle drives on while scans are lost.
    tcp : str, optional
        TCP address that is listened on: port, or address and port, see
        ``parse_tcp``.
    secret_file : path, optional
        File of the secret that is asked for there; by default that of the environment, if there is
        one, see ``live/sockets.py``.

    Returns
    -------
    int
        The number of frames.

    Raises
    ------
    ValueError
        If an argument is not valid, or the folder or socket cannot be used.
    """
    parsed_faults = [Fault.parse(text) for text in faults]
    if not rate >= 1 / _LONGEST_WAIT:
        raise ValueError(f"rate must be positive, got {rate:g}: a scan a day is the least")
    targets = [target for target in (folder, socket_path, tcp) if target is not None]
    if len(targets) != 1:
        raise ValueError(
            f"feed needs one of a folder, a socket and a TCP address, got {len(targets)} of them"
        )
    if secret_file is not None and tcp is None:
        raise ValueError(f"secret-file goes with a TCP address, got {secret_file}")
    address = None if tcp is None else parse_tcp(tcp)
    secret = None if tcp is None else live_secret(secret_file)
    dataset = open_run(run)
    description = describe_for_live(dataset)
    total = dataset.sizes["scan"]
    if not 0 <= first < total:
        raise ValueError(f"first must be a scan of the run (0 to {total - 1}), got {first}")
    if count is not None and count < 1:
        raise ValueError(f"count must be a scan or more, got {count}")
    if not 0 <= lead <= _LONGEST_WAIT:
        raise ValueError(
            f"lead must not be negative, and a day at most ({_LONGEST_WAIT:g} s), got {lead:g}"
        )
    last = total if count is None else min(first + count, total)
    for fault in parsed_faults:
        if not first <= fault.scan < last:
            raise ValueError(
                f"fault must begin with a scan that is played ({first} to {last - 1}), "
                f"got {fault.scan}"
            )
        if fault.count > last - fault.scan:
            raise ValueError(
                f"fault must end with a scan that is played ({fault.kind}:{fault.scan} has "
                f"{last - fault.scan} to the end), got {fault.kind}:{fault.scan}:{fault.count}"
            )

    sink: _FolderSink | _SocketSink
    if folder is not None:
        sink = _FolderSink(Path(folder))
    elif address is not None:
        sink = _SocketSink(connected_tcp(address), secret)
    else:
        sink = _SocketSink(connected_unix(Path(str(socket_path))))
    with sink:
        sink.begin(description)
        if lead > 0:
            wait(lead)
        start = time.monotonic()
        frames = _playing_order(first, last, parsed_faults)
        for frame in frames:
            # Encoded before the wait, so that the frame leaves in time.
            scan = stored_scan(dataset, frame.scan)
            if "nan" in frame.kinds:
                scan.signal[0, 0] = np.nan
            if "jump" in frame.kinds and scan.pose is not None:
                scan.pose[1] += _JUMP
            data = encode_scan(scan.number, scan.signal, scan.pose, scan.time, description.run_id)
            if not math.isinf(rate):
                due = start + (frame.moment - first) / rate - time.monotonic()
                if due > 0:
                    wait(due)
            sink.scan(frame.scan, data, frame.is_repeat)
        if last == total:
            sink.end(last - first)
    return len(frames)


def _playing_order(first: int, last: int, faults: Sequence[Fault]) -> list[_PlayedFrame]:
    """Return the frames in the order in which they are played."""
    frames = []
    for scan in range(first, last):
        moment = float(scan)
        for fault in faults:
            if fault.kind == "late" and fault.scan == scan:
                moment += fault.count + 0.5
        kinds = frozenset(fault.kind for fault in faults if fault.covers(scan))
        if "lost" in kinds:
            continue
        frames.append(_PlayedFrame(moment, scan, False, kinds))
        if "twice" in kinds:
            frames.append(_PlayedFrame(moment, scan, True, kinds))
    frames.sort(key=attrgetter("moment", "scan", "is_repeat"))
    return frames


class _FolderSink(AbstractContextManager["_FolderSink"]):
    """Writes frames as files."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, description: RunDescription) -> None:
        """Hand over the description of the run."""
        path = self._folder / RUN_FILE
        if not path.exists():
            write_description(description, self._folder)
            return
        if Folder(self._folder).read(RUN_FILE) != description_text(description).encode():
            raise ValueError(
                f"folder must be empty or hold the same run, "
                f"got {self._folder} with another {RUN_FILE}"
            )
        names = {path.name for path in self._folder.iterdir()}
        earlier = sum(name.endswith(SCAN_SUFFIX) for name in names)
        if earlier:
            end = " and the end" if END_FILE in names else ""
            log_note(
                f"{self._folder} holds {earlier} scans{end} of an earlier play: "
                "what is not played again stays there"
            )

    def scan(self, number: int, frame: bytes, is_repeat: bool) -> None:
        """Hand over a frame."""
        name = Path(scan_name(number))
        file_name = f"{name.stem}-again{name.suffix}" if is_repeat else name
        write_whole(self._folder / file_name, frame)

    def end(self, scans: int) -> None:
        """Announce the end of the run."""
        write_whole(self._folder / END_FILE, json.dumps({"scans": scans}) + "\n")


class _SocketSink(AbstractContextManager["_SocketSink"]):
    """Sends frames over a connected socket."""

    def __init__(self, connection: socket.socket, secret: bytes | None = None) -> None:
        self._socket = connection
        if secret is not None:
            try:
                answer_challenge(connection, secret)
            except ValueError:
                connection.close()
                raise

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def begin(self, description: RunDescription) -> None:
        """Hand over the description of the run."""
        self._send(encode_frame("run", description.as_json()))

    def scan(self, number: int, frame: bytes, is_repeat: bool) -> None:  # noqa: ARG002
        """Hand over a frame."""
        self._send(frame)

    def end(self, scans: int) -> None:
        """Announce the end of the run."""
        self._send(encode_frame("end", {"scans": scans}))

    def _send(self, data: bytes) -> None:
        """Send bytes; a connection that the receiver closed is a ValueError."""
        try:
            self._socket.sendall(data)
        except (BrokenPipeError, ConnectionResetError):
            raise ValueError(
                "flgpr live must listen to the end, got a connection that it closed: the run ended "
                "there, it has senders enough, or it asks for a secret that is not this one"
            ) from None
