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
from flgpr.chain.lane_chain import LaneChain
from flgpr.chain.model import Model, load_model, read_model
from flgpr.chain.passes import BLOCK, Arrays, mine, part_name
from flgpr.chain.recipe import parse_recipe
from flgpr.chain.sections import Section, section_lane, section_note
from flgpr.door import read_named
from flgpr.execution.checkpoint import Checkpoint, Kept
from flgpr.execution.executors import Report
from flgpr.model import Lane
from flgpr.report import report_html
from flgpr.results.description import describe_run
from flgpr.results.result import add_files, read_result, write_result
from flgpr.store import MAX_MEMORY, canonical_json, open_run, read_manifest, sha256
from flgpr.store.tables import parse_table

FOLD_BYTES = 1 << 28
"""Parts of this size are folded together as they come: those of a long run would fill the disk."""
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pandas")
_OPENING = threading.Lock()
_ONE_AT_A_TIME = threading.Lock()


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
    #: folder of passes that jobs of the same images share, see :meth:`flgpr.chain.lane_chain.LaneChain.basis`
    kept: str = ""

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
    kept: str | Path | None = None,
) -> LaneJob:
    """Describe a detection; a run or model that is not valid is refused."""
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
        others=tuple(
            (n, str(Path(p).resolve()), read_manifest(p)["sha256"])
            for n, p in (others or {}).items()
        ),
        truth=("", "")
        if truth is None
        else (str(Path(truth).resolve()), sha256(read_named(truth))),
        kept="" if kept is None else str(Path(kept).resolve()),
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


def kept_pass(job: LaneJob, stage: str) -> str | None:
    """Name under which jobs of the same images share the result of a pass; None if they do not."""
    if not job.kept:
        return None
    told = _open(job)[0].basis(stage)
    about = {
        name: job.identity()[name] for name in ("run", "lane", "code", "cpu", "block", "others")
    }
    return None if told is None else sha256(canonical_json([about, told]))[:32]


def do_part(job: LaneJob, stage: str, number: int) -> Report:
    """Do one block of a stage and leave it in the work folder; a process without it, or of other versions, refuses."""
    begun = _now()
    with (
        _ONE_AT_A_TIME if mine.threads == 1 else nullcontext()
    ):  # but for threads that blocks are dealt to
        chain, work = _open(job)
        name = part_name(stage, number)
        if name not in work and number >= folded(work, stage):
            kept = Kept(work, name)
            work[name] = chain.part(stage, number, kept)
            kept.drop()
        size = work.size(name)
        _fold_ahead(chain, work, stage)
        return report(Path(job.output).name, stage, number, begun, size)


def folded(work: Checkpoint, stage: str) -> int:
    """Tell how many blocks of a stage, the first ones, are folded before the others are done."""
    return int(work.bundle(_so_far(stage))["next"]) if _so_far(stage) in work else 0


def _so_far(stage: str) -> str:
    return f"{stage}-so-far"


def _fold_ahead(chain: LaneChain, work: Checkpoint, stage: str) -> None:
    """Fold the first blocks of a stage that are done, if they are large together, with the bits of one fold of all.

    Only where all blocks are gone through. Sums are then no larger than those of one block; what grows with scans is
    folded when there is twice as much of it, so that it is not written over and over.
    """
    if not chain.passes[stage].whole or chain.passes[stage].stored:
        return
    with work.folding() as alone:
        if not alone:
            return
        begun = folded(work, stage)
        so_far = _so_far(stage)
        ready = list(
            takewhile(lambda number: part_name(stage, number) in work, chain.numbers(stage)[begun:])
        )
        size = sum(work.size(part_name(stage, number)) for number in ready)
        if not ready or size < max(FOLD_BYTES, 2 * work.size(so_far)):
            return
        gathered = chain.merged(stage, _parts(work, stage, ready))
        work[so_far] = {**gathered.state(True), "next": np.array(begun + len(ready))}
        for number in ready:
            del work[part_name(stage, number)]


