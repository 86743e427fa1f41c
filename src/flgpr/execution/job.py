"""One lane as pieces of work that any process can do: it needs the run, the work folder, and what the job says."""

from __future__ import annotations

import os
import platform
import resource
import socket
import threading
import time
from collections import ChainMap
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from itertools import takewhile
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np
import pandas as pd

import flgpr
from flgpr.chain.engine import BLOCK, Arrays, Engine, block_name, worker_state
from flgpr.chain.lane_setup import LaneSetup
from flgpr.chain.method import detection_of, engine_of
from flgpr.chain.model import Model, load_model, read_model
from flgpr.chain.recipe import parse_recipe
from flgpr.chain.sections import Section, section_lane, section_note
from flgpr.door import read_named
from flgpr.execution.checkpoint import BlockCheckpoint, Checkpoint
from flgpr.execution.workers import Report
from flgpr.model import Lane
from flgpr.report import report_html
from flgpr.results.description import describe_run
from flgpr.results.result import add_files, read_result, write_result
from flgpr.store import MAX_MEMORY, canonical_json, open_run, read_manifest, sha256
from flgpr.store.tables import parse_table

FOLD_BYTES = 1 << 28
"""States of this size are merged as they come: those of a long run would fill the disk."""
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pandas")
_OPENING = threading.Lock()
_ONE_AT_A_TIME = threading.Lock()
_PASS_CACHE_LAYOUT = 2  # changes when the arrays that passes share do


@dataclass(frozen=True)
class LaneJob:
    """A detection as plain values, so that it can be sent anywhere."""

    run: str  #: run store
    recipe: str  #: its text
    lane: tuple[float, float, float, float]  #: x_min, x_max, y_min, y_max, m
    model: str | None  #: folder of a trained model
    output: str  #: result folder to make
    report: bool
    store_sha256: str  #: digest of the run's manifest
    model_sha256: str  #: that of the model, "" without one
    code: tuple[tuple[str, str], ...]  #: versions of the program and of the libraries
    cpu: str  #: processor of the machine that drives
    max_memory: int = MAX_MEMORY  #: that reading the run may take, bytes
    section: Section | None = None  #: rows of the lane that are worked on; None takes all
    shared: str = ""  #: the work folder that has the background of all sections
    others: tuple[
        tuple[str, str, str], ...
    ] = ()  #: name, store and digest of every run taken together with it
    truth: tuple[str, str] = ("", "")  #: file and digest of a training lane's targets
    explains: bool = True
    pass_cache: str = (
        ""  #: folder of passes that jobs of other recipes share, see :func:`cached_pass`
    )

    @property
    def work(self) -> Path:
        """The work folder beside the output."""
        output = Path(self.output)
        return output.with_name(output.name + ".work")

    @property
    def largest(self) -> int:
        """Bytes that a file of the work folder may have: what a process wrote there it held."""
        return max(self.max_memory, MAX_MEMORY)

    def identity(self) -> dict[str, Any]:
        """All that the bits of the result depend on; a section's threshold follows from it."""
        rows = None if self.section is None else [self.section.start, self.section.stop]
        return {
            "rows": rows,
            "run": self.store_sha256,
            "recipe": sha256(self.recipe.encode()),
            "lane": list(self.lane),
            "model": self.model_sha256,
            "code": dict(self.code),
            "cpu": self.cpu,
            "block": BLOCK,
            "others": {name: digest for name, _, digest in self.others},
            "truth": self.truth[1],
            "explains": self.explains,
        }


def make_job(
    run: str | Path,
    recipe: str,
    lane: Lane,
    output: str | Path,
    report: bool = True,
    model: str | Path | None = None,
    max_memory: int = MAX_MEMORY,
    others: Mapping[str, str | Path] | None = None,
    truth: str | Path | None = None,
    pass_cache: str | Path | None = None,
) -> LaneJob:
    """Describe a detection; a run or model that is not valid is refused."""
    beside = []
    for name, path in (others or {}).items():
        beside.append((name, str(Path(path).resolve()), read_manifest(path)["sha256"]))
    targets = ("", "")
    if truth is not None:
        targets = (str(Path(truth).resolve()), sha256(read_named(truth)))
    return LaneJob(
        str(Path(run).resolve()),
        recipe,
        (lane.x_min, lane.x_max, lane.y_min, lane.y_max),
        None if model is None else str(Path(model).resolve()),
        str(Path(output).resolve()),
        report,
        read_manifest(run)["sha256"],
        "" if model is None else model_digest(model),
        code_versions(),
        processor(),
        max_memory,
        others=tuple(beside),
        truth=targets,
        pass_cache="" if pass_cache is None else str(Path(pass_cache).resolve()),
    )


