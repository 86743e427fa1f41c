"""Repeat experiments of the papers' size on other lanes: what holds in all together, and how often one would show it.

    python evidence/replicates.py DIR {wang2007,flsar2004} [--count N] [--minutes M]

DIR is the folder of `flgpr reproduce all -o DIR`. For Wang et al. 2007 a replicate is the calibration experiment, three
lanes with the paper's mines, of other seeds; their statements on blind lanes are not repeated. For flsar2004 it is the
whole study, on lanes of both sites of other seeds, with the study's mines. By default there are 20 and 12 of them.

Every finished replicate stays in DIR/PAPER/replicates as a list of findings, so that an interrupted run resumes.
Those in evidence/repeats/PAPER ran before and are taken as they are: each takes eight minutes of a processor, of
flsar2004 six to fourteen. With ``--minutes`` it begins no replicate after that time. The statements of all together,
``findings.json`` there, have the mean over the replicates with Student's interval, its verdict and power, and in how
many the number by itself shows what the paper says. ``python evidence/verdict_tables.py DIR`` takes them into the
tables.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from flgpr.progress import silent
from flgpr.recipe.schema import parse_recipe
from flgpr.store import write_whole
from flgpr_papers.flsar2004.examples import join
from flgpr_papers.flsar2004.experiment import JUDGED
from flgpr_papers.flsar2004.findings import prepare
from flgpr_papers.flsar2004.lanes import drive, load_settings
from flgpr_papers.kit.findings import (
    OPEN,
    Finding,
    finding_of,
    over_experiments,
    row_of,
    write_findings,
)
from flgpr_papers.kit.settings import packaged_text
from flgpr_papers.kit.study import one_blas_thread
from flgpr_papers.kit.study_worlds import OWN
from flgpr_papers.wang2007.findings import all_findings
from flgpr_papers.wang2007.lanes import calibration_scenes, sensor
from flgpr_papers.wang2007.study import lane_result

COUNTS = {"wang2007": 20, "flsar2004": 12}
"""Replicates of each paper."""
STORED = Path(__file__).with_name("repeats")
"""Replicates that ran before; their statements are those of the time when they ran."""
DRAWS = 100
"""Bootstrap draws within a replicate, whose own interval is not used."""
Replicate = Callable[[int], list[Finding]]
"""Runs the replicate of a number, and judges its statements."""


@one_blas_thread
def main(arguments: Sequence[str] | None = None) -> None:
    """Run the replicates that are not on disk, and write what all together say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("paper", choices=COUNTS)
    parser.add_argument("--count", type=int)
    parser.add_argument("--minutes", type=float, default=math.inf)
    given = parser.parse_args(arguments)
    folder = given.folder / given.paper / "replicates"
    folder.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + 60 * given.minutes
    count = given.count or COUNTS[given.paper]
    experiments = list(replicates(folder, given.paper, count, end))
    together = pooled(experiments)
    write_findings(folder, together, quick=False, world=OWN, replicates=len(experiments))
    print(
        f"{len(experiments)} of {count} replicates, {len(together)} statements: {folder / 'findings.json'}"
    )


def replicates(folder: Path, paper: str, count: int, end: float) -> Iterator[list[Finding]]:
    """Yield the findings of every replicate that is on disk or that can begin before an end of time, s."""
    run: Replicate | None = None
    for number in range(1, count + 1):
        path = folder / f"{number}.json"
        ran_before = STORED / paper / path.name
        if not path.is_file() and ran_before.is_file():
            shutil.copy(ran_before, path)
        if not path.is_file():
            if time.monotonic() > end:
                continue
            # What all replicates share is made when the first one needs it.
            run = run or EXPERIMENTS[paper](folder)
            write_whole(path, json.dumps([row_of(finding) for finding in run(number)]))
        yield [finding_of(row) for row in json.loads(path.read_text("utf-8"))]


def pooled(experiments: Sequence[Sequence[Finding]]) -> list[Finding]:
    """Return every statement by all experiments together that have a number for it."""
    by_statement: dict[tuple[str, str], list[Finding]] = {}
    for findings in experiments:
        for finding in findings:
            if finding.verdict != OPEN and finding.interval is not None:
                by_statement.setdefault((finding.claim, finding.quantity), []).append(finding)
    return [over_experiments(found) for found in by_statement.values()]


def calibration_experiment(folder: Path) -> Replicate:
    """Return what repeats the calibration lanes of Wang et al. 2007; a lane's data are deleted after its result."""
    text = packaged_text("wang2007")

    def run(number: int) -> list[Finding]:
        work = folder / f"lanes-{number}"
        lanes = [
            lane_result(work, scene, seed, sensor(), text, silent)
            for scene, seed in calibration_scenes(OWN, number).values()
        ]
        findings, _ = all_findings(lanes, [], parse_recipe(text), DRAWS)
        shutil.rmtree(work)
        return findings

    return run


def study_on_other_lanes(folder: Path) -> Replicate:
    """Return what repeats the study of flsar2004; a lane's images are deleted after its result."""
    settings = load_settings()

    def run(number: int) -> list[Finding]:
        other = settings.model_copy(update={"seed": settings.seed + 1000 * number})
        work = folder / f"lanes-{number}"
        sites = [join(other, drive(other, site, work)) for site in other.sites]
        material = prepare(other, sites)
        findings = [finding for part in JUDGED.values() for finding in part(material).findings]
        shutil.rmtree(work)
        return findings

    return run


EXPERIMENTS = {"wang2007": calibration_experiment, "flsar2004": study_on_other_lanes}
"""What makes the replicates of a paper."""


if __name__ == "__main__":
    main()
