"""Writing files so that they are whole or absent, the digests that prove it, and JSON that carries its own."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import re
import shutil
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from flgpr.append_log import sync_directory
from flgpr.door import MOST_JSON, Folder, Listed, kind_of, open_named, open_own, parse_json

_LFS = b"version https://git-lfs.github.com/spec/v1"
_LARGEST_POINTER = 1024  # bytes, by Git LFS's specification


def sha256(data: bytes | memoryview) -> str:
    """Hexadecimal SHA-256 of bytes."""
    return hashlib.sha256(data).hexdigest()


def canonical_json(value: Any) -> bytes:
    """Write a JSON value in its one canonical form: sorted keys, no spaces, no NaN (a ValueError), UTF-8."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def existing(path: str | Path, what: str = "file") -> Path:
    """Give the path of a regular file that is there; else a FileNotFoundError, or a ValueError for a pipe or device."""
    path = Path(path)
    if path.is_file():
        _refuse_pointer(path, what)
        return path
    if path.exists() and not path.is_dir():
        raise ValueError(
            f"{what} must be a regular file, got {kind_of(path)}, {path}: save what it gives to a file"
        )
    raise FileNotFoundError(f"{what} not found: {path}")


def _refuse_pointer(path: Path, what: str) -> None:
    """Refuse a pointer of Git LFS, which stands for a file that was not fetched."""
    if path.stat().st_size > _LARGEST_POINTER:
        return
    with open_named(path) as file:
        head = file.read(_LARGEST_POINTER)
    if head.startswith(_LFS):
        size = re.search(rb"^size (\d{1,18})$", head, re.MULTILINE)
        told = f" of {int(size[1])} bytes" if size else ""
        raise ValueError(
            f"{path}: {what} is a pointer of Git LFS to a file{told} that was not fetched: git lfs pull"
        )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Let an error of the system name the file that is written, and not what it is called until it is whole."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and (
            error.filename is None or ".partial" in str(error.filename)
        ):
            error.filename = str(path)
            error.filename2 = None
        raise


@contextmanager
def faults_of(path: str | Path) -> Iterator[None]:
    """Name the file whose content breaks a rule, in a ValueError."""
    try:
        yield
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None
    except RecursionError:
        raise ValueError(f"{path}: its entries are nested too deeply to be read") from None


def sync_file(path: Path) -> None:
    """Flush a file's content to disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def write_whole(path: Path, data: bytes | str) -> None:
    """Write a file, text as UTF-8, so that it holds either its old content or all of the new; its folder must exist.

    A file that has these bytes already is left as it is. Of two processes that write the same file at once the second
    waits for the first.
    """
    content = data.encode() if isinstance(data, str) else data
    temporary = path.with_name(path.name + ".partial")
    with writing(path), _open_alone(temporary) as file:
        if _holds(path, content):
            temporary.unlink(missing_ok=True)
            return
        try:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    sync_directory(path.parent)


def _holds(path: Path, content: bytes) -> bool:
    """Tell whether a regular file, and no link to one, has these bytes."""
    if path.is_symlink() or not path.is_file() or path.stat().st_size != len(content):
        return False
    with open(path, "rb", opener=open_own) as file:
        return file.read() == content


def _open_alone(temporary: Path) -> BinaryIO:
    """Open an empty file that no other process writes; what a killed process left there is taken."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    while True:
        if os.path.lexists(temporary) and not stat.S_ISREG(temporary.lstat().st_mode):
            temporary.unlink()  # a link, which would lead elsewhere, or a pipe
        file = os.fdopen(os.open(temporary, flags, 0o666), "wb")
        with suppress(OSError):  # a file system without locks
            fcntl.flock(file, fcntl.LOCK_EX)
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), temporary.lstat()):
                file.truncate(0)
                return file
        file.close()


