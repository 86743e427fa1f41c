"""The engine: runs passes over the scans of a run, block by block, in memory or shared among workers.

A pass goes through the scans block by block. What is gathered of a block depends on nothing but the
run, the recipe and the results of earlier passes; the states of the blocks are merged in the order
of the blocks. So the bits of a result depend neither on how many work on it, nor where, nor on what
was interrupted in between. The engine knows no pass by name: what a pass does stands in
``chain/passes`` and in the stages.
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
from typing import Any, Protocol, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from flgpr.chain.progress import Track, silent

BLOCK = 16
"""Most scans in a block."""
# Each thread holds a scan and a block's sums, and in memory nobody counts how much that is.
_MOST_THREADS = 16
Arrays = dict[str, NDArray[Any]]
T = TypeVar("T")


class _WorkerState(threading.local):
    """What a thread knows of the pieces of work that it takes."""

    threads = 1  # that take pieces beside it, itself included
    stop = threading.Event()  # set when nobody waits for its piece any more


worker_state = _WorkerState()


class Gatherer(Protocol):
    """What the engine needs of a pass at work on a block, or on the states of all blocks."""

    def add(self, index: int, /) -> Any:
        """Add one scan, by its index among the complete ones."""

    def state(self, exact: bool, /) -> Arrays:
        """Return everything gathered so far, as plain arrays.

        With ``exact`` another gatherer that merges it goes on with the same bits; else the
        precision of what is estimated from it suffices, and it may be smaller.
        """

    def merge(self, state: Any, /) -> None:
        """Merge the state of the scans that follow."""

    def result(self) -> Arrays:
        """Return what later passes read."""


@dataclass(frozen=True)
class Accumulator:
    """A gatherer made of four functions, for stages that gather examples or estimates of their own."""

    add: Callable[[int], Any]  #: adds one scan, by its index among the complete ones
    state: Callable[[bool], Arrays]  #: returns everything gathered so far, see :class:`Gatherer`
    merge: Callable[[Any], None]  #: merges the state of the scans that follow
    result: Callable[[], Arrays]  #: returns what later passes read


def not_shared() -> dict[str, Any] | None:
    """Return the cache key of a pass whose result no other recipe can use: None."""
    return None


@dataclass(frozen=True)
class PlannedPass:
    """One pass over the scans, as the engine plans it."""

    name: str  #: its name, under which its result is kept
    title: str  #: what it is called where progress is shown
    #: begins to gather a block, or with None the states of all blocks, once earlier passes have their results
    start: Callable[[range | None], Gatherer]
    needs: tuple[str, ...] = ()  #: earlier passes whose results it reads
    all_scans: bool = False  #: goes through all scans even where a section of the lane is wanted
    #: the states of its blocks are not merged but kept, by the names of :func:`block_name`
    keep_blocks: bool = False
    needs_no_scans: bool = False  #: works on the results of earlier passes alone
    #: what its result depends on beside run, lane and program; None if no other recipe can use it
    cache_key: Callable[[], dict[str, Any] | None] = not_shared


BlockIterator = Callable[[range, Gatherer], Iterator[int]]
"""Goes through the scans of a block for a gatherer, which may begin with what a checkpoint holds of it."""


def whole_block(block: range, gatherer: Gatherer) -> Iterator[int]:  # noqa: ARG001
    """Yield the scans of a block from its first; no checkpoint is kept."""
    yield from block


def block_name(name: str, number: int) -> str:
    """Return the name under which the state of a pass's block is kept."""
    return f"{name}-{number:06d}"


