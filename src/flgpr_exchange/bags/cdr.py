"""Messages of ROS 2 as numbers, by the definitions that a recording holds.

The encoding is the OMG's Common Data Representation (CDR). It is decoded here and not by
``mcap-ros2-support``: that library returns a text or a byte array that is cut off as if it were
complete, and builds arrays number by number in Python. It is the oracle of the tests.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from flgpr.budget import VALUE, Budget
from flgpr.model.bounds import shown_number
from flgpr.types import AnyArray, Entries

Decoder = Callable[[bytes], Entries]
_NUMBERS = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "float32": "f4",
    "float64": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
}
"""NumPy types of the primitive types of ROS 2."""
_TEXT = "text"
_VARIABLE = -1
_LENGTH_BYTES = 4  # of the count before a text or a sequence
_HEAD_BYTES = 4  # of a message: byte order and options; alignment counts from behind them
_FIELD = re.compile(r"([\w/]+)(?:<=\d+)?(\[(?:(?:<=)?\d+)?\])?\s+(\w+)(?:\s+[^=\s].*)?$")
_DEEPEST = 40
_MOST_FIELDS = 100_000  # of a type, those of all types in it counted: no sensor has a tenth of it
_MOST_DIGITS = 9  # of the length of an array
MOST_MESSAGE = 256 * 10**6
"""Memory that a message may take when it is decoded, bytes."""
_FREE_VALUES = 1000  # that a message may hold beside two for each of its bytes


class _Struct(NamedTuple):
    """The fields of a message type, in their order."""

    fields: list[_Field]
    least: int  # bytes that a message of this type takes at least
    size: int  # number of all fields in it, those of nested types too


class _Field(NamedTuple):
    """One field of a message type."""

    name: str
    kind: str | _Struct  # NumPy type, _TEXT, or the fields of a nested message
    size: int | None  # None: a single value; _VARIABLE: as many as the message states


def message_decoder(name: str, text: str) -> Decoder:
    """Return a decoder of the messages of a type.

    Parameters
    ----------
    name : str
        Type of the messages, such as "sensor_msgs/msg/Imu".
    text : str
        Its definition, followed by those of all types in it.

    Returns
    -------
    callable
        Takes the bytes of a message and returns nested dictionaries of NumPy numbers, arrays and
        texts; a message that is cut off is a ValueError.

    Raises
    ------
    ValueError
        If a definition is missing, holds itself, or has a field that cannot be read.
    """
    definitions = {"builtin_interfaces/Time": "int32 sec\nuint32 nanosec"}
    definitions["builtin_interfaces/Duration"] = definitions["builtin_interfaces/Time"]
    top_name = _short(name, "")
    for section in re.split(r"^={3,}\s*$", text, flags=re.MULTILINE):
        body = section.strip()
        head = re.match(r"MSG:\s*(\S+)\s*", body)
        if head is None:
            definitions[top_name] = body
        else:
            definitions[_short(head[1], "")] = body[head.end() :]
    top = _struct(top_name, definitions, {}, 0)

    def decode(data: bytes) -> Entries:
        return _Reader(data).struct(top)

    return decode


def _short(name: str, package: str) -> str:
    """Return pkg/Name of pkg/msg/Name, of pkg/Name, or of a Name in the same package."""
    segments = name.split("/")
    if len(segments) > 1:
        return f"{segments[0]}/{segments[-1]}"
    return "std_msgs/Header" if name == "Header" else f"{package}/{name}"


def _struct(
    name: str, definitions: dict[str, str], known: dict[str, _Struct], depth: int
) -> _Struct:
    """Return the fields of a type and of all types in it; ``known`` are those read before."""
    if name in known:
        return known[name]
    if name not in definitions or depth > _DEEPEST:
        raise ValueError(f"the definition of {name} is missing or holds itself")
    fields = []
    least = count = 0
    for line in definitions[name].splitlines():
        declaration = line.split("#")[0].strip()
        match = _FIELD.match(declaration)
        is_constant = match is None and "=" in declaration
        if not declaration or is_constant:
            continue
        if match is None:
            raise ValueError(
                f"the definition of {name} has a line that is no field: {declaration[:80]!r}"
            )
        type_name, brackets, label = match.groups()
        kind: str | _Struct
        single, nested = _LENGTH_BYTES, 0  # bytes at least, and fields in it
        if type_name in _NUMBERS:
            kind = _NUMBERS[type_name]
            single = np.dtype(kind).itemsize
        elif type_name == "string":
            kind = _TEXT
        elif type_name == "wstring":
            raise ValueError(f"the definition of {name} has wide texts, which are not read")
        else:
            package = name.split("/")[0]
            kind = _struct(_short(type_name, package), definitions, known, depth + 1)
            single, nested = kind.least, kind.size
        size = None
        if brackets is not None:
            digits = brackets[1:-1]
            if len(digits) > _MOST_DIGITS and digits.isdigit():
                raise ValueError(
                    f"an array must have at most 10^{_MOST_DIGITS} values, got {digits[:20]}"
                )
            size = int(digits) if digits.isdigit() else _VARIABLE
        repeats = 1 if size in (None, _VARIABLE) else size or 0
        least += _LENGTH_BYTES if size == _VARIABLE else repeats * single
        count += 1 + repeats * nested
        fields.append(_Field(label, kind, size))
    if count > _MOST_FIELDS:
        raise ValueError(
            f"the definition of {name} must hold at most {_MOST_FIELDS} fields, those of all "
            f"types in it counted, got {shown_number(count)}"
        )
    known[name] = _Struct(fields, max(least, 1), count)
    return known[name]


class _Reader:
    """Reads the fields of one message; sizes are checked before memory is taken."""

    def __init__(self, data: bytes) -> None:
        is_plain_cdr = len(data) >= _HEAD_BYTES and data[0] == 0 and data[1] <= 1
        if not is_plain_cdr:
            raise ValueError(f"a message must begin as plain CDR, got {data[:4].hex()!r}")
        self.data = data
        self.position = _HEAD_BYTES
        self.order = "<" if data[1] else ">"
        # Every value but an empty array takes a byte, and so does the message that it lies in.
        own = VALUE * (_FREE_VALUES + 2 * len(data))
        self.budget = Budget(f"a message of {len(data)} bytes", min(own, MOST_MESSAGE))

    def numbers(self, kind: str, count: int) -> AnyArray:
        """Return so many numbers of a NumPy type, from the next position that is aligned to it."""
        width = int(kind[1:])
        if count:
            self.position += -(self.position - _HEAD_BYTES) % width
        self.check(count * width)
        values = np.frombuffer(self.data, self.order + kind, count, self.position)
        self.position += count * width
        return values

    def check(self, size: int) -> None:
        """Refuse to read more bytes than the message has left."""
        if size > len(self.data) - self.position:
            raise ValueError(
                f"a message of {len(self.data)} bytes is cut off, "
                f"it needs {size} more at {self.position}"
            )

    def length(self) -> int:
        """Return the length that stands before a text or a sequence."""
        return int(self.numbers("u4", 1)[0])

    def text(self) -> str:
        """Return a text."""
        size = self.length()
        self.check(size)
        begin = self.position
        self.position += size
        content = self.data[begin : self.position].rstrip(b"\0")
        return content.decode("utf-8", errors="replace")

    def struct(self, kind: _Struct) -> Entries:
        """Return the fields of a message by their names."""
        if not kind.fields:
            self.numbers("u1", 1)  # an empty message has a byte
        values = {}
        self.budget.spend_values(1 + len(kind.fields))
        for field in kind.fields:
            values[field.name] = self.field(field.kind, field.size)
        return values

    def field(self, kind: str | _Struct, count: int | None) -> Any:
        """Return the value of a field, or the list or array of its values."""
        if count == _VARIABLE:
            count = self.length()
        read: Callable[[], Any]
        if isinstance(kind, _Struct):
            least, read = kind.least, partial(self.struct, kind)
        elif kind == _TEXT:
            least, read = _LENGTH_BYTES, self.text
        else:
            return self.numbers(kind, 1)[0] if count is None else self.numbers(kind, count)
        if count is None:
            return read()
        self.check(count * least)
        self.budget.spend_values(count)
        return [read() for _ in range(count)]
