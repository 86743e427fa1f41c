"""Named arrays in other people's files: HDF5, MATLAB, NPZ, NPY, CSV and Touchstone behind one interface."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from flgpr.archive import Archive, array_bytes, npy_header
from flgpr.door import check_expansion, open_named
from flgpr.formats.motive import is_motive, read_motive
from flgpr.formats.recording import Recording
from flgpr.formats.touchstone import touchstone_text
from flgpr.store.extras import MissingExtraError, optional
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.store.text_tables import read_text_table

LIMIT = MAX_MEMORY
"""Largest array that is read, bytes, unless told otherwise."""
_CONVERTED = {
    b"SQLite format 3": "a ROS 2 bag (or another file) in SQLite",
    b"#ROSBAG": "a ROS 1 bag",
}
_CHILD = Path(__file__).with_name("child.py")
_PATIENCE = 120.0  # s
# times the largest array that all arrays of an archive may take: they are read one by one
_MOST_OF_ALL = 8
_PAIRS = (("real", "imag"), ("re", "im"), ("r", "i"))
"""Names of the fields of a record that is a complex number."""
_COMPLEX_PAIRS = [{*pair} for pair in _PAIRS]
_SPARE = 2**29  # bytes that a child may take beside what it reads


@dataclass(frozen=True)
class ArrayInfo:
    """What is known of an array before it is read."""

    # : name inside the file; members of groups and structures as ``group/name`` or ``struct.name``
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
    about: list[str] = field(default_factory=list)  #: what else the file tells, a line each
    #: what was assumed, changed or left out so far, in words, which an import keeps
    notes: list[str] = field(default_factory=list)

    def read(self, name: str) -> NDArray[Any]:
        """Read one of ``arrays`` in the machine's byte order; if it is too large or damaged, that is a ValueError."""
        if name not in self.arrays:
            known = ", ".join(list(self.arrays)[:12]) or "no array"
            raise ValueError(f"{self.path}: variable must be one of {known}, got {name!r}")
        info = self.arrays[name]
        size = int(np.prod([float(n) for n in info.shape])) * _width(info.dtype)
        if size > self.limit:
            raise ValueError(
                f"{self.path}: {name} must hold at most {self.limit / 1e9:g} GB, got shape {info.shape} of "
                f"{info.dtype}, {size / 1e9:.3g} GB"
            )
        with _plainly(self.path, self.kind):
            values = _as_complex(np.asarray(self._read(name)))
        if values.dtype.kind not in "fciubUS":
            raise ValueError(f"{self.path}: {name} must hold numbers or text, got {values.dtype}")
        return values.astype(values.dtype.newbyteorder("="), copy=False)


def open_arrays(path: str | Path, limit: int = LIMIT) -> ArrayFile:
    """Open a file of named arrays, of at most ``limit`` bytes each, and list what it holds.

    HDF5 files, MCAP recordings and takes of Motive are known by their content; MATLAB, .npz, .npy, .csv, .txt and
    Touchstone (.s2p, ...) by their ending. A recording is read chunk by chunk and may be larger.
    """
    path = existing(path)
    kind, opener = _format_of(path)
    if path.stat().st_size > limit and opener is not _open_mcap:
        raise ValueError(
            f"{path}: a file must hold at most {limit / 1e9:g} GB, got {path.stat().st_size / 1e9:.3g} GB"
        )
    about: list[str] = []
    notes: list[str] = []
    with _plainly(path, kind):
        infos, read = opener(path, limit, about, notes)
    if not infos and not about:
        raise ValueError(f"{path}: this {kind} holds no array")
    return ArrayFile(path, kind, {info.name: info for info in infos}, read, limit, about, notes)


