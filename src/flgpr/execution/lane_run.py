"""One lane from run to result: what drives the pieces of work, in sections if need be, and goes on after a stop.

A lane in sections becomes a folder with a result folder per section, ``alarms.csv`` with all alarms ranked together,
``lane.toml``, and ``sections.json``, which lists them with their digests.
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
from flgpr.chain.lane_chain import LaneChain, array_table
from flgpr.chain.memory import plan_sections, sizes_of, threads_within
from flgpr.chain.model import MODEL_FILE
from flgpr.chain.passes import Pass, group_of, part_name
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import parse_recipe
from flgpr.chain.sections import Section, lane_threshold
from flgpr.door import Folder
from flgpr.execution.checkpoint import Checkpoint, begin, finish
from flgpr.execution.executors import Executor, Report
from flgpr.execution.lane_work import (
    LaneJob,
    do_finish,
    do_fold,
    do_part,
    folded,
    kept_pass,
    open_chain,
)
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

    ``OUTPUT.work`` keeps what is done until the result is written: after a stop, however hard, the same call goes on
    there, to the same bits. A lane that would take more than the job's memory, or is longer than ``longest`` (m;
    infinity for one piece or not at all), is taken in sections, which together hold the alarms that the whole lane
    would. Without ``overwrite`` a whole result of this job and version is left as it is, and any other is a
    FileExistsError.
    """
    folder = check_free(job.output)
    first = open_chain(job)  # refuses what does not fit before anything is written
    sections = plan_sections(
        sizes_of(first.setup.run), first.recipe, first.lane, job.max_memory, longest
    )
    if not overwrite and holds_result(job, sections):
        tell_finished(folder, OVERWRITE)
        return results_at(folder)

    def plan(wanted: Callable[[Pass], bool], section: Section | None = None) -> Plan:
        opened = first.run, first.recipe, first.lane, first.model
        chain = LaneChain(
            *opened, section=section, others=first.setup.others
        )  # not kept: it holds memory
        return _planned(chain, wanted)

    folder.parent.mkdir(parents=True, exist_ok=True)
    drive = _Drive(executor, track, note, _threads(first, sections, job))
    if len(sections) > 1:
        return _in_sections(job, sections, plan, drive)
    with begin(job.work, job.identity(), job.largest) as work:
        drive.passes(job, work, plan(lambda _: True))
        drive.finish(job)
        finish(job.work)
    return [folder]


@contextmanager
def passes_of_lane(
    job: LaneJob, executor: Executor, track: Track = silent, note: Note = unnoted, name: str = ""
) -> Iterator[LaneChain]:
    """Do the passes of a stored training lane, but for what explains alarms, and give the chain with their results.

    With a truth it ends where the first stage that has not learnt yet has its examples. ``OUTPUT.work`` is kept.
    """
    job = replace(job, explains=False)
    chain = open_chain(job)
    sections = plan_sections(
        sizes_of(chain.setup.run), chain.recipe, chain.lane, job.max_memory, math.inf
    )
    drive = _Drive(executor, track, note, _threads(chain, sections, job))
    with begin(job.work, job.identity(), job.largest) as work:
        chain = open_chain(job, work)
        drive.passes(job, work, _planned(chain, lambda _: True), name)
        yield chain


def _threads(chain: LaneChain, sections: Sequence[Section], job: LaneJob) -> int:
    """Tell how many threads of a process may take blocks of a lane."""
    if not chain.concurrent:
        return 1
    return threads_within(
        sizes_of(chain.setup.run), chain.recipe, chain.lane, sections, job.max_memory
    )


def _planned(chain: LaneChain, wanted: Callable[[Pass], bool]) -> Plan:
    return {
        one.name: (one.title, chain.numbers(one.name))
        for one in chain.passes.values()
        if wanted(one)
    }


