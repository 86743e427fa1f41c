"""One file of named arrays and words in JSON, which proves itself: models, snapshots, and what is kept of long work.

A line with the length and the SHA-256 of a JSON head, the head, and the arrays' bytes. The head holds the words, and
every array's type, shape, place and SHA-256, so that arrays can be read one by one and each is checked when it is.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from flgpr.io.files import canonical_json, sha256, writing

PARTIAL = ".partial"
_KINDS, _ALIGN = "biufcU", 64
_LONGEST_HEAD = 2**26


class BundleError(ValueError):
    """A file is no bundle, or damaged."""


def write_bundle(
    path: Path, arrays: Mapping[str, NDArray[Any]], about: Mapping[str, Any] | None = None, lasting: bool = False
) -> int:
    """Write arrays of numbers, booleans or text, and words, to a file that appears whole or not at all; give its bytes.

    With ``lasting`` it is on the disk before it appears; else what a crash of the machine tears is found out when read.
    """
    listed: list[dict[str, Any]] = []
    place, held = 0, []
    for name, value in arrays.items():
        value = np.asarray(value, order="C")
        if value.dtype.kind not in _KINDS:
            raise ValueError(f"{name} must hold numbers, booleans or text, got {value.dtype}")
        data = value.reshape(-1).view(np.uint8)
        digest = hashlib.sha256(data.data).hexdigest()
        entry = {"name": name, "dtype": value.dtype.str, "shape": list(value.shape), "at": place, "sha256": digest}
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
    """The arrays of a file of :func:`write_bundle`, read and checked when first asked for, and its words, ``about``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._kept: dict[str, NDArray[Any]] = {}
        try:
            with path.open("rb") as file:
                self.about, self._head, self._start = _read_head(file)
                size = file.seek(0, os.SEEK_END)
            ends = [one["at"] + -(-_bytes(one) // _ALIGN) * _ALIGN for one in self._head.values()]
            if size != self._start + max(ends, default=0):
                raise ValueError(f"{size} bytes of {self._start + max(ends, default=0)}")
        except FileNotFoundError:
            raise
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
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
        """Read every array and keep none; a damaged one is a BundleError."""
        for name, one in self._head.items():
            self._read(name, one)

    def _read(self, name: str, one: dict[str, Any]) -> NDArray[Any]:
        wanted = _bytes(one)
        with self.path.open("rb") as file:
            file.seek(self._start + one["at"])
            data = np.fromfile(file, np.uint8, wanted + -wanted % _ALIGN)
        if hashlib.sha256(data[:wanted].data).hexdigest() != one["sha256"] or data[wanted:].any():
            raise BundleError(f"{self.path}: {name} differs from what was written")
        return data[:wanted].view(np.dtype(one["dtype"])).reshape(one["shape"])


def _read_head(file: BinaryIO) -> tuple[dict[str, Any], dict[str, dict[str, Any]], int]:
    length, _, digest = file.readline(128).decode("ascii").rstrip("\n").partition(" ")
    if not length.isdecimal() or int(length) > _LONGEST_HEAD:
        raise ValueError("no head")
    text = file.read(int(length))
    if sha256(text) != digest:
        raise ValueError("the head is damaged")
    head = json.loads(text)
    arrays = {one["name"]: one for one in head["arrays"]}
    for one in arrays.values():
        if np.dtype(one["dtype"]).kind not in _KINDS or min(one["at"], *one["shape"], 0) < 0:
            raise ValueError(f"type {one['dtype']} {one['shape']} at {one['at']}")
    return dict(head["about"]), arrays, file.tell()


def _bytes(one: dict[str, Any]) -> int:
    count = np.dtype(one["dtype"]).itemsize
    for length in one["shape"]:
        count *= length
    return int(count)
