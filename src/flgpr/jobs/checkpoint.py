"""The work folder: what an interrupted detection has done so far.

A file is whole and proven by its digest, or it is made again. Nothing is flushed to the disk on
purpose: what a crash of the machine damages is found and made again. Why a resumed run gives the
same bits: ``engine.py``.

The pass cache: results of passes that jobs of other recipes share.

It is a folder that may be deleted at any time. Beside every result lies a report of what it cost.
"""

from __future__ import annotations

import json
import shutil
import time
from collections import ChainMap
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np

from flgpr import system
from flgpr.door import MOST_JSON, DoorError, Folder, open_own, refuse_links
from flgpr.engine import Accumulator, Engine, block_name
from flgpr.jobs.job import WORK_SUFFIX, LaneJob
from flgpr.jobs.workers import Report
from flgpr.method.sections import Section
from flgpr.store import Bundle, BundleError, canonical_json, sha256, write_bundle, write_whole
from flgpr.store.bundle import MOST_BUNDLE
from flgpr.store.files import PARTIAL, naming_output, own_partial
from flgpr.types import AnyArray, Arrays

SUFFIX = ".arrays"
_JOB = "job.json"
_LOCK = "lock"
_MERGE_LOCK = "folding"  # a name of earlier versions: another would make their folders foreign
KEEP_EVERY = 2.0
"""Seconds of work on a block that a stop may cost, beside the scan in progress."""
MERGE_BYTES = 1 << 28
"""States of this size together are merged early, in bytes: those of a long run fill the disk."""


class WorkError(ValueError):
    """A work folder that another process uses."""


class Checkpoint(MutableMapping[str, Mapping[str, AnyArray]]):
    """A work folder as a mapping from names to groups of arrays.

    :func:`begin_work` begins or continues a job in it.

    Parameters
    ----------
    folder : Path
        The folder.
    most : int
        Bytes of the largest file that is opened.
    """

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
        """Open a group; the latest one stays open with what was read of it."""
        latest = self._latest  # read and set in one step: several threads may ask
        if latest is None or latest[0] != name:
            if name not in self:
                raise KeyError(name)
            latest = self._latest = (name, self.bundle(name))
        return latest[1]

    def __setitem__(self, name: str, arrays: Mapping[str, AnyArray]) -> None:
        write_bundle(self.path(name), arrays)
        self._forget(name)

    def __delitem__(self, name: str) -> None:
        self.path(name).unlink()
        self._forget(name)

    def _forget(self, name: str) -> None:
        """Let go of a group that is open, as its file changes."""
        latest = self._latest
        if latest is not None and latest[0] == name:
            self._latest = None

    def with_shared(self, folder: str) -> MutableMapping[str, Any]:
        """Return the results of passes here, and of those that all sections of a lane share.

        Parameters
        ----------
        folder : str
            The work folder of the whole lane, which holds the latter; "" of a lane in one piece.
        """
        if not folder:
            return self
        return ChainMap(self, Checkpoint(Path(folder), self.most))

    def drop_damaged(self) -> list[str]:
        """Delete the groups whose files are damaged, and return their names."""
        damaged = []
        for name in list(self):
            try:
                self.bundle(name).check()
            except BundleError:
                del self[name]
                damaged.append(name)
        return damaged

    def take(self, other: Checkpoint, name: str, as_name: str) -> bool:
        """Copy a group of another folder, if it is there and whole.

        Parameters
        ----------
        other : Checkpoint
            The other folder.
        name : str
            The group's name there.
        as_name : str
            Its name here.

        Returns
        -------
        bool
            Whether it was copied.
        """
        try:
            other.bundle(name).check()
        except (OSError, BundleError):
            return False
        refuse_links(self.path(as_name))
        with own_partial(self.path(as_name)) as partial:
            try:
                partial.hardlink_to(other.path(name))  # nobody writes into a file that is there
            except OSError:
                shutil.copyfile(other.path(name), partial)
        return True

    def bundle(self, name: str) -> Bundle:
        """Open a group's file; one larger than a process may hold counts as damaged."""
        return Bundle(self.path(name), most=self.most)

    def path(self, name: str) -> Path:
        """Return the path of a group's file."""
        return self.folder / f"{name}{SUFFIX}"

    def size(self, name: str) -> int:
        """Return the bytes of a group; 0 where another process has just merged and deleted it."""
        try:
            return self.path(name).stat().st_size
        except FileNotFoundError:
            return 0

    # The states of the blocks of a pass, the first of which may have been merged early

    def merged_blocks(self, name: str) -> int:
        """Return how many blocks of a pass, from the first, have been merged early."""
        so_far = _so_far(name)
        while so_far in self:
            version = _file_version(self.path(so_far))
            try:
                return int(self.bundle(so_far)["next"])
            except BundleError:
                # Another process may have replaced the file after its head was read here.
                if _file_version(self.path(so_far)) == version:
                    raise
        return 0

    def missing_blocks(self, name: str, numbers: Sequence[int]) -> list[int]:
        """Return those of some blocks of a pass that are still to be done."""
        absent = [number for number in numbers if block_name(name, number) not in self]
        # Asked last: another process may just have merged a block and deleted its state.
        merged = self.merged_blocks(name)
        return [number for number in absent if number >= merged]

    def block_states(self, name: str, numbers: Sequence[int]) -> Iterator[Arrays]:
        """Yield the states of some blocks of a pass.

        Blocks that have been merged early have one state together, which comes first.
        """
        begun = self.merged_blocks(name)
        if begun:
            bundle = self.bundle(_so_far(name))
            yield {key: array for key, array in bundle.items() if key != "next"}
        for number in numbers:
            if number >= begun:
                yield dict(self.bundle(block_name(name, number)))

    def merge_ahead(self, engine: Engine, name: str) -> None:
        """Merge the first blocks of a pass that are done, if their states are large together.

        The bits are those of one merge of all. It is done only for passes that go through all
        blocks.
        """
        planned = engine.passes[name]
        if not planned.all_scans or planned.keep_blocks:
            return
        with _locked(self.folder / _MERGE_LOCK) as alone:
            if not alone:
                return
            begun = self.merged_blocks(name)
            so_far = _so_far(name)
            following = engine.block_numbers(name)[begun:]
            ready = list(takewhile(lambda number: block_name(name, number) in self, following))
            size = sum(self.size(block_name(name, number)) for number in ready)
            # Sums are no larger than those of one block. What grows with the scans is merged only
            # when there is twice as much of it, so that it is not written over and over.
            if not ready or size < max(MERGE_BYTES, 2 * self.size(so_far)):
                return
            accumulator = engine.merge_blocks(name, self.block_states(name, ready))
            self[so_far] = {**accumulator.state(True), "next": np.array(begun + len(ready))}
            for number in ready:
                del self[block_name(name, number)]

    def drop_blocks(self, name: str) -> None:
        """Delete the states of the blocks of a pass, which are merged."""
        for path in self.folder.glob(f"{name}-*{SUFFIX}"):
            path.unlink()


