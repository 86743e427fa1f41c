"""The engine: runs passes over the scans of a run, block by block, in memory or in workers.

The state of a block depends on nothing but the run, the recipe and the results of earlier passes,
and the states are merged in the order of the blocks. A block that was stopped half way goes on from
its exact sums (``Accumulator.state``), and is rounded at its end alone. So the bits of a result depend
neither on the number of workers nor on interruptions (``jobs/checkpoint.py``). On processors
of one kind and with equal versions they are the same on every machine. Linear algebra has one
thread meanwhile, as its last bits depend on the number. The engine knows no pass by name: what a
pass does stands in ``method/passes`` and in the stages.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import (
    Callable,
    Generator,
    Iterable,
    Iterator,
    Mapping,
    MutableMapping,
    Sequence,
)
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

import numba
import numpy as np

from flgpr.jit.threads import blas_on_one_thread
from flgpr.progress import Track, silent
from flgpr.types import AnyArray, Arrays

BLOCK = 16
"""Most scans in a block."""
# Each thread holds a scan and the sums of a block, and detection in memory has no limit to count
# them against.
_MOST_THREADS = 16
T = TypeVar("T")


class _WorkerState(threading.local):
    """What a thread knows about the pieces of work that it takes."""

    threads = 1  # threads of this process that take pieces, this one included
    stop = threading.Event()  # set when the results of its pieces are no longer needed


worker_state = _WorkerState()


@dataclass(frozen=True)
class Accumulator:
    """What adds the scans of a block, or merges the blocks of a pass, as four functions."""

    add: Callable[[int], Any]  #: adds one scan, by its index among the complete ones
    #: returns everything gathered so far as plain arrays. With ``exact`` (True) another one that
    #: merges the state continues with the same bits; without it the precision of the result
    #: suffices, and the state may be smaller
    state: Callable[[bool], Arrays]
    merge: Callable[[Any], None]  #: merges the state of the scans that follow
    result: Callable[[], Arrays]  #: returns what later passes read


def not_shared() -> dict[str, Any] | None:
    """Return the cache key of a pass whose result no other recipe can use: None."""
    return None


@dataclass(frozen=True)
class PlannedPass:
    """One pass over the scans, as the engine plans it."""

    name: str  #: its name, which is that of its result
    title: str  #: what it is called where progress is shown
    #: returns the accumulator of a block, or with None the one that merges all blocks; called once
    #: earlier passes have their results
    start: Callable[[range | None], Accumulator]
    needs: tuple[str, ...] = ()  #: earlier passes whose results it reads
    all_scans: bool = False  #: goes through all scans even where a section of the lane is wanted
    #: the states of its blocks are not merged but kept, by the names of :func:`block_name`
    keep_blocks: bool = False
    needs_no_scans: bool = False  #: works on the results of earlier passes alone
    #: what its result depends on beside run, lane and version of the program; None if no other
    #: recipe can use it
    cache_key: Callable[[], dict[str, Any] | None] = not_shared


BlockIterator = Callable[[range, Accumulator], Iterator[int]]
"""Yields the scans of a block that its accumulator lacks; a checkpoint may hold the first ones."""


def whole_block(block: range, accumulator: Accumulator) -> Iterator[int]:  # noqa: ARG001
    """Yield all scans of a block, without a checkpoint."""
    yield from block


def block_name(name: str, number: int) -> str:
    """Return the name of the state of one block of a pass."""
    return f"{name}-{number:06d}"


def blocks_of(scans: int, most: int | None = None) -> list[range]:
    """Divide scans, or rows, into blocks of at most so many consecutive ones, as even as can be.

    By default they are of at most ``BLOCK`` scans.
    """
    count = -(-scans // (most or BLOCK))
    edges = [scans * k // count for k in range(count + 1)]
    return [range(begin, end) for begin, end in pairwise(edges)]


class Engine:
    """Runs passes over the scans of a run.

    Parameters
    ----------
    passes : sequence of PlannedPass
        The passes in their order.
    scans : int
        Number of complete scans.
    results : mutable mapping
        Takes the result of each pass by its name. Passes whose results are there are not run.
    concurrent : bool
        Whether several threads may work on blocks at once.
    block_numbers : sequence of int, optional
        Numbers of the blocks that see the section that is wanted; by default all.

    Raises
    ------
    ValueError
        If a pass needs the result of one that does not stand before it.
    """

    def __init__(
        self,
        passes: Sequence[PlannedPass],
        scans: int,
        results: MutableMapping[str, Any],
        concurrent: bool = False,
        block_numbers: Sequence[int] | None = None,
    ) -> None:
        self.passes: dict[str, PlannedPass] = {}
        for planned in passes:
            missing = [name for name in planned.needs if name not in self.passes]
            if missing:
                raise ValueError(f"pass {planned.name} needs {missing[0]} before it, got none")
            self.passes[planned.name] = planned
        self.blocks = blocks_of(scans)
        self.results = results
        self.concurrent = concurrent
        if block_numbers is None:
            block_numbers = range(len(self.blocks))
        self._of_section = list(block_numbers)

    def block_numbers(self, name: str) -> list[int]:
        """Return the numbers of the blocks that a pass goes through."""
        planned = self.passes[name]
        if planned.needs_no_scans:
            return []
        if planned.all_scans:
            return list(range(len(self.blocks)))
        return self._of_section

    def gather_block(
        self, name: str, number: int, block_iterator: BlockIterator = whole_block
    ) -> Arrays:
        """Add the scans of one block of a pass and return its state.

        Parameters
        ----------
        name : str
            Name of the pass.
        number : int
            Number of the block.
        block_iterator : callable
            Yields the scans to add; a checkpoint may hold those before.

        Returns
        -------
        dict of str to ndarray
            What :meth:`merge_blocks` merges.

        Raises
        ------
        CancelledError
            If the state is no longer needed.
        """
        block = self.blocks[number]
        with blas_on_one_thread():
            accumulator = self.passes[name].start(block)
            for index in block_iterator(block, accumulator):
                if worker_state.stop.is_set():
                    raise CancelledError
                accumulator.add(index)
            # Rounded, but always at the same edges, whether the run was stopped or not.
            return accumulator.state(False)

    def merge_blocks(self, name: str, states: Iterable[Arrays]) -> Accumulator:
        """Merge the states of the blocks of a pass.

        Parameters
        ----------
        name : str
            Name of the pass.
        states : iterable of dict
            States of the blocks of :meth:`block_numbers`, in their order.

        Returns
        -------
        Accumulator
            It has the result of the pass.
        """
        with blas_on_one_thread():
            accumulator = self.passes[name].start(None)
            for state in states:
                accumulator.merge(state)
            return accumulator

    def result_of(self, name: str, states: Iterable[Arrays]) -> Arrays:
        """Return the result of a pass.

        Parameters
        ----------
        name : str
            Name of the pass.
        states : iterable of dict
            As for :meth:`merge_blocks`.
        """
        with blas_on_one_thread():
            return self.merge_blocks(name, states).result()

    def run(self, track: Track = silent, names: Sequence[str] | None = None) -> None:
        """Run passes in this process that have no result yet, by default all.

        Parameters
        ----------
        track : Track
            Shows progress.
        names : sequence of str, optional
            Names of the passes to run.
        """
        chosen = self.passes if names is None else names
        for name in chosen:
            if name not in self.results:
                self._run_pass(name, track)

    def _run_pass(self, name: str, track: Track) -> None:
        """Run one pass and put its result, or the states of its blocks, among the results."""
        planned = self.passes[name]
        numbers = self.block_numbers(name)
        pieces = [(name, number) for number in numbers]
        threads = _MOST_THREADS if self.concurrent else 1
        with closing(run_pieces(self.gather_block, pieces, threads)) as done:
            states = track(done, planned.title, len(numbers))
            if planned.keep_blocks:
                for number, state in zip(numbers, states, strict=True):
                    self.results[block_name(name, number)] = state
                self.results[name] = {}
            else:
                self.results[name] = self.result_of(name, states)


def run_pieces(
    work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], threads: int
) -> Generator[T]:
    """Do a piece of work for each set of arguments and yield what it returns, in their order.

    Close the generator where it may not be used up: the pieces at work then end at their next scan.

    Parameters
    ----------
    work : callable
        Does one piece.
    arguments : sequence of tuple
        The arguments of every piece.
    threads : int
        How many pieces may be worked on at once.

    Yields
    ------
    object
        What ``work`` returned.
    """
    # Threads take whole pieces, each with its share of numba's threads: threads that share the loop
    # of a kernel wait for one another at every call.
    kernels = numba.get_num_threads()
    threads = min(threads, kernels, len(arguments))
    with blas_on_one_thread():
        if threads > 1:
            # Where the last round would leave most threads without a piece, all of them share the
            # loops of its pieces.
            last_round = len(arguments) % threads
            count = len(arguments)
            if 2 * last_round <= threads:
                count -= last_round
            yield from _run_at_once(work, arguments[:count], threads, kernels // threads)
            arguments = arguments[count:]
        for piece in arguments:
            yield work(*piece)


def _run_at_once(
    work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], threads: int, kernels: int
) -> Generator[T]:
    """Do pieces of work in threads, each of which runs kernels with so many of numba's threads."""
    stop = threading.Event()

    def begin() -> None:
        numba.set_num_threads(kernels)
        worker_state.threads = threads
        worker_state.stop = stop

    waiting: deque[Future[T]] = deque()
    pool = ThreadPoolExecutor(threads, "flgpr-block", begin)
    try:
        for piece in arguments:
            waiting.append(pool.submit(work, *piece))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def bundle_groups(groups: Mapping[str, Mapping[str, AnyArray]], mark: str = "|") -> Arrays:
    """Bundle groups of arrays into one, each array as GROUP, the mark and NAME."""
    bundled = {}
    for group, arrays in groups.items():
        for name, array in arrays.items():
            bundled[f"{group}{mark}{name}"] = array
    return bundled


