"""What the commands share: options, plain errors, progress."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from flgpr.chain.progress import Track, silent
from flgpr.commands.messages import is_unchanged
from flgpr.commands.messages import plain_errors as plain_errors

Quiet = Annotated[bool, Option("--quiet", help="Print nothing but errors.")]
Json = Annotated[bool, Option("--json", help="Print one JSON object instead of words.")]
Scheduler = Annotated[
    str | None, Option(help="Dask scheduler (tcp://host:8786) whose workers do the work.")
]
Output = Annotated[Path, Option("-o", "--output", help="What to write.")]
Overwrite = Annotated[
    bool, Option("--overwrite", help="Make it anew, whatever the output holds of an earlier one.")
]


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
        if path is not None and not is_unchanged(path) and not quiet:
            typer.echo(f"wrote {path}")


@contextmanager
def progress(quiet: bool) -> Iterator[Track]:
    """Show bars, or nothing."""
    if quiet:
        yield silent
    else:
        from flgpr.commands.bars import Bars

        with Bars() as bars:
            yield bars
