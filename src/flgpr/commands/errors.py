"""Messages of errors that the user can mend: one line with the rule, the file and the cause."""

from __future__ import annotations

import errno
import os
import re

USER_ERRORS = (ValueError, OSError, ModuleNotFoundError, RecursionError, MemoryError)
"""Errors for which a command ends with exit status 2.

Any other error is a fault of the program and shows its traceback.
"""
_ROOM = "the disk must have room for what is written"
_PERMISSION = "this user must be allowed to read the inputs and to write the output"
_NEW_OUTPUT = "output must not exist yet"
_OPEN_FILES = "fewer files must be open at once"
_RULES = {
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: _ROOM,
    errno.EFBIG: "files must not grow larger than disk and account allow",
    errno.EROFS: "the disk must not be read-only: choose an output on another one",
    errno.EACCES: _PERMISSION,
    errno.EPERM: _PERMISSION,
    errno.ENAMETOOLONG: "names must be shorter: files beside an output have a longer one",
    errno.EISDIR: "path must be a file and not a folder",
    errno.ENOTDIR: "path must lie in a folder and not in a file",
    errno.ENOENT: "file or folder must exist",
    errno.EEXIST: _NEW_OUTPUT,
    errno.ENOTEMPTY: _NEW_OUTPUT,
    errno.ELOOP: "links must lead to a file or folder",
    errno.EMFILE: _OPEN_FILES,
    errno.ENFILE: _OPEN_FILES,
    errno.EIO: "the disk must work; what was written before is complete",
}
_REPLACEMENTS = (
    (re.compile(r"\[Errno -?\d+\] "), ""),
    (re.compile(r"\b(?:Pure)?(?:Posix|Windows)?Path\((['\"])(.*?)\1\)"), r"\2"),
    (re.compile(r"\bnp\.\w+\(([^()]*)\)"), r"\1"),
    (re.compile(r"\bgot None\b"), "got none"),
)


def plain_message(error: BaseException) -> str:
    """Return the message of an error without names of Python's types."""
    if isinstance(error, RecursionError):
        return "brackets in a file must not be nested so deeply; look for them in the inputs"
    if isinstance(error, MemoryError):
        return f"the memory must hold what is asked for; {error or 'take less at once'}"
    if isinstance(error, OSError) and error.errno is not None and error.strerror:
        return _system_error(error)
    text = str(error)
    for pattern, replacement in _REPLACEMENTS:
        text = pattern.sub(replacement, text)
    return text


def _system_error(error: OSError) -> str:
    """Return the rule that the system's error stands for, the file and the system's message."""
    rule = _RULES.get(error.errno or 0, "the system must allow what is asked for")
    file = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
    return f"{rule}, got {file}{error.strerror}"
