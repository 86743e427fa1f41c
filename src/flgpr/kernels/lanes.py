"""Short vectors as machine code: the steps in which all channels of a pixel move together.

A lane row is ``2·channels`` float32 numbers, the real parts of all channels followed by the imaginary parts. Numba has
no vector type, and LLVM does not keep a row in registers across a loop over pairs by itself, so these few operations
are built as LLVM vectors. LLVM splits them into whatever registers the machine has.

``taps`` and ``channels`` are tuples of which only the length counts: it is part of the type, so that a kernel is
compiled for a width and a number of channels.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from flgpr.kernels.layout import BLOCK

_FLOAT = ir.FloatType()
_INDEX = ir.IntType(64)
_FUSED = ("contract",)


class _Code:
    """Loads, stores and arithmetic on vectors of ``lanes`` float32 numbers."""

    def __init__(self, context: Any, builder: Any, lanes: int) -> None:
        self.context, self.builder, self.lanes = context, builder, lanes
        self.vector = ir.VectorType(_FLOAT, lanes)

    def data(self, kind: Any, array: Any) -> Any:
        return self.context.make_array(kind)(self.context, self.builder, array).data

    def _at(self, data: Any, index: Any, kind: Any) -> Any:
        step = ir.Constant(_INDEX, 4)
        return cgutils.pointer_add(self.builder, data, self.builder.mul(index, step), kind.as_pointer())

    def number(self, data: Any, index: Any, kind: Any = _FLOAT) -> Any:
        return self.builder.load(self._at(data, index, kind), align=4)

    def spread(self, value: Any) -> Any:
        empty = ir.Constant(self.vector, ir.Undefined)
        first = self.builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), None)
        return self.builder.shuffle_vector(first, empty, zeros)

    def load(self, data: Any, index: Any) -> Any:
        return self.builder.load(self._at(data, index, self.vector), align=4)

    def store(self, value: Any, data: Any, index: Any) -> None:
        self.builder.store(value, self._at(data, index, self.vector), align=4)

    def add(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=_FUSED)

    def sub(self, a: Any, b: Any) -> Any:
        return self.builder.fsub(a, b, flags=_FUSED)

    def mul(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=_FUSED)

    def plus(self, index: Any, step: int) -> Any:
        return self.builder.add(index, ir.Constant(_INDEX, step))


@intrinsic
def gather_pairs(_context, total, at, table, bins, fields, k, pairs, taps, channels):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Add to one pixel's two lane rows the interpolated, rotated profiles of several pairs.

    ``total[at:]`` holds the rows Σ cos·v and Σ sin·v, v = Σ_a weight_a·table[bins + a]; ``fields`` holds per pair the
    rows cosine, sine and weights, each ``BLOCK`` long, of which entry ``k`` is used.
    """
    signature = types.void(total, types.uint64, table, bins, fields, types.uint64, types.uint64, taps, channels)
    step, width, lanes = BLOCK, taps.count, 2 * channels.count

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = _Code(context, builder, lanes)
        sums, profile, start, field = (code.data(sig.args[i], args[i]) for i in (0, 2, 3, 4))
        kept = [cgutils.alloca_once_value(builder, code.load(sums, code.plus(args[1], i * lanes))) for i in (0, 1)]
        with cgutils.for_range(builder, args[6], intp=_INDEX) as loop:
            at_pair = builder.add(builder.mul(loop.index, ir.Constant(_INDEX, step)), args[5])
            row = builder.zext(code.number(start, at_pair, ir.IntType(32)), _INDEX)
            where = builder.add(builder.mul(loop.index, ir.Constant(_INDEX, step * (width + 2))), args[5])
            value = None
            for a in range(width):
                weight = code.spread(code.number(field, code.plus(where, (2 + a) * step)))
                term = code.mul(weight, code.load(profile, code.plus(row, a * lanes)))
                value = term if value is None else code.add(value, term)
            for i in (0, 1):
                turn = code.spread(code.number(field, code.plus(where, i * step)))
                builder.store(code.add(builder.load(kept[i]), code.mul(turn, value)), kept[i])
        for i in (0, 1):
            code.store(builder.load(kept[i]), sums, code.plus(args[1], i * lanes))
        return context.get_dummy_value()

    return signature, build


