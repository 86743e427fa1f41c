"""Writing the files of a score into a folder, and recognizing a score that is already there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from flgpr.door import read_named, refuse_links
from flgpr.model.printable import text_bytes
from flgpr.store import write_whole
from flgpr.store.outputs import OVERWRITE, locked_folder, log_finished, output_exists_error

Files = Mapping[str, bytes | str]
"""Content of files, bytes or text in UTF-8, by name."""


def write_score_files(folder: Path, files: Files, overwrite: bool = True) -> None:
    """Write files into a folder, one process after the other.

    Parameters
    ----------
    folder : Path
        The folder, made if need be.
    files : mapping of str to str or bytes
        Content by name.
    overwrite : bool
        Whether files with other content may be replaced.

    Raises
    ------
    FileExistsError
        If files with other content are there and are not to be replaced, or the folder is a
        symbolic link.
    """
    refuse_links(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with locked_folder(folder, wait=True):
        if not must_write(folder, files, overwrite):
            return
        for name, content in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content)


def must_write(folder: Path, files: Files, overwrite: bool, last_file: str = "") -> bool:
    """Return whether files must be written, or are all there.

    Parameters
    ----------
    folder : Path
        The folder.
    files : mapping of str to str or bytes
        Content by name.
    overwrite : bool
        Whether files with other content may be replaced.
    last_file : str
        Name of the file that is written last. Where it is missing, the others belong to no score,
        or to one that was interrupted: they are written again, whatever they hold.

    Returns
    -------
    bool
        Whether they must.

    Raises
    ------
    FileExistsError
        If files with other content are there and are not to be replaced.
    """
    if overwrite:
        return True
    if last_file and not os.path.lexists(folder / last_file):
        return True
    is_missing = False
    for name, content in files.items():
        path = folder / name
        if not os.path.lexists(path):
            is_missing = True
            continue
        expected = text_bytes(content) if isinstance(content, str) else content
        if read_named(path) != expected:
            raise output_exists_error(path, f"{OVERWRITE}, or choose another output")
    if not is_missing:
        log_finished(folder, OVERWRITE)
    return is_missing


def with_last(files: Files, name: str) -> dict[str, bytes | str]:
    """Return files with one of them at the end: where it exists, all others do."""
    ordered = {key: content for key, content in files.items() if key != name}
    if name in files:
        ordered[name] = files[name]
    return ordered