@contextmanager
def _plainly(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser raises on a damaged file into one ValueError that names the file."""
    try:
        yield
    except MissingExtraError:
        raise
    except Exception as error:
        words = " ".join(str(error).split())[:200] or type(error).__name__
        told = f"{path}: cannot be read as a {kind}: it is damaged or of another kind ({words})"
        raise ValueError(told) from None


_Opened = tuple[list[ArrayInfo], Callable[[str], Any]]


_Opener = Callable[[Path, int, list[str], list[str]], _Opened]
"""Opens a file with a limit for its arrays, bytes; adds lines to what it tells, and to the notes of an import."""


def _format_of(path: Path) -> tuple[str, _Opener]:
    suffix = path.suffix.lower()
    if h5py.is_hdf5(path):
        return "HDF5 file", _open_hdf5
    with open_named(path) as file:
        head = file.read(16)
    if head.startswith(b"\x89MCAP"):
        return "MCAP recording", _open_mcap
    if is_motive(path):
        return "take of OptiTrack Motive", _open_motive
    for magic, other in _CONVERTED.items():
        if head.startswith(magic):
            raise ValueError(
                f"{path}: {other} is not read as it is: make MCAP of it, mcap convert {path.name} OUT.mcap"
            )
    if suffix == ".mcap":
        raise ValueError(
            f"{path}: an MCAP recording must begin with its signature: it is empty or damaged"
        )
    if suffix in (".h5", ".hdf5"):
        raise ValueError(
            f"{path}: an HDF5 file must begin with the HDF5 signature: it is damaged or of another kind"
        )
    for endings, kind, opener in _FORMATS:
        if re.fullmatch(endings, suffix):
            return kind, opener
    if suffix == ".zip":
        raise ValueError(f"{path}: a zip holds other files: unzip it, and give one of them")
    from flgpr.formats.gpr_files import (
        READERS,  # which are no arrays, but what a user may have meant
    )

    raise ValueError(
        f"{path}: the format must be HDF5, MATLAB, MCAP, CPHD, .npz, .npy, .csv, .txt or Touchstone (.s2p), or a "
        f"recording of a commercial radar ({', '.join(READERS)}), got the ending {suffix!r}"
    )


def _in_child(library: str, *arguments: object, stdout: Any = subprocess.DEVNULL) -> None:
    """Have ``child.py`` read a file: damaged ones can crash the libraries or make them loop for ever."""
    command = [sys.executable, "-P", str(_CHILD), library.lower(), *map(str, arguments)]
    # Every thread of the linear algebra takes address space, which is bounded.
    alone = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(  # noqa: S603
            command,
            stdout=stdout,
            stderr=subprocess.PIPE,
            env=alone,
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ValueError(
            f"the {library} library did not come to an end with it in {_PATIENCE:g} s"
        ) from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise ValueError(
            said[-1] if said and done.returncode > 0 else f"the {library} library crashes on it"
        )


def _open_mcap(path: Path, limit: int, about: list[str], notes: list[str]) -> _Opened:
    recording = Recording(path, limit, notes)
    about += recording.lines
    return [ArrayInfo(*one) for one in recording.arrays], recording.read


def _open_motive(path: Path, _: int, about: list[str], *_notes: list[str]) -> _Opened:
    arrays, units, told = read_motive(path)
    about += told
    infos = [
        ArrayInfo(name, value.shape, str(value.dtype), units.get(name, ""))
        for name, value in arrays.items()
    ]
    return infos, arrays.__getitem__


def _open_hdf5(path: Path, _: int, about: list[str], *_notes: list[str]) -> _Opened:
    with tempfile.TemporaryFile() as file:
        _in_child("HDF5", path, stdout=file)
        file.seek(0)
        damaged = dict(
            line.split("\t", 1) for line in file.read().decode(errors="replace").splitlines()
        )
    infos: list[ArrayInfo] = []
    visited: set[str] = set()

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        visited.add(repr(name))
        if item.shape is None:
            about.append(f"{name}: empty")
            return
        unreadable = damaged.get(repr(name)) or _unreadable(item.dtype)
        if unreadable:
            about.append(f"{name}: not read: {unreadable}")
            return
        shape = item.shape[::-1] if "MATLAB_class" in item.attrs else item.shape
        kind = "text" if h5py.check_string_dtype(item.dtype) else str(item.dtype)
        infos.append(ArrayInfo(name, tuple(map(int, shape)), kind, _unit_of(item)))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    about += [f"{name[1:-1]}: not read: {damaged[name]}" for name in damaged if name not in visited]

    def read(name: str) -> Any:
        # MATLAB stores its column-major arrays with the order of the dimensions turned round.
        with h5py.File(path, "r") as file:
            item = file[name]
            if item.is_virtual or item.external is not None:
                raise ValueError(f"{name} must hold its numbers itself, they lie in other files")
            check_expansion(name, item.nbytes, item.id.get_storage_size())
            values = item[()]
            if h5py.check_string_dtype(item.dtype):
                values = np.asarray(item.asstr(errors="replace")[()], dtype=np.str_)
            return np.asarray(values).T if "MATLAB_class" in item.attrs else values

    return infos, read


def _unit_of(item: Any) -> str:
    """Return the unit that an attribute of an HDF5 array states; empty if there is none, or none that can be read."""
    for key in ("units", "unit", "UNITS"):
        with suppress(KeyError, OSError, TypeError, ValueError, RuntimeError):
            unit = item.attrs[key]
            return unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
    return ""


def _unreadable(kind: np.dtype[Any]) -> str:
    """Say why values of a type of HDF5 are neither numbers nor text; empty if they are."""
    if h5py.check_string_dtype(kind):
        return ""
    if h5py.check_ref_dtype(kind):
        return "references to other parts of the file"
    if h5py.check_vlen_dtype(kind) is not None:
        return "rows of different lengths"
    if kind.names:
        numbers = all(kind[name].kind in "fiu" for name in kind.names)
        if numbers and {name.lower() for name in kind.names} in _COMPLEX_PAIRS:
            return ""
        return f"records of {', '.join(kind.names)}"
    return "" if kind.kind in "fciubUS" else f"values of type {kind}"


def _open_mat(path: Path, limit: int, about: list[str], *_notes: list[str]) -> _Opened:
    arrays: dict[str, NDArray[Any]] = {}
    with tempfile.TemporaryFile() as file:
        _in_child("MATLAB", path, limit, _SPARE, stdout=file)
        end = file.seek(0, os.SEEK_END)
        file.seek(0)
        passed_over = np.load(file, allow_pickle=False)
        about += [f"{one}" for one in passed_over.tolist()]
        while file.tell() < end:
            name = str(np.load(file, allow_pickle=False))
            arrays[name] = np.load(file, allow_pickle=False)
    return _held(arrays)


def _open_npz(path: Path, limit: int, about: list[str], *_notes: list[str]) -> _Opened:
    with open_named(path) as file:
        archive = Archive(file, _MOST_OF_ALL * limit)
    members = archive.members
    about += [f"{name}: not read: {reason}" for name, reason in archive.passed_over.items()]
    infos = [ArrayInfo(name, member.shape, str(member.dtype)) for name, member in members.items()]

    def read(name: str) -> Any:
        with open_named(path) as file:
            return Archive(file, _MOST_OF_ALL * limit)[name]

    return infos, read


def _open_npy(path: Path, *_: Any) -> _Opened:
    with open_named(path) as file:
        shape, dtype, head = npy_header(file)
        size = file.seek(0, os.SEEK_END)
    if head + array_bytes(shape, dtype) != size:
        raise ValueError(f"the file holds {size} bytes, its header tells {shape} {dtype}")

    def read(name: str) -> Any:  # noqa: ARG001
        with open_named(path) as file:
            return np.load(file, allow_pickle=False)

    return [ArrayInfo("array", shape, str(dtype))], read


def _open_text(path: Path, _: int, _about: list[str], notes: list[str]) -> _Opened:
    return _held(read_text_table(path, notes))


def _held(arrays: dict[str, NDArray[Any]]) -> _Opened:
    return [
        ArrayInfo(name, value.shape, str(value.dtype)) for name, value in arrays.items()
    ], arrays.__getitem__


def _open_touchstone(path: Path, _: int, _about: list[str], notes: list[str]) -> _Opened:
    library = optional("skrf", "vna")
    text = touchstone_text(path, notes)
    network = library.Network()
    network.read_touchstone(text)  # given a file, the class itself tries whether it is a pickle
    s = np.asarray(network.s)
    ports = network.nports
    if text.tones not in (0, len(network.f)):
        raise ValueError(
            f"it holds {text.tones} tones, of which the scikit-rf library reads {len(network.f)}"
        )
    join = "" if ports < 10 else "_"
    arrays = {"frequency": np.asarray(network.f, dtype=np.float64), "s": s}
    arrays |= {f"s{a + 1}{join}{b + 1}": s[:, a, b] for a in range(ports) for b in range(ports)}
    infos = [
        ArrayInfo(name, v.shape, str(v.dtype), "Hz" if name == "frequency" else "1")
        for name, v in arrays.items()
    ]
    return infos, arrays.__getitem__


_FORMATS: tuple[tuple[str, str, _Opener], ...] = (
    (r"\.mat", "MATLAB file", _open_mat),
    (r"\.npz", "NumPy archive", _open_npz),
    (r"\.npy", "NumPy array", _open_npy),
    (r"\.(csv|txt|dat|tsv)", "table of numbers", _open_text),
    (r"\.(s\d+p|ts)", "Touchstone file", _open_touchstone),
)


def _as_complex(values: NDArray[Any]) -> NDArray[Any]:
    names = values.dtype.names
    if not names:
        return values
    low = {name.lower(): name for name in names}
    for real, imaginary in _PAIRS:
        if set(low) == {real, imaginary}:
            first = values[low[real]]
            second = values[low[imaginary]]
            return (
                first
                + np.asarray(1j).astype(
                    np.complex64 if first.dtype.itemsize == 4 else np.complex128
                )
                * second
            )
    raise ValueError(f"the array must be of numbers, got a record of {', '.join(names)}")


def _width(dtype: str) -> int:
    try:
        return np.dtype(dtype).itemsize or 1
    except TypeError:
        return 16
