"""In which worlds each statement of the papers holds: every study on small lanes in all of them.

Declared before anything was run: the axes (``worlds.toml``), and how a statement is judged. Small lanes decide little
in a world of their own, so statements are judged in regions: the whole space and the half, third or quarter with one
value of an axis. Every world's lanes have seeds of their own, so that the mean over a region's worlds has Student's
interval; it is to hold in all regions and all parts of a claim together (Bonferroni), and gets the error of the paper's
figure where there is one. A statement holds somewhere if it agrees in at least one region, and nowhere if it disagrees
in all that decide. Beside that, after the first worlds had been looked at, regions with two values of two axes: a
statement that agrees in one of these alone holds in a corner. Their intervals hold in all regions of both kinds.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from itertools import combinations, pairwise
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.special import stdtrit

import flgpr
from flgpr.chain.progress import Track, silent
from flgpr.execution.executors import Executor
from flgpr.execution.survey import PLAINLY, How
from flgpr.io import write_whole
from flgpr.report import figure_png
from flgpr_papers.kit.cache import key_of
from flgpr_papers.kit.findings import (
    AGREES,
    DISAGREES,
    UNDECIDED,
    Finding,
    Interval,
    all_of,
    finding_of,
    judge_again,
    row_of,
)
from flgpr_papers.kit.page import study_html
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.worlds import AXES, World, smooth_worlds, worlds

TWO_SITES = "flsar2004"  # its two sites are the two losses of a world: it is asked once for both
FEWEST = 5  # worlds that a region needs to be judged
SOILS = (
    ("Dry sand (3, low loss) is better than gravel (4, model)", (3.0, "low"), (4.0, "mironov")),
    ("Dry sand (3, low loss) is better than wet clay (9, model)", (3.0, "low"), (9.0, "mironov")),
    ("Wet clay (9, model) is worse than gravel (4, model)", (4.0, "mironov"), (9.0, "mironov")),
)
"""Soils of cosgrove2004, the better first: permittivity and loss."""


def map_worlds(output: str | Path, how: How = PLAINLY) -> Path:
    """Judge every statement of every paper in every declared world and write the map; what was stopped goes on.

    Parameters
    ----------
    output : str or Path
        Folder to work in: ``index.html``, ``worlds.csv`` and a heat map per paper. A cluster's workers see it under
        the same path.
    how : How
        Who works, each at a study in a world, and who is shown progress.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ValueError
        If workers and a scheduler are asked for, or there is no scheduler at the address.
    """
    folder = Path(output).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    with how.executor() as executor:
        run_worlds(folder, executor, how.track)
    return write_map(folder)


def studies() -> list[tuple[str, World]]:
    """List every paper in every world, in an order that covers the space evenly however far a run gets."""
    asked = [(paper, one) for one in worlds() for paper in PAPERS if paper != TWO_SITES or one.loss == "low"]
    beside = [(paper, one) for one in smooth_worlds() for paper in PAPERS]
    return [asked[k] for k in np.random.default_rng(2004).permutation(len(asked))] + beside


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
    world, before = [*worlds(), *smooth_worlds()][number], time.process_time()
    work, found, failed = Path(folder) / "work" / f"{paper}-{number}", [], ""
    try:
        found = import_module(f"flgpr_papers.{paper}.study").findings_in(world, work)
    except ValueError as error:
        failed = str(error)
    path, spent = path_of(Path(folder), paper, world), time.process_time() - before
    path.parent.mkdir(parents=True, exist_ok=True)
    record = {"world": asdict(world), "failed": failed, "seconds": spent, "findings": [row_of(one) for one in found]}
    write_whole(path, json.dumps(record))
    shutil.rmtree(work, ignore_errors=True)
    return {"paper": paper, "seconds": spent}


def read_worlds(folder: Path) -> dict[str, list[tuple[World, dict[str, Any]]]]:
    """Read what is there: worlds and their records, by paper."""
    found: dict[str, list[tuple[World, dict[str, Any]]]] = {paper: [] for paper in PAPERS}
    for paper, world in sorted(studies(), key=lambda one: one[1].number):
        path = path_of(folder, paper, world)
        if path.is_file():
            found[paper].append((world, json.loads(path.read_text(encoding="utf-8"))))
    return found


@dataclass(frozen=True)
class Statement:
    """A statement of a paper in all worlds where it was judged."""

    claim: str  #: what the paper says, and of which number
    found: list[tuple[World, Finding]]  #: what each world shows
    regions: dict[str, tuple[int, Interval, str]]  #: worlds, mean with its interval, and verdict, by region
    smooth: tuple[int, Interval, str] = (0, (np.nan, -np.inf, np.inf), UNDECIDED)  #: the same on smooth roads
    corners: tuple[str, ...] = ()  #: regions of two values in which it agrees

    @property
    def holds(self) -> str:
        """Where it holds: "everywhere" that it can be asked, "somewhere", "in a corner", "nowhere" or "undecided"."""
        verdicts = {verdict for count, _, verdict in self.regions.values() if count >= FEWEST}
        if AGREES in verdicts:
            return "everywhere" if verdicts == {AGREES} else "somewhere"
        if self.corners:
            return "in a corner"
        return "nowhere" if DISAGREES in verdicts else "undecided"


def statements(records: Sequence[tuple[World, dict[str, Any]]]) -> list[Statement]:
    """Judge the statements of a paper in every region."""
    found: dict[str, list[tuple[World, Finding]]] = {}
    for world, record in records:
        for one in map(finding_of, record["findings"]):
            if one.asks is not None or one.rule is not None:
                found.setdefault(one.claim + f" [{one.quantity}]" * bool(one.quantity), []).append((world, one))
    beside = {world.number for world in smooth_worlds()}
    of_map = [world for world, _ in records if world.number not in beside]
    several = [axis for axis in AXES if len({getattr(world, axis) for world in of_map}) > 1]
    values = [{axis: value} for axis in several for value in AXES[axis]]
    pairs = [one | other for one, other in combinations(values, 2) if one.keys() != other.keys()]
    made = []
    for claim, every in found.items():
        here = [(world, one) for world, one in every if world.number not in beside]

        def judged(region: dict[str, Any], count: int, here: Any = here) -> tuple[int, Interval, str]:
            inside = [one for world, one in here if all(getattr(world, axis) == v for axis, v in region.items())]
            return pooled(inside, count)

        regions = {_named(region): judged(region, 1 + len(values)) for region in ({}, *values)}
        corners = [_named(one) for one in pairs if judged(one, 1 + len(values) + len(pairs))[2] == AGREES]
        smooth = pooled([one for world, one in every if world.number in beside], 1)
        made.append(Statement(claim, here, regions, smooth, tuple(corners)))
    return made


def _named(region: dict[str, Any]) -> str:
    return ", ".join(f"{axis} {value}" for axis, value in region.items()) or "all"


def pooled(found: Sequence[Finding], regions: int) -> tuple[int, Interval, str]:
    """Judge the mean over a region's worlds by Student's interval: their number, the least part, the verdict."""
    values = np.array([numbers(one) for one in found], dtype=np.float64)
    values = values[np.isfinite(values).all(axis=1)] if values.size else values
    count = len(values)
    if count < FEWEST:
        return count, (np.nan, -np.inf, np.inf), UNDECIDED
    level = 1 - 0.025 / (regions * values.shape[1])
    half = stdtrit(count - 1, level) * values.std(axis=0, ddof=1) / np.sqrt(count)
    parts = [(float(m), float(m - h), float(m + h)) for m, h in zip(values.mean(axis=0), half, strict=True)]
    asked = found[0]
    if asked.asks is not None:  # the error of a paper's figure may be estimated in each world anew
        asked = replace(asked, asks=(*asked.asks[:2], float(np.mean([one.asks[2] for one in found if one.asks]))))
    verdicts = [judge_again(asked, *part) for part in parts]
    told = DISAGREES if DISAGREES in verdicts else UNDECIDED
    shown = parts[verdicts.index(told)] if told in verdicts else min(parts, key=lambda one: one[1])
    return count, shown, all_of(verdicts)


def soils_in_order(records: Sequence[tuple[World, dict[str, Any]]]) -> list[Statement]:
    """Judge cosgrove2004's order of soils, which needs several worlds: differences where all but the soil is alike."""
    pd = {
        (w.permittivity, w.loss, w.roughness, w.roadside): finding_of(row).interval
        for w, record in records
        for row in record["findings"]
        if row["claim"].startswith("Pd of")
    }
    made = []
    for claim, better, worse in SOILS:
        found = []
        for world, _ in records:
            place = world.roughness, world.roadside
            a, b = pd.get((*better, *place)), pd.get((*worse, *place))
            if (world.permittivity, world.loss) == better and a and b:
                gap = (a[0] - b[0], -np.inf, np.inf)
                found.append((world, Finding(claim, "", "", UNDECIDED, interval=gap, asks=("larger", 0.0, 0.0))))
        made.append(Statement(claim, found, {"all": pooled([one for _, one in found], 1)}))
    return made