def replace_folder(new: Path, folder: Path) -> None:
    """Let a folder that is whole take the place of an older one."""
    old = replaced_by(folder)
    shutil.rmtree(old, ignore_errors=True)
    if folder.exists():
        folder.rename(old)
    new.rename(folder)
    sync_directory(folder.parent)
    shutil.rmtree(old, ignore_errors=True)


def replaced_by(folder: Path) -> Path:
    """Tell where a folder lies while another takes its place: no name that anybody gives to a copy."""
    return folder.with_name(f".replaced-by-{folder.name}")


def check_new(path: str | Path | None) -> None:
    """Make sure that nothing lies where something is to be made; None is nothing to be made."""
    if path is not None and Path(path).exists():
        raise FileExistsError(f"output must not exist yet, got {path}")


def check_free_folder(folder: str | Path, marks: Sequence[str], kind: str) -> Path:
    """Refuse a place where something lies that is no ``kind``, a folder with one of ``marks``; give its path."""
    folder = Path(folder)
    known = any((folder / name).is_file() for name in marks)
    if folder.exists() and not known and (folder.is_file() or any(folder.iterdir())):
        raise FileExistsError(
            f"output must be a new folder or an older {kind}, got {folder}, which holds other files"
        )
    return folder


def laid_over(tables: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Lay the entries of nested tables over those of others."""
    both = {}
    for name, entry in more.items():
        nested = isinstance(entry, dict) and isinstance(tables.get(name), dict)
        both[name] = laid_over(tables[name], entry) if nested else entry
    return {**tables, **both}


def seal(content: Mapping[str, Any]) -> bytes:
    """Write a JSON object with its own SHA-256 as last entry; NaN, infinity or an entry ``sha256`` is a ValueError."""
    if "sha256" in content:
        raise ValueError("content must not hold the entry sha256, which is added")
    whole = {**content, "sha256": sha256(canonical_json(content))}
    return json.dumps(whole, indent=1, allow_nan=False).encode() + b"\n"


def unseal(data: bytes) -> dict[str, Any]:
    """Read what :func:`seal` wrote, with ``sha256``; a byte that differs is a ValueError."""
    try:
        whole = parse_json(data)
        content = {name: value for name, value in whole.items() if name != "sha256"}
        same = seal(content) == data
    except (ValueError, AttributeError) as error:
        raise ValueError(f"it cannot be read ({error})") from None
    if not same:
        raise ValueError("it differs from what was written")
    return dict(whole)


def read_sealed(folder: str | Path, name: str) -> dict[str, Any]:
    """Read a file of :func:`seal` in a folder that may come from anywhere; one that is altered is a ValueError."""
    return unseal(Folder(folder).read(name, MOST_JSON))


def listed_files(folder: str | Path, manifest: Mapping[str, Any]) -> Folder:
    """Give the files of a folder as its manifest lists them, by name.

    ``files`` holds a digest each and ``added`` several, of which one fits, or None while the file may be absent;
    ``sizes`` and ``added_sizes`` hold bytes likewise, where the manifest is not of an older version.
    """
    try:
        sizes = manifest.get("sizes", {})
        added_sizes = manifest.get("added_sizes", {})
        listed = {
            name: _listed([digest], [sizes.get(name)]) for name, digest in manifest["files"].items()
        }
        for name, digests in manifest.get("added", {}).items():
            listed[name] = _listed(digests, added_sizes.get(name, [None] * len(digests)))
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{folder}: its list of files cannot be read ({error!r})") from None
    return Folder(folder, listed)


def _listed(digests: Sequence[str | None], sizes: Sequence[int | None]) -> Listed:
    versions = [
        (digest, size) for digest, size in zip(digests, sizes, strict=True) if digest is not None
    ]
    if not versions or not all(isinstance(digest, str) for digest, _ in versions):
        raise ValueError(f"every file must have a digest, got {digests}")
    # Where the size of one version is not known, that of another must not keep it out.
    known = [size for _, size in versions if size is not None]
    proven = tuple(known) if len(known) == len(versions) else ()
    return Listed(tuple(digest for digest, _ in versions), proven, None in digests)
