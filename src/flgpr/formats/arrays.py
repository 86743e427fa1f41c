"""Named arrays in other people's files behind one interface.

They are HDF5, MATLAB, NPZ, NPY, CSV, Touchstone and SigMF files, recordings and takes of motion
capture.
"""

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
from flgpr.formats.sigmf import SigmfRecording
from flgpr.formats.touchstone import touchstone_text
from flgpr.store.extras import MissingExtraError, optional
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.store.text_tables import read_text_table

SIGMF = "SigMF recording"
"""Kind of a recording in words."""
LIMIT = MAX_MEMORY
"""Largest array that is read, bytes, unless another limit is given."""
_CONVERTED = {
    b"SQLite format 3": "a ROS 2 bag (or another file) in SQLite",
    b"#ROSBAG": "a ROS 1 bag",
}
"""Beginnings of files that must be converted, and what these are."""
_CHILD = Path(__file__).with_name("child.py")
_PATIENCE = 120.0  # s
# Times the largest array that all arrays of an archive may take: they are read one by one.
_ALL_ARRAYS = 8
_PAIRS = (("real", "imag"), ("re", "im"), ("r", "i"))
"""Names of the fields of a record that is a complex number."""
_COMPLEX_PAIRS = [{*pair} for pair in _PAIRS]
_SPARE = 2**29  # bytes that a child may take besides what it reads
_MATLAB = "MATLAB_class"
"""Attribute of HDF5 arrays that MATLAB wrote, with the order of the dimensions reversed."""
_UNIT_NAMES = ("units", "unit", "UNITS")
_NUMBERS_AND_TEXT = "fciubUS"
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

    def read(self, name: str) -> NDArray[Any]:
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
        with _faults_of_parser(self.path, self.kind):
            values = _as_complex(np.asarray(self._read(name)))
        if values.dtype.kind not in _NUMBERS_AND_TEXT:
            raise ValueError(f"{self.path}: {name} must hold numbers or text, got {values.dtype}")
        return values.astype(values.dtype.newbyteorder("="), copy=False)


def open_arrays(path: str | Path, limit: int = LIMIT) -> ArrayFile:
    """Open a file of named arrays and list what it holds.

    HDF5 files, MCAP recordings and takes of Motive are known by their content; MATLAB, .npz, .npy,
    .csv, .txt, Touchstone (.s2p, ...) and SigMF (.sigmf-meta) by their ending.

    Parameters
    ----------
    path : path
        The file.
    limit : int
        Bytes that the file and each array may take; a recording is read chunk by chunk and may be
        larger.

    Returns
    -------
    ArrayFile
        The opened file.

    Raises
    ------
    ValueError
        If the file is of another kind, damaged or too large, or holds nothing.
    """
    path = existing(path)
    kind, opener = _format_of(path)
    size = path.stat().st_size
    if size > limit and opener is not _open_mcap:
        raise ValueError(
            f"{path}: a file must hold at most {limit / 1e9:g} GB, got {size / 1e9:.3g} GB"
        )

    about: list[str] = []
    notes: list[str] = []
    with _faults_of_parser(path, kind):
        infos, read = opener(path, limit, about, notes)
    if not infos and not about:
        raise ValueError(f"{path}: this {kind} holds no array")
    return ArrayFile(path, kind, {info.name: info for info in infos}, read, limit, about, notes)


