"""One file of named arrays and words in JSON, which proves itself: models, snapshots, and what is kept of long work.

A line with the length and the SHA-256 of a JSON head, the head, and the arrays' bytes. The head holds the words, and
every array's type, shape, place and SHA-256, so that arrays can be read one by one and each is checked when it is.
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

from flgpr.door import Folder, parse_json
from flgpr.store.files import canonical_json, sha256, writing

PARTIAL = ".partial"
_KINDS = "biufcU"
_TYPE = re.compile(r"[<>|][biufcU][0-9]{1,9}")
"""Types of numbers and text as NumPy spells them. It reads much more, and parses some of that without a bound."""
_MOST_AXES = 32
_LONGEST_AXIS = 2**53
_ALIGN = 64
_LONGEST_HEAD = 2**26
_PIECE = 2**20
MOST_BUNDLE = 16 * 2**30
"""Largest file of arrays that is read unless told otherwise, bytes."""


class BundleError(ValueError):
    """A file is no bundle, or damaged."""


def write_bundle(
    path: Path,
    arrays: Mapping[str, NDArray[Any]],
    about: Mapping[str, Any] | None = None,
    lasting: bool = False,
) -> int:
    """Write arrays of numbers, booleans or text, and words, to a file that appears whole or not at all; give its bytes.

    With ``lasting`` it is on the disk before it appears; else what a crash of the machine tears is found out when read.
    """
    listed: list[dict[str, Any]] = []
    place = 0
    held = []
    for name, value in arrays.items():
        value = np.asarray(value, order="C")
        if value.dtype.kind not in _KINDS:
            raise ValueError(f"{name} must hold numbers, booleans or text, got {value.dtype}")
        data = value.reshape(-1).view(np.uint8)
        digest = hashlib.sha256(data.data).hexdigest()
        entry = {
            "name": name,
            "dtype": value.dtype.str,
            "shape": list(value.shape),
            "at": place,
            "sha256": digest,
        }
        listed.append(entry)
        held.append(data)
        place += -(-data.size // _ALIGN) * _ALIGN
    text = canonical_json({"about": dict(about or {}), "arrays": listed})
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{os.urandom(4).hex()}{PARTIAL}")
    try:
        with writing(path), temporary.open("wb") as file:
            file.write(f"{len(text)} {sha256(text)}\n".encode())
            file.write(text)
            for data in held:
                file.write(data.data)
                file.write(bytes(-data.size % _ALIGN))
            size = file.tell()
            if lasting:
                file.flush()
                os.fsync(file.fileno())
        temporary.replace(path)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise
    return size


class Bundle(Mapping[str, NDArray[Any]]):
    """The arrays of a file of :func:`write_bundle`, read and checked when first asked for, and its words, ``about``.

    Parameters
    ----------
    path : Path
        The file, which must be regular and no link.
    data : bytes, optional
        What the file holds, if it was read already: the file is then not opened.
    most : int
        Bytes that the file may have.

    Raises
    ------
    BundleError
        If it is no such file, larger, or damaged; for arrays when they are read.
    FileNotFoundError
        If there is no file.
    """

    def __init__(self, path: Path, data: bytes | None = None, most: int = MOST_BUNDLE) -> None:
        self.path = path
        self._data = data
        self._most = most
        self._kept: dict[str, NDArray[Any]] = {}
        try:
            with self._open() as file:
                self.about, self._head, self._start = _read_head(file)
                size = file.seek(0, os.SEEK_END)
            end = self._start + _laid_out(self._head)
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

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._kept:
            self._kept[name] = self._read(name, self._head[name])
        return self._kept[name]

    def listed(self) -> list[dict[str, Any]]:
        """List the arrays by the head alone: ``name``, ``dtype``, ``shape`` and ``bytes`` of each."""
        return [
            {"name": name, "dtype": one["dtype"], "shape": list(one["shape"]), "bytes": _bytes(one)}
            for name, one in self._head.items()
        ]

    def check(self) -> None:
        """Read every array piece by piece and keep none; a damaged one is a BundleError."""
        with self._open() as file:
            for name, entry in self._head.items():
                file.seek(self._start + entry["at"])
                wanted = _bytes(entry)
                digest = hashlib.sha256()
                for begin in range(0, wanted, _PIECE):
                    digest.update(file.read(min(_PIECE, wanted - begin)))
                if digest.hexdigest() != entry["sha256"] or any(file.read(-wanted % _ALIGN)):
                    raise self._damaged(name)

    def _open(self) -> AbstractContextManager[io.BufferedReader | io.BytesIO]:
        if self._data is not None:
            return nullcontext(io.BytesIO(self._data))
        return Folder(self.path.parent).open(self.path.name, self._most)

    def _read(self, name: str, entry: dict[str, Any]) -> NDArray[Any]:
        wanted = _bytes(entry)
        data = np.empty(wanted + -wanted % _ALIGN, np.uint8)
        with self._open() as file:
            file.seek(self._start + entry["at"])
            filled = file.readinto(data.data)
        if filled != data.size or hashlib.sha256(data[:wanted].data).hexdigest() != entry["sha256"]:
            raise self._damaged(name)
        if data[wanted:].any():
            raise self._damaged(name)
        return data[:wanted].view(np.dtype(entry["dtype"])).reshape(entry["shape"])

    def _damaged(self, name: str) -> BundleError:
        return BundleError(f"{self.path}: {name} differs from what was written")


def _read_head(file: BinaryIO) -> tuple[dict[str, Any], dict[str, dict[str, Any]], int]:
    length, _, digest = file.readline(128).decode("ascii").rstrip("\n").partition(" ")
    if not length.isdecimal() or int(length) > _LONGEST_HEAD:
        raise ValueError("no head")
    text = file.read(int(length))
    if sha256(text) != digest:
        raise ValueError("the head is damaged")
    head = parse_json(text)
    arrays: dict[str, dict[str, Any]] = {}
    for entry in head["arrays"]:
        _check_entry(entry)
        if entry["name"] in arrays:
            raise ValueError(f"the array {_short(entry['name'])} is there twice")
        arrays[entry["name"]] = entry
    return dict(head["about"]), arrays, file.tell()


def _check_entry(entry: Mapping[str, Any]) -> None:
    """Refuse an array that the head describes in another way than :func:`write_bundle` does."""
    name, spelling, shape, place = (entry[key] for key in ("name", "dtype", "shape", "at"))
    if not isinstance(name, str):
        raise ValueError(f"names of arrays must be text, got {_short(name)}")
    is_known = isinstance(spelling, str) and _TYPE.fullmatch(spelling) is not None
    if not is_known or not np.dtype(spelling).itemsize:
        raise ValueError(
            f"{_short(name)} must hold numbers or text, got the type {_short(spelling)}"
        )
    if not isinstance(shape, list) or len(shape) > _MOST_AXES:
        raise ValueError(f"{_short(name)} must have at most {_MOST_AXES} axes, got {_short(shape)}")
    for number in (place, *shape):
        if type(number) is not int or not 0 <= number < _LONGEST_AXIS:
            raise ValueError(
                f"{_short(name)} must have a shape and place of whole numbers from 0, got {_short(shape)} at "
                f"{_short(place)}"
            )


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _laid_out(arrays: Mapping[str, dict[str, Any]]) -> int:
    """Count the bytes of arrays that lie one after the other; some that share bytes would take more than the file."""
    end = 0
    for name, entry in arrays.items():
        if entry["at"] != end:
            raise ValueError(
                f"{name} must begin where the array before it ends, {end}, got {entry['at']}"
            )
        end += -(-_bytes(entry) // _ALIGN) * _ALIGN
    return end


def _bytes(entry: dict[str, Any]) -> int:
    count = np.dtype(entry["dtype"]).itemsize
    for length in entry["shape"]:
        count *= length
    return int(count)