def _so_far(name: str) -> str:
    """Return the name of the state of the blocks of a pass that have been merged early."""
    return f"{name}-so-far"


def _file_version(path: Path) -> tuple[int, int]:
    """Return what changes when a file is replaced by another one."""
    status = path.stat()
    return status.st_ino, status.st_mtime_ns


class BlockCheckpoint:
    """Goes through the scans of a block and stores its state every few seconds.

    So a stop costs little of a long block.

    Parameters
    ----------
    work : Checkpoint
        The work folder.
    block : str
        Name of the block.
    every : float, optional
        Seconds between states; by default ``KEEP_EVERY``.
    """

    def __init__(self, work: Checkpoint, block: str, every: float | None = None) -> None:
        self.work = work
        self.name = f"{block}-kept"
        self.every = KEEP_EVERY if every is None else every

    def __call__(self, block: range, accumulator: Accumulator) -> Iterator[int]:
        """Yield the scans of a block that were not gathered before a stop.

        A scan counts as gathered when the next is asked for.
        """
        begun = block.start
        if self.name in self.work:
            stored = dict(self.work[self.name])
            begun = int(stored.pop("next"))
            accumulator.merge(stored)
        last = time.monotonic()
        for index in range(begun, block.stop):
            yield index
            if index + 1 < block.stop and time.monotonic() - last >= self.every:
                self.work[self.name] = {**accumulator.state(True), "next": np.array(index + 1)}
                last = time.monotonic()

    def drop(self) -> None:
        """Delete the state that was stored, as the block is done."""
        if self.name in self.work:
            del self.work[self.name]


@contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Lock a file while the context lasts; yield whether no other process holds the lock."""
    with open(path, "ab", opener=open_own) as lock:
        try:
            system.lock(lock)
        except OSError:
            yield False
        else:
            yield True


@contextmanager
def work_until_done(job: LaneJob, sections: Sequence[Section] = ()) -> Iterator[Checkpoint]:
    """Begin the work folder of a job, or continue it, and delete it once the job is done.

    It is done where the context ends without an error; else the folder stays. Parameters and errors
    are those of :func:`begin_work`.
    """
    with begin_work(job, sections) as work:
        yield work
        finish(job.work)


def begin_work(
    job: LaneJob, sections: Sequence[Section] = ()
) -> AbstractContextManager[Checkpoint]:
    """Begin the work folder of a job, or continue it, see :func:`begin`. It stays.

    Parameters
    ----------
    job : LaneJob
        The job.
    sections : sequence of Section
        Those that share the folder, where the lane is taken in several.
    """
    identity = job.identity
    if sections:
        identity["rows"] = [[section.start, section.stop] for section in sections]
    return begin(job.work, identity, job.largest)


@contextmanager
def begin(folder: Path, job: dict[str, Any], most: int = MOST_BUNDLE) -> Iterator[Checkpoint]:
    """Begin a job in a work folder, or continue it. No other process can while the context lasts.

    What belongs to another job, or is damaged, is deleted.

    Parameters
    ----------
    folder : Path
        The work folder.
    job : dict
        All that the outcome depends on, as JSON holds it.
    most : int
        Bytes of the largest file that is opened.

    Yields
    ------
    Checkpoint
        The work folder.

    Raises
    ------
    WorkError
        If another process works there.
    FileExistsError
        If the folder holds what no work folder holds, or is a symbolic link.
    """
    refuse_links(folder, done_folder(folder))
    output = _output_of(folder)
    content = canonical_json({"format": "flgpr-work", "version": 2, "job": job}) + b"\n"
    with naming_output(output):  # nobody has typed the name of the work folder
        folder.mkdir(exist_ok=True)
        with _locked(folder / _LOCK) as alone:
            if not alone:
                raise WorkError(
                    f"{output}: another process is at work on it: wait until it is done, "
                    "or choose another output"
                )
            _prepare(folder, content)
            checkpoint = Checkpoint(folder, most)
            checkpoint.drop_damaged()
            yield checkpoint


def _output_of(folder: Path) -> Path:
    """Return the output that is made in a work folder."""
    return folder.with_name(folder.name.removesuffix(WORK_SUFFIX))


def _prepare(folder: Path, job: bytes) -> None:
    """Delete what belongs to another job, and write what this one is."""
    foreign = [path for path in folder.iterdir() if not _is_ours(path)]
    if foreign:
        raise FileExistsError(
            f"{_output_of(folder)}: unfinished work goes into {folder.name} beside it, which must "
            f"hold nothing else, got {foreign[0].name}: move it away or choose another output"
        )
    for path in folder.glob(f"*{PARTIAL}"):
        path.unlink()
    with suppress(FileNotFoundError, DoorError):
        if Folder(folder).read(_JOB, MOST_JSON) == job:
            return
    for path in folder.glob(f"*{SUFFIX}"):
        path.unlink()
    write_whole(folder / _JOB, job)


def _is_ours(path: Path) -> bool:
    """Return whether a path is a regular file of a name that work folders have."""
    regular = path.is_file() and not path.is_symlink()
    return regular and (path.name in (_JOB, _LOCK, _MERGE_LOCK) or path.suffix in (SUFFIX, PARTIAL))


def done_folder(folder: Path) -> Path:
    """Return the name under which a work folder is deleted."""
    return folder.with_name(f"{folder.name}.done")


def finish(folder: Path) -> None:
    """Delete a work folder whose job is done."""
    done = done_folder(folder)
    refuse_links(folder, done)
    shutil.rmtree(done, ignore_errors=True)
    folder.rename(done)
    shutil.rmtree(done, ignore_errors=True)


_LAYOUT = 2  # to be raised when the arrays that jobs share change
_COSTS = ("seconds", "processor_seconds")
"""Entries of reports that add up."""


class PassCache:
    """The pass cache of a job; without a folder nothing is shared.

    Parameters
    ----------
    job : LaneJob
        The job.
    """

    def __init__(self, job: LaneJob) -> None:
        self._job = job
        self._folder = Path(job.pass_cache)
        self._results = Checkpoint(self._folder, job.largest)
        self._reports = Folder(self._folder)

    def name_of(self, name: str, depends_on: Mapping[str, Any] | None) -> str | None:
        """Return the name that the result of a pass has in the cache.

        Parameters
        ----------
        name : str
            Name of the pass.
        depends_on : mapping or None
            What of the recipe its result depends on; None if no other recipe can use the result.

        Returns
        -------
        str or None
            The name; None if the result is not shared.
        """
        if not self._job.pass_cache or depends_on is None:
            return None
        identity = self._job.identity
        context = {key: identity[key] for key in ("run", "lane", "code", "cpu", "block", "others")}
        for key in ("left_out", "left_out_of_others"):
            if key in identity:
                context[key] = identity[key]
        context["layout"] = _LAYOUT
        return sha256(canonical_json([context, name, depends_on]))[:32]

    def take(self, shared_name: str, work: Checkpoint, name: str) -> Report | None:
        """Take the result of a pass into a work folder.

        Returns
        -------
        Report or None
            What it cost the first job; None if the cache does not hold the result.
        """
        if not work.take(self._results, shared_name, name):
            return None
        report: Report = self._reports.json(f"{shared_name}.json")
        return report | {"lane": self._job.name}

    def leave(
        self, shared_name: str, work: Checkpoint, name: str, reports: Sequence[Report]
    ) -> None:
        """Leave the result of a pass in the cache, with what its blocks and their merge cost."""
        self._folder.mkdir(parents=True, exist_ok=True)
        cost = dict(reports[-1])
        for entry in _COSTS:
            cost[entry] = sum(report[entry] for report in reports)
        cost["peak_bytes"] = max(report["peak_bytes"] for report in reports)
        write_whole(self._folder / f"{shared_name}.json", json.dumps(cost))
        self._results.take(work, name, shared_name)