@contextmanager
def _faults_of_parser(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser raises on a damaged file into one ValueError that names the file."""
    try:
        yield
    except MissingExtraError:
        raise
    except Exception as error:
        message = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(
            f"{path}: cannot be read as a {kind}: it is damaged or of another kind ({message})"
        ) from None


_Opened = tuple[list[ArrayInfo], Callable[[str], Any]]
"""The arrays of a file, and what reads one of them."""
_Opener = Callable[[Path, int, list[str], list[str]], _Opened]
"""Opens a file with a limit for its arrays, bytes.

It adds lines to what the file states, and to the notes of an import.
"""


def _format_of(path: Path) -> tuple[str, _Opener]:
    """Return the kind of a file in words, and what opens it."""
    if h5py.is_hdf5(path):
        return "HDF5 file", _open_hdf5
    with open_named(path) as file:
        head = file.read(16)
    if head.startswith(b"\x89MCAP"):
        return "MCAP recording", _open_mcap
    if is_motive(path):
        return "take of OptiTrack Motive", _open_motive
    for beginning, kind in _CONVERTED.items():
        if head.startswith(beginning):
            raise ValueError(
                f"{path}: {kind} is not read as it is: make MCAP of it, "
                f"mcap convert {path.name} OUT.mcap"
            )
    suffix = path.suffix.lower()
    if suffix == ".mcap":
        raise ValueError(
            f"{path}: an MCAP recording must begin with its signature: it is empty or damaged"
        )
    if suffix in (".h5", ".hdf5"):
        raise ValueError(
            f"{path}: an HDF5 file must begin with the HDF5 signature: "
            "it is damaged or of another kind"
        )
    for endings, kind, opener in _FORMATS:
        if re.fullmatch(endings, suffix):
            return kind, opener
    if suffix == ".zip":
        raise ValueError(f"{path}: a zip holds other files: unzip it, and give one of them")
    if suffix in (".sigmf", ".sigmf-collection"):
        raise ValueError(
            f"{path}: an archive or a collection of SigMF names other files: unpack it "
            "(tar -xf), and give the .sigmf-meta of one recording, or of several"
        )
    # Recordings of radars are no arrays, but what a user may have meant.
    from flgpr.formats.gpr_files import READERS

    raise ValueError(
        f"{path}: the format must be HDF5, MATLAB, MCAP, CPHD, .npz, .npy, .csv, .txt or "
        "Touchstone (.s2p), SigMF (.sigmf-meta), or a recording of a commercial radar "
        f"({', '.join(READERS)}), got the ending {suffix!r}"
    )


def _in_child(library: str, *arguments: object, stdout: Any = subprocess.DEVNULL) -> None:
    """Let ``child.py`` read a file: damaged ones can crash the libraries or keep them busy."""
    # -P keeps the script's folder, with modules of this package, off the path of imports.
    command = [sys.executable, "-P", str(_CHILD), library.lower(), *map(str, arguments)]
    # Every thread of the linear algebra takes address space, which is bounded.
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    try:
        process = subprocess.run(  # noqa: S603
            command,
            stdout=stdout,
            stderr=subprocess.PIPE,
            env=environment,
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ValueError(
            f"the {library} library did not come to an end with it in {_PATIENCE:g} s"
        ) from None
    if process.returncode == 0:
        return
    errors = process.stderr.decode(errors="replace").strip().splitlines()
    if errors and process.returncode > 0:
        raise ValueError(errors[-1])
    raise ValueError(f"the {library} library crashes on it")


def _open_mcap(path: Path, limit: int, about: list[str], notes: list[str]) -> _Opened:
    """Open a recording."""
    recording = Recording(path, limit, notes)
    about += recording.lines
    return [ArrayInfo(*array) for array in recording.arrays], recording.read


def _open_motive(path: Path, _: int, about: list[str], *_notes: list[str]) -> _Opened:
    """Open a take of motion capture."""
    arrays, units, lines = read_motive(path)
    about += lines
    return _from_memory(arrays, units)


def _open_sigmf(path: Path, limit: int, about: list[str], notes: list[str]) -> _Opened:
    """Open a SigMF recording."""
    recording = SigmfRecording(path, limit, notes)
    about += recording.lines
    return [ArrayInfo(*array) for array in recording.arrays], recording.read


def _open_hdf5(path: Path, _: int, about: list[str], *_notes: list[str]) -> _Opened:
    """Open an HDF5 file, after a child process has read it."""
    damaged = _damaged_in_hdf5(path)
    infos: list[ArrayInfo] = []
    visited: set[str] = set()

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        visited.add(repr(name))
        if item.shape is None:
            about.append(f"{name}: empty")
            return
        reason = damaged.get(repr(name)) or _why_unreadable(item.dtype)
        if reason:
            about.append(f"{name}: not read: {reason}")
        else:
            infos.append(_info_of(name, item))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    for name, reason in damaged.items():
        if name not in visited:
            about.append(f"{name[1:-1]}: not read: {reason}")

    def read(name: str) -> Any:
        with h5py.File(path, "r") as file:
            return _read_hdf5(name, file[name])

    return infos, read


def _damaged_in_hdf5(path: Path) -> dict[str, str]:
    """Return why arrays of an HDF5 file cannot be read, by the ``repr`` of their names."""
    with tempfile.TemporaryFile() as file:
        _in_child("HDF5", path, stdout=file)
        file.seek(0)
        lines = file.read().decode(errors="replace").splitlines()
    return dict(line.split("\t", 1) for line in lines)


def _info_of(name: str, item: Any) -> ArrayInfo:
    """Return what is known of an HDF5 array."""
    shape = item.shape[::-1] if _MATLAB in item.attrs else item.shape
    kind = "text" if h5py.check_string_dtype(item.dtype) else str(item.dtype)
    return ArrayInfo(name, tuple(map(int, shape)), kind, _unit_of(item))


def _read_hdf5(name: str, item: Any) -> Any:
    """Read the values of an HDF5 array."""
    # Such an array would have HDF5 open any file of the user's that this one names.
    if item.is_virtual or item.external is not None:
        raise ValueError(f"{name} must hold its numbers itself, they lie in other files")
    check_expansion(name, item.nbytes, item.id.get_storage_size())
    values = item[()]
    if h5py.check_string_dtype(item.dtype):
        values = np.asarray(item.asstr(errors="replace")[()], dtype=np.str_)
    return np.asarray(values).T if _MATLAB in item.attrs else values


def _unit_of(item: Any) -> str:
    """Return the unit that an attribute of an HDF5 array states.

    It is empty if there is none, or none that can be read.
    """
    for name in _UNIT_NAMES:
        with suppress(KeyError, OSError, TypeError, ValueError, RuntimeError):
            unit = item.attrs[name]
            return unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
    return ""


def _why_unreadable(kind: np.dtype[Any]) -> str:
    """Return why values of a type of HDF5 are neither numbers nor text; empty if they are."""
    if h5py.check_string_dtype(kind):
        return ""
    if h5py.check_ref_dtype(kind):
        return "references to other parts of the file"
    if h5py.check_vlen_dtype(kind) is not None:
        return "rows of different lengths"
    if kind.names:
        are_numbers = all(kind[name].kind in "fiu" for name in kind.names)
        if are_numbers and {name.lower() for name in kind.names} in _COMPLEX_PAIRS:
            return ""
        return f"records of {', '.join(kind.names)}"
    return "" if kind.kind in _NUMBERS_AND_TEXT else f"values of type {kind}"


def _open_mat(path: Path, limit: int, about: list[str], *_notes: list[str]) -> _Opened:
    """Open a MATLAB file, which a child process has read."""
    arrays: dict[str, NDArray[Any]] = {}
    with tempfile.TemporaryFile() as file:
        _in_child("MATLAB", path, limit, _SPARE, stdout=file)
        end = file.seek(0, os.SEEK_END)
        file.seek(0)
        about += map(str, np.load(file, allow_pickle=False).tolist())
        while file.tell() < end:
            name = str(np.load(file, allow_pickle=False))
            arrays[name] = np.load(file, allow_pickle=False)
    return _from_memory(arrays)


def _open_npz(path: Path, limit: int, about: list[str], *_notes: list[str]) -> _Opened:
    """Open an archive of NumPy."""
    with open_named(path) as file:
        archive = Archive(file, _ALL_ARRAYS * limit)
    for name, reason in archive.passed_over.items():
        about.append(f"{name}: not read: {reason}")
    infos = []
    for name, member in archive.members.items():
        infos.append(ArrayInfo(name, member.shape, str(member.dtype)))

    def read(name: str) -> Any:
        with open_named(path) as file:
            return Archive(file, _ALL_ARRAYS * limit)[name]

    return infos, read


def _open_npy(path: Path, *_: Any) -> _Opened:
    """Open a single array of NumPy."""
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
    """Open a table of text."""
    return _from_memory(read_text_table(path, notes))


def _from_memory(arrays: dict[str, NDArray[Any]], units: dict[str, str] | None = None) -> _Opened:
    """Return arrays that are read already, with their units."""
    infos = []
    for name, values in arrays.items():
        unit = "" if units is None else units.get(name, "")
        infos.append(ArrayInfo(name, values.shape, str(values.dtype), unit))
    return infos, arrays.__getitem__


def _open_touchstone(path: Path, _: int, _about: list[str], notes: list[str]) -> _Opened:
    """Open a Touchstone file."""
    library = optional("skrf", "vna")
    text = touchstone_text(path, notes)
    network = library.Network()
    network.read_touchstone(text)  # given a file, the class itself tries whether it is a pickle
    parameters = np.asarray(network.s)
    frequency = np.asarray(network.f, dtype=np.float64)
    if text.tones not in (0, frequency.size):
        raise ValueError(
            f"it holds {text.tones} tones, of which the scikit-rf library reads {frequency.size}"
        )
    arrays = {"frequency": frequency, "s": parameters}
    ports = network.nports
    separator = "" if ports < 10 else "_"
    for row in range(ports):
        for column in range(ports):
            arrays[f"s{row + 1}{separator}{column + 1}"] = parameters[:, row, column]
    units = dict.fromkeys(arrays, "1") | {"frequency": "Hz"}
    return _from_memory(arrays, units)


_FORMATS: tuple[tuple[str, str, _Opener], ...] = (
    (r"\.mat", "MATLAB file", _open_mat),
    (r"\.npz", "NumPy archive", _open_npz),
    (r"\.npy", "NumPy array", _open_npy),
    (r"\.(csv|txt|dat|tsv)", "table of numbers", _open_text),
    (r"\.(s\d+p|ts)", "Touchstone file", _open_touchstone),
    (r"\.sigmf-(meta|data)", SIGMF, _open_sigmf),
)


def _as_complex(values: NDArray[Any]) -> NDArray[Any]:
    """Return records of a real and an imaginary part as complex numbers; others as they are."""
    names = values.dtype.names
    if not names:
        return values
    name_of = {name.lower(): name for name in names}
    for real, imaginary in _PAIRS:
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
