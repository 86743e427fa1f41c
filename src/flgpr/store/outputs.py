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

from flgpr.append_log import sync_directory
from flgpr.store.files import replace_folder, sync_file, writing

_LOG = logging.getLogger("flgpr.outputs")
DELETE = "delete it to make it anew"
OVERWRITE = "--overwrite makes it anew"


class BusyError(ValueError):
    """Another process is writing the same output."""


def tell_finished(output: str | Path, anew: str = DELETE) -> None:
    """Log that an output is there already as this call would make it, and how to make it ``anew``."""
    words = "%s is there already, made from the same: nothing was written; %s"
    _LOG.info(words, output, anew, extra={"output": output})


def other_output(
    output: str | Path, anew: str = "move it away or choose another output"
) -> FileExistsError:
    """Make the error that something else lies where an output is to be made."""
    return FileExistsError(
        f"output must not exist yet, got {output}, which holds something else: {anew}"
    )


@contextmanager
def held_folder(folder: Path, wait: bool = False) -> Iterator[None]:
    """Hold a folder, made if need be, so that no other process writes there; wait for one that does.

    Without ``wait`` that is a BusyError.
    """
    handle = _hold(folder, wait)
    try:
        yield
    finally:
        os.close(handle)


def _hold(folder: Path, wait: bool) -> int:
    """Open and lock a folder; begin again where another process has just taken it away."""
    while True:
        folder.mkdir(exist_ok=True)
        try:
            handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except FileNotFoundError:
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
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
def whole_output(path: Path, replace: bool = False, more: bool = False) -> Iterator[Path]:
    """Give a place, with its name, to write a file or a folder to, which gets its own if nothing fails.

    What is there already stays if it has the same bytes, is replaced if that is wanted, or is a FileExistsError. With
    ``more`` a folder that stays may hold other files as well.
    """
    partial = path.with_name(f".partial-{path.name}")
    with writing(path), held_folder(partial):
        _empty(partial)
        made = partial / path.name
        try:
            yield made
            if made.is_file():
                sync_file(made)
            if not replace:
                _put(made, path, more)
            elif made.is_dir():
                replace_folder(made, path)
            else:
                made.replace(path)
            sync_directory(path.parent)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def write_new(path: Path, data: bytes | str) -> None:
    """Write a new file, text as UTF-8; one that is there must have the same bytes, else it is a FileExistsError."""
    with whole_output(path) as made:
        made.write_bytes(data.encode() if isinstance(data, str) else data)


def same_content(first: Path, second: Path, more: bool = False) -> bool:
    """Tell whether two files, or all files of two folders, have the same bytes; links are never the same.

    With ``more`` the second folder may hold other files as well.
    """
    if first.is_symlink() or second.is_symlink():
        return False
    if first.is_dir() and second.is_dir():
        names, others = ({path.name for path in folder.iterdir()} for folder in (first, second))
        listed = names <= others if more else names == others
        return listed and all(
            same_content(first / name, second / name, more) for name in sorted(names)
        )
    return first.is_file() and second.is_file() and filecmp.cmp(first, second, shallow=False)


def _put(made: Path, output: Path, more: bool) -> None:
    """Give what was made its name, unless the same lies there."""
    if _named(made, output):
        return
    if not same_content(made, output, more):
        raise other_output(output)
    tell_finished(output)


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
