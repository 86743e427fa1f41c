"""Progress bars on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from flgpr.commands.console import PlainConsole

T = TypeVar("T")


class Bars:
    """Progress bars on the error stream, one per piece of work.

    A context manager that is called like any ``Track``.
    """

    def __init__(self) -> None:
        self._progress = Progress(
            TextColumn("{task.description:<32}", markup=False),
            BarColumn(bar_width=30),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=PlainConsole(stderr=True),
        )

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress.tasks:
            self._progress.stop()

    def __call__(self, items: Iterable[T], label: str, total: int) -> Iterator[T]:
        """Iterate over items under a bar labelled by what is being done."""
        self._progress.start()
        task = self._progress.add_task(label, total=total)
        for item in items:
            yield item
            self._progress.advance(task)
