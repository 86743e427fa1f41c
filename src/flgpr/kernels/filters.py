"""Median over a rectangular window that shrinks at the image border.

Every column has a histogram of the pixels it adds to the window (Perreault & Hébert 2007), in three
levels of 16 bins that are one vector of the machine each: at every level the window's bins are the
sum of its columns', and the median is searched below one of them. The histograms count ranks, not
values: a bin holds equally many pixels of the image, so that the few of them inside the window can
be compared and the median is exact. Numba has no vector type: the sums of bins and the comparisons
are built as LLVM vectors. As plain loops they take 1.5 to 4.1 and 1.2 to 1.5 times as long as all
of the filter does now (``docs/evidence/speed.md``).
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import int64, types, uint64
from numba.core import cgutils
from numba.extending import intrinsic

from flgpr.jit.compiled import njit
from flgpr.jit.threads import share, shared
from flgpr.types import Float32Array

# Bins of a histogram level that make up one bin of the level above, and the lanes of a vector.
_FAN = 16
_MOST = 0xFFFF  # pixels that 16 bits count
_DIGIT = 11  # bits sorted at a time
_SHORT = ir.IntType(16)
_INDEX = ir.IntType(64)
_VECTOR = ir.VectorType(_SHORT, _FAN)
_ORDER = ir.VectorType(ir.IntType(32), _FAN)


@njit(cache=True)
def sorted_order(values: Any) -> Any:
    """Return the order of float32 values from small to large: a radix sort of their bits.

    The bits of floats that are not negative have the order of their values. With the sign bit set,
    and all bits of negative values inverted, this holds for all.
    """
    n = values.size
    bits = values.view(np.uint32)
    keys = np.empty(n, np.uint32)
    order = np.empty(n, np.int32)
    other_keys = np.empty(n, np.uint32)
    other_order = np.empty(n, np.int32)
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
            other_keys[to] = keys[i]
            other_order[to] = order[i]
        keys, other_keys = other_keys, keys
        order, other_order = other_order, order
    return order


def _row(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    """Read ``_FAN`` 16-bit numbers of an array from ``at`` on."""
    data = context.make_array(kind)(context, builder, array).data
    start = builder.mul(at, ir.Constant(_INDEX, 2))
    return builder.load(cgutils.pointer_add(builder, data, start, _VECTOR.as_pointer()), align=2)


def _spread(builder: Any, value: Any, number: Any = _SHORT) -> Any:
    """Return a vector that holds a number in every place."""
    none = ir.Constant(ir.VectorType(number, _FAN), ir.Undefined)
    first = builder.insert_element(
        none, builder.trunc(value, number), ir.Constant(ir.IntType(32), 0)
    )
    return builder.shuffle_vector(first, none, ir.Constant(_ORDER, None))


@intrinsic
def _bin_of(_context, table, first, columns, number_in_box, most):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return the bin of a counted pixel, and the number of pixels in the bins before it.

    The 16 bins are summed over ``columns`` rows of ``table[first:]``. A number of ``most``'s type
    can count all pixels.
    """
    pair = types.UniTuple(types.uint64, 2)
    number = ir.IntType(most.bitwidth)
    vector = ir.VectorType(number, _FAN)

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero = ir.Constant(vector, None)
        total = cgutils.alloca_once_value(builder, zero)
        with cgutils.for_range(builder, args[2], intp=_INDEX) as loop:
            at = builder.add(args[1], builder.mul(loop.index, ir.Constant(_INDEX, _FAN)))
            row = _row(context, builder, sig.args[0], args[0], at)
            row = row if number == _SHORT else builder.zext(row, vector)
            builder.store(builder.add(builder.load(total), row), total)
        cumulative = builder.load(total)
        for step in (1, 2, 4, 8):
            order = ir.Constant(_ORDER, [_FAN + i if i < step else i - step for i in range(_FAN)])
            cumulative = builder.add(cumulative, builder.shuffle_vector(cumulative, zero, order))
        is_before = builder.icmp_unsigned("<=", cumulative, _spread(builder, args[3], number))
        bin_index = builder.zext(builder.ctpop(builder.bitcast(is_before, _SHORT)), _INDEX)
        sums = cgutils.alloca_once_value(builder, cumulative)
        last = builder.sub(
            bin_index,
            builder.zext(builder.icmp_unsigned(">", bin_index, ir.Constant(_INDEX, 0)), _INDEX),
        )
        counted_before = builder.load(
            builder.gep(builder.bitcast(sums, number.as_pointer()), [last])
        )
        none = builder.icmp_unsigned("==", bin_index, ir.Constant(_INDEX, 0))
        before = builder.select(none, ir.Constant(_INDEX, 0), builder.zext(counted_before, _INDEX))
        return context.make_tuple(builder, pair, (bin_index, before))

    return pair(table, types.uint64, types.uint64, types.uint64, most), build


