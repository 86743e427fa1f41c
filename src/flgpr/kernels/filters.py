"""Median and mean over a rectangular window that shrinks at the image border, so that nothing beyond it is made up."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

_BLOCK = 256  # ranks per coarse bin of the window's histogram


@njit(cache=True, inline="always")
def _select(fine: Any, coarse: Any, order: int) -> int:
    block, seen = 0, 0
    while seen + coarse[block] <= order:
        seen += coarse[block]
        block += 1
    rank = block * _BLOCK
    while seen + fine[rank] <= order:
        seen += fine[rank]
        rank += 1
    return rank


@njit(cache=True)
def _median_rows(ranks: Any, values: Any, half_y: int, half_x: int, first: int, last: int, out: Any) -> None:
    ny, nx = ranks.shape
    fine = np.zeros(values.size + _BLOCK, np.int32)
    coarse = np.zeros(values.size // _BLOCK + 2, np.int32)
    for y in range(first, last):
        y0, y1 = max(0, y - half_y), min(ny, y + half_y + 1)
        fine[:] = 0
        coarse[:] = 0
        count = 0
        for x in range(-half_x, nx):
            enter, leave = x + half_x, x - half_x - 1
            for v in range(y0, y1):
                if enter < nx:
                    rank = ranks[v, enter]
                    fine[rank] += 1
                    coarse[rank // _BLOCK] += 1
                    count += 1
                if leave >= 0:
                    rank = ranks[v, leave]
                    fine[rank] -= 1
                    coarse[rank // _BLOCK] -= 1
                    count -= 1
            if x >= 0:
                low = values[_select(fine, coarse, (count - 1) // 2)]
                high = low if count % 2 else values[_select(fine, coarse, count // 2)]
                out[y, x] = (low + high) / 2


@njit(parallel=True, cache=True)
def median_of_ranks(
    ranks: NDArray[np.int32],
    values: NDArray[np.float64],
    half_y: int,
    half_x: int,
    parts: int,
    out: NDArray[np.float64],
) -> None:
    """Median of ``values[ranks]`` in windows of half-widths ``half_y``, ``half_x``.

    ``ranks`` (y, x) place of every pixel in the sorted ``values``; rows are dealt to ``parts`` independent histograms.
    """
    ny = ranks.shape[0]
    for part in prange(parts):
        _median_rows(ranks, values, half_y, half_x, part * ny // parts, (part + 1) * ny // parts, out)


def median_filter(image: NDArray[np.floating], size: tuple[int, int]) -> NDArray[np.float64]:
    """Exact median in a window of ``size`` (y, x) odd pixels, of the pixels inside the image.

    ``image`` (y, x), finite.
    """
    flat = np.asarray(image, dtype=np.float64).ravel()
    order = np.argsort(flat, kind="stable")
    ranks = np.empty(flat.size, np.int32)
    ranks[order] = np.arange(flat.size, dtype=np.int32)
    out = np.empty(image.shape)
    median_of_ranks(ranks.reshape(image.shape), flat[order], size[0] // 2, size[1] // 2, min(8, image.shape[0]), out)
    return out


def mean_filter(image: NDArray[np.floating], size: tuple[int, int]) -> NDArray[np.float64]:
    """Mean in a window of ``size`` (y, x) odd pixels, of the pixels inside the image.

    ``image`` (y, x), finite.
    """
    total = np.asarray(image, dtype=np.float64)
    count = np.ones(image.shape)
    for axis in (0, 1):
        total, count = (_running_sum(array, size[axis] // 2, axis) for array in (total, count))
    return np.asarray(total / count, dtype=np.float64)


def _running_sum(array: NDArray[np.float64], half: int, axis: int) -> NDArray[np.float64]:
    array = np.moveaxis(array, axis, 0)
    sums = np.concatenate([np.zeros((1, *array.shape[1:])), np.cumsum(array, axis=0)])
    centre = np.arange(array.shape[0])
    result = sums[np.minimum(centre + half + 1, array.shape[0])] - sums[np.maximum(centre - half, 0)]
    return np.moveaxis(result, 0, axis)
