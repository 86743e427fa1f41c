"""Options of commands that run recipes: processes, memory and progress."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flgpr.commands.options import PathLike, size_in_bytes

if TYPE_CHECKING:
    from flgpr.jobs.workers import RunOptions
    from flgpr.progress import Track


def run_options(
    workers: int | None = None,
    scheduler: str | None = None,
    max_memory: str | int = "2GB",
    track: Track | None = None,
    note: Any = None,
    pass_cache: PathLike | None = None,
) -> RunOptions:
    """Return the options of a run; what is None keeps its default.

    Parameters
    ----------
    workers : int, optional
        Processes.
    scheduler : str, optional
        Address of a Dask scheduler.
    max_memory : int or str
        Memory of each process, such as "2GB".
    track : Track, optional
        Shows progress.
    note : callable, optional
        Takes a report of every piece of work that was done.
    pass_cache : path, optional
        Folder of backgrounds and run-views that other recipes share.

    Returns
    -------
    RunOptions
        The options.
    """
    from flgpr.jobs.workers import RunOptions

    reporting: dict[str, Any] = {}
    if track is not None:
        reporting["track"] = track
    if note is not None:
        reporting["note"] = note
    memory = size_in_bytes(max_memory)
    return RunOptions(workers, scheduler, memory, pass_cache=pass_cache, **reporting)
