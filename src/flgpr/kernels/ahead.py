"""Compilation of the kernels of a detection by another process: ``python -m flgpr.kernels.ahead``.

A first detection on a machine waits for the compiler longer than for anything else. Two processes
share that work by the code that either stores on disk. With the argument ``training`` it also
compiles the kernels of trainings, with ``tolerances`` imaging to any tolerance that single
precision keeps.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import product
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from threading import Thread
from typing import Any

import numpy as np
from numba import config, typeof

from flgpr.jit.compiled import cache_folder
from flgpr.kernels import relevance
from flgpr.kernels.background import (
    add_clipped,
    gain_and_limit,
    magnitude_over_background,
    mean_of_nodes,
    residual,
    root_mean_square,
    subtract_and_divide,
)
from flgpr.kernels.filters import _sort, median_of_ranks
from flgpr.kernels.focus import focus
from flgpr.kernels.hermitian import eigen_3x3
from flgpr.kernels.patches import region_statistics
from flgpr.kernels.profiles import Geometry, adjoint, forward, locate, polynomial_degree
from flgpr.kernels.sampling import _sample
from flgpr.kernels.transform import Spectrum, compress, expand
from flgpr.types import AnyArray


def _array(kind: type, dimensions: int) -> AnyArray:
    """Return an empty array of a type and a number of dimensions."""
    return np.empty((0,) * dimensions, kind)


# Short, as in the type codes of NumPy: the list below is a table of types.
_i = partial(_array, np.int64)
_f = partial(_array, np.float32)
_d = partial(_array, np.float64)
_c = partial(_array, np.complex64)
_z = partial(_array, np.complex128)


def usual() -> list[tuple[Any, tuple[Any, ...]]]:
    """Return the kernels of the packaged recipes, in the order of their use.

    Returns
    -------
    list of (kernel, tuple)
        Each kernel with arguments of the types that it is called with.
    """
    spectrum = Spectrum(0, 0, _i(1), _i(1), _f(1), _f(1), _c(1))
    geometry = Geometry(_i(1), _i(1), _d(2), _d(2), 0, _d(1), 0.0, 0.0, 0, 0, _f(2), _f(1))
    tones = (_c(3), _f(2), spectrum)
    read = (_f(1), 0, geometry, _c(2))
    section = (0, 0)
    rows: Any = {length: (0,) * length for length in (4, 5, 8, 9, 16)}  # taps, powers and channels
    cleaned = (_c(2), _d(1), _c(2), _f(2))
    return [
        (eigen_3x3, (_z(3), _d(2), _z(3), *section)),
        (compress, (*tones, _f(1), 0, 0, 0, rows[16], *section)),
        (adjoint, (*read, rows[4], rows[8], rows[16], *section)),
        (_sample, (_f(3), _d(1), _d(1), _f(2))),
        (locate, (geometry, *section)),
        (gain_and_limit, (_c(2), 0, 0.0, _d(1), _d(1), *section)),
        (residual, (*cleaned, *section)),
        (_sort, (_f(2), _array(np.int32, 2), *section)),
        (median_of_ranks, (_array(np.int32, 2), _f(3), 0, 0, 0, 0, np.uint16(0), _f(3), *section)),
        (mean_of_nodes, (_d(3), _i(2), _i(2), _f(3), *section)),
        (root_mean_square, (_f(3), _d(2), _f(2), *section)),
        (magnitude_over_background, (*cleaned, _f(2), *section)),
        (compress, (*tones, _f(1), 0, 0, 0, rows[4], *section)),
        (adjoint, (*read, rows[5], rows[9], rows[4], *section)),
        (forward, (*read, rows[5], rows[9], rows[4], *section)),
        (expand, (_f(1), _f(2), spectrum, _c(3), 0, 0, 0, rows[4], *section)),
        (_sample, (_c(3), _d(1), _d(1), _c(2))),
        (subtract_and_divide, (*cleaned, _c(2), *section)),
        (region_statistics, (_f(3), _d(1), _d(1), _d(1), _array(np.int8, 3), _d(4), *section)),
        (focus, (_c(3), _d(1), _d(2), _f(3), _f(3), *section)),
        (add_clipped, (_c(2), _d(1), _d(1), _d(1), _z(2), _z(2), *section)),
    ]


def compile_usual() -> None:
    """Compile the usual kernels, the last first: the detection itself begins with the first."""
    for kernel, arguments in reversed(usual()):
        compiled = getattr(kernel, "kernel", kernel)  # kernels on several threads hold another one
        types = tuple(map(typeof, arguments))
        compiled.compile(types)


def compile_training() -> None:
    """Compile the training of relevance vector machines, which takes longer than a detection's."""
    # Two examples and two basis functions: a call compiles, whatever the size.
    rows = np.eye(2)
    target = np.array([0.0, 1.0])
    every = np.ones(2, np.bool_)
    problem = relevance.Problem(rows, relevance.single(rows), target, 0.0, every, 0.0)
    relevance.climb(problem, 1)

    active = np.arange(2)
    alpha = np.ones(2)
    mean = np.zeros(2)
    relevance.ascend(problem, active, alpha, mean, every, 1e-3, 0)
    posterior = relevance.laplace(rows, target, 0.0, alpha, mean)
    relevance.entries(problem, active, posterior)


