"""Recordings of vehicles: MCAP files, with messages of ROS 2 (CDR) or JSON, as arrays.

Arrays are stacked over the messages. Whatever a file declares is checked against what it holds
before memory is taken for it. What is damaged is left out and counted: a message, or a chunk with
the messages in it (:mod:`flgpr_exchange.bags.container`).
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
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
from flgpr.model.printable import in_one_line
from flgpr.store.extras import optional
from flgpr.types import AnyArray, Entries, Notes
from flgpr_exchange.bags.cdr import MOST_MESSAGE, Decoder, message_decoder
from flgpr_exchange.bags.container import CHANNEL, MESSAGE, SCHEMA, McapContainer

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
_BAD_RECORDS = "records of schemas and channels are damaged"
_HEADLESS = "messages without a whole head are left out"
_UNDECLARED = "messages of channels that nothing declares are left out"
_Known = dict[int, dict[int, Any]]
"""Schemas and channels by their numbers, by the kinds of their records."""


@dataclass
class _Series:
    """Messages that are stacked: of a topic, or a topic's transforms of one frame to another."""

    name: str
    kind: str
    encoding: str
    count: int = 0
    first: int = 0  # log times, ns
    last: int = 0
    fields: Entries = field(default_factory=dict)  # of the first message that can be read
    known: bool = False  # whether one was read
    damaged: int = 0  # messages that cannot be read, of those decoded
    fault: str = ""

    def all_fields(self) -> Entries:
        """Return the fields of a message, the recorder's two times before them."""
        return {_LOG_TIME: np.float64(), _PUBLISH_TIME: np.float64(), **self.fields}

    def damage(self) -> list[str]:
        """Return the note of messages that are damaged, if there are any."""
        if not self.damaged:
            return []
        return [
            f"{self.name}: {self.damaged} of {self.count} messages are damaged "
            f"and left out ({self.fault})"
        ]


