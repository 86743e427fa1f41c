"""One lane from run to result: what drives the pieces of work, in sections if need be, and goes on after a stop.

A lane in sections becomes a folder with a result folder per section, ``alarms.csv`` with all alarms
ranked together, ``lane.toml``, and ``sections.json``, which lists them with their digests.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import flgpr
from flgpr.chain.engine import Engine, PlannedPass, block_name, group_of
from flgpr.chain.lane_setup import LaneSetup, array_table
from flgpr.chain.memory import plan_sections, sizes_of, threads_within
from flgpr.chain.method import engine_of
from flgpr.chain.model import MODEL_FILE
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import parse_recipe
from flgpr.chain.sections import Section, lane_threshold
from flgpr.door import Folder
from flgpr.execution.checkpoint import Checkpoint, begin, finish
from flgpr.execution.job import (
    LaneJob,
    cached_pass,
    do_block,
    do_finish,
    do_merge,
    merged_blocks,
    open_lane,
)
from flgpr.execution.workers import Executor, Report
from flgpr.model import Lane
from flgpr.results.errors import ResultError
from flgpr.results.result import MODEL, check_free, read_result, read_result_manifest
from flgpr.results.sections import SECTIONS, read_sections, write_sections
from flgpr.store import lane_text, write_table
from flgpr.store.files import listed_files, replace_folder, replaced_by, write_whole
from flgpr.store.outputs import OVERWRITE, other_output, tell_finished
from flgpr.store.tables import parse_own_table

Note = Callable[[Report], None]
Plan = dict[str, tuple[str, list[int]]]  # title and blocks of each pass


def unnoted(report: Report) -> None:
    """Take a report and do nothing."""


def detect_lane(
    job: LaneJob,
    executor: Executor,
    track: Track = silent,
    note: Note = unnoted,
    longest: float | None = None,
    overwrite: bool = True,
) -> list[Path]:
    """Run a recipe on a stored lane, block by block; give its result folder, or those of its sections in their order.

    ``OUTPUT.work`` keeps what is done until the result is written: after a stop, however hard, the
    same call goes on there, to the same bits. A lane that would take more than the job's memory, or
    is longer than ``longest`` (m; infinity for one piece or not at all), is taken in sections,
    which together hold the alarms that the whole lane would. Without ``overwrite`` a whole result
    of this job and version is left as it is, and any other is a FileExistsError.
    """
    folder = check_free(job.output)
    first = open_lane(job)  # refuses what does not fit before anything is written
    sections = plan_sections(
        sizes_of(first.setup.run), first.recipe, first.lane, job.max_memory, longest
    )
    if not overwrite and holds_result(job, sections):
        tell_finished(folder, OVERWRITE)
        return results_at(folder)

    def plan(wanted: Callable[[PlannedPass], bool], section: Section | None = None) -> Plan:
        # Made anew and let go of again, as it holds memory.
        lane = LaneSetup(
            first.run,
            first.recipe,
            first.lane,
            first.model,
            section=section,
            others=first.setup.others,
        )
        return _planned(engine_of(lane), wanted)

    folder.parent.mkdir(parents=True, exist_ok=True)
    driver = _Driver(executor, track, note, _threads(first, sections, job))
    if len(sections) > 1:
        return _in_sections(job, sections, plan, driver)
    with begin(job.work, job.identity(), job.largest) as work:
        driver.run_passes(job, work, plan(lambda _: True))
        driver.finish(job)
        finish(job.work)
    return [folder]


@contextmanager
def passes_of_lane(
    job: LaneJob, executor: Executor, track: Track = silent, note: Note = unnoted, name: str = ""
) -> Iterator[LaneSetup]:
    """Do the passes of a stored training lane, but for what explains alarms, and yield the lane with their results.

    With a truth they end where the first stage that has not learnt yet has its examples.
    ``OUTPUT.work`` is kept.
    """
    job = replace(job, explains=False)
    lane = open_lane(job)
    sections = plan_sections(
        sizes_of(lane.setup.run), lane.recipe, lane.lane, job.max_memory, math.inf
    )
    driver = _Driver(executor, track, note, _threads(lane, sections, job))
    with begin(job.work, job.identity(), job.largest) as work:
        lane = open_lane(job, work)
        driver.run_passes(job, work, _planned(engine_of(lane), lambda _: True), name)
        yield lane


def _threads(lane: LaneSetup, sections: Sequence[Section], job: LaneJob) -> int:
    """Return how many threads of a process may take blocks of a lane."""
    if not lane.concurrent:
        return 1
    return threads_within(
        sizes_of(lane.setup.run), lane.recipe, lane.lane, sections, job.max_memory
    )


def _planned(engine: Engine, wanted: Callable[[PlannedPass], bool]) -> Plan:
    """List the title and the blocks of the passes that are wanted."""
    plan: Plan = {}
    for name, planned in engine.passes.items():
        if wanted(planned):
            plan[name] = (planned.title, engine.block_numbers(name))
    return plan


class _Driver:
    """Hands the pieces of a lane out and waits for them."""

    def __init__(self, executor: Executor, track: Track, note: Note, threads: int) -> None:
        self.executor = executor
        self.track = track
        self.note = note
        self.threads = threads

    def run_passes(self, job: LaneJob, work: Checkpoint, plan: Plan, name: str = "") -> None:
        """Do the passes of a plan that the work folder lacks, one after the other."""
        for pass_name, (title, numbers) in plan.items():
            if pass_name in work:
                continue
            cached = cached_pass(job, pass_name)
            if cached is not None and self._take(job, work, pass_name, cached):
                continue
            reports = self._gather(job, work, pass_name, numbers, name + title)
            reports += self._merge(job, pass_name, numbers)
            if cached is not None:
                self._leave(job, work, pass_name, cached, reports)

    def _gather(
        self, job: LaneJob, work: Checkpoint, name: str, numbers: Sequence[int], label: str
    ) -> list[Report]:
        """Do the blocks of a pass that the work folder lacks."""
        begun = merged_blocks(work, name)
        pieces = []
        for number in numbers:
            if number >= begun and block_name(name, number) not in work:
                pieces.append((job, name, number))
        reports = []
        with closing(self.executor.run(do_block, pieces, self.threads)) as done:
            for report in self.track(done, label, len(pieces)) if pieces else ():
                self.note(report)
                reports.append(report)
        return reports

    def _merge(self, job: LaneJob, name: str, numbers: Sequence[int]) -> list[Report]:
        """Merge the blocks of a pass to its result."""
        reports = []
        for report in self.executor.run(do_merge, [(job, name, tuple(numbers))]):
            self.note(report)
            reports.append(report)
        return reports

    def _take(self, job: LaneJob, work: Checkpoint, name: str, cached: str) -> bool:
        """Take a pass from those that jobs share, and report what it cost the first of them."""
        if not work.take(Checkpoint(Path(job.pass_cache), job.largest), cached, name):
            return False
        report = Folder(job.pass_cache).json(f"{cached}.json")
        self.note(report | {"lane": Path(job.output).name})
        return True

    def _leave(
        self, job: LaneJob, work: Checkpoint, name: str, cached: str, reports: Sequence[Report]
    ) -> None:
        """Leave a pass to jobs of other recipes."""
        folder = Path(job.pass_cache)
        folder.mkdir(parents=True, exist_ok=True)
        cost = dict(reports[-1])
        for entry in ("seconds", "processor_seconds"):
            cost[entry] = sum(report[entry] for report in reports)
        cost["peak_bytes"] = max(report["peak_bytes"] for report in reports)
        write_whole(folder / f"{cached}.json", json.dumps(cost))
        Checkpoint(folder, job.largest).take(work, name, cached)

    def finish(self, job: LaneJob, name: str = "") -> None:
        """Write the result folder."""
        done = self.executor.run(do_finish, [(job,)])
        for report in self.track(done, f"{name}writing the result", 1):
            self.note(report)


def _in_sections(
    job: LaneJob, sections: Sequence[Section], plan: Callable[..., Plan], driver: _Driver
) -> list[Path]:
    """Take a lane in sections: first what all share, then every run-view, then, with one threshold, the rest."""
    gathering = Path(job.output).with_name(Path(job.output).name + ".sections")
    names = _section_names(sections)
    cut = {"rows": [[section.start, section.stop] for section in sections]}
    folders = [Path(job.output) / name for name in names]
    with begin(job.work, job.identity() | cut, job.largest) as shared:
        stopped_after_last_step = (
            "threshold" in shared
            and not gathering.exists()
            and _is_whole(job)
            and results_at(job.output) == folders
        )
        if stopped_after_last_step:
            finish(job.work)
            return folders
        _prepare(gathering, names if len(shared) else ())
        driver.run_passes(job, shared, plan(lambda planned: planned.all_scans))
        parts = {}
        for name, section in zip(names, sections, strict=True):
            output = str(gathering / name)
            parts[name] = replace(job, output=output, section=section, shared=str(job.work))
        if "threshold" not in shared:
            for name, part in parts.items():
                with begin(part.work, part.identity(), job.largest) as work:
                    until_alarms = plan(lambda p: p.name in ("view", "alarms"), part.section)
                    driver.run_passes(part, work, until_alarms, f"{name}: ")
            threshold = _threshold(job, list(parts.values()))
            shared["threshold"] = {"threshold": np.array(threshold)}
        threshold = float(shared["threshold"]["threshold"])
        for (name, part), section in zip(parts.items(), sections, strict=True):
            part = replace(part, section=replace(section, threshold=threshold))
            if not is_done(part):
                with begin(part.work, part.identity(), job.largest) as work:
                    rest = plan(lambda planned: not planned.all_scans, part.section)
                    driver.run_passes(part, work, rest, f"{name}: ")
                    driver.finish(part, f"{name}: ")
                    finish(part.work)
        _bring_together(job, gathering, names)
        finish(job.work)
    return folders


def _section_names(sections: Sequence[Section]) -> list[str]:
    width = max(2, len(str(len(sections))))
    return [f"section-{number:0{width}d}" for number in range(1, len(sections) + 1)]


def _prepare(gathering: Path, names: Sequence[str]) -> None:
    """Make the folder that the sections gather in, without what is left of another job."""
    gathering.mkdir(exist_ok=True)
    for path in gathering.iterdir():
        if path.name.partition(".")[0] not in names:
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        elif path.is_symlink():
            path.unlink()


def _threshold(job: LaneJob, parts: Sequence[LaneJob]) -> float:
    raised = [Checkpoint(part.work, job.largest)["alarms"] for part in parts]
    maxima = pd.concat([array_table(group_of(one, "maximum")) for one in raised], ignore_index=True)
    return lane_threshold(
        parse_recipe(job.recipe), Lane(*job.lane), maxima, sum(int(one["seen"]) for one in raised)
    )


def _bring_together(job: LaneJob, gathering: Path, names: Sequence[str]) -> None:
    tables = [_alarms_of(gathering / name) for name in names]
    for name, table in zip(names, tables, strict=True):
        table["alarm_id"] = [f"{name}/{alarm}" for alarm in table["alarm_id"]]
    filled = [table for table in tables if len(table)] or tables[:1]
    alarms = pd.concat(filled, ignore_index=True).sort_values(
        "confidence", ascending=False, kind="stable"
    )
    write_table(alarms, gathering / "alarms.csv")
    write_whole(gathering / "lane.toml", lane_text(Lane(*job.lane)))
    write_sections(gathering, names, _lasting(job))
    replace_folder(gathering, Path(job.output))


def _alarms_of(home: Path) -> pd.DataFrame:
    """Read the alarms of a result that is whole, and nothing else of it."""
    files = listed_files(home, read_result_manifest(home))
    return parse_own_table(files.read("alarms.csv"), "alarms", home / "alarms.csv")


def _lasting(job: LaneJob) -> dict[str, Any]:
    """Return what a result must have been made of to stand for a job, whatever the program and the machine."""
    return {name: job.identity()[name] for name in ("run", "recipe", "lane", "model", "others")}


def results_at(folder: str | Path) -> list[Path]:
    """Return which result folders a lane has: the folder itself, or those of its sections in their order."""
    folder = Path(folder)
    return read_sections(folder).homes if Folder(folder).has(SECTIONS) else [folder]


def holds_result(job: LaneJob, sections: Sequence[Section]) -> bool:
    """Return whether the output of a job is whole, and take away what a kill left beside it.

    Nothing there, or a result of this job that lacks its report, is none yet; any other result is a
    FileExistsError.
    """
    folder = Path(job.output)
    if not any((folder / name).is_file() for name in ("manifest.json", SECTIONS)):
        return False
    if (
        not _is_cut(folder, sections)
        or not _is_whole(replace(job, report=False))
        or not _of_this_version(folder)
    ):
        raise other_output(folder, f"{OVERWRITE}, or choose another output")
    if not _is_whole(job):
        return False
    for left in (job.work.with_name(f"{job.work.name}.done"), replaced_by(folder)):
        shutil.rmtree(left, ignore_errors=True)
    if job.work.is_dir():
        with begin(job.work, job.identity()):
            finish(job.work)
    return True


def _is_cut(folder: Path, sections: Sequence[Section]) -> bool:
    """Return whether a lane was taken in these sections."""
    if len(sections) == 1:
        return not (folder / SECTIONS).is_file()
    wanted = dict(
        zip(_section_names(sections), [[one.start, one.stop] for one in sections], strict=True)
    )
    try:
        homes = results_at(folder)
        return {
            home.name: read_result_manifest(home).get("section", {}).get("rows") for home in homes
        } == wanted
    except ResultError:
        return False


def _of_this_version(folder: Path) -> bool:
    return all(
        read_result_manifest(home)["flgpr"] == flgpr.__version__ for home in results_at(folder)
    )


def is_done(job: LaneJob) -> bool:
    """Return whether the result of a job is there and whole: of the same run, recipe, lane, model and rows."""
    return not job.work.exists() and _is_whole(job)


def _is_whole(job: LaneJob) -> bool:
    try:
        if Folder(job.output).has(SECTIONS):
            sections = read_sections(job.output)
            for home in sections.homes:
                read_result(home)
            return bool(sections.identity == _lasting(job))
        result = read_result(job.output)
    except ResultError:
        return False
    manifest = result.manifest
    section = None if job.section is None else [job.section.start, job.section.stop]
    lane = (
        result.lane
        if section is None
        else Lane(**manifest.get("section", {}).get("lane", manifest["lane"]))
    )
    others = {
        name: str(one["store_sha256"]) for name, one in manifest["run"].get("others", {}).items()
    }
    return bool(
        manifest["run"].get("store_sha256") == job.store_sha256
        and manifest["recipe_sha256"] == job.identity()["recipe"]
        and others == job.identity()["others"]
        and (lane.x_min, lane.x_max, lane.y_min, lane.y_max) == job.lane
        and manifest.get("section", {}).get("rows") == section
        and manifest["files"].get(f"{MODEL}/{MODEL_FILE}", "") == job.model_sha256
        and (None not in manifest["added"].get("report.html", [None]) or not job.report)
    )
