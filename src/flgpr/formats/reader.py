"""Readers of formats, those of other packages among them: one table that everybody asks.

``flgpr info``, ``flgpr import mapped``, ``flgpr image`` and the viewer know no maker's format by its
name. A package offers one by an entry point of the group "flgpr.formats", whose object is a
:class:`Reader`; :class:`NmeaLog` is one.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

import xarray as xr

from flgpr.door import open_named, read_named
from flgpr.formats.array_file import ArrayFile
from flgpr.formats.section import GprSection
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.types import FloatArray

GROUP = "flgpr.formats"
_HEAD = 64  # bytes by which a file is known


@dataclass(frozen=True)
class Explanation:
    """What a file holds."""

    path: Path
    kind: str
    lines: list[str] = field(default_factory=list)  #: what it holds, a line per array or fact
    mapping: str = ""  #: draft of a mapping; empty where none is needed or possible
    needs_mapping: bool = True  #: whether it is imported by a mapping alone


class Reader:
    """Reader of a format.

    A file may be anybody's: a reader checks sizes before it reads, runs nothing of what it finds,
    and refuses what is damaged by a ValueError. A library that damage can crash or keep busy reads
    in a process of its own.
    """

    kind: str  #: the format in words
    names: str = ""  #: how an error lists what can be read, such as "SigMF (.sigmf-meta)"
    endings: Sequence[str] = ()  #: of files of traces
    #: what it reads besides explaining a file: "arrays" (:meth:`open_arrays`), "traces"
    #: (:meth:`read_section` and :meth:`preview`), "poses" (:meth:`read_poses`)
    reads: frozenset[str] = frozenset()
    #: kind of file of arrays of which the format is a layout, such as "HDF5 file": the reader is
    #: asked only where such a file was opened and found sound
    within: str = ""
    is_stream: bool = False  #: whether files may be larger than the memory

    def owns(self, path: Path, head: bytes) -> bool:
        """Return whether a file is of this format, by its name and its first bytes.

        Raises
        ------
        ValueError
            If it is of a kind that must be made another first; the message says how.
        """
        raise NotImplementedError

    def explain(self, path: Path, limit: int) -> Explanation | None:  # noqa: ARG002
        """Return what a file holds; None where its arrays are what can be said of it."""
        return None

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open a file as named arrays, each of so many bytes at most."""
        raise NotImplementedError

    def read_section(self, path: Path, max_memory: int = MAX_MEMORY) -> GprSection:
        """Read a line of traces with so many bytes of memory."""
        raise NotImplementedError

    def preview(self, path: Path, max_memory: int = MAX_MEMORY) -> xr.Dataset:
        """Return a line of traces as a run to be viewed."""
        raise NotImplementedError

    def read_poses(
        self, path: Path, body: str | None, axes: Sequence[str] | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return times, s, and poses (time, 6) of a body; ``axes`` are the lane's in the file's."""
        raise NotImplementedError


class NmeaLog(Reader):
    """Log of a satellite receiver: counted here, read as a track (``formats/tracks.py``)."""

    kind = "NMEA 0183 log"

    def owns(self, path: Path, head: bytes) -> bool:
        """Return whether the file begins with a sentence, or holds one and calls itself a log."""
        sentence = rb"\$[A-Z]{2}[A-Z]{3},"
        is_log = path.suffix.lower() in (".nmea", ".nma") and re.search(sentence, head)
        return bool(is_log or re.match(rb"\s*" + sentence, head))

    def explain(self, path: Path, limit: int) -> Explanation:  # noqa: ARG002
        """Return how many sentences of each kind the log holds."""
        kinds: Counter[str] = Counter()
        for line in read_named(path, MAX_MEMORY).splitlines():
            sentence = re.search(rb"\$[A-Z]{2}([A-Z]{3}),", line)
            if sentence is not None:
                kinds[sentence[1].decode()] += 1
        counts = ", ".join(f"{count} {name}" for name, count in sorted(kinds.items()))
        needs = "GGA gives positions, HDT or THS headings; read as a track with an anchor"
        return Explanation(path, self.kind, [counts, needs], needs_mapping=False)


@cache
def readers() -> tuple[Reader, ...]:
    """Return the readers of this package, and those of others by the names of their offers."""
    offered = sorted(entry_points(group=GROUP), key=lambda one: one.name)
    return (NmeaLog(), *(one.load() for one in offered))


def reader_of(path: Path, what: str = "") -> Reader | None:
    """Return the reader to which a file belongs, by its name and its first bytes.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What the reader must be able to read: "arrays", "traces", "poses"; by default anything.

    Returns
    -------
    Reader or None
        The reader; None where the file is none of theirs, or a layout of arrays
        (:attr:`Reader.within`).

    Raises
    ------
    ValueError
        If the file must be made another first.
    """
    with open_named(path) as file:
        head = file.read(_HEAD)
    for reader in readers():
        is_asked = not reader.within and (not what or what in reader.reads)
        if is_asked and reader.owns(path, head):
            return reader
    return None


def is_recording(path: str | Path) -> bool:
    """Return whether a path is a file of traces that a radar recorded."""
    return Path(path).is_file() and reader_of(Path(path), "traces") is not None


def recording_reader(path: str | Path) -> Reader:
    """Return the reader of a file of traces; a ValueError where it is none."""
    reader = reader_of(Path(path), "traces")
    if reader is None:
        raise ValueError(f"{path}: this is no recording of a radar")
    return reader
