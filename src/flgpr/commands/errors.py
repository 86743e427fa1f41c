"""What the user can mend, in one plain line: the rule, the file, and what the system said."""

from __future__ import annotations

import errno
import os
import re

MENDED = (ValueError, OSError, ModuleNotFoundError, RecursionError, MemoryError)
"""Errors that a command ends with exit status 2 for; any other is a fault of the program and shows where it arose."""
_ROOM = "the disk must have room for what is written"
_RULES = {
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: _ROOM,
    errno.EFBIG: "files must not grow larger than disk and account allow",
    errno.EROFS: "the disk must not be read-only: choose an output on another one",
    errno.EACCES: "this user must be allowed to read what is given and to write the output",
    errno.EPERM: "this user must be allowed to read what is given and to write the output",
    errno.ENAMETOOLONG: "names must be shorter, for files beside an output have a longer one",
    errno.EISDIR: "path must be a file and not a folder",
    errno.ENOTDIR: "path must lie in a folder and not in a file",
    errno.ENOENT: "file or folder must exist",
    errno.EEXIST: "output must not exist yet",
    errno.ENOTEMPTY: "output must not exist yet",
    errno.ELOOP: "links must lead somewhere",
    errno.EMFILE: "fewer files must be open at once",
    errno.ENFILE: "fewer files must be open at once",
    errno.EIO: "the disk must work; what was written before is whole",
}
_PYTHON = (
    (re.compile(r"\[Errno -?\d+\] "), ""),
    (re.compile(r"\b(?:Pure)?(?:Posix|Windows)?Path\((['\"])(.*?)\1\)"), r"\2"),
    (re.compile(r"\bnp\.\w+\(([^()]*)\)"), r"\1"),
    (re.compile(r"\bgot None\b"), "got none"),
)


def in_words(error: BaseException) -> str:
    """Say an error in one line without the program's own words."""
    if isinstance(error, RecursionError):
        return "what a file holds must not be nested so deeply; look for brackets in brackets in what was given"
    if isinstance(error, MemoryError):
        return f"the memory must hold what is asked for; {error or 'take less at once'}"
    if isinstance(error, OSError) and error.errno is not None and error.strerror:
        return _system_error(error)
    text = str(error)
    for pattern, words in _PYTHON:
        text = pattern.sub(words, text)
    return text


def _system_error(error: OSError) -> str:
    rule = _RULES.get(error.errno or 0, "the system must allow what is asked for")
    where = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
    return f"{rule}, got {where}{error.strerror}"
