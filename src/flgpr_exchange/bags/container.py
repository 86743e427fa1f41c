"""The container of MCAP recordings: the records that can be read, in their order, and the damage.

The layout is that of https://mcap.dev/spec. A damaged chunk costs its own messages alone; the
indexes behind it state how many these are. What lies behind the point at which a file is cut off is
lost.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from flgpr.door import check_expansion, open_named
from flgpr.model.printable import in_one_line
from flgpr.store.extras import MissingExtraError, optional

SCHEMA = 3
CHANNEL = 4
MESSAGE = 5
_FOOTER = 2
_CHUNK = 6
_MESSAGE_INDEX = 7
_DATA_END = 15
_MAGIC = b"\x89MCAP0\r\n"
_RECORD_HEAD = 9  # bytes: kind and length
_FOOTER_BODY = struct.Struct("<QQI")  # where the summary and its offsets begin, and a checksum
_INDEX_HEAD = struct.Struct("<HI")  # channel, and bytes of the entries
_INDEX_ENTRY = 16  # bytes: time and offset of a message
_CHANNEL_OF_MESSAGE = struct.Struct("<H")
_WINDOW = 2**27  # largest window of zstd, bytes


class TooLargeError(ValueError):
    """A record or a chunk takes more memory than it may."""


@dataclass
class ContainerDamage:
    """What of a recording cannot be read and is left out."""

    chunks: int = 0  #: that the file holds, damaged ones included
    damaged_chunks: int = 0
    uncounted_chunks: int = 0  #: damaged ones whose messages no index counts
    messages: Counter[int] = field(default_factory=Counter)  #: of damaged chunks, by channel
    cut_off: bool = False  #: whether the file ends before the end of its data
    reason: str = ""  #: of the first damage


@dataclass
class _DamagedChunk:
    """A chunk whose indexes follow: what was read of it, and whether an index was."""

    read: Counter[int]  # messages by channel
    indexed: bool = False


class McapContainer:
    """The records of an MCAP file.

    Records and chunks of more than ``limit`` bytes are a :class:`TooLargeError`; a file that does
    not begin as MCAP is a ValueError.

    Attributes
    ----------
    damage : ContainerDamage
        What was left out when the records were last read.
    """

    def __init__(self, path: Path, limit: int) -> None:
        self.path = path
        self.limit = limit
        self.damage = ContainerDamage()

    def records(self) -> Iterator[tuple[int, bytes]]:
        """Yield kind and content of schemas, channels and messages up to the end of the data."""
        self.damage = ContainerDamage()
        with open_named(self.path) as file:
            end = file.seek(0, 2)
            file.seek(0)
            if file.read(len(_MAGIC)) != _MAGIC:
                raise ValueError("it does not begin as MCAP of version 0")
            damaged: _DamagedChunk | None = None
            for kind, size in self._heads_of_data(file, end):
                if kind == _MESSAGE_INDEX and damaged is not None and size <= self.limit:
                    self._count_lost(file.read(size), damaged)
                elif kind == _CHUNK:
                    damaged = yield from self._chunk(self._content(file, size))
                elif kind in (SCHEMA, CHANNEL, MESSAGE):
                    yield kind, self._content(file, size)
                else:
                    file.seek(size, 1)

    def summary(self) -> Iterator[tuple[int, bytes]]:
        """Yield the schemas and channels that the summary behind the data repeats, if any."""
        with open_named(self.path) as file:
            end = file.seek(0, 2)
            file.seek(_summary_start(file, end))
            for kind, size in _record_heads(file, end):
                if kind == _FOOTER:
                    return
                if kind in (SCHEMA, CHANNEL):
                    yield kind, self._content(file, size)
                else:
                    file.seek(size, 1)

    def _heads_of_data(self, file: BinaryIO, end: int) -> Iterator[tuple[int, int]]:
        """Yield the kinds and lengths of the records of the data, or to where they are cut off."""
        for kind, size in _record_heads(file, end):
            if kind == _DATA_END:
                return
            yield kind, size
        self.damage.cut_off = True
        fault = f"it is cut off after {end} bytes, before the end of its data"
        self.damage.reason = self.damage.reason or fault

    def _content(self, file: BinaryIO, size: int) -> bytes:
        """Read the content of a record of a size that is checked first."""
        if size > self.limit:
            raise TooLargeError(
                f"a record must have at most {self.limit / 1e9:g} GB, got {size / 1e9:.3g} GB"
            )
        return file.read(size)

    def _chunk(self, content: bytes) -> Generator[tuple[int, bytes], None, _DamagedChunk | None]:
        """Yield the records of a chunk, and return what is to be counted if it is damaged.

        Records behind one that goes beyond the end of the chunk are not looked for.
        """
        self.damage.chunks += 1
        fault, data = "", b""
        try:
            data = self._unpacked(content)
        except (MissingExtraError, TooLargeError):
            raise
        except Exception as error:  # whatever a library raises on what is damaged
            fault = in_one_line(error, 160)
        read: Counter[int] = Counter()
        stop = 0
        while stop < len(data):
            kind, begin = data[stop], stop + _RECORD_HEAD
            stop = begin + int.from_bytes(data[stop + 1 : begin], "little")
            if stop > len(data):
                fault = "a record goes beyond the end of its chunk"
            elif kind in (SCHEMA, CHANNEL, MESSAGE):
                if kind == MESSAGE and stop - begin >= _CHANNEL_OF_MESSAGE.size:
                    read[_CHANNEL_OF_MESSAGE.unpack_from(data, begin)[0]] += 1
                yield kind, data[begin:stop]
        if not fault:
            return None
        self.damage.reason = self.damage.reason or fault
        self.damage.damaged_chunks += 1
        self.damage.uncounted_chunks += 1  # until an index states them
        return _DamagedChunk(read)

    def _count_lost(self, index: bytes, chunk: _DamagedChunk) -> None:
        """Count the messages of a damaged chunk that an index states, less those that were read."""
        if len(index) < _INDEX_HEAD.size:
            return
        channel, size = _INDEX_HEAD.unpack_from(index)
        if size != len(index) - _INDEX_HEAD.size or size % _INDEX_ENTRY:
            return
        self.damage.uncounted_chunks -= not chunk.indexed
        chunk.indexed = True
        self.damage.messages[channel] += max(size // _INDEX_ENTRY - chunk.read[channel], 0)

    def _unpacked(self, content: bytes) -> bytes:
        """Return the records of a chunk, unpacked; damage is an error of any kind."""
        stream = optional("mcap.data_stream", "bags").ReadDataStream(BytesIO(content))
        chunk = optional("mcap.records", "bags").Chunk.read(stream)
        size = chunk.uncompressed_size
        if size > self.limit:
            raise TooLargeError(
                f"a chunk must unpack to at most {self.limit / 1e9:g} GB, got {size / 1e9:.3g} GB"
            )
        # What a chunk declares is checked before memory is taken for it.
        check_expansion("a chunk", size, len(chunk.data))
        data = _decompressed(chunk, size)
        if len(data) != size:
            raise ValueError(
                f"a chunk must unpack to the {size} bytes that it declares, got {len(data)} or more"
            )
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError("a chunk does not agree with its checksum")
        return data


def _decompressed(chunk: Any, size: int) -> bytes:
    """Unpack a chunk; at most one byte more than ``size`` is taken."""
    stream = BytesIO(chunk.data)
    if chunk.compression == "zstd":
        packer = optional("zstandard", "bags").ZstdDecompressor(max_window_size=_WINDOW)
        stream = packer.stream_reader(stream)
    elif chunk.compression == "lz4":
        packer = optional("lz4.frame", "bags").LZ4FrameDecompressor()
        return bytes(packer.decompress(chunk.data, max_length=size + 1))
    elif chunk.compression:
        raise ValueError(
            f"chunks must be packed by zstd, lz4 or not at all, got {chunk.compression[:20]!r}"
        )
    return bytes(stream.read(size + 1))


def _record_heads(file: BinaryIO, end: int) -> Iterator[tuple[int, int]]:
    """Yield the kinds and lengths of records up to one that is cut off.

    The caller moves the file past the content of each.
    """
    while True:
        head = file.read(_RECORD_HEAD)
        size = int.from_bytes(head[1:], "little")
        if len(head) < _RECORD_HEAD or size > end - file.tell():
            return
        yield head[0], size


def _summary_start(file: BinaryIO, end: int) -> int:
    """Return where the summary begins by the footer; the file's end if there is none."""
    length = _RECORD_HEAD + _FOOTER_BODY.size
    begin = end - len(_MAGIC) - length
    if begin < len(_MAGIC):
        return end
    file.seek(begin)
    footer = file.read(length)
    if footer[:_RECORD_HEAD] != struct.pack("<BQ", _FOOTER, _FOOTER_BODY.size):
        return end
    start: int = _FOOTER_BODY.unpack_from(footer, _RECORD_HEAD)[0]
    return start if len(_MAGIC) <= start < begin else end
