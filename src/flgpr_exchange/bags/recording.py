"""Recordings of vehicles: MCAP files, with messages of ROS 2 (CDR) or JSON, as arrays.

Arrays are stacked over the messages. Whatever a file declares is checked against what it holds
before memory is taken for it. What is damaged is left out and counted: a message, or a chunk with
the messages in it (:mod:`flgpr_exchange.bags.container`).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flgpr.budget import VALUE, Budget
from flgpr.formats.array_file import ArrayFile, ArrayInfo
from flgpr.formats.arrays import open_arrays
from flgpr.formats.draft_mapping import draft_of_file
from flgpr.formats.reader import Explanation, Reader
from flgpr.json_text import parse_json
from flgpr.store.extras import optional
from flgpr.types import AnyArray
from flgpr_exchange.bags.cdr import MOST_MESSAGE, Decoder, message_decoder
from flgpr_exchange.bags.container import MESSAGE, SCHEMA, McapContainer

_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log and publish time in ns
_LARGEST_JSON = 64 * 2**20  # bytes of a message; it takes many times that when it is read
_DAMAGED = object()
"""Content of a message that cannot be read."""
_STAMPS = ({"sec", "nanosec"}, {"sec", "nsec"})
_LOG_TIME = "@log_time"
_PUBLISH_TIME = "@publish_time"
_CONVERTED = {
    b"SQLite format 3": "a ROS 2 bag (or another file) in SQLite",
    b"#ROSBAG": "a ROS 1 bag",
}
"""Beginnings of files that must be converted, and what these are."""
_RECOVER = "mcap recover makes a file of what is there"


@dataclass
class _Series:
    """Messages that are stacked: of a topic, or a topic's transforms of one frame to another."""

    name: str
    kind: str
    encoding: str
    count: int = 0
    first: int = 0  # log times, ns
    last: int = 0
    fields: dict[str, Any] = field(default_factory=dict)  # of the first message that can be read
    known: bool = False  # whether one was read
    damaged: int = 0  # messages that cannot be read, of those decoded
    fault: str = ""

    def all_fields(self) -> dict[str, Any]:
        """Return the fields of a message, the recorder's two times before them."""
        return {_LOG_TIME: np.float64(), _PUBLISH_TIME: np.float64(), **self.fields}


class _Message(NamedTuple):
    """A message, or one transform of it."""

    series: str
    content: Any  # its fields by path; _DAMAGED, or None where it is not needed
    log_time: int  # ns
    publish_time: int  # ns


class _Declarations:
    """The schemas and channels that records declare, and the decoders of their messages."""

    def __init__(self) -> None:
        self.schemas: dict[int, Any] = {}
        self.channels: dict[int, Any] = {}
        self.decoders: dict[int, Decoder | None] = {}
        self.damaged = 0  # records that cannot be read
        self.with_summary = False  # whether those that the summary repeats are among them
        self._records = optional("mcap.records", "bags")
        self._stream = optional("mcap.data_stream", "bags").ReadDataStream

    def add(self, kind: int, content: bytes) -> None:
        """Add a schema or a channel; a record that is damaged is counted."""
        reader = self._records.Schema if kind == SCHEMA else self._records.Channel
        try:
            declared = reader.read(self._stream(BytesIO(content)))
        except Exception:  # whatever the library raises on what is damaged
            self.damaged += 1
            return
        known = self.schemas if kind == SCHEMA else self.channels
        known[declared.id] = declared


