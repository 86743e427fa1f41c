"""Outputs: made beside their place by one process at a time, named when they are whole, and never over another.

What a killed process left beside an output is held by nobody, and the next process that makes the output takes it away.
"""

from __future__ import annotations

import fcntl
import filecmp
import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from flgpr.io.files import replace_folder, sync_directory, sync_file

_LOG = logging.getLogger("flgpr.outputs")
DELETE = "delete it to make it anew"
OVERWRITE = "--overwrite makes it anew"


class BusyError(ValueError):
    """Another process is writing the same output."""


def tell_finished(output: str | Path, anew: str = DELETE) -> None:
    """Log that an output is there already as this call would make it, and how to make it ``anew``."""
    _LOG.info("%s is there already, made of the same: nothing was written; %s", output, anew, extra={"output": output})


def other_output(output: str | Path, anew: str = "move it away or choose another output") -> FileExistsError:
    """Make the error that something else lies where an output is to be made."""
    return FileExistsError(f"output must not exist yet, got {output}, which holds something else: {anew}")


@contextmanager
def held_folder(folder: Path) -> Iterator[None]:
    """Hold a folder, made if need be, so that no other process writes there; if one does that is a BusyError."""
    handle = _hold(folder)
    try:
        yield
    finally:
        os.close(handle)


def _hold(folder: Path) -> int:
    """Open and lock a folder; begin again where another process has just taken it away."""
    while True:
        folder.mkdir(exist_ok=True)
        try:
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except FileNotFoundError:
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise BusyError(
                f"{folder}: another process is writing here: wait until it is done, or choose another output"
            ) from None
        except OSError:  # a file system without locks
            return handle
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), folder.stat()):
                return handle
        os.close(handle)


@contextmanager
def partial_folder(folder: Path, replace: bool = False) -> Iterator[Path]:
    """Give an empty folder to write to, which gets its name if nothing fails.

    A folder of that name stays if it holds the same, is replaced if that is wanted, or is a FileExistsError.
    """
    partial = folder.with_name(f"{folder.name}.partial")
    with held_folder(partial):
        _empty(partial)
        try:
            yield partial
            if replace:
                replace_folder(partial, folder)
            else:
                _put(partial, folder)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Give a place to write a file to, with its name, which it gets in its folder if nothing fails.

    A file that is there already stays if it has the same bytes; else it is a FileExistsError.
    """
    partial = path.with_name(f".partial-{path.name}")
    with held_folder(partial):
        _empty(partial)
        try:
            yield partial / path.name
            sync_file(partial / path.name)
            _put(partial / path.name, path)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def write_new(path: Path, data: bytes | str) -> None:
    """Write a new file, text as UTF-8, by the rules of :func:`new_file`."""
    with new_file(path) as made:
        made.write_bytes(data.encode() if isinstance(data, str) else data)


def same_content(first: Path, second: Path) -> bool:
    """Tell whether two files, or all files of two folders, have the same bytes; links are never the same."""
    if first.is_symlink() or second.is_symlink():
        return False
    if first.is_dir() and second.is_dir():
        names, others = ({path.name for path in folder.iterdir()} for folder in (first, second))
        return names == others and all(same_content(first / name, second / name) for name in sorted(names))
    return first.is_file() and second.is_file() and filecmp.cmp(first, second, shallow=False)


def _put(made: Path, output: Path) -> None:
    """Give what was made its name, unless the same lies there."""
    if _named(made, output):
        sync_directory(output.parent)
    elif same_content(made, output):
        tell_finished(output)
    else:
        raise other_output(output)


def _named(made: Path, output: Path) -> bool:
    """Give a file or folder its name in one step, unless something has that name."""
    if made.is_dir():
        if os.path.lexists(output) and not (output.is_dir() and not any(output.iterdir())):
            return False
        with suppress(OSError):  # another process has just made it
            made.rename(output)
            return True
        return False
    try:
        os.link(made, output)  # which, other than renaming, replaces nothing
    except FileExistsError:
        return False
    except OSError:  # a file system without hard links
        if os.path.lexists(output):
            return False
        made.rename(output)
    return True


def _empty(folder: Path) -> None:
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
