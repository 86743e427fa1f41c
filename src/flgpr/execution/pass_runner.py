"""The passes of a job, handed out block by block, and shared with jobs of other recipes."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from flgpr.chain.engine import Engine, PlannedPass, block_name
from flgpr.chain.progress import Track
from flgpr.door import Folder
from flgpr.execution.checkpoint import Checkpoint
from flgpr.execution.job import LaneJob, do_block, do_finish, do_merge, merged_blocks, shared_name
from flgpr.execution.workers import Executor, Report
from flgpr.store.files import write_whole

OnReport = Callable[[Report], None]
"""Takes a report of every piece of work that was done."""
_COSTS = ("seconds", "processor_seconds")
"""Entries of reports that add up."""


def ignore_report(report: Report) -> None:
    """Take a report and do nothing."""


class PassRunner:
    """Hands the blocks of passes out and waits for them.

    Parameters
    ----------
    executor : Executor
        Does the work.
    plan : callable
        Returns the engine of a job, which lists its passes and their blocks. That of a section is
        made anew and let go of again, as it holds memory.
    track : Track
        Shows progress.
    note : callable
        Takes a report of every piece of work that was done.
    threads : int
        How many threads of a process may take blocks at once.
    """

    def __init__(
        self,
        executor: Executor,
        plan: Callable[[LaneJob], Engine],
        track: Track,
        note: OnReport,
        threads: int,
    ) -> None:
        self.executor = executor
        self.plan = plan
        self.track = track
        self.note = note
        self.threads = threads

    def run(
        self,
        job: LaneJob,
        work: Checkpoint,
        chosen: Callable[[PlannedPass], bool],
        label: str = "",
    ) -> None:
        """Do the passes that the work folder lacks, one after the other.

        Parameters
        ----------
        job : LaneJob
            The job.
        work : Checkpoint
            Its work folder.
        chosen : callable
            Returns whether to do a pass.
        label : str
            What stands before the titles of the passes where progress is shown.
        """
        titles = {}
        blocks = {}
        engine = self.plan(job)
        for name, planned in engine.passes.items():
            if chosen(planned):
                titles[name] = planned.title
                blocks[name] = engine.block_numbers(name)
        del engine
        for name, title in titles.items():
            if name not in work:
                self._run_pass(job, work, name, blocks[name], label + title)

    def finish(self, job: LaneJob, label: str = "") -> None:
        """Write the result folder of a job whose passes are done."""
        done = self.executor.run(do_finish, [(job,)])
        for report in self.track(done, f"{label}writing the result", 1):
            self.note(report)

    def _run_pass(
        self, job: LaneJob, work: Checkpoint, name: str, numbers: Sequence[int], label: str
    ) -> None:
        """Do one pass, unless a job of another recipe has left its result."""
        shared = shared_name(job, name)
        if shared is not None and self._take(job, work, name, shared):
            return
        reports = self._gather(job, work, name, numbers, label)
        for report in self.executor.run(do_merge, [(job, name, tuple(numbers))]):
            self.note(report)
            reports.append(report)
        if shared is not None:
            self._leave(job, work, name, shared, reports)

    def _gather(
        self, job: LaneJob, work: Checkpoint, name: str, numbers: Sequence[int], label: str
    ) -> list[Report]:
        """Do the blocks of a pass that the work folder lacks."""
        merged = merged_blocks(work, name)
        pieces = []
        for number in numbers:
            if number >= merged and block_name(name, number) not in work:
                pieces.append((job, name, number))
        reports: list[Report] = []
        if not pieces:
            return reports
        with closing(self.executor.run(do_block, pieces, self.threads)) as done:
            for report in self.track(done, label, len(pieces)):
                self.note(report)
                reports.append(report)
        return reports

    def _take(self, job: LaneJob, work: Checkpoint, name: str, shared: str) -> bool:
        """Take the result of a pass from the pass cache, and report what it cost the first job."""
        if not work.take(Checkpoint(Path(job.pass_cache), job.largest), shared, name):
            return False
        report = Folder(job.pass_cache).json(f"{shared}.json")
        self.note(report | {"lane": Path(job.output).name})
        return True

    def _leave(
        self, job: LaneJob, work: Checkpoint, name: str, shared: str, reports: Sequence[Report]
    ) -> None:
        """Leave the result of a pass in the pass cache, with what it cost."""
        folder = Path(job.pass_cache)
        folder.mkdir(parents=True, exist_ok=True)
        cost = dict(reports[-1])
        for entry in _COSTS:
            cost[entry] = sum(report[entry] for report in reports)
        cost["peak_bytes"] = max(report["peak_bytes"] for report in reports)
        write_whole(folder / f"{shared}.json", json.dumps(cost))
        Checkpoint(folder, job.largest).take(work, name, shared)