class Recording:
    """An MCAP file as arrays over its messages.

    Every numeric field of a topic is an array over its messages, ``TOPIC/field.of.field``; a field
    of numbers alone, such as a position or a quaternion, is one (message, n) besides. Stamps are
    seconds; ``TOPIC@log_time`` and ``TOPIC@publish_time`` are the recorder's. Transforms are
    ``TOPIC/FRAME>CHILD/...``.

    What is damaged is left out: a message, or a chunk and all in it. A file of which nothing can be
    read is a ValueError.

    Attributes
    ----------
    arrays : dict of str to ArrayInfo
        Every array by its name.
    notes : list of str
        Counts of what is damaged; of messages, among those read so far.
    """

    def __init__(self, path: Path, limit: int) -> None:
        self.path = path
        self.limit = limit
        self._container = McapContainer(path, limit)
        self._series: dict[str, _Series] = {}
        self._transforms: dict[str, _Series] = {}  # their topics, whose messages may be damaged
        self._columns: dict[str, AnyArray] = {}
        self._field_of: dict[str, tuple[str, str]] = {}  # series and field of an array
        self._declared = _Declarations()
        self._undeclared = 0  # messages of channels that nothing declares
        self._short = 0  # messages whose head is cut off
        self.arrays: dict[str, ArrayInfo] = {}
        self.notes: list[str] = []
        self._count()

    @property
    def lines(self) -> list[str]:
        """What it holds, a line per topic."""
        lines = [_line_of(series) for series in self._series.values()]
        return lines or ["no messages"]

    def read(self, name: str) -> AnyArray:
        """Stack one field over all messages of its series.

        A field that is missing in a message, or of another length, is a ValueError.
        """
        if name not in self._columns:
            self._columns = {}  # only one series at a time, to bound the memory
            self._stack(*self._field_of[name])
        return self._columns[name]

    def _stack(self, name: str, required: str) -> None:
        """Stack the fields of a series; where all are too large, the ``required`` one alone."""
        series = self._series[name]
        needed = (required, _LOG_TIME)
        columns = self._empty_columns(series, needed)
        row = 0
        damaged_before = series.damaged
        series.damaged = 0
        for message in self._messages({name}):
            if message.series != name or message.content is _DAMAGED:
                continue
            values = message.content
            values[_LOG_TIME] = np.float64(message.log_time / 1e9)
            values[_PUBLISH_TIME] = np.float64(message.publish_time / 1e9)
            for label in list(columns):
                value = values.get(label)
                shape = columns[label].shape[1:]
                if _fits(value, shape):
                    columns[label][row] = value
                elif label not in needed:
                    del columns[label]  # an error when it is asked for
                else:
                    got = "none" if value is None else f"shape {np.shape(value)}"
                    raise ValueError(
                        f"{name}: {label} must have the shape {shape} in all messages, "
                        f"got {got} in message {row}"
                    )
            row += 1

        if not row:
            raise ValueError(
                f"{name}: none of its {series.count} messages can be read: {series.fault}"
            )
        if series.damaged and series.damaged != damaged_before:
            self._note_damage(series)
        series.damaged = max(series.damaged, damaged_before)

        # Messages are mostly in order, but several writers may share a file.
        order = np.argsort(columns[_LOG_TIME][:row], kind="stable")
        self._columns = {}
        for label, column in columns.items():
            self._columns[_array_name(name, label)] = column[:row][order]

    def _empty_columns(self, series: _Series, needed: tuple[str, ...]) -> dict[str, AnyArray]:
        """Return an empty array for every field; where all are too large, for the needed alone."""
        fields = series.all_fields()
        bytes_of_message = sum(np.asarray(value).nbytes for value in fields.values())
        if series.count * bytes_of_message > self.limit:
            fields = {label: fields[label] for label in fields if label in needed}
        columns = {}
        for label, value in fields.items():
            shape = (series.count, *np.shape(value))
            columns[label] = np.empty(shape, np.asarray(value).dtype)
        return columns

    def _note_damage(self, series: _Series) -> None:
        """Add a note of the damaged messages of a series."""
        self.notes.append(
            f"{series.name}: {series.damaged} of {series.count} messages are damaged "
            f"and left out ({series.fault})"
        )

    def _count(self) -> None:
        """Go through the file once: count messages, and find the fields of every series."""
        for message in self._messages(None):
            series = self._series[message.series]
            if series.count:
                series.first = min(series.first, message.log_time)
                series.last = max(series.last, message.log_time)
            else:
                series.first = message.log_time
                series.last = message.log_time
            can_be_read = message.content is not None and message.content is not _DAMAGED
            if can_be_read and not series.known:
                for label, value in message.content.items():
                    if not isinstance(value, str):
                        series.fields[label] = value
                series.known = True
            series.count += 1
        self._note_container()
        for series in (*self._series.values(), *self._transforms.values()):
            if series.damaged:
                self._note_damage(series)
        for series in self._series.values():
            self._list_arrays(series)

    def _list_arrays(self, series: _Series) -> None:
        """Add the arrays of a series to ``arrays``."""
        for label, value in series.all_fields().items():
            values = np.asarray(value)
            name = _array_name(series.name, label)
            is_time = label.startswith("@") or label.split(".")[-1] == "stamp"
            shape = (series.count, *values.shape)
            self._field_of[name] = (series.name, label)
            unit = "s" if is_time else ""
            self.arrays[name] = ArrayInfo(name, shape, str(values.dtype), unit)

    def _messages(self, decoded: set[str] | None) -> Iterator[_Message]:
        """Yield all messages in the order of the file.

        Those of the series ``decoded`` are decoded; if it is None, the first that can be read of
        every series.
        """
        self._declared = _Declarations()
        self._undeclared = 0
        self._short = 0
        for kind, content in self._container.records():
            if kind != MESSAGE:
                self._declared.add(kind, content)
            elif len(content) < _MESSAGE_HEAD.size:
                self._short += 1
            else:
                yield from self._message(content, decoded)

    def _message(self, record: bytes, decoded: set[str] | None) -> Iterator[_Message]:
        """Yield a message, or each transform that it holds."""
        number, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(record)
        channel = self._channel(number)
        if channel is None:
            self._undeclared += 1
            return
        data = record[_MESSAGE_HEAD.size :]
        schema = self._declared.schemas.get(channel.schema_id)
        decoders = self._declared.decoders
        if number not in decoders:
            decoders[number] = self._decoder(channel, schema)
        decode = decoders[number]

        topic = channel.topic
        holds_transforms = schema is not None and schema.name.endswith("TFMessage")
        if holds_transforms and decode is not None:
            if decoded is None or any(name.startswith(f"{topic}/") for name in decoded):
                for name, transform in self._transforms_of(topic, decode, data):
                    yield _Message(name, transform, log_time, publish_time)
            return
        series = self._series[topic]
        is_wanted = not series.known if decoded is None else topic in decoded
        content = None
        if is_wanted and decode is not None:
            content = _decoded(lambda data: _flat(decode(data)), data, series)
        yield _Message(topic, content, log_time, publish_time)

    def _transforms_of(self, topic: str, decode: Decoder, data: bytes) -> Iterator[tuple[str, Any]]:
        """Yield series and fields of each transform of a message; a damaged one is counted."""

        def transforms_in(data: bytes) -> list[tuple[str, dict[str, Any]]]:
            found = []
            for transform in decode(data).get("transforms", ()):
                parent = str(transform["header"]["frame_id"])
                child = str(transform["child_frame_id"])
                found.append((f"{topic}/{parent}>{child}", _flat(transform)))
            return found

        carrier = self._transforms.setdefault(topic, _Series(topic, "transforms", "cdr"))
        content = _decoded(transforms_in, data, carrier)
        carrier.count += 1
        if content is _DAMAGED:
            return
        for name, fields in content:
            self._series.setdefault(name, _Series(name, "transforms", "cdr"))
            yield name, fields

    def _channel(self, number: int) -> Any:
        """Return a channel as it was declared, or None.

        The summary repeats it where the chunk that declared it is damaged.
        """
        declared = self._declared
        if number not in declared.channels and not declared.with_summary:
            repeated = _Declarations()
            for kind, content in self._container.summary():
                repeated.add(kind, content)
            declared.schemas = repeated.schemas | declared.schemas
            declared.channels = repeated.channels | declared.channels
            declared.with_summary = True
        return declared.channels.get(number)

    def _note_container(self) -> None:
        """Add notes of what of the file is damaged and left out.

        A file of which nothing is left is a ValueError.
        """
        damage = self._container.damage
        notes = []
        if damage.damaged_chunks:
            notes.append(
                f"{damage.damaged_chunks} of {damage.chunks} chunks are damaged and left out, "
                f"{self._lost_messages()} ({damage.reason})"
            )
        if damage.cut_off:
            notes.append(
                f"it is cut off before the end of its data: what came behind is lost, {_RECOVER}"
            )
        if self._declared.damaged:
            notes.append(f"{self._declared.damaged} records of schemas and channels are damaged")
        if self._short:
            notes.append(f"{self._short} messages without a whole head are left out")
        if self._undeclared:
            notes.append(
                f"{self._undeclared} messages of channels that nothing declares are left out"
            )
        if notes and not any(series.count for series in self._series.values()):
            reason = f": {damage.reason}" if damage.reason else ""
            raise ValueError(f"it holds no message that can be read{reason}; {'; '.join(notes)}")
        self.notes += notes

    def _lost_messages(self) -> str:
        """Return in words how many messages the damaged chunks held, by topic.

        Their indexes state it, as far as there are any.
        """
        damage = self._container.damage
        if damage.uncounted_chunks == damage.damaged_chunks:
            return "with messages that no index counts"
        counts = []
        for number, count in damage.messages.items():
            if not count:
                continue
            channel = self._channel(number)
            topic = channel.topic if channel else f"channel {number}"
            counts.append(f"{count} of {topic}")
        total = sum(damage.messages.values())
        summary = f"with {total} messages"
        if counts:
            summary += f": {', '.join(counts)}"
        if damage.uncounted_chunks:
            summary += f"; no index counts those of {damage.uncounted_chunks} chunks"
        return summary

    def _decoder(self, channel: Any, schema: Any) -> Decoder | None:
        """Return the decoder of a channel's messages, None where there is none.

        The channel's topic is listed either way.
        """
        topic = channel.topic
        encoding = channel.message_encoding
        kind = schema.name if schema else ""
        series = self._series.setdefault(topic, _Series(topic, kind, encoding))
        if encoding == "json":
            return _from_json
        if encoding == "cdr" and schema is not None and schema.encoding == "ros2msg":
            try:
                decoder = message_decoder(schema.name, schema.data.decode("utf-8"))
            except ValueError as error:
                series.fault = f"not read: {' '.join(str(error).split())[:160]}"
                return None
            if schema.name.endswith("TFMessage"):
                self._series.pop(topic)
            return decoder
        definition = schema.encoding if schema is not None else "no"
        series.fault = (
            f"not read: {encoding or 'unknown'} messages with {definition or 'no'} definition"
        )
        return None