class _Message(NamedTuple):
    """A message, or one transform of it."""

    series: str
    content: Any  # its fields by path; _DAMAGED, or None where it is not needed
    log_time: int  # ns
    publish_time: int  # ns


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
        self._known: _Known = {SCHEMA: {}, CHANNEL: {}}
        self._decoders: dict[int, Decoder | None] = {}  # by the number of the channel
        self._has_summary = False  # whether what the summary repeats is known
        self._left_out: Counter[str] = Counter()
        self.arrays: dict[str, ArrayInfo] = {}
        self.notes: Notes = []
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
        fields = series.all_fields()
        bytes_of_message = sum(np.asarray(value).nbytes for value in fields.values())
        if series.count * bytes_of_message > self.limit:
            fields = {label: fields[label] for label in fields if label in needed}
        columns = {}
        for label, value in fields.items():
            columns[label] = np.empty((series.count, *np.shape(value)), np.asarray(value).dtype)
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
        if series.damaged != damaged_before:
            self.notes += series.damage()
        series.damaged = max(series.damaged, damaged_before)

        # Messages are mostly in order, but several writers may share a file.
        order = np.argsort(columns[_LOG_TIME][:row], kind="stable")
        self._columns = {
            _array_name(name, label): column[:row][order] for label, column in columns.items()
        }

    def _count(self) -> None:
        """Go through the file once: count messages, and find the fields of every series."""
        for message in self._messages(None):
            series = self._series[message.series]
            if not series.count:
                series.first = series.last = message.log_time
            series.first = min(series.first, message.log_time)
            series.last = max(series.last, message.log_time)
            can_be_read = message.content is not None and message.content is not _DAMAGED
            if can_be_read and not series.known:
                for label, value in message.content.items():
                    if not isinstance(value, str):
                        series.fields[label] = value
                series.known = True
            series.count += 1
        self._note_container()
        for series in (*self._series.values(), *self._transforms.values()):
            self.notes += series.damage()
        for series in self._series.values():
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
        self._known = {SCHEMA: {}, CHANNEL: {}}
        self._decoders = {}
        self._has_summary = False
        self._left_out.clear()
        for kind, record in self._container.records():
            if kind != MESSAGE:
                self._left_out[_BAD_RECORDS] += not _declare(kind, record, self._known)
                continue
            if len(record) < _MESSAGE_HEAD.size:
                self._left_out[_HEADLESS] += 1
                continue
            number, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(record)
            channel = self._channel(number)
            if channel is None:
                self._left_out[_UNDECLARED] += 1
                continue
            data = record[_MESSAGE_HEAD.size :]
            schema = self._known[SCHEMA].get(channel.schema_id)
            if number not in self._decoders:
                self._decoders[number] = self._decoder(channel, schema)
            decode = self._decoders[number]

            topic = channel.topic
            if decode is not None and schema is not None and schema.name.endswith("TFMessage"):
                if decoded is None or any(name.startswith(f"{topic}/") for name in decoded):
                    for name, fields in self._transforms_of(topic, decode, data):
                        yield _Message(name, fields, log_time, publish_time)
                continue
            series = self._series[topic]
            is_wanted = not series.known if decoded is None else topic in decoded
            content = None
            if is_wanted and decode is not None:
                content = _decoded(decode, data, series, _flat)
            yield _Message(topic, content, log_time, publish_time)

    def _transforms_of(self, topic: str, decode: Decoder, data: bytes) -> Iterator[tuple[str, Any]]:
        """Yield series and fields of each transform of a message; a damaged one is counted."""
        carrier = self._transforms.setdefault(topic, _Series(topic, "transforms", "cdr"))
        carrier.count += 1
        content = _decoded(decode, data, carrier, _transforms_in)
        for frames, fields in () if content is _DAMAGED else content:
            name = f"{topic}/{frames}"
            self._series.setdefault(name, _Series(name, "transforms", "cdr"))
            yield name, fields

    def _channel(self, number: int) -> Any:
        """Return a channel as it was declared, or None.

        The summary repeats it where the chunk that declared it is damaged.
        """
        channels = self._known[CHANNEL]
        if number not in channels and not self._has_summary:
            repeated: _Known = {SCHEMA: {}, CHANNEL: {}}
            for kind, content in self._container.summary():
                _declare(kind, content, repeated)
            for kind, known in self._known.items():
                known |= repeated[kind] | known
            self._has_summary = True
        return channels.get(number)

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
        for what in (_BAD_RECORDS, _HEADLESS, _UNDECLARED):
            if self._left_out[what]:
                notes.append(f"{self._left_out[what]} {what}")
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
            if count:
                channel = self._channel(number)
                counts.append(f"{count} of {channel.topic if channel else f'channel {number}'}")
        summary = f"with {sum(damage.messages.values())} messages"
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
                series.fault = f"not read: {in_one_line(error, 160)}"
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
    span = f" over {(series.last - series.first) / 1e9:.6g} s" if series.count > 1 else ""
    fields = series.fields
    # Components of vectors are not listed.
    vectors = tuple(
        f"{name}." for name in fields if f"{name}.x" in fields and np.ndim(fields[name])
    )
    shapes = [
        f"{name} {'x'.join(map(str, np.shape(value)))}".strip()
        for name, value in fields.items()
        if not name.startswith(vectors)
    ]
    content = ", ".join(shapes) if series.known else series.fault
    kind = series.kind or series.encoding
    return f"{series.name}: {series.count} {kind}{span}; {content or 'no numbers'}"


def _declare(kind: int, content: bytes, known: _Known) -> bool:
    """Add a schema or a channel to those that are known, unless its record is damaged."""
    records = optional("mcap.records", "bags")
    stream = optional("mcap.data_stream", "bags").ReadDataStream(BytesIO(content))
    try:
        declared = (records.Schema if kind == SCHEMA else records.Channel).read(stream)
    except Exception:  # whatever the library raises on what is damaged
        return False
    known[kind][declared.id] = declared
    return True


def _decoded(decode: Decoder, data: bytes, series: _Series, take: Callable[[Entries], Any]) -> Any:
    """Return what is taken of a message; ``_DAMAGED`` for a damaged one, which its series counts."""
    try:
        return take(decode(data))
    except (ValueError, KeyError, IndexError, OverflowError, RecursionError) as error:
        series.damaged += 1
        series.fault = in_one_line(error, 120)
        return _DAMAGED


