"""In which worlds each statement of the papers holds.

Every quick study in the worlds of the designed fraction. Small lanes decide little in a world of
their own, so statements are judged in regions: the whole space and the half, third or quarter with
one level of an axis. Every world's lanes have seeds of their own, so that the mean over a region's
worlds has Student's interval; it is to hold in all regions and all parts of a claim together
(Bonferroni). A statement holds
somewhere if it agrees in at least one region, and nowhere if it disagrees in all that decide.
Beside that stand regions with levels of two axes: a statement that agrees in one of these alone
holds in a corner. Their intervals hold in all regions of both kinds.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtrit

import flgpr
from flgpr.door import refuse_links
from flgpr.jobs.workers import Executor
from flgpr.progress import Track, silent
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.findings import (
    AGREES,
    DISAGREES,
    OPEN,
    UNDECIDED,
    Finding,
    all_of,
    finding_of,
    judge,
    row_of,
)
from flgpr_papers.kit.intervals import Interval
from flgpr_papers.kit.settings import PAPERS
from worlds.design import marginal_row, model_matrix
from worlds.effects import fit_means
from worlds.space import AXES, World, worlds
from worlds.studies import FINDINGS_IN
from worlds.tables import write_rounded_table

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
Region = dict[str, Any]
Record = tuple[World, dict[str, Any]]


def studies() -> list[tuple[str, World]]:
    """Return every paper in every world, in an order that covers the space evenly.

    An interrupted run has judged the statements in worlds from all of the space.
    """
    pairs = []
    for world in worlds():
        for paper in PAPERS:
            if paper != TWO_SITES or world.loss == "low":
                pairs.append((paper, world))
    order = np.random.default_rng(2004).permutation(len(pairs))
    return [pairs[index] for index in order]


def path_of(folder: Path, paper: str, world: World) -> Path:
    """Return the file of a paper's findings in a world, with a key of world and version."""
    key = key_of(asdict(world), world.tables(), flgpr.__version__)
    return folder / "statements" / f"{paper}-{world.name}-{key}.json"


def run(folder: Path, executor: Executor, track: Track = silent) -> None:
    """Run the studies that are not on disk and write the tables of all that are there.

    ``statements.csv`` has every statement in every region, ``statements-worlds.csv`` in every
    world, ``statements-PAPER.csv`` a paper's statements with a column per axis.

    Parameters
    ----------
    folder : Path
        Folder of the map of worlds.
    executor : Executor
        Workers, each at a study in a world.
    track : Track
        Shows progress.
    """
    refuse_links(folder / "work")
    pending = []
    for paper, world in studies():
        if not path_of(folder, paper, world).is_file():
            pending.append((paper, asdict(world), str(folder)))
    for _ in track(executor.run(judge_in_world, pending), "statements", len(pending)):
        pass
    # Studies take their own lanes away: what is left is of earlier versions, or empty.
    shutil.rmtree(folder / "work", ignore_errors=True)
    write_tables(folder)


def judge_in_world(paper: str, levels: Mapping[str, Any], folder: str) -> None:
    """Judge the statements of a paper in a world, in a worker process, and write the record.

    Lanes too small for a study are recorded as such.

    Parameters
    ----------
    paper : str
        Name of the paper.
    levels : mapping
        Fields of a `worlds.space.World`.
    folder : str
        Folder of the map of worlds.
    """
    world = World(**levels)
    path = path_of(Path(folder), paper, world)
    read_or_make(path, partial(_record, paper, world, Path(folder) / "work"))


def _record(paper: str, world: World, folder: Path) -> dict[str, Any]:
    """Judge the statements of a paper in a world, whose lanes lie in a folder for that time."""
    begin = time.process_time()
    work = folder / f"{paper}-{world.number}"
    refuse_links(work.parent, work)
    findings: list[Finding] = []
    failed = ""
    try:
        findings = FINDINGS_IN[paper](world, work)
    except ValueError as error:
        failed = str(error)
    shutil.rmtree(work, ignore_errors=True)
    return {
        "world": asdict(world),
        "failed": failed,
        "seconds": time.process_time() - begin,
        "findings": [row_of(finding) for finding in findings],
    }


def read_records(folder: Path) -> dict[str, list[Record]]:
    """Read the worlds that are on disk with their records, by paper, in the order of the worlds."""
    records: dict[str, list[Record]] = {paper: [] for paper in PAPERS}
    for paper, world in sorted(studies(), key=lambda study: study[1].number):
        path = path_of(folder, paper, world)
        if path.is_file():
            records[paper].append((world, json.loads(path.read_text(encoding="utf-8"))))
    return records


@dataclass(frozen=True)
class Statement:
    """A statement of a paper in all worlds where it was judged."""

    claim: str  #: what the paper says, and of which number
    findings: list[tuple[World, Finding]]  #: what each world shows
    #: number of worlds, mean with its interval, and verdict, by region
    regions: dict[str, tuple[int, Interval, str]]
    corners: tuple[str, ...] = ()  #: regions of two levels in which it agrees

    @property
    def holds(self) -> str:
        """Where it holds: "everywhere", "somewhere", "in a corner", "nowhere" or "undecided".

        "everywhere" counts the regions in which it can be asked.
        """
        verdicts = {verdict for count, _, verdict in self.regions.values() if count >= FEWEST}
        if AGREES in verdicts:
            return "everywhere" if verdicts == {AGREES} else "somewhere"
        if self.corners:
            return "in a corner"
        return "nowhere" if DISAGREES in verdicts else "undecided"


