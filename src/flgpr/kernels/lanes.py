"""Short vectors as machine code: the steps in which all channels of a pixel move together.

A lane row is ``2·channels`` float32 numbers, the real parts of all channels followed by the
imaginary parts. A single channel would waste most of a vector: its table row holds the bins of all
taps instead, so that one load reads them and one store writes them. Numba has no vector type, and
LLVM does not keep a row in registers across a loop over pairs by itself, so these few operations
are built as LLVM vectors. LLVM splits them into whatever registers the machine has. With any one of
them as a plain numba loop the imaging kernels take 1.2 to 3.1 times as long
(``docs/evidence/speed.md``).

``taps`` and ``channels`` are tuples of which only the length counts: it is part of the type, so
that a kernel is compiled for a width and a number of channels.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from flgpr.kernels.layout import BLOCK, padded, row_size

_FLOAT = ir.FloatType()
_INDEX = ir.IntType(64)
_FUSED = ("contract",)
_VECTOR = 16


class _Code:
    """Loads, stores and arithmetic on vectors of ``lanes`` float32 numbers."""

    def __init__(self, context: Any, builder: Any, lanes: int) -> None:
        self.context = context
        self.builder = builder
        self.lanes = lanes
        self.vector = ir.VectorType(_FLOAT, lanes)

    def data(self, kind: Any, array: Any) -> Any:
        """Return the pointer to an array's numbers."""
        return self.context.make_array(kind)(self.context, self.builder, array).data

    def _at(self, data: Any, index: Any, kind: Any) -> Any:
        """Return the pointer to an entry, as one of another type."""
        step = ir.Constant(_INDEX, 4)
        return cgutils.pointer_add(
            self.builder, data, self.builder.mul(index, step), kind.as_pointer()
        )

    def number(self, data: Any, index: Any, kind: Any = _FLOAT) -> Any:
        """Return one number of an array."""
        return self.builder.load(self._at(data, index, kind), align=4)

    def spread(self, value: Any, vector: Any = None) -> Any:
        """Return a vector that holds a value in every place."""
        empty = ir.Constant(vector or self.vector, ir.Undefined)
        first = self.builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), None)
        return self.builder.shuffle_vector(first, empty, zeros)

    def shuffle(self, value: Any, order: list[int], other: Any = None) -> Any:
        """Return a vector of some places of one or two vectors, in an order."""
        other = ir.Constant(value.type, ir.Undefined) if other is None else other
        return self.builder.shuffle_vector(
            value, other, ir.Constant(ir.VectorType(ir.IntType(32), len(order)), order)
        )

    def load(self, data: Any, index: Any, vector: Any = None) -> Any:
        """Return a vector from an array."""
        return self.builder.load(self._at(data, index, vector or self.vector), align=4)

    def store(self, value: Any, data: Any, index: Any) -> None:
        """Write a vector into an array."""
        self.builder.store(value, self._at(data, index, value.type), align=4)

    def add(self, a: Any, b: Any) -> Any:
        """Return the sum of two vectors."""
        return self.builder.fadd(a, b, flags=_FUSED)

    def sub(self, a: Any, b: Any) -> Any:
        """Return the difference of two vectors."""
        return self.builder.fsub(a, b, flags=_FUSED)

    def mul(self, a: Any, b: Any) -> Any:
        """Return the product of two vectors."""
        return self.builder.fmul(a, b, flags=_FUSED)

    def plus(self, index: Any, step: int) -> Any:
        """Return an index some entries further on."""
        return self.builder.add(index, ir.Constant(_INDEX, step))


