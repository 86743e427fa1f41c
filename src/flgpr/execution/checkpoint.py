"""The work folder: what an interrupted detection has done so far, in files that are whole and proven or absent.

A file holds named arrays: one line with the length and the SHA-256 of a JSON head, the head, and the arrays' bytes. The
head tells every array's type, shape, place and SHA-256, so that arrays can be read one by one and each is checked when
it is. Nothing is flushed to the disk on purpose: what a crash of the machine tears is found out and made again.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from flgpr.chain.passes import Accumulator, Arrays
from flgpr.io import canonical_json, sha256, write_whole

SUFFIX = ".arrays"
_JOB, _LOCK, _PARTIAL = "job.json", "lock", ".partial"
_KINDS, _ALIGN = "biufcU", 64
_LONGEST_HEAD = 2**22
KEEP_EVERY = 2.0
"""Seconds of work on a block that a stop may cost besides the scan in flight."""


class WorkError(ValueError):
    """A work folder is in use, damaged, or not a work folder at all."""


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> int:
    """Write named arrays of numbers, booleans or text to a file that appears whole or not at all; give its bytes."""
    head: list[dict[str, Any]] = []
    place, held = 0, []
    for name, value in arrays.items():
        value = np.asarray(value, order="C")
        if value.dtype.kind not in _KINDS:
            raise ValueError(f"{name} must hold numbers, booleans or text, got {value.dtype}")
        data = value.reshape(-1).view(np.uint8)
        digest = hashlib.sha256(data.data).hexdigest()
        about = {"name": name, "dtype": value.dtype.str, "shape": list(value.shape), "at": place, "sha256": digest}
        head.append(about)
        held.append(data)
        place += -(-data.size // _ALIGN) * _ALIGN
    text = canonical_json(head)
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{os.urandom(4).hex()}{_PARTIAL}")
    with temporary.open("wb") as file:
        file.write(f"{len(text)} {sha256(text)}\n".encode())
        file.write(text)
        for data in held:
            file.write(data.data)
            file.write(bytes(-data.size % _ALIGN))
        size = file.tell()
    temporary.replace(path)
    return size


class ArrayFile(Mapping[str, NDArray[Any]]):
    """Named arrays of a file, read and checked one by one when they are first asked for, and then kept.

    A file of :func:`write_arrays` that is not whole is a WorkError.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._kept: Arrays = {}
        try:
            with path.open("rb") as file:
                self._head, self._start = _read_head(file)
                size = file.seek(0, os.SEEK_END)
            needed = max((one["at"] + _bytes(one) for one in self._head.values()), default=0)
            if size < self._start + needed:
                raise ValueError(f"{size} bytes of {self._start + needed}")
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise WorkError(f"{path}: not a whole file of arrays ({error})") from None

    def __len__(self) -> int:
        return len(self._head)

    def __iter__(self) -> Iterator[str]:
        return iter(self._head)

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._kept:
            self._kept[name] = self._read(name, self._head[name])
        return self._kept[name]

    def check(self) -> None:
        """Read every array and keep none; a damaged one is a WorkError."""
        for name, one in self._head.items():
            self._read(name, one)

    def _read(self, name: str, one: dict[str, Any]) -> NDArray[Any]:
        with self.path.open("rb") as file:
            file.seek(self._start + one["at"])
            data = np.fromfile(file, np.uint8, _bytes(one))
        if hashlib.sha256(data.data).hexdigest() != one["sha256"]:
            raise WorkError(f"{self.path}: {name} is damaged; delete the file and run again")
        return data.view(np.dtype(one["dtype"])).reshape(one["shape"])


def _read_head(file: BinaryIO) -> tuple[dict[str, dict[str, Any]], int]:
    length, _, digest = file.readline(128).decode("ascii").rstrip("\n").partition(" ")
    if not length.isdecimal() or int(length) > _LONGEST_HEAD:
        raise ValueError("no head")
    text = file.read(int(length))
    if sha256(text) != digest:
        raise ValueError("the head is damaged")
    head = {one["name"]: one for one in json.loads(text)}
    for one in head.values():
        if np.dtype(one["dtype"]).kind not in _KINDS:
            raise ValueError(f"type {one['dtype']}")
    return head, file.tell()


def _bytes(one: dict[str, Any]) -> int:
    count = np.dtype(one["dtype"]).itemsize
    for length in one["shape"]:
        count *= length
    return int(count)