@intrinsic
def _inside(_context, places, at, box):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return as bits which of 16 ``places`` (y, x) lie in a ``box``.

    The box is its first y, rows, first x and columns.
    """

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        low_y, rows, low_x, columns = (
            _spread(builder, builder.extract_value(args[2], i)) for i in range(4)
        )
        y, x = (
            _row(context, builder, sig.args[0].dtype, builder.extract_value(args[0], i), args[1])
            for i in range(2)
        )
        inside = [
            builder.icmp_unsigned("<", builder.sub(a, low), n)
            for a, low, n in ((y, low_y, rows), (x, low_x, columns))
        ]
        return builder.zext(builder.bitcast(builder.and_(*inside), _SHORT), _INDEX)

    return types.uint64(places, types.uint64, box), build


@intrinsic
def _ones(_context, bits):  # type: ignore[no-untyped-def]
    """Count the bits that are set."""
    return types.uint64(bits), lambda _context, builder, _sig, args: builder.ctpop(args[0])


@intrinsic
def _lowest(_context, bits):  # type: ignore[no-untyped-def]
    """Return the position of the lowest bit that is set."""
    return types.uint64(bits), lambda _c, builder, _s, args: builder.cttz(
        args[0], ir.Constant(ir.IntType(1), 0)
    )


@njit(cache=True)
def _pick(places: Any, rank: int, last: int, number_in_box: Any, box: Any) -> int:
    """Return the rank of a pixel, given its number in the ``box`` among a bin's ranks."""
    change = uint64(1)
    while rank < last:
        bits = _inside(places, uint64(rank), box)
        if last - rank < _FAN:
            bits &= (change << uint64(last - rank)) - change
        count = _ones(bits)
        if number_in_box < count:
            for _ in range(number_in_box):
                bits &= bits - change
            return rank + int64(_lowest(bits))
        number_in_box -= count
        rank += _FAN
    return last - 1


