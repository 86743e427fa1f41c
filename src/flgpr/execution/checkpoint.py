"""The work folder: what an interrupted detection has done so far, in files that are whole and proven or absent.

Nothing is flushed to the disk on purpose: what a crash of the machine tears is found out and made
again.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import time
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.chain.engine import Gatherer
from flgpr.door import MOST_JSON, DoorError, Folder, open_own
from flgpr.store import Bundle, BundleError, canonical_json, write_bundle, write_whole
from flgpr.store.bundle import MOST_BUNDLE, PARTIAL

SUFFIX = ".arrays"
_JOB = "job.json"
_LOCK = "lock"
_MERGING = "folding"
KEEP_EVERY = 2.0
"""Seconds of work on a block that a stop may cost besides the scan in flight."""


class WorkError(ValueError):
    """A work folder is in use, or not a work folder at all."""


class Checkpoint(MutableMapping[str, Mapping[str, NDArray[Any]]]):
    """A work folder as a mapping from names to groups of arrays; :func:`begin` begins or goes on with a job."""

    def __init__(self, folder: Path, most: int = MOST_BUNDLE) -> None:
        self.folder = folder
        self.most = most
        self._latest: tuple[str, Bundle] | None = None

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __iter__(self) -> Iterator[str]:
        for path in sorted(self.folder.glob(f"*{SUFFIX}")):
            yield path.name.removesuffix(SUFFIX)

    def __contains__(self, name: object) -> bool:
        path = self.path(str(name))
        return path.is_file() and not path.is_symlink()

    def __getitem__(self, name: str) -> Bundle:
        """Open a group; the one asked for last is kept open with what was read of it."""
        latest = self._latest  # read and set in one step: several threads may ask
        if latest is None or latest[0] != name:
            if name not in self:
                raise KeyError(name)
            latest = self._latest = (name, self.bundle(name))
        return latest[1]

    def __setitem__(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        write_bundle(self.path(name), arrays)
        self._forget(name)

    def __delitem__(self, name: str) -> None:
        self.path(name).unlink()
        self._forget(name)

    def _forget(self, name: str) -> None:
        latest = self._latest
        if latest is not None and latest[0] == name:
            self._latest = None

    def drop_blocks(self, name: str) -> None:
        """Delete the states of the blocks of a pass, which are merged."""
        for path in self.folder.glob(f"{name}-*{SUFFIX}"):
            path.unlink()

    def merging(self) -> AbstractContextManager[bool]:
        """Return whether nobody else merges states here; nobody else does while the context lasts."""
        return _locked(self.folder / _MERGING)

    def drop_damaged(self) -> list[str]:
        """Delete what is not whole, and give its names."""
        bad = []
        for name in list(self):
            try:
                self.bundle(name).check()
            except BundleError:
                del self[name]
                bad.append(name)
        return bad

    def take(self, other: Checkpoint, name: str, as_name: str) -> bool:
        """Take a group of another folder over, under a name of its own, if it is there and whole."""
        try:
            other.bundle(name).check()
        except (OSError, BundleError):
            return False
        beside = self.path(as_name).with_suffix(f".{os.getpid()}-{os.urandom(4).hex()}{PARTIAL}")
        try:
            beside.hardlink_to(other.path(name))  # nobody writes into a file that is there
        except OSError:
            shutil.copyfile(other.path(name), beside)
        beside.replace(self.path(as_name))
        return True

    def bundle(self, name: str) -> Bundle:
        """Open a group's file; one larger than a process may hold is damaged, however it came there."""
        return Bundle(self.path(name), most=self.most)

    def path(self, name: str) -> Path:
        """File of a group."""
        return self.folder / f"{name}{SUFFIX}"

    def size(self, name: str) -> int:
        """Bytes of a group, none where another has just folded and deleted it."""
        try:
            return self.path(name).stat().st_size
        except FileNotFoundError:
            return 0


class BlockCheckpoint:
    """Goes through the scans of a block and stores its state every few seconds: a stop costs little of a long block."""

    def __init__(self, work: Checkpoint, block: str, every: float | None = None) -> None:
        self.work = work
        self.name = f"{block}-kept"
        self.every = KEEP_EVERY if every is None else every

    def __call__(self, block: range, gatherer: Gatherer) -> Iterator[int]:
        """Yield a block's scans from where it was left; one counts as gathered when the next is asked for."""
        begun = block.start
        if self.name in self.work:
            stored = dict(self.work[self.name])
            begun = int(stored.pop("next"))
            gatherer.merge(stored)
        last = time.monotonic()
        for index in range(begun, block.stop):
            yield index
            if index + 1 < block.stop and time.monotonic() - last >= self.every:
                self.work[self.name] = {**gatherer.state(True), "next": np.array(index + 1)}
                last = time.monotonic()

    def drop(self) -> None:
        """Delete what was stored; the block is done."""
        if self.name in self.work:
            del self.work[self.name]


@contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Return whether nobody else holds the lock of a file; nobody else does while the context lasts."""
    with open(path, "ab", opener=open_own) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            yield False
        else:
            yield True


@contextmanager
def begin(folder: Path, job: dict[str, Any], most: int = MOST_BUNDLE) -> Iterator[Checkpoint]:
    """Begin a job in a work folder, or go on with it; no other process can begin while the context lasts.

    ``job`` holds all that the outcome depends on, as JSON, and ``most`` is the size of the largest
    file in bytes. What belongs to another job, or is damaged, is deleted; anything that a work
    folder does not hold is refused.
    """
    folder.mkdir(exist_ok=True)
    with _locked(folder / _LOCK) as alone:
        if not alone:
            raise WorkError(f"{folder}: another process is at work here")
        _prepare(folder, canonical_json({"format": "flgpr-work", "version": 2, "job": job}) + b"\n")
        checkpoint = Checkpoint(folder, most)
        checkpoint.drop_damaged()
        yield checkpoint


def _prepare(folder: Path, job: bytes) -> None:
    foreign = [path for path in folder.iterdir() if not _is_ours(path)]
    if foreign:
        raise FileExistsError(f"work folder must hold nothing else, got {foreign[0]}")
    for path in folder.glob(f"*{PARTIAL}"):
        path.unlink()
    note = folder / _JOB
    with suppress(FileNotFoundError, DoorError):
        if Folder(folder).read(_JOB, MOST_JSON) == job:
            return
    for path in folder.glob(f"*{SUFFIX}"):
        path.unlink()
    write_whole(note, job)


def _is_ours(path: Path) -> bool:
    regular = path.is_file() and not path.is_symlink()
    return regular and (path.name in (_JOB, _LOCK, _MERGING) or path.suffix in (SUFFIX, PARTIAL))


def finish(folder: Path) -> None:
    """Delete a work folder whose job is done."""
    done = folder.with_name(f"{folder.name}.done")
    shutil.rmtree(done, ignore_errors=True)
    folder.rename(done)
    shutil.rmtree(done, ignore_errors=True)
