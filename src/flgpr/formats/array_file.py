"""A file of named arrays: what it holds, and how one of them is read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.model.printable import in_one_line
from flgpr.store.extras import MissingExtraError
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.types import AnyArray, Arrays

LIMIT = MAX_MEMORY
"""Largest array that is read, bytes, unless another limit is given."""
PAIRS = (("real", "imag"), ("re", "im"), ("r", "i"))
"""Names of the fields of a record that is a complex number."""
DAMAGED = "it is damaged or of another kind"
"""What is to be said of a file at whose arrays a parser fails."""
NUMBERS_AND_TEXT = "fciubUS"
"""Kinds of NumPy types that are read."""


@dataclass(frozen=True)
class ArrayInfo:
    """What is known of an array before it is read."""

    #: name inside the file; members of groups and structures as ``group/name`` or ``struct.name``
    name: str
    shape: tuple[int, ...]  #: its shape, as the program that wrote the file shows it
    dtype: str  #: type of its values
    unit: str = ""  #: unit the file itself states, empty if none


@dataclass
class ArrayFile:
    """An opened file of named arrays."""

    path: Path
    kind: str  #: its format in words
    arrays: dict[str, ArrayInfo]  #: name -> :class:`ArrayInfo`
    _read: Callable[[str], Any] = field(repr=False)
    limit: int = LIMIT
    about: list[str] = field(default_factory=list)  #: what else the file states, a line each
    #: what was assumed, changed or left out so far, in words, for the notes of an import
    notes: list[str] = field(default_factory=list)
    signal: str = ""  #: the array that is certainly the signal, if the format has one
    #: beginning of the names of arrays that say again what others hold
    repeated: str = ""

    def read(self, name: str) -> AnyArray:
        """Read one of ``arrays``.

        Parameters
        ----------
        name : str
            The array.

        Returns
        -------
        ndarray
            Its values in the machine's byte order.

        Raises
        ------
        ValueError
            If there is no such array, or it is too large or damaged.
        """
        if name not in self.arrays:
            known = ", ".join(list(self.arrays)[:12]) or "no array"
            raise ValueError(f"{self.path}: variable must be one of {known}, got {name!r}")
        info = self.arrays[name]
        count = int(np.prod([float(size) for size in info.shape]))
        size = count * _width(info.dtype)
        if size > self.limit:
            raise ValueError(
                f"{self.path}: {name} must hold at most {self.limit / 1e9:g} GB, "
                f"got shape {info.shape} of {info.dtype}, {size / 1e9:.3g} GB"
            )
        with faults_of_parser(self.path, f"a {self.kind}: {DAMAGED}"):
            values = _as_complex(np.asarray(self._read(name)))
        if values.dtype.kind not in NUMBERS_AND_TEXT:
            raise ValueError(f"{self.path}: {name} must hold numbers or text, got {values.dtype}")
        return values.astype(values.dtype.newbyteorder("="), copy=False)


@contextmanager
def faults_of_parser(
    path: Path, what: str, passed: tuple[type[Exception], ...] = ()
) -> Iterator[None]:
    """Turn whatever a parser raises on a damaged file into one ValueError that names the file.

    Errors that are ``passed`` stay as they are, as those of a package that is missing do.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, (MissingExtraError, *passed)):
            raise
        raise ValueError(f"{path}: cannot be read as {what}: {in_one_line(error, 240)}") from None


Opened = tuple[dict[str, ArrayInfo], Callable[[str], Any]]
"""The arrays of a file, and what reads one of them."""


def from_memory(arrays: Arrays, units: dict[str, str] | None = None) -> Opened:
    """Return arrays that are read already, with their units."""
    infos = {}
    for name, values in arrays.items():
        unit = "" if units is None else units.get(name, "")
        infos[name] = ArrayInfo(name, values.shape, str(values.dtype), unit)
    return infos, arrays.__getitem__


def _as_complex(values: AnyArray) -> AnyArray:
    """Return records of a real and an imaginary part as complex numbers; others as they are."""
    names = values.dtype.names
    if not names:
        return values
    name_of = {name.lower(): name for name in names}
    for real, imaginary in PAIRS:
        if set(name_of) == {real, imaginary}:
            first = values[name_of[real]]
            second = values[name_of[imaginary]]
            # A unit of the same precision keeps single precision single.
            unit = np.asarray(1j)
            kind = np.complex64 if first.dtype.itemsize == 4 else np.complex128
            return first + unit.astype(kind) * second
    raise ValueError(f"the array must be of numbers, got a record of {', '.join(names)}")


def _width(dtype: str) -> int:
    """Return the bytes of a value of a type, at least 1; 16 for text."""
    try:
        return np.dtype(dtype).itemsize or 1
    except TypeError:
        return 16
