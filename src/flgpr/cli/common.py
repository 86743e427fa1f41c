"""What the commands share: options, plain errors, progress."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from flgpr.chain.progress import Track, silent
from flgpr.cli.errors import MENDED, in_words

Quiet = Annotated[bool, Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[bool, Option("--json", help="Print one JSON object instead of words.")]
Scheduler = Annotated[
    str | None, Option(help="Dask scheduler (tcp://host:8786) whose workers do the work.")
]
Output = Annotated[Path, Option("-o", "--output", help="What to write.")]
Overwrite = Annotated[
    bool, Option("--overwrite", help="Make it anew, whatever the output holds of an earlier one.")
]


_there_already: set[str] = set()
"""Outputs that the command in hand found there already, made of the same."""


@contextmanager
def plain_errors(quiet: bool = False) -> Iterator[None]:
    """Turn what the user can mend into one line and exit status 2, and warnings into one line each.

    An output that was there already, made of the same, is told in a line unless ``quiet``, and is no error.
    """
    try:
        with warnings.catch_warnings(), _there_already_told(quiet):
            warnings.showwarning = _show_warning
            yield
    except BrokenPipeError:  # whoever read the output has gone
        raise
    except MENDED as error:
        typer.echo(f"error: {in_words(error)}", err=True)
        raise typer.Exit(2) from None


class _Notes(logging.Handler):
    """Prints what was found, replaced or assumed on reading, each line once."""

    def __init__(self, quiet: bool) -> None:
        super().__init__()
        self._quiet = quiet
        self._said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Take a message of ``flgpr.store.notes.tell_note``."""
        text = record.getMessage()
        if not self._quiet and text not in self._said:
            typer.echo(f"note: {text}", err=True)
        self._said.add(text)


class _Teller(logging.Handler):
    """Prints, and remembers, what was there already."""

    def __init__(self, quiet: bool) -> None:
        super().__init__()
        self._quiet = quiet

    def emit(self, record: logging.LogRecord) -> None:
        """Take a message of :func:`flgpr.store.outputs.tell_finished`."""
        _there_already.add(str(vars(record).get("output")))
        if not self._quiet:
            typer.echo(record.getMessage(), err=True)


@contextmanager
def _there_already_told(quiet: bool) -> Iterator[None]:
    _there_already.clear()
    with _heard("flgpr.outputs", _Teller(quiet)), _heard("flgpr.notes", _Notes(quiet)):
        yield


@contextmanager
def _heard(name: str, handler: logging.Handler) -> Iterator[None]:
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


def _show_warning(message: Warning | str, *where: Any, **more: Any) -> None:  # noqa: ARG001
    typer.echo(f"warning: {message}", err=True)


def with_witness(book: Path | None, witness: Path | None) -> Any:
    """Put a register and the witness of it together; a witness alone is a ValueError."""
    if witness is None:
        return book
    if book is None:
        raise ValueError(f"--witness goes with --book, got --witness {witness} alone")
    from flgpr import tasks

    return tasks.WitnessedRegister(book, witness)


def tell_written(quiet: bool, *paths: Path | None) -> None:
    """Name what was written and was not there already, unless nothing is to be printed."""
    for path in paths:
        if path is not None and str(path) not in _there_already and not quiet:
            typer.echo(f"wrote {path}")


@contextmanager
def progress(quiet: bool) -> Iterator[Track]:
    """Show bars, or nothing."""
    if quiet:
        yield silent
    else:
        from flgpr.cli.bars import Bars

        with Bars() as bars:
            yield bars
