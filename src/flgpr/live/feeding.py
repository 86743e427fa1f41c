"""Plays a stored run as a radar would hand it over: scan by scan into a folder or a socket."""

from __future__ import annotations

import json
import math
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flgpr.door import Folder
from flgpr.store import (
    RunDescription,
    describe_for_live,
    encode_frame,
    encode_scan,
    open_run,
    write_description,
    write_whole,
)
from flgpr.store.scan_file import END_FILE, RUN_FILE, scan_name

PathLike = str | Path
FAULTS = ("lost", "late", "twice", "nan", "jump")
_JUMP = 45.0  # m along the lane, by which a position is wrong that jumps


@dataclass(frozen=True)
class Fault:
    """What goes wrong from a scan on: so many are lost, come twice, have a sweep of NaN or a pose that is 45 m off.

    One comes so much later.
    """

    kind: str
    scan: int
    count: int

    @classmethod
    def parse(cls, text: str) -> Fault:
        """Read ``KIND:SCAN`` or ``KIND:SCAN:COUNT``, such as ``lost:40:13``."""
        kind, _, rest = text.partition(":")
        numbers = rest.split(":")
        if (
            kind not in FAULTS
            or len(numbers) > 2
            or not all(n.isascii() and n.isdigit() for n in numbers)
        ):
            raise ValueError(
                f"fault must be {', '.join(FAULTS)} with a scan and a number, as lost:40:5, got {text!r}"
            )
        return cls(kind, int(numbers[0]), int(numbers[1]) if len(numbers) == 2 else 1)


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
) -> int:
    """Play a stored run into a folder, made if need be, or a Unix socket, and give the number of frames played.

    ``rate`` is in scans per second; infinity plays as fast as possible. The end is announced only after the run's last
    scan. ``lead`` is the time between description and first scan, s, as when a radar is switched on; ``wait`` waits.
    ``faults`` rehearse what a radar gets wrong, see :class:`Fault`: the vehicle drives on while scans are lost.
    """
    wrong = [Fault.parse(text) for text in faults]
    if not rate > 0:
        raise ValueError(f"rate must be positive, got {rate}")
    if (folder is None) == (socket_path is None):
        raise ValueError("feed needs a folder or a socket, and not both")
    dataset = open_run(run)
    description = describe_for_live(dataset)
    total = dataset.sizes["scan"]
    if not 0 <= first < total:
        raise ValueError(f"first must be a scan of the run (0 to {total - 1}), got {first}")
    last = total if count is None else min(first + count, total)
    beyond = [fault.scan for fault in wrong if not first <= fault.scan < last]
    if beyond:
        raise ValueError(
            f"fault must begin with a scan that is played ({first} to {last - 1}), got {beyond[0]}"
        )
    sink = _FolderSink(Path(folder)) if folder is not None else _SocketSink(Path(str(socket_path)))
    with sink:
        sink.begin(description)
        if lead > 0:
            wait(lead)
        start = time.monotonic()
        played = _played(first, last, wrong)
        for moment, scan, again, kinds in played:
            one = dataset.isel(scan=scan)
            signal = np.array(one["signal"].values)
            pose = np.array(one["pose"].values)
            if "nan" in kinds:
                signal[0, 0] = np.nan
            if "jump" in kinds:
                pose[1] += _JUMP
            frame = encode_scan(scan, signal, pose, float(one["time"]), description.run_id)
            due = 0.0 if math.isinf(rate) else start + (moment - first) / rate - time.monotonic()
            if due > 0:
                wait(due)
            sink.scan(scan, frame, again)
        if last == total:
            sink.end(total)
    return len(played)


def _played(
    first: int, last: int, faults: Sequence[Fault]
) -> list[tuple[float, int, bool, frozenset[str]]]:
    """Order what is played: when, in scans, which scan, whether once more, and the faults that it has."""
    played = []
    for scan in range(first, last):
        late = sum(
            fault.count + 0.5 for fault in faults if fault.kind == "late" and fault.scan == scan
        )
        kinds = frozenset(
            fault.kind for fault in faults if fault.scan <= scan < fault.scan + fault.count
        )
        if "lost" not in kinds:
            played += [
                (scan + late, scan, again, kinds)
                for again in (False, True)[: 1 + ("twice" in kinds)]
            ]
    return sorted(played, key=lambda one: one[:3])


class _FolderSink(AbstractContextManager["_FolderSink"]):
    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, description: RunDescription) -> None:
        path = self._folder / RUN_FILE
        if not path.exists():
            write_description(description, self._folder)
        elif (
            Folder(self._folder).read(RUN_FILE)
            != (json.dumps(description.as_json(), indent=1) + "\n").encode()
        ):
            raise ValueError(
                f"folder must be empty or hold the same run, got {self._folder} with another {RUN_FILE}"
            )

    def scan(self, number: int, frame: bytes, again: bool) -> None:
        name = Path(scan_name(number))
        write_whole(self._folder / (f"{name.stem}-again{name.suffix}" if again else name), frame)

    def end(self, scans: int) -> None:
        write_whole(self._folder / END_FILE, json.dumps({"scans": scans}) + "\n")


class _SocketSink(AbstractContextManager["_SocketSink"]):
    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(str(path))
        except OSError as error:
            self._socket.close()
            reason = error.strerror or "its path is too long"
            raise ValueError(
                f"socket must be one that flgpr live listens on, got {path}: {reason}"
            ) from None

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def begin(self, description: RunDescription) -> None:
        self._socket.sendall(encode_frame("run", description.as_json()))

    def scan(self, number: int, frame: bytes, again: bool) -> None:  # noqa: ARG002
        self._socket.sendall(frame)

    def end(self, scans: int) -> None:
        self._socket.sendall(encode_frame("end", {"scans": scans}))
