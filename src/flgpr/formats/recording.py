"""Recordings of vehicles: MCAP files, with messages of ROS 2 (CDR) or JSON, as arrays stacked over the messages.

The container is that of https://mcap.dev/spec, the messages those of the OMG's Common Data Representation with the
layout that the file's ROS 2 message definitions give. Whatever a file declares is checked against what it holds before
memory is taken for it.
"""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.door import check_expansion
from flgpr.store.extras import optional

_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA = 3
_CHANNEL = 4
_MESSAGE = 5
_CHUNK = 6
_DATA_END = 15
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log and publish time in ns
_LARGEST_JSON = 64 * 2**20  # bytes of a message; it takes many times that when it is read
_WINDOW = 2**27  # largest window of zstd, bytes
_DAMAGED = object()
"""What stands for a message that cannot be read."""
_STAMPS = ({"sec", "nanosec"}, {"sec", "nsec"})


@dataclass
class _Series:
    """Messages that are stacked: those of a topic, or a topic's transforms of one frame to another."""

    name: str
    kind: str
    encoding: str
    count: int = 0
    first: int = 0  # log times, ns
    last: int = 0
    fields: dict[str, Any] = field(default_factory=dict)  # of the first message that can be read
    known: bool = False  # whether one was read
    damaged: int = 0  # messages that cannot be read, of those looked at
    fault: str = ""


