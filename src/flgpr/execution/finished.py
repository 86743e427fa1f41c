"""Whether the result of a job is there and whole, so that nothing is computed twice."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import flgpr
from flgpr.chain.model import MODEL_FILE
from flgpr.chain.sections import Section
from flgpr.door import Folder
from flgpr.execution.checkpoint import begin, finish
from flgpr.execution.job import LaneJob
from flgpr.model import Lane
from flgpr.results.errors import ResultError
from flgpr.results.result import MODEL, Result, read_result, read_result_manifest
from flgpr.results.sections import SECTIONS, read_sections
from flgpr.store.files import replaced_by
from flgpr.store.outputs import OVERWRITE, output_exists_error


def results_at(folder: str | Path) -> list[Path]:
    """Return the result folders of a lane: the folder itself, or those of its sections in order."""
    folder = Path(folder)
    return read_sections(folder).homes if Folder(folder).has(SECTIONS) else [folder]


def section_names(sections: Sequence[Section]) -> list[str]:
    """Return the names of the folders of a lane's sections."""
    width = max(2, len(str(len(sections))))
    return [f"section-{number:0{width}d}" for number in range(1, len(sections) + 1)]


def lasting_identity(job: LaneJob) -> dict[str, Any]:
    """Return what a result must have been made of to stand for a job.

    Neither the versions of the program nor the machine are part of it.
    """
    identity = job.identity()
    return {name: identity[name] for name in ("run", "recipe", "lane", "model", "others")}


def is_done(job: LaneJob) -> bool:
    """Return whether the result of a job is there and whole.

    It must be of the same run, recipe, lane, model and rows, and no work on it may be left.
    """
    return not job.work.exists() and is_whole(job)


def holds_result(job: LaneJob, sections: Sequence[Section]) -> bool:
    """Return whether the output of a job is whole, and delete what a kill left beside it.

    Nothing there, or a result of this job that lacks its report, does not count as a result.

    Parameters
    ----------
    job : LaneJob
        The job.
    sections : sequence of Section
        The sections that the lane is to be taken in.

    Raises
    ------
    FileExistsError
        If the output holds any other result.
    """
    folder = Path(job.output)
    if not any((folder / name).is_file() for name in ("manifest.json", SECTIONS)):
        return False
    without_report = replace(job, report=False)
    is_of_this_job = (
        _has_sections(folder, sections) and is_whole(without_report) and _of_this_version(folder)
    )
    if not is_of_this_job:
        raise output_exists_error(folder, f"{OVERWRITE}, or choose another output")
    if not is_whole(job):
        return False
    _delete_leftovers(job)
    return True


def _delete_leftovers(job: LaneJob) -> None:
    """Delete what a kill left beside a result that is whole."""
    for path in (job.work.with_name(f"{job.work.name}.done"), replaced_by(Path(job.output))):
        shutil.rmtree(path, ignore_errors=True)
    if job.work.is_dir():
        with begin(job.work, job.identity()):
            finish(job.work)


def _has_sections(folder: Path, sections: Sequence[Section]) -> bool:
    """Return whether a lane was taken in these sections."""
    if len(sections) == 1:
        return not (folder / SECTIONS).is_file()
    expected = {}
    for name, section in zip(section_names(sections), sections, strict=True):
        expected[name] = [section.start, section.stop]
    present = {}
    try:
        for result_folder in results_at(folder):
            manifest = read_result_manifest(result_folder)
            present[result_folder.name] = manifest.get("section", {}).get("rows")
    except ResultError:
        return False
    return present == expected


def _of_this_version(folder: Path) -> bool:
    """Return whether this version of the program wrote the results of a lane."""
    versions = [read_result_manifest(result)["flgpr"] for result in results_at(folder)]
    return all(version == flgpr.__version__ for version in versions)


def is_whole(job: LaneJob) -> bool:
    """Return whether the output of a job is a whole result of it."""
    try:
        if Folder(job.output).has(SECTIONS):
            sections = read_sections(job.output)
            for folder in sections.homes:
                read_result(folder)
            return bool(sections.identity == lasting_identity(job))
        result = read_result(job.output)
    except ResultError:
        return False
    return _is_result_of(job, result)


def _is_result_of(job: LaneJob, result: Result) -> bool:
    """Return whether a result was made of what a job names."""
    manifest = result.manifest
    identity = job.identity()
    section = manifest.get("section", {})
    lane = result.lane
    if job.section is not None:
        # The lane of a section's result is its part of the whole lane.
        lane = Lane(**section.get("lane", manifest["lane"]))
    others = {}
    for name, described in manifest["run"].get("others", {}).items():
        others[name] = str(described["store_sha256"])
    report_is_missing = None in manifest["added"].get("report.html", [None])
    return bool(
        manifest["run"].get("store_sha256") == job.store_sha256
        and manifest["recipe_sha256"] == identity["recipe"]
        and others == identity["others"]
        and (lane.x_min, lane.x_max, lane.y_min, lane.y_max) == job.lane
        and section.get("rows") == identity["rows"]
        and manifest["files"].get(f"{MODEL}/{MODEL_FILE}", "") == job.model_sha256
        and not (job.report and report_is_missing)
    )