def model_digest(model: str | Path) -> str:
    """SHA-256 of the file of a valid model."""
    digest = sha256(read_model(model))
    load_model(model, digest)
    return digest


@lru_cache
def code_versions() -> tuple[tuple[str, str], ...]:
    """Versions of what computes: equal ones give equal bits on equal processors."""
    own = (("flgpr", flgpr.__version__), ("python", platform.python_version()))
    return (*own, *((name, version(name)) for name in _LIBRARIES))


@lru_cache
def processor() -> str:
    """Name of the processor, as the compiler sees it."""
    return f"{platform.machine()} {llvmlite.binding.get_host_cpu_name()}"


def cached_pass(job: LaneJob, name: str) -> str | None:
    """Return the name under which jobs of other recipes share the result of a pass; None if they do not."""
    if not job.pass_cache:
        return None
    _, engine, _ = _open(job)
    depends_on = engine.passes[name].cache_key()
    if depends_on is None:
        return None
    identity = job.identity()
    about = {key: identity[key] for key in ("run", "lane", "code", "cpu", "block", "others")}
    about["layout"] = _PASS_CACHE_LAYOUT
    return sha256(canonical_json([about, name, depends_on]))[:32]


def do_block(job: LaneJob, name: str, number: int) -> Report:
    """Do one block of a pass and leave its state in the work folder.

    A process that does not see the work folder, or has other versions than the driver, refuses.
    """
    begun = _now()
    # Threads of one process take blocks at once only where the driver deals them out to threads.
    alone = worker_state.threads == 1
    with _ONE_AT_A_TIME if alone else nullcontext():
        _, engine, work = _open(job)
        block = block_name(name, number)
        if block not in work and number >= merged_blocks(work, name):
            checkpoint = BlockCheckpoint(work, block)
            work[block] = engine.gather_block(name, number, checkpoint)
            checkpoint.drop()
        size = work.size(block)
        _merge_ahead(engine, work, name)
        return report(Path(job.output).name, name, number, begun, size)


def merged_blocks(work: Checkpoint, name: str) -> int:
    """Return how many blocks of a pass, the first ones, are merged before the others are done."""
    so_far = _so_far(name)
    return int(work.bundle(so_far)["next"]) if so_far in work else 0


def _so_far(name: str) -> str:
    return f"{name}-so-far"


def _merge_ahead(engine: Engine, work: Checkpoint, name: str) -> None:
    """Merge the first blocks of a pass that are done, if they are large together, to the bits of one merge of all.

    Only where all blocks are gone through. Sums are then no larger than those of one block; what
    grows with scans is merged when there is twice as much of it, so that it is not written over and
    over.
    """
    planned = engine.passes[name]
    if not planned.all_scans or planned.keep_blocks:
        return
    with work.merging() as alone:
        if not alone:
            return
        begun = merged_blocks(work, name)
        so_far = _so_far(name)
        following = engine.block_numbers(name)[begun:]
        ready = list(takewhile(lambda number: block_name(name, number) in work, following))
        size = sum(work.size(block_name(name, number)) for number in ready)
        if not ready or size < max(FOLD_BYTES, 2 * work.size(so_far)):
            return
        gatherer = engine.merge_blocks(name, _states(work, name, ready))
        work[so_far] = {**gatherer.state(True), "next": np.array(begun + len(ready))}
        for number in ready:
            del work[block_name(name, number)]


def do_merge(job: LaneJob, name: str, numbers: Sequence[int]) -> Report:
    """Merge the blocks of a pass, in their order, and leave its result in the work folder; reported as block -1."""
    begun = _now()
    with _ONE_AT_A_TIME:
        _, engine, work = _open(job)
        keep_blocks = engine.passes[name].keep_blocks
        if name not in work:
            result: Arrays = {}
            if not keep_blocks:
                result = engine.merge_blocks(name, _states(work, name, numbers)).result()
            work[name] = result
        if not keep_blocks:
            work.drop_blocks(name)
        return report(Path(job.output).name, name, -1, begun, work.size(name))


