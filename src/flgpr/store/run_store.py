"""The run store: Zarr v3, one chunk per scan, committed by a manifest of SHA-256 digests.

The manifest is written last. Zarr itself reads a missing chunk as fill values, which a radar run
must never do. Runs are therefore read here without the Zarr library, by the manifest, which lists
every chunk and its digest; plain bytes in chunks are also read faster so.
:mod:`flgpr.store.run_writer` writes stores.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any, Literal

import google_crc32c
import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from flgpr.door import MOST_CHECKED, MOST_JSON, DoorError, Folder, Listed
from flgpr.json_text import canonical_json, parse_json, sha256
from flgpr.model import AXES, POSE_COMPONENTS, check_run
from flgpr.model.constants import DIMS, VARIABLE_ATTRS
from flgpr.model.run import described
from flgpr.store.files import taken_for
from flgpr.store.store_layout import MAX_MEMORY, ArrayLayout, check_declared
from flgpr.types import AnyArray

FORMAT = "flgpr-run"
VERSION = 1
MANIFEST = "commit.json"
CHECKSUM_BYTES = 4
"""Bytes of the CRC-32C after the numbers of a chunk."""
_VARIABLES = ("signal", "valid", "tx_position", "rx_position", "pose")


class RunStoreError(ValueError):
    """A run store is incomplete, altered or not a run store at all."""


class CommittedFiles:
    """The files of a run store, of which only those that the manifest lists are read."""

    def __init__(self, root: Path, files: dict[str, dict[str, Any]]) -> None:
        self.root = root
        self.files = files
        listed = {}
        for name, entry in files.items():
            listed[name] = Listed((entry["sha256"],), (entry["bytes"],))
        self._folder = Folder(root, listed)

    def check_sizes(self) -> None:
        """Check that every file is there, regular and of its size, before any is read."""
        for key in self.files:
            with self._naming_store(key):
                self._folder.check_size(key)

    def read(self, key: str) -> bytes:
        """Read a file that the manifest lists, and check its digest."""
        with self._naming_store(key):
            return self._folder.read(key, MOST_CHECKED)

    @contextmanager
    def _naming_store(self, key: str) -> Iterator[None]:
        """Turn an error of reading a file into a RunStoreError that names the store."""
        try:
            yield
        except OSError as error:
            raise RunStoreError(
                f"{self.root}: {key} was committed but cannot be read ({error.strerror})"
            ) from None
        except DoorError as error:
            raise RunStoreError(f"{error}: the store is truncated or altered") from None


class _StoredArray(BackendArray):
    """An array of a run store for xarray: read chunk by chunk, each checked when it is needed."""

    def __init__(self, files: CommittedFiles, name: str, layout: ArrayLayout) -> None:
        self._files = files
        self._name = name
        self._layout = layout
        self.shape = layout.shape
        self.dtype = np.dtype(layout.dtype)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER, self.select
        )

    def select(self, key: tuple[Any, ...]) -> AnyArray:
        """Return what ``key`` selects, a number, slice or list of numbers per dimension."""
        selected = [np.arange(length)[index] for length, index in zip(self.shape, key, strict=True)]
        positions = [np.atleast_1d(axis) for axis in selected]
        lengths = self._layout.chunks
        chunk_numbers = []
        for axis, length in zip(positions, lengths, strict=True):
            chunk_numbers.append(np.unique(axis // length).tolist())
        out = np.empty([axis.size for axis in positions], self.dtype)
        for number in product(*chunk_numbers):
            in_output = []
            in_chunk = []
            for axis, length, k in zip(positions, lengths, number, strict=True):
                is_in_chunk = axis // length == k
                in_output.append(np.flatnonzero(is_in_chunk))
                in_chunk.append(axis[is_in_chunk] - k * length)
            chunk = self._chunk(number)
            out[np.ix_(*in_output)] = chunk[np.ix_(*in_chunk)]
        # An axis that a single number was taken of is dropped, as NumPy does.
        return out.reshape([length for axis in selected for length in axis.shape])

    def _chunk(self, number: tuple[int, ...]) -> AnyArray:
        """Read one chunk and check its checksum, if it has one."""
        key = "/".join([self._name, "c", *map(str, number)])
        layout = self._layout
        data = self._files.read(key)
        size = self.dtype.itemsize * math.prod(layout.chunks)
        numbers = data[:size]
        checksum = data[size:]
        if checksum and google_crc32c.value(numbers) != int.from_bytes(checksum, "little"):
            raise RunStoreError(f"{self._files.root}: {key} has a wrong checksum")
        byte_order: Literal["<", ">"] = ">" if layout.big_endian else "<"
        values = np.frombuffer(numbers, self.dtype.newbyteorder(byte_order))
        return values.reshape(layout.chunks)


def open_run(path: str | Path, max_memory: int = MAX_MEMORY) -> xr.Dataset:
    """Open a run; its signal is read scan by scan when it is asked for, and verified each time.

    Shapes, chunks, types and sizes are checked before anything is decoded, so that an untrusted
    store may be opened.

    Parameters
    ----------
    path : str or Path
        Folder of the store.
    max_memory : int
        Memory that the run's small arrays and a few of its scans may take, bytes.

    Returns
    -------
    Dataset
        The run, see :func:`flgpr.model.make_run`.

    Raises
    ------
    FileNotFoundError
        If there is no folder.
    RunStoreError
        If the store was not committed, is damaged, leads out of its folder or breaks a rule.
        Reading a scan whose file has changed since raises it, too.
    """
    root = Path(path)
    manifest = read_manifest(root)
    files = CommittedFiles(root, manifest["files"])
    files.check_sizes()
    try:
        run = _decode(files, max_memory)
    except RunStoreError:
        raise
    except ValueError as error:
        raise RunStoreError(f"{root}: {error}") from None
    except (KeyError, TypeError, AttributeError) as error:
        raise RunStoreError(f"{root}: not a run store ({error})") from error
    if manifest["scans"] != run.sizes["scan"]:
        raise RunStoreError(
            f"{root}: {manifest['scans']} scans were committed, the arrays hold {run.sizes['scan']}"
        )
    return run


def _decode(files: CommittedFiles, max_memory: int) -> xr.Dataset:
    """Return the run of committed files, its signal unread and all other arrays in memory."""
    layouts = check_declared(files.files, files.read, max_memory)
    attrs = parse_json(files.read("zarr.json"))["attributes"]
    arrays: dict[str, tuple[tuple[str, ...], Any]] = {}
    for name, layout in layouts.items():
        stored = _StoredArray(files, name, layout)
        if name == "signal":
            lazy = indexing.LazilyIndexedArray(stored)
            copied = indexing.CopyOnWriteArray(lazy)  # type: ignore[arg-type]
            cached = indexing.MemoryCachedArray(copied)  # type: ignore[no-untyped-call]
            arrays[name] = (DIMS[name], cached)
        else:
            everything = (slice(None),) * len(stored.shape)
            arrays[name] = (DIMS[name], stored.select(everything))
    coords = {
        "frequency": arrays["frequency"],
        "polarization": ("polarization", [str(label) for label in attrs["polarization"]]),
        "time": arrays["time"],
        "axis": ("axis", list(AXES)),
        "component": ("component", list(POSE_COMPONENTS)),
    }
    variables = {name: arrays[name] for name in _VARIABLES}
    run = xr.Dataset(variables, coords, dict(attrs["attrs"]))
    return described(check_run(run), VARIABLE_ATTRS)


def read_manifest(path: str | Path) -> dict[str, Any]:
    """Read and check the manifest of a run store.

    Parameters
    ----------
    path : str or Path
        Folder of the store.

    Returns
    -------
    dict
        ``format``, ``version``, ``scans`` (their number), ``files`` (name -> ``sha256`` and
        ``bytes``), and ``sha256`` of the manifest itself.

    Raises
    ------
    FileNotFoundError
        If there is no folder.
    RunStoreError
        If it holds no committed store, or the manifest is altered or of another format.
    """
    root = Path(path)
    if not root.is_dir():
        raise _no_folder_error(root)
    manifest = _read_unaltered_manifest(root)
    if manifest.get("format") != FORMAT or manifest.get("version") != VERSION:
        raise RunStoreError(
            f"{root}: format must be {FORMAT} version {VERSION}, "
            f"got {manifest.get('format')} {manifest.get('version')}"
        )
    files = manifest.get("files")
    has_count = type(manifest.get("scans")) is int
    has_entries = isinstance(files, dict) and all(map(_is_entry, files.values()))
    if not has_count or not has_entries:
        raise RunStoreError(
            f"{root}: {MANIFEST} must tell the number of scans and digest and size of every file"
        )
    return manifest


def _no_folder_error(root: Path) -> OSError | RunStoreError:
    """Return the error for a path that is no folder."""
    partial = root.with_name(root.name + ".partial")
    if partial.is_dir():
        return RunStoreError(
            f"{root}: writing stopped before the run was committed; {partial} has what was written"
        )
    reason = "which is no folder" if root.exists() else "which does not exist"
    return FileNotFoundError(f"path must be a run store, got {root}, {reason}{taken_for(root)}")


def _read_unaltered_manifest(root: Path) -> dict[str, Any]:
    """Return the manifest of a folder, checked against its own digest, byte for byte."""
    try:
        written = Folder(root).read(MANIFEST, MOST_JSON)
        manifest = parse_json(written)
        content = {name: value for name, value in manifest.items() if name != "sha256"}
        has_digest = sha256(canonical_json(content)) == manifest["sha256"]
        is_unaltered = has_digest and manifest_bytes(manifest) == written
    except FileNotFoundError:
        raise RunStoreError(
            f"{root}: no {MANIFEST}: this is no run store, or writing it was interrupted"
            f"{taken_for(root)}"
        ) from None
    except (ValueError, KeyError, AttributeError, TypeError, OSError) as error:
        raise RunStoreError(
            f"{root}: {MANIFEST} cannot be read ({error}): the store is truncated or altered"
        ) from None
    if not is_unaltered:
        raise RunStoreError(
            f"{root}: {MANIFEST} differs from what was committed: the store is altered"
        )
    return dict(manifest)


def _is_entry(entry: Any) -> bool:
    """Return whether an entry of a manifest holds a digest and a size."""
    if not isinstance(entry, dict) or not isinstance(entry.get("sha256"), str):
        return False
    return type(entry.get("bytes")) is int and entry["bytes"] >= 0


def manifest_bytes(manifest: dict[str, Any]) -> bytes:
    """Return a manifest as it is written."""
    return json.dumps(manifest, indent=1, sort_keys=True).encode()
