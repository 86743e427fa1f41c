"""Files that only grow, line by line: journals of writers and registers of trials.

One process at a time holds a log. A line is on the disk, with its folder's entry, before it counts.
What a kill or a full disk leaves of a line, text without its end, is dropped before the next line
is added, so that it cannot spoil that. Until then nothing changes: whoever holds a file that is no
log of theirs can still leave it as it is.
"""

from __future__ import annotations

import os
import stat
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from flgpr import system

MOST_BYTES = 2**30
"""Most bytes that a log may have."""
_PAUSE = 0.02  # s between two tries to hold a log


class LogHeldError(ValueError):
    """Another process holds the log."""


class AppendLog:
    """A log held by this process alone, until :meth:`close` or the end of a ``with`` block.

    Parameters
    ----------
    path : Path
        The file, made if it is missing, with its folder.
    wait : float
        Time to wait for another process that holds it, s.

    Attributes
    ----------
    lines : list of bytes
        Complete lines without their ends.
    torn : bytes
        Text after the last of them, which goes when a line is added or dropped.

    Raises
    ------
    LogHeldError
        If another process still holds it.
    ValueError
        If the path is no regular file, or one of more than ``MOST_BYTES``.
    """

    def __init__(self, path: Path, wait: float = 0.0) -> None:
        self.path = path
        self._file = _hold(path, wait)
        try:
            text = _read(self._file, self.path)
            *self.lines, self.torn = text.split(b"\n")
            self._ends: list[int] = []
            end = 0
            for line in self.lines:
                end += len(line) + 1
                self._ends.append(end)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def append(self, line: bytes, settled: bool = True) -> None:
        """Add a line so that it is on the disk; if that fails the log stays as it was.

        One that is not ``settled`` is on the disk with the next that is.
        """
        if b"\n" in line:
            raise ValueError("line must not hold the end of a line")
        if self.torn:
            self.keep(len(self.lines))
        try:
            write_all(self._file, line + b"\n")
            if settled:
                os.fsync(self._file.fileno())
        except BaseException:
            self._file.truncate(self._ends[-1] if self._ends else 0)
            raise
        self.lines.append(line)
        self._ends.append(self._file.seek(0, os.SEEK_END))

    def keep(self, count: int) -> None:
        """Drop all lines but the first ``count``."""
        self._file.truncate(self._ends[count - 1] if count else 0)
        os.fsync(self._file.fileno())
        self.torn = b""
        del self.lines[count:]
        del self._ends[count:]

    def close(self) -> None:
        """Close the log, which another process may then hold."""
        self._file.close()


def read_log(path: Path, wait: float = 0.0) -> tuple[list[bytes], bytes]:
    """Return the complete lines of a log, and the text after the last one, changing nothing.

    It waits up to ``wait`` seconds for a process that is adding a line. A missing log has no lines.
    """
    try:
        file = _open(path, os.O_RDONLY)
    except FileNotFoundError:
        return [], b""
    with file:
        _lock(file, path, wait, shared=True)
        *lines, torn = _read(file, path).split(b"\n")
    return lines, torn


def _hold(path: Path, wait: float) -> BinaryIO:
    """Open and lock a log.

    It begins again if its folder was removed or another file took its name meanwhile.
    """
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        is_new = not os.path.lexists(path)
        try:
            file = _open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        except FileNotFoundError:
            continue
        try:
            _lock(file, path, wait)
        except BaseException:
            file.close()
            raise
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                if is_new:
                    sync_directory(path.parent)
                return file
        file.close()


def _open(path: Path, flags: int) -> BinaryIO:
    """Open a regular file; what is no file is a ValueError, and never waited for."""
    handle = os.open(path, flags | system.AT_ONCE | system.PLAIN, 0o666)
    try:
        state = os.fstat(handle)
        if not stat.S_ISREG(state.st_mode):
            raise ValueError(f"{path}: must be a regular file, got something else")
    except BaseException:
        os.close(handle)
        raise
    return os.fdopen(handle, "rb" if flags == os.O_RDONLY else "ab+", buffering=0)


def _lock(file: BinaryIO, path: Path, wait: float, shared: bool = False) -> None:
    """Lock an open file, and try again for ``wait`` seconds if another process holds it."""
    end = time.monotonic() + wait
    while True:
        try:
            system.lock(file, shared=shared)
            return
        except BlockingIOError:
            if time.monotonic() >= end:
                raise LogHeldError(
                    f"{path}: another process holds it: try again when that is done"
                ) from None
        time.sleep(_PAUSE)


def _read(file: BinaryIO, path: Path) -> bytes:
    """Read a log from its beginning, up to its size at this moment."""
    size = os.fstat(file.fileno()).st_size
    if size > MOST_BYTES:
        raise ValueError(
            f"{path}: must have at most {MOST_BYTES / 2**20:g} MiB, got {size / 2**20:.0f}"
        )
    file.seek(0)
    blocks = []
    left = size
    while left > 0:
        block = file.read(left)
        if not block:
            break
        blocks.append(block)
        left -= len(block)
    return b"".join(blocks)


def write_all(file: BinaryIO, data: bytes) -> None:
    """Write all data to an unbuffered file, which may take a part only when the disk is full."""
    left = memoryview(data)
    while left:
        left = left[file.write(left) :]


def sync_directory(path: Path) -> None:
    """Flush the entries of a directory to disk, where a directory can be opened."""
    if not system.OPENS_FOLDERS:
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