def write_map(folder: Path) -> Path:
    """Write what is there: ``worlds.csv``, a heat map per paper and the page, ``index.html``."""
    records = read_worlds(folder)
    judged = {paper: statements(found) for paper, found in records.items()}
    judged["cosgrove2004"] += soils_in_order(records["cosgrove2004"])
    rows = [
        {"paper": paper, "statement": one.claim, "region": region, "worlds": count, "mean": value[0], "low": value[1]}
        | {"high": value[2], "verdict": verdict, "holds": one.holds, "corners": "; ".join(one.corners)}
        for paper, several in judged.items()
        for one in several
        for region, (count, value, verdict) in [*one.regions.items(), ("smooth", one.smooth)]
    ]
    write_whole(folder / "worlds.csv", pd.DataFrame(rows).round(4).to_csv(index=False))
    shown = [paper for paper, several in judged.items() if any(one.found for one in several)]
    pictures = {paper: figure_png(heat_maps(several)) for paper, several in judged.items() if paper in shown}
    for paper, picture in pictures.items():
        write_whole(folder / f"{paper}.png", picture)
    html = study_html(
        "worlds.html",
        judged=judged,
        pictures=pictures,
        papers=PAPERS,
        axes=AXES,
        counts={paper: (len(found), sum(bool(one["failed"]) for _, one in found)) for paper, found in records.items()},
        asked={paper: sum(name == paper for name, _ in studies()) for paper in PAPERS},
        two_sites=TWO_SITES,
        marks={AGREES: "+", DISAGREES: "−", UNDECIDED: "·"},
    )
    write_whole(folder / "index.html", html)
    return folder / "index.html"


