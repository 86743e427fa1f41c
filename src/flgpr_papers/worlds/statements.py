"""In which worlds each statement of the papers holds.

Every quick study in the worlds of the designed fraction. Small lanes decide little in a world of
their own, so statements are judged in regions: the whole space and the half, third or quarter with
one level of an axis. Every world's lanes have seeds of their own, so that the mean over a region's
worlds has Student's interval; it is to hold in all regions and all parts of a claim together
(Bonferroni), and gets the error of the paper's figure where there is one. A statement holds
somewhere if it agrees in at least one region, and nowhere if it disagrees in all that decide.
Beside that stand regions with levels of two axes: a statement that agrees in one of these alone
holds in a corner. Their intervals hold in all regions of both kinds.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

import flgpr
from flgpr.chain.progress import Track, silent
from flgpr.execution.workers import Executor
from flgpr.store import write_whole
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
    larger,
    row_of,
)
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.worlds import AXES, World, worlds
from flgpr_papers.worlds.design import marginal_row, model_matrix
from flgpr_papers.worlds.effects import fit_means
from flgpr_papers.worlds.tables import write_rounded_table

TWO_SITES = "flsar2004"
"""Paper whose two sites are the two losses of a world: it is asked once for both."""
STUDY_AXES = {axis: levels for axis, levels in AXES.items() if axis != "mines"}
"""Axes that the studies' lanes have; their mines are their own."""
FEWEST = 5
"""Worlds that a region needs to be judged."""
MARKS = {AGREES: "✓", DISAGREES: "✗", UNDECIDED: "·"}
"""What stands for a verdict in a table; a region with fewer worlds has a dash."""
SOILS = (
    ("Dry sand (3, low loss) is better than gravel (4.5, model)", (3.0, "low"), (4.5, "mironov")),
    ("Dry sand (3, low loss) is better than wet clay (9, model)", (3.0, "low"), (9.0, "mironov")),
    ("Wet clay (9, model) is worse than gravel (4.5, model)", (4.5, "mironov"), (9.0, "mironov")),
)
"""Soils of cosgrove2004, the better first: permittivity and loss."""
_QUICK_NUMBER = 900  # added to a world's number in a quick run, which gives its lanes other seeds
Region = dict[str, Any]
Record = tuple[World, dict[str, Any]]


def studies(quick: bool = False) -> list[tuple[str, World]]:
    """List every paper in every world, in an order that covers the space evenly.

    It does however far a run gets.
    """
    every = worlds()
    if quick:
        first = next(world for world in every if world.loss == "low")
        return [(paper, replace(first, number=_QUICK_NUMBER + first.number)) for paper in PAPERS]
    asked = [
        (paper, world)
        for world in every
        for paper in PAPERS
        if paper != TWO_SITES or world.loss == "low"
    ]
    return [asked[index] for index in np.random.default_rng(2004).permutation(len(asked))]


def path_of(folder: Path, paper: str, world: World) -> Path:
    """Return the file of a paper's findings in a world.

    Another world, site or version has another.
    """
    key = key_of(asdict(world), world.tables(), flgpr.__version__)
    return folder / "statements" / f"{paper}-{world.name}-{key}.json"


def run(folder: Path, executor: Executor, quick: bool = False, track: Track = silent) -> None:
    """Run the studies that are not on disk and write the tables of all that are there.

    ``statements.csv`` has every statement in every region, ``statements-worlds.csv`` in every
    world, ``statements-PAPER.csv`` a paper's statements with a column per axis.
    """
    left = []
    for paper, world in studies(quick):
        if not path_of(folder, paper, world).is_file():
            left.append((paper, asdict(world), str(folder)))
    for _ in track(executor.run(judge_in_world, left), "statements", len(left)):
        pass
    # Of a study that was killed after its record was written nothing else takes its lanes away.
    shutil.rmtree(folder / "work", ignore_errors=True)
    write_tables(folder, quick)