def blocks_of(scans: int) -> list[range]:
    """Divide scans into blocks of at most ``BLOCK`` consecutive ones, as even as can be."""
    count = -(-scans // BLOCK)
    edges = [scans * k // count for k in range(count + 1)]
    return [range(begin, end) for begin, end in pairwise(edges)]


class Engine:
    """Runs passes over so many complete scans; ``results`` holds what each pass gave, by its name.

    ``block_numbers`` are those of the blocks that see what is wanted, by default all;
    ``concurrent`` says whether several threads may work on blocks at once.
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
        every = list(range(len(self.blocks)))
        self._wanted = every if block_numbers is None else list(block_numbers)

    def block_numbers(self, name: str) -> list[int]:
        """Return the numbers of the blocks that a pass goes through."""
        planned = self.passes[name]
        if planned.needs_no_scans:
            return []
        if planned.all_scans:
            return list(range(len(self.blocks)))
        return self._wanted

    def gather_block(
        self, name: str, number: int, block_iterator: BlockIterator = whole_block
    ) -> Arrays:
        """Work on one block of a pass and return the state of it."""
        block = self.blocks[number]
        gatherer = self.passes[name].start(block)
        for index in block_iterator(block, gatherer):
            if worker_state.stop.is_set():
                raise CancelledError
            gatherer.add(index)
        return gatherer.state(False)

    def merge_blocks(self, name: str, states: Iterable[Arrays]) -> Gatherer:
        """Merge the states of the blocks of :meth:`block_numbers`, in their order, one after the other."""
        gatherer = self.passes[name].start(None)
        for state in states:
            gatherer.merge(state)
        return gatherer

    def run(self, track: Track = silent, names: Sequence[str] | None = None) -> None:
        """Run passes in this process, by default all; those whose results are there already are left out."""
        for name in self.passes if names is None else names:
            if name not in self.results:
                self._run_pass(name, track)

    def _run_pass(self, name: str, track: Track) -> None:
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
                self.results[name] = self.merge_blocks(name, states).result()


def run_pieces(
    work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], threads: int
) -> Generator[T]:
    """Do a piece of work for each set of arguments, so many at once, and yield what it returns in their order.

    Threads take whole pieces, each with its share of numba's threads: those that share a kernel's
    loop wait for one another at every call. Where the last round would leave most without a piece,
    all share the loops of what is left. Close it where it may not be used up: the pieces at work
    then end at their next scan.
    """
    kernels = numba.get_num_threads()
    threads = min(threads, kernels, len(arguments))
    if threads > 1:
        left = len(arguments) % threads
        count = len(arguments) - (left if 2 * left <= threads else 0)
        yield from _run_at_once(work, arguments[:count], threads, kernels // threads)
        arguments = arguments[count:]
    for piece in arguments:
        yield work(*piece)


def _run_at_once(
    work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], threads: int, kernels: int
) -> Generator[T]:
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


def bundle_groups(groups: Mapping[str, Arrays]) -> Arrays:
    """Bundle groups of arrays into one, each array as GROUP|NAME."""
    bundled = {}
    for group, arrays in groups.items():
        for name, array in arrays.items():
            bundled[f"{group}|{name}"] = array
    return bundled


def group_of(arrays: Mapping[str, NDArray[Any]], group: str) -> Arrays:
    """Return one group of what :func:`bundle_groups` made."""
    prefix = f"{group}|"
    return {key.removeprefix(prefix): arrays[key] for key in arrays if key.startswith(prefix)}


def sum_accumulator(
    sums: Arrays, add: Callable[[int], Any], result: Callable[[], Arrays] | None = None
) -> Accumulator:
    """Make an accumulator of arrays of fixed shapes: ``add`` adds a scan's to ``sums``, and so are states."""

    def merge(state: Mapping[str, NDArray[Any]]) -> None:
        for name, value in sums.items():
            value += state[name]

    return Accumulator(add, lambda _: dict(sums), merge, result or (lambda: sums))


def append_accumulator(parts: list[Arrays], add: Callable[[int], Any]) -> Accumulator:
    """Make an accumulator of arrays whose first axis grows: ``add`` appends a scan's to ``parts``."""

    def merge(state: Mapping[str, NDArray[Any]]) -> None:
        if state:
            parts.append(dict(state))

    return Accumulator(add, lambda _: joined_parts(parts), merge, lambda: joined_parts(parts))


def joined_parts(parts: Sequence[Arrays]) -> Arrays:
    """Concatenate arrays of the same names along their first axis; no parts give no arrays."""
    if not parts:
        return {}
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
