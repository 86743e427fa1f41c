"""Detection on many stored lanes, by one process or many. An interrupted survey resumes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from flgpr.door import read_named
from flgpr.jobs.driver import check_job, detect_lane
from flgpr.jobs.finished import is_done
from flgpr.jobs.job import LaneJob
from flgpr.jobs.workers import DEFAULTS, RunOptions
from flgpr.results.result import read_result
from flgpr.results.sections import results_at
from flgpr.store import write_whole
from flgpr.store.outputs import OVERWRITE, log_finished
from flgpr.types import PathLike


def detect_survey(
    jobs: Iterable[LaneJob],
    output: PathLike,
    section: float | None = None,
    at_once: int | None = None,
    options: RunOptions = DEFAULTS,
    overwrite: bool = True,
) -> list[Path]:
    """Do the jobs of many lanes, and sum them up in ``OUTPUT/survey.json``.

    Lanes whose result is there are left out, so that an interrupted survey resumes.

    Parameters
    ----------
    jobs : iterable of LaneJob
        The detection on each lane. Each is checked before the next is made.
    output : str or path
        Folder of the summary, and usually of the lanes' results.
    section : float, optional
        Longest section of a lane, m.
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
        The folder of each lane, a result or one of sections, in the order of the jobs.

    Raises
    ------
    ValueError
        If the memory does not suffice, or an option breaks its rule.
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
    checked = []
    for job in jobs:
        check_job(job, section, overwrite)
        checked.append(job)
    survey.mkdir(parents=True, exist_ok=True)
    unfinished = [job for job in checked if not is_done(job)]
    if not unfinished:
        log_finished(survey, OVERWRITE)

    def detect(job: LaneJob) -> None:
        label = f"{job.name}: "
        detect_lane(job, executor, options, section, overwrite, label)

    with executor:
        if at_once == 1:
            # In this thread, which is the one that is interrupted.
            for job in unfinished:
                detect(job)
        else:
            # The first error, or an interrupt, ends all.
            with ThreadPoolExecutor(at_once) as pool:
                try:
                    for future in [pool.submit(detect, job) for job in unfinished]:
                        future.result()
                except BaseException:
                    executor.stop()
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
    _write_summary(survey, checked)
    return [job.folder for job in checked]


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


def _write_summary(survey: Path, jobs: Sequence[LaneJob]) -> None:
    """Write what was found on every lane, a row each, unless it stands there already."""
    rows = []
    for job in jobs:
        alarms = 0
        area = 0.0
        result_folders = results_at(job.folder)
        for result_folder in result_folders:
            result = read_result(result_folder)  # one at a time, as a result holds its run-views
            alarms += len(result.detections[0].alarms)
            area += result.lane.area
        described = result.manifest["run"]
        rows.append(
            {
                "lane": job.name,
                "run": job.run,
                "scans": described["scans"],
                "masked_scans": len(described["masked_scans"]),
                "implausible_scans": len(described.get("motion", {}).get("scans", [])),
                "area_m2": round(area, 3),
                "alarms": alarms,
                "sections": len(result_folders),
            }
        )
    path = survey / "survey.json"
    text = json.dumps(rows, indent=1) + "\n"
    if not path.is_file() or read_named(path).decode("utf-8", "replace") != text:
        write_whole(path, text)
