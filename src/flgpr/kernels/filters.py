"""Median and mean over a rectangular window that shrinks at the image border, so that nothing beyond it is made up.

The median takes the same time per pixel whatever the window (Perreault & Hébert 2007): every column keeps a histogram
of the pixels it adds to the window, and the window's histogram gains a column and loses one at each step. The
histograms count ranks, not values: a bin holds equally many pixels of the image, so that the few of them inside the
window can be looked at one by one and the median is exact.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from flgpr.kernels.compiled import njit

_FINE = 64  # bins per coarse bin
_COARSE = 64
_DIGIT = 11  # bits sorted at a time


@njit(cache=True)
def sorted_order(values: Any) -> Any:
    """Order of float32 values from small to large: a radix sort of their bits."""
    n = values.size
    bits = values.view(np.uint32)
    keys, order = np.empty(n, np.uint32), np.empty(n, np.int32)
    other_keys, other_order = np.empty(n, np.uint32), np.empty(n, np.int32)
    for i in range(n):
        flip = np.uint32(0xFFFFFFFF) if bits[i] >> 31 else np.uint32(0x80000000)
        keys[i] = bits[i] ^ flip
        order[i] = i
    count = np.empty(1 << _DIGIT, np.int32)
    for shift in (0, _DIGIT, 2 * _DIGIT):
        count[:] = 0
        for i in range(n):
            count[(keys[i] >> shift) & ((1 << _DIGIT) - 1)] += 1
        start = 0
        for digit in range(1 << _DIGIT):
            start, count[digit] = start + count[digit], start
        for i in range(n):
            digit = (keys[i] >> shift) & ((1 << _DIGIT) - 1)
            to = count[digit]
            count[digit] = to + 1
            other_keys[to], other_order[to] = keys[i], order[i]
        keys, other_keys = other_keys, keys
        order, other_order = other_order, order
    return order


@njit(cache=True)
def _add_column(total: Any, column: Any) -> None:
    for i in range(total.size):
        total[i] += column[i]


@njit(cache=True)
def _drop_column(total: Any, column: Any) -> None:
    for i in range(total.size):
        total[i] -= column[i]


@njit(cache=True)
def _move_column(total: Any, enters: Any, leaves: Any) -> None:
    for i in range(total.size):
        total[i] += enters[i] - leaves[i]


@njit(cache=True)
def _bring_up(fine: Any, groups: Any, have: int, first: int, span: int) -> None:
    """Bring one coarse bin of the fine histogram from the window at group ``have`` to that at group ``first``."""
    count = groups.shape[0]
    if have < 0 or first - have > span // 2:
        fine[:] = 0
        for g in range(first, min(count, first + span)):
            _add_column(fine, groups[g])
        return
    for at in range(have + 1, first + 1):
        enter, leave = at + span - 1, at - 1
        if enter < count:
            _move_column(fine, groups[enter], groups[leave])
        else:
            _drop_column(fine, groups[leave])


@njit(cache=True)
def _pick(places: Any, rank: int, last: int, wanted: int, y0: int, y1: int, x0: int, x1: int) -> int:
    """Rank of the ``wanted``-th pixel inside the window among the pixels of one bin, which begins at ``rank``."""
    for at in range(rank, last):
        y, x = places[at, 0], places[at, 1]
        if y0 <= y < y1 and x0 <= x < x1:
            if wanted == 0:
                return at
            wanted -= 1
    return last - 1


@njit(cache=True)
def _median_rows(
    places: Any, values: Any, bins: Any, half_y: int, half_x: int, step: int, first: int, last: int, out: Any
) -> None:
    """Median at every ``step``-th pixel of rows ``first`` to ``last``; ``places`` lists the pixels (y, x) by rank.

    Columns that enter and leave the window together share a histogram: ``step`` of them where the window is as many
    whole groups. Group g begins ``half_x`` pixels before column g·wide, where the window about that column does.
    """
    ny, nx = bins.shape
    width, wide = _bin_width(values.size), step if (2 * half_x + 1) % step == 0 else 1
    span, groups = (2 * half_x + 1) // wide, (nx - 1 + half_x) // wide + 1
    group = (np.arange(nx) + half_x) // wide
    groups_coarse = np.zeros((groups, _COARSE), np.uint16)
    groups_fine = np.zeros((_COARSE, groups, _FINE), np.uint16)
    coarse, fine = np.empty(_COARSE, np.uint16), np.empty((_COARSE, _FINE), np.uint16)
    upto = np.empty(_COARSE, np.int32)
    for y in range(first, last):
        y0, y1 = max(0, y - half_y), min(ny, y + half_y + 1)
        for v in range(y0 if y == first else y + half_y, y1):
            for x in range(nx):
                b, g = bins[v, x], group[x]
                groups_coarse[g, b // _FINE] += 1
                groups_fine[b // _FINE, g, b % _FINE] += 1
        if y > first and y - half_y - 1 >= 0:
            for x in range(nx):
                b, g = bins[y - half_y - 1, x], group[x]
                groups_coarse[g, b // _FINE] -= 1
                groups_fine[b // _FINE, g, b % _FINE] -= 1
        if y % step:
            continue
        coarse[:] = 0
        upto[:] = -1
        for g in range(min(span, groups)):
            _add_column(coarse, groups_coarse[g])
        for x in range(0, nx, step):
            at = x // wide
            for g in range(at - step // wide if x else at, at):
                _drop_column(coarse, groups_coarse[g])
                if g + span < groups:
                    _add_column(coarse, groups_coarse[g + span])
            x0, x1 = max(0, x - half_x), min(nx, x + half_x + 1)
            count = (y1 - y0) * (x1 - x0)
            total = 0.0
            for wanted in ((count - 1) // 2, count // 2):
                segment, seen = 0, 0
                while seen + coarse[segment] <= wanted:
                    seen += coarse[segment]
                    segment += 1
                if upto[segment] != at:
                    _bring_up(fine[segment], groups_fine[segment], upto[segment], at, span)
                    upto[segment] = at
                b = 0
                while seen + fine[segment, b] <= wanted:
                    seen += fine[segment, b]
                    b += 1
                start = (segment * _FINE + b) * width
                total += values[_pick(places, start, min(start + width, values.size), wanted - seen, y0, y1, x0, x1)]
                if count % 2:
                    total *= 2
                    break
            out[y // step, x // step] = total / 2


@njit(cache=True)
def _bin_width(pixels: int) -> int:
    return (pixels + _COARSE * _FINE - 1) // (_COARSE * _FINE)


@njit(cache=True)
def _ranked(order: Any, image: Any) -> Any:
    """Places and values by rank, and every pixel's bin."""
    ny, nx = image.shape
    pixels, width = image.ravel(), _bin_width(order.size)
    bins, places = np.empty(order.size, np.uint16), np.empty((order.size, 2), np.int16)
    values, per_row = np.empty(order.size, image.dtype), 1 / nx
    for rank in range(order.size):
        y = int((order[rank] + 0.5) * per_row)  # a division of whole numbers takes several times as long
        places[rank, 0], places[rank, 1] = y, order[rank] - y * nx
    for first in range(0, order.size, width):
        for rank in range(first, min(first + width, order.size)):
            values[rank], bins[order[rank]] = pixels[order[rank]], first // width
    return places, values, bins.reshape(ny, nx)


