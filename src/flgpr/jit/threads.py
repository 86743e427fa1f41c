"""Short tasks on several threads, which never wait for a thread that the machine does not run.

The calling thread works too and tasks are handed out one by one, so that a thread that is late
takes fewer. Waiting threads sleep. Calls from several threads at once are allowed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, partial, wraps
from typing import Any

from numba import config, get_num_threads

from flgpr.jit.compiled import njit

TASKS_PER_THREAD = 6

_pools: list[ThreadPoolExecutor] = []
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pools.clear)


def _pool() -> ThreadPoolExecutor:
    """Return the pool of waiting threads, started at the first use."""
    if not _pools:
        _pools.append(
            ThreadPoolExecutor(max(1, config.NUMBA_NUM_THREADS - 1), thread_name_prefix="flgpr")
        )
    return _pools[0]


def share(
    count: int, run: Callable[[int, int], None], step: int | None = None, alone: bool = False
) -> None:
    """Call ``run(begin, end)`` for sections of a range on as many threads as numba uses.

    Parameters
    ----------
    count : int
        Length of the range.
    run : callable
        Processes a section; it must release the interpreter lock to run in parallel.
    step : int, optional
        Length of a section; by default every thread gets a few.
    alone : bool
        Whether the calling thread does all, where that takes no longer than to wake another.
    """
    threads = 1 if alone else get_num_threads()
    size = step or max(1, count if alone else -(-count // (TASKS_PER_THREAD * threads)))
    starts = iter(range(0, count, size))

    def work() -> None:
        """Run sections until none is left."""
        for begin in starts:
            run(begin, min(begin + size, count))

    helpers = [_pool().submit(work) for _ in range(min(threads, -(-count // size)) - 1)]
    try:
        work()
    finally:
        for helper in helpers:
            if not helper.cancel():
                helper.result()


@contextmanager
def blas_on_one_thread() -> Iterator[None]:
    """Return a context in which the linear algebra uses one thread, in all threads of the process.

    The last bits of products and of eigenvectors depend on the number of its threads. It is also
    for small matrices, and for work beside the threads of our kernels. Where several threads work,
    the one that waits for them holds the context: the library lets one thread at a time decide.
    """
    with _libraries().limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries() -> Any:
    """Return the controller of the linear algebra's threads."""
    from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]  # slow

    return ThreadpoolController()


def shared(axis: int = 0, **options: Any) -> Callable[[Callable[..., None]], Any]:
    """Compile a kernel whose work several threads share.

    Its last arguments ``begin`` and ``end`` are indices along an ``axis`` of the argument before
    these, which it fills.

    numba's parallel loops would do it, too, but take two to five times as long to compile. As in
    these, a division by zero is no error: asking for it keeps the compiler from vector code.
    """

    def compiled(function: Callable[..., None]) -> Any:
        kernel = njit(nogil=True, error_model="numpy", **options)(function)

        @wraps(function)
        def call(*arguments: Any) -> None:
            """Run the kernel in sections on several threads."""
            share(arguments[-1].shape[axis], partial(kernel, *arguments))

        call.kernel = kernel  # type: ignore[attr-defined]
        return call

    return compiled
