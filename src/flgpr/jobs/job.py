"""A job: a detection on one lane as plain values, which can be sent anywhere.

Its lane is opened in ``jobs/pieces.py``, its work folder in ``jobs/checkpoint.py``.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import llvmlite.binding

import flgpr
from flgpr.door import read_named, refuse_links
from flgpr.engine import BLOCK
from flgpr.geo.anchor import check_same_place
from flgpr.health.judging import HEALTHY, Health, LeftOut
from flgpr.health.of_run import health_of_run, without
from flgpr.jobs.workers import DEFAULTS, RunOptions
from flgpr.method.model import parse_model, read_model
from flgpr.method.sections import Section
from flgpr.method.unlike import Trust
from flgpr.model import Lane
from flgpr.recipe.fit import area_of
from flgpr.recipe.schema import Recipe, parse_recipe
from flgpr.stages.earlier import is_before
from flgpr.store import (
    MAX_MEMORY,
    open_run,
    read_lane,
    read_manifest,
    sha256,
)
from flgpr.store.lane_file import lane_file_of
from flgpr.types import PathLike

WORK_SUFFIX = ".work"
"""Ending of the work folder beside an output."""
USUAL = Trust()
"""What is asked of a detection where a user asks for nothing else."""
_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pandas")


@dataclass(frozen=True)
class LaneJob:
    """A detection as plain values, so that it can be sent anywhere."""

    run: str  #: run store
    recipe: str  #: its text
    lane: tuple[float, float, float, float]  #: x_min, x_max, y_min, y_max, m
    model: str | None  #: folder of a trained model; None without one
    output: str  #: result folder to make
    report: bool  #: whether to write ``report.html``
    store_sha256: str  #: digest of the run's manifest
    model_sha256: str  #: that of the model, "" without one
    code: tuple[tuple[str, str], ...]  #: versions of the program and of the libraries
    cpu: str  #: processor of the machine that drives
    max_memory: int = MAX_MEMORY  #: bytes that reading the run may take
    section: Section | None = None  #: rows of the lane that are worked on; None takes all
    shared: str = ""  #: the work folder with what all sections share; "" of a lane in one piece
    #: name, store and digest of every run taken together with it
    others: tuple[tuple[str, str, str], ...] = ()
    truth: tuple[str, str] = ("", "")  #: file and digest of a training lane's targets
    explains: bool = True  #: whether what explains alarms is gathered
    lane_source: str = ""  #: where the lane's borders come from; "" is the recipe or the run
    #: folder of passes that jobs of other recipes share (``jobs/checkpoint.py``); "" for none
    pass_cache: str = ""
    trust: Trust = USUAL  #: what is asked of the detection about how far it can be trusted
    #: what is wrong with the runs and what of the first is left out; by default nothing
    health: Health = HEALTHY
    #: what is left out of every run taken together with it; () for nothing
    left_out_of_others: tuple[LeftOut, ...] = ()

    @property
    def left_out(self) -> LeftOut:
        """Pairs and tones of the run that are left out."""
        return self.health.left_out

    @property
    def folder(self) -> Path:
        """The result folder to make."""
        return Path(self.output)

    @property
    def name(self) -> str:
        """Name of the lane where work is reported: that of its result folder."""
        return self.folder.name

    @property
    def work(self) -> Path:
        """The work folder beside the result folder."""
        return self.folder.with_name(self.name + WORK_SUFFIX)

    @property
    def largest(self) -> int:
        """Bytes that a file of the work folder may have.

        What a process wrote there it held in memory.
        """
        return max(self.max_memory, MAX_MEMORY)

    @property
    def identity(self) -> dict[str, Any]:
        """All that the bits of the result depend on, as JSON holds it.

        Of the program it is the version, not the sources: after an edit of the arithmetic, delete
        OUTPUT.work and the cache of passes. The threshold of a section is no part of it, as it
        follows from the rest.
        """
        rows = None if self.section is None else [self.section.start, self.section.stop]
        entries: dict[str, Any] = {
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
            "unlike": self.trust.unlike,
            "far": self.trust.far,
        }
        if self.left_out:
            entries["left_out"] = [list(self.left_out.pairs), list(self.left_out.tones)]
        if any(self.left_out_of_others):
            entries["left_out_of_others"] = [one.as_json() for one in self.left_out_of_others]
        return entries

    @property
    def lasting_identity(self) -> dict[str, Any]:
        """What a result must have been made of to stand for the job.

        Neither the versions of the program nor the machine are part of it.
        """
        identity = self.identity
        names = ("run", "recipe", "lane", "model", "others", "left_out", "left_out_of_others")
        lasting = {name: identity[name] for name in names if name in identity}
        if self.trust.unlike != "fallback":
            lasting["unlike"] = self.trust.unlike
        if self.trust.far is not None:
            lasting["far"] = self.trust.far
        return lasting


def choose_lane(
    run: PathLike, given: PathLike | Lane | None, recipe: Recipe
) -> tuple[Lane | None, str]:
    """Return the lane that a run is searched in, and where its borders come from.

    A lane that is given comes first, then the recipe's, then ``NAME-lane.toml`` beside the run.
    Without any the lane is None and its source "": the ground that the run sees is searched.

    Parameters
    ----------
    run : path
        Run store.
    given : path or Lane, optional
        Lane that is given, or its file.
    recipe : Recipe
        Recipe whose lane comes before that beside the run.

    Raises
    ------
    ValueError
        If a file is no lane; the error names it.
    """
    if isinstance(given, Lane):
        return given, "as given"
    if given is not None:
        return read_lane(given), f"{Path(given).name}, as given"
    if recipe.lane is not None:
        return None, ""
    beside = lane_file_of(run)
    if beside.is_file():
        return read_lane(beside), f"{beside.name} beside the run"
    return None, ""


def make_job(
    run: PathLike,
    recipe: str,
    lane: PathLike | Lane | None,
    output: PathLike,
    report: bool = True,
    model: PathLike | None = None,
    others: Mapping[str, PathLike] | None = None,
    truth: PathLike | None = None,
    options: RunOptions = DEFAULTS,
    trust: Trust = USUAL,
) -> LaneJob:
    """Check that a recipe fits a stored run, and describe the detection as plain values.

    Parameters
    ----------
    run : str or path
        Run store.
    recipe : str
        TOML text of the recipe.
    lane : str, path or Lane or None
        The lane's borders, or their file; without them that of :func:`choose_lane`, else the ground
        that the run sees is searched.
    output : str or path
        Result folder to make.
    report : bool
        Whether to write ``report.html``.
    model : str or path, optional
        Folder of a trained model.
    others : mapping of str to path, optional
        Runs taken together with it, by the names that the recipe gives them.
    truth : str or path, optional
        File of a training lane's targets.
    options : RunOptions
        Memory of a process, and the folder of passes that jobs of other recipes share.
    trust : Trust
        What is asked of the detection about how far it can be trusted.

    Returns
    -------
    LaneJob
        The job.

    Raises
    ------
    ValueError
        If the recipe does not fit the run, or a run, the lane or the model is not valid; or a run
        that is taken together with it lies elsewhere on the Earth.
    """
    parsed = parse_recipe(recipe)
    borders, lane_source = choose_lane(run, lane, parsed)
    stored = open_run(run, options.max_memory)
    health = health_of_run(stored, borders or (None if parsed.lane is None else parsed.lane.lane()))
    other_runs = []
    left_out_of_others: list[LeftOut] = []
    of_before = []  # numbers of earlier drives of the same tones
    for name, path in (others or {}).items():
        other_runs.append((name, absolute(path), read_manifest(path)["sha256"]))
        other = open_run(path, options.max_memory)
        check_same_place(stored.attrs.get("georeference"), other.attrs.get("georeference"), path)
        judged = health_of_run(other)
        if is_before(name) and other["frequency"].equals(stored["frequency"]):
            of_before.append(len(left_out_of_others))
        findings = tuple(one.of_run(name) for one in judged.findings)
        health = replace(health, findings=health.findings + findings)
        left_out_of_others.append(judged.left_out)
    # Earlier drives predict images by the same tones: what is faulty in one is left out of all.
    faulty = set(health.left_out.tones)
    for number in of_before:
        faulty |= set(left_out_of_others[number].tones)
    tones = tuple(sorted(faulty))
    health = replace(health, left_out=replace(health.left_out, tones=tones))
    for number in of_before:
        left_out_of_others[number] = replace(left_out_of_others[number], tones=tones)
    area = area_of(without(stored, health.left_out), parsed, borders)
    truth_and_digest = ("", "")
    if truth is not None:
        truth_and_digest = (absolute(truth), sha256(read_named(truth)))
    refuse_links(Path(output))  # before it is followed to where it leads
    return LaneJob(
        run=absolute(run),
        recipe=recipe,
        lane=astuple(area),
        model=None if model is None else absolute(model),
        output=absolute(output),
        report=report,
        store_sha256=read_manifest(run)["sha256"],
        model_sha256="" if model is None else model_digest(model),
        code=code_versions(),
        cpu=processor(),
        max_memory=options.max_memory,
        others=tuple(other_runs),
        truth=truth_and_digest,
        lane_source=lane_source,
        pass_cache="" if options.pass_cache is None else absolute(options.pass_cache),
        trust=trust,
        health=health,
        left_out_of_others=tuple(left_out_of_others) if any(left_out_of_others) else (),
    )


def absolute(path: PathLike) -> str:
    """Return a path that means the same in every process."""
    return str(Path(path).resolve())


def model_digest(model: PathLike) -> str:
    """Return the SHA-256 of a model's file; a ValueError if the model is not valid."""
    data = read_model(model)
    parse_model(data, model)
    return sha256(data)


@lru_cache
def code_versions() -> tuple[tuple[str, str], ...]:
    """Return the versions of what computes: equal ones give equal bits on equal processors."""
    versions = [("flgpr", flgpr.__version__), ("python", platform.python_version())]
    for name in _LIBRARIES:
        versions.append((name, version(name)))
    return tuple(versions)


@lru_cache
def processor() -> str:
    """Return the name of the processor, as the compiler sees it."""
    return f"{platform.machine()} {llvmlite.binding.get_host_cpu_name()}"
