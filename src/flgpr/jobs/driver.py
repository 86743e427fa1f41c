"""The driver: hands out the passes of a lane block by block, in one piece or in sections.

A caller makes a job. :func:`plan_detection` opens its lane and refuses what does not fit;
:func:`detect_lane` runs the passes of ``method/method.py`` and writes the result. The driver computes
nothing: the pieces of work (``jobs/pieces.py``) are done by whoever the executor asks
(``jobs/workers.py``). An interrupted detection resumes with what its work folder holds
(``jobs/checkpoint.py``), to the same bits: why, ``engine.py`` tells.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import refuse_links
from flgpr.engine import group_of, not_shared
from flgpr.jobs.checkpoint import Checkpoint, PassCache, begin_work, work_until_done
from flgpr.jobs.finished import is_done, keeps_result, whole_results
from flgpr.jobs.job import LaneJob
from flgpr.jobs.pieces import do_block, do_finish, do_merge, open_lane
from flgpr.jobs.workers import DEFAULTS, Executor, Report, RunOptions
from flgpr.method.imaged_run import ImagedRun, array_table
from flgpr.method.memory import sizes_of
from flgpr.method.method import engine_of
from flgpr.method.sections import Section, lane_threshold, plan_sections, threads_within
from flgpr.model import Lane
from flgpr.recipe.schema import as_imaged, parse_recipe
from flgpr.results.sections import join_results, section_names
from flgpr.store import open_run
from flgpr.store.files import replace_folder
from flgpr.store.outputs import OVERWRITE, log_finished


@dataclass(frozen=True)
class LanePlan:
    """The lane of a job that fits, and how it is taken."""

    lane: ImagedRun  #: the lane, which reads the results of passes in the job's work folder
    sections: list[Section]  #: that it is taken in; one for a lane in one piece
    folders: list[Path]  #: the result folder of each section
    threads: int  #: of a process that may take blocks at once


def detect_lane(
    job: LaneJob,
    executor: Executor,
    options: RunOptions = DEFAULTS,
    longest: float | None = None,
    overwrite: bool = True,
    label: str = "",
) -> list[Path]:
    """Run a recipe on a stored lane, block by block.

    ``OUTPUT.work`` holds what is done until the result is written. After a stop, however hard, the
    same call continues there, to the same bits. A lane that would take more than the job's memory
    is taken in sections, which together hold the alarms that the whole lane would.

    Parameters
    ----------
    job : LaneJob
        What to do.
    executor : Executor
        Does the work.
    options : RunOptions
        Shows progress, and takes a report of every piece of work that was done.
    longest : float, optional
        Length of a section at most, m; infinity asks for the lane in one piece.
    overwrite : bool
        Whether another result is overwritten. Otherwise a whole result of this job and version is
        left as it is.
    label : str
        What stands before the titles of the passes where progress is shown.

    Returns
    -------
    list of Path
        The result folder, or those of the sections in their order.

    Raises
    ------
    ValueError
        If the recipe does not fit, or the memory does not suffice; nothing is written then.
    FileExistsError
        If the output holds something else and is not to be overwritten.
    """
    plan = plan_detection(job, longest)
    if keeps_result(job, plan.sections, overwrite):
        log_finished(job.folder, OVERWRITE)
        return plan.folders
    job.folder.parent.mkdir(parents=True, exist_ok=True)
    runner = PassRunner(executor, options, plan.threads, label)
    if len(plan.sections) > 1:
        run_sections(job, plan, runner)
    else:
        with work_until_done(job) as work:
            runner.run(job, work, passes_to_run(job, plan.lane))
            runner.finish(job)
    return plan.folders


def plan_detection(job: LaneJob, longest: float | None = None) -> LanePlan:
    """Open the lane of a job, and decide how it is taken.

    Raises
    ------
    ValueError
        If the recipe does not fit, or the memory does not suffice; nothing is written.
    """
    # The lane is opened before the work folder is made: what does not fit is refused first.
    lane, _ = open_lane(job)
    sizes = sizes_of(lane.setup.run)
    sections = plan_sections(sizes, lane.recipe, lane.lane, job.max_memory, longest)
    threads = 1
    if lane.concurrent:
        threads = threads_within(sizes, lane.recipe, lane.lane, sections, job.max_memory)
    folders = [job.folder]
    if len(sections) > 1:
        folders = [job.folder / name for name in section_names(len(sections))]
    return LanePlan(lane, sections, folders, threads)


def check_job(job: LaneJob, longest: float | None = None, overwrite: bool = True) -> None:
    """Refuse a job that :func:`detect_lane` could not do, by what is known before it is begun.

    Parameters
    ----------
    job : LaneJob
        What to do.
    longest : float, optional
        Length of a section at most, m.
    overwrite : bool
        Whether another result is overwritten.

    Raises
    ------
    ValueError
        If the memory does not suffice.
    FileExistsError
        If the output holds something else and is not to be overwritten.
    """
    recipe = parse_recipe(job.recipe)
    sizes = sizes_of(as_imaged(open_run(job.run, job.max_memory), recipe))
    sections = plan_sections(sizes, recipe, Lane(*job.lane), job.max_memory, longest)
    keeps_result(job, sections, overwrite)


@contextmanager
def passes_of_lane(
    job: LaneJob,
    executor: Executor,
    options: RunOptions = DEFAULTS,
    label: str = "",
) -> Iterator[ImagedRun]:
    """Do the passes of a stored training lane and yield the lane with their results.

    What explains alarms is left out. With a truth the passes end where the first stage that has not
    learnt yet has its examples. ``OUTPUT.work`` stays.
    """
    job = replace(job, explains=False)
    plan = plan_detection(job, math.inf)
    with begin_work(job) as work:
        runner = PassRunner(executor, options, plan.threads, label)
        runner.run(job, work, passes_to_run(job, plan.lane))
        yield plan.lane


# The passes of a lane, one after the other


@dataclass(frozen=True)
class PassToRun:
    """A pass of a lane, as it is handed out."""

    name: str  #: its name, which is that of its result
    title: str  #: what it is called where progress is shown
    all_scans: bool  #: whether the sections of a lane share it
    numbers: list[int]  #: of its blocks
    #: what its result depends on beside run, lane and version of the program; None if no other
    #: recipe can use it
    cache_key: Callable[[], dict[str, Any] | None] = not_shared


def passes_to_run(job: LaneJob, lane: ImagedRun) -> list[PassToRun]:
    """Return the passes of a lane in their order."""
    engine = engine_of(lane)
    passes = []
    for name, planned in engine.passes.items():
        # Without a pass cache nothing of the lane is held, as that of a section takes memory.
        cache_key = planned.cache_key if job.pass_cache else not_shared
        numbers = engine.block_numbers(name)
        passes.append(PassToRun(name, planned.title, planned.all_scans, numbers, cache_key))
    return passes


@dataclass(frozen=True)
class PassRunner:
    """Hands out the blocks of passes and waits for them."""

    executor: Executor  #: does the work
    options: RunOptions  #: shows progress, and takes a report of every piece of work that was done
    threads: int  #: of a process that may take blocks at once
    label: str = ""  #: stands before all that progress is shown of, such as the name of a lane

    def run(self, job: LaneJob, work: Checkpoint, passes: Sequence[PassToRun]) -> None:
        """Do the passes that the work folder lacks, one after the other.

        Parameters
        ----------
        job : LaneJob
            The job.
        work : Checkpoint
            Its work folder.
        passes : sequence of PassToRun
            The passes in their order.
        """
        cache = PassCache(job)
        for planned in passes:
            if planned.name not in work:
                self._run_pass(job, work, cache, planned)

    def finish(self, job: LaneJob) -> None:
        """Write the result folder of a job whose passes are done."""
        done = self.executor.run(do_finish, [(job,)])
        for report in self.options.track(done, f"{self.label}writing the result", 1):
            self.options.note(report)

    def _run_pass(
        self, job: LaneJob, work: Checkpoint, cache: PassCache, planned: PassToRun
    ) -> None:
        """Do one pass: its blocks and then their merge, unless another recipe left its result."""
        shared_name = cache.name_of(planned.name, planned.cache_key())
        if shared_name is not None:
            cost = cache.take(shared_name, work, planned.name)
            if cost is not None:
                self.options.note(cost)
                return
        reports = self._gather(job, work, planned)
        for report in self.executor.run(do_merge, [(job, planned.name, tuple(planned.numbers))]):
            self.options.note(report)
            reports.append(report)
        if shared_name is not None:
            cache.leave(shared_name, work, planned.name, reports)

    def _gather(self, job: LaneJob, work: Checkpoint, planned: PassToRun) -> list[Report]:
        """Do the blocks of a pass that the work folder lacks."""
        missing = work.missing_blocks(planned.name, planned.numbers)
        pieces = [(job, planned.name, number) for number in missing]
        reports: list[Report] = []
        if not pieces:
            return reports
        title = f"{self.label}{planned.title}"
        with closing(self.executor.run(do_block, pieces, self.threads)) as done:
            for report in self.options.track(done, title, len(pieces)):
                self.options.note(report)
                reports.append(report)
        return reports


# A lane in sections


def run_sections(job: LaneJob, plan: LanePlan, runner: PassRunner) -> None:
    """Take a lane in sections.

    First come the passes that all sections share, then the run-view of every section, and then,
    with one threshold for the lane, the rest of every section.

    Parameters
    ----------
    job : LaneJob
        The job of the lane.
    plan : LanePlan
        The lane of the job, its sections and their folders.
    runner : PassRunner
        Runs the passes.
    """
    gathering = job.folder.with_name(f"{job.name}.sections")
    refuse_links(gathering)
    names = [folder.name for folder in plan.folders]
    section_jobs = []
    for name, section in zip(names, plan.sections, strict=True):
        output = str(gathering / name)
        section_jobs.append(replace(job, output=output, section=section, shared=str(job.work)))

    with work_until_done(job, plan.sections) as shared:
        stopped_after_last_step = (
            "threshold" in shared and not gathering.exists() and whole_results(job) == plan.folders
        )
        if stopped_after_last_step:
            return

        _prepare(gathering, names if len(shared) else ())
        shared_passes = [item for item in passes_to_run(job, plan.lane) if item.all_scans]
        runner.run(job, shared, shared_passes)
        if "threshold" not in shared:
            threshold = _find_threshold(plan.lane, section_jobs, runner)
            shared["threshold"] = {"threshold": np.array(threshold)}
        threshold = float(shared["threshold"]["threshold"])
        for section_job, section in zip(section_jobs, plan.sections, strict=True):
            known = replace(section, threshold=threshold)
            _finish_section(plan.lane, replace(section_job, section=known), runner)
        join_results(gathering, names, Lane(*job.lane), job.lasting_identity)
        replace_folder(gathering, job.folder)


def _find_threshold(lane: ImagedRun, section_jobs: Sequence[LaneJob], runner: PassRunner) -> float:
    """Do the run-views of all sections, and return the threshold of the lane by its maxima."""
    tables = []
    pixels_seen = 0
    for job in section_jobs:
        of_section = replace(runner, label=f"{runner.label}{job.name}: ")
        with begin_work(job) as work:
            of_rows = lane.in_section(job.section, work.with_shared(job.shared))
            passes = passes_to_run(job, of_rows)
            until_alarms = [item for item in passes if item.name in ("view", "alarms")]
            of_section.run(job, work, until_alarms)
            raised = work["alarms"]
            tables.append(array_table(group_of(raised, "maximum")))
            pixels_seen += int(raised["seen"])
    maxima = pd.concat(tables, ignore_index=True)
    return lane_threshold(lane.recipe, lane.lane, maxima, pixels_seen)


def _finish_section(lane: ImagedRun, job: LaneJob, runner: PassRunner) -> None:
    """Do the rest of a section and write its result, unless that is done."""
    if is_done(job):
        return
    runner = replace(runner, label=f"{runner.label}{job.name}: ")
    with work_until_done(job) as work:
        of_rows = lane.in_section(job.section, work.with_shared(job.shared))
        passes = passes_to_run(job, of_rows)
        own_passes = [item for item in passes if not item.all_scans]
        runner.run(job, work, own_passes)
        runner.finish(job)


def _prepare(gathering: Path, names: Sequence[str]) -> None:
    """Make the folder that the sections gather in, without what is left of another job."""
    refuse_links(gathering)  # that somebody made meanwhile
    gathering.mkdir(exist_ok=True)
    for path in gathering.iterdir():
        if path.name.partition(".")[0] in names:
            # Nothing of ours is a link: it could lead anywhere.
            if path.is_symlink():
                path.unlink()
        elif path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
