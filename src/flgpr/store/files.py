"""Atomic writing of files and folders, and reading of those whose digest is in them.

A file that is written here holds either its old or its new content, whenever the process is killed.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

from flgpr import system
from flgpr.append_log import sync_directory
from flgpr.door import MOST_JSON, Folder, kind_of, open_named, open_own, refuse_links
from flgpr.json_text import parse_with_digest
from flgpr.model.printable import text_bytes

PARTIAL = ".partial"
"""Ending of the name of a file that is being written."""
PARTIAL_PREFIX = ".partial-"
"""Before the name of an output, for the folder in which it is made."""
_LFS = b"version https://git-lfs.github.com/spec/v1"
_LARGEST_POINTER = 1024  # bytes, by Git LFS's specification
_FOREIGN = {
    _LFS: "a pointer of Git LFS to a file that was not fetched: git lfs pull",
    b"PK\x03\x04": "a ZIP archive or an Excel file: unpack it, or save the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an Excel file: save the sheet as CSV",
    b"\x89PNG": "a picture: give the data that it was drawn of",
    b"\xff\xd8\xff": "a picture: give the data that it was drawn of",
    b"%PDF": "a PDF: give the data that it was made of",
    b"\x1f\x8b": "compressed by gzip: unpack it",
}
_FOLDERS = {
    "commit.json": "a run: `flgpr.detect` makes a result of it",
    "manifest.json": "a result: `flgpr.view` shows it, `flgpr.score` scores it",
    "model.bundle": "a model: `flgpr.detect` takes it as `model`",
    "roc.json": "a score: `flgpr.view` shows it",
}
"""What a folder is by a name in it."""
_MOST_ENTRIES = 1000  # of a folder that are looked at


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Return a sort key by which scan_2 comes before scan_10."""
    key = []
    for token in re.split(r"(\d+)", str(path)):
        key.append((int(token), "") if token.isdecimal() else (-1, token))
    return key


def existing(path: str | Path, what: str = "file") -> Path:
    """Return the path of a regular file that exists.

    Parameters
    ----------
    path : str or Path
        The file.
    what : str
        What the file is, for the messages.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    ValueError
        If it is a pipe or a device, or a pointer of Git LFS in the place of the file.
    """
    path = Path(path)
    if path.is_file():
        _refuse_pointer(path, what)
        return path
    if path.exists() and not path.is_dir():
        raise ValueError(
            f"{what} must be a regular file, got {kind_of(path)}, {path}: "
            "save what it gives to a file"
        )
    raise FileNotFoundError(f"{what} not found: {path}")


def taken_for(path: str | Path) -> str:
    """Return what lies at a path in the place of what was asked for, and what it is for.

    It is the end of an error: " (a result: `flgpr.view` shows it)"; "" where nobody can say.
    """
    path = Path(path)
    found = ""
    if path.is_file():
        with suppress(OSError, ValueError), open_named(path) as file:
            found = foreign_content(file.read(_LARGEST_POINTER))
        if not found and path.suffix.lower() in (".csv", ".txt"):
            found = "a table: alarms and truth are for `flgpr.score`"
    elif path.is_dir():
        folder = Folder(path)
        found = next((what for name, what in _FOLDERS.items() if folder.has(name)), "")
        if not found:
            inside = (entry for entry in islice(path.iterdir(), _MOST_ENTRIES) if entry.is_dir())
            names = [one.name for one in inside if any(Folder(one).has(name) for name in _FOLDERS)]
            found = f"a folder that holds {', '.join(sorted(names))}: name it" if names else ""
    return f" ({found})" if found else ""


def foreign_content(head: bytes) -> str:
    """Return what a file is by its first bytes, and what to do with it; "" for any other."""
    return next((what for magic, what in _FOREIGN.items() if head.startswith(magic)), "")


def _refuse_pointer(path: Path, what: str) -> None:
    """Refuse a pointer of Git LFS, which stands for a file that was not fetched."""
    if path.stat().st_size > _LARGEST_POINTER:
        return
    with open_named(path) as file:
        head = file.read(_LARGEST_POINTER)
    if head.startswith(_LFS):
        size = re.search(rb"^size (\d{1,18})$", head, re.MULTILINE)
        stated_size = f" of {int(size[1])} bytes" if size else ""
        raise ValueError(
            f"{path}: {what} is a pointer of Git LFS to a file{stated_size} that was not fetched: "
            "git lfs pull"
        )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Make a system error name the file that is written instead of its temporary name."""
    try:
        yield
    except OSError as error:
        names_temporary = error.filename is None or ".partial" in str(error.filename)
        if error.errno is not None and names_temporary:
            error.filename = str(path)
            error.filename2 = None
        raise


@contextmanager
def naming_output(output: Path) -> Iterator[None]:
    """Make a system error about a folder beside an output name the output, as a user typed it.

    The folder has the name of the output with an ending, such as ``.work``.
    """
    try:
        yield
    except OSError as error:
        if str(error.filename or "").startswith(f"{output}."):
            error.filename = str(output)
            error.filename2 = None
        raise


def sync_file(path: Path) -> None:
    """Flush a file's content to disk."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def write_whole(path: Path, data: bytes | str) -> None:
    """Write a file so that it holds either its old content or all of the new.

    A file that has these bytes already is left as it is. Of two processes that write the same file
    at once, the second waits for the first.

    Parameters
    ----------
    path : Path
        The file, in a folder that exists.
    data : bytes or str
        The content; text is written as UTF-8.

    Raises
    ------
    FileExistsError
        If the file or its temporary name is a symbolic link.
    OSError
        If the file cannot be written; the error names it.
    """
    refuse_links(path)
    content = text_bytes(data) if isinstance(data, str) else data
    if not system.OPENS_FOLDERS:
        _write_under_own_name(path, content)
        return
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
    """Return whether a path, which is no link, is a regular file with these bytes."""
    if not path.is_file() or path.stat().st_size != len(content):
        return False
    with open(path, "rb", opener=open_own) as file:
        return file.read() == content


