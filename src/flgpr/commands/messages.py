"""What a command prints beside its result: one line for an error, a warning or a note.

An error that the user can mend is told by its rule, the file and the cause.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from flgpr.model.printable import for_terminal

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

INTERRUPTED = 130
"""Exit status of a command that was interrupted: 128 and the number of the signal."""
STOPPED = "stopped"
GOES_ON = "stopped; the same command goes on"

_unchanged_outputs: set[str] = set()
"""Outputs that the running command left as they were: they were made of the same inputs."""


@contextmanager
def plain_errors(
    quiet: bool = False, stopped: str = STOPPED, typed_names: Mapping[str, str] | None = None
) -> Iterator[None]:
    """Print errors that the user can mend in one line, with exit status 2, and warnings likewise.

    An output that was left as it was is reported in a line unless ``quiet``, and is no error. An
    interrupt (Ctrl-C) prints the line ``stopped``, with exit status 130. ``typed_names`` are the
    options of the command line by the names that they have in Python.
    """
    # Several commands may run in one process, as tests do.
    _unchanged_outputs.clear()
    unchanged = _attached("flgpr.outputs", _UnchangedOutputs(quiet, typed_names))
    reading = _attached("flgpr.notes", _ReadingNotes(quiet, typed_names))
    try:
        with warnings.catch_warnings(), unchanged, reading:
            warnings.showwarning = _show_warning
            yield
    except (KeyboardInterrupt, typer.Abort):  # the second at a prompt, whose input may end, too
        say(stopped, err=True)
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:  # the program that read the output has ended
        raise
    except USER_ERRORS as error:
        say(f"error: {in_shell_words(plain_message(error), typed_names)}", err=True)
        raise typer.Exit(2) from None


def in_shell_words(text: str, typed_names: Mapping[str, str] | None) -> str:
    """Return a message with options and commands for the parameters and verbs of Python.

    Messages name a parameter as Python does: in backticks where its name could be a word of the
    sentence, `fresh`; and a verb as `flgpr.train`.
    """
    for name, typed in (typed_names or {}).items():
        bare = rf"|(?<![\w.-]){name}(?![\w-])" if "_" in name else ""
        text = re.sub(rf"`{name}`{bare}", typed, text)
    return re.sub(r"`flgpr\.(\w+)`", r"`flgpr \1`", text)


def is_unchanged(output: Path) -> bool:
    """Return whether the running command left an output as it was."""
    return str(output) in _unchanged_outputs


def say(text: Any, err: bool = False, nl: bool = True) -> None:
    """Print text of any origin, see :func:`flgpr.model.printable.for_terminal`.

    All that a command prints goes through here, or through ``Drawn`` (``shell.py``) where it is
    drawn.

    Parameters
    ----------
    text : object
        The text.
    err : bool
        Whether it goes to the error stream.
    nl : bool
        Whether a line end follows.
    """
    typer.echo(for_terminal(str(text)), err=err, nl=nl)


class _Printer(logging.Handler):
    """Prints messages of a logger on the error stream, unless the command is quiet."""

    def __init__(self, quiet: bool, typed_names: Mapping[str, str] | None) -> None:
        super().__init__()
        self._quiet = quiet
        self._typed_names = typed_names
        self._printed: set[str] = set()

    def tell(self, text: str) -> None:
        """Print a line."""
        if not self._quiet:
            say(in_shell_words(text, self._typed_names), err=True)


class _ReadingNotes(_Printer):
    """Prints what was found, replaced or assumed on reading, each line once."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a message of ``flgpr.store.notes.log_note``."""
        text = record.getMessage()
        if text not in self._printed:
            self.tell(f"note: {text}")
        self._printed.add(text)


class _UnchangedOutputs(_Printer):
    """Prints and remembers outputs that are left as they were."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a message of :func:`flgpr.store.outputs.log_finished`."""
        _unchanged_outputs.add(str(vars(record).get("output")))
        self.tell(record.getMessage())


@contextmanager
def _attached(name: str, handler: logging.Handler) -> Iterator[None]:
    """Let a handler take the messages of a logger for as long as a command runs."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.INFO)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


def _show_warning(message: Warning | str, *position: Any, **source: Any) -> None:  # noqa: ARG001
    """Print a warning without its position in the source."""
    say(f"warning: {message}", err=True)


def plain_message(error: BaseException) -> str:
    """Return the message of an error without names of Python's types."""
    if isinstance(error, RecursionError):
        return "brackets in a file must not be nested so deeply; look for them in the inputs"
    if isinstance(error, MemoryError):
        return f"the memory must hold what is asked for; {error or 'take less at once'}"
    if isinstance(error, OSError) and error.errno is not None and error.strerror:
        rule = _RULES.get(error.errno, "the system must allow what is asked for")
        file = "" if error.filename is None else f"{os.fsdecode(error.filename)}: "
        return f"{rule}, got {file}{error.strerror}"
    text = _plain_text(error)
    for pattern, replacement in _REPLACEMENTS:
        text = pattern.sub(replacement, text)
    return text


def _plain_text(error: BaseException) -> str:
    """Return the text of an error; one of Python about characters in our words."""
    if isinstance(error, UnicodeEncodeError):
        letter = ord(error.object[error.start])
        return f"text must be of whole characters, got half of one, U+{letter:04X}"
    if isinstance(error, UnicodeDecodeError):
        return f"text must be {error.encoding.upper()}, got other bytes at byte {error.start}"
    return str(error)
