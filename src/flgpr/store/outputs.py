"""Outputs: made under a temporary name by one process at a time, and renamed when complete.

No output replaces another. What a killed process left under a temporary name is locked by nobody,
and the next process that makes the output removes it.
"""

from __future__ import annotations

import filecmp
import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from flgpr import system
from flgpr.append_log import sync_directory
from flgpr.door import refuse_links
from flgpr.model.printable import text_bytes
from flgpr.store.files import (
    PARTIAL_PREFIX,
    partial_folder,
    replace_folder,
    replaced_by,
    sync_file,
    writing,
)

_LOG = logging.getLogger("flgpr.outputs")
DELETE = "delete it to make it again"
OVERWRITE = "`overwrite` makes it again"


class BusyError(ValueError):
    """Another process is writing the same output."""


def log_finished(output: str | Path, remedy: str = DELETE) -> None:
    """Log that an output exists as this call would make it, and the ``remedy`` to make it again.

    What a killed writer left beside it goes: its kill may have come after the output had its name.
    """
    _discard_partial(Path(output))
    message = "%s exists already, made from the same inputs: nothing was written; %s"
    _LOG.info(message, output, remedy, extra={"output": output})


def _discard_partial(path: Path) -> None:
    """Remove the temporary folder of an output, unless a process is writing there."""
    partial = partial_folder(path)
    if not partial.is_dir() or partial.is_symlink():
        return
    with suppress(BusyError, OSError), locked_folder(partial):
        shutil.rmtree(partial, ignore_errors=True)


def discard_partials(folder: Path) -> None:
    """Remove what killed writers left in a folder of outputs; nothing if there is no folder."""
    for partial in sorted(folder.glob(f"{PARTIAL_PREFIX}*")):
        _discard_partial(partial.with_name(partial.name.removeprefix(PARTIAL_PREFIX)))


def output_exists_error(
    output: str | Path, remedy: str = "move it away or choose another output"
) -> FileExistsError:
    """Return the error for an output path at which something else lies."""
    return FileExistsError(
        f"output must not exist yet, got {output}, which holds something else: {remedy}"
    )


@contextmanager
def locked_folder(folder: Path, wait: bool = False, output: Path | None = None) -> Iterator[None]:
    """Lock a folder, made if need be, so that no other process writes there.

    If one does already, that is a BusyError, or with ``wait`` this process waits for it. The error
    names the ``output`` that is made in the folder, by default the folder itself. A folder that is
    a symbolic link is a FileExistsError.
    """
    hold = _hold if system.OPENS_FOLDERS else _hold_beside
    handle = hold(folder, wait, output or folder)
    try:
        yield
    finally:
        os.close(handle)
        if not system.OPENS_FOLDERS:
            with suppress(OSError):  # another process waits for it
                _lock_file_of(folder).unlink()


def _hold(folder: Path, wait: bool, output: Path) -> int:
    """Open and lock a folder, again and again while other processes remove it meanwhile."""
    while True:
        refuse_links(folder)
        folder.mkdir(exist_ok=True)
        try:
            handle = os.open(folder, os.O_RDONLY | system.DIRECTORY | system.NO_LINK)
        except FileNotFoundError:
            continue
        if not _lock(handle, output, wait):
            return handle
        # The folder may have been removed before it was locked; then another one has its name.
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), folder.lstat()):
                return handle
        os.close(handle)


def _lock(handle: int, output: Path, wait: bool) -> bool:
    """Lock what stands for a folder, and return whether its file system has locks.

    A lock of another process is a BusyError on the output, and the handle is closed.
    """
    try:
        system.lock(handle, wait=wait)
    except BlockingIOError:
        os.close(handle)
        raise BusyError(
            f"{output}: another process is writing here: wait until it is done, "
            "or choose another output"
        ) from None
    except OSError:
        return False
    return True


def _lock_file_of(folder: Path) -> Path:
    """Return the file that is locked in place of a folder that cannot be opened."""
    return folder.with_name(folder.name + ".lock")