def numbers(one: Finding) -> tuple[float, ...]:
    """Give the number of every part of a finding, or its only one."""
    return one.parts or (np.nan if one.interval is None else one.interval[0],)


def margin(one: Finding) -> float:
    """Tell by how much the number of a finding keeps what is asked of it; below zero it does not."""
    values = numbers(one)
    if one.rule is not None:
        return min(min(value - one.rule[0], one.rule[1] - value) for value in values)
    kind, limit, _ = one.asks or ("", 0.0, 0.0)
    return min(value - limit if kind == "larger" else limit - abs(value) for value in values)


def heat_maps(several: Sequence[Statement]) -> Figure:
    """Draw every statement over the space: how far each world is on its side of the limit; verdicts are marked."""
    columns = 3
    rows = -(-len(several) // columns)
    figure = Figure(figsize=(3.3 * columns, 1.75 * rows + 0.6), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False)
    order = "roadside", "loss", "roughness"
    losses = {w.loss for one in several for w, _ in one.found}
    down = AXES["permittivity"]
    across = sorted(
        {replace(w, number=0, permittivity=0) for w in worlds() if w.loss in losses},
        key=lambda w: [AXES[axis].index(getattr(w, axis)) for axis in order],
    )
    for axes, one in zip(grid.flat, several, strict=False):
        value = np.full((len(down), len(across)), np.nan)
        for world, found in one.found:
            at = down.index(world.permittivity), across.index(replace(world, number=0, permittivity=0))
            value[at] = margin(found)
            if found.verdict in (AGREES, DISAGREES):
                axes.text(at[1], at[0], "+" if found.verdict == AGREES else "−", ha="center", va="center", fontsize=6)
        known = np.abs(value[np.isfinite(value)])
        top = float(np.quantile(known, 0.9)) if known.size and known.any() else 1.0
        axes.imshow(value, cmap="RdBu", vmin=-top, vmax=top, aspect="auto")
        axes.set_facecolor("0.85")
        axes.set_title(fill(one.claim.split(" [")[0], 48) + f"\n{one.holds}", fontsize=7.5)
        axes.set_yticks(range(len(down)), [f"{value:g}" for value in down], fontsize=6)
        axes.set_xticks([])
        for k, (a, b) in enumerate(pairwise(across)):
            axes.axvline(k + 0.5, color="k", lw=1.0 if a.roadside != b.roadside else 0.4 * (a.loss != b.loss))
    for axes in list(grid.flat)[len(several) :]:
        axes.set_visible(False)
    figure.supxlabel(
        f"{', '.join(AXES['roadside'])}; in each low loss before that of the model; in each 3, 6, 10 mm rms", fontsize=8
    )
    figure.supylabel("permittivity", fontsize=8)
    return figure
