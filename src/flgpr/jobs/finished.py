"""Whether the result of a job is there and whole, so that nothing is computed twice."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import flgpr
from flgpr.jobs.checkpoint import done_folder, work_until_done
from flgpr.jobs.job import LaneJob
from flgpr.method.model import MODEL_FILE
from flgpr.method.sections import Section
from flgpr.model import Lane
from flgpr.results.manifest import MANIFEST, ResultError
from flgpr.results.result import MODEL, check_free, read_result
from flgpr.results.sections import SECTIONS, sections_at
from flgpr.store.files import replaced_by
from flgpr.store.outputs import OVERWRITE, output_exists_error


def is_done(job: LaneJob) -> bool:
    """Return whether the result of a job is there and whole.

    It must be of the same run, recipe, lane, model and rows, and no work on it may be left.
    """
    return not job.work.exists() and bool(whole_results(job))


def keeps_result(job: LaneJob, sections: Sequence[Section], overwrite: bool = False) -> bool:
    """Return whether the output of a job is whole and stays, and refuse what must not be replaced.

    What a kill left beside a result that stays is deleted. Nothing there, or a result of this job
    that lacks its report, does not count as a result.

    Parameters
    ----------
    job : LaneJob
        The job.
    sections : sequence of Section
        The sections that the lane is to be taken in.
    overwrite : bool
        Whether any result is replaced.

    Raises
    ------
    FileExistsError
        If the output holds anything but a result, or another result that is not to be overwritten.
    """
    check_free(job.folder)
    if overwrite or not any((job.folder / name).is_file() for name in (MANIFEST, SECTIONS)):
        return False
    manifests = list(_own_manifests(job).values())
    rows = [manifest.get("section", {}).get("rows") for manifest in manifests]
    expected_rows = [[section.start, section.stop] for section in sections]
    if len(sections) == 1:
        expected_rows = [job.identity["rows"]]
    versions = {manifest["flgpr"] for manifest in manifests}
    if rows != expected_rows or versions != {flgpr.__version__}:
        raise output_exists_error(job.folder, f"{OVERWRITE}, or choose another output")
    if _lacks_report(job, manifests):
        return False
    for path in (done_folder(job.work), replaced_by(job.folder)):
        shutil.rmtree(path, ignore_errors=True)
    if job.work.is_dir():
        with work_until_done(job):
            pass  # all of it is done
    return True


def whole_results(job: LaneJob) -> list[Path]:
    """Return the folder of the whole result of a job, or those of its sections in order.

    There is none if the result is not whole, lacks its report or was made of anything else.
    """
    manifests = _own_manifests(job)
    if not manifests or _lacks_report(job, list(manifests.values())):
        return []
    return list(manifests)


def _own_manifests(job: LaneJob) -> dict[Path, dict[str, Any]]:
    """Return the manifests of the whole result of a job, or of its sections in order, by folder.

    There is none if the result is not whole or was made of anything else.
    """
    try:
        sections = sections_at(job.folder)
        if sections is None:
            manifest = read_result(job.folder).manifest
            return {job.folder: manifest} if _is_result_of(job, manifest) else {}
        if sections.identity != job.lasting_identity:
            return {}
        # One at a time, as a result holds its run-views.
        return {folder: read_result(folder).manifest for folder in sections.homes}
    except ResultError:
        return {}


def _lacks_report(job: LaneJob, manifests: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether a job writes a report that its result lacks; one in sections is not asked."""
    if not job.report or len(manifests) > 1:
        return False
    return None in manifests[0]["added"].get("report.html", [None])


def _is_result_of(job: LaneJob, manifest: Mapping[str, Any]) -> bool:
    """Return whether a result was made of what a job names, with a report or without."""
    identity = job.identity
    section = manifest.get("section", {})
    lane = Lane(**manifest["lane"])
    if job.section is not None:
        # The lane of a section's result is its part of the whole lane.
        lane = Lane(**section.get("lane", manifest["lane"]))
    others = {}
    for name, described in manifest["run"].get("others", {}).items():
        others[name] = str(described["store_sha256"])
    return bool(
        manifest["run"].get("store_sha256") == job.store_sha256
        and manifest["recipe_sha256"] == identity["recipe"]
        and others == identity["others"]
        and astuple(lane) == job.lane
        and section.get("rows") == identity["rows"]
        and manifest["files"].get(f"{MODEL}/{MODEL_FILE}", "") == job.model_sha256
        and manifest["run"].get("unlike", {}).get("choice", job.trust.unlike) == job.trust.unlike
        and manifest["run"].get("far", {}).get("rate") == job.trust.far
    )
