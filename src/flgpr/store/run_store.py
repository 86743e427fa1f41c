"""The run store: Zarr v3, one chunk per scan, committed by a manifest of SHA-256 digests that is written last.

Zarr reads a chunk that is not there as fill values. A radar run must never do that, so runs are read without it, by the
manifest, which knows which chunks there are and what they hold. Plain bytes in chunks are soon read, and sooner.
"""

from __future__ import annotations

import glob
import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import Any

import google_crc32c
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from flgpr.door import MOST_CHECKED, MOST_JSON, DoorError, Folder, Listed, parse_json
from flgpr.model import AXES, POSE_COMPONENTS, check_run, make_run
from flgpr.model.run import check_poses
from flgpr.store.files import (
    canonical_json,
    replace_folder,
    replaced_by,
    sha256,
    sync_file,
    write_whole,
)
from flgpr.store.journal import (
    JOURNAL,
    Journal,
    JournalError,
    OtherRunError,
    WrittenScan,
    difference,
)
from flgpr.store.outputs import tell_finished
from flgpr.store.store_layout import DIMS, MAX_MEMORY, Layout, check_declared

FORMAT = "flgpr-run"
VERSION = 1
_COMMIT = "commit.json"
_CRC = 4  # bytes of a checksum after a chunk
MADE_OF = "made-of.json"
"""What a store's scans depend on, kept beside its manifest, so that the call that made it knows it again."""
_AHEAD = 64  # scans by which the array grows: its description is written anew each time
_VARIABLES = ("signal", "valid", "tx_position", "rx_position", "pose")


class RunStoreError(ValueError):
    """A run store is incomplete, altered or not a run store at all."""


class RunExistsError(FileExistsError):
    """A run store is there already; ``same`` tells whether it is whole and made of the same."""

    def __init__(self, path: Path, different: str | None) -> None:
        self.same = different == ""
        if self.same:
            holds = "which is whole and holds this very run"
        else:
            holds = (
                f"which holds another run ({different})"
                if different
                else "which holds something else or a damaged store"
            )
        super().__init__(
            f"path must not exist yet, got {path}, {holds}: move it away or choose another output"
        )