def do_finish(job: LaneJob) -> Report:
    """Write the result folder from a work folder that holds every pass; report the number of ``alarms``."""
    begun = _now()
    with _ONE_AT_A_TIME:
        lane, _, _ = _open(job)
        detection = detection_of(lane)
        described = describe_run(lane.run, job.run, lane.recipe.motion)
        if job.others:
            described["others"] = {}
            for name, path, digest in job.others:
                described["others"][name] = {"path": path, "store_sha256": digest}
        borders = section_lane(lane.recipe, lane.lane, lane.section)
        section = section_note(lane.lane, lane.section) if job.section else None
        folder = write_result(
            job.output, [detection], job.recipe, borders, described, lane.model, section
        )
        if job.report:
            add_files(folder, {"report.html": report_html(read_result(folder))})
        _opened.cache_clear()  # lets the run-views go
        done = report(Path(job.output).name, "finish", -1, begun, 0)
        return done | {"alarms": len(detection.alarms)}


def _states(work: Checkpoint, name: str, numbers: Sequence[int]) -> Iterator[Arrays]:
    """Yield the states of some blocks; of those that are merged already, once, that of all of them together."""
    begun = merged_blocks(work, name)
    if begun:
        bundle = work.bundle(_so_far(name))
        yield {key: array for key, array in bundle.items() if key != "next"}
    for number in numbers:
        if number >= begun:
            yield dict(work.bundle(block_name(name, number)))


def _open(job: LaneJob) -> tuple[LaneSetup, Engine, Checkpoint]:
    if job.code != code_versions():
        theirs = dict(job.code)
        ours = dict(code_versions())
        differ = ", ".join(
            f"{n} {ours.get(n)} and {theirs.get(n)}" for n in theirs if ours.get(n) != theirs[n]
        )
        raise ValueError(
            f"worker {socket.gethostname()} must have the versions of the driver, got {differ}"
        )
    if not job.work.is_dir():
        raise ValueError(
            f"worker {socket.gethostname()} must see the work folder of the driver, got no "
            f"{job.work}"
        )
    with _OPENING:
        return _opened(job)


@lru_cache(maxsize=2)
def _opened(job: LaneJob) -> tuple[LaneSetup, Engine, Checkpoint]:
    work = Checkpoint(job.work, job.largest)
    results: MutableMapping[str, Any] = work
    if job.shared:
        results = ChainMap(work, Checkpoint(Path(job.shared), job.largest))
    lane = open_lane(job, results)
    return lane, engine_of(lane), work


def open_lane(job: LaneJob, results: MutableMapping[str, Any] | None = None) -> LaneSetup:
    """Open what a job names, as the driver saw it."""
    for name, path, digest in (("run", job.run, job.store_sha256), *job.others):
        if read_manifest(path)["sha256"] != digest:
            raise ValueError(
                f"worker {socket.gethostname()} must see the {name} of the driver, got another at "
                f"{path}"
            )
    model = None if job.model is None else _model_of(job, job.model)
    others = {name: open_run(path, job.max_memory) for name, path, _ in job.others}
    return LaneSetup(
        open_run(job.run, job.max_memory),
        parse_recipe(job.recipe),
        Lane(*job.lane),
        model,
        results,
        job.section,
        others,
        _truth_of(job) if job.truth[0] else None,
        job.explains,
    )


def _model_of(job: LaneJob, folder: str) -> Model:
    if sha256(read_model(folder)) != job.model_sha256:
        raise ValueError(
            f"worker {socket.gethostname()} must see the model of the driver, got another at "
            f"{folder}"
        )
    return load_model(folder, job.model_sha256)


def _truth_of(job: LaneJob) -> pd.DataFrame:
    path, digest = job.truth
    data = read_named(path)
    if sha256(data) != digest:
        raise ValueError(
            f"worker {socket.gethostname()} must see the truth of the driver, got another at {path}"
        )
    return parse_table(data, "truth", path)


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def report(lane: str, stage: str, number: int, begun: tuple[float, float], size: int) -> Report:
    """Report a piece of work that began at ``begun`` by the clocks of wall and processor, and its bytes."""
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
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "cpu": processor(),
    }