def statements(records: Sequence[Record]) -> list[Statement]:
    """Judge the statements of a paper in every region.

    Parameters
    ----------
    records : sequence of Record
        Worlds and their records.
    """
    single = _single_regions(records)
    double = _double_regions(single)
    pooled_statements = []
    for claim, findings in _findings_by_claim(records).items():
        regions = {}
        for region in ({}, *single):
            # An interval holds together with those of all other regions.
            regions[name_of(region)] = pooled(_inside(findings, region), 1 + len(single))
        corners = []
        for region in double:
            count = 1 + len(single) + len(double)
            _, _, verdict = pooled(_inside(findings, region), count)
            if verdict == AGREES:
                corners.append(name_of(region))
        pooled_statements.append(Statement(claim, findings, regions, tuple(corners)))
    return pooled_statements


def _findings_by_claim(records: Sequence[Record]) -> dict[str, list[tuple[World, Finding]]]:
    """Return the findings that can be judged again, with their worlds, by claim and number."""
    by_claim: dict[str, list[tuple[World, Finding]]] = {}
    for world, record in records:
        for row in record["findings"]:
            finding = finding_of(row)
            if finding.rule is None:
                continue
            claim = finding.claim
            if finding.quantity:
                claim = f"{claim} [{finding.quantity}]"
            by_claim.setdefault(claim, []).append((world, finding))
    return by_claim


def _single_regions(records: Sequence[Record]) -> list[Region]:
    """Return the regions of one level, of all axes that the worlds vary."""
    regions: list[Region] = []
    for axis in STUDY_AXES:
        levels = {getattr(world, axis) for world, _ in records}
        if len(levels) > 1:
            regions += [{axis: level} for level in AXES[axis]]
    return regions


