"""One lane from run to result: its passes, block by block, in one piece or in sections.

An interrupted detection resumes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from flgpr.chain.engine import Engine
from flgpr.chain.lane_setup import LaneSetup
from flgpr.chain.memory import plan_sections, sizes_of, threads_within
from flgpr.chain.method import engine_of
from flgpr.chain.progress import Track, silent
from flgpr.execution.checkpoint import begin, finish
from flgpr.execution.finished import holds_result, results_at
from flgpr.execution.job import LaneJob, open_lane
from flgpr.execution.lane_sections import detect_in_sections
from flgpr.execution.pass_runner import OnReport, PassRunner, ignore_report
from flgpr.execution.workers import Executor
from flgpr.results.result import check_free
from flgpr.store.outputs import OVERWRITE, log_finished


def detect_lane(
    job: LaneJob,
    executor: Executor,
    track: Track = silent,
    note: OnReport = ignore_report,
    longest: float | None = None,
    overwrite: bool = True,
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
    track : Track
        Shows progress.
    note : callable
        Takes a report of every piece of work that was done.
    longest : float, optional
        Length of a section at most, m; infinity asks for the lane in one piece.
    overwrite : bool
        Whether another result is overwritten. Otherwise a whole result of this job and version is
        left as it is.

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
    folder = check_free(job.output)
    lane = open_lane(job)  # refuses what does not fit before anything is written
    sizes = sizes_of(lane.setup.run)
    sections = plan_sections(sizes, lane.recipe, lane.lane, job.max_memory, longest)
    if not overwrite and holds_result(job, sections):
        log_finished(folder, OVERWRITE)
        return results_at(folder)

    folder.parent.mkdir(parents=True, exist_ok=True)
    threads = 1
    if lane.concurrent:
        threads = threads_within(sizes, lane.recipe, lane.lane, sections, job.max_memory)
    runner = PassRunner(executor, _planner(lane), track, note, threads)
    if len(sections) > 1:
        return detect_in_sections(job, sections, runner)
    with begin(job.work, job.identity(), job.largest) as work:
        runner.run(job, work, lambda _: True)
        runner.finish(job)
        finish(job.work)
    return [folder]


@contextmanager
def passes_of_lane(
    job: LaneJob,
    executor: Executor,
    track: Track = silent,
    note: OnReport = ignore_report,
    label: str = "",
) -> Iterator[LaneSetup]:
    """Do the passes of a stored training lane and yield the lane with their results.

    What explains alarms is left out. With a truth the passes end where the first stage that has not
    learnt yet has its examples. ``OUTPUT.work`` stays.
    """
    job = replace(job, explains=False)
    lane = open_lane(job)
    sizes = sizes_of(lane.setup.run)
    one_piece = plan_sections(sizes, lane.recipe, lane.lane, job.max_memory, math.inf)
    threads = 1
    if lane.concurrent:
        threads = threads_within(sizes, lane.recipe, lane.lane, one_piece, job.max_memory)
    with begin(job.work, job.identity(), job.largest) as work:
        lane = open_lane(job, work)
        runner = PassRunner(executor, lambda _: engine_of(lane), track, note, threads)
        runner.run(job, work, lambda _: True, label)
        yield lane


def _planner(lane: LaneSetup) -> Callable[[LaneJob], Engine]:
    """Return what plans the passes of a lane, or of one of its sections."""

    def plan(job: LaneJob) -> Engine:
        if job.section is None:
            return engine_of(lane)
        setup = LaneSetup(
            lane.run,
            lane.recipe,
            lane.lane,
            lane.model,
            section=job.section,
            others=lane.setup.others,
        )
        return engine_of(setup)

    return plan