def _line_of(series: _Series) -> str:
    """Return in words what a series holds."""
    span = ""
    if series.count > 1:
        span = f" over {(series.last - series.first) / 1e9:.6g} s"
    vectors = []  # fields of vectors, whose components are not listed
    for name, value in series.fields.items():
        if f"{name}.x" in series.fields and np.ndim(value):
            vectors.append(f"{name}.")
    shapes = []
    for name, value in series.fields.items():
        if not name.startswith(tuple(vectors)):
            size = "x".join(map(str, np.shape(value)))
            shapes.append(f"{name} {size}".strip())
    content = ", ".join(shapes) if series.known else series.fault
    kind = series.kind or series.encoding
    return f"{series.name}: {series.count} {kind}{span}; {content or 'no numbers'}"


def _decoded(decode: Callable[[bytes], Any], data: bytes, series: _Series) -> Any:
    """Return what a message holds; ``_DAMAGED`` for a damaged one, which its series counts."""
    try:
        return decode(data)
    except (ValueError, KeyError, IndexError, OverflowError, RecursionError) as error:
        series.damaged += 1
        series.fault = " ".join(str(error).split())[:120] or type(error).__name__
        return _DAMAGED


def _fits(value: Any, shape: tuple[int, ...]) -> bool:
    """Return whether a value of a message is there, is no text, and has a shape."""
    if value is None or isinstance(value, str):
        return False
    return np.shape(value) == shape


