"""Workers: who does the work of jobs, and the pieces of work that they do.

This process, other processes of this machine or a Dask cluster: all take a function of a module and
a list of arguments, and yield what the function returns as the work gets done. What they return is
small: arrays go through the work folder.
"""

from __future__ import annotations

import multiprocessing
import os
import socket
import sys
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import numba
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr import system
from flgpr.chain.engine import Arrays, Engine, block_name, run_pieces, worker_state
from flgpr.chain.lane_setup import LaneSetup
from flgpr.chain.method import detection_of, engine_of
from flgpr.chain.model import trained_on
from flgpr.chain.progress import Track, silent
from flgpr.chain.searched import searched_ground
from flgpr.chain.sections import section_lane, section_note
from flgpr.execution.checkpoint import BlockCheckpoint, Checkpoint
from flgpr.execution.job import LaneJob, code_versions, open_lane, processor
from flgpr.model import Lane
from flgpr.report import report_html
from flgpr.results.description import describe_run
from flgpr.results.result import add_files, read_result, write_result
from flgpr.store import MAX_MEMORY
from flgpr.store.extras import optional

PathLike = str | Path
Report = dict[str, Any]
OnReport = Callable[[Report], None]
"""Takes a report of every piece of work that was done."""
Work = Callable[..., Report]
_TRIALS = 3  # times that work is begun before lost workers end it
_PATIENCE = "20s"  # with a scheduler that does not answer
_SLOW = ("dask.array", "sklearn")
"""What takes longest to import of what the work may need.

Workers are forked with it where this process has needed it.
"""

_OPENING = threading.Lock()
_ONE_AT_A_TIME = threading.Lock()
_Clocks = tuple[float, float]
"""Readings of the clocks of the wall and of the process, s."""


def ignore_report(report: Report) -> None:
    """Take a report and do nothing."""


class LostWorkersError(ValueError):
    """Workers were lost time and again."""


class StoppedError(RuntimeError):
    """The work was stopped by another thread."""


class Executor(AbstractContextManager["Executor"]):
    """Does pieces of work; at its exit the workers go, after an error before they have done all."""

    parallel = True
    """Whether work is done elsewhere, so that several callers may wait at once."""
    _is_stopped = False

    def stop(self) -> None:
        """Let callers in other threads end with a StoppedError at the next piece that is done."""
        self._is_stopped = True

    def _check_stopped(self) -> None:
        """Raise a StoppedError if the work is to end."""
        if self._is_stopped:
            raise StoppedError("the work was stopped")

    @abstractmethod
    def run(
        self, work: Work, arguments: Sequence[tuple[Any, ...]], threads: int = 1
    ) -> Generator[Report]:
        """Do a piece of work for each set of arguments and yield what it returns, in any order.

        Close the generator where it may not be used up.

        Parameters
        ----------
        work : callable
            A function of a module.
        arguments : sequence of tuple
            The arguments of every piece.
        threads : int
            How many pieces a single process may do at once.
        """


class InProcess(Executor):
    """Does everything in this process."""

    parallel = False

    def __exit__(self, *_: object) -> None:
        pass

    def run(
        self, work: Work, arguments: Sequence[tuple[Any, ...]], threads: int = 1
    ) -> Generator[Report]:
        """Hand the work to threads, and yield in its order."""
        yield from run_pieces(work, arguments, threads)