def _transforms_in(content: Entries) -> list[tuple[str, Entries]]:
    """Return frames and fields of each transform of a message."""
    found = []
    for transform in content.get("transforms", ()):
        frames = f"{transform['header']['frame_id']}>{transform['child_frame_id']}"
        found.append((frames, _flat(transform)))
    return found


def _fits(value: Any, shape: tuple[int, ...]) -> bool:
    """Return whether a value of a message is there, is no text, and has a shape."""
    return value is not None and not isinstance(value, str) and np.shape(value) == shape


def _array_name(series: str, label: str) -> str:
    """Return the name of the array of a field."""
    return series + label if label.startswith("@") else f"{series}/{label}"


def _from_json(data: bytes) -> Any:
    """Return what a message in JSON holds."""
    if len(data) > _LARGEST_JSON:
        raise ValueError(f"a JSON message must have at most {_LARGEST_JSON} bytes, got {len(data)}")
    # A whole number may be larger than any type of NumPy holds.
    return parse_json(data, whole=float)


def _flat(content: Any, path: str = "", budget: Budget | None = None) -> Entries:
    """Return the numbers and texts of a message, or of a part at a path, by their path.

    A stamp is a number of seconds; fields that all are numbers are a vector besides. Lists of like
    messages become arrays of their fields. Paths that take more memory than a message may are a
    ValueError: each repeats all names above it.
    """
    budget = budget or Budget("the fields of a message", MOST_MESSAGE)
    if isinstance(content, dict):
        return _flat_table(content, path, budget)
    if isinstance(content, (list, tuple)):
        if content and all(isinstance(item, dict) for item in content):
            return _flat_tables(content, path, budget)
        with suppress(ValueError, TypeError):
            return {path: np.array(content, dtype=np.float64)}
        return {}
    if isinstance(content, (int, float)) or content is None:
        return {path: np.float64(np.nan if content is None else content)}
    return {path: content}


def _flat_table(content: Entries, path: str, budget: Budget) -> Entries:
    """Return the fields of a part of a message by their path."""
    is_nested = any(isinstance(value, (dict, list, str)) for value in content.values())
    if set(content) in _STAMPS and not is_nested:
        stamp = dict(content)
        seconds = float(stamp.pop("sec"))
        (nanoseconds,) = stamp.values()  # "nanosec" of ROS 2, "nsec" of ROS 1
        return {path: np.float64(seconds + 1e-9 * float(nanoseconds))}
    budget.spend(sum(VALUE + len(path) + len(name) for name in content))
    fields: Entries = {}
    for name, value in content.items():
        fields |= _flat(value, f"{path}.{name}" if path else str(name), budget)
    components = [fields.get(f"{path}.{name}") for name in content]
    all_numbers = all(isinstance(value, (np.number, np.bool_)) for value in components)
    if path and len(components) > 1 and all_numbers:
        fields[path] = np.array(components)
    return fields


def _flat_tables(content: Sequence[Entries], path: str, budget: Budget) -> Entries:
    """Return like parts of a message as arrays of their fields."""
    rows = [_flat_table(item, "", budget) for item in content]
    fields: Entries = {}
    for name, first in rows[0].items():
        values: list[Any] = [row.get(name) for row in rows]
        if all(_fits(value, np.shape(first)) for value in values):
            budget.spend(VALUE + len(path) + len(name))
            fields[f"{path}.{name}"] = np.stack(values)
    return fields


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
        lines, notes = recording.lines, recording.notes
        return ArrayFile(path, self.kind, recording.arrays, recording.read, limit, lines, notes)

    def explain(self, path: Path, limit: int) -> Explanation:
        """Return the topics: the arrays are too many, and take too long, to read them all."""
        opened = open_arrays(path, limit)
        return Explanation(path, opened.kind, opened.about + opened.notes, draft_of_file(opened))


READER = McapReader()