def _double_regions(single: Sequence[Region]) -> list[Region]:
    """Return the regions of two levels, of different axes."""
    regions: list[Region] = []
    for first, second in combinations(single, 2):
        if first.keys() != second.keys():
            regions.append(first | second)
    return regions


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

    Parameters
    ----------
    findings : sequence of Finding
        The finding of a statement in every world of the region.
    regions : int
        Number of regions, whose intervals are to hold all together.

    Returns
    -------
    count : int
        Number of worlds.
    interval : Interval
        Mean and interval of the part that decides.
    verdict : str
        "cannot say" for fewer worlds than ``FEWEST``.
    """
    values = np.array([numbers(finding) for finding in findings], dtype=np.float64)
    if values.size:
        values = values[np.isfinite(values).all(axis=1)]
    count = len(values)
    if count < FEWEST:
        return count, (np.nan, -np.inf, np.inf), UNDECIDED
    level = 1 - 0.025 / (regions * values.shape[1])
    means = values.mean(axis=0)
    halves = stdtrit(count - 1, level) * values.std(axis=0, ddof=1) / np.sqrt(count)
    intervals = []
    for mean, half in zip(means, halves, strict=True):
        intervals.append((float(mean), float(mean - half), float(mean + half)))
    asked = findings[0]
    verdicts = [judge_again(asked, interval) for interval in intervals]
    return count, _deciding_interval(intervals, verdicts), all_of(verdicts)


def judge_again(finding: Finding, interval: Interval) -> str:
    """Return the verdict on another number by what the claim of a finding asks.

    Parameters
    ----------
    finding : Finding
        A statement, judged on some lanes.
    interval : Interval
        The same number on other lanes, with its interval.
    """
    if finding.rule is None:
        return OPEN
    return judge(interval, finding.rule, finding.worth, finding.figure)


def _deciding_interval(intervals: Sequence[Interval], verdicts: Sequence[str]) -> Interval:
    """Return the interval of the part that decides: one that disagrees, or else is undecided.

    If all agree, it is the lowest.
    """
    for verdict in (DISAGREES, UNDECIDED):
        if verdict in verdicts:
            return intervals[verdicts.index(verdict)]
    return min(intervals, key=lambda interval: interval[1])


def soils_in_order(records: Sequence[Record]) -> list[Statement]:
    """Judge cosgrove2004's order of soils, which needs several worlds.

    Pd of two soils is compared, the other axes in their middle. Pd of all worlds is fitted by the
    studies' axes and the interaction of permittivity and loss.

    Parameters
    ----------
    records : sequence of Record
        Worlds and their records of cosgrove2004.
    """
    rows = []
    for world, record in records:
        for row in record["findings"]:
            if row["claim"].startswith("Pd of"):
                pd_interval = finding_of(row).interval
                pd_of_world = pd_interval[0] if pd_interval else np.nan
                rows.append({**asdict(world), "pd": pd_of_world})
    table = pd.DataFrame(rows)
    soil_statements = []
    for claim, better, worse in SOILS:
        interval: Interval = (np.nan, -np.inf, np.inf)
        verdict = UNDECIDED
        try:
            interval = _soil_difference(table, better, worse)
            verdict = judge(interval, (0.0, np.inf))
        except (KeyError, ValueError):  # no worlds yet, or too few to tell the axes apart
            pass
        regions = {"all": (len(rows), interval, verdict)}
        soil_statements.append(Statement(claim, [], regions))
    return soil_statements


def _soil_difference(
    table: pd.DataFrame, better: tuple[float, str], worse: tuple[float, str]
) -> Interval:
    """Return the fitted Pd of a soil less that of another, permittivity and loss of each."""
    soil_axes = ("permittivity", "loss")
    fit = fit_means(model_matrix(table, STUDY_AXES, [soil_axes]), table["pd"])
    first = marginal_row(dict(zip(soil_axes, better, strict=True)), STUDY_AXES, [soil_axes])
    second = marginal_row(dict(zip(soil_axes, worse, strict=True)), STUDY_AXES, [soil_axes])
    return fit.difference(first, second)


def write_tables(folder: Path) -> None:
    """Write the tables of all records that are on disk."""
    records = read_records(folder)
    judged = {paper: statements(of_paper) for paper, of_paper in records.items()}
    judged["cosgrove2004"] += soils_in_order(records["cosgrove2004"])
    region_rows: list[dict[str, Any]] = []
    world_rows: list[dict[str, Any]] = []
    for paper, of_paper in judged.items():
        for statement in of_paper:
            about = {"paper": paper, "statement": statement.claim}
            region_rows += [about | row for row in _region_rows(statement)]
            world_rows += [about | row for row in _world_rows(statement)]
        write_rounded_table(folder / f"statements-{paper}.csv", short_table(of_paper))
    write_rounded_table(folder / "statements.csv", pd.DataFrame(region_rows))
    write_rounded_table(folder / "statements-worlds.csv", pd.DataFrame(world_rows))
    papers_asked = [paper for paper, _ in studies()]
    counts = []
    for paper, records_of_paper in records.items():
        too_small = sum(bool(record["failed"]) for _, record in records_of_paper)
        counts.append(
            {
                "paper": paper,
                "worlds": len(records_of_paper),
                "asked": papers_asked.count(paper),
                "too_small": too_small,
            }
        )
    write_rounded_table(folder / "statements-counts.csv", pd.DataFrame(counts))


def _region_rows(statement: Statement) -> list[dict[str, Any]]:
    """Return the rows of ``statements.csv`` of a statement, one per region."""
    rows = []
    for region, (count, interval, verdict) in statement.regions.items():
        mean, low, high = interval
        rows.append(
            {
                "region": region,
                "worlds": count,
                "verdict": verdict,
                "mean": mean,
                "low": low,
                "high": high,
                "holds": statement.holds,
                "corners": "; ".join(statement.corners),
            }
        )
    return rows


def _world_rows(statement: Statement) -> list[dict[str, Any]]:
    """Return the rows of ``statements-worlds.csv`` of a statement, one per world."""
    rows = []
    for world, finding in statement.findings:
        row = {axis: getattr(world, axis) for axis in STUDY_AXES}
        rows.append(row | {"margin": margin(finding), "verdict": finding.verdict})
    return rows


def short_table(several: Sequence[Statement]) -> pd.DataFrame:
    """Tabulate statements with a column per axis: a mark for each level, in the declared order.

    Parameters
    ----------
    several : sequence of Statement
        Statements of a paper.
    """
    rows = []
    for statement in several:
        count, interval, _ = statement.regions["all"]
        mean, low, high = interval
        row = {
            "statement": statement.claim.split(" [")[0],
            "holds": statement.holds,
            "mean over all, worlds": f"{mean:z.2f} ({low:z.2f} to {high:z.2f}), {count}",
        }
        for axis, levels in STUDY_AXES.items():
            title = f"{axis}: {', '.join(str(level) for level in levels)}"
            row[title] = _marks(statement, axis)
        rows.append(row)
    return pd.DataFrame(rows)


def _marks(statement: Statement, axis: str) -> str:
    """Return the marks of a statement at the levels of an axis, a dash for too few worlds."""
    marks = []
    for level in STUDY_AXES[axis]:
        region = statement.regions.get(name_of({axis: level}))
        if region is not None:
            count, _, verdict = region
            marks.append(MARKS[verdict] if count >= FEWEST else "–")
    return " ".join(marks)


def numbers(finding: Finding) -> tuple[float, ...]:
    """Return the number of every part of a finding, or its only one; NaN without one."""
    if finding.parts:
        return finding.parts
    if finding.interval is None:
        return (np.nan,)
    return (finding.interval[0],)


def margin(finding: Finding) -> float:
    """Return by how much the number of a finding keeps what is asked of it; below 0 it does not."""
    low, high = finding.rule or (-np.inf, np.inf)
    return min(min(value - low, high - value) for value in numbers(finding))
