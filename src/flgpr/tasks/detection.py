"""Detection on stored runs: files in, files out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import parse_recipe, recipe_text
from flgpr.chain.recipe_for_run import area_of, recipe_for
from flgpr.execution.driver import Note, detect_lane, results_at, unnoted
from flgpr.execution.job import make_job
from flgpr.execution.survey import DEFAULTS, RunOptions, detect_survey, lane_names
from flgpr.results.result import Result, read_result
from flgpr.store import MAX_MEMORY, open_run, read_lane

PathLike = str | Path


def detect_run(
    run: PathLike,
    recipe: PathLike | None,
    output: PathLike,
    lane: PathLike | None = None,
    track: Track = silent,
    report: bool = True,
    model: PathLike | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    note: Note = unnoted,
    max_memory: int = MAX_MEMORY,
    others: Mapping[str, PathLike] | None = None,
) -> Result:
    """Detect on a stored run block by block and write a result folder with its report; a stopped call goes on.

    An input that is not valid, or an output that would overwrite something else, is refused before
    anything is written.

    Parameters
    ----------
    run, output : path
        Run store, and result folder to make.
    recipe : str or path or None
        Packaged recipe or TOML file; None makes one for the run, see
        :func:`flgpr.chain.recipe_for_run.fit_recipe`.
    lane : path, optional
        TOML with x_min, x_max, y_min, y_max (m) in place of the recipe's lane.
    report : bool
        Whether to write ``report.html`` now; scoring writes it anew anyway.
    model : path, optional
        What training made, for recipes that learn.
    workers, scheduler, track, note
        As in :class:`flgpr.execution.survey.RunOptions`; the result is the same, bit for bit.
    max_memory : int
        Memory of each process, bytes; a lane that would take more is refused, see
        :func:`detect_long`.
    others : mapping of str to path, optional
        Runs taken together with this one, such as a second band, by the names that the recipe gives
        them.
    """
    how = RunOptions(workers, scheduler, max_memory, track, note)
    return read_result(
        detect_long(run, recipe, output, lane, model, math.inf, others, report, how)[0]
    )


def detect_long(
    run: PathLike,
    recipe: PathLike | None,
    output: PathLike,
    lane: PathLike | None = None,
    model: PathLike | None = None,
    section: float | None = None,
    others: Mapping[str, PathLike] | None = None,
    report: bool = True,
    how: RunOptions = DEFAULTS,
    overwrite: bool = True,
) -> list[Path]:
    """Detect on a stored run of any length, and give the result folder, or those of its sections in their order.

    Arguments are those of :func:`detect_run`. A lane that would take more memory, or is longer than ``section`` (m;
    infinity for one piece or not at all), is taken in sections: ``output`` then holds a
    result folder per section and a table of all alarms, see :mod:`flgpr.execution.driver`. ``how`` tells who does it.
    Without ``overwrite`` a whole result of the same inputs and version is left as it is, and any other there is a
    FileExistsError.
    """
    text = _text_of(recipe, run, model, how.max_memory)
    parsed = parse_recipe(text, str(recipe))
    area = area_of(
        open_run(run, how.max_memory), parsed, read_lane(lane) if lane is not None else None
    )
    job = make_job(
        run, text, area, output, report, model, how.max_memory, others, pass_cache=how.pass_cache
    )
    with how.executor() as executor:
        return detect_lane(job, executor, how.track, how.note, section, overwrite)


def detect_runs(
    runs: Sequence[PathLike],
    recipe: PathLike | None,
    output: PathLike,
    lanes: Sequence[PathLike] | None = None,
    model: PathLike | None = None,
    section: float | None = None,
    others: Sequence[Mapping[str, PathLike]] | None = None,
    report: bool = True,
    lanes_at_once: int | None = None,
    how: RunOptions = DEFAULTS,
    overwrite: bool = True,
) -> list[Path]:
    """Detect on many stored runs and give their result folders in order; goes on where it was stopped.

    The runs have different names; ``output`` takes a result folder per run, named like it, and ``survey.json``. A
    recipe of None is made for the first run, which the others must fit. ``lanes`` and ``others`` are per run the TOML
    of its lane and the runs taken together with it; ``lanes_at_once``, how many are worked on at the same time, needs
    workers or a scheduler to be more than 1. The rest is as for :func:`detect_long`.
    """
    if not runs:
        raise ValueError("runs must hold at least one run, got none")
    lane_names(runs)  # refuses runs of one name
    text = _text_of(recipe, runs[0], model, how.max_memory)
    if recipe is None and lanes is None and len(runs) > 1 and parse_recipe(text).lane is not None:
        raise ValueError(
            f"lanes must be given or a recipe: {runs[0]} is so short that its own recipe has its lane"
        )
    folders = detect_survey(
        runs, text, output, lanes, model, section, others, report, lanes_at_once, how, overwrite
    )
    return [result for folder in folders for result in results_at(folder)]


def _text_of(
    recipe: PathLike | None, run: PathLike, model: PathLike | None, max_memory: int
) -> str:
    """Text of a recipe, or of the one made for a run."""
    if recipe is not None:
        return recipe_text(recipe)
    if model is not None:
        raise ValueError("recipe must be given with a model: the one it was trained with, got none")
    return recipe_for(run, max_memory=max_memory)
