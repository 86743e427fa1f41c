"""Detection on stored lanes, one or many, by one process or many: what drives the work and goes on after a stop."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from flgpr.io import MAX_MEMORY, open_run, read_lane, write_whole
from flgpr.model import Lane
from flgpr.pipeline.blocks import STAGES
from flgpr.pipeline.checkpoint import begin, finish
from flgpr.pipeline.cluster import Cluster
from flgpr.pipeline.detect import lane_of
from flgpr.pipeline.executors import Executor, Here, Processes, Report
from flgpr.pipeline.lane_work import LaneJob, do_finish, do_fold, do_part, make_job
from flgpr.pipeline.memory import check_memory
from flgpr.pipeline.progress import Track, silent
from flgpr.pipeline.recipe import Recipe, parse_recipe
from flgpr.pipeline.result import MODEL, ResultError, check_free, read_result
from flgpr.pipeline.wang2007 import blocks_of, whole_imager

Note = Callable[[Report], None]
PathLike = str | Path


def unnoted(report: Report) -> None:
    """Take a report and do nothing.

    Parameters
    ----------
    report : dict
        The report.
    """


def detect_lane(job: LaneJob, executor: Executor, track: Track = silent, note: Note = unnoted) -> Path:
    """Run a recipe with features on a stored lane, block by block, and write its result folder.

    The work folder beside the output, ``OUTPUT.work``, keeps what is done. After a stop, however hard, the same call
    goes on there, and the result has the same bits. It is deleted when the result is written.

    Parameters
    ----------
    job : LaneJob
        What to do.
    executor : Executor
        Who does it.
    track : Track
        Shows progress.
    note : callable
        Takes a report of every piece of work that was done.

    Returns
    -------
    Path
        The result folder.

    Raises
    ------
    ValueError, FileExistsError
        If the run does not fit the recipe, something else lies at the output, or another process works on it.
    """
    folder = check_free(job.output)
    run, recipe = open_run(job.run, job.max_memory), parse_recipe(job.recipe)
    check_memory(dict(run.sizes), recipe, Lane(*job.lane), job.max_memory)  # type: ignore[arg-type]
    blocks = len(blocks_of(len(whole_imager(run, recipe))))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with begin(job.work, job.identity()) as work:
        for stage, label in STAGES.items():
            if stage not in work:
                missing = [number for number in range(blocks) if work.part(stage, number) not in work]
                parts = executor.run(do_part, [(job, stage, number) for number in missing])
                for report in track(parts, label, len(missing)):
                    note(report)
                for report in executor.run(do_fold, [(job, stage, blocks)]):
                    note(report)
            work.drop_parts(stage)
        for report in track(executor.run(do_finish, [(job,)]), "writing the result", 1):
            note(report)
        finish(job.work)
    return folder


def executor_for(workers: int | None = None, scheduler: str | None = None) -> Executor:
    """Choose who does the work.

    Parameters
    ----------
    workers : int, optional
        Number of processes; default this one, with all its threads.
    scheduler : str, optional
        Address of a Dask scheduler.

    Returns
    -------
    Executor
        Who.

    Raises
    ------
    ValueError
        If both are given, or the number is not positive.
    """
    if scheduler is not None and workers is not None:
        raise ValueError(f"workers and scheduler exclude each other, got {workers} and {scheduler}")
    if scheduler is not None:
        return Cluster(scheduler)
    return Here() if workers is None else Processes(workers)


def detect_survey(
    runs: Sequence[PathLike],
    recipe_text: str,
    output: PathLike,
    lanes: Sequence[PathLike] | None = None,
    model: PathLike | None = None,
    report: bool = True,
    executor: Executor | None = None,
    at_once: int | None = None,
    max_memory: int = MAX_MEMORY,
    track: Track = silent,
    note: Note = unnoted,
) -> list[Path]:
    """Run a recipe with features on many stored lanes.

    Lanes whose result is there already are left out, so that a survey that was stopped goes on.

    Parameters
    ----------
    runs : sequence of path
        Run stores with different names.
    recipe_text : str
        Text of the recipe.
    output : path
        Folder that takes one result folder per lane, named like its run, and ``survey.json``, which lists them.
    lanes : sequence of path, optional
        TOML of each lane, in the same order.
    model : path, optional
        Folder of a trained classifier.
    report : bool
        Whether to draw the reports.
    executor : Executor, optional
        Who does it; default this process.
    at_once : int, optional
        How many lanes are worked on at the same time; default 2 where others do the work, so that none of them waits
        for the last block of a stage, else 1.
    max_memory : int
        Memory that each process may take, bytes.
    track : Track
        Shows progress.
    note : callable
        Takes a report of every piece of work that was done.

    Returns
    -------
    list of Path
        The result folders, in the order of the runs.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid. Results of lanes that were done stay.
    """
    recipe, home, who = parse_recipe(recipe_text), Path(output), executor or Here()
    at_once = at_once or (2 if who.parallel else 1)
    if at_once > 1 and not who.parallel:
        raise ValueError(f"lanes at once needs workers or a scheduler to be more than 1, got {at_once}")
    names = lane_names(runs)
    if lanes is not None and len(lanes) != len(runs):
        raise ValueError(f"lanes must be one per run, got {len(lanes)} for {len(runs)} runs")
    jobs = []
    for number, (run, name) in enumerate(zip(runs, names, strict=True)):
        lane = None if lanes is None else read_lane(lanes[number])
        area = area_of(run, recipe, lane, max_memory)
        jobs.append(make_job(run, recipe_text, area, home / name, report, model, max_memory))
        check_free(home / name)
    home.mkdir(parents=True, exist_ok=True)
    left = [job for job in jobs if not is_done(job)]
    with ExitStack() as stack:
        stack.enter_context(who)
        pool = stack.enter_context(ThreadPoolExecutor(at_once))
        futures = [pool.submit(detect_lane, job, who, _named(track, Path(job.output).name), note) for job in left]
        try:
            for future in futures:
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    folders = [Path(job.output) for job in jobs]
    write_whole(home / "survey.json", json.dumps(_summary(runs, folders), indent=1) + "\n")
    return folders


def lane_names(runs: Sequence[PathLike]) -> list[str]:
    """Name the lanes of a survey after their runs.

    Parameters
    ----------
    runs : sequence of path
        Run stores.

    Returns
    -------
    list of str
        Their names without ending.

    Raises
    ------
    ValueError
        If two are the same.
    """
    names = [Path(run).stem for run in runs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"runs must have different names, got several {', '.join(twice)}")
    return names


def area_of(run: PathLike, recipe: Recipe, lane: Lane | None, max_memory: int = MAX_MEMORY) -> Lane:
    """Choose the lane: the one given, the recipe's, or the ground that the scans cover.

    Parameters
    ----------
    run : path
        Run store.
    recipe : Recipe
        The recipe.
    lane : Lane, optional
        Lane in place of the recipe's.
    max_memory : int
        Memory that reading the run may take, bytes.

    Returns
    -------
    Lane
        The lane.
    """
    return lane if lane is not None else lane_of(open_run(run, max_memory), recipe)


def is_done(job: LaneJob) -> bool:
    """Tell whether the result of a job is there and whole.

    Parameters
    ----------
    job : LaneJob
        The job.

    Returns
    -------
    bool
        True if it was made of the same run with the same recipe, lane and classifier.
    """
    if job.work.exists():
        return False
    try:
        result = read_result(job.output)
    except ResultError:
        return False
    manifest = result.manifest
    return bool(
        manifest["run"].get("store_sha256") == job.store_sha256
        and manifest["recipe_sha256"] == job.identity()["recipe"]
        and (result.lane.x_min, result.lane.x_max, result.lane.y_min, result.lane.y_max) == job.lane
        and manifest["files"].get(f"{MODEL}/model.json", "") == job.model_sha256
        and ("report.html" in manifest["added"] or not job.report)
    )


def _summary(runs: Sequence[PathLike], folders: Sequence[Path]) -> list[dict[str, Any]]:
    rows = []
    for run, folder in zip(runs, folders, strict=True):
        result = read_result(folder)
        described = result.manifest["run"]
        rows.append(
            {
                "lane": folder.name,
                "run": str(run),
                "scans": described["scans"],
                "masked_scans": len(described["masked_scans"]),
                "area_m2": round(result.lane.area, 3),
                "alarms": len(result.detections[0].alarms),
            }
        )
    return rows


def _named(track: Track, name: str) -> Track:
    def named(items: Any, label: str, total: int) -> Any:
        return track(items, f"{name}: {label}", total)

    return named
