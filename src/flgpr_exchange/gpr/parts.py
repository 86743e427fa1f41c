"""What the readers of commercial radars share: text headers and records of one length.

Every function that replaces, leaves out or assumes something notes it in ``notes``, with a count.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.door import Folder, open_named, refuse_linked_companion
from flgpr.store.text import decode_text
from flgpr.types import AnyArray, ArrayLike, Entries, FloatArray, Notes

NANOSECOND = 1e-9
FOOT = 0.3048
INTERVALS = (1e-13, 1e-6)
"""Shortest and longest time between samples that any such radar has, s."""
MOST_SAMPLES = 2**20
"""Most samples of a trace."""
LARGEST_TEXT = 64 * 2**20
ZERO_ASSUMED = "the header tells no time zero: it is put at the first sample"
_LARGEST_COUNT = 1e30  # magnitude that no recorder reaches but a wrong byte order makes
_LENGTHS = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "mt": 1.0,
    "cm": 0.01,
    "centimetre": 0.01,
    "centimeter": 0.01,
    "mm": 1e-3,
    "millimetre": 1e-3,
    "millimeter": 1e-3,
    "dm": 0.1,
    "km": 1e3,
    "ft": FOOT,
    "foot": FOOT,
    "feet": FOOT,
    "'": FOOT,
    "in": 0.0254,
    "inch": 0.0254,
    "inche": 0.0254,
    '"': 0.0254,
    "yd": 0.9144,
    "yard": 0.9144,
}


class MissingHeaderError(FileNotFoundError):
    """A file that a recording cannot be read without does not lie beside it."""


@dataclass
class Header:
    """The lines ``name = value`` of a text header."""

    path: Path
    values: dict[str, str]

    def number(self, name: str, low: float, high: float) -> float | None:
        """Return the number of an entry.

        Parameters
        ----------
        name : str
            The entry.
        low, high : float
            Its bounds.

        Returns
        -------
        float or None
            The number; None where the entry is absent.

        Raises
        ------
        ValueError
            If it is out of bounds.
        """
        cells = self.values.get(name, "").split()
        if not cells:
            return None
        try:
            value = float(cells[0].replace(",", "."))
        except ValueError:
            value = np.nan
        if not low <= value <= high:
            raise ValueError(
                f"{self.path.name}: {name} must be a number from {low:g} to {high:g}, "
                f"got {cells[0][:40]!r}"
            )
        return value

    def needed(self, name: str, low: float, high: float) -> float:
        """Return the number of an entry that must be there."""
        value = self.number(name, low, high)
        if value is None:
            raise ValueError(f"{self.path.name} must hold {name}, which it does not")
        return value

    def text(self, *names: str) -> str:
        """Return the first of these entries that is not empty, else an empty text."""
        return next((self.values[name] for name in names if self.values.get(name)), "")


def words_type(words: Mapping[str, tuple[Any, int]], size: int, order: str) -> np.dtype[Any]:
    """Return the type of a binary header, by a table of its words.

    Parameters
    ----------
    words : mapping of str to (type, int)
        Type, without its byte order, and first byte of each word, by its name.
    size : int
        Bytes of the header.
    order : str
        Byte order, "<" or ">".

    Returns
    -------
    numpy.dtype
        Of a record with a field for every word.
    """
    fields: Any = {
        "names": list(words),
        "formats": [order + kind for kind, _ in words.values()],
        "offsets": [offset for _, offset in words.values()],
        "itemsize": size,
    }
    return np.dtype(fields)


def header_words(raw: bytes, words: Mapping[str, tuple[str, int]], order: str) -> Entries:
    """Return the words of a binary header by their names, see :func:`words_type`."""
    (values,) = np.frombuffer(raw, words_type(words, len(raw), order)).tolist()
    return dict(zip(words, values, strict=True))


def note_count(notes: Notes, found: ArrayLike, text: str) -> int:
    """Add a note that begins with a count, unless that is zero.

    Parameters
    ----------
    notes : list of str
        Takes the note.
    found : array_like of bool, or int
        What is counted, or the count.
    text : str
        What follows the count.

    Returns
    -------
    int
        The count.
    """
    count = int(np.sum(found))
    if count:
        notes.append(f"{count} {text}")
    return count


def first_bytes(path: Path, size: int, start: int = 0, header: str = "", least: int = 0) -> bytes:
    """Return up to so many bytes of a recording from ``start`` on.

    Parameters
    ----------
    path : Path
        The recording.
    size : int
        Most bytes.
    start : int
        First byte.
    header : str
        What they are, for the error.
    least : int
        Fewest bytes.

    Returns
    -------
    bytes
        Fewer than ``size`` where the file ends.

    Raises
    ------
    ValueError
        If there are fewer than ``least``.
    """
    with open_named(path) as file:
        file.seek(start)
        raw = file.read(size)
    if len(raw) < least:
        raise ValueError(f"{header} must have {least} bytes, the file has {len(raw)}")
    return raw


def find_companion(path: Path, suffix: str) -> Path | None:
    """Find the file of the same name and another ending, in any case.

    Parameters
    ----------
    path : Path
        The recording.
    suffix : str
        The ending, such as ".gps".

    Returns
    -------
    Path or None
        The file; None if there is none.

    Raises
    ------
    ValueError
        If it is a symbolic link: the user named the recording, and nobody where this leads.
    """
    companion_name = (path.stem + suffix).lower()
    for other in sorted(path.parent.iterdir()):
        if other.name.lower() == companion_name and other.is_file():
            refuse_linked_companion(other)
            return other
    return None


def read_header(path: Path, suffix: str, mark: str, notes: Notes) -> Header:
    """Read the text header beside a recording.

    Parameters
    ----------
    path : Path
        The recording.
    suffix : str
        Ending of the header.
    mark : str
        What separates the name and the value of an entry.
    notes : list of str
        Notes of the encoding are added to it.

    Returns
    -------
    Header
        The entries, their names in capitals.

    Raises
    ------
    MissingHeaderError
        If there is no such file.
    """
    companion = find_companion(path, suffix)
    if companion is None:
        raise MissingHeaderError(
            f"{path}: its header {path.stem}{suffix} must lie beside it, it does not"
        )
    values = {}
    for line in read_companion(companion, notes).splitlines():
        name, separator, value = line.partition(mark)
        if separator:
            values[name.strip().upper()] = value.strip()
    return Header(companion, values)


def read_companion(path: Path, notes: Notes) -> str:
    """Read a text file that lies beside a recording, in an encoding of :mod:`flgpr.store.text`.

    Parameters
    ----------
    path : Path
        The file.
    notes : list of str
        Takes a line for an encoding other than UTF-8.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    ValueError
        If it is too large, or no text.
    """
    size = path.lstat().st_size
    if size > LARGEST_TEXT:
        raise ValueError(f"{path.name} must hold at most {LARGEST_TEXT} bytes, got {size}")
    return decode_text(Folder(path.parent).read(path.name), path.name, notes)


def length_unit(text: str) -> float | None:
    """Return how many metres a unit of length is.

    Parameters
    ----------
    text : str
        Name or sign of the unit.

    Returns
    -------
    float or None
        Metres; None if the unit is not known.
    """
    word = text.strip().lower().removesuffix("(s)").rstrip(".")
    return _LENGTHS.get(word) or _LENGTHS.get(word.rstrip("s"))


def read_records(
    path: Path,
    start: int,
    kind: np.dtype[Any],
    stated: float | None,
    notes: Notes,
    limit: int,
    end: int = 0,
) -> AnyArray:
    """Read records of one length, after they were counted by the size of the file.

    Parameters
    ----------
    path : Path
        The recording.
    start, end : int
        Bytes before the first record, and behind the last.
    kind : dtype
        Type of a record: samples, or fields with one called "samples".
    stated : float or None
        Traces by the header; others than there are get a note.
    notes : list of str
        Notes are added to it.
    limit : int
        Bytes that all traces may take in memory.

    Returns
    -------
    (trace,) ndarray
        The records.

    Raises
    ------
    ValueError
        If there is no trace, or they take too much memory.
    """
    samples = kind if kind.fields is None else kind["samples"]
    growth = 4 if samples.base.itemsize == 1 else 2  # of counts that become floating point
    available = path.stat().st_size - start - end
    count, rest = divmod(max(available, 0), kind.itemsize)
    if count < 1:
        raise ValueError(
            f"it must hold at least one trace of {kind.itemsize} bytes after {start}, "
            f"the file has {available + start}"
        )
    needed = count * kind.itemsize * growth
    if needed > limit:
        raise ValueError(
            f"it must fit into {limit / 1e9:.3g} GB, its traces take {needed / 1e9:.3g} GB"
        )
    if rest:
        notes.append(f"the last trace is cut off and left out ({rest} of {kind.itemsize} bytes)")
    if stated is not None and count < stated - 1:  # headers count from 0 or from 1
        notes.append(f"truncated: the header tells {stated:g} traces, the file holds {count}")
    if stated is not None and count > stated + 1:
        notes.append(
            f"the header tells {stated:g} traces, the file holds {count}, all of which are read"
        )
    return np.fromfile(path, dtype=kind, count=count, offset=start)


def exact_floats(samples: AnyArray, notes: Notes) -> NDArray[np.floating[Any]]:
    """Return samples as floating point in which every count is exact.

    Parameters
    ----------
    samples : (trace, ...) ndarray
        Counts or numbers.
    notes : list of str
        Takes a line on traces with samples that are no numbers.

    Returns
    -------
    (trace, ...) ndarray of float
        In single precision, or in double where that would round counts or numbers.

    Raises
    ------
    ValueError
        If a magnitude is beyond 1e30.
    """
    # Single precision holds whole numbers of up to 24 bit exactly.
    width = samples.dtype.itemsize
    is_wide = width > 4 or (width == 4 and samples.dtype.kind in "iu")
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        real: NDArray[np.floating[Any]] = samples.astype(np.float64 if is_wide else np.float32)
    finite = np.isfinite(real)
    size = np.abs(real[finite]).max(initial=0.0)
    if size > _LARGEST_COUNT:
        raise ValueError(
            f"samples must be below 1e30 in magnitude, got {size:g}: is the byte order wrong?"
        )
    missing = ~finite.reshape(len(real), -1).all(axis=1)
    note_count(notes, missing, f"of {len(real)} traces hold samples that are no numbers")
    return real


def float64(values: AnyArray) -> FloatArray:
    """Return header words as float64; a signalling NaN becomes a quiet one, without a warning."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def numbers_in(text: bytes, widths: list[int]) -> list[float]:
    """Return numbers that are written as text in fields of fixed widths.

    Parameters
    ----------
    text : bytes
        The fields, one after the other.
    widths : list of int
        Bytes of each field.

    Returns
    -------
    list of float
        A number per field; NaN for what is none.
    """
    numbers = []
    for end, width in zip(accumulate(widths), widths, strict=True):
        try:
            numbers.append(float(text[end - width : end].split(b"\0")[0]))
        except ValueError:
            numbers.append(np.nan)
    return numbers


def is_header_line(line: str) -> bool:
    """Return whether a line of a table names columns or is a comment.

    It is empty, begins with a mark of comments, or holds no digit.
    """
    content = line.strip()
    return not content or content[0] in "#;!%/" or not re.search(r"\d", content)