def do_fold(job: LaneJob, stage: str, numbers: Sequence[int]) -> Report:
    """Fold the blocks of a stage, in their order, and leave its result in the work folder; reported as block -1."""
    begun = _now()
    with _ONE_AT_A_TIME:
        chain, work = _open(job)
        stored = chain.passes[stage].stored
        if stage not in work:
            work[stage] = (
                {} if stored else chain.merged(stage, _parts(work, stage, numbers)).result()
            )
        if not stored:
            work.drop_parts(stage)
        return report(Path(job.output).name, stage, -1, begun, work.size(stage))


def do_finish(job: LaneJob) -> Report:
    """Write the result folder from a work folder in which every stage is folded; report the number of ``alarms``."""
    begun = _now()
    with _ONE_AT_A_TIME:
        chain, _ = _open(job)
        detections = chain.detections()
        described = describe_run(chain.run, job.run, chain.recipe.motion)
        if job.others:
            described["others"] = {
                name: {"path": path, "store_sha256": digest} for name, path, digest in job.others
            }
        lane = section_lane(chain.recipe, chain.lane, chain.section)
        cut = chain.section if job.section else None
        told = None if cut is None else section_note(chain.lane, cut)
        folder = write_result(
            job.output, detections, job.recipe, lane, described, chain.model, told
        )
        if job.report:
            add_files(folder, {"report.html": report_html(read_result(folder))})
        _opened.cache_clear()  # lets the run-views go
        return report(Path(job.output).name, "finish", -1, begun, 0) | {
            "alarms": len(detections[0].alarms)
        }


def _parts(work: Checkpoint, stage: str, numbers: Sequence[int]) -> Iterator[Arrays]:
    """Give what was gathered of some blocks; of those that are folded already, once, all of them together."""
    begun = folded(work, stage)
    if begun:
        yield {name: array for name, array in work.bundle(_so_far(stage)).items() if name != "next"}
    for number in numbers:
        if number >= begun:
            yield dict(work.bundle(part_name(stage, number)))


def _open(job: LaneJob) -> tuple[LaneChain, Checkpoint]:
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
            f"worker {socket.gethostname()} must see the work folder of the driver, got no {job.work}"
        )
    with _OPENING:
        return _opened(job)


@lru_cache(maxsize=2)
def _opened(job: LaneJob) -> tuple[LaneChain, Checkpoint]:
    work = Checkpoint(job.work, job.largest)
    return open_chain(
        job, ChainMap(work, Checkpoint(Path(job.shared), job.largest)) if job.shared else work
    ), work


def open_chain(job: LaneJob, known: MutableMapping[str, Any] | None = None) -> LaneChain:
    """Open what a job names, as the driver saw it, and make its chain."""
    for name, path, digest in (("run", job.run, job.store_sha256), *job.others):
        if read_manifest(path)["sha256"] != digest:
            raise ValueError(
                f"worker {socket.gethostname()} must see the {name} of the driver, got another at {path}"
            )
    model = None if job.model is None else _model_of(job, job.model)
    others = {name: open_run(path, job.max_memory) for name, path, _ in job.others}
    return LaneChain(
        open_run(job.run, job.max_memory),
        parse_recipe(job.recipe),
        Lane(*job.lane),
        model,
        known,
        job.section,
        others,
        _truth_of(job) if job.truth[0] else None,
        job.explains,
    )


def _model_of(job: LaneJob, folder: str) -> Model:
    if sha256(read_model(folder)) != job.model_sha256:
        raise ValueError(
            f"worker {socket.gethostname()} must see the model of the driver, got another at {folder}"
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
    """Report a piece of work that began when the clocks of wall and processor told ``begun``, and its bytes."""
    wall, processor_time = _now()
    return {
        "lane": lane,
        "stage": stage,
        "block": number,
        "seconds": wall - begun[0],
        "processor_seconds": (processor_time - begun[1])
        / mine.threads,  # of the process: each of its threads saw all
        "bytes": size,
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "worker": f"{socket.gethostname()}:{os.getpid()}",
        "cpu": processor(),
    }
