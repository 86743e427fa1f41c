"""Writing files so that they are whole or absent, the digests that prove it, and JSON that carries its own."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from flgpr.append_log import sync_directory

_MOST_EXPANSION, _SMALL = 200, 64 * 2**20
"""What is above the second number of bytes may take this many times its room in the file, not more."""


def sha256(data: bytes | memoryview) -> str:
    """Hexadecimal SHA-256 of bytes."""
    return hashlib.sha256(data).hexdigest()


def canonical_json(value: Any) -> bytes:
    """Write a JSON value in its one canonical form: sorted keys, no spaces, no NaN (a ValueError), UTF-8."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def existing(path: str | Path, what: str = "file") -> Path:
    """Give the path of a file that is there; else a FileNotFoundError says what is not."""
    if not Path(path).is_file():
        raise FileNotFoundError(f"{what} not found: {path}")
    return Path(path)


def check_expansion(name: str, size: int, room: int) -> None:
    """Refuse what decodes into far more than the file holds: no measurement does."""
    if size > _SMALL and size > _MOST_EXPANSION * room:
        raise ValueError(f"{name} takes {room} bytes of the file and would expand to {size}: no data do")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Let an error of the system name the file that is written, and not what it is called until it is whole."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and (error.filename is None or ".partial" in str(error.filename)):
            error.filename, error.filename2 = str(path), None
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

    Of two processes that write the same file at once the second waits for the first.
    """
    temporary = path.with_name(path.name + ".partial")
    with writing(path), _open_alone(temporary) as file:
        try:
            file.write(data.encode() if isinstance(data, str) else data)
            file.flush()
            os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    sync_directory(path.parent)


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
        raise FileExistsError(f"output must be a new folder or an older {kind}, got {folder}, which holds other files")
    return folder


def laid_over(tables: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Lay the entries of nested tables over those of others."""
    both = {}
    for name, entry in more.items():
        nested = isinstance(entry, dict) and isinstance(tables.get(name), dict)
        both[name] = laid_over(tables[name], entry) if nested else entry
    return {**tables, **both}


MOST_BYTES = 256 * 2**20
"""Largest sealed file that is read."""


def seal(content: Mapping[str, Any]) -> bytes:
    """Write a JSON object with its own SHA-256 as last entry; NaN, infinity or an entry ``sha256`` is a ValueError."""
    if "sha256" in content:
        raise ValueError("content must not hold the entry sha256, which is added")
    whole = {**content, "sha256": sha256(canonical_json(content))}
    return json.dumps(whole, indent=1, allow_nan=False).encode() + b"\n"


def unseal(data: bytes) -> dict[str, Any]:
    """Read what :func:`seal` wrote, with ``sha256``; a byte that differs is a ValueError."""
    try:
        whole = json.loads(data)
        content = {name: value for name, value in whole.items() if name != "sha256"}
        same = seal(content) == data
    except (ValueError, AttributeError, RecursionError) as error:
        raise ValueError(f"it cannot be read ({error})") from None
    if not same:
        raise ValueError("it differs from what was written")
    return dict(whole)


def read_limited(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a file of at most so many bytes; a larger one is a ValueError."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(min(size, most) + 1)  # a buffer of this size is made at once
    if len(data) > most:
        raise ValueError(f"{path}: it must hold at most {most / 2**20:g} MiB, got more")
    return data


def inside(root: Path, name: str) -> Path:
    """Find a file of a folder by a relative name with forward slashes; one that leads out of it is a ValueError."""
    pure = PurePosixPath(name)
    if not name or "\0" in name or "\\" in name or pure.is_absolute() or ".." in pure.parts:
        raise ValueError(f"{root}: names must be relative and stay inside, got {name!r}")
    path, at = root / pure, str(root)
    if not any(os.path.islink(at := f"{at}{os.sep}{part}") for part in pure.parts):
        return path  # nothing below the folder leads elsewhere
    try:
        real = path.resolve()
    except (OSError, RuntimeError):
        raise ValueError(f"{root}: {name} is a symbolic link that leads nowhere") from None
    if not real.is_relative_to(root.resolve()):
        raise ValueError(f"{root}: {name} leads out of the folder, to {real}")
    return path