@intrinsic
def spread_pairs(_context, value, at, table, bins, fields, k, pairs, taps, channels):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Transpose of :func:`gather_pairs`: add one pixel's lane row ``value[at:]`` to the profiles of several pairs."""
    signature = types.void(value, types.uint64, table, bins, fields, types.uint64, types.uint64, taps, channels)
    step, width, half = BLOCK, taps.count, channels.count
    lanes = 2 * half

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = _Code(context, builder, lanes)
        source, profile, start, field = (code.data(sig.args[i], args[i]) for i in (0, 2, 3, 4))
        row = code.load(source, args[1])
        # -j·value: the imaginary parts first, then the real parts with the sign changed.
        order = [*range(half, lanes), *range(lanes, lanes + half)]
        mask = ir.Constant(ir.VectorType(ir.IntType(32), lanes), order)
        turned = builder.shuffle_vector(row, builder.fneg(row), mask)
        with cgutils.for_range(builder, args[6], intp=_INDEX) as loop:
            at_pair = builder.add(builder.mul(loop.index, ir.Constant(_INDEX, step)), args[5])
            to = builder.zext(code.number(start, at_pair, ir.IntType(32)), _INDEX)
            where = builder.add(builder.mul(loop.index, ir.Constant(_INDEX, step * (width + 2))), args[5])
            cosine, sine = (code.spread(code.number(field, code.plus(where, i * step))) for i in (0, 1))
            rotated = code.add(code.mul(cosine, row), code.mul(sine, turned))
            for a in range(width):
                weight = code.spread(code.number(field, code.plus(where, (2 + a) * step)))
                spot = code.plus(to, a * lanes)
                code.store(code.add(code.load(profile, spot), code.mul(weight, rotated)), profile, spot)
        return context.get_dummy_value()

    return signature, build


@intrinsic
def butterfly(_context, source, at, gap, target, to, step, twiddle, turn, channels):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """One radix-4 butterfly of an inverse Fourier transform on lane rows.

    Reads the rows at ``at + i·gap`` and writes those at ``to + i·step`` (i = 0..3), times the twiddle factors 1,
    w, w², w³ with w = ``twiddle[turn]``, found at ``turn``, ``2·turn`` and ``3·turn``.
    """
    signature = types.void(
        source, types.uint64, types.uint64, target, types.uint64, types.uint64, twiddle, types.uint64, channels,
    )  # fmt: skip
    half = channels.count

    def build(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        code = _Code(context, builder, half)
        data, out, table = (code.data(sig.args[i], args[i]) for i in (0, 3, 6))

        def read(i: int) -> tuple[Any, Any]:
            spot = builder.add(args[1], builder.mul(args[2], ir.Constant(_INDEX, i)))
            return code.load(data, spot), code.load(data, code.plus(spot, half))

        def write(i: int, value: tuple[Any, Any]) -> None:
            spot = builder.add(args[4], builder.mul(args[5], ir.Constant(_INDEX, i)))
            if i:
                entry = builder.mul(args[7], ir.Constant(_INDEX, 2 * i))
                c, s = (code.spread(code.number(table, code.plus(entry, j))) for j in (0, 1))
                re, im = value
                value = code.sub(code.mul(re, c), code.mul(im, s)), code.add(code.mul(re, s), code.mul(im, c))
            code.store(value[0], out, spot)
            code.store(value[1], out, code.plus(spot, half))

        (ar, ai), (br, bi), (cr, ci), (dr, di) = (read(i) for i in range(4))
        pr, pi, mr, mi = code.add(ar, cr), code.add(ai, ci), code.sub(ar, cr), code.sub(ai, ci)
        qr, qi, nr, ni = code.add(br, dr), code.add(bi, di), code.sub(br, dr), code.sub(bi, di)
        write(0, (code.add(pr, qr), code.add(pi, qi)))
        write(1, (code.sub(mr, ni), code.add(mi, nr)))
        write(2, (code.sub(pr, qr), code.sub(pi, qi)))
        write(3, (code.add(mr, ni), code.sub(mi, nr)))
        return context.get_dummy_value()

    return signature, build
