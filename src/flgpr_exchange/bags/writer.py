"""Writes recordings in MCAP whose messages are JSON: the same messages give the same bytes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from flgpr.door import open_own
from flgpr.json_text import compact_json
from flgpr.store.extras import optional
from flgpr_exchange.bags.foxglove import SCHEMAS, Message

_LIBRARY = "flgpr"
"""What the file says wrote it; the library's own version would change its bytes."""


class McapWriter:
    """Adds messages to an MCAP file, each with a schema of :data:`flgpr_exchange.bags.foxglove.SCHEMAS`.

    Parameters
    ----------
    file : binary file
        An empty file.
    topics : mapping of str to str
        The schema of the messages of every topic.
    """

    def __init__(self, file: BinaryIO, topics: Mapping[str, str]) -> None:
        self._topics = topics
        self._writer = optional("mcap.writer", "bags").Writer(file)
        self._writer.start(library=_LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: Counter[str] = Counter()

    def add(self, topic: str, nanoseconds: int, message: Message) -> None:
        """Add a message.

        Parameters
        ----------
        topic : str
            Its topic.
        nanoseconds : int
            Time at which it is played, ns since 1970.
        message : dict
            JSON values.

        Raises
        ------
        ValueError
            If a number is not finite.
        """
        data = compact_json(message).encode()
        if topic not in self._channels:
            name = self._topics[topic]
            if name not in self._schemas:  # declared when it is first used
                schema = compact_json(SCHEMAS[name]).encode()
                self._schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
            channel = self._writer.register_channel(topic, "json", self._schemas[name])
            self._channels[topic] = channel
        channel, count = self._channels[topic], self._counts[topic]
        self._writer.add_message(channel, nanoseconds, data, nanoseconds, count)
        self._counts[topic] += 1

    def describe(self, name: str, entries: Mapping[str, str]) -> None:
        """Add a record of texts about the recording."""
        self._writer.add_metadata(name, dict(entries))

    def finish(self) -> None:
        """Write what comes behind the messages: the file is complete then."""
        self._writer.finish()


@contextmanager
def mcap_file(path: Path, topics: Mapping[str, str]) -> Iterator[McapWriter]:
    """Open a new MCAP file to write to, and complete it where nothing fails."""
    with open(path, "xb", opener=open_own) as file:
        writer = McapWriter(file, topics)
        yield writer
        writer.finish()
