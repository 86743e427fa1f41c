"""Writing of run stores (:mod:`flgpr.store.run_store`), scan by scan, safe against a kill."""

from __future__ import annotations

import glob
import json
import math
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.door import DoorError, Folder, refuse_links
from flgpr.json_text import canonical_json, parse_json, sha256
from flgpr.model import check_run, make_run
from flgpr.model.constants import DIMS, VARIABLE_ATTRS
from flgpr.model.run import check_poses, measured_sweeps, polarizations_of
from flgpr.store.files import (
    PARTIAL,
    replace_folder,
    replaced_by,
    sync_file,
    write_whole,
    writing,
)
from flgpr.store.journal import (
    JOURNAL,
    MADE_OF,
    FixedParts,
    Journal,
    JournalError,
    OtherRunError,
    WrittenScan,
    describe_inputs,
    difference_from_stored,
)
from flgpr.store.outputs import log_finished
from flgpr.store.run_store import (
    CHECKSUM_BYTES,
    FORMAT,
    MANIFEST,
    VERSION,
    RunStoreError,
    manifest_bytes,
)
from flgpr.types import ArrayLike, ComplexArray, floats

GROUP = "zarr.json"
"""File that describes a group or an array of Zarr."""
_SCANS_PER_GROWTH = 64  # Zarr writes the array's description anew each time it grows
_WIDTH = np.dtype(np.complex64).itemsize
_SMALL_SCAN = 4096  # bytes: a file takes at least so many on a disk, and smaller scans share one
_PIECE = 65_536  # bytes of such a file


class RunExistsError(FileExistsError):
    """A run store exists already; ``same`` is true if it is complete and made of the same."""

    def __init__(self, path: Path, different: str | None) -> None:
        self.same = different == ""
        if self.same:
            content = "which is whole and holds this very run"
        elif different:
            content = f"which holds another run ({different})"
        else:
            content = "which holds something else or a damaged store"
        super().__init__(
            f"output must not exist yet, got {path}, {content}: "
            "move it away or choose another output"
        )