def judge_in_world(paper: str, levels: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """Judge the statements of a paper in a world and write them.

    Lanes too small for a study are recorded as such.
    """
    world = World(**levels)
    begin = time.process_time()
    work = Path(folder) / "work" / f"{paper}-{world.number}"
    findings: list[Finding] = []
    failed = ""
    try:
        findings = import_module(f"flgpr_papers.{paper}.study").findings_in(world, work)
    except ValueError as error:
        failed = str(error)
    seconds = time.process_time() - begin
    path = path_of(Path(folder), paper, world)
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [row_of(finding) for finding in findings]
    write_whole(
        path,
        json.dumps(
            {"world": asdict(world), "failed": failed, "seconds": seconds, "findings": rows}
        ),
    )
    shutil.rmtree(work, ignore_errors=True)
    return {"paper": paper, "seconds": seconds}


def read_records(folder: Path, quick: bool = False) -> dict[str, list[Record]]:
    """Read what is on disk: worlds and their records, by paper."""
    records: dict[str, list[Record]] = {paper: [] for paper in PAPERS}
    for paper, world in sorted(studies(quick), key=lambda asked: asked[1].number):
        path = path_of(folder, paper, world)
        if path.is_file():
            records[paper].append((world, json.loads(path.read_text(encoding="utf-8"))))
    return records


@dataclass(frozen=True)
class Statement:
    """A statement of a paper in all worlds where it was judged."""

    claim: str  #: what the paper says, and of which number
    findings: list[tuple[World, Finding]]  #: what each world shows
    regions: dict[
        str, tuple[int, Interval, str]
    ]  #: worlds, mean with its interval, and verdict, by region
    corners: tuple[str, ...] = ()  #: regions of two levels in which it agrees

    @property
    def holds(self) -> str:
        """Where it holds.

        "everywhere" that it can be asked, "somewhere", "in a corner", "nowhere" or "undecided".
        """
        verdicts = {verdict for count, _, verdict in self.regions.values() if count >= FEWEST}
        if AGREES in verdicts:
            return "everywhere" if verdicts == {AGREES} else "somewhere"
        if self.corners:
            return "in a corner"
        return "nowhere" if DISAGREES in verdicts else "undecided"


def statements(records: Sequence[Record]) -> list[Statement]:
    """Judge the statements of a paper in every region."""
    by_claim: dict[str, list[tuple[World, Finding]]] = {}
    for world, record in records:
        for row in record["findings"]:
            finding = finding_of(row)
            if finding.asks is not None or finding.rule is not None:
                claim = (
                    f"{finding.claim} [{finding.quantity}]" if finding.quantity else finding.claim
                )
                by_claim.setdefault(claim, []).append((world, finding))
    varied = []
    for axis in STUDY_AXES:
        levels = {getattr(world, axis) for world, _ in records}
        if len(levels) > 1:
            varied.append(axis)
    single: list[Region] = [{axis: level} for axis in varied for level in AXES[axis]]
    double: list[Region] = [
        first_levels | other
        for first_levels, other in combinations(single, 2)
        if first_levels.keys() != other.keys()
    ]
    pooled_statements = []
    for claim, findings in by_claim.items():
        regions = {}
        for region in ({}, *single):
            regions[name_of(region)] = pooled(_inside(findings, region), 1 + len(single))
        corners = []
        for region in double:
            if pooled(_inside(findings, region), 1 + len(single) + len(double))[2] == AGREES:
                corners.append(name_of(region))
        pooled_statements.append(Statement(claim, findings, regions, tuple(corners)))
    return pooled_statements


def name_of(region: Region) -> str:
    """Return the name of a region: axes with their levels, or "all"."""
    return ", ".join(f"{axis} {level}" for axis, level in region.items()) or "all"


def _inside(findings: Sequence[tuple[World, Finding]], region: Region) -> list[Finding]:
    """Return the findings of the worlds of a region."""
    inside = []
    for world, finding in findings:
        if all(getattr(world, axis) == level for axis, level in region.items()):
            inside.append(finding)
    return inside


def pooled(findings: Sequence[Finding], regions: int) -> tuple[int, Interval, str]:
    """Judge the mean over a region's worlds by Student's interval.

    Their number, the least part, the verdict.
    """
    values = np.array([numbers(finding) for finding in findings], dtype=np.float64)
    values = values[np.isfinite(values).all(axis=1)] if values.size else values
    count = len(values)
    if count < FEWEST:
        return count, (np.nan, -np.inf, np.inf), UNDECIDED
    level = 1 - 0.025 / (regions * values.shape[1])
    mean = values.mean(axis=0)
    half = stdtrit(count - 1, level) * values.std(axis=0, ddof=1) / np.sqrt(count)
    intervals = [(float(m), float(m - h), float(m + h)) for m, h in zip(mean, half, strict=True)]
    asked = findings[0]
    if asked.asks is not None:  # the error of a paper's figure may be estimated in each world anew
        error = float(np.mean([finding.asks[2] for finding in findings if finding.asks]))
        asked = replace(asked, asks=(*asked.asks[:2], error))
    verdicts = [judge_again(asked, *interval) for interval in intervals]
    decisive = DISAGREES if DISAGREES in verdicts else UNDECIDED
    shown = (
        intervals[verdicts.index(decisive)]
        if decisive in verdicts
        else min(intervals, key=lambda interval: interval[1])
    )
    return count, shown, all_of(verdicts)


def soils_in_order(records: Sequence[Record]) -> list[Statement]:
    """Judge cosgrove2004's order of soils, which needs several worlds.

    Pd of two soils, the other axes in their middle. Pd of all worlds is fitted by the studies' axes
    and the interaction of permittivity and loss.
    """
    rows = []
    for world, record in records:
        for row in record["findings"]:
            if row["claim"].startswith("Pd of"):
                own_interval = finding_of(row).interval
                rows.append({**asdict(world), "pd": own_interval[0] if own_interval else np.nan})
    crossed = [("permittivity", "loss")]
    tests_of_order = []
    for claim, better, worse in SOILS:
        interval: Interval = (np.nan, -np.inf, np.inf)
        verdict = UNDECIDED
        try:
            table = pd.DataFrame(rows)
            fit = fit_means(model_matrix(table, STUDY_AXES, crossed), table["pd"])
            first = marginal_row(dict(zip(crossed[0], better, strict=True)), STUDY_AXES, crossed)
            second = marginal_row(dict(zip(crossed[0], worse, strict=True)), STUDY_AXES, crossed)
            interval = fit.difference(first, second)
            verdict = larger(*interval[1:])
        except (KeyError, ValueError):  # no worlds yet, or too few to tell the axes apart
            pass
        tests_of_order.append(Statement(claim, [], {"all": (len(rows), interval, verdict)}))
    return tests_of_order


def write_tables(folder: Path, quick: bool = False) -> None:
    """Write the tables of all that is on disk."""
    records = read_records(folder, quick)
    judged = {paper: statements(several) for paper, several in records.items()}
    judged["cosgrove2004"] += soils_in_order(records["cosgrove2004"])
    regions = []
    by_world = []
    for paper, several in judged.items():
        for statement in several:
            about = {"paper": paper, "statement": statement.claim}
            for region, (count, interval, verdict) in statement.regions.items():
                row = about | {"region": region, "worlds": count, "verdict": verdict}
                row |= dict(zip(("mean", "low", "high"), interval, strict=True))
                regions.append(
                    row | {"holds": statement.holds, "corners": "; ".join(statement.corners)}
                )
            for world, finding in statement.findings:
                levels = {axis: getattr(world, axis) for axis in STUDY_AXES}
                by_world.append(
                    about | levels | {"margin": margin(finding), "verdict": finding.verdict}
                )
        write_rounded_table(folder / f"statements-{paper}.csv", short_table(several))
    write_rounded_table(folder / "statements.csv", pd.DataFrame(regions))
    write_rounded_table(folder / "statements-worlds.csv", pd.DataFrame(by_world))
    counts = []
    for paper, several_records in records.items():
        failed = sum(bool(record["failed"]) for _, record in several_records)
        asked = sum(name == paper for name, _ in studies(quick))
        counts.append(
            {"paper": paper, "worlds": len(several_records), "asked": asked, "too_small": failed}
        )
    write_rounded_table(folder / "statements-counts.csv", pd.DataFrame(counts))


def short_table(several: Sequence[Statement]) -> pd.DataFrame:
    """Tabulate statements with a column per axis.

    A mark stands for each level in the declared order.
    """
    rows = []
    for statement in several:
        count, interval, _ = statement.regions["all"]
        mean, low, high = interval
        row = {"statement": statement.claim.split(" [")[0], "holds": statement.holds}
        row["mean over all, worlds"] = f"{mean:z.2f} ({low:z.2f} to {high:z.2f}), {count}"
        for axis, levels in STUDY_AXES.items():
            marks = []
            for level in levels:
                region = statement.regions.get(name_of({axis: level}))
                if region is not None:
                    marks.append(MARKS[region[2]] if region[0] >= FEWEST else "–")
            row[f"{axis}: {', '.join(f'{level}' for level in levels)}"] = " ".join(marks)
        rows.append(row)
    return pd.DataFrame(rows)


def numbers(finding: Finding) -> tuple[float, ...]:
    """Return the number of every part of a finding, or its only one."""
    return finding.parts or (np.nan if finding.interval is None else finding.interval[0],)


def margin(finding: Finding) -> float:
    """Return by how much the number of a finding keeps what is asked of it.

    Below zero it does not.
    """
    values = numbers(finding)
    if finding.rule is not None:
        low, high = finding.rule
        return min(min(value - low, high - value) for value in values)
    kind, limit, _ = finding.asks or ("", 0.0, 0.0)
    return min(value - limit if kind == "larger" else limit - abs(value) for value in values)
