"""What is drawn on a terminal: tables and bars with names of any origin."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from flgpr.model.printable import for_terminal


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