class Processes(Executor):
    """Does the work in processes of this machine, which share its processors evenly.

    They end when this process does. If one is killed, its work is begun anew. Scripts use it under
    ``if __name__ == "__main__"``, since it imports them.

    Parameters
    ----------
    count : int
        Number of processes.
    """

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError(f"workers must be at least 1, got {count}")
        self.count = count
        self._lock = threading.Lock()
        self._pool: ProcessPoolExecutor | None = None

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None

    def run(
        self,
        work: Work,
        arguments: Sequence[tuple[Any, ...]],
        threads: int = 1,  # noqa: ARG002
    ) -> Generator[Report]:
        """Hand the work to the processes; yield first what is done first.

        Raises
        ------
        LostWorkersError
            If processes are killed time and again.
        """
        left = list(arguments)
        for _ in range(_TRIALS):
            self._check_stopped()
            pool = self._pool or self._begin(None)
            waiting: dict[Future[Report], tuple[Any, ...]] = {}
            try:
                for piece in left:
                    waiting[pool.submit(work, *piece)] = piece
            except BrokenProcessPool:
                pass
            submitted = len(waiting)
            broken = submitted < len(left)
            undone = left[submitted:]
            for future in as_completed(waiting):
                self._check_stopped()
                try:
                    yield future.result()
                except BrokenProcessPool:
                    broken = True
                    undone.append(waiting[future])
            if not broken:
                return
            left = undone
            self._begin(pool)
        raise LostWorkersError(
            f"workers must live to do their work, they were killed {_TRIALS} times: out of memory?"
        )

    def _begin(self, broken: ProcessPoolExecutor | None) -> ProcessPoolExecutor:
        """Return new processes, or those that another thread started after the broken ones."""
        with self._lock:
            if self._pool is None or self._pool is broken:
                context = multiprocessing.get_context(system.start_method())
                slow = (name for name in _SLOW if name in sys.modules)
                # Without effect where processes are started anew.
                context.set_forkserver_preload([*slow, "flgpr.execution.preload"])
                threads = max(1, (os.cpu_count() or 1) // self.count)
                self._pool = ProcessPoolExecutor(self.count, context, _begin_worker, (threads,))
            return self._pool


def _begin_worker(threads: int) -> None:
    """Set up a process with its share of threads. It ends with its parent."""
    system.begin_worker()
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    threadpool_limits(threads)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait for the end of the parent, and end this process."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


class Cluster(Executor):
    """Hands the work to the workers of an existing Dask cluster.

    Only small values go through it: arrays stay in the work folder, which all see. A lost worker
    costs the piece that it worked on. Run, model and output must have the same path on every
    worker, and the workers the same versions as this process.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as ``tcp://host:8786``.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._distributed = optional("distributed", "cluster")
        self._client: Any = None

    def __enter__(self) -> Cluster:
        try:
            self._client = self._distributed.Client(
                self.address, timeout=_PATIENCE, set_as_default=False
            )
        except (OSError, ValueError) as error:
            raise ValueError(
                f"scheduler must be the address of a Dask scheduler, got {self.address} ({error})"
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def run(
        self,
        work: Work,
        arguments: Sequence[tuple[Any, ...]],
        threads: int = 1,  # noqa: ARG002
    ) -> Generator[Report]:
        """Submit a task for each set of arguments; yield first what is done first.

        Raises
        ------
        LostWorkersError
            If workers are lost time and again.
        """
        futures = [self._client.submit(work, *piece, pure=False) for piece in arguments]
        try:
            done = self._distributed.as_completed(
                futures, loop=self._client.loop, with_results=True
            )
            for future, report in done:
                self._check_stopped()
                future.release()
                yield report
        except self._distributed.KilledWorker as error:
            raise LostWorkersError(
                f"workers must live to do their work, several died at one piece ({error})"
            ) from None
        finally:
            for future in futures:
                future.release()


@dataclass(frozen=True)
class RunOptions:
    """Who works on lanes, and how. The results are the same, bit for bit."""

    workers: int | None = None  #: number of processes; None takes this one with all its threads
    scheduler: str | None = None  #: address of a Dask scheduler in place of workers
    max_memory: int = MAX_MEMORY  #: bytes that each process may take
    track: Track = silent  #: shows progress
    note: OnReport = ignore_report  #: takes a report of every piece of work that was done
    #: folder of backgrounds, run-views and features that recipes share; it may be deleted
    pass_cache: PathLike | None = None

    def executor(self) -> Executor:
        """Return who does the work; a ValueError if both workers and a scheduler are given."""
        if self.scheduler is not None and self.workers is not None:
            raise ValueError(
                f"workers and scheduler exclude each other, got {self.workers} and {self.scheduler}"
            )
        if self.scheduler is not None:
            return Cluster(self.scheduler)
        return InProcess() if self.workers is None else Processes(self.workers)


DEFAULTS = RunOptions()


# The pieces of work of a job, which any process can do with the run and the work folder


def do_block(job: LaneJob, name: str, number: int) -> Report:
    """Do one block of a pass and write its state to the work folder.

    Parameters
    ----------
    job : LaneJob
        The job.
    name : str
        Name of the pass.
    number : int
        Number of the block.

    Returns
    -------
    Report
        What it cost.

    Raises
    ------
    ValueError
        If this process does not see the work folder, or has other versions than the driver.
    """
    begun = _now()
    # Threads of one process take blocks at once only where the driver hands blocks to threads.
    alone = worker_state.threads == 1
    with _ONE_AT_A_TIME if alone else nullcontext():
        _, engine, work = _open(job)
        block = block_name(name, number)
        if work.missing_blocks(name, [number]):
            checkpoint = BlockCheckpoint(work, block)
            work[block] = engine.gather_block(name, number, checkpoint)
            checkpoint.drop()
        size = work.size(block)
        work.merge_ahead(engine, name)
        return report(job.name, name, number, begun, size)


def do_merge(job: LaneJob, name: str, numbers: Sequence[int]) -> Report:
    """Merge the blocks of a pass, in their order, and write its result to the work folder.

    Parameters
    ----------
    job : LaneJob
        The job.
    name : str
        Name of the pass.
    numbers : sequence of int
        Numbers of its blocks.

    Returns
    -------
    Report
        What it cost; the block is -1.
    """
    begun = _now()
    with _ONE_AT_A_TIME:
        _, engine, work = _open(job)
        keep_blocks = engine.passes[name].keep_blocks
        if name not in work:
            result: Arrays = {}
            if not keep_blocks:
                result = engine.result_of(name, work.block_states(name, numbers))
            work[name] = result
        if not keep_blocks:
            work.drop_blocks(name)
        return report(job.name, name, -1, begun, work.size(name))


def do_finish(job: LaneJob) -> Report:
    """Write the result folder from a work folder that holds every pass.

    Returns
    -------
    Report
        What it cost, and the number of ``alarms``.
    """
    begun = _now()
    with _ONE_AT_A_TIME:
        lane, _, _ = _open(job)
        detection = detection_of(lane)
        borders = section_lane(lane.recipe, lane.lane, lane.section)
        section = section_note(lane.lane, lane.section) if job.section else None
        folder = write_result(
            job.folder,
            [detection],
            job.recipe,
            borders,
            _describe_runs(job, lane),
            lane.model,
            section,
        )
        if job.report:
            add_files(folder, {"report.html": report_html(read_result(folder))})
        _opened.cache_clear()  # frees the memory of the run-views
        done = report(job.name, "finish", -1, begun, 0)
        return done | {"alarms": len(detection.alarms)}


def _describe_runs(job: LaneJob, lane: LaneSetup) -> dict[str, Any]:
    """Return what a manifest says of the run, and of those taken together with it."""
    described = describe_run(lane.run, job.run, lane.recipe.motion)
    searched = searched_ground(lane.run, lane.recipe, Lane(*job.lane), job.lane_source)
    described["searched"] = searched.as_json()
    if trained_on(lane.model, job.store_sha256):
        described["trained_on_this_run"] = True
    if job.others:
        described["others"] = {}
        for name, path, digest in job.others:
            described["others"][name] = {"path": path, "store_sha256": digest}
    return described


def _open(job: LaneJob) -> tuple[LaneSetup, Engine, Checkpoint]:
    """Return the lane of a job, its engine and its work folder, as this process sees them."""
    if job.code != code_versions():
        ours = dict(code_versions())
        different = []
        for name, theirs in job.code:
            if ours.get(name) != theirs:
                different.append(f"{name} {ours.get(name)} and {theirs}")
        raise ValueError(
            f"worker {socket.gethostname()} must have the versions of the driver, "
            f"got {', '.join(different)}"
        )
    if not job.work.is_dir():
        raise ValueError(
            f"worker {socket.gethostname()} must see the work folder of the driver, got no "
            f"{job.work}"
        )
    with _OPENING:
        return _opened(job)


@lru_cache(maxsize=2)
def _opened(job: LaneJob) -> tuple[LaneSetup, Engine, Checkpoint]:
    """Open what a job names; the latest ones stay open, as a process does many pieces of a job."""
    lane, work = open_lane(job)
    return lane, engine_of(lane), work


def _now() -> _Clocks:
    """Read the clocks."""
    return time.perf_counter(), time.process_time()


def report(lane: str, stage: str, number: int, begun: _Clocks, size: int) -> Report:
    """Return a report of a piece of work that is done now.

    Parameters
    ----------
    lane : str
        Name of the lane.
    stage : str
        Name of the pass.
    number : int
        Number of the block.
    begun : tuple of float
        Clocks of wall and process when the work began.
    size : int
        Bytes that it wrote.
    """
    wall, processor_time = _now()
    # The processor time is that of the process, and each of its threads sees all of it.
    own_share = (processor_time - begun[1]) / worker_state.threads
    return {
        "lane": lane,
        "stage": stage,
        "block": number,
        "seconds": wall - begun[0],
        "processor_seconds": own_share,
        "bytes": size,
        "peak_bytes": system.peak_memory(),
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "cpu": processor(),
    }