class RunWriter:
    """Writer of a run store, scan by scan; the store appears under its name when it is complete.

    Use it as a context manager: leaving it normally commits the store, leaving it by an exception
    removes what was written, unless it is to be resumed (``keeps``). ``len(writer)`` is the number
    of scans that are written, where a resumed run continues::

        with RunWriter(path, *fixed, resume=True) as writer:
            for scan in range(len(writer), total):
                writer.append(signal(scan), pose[scan])

    Parameters
    ----------
    path : str or Path
        Folder to make. One that exists is a RunExistsError, unless ``overwrite`` is true.
    frequency, polarization, tx_position, rx_position, attrs
        As in :func:`flgpr.model.make_run`.
    overwrite : bool
        Replace a run that exists.
    resume : bool
        Continue after the last good scan of a writer of the same run that was stopped, even by a
        kill. Without it, what a stopped writer left is removed.
    inputs : dict, optional
        What else the scans depend on (digests of input files, versions), as JSON values. Resuming
        requires the same inputs. A complete store records them, but they are no part of the run.
    limits : dict, optional
        What ends in the scans because of how they were made, such as the edge of simulated ground,
        as JSON values. A complete store with ``inputs`` records it for ``read_limits``. It is
        no part of the run, and not compared when a writer resumes.
    together : int
        Scans that share a file of the store. Such a piece is written when it is full; a writer that
        is resumed continues after the last whole one.

    Raises
    ------
    ValueError
        If a parameter breaks a rule of ``make_run``, or ``attrs`` is not writable as JSON.
    RunExistsError
        If the run exists already.
    FileExistsError
        If the path, or a name beside it that the writer takes, is a symbolic link.
    RunStoreError
        If ``resume`` finds another unfinished run, or another process writes this one.
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
        limits: dict[str, Any] | None = None,
        together: int = 1,
    ) -> None:
        self.path = Path(path)
        self._together = together
        self._waiting: list[tuple[ComplexArray, WrittenScan]] = []  # signals and what else
        self._limits = limits or {}
        labels = [str(label) for label in np.atleast_1d(np.asarray(polarization))]
        tones, tx, rx = map(floats, (frequency, tx_position, rx_position))
        self._fixed = FixedParts(tones, labels, tx, rx)
        try:
            self._attrs = parse_json(canonical_json(attrs or {}))
        except (TypeError, ValueError) as error:
            raise ValueError(f"attrs must be writable as JSON: {error}") from None
        self._shape = (len(labels), len(tx), tones.size)
        # A broken rule is found here, not when the last scan is written.
        probe = np.broadcast_to(np.complex64(0), (1, *self._shape))
        make_run(probe, *self._fixed, np.zeros((1, 6)))
        self.keeps = resume
        self._committed = False
        self._partial = _partial_store(self.path)
        self._about = describe_inputs(self._fixed, self._attrs, inputs)
        self._check_free(overwrite)
        try:
            with writing(self.path):
                journal = Journal(self._partial, self._about, resume)
        except JournalError as error:
            raise RunStoreError(f"{self.path}: {error}") from error
        try:
            # Another process may have committed the run, or somebody made a link, meanwhile.
            self._check_free(overwrite)
        except FileExistsError:
            self._discard(journal)
            raise
        self._journal = journal
        self._drop_unverified_files()
        for folder in self._discarded():
            shutil.rmtree(folder, ignore_errors=True)
        import zarr  # slow to import, and needed for writing only

        self._group = zarr.open_group(self._partial, mode="a", zarr_format=3)
        self._signal = self._array(
            "signal", (len(self), *self._shape), (together, *self._shape), "complex64"
        )

    @classmethod
    def resumed(cls, *fixed: Any, inputs: dict[str, Any], together: int = 1) -> RunWriter:
        """Return a writer that continues a stopped writer of the same run and inputs.

        What a stopped writer of another run left is removed.
        """
        try:
            return cls(*fixed, resume=True, inputs=inputs, together=together)
        except RunStoreError as error:
            if not isinstance(error.__cause__, OtherRunError):
                raise
        # Without ``resume`` the writer empties what the other run left, while it holds the journal.
        writer = cls(*fixed, inputs=inputs, together=together)
        writer.keeps = True
        return writer

    def __len__(self) -> int:
        return len(self._journal.scans)

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: object
    ) -> None:
        # A full disk is reported by the library of arrays without the name of a file.
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            error.filename = str(self.path)
        try:
            if kind is None:
                self.commit()
        finally:
            if self._committed or (self.keeps and len(self)):
                self._journal.close()
            else:
                self._discard(self._journal)

    def append(self, signal: ArrayLike, pose: ArrayLike, time: float = float("nan")) -> None:
        """Write one scan by the rules of :func:`flgpr.model.make_run`.

        Parameters
        ----------
        signal : (polarization, pair, frequency) array_like of complex
            Received field over transmitted field.
        pose : (6,) array_like
            x, y, z, m, and heading, pitch, roll, rad.
        time : float
            Time of the scan, s; NaN where it is unknown.

        Raises
        ------
        ValueError
            If the signal has another shape, the pose is not finite, or the time decreases.
        OSError
            If the scan cannot be written.
        """
        block = np.asarray(signal, dtype=np.complex64)
        if block.shape != self._shape:
            raise ValueError(
                "signal must have the shape (polarization, pair, frequency) "
                f"{self._shape}, got {block.shape}"
            )
        checked_pose = check_poses(np.asarray(pose)[None], 1)[0]
        last = self._journal.scans[-1].time if len(self) else None
        if self._waiting:
            last = self._waiting[-1][1].time
        decreases = last is not None and time < last
        if math.isinf(time) or decreases:
            before = "" if last is None else f" after {last:g}"
            raise ValueError(
                "time must be finite, or NaN, and not decrease from scan to scan, "
                f"got {time:g}{before}"
            )
        scan = WrittenScan("", checked_pose, float(time), measured_sweeps(block))
        self._waiting.append((block, scan))
        if len(self._waiting) == self._together:
            try:
                self._write_piece()
            except BaseException:
                self._waiting.pop()  # the same scan may be given once more
                raise

    def _write_piece(self) -> None:
        """Write the scans that wait as one file, and then their lines of the journal."""
        waiting = self._waiting
        count = len(self)
        end = count + len(waiting)
        if end > self._signal.shape[0]:
            growth = max(_SCANS_PER_GROWTH, self._together)
            self._signal.resize((count + growth, *self._shape))
        self._signal[count:end] = np.stack([signal for signal, _ in waiting])
        chunk = self._chunk(count)
        sync_file(chunk)
        digest = sha256(chunk.read_bytes())
        for number, (_, scan) in enumerate(waiting, 1):
            self._journal.append(scan._replace(sha256=digest), settled=number == len(waiting))
        self._waiting = []

    def commit(self) -> None:
        """Write the small arrays and the manifest, then give the store its name.

        Raises
        ------
        ValueError
            If no scan was written.
        OSError
            If a file cannot be written.
        """
        if self._waiting:
            self._write_piece()
        scans = self._journal.scans
        if not scans:
            raise ValueError("a run must hold at least one scan, got none")
        self._write_small_arrays(scans)
        self._group.attrs.update(
            {
                "format": FORMAT,
                "version": VERSION,
                "polarization": self._fixed.polarization,
                "attrs": self._attrs,
            }
        )
        folder = Folder(self._partial)
        arrays = {}
        for name in DIMS:
            arrays[name] = folder.json(f"{name}/{GROUP}")
        group = folder.json(GROUP)
        consolidated = {"kind": "inline", "must_understand": False, "metadata": arrays}
        text = json.dumps({**group, "consolidated_metadata": consolidated}, indent=2)
        write_whole(self._partial / GROUP, text)
        digest = _write_manifest(self._partial, len(scans))
        if self._about["inputs"]:
            record: dict[str, Any] = {"commit": digest, "about": self._about}
            if self._limits:
                record["limits"] = self._limits
            write_whole(self._partial / MADE_OF, canonical_json(record) + b"\n")
        replace_folder(self._partial, self.path)
        self._committed = True
        # Not before: a kill in between would cost every scan. The next writer removes what a kill
        # here leaves.
        (self.path / JOURNAL).unlink(missing_ok=True)

    def _write_small_arrays(self, scans: list[WrittenScan]) -> None:
        """Write all arrays but the signal, which is cut to the scans that were written."""
        # One tone stands for all, which were checked at the beginning: those of a day's drive would
        # not fit into the memory.
        valid = np.stack([scan.valid for scan in scans])[..., None]
        if not valid.any():  # scans of zeros alone are kept, and lost sweeps are not
            finite = [np.isfinite(self._signal[k]).all(axis=-1) for k in range(len(scans))]
            valid = np.stack(finite)[..., None]
        probe = np.where(valid, np.complex64(1), np.complex64(np.nan))
        frequency = self._fixed.frequency
        run = make_run(
            probe,
            frequency[:1],
            *self._fixed[1:],
            np.stack([scan.pose for scan in scans]),
            [scan.time for scan in scans],
        )
        # The array may have grown ahead, and hold a scan that append failed at.
        self._signal.resize((len(scans), *self._shape))
        for name in ("valid", "tx_position", "rx_position", "pose", "frequency", "time"):
            values = frequency if name == "frequency" else run[name].values
            array = self._array(name, values.shape, values.shape, str(values.dtype))
            array[...] = values

    def _check_free(self, overwrite: bool) -> None:
        """Refuse a path that exists, and links at the names that are removed or replaced.

        If it is this very run, what killed writers left beside it is removed.
        """
        check_store_names(self.path)
        if overwrite or not os.path.lexists(self.path):
            return
        different = difference_from_stored(self.path, self._about)
        if different == "":
            (self.path / JOURNAL).unlink(missing_ok=True)
            for folder in (replaced_by(self.path), *self._discarded()):
                shutil.rmtree(folder, ignore_errors=True)
        raise RunExistsError(self.path, different)

    def _discard(self, journal: Journal) -> None:
        """Remove what was written.

        The folder is renamed first, because the next writer may take its name at once.
        """
        with suppress(OSError):
            aside = tempfile.mkdtemp(
                prefix=f".discarded-{self.path.name}-", dir=self._partial.parent
            )
            self._partial.rename(aside)
        for folder in self._discarded():
            shutil.rmtree(folder, ignore_errors=True)
        journal.close()

    def _discarded(self) -> list[Path]:
        """Return folders of discarded runs of this name, which a killed process may have left."""
        return list(self.path.parent.glob(f".discarded-{glob.escape(self.path.name)}-*"))

    def _chunk(self, scan: int) -> Path:
        """Return the file of a scan's signal."""
        piece = str(scan // self._together)
        return self._partial / "signal" / "c" / piece / "0" / "0" / "0"

    def _drop_unverified_files(self) -> None:
        """Remove all files but the journal and the scans before the first that differs from it."""
        verified: list[Path] = []
        for scan, written in enumerate(self._journal.scans):
            chunk = self._chunk(scan)
            if not self._is_verified(chunk, written):
                break
            verified.append(chunk)
        whole = len(verified) - len(verified) % self._together
        del verified[whole:]
        self._journal.keep(whole)
        remaining = {self._partial / JOURNAL, *verified}
        for path in sorted(self._partial.rglob("*"), reverse=True):
            if path.is_dir() and not path.is_symlink():
                if not any(path.iterdir()):
                    path.rmdir()
            elif path not in remaining:
                path.unlink()

    def _is_verified(self, chunk: Path, written: WrittenScan) -> bool:
        """Return whether a chunk is what the journal says; one that is too large is not read."""
        largest = self._together * _WIDTH * math.prod(self._shape) + CHECKSUM_BYTES
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
    ) -> Any:
        """Return a new array of the store."""
        from zarr.codecs import Crc32cCodec

        return self._group.create_array(
            name,
            shape=shape,
            chunks=chunks,
            dtype=dtype,
            fill_value=False if dtype == "bool" else np.nan,
            compressors=[Crc32cCodec()],
            filters=[],
            dimension_names=DIMS[name],
            attributes=VARIABLE_ATTRS[name],
            config={"write_empty_chunks": True},
        )


