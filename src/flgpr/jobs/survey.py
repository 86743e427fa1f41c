"""Detection on many stored lanes, by one process or many. An interrupted survey resumes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from flgpr.door import read_named
from flgpr.jobs.driver import check_job, detect_lane
from flgpr.jobs.finished import is_done
from flgpr.jobs.job import LaneJob, job_of_run
from flgpr.jobs.workers import DEFAULTS, Executor, RunOptions
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe
from flgpr.results.result import read_result
from flgpr.results.sections import results_at
from flgpr.store import write_whole
from flgpr.store.outputs import OVERWRITE, log_finished

PathLike = str | Path


def detect_survey(
    runs: Sequence[PathLike],
    recipe_text: str,
    output: PathLike,
    lanes: Sequence[PathLike | Lane] | None = None,
    model: PathLike | None = None,
    section: float | None = None,
    others: Sequence[Mapping[str, PathLike]] | None = None,
    report: bool = True,
    at_once: int | None = None,
    options: RunOptions = DEFAULTS,
    overwrite: bool = True,
) -> list[Path]:
    """Run a recipe on many stored lanes.

    Lanes whose result is there are left out, so that an interrupted survey resumes.

    Parameters
    ----------
    runs : sequence of str or path
        Run stores.
    recipe_text : str
        TOML text of the recipe.
    output : str or path
        Takes a result folder per lane, named like its run, and ``survey.json``.
    lanes : sequence of str, path or Lane, optional
        Borders or their files, one per run.
    model : str or path, optional
        Folder of a trained model.
    section : float, optional
        Longest section of a lane, m.
    others : sequence of mapping, optional
        For each run those taken together with it, by the names that the recipe gives them.
    report : bool
        Whether to write a report of each lane.
    at_once : int, optional
        Lanes that are worked on at once. By default two where other processes do the work, so that
        none of them waits for the last block of a pass.
    options : RunOptions
        Who does the work.
    overwrite : bool
        Whether other results are overwritten.

    Returns
    -------
    list of Path
        The folder of each lane, a result or one of sections, in the order of the runs.

    Raises
    ------
    ValueError
        If the recipe does not fit a run, names are not different, or an option breaks its rule.
    FileExistsError
        If a lane's folder holds another result that is not to be overwritten; no lane is begun
        then.
    """
    survey = Path(output)
    executor = options.executor()
    at_once = at_once or (2 if executor.parallel else 1)
    if at_once > 1 and not executor.parallel:
        raise ValueError(
            f"lanes_at_once needs workers or a scheduler to be more than 1, got {at_once}"
        )
    jobs = _make_jobs(
        runs, recipe_text, survey, lanes, model, section, others, report, options, overwrite
    )
    survey.mkdir(parents=True, exist_ok=True)
    unfinished = [job for job in jobs if not is_done(job)]
    if not unfinished:
        log_finished(survey, OVERWRITE)

    def detect(job: LaneJob) -> None:
        label = f"{job.name}: "
        detect_lane(job, executor, options.track, options.note, section, overwrite, label)

    with executor:
        if at_once == 1:
            # In this thread, which is the one that is interrupted.
            for job in unfinished:
                detect(job)
        else:
            _detect_at_once(detect, unfinished, at_once, executor)
    folders = [job.folder for job in jobs]
    _write_summary(survey, runs, folders)
    return folders


def _make_jobs(
    runs: Sequence[PathLike],
    recipe_text: str,
    survey: Path,
    lanes: Sequence[PathLike | Lane] | None,
    model: PathLike | None,
    section: float | None,
    others: Sequence[Mapping[str, PathLike]] | None,
    report: bool,
    options: RunOptions,
    overwrite: bool,
) -> list[LaneJob]:
    """Return the jobs of all lanes; refuse what could not be done before any is begun."""
    recipe = parse_recipe(recipe_text)
    names = lane_names(runs)
    if lanes is not None and len(lanes) != len(runs):
        raise ValueError(f"lane must be given once per run, got {len(lanes)} for {len(runs)} runs")
    jobs = []
    for number, (run, name) in enumerate(zip(runs, names, strict=True)):
        given_lane = None if lanes is None else lanes[number]
        other_runs = None if others is None else others[number]
        job = job_of_run(
            run,
            recipe,
            recipe_text,
            survey / name,
            given_lane,
            other_runs,
            model,
            report,
            options.max_memory,
            options.pass_cache,
        )
        jobs.append(job)
        check_job(job, section, overwrite)
    return jobs


def _detect_at_once(
    detect: Callable[[LaneJob], None],
    jobs: Sequence[LaneJob],
    at_once: int,
    executor: Executor,
) -> None:
    """Detect on several lanes at once; the first error, or an interrupt, ends all."""
    with ThreadPoolExecutor(at_once) as pool:
        try:
            for future in [pool.submit(detect, job) for job in jobs]:
                future.result()
        except BaseException:
            executor.stop()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def lane_names(runs: Sequence[PathLike]) -> list[str]:
    """Return the names of the lanes of a survey: those of their runs, without the ending.

    Raises
    ------
    ValueError
        If two runs have the same name.
    """
    names = [Path(run).stem for run in runs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"runs must have different names, got several {', '.join(twice)}")
    return names


def _write_summary(survey: Path, runs: Sequence[PathLike], folders: Sequence[Path]) -> None:
    """Write what was found on every lane, unless it stands there already."""
    path = survey / "survey.json"
    text = json.dumps(_summary(runs, folders), indent=1) + "\n"
    if not path.is_file() or read_named(path).decode("utf-8", "replace") != text:
        write_whole(path, text)


def _summary(runs: Sequence[PathLike], folders: Sequence[Path]) -> list[dict[str, Any]]:
    """Return a row for every lane."""
    rows = []
    for run, folder in zip(runs, folders, strict=True):
        alarms = 0
        area = 0.0
        result_folders = results_at(folder)
        for result_folder in result_folders:
            result = read_result(result_folder)  # one at a time, as a result holds its run-views
            alarms += len(result.detections[0].alarms)
            area += result.lane.area
        described = result.manifest["run"]
        rows.append(
            {
                "lane": folder.name,
                "run": str(run),
                "scans": described["scans"],
                "masked_scans": len(described["masked_scans"]),
                "implausible_scans": len(described.get("motion", {}).get("scans", [])),
                "area_m2": round(area, 3),
                "alarms": alarms,
                "sections": len(result_folders),
            }
        )
    return rows