@intrinsic
def combine_antennas(  # type: ignore[no-untyped-def]
    _context,
    delay,
    cosine,
    sine,
    i,  # noqa: ARG001
    j,  # noqa: ARG001
    base,  # noqa: ARG001
    origin,  # noqa: ARG001
    shift,  # noqa: ARG001
    weight,
    powers,
    taps,
    channels,
    start,
    fields,
    g,  # noqa: ARG001
):
    """Compute table rows, phasors and tap weights of pair ``g`` from the rows of its two antennas.

    Parameters
    ----------
    delay, cosine, sine : ndarray
        32-bit delays and phasors of all antennas (:func:`flgpr.kernels.geometry.antenna_rows`).
    i, j : int
        Entries where the pixels of the pair's two antennas begin.
    base : int
        First bin of the pair in the table.
    origin, shift : int
        32-bit delay of that bin, and number of a delay's bits below a bin.
    weight : (power·tap,) ndarray of float32
        Coefficients of the taps' polynomials in the fraction of a bin less one half, the taps
        padded as in :func:`flgpr.kernels.layout.padded`.
    powers, taps, channels : tuple
        As long as there are coefficients, taps and channels.
    start : ndarray of uint32
        Starts of the table rows, filled as :func:`gather_pairs` takes them.
    fields : ndarray of float32
        Cosines, sines and weights, likewise.
    g : int
        Number of the pair in ``start`` and ``fields``.
    """
    signature = types.void(
        delay,
        cosine,
        sine,
        types.uint64,
        types.uint64,
        types.uint32,
        types.uint32,
        types.uint32,
        weight,
        powers,
        taps,
        channels,
        start,
        fields,
        types.uint64,
    )
    width = padded.py_func(taps.count)
    numbers = row_size.py_func(taps.count, channels.count)
    together = _VECTOR // width

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = _Code(context, builder, _VECTOR)
        narrow = _Code(context, builder, width)
        delays, cosines, sines, table, target, out = (
            code.data(sig.args[n], args[n]) for n in (0, 1, 2, 8, 12, 13)
        )
        index_vector = ir.VectorType(ir.IntType(32), _VECTOR)
        base, origin, shift = (code.spread(args[n], index_vector) for n in (5, 6, 7))
        unit = ir.Constant(ir.IntType(32), 1)
        mask = code.spread(builder.sub(builder.shl(unit, args[7]), unit), index_vector)
        scale = code.spread(
            builder.fdiv(ir.Constant(_FLOAT, 1), builder.uitofp(builder.shl(unit, args[7]), _FLOAT))
        )
        powers_ = [
            narrow.shuffle(
                narrow.load(table, ir.Constant(_INDEX, n * width)), [*range(width)] * together
            )
            for n in range(powers.count)
        ]
        row = builder.mul(args[14], ir.Constant(_INDEX, BLOCK))
        first = builder.mul(row, ir.Constant(_INDEX, 2 + width))
        with cgutils.for_range(builder, ir.Constant(_INDEX, BLOCK // _VECTOR), intp=_INDEX) as loop:
            k = builder.mul(loop.index, ir.Constant(_INDEX, _VECTOR))
            at_tx = builder.add(args[3], k)
            at_rx = builder.add(args[4], k)
            delay_tx = code.load(delays, at_tx, index_vector)
            delay_rx = code.load(delays, at_rx, index_vector)
            d = builder.sub(builder.add(delay_tx, delay_rx), origin)
            bin_ = builder.add(base, builder.lshr(d, shift))
            starts = builder.mul(bin_, ir.Constant(index_vector, [numbers] * _VECTOR))
            code.store(starts, target, builder.add(row, k))
            ci = code.load(cosines, at_tx)
            cj = code.load(cosines, at_rx)
            si = code.load(sines, at_tx)
            sj = code.load(sines, at_rx)
            where = builder.add(first, k)
            code.store(code.sub(code.mul(ci, cj), code.mul(si, sj)), out, where)
            code.store(code.add(code.mul(si, cj), code.mul(ci, sj)), out, code.plus(where, BLOCK))
            half = ir.Constant(code.vector, [0.5] * _VECTOR)
            y = code.sub(code.mul(builder.sitofp(builder.and_(d, mask), code.vector), scale), half)
            destination = code.plus(
                builder.add(first, builder.mul(k, ir.Constant(_INDEX, width))), 2 * BLOCK
            )
            for n in range(width):
                fraction = code.shuffle(
                    y, [n * together + m for m in range(together) for _ in range(width)]
                )
                value = powers_[-1]
                for power in powers_[-2::-1]:
                    value = code.add(code.mul(value, fraction), power)
                code.store(value, out, code.plus(destination, n * _VECTOR))
        return context.get_dummy_value()

    return signature, build


@intrinsic
def gather_pairs(_context, total, at, table, bins, fields, k, pairs, taps, channels):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Add to one pixel's row ``total[at:]`` the interpolated, rotated profiles of several pairs.

    Parameters
    ----------
    total : ndarray of float32
        Complex numbers of all channels; of a single channel the sums of every tap, all real parts
        before the imaginary parts.
    at : int
        Entry where the pixel's row begins.
    table : ndarray of float32
        Range profiles.
    bins, fields : ndarray
        Starts of table rows, and for every pair the rows cosine and sine, ``BLOCK`` long, before
        the weights (pixel, tap), as :func:`combine_antennas` fills them.
    k : int
        Number of the pixel in its block.
    pairs : int
        Number of pairs.
    taps, channels : tuple
        As long as there are taps and channels.
    """
    signature = types.void(
        total, types.uint64, table, bins, fields, types.uint64, types.uint64, taps, channels
    )
    width = padded.py_func(taps.count)
    single = channels.count == 1
    half = width if single else channels.count
    lanes = 2 * half

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = _Code(context, builder, lanes)
        narrow = _Code(context, builder, width)
        sums, profile, start, field = (code.data(sig.args[i], args[i]) for i in (0, 2, 3, 4))
        # Σ cos·v and Σ sin·v, v = Σ_a weight_a·table[bins + a]
        accumulators = [
            cgutils.alloca_once_value(builder, ir.Constant(code.vector, None)) for _ in range(2)
        ]
        with cgutils.for_range(builder, args[6], intp=_INDEX) as loop:
            row, turns, weights = _fields_of(code, narrow, start, field, loop.index, args[5])
            if single:
                value = code.mul(
                    code.load(profile, row), code.shuffle(weights, [*range(width)] * 2)
                )
            else:
                value = None
                for a in range(taps.count):
                    term = code.mul(
                        code.shuffle(weights, [a] * lanes),
                        code.load(profile, code.plus(row, a * lanes)),
                    )
                    value = term if value is None else code.add(value, term)
            for sum_, turn in zip(accumulators, turns, strict=True):
                builder.store(
                    code.add(builder.load(sum_), code.mul(code.spread(turn), value)), sum_
                )
        across, up = (builder.load(sum_) for sum_ in accumulators)
        real = [*range(half)]
        imaginary = [*range(half, lanes)]
        re = code.sub(code.shuffle(across, real), code.shuffle(up, imaginary))
        im = code.add(code.shuffle(across, imaginary), code.shuffle(up, real))
        order = real + imaginary if single else [i for k in range(half) for i in (k, half + k)]
        code.store(code.add(code.load(sums, args[1]), code.shuffle(re, order, im)), sums, args[1])
        return context.get_dummy_value()

    return signature, build


def _fields_of(
    code: _Code, taps: _Code, start: Any, field: Any, pair: Any, k: Any
) -> tuple[Any, list[Any], Any]:
    """Return the start of the table row of a pair and pixel, its cosine, sine and weights."""
    width = taps.lanes
    builder = code.builder
    at_pair = builder.add(builder.mul(pair, ir.Constant(_INDEX, BLOCK)), k)
    row = builder.zext(code.number(start, at_pair, ir.IntType(32)), _INDEX)
    first = builder.mul(pair, ir.Constant(_INDEX, BLOCK * (2 + width)))
    where = builder.add(first, k)
    turns = [code.number(field, code.plus(where, i * BLOCK)) for i in (0, 1)]
    weights = builder.add(code.plus(first, 2 * BLOCK), builder.mul(k, ir.Constant(_INDEX, width)))
    return row, turns, taps.load(field, weights)


@intrinsic
def spread_pairs(_context, value, at, table, bins, fields, k, pairs, taps, channels):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Add one pixel's value to the profiles of several pairs: the transpose of gather_pairs.

    ``value[at:]`` holds the real parts of all channels before the imaginary parts; the other
    arguments are those of :func:`gather_pairs`.
    """
    signature = types.void(
        value, types.uint64, table, bins, fields, types.uint64, types.uint64, taps, channels
    )
    width = padded.py_func(taps.count)
    single = channels.count == 1
    half = width if single else channels.count
    lanes = 2 * half

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = _Code(context, builder, lanes)
        narrow = _Code(context, builder, width)
        source, profile, start, field = (code.data(sig.args[i], args[i]) for i in (0, 2, 3, 4))
        row = _Code(context, builder, 2 * channels.count).load(source, args[1])
        if single:
            row = code.shuffle(row, [0] * half + [1] * half)
        # -j·value: the imaginary parts first, then the real parts with the sign changed.
        turned = code.shuffle(
            row, [*range(half, lanes), *range(lanes, lanes + half)], builder.fneg(row)
        )
        with cgutils.for_range(builder, args[6], intp=_INDEX) as loop:
            to, (cosine, sine), weights = _fields_of(
                code, narrow, start, field, loop.index, args[5]
            )
            rotated = code.add(
                code.mul(code.spread(cosine), row), code.mul(code.spread(sine), turned)
            )
            for a in range(1 if single else taps.count):
                weight = code.shuffle(weights, [*range(width)] * 2 if single else [a] * lanes)
                spot = code.plus(to, a * lanes)
                code.store(
                    code.add(code.load(profile, spot), code.mul(weight, rotated)), profile, spot
                )
        return context.get_dummy_value()

    return signature, build


@intrinsic
def butterfly(_context, source, at, gap, target, to, step, twiddle, turn, channels):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Compute one radix-4 butterfly of an inverse Fourier transform on lane rows.

    Reads the rows at ``at + i·gap`` and writes those at ``to + i·step`` (i = 0..3), times the
    twiddle factors 1, w, w², w³ with w = ``twiddle[turn]``, found at ``turn``, ``2·turn`` and
    ``3·turn``.
    """
    signature = types.void(
        source,
        types.uint64,
        types.uint64,
        target,
        types.uint64,
        types.uint64,
        twiddle,
        types.uint64,
        channels,
    )
    half = channels.count

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = _Code(context, builder, half)
        data, out, table = (code.data(sig.args[i], args[i]) for i in (0, 3, 6))

        def read(i: int) -> tuple[Any, Any]:
            """Return real and imaginary parts of input row ``i``."""
            spot = builder.add(args[1], builder.mul(args[2], ir.Constant(_INDEX, i)))
            return code.load(data, spot), code.load(data, code.plus(spot, half))

        def write(i: int, value: tuple[Any, Any]) -> None:
            """Write output row ``i``, turned by its twiddle factor."""
            spot = builder.add(args[4], builder.mul(args[5], ir.Constant(_INDEX, i)))
            if i:
                entry = builder.mul(args[7], ir.Constant(_INDEX, 2 * i))
                c, s = (code.spread(code.number(table, code.plus(entry, j))) for j in (0, 1))
                re, im = value
                value = (
                    code.sub(code.mul(re, c), code.mul(im, s)),
                    code.add(code.mul(re, s), code.mul(im, c)),
                )
            code.store(value[0], out, spot)
            code.store(value[1], out, code.plus(spot, half))

        (ar, ai), (br, bi), (cr, ci), (dr, di) = (read(i) for i in range(4))
        pr = code.add(ar, cr)
        pi = code.add(ai, ci)
        mr = code.sub(ar, cr)
        mi = code.sub(ai, ci)
        qr = code.add(br, dr)
        qi = code.add(bi, di)
        nr = code.sub(br, dr)
        ni = code.sub(bi, di)
        write(0, (code.add(pr, qr), code.add(pi, qi)))
        write(1, (code.sub(mr, ni), code.add(mi, nr)))
        write(2, (code.sub(pr, qr), code.sub(pi, qi)))
        write(3, (code.add(mr, ni), code.sub(mi, nr)))
        return context.get_dummy_value()

    return signature, build
