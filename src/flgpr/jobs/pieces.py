"""The pieces of work of a job: a block of a pass, the merge of its blocks, the result.

Any process that sees the run and the work folder can do them (``jobs/workers.py``). What they
return is small: arrays go through the work folder.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import lru_cache
from itertools import zip_longest
from typing import Any

import xarray as xr

from flgpr import system
from flgpr.door import read_named
from flgpr.engine import Engine, block_name, worker_state
from flgpr.health.judging import LeftOut
from flgpr.health.of_run import without
from flgpr.jobs.checkpoint import BlockCheckpoint, Checkpoint
from flgpr.jobs.job import LaneJob, code_versions, processor
from flgpr.jobs.workers import Report
from flgpr.method.detection import MAIN, Detection
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.instead import describe_trust
from flgpr.method.method import detections_of, engine_of
from flgpr.method.model import of_another_array, parse_model, read_model, trained_on
from flgpr.method.sections import describe_searched, section_lane, section_note
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe
from flgpr.report import report_html
from flgpr.results.description import describe_run
from flgpr.results.result import add_files, read_result, write_result
from flgpr.store import open_run, read_manifest, sha256
from flgpr.store.tables import parse_table
from flgpr.types import Arrays

_OPENING = threading.Lock()
_ONE_AT_A_TIME = threading.Lock()
_Clocks = tuple[float, float]
"""Readings of the clocks of the wall and of the process, s."""


def do_block(job: LaneJob, name: str, number: int) -> Report:
    """Do one block of a pass and write its state to the work folder.

    Parameters
    ----------
    job : LaneJob
        The job.
    name : str
        Name of the pass.
    number : int
        Number of the block.

    Returns
    -------
    Report
        What it cost.

    Raises
    ------
    ValueError
        If this process does not see the work folder, or has other versions than the driver.
    """
    begun = _now()
    # Threads of one process take blocks at once only where the driver hands blocks to threads.
    alone = worker_state.threads == 1
    with _ONE_AT_A_TIME if alone else nullcontext():
        _, engine, work = _open(job)
        block = block_name(name, number)
        if work.missing_blocks(name, [number]):
            checkpoint = BlockCheckpoint(work, block)
            work[block] = engine.gather_block(name, number, checkpoint)
            checkpoint.drop()
        size = work.size(block)
        work.merge_ahead(engine, name)
        return report(job.name, name, number, begun, size)


def do_merge(job: LaneJob, name: str, numbers: Sequence[int]) -> Report:
    """Merge the blocks of a pass, in their order, and write its result to the work folder.

    Parameters
    ----------
    job : LaneJob
        The job.
    name : str
        Name of the pass.
    numbers : sequence of int
        Numbers of its blocks.

    Returns
    -------
    Report
        What it cost; the block is -1.
    """
    begun = _now()
    with _ONE_AT_A_TIME:
        _, engine, work = _open(job)
        keep_blocks = engine.passes[name].keep_blocks
        if name not in work:
            result: Arrays = {}
            if not keep_blocks:
                result = engine.result_of(name, work.block_states(name, numbers))
            work[name] = result
        if not keep_blocks:
            work.drop_blocks(name)
        return report(job.name, name, -1, begun, work.size(name))


def do_finish(job: LaneJob) -> Report:
    """Write the result folder from a work folder that holds every pass.

    Returns
    -------
    Report
        What it cost, and the number of ``alarms``.
    """
    begun = _now()
    with _ONE_AT_A_TIME:
        lane, _, _ = _open(job)
        detections = detections_of(lane)
        borders = section_lane(lane.recipe, lane.lane, lane.section)
        section = section_note(lane.lane, lane.section) if job.section else None
        folder = write_result(
            job.folder,
            with_recipes(detections, job.recipe),
            job.recipe,
            borders,
            _describe_runs(job, lane, detections),
            lane.model,
            section,
        )
        if job.report:
            add_files(folder, {"report.html": report_html(read_result(folder))})
        _opened.cache_clear()  # frees the memory of the run-views
        done = report(job.name, "finish", -1, begun, 0)
        return done | {"alarms": len(detections[0].alarms)}


def _describe_runs(job: LaneJob, lane: ImagedRun, detections: list[Detection]) -> dict[str, Any]:
    """Return what a manifest says of the run, and of those taken together with it."""
    described = describe_run(lane.run, job.run, lane.recipe.motion)
    described["searched"] = describe_searched(
        lane.run, lane.recipe, Lane(*job.lane), job.lane_source
    )
    if job.health.findings:
        described["health"] = [finding.as_json() for finding in job.health.findings]
    if job.left_out:
        described["left_out"] = job.left_out.as_json()
    if trained_on(lane.model, job.store_sha256):
        described["trained_on_this_run"] = True
    another = of_another_array(lane.model, lane.run)
    if another:
        described["another_array"] = another
    described |= describe_trust(lane, detections)
    if job.others:
        described["others"] = {}
        for (name, path, digest), left_out in zip_longest(job.others, job.left_out_of_others):
            described["others"][name] = {"path": path, "store_sha256": digest}
            if left_out:
                described["others"][name]["left_out"] = left_out.as_json()
    return described


def with_recipes(detections: list[Detection], text: str) -> list[Detection]:
    """Return detections that know their recipe: those beside the result's own are of its recipe."""
    known = []
    for detection in detections:
        is_own = detection.name == MAIN or detection.recipe_text
        known.append(detection if is_own else replace(detection, recipe_text=text))
    return known


