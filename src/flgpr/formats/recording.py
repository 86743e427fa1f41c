"""Recordings of vehicles: MCAP files, with messages of ROS 2 (CDR) or JSON, as arrays stacked over the messages.

Whatever a file declares is checked against what it holds before memory is taken for it. What is damaged is left out and
counted: a message, or a chunk with the messages in it (:mod:`flgpr.formats.mcap_container`).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.cdr import Decoder, message_decoder
from flgpr.formats.mcap_container import MESSAGE, SCHEMA, McapContainer
from flgpr.store.extras import optional

_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log and publish time in ns
_LARGEST_JSON = 64 * 2**20  # bytes of a message; it takes many times that when it is read
_DAMAGED = object()
"""What stands for a message that cannot be read."""
_STAMPS = ({"sec", "nanosec"}, {"sec", "nsec"})
_RECOVER = "mcap recover makes a file of what is there"


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
        """Take a record of a schema or a channel; one that is damaged is counted."""
        reader = self._records.Schema if kind == SCHEMA else self._records.Channel
        try:
            declared = reader.read(self._stream(BytesIO(content)))
        except Exception:  # whatever the library raises on what is damaged
            self.damaged += 1
            return
        known = self.schemas if kind == SCHEMA else self.channels
        known[declared.id] = declared


class Recording:
    """An MCAP file: ``arrays`` are (name, shape, type, unit) of all it holds, ``lines`` tell its topics.

    What is damaged is left out: a message, or a chunk and all in it. ``notes`` count them, messages
    among those read so far. A file of which nothing can be read is a ValueError.

    Every numeric field of a topic is an array over its messages, ``TOPIC/field.of.field``; a field of numbers alone,
    such as a position or a quaternion, is one (message, n) besides. Stamps are seconds; ``TOPIC@log_time`` and
    ``TOPIC@publish_time`` are the recorder's. Transforms are ``TOPIC/FRAME>CHILD/...``.
    """

    def __init__(self, path: Path, limit: int, notes: list[str] | None = None) -> None:
        self.path = path
        self.limit = limit
        self._container = McapContainer(path, limit)
        self._series: dict[str, _Series] = {}
        self._lost: dict[str, _Series] = {}  # topics of transforms, whose messages may be damaged
        self._columns: dict[str, NDArray[Any]] = {}
        self._places: dict[str, tuple[str, str]] = {}
        self._declared = _Declarations()
        self._undeclared = 0  # messages of channels that nothing declares
        self._short = 0  # messages without a whole head
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
        self._note_container()
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
        self._declared = _Declarations()
        self._undeclared = 0
        self._short = 0
        for kind, content in self._container.records():
            if kind != MESSAGE:
                self._declared.add(kind, content)
            elif len(content) < _MESSAGE_HEAD.size:
                self._short += 1
            else:
                yield from self._message(content, wanted)

    def _message(
        self, record: bytes, wanted: set[str] | None
    ) -> Iterator[tuple[str, Any, int, int]]:
        """Give a message, or each transform that it holds."""
        number, _, log, publish = _MESSAGE_HEAD.unpack_from(record)
        channel = self._channel(number)
        if channel is None:
            self._undeclared += 1
            return
        content = record[_MESSAGE_HEAD.size :]
        schema = self._declared.schemas.get(channel.schema_id)
        decoders = self._declared.decoders
        if number not in decoders:
            decoders[number] = self._decoder(channel, schema)
        decode = decoders[number]
        topic = channel.topic
        if schema is None or decode is None or not schema.name.endswith("TFMessage"):
            series = self._series[topic]
            asked = topic in wanted if wanted is not None else not series.known
            said = _decoded(decode, content, series) if asked and decode is not None else None
            yield topic, said, log, publish
            return
        if wanted is not None and not any(name.startswith(f"{topic}/") for name in wanted):
            return
        lost = self._lost.setdefault(topic, _Series(topic, "transforms", "cdr"))
        said = _decoded(decode, content, lost)
        lost.count += 1
        for transform in () if said is _DAMAGED else said.get("transforms", ()):
            parent = str(transform["header"]["frame_id"])
            child = str(transform["child_frame_id"])
            name = f"{topic}/{parent}>{child}"
            self._series.setdefault(name, _Series(name, "transforms", "cdr"))
            yield name, transform, log, publish

    def _channel(self, number: int) -> Any:
        """Return a channel as it was declared; by the summary where the chunk that declared it is damaged."""
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
        """Tell what of the file is damaged and left out; a file of which nothing is left is a ValueError."""
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
        """Say how many messages the damaged chunks held, by topic, as far as their indexes tell."""
        damage = self._container.damage
        topics = []
        for number, count in damage.messages.items():
            channel = self._channel(number) if count else None
            if count:
                topics.append(f"{count} of {channel.topic if channel else f'channel {number}'}")
        words = f"with {sum(damage.messages.values())} messages"
        if topics:
            words += f": {', '.join(topics)}"
        if damage.uncounted_chunks == damage.damaged_chunks:
            return "with messages that no index counts"
        if damage.uncounted_chunks:
            words += f"; no index counts those of {damage.uncounted_chunks} chunks"
        return words

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