def save_run(
    run: xr.Dataset,
    path: str | Path,
    overwrite: bool = False,
    resume: bool = False,
    share_files: bool = False,
) -> Path:
    """Write a run as a store.

    Parameters
    ----------
    run : Dataset
        A run, see :func:`flgpr.model.make_run`.
    path : str or Path
        Folder to make.
    overwrite : bool
        Replace a run that exists.
    resume : bool
        Continue where writing exactly this run was stopped, even by a kill. What is left of another
        run is removed, and a complete store of exactly this run is left as it is.
    share_files : bool
        Put scans of less than 4 KiB together into files of 64 KiB. A disk gives every file, and
        every folder about it, 4 KiB.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        If the path exists and ``overwrite`` is false, unless ``resume`` finds this very run.
    RunStoreError
        If another process writes the same store.
    """
    check_run(run)
    fixed = (path, *_fixed_of(run), _attrs_of(run), overwrite)
    size = _WIDTH * run["signal"][0].size
    together = _PIECE // size if share_files and size <= _SMALL_SCAN else 1
    try:
        if resume:
            begun = RunWriter.resumed(*fixed, inputs=_digests(run), together=together)
        else:
            begun = RunWriter(*fixed, together=together)
    except RunExistsError as error:
        if not (resume and error.same):
            raise
        log_finished(path)
        return Path(path)
    with begun as writer:
        pose = run["pose"].values
        time = run["time"].values
        for scan in range(len(writer), run.sizes["scan"]):
            writer.append(run["signal"][scan].values, pose[scan], float(time[scan]))
    return Path(path)