class Recording:
    """An MCAP file: ``arrays`` are (name, shape, type, unit) of all it holds, ``lines`` tell its topics.

    A message that is damaged is left out; ``notes`` count them, those among the messages read so
    far.

    Every numeric field of a topic is an array over its messages, ``TOPIC/field.of.field``; a field of numbers alone,
    such as a position or a quaternion, is one (message, n) besides. Stamps are seconds; ``TOPIC@log_time`` and
    ``TOPIC@publish_time`` are the recorder's. Transforms are ``TOPIC/FRAME>CHILD/...``.
    """

    def __init__(self, path: Path, limit: int, notes: list[str] | None = None) -> None:
        self.path = path
        self.limit = limit
        self._series: dict[str, _Series] = {}
        self._lost: dict[str, _Series] = {}  # topics of transforms, whose messages may be damaged
        self._columns: dict[str, NDArray[Any]] = {}
        self._places: dict[str, tuple[str, str]] = {}
        self.arrays: list[tuple[str, tuple[int, ...], str, str]] = []
        self.notes = [] if notes is None else notes
        self._count()

    @property
    def lines(self) -> list[str]:
        """What it holds, a line per topic."""
        told = []
        for one in self._series.values():
            span = f" over {(one.last - one.first) / 1e9:.6g} s" if one.count > 1 else ""
            tables = [
                f"{name}."
                for name, value in one.fields.items()
                if f"{name}.x" in one.fields and np.ndim(value)
            ]
            shapes = ", ".join(
                f"{name} {'x'.join(map(str, np.shape(value)))}".strip()
                for name, value in one.fields.items()
                if not name.startswith(tuple(tables))
            )
            what = shapes if one.known else one.fault
            told.append(
                f"{one.name}: {one.count} {one.kind or one.encoding}{span}; {what or 'no numbers'}"
            )
        return told or ["no messages"]

    def read(self, name: str) -> NDArray[Any]:
        """Stack one field over all messages of its series; one that is missing or of another length is a ValueError."""
        if name not in self._columns:
            self._columns = {}  # one series at a time is kept
            self._stack(*self._places[name])
        return self._columns[name]

    def _stack(self, series: str, wanted: str) -> None:
        one = self._series[series]
        fields = {"@log_time": np.float64(), "@publish_time": np.float64(), **one.fields}
        size = one.count * sum(np.asarray(value).nbytes for value in fields.values())
        if size > self.limit:
            fields = {
                name: value for name, value in fields.items() if name in (wanted, "@log_time")
            }
        columns = {
            name: np.empty((one.count, *np.shape(value)), np.asarray(value).dtype)
            for name, value in fields.items()
        }
        row = 0
        damaged = one.damaged
        one.damaged = 0
        for topic, told, log, publish in self._messages({series}):
            if topic != series or told is _DAMAGED:
                continue
            flat = _flat(told) | {
                "@log_time": np.float64(log / 1e9),
                "@publish_time": np.float64(publish / 1e9),
            }
            for name in list(columns):
                value = flat.get(name)
                if (
                    value is not None
                    and not isinstance(value, str)
                    and np.shape(value) == columns[name].shape[1:]
                ):
                    columns[name][row] = value
                elif name not in (wanted, "@log_time"):
                    del columns[name]  # told when it is asked for
                else:
                    got = "none" if value is None else f"shape {np.shape(value)}"
                    raise ValueError(
                        f"{series}: {name} must have the shape {columns[name].shape[1:]} in all messages, got {got} in "
                        f"message {row}"
                    )
            row += 1
        if not row:
            raise ValueError(f"{series}: none of its {one.count} messages can be read: {one.fault}")
        if one.damaged and one.damaged != damaged:
            self._note_damage(one)
        one.damaged = max(one.damaged, damaged)
        # Messages are mostly in order, but several writers may share a file.
        order = np.argsort(columns["@log_time"][:row], kind="stable")
        self._columns = {
            _joined(series, name): column[:row][order] for name, column in columns.items()
        }

    def _note_damage(self, one: _Series) -> None:
        self.notes.append(
            f"{one.name}: {one.damaged} of {one.count} messages are damaged and left out ({one.fault})"
        )

    def _count(self) -> None:
        for name, told, log, _ in self._messages(None):
            one = self._series[name]
            one.first, one.last = (
                (min(one.first, log), max(one.last, log)) if one.count else (log, log)
            )
            if told is not None and told is not _DAMAGED and not one.known:
                one.fields = {
                    key: value for key, value in _flat(told).items() if not isinstance(value, str)
                }
                one.known = True
            one.count += 1
        for one in (*self._series.values(), *self._lost.values()):
            if one.damaged:
                self._note_damage(one)
        for one in self._series.values():
            for name, value in {
                "@log_time": np.float64(),
                "@publish_time": np.float64(),
                **one.fields,
            }.items():
                values = np.asarray(value)
                whole = _joined(one.name, name)
                self._places[whole] = one.name, name
                unit = "s" if name.startswith("@") or name.split(".")[-1] == "stamp" else ""
                self.arrays.append((whole, (one.count, *values.shape), str(values.dtype), unit))

    def _messages(self, wanted: set[str] | None) -> Iterator[tuple[str, Any, int, int]]:
        """Go through all messages: series, what it says (None where that is not needed), log and publish time, ns."""
        records = optional("mcap.records", "bags")
        streams = optional("mcap.data_stream", "bags").ReadDataStream
        schemas: dict[int, Any] = {}
        channels: dict[int, Any] = {}
        decoders: dict[int, Decoder | None] = {}
        for kind, data in self._records():
            if kind == _SCHEMA:
                schema = records.Schema.read(streams(BytesIO(data)))
                schemas[schema.id] = schema
            elif kind == _CHANNEL:
                channel = records.Channel.read(streams(BytesIO(data)))
                channels[channel.id] = channel
            elif kind == _MESSAGE:
                if len(data) < _MESSAGE_HEAD.size:
                    raise ValueError(
                        f"a message must have {_MESSAGE_HEAD.size} bytes or more, got {len(data)}"
                    )
                number, _, log, publish = _MESSAGE_HEAD.unpack_from(data)
                content = data[_MESSAGE_HEAD.size :]
                if number not in channels:
                    raise ValueError(
                        f"a message belongs to channel {number}, which is not declared"
                    )
                channel = channels[number]
                schema = schemas.get(channel.schema_id)
                if channel.id not in decoders:
                    decoders[channel.id] = self._decoder(channel, schema)
                decode = decoders[channel.id]
                topic = channel.topic
                transforms = (
                    schema is not None and schema.name.endswith("TFMessage") and decode is not None
                )
                if not transforms:
                    one = self._series[topic]
                    needed = decode is not None and (
                        topic in wanted if wanted is not None else not one.known
                    )
                    told = _decoded(decode, content, one) if needed and decode is not None else None
                    yield topic, told, log, publish
                elif decode is not None and (
                    wanted is None or any(name.startswith(f"{topic}/") for name in wanted)
                ):
                    lost = self._lost.setdefault(topic, _Series(topic, "transforms", "cdr"))
                    message = _decoded(decode, content, lost)
                    lost.count += 1
                    for told in () if message is _DAMAGED else message.get("transforms", ()):
                        parent = str(told["header"]["frame_id"])
                        child = str(told["child_frame_id"])
                        name = f"{topic}/{parent}>{child}"
                        self._series.setdefault(name, _Series(name, "transforms", "cdr"))
                        yield name, told, log, publish

    def _decoder(self, channel: Any, schema: Any) -> Decoder | None:
        """Give the decoder of a channel's messages, None where there is none; its topic is listed either way."""
        name = channel.topic
        encoding = channel.message_encoding
        one = self._series.setdefault(name, _Series(name, schema.name if schema else "", encoding))
        if encoding == "json":
            return _from_json
        if encoding == "cdr" and schema is not None and schema.encoding == "ros2msg":
            try:
                decoder = message_decoder(schema.name, schema.data.decode("utf-8"))
            except ValueError as error:
                one.fault = f"not read: {' '.join(str(error).split())[:160]}"
                return None
            if schema.name.endswith("TFMessage"):
                self._series.pop(name)
            return decoder
        layout = schema.encoding if schema is not None else "no"
        one.fault = f"not read: {encoding or 'unknown'} messages with {layout or 'no'} definition"
        return None

    def _records(self) -> Iterator[tuple[int, bytes]]:
        """Go through the records of the file, those in chunks, too, up to the end of the data."""
        with self.path.open("rb") as file:
            end = file.seek(0, 2)
            file.seek(0)
            if file.read(8) != _MAGIC:
                raise ValueError("it does not begin as MCAP of version 0")
            while True:
                head = file.read(9)
                size = int.from_bytes(head[1:], "little")
                if len(head) < 9 or size > end - file.tell():
                    raise ValueError(
                        f"it is cut off after {end} bytes, before the end of its data: mcap recover keeps what is there"
                    )
                if head[0] == _DATA_END:
                    return
                if head[0] not in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK):
                    file.seek(size, 1)
                    continue
                if size > self.limit:
                    raise ValueError(
                        f"a record must have at most {self.limit / 1e9:g} GB, got {size / 1e9:.3g} GB"
                    )
                data = file.read(size)
                if head[0] == _CHUNK:
                    yield from self._inside(data)
                else:
                    yield head[0], data

    def _inside(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        chunk = optional("mcap.records", "bags").Chunk.read(
            optional("mcap.data_stream", "bags").ReadDataStream(BytesIO(data))
        )
        held = self._unpacked(chunk)
        if chunk.uncompressed_crc and zlib.crc32(held) != chunk.uncompressed_crc:
            raise ValueError("a chunk does not agree with its checksum")
        at = 0
        while at < len(held):
            size = int.from_bytes(held[at + 1 : at + 9], "little")
            if at + 9 + size > len(held):
                raise ValueError("a record goes beyond the end of its chunk")
            if held[at] in (_SCHEMA, _CHANNEL, _MESSAGE):
                yield held[at], held[at + 9 : at + 9 + size]
            at += 9 + size

    def _unpacked(self, chunk: Any) -> bytes:
        size = chunk.uncompressed_size
        if size > self.limit:
            raise ValueError(
                f"a chunk must unpack to at most {self.limit / 1e9:g} GB, got {size / 1e9:.3g} GB"
            )
        check_expansion("a chunk", size, len(chunk.data))
        if chunk.compression == "zstd":
            packer = optional("zstandard", "bags").ZstdDecompressor(max_window_size=_WINDOW)
            with packer.stream_reader(BytesIO(chunk.data)) as stream:
                held = stream.read(size + 1)
        elif chunk.compression == "lz4":
            held = (
                optional("lz4.frame", "bags")
                .LZ4FrameDecompressor()
                .decompress(chunk.data, max_length=size + 1)
            )
        elif chunk.compression == "":
            held = chunk.data
        else:
            raise ValueError(
                f"chunks must be packed by zstd, lz4 or not at all, got {chunk.compression[:20]!r}"
            )
        if len(held) != size:
            raise ValueError(
                f"a chunk must unpack to the {size} bytes that it declares, got {len(held)} or more"
            )
        return bytes(held)


def _decoded(decode: Decoder, content: bytes, one: _Series) -> Any:
    """Return what a message says; ``_DAMAGED`` for one that is damaged, which its series counts."""
    try:
        return decode(content)
    except (ValueError, KeyError, IndexError, OverflowError, RecursionError) as error:
        one.damaged += 1
        one.fault = " ".join(str(error).split())[:120] or type(error).__name__
        return _DAMAGED


def _joined(series: str, name: str) -> str:
    return series + name if name.startswith("@") else f"{series}/{name}"


def _from_json(data: bytes) -> Any:
    if len(data) > _LARGEST_JSON:
        raise ValueError(f"a JSON message must have at most {_LARGEST_JSON} bytes, got {len(data)}")
    return json.loads(data, parse_int=float)


def _flat(told: Any, path: str = "") -> dict[str, Any]:
    """Numbers and texts of a message by their path; lists of like messages become arrays of their fields."""
    if isinstance(told, dict):
        if set(told) in _STAMPS and not any(
            isinstance(part, (dict, list, str)) for part in told.values()
        ):
            first, second = (
                told.values() if "sec" in list(told)[:1] else reversed(list(told.values()))
            )
            return {path: np.float64(float(first) + 1e-9 * float(second))}
        found: dict[str, Any] = {}
        for name, one in told.items():
            found |= _flat(one, f"{path}.{name}" if path else str(name))
        sides = [found.get(f"{path}.{name}") for name in told]
        if (
            path
            and len(sides) > 1
            and all(isinstance(side, (np.number, np.bool_)) for side in sides)
        ):
            found[path] = np.array(sides)
        return found
    if isinstance(told, np.ndarray):
        return {path: told}
    if isinstance(told, (list, tuple)):
        if told and all(isinstance(one, dict) for one in told):
            rows = [_flat(one) for one in told]
            return {
                f"{path}.{name}": np.stack([row[name] for row in rows])
                for name, first in rows[0].items()
                if not isinstance(first, str)
                and all(name in row and np.shape(row[name]) == np.shape(first) for row in rows)
                and not any(isinstance(row[name], str) for row in rows)
            }
        try:
            values = np.array(told, dtype=np.float64)
        except (ValueError, TypeError):
            return {}
        return {path: values}
    if isinstance(told, str):
        return {path: told}
    if told is None:
        return {path: np.float64(np.nan)}
    return {path: np.float64(told) if isinstance(told, (int, float)) else told}


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
