"""Workers: who does the pieces of work of jobs (``jobs/pieces.py``).

This process, other processes of this machine or a Dask cluster: all take a function of a module and
a list of arguments, and yield what the function returns as the work gets done.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from abc import abstractmethod
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any

import numba
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from flgpr import system
from flgpr.engine import run_pieces
from flgpr.progress import Track, silent
from flgpr.store import MAX_MEMORY
from flgpr.store.extras import optional
from flgpr.types import PathLike

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
                context.set_forkserver_preload([*slow, "flgpr.jobs.preload"])
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