def check_store_names(path: Path) -> None:
    """Refuse symbolic links at the names that the writer of a run store removes or replaces."""
    refuse_links(path, _partial_store(path), replaced_by(path))


def _partial_store(path: Path) -> Path:
    """Return the folder in which a run store is made."""
    return path.with_name(path.name + PARTIAL)


def is_finished(path: str | Path) -> bool:
    """Return whether a store has its name and its writer came to an end.

    A writer that was killed in between leaves its journal in the store, which the next writer takes
    away.
    """
    root = Path(path)
    return root.is_dir() and not os.path.lexists(root / JOURNAL)


def is_stored(run: xr.Dataset, path: str | Path) -> bool:
    """Return whether a path holds a complete store of exactly this run.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    path : str or path
        The store.

    Returns
    -------
    bool
        Whether it does; False where nothing is there.

    Raises
    ------
    RunExistsError
        If anything else is there.
    FileExistsError
        If the path, or a name beside it that the writer takes, is a symbolic link.
    """
    root = Path(path)
    check_store_names(root)
    if not os.path.lexists(root):
        return False
    different = difference_from_stored(
        root, describe_inputs(_fixed_of(run), _attrs_of(run), _digests(run))
    )
    if different != "":
        raise RunExistsError(root, different)
    return True


def _fixed_of(run: xr.Dataset) -> FixedParts:
    """Return what all scans of a run share."""
    frequency, tx, rx = (run[name].values for name in ("frequency", "tx_position", "rx_position"))
    return FixedParts(frequency, polarizations_of(run), tx, rx)


def _attrs_of(run: xr.Dataset) -> dict[str, Any]:
    """Return the attributes of a run by their names as text."""
    return {str(key): value for key, value in run.attrs.items()}


def _digests(run: xr.Dataset) -> dict[str, Any]:
    """Return the digests of all that a run's scans hold."""
    digests = {}
    for name in ("signal", "pose", "time"):
        values = np.ascontiguousarray(run[name].values)
        digests[name] = sha256(values.view(np.uint8).data)
    return digests


def _write_manifest(root: Path, scans: int) -> str:
    """Write the manifest of all files in a folder, and return its digest."""
    files = {}
    for file in sorted(root.rglob("*")):
        # The journal is removed at the end; what the store was made of is no part of the run.
        if file.is_file() and file.name not in (JOURNAL, MADE_OF):
            data = file.read_bytes()
            sync_file(file)  # before the manifest vouches for it
            name = file.relative_to(root).as_posix()
            files[name] = {"sha256": sha256(data), "bytes": len(data)}
    manifest: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "scans": scans,
        "files": files,
    }
    digest = sha256(canonical_json(manifest))
    manifest["sha256"] = digest
    write_whole(root / MANIFEST, manifest_bytes(manifest))
    return digest
