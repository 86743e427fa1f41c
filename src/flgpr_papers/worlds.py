"""In which worlds each statement of the papers holds: every study on small lanes in all of them.

Declared before anything was run: the axes (``worlds.toml``), and how a statement is judged. Small lanes decide little
in a world of their own, so statements are judged in regions: the whole space and the half, third or quarter with one
value of an axis. Every world's lanes have seeds of their own, so that the mean over a region's worlds has Student's
interval; it is to hold in all regions and all parts of a claim together (Bonferroni), and gets the error of the paper's
figure where there is one. A statement holds somewhere if it agrees in at least one region, and nowhere if it disagrees
in all that decide.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Iterator
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

import flgpr
from flgpr.chain.progress import Track, silent
from flgpr.execution.executors import Executor
from flgpr.io import write_whole
from flgpr_papers.kit.cache import key_of
from flgpr_papers.kit.findings import row_of
from flgpr_papers.kit.worlds import World, worlds
from flgpr_papers.overview import PAPERS

TWO_SITES = "flsar2004"
"""The paper whose two sites are the two losses of a world: it is asked once for both."""


def studies() -> list[tuple[str, World]]:
    """Every paper in every world, in an order that covers the space evenly however far a run gets."""
    asked = [(paper, one) for one in worlds() for paper in PAPERS if paper != TWO_SITES or one.loss == "low"]
    return [asked[k] for k in np.random.default_rng(2004).permutation(len(asked))]


def path_of(folder: Path, paper: str, world: World) -> Path:
    """Give the file of a paper's statements in a world; another world of the same name or version has another."""
    return folder / "worlds" / f"{paper}-{world.name}-{key_of(asdict(world), flgpr.__version__)}.json"


def run_worlds(folder: Path, executor: Executor, track: Track = silent) -> None:
    """Run the studies that are not on disk."""
    left = [
        (paper, world.number, str(folder)) for paper, world in studies() if not path_of(folder, paper, world).is_file()
    ]
    for _ in track(executor.run(judge_in_world, left), "worlds", len(left)):
        pass


def judge_in_world(paper: str, number: int, folder: str) -> dict[str, Any]:
    """Judge the statements of a paper in a world and write them; lanes too small for a study are told as such."""
    world, before = worlds()[number], time.process_time()
    work, told = Path(folder) / "work" / f"{paper}-{number}", {"failed": ""}
    try:
        found = import_module(f"flgpr_papers.{paper}.world").findings_in(world, work)
    except ValueError as error:
        found, told = [], {"failed": str(error)}
    path, spent = path_of(Path(folder), paper, world), time.process_time() - before
    path.parent.mkdir(parents=True, exist_ok=True)
    record = {"world": asdict(world), **told, "seconds": spent, "findings": [row_of(one) for one in found]}
    write_whole(path, json.dumps(record))
    shutil.rmtree(work, ignore_errors=True)
    return {"paper": paper, "seconds": spent}


def read_worlds(folder: Path) -> Iterator[tuple[str, World, dict[str, Any]]]:
    """Read what is there: paper, world and its record."""
    for paper, world in studies():
        path = path_of(folder, paper, world)
        if path.is_file():
            yield paper, world, json.loads(path.read_text(encoding="utf-8"))