def _array_name(series: str, label: str) -> str:
    """Return the name of the array of a field."""
    return series + label if label.startswith("@") else f"{series}/{label}"


def _from_json(data: bytes) -> Any:
    """Return what a message in JSON holds."""
    if len(data) > _LARGEST_JSON:
        raise ValueError(f"a JSON message must have at most {_LARGEST_JSON} bytes, got {len(data)}")
    # A whole number may be larger than any type of NumPy holds.
    return parse_json(data, whole=float)


def _flat(content: Any) -> dict[str, Any]:
    """Return the numbers and texts of a message by their path.

    Lists of like messages become arrays of their fields. Paths that take more memory than a message
    may are a ValueError: each repeats all names above it.
    """
    fields: dict[str, Any] = {}
    _add_flat(fields, content, "", Budget("the fields of a message", MOST_MESSAGE))
    return fields


def _add_flat(fields: dict[str, Any], content: Any, path: str, budget: Budget) -> None:
    """Add the numbers and texts of a part of a message to those of the message."""
    if isinstance(content, dict):
        _add_table(fields, content, path, budget)
    elif isinstance(content, (list, tuple)):
        _add_list(fields, content, path, budget)
    elif isinstance(content, (np.ndarray, str)):
        fields[path] = content
    elif content is None:
        fields[path] = np.float64(np.nan)
    else:
        fields[path] = np.float64(content) if isinstance(content, (int, float)) else content


