"""SigMF recordings as named arrays: a metadata file in JSON and a file of samples beside it.

The format is that of the Signal Metadata Format Specification 1.2.5. A recording is read as it is
stored; nothing is scaled.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.door import MOST_JSON, Folder, read_named
from flgpr.formats.array_file import ArrayFile, ArrayInfo, from_memory
from flgpr.formats.reader import Reader
from flgpr.json_text import MOST_VALUES, parse_json
from flgpr.store.text import zoned_time
from flgpr.types import AnyArray, Arrays, Entries, FloatArray, Notes

VERSION = "1.2.5"
"""Version of the specification that is written."""
META = ".sigmf-meta"
"""Ending of a file of metadata."""
DATA = ".sigmf-data"
"""Ending of a file of samples."""
NAMESPACE = "flgpr"
"""Extension whose entries hold what a run has besides samples, see ``flgpr.sigmf-ext.md``."""
_DATATYPE = r"([cr])(?:(i8|u8)|(f32|f64|i32|i16|u32|u16)_(le|be))"
_LARGEST = 2**63 - 1
_MOST_NAMES = 1000  # of entries in one part of the metadata
_MOST_TEXT = 2**22  # characters of an array of text
_LONGEST_LINE = 200  # characters
_UNITS = {
    "core:frequency": "Hz",
    "core:sample_rate": "Hz",
    "core:freq_lower_edge": "Hz",
    "core:freq_upper_edge": "Hz",
    f"{NAMESPACE}:frequency": "Hz",
    f"{NAMESPACE}:tx_position": "m",
    f"{NAMESPACE}:rx_position": "m",
    f"{NAMESPACE}:pose": "m",
    f"{NAMESPACE}:time": "s",
}
_OF_THE_FILE = (
    "core:datatype",
    "core:version",
    "core:dataset",
    "core:sha512",
    "core:description",
    "core:author",
    "core:hw",
    "core:recorder",
    "core:license",
)
"""Texts of the metadata that are no arrays."""
_ELSEWHERE = ("core:geolocation", "core:extensions")
"""Objects of the metadata that are read otherwise."""
_DESCRIPTIONS = ("description", "author", "hw", "recorder", "license")
_PLACE = ("longitude", "latitude", "height")


@dataclass(frozen=True)
class _Samples:
    """How the samples lie in their file."""

    name: str  #: of the file
    size: int  #: bytes of the file
    is_complex: bool
    number: np.dtype[Any]  #: type of a real number in the file
    channels: int
    #: sample at which a header begins, and its bytes, in rising order
    headers: list[tuple[int, int]]
    length: int  #: bytes of all samples
    sha512: str  #: digest that the metadata state, empty if none

    @property
    def width(self) -> int:
        """The bytes that a sample of all channels takes in the file."""
        return self.number.itemsize * (1 + self.is_complex) * self.channels

    @property
    def count(self) -> int:
        """Samples of each channel."""
        return self.length // self.width

    @property
    def value(self) -> np.dtype[Any]:
        """The type of a sample in memory, of which every number of the file is exact."""
        if not self.is_complex:
            return self.number.newbyteorder("=")
        fits_single = self.number.itemsize <= 2 or self.number.str.endswith("f4")
        return np.dtype(np.complex64 if fits_single else np.complex128)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of all samples."""
        return (self.count,) if self.channels == 1 else (self.count, self.channels)


