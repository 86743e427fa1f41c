"""Messages of ROS 2 as numbers: the OMG's Common Data Representation, by the definitions that a recording holds."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Decoder = Callable[[bytes], dict[str, Any]]
_NUMBERS = {
    "bool": "u1", "byte": "u1", "char": "u1", "float32": "f4", "float64": "f8", "int8": "i1", "uint8": "u1",
    "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_FIELD = re.compile(r"([\w/]+)(?:<=\d+)?(\[(?:(?:<=)?\d+)?\])?\s+(\w+)(?:\s+[^=\s].*)?$")
_DEEPEST = 40


class _Struct(NamedTuple):
    fields: list[_Field]
    least: int  # bytes that one takes at least


class _Field(NamedTuple):
    name: str
    kind: str | _Struct  # NumPy type, "text", or members
    many: int | None  # None: one; -1: as many as the message says


def message_decoder(name: str, text: str) -> Decoder:
    """Make a decoder of messages of a type, whose definition ``text`` holds those of all types in it.

    It gives nested dictionaries of NumPy numbers, arrays and texts; content that is cut off is a ValueError.
    """
    definitions = {"builtin_interfaces/Time": "int32 sec\nuint32 nanosec"}
    definitions["builtin_interfaces/Duration"] = definitions["builtin_interfaces/Time"]
    own = _short(name, "")
    for part in re.split(r"^={3,}\s*$", text, flags=re.MULTILINE):
        body = part.strip()
        head = re.match(r"MSG:\s*(\S+)\s*", body)
        definitions[_short(head[1], "") if head else own] = body[head.end() :] if head else body
    whole = _struct(own, definitions, {}, 0)

    def decode(data: bytes) -> dict[str, Any]:
        return _Reader(data).struct(whole)

    return decode


def _short(name: str, package: str) -> str:
    """Take pkg/msg/Name, pkg/Name or a Name of the same package as pkg/Name."""
    parts = name.split("/")
    if len(parts) == 1:
        return "std_msgs/Header" if name == "Header" else f"{package}/{name}"
    return f"{parts[0]}/{parts[-1]}"


def _struct(
    name: str, definitions: dict[str, str], known: dict[str, _Struct], depth: int
) -> _Struct:
    if name in known:
        return known[name]
    if name not in definitions or depth > _DEEPEST:
        raise ValueError(f"the definition of {name} is missing or holds itself")
    fields = []
    least = 0
    for line in definitions[name].splitlines():
        plain = line.split("#")[0].strip()
        found = _FIELD.match(plain)
        if not plain or (not found and "=" in plain):
            continue  # a constant
        if not found:
            raise ValueError(
                f"the definition of {name} has a line that is no field: {plain[:80]!r}"
            )
        told, many, label = found.groups()
        kind: str | _Struct
        if told in _NUMBERS:
            kind = _NUMBERS[told]
        elif told == "string":
            kind = "text"
        elif told == "wstring":
            raise ValueError(f"the definition of {name} has wide texts, which are not read")
        else:
            kind = _struct(_short(told, name.split("/")[0]), definitions, known, depth + 1)
        count = None if many is None else int(many[1:-1]) if many[1:-1].isdigit() else -1
        one = (
            kind.least
            if isinstance(kind, _Struct)
            else 4
            if kind == "text"
            else np.dtype(kind).itemsize
        )
        least += one if count is None else 4 if count < 0 else count * one
        fields.append(_Field(label, kind, count))
    known[name] = _Struct(fields, max(least, 1))
    return known[name]


class _Reader:
    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] or data[1] > 1:
            raise ValueError(f"a message must begin as plain CDR, got {data[:4].hex()!r}")
        self.data = data
        self.at = 4
        self.order = "<" if data[1] else ">"

    def take(self, kind: str, count: int) -> NDArray[Any]:
        """Numbers at their alignment, which counts from behind the four bytes of the header."""
        width = int(kind[1:])
        if count:
            self.at += -(self.at - 4) % width
        self.check(count * width)
        values = np.frombuffer(self.data, self.order + kind, count, self.at)
        self.at += count * width
        return values

    def check(self, size: int) -> None:
        if size > len(self.data) - self.at:
            raise ValueError(
                f"a message of {len(self.data)} bytes is cut off, it needs {size} more at {self.at}"
            )

    def length(self) -> int:
        return int(self.take("u4", 1)[0])

    def text(self) -> str:
        size = self.length()
        self.check(size)
        self.at += size
        return self.data[self.at - size : self.at].rstrip(b"\0").decode("utf-8", errors="replace")

    def struct(self, kind: _Struct) -> dict[str, Any]:
        if not kind.fields:
            self.take("u1", 1)  # an empty message has a byte
        return {name: self.field(one, count) for name, one, count in kind.fields}

    def field(self, kind: str | _Struct, count: int | None) -> Any:
        if count == -1:
            count = self.length()
        if isinstance(kind, _Struct):
            if count is None:
                return self.struct(kind)
            self.check(count * kind.least)
            return [self.struct(kind) for _ in range(count)]
        if kind == "text":
            if count is None:
                return self.text()
            self.check(4 * count)
            return [self.text() for _ in range(count)]
        return self.take(kind, 1)[0] if count is None else self.take(kind, count)
