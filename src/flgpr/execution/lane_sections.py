"""One lane in sections: what they share, the threshold of all, and their results brought together.

A lane in sections becomes a folder with a result folder per section, ``alarms.csv`` with all alarms
ranked together, ``lane.toml``, and ``sections.json``, which lists them with their digests.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.chain.engine import group_of
from flgpr.chain.lane_setup import array_table
from flgpr.chain.recipe import parse_recipe
from flgpr.chain.sections import Section, lane_threshold
from flgpr.execution.checkpoint import Checkpoint, begin, finish
from flgpr.execution.finished import (
    is_done,
    is_whole,
    lasting_identity,
    results_at,
    section_names,
)
from flgpr.execution.job import LaneJob
from flgpr.execution.pass_runner import PassRunner
from flgpr.model import Lane
from flgpr.results.result import read_result_manifest
from flgpr.results.sections import write_sections
from flgpr.store import lane_text, write_table
from flgpr.store.files import listed_files, replace_folder, write_whole
from flgpr.store.tables import parse_own_table


def detect_in_sections(job: LaneJob, sections: Sequence[Section], runner: PassRunner) -> list[Path]:
    """Take a lane in sections.

    First come the passes that all sections share, then the run-view of every section, and then,
    with one threshold for the lane, the rest of every section.

    Parameters
    ----------
    job : LaneJob
        The job of the lane.
    sections : sequence of Section
        Its sections.
    runner : PassRunner
        Does the passes.

    Returns
    -------
    list of Path
        The result folders of the sections, in their order.
    """
    output = Path(job.output)
    gathering = output.with_name(f"{output.name}.sections")
    names = section_names(sections)
    folders = [output / name for name in names]
    identity = job.identity()
    identity["rows"] = [[section.start, section.stop] for section in sections]
    with begin(job.work, identity, job.largest) as shared:
        stopped_after_last_step = (
            "threshold" in shared
            and not gathering.exists()
            and is_whole(job)
            and results_at(output) == folders
        )
        if stopped_after_last_step:
            finish(job.work)
            return folders

        _prepare(gathering, names if len(shared) else ())
        runner.run(job, shared, lambda planned: planned.all_scans)
        section_jobs = _section_jobs(job, sections, gathering)
        if "threshold" not in shared:
            threshold = _find_threshold(job, section_jobs, runner)
            shared["threshold"] = {"threshold": np.array(threshold)}
        threshold = float(shared["threshold"]["threshold"])
        for section_job in section_jobs:
            _finish_section(section_job, threshold, runner)
        _bring_together(job, gathering, names)
        finish(job.work)
    return folders


def _section_jobs(job: LaneJob, sections: Sequence[Section], gathering: Path) -> list[LaneJob]:
    """Return the jobs of the sections, whose results are gathered in a folder."""
    jobs = []
    for name, section in zip(section_names(sections), sections, strict=True):
        output = str(gathering / name)
        jobs.append(replace(job, output=output, section=section, shared=str(job.work)))
    return jobs


def _find_threshold(job: LaneJob, section_jobs: Sequence[LaneJob], runner: PassRunner) -> float:
    """Do the run-views of all sections, and return the threshold of the lane by its maxima."""
    for section_job in section_jobs:
        label = f"{Path(section_job.output).name}: "
        with begin(section_job.work, section_job.identity(), job.largest) as work:
            runner.run(section_job, work, lambda planned: planned.name in ("view", "alarms"), label)
    tables = []
    pixels_seen = 0
    for section_job in section_jobs:
        raised = Checkpoint(section_job.work, job.largest)["alarms"]
        tables.append(array_table(group_of(raised, "maximum")))
        pixels_seen += int(raised["seen"])
    maxima = pd.concat(tables, ignore_index=True)
    return lane_threshold(parse_recipe(job.recipe), Lane(*job.lane), maxima, pixels_seen)


def _finish_section(job: LaneJob, threshold: float, runner: PassRunner) -> None:
    """Do the rest of a section and write its result, unless that is done."""
    if job.section is None:
        raise ValueError("job must have a section, got the whole lane")
    job = replace(job, section=replace(job.section, threshold=threshold))
    if is_done(job):
        return
    label = f"{Path(job.output).name}: "
    with begin(job.work, job.identity(), job.largest) as work:
        runner.run(job, work, lambda planned: not planned.all_scans, label)
        runner.finish(job, label)
        finish(job.work)


def _prepare(gathering: Path, names: Sequence[str]) -> None:
    """Make the folder that the sections gather in, without what is left of another job."""
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


def _bring_together(job: LaneJob, gathering: Path, names: Sequence[str]) -> None:
    """Write the table of all alarms and the list of sections, and move all into place."""
    tables = []
    for name in names:
        table = _alarms_of(gathering / name)
        table["alarm_id"] = [f"{name}/{alarm}" for alarm in table["alarm_id"]]
        tables.append(table)
    # Columns of tables without rows would change the types of the others.
    filled = [table for table in tables if len(table)] or tables[:1]
    alarms = pd.concat(filled, ignore_index=True)
    alarms = alarms.sort_values("confidence", ascending=False, kind="stable")
    write_table(alarms, gathering / "alarms.csv")
    write_whole(gathering / "lane.toml", lane_text(Lane(*job.lane)))
    write_sections(gathering, names, lasting_identity(job))
    replace_folder(gathering, Path(job.output))


def _alarms_of(folder: Path) -> pd.DataFrame:
    """Read the alarms of a result that is whole, and nothing else of it."""
    files = listed_files(folder, read_result_manifest(folder))
    return parse_own_table(files.read("alarms.csv"), "alarms", folder / "alarms.csv")
