"""What the commands share: options, plain errors, progress."""

from __future__ import annotations

import errno
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from flgpr.chain.progress import Track, silent

Quiet = Annotated[bool, Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[bool, Option("--json", help="Print one JSON object instead of words.")]
Scheduler = Annotated[str | None, Option(help="Dask scheduler (tcp://host:8786) whose workers do the work.")]
Output = Annotated[Path, Option("-o", "--output", help="What to write.")]


@contextmanager
def plain_errors() -> Iterator[None]:
    """Turn what the user can mend into one line and exit status 2, and warnings into one line each."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            yield
    except (ValueError, FileNotFoundError, FileExistsError, PermissionError, ModuleNotFoundError) as error:
        said = str(error)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        said = f"the disk must have room for what is written, got {error}"
    else:
        return
    typer.echo(f"error: {said}", err=True)
    raise typer.Exit(2)


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
    """Name what was written, unless nothing is to be printed."""
    for path in paths:
        if path is not None and not quiet:
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
