"""What commands that run recipes share: where runs and results lie, and who does the work."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flgpr.commands.options import PathLike, size_in_bytes

if TYPE_CHECKING:
    import xarray as xr

    from flgpr.jobs.workers import RunOptions
    from flgpr.method.detection import Detection
    from flgpr.model import Lane
    from flgpr.progress import Track
    from flgpr.results.result import Result

_MOST_WORKERS = 8  # for each core
T = TypeVar("T")
DEMO_COMPARISONS = ("mean-self-signature", "median-self-signature", "roadside-suppressed")
"""Names, after ``demo-``, of the recipes that the demonstration compares with the recipe demo."""


def is_in_memory(run: Any) -> bool:
    """Return whether a run is no path of a store."""
    return not isinstance(run, str | Path)


class RunLocations:
    """Paths of a run and its result; what is in memory is stored in a temporary folder.

    The folder lives as long as the result that :meth:`result` returns.

    Parameters
    ----------
    run : str, path or xarray.Dataset
        The run, or its store.
    output : str or path, optional
        Result folder to make; by default a temporary one.
    other_runs : mapping of str to run or path
        Runs taken together with it, by the names that the recipe gives them.
    """

    def __init__(self, run: Any, output: PathLike | None, other_runs: Mapping[str, Any]) -> None:
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self.run: Path = self._store_of(run, "run")
        self.other_runs: dict[str, Path] = {}
        for name, other_run in other_runs.items():
            self.other_runs[name] = self._store_of(other_run, name)
        self.output = self._folder() / "result" if output is None else Path(output)
        self._result_is_temporary = output is None

    def __enter__(self) -> RunLocations:
        return self

    def __exit__(self, *_: object) -> None:
        if self._temporary is not None and not self._result_is_temporary:
            self._temporary.cleanup()

    def result(self) -> Result:
        """Read the result that was made."""
        from flgpr.results.result import read_lane_result

        result = read_lane_result(self.output)
        # The result reads its files when it is asked: the folder must live as long.
        if self._temporary is not None:
            weakref.finalize(result, self._temporary.cleanup)
        return result

    def _folder(self) -> Path:
        """Return the temporary folder, made on first use."""
        if self._temporary is None:
            self._temporary = tempfile.TemporaryDirectory(prefix="flgpr-")
        return Path(self._temporary.name)

    def _store_of(self, run: Any, name: str) -> Path:
        """Return the store of a run; a run in memory is saved first."""
        if not is_in_memory(run):
            return Path(run)
        if not hasattr(run, "data_vars"):
            raise ValueError(f"runs must be run stores or datasets, got a {type(run).__name__}")
        from flgpr.store import save_run

        store = self._folder() / f"{name}.zarr"
        save_run(run, store)
        return store


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
    from flgpr.jobs.workers import RunOptions, ignore_report
    from flgpr.progress import silent

    memory = size_in_bytes(max_memory)
    cores = os.cpu_count() or 1
    if workers is not None and workers > _MOST_WORKERS * cores:
        raise ValueError(
            f"workers must be at most {_MOST_WORKERS} for each of the {cores} cores of this "
            f"machine, got {workers}: more only wait for one another"
        )
    return RunOptions(
        workers, scheduler, memory, track or silent, note or ignore_report, pass_cache
    )


def detect_compared(run: xr.Dataset, name: str, text: str, lane: Lane, track: Track) -> Detection:
    """Detect on a run by a recipe that is compared with a result's own.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    name : str
        Name of the detection.
    text : str
        The recipe, TOML.
    lane : Lane
        The lane.
    track : Track
        Shows progress.

    Returns
    -------
    Detection
        The detection, under its name.
    """
    from flgpr.method.method import detect
    from flgpr.recipe.schema import parse_recipe

    def track_with_name(items: Iterable[T], label: str, total: int) -> Iterable[T]:
        return track(items, f"{name}: {label}", total)

    detection = detect(run, parse_recipe(text), lane, track_with_name)
    return replace(detection, name=name, recipe_text=text)
