"""Detection on stored runs: files in, files out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from flgpr.io import MAX_MEMORY, open_run, read_lane
from flgpr.pipeline.classifier import load_classifier
from flgpr.pipeline.detect import detect
from flgpr.pipeline.lane_run import Note, detect_lane, homes_at, unnoted
from flgpr.pipeline.lane_work import make_job
from flgpr.pipeline.memory import check_memory, sizes_of
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.recipe import lane_of, parse_recipe, recipe_text
from flgpr.pipeline.report import report_html
from flgpr.pipeline.result import Result, add_files, check_free, read_result, write_result
from flgpr.pipeline.run_info import describe_run
from flgpr.pipeline.survey import area_of, detect_survey, executor_for, lane_names

PathLike = str | Path


def detect_run(
    run: PathLike,
    recipe: PathLike,
    output: PathLike,
    lane: PathLike | None = None,
    track: Track = silent,
    report: bool = True,
    model: PathLike | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    note: Note = unnoted,
    max_memory: int = MAX_MEMORY,
) -> Result:
    """Detect on a stored run and write a result folder with its report.

    With a recipe that has features this works block by block and can be stopped and gone on with, see
    :func:`flgpr.pipeline.lane_run.detect_lane`.

    Parameters
    ----------
    run : path
        Run store.
    recipe : str or path
        Name of a packaged recipe, or a TOML file.
    output : path
        Result folder to make.
    lane : path, optional
        TOML with x_min, x_max, y_min, y_max (m) in place of the recipe's lane.
    track : Track
        Shows progress.
    report : bool
        Whether to write ``report.html`` now; scoring writes it anew anyway.
    model : path, optional
        Folder of a trained classifier, for recipes with features.
    workers : int, optional
        Number of processes, for recipes with features; default this one. The result is the same, bit for bit.
    scheduler : str, optional
        Address of a Dask scheduler in place of workers.
    note : callable
        Takes a report of every piece of work that was done.
    max_memory : int
        Memory that each process may take, bytes; a lane that would take more is refused before anything is decoded, see
        :func:`detect_long`.

    Returns
    -------
    Result
        The result as written.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid or the output would overwrite something else; nothing is written then.
    """
    options = (track, report, model, workers, scheduler, note, max_memory)
    return read_result(detect_long(run, recipe, output, lane, *options, section=math.inf)[0])


def detect_long(
    run: PathLike,
    recipe: PathLike,
    output: PathLike,
    lane: PathLike | None = None,
    track: Track = silent,
    report: bool = True,
    model: PathLike | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    note: Note = unnoted,
    max_memory: int = MAX_MEMORY,
    section: float | None = None,
) -> list[Path]:
    """Detect on a stored run of any length.

    Parameters
    ----------
    run, recipe, output, lane, track, report, model, workers, scheduler, note, max_memory
        As for :func:`detect_run`. With a recipe that has features a lane that would take more memory is taken in
        sections: ``output`` then holds a result folder per section and a table of all alarms, see
        :mod:`flgpr.pipeline.lane_run`.
    section : float, optional
        Longest section that is wanted, m; default as long as the memory allows; infinity for one piece or not at all.

    Returns
    -------
    list of Path
        The result folder, or those of the sections in their order.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid or the output would overwrite something else; nothing is written then.
    """
    text = recipe_text(recipe)
    parsed = parse_recipe(text, str(recipe))
    if parsed.features is not None:
        area = area_of(run, parsed, read_lane(lane) if lane is not None else None, max_memory)
        job = make_job(run, text, area, output, report, model, max_memory)
        with executor_for(workers, scheduler) as executor:
            return detect_lane(job, executor, track, note, section)
    if section is not None and section != math.inf:
        raise ValueError(f"section needs a recipe with the table features, got {recipe}")
    if workers is not None or scheduler is not None:
        raise ValueError(f"workers and scheduler need a recipe with the table features, got {recipe}")
    check_free(output)
    dataset = open_run(run, max_memory)
    area = read_lane(lane) if lane is not None else lane_of(dataset, parsed)
    check_memory(sizes_of(dataset), parsed, area, max_memory)
    classifier = load_classifier(model) if model is not None else None
    detections = detect(dataset, parsed, area, track, classifier)
    folder = write_result(output, detections, text, area, describe_run(dataset, run))
    if report:
        for page in track(["report.html"], "drawing the report", 1):
            add_files(folder, {page: report_html(read_result(folder))})
    return [folder]


def detect_runs(
    runs: Sequence[PathLike],
    recipe: PathLike,
    output: PathLike,
    lanes: Sequence[PathLike] | None = None,
    track: Track = silent,
    report: bool = True,
    model: PathLike | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    lanes_at_once: int | None = None,
    note: Note = unnoted,
    max_memory: int = MAX_MEMORY,
    section: float | None = None,
) -> list[Path]:
    """Detect on many stored runs; goes on where it was stopped.

    Parameters
    ----------
    runs : sequence of path
        Run stores with different names.
    recipe : str or path
        Name of a packaged recipe, or a TOML file.
    output : path
        Folder that takes a result folder per run, named like it, and ``survey.json``.
    lanes : sequence of path, optional
        TOML of each lane, in the same order, in place of the recipe's.
    track, report, model, workers, scheduler, note, max_memory, section
        As for :func:`detect_long`.
    lanes_at_once : int, optional
        How many lanes are worked on at the same time; more than 1 needs workers or a scheduler.

    Returns
    -------
    list of Path
        The result folders, in the order of the runs; a lane in sections has one for each.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid or the output would overwrite something else.
    """
    text = recipe_text(recipe)
    if parse_recipe(text, str(recipe)).features is None:
        names = lane_names(runs)
        areas = [None] * len(runs) if lanes is None else list(lanes)
        if len(areas) != len(runs):
            raise ValueError(f"lanes must be one per run, got {len(areas)} for {len(runs)} runs")
        found: list[Path] = []
        for run, name, area in zip(runs, names, areas, strict=True):
            home = Path(output) / name
            found += detect_long(
                run, recipe, home, area, track, report, model, workers, scheduler, note, max_memory, section
            )
        return found
    who = executor_for(workers, scheduler)
    folders = detect_survey(
        runs, text, output, lanes, model, report, who, lanes_at_once, max_memory, track, note, section
    )
    return [home for folder in folders for home in homes_at(folder)]