class Checkpoint(MutableMapping[str, Mapping[str, NDArray[Any]]]):
    """A work folder as a mapping from names to groups of arrays; :func:`begin` begins or goes on with a job."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._latest: tuple[str, ArrayFile] | None = None

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __iter__(self) -> Iterator[str]:
        for path in sorted(self.folder.glob(f"*{SUFFIX}")):
            yield path.name.removesuffix(SUFFIX)

    def __contains__(self, name: object) -> bool:
        return self.path(str(name)).is_file()

    def __getitem__(self, name: str) -> ArrayFile:
        """Open a group; the one asked for last is kept open with what was read of it."""
        if self._latest is None or self._latest[0] != name:
            if name not in self:
                raise KeyError(name)
            self._latest = (name, ArrayFile(self.path(name)))
        return self._latest[1]

    def __setitem__(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        write_arrays(self.path(name), arrays)
        self._latest = None

    def __delitem__(self, name: str) -> None:
        self.path(name).unlink()
        self._latest = None

    def drop_parts(self, stage: str) -> None:
        """Delete the parts of a stage that is folded."""
        for path in self.folder.glob(f"{stage}-*{SUFFIX}"):
            path.unlink()

    def drop_damaged(self) -> list[str]:
        """Delete what is not whole, and give its names."""
        bad = []
        for name in list(self):
            try:
                ArrayFile(self.path(name)).check()
            except WorkError:
                del self[name]
                bad.append(name)
        return bad

    def path(self, name: str) -> Path:
        """File of a group."""
        return self.folder / f"{name}{SUFFIX}"

    def size(self, name: str) -> int:
        """Bytes of a group."""
        return self.path(name).stat().st_size


class Kept:
    """Goes through a block and keeps what was gathered every few seconds: a stop costs little of a long block."""

    def __init__(self, work: Checkpoint, part: str, every: float | None = None) -> None:
        self.work, self.name = work, f"{part}-kept"
        self.every = KEEP_EVERY if every is None else every

    def __call__(self, block: range, gathered: Accumulator) -> Iterator[int]:
        """Give a block's scans from where it was left; one counts as gathered when the next is asked for."""
        begun = block.start
        if self.name in self.work:
            kept = dict(self.work[self.name])
            begun = int(kept.pop("next"))
            gathered.merge(kept)
        last = time.monotonic()
        for place in range(begun, block.stop):
            yield place
            if place + 1 < block.stop and time.monotonic() - last >= self.every:
                self.work[self.name] = {**gathered.state(True), "next": np.array(place + 1)}
                last = time.monotonic()

    def drop(self) -> None:
        """Delete what was kept; the block is done."""
        if self.name in self.work:
            del self.work[self.name]


@contextmanager
def begin(folder: Path, job: dict[str, Any]) -> Iterator[Checkpoint]:
    """Begin a job in a work folder, or go on with it where it was interrupted.

    ``job`` holds all that the outcome depends on, as JSON. What belongs to another job, or is damaged, is deleted.
    While the context lasts no other process can begin. A folder with other files in it is refused.
    """
    folder.mkdir(exist_ok=True)
    with (folder / _LOCK).open("ab") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise WorkError(f"{folder}: another process is at work here") from None
        _prepare(folder, canonical_json({"format": "flgpr-work", "version": 1, "job": job}) + b"\n")
        checkpoint = Checkpoint(folder)
        checkpoint.drop_damaged()
        yield checkpoint


def _prepare(folder: Path, job: bytes) -> None:
    foreign = [path for path in folder.iterdir() if not _is_ours(path)]
    if foreign:
        raise FileExistsError(f"work folder must hold nothing else, got {foreign[0]}")
    for path in folder.glob(f"*{_PARTIAL}"):
        path.unlink()
    note = folder / _JOB
    if note.is_file() and note.read_bytes() == job:
        return
    for path in folder.glob(f"*{SUFFIX}"):
        path.unlink()
    write_whole(note, job)


def _is_ours(path: Path) -> bool:
    return path.is_file() and (path.name in (_JOB, _LOCK) or path.suffix in (SUFFIX, _PARTIAL))


def finish(folder: Path) -> None:
    """Delete a work folder whose job is done."""
    done = folder.with_name(f"{folder.name}.done")
    shutil.rmtree(done, ignore_errors=True)
    folder.rename(done)
    shutil.rmtree(done, ignore_errors=True)
