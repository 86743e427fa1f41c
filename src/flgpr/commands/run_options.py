"""Who does the work of a command that runs recipes, and how much memory it takes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flgpr.commands.options import PathLike, size_in_bytes

if TYPE_CHECKING:
    from flgpr.chain.progress import Track
    from flgpr.execution.survey import RunOptions


def run_options(
    workers: int | None = None,
    scheduler: str | None = None,
    max_memory: str | int = "2GB",
    track: Track | None = None,
    note: Any = None,
    pass_cache: PathLike | None = None,
) -> RunOptions:
    """Return the options of a run; what is None keeps its default."""
    from flgpr.execution.survey import RunOptions

    options: dict[str, Any] = {"track": track, "note": note}
    chosen = {name: value for name, value in options.items() if value is not None}
    return RunOptions(
        workers, scheduler, size_in_bytes(max_memory), pass_cache=pass_cache, **chosen
    )
