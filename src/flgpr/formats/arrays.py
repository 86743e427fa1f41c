"""Named arrays in other people's files behind one interface.

HDF5, MATLAB, NPZ, NPY and CSV files are read here, other formats by their readers
(:mod:`flgpr.formats.reader`).
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from flgpr.archive import Archive, array_bytes, npy_header
from flgpr.budget import Budget
from flgpr.door import check_expansion, open_named
from flgpr.formats.array_file import (
    DAMAGED,
    LIMIT,
    NUMBERS_AND_TEXT,
    PAIRS,
    ArrayFile,
    ArrayInfo,
    Opened,
    faults_of_parser,
    from_memory,
)
from flgpr.formats.child import LARGEST_PROBED, oversized_chunks
from flgpr.formats.reader import reader_of, readers
from flgpr.store.files import existing
from flgpr.store.text_tables import read_text_table
from flgpr.types import Arrays, Notes

_CHILD = Path(__file__).with_name("child.py")
_PATIENCE = 120.0  # s
# Times the largest array that all arrays of an archive may take: they are read one by one.
_ALL_ARRAYS = 8
_COMPLEX_PAIRS = [{*pair} for pair in PAIRS]
_MOST_SAVED = 1000  # arrays in one file of NumPy
_SPARE = 2**29  # bytes that a child may take besides what it reads
_MATLAB = "MATLAB_class"
"""Attribute of HDF5 arrays that MATLAB wrote, with the order of the dimensions reversed."""
_UNIT_NAMES = ("units", "unit", "UNITS")


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
    is_hdf5 = h5py.is_hdf5(path)
    reader = None if is_hdf5 else reader_of(path, "arrays")
    if reader is None or not reader.is_stream:
        size = path.stat().st_size
        if size > limit:
            raise ValueError(
                f"{path}: a file must hold at most {limit / 1e9:g} GB, got {size / 1e9:.3g} GB"
            )
    if reader is not None:
        with faults_of_parser(path, f"a {reader.kind}: {DAMAGED}"):
            opened = reader.open_arrays(path, limit)
    else:
        kind, opener = ("HDF5 file", _open_hdf5) if is_hdf5 else _format_of(path)
        about: list[str] = []
        notes: Notes = []
        with faults_of_parser(path, f"a {kind}: {DAMAGED}"):
            infos, read = opener(path, limit, about, notes)
        opened = ArrayFile(path, kind, infos, read, limit, about, notes)
    if not opened.arrays and not opened.about:
        raise ValueError(f"{path}: this {opened.kind} holds no array")
    return opened


_Opener = Callable[[Path, int, list[str], list[str]], Opened]
"""Opens a file with a limit for its arrays, bytes.