def compile_tolerances() -> None:
    """Compile imaging and its forward model for other tolerances than those of the recipes."""
    read = next(arguments[:4] for kernel, arguments in usual() if kernel is adjoint)
    # The most likely widths first: the process may be ended at any time.
    for width, channels in product((5, 6, 4, 7, 3, 9, 8, 2), (1, 16, 4)):
        powers = polynomial_degree(width) + 1
        rows: Any = ((0,) * width, (0,) * powers, (0,) * channels)
        types = tuple(map(typeof, (*read, *rows, 0, 0)))
        for kernel in (adjoint, forward):
            kernel.compile(types)


@contextmanager
def compiled_beside() -> Iterator[None]:
    """Let another process compile the kernels until it is done, or this one leaves the context.

    It is started only if it has not finished on this machine before.
    """
    done = cache_folder(Path(__file__))
    several_threads = config.NUMBA_NUM_THREADS >= 2
    compiler = None
    if several_threads and _writable(done.parent) and not done.exists():
        compiler = _start_compiler()
    if compiler is None:
        yield
        return
    with compiler:
        # Waited for, so that it does not stay as a zombie as long as a detection lasts.
        Thread(target=compiler.wait, daemon=True).start()
        try:
            yield
        finally:
            compiler.kill()


def _start_compiler() -> Popen[bytes] | None:
    """Start the compiling process; None if the machine cannot."""
    # -P: modules in the working folder are not meant
    command = [sys.executable, "-P", "-m", "flgpr.kernels.ahead"]
    try:
        return Popen(command, stdin=PIPE, stdout=DEVNULL, stderr=DEVNULL)  # noqa: S603 - nothing from outside
    except OSError:  # no more processes, or no memory for one: the detection compiles alone
        return None


def _writable(folder: Path) -> bool:
    """Make a folder, and return whether files can be written to it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _end_with_input() -> None:
    """End when the other side of the pipe is closed, also by the death of the process there."""
    while os.read(0, 4096):
        pass
    os._exit(0)


if __name__ == "__main__":
    if stat.S_ISFIFO(os.fstat(0).st_mode):
        Thread(target=_end_with_input, daemon=True).start()
    compile_usual()
    if _writable(cache_folder(Path(__file__)).parent):
        cache_folder(Path(__file__)).mkdir(exist_ok=True)  # the note that all is done
    if "training" in sys.argv[1:]:
        compile_training()
    if "tolerances" in sys.argv[1:]:
        compile_tolerances()
