"""MATLAB v5 files (saved by -v6 and -v7), read without C code that a damaged file could crash.

Written from the format's description (MathWorks, "MAT-File Format", level 5). Numbers, text and structures of them are
read; cells are gone into, and objects, functions and sparse arrays are passed over.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_STORED = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8", 16: "u1", 17: "u2",
    18: "u4",
}  # fmt: skip
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _CHAR = 1, 2, 4
_DEEPEST = 16


def read_mat(path: Path, limit: int) -> dict[str, NDArray[Any]]:
    """Read all arrays of a MATLAB v5 file.

    Parameters
    ----------
    path : Path
        The file.
    limit : int
        Most bytes the file may unpack to.

    Returns
    -------
    dict
        Name -> array; members of structures as ``struct.field``, of structure arrays and cells as ``struct[k].field``.

    Raises
    ------
    ValueError
        If the file is damaged or of another version.
    """
    raw = path.read_bytes()
    if len(raw) < 128:
        raise ValueError(f"it holds {len(raw)} bytes, the header alone has 128")
    mark = raw[126:128]
    if mark not in (b"IM", b"MI"):
        raise ValueError("the header does not tell the byte order; MATLAB v4 files must be saved anew with -v7")
    order = "<" if mark == b"IM" else ">"
    found: dict[str, NDArray[Any]] = {}
    reader = _Reader(memoryview(raw)[128:], order)
    budget = limit
    while reader.left() >= 8:
        kind, data = reader.element()
        if kind == _COMPRESSED:
            data, used = _unpacked(data, budget)
            budget -= used
            kind, data = _Reader(data, order).element()
        if kind == _MATRIX:
            found.update(_matrix(data, order, None, 0))
    if reader.left():
        raise ValueError(f"{reader.left()} bytes are left over at its end")
    return found


def _unpacked(data: memoryview, budget: int) -> tuple[memoryview, int]:
    work = zlib.decompressobj()
    out = work.decompress(data, max(budget, 1))
    if work.unconsumed_tail:
        raise ValueError(f"it unpacks to more than {budget / 2**30:.3g} GiB")
    if not work.eof:
        raise ValueError("a compressed variable is cut off")
    return memoryview(out), len(out)


@dataclass
class _Reader:
    data: memoryview
    order: str
    at: int = 0

    def left(self) -> int:
        return len(self.data) - self.at

    def element(self) -> tuple[int, memoryview]:
        """Read one tagged element; small ones hold their data in the tag."""
        if self.left() < 8:
            raise ValueError("a tag is cut off")
        first, size = (int(v) for v in np.frombuffer(self.data, f"{self.order}u4", 2, self.at))
        if first >> 16:
            kind, size, start, step = first & 0xFFFF, first >> 16, self.at + 4, 8
            if size > 4:
                raise ValueError(f"a small element tells of {size} bytes, it holds 4 at most")
        else:
            kind, start = first, self.at + 8
            step = 8 + size + (0 if kind == _COMPRESSED else -size % 8)
        if start + size > len(self.data):
            raise ValueError(f"an element tells of {size} bytes, {len(self.data) - start} are left: truncated")
        self.at = min(self.at + step, len(self.data))
        return kind, self.data[start : start + size]

    def numbers(self) -> NDArray[Any]:
        kind, data = self.element()
        if kind not in _STORED:
            raise ValueError(f"numbers cannot be of the type {kind}")
        dtype = np.dtype(self.order + _STORED[kind])
        if len(data) % dtype.itemsize:
            raise ValueError(f"{len(data)} bytes are no whole number of {dtype.itemsize}-byte values")
        return np.frombuffer(data, dtype)


def _matrix(data: memoryview, order: str, name: str | None, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    if not len(data):
        return
    if depth > _DEEPEST:
        raise ValueError(f"structures are nested deeper than {_DEEPEST}")
    reader = _Reader(data, order)
    flags = reader.numbers()
    if flags.size < 1:
        raise ValueError("a variable has no flags")
    kind, complex_ = int(flags[0]) & 0xFF, bool(int(flags[0]) & 0x0800)
    if kind > 15:
        return
    shape = tuple(int(n) for n in reader.numbers())
    count = int(np.prod(np.array(shape, dtype=object))) if shape else 0
    if len(shape) < 2 or min(shape) < 0 or count > 2**40:
        raise ValueError(f"a variable tells of the impossible shape {shape}")
    own = reader.numbers().tobytes().decode("ascii", errors="replace")
    label = own if name is None else name
    if kind == _STRUCT:
        yield from _structure(reader, label, count, depth)
    elif kind == _CELL:
        for k in range(count):
            yield from _matrix(reader.element()[1], order, f"{label}[{k}]", depth + 1)
    elif kind == _CHAR:
        letters = reader.numbers().astype(np.uint32)
        yield label, np.array("".join(chr(c) if c < 0x110000 else "?" for c in letters))
    elif kind in _CLASSES:
        values = _values(reader, shape, count, _CLASSES[kind])
        yield label, values + 1j * _values(reader, shape, count, _CLASSES[kind]) if complex_ else values


def _values(reader: _Reader, shape: tuple[int, ...], count: int, dtype: str) -> NDArray[Any]:
    stored = reader.numbers()
    if stored.size != count:
        raise ValueError(f"a variable of the shape {shape} holds {stored.size} values")
    with np.errstate(invalid="ignore", over="ignore"):
        return stored.astype(dtype).reshape(shape, order="F")


def _structure(reader: _Reader, label: str, count: int, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    width = reader.numbers()
    names = reader.numbers().tobytes()
    length = int(width[0]) if width.size else 0
    if not 1 <= length <= 256 or len(names) % length:
        raise ValueError(f"field names of {length} letters do not fill {len(names)} bytes")
    fields = [names[k : k + length].split(b"\0")[0].decode("ascii", "replace") for k in range(0, len(names), length)]
    for k in range(count if fields else 0):
        place = label if count == 1 else f"{label}[{k}]"
        for one in fields:
            kind, data = reader.element()
            if kind != _MATRIX:
                raise ValueError(f"{place}.{one} is no variable but of the type {kind}")
            yield from _matrix(data, reader.order, f"{place}.{one}", depth + 1)
