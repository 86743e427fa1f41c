"""Limits of the machine: multiply-adds in single precision and bytes from memory per second."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from llvmlite import ir
from numba import get_num_threads, prange
from numba.core import cgutils, types
from numba.extending import intrinsic

from flgpr.jit.compiled import njit

_CHAINS = 12
_LANES = 16
_INDEX = ir.IntType(32)
_FUSED = ("contract",)
"""Flag of LLVM that lets a product and a sum become one multiply-add."""
_BANDWIDTH_ELEMENTS = 16_000_000  # 64 MB, more than caches hold


@intrinsic
def _multiply_add(_context, count, scale):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return the sum of independent chains x <- x·scale + scale of vectors in registers."""
    signature = types.float32(types.int64, types.float32)

    def build(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        count, scale = args
        factor = _filled_vector(builder, scale)
        # As many chains as a core has multiply-adds under way, so that none waits for another.
        chains = [cgutils.alloca_once_value(builder, factor) for _ in range(_CHAINS)]
        with cgutils.for_range(builder, count):
            for chain in chains:
                product = builder.fmul(builder.load(chain), factor, flags=_FUSED)
                value = builder.fadd(product, factor, flags=_FUSED)
                builder.store(value, chain)
        return _sum_of_chains(builder, chains)

    return signature, build


def _filled_vector(builder: Any, scale: Any) -> Any:
    """Return a vector whose elements all are a number."""
    vector = ir.VectorType(ir.FloatType(), _LANES)
    empty = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(empty, scale, ir.Constant(_INDEX, 0))
    zeros = ir.Constant(ir.VectorType(_INDEX, _LANES), None)
    return builder.shuffle_vector(first, empty, zeros)


def _sum_of_chains(builder: Any, chains: list[Any]) -> Any:
    """Return the sum of all elements of vectors: a result that nothing can be left out of."""
    total = builder.load(chains[0])
    for chain in chains[1:]:
        total = builder.fadd(total, builder.load(chain))
    value = builder.extract_element(total, ir.Constant(_INDEX, 0))
    for lane in range(1, _LANES):
        element = builder.extract_element(total, ir.Constant(_INDEX, lane))
        value = builder.fadd(value, element)
    return value


@njit(parallel=True, cache=True)
def _multiply_add_all(tasks, count, scale, out):  # type: ignore[no-untyped-def]
    for i in prange(tasks):
        out[i] = _multiply_add(count, scale)


@njit(parallel=True, cache=True)
def _copy(source, target):  # type: ignore[no-untyped-def]
    for i in prange(source.size):
        target[i] = source[i]


def peak_flops() -> float:
    """Measure the floating-point operations per second of multiply-adds on all threads."""
    tasks = 4 * get_num_threads()
    count = 1_000_000
    scale = np.float32(0.5)  # values converge to 1: none becomes a slow denormal
    out = np.empty(tasks, np.float32)
    _multiply_add_all(tasks, 1, scale, out)  # compiles
    start = time.perf_counter()
    _multiply_add_all(tasks, count, scale, out)
    seconds = time.perf_counter() - start
    return 2.0 * _CHAINS * _LANES * count * tasks / seconds


def peak_bandwidth() -> float:
    """Measure the bytes read and written per second by a copy that no cache holds."""
    source = np.ones(_BANDWIDTH_ELEMENTS, np.float32)
    target = np.empty_like(source)
    _copy(source, target)  # compiles, and makes the pages of the target
    start = time.perf_counter()
    _copy(source, target)
    seconds = time.perf_counter() - start
    return 2.0 * source.nbytes / seconds
