"""Detection on stored lanes, one or many, by one process or many: what drives the work and goes on after a stop."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flgpr.chain.memory import plan_sections, sizes_of
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import as_imaged, parse_recipe
from flgpr.chain.recipe_fit import area_of
from flgpr.door import read_named
from flgpr.execution.driver import Note, detect_lane, holds_result, is_done, results_at, unnoted
from flgpr.execution.job import LaneJob, make_job
from flgpr.execution.workers import Cluster, Executor, InProcess, Processes
from flgpr.results.result import check_free, read_result
from flgpr.store import MAX_MEMORY, open_run, read_lane, write_whole
from flgpr.store.outputs import OVERWRITE, tell_finished

PathLike = str | Path


@dataclass(frozen=True)
class RunOptions:
    """Who works on lanes, and how; the results are the same, bit for bit."""

    workers: int | None = None  #: number of processes; None takes this one with all its threads
    scheduler: str | None = None  #: address of a Dask scheduler in place of workers
    max_memory: int = MAX_MEMORY  #: that each process may take, bytes
    track: Track = silent  #: shows progress
    note: Note = unnoted  #: takes a report of every piece of work that was done
    #: folder in which backgrounds, run-views and features stay for other recipes that have the same; it may be deleted
    pass_cache: PathLike | None = None

    def executor(self) -> Executor:
        """Choose who does the work."""
        if self.scheduler is not None and self.workers is not None:
            raise ValueError(
                f"workers and scheduler exclude each other, got {self.workers} and {self.scheduler}"
            )
        if self.scheduler is not None:
            return Cluster(self.scheduler)
        return InProcess() if self.workers is None else Processes(self.workers)


DEFAULTS = RunOptions()


def detect_survey(
    runs: Sequence[PathLike],
    recipe_text: str,
    output: PathLike,
    lanes: Sequence[PathLike] | None = None,
    model: PathLike | None = None,
    section: float | None = None,
    others: Sequence[Mapping[str, PathLike]] | None = None,
    report: bool = True,
    at_once: int | None = None,
    how: RunOptions = DEFAULTS,
    overwrite: bool = True,
) -> list[Path]:
    """Run a recipe on many stored lanes; give their folders in the runs' order, results or folders of sections.

    Lanes whose result is there are left out, so that a stopped survey goes on. ``output`` takes a
    result folder per lane, named like its run, and ``survey.json``. Where others do the work two
    lanes are worked on at once by default, so that none of them waits for the last block of a
    stage. Without ``overwrite`` a lane whose place holds another result is refused before any is
    begun.
    """
    recipe = parse_recipe(recipe_text)
    survey = Path(output)
    executor = how.executor()
    at_once = at_once or (2 if executor.parallel else 1)
    if at_once > 1 and not executor.parallel:
        raise ValueError(
            f"lanes at once needs workers or a scheduler to be more than 1, got {at_once}"
        )
    names = lane_names(runs)
    if lanes is not None and len(lanes) != len(runs):
        raise ValueError(f"lanes must be one per run, got {len(lanes)} for {len(runs)} runs")
    jobs = []
    for number, (run, name) in enumerate(zip(runs, names, strict=True)):
        lane = None if lanes is None else read_lane(lanes[number])
        beside = None if others is None else others[number]
        dataset = open_run(run, how.max_memory)
        area = area_of(dataset, recipe, lane)
        jobs.append(
            make_job(
                run,
                recipe_text,
                area,
                survey / name,
                report,
                model,
                how.max_memory,
                beside,
                pass_cache=how.pass_cache,
            )
        )
        check_free(survey / name)
        sizes = sizes_of(as_imaged(dataset, recipe))
        sections = plan_sections(sizes, recipe, area, how.max_memory, section)  # refuses beforehand
        if not overwrite:
            holds_result(jobs[-1], sections)
    survey.mkdir(parents=True, exist_ok=True)
    left = [job for job in jobs if not is_done(job)]
    if not left:
        tell_finished(survey, OVERWRITE)

    def detect(job: LaneJob) -> None:
        detect_lane(
            job, executor, _named(how.track, Path(job.output).name), how.note, section, overwrite
        )

    with executor:
        if at_once == 1:  # in this thread, which is the one that is interrupted
            for job in left:
                detect(job)
        else:
            with ThreadPoolExecutor(at_once) as pool:
                try:
                    for future in [pool.submit(detect, job) for job in left]:
                        future.result()
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    raise
    folders = [Path(job.output) for job in jobs]
    path = survey / "survey.json"
    text = json.dumps(_summary(runs, folders), indent=1) + "\n"
    if not path.is_file() or read_named(path).decode("utf-8", "replace") != text:
        write_whole(path, text)
    return folders


def lane_names(runs: Sequence[PathLike]) -> list[str]:
    """Name the lanes of a survey after their runs, without the ending; the names must differ."""
    names = [Path(run).stem for run in runs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"runs must have different names, got several {', '.join(twice)}")
    return names


def _summary(runs: Sequence[PathLike], folders: Sequence[Path]) -> list[dict[str, Any]]:
    rows = []
    for run, folder in zip(runs, folders, strict=True):
        alarms = 0
        area = 0.0
        results = results_at(folder)
        for result in map(read_result, results):
            alarms = alarms + len(result.detections[0].alarms)
            area = area + result.lane.area
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
                "sections": len(results),
            }
        )
    return rows


def _named(track: Track, name: str) -> Track:
    def named(items: Any, label: str, total: int) -> Any:
        return track(items, f"{name}: {label}", total)

    return named