def _add_table(fields: dict[str, Any], content: dict[str, Any], path: str, budget: Budget) -> None:
    """Add the fields of a message by their path.

    A stamp is a number of seconds; fields that all are numbers are a vector besides.
    """
    is_nested = any(isinstance(value, (dict, list, str)) for value in content.values())
    if set(content) in _STAMPS and not is_nested:
        stamp = dict(content)
        seconds = float(stamp.pop("sec"))
        (nanoseconds,) = stamp.values()  # "nanosec" of ROS 2, "nsec" of ROS 1
        fields[path] = np.float64(seconds + 1e-9 * float(nanoseconds))
        return
    budget.spend(sum(VALUE + len(path) + len(name) for name in content))
    for name, value in content.items():
        _add_flat(fields, value, f"{path}.{name}" if path else str(name), budget)
    components = [fields.get(f"{path}.{name}") for name in content]
    all_numbers = all(isinstance(value, (np.number, np.bool_)) for value in components)
    if path and len(components) > 1 and all_numbers:
        fields[path] = np.array(components)


def _add_list(
    fields: dict[str, Any], content: list[Any] | tuple[Any, ...], path: str, budget: Budget
) -> None:
    """Add a list of numbers as an array, one of like messages as arrays of their fields."""
    if content and all(isinstance(item, dict) for item in content):
        rows = []
        for item in content:
            row: dict[str, Any] = {}
            _add_flat(row, item, "", budget)
            rows.append(row)
        for name, first in rows[0].items():
            values: list[Any] = [row.get(name) for row in rows]
            if all(_fits(value, np.shape(first)) for value in values):
                budget.spend(VALUE + len(path) + len(name))
                fields[f"{path}.{name}"] = np.stack(values)
        return
    with suppress(ValueError, TypeError):
        fields[path] = np.array(content, dtype=np.float64)


class McapReader(Reader):
    """Recordings in MCAP, read chunk by chunk."""

    kind = "MCAP recording"
    names = "MCAP"
    reads = frozenset({"arrays"})
    is_stream = True

    def owns(self, path: Path, head: bytes) -> bool:
        """Return whether the file begins with the signature; refuse bags that must be converted."""
        if head.startswith(b"\x89MCAP"):
            return True
        for beginning, kind in _CONVERTED.items():
            if head.startswith(beginning):
                raise ValueError(
                    f"{path}: {kind} is not read as it is: make MCAP of it, "
                    f"mcap convert {path.name} OUT.mcap"
                )
        if path.suffix.lower() == ".mcap":
            raise ValueError(
                f"{path}: an MCAP recording must begin with its signature: it is empty or damaged"
            )
        return False

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open the fields of all topics as arrays over their messages."""
        recording = Recording(path, limit)
        return ArrayFile(
            path,
            self.kind,
            recording.arrays,
            recording.read,
            limit,
            recording.lines,
            recording.notes,
        )

    def explain(self, path: Path, limit: int) -> Explanation:
        """Return the topics: the arrays are too many, and take too long, to read them all."""
        opened = open_arrays(path, limit)
        return Explanation(path, opened.kind, opened.about + opened.notes, draft_of_file(opened))


READER = McapReader()
