"""The engine: a chain is a list of passes over the scans of a run, and what each gathers can be shared and folded.

A pass goes through the scans block by block. What an accumulator gathers of a block depends on nothing but the run, the
recipe and the results of earlier passes; the blocks' states are merged in the order of the blocks. So the bits of a
result depend neither on how many work on it, nor where, nor on what was interrupted in between.
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
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from flgpr.chain.progress import Track, silent

BLOCK = 16
"""Most scans in a block."""
# that take whole blocks at the most where nobody counts the memory: each holds a scan, a block's
# sums
_THREADS = 16
Arrays = dict[str, NDArray[Any]]
T = TypeVar("T")


class _Mine(threading.local):
    """What a thread knows of the pieces that it takes."""

    threads = 1  # that take pieces beside it, itself included
    stop = threading.Event()  # set when nobody waits for its piece any more


mine = _Mine()


@dataclass(frozen=True)
class Accumulator:
    """What one pass gathers, as four functions."""

    add: Callable[[int], Any]  #: takes in one scan, by its index among the complete ones
    #: gives everything gathered so far; told True exactly, to go on with the same bits, else as the result needs it
    state: Callable[[bool], Arrays]
    merge: Callable[[Any], None]  #: takes in the state of the scans that follow
    result: Callable[[], Arrays]  #: gives what later passes may read


@dataclass(frozen=True)
class Pass:
    """One pass over the scans."""

    #: name, title: its name, and what it is called where progress is shown
    name: str
    title: str
    #: makes its accumulator for a block, or for all scans where it is given None, once earlier passes are known
    start: Callable[[range | None], Accumulator]
    #: whether it goes through all scans where only a section of the lane is asked for
    whole: bool = False
    #: whether what is gathered of each block is not folded but stays known by the block's :func:`part_name`
    stored: bool = False
    still: bool = False  #: whether it looks at what is known alone, at no scan


# Goes through a block for an accumulator, which may begin with what was kept of it.
Going = Callable[[range, Accumulator], Iterator[int]]


def plainly(block: range, gathered: Accumulator) -> Iterator[int]:  # noqa: ARG001
    """Go through a block from its beginning and keep nothing."""
    yield from block


def part_name(name: str, number: int) -> str:
    """Name under which a block's part of a pass is kept."""
    return f"{name}-{number:06d}"


def blocks_of(scans: int) -> list[range]:
    """Divide scans into blocks of at most ``BLOCK`` consecutive ones, as even as can be."""
    count = -(-scans // BLOCK)
    edges = [scans * k // count for k in range(count + 1)]
    return [range(begin, end) for begin, end in pairwise(edges)]


class Chain:
    """Passes over so many complete scans, and what is ``known`` of their results, by pass."""

    concurrent = False
    """Whether several threads may work on blocks at once."""

    def __init__(self, passes: Sequence[Pass], scans: int, known: MutableMapping[str, Any]) -> None:
        self.passes = {one.name: one for one in passes}
        self.blocks = blocks_of(scans)
        self.known = known

    def numbers(self, name: str) -> list[int]:
        """Tell which blocks a pass goes through."""
        if self.passes[name].still:
            return []
        return list(range(len(self.blocks))) if self.passes[name].whole else self.reaching

    @cached_property
    def reaching(self) -> list[int]:
        """Numbers of the blocks that see what is asked for, at least one."""
        return list(range(len(self.blocks)))

    def part(self, name: str, number: int, going: Going = plainly) -> Arrays:
        """Work on one block of a pass and give what was gathered of it."""
        block = self.blocks[number]
        gathered = self.passes[name].start(block)
        for index in going(block, gathered):
            if mine.stop.is_set():
                raise CancelledError
            gathered.add(index)
        return gathered.state(False)

    def merged(self, name: str, parts: Iterable[Arrays]) -> Accumulator:
        """Merge what :meth:`part` gave for the blocks of :meth:`numbers`, in their order, taken one by one."""
        gathered = self.passes[name].start(None)
        for part in parts:
            gathered.merge(part)
        return gathered

    def go(self, track: Track = silent, names: Sequence[str] | None = None) -> None:
        """Do passes here and now, block after block, all of them by default; those already known are left out."""
        for name in self.passes if names is None else names:
            if name not in self.known:
                every = self.numbers(name)
                pieces = [(name, number) for number in every]
                with closing(dealt(self.part, pieces, _THREADS if self.concurrent else 1)) as done:
                    parts = track(done, self.passes[name].title, len(every))
                    if self.passes[name].stored:
                        for number, part in zip(every, parts, strict=True):
                            self.known[part_name(name, number)] = part
                        self.known[name] = {}
                    else:
                        self.known[name] = self.merged(name, parts).result()


def dealt(
    work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], threads: int
) -> Generator[T]:
    """Do a piece of work for each set of arguments, so many at once, and yield what it gives in their order.

    Threads take whole pieces, each with its share of numba's threads: those that share a kernel's loop wait for one
    another at every call. Where the last round would leave most without a piece, all share the loops of what is left.
    Close it where it may not be used up: the pieces at work then end at their next scan.
    """
    kernels = numba.get_num_threads()
    threads = min(threads, kernels, len(arguments))
    if threads > 1:
        left = len(arguments) % threads
        count = len(arguments) - (left if 2 * left <= threads else 0)
        yield from _at_once(work, arguments[:count], threads, kernels // threads)
        arguments = arguments[count:]
    for some in arguments:
        yield work(*some)


def _at_once(
    work: Callable[..., T], arguments: Sequence[tuple[Any, ...]], threads: int, kernels: int
) -> Generator[T]:
    stop = threading.Event()

    def begin() -> None:
        numba.set_num_threads(kernels)
        mine.threads = threads
        mine.stop = stop

    waiting: deque[Future[T]] = deque()
    pool = ThreadPoolExecutor(threads, "flgpr-block", begin)
    try:
        for some in arguments:
            waiting.append(pool.submit(work, *some))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def bundled(groups: Mapping[str, Arrays]) -> Arrays:
    """Put groups of arrays into one, each array as GROUP|NAME."""
    return {
        f"{group}|{name}": array
        for group, arrays in groups.items()
        for name, array in arrays.items()
    }


def group_of(arrays: Mapping[str, NDArray[Any]], group: str) -> Arrays:
    """Take a group out of what :func:`bundled` made."""
    return {
        key.removeprefix(f"{group}|"): arrays[key] for key in arrays if key.startswith(f"{group}|")
    }


def added(
    sums: Arrays, add: Callable[[int], Any], result: Callable[[], Arrays] | None = None
) -> Accumulator:
    """Accumulator of arrays of fixed shapes: ``add`` adds a scan's to ``sums``, and so are the states of others."""

    def merge(state: Mapping[str, NDArray[Any]]) -> None:
        for name, value in sums.items():
            value += state[name]

    return Accumulator(add, lambda _: dict(sums), merge, result or (lambda: sums))


def gathered(parts: list[Arrays], add: Callable[[int], Any]) -> Accumulator:
    """Accumulator of arrays whose first axis grows: ``add`` appends a scan's to ``parts``, the result joins them."""

    def joined() -> Arrays:
        return (
            {name: np.concatenate([one[name] for one in parts]) for name in parts[0]}
            if parts
            else {}
        )

    def merge(state: Mapping[str, NDArray[Any]]) -> None:
        if state:
            parts.append(dict(state))

    return Accumulator(add, lambda _: joined(), merge, joined)
