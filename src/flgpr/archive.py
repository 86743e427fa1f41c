"""Untrusted NumPy archives: what they declare is checked before anything is decoded."""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from flgpr.door import check_expansion

if TYPE_CHECKING:
    from flgpr.types import AnyArray

MOST_DECODED = 2 * 10**9
"""Bytes that all arrays of an archive may take together."""
_LARGEST_DIRECTORY = 2**18
_LONGEST_HEADER = 10_000
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_KINDS = "biufcU"


class Member(NamedTuple):
    """An array as its archive declares it."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    size: int  #: bytes when decoded, with its header
    room: int  #: bytes in the file


class Archive(Mapping[str, "AnyArray"]):
    """The arrays of an ``.npz`` file, by name.

    They are checked when the file is opened, and decoded one by one when they are asked for. Each
    member must be a ``.npy`` of numbers, booleans or text, stored or deflated, of the size that its
    header states. Other members, and arrays of Python objects, are left out; ``passed_over`` holds
    the reason by name.

    Parameters
    ----------
    file : binary file
        The open file.
    most : int
        Bytes that all arrays together may take. Above 64 MiB they may also take at most 200 times
        the bytes of the file.

    Raises
    ------
    ValueError
        If the file breaks a rule; for an array when it is decoded.
    """

    def __init__(self, file: BinaryIO, most: int = MOST_DECODED) -> None:
        _check_directory(file)
        self.members: dict[str, Member] = {}
        self.passed_over: dict[str, str] = {}
        try:
            self._zip = zipfile.ZipFile(file)
            for entry in self._zip.infolist():
                self._add(entry)
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            NotImplementedError,
            RuntimeError,
        ) as error:
            raise ValueError(f"no archive of arrays ({error})") from None
        size = sum(member.size for member in self.members.values())
        room = sum(member.room for member in self.members.values())
        if room > file.seek(0, os.SEEK_END):
            raise ValueError("its members must lie one after the other, got some that overlap")
        if size > most:
            raise ValueError(f"its arrays must take at most {most} bytes, got {size}")
        check_expansion("all of it", size, room)

    def __len__(self) -> int:
        return len(self.members)

    def __iter__(self) -> Iterator[str]:
        return iter(self.members)

    def __getitem__(self, name: str) -> AnyArray:
        if name not in self.members:
            raise ValueError(f"{name} is not among its arrays")
        try:
            with self._zip.open(f"{name}.npy") as member:
                return np.asarray(np.lib.format.read_array(member, allow_pickle=False))
        except (zipfile.BadZipFile, zlib.error, EOFError) as error:
            raise ValueError(f"{name} is damaged ({error})") from None

    def _add(self, entry: zipfile.ZipInfo) -> None:
        """Check the header of a member and add it to the arrays, or to what is left out."""
        name = entry.filename.removesuffix(".npy")
        if name == entry.filename:
            self.passed_over[name] = "no array"
            return
        if entry.compress_type not in _METHODS:
            raise ValueError(
                f"{entry.filename} must be stored or deflated, got method {entry.compress_type}"
            )
        with self._zip.open(entry) as file:
            shape, dtype, head = npy_header(file)
        if dtype.kind not in _KINDS or not dtype.itemsize:
            reason = "Python objects" if dtype.hasobject else f"values of type {dtype}"
            self.passed_over[name] = reason
            return
        if head + array_bytes(shape, dtype) != entry.file_size:
            raise ValueError(
                f"{entry.filename} holds {entry.file_size} bytes, its header tells {shape} {dtype}"
            )
        if name in self.members:
            raise ValueError(f"{entry.filename} is there twice")
        self.members[name] = Member(shape, dtype, entry.file_size, entry.compress_size)


def npy_header(file: Any) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Return shape and type of the array of a ``.npy`` file, and the bytes of its header."""
    start = file.read(np.lib.format.MAGIC_LEN)
    version = np.lib.format.read_magic(io.BytesIO(start))
    width = 2 if version == (1, 0) else 4
    counted = file.read(width)
    length = int.from_bytes(counted, "little")
    # NumPy checks the length after it has read the header, which may take gigabytes.
    if length > _LONGEST_HEADER:
        raise ValueError(
            f"the header of an array must take at most {_LONGEST_HEADER} bytes, got {length}"
        )
    text = io.BytesIO(counted + file.read(length))
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(text)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(text)
    return shape, dtype, len(start) + width + length


def array_bytes(shape: tuple[int, ...], dtype: np.dtype[Any]) -> int:
    """Return the bytes of an array, in Python's integers, which do not overflow."""
    total = dtype.itemsize
    for count in shape:
        total *= count
    return total


def _check_directory(file: BinaryIO) -> None:
    """Refuse a directory of very many members, for each of which ``zipfile`` makes an object."""
    # The record at the end, of either kind, as ZipFile itself finds it.
    end = zipfile._EndRecData(file)  # type: ignore[attr-defined]
    if not end:
        raise ValueError("no archive of arrays (it has no end)")
    size = int(end[zipfile._ECD_SIZE])  # type: ignore[attr-defined]
    if size > _LARGEST_DIRECTORY:
        raise ValueError(
            f"the directory of an archive must take at most {_LARGEST_DIRECTORY} bytes, got {size}"
        )