def _open(job: LaneJob) -> tuple[ImagedRun, Engine, Checkpoint]:
    """Return the lane of a job, its engine and its work folder, as this process sees them."""
    if job.code != code_versions():
        ours = dict(code_versions())
        different = []
        for name, theirs in job.code:
            if ours.get(name) != theirs:
                different.append(f"{name} {ours.get(name)} and {theirs}")
        raise ValueError(
            f"worker {socket.gethostname()} must have the versions of the driver, "
            f"got {', '.join(different)}"
        )
    if not job.work.is_dir():
        raise ValueError(
            f"worker {socket.gethostname()} must see the work folder of the driver, got no "
            f"{job.work}"
        )
    with _OPENING:
        return _opened(job)


@lru_cache(maxsize=2)
def _opened(job: LaneJob) -> tuple[ImagedRun, Engine, Checkpoint]:
    """Open what a job names; the latest ones stay open, as a process does many pieces of a job."""
    lane, work = open_lane(job)
    return lane, engine_of(lane), work


# What a job names, opened: by the driver and by every worker


def open_lane(job: LaneJob) -> tuple[ImagedRun, Checkpoint]:
    """Open the run, the model and the truth that a job names, as the driver saw them.

    Returns
    -------
    lane : ImagedRun
        The lane. It reads the results of passes in the work folder, those that sections share
        included.
    work : Checkpoint
        The work folder, which need not be there yet.

    Raises
    ------
    ValueError
        If this process sees others, or the recipe does not fit.
    """
    model_data, truth_data = _read_as_seen(job)
    model = None if model_data is None else parse_model(model_data, str(job.model))
    truth = None if truth_data is None else parse_table(truth_data, "truth", job.truth[0])
    recipe = parse_recipe(job.recipe)
    run = without(open_run(job.run, job.max_memory), job.left_out)
    work = Checkpoint(job.work, job.largest)
    results = work.with_shared(job.shared)
    lane = ImagedRun(
        run=run,
        recipe=recipe,
        lane=Lane(*job.lane),
        model=model,
        results=results,
        section=job.section,
        others=other_runs(job),
        truth=truth,
        explains=job.explains,
        trust=job.trust,
    )
    return lane, work


def other_runs(job: LaneJob) -> dict[str, xr.Dataset]:
    """Open the runs that a job takes together with its own, by name."""
    others = {}
    for (name, path, _), left_out in zip_longest(job.others, job.left_out_of_others):
        others[name] = without(open_run(path, job.max_memory), left_out or LeftOut())
    return others


def _read_as_seen(job: LaneJob) -> tuple[bytes | None, bytes | None]:
    """Refuse files that are not those that the driver saw.

    Return the bytes of the model and of the truth, None where the job has none.
    """
    seen = [("run", job.run, read_manifest(job.run)["sha256"], job.store_sha256)]
    for name, path, digest in job.others:
        seen.append((name, path, read_manifest(path)["sha256"], digest))
    model_data = None
    if job.model is not None:
        model_data = read_model(job.model)
        seen.append(("model", job.model, sha256(model_data), job.model_sha256))
    truth_path, truth_digest = job.truth
    truth_data = None
    if truth_path:
        truth_data = read_named(truth_path)
        seen.append(("truth", truth_path, sha256(truth_data), truth_digest))

    for name, path, actual, expected in seen:
        if actual != expected:
            raise ValueError(
                f"worker {socket.gethostname()} must see the {name} of the driver, got another at "
                f"{path}"
            )
    return model_data, truth_data


# Reports


def _now() -> _Clocks:
    """Read the clocks."""
    return time.perf_counter(), time.process_time()


def report(lane: str, stage: str, number: int, begun: _Clocks, size: int) -> Report:
    """Return a report of a piece of work that is done now.

    Parameters
    ----------
    lane : str
        Name of the lane.
    stage : str
        Name of the pass.
    number : int
        Number of the block.
    begun : tuple of float
        Clocks of wall and process when the work began.
    size : int
        Bytes that it wrote.
    """
    wall, processor_time = _now()
    # The processor time is that of the process, and each of its threads sees all of it.
    own_share = (processor_time - begun[1]) / worker_state.threads
    return {
        "lane": lane,
        "stage": stage,
        "block": number,
        "seconds": wall - begun[0],
        "processor_seconds": own_share,
        "bytes": size,
        "peak_bytes": system.peak_memory(),
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "cpu": processor(),
    }
