"""What is drawn on a terminal: tables with names of any origin, and progress bars."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment

from flgpr.model.printable import for_terminal

T = TypeVar("T")


class PlainConsole(Console):
    """A console on which names from files are no markup and steer nothing.

    Parameters
    ----------
    **options
        Options of ``rich.console.Console``.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Yield what is drawn, text without the characters that steer a terminal."""
        for segment in super().render(renderable, options):
            text = segment.text if segment.control else for_terminal(segment.text)
            yield segment if text == segment.text else segment._replace(text=text)


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