@njit(parallel=True, cache=True)
def median_of_ranks(orders, images, half_y, half_x, step, parts, out):  # type: ignore[no-untyped-def]
    """Median of ``images`` (image, y, x) in windows of half-widths ``half_y``, ``half_x``, at every ``step``-th pixel.

    ``orders`` (image, pixel) ranks the pixels of every image; its rows are dealt to ``parts`` sets of histograms.
    """
    count, ny = images.shape[0], images.shape[1]
    for task in prange(count * parts):
        i, part = task // parts, task % parts
        places, values, bins = _ranked(orders[i], images[i])
        first, last = part * ny // parts, (part + 1) * ny // parts
        _median_rows(places, values, bins, half_y, half_x, step, first, last, out[i])


@njit(parallel=True, cache=True)
def _sort(images, orders):  # type: ignore[no-untyped-def]
    """Fill ``orders`` with the order of every image of ``images`` (image, pixel)."""
    for i in prange(images.shape[0]):
        order = sorted_order(images[i])
        for k in range(order.size):  # as a whole it would take seconds more to compile
            orders[i, k] = order[k]


def median_stack(images: NDArray[np.float32], size: tuple[int, int], step: int = 1) -> NDArray[np.float32]:
    """Exact median of finite images (image, y, x) in a window as :func:`median_filter`, at every ``step``-th pixel."""
    stack = np.ascontiguousarray(images, dtype=np.float32)
    count, ny, nx = stack.shape
    out = np.empty((count, -(-ny // step), -(-nx // step)), np.float32)
    parts = max(1, min(8 // max(count, 1), ny))
    orders = np.empty((count, ny * nx), np.int32)
    _sort(stack.reshape(orders.shape), orders)
    median_of_ranks(orders, stack, size[0] // 2, size[1] // 2, step, parts, out)
    return out


def median_filter(image: NDArray[np.floating], size: tuple[int, int]) -> NDArray[np.float64]:
    """Exact median of an image (y, x), finite, in a window of ``size`` (y, x) odd pixels that shrinks at the border."""
    plain = np.ascontiguousarray(image, dtype=np.float64)[None]
    order = np.argsort(plain.ravel(), kind="stable").astype(np.int32)[None]
    out = np.empty_like(plain)
    median_of_ranks(order, plain, size[0] // 2, size[1] // 2, 1, min(8, plain.shape[1]), out)
    return out[0]


def mean_filter(image: NDArray[np.floating], size: tuple[int, int]) -> NDArray[np.float64]:
    """Mean of an image (y, x), finite, in a window of ``size`` (y, x) odd pixels that shrinks at the border."""
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