It adds lines to what the file states, and to the notes of an import.
"""


def _format_of(path: Path) -> tuple[str, _Opener]:
    """Return the kind of a file in words, and what opens it."""
    suffix = path.suffix.lower()
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
    others = ", ".join(reader.names for reader in readers() if reader.names)
    raise ValueError(
        f"{path}: the format must be HDF5, MATLAB, .npz, .npy, .csv, .txt"
        f"{others and f', {others}'}, got the ending {suffix!r}"
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


def _open_hdf5(path: Path, _: int, about: list[str], *_notes: list[str]) -> Opened:
    """Open an HDF5 file, after a child process has read it."""
    # Why arrays cannot be read, by the ``repr`` of their names.
    with tempfile.TemporaryFile() as file:
        _in_child("HDF5", path, stdout=file)
        file.seek(0)
        lines = file.read().decode(errors="replace").splitlines()
    damaged = dict(line.split("\t", 1) for line in lines)
    infos: dict[str, ArrayInfo] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        reason = damaged.pop(repr(name), "")
        if item.shape is None:
            about.append(f"{name}: empty")
            return
        reason = reason or _why_unreadable(item.dtype)
        if reason:
            about.append(f"{name}: not read: {reason}")
            return
        shape = item.shape[::-1] if _MATLAB in item.attrs else item.shape
        kind = "text" if h5py.check_string_dtype(item.dtype) else str(item.dtype)
        unit = ""
        for attribute in reversed(_UNIT_NAMES):  # the first that can be read
            with suppress(KeyError, OSError, TypeError, ValueError, RuntimeError):
                stated = item.attrs[attribute]
                is_bytes = isinstance(stated, bytes)
                unit = stated.decode(errors="replace") if is_bytes else str(stated)
        infos[name] = ArrayInfo(name, tuple(map(int, shape)), kind, unit)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    about += [f"{name[1:-1]}: not read: {reason}" for name, reason in damaged.items()]

    def read(name: str) -> Any:
        with h5py.File(path, "r") as file:
            return _read_hdf5(name, file[name])

    return infos, read


def _read_hdf5(name: str, item: Any) -> Any:
    """Read the values of an HDF5 array."""
    # Such an array would have HDF5 open any file of the user's that this one names.
    if item.is_virtual or item.external is not None:
        raise ValueError(f"{name} must hold its numbers itself, they lie in other files")
    check_dataset(name, item)
    is_text = h5py.check_string_dtype(item.dtype)
    if is_text and item.size >= LARGEST_PROBED:
        raise ValueError(f"{name} must hold fewer than {LARGEST_PROBED} texts, got {item.size}")
    values = item[()]
    if is_text:
        texts = item.asstr(errors="replace")[()]
        # All get the room of the longest, four bytes for each character.
        longest = max((len(text) for text in np.ravel(texts)), default=0)
        Budget(f"the texts {name}").spend(4 * longest * item.size)
        values = np.asarray(texts, dtype=np.str_)
    return np.asarray(values).T if _MATLAB in item.attrs else values


def check_dataset(name: str, item: Any) -> None:
    """Refuse an array of HDF5 that would take far more memory than its file, before it is read.

    A chunk is unpacked as a whole, however few of its values the array has.

    Parameters
    ----------
    name : str
        The array, for errors.
    item : h5py.Dataset
        The array.

    Raises
    ------
    ValueError
        If its numbers or one of its chunks would expand too far.
    """
    check_expansion(name, item.nbytes, item.id.get_storage_size())
    reason = oversized_chunks(item)
    if reason:
        raise ValueError(f"{name} cannot be read: {reason}")


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
        is_complex = {name.lower() for name in kind.names} in _COMPLEX_PAIRS
        return "" if are_numbers and is_complex else f"records of {', '.join(kind.names)}"
    return "" if kind.kind in NUMBERS_AND_TEXT else f"values of type {kind}"


def _open_mat(path: Path, limit: int, about: list[str], *_notes: list[str]) -> Opened:
    """Open a MATLAB file, which a child process has read."""
    arrays: Arrays = {}
    with tempfile.TemporaryFile() as file:
        _in_child("MATLAB", path, limit, _SPARE, stdout=file)
        end = file.seek(0, os.SEEK_END)
        file.seek(0)
        about += map(str, np.load(file, allow_pickle=False).tolist())
        while file.tell() < end:
            name = str(np.load(file, allow_pickle=False))
            arrays[name] = np.load(file, allow_pickle=False)
    return from_memory(arrays)


def _open_npz(path: Path, limit: int, about: list[str], *_notes: list[str]) -> Opened:
    """Open an archive of NumPy."""
    with open_named(path) as file:
        archive = Archive(file, _ALL_ARRAYS * limit)
    about += [f"{name}: not read: {reason}" for name, reason in archive.passed_over.items()]
    infos = {
        name: ArrayInfo(name, member.shape, str(member.dtype))
        for name, member in archive.members.items()
    }

    def read(name: str) -> Any:
        with open_named(path) as file:
            return Archive(file, _ALL_ARRAYS * limit)[name]

    return infos, read


def _open_npy(path: Path, _: int, about: list[str], *_notes: list[str]) -> Opened:
    """Open the arrays of a file of NumPy: one, or several that were saved one after the other."""
    arrays: dict[str, ArrayInfo] = {}
    begins: dict[str, int] = {}
    with open_named(path) as file:
        size = file.seek(0, os.SEEK_END)
        end = 0
        while end < size or not arrays:
            file.seek(end)
            shape, dtype, head = npy_header(file)
            name = f"array_{len(arrays) + 1}" if arrays else "array"
            arrays[name] = ArrayInfo(name, shape, str(dtype))
            begins[name] = end
            end += head + array_bytes(shape, dtype)
            if end > size or len(arrays) > _MOST_SAVED:
                raise ValueError(f"the file holds {size} bytes, its header tells {shape} {dtype}")
    if len(arrays) > 1:
        about.append(f"{len(arrays)} arrays, saved one after the other")

    def read(name: str) -> Any:
        with open_named(path) as file:
            file.seek(begins[name])
            return np.load(file, allow_pickle=False)

    return arrays, read


_FORMATS: tuple[tuple[str, str, _Opener], ...] = (
    (r"\.mat", "MATLAB file", _open_mat),
    (r"\.npz", "NumPy archive", _open_npz),
    (r"\.npy", "NumPy array", _open_npy),
    (
        r"\.(csv|txt|dat|tsv)",
        "table of numbers",
        lambda path, _, __, notes: from_memory(read_text_table(path, notes)),
    ),
)