def group_of(arrays: Mapping[str, AnyArray], group: str, mark: str = "|") -> Arrays:
    """Return one group of what :func:`bundle_groups` made with this mark."""
    prefix = f"{group}{mark}"
    members = {}
    for key in arrays:
        if key.startswith(prefix):
            members[key.removeprefix(prefix)] = arrays[key]
    return members


def sum_accumulator(
    sums: Arrays, add: Callable[[int], Any], result: Callable[[], Arrays] | None = None
) -> Accumulator:
    """Return an accumulator of arrays of fixed shapes, to which those of every scan are added.

    Parameters
    ----------
    sums : dict of str to ndarray
        The sums so far, usually zeros; changed in place.
    add : callable
        Adds the arrays of the scan at an index to ``sums``.
    result : callable, optional
        Returns the result; by default the sums are the result.

    Returns
    -------
    Accumulator
        What the engine runs.
    """

    def merge(state: Mapping[str, AnyArray]) -> None:
        for name, value in sums.items():
            value += state[name]

    return Accumulator(add, lambda _: dict(sums), merge, result or (lambda: sums))


def append_accumulator(pieces: list[Arrays], add: Callable[[int], Any]) -> Accumulator:
    """Return an accumulator of arrays whose first axis grows with every scan.

    Parameters
    ----------
    pieces : list of dict
        The arrays so far, usually none; changed in place.
    add : callable
        Appends the arrays of the scan at an index to ``pieces``.

    Returns
    -------
    Accumulator
        What the engine runs.
    """

    def merge(state: Mapping[str, AnyArray]) -> None:
        if state:
            pieces.append(dict(state))

    return Accumulator(add, lambda _: concatenate(pieces), merge, lambda: concatenate(pieces))


def concatenate(pieces: Sequence[Arrays]) -> Arrays:
    """Concatenate arrays of the same names along their first axis; no pieces give no arrays."""
    if not pieces:
        return {}
    joined = {}
    for name in pieces[0]:
        joined[name] = np.concatenate([piece[name] for piece in pieces])
    return joined
