"""Writing files so that they are whole or absent, and the digests that prove it."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def sha256(data: bytes | memoryview) -> str:
    """Hexadecimal SHA-256 of bytes.

    Parameters
    ----------
    data : bytes
        What to hash.

    Returns
    -------
    str
        The digest.
    """
    return hashlib.sha256(data).hexdigest()


def canonical_json(value: Any) -> bytes:
    """Write a JSON value in its one canonical form: sorted keys, no spaces, no NaN.

    Parameters
    ----------
    value : object
        Anything JSON can hold.

    Returns
    -------
    bytes
        UTF-8 text.

    Raises
    ------
    ValueError
        If the value holds NaN or infinity.
    TypeError
        If the value holds something JSON cannot.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()


def sync_directory(path: Path) -> None:
    """Flush a directory's entries to disk.

    Parameters
    ----------
    path : Path
        The directory.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_file(path: Path) -> None:
    """Flush a file's content to disk.

    Parameters
    ----------
    path : Path
        The file.
    """
    with path.open("rb") as file:
        os.fsync(file.fileno())


def write_whole(path: Path, data: bytes | str) -> None:
    """Write a file so that it holds either its old content or all of the new.

    Parameters
    ----------
    path : Path
        Target; its folder must exist.
    data : bytes or str
        Content; text is written as UTF-8.
    """
    temporary = path.with_name(path.name + ".partial")
    with temporary.open("wb") as file:
        file.write(data.encode() if isinstance(data, str) else data)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
    sync_directory(path.parent)


def replace_folder(new: Path, folder: Path) -> None:
    """Let a folder that is whole take the place of an older one.

    Parameters
    ----------
    new : Path
        The folder that is whole.
    folder : Path
        Where it belongs.
    """
    old = folder.with_name(folder.name + ".old")
    shutil.rmtree(old, ignore_errors=True)
    if folder.exists():
        folder.rename(old)
    new.rename(folder)
    sync_directory(folder.parent)
    shutil.rmtree(old, ignore_errors=True)


def check_free_folder(folder: str | Path, marks: Sequence[str], kind: str) -> Path:
    """Make sure that a folder may be written at a place.

    Parameters
    ----------
    folder : str or Path
        The place.
    marks : sequence of str
        Files of which a folder of the kind has one.
    kind : str
        What may be replaced there, for the message.

    Returns
    -------
    Path
        The same.

    Raises
    ------
    FileExistsError
        If something else lies there.
    """
    folder = Path(folder)
    known = any((folder / name).is_file() for name in marks)
    if folder.exists() and not known and (folder.is_file() or any(folder.iterdir())):
        raise FileExistsError(f"output must be a new folder or an older {kind}, got {folder}, which holds other files")
    return folder