class SigmfRecording:
    """A recording whose metadata were read; samples are read when an array of them is.

    Its arrays are

    - ``samples`` (sample,) or (sample, channel);
    - ``segments`` (capture, sample) or (capture, sample, channel), where there are several captures
      and all are equally long;
    - ``sweeps`` (sweep, tone) or (sweep, tone, channel), where such captures differ in their
      frequencies: the mean of the samples of each capture. ``tones`` (tone,), Hz, and
      ``sweeps/NAME``, what the first capture of each sweep states, belong to it;
    - every number, text and list of them in the metadata as ``global/NAME``, ``captures/NAME`` and
      ``annotations/NAME``, the latter two with a row for each. Names of the core are written
      without ``core:``. Numbers that a capture does not have are NaN. Times of captures also are
      ``captures/time``, s since 1970, and their places ``captures/longitude`` and ``latitude``,
      degrees, and ``height``, m.

    Parameters
    ----------
    path : Path
        One of the two files.
    limit : int
        Bytes that the file of samples may hold.
    notes : list of str
        Gets what was left out or assumed.

    Raises
    ------
    ValueError
        If the metadata break a rule of the specification, or do not fit the file of samples.
    FileNotFoundError
        If one of the files is missing.
    """

    def __init__(self, path: Path, limit: int, notes: Notes) -> None:
        self._limit = limit
        self._notes = notes
        self._folder = Folder(path.parent)
        meta = path if path.suffix == META else path.with_suffix(META)
        content = _object(
            parse_json(read_named(meta, MOST_JSON), constant=_refuse_constant), "the metadata"
        )
        self._global = _object(content.get("global"), "global")
        self._captures = _objects(content.get("captures"), "captures")
        rule = f"such as {VERSION}"
        version = _matched(self._global, "core:version", r"(?s)(\d{1,3})\.\d.*", rule)
        if int(version[1]) > 1:
            raise ValueError(f"core:version must be at most 1.x, got {version[0]:.100}")
        names = []
        for extension in _objects(self._global.get("core:extensions", []), "core:extensions"):
            name = str(extension.get("name"))
            if extension.get("optional") is False and name != NAMESPACE:
                names.append(f"{name!r:.50}")
        if names:
            notes.append(
                f"the metadata ask for extensions that are not known: {', '.join(names[:9])}; "
                "samples are read by the core alone"
            )
        starts = self._starts_of_captures()
        self._samples = self._find_samples(meta, path, starts)
        if starts != sorted(starts):
            raise ValueError("captures must be sorted by core:sample_start, they are not")
        used = [start for start in starts if start < self._samples.count]
        ignored = len(starts) - len(used)
        if ignored:
            notes.append(f"{ignored} captures begin after the last sample and are ignored")
            self._captures = self._captures[: len(used)]
        self._starts = used or [0]
        self._arrays: Arrays = {}
        self._of_sweeps: Arrays = {}
        self._units: dict[str, str] = {}
        self._unread: list[str] = []
        self._take_entries("global", [self._global])
        self._take_entries("captures", self._captures)
        annotations = _objects(content.get("annotations", []), "annotations")
        self._take_entries("annotations", annotations)
        self._take_times_and_places()
        lengths = np.diff([*self._starts, self._samples.count])
        is_even = len(lengths) > 1 and self._starts[0] == 0 and len(set(lengths)) == 1
        self._segment = int(lengths[0]) if is_even else 0  # samples of each capture; 0 if uneven
        self._sweep = self._sweep_length() if is_even else 0

    @property
    def lines(self) -> list[str]:
        """What the recording states, a line each."""
        samples = self._samples
        of_channels = "1 channel" if samples.channels == 1 else f"{samples.channels} channels"
        lines = [
            f"{samples.count} samples of {of_channels}, {self._global['core:datatype']}, "
            f"in {_printable(samples.name)}",
            f"captures: {len(self._starts)}",
        ]
        for name in _DESCRIPTIONS:
            text = self._global.get(f"core:{name}")
            if isinstance(text, str) and text:
                lines.append(f"{name}: {_printable(text[:_LONGEST_LINE])}")
        digest = "is checked when they are read" if samples.sha512 else "is not stated"
        lines.append(f"the SHA-512 of the samples {digest}")
        return lines + self._unread

    @property
    def arrays(self) -> dict[str, ArrayInfo]:
        """The arrays by their names, those of samples first."""
        samples = self._samples
        kind = str(samples.value)
        infos = {}
        if self._segment:
            infos["segments"] = ArrayInfo("segments", self._shape_of_segments(), kind)
        if self._sweep:
            shape = (len(self._starts) // self._sweep, self._sweep, *samples.shape[1:])
            mean_kind = kind if samples.is_complex else "float64"
            infos["sweeps"] = ArrayInfo("sweeps", shape, mean_kind)
        infos["samples"] = ArrayInfo("samples", samples.shape, kind)
        # Those of sweeps before those of captures, so that a draft tries them first.
        return infos | from_memory(self._of_sweeps | self._arrays, self._units)[0]

    def _shape_of_segments(self) -> tuple[int, ...]:
        """Return the shape of the samples by captures of equal length."""
        return (len(self._starts), self._segment, *self._samples.shape[1:])

    def read(self, name: str) -> AnyArray:
        """Read one of ``arrays``; samples whose digest is another than stated are a ValueError."""
        in_memory = self._of_sweeps | self._arrays
        if name in in_memory:
            return in_memory[name]
        samples = self._read_samples()
        if name == "samples":
            return samples
        segments = samples.reshape(self._shape_of_segments())
        if name == "segments":
            return segments
        segments = segments[: len(segments) // self._sweep * self._sweep]
        # Sums over a segment lose digits in single precision.
        if self._samples.is_complex:
            means = segments.mean(axis=1, dtype=np.complex128).astype(segments.dtype)
        else:
            means = segments.mean(axis=1, dtype=np.float64)
        return means.reshape(-1, self._sweep, *samples.shape[1:])

    def _find_samples(self, meta: Path, path: Path, starts: list[int]) -> _Samples:
        """Return how the samples lie, by the metadata and the size of their file."""
        entries = self._global
        if entries.get("core:metadata_only") is True:
            raise ValueError("core:metadata_only: it is metadata alone, without samples")
        name = entries.get("core:dataset", f"{meta.stem}{DATA}")
        if not isinstance(name, str) or "/" in name:
            raise ValueError(
                f"core:dataset must be the name of a file beside the metadata, got {name!r:.200}"
            )
        if path != meta and name != path.name:
            raise ValueError(f"its metadata {meta.name} are of another file, {name!r:.200}")
        letter, byte, word, order = _matched(
            entries,
            "core:datatype",
            _DATATYPE,
            "such as cf32_le, ci16_be, ri16_le or cu8, with the byte order of numbers of more "
            "than one byte",
        ).groups()
        kind = byte or word
        number = np.dtype(f"{'>' if order == 'be' else '<'}{kind[0]}{int(kind[1:]) // 8}")
        channels = _count(entries, "core:num_channels", 1, least=1)
        trailing = _count(entries, "core:trailing_bytes", 0)
        sizes = [_count(capture, "core:header_bytes", 0) for capture in self._captures]
        digits = "128 hexadecimal digits"
        digest = _matched(entries, "core:sha512", r"([0-9a-fA-F]{128})?", digits, "")[0].lower()
        with self._folder.open(name, self._limit) as file:
            size = file.seek(0, os.SEEK_END)

        headers = [(start, bytes_) for start, bytes_ in zip(starts, sizes, strict=True) if bytes_]
        length = size - trailing - sum(sizes)
        samples = _Samples(name, size, letter == "c", number, channels, headers, length, digest)
        if length <= 0 or length % samples.width:
            raise ValueError(
                f"{name} must hold samples of {samples.width} bytes each by core:datatype and "
                f"core:num_channels, got {max(length, 0)} bytes: is it cut off?"
            )
        if number.kind == "u":
            self._notes.append(
                f"samples are taken as stored: the midpoint of unsigned {number.name} is not "
                "subtracted"
            )
        return samples

    def _starts_of_captures(self) -> list[int]:
        """Return the first sample of each capture, counted from the beginning of the file."""
        offset = _count(self._global, "core:offset", 0)
        starts = [_count(capture, "core:sample_start", None) for capture in self._captures]
        for start in starts:
            if start < offset:
                raise ValueError(
                    f"core:sample_start must be at least core:offset {offset}, got {start}"
                )
        return [start - offset for start in starts]

    def _take_entries(self, scope: str, objects: Sequence[Mapping[str, Any]]) -> None:
        """Take the numbers, lists and texts of the metadata as arrays."""
        excluded = {*_ELSEWHERE, *(_OF_THE_FILE if scope == "global" else ())}
        # In the order of their first appearance.
        names = dict.fromkeys(key for entries in objects for key in entries)
        keys = [key for key in names if key not in excluded]
        # Every name takes a value of every object, also where most do not have it.
        most = min(_MOST_NAMES, max(MOST_VALUES // max(len(objects), 1), 1))
        if len(keys) > most:
            self._unread.append(
                f"{scope}: {len(keys) - most} names after the first {most}: not read"
            )
        for key in keys[:most]:
            name = f"{scope}/{key.removeprefix('core:')}"
            values = _column_of([entries.get(key) for entries in objects])
            if values is None:
                self._unread.append(
                    f"{name!r:.{_LONGEST_LINE}}: not read: no numbers or short texts"
                )
                continue
            self._arrays[name] = np.asarray(values[0]) if scope == "global" else values
            self._units[name] = _UNITS.get(key, "")

    def _take_times_and_places(self) -> None:
        """Take times and places of captures as numbers."""
        times = self._arrays.get("captures/datetime")
        if times is not None and times.dtype.kind == "U" and times.ndim == 1:
            moments = [zoned_time(str(text)) for text in times]
            seconds = np.array([math.nan if one is None else one.timestamp() for one in moments])
            self._arrays["captures/time"] = seconds
            self._units["captures/time"] = "s"
            self._note_bad("core:datetime", int(np.isnan(seconds[times != ""]).sum()))

        places = np.full((len(self._captures), len(_PLACE)), np.nan)
        bad = 0
        of_all = self._global.get("core:geolocation")
        for row, capture in zip(places, self._captures, strict=True):
            point = capture.get("core:geolocation", of_all)
            if point is not None:
                coordinates = _coordinates(point)
                row[: coordinates.size] = coordinates
                bad += not coordinates.size
        self._note_bad("core:geolocation", bad)
        for name, values in zip(_PLACE, places.T, strict=True):
            if np.isfinite(values).any():
                self._arrays[f"captures/{name}"] = values
                self._units[f"captures/{name}"] = "m" if name == "height" else "deg"

    def _note_bad(self, key: str, count: int) -> None:
        """Note how many entries of captures cannot be understood."""
        if count:
            self._notes.append(f"{key} of {count} captures cannot be understood and is not used")

    def _sweep_length(self) -> int:
        """Return how many captures of equal length make a sweep; 0 if none do.

        It adds the tones, and the entries of the first capture of every sweep, to the arrays.
        """
        frequency = self._arrays.get("captures/frequency")
        if frequency is None or frequency.ndim != 1 or frequency.dtype.kind not in "iuf":
            return 0
        # A sweep ends where the first tone comes again.
        again = np.flatnonzero(frequency[1:] == frequency[0])
        tones = int(again[0]) + 1 if again.size else frequency.size
        used = frequency.size // tones * tones
        sweep = frequency[:tones]
        # The last sweep may be cut off; a tone that is not finite is in none.
        are_alike = (np.resize(sweep, frequency.size) == frequency).all()
        if tones < 2 or not are_alike or not np.isfinite(sweep).all():
            return 0
        if used < frequency.size:
            self._notes.append(
                f"the last {frequency.size - used} captures are no complete sweep of {tones} "
                "tones: sweeps leaves them out"
            )
        self._of_sweeps["tones"] = sweep
        self._units["tones"] = "Hz"
        for name, values in self._arrays.items():
            scope, _, key = name.partition("/")
            if scope == "captures" and key not in ("frequency", "sample_start"):
                self._of_sweeps[f"sweeps/{key}"] = values[:used:tones]
                self._units[f"sweeps/{key}"] = self._units[name]
        return tones

    def _read_samples(self) -> AnyArray:
        """Read all samples, and check their digest if the metadata state one."""
        samples = self._samples
        memory = math.prod(samples.shape) * samples.value.itemsize
        if memory > self._limit:
            raise ValueError(
                f"samples must take at most {self._limit / 1e9:g} GB, got {memory / 1e9:.3g} GB"
            )
        content = bytearray(samples.size)
        with self._folder.open(samples.name, samples.size) as file:
            length = file.readinto(content)
        if length != samples.size:
            raise ValueError(f"{samples.name} must stay as it is while it is read")
        note = "the metadata state no SHA-512 of the samples: they are not checked"
        if samples.sha512:
            note = "the SHA-512 of the samples is that of the metadata"
            if hashlib.sha512(content).hexdigest() != samples.sha512:
                raise ValueError(
                    f"{samples.name} differs from what its metadata state: its SHA-512 is another"
                )
        if note not in self._notes:
            self._notes.append(note)
        if samples.headers:
            parts = []
            begin = passed = 0  # bytes; a header comes before its sample
            for start, header in samples.headers:
                end = start * samples.width + passed
                parts.append(content[begin:end])
                begin = end + header
                passed += header
            content = bytearray().join([*parts, content[begin:]])
        numbers = np.frombuffer(content, samples.number, samples.length // samples.number.itemsize)
        if samples.is_complex:
            component: Any = np.float32 if samples.value == np.complex64 else np.float64
            numbers = numbers.astype(component, copy=False).view(samples.value)
        return numbers.astype(samples.value, copy=False).reshape(samples.shape)


def _printable(text: str) -> str:
    """Return a text with spaces for characters that a terminal would obey."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _refuse_constant(name: str) -> None:
    """Refuse a number that JSON does not have."""
    raise ValueError(f"metadata must be JSON, which has no {name}")


def _object(value: Any, name: str) -> Entries:
    """Return an object of the metadata; anything else is a ValueError."""
    if not isinstance(value, dict):
        raise ValueError(f"{name} must be an object, got {value!r:.100}")
    return value


def _objects(value: Any, name: str) -> list[Entries]:
    """Return a list of objects of the metadata; anything else is a ValueError."""
    if not isinstance(value, list):
        raise ValueError(f"{name} must be a list of objects, got {value!r:.100}")
    return [_object(entry, f"each of {name}") for entry in value]


def _matched(
    entries: Mapping[str, Any], key: str, pattern: str, rule: str, default: str | None = None
) -> re.Match[str]:
    """Return the match of a text of the metadata; one that does not match is a ValueError."""
    value = entries.get(key, default)
    matched = re.fullmatch(pattern, value) if isinstance(value, str) else None
    if matched is None:
        raise ValueError(f"{key} must be {rule}, got {value!r:.200}")
    return matched


def _count(content: Mapping[str, Any], key: str, default: int | None, least: int = 0) -> int:
    """Return a whole number of the metadata; without a default it must be there."""
    value = content.get(key, default)
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if not is_whole or not least <= value <= _LARGEST:
        raise ValueError(f"{key} must be a whole number from {least} on, got {value!r:.100}")
    return int(value)


def _column_of(column: list[Any]) -> AnyArray | None:
    """Return the values of an entry as an array with a row for each object.

    It is None where they are neither finite numbers nor short texts, or differ in their shape.
    Numbers that are missing are NaN, and texts that are missing are empty.
    """
    present = [value for value in column if value is not None]
    # Looked at before NumPy is: a text among numbers would give every row the room of the text.
    leaves = _leaves(present)
    if leaves and all(isinstance(leaf, str) for leaf in leaves):
        # NumPy gives every text the room of the longest.
        if max(map(len, leaves)) * max(len(leaves), len(column)) > _MOST_TEXT:
            return None
        rows = ["" if value is None else value for value in column]
        with suppress(ValueError):
            return np.array(rows, dtype=np.str_)
        return None
    if not all(isinstance(leaf, int | float) and not isinstance(leaf, bool) for leaf in leaves):
        return None
    if not any(isinstance(value, list) for value in present):
        column = [math.nan if value is None else value for value in column]
    try:
        values = np.array(column)
    except (ValueError, OverflowError):
        return None
    if values.dtype.kind not in "iuf" or 0 in values.shape or np.isinf(values).any():
        return None
    return values


def _leaves(values: list[Any]) -> list[Any]:
    """Return what lists hold, and lists within them, without the lists."""
    leaves = []
    unread = list(values)
    while unread:
        value = unread.pop()
        if isinstance(value, list):
            unread.extend(value)
        else:
            leaves.append(value)
    return leaves


def _coordinates(point: Any) -> FloatArray:
    """Return longitude and latitude, degrees, and height, m, if any, of a point of GeoJSON.

    There are none where it is no such point.
    """
    values = point.get("coordinates") if isinstance(point, dict) else None
    coordinates = None
    if isinstance(values, list) and 2 <= len(values) <= len(_PLACE):
        coordinates = _column_of(values)
    if coordinates is None or coordinates.ndim != 1 or coordinates.dtype.kind not in "iuf":
        return np.empty(0)
    return coordinates.astype(np.float64)


class SigmfReader(Reader):
    """Recordings in SigMF, whose metadata and samples are two files."""

    kind = "SigMF recording"
    names = "SigMF (.sigmf-meta)"
    reads = frozenset({"arrays"})

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the ending is that of one of the two files; refuse sets of recordings."""
        suffix = path.suffix.lower()
        if suffix in (".sigmf", ".sigmf-collection"):
            raise ValueError(
                f"{path}: an archive or a collection of SigMF names other files: unpack it "
                "(tar -xf), and give the .sigmf-meta of one recording, or of several"
            )
        return suffix in (".sigmf-meta", ".sigmf-data")

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open samples, sweeps and the numbers of the metadata."""
        notes: Notes = []
        recording = SigmfRecording(path, limit, notes)
        arrays, about = recording.arrays, recording.lines
        opened = ArrayFile(path, self.kind, arrays, recording.read, limit, about, notes)
        if "sweeps" in arrays:
            opened.signal = "sweeps"
            opened.repeated = "captures/"  # what the captures state is there for the sweeps as well
        return opened


READER = SigmfReader()