def _hold_beside(folder: Path, wait: bool, output: Path) -> int:
    """Make a folder and lock a file beside it, where a folder cannot be opened."""
    refuse_links(folder, _lock_file_of(folder))
    folder.mkdir(exist_ok=True)
    handle = os.open(_lock_file_of(folder), os.O_RDWR | os.O_CREAT | system.PLAIN, 0o666)
    _lock(handle, output, wait)
    return handle


@contextmanager
def atomic_output(path: Path, replace: bool = False, more: bool = False) -> Iterator[Path]:
    """Yield a temporary path for a file or folder, which is renamed to ``path`` if nothing fails.

    Parameters
    ----------
    path : Path
        The output.
    replace : bool
        Replace an output that exists. Otherwise one of the same bytes stays as it is, and any other
        is an error.
    more : bool
        Let a folder that stays hold other files as well.

    Yields
    ------
    Path
        A path of the same name in a locked folder beside the output.

    Raises
    ------
    FileExistsError
        If another output lies there, or it or a temporary name beside it is a symbolic link.
    BusyError
        If another process makes the same output.
    OSError
        If it cannot be written; the error names the output.
    """
    partial = partial_folder(path)
    refuse_links(path, replaced_by(path))
    with writing(path), locked_folder(partial, output=path):
        _empty(partial)  # of what a killed process left
        temporary = partial / path.name
        try:
            yield temporary
            if temporary.is_file():
                sync_file(temporary)
            refuse_links(path)  # that somebody made meanwhile
            if not replace:
                _rename_unless_same(temporary, path, more)
            elif temporary.is_dir():
                replace_folder(temporary, path)
            else:
                temporary.replace(path)
            sync_directory(path.parent)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def write_new(path: Path, data: bytes | str) -> None:
    """Write a new file, text as UTF-8.

    Parameters
    ----------
    path : Path
        The file.
    data : bytes or str
        The content.

    Raises
    ------
    FileExistsError
        If a file with other bytes is there.
    """
    content = text_bytes(data) if isinstance(data, str) else data
    with atomic_output(path) as temporary:
        temporary.write_bytes(content)


def same_content(first: Path, second: Path, more: bool = False) -> bool:
    """Return whether two files, or all files of two folders, have the same bytes.

    Links are never the same.

    Parameters
    ----------
    first : Path
        A file or folder.
    second : Path
        Another one.
    more : bool
        Whether the second folder may hold other files as well.

    Returns
    -------
    bool
        Whether they are the same.
    """
    if first.is_symlink() or second.is_symlink():
        return False
    if first.is_dir() and second.is_dir():
        first_names = {path.name for path in first.iterdir()}
        second_names = {path.name for path in second.iterdir()}
        has_names = first_names <= second_names if more else first_names == second_names
        if not has_names:
            return False
        return all(same_content(first / name, second / name, more) for name in sorted(first_names))
    return first.is_file() and second.is_file() and filecmp.cmp(first, second, shallow=False)


def _rename_unless_same(temporary: Path, output: Path, more: bool) -> None:
    """Rename an output, unless one of the same content has its name."""
    if _renamed(temporary, output):
        return
    if not same_content(temporary, output, more):
        raise output_exists_error(output)
    log_finished(output)


def _renamed(temporary: Path, output: Path) -> bool:
    """Rename a file or folder in one step; return False if something else has that name."""
    if temporary.is_dir():
        is_empty_folder = output.is_dir() and not any(output.iterdir())
        if os.path.lexists(output) and not is_empty_folder:
            return False
        with suppress(OSError):  # another process has just made it
            temporary.rename(output)
            return True
        return False
    try:
        os.link(temporary, output)  # unlike renaming, it never replaces a file
    except FileExistsError:
        return False
    except OSError:  # a file system without hard links
        if os.path.lexists(output):
            return False
        temporary.rename(output)
    return True


def _empty(folder: Path) -> None:
    """Remove all files and folders of a folder."""
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