class _Drive:
    """Hands the pieces of a lane out and waits for them."""

    def __init__(self, executor: Executor, track: Track, note: Note, threads: int) -> None:
        self.executor = executor
        self.track = track
        self.note = note
        self.threads = threads

    def passes(self, job: LaneJob, work: Checkpoint, plan: Plan, name: str = "") -> None:
        for stage, (title, every) in plan.items():
            if stage in work:
                continue
            shared = kept_pass(job, stage)
            if shared is not None and self._taken(job, work, stage, shared):
                continue
            begun = folded(work, stage)
            missing = [
                number
                for number in every
                if number >= begun and part_name(stage, number) not in work
            ]
            spent = []
            pieces = [(job, stage, number) for number in missing]
            with closing(self.executor.run(do_part, pieces, self.threads)) as parts:
                for report in self.track(parts, name + title, len(missing)) if missing else ():
                    self.note(report)
                    spent.append(report)
            for report in self.executor.run(do_fold, [(job, stage, tuple(every))]):
                self.note(report)
                spent.append(report)
            if shared is not None:
                self._keep(job, work, stage, shared, spent)

    def _taken(self, job: LaneJob, work: Checkpoint, stage: str, shared: str) -> bool:
        """Take a pass from what jobs of the same images share, and report what it cost the first of them."""
        if not work.take(Checkpoint(Path(job.kept), job.largest), shared, stage):
            return False
        self.note(Folder(job.kept).json(f"{shared}.json") | {"lane": Path(job.output).name})
        return True

    def _keep(
        self, job: LaneJob, work: Checkpoint, stage: str, shared: str, spent: Sequence[Report]
    ) -> None:
        """Leave a pass to jobs of the same images."""
        Path(job.kept).mkdir(parents=True, exist_ok=True)
        sums = {name: sum(one[name] for one in spent) for name in ("seconds", "processor_seconds")}
        largest = max(one["peak_bytes"] for one in spent)
        write_whole(
            Path(job.kept) / f"{shared}.json",
            json.dumps(spent[-1] | sums | {"peak_bytes": largest}),
        )
        Checkpoint(Path(job.kept), job.largest).take(work, stage, shared)

    def finish(self, job: LaneJob, name: str = "") -> None:
        for report in self.track(
            self.executor.run(do_finish, [(job,)]), f"{name}writing the result", 1
        ):
            self.note(report)


def _in_sections(
    job: LaneJob, sections: Sequence[Section], plan: Callable[..., Plan], drive: _Drive
) -> list[Path]:
    """Take a lane in sections: first what all share, then every run-view, then, with one threshold, the rest."""
    gathering = Path(job.output).with_name(Path(job.output).name + ".sections")
    names = _section_names(sections)
    cut = {"rows": [[section.start, section.stop] for section in sections]}
    folders = [Path(job.output) / name for name in names]
    with begin(job.work, job.identity() | cut, job.largest) as shared:
        if (
            "threshold" in shared
            and not gathering.exists()
            and _is_whole(job)
            and results_at(job.output) == folders
        ):
            finish(job.work)  # it was stopped after its last step but this
            return folders
        _prepare(gathering, names if len(shared) else ())
        drive.passes(job, shared, plan(lambda one: one.whole))
        parts = {
            name: replace(job, output=str(gathering / name), section=section, shared=str(job.work))
            for name, section in zip(names, sections, strict=True)
        }
        if "threshold" not in shared:
            for name, part in parts.items():
                with begin(part.work, part.identity(), job.largest) as work:
                    drive.passes(
                        part,
                        work,
                        plan(lambda p: p.name in ("view", "alarms"), part.section),
                        f"{name}: ",
                    )
            shared["threshold"] = {"threshold": np.array(_threshold(job, list(parts.values())))}
        threshold = float(shared["threshold"]["threshold"])
        for (name, part), section in zip(parts.items(), sections, strict=True):
            part = replace(part, section=replace(section, threshold=threshold))
            if not is_done(part):
                with begin(part.work, part.identity(), job.largest) as work:
                    drive.passes(part, work, plan(lambda p: not p.whole, part.section), f"{name}: ")
                    drive.finish(part, f"{name}: ")
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
    """Tell what a result must have been made of to stand for a job, whatever the program and the machine."""
    return {name: job.identity()[name] for name in ("run", "recipe", "lane", "model", "others")}


def results_at(folder: str | Path) -> list[Path]:
    """Tell which result folders a lane has: the folder itself, or those of its sections in their order."""
    folder = Path(folder)
    return read_sections(folder).homes if Folder(folder).has(SECTIONS) else [folder]


def holds_result(job: LaneJob, sections: Sequence[Section]) -> bool:
    """Tell whether the output of a job is whole, and take away what a kill left beside it.

    Nothing there, or a result of this job that lacks its report, is none yet; any other result is a FileExistsError.
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
    """Tell whether a lane was taken in these sections."""
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
    """Tell whether the result of a job is there and whole: of the same run, recipe, lane, model and rows."""
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
