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


@intrinsic
def _multiply_add(_context, count, scale):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return the sum of independent chains x <- x·scale + scale of vectors in registers."""
    signature = types.float32(types.int64, types.float32)

    def build(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        vector = ir.VectorType(ir.FloatType(), _LANES)
        empty = ir.Constant(vector, ir.Undefined)
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), None)
        first = builder.insert_element(empty, args[1], ir.Constant(ir.IntType(32), 0))
        factor = builder.shuffle_vector(first, empty, zeros)
        chains = [cgutils.alloca_once_value(builder, factor) for _ in range(_CHAINS)]
        with cgutils.for_range(builder, args[0]):
            for chain in chains:
                product = builder.fmul(builder.load(chain), factor, flags=("contract",))
                builder.store(builder.fadd(product, factor, flags=("contract",)), chain)
        total = builder.load(chains[0])
        for chain in chains[1:]:
            total = builder.fadd(total, builder.load(chain))
        elements = [
            builder.extract_element(total, ir.Constant(ir.IntType(32), i)) for i in range(_LANES)
        ]
        value = elements[0]
        for element in elements[1:]:
            value = builder.fadd(value, element)
        return value

    return signature, build


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
    out = np.empty(tasks, np.float32)
    _multiply_add_all(tasks, 1, np.float32(0.5), out)
    start = time.perf_counter()
    _multiply_add_all(tasks, count, np.float32(0.5), out)
    return 2.0 * _CHAINS * _LANES * count * tasks / (time.perf_counter() - start)


def peak_bandwidth() -> float:
    """Measure the bytes read and written per second by a copy that no cache holds."""
    source = np.ones(16_000_000, np.float32)
    target = np.empty_like(source)
    _copy(source, target)
    start = time.perf_counter()
    _copy(source, target)
    return 2.0 * source.nbytes / (time.perf_counter() - start)
