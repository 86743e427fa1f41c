"""Bundles: one file of named arrays and JSON metadata that carries its own digests.

Models, snapshots and checkpoints of long work are bundles. A file begins with a line that holds the
length and the SHA-256 of a JSON head. Then follow the head and the bytes of the arrays. The head
holds the metadata ("about") and the type, shape, offset and SHA-256 of every array, so that arrays
can be read one by one and each is checked when it is read.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from flgpr.door import Folder, refuse_links
from flgpr.json_text import canonical_json, parse_json, sha256
from flgpr.store.files import own_partial, writing
from flgpr.types import AnyArray

_KINDS = "biufcU"
_TYPE = re.compile(r"[<>|][biufcU][0-9]{1,9}")
"""Types of numbers and text as NumPy spells them.

NumPy accepts many more spellings and parses some of them without a bound on memory.
"""
_MOST_AXES = 32
_LONGEST_AXIS = 2**53  # up to here every reader of JSON holds integers exactly
_ALIGN = 64  # bytes; every array begins at a multiple of it
_LONGEST_HEAD = 2**26
_PIECE = 2**20  # bytes that are read at a time while an array is only checked
MOST_BUNDLE = 16 * 2**30
"""Largest bundle that is read by default, bytes."""


class BundleError(ValueError):
    """A file is no bundle, or it is damaged."""


def write_bundle(
    path: Path,
    arrays: Mapping[str, AnyArray],
    about: Mapping[str, Any] | None = None,
    lasting: bool = False,
) -> int:
    """Write arrays and metadata to a file that appears complete or not at all.

    Parameters
    ----------
    path : Path
        The file; one that exists is replaced.
    arrays : mapping of str to (...) ndarray
        Numbers, booleans or text, by name.
    about : mapping, optional
        Metadata, JSON values.
    lasting : bool
        Flush the file to the disk before it appears. Otherwise a crash of the machine may leave a
        damaged file, which is detected when it is read.

    Returns
    -------
    int
        Size of the file, bytes.

    Raises
    ------
    ValueError
        If an array holds anything else, or the metadata are no JSON values.
    FileExistsError
        If the file is a symbolic link.
    OSError
        If the file cannot be written.
    """
    refuse_links(path)
    entries: list[dict[str, Any]] = []
    blocks: list[NDArray[np.uint8]] = []
    offset = 0
    for name, value in arrays.items():
        array = np.asarray(value, order="C")
        if array.dtype.kind not in _KINDS:
            raise ValueError(f"{name} must hold numbers, booleans or text, got {array.dtype}")
        data = array.reshape(-1).view(np.uint8)
        entries.append(
            {
                "name": name,
                "dtype": array.dtype.str,
                "shape": list(array.shape),
                "at": offset,
                "sha256": hashlib.sha256(data.data).hexdigest(),
            }
        )
        blocks.append(data)
        offset += _aligned(data.size)
    head = canonical_json({"about": dict(about or {}), "arrays": entries})
    # Several processes may write the same bundle at once, each under a name of its own.
    with writing(path), own_partial(path) as temporary, temporary.open("xb") as file:
        file.write(f"{len(head)} {sha256(head)}\n".encode())
        file.write(head)
        for data in blocks:
            file.write(data.data)
            padding = -data.size % _ALIGN
            file.write(bytes(padding))
        size = file.tell()
        if lasting:
            file.flush()
            os.fsync(file.fileno())
    return size


class Bundle(Mapping[str, AnyArray]):
    """The arrays of a file of :func:`write_bundle`, by name, and its metadata ``about``.

    An array is read and checked when it is first asked for.

    Parameters
    ----------
    path : Path
        The file, which must be regular and no link.
    data : bytes, optional
        Content of the file, if it was read already: the file is then not opened.
    most : int
        Largest size that the file may have, bytes.

    Raises
    ------
    BundleError
        If it is no bundle, too large, or damaged. A damaged array is found when it is read.
    FileNotFoundError
        If there is no file.
    """

    def __init__(self, path: Path, data: bytes | None = None, most: int = MOST_BUNDLE) -> None:
        self.path = path
        self._data = data
        self._most = most
        self._cache: dict[str, AnyArray] = {}
        try:
            with self._open() as file:
                self.about, self._head, self._start = _read_head(file)
                size = file.seek(0, os.SEEK_END)
            end = 0
            for name, entry in self._head.items():
                if entry["at"] != end:
                    raise ValueError(
                        f"{name} must begin where the array before it ends, {end}, got {entry['at']}"
                    )
                end += _aligned(_array_size(entry))
            end = self._start + end
            if size != end:
                raise ValueError(f"{size} bytes of {end}")
        except FileNotFoundError:
            raise
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise BundleError(f"{path}: not a whole file of arrays ({error})") from None

    def __len__(self) -> int:
        return len(self._head)

    def __iter__(self) -> Iterator[str]:
        return iter(self._head)

    def __getitem__(self, name: str) -> AnyArray:
        if name not in self._cache:
            entry = self._head[name]
            size = _array_size(entry)
            padded = np.empty(_aligned(size), np.uint8)
            with self._open() as file:
                file.seek(self._start + entry["at"])
                filled = file.readinto(padded.data)
            data = padded[:size]
            padding = padded[size:]
            if filled != padded.size or padding.any():
                raise self._damaged(name)
            if hashlib.sha256(data.data).hexdigest() != entry["sha256"]:
                raise self._damaged(name)
            self._cache[name] = data.view(np.dtype(entry["dtype"])).reshape(entry["shape"])
        return self._cache[name]

    def listed(self) -> list[dict[str, Any]]:
        """Return ``name``, ``dtype``, ``shape`` and ``bytes`` of every array from the head."""
        rows = []
        for name, entry in self._head.items():
            row = {
                "name": name,
                "dtype": entry["dtype"],
                "shape": list(entry["shape"]),
                "bytes": _array_size(entry),
            }
            rows.append(row)
        return rows

    def check(self) -> None:
        """Check every array against its digest, in pieces so that memory stays small.

        Raises
        ------
        BundleError
            If an array is damaged.
        """
        with self._open() as file:
            for name, entry in self._head.items():
                file.seek(self._start + entry["at"])
                size = _array_size(entry)
                digest = hashlib.sha256()
                for begin in range(0, size, _PIECE):
                    digest.update(file.read(min(_PIECE, size - begin)))
                padding = file.read(-size % _ALIGN)
                if digest.hexdigest() != entry["sha256"] or any(padding):
                    raise self._damaged(name)

    def _open(self) -> AbstractContextManager[io.BufferedReader | io.BytesIO]:
        """Open the file, or the content that was read before."""
        if self._data is not None:
            return nullcontext(io.BytesIO(self._data))
        return Folder(self.path.parent).open(self.path.name, self._most)

    def _damaged(self, name: str) -> BundleError:
        """Return the error for a damaged array."""
        return BundleError(f"{self.path}: {name} differs from what was written")


def _read_head(file: BinaryIO) -> tuple[dict[str, Any], dict[str, dict[str, Any]], int]:
    """Return the metadata, the entry of every array by name, and the offset where arrays begin."""
    length, _, digest = file.readline(128).decode("ascii").rstrip("\n").partition(" ")
    if not length.isdecimal() or int(length) > _LONGEST_HEAD:
        raise ValueError("no head")
    text = file.read(int(length))
    if sha256(text) != digest:
        raise ValueError("the head is damaged")
    head = parse_json(text)
    arrays: dict[str, dict[str, Any]] = {}
    for entry in head["arrays"]:
        name = entry["name"]
        spelling = entry["dtype"]
        shape = entry["shape"]
        offset = entry["at"]
        if not isinstance(name, str):
            raise ValueError(f"names of arrays must be text, got {_short(name)}")
        is_known = isinstance(spelling, str) and _TYPE.fullmatch(spelling) is not None
        if not is_known or not np.dtype(spelling).itemsize:
            raise ValueError(
                f"{_short(name)} must hold numbers or text, got the type {_short(spelling)}"
            )
        if not isinstance(shape, list) or len(shape) > _MOST_AXES:
            raise ValueError(
                f"{_short(name)} must have at most {_MOST_AXES} axes, got {_short(shape)}"
            )
        for number in (offset, *shape):
            if type(number) is not int or not 0 <= number < _LONGEST_AXIS:
                raise ValueError(
                    f"{_short(name)} must have a shape and offset of whole numbers from 0, "
                    f"got {_short(shape)} at {_short(offset)}"
                )
        if entry["name"] in arrays:
            raise ValueError(f"the array {_short(entry['name'])} is there twice")
        arrays[entry["name"]] = entry
    return dict(head["about"]), arrays, file.tell()


def _short(value: Any) -> str:
    """Return a value from a file as text short enough for a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _aligned(size: int) -> int:
    """Return a number of bytes rounded up to the alignment of arrays in the file."""
    return -(-size // _ALIGN) * _ALIGN


def _array_size(entry: dict[str, Any]) -> int:
    """Return the bytes of an array without padding."""
    count = np.dtype(entry["dtype"]).itemsize
    for length in entry["shape"]:
        count *= length
    return int(count)