@contextmanager
def own_partial(path: Path) -> Iterator[Path]:
    """Yield a temporary path that no other process, and no other call, uses.

    What is written there gets the name of ``path`` if nothing fails, and else goes.
    """
    temporary = path.with_name(f"{path.name}.{os.getpid()}-{os.urandom(4).hex()}{PARTIAL}")
    try:
        yield temporary
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _write_under_own_name(path: Path, content: bytes) -> None:
    """Write a file where an open file cannot be renamed.

    It is closed before it is renamed, so that no lock can last until then: every process writes
    under a temporary name of its own. What a killed process leaves stays.
    """
    with writing(path):
        if _holds(path, content):
            return
        with own_partial(path) as temporary, temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())


def _open_alone(temporary: Path) -> BinaryIO:
    """Open an empty file that no other process writes.

    A file that a killed process left is emptied and used again.
    """
    flags = os.O_RDWR | os.O_CREAT | system.NO_LINK | system.AT_ONCE | system.PLAIN
    while True:
        refuse_links(temporary)
        with suppress(FileNotFoundError):  # there is none, or another process has just renamed it
            if not stat.S_ISREG(temporary.lstat().st_mode):
                temporary.unlink()  # a pipe
        file = os.fdopen(os.open(temporary, flags, 0o666), "wb")
        with suppress(OSError):  # a file system without locks
            system.lock(file, wait=True)
        # Another process may have renamed or removed the file before this one had the lock.
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(file.fileno()), temporary.lstat()):
                file.truncate(0)
                return file
        file.close()


def replace_folder(new: Path, folder: Path) -> None:
    """Rename a complete folder to the name of an older one, which is removed.

    Parameters
    ----------
    new : Path
        The complete folder, on the same file system.
    folder : Path
        The name that it gets; a folder of this name is removed.

    Raises
    ------
    FileExistsError
        If one of the names is a symbolic link.
    OSError
        If a folder cannot be renamed.
    """
    old = replaced_by(folder)
    refuse_links(new, folder, old)
    shutil.rmtree(old, ignore_errors=True)
    # No system renames a folder over one that holds files: for a moment neither has the name.
    if folder.exists():
        folder.rename(old)
    new.rename(folder)
    sync_directory(folder.parent)
    shutil.rmtree(old, ignore_errors=True)


def replaced_by(folder: Path) -> Path:
    """Return the temporary name of a folder that is being replaced.

    It is no name that a user gives to a copy, so that what a killed process left can be removed.
    """
    return folder.with_name(f".replaced-by-{folder.name}")


def partial_folder(output: Path) -> Path:
    """Return the temporary folder in which an output is made."""
    if not output.name:
        raise ValueError(f"output must have a name of its own, got {str(output)!r}")
    return output.with_name(f"{PARTIAL_PREFIX}{output.name}")


def check_new(path: str | Path | None) -> None:
    """Refuse an output that exists, or is a symbolic link; None is no output."""
    if path is None:
        return
    refuse_links(Path(path))
    if Path(path).exists():
        raise FileExistsError(f"output must not exist yet, got {path}")


def check_free_folder(folder: str | Path, marks: Sequence[str], kind: str) -> Path:
    """Refuse an output folder that holds other files than an older output of its kind.

    Parameters
    ----------
    folder : str or Path
        The folder.
    marks : sequence of str
        File names by which an older output is known.
    kind : str
        What the output is called in the message.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        If the folder is not empty and holds none of ``marks``, or is a file. If it, or a name
        beside it that writing takes, is a symbolic link.
    """
    folder = Path(folder)
    refuse_links(folder, partial_folder(folder), replaced_by(folder))
    is_older_output = any((folder / name).is_file() for name in marks)
    if is_older_output or not folder.exists():
        return folder
    if folder.is_file() or any(folder.iterdir()):
        raise FileExistsError(
            f"output must be a new folder or an older {kind}, got {folder}, which holds other files"
        )
    return folder


def merge_tables(tables: Mapping[str, Any], more: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables with the entries of others put over them.

    Parameters
    ----------
    tables, more : mapping of str to value or table
        Nested tables; an entry of ``more`` replaces that of ``tables`` unless both are tables.

    Returns
    -------
    dict
        The merged tables; the arguments stay as they are.
    """
    merged = dict(tables)
    for name, entry in more.items():
        is_nested = isinstance(entry, dict) and isinstance(tables.get(name), dict)
        merged[name] = merge_tables(tables[name], entry) if is_nested else entry
    return merged


def read_with_digest(folder: str | Path, name: str) -> dict[str, Any]:
    """Read a file of an untrusted folder by :func:`parse_with_digest`.

    Parameters
    ----------
    folder : str or path
        The folder.
    name : str
        Name of the file in it.

    Returns
    -------
    dict
        The object, with its entry ``sha256``.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    return parse_with_digest(Folder(folder).read(name, MOST_JSON))