@njit(cache=True)
def _count(
    row: Any, group: Any, groups: Any, change: Any, coarse: Any, middle: Any, fine: Any
) -> None:
    """Add ``change`` to the three levels for every pixel of a row of bins."""
    fan = uint64(_FAN)
    for x in range(row.size):
        b = uint64(row[x])
        g = group[x]
        half = b // fan
        coarse[g * fan + half // fan] += change
        middle[(half // fan * groups + g) * fan + half % fan] += change
        fine[(half * groups + g) * fan + b % fan] += change


@njit(cache=True)
def _median_rows(
    places: Any,
    values: Any,
    bins: Any,
    half_y: int,
    half_x: int,
    step: int,
    first: int,
    last: int,
    most: Any,
    out: Any,
) -> None:
    """Fill the median at every ``step``-th pixel of rows ``first`` to ``last``.

    Columns that enter and leave the window together share a histogram: ``step`` of them where the
    window is a whole number of groups. Group g begins ``half_x`` pixels before column g·wide, where
    the window about that column does.

    Parameters
    ----------
    places : tuple of two (rank,) ndarrays
        The y and the x of the pixels by rank, from :func:`_ranked`.
    values : (rank,) ndarray
        Pixel values by rank.
    bins : (y, x) ndarray of uint16
        Bins of the pixels in the finest histogram.
    half_y, half_x : int
        Half of the window without its centre.
    step : int
        Distance of the pixels whose median is computed.
    first, last : int
        First row, and the one after the last.
    most : unsigned integer
        Its type counts the pixels of a window.
    out : (y/step, x/step) ndarray
        Medians.
    """
    ny, nx = bins.shape
    shared = (2 * half_x + 1) % step == 0 and (2 * half_y + 1) * step <= _MOST
    width = _bin_width(bins.size)
    wide = step if shared else 1
    span = (2 * half_x + 1) // wide
    count = (nx - 1 + half_x) // wide + 1
    group = np.empty(nx, np.uint64)
    groups = uint64(count)
    fan = uint64(_FAN)
    for x in range(nx):
        group[x] = (x + half_x) // wide
    coarse = np.zeros(count * _FAN, np.uint16)
    middle = np.zeros(count * _FAN**2, np.uint16)
    fine = np.zeros(count * _FAN**3, np.uint16)
    for y in range(first, last):
        y0 = max(0, y - half_y)
        y1 = min(ny, y + half_y + 1)
        for v in range(y0 if y == first else y + half_y, y1):
            _count(bins[v], group, groups, np.uint16(1), coarse, middle, fine)
        if y > first and y - half_y - 1 >= 0:
            # Adding the largest number subtracts one.
            _count(bins[y - half_y - 1], group, groups, np.uint16(0xFFFF), coarse, middle, fine)
        if y % step:
            continue
        for x in range(0, nx, step):
            at = uint64(x // wide)
            columns = uint64(min(span, count - x // wide))
            x0 = max(0, x - half_x)
            x1 = min(nx, x + half_x + 1)
            box = uint64(y0), uint64(y1 - y0), uint64(x0), uint64(x1 - x0)
            pixels = (y1 - y0) * (x1 - x0)
            total = 0.0
            # The two middle ranks; of an odd number of pixels they are the same.
            for rank in ((pixels - 1) // 2, pixels // 2):
                b = uint64(0)
                left = uint64(rank)
                for table in (coarse, middle, fine):
                    i, before = _bin_of(table, (b * groups + at) * fan, columns, left, most)
                    b = b * fan + i
                    left = left - before
                start = int64(b) * width
                total += values[_pick(places, start, min(start + width, bins.size), left, box)]
                if pixels % 2:
                    total *= 2
                    break
            out[y // step, x // step] = total / 2


@njit(cache=True)
def _bin_width(pixels: int) -> int:
    """Return the ranks in a bin of the finest histogram."""
    return (pixels + _FAN**3 - 1) // _FAN**3


@njit(cache=True)
def _ranked(order: Any, image: Any) -> Any:
    """Return positions (y, x) by rank, a vector more of them, values by rank, and pixels' bins."""
    ny, nx = image.shape
    pixels = image.ravel()
    width = _bin_width(order.size)
    bins = np.empty(order.size, np.uint16)
    values = np.empty(order.size, image.dtype)
    rows = np.zeros(order.size + _FAN, np.int16)
    columns = np.zeros(order.size + _FAN, np.int16)
    per_row = 1 / nx
    for rank in range(order.size):
        # A division of whole numbers takes several times as long.
        y = int((order[rank] + 0.5) * per_row)
        rows[rank] = y
        columns[rank] = order[rank] - y * nx
    for first in range(0, order.size, width):
        for rank in range(first, min(first + width, order.size)):
            values[rank] = pixels[order[rank]]
            bins[order[rank]] = first // width
    return (rows, columns), values, bins.reshape(ny, nx)


@njit(nogil=True, cache=True)
def median_of_ranks(orders, images, half_y, half_x, step, sections, most, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill the median of images in windows at every ``step``-th pixel.

    Parameters
    ----------
    orders : (image, pixel) ndarray of int32
        Pixels of every image by rank.
    images : (image, y, x) ndarray
        Finite images.
    half_y, half_x, step, most
        As in :func:`_median_rows`.
    sections : int
        Sections of rows of an image, each with its own histograms.
    out : (image, y/step, x/step) ndarray
        Medians.
    begin, end : int
        Tasks of this call; a task is a section of an image.
    """
    ny = images.shape[1]
    for task in range(begin, end):
        i = task // sections
        section = task % sections
        places, values, bins = _ranked(orders[i], images[i])
        first, last = section * ny // sections, (section + 1) * ny // sections
        _median_rows(places, values, bins, half_y, half_x, step, first, last, most, out[i])


@shared(cache=True)
def _sort(images, orders, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``orders`` with the order of every image of ``images`` (image, pixel)."""
    for i in range(begin, end):
        order = sorted_order(images[i])
        # Assigning the array would take seconds more to compile.
        for k in range(order.size):
            orders[i, k] = order[k]


def median_stack(images: Float32Array, size: tuple[int, int], step: int = 1) -> Float32Array:
    """Return the exact median of images in a window, at every ``step``-th pixel.

    Parameters
    ----------
    images : (image, y, x) ndarray of float32
        Finite images.
    size : tuple of int
        Window (y, x), odd numbers of pixels; it shrinks at the border.
    step : int
        Distance of the pixels whose median is computed, both ways.

    Returns
    -------
    (image, ⌈y/step⌉, ⌈x/step⌉) ndarray of float32
        Medians.
    """
    stack = np.ascontiguousarray(images, dtype=np.float32)
    count, ny, nx = stack.shape
    orders = np.empty((count, ny * nx), np.int32)
    _sort(stack.reshape(orders.shape), orders)
    out = np.empty((count, -(-ny // step), -(-nx // step)), np.float32)
    # About eight tasks, also of few images: every section fills its first window anew.
    sections = max(1, min(8 // max(count, 1), ny))
    most = np.uint16(0) if size[0] * size[1] <= _MOST else np.uint32(0)
    half_y = size[0] // 2
    half_x = size[1] // 2
    medians = partial(median_of_ranks, orders, stack, half_y, half_x, step, sections, most, out)
    share(count * sections, medians)
    return out