class _CommittedFiles:
    """The files of a run, of which only what the commit manifest vouches for is read."""

    def __init__(self, root: Path, files: dict[str, dict[str, Any]]) -> None:
        self.root = root
        self.files = files
        listed = {
            name: Listed((entry["sha256"],), (entry["bytes"],)) for name, entry in files.items()
        }
        self._folder = Folder(root, listed)

    def check_sizes(self) -> None:
        """Check that every file is there, regular and of its size, before any is read."""
        for key in self.files:
            with self._faults(key):
                self._folder.check_size(key)

    def read(self, key: str) -> bytes | None:
        """Read one key and check it against the manifest; None if that does not list it."""
        if key not in self.files:
            return None
        with self._faults(key):
            return self._folder.read(key, MOST_CHECKED)

    @contextmanager
    def _faults(self, key: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RunStoreError(
                f"{self.root}: {key} was committed but cannot be read ({error.strerror})"
            ) from None
        except DoorError as error:
            raise RunStoreError(f"{error}: the store is truncated or altered") from None


class _StoredArray(BackendArray):
    """An array of a run as xarray reads it: chunk by chunk, each checked when it is needed."""

    def __init__(self, files: _CommittedFiles, name: str, layout: Layout) -> None:
        self._files = files
        self._name = name
        self._layout = layout
        self.shape = layout.shape
        self.dtype = np.dtype(layout.dtype)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER, self.select
        )

    def select(self, key: tuple[Any, ...]) -> NDArray[Any]:
        """Read what a number, slice or list of numbers per dimension takes."""
        wanted = [np.arange(length)[one] for length, one in zip(self.shape, key, strict=True)]
        places = [np.atleast_1d(one) for one in wanted]
        steps = self._layout.chunks
        out = np.empty([one.size for one in places], self.dtype)
        for number in product(
            *(np.unique(one // step).tolist() for one, step in zip(places, steps, strict=True))
        ):
            cells = list(zip(places, steps, number, strict=True))
            here = [np.flatnonzero(one // step == k) for one, step, k in cells]
            there = [one[one // step == k] - k * step for one, step, k in cells]
            out[np.ix_(*here)] = self._chunk(number)[np.ix_(*there)]
        return out.reshape([length for one in wanted for length in one.shape])

    def _chunk(self, number: tuple[int, ...]) -> NDArray[Any]:
        key = "/".join([self._name, "c", *map(str, number)])
        layout = self._layout
        data = self._files.read(key) or b""
        size = self.dtype.itemsize * math.prod(layout.chunks)
        if len(data) > size and google_crc32c.value(data[:size]) != int.from_bytes(
            data[size:], "little"
        ):
            raise RunStoreError(f"{self._files.root}: {key} has a wrong checksum")
        values = np.frombuffer(
            data[:size], self.dtype.newbyteorder(">" if layout.big_endian else "<")
        )
        return values.reshape(layout.chunks)


class RunWriter:
    """Write a run scan by scan; the store appears under its name only when it is whole.

    Use as a context manager: leaving it normally commits, leaving it by an exception removes what
    was written, unless it is to be resumed (``keeps``). ``len(writer)`` tells how many scans are
    there, so that a resumed run goes on::

        with RunWriter(path, *fixed, resume=True) as writer:
            for scan in range(len(writer), total):
                writer.append(signal(scan), pose[scan])

    Parameters
    ----------
    path : str or Path
        Folder to make; ``overwrite`` replaces a run that is there, else it is a RunExistsError.
    frequency, polarization, tx_position, rx_position, attrs
        As in :func:`flgpr.model.make_run`.
    resume : bool
        Go on where a writer of the same run was stopped, even by a kill, after its last good scan.
        Without it, what a stopped writer left is thrown away. Another run, or one that another
        process writes, is a RunStoreError.
    inputs : dict, optional
        What else the scans depend on (digests of input files, versions), as JSON values. Resuming
        demands the same, and a store that is whole tells by them whether it is the one that would
        be made; they are no part of the run.
    """

    def __init__(
        self,
        path: str | Path,
        frequency: ArrayLike,
        polarization: ArrayLike,
        tx_position: ArrayLike,
        rx_position: ArrayLike,
        attrs: dict[str, Any] | None = None,
        overwrite: bool = False,
        *,
        resume: bool = False,
        inputs: dict[str, Any] | None = None,
    ) -> None:
        self.path = Path(path)
        self._frequency = np.asarray(frequency, dtype=np.float64)
        self._polarization = [str(label) for label in np.atleast_1d(np.asarray(polarization))]
        self._tx = np.asarray(tx_position, dtype=np.float64)
        self._rx = np.asarray(rx_position, dtype=np.float64)
        try:
            self._attrs = json.loads(canonical_json(attrs or {}))
        except (TypeError, ValueError) as error:
            raise ValueError(f"attrs must be writable as JSON: {error}") from None
        self._shape = (len(self._polarization), len(self._tx), self._frequency.size)
        probe = np.broadcast_to(np.complex64(0), (1, *self._shape))
        # Refused at once, not when the last scan is written.
        make_run(probe, self._frequency, self._polarization, self._tx, self._rx, np.zeros((1, 6)))
        self.keeps = resume
        self._committed = False
        self._partial = self.path.with_name(self.path.name + ".partial")
        self._about = _describe(
            self._frequency, self._polarization, self._tx, self._rx, self._attrs, inputs
        )
        self._check_free(overwrite)
        try:
            self._journal = Journal(self._partial, self._about, resume)
        except JournalError as error:
            raise RunStoreError(str(error)) from error
        try:
            self._check_free(
                overwrite
            )  # another process may have committed until the journal was ours
        except FileExistsError:
            self._discard()
            raise
        self._drop_what_is_not_sure()
        for left in self._discarded():
            shutil.rmtree(left, ignore_errors=True)
        import zarr  # takes long to load, and only writing needs it

        self._group = zarr.open_group(self._partial, mode="a", zarr_format=3)
        self._signal = self._array(
            "signal", (len(self), *self._shape), (1, *self._shape), "complex64"
        )

    @classmethod
    def resumed(cls, *fixed: Any, inputs: dict[str, Any]) -> RunWriter:
        """Go on where a writer of the same run and inputs was stopped; what is left of another is thrown away."""
        try:
            return cls(*fixed, resume=True, inputs=inputs)
        except RunStoreError as error:
            if not isinstance(error.__cause__, OtherRunError):
                raise
        writer = cls(
            *fixed, inputs=inputs
        )  # empties what the other run left, with the journal in hand
        writer.keeps = True
        return writer

    def __len__(self) -> int:
        return len(self._journal.scans)

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: object
    ) -> None:
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            error.filename = str(self.path)
        try:
            if kind is None:
                self.commit()
        finally:
            if self._committed or (self.keeps and len(self)):
                self._journal.close()
            else:
                self._discard()

    def append(self, signal: ArrayLike, pose: ArrayLike, time: float = float("nan")) -> None:
        """Write one scan by the rules of ``make_run``: field (polarization, pair, frequency), pose, time if known."""
        block = np.asarray(signal, dtype=np.complex64)
        if block.shape != self._shape:
            raise ValueError(
                f"signal must have the shape (polarization, pair, frequency) {self._shape}, got {block.shape}"
            )
        place = check_poses(np.asarray(pose)[None], 1)[0]
        count = len(self)
        if math.isinf(time) or (count and time < self._journal.scans[-1].time):
            before = f" after {self._journal.scans[-1].time:g}" if count else ""
            raise ValueError(
                f"time must be finite, or NaN, and not decrease from scan to scan, got {time:g}{before}"
            )
        if count == self._signal.shape[0]:
            self._signal.resize((count + _AHEAD, *self._shape))
        self._signal[count] = block
        chunk = self._chunk(count)
        sync_file(chunk)
        valid = np.asarray(np.isfinite(block).all(axis=-1), dtype=np.bool_)
        digest = sha256(chunk.read_bytes())
        self._journal.append(WrittenScan(digest, place, float(time), valid))

    def commit(self) -> None:
        """Write the small arrays and the manifest, then give the store its name; a run without scans is an error."""
        scans = self._journal.scans
        if not scans:
            raise ValueError("a run must hold at least one scan, got none")
        # One tone stands for all, which the beginning checked: those of a day's drive would not fit
        # into the memory.
        probe = np.where(
            np.stack([scan.valid for scan in scans])[..., None],
            np.complex64(0),
            np.complex64(np.nan),
        )
        run = make_run(
            probe,
            self._frequency[:1],
            self._polarization,
            self._tx,
            self._rx,
            np.stack([scan.pose for scan in scans]),
            [scan.time for scan in scans],
        )
        self._signal.resize(
            (len(scans), *self._shape)
        )  # what was made ahead, or append failed at, does not count
        for name in ("valid", "tx_position", "rx_position", "pose", "frequency", "time"):
            values = self._frequency if name == "frequency" else run[name].values
            self._array(name, values.shape, values.shape, str(values.dtype), run[name].dims)[
                ...
            ] = values
        self._group.attrs.update(
            {
                "format": FORMAT,
                "version": VERSION,
                "polarization": self._polarization,
                "attrs": self._attrs,
            }
        )
        digest = _write_manifest(self._partial, len(scans))
        if self._about["inputs"]:
            write_whole(
                self._partial / MADE_OF,
                canonical_json({"commit": digest, "about": self._about}) + b"\n",
            )
        replace_folder(self._partial, self.path)
        self._committed = True
        # Not before: a kill in between would cost every scan. The next writer takes away what a
        # kill here leaves.
        (self.path / JOURNAL).unlink(missing_ok=True)

    def _check_free(self, overwrite: bool) -> None:
        """Refuse a place that is taken, and take away what writers that were killed left beside a whole store."""
        if overwrite or not os.path.lexists(self.path):
            return
        different = _difference_from_stored(self.path, self._about)
        if different == "":
            (self.path / JOURNAL).unlink(missing_ok=True)
            for left in (replaced_by(self.path), *self._discarded()):
                shutil.rmtree(left, ignore_errors=True)
        raise RunExistsError(self.path, different)

    def _discard(self) -> None:
        """Throw away what was written: out of the name first, for the next writer may take that at once."""
        with suppress(OSError):
            aside = tempfile.mkdtemp(
                prefix=f".discarded-{self.path.name}-", dir=self._partial.parent
            )
            self._partial.rename(aside)
        for left in self._discarded():
            shutil.rmtree(left, ignore_errors=True)
        self._journal.close()

    def _discarded(self) -> list[Path]:
        return list(self.path.parent.glob(f".discarded-{glob.escape(self.path.name)}-*"))

    def _chunk(self, scan: int) -> Path:
        return self._partial / "signal" / "c" / str(scan) / "0" / "0" / "0"

    def _drop_what_is_not_sure(self) -> None:
        """Keep the scans up to the first whose chunk is not what the journal says, and nothing else."""
        good: list[Path] = []
        for scan, written in enumerate(self._journal.scans):
            chunk = self._chunk(scan)
            if not self._is_sure(chunk, written):
                break
            good.append(chunk)
        self._journal.keep(len(good))
        kept = {self._partial / JOURNAL, *good}
        for path in sorted(self._partial.rglob("*"), reverse=True):
            if path.is_dir() and not path.is_symlink():
                if not any(path.iterdir()):
                    path.rmdir()
            elif path not in kept:
                path.unlink()

    def _is_sure(self, chunk: Path, written: WrittenScan) -> bool:
        """Tell whether a chunk is what the journal says; what a chunk cannot be is not read."""
        largest = np.dtype(np.complex64).itemsize * math.prod(self._shape) + _CRC
        try:
            data = Folder(self._partial).read(chunk.relative_to(self._partial).as_posix(), largest)
        except (OSError, DoorError):
            return False
        return sha256(data) == written.sha256

    def _array(
        self,
        name: str,
        shape: tuple[int, ...],
        chunks: tuple[int, ...],
        dtype: str,
        dims: tuple[Any, ...] = ("scan", "polarization", "pair", "frequency"),
    ) -> Any:
        from zarr.codecs import Crc32cCodec

        return self._group.create_array(
            name,
            shape=shape,
            chunks=chunks,
            dtype=dtype,
            fill_value=False if dtype == "bool" else np.nan,
            compressors=[Crc32cCodec()],
            filters=[],
            dimension_names=list(map(str, dims)),
            config={"write_empty_chunks": True},
        )


def is_finished(path: str | Path) -> bool:
    """Tell whether a store has its name and its writer came to an end.

    One that was killed in between leaves its journal in the store, which the next writer takes away.
    """
    root = Path(path)
    return root.is_dir() and not os.path.lexists(root / JOURNAL)


def is_stored(run: xr.Dataset, path: str | Path) -> bool:
    """Tell whether a place holds a whole store of exactly this run; anything else there is a RunExistsError."""
    root = Path(path)
    if not os.path.lexists(root):
        return False
    frequency, tx_position, rx_position = (
        run[name].values for name in ("frequency", "tx_position", "rx_position")
    )
    polarization = [str(label) for label in run["polarization"].values]
    attrs = {str(key): value for key, value in run.attrs.items()}
    about = _describe(frequency, polarization, tx_position, rx_position, attrs, _digests(run))
    different = _difference_from_stored(root, about)
    if different != "":
        raise RunExistsError(root, different)
    return True


def save_run(
    run: xr.Dataset, path: str | Path, overwrite: bool = False, resume: bool = False
) -> Path:
    """Write a run as a Zarr v3 store; one that exists is a FileExistsError unless ``overwrite`` is true.

    With ``resume`` it goes on where writing exactly this run was stopped, even by a kill; what is left of another run
    is thrown away, and a whole store of exactly this run is left as it is.
    """
    check_run(run)
    frequency, polarization, tx_position, rx_position = (
        run[name].values for name in ("frequency", "polarization", "tx_position", "rx_position")
    )
    attrs = {str(key): value for key, value in run.attrs.items()}
    fixed = path, frequency, polarization, tx_position, rx_position, attrs, overwrite
    try:
        begun = RunWriter.resumed(*fixed, inputs=_digests(run)) if resume else RunWriter(*fixed)
    except RunExistsError as error:
        if not (resume and error.same):
            raise
        tell_finished(path)
        return Path(path)
    with begun as writer:
        pose = run["pose"].values
        time = run["time"].values
        for scan in range(len(writer), run.sizes["scan"]):
            writer.append(run["signal"][scan].values, pose[scan], float(time[scan]))
    return Path(path)


def _digests(run: xr.Dataset) -> dict[str, Any]:
    """Digests of all that a run's scans hold."""
    arrays = {name: np.ascontiguousarray(run[name].values) for name in ("signal", "pose", "time")}
    return {name: sha256(values.view(np.uint8).data) for name, values in arrays.items()}


def open_run(path: str | Path, max_memory: int = MAX_MEMORY) -> xr.Dataset:
    """Open a run; the signal is read scan by scan when it is asked for, and verified each time.

    Shapes, chunks, types and sizes are checked before anything is decoded, so that a store from anywhere may be opened.
    ``max_memory`` is what the run's small arrays and a few of its scans may take, bytes. A store that was not
    committed, is damaged, leads out of its folder or breaks a rule is a RunStoreError; so is reading a scan whose file
    has changed.
    """
    root = Path(path)
    manifest = read_manifest(root)
    files = _CommittedFiles(root, manifest["files"])
    files.check_sizes()
    try:
        layouts = check_declared(files.files, files.read, max_memory)
        attrs = parse_json(files.read("zarr.json") or b"{}")["attributes"]
        arrays = {name: _StoredArray(files, name, layout) for name, layout in layouts.items()}
        lazy = indexing.LazilyIndexedArray(arrays.pop("signal"))
        held = {
            name: (DIMS[name], array.select((slice(None),) * len(array.shape)))
            for name, array in arrays.items()
        }
        coords = {
            "frequency": held.pop("frequency"),
            "polarization": ("polarization", [str(label) for label in attrs["polarization"]]),
            "time": held.pop("time"),
            "axis": ("axis", list(AXES)),
            "component": ("component", list(POSE_COMPONENTS)),
        }
        kept = indexing.MemoryCachedArray(indexing.CopyOnWriteArray(lazy))  # type: ignore[arg-type,no-untyped-call]
        signal = (DIMS["signal"], kept)
        variables = {name: signal if name == "signal" else held[name] for name in _VARIABLES}
        run = check_run(xr.Dataset(variables, coords, dict(attrs["attrs"])))
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


def read_manifest(path: str | Path) -> dict[str, Any]:
    """Read and check a store's commit manifest: format, version, scans, files (key -> sha256, bytes), sha256."""
    root = Path(path)
    if not root.is_dir():
        partial = root.with_name(root.name + ".partial")
        if partial.is_dir():
            raise RunStoreError(
                f"{root}: writing stopped before the run was committed; {partial} has what was written"
            )
        said = "which is no folder" if root.exists() else "which does not exist"
        raise FileNotFoundError(f"path must be a run store, got {root}, {said}")
    try:
        written = Folder(root).read(_COMMIT, MOST_JSON)
        manifest = parse_json(written)
        own = manifest.pop("sha256")
        same = (
            sha256(canonical_json(manifest)) == own
            and _manifest_bytes({**manifest, "sha256": own}) == written
        )
    except FileNotFoundError:
        raise RunStoreError(
            f"{root}: no {_COMMIT}: this is no run store, or writing it was interrupted"
        ) from None
    except (ValueError, KeyError, AttributeError, TypeError, OSError) as error:
        raise RunStoreError(
            f"{root}: {_COMMIT} cannot be read ({error}): the store is truncated or altered"
        ) from None
    if not same:
        raise RunStoreError(
            f"{root}: {_COMMIT} differs from what was committed: the store is altered"
        )
    if manifest.get("format") != FORMAT or manifest.get("version") != VERSION:
        raise RunStoreError(
            f"{root}: format must be {FORMAT} version {VERSION}, got {manifest.get('format')} {manifest.get('version')}"
        )
    files = manifest.get("files")
    if (
        type(manifest.get("scans")) is not int
        or not isinstance(files, dict)
        or not all(map(_is_entry, files.values()))
    ):
        raise RunStoreError(
            f"{root}: {_COMMIT} must tell the number of scans and digest and size of every file"
        )
    return {**manifest, "sha256": own}


def _is_entry(entry: Any) -> bool:
    known = isinstance(entry, dict) and isinstance(entry.get("sha256"), str)
    return known and type(entry.get("bytes")) is int and entry["bytes"] >= 0


def _describe(
    frequency: NDArray[np.float64],
    polarization: list[str],
    tx_position: NDArray[np.float64],
    rx_position: NDArray[np.float64],
    attrs: dict[str, Any],
    inputs: dict[str, Any] | None,
) -> dict[str, Any]:
    """Describe all that the scans of a store depend on."""
    return {
        "frequency": sha256(frequency.tobytes()),
        "polarization": polarization,
        "tx_position": sha256(tx_position.tobytes()),
        "rx_position": sha256(rx_position.tobytes()),
        "attrs": attrs,
        "inputs": inputs or {},
    }


def _difference_from_stored(root: Path, about: dict[str, Any]) -> str | None:
    """Tell what a store was made of otherwise: "" for nothing, None where it is not whole or does not tell."""
    try:
        stored = parse_json(Folder(root).read(MADE_OF, MOST_JSON))
        manifest = read_manifest(root)
        _CommittedFiles(root, manifest["files"]).check_sizes()
        if stored["commit"] != manifest["sha256"]:
            return None
        return difference(stored["about"], parse_json(canonical_json(about)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _write_manifest(root: Path, scans: int) -> str:
    """Write the manifest of all that is in a folder, and give its digest."""
    files = {}
    for file in sorted(root.rglob("*")):
        if file.is_file() and file.name not in (JOURNAL, MADE_OF):
            data = file.read_bytes()
            sync_file(file)
            files[file.relative_to(root).as_posix()] = {"sha256": sha256(data), "bytes": len(data)}
    manifest: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "scans": scans,
        "files": files,
    }
    manifest["sha256"] = sha256(canonical_json(manifest))
    write_whole(root / _COMMIT, _manifest_bytes(manifest))
    return str(manifest["sha256"])


def _manifest_bytes(manifest: dict[str, Any]) -> bytes:
    return json.dumps(manifest, indent=1, sort_keys=True).encode()
