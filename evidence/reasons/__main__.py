"""Why statements of the papers do not hold on simulated lanes: run the experiments and write their tables.

``python evidence/reasons DIR [--paper wang2007] [--world as-found] [--quick]`` works in the folder of
``flgpr reproduce all -o DIR``, whose lanes it uses; lanes and verdicts of the studies stay as they
are. Every paper's folder gets ``reasons.csv``, and DIR the table of all of them, ``reasons.csv`` or
``reasons-as-found.csv``. Finished measurements stay on disk, so that an interrupted run resumes. On
roads as found there is one more experiment: whether a statement that disagrees there agrees on
prepared lanes, where the study has run on both. ``--quick`` takes the lanes of the quick studies.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from flgpr.commands.bars import Bars
from flgpr.store import write_whole
from flgpr_papers.kit.findings import read_findings
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.study import one_blas_thread
from flgpr_papers.kit.study_worlds import AS_FOUND, OWN, world_folder
from reasons.trials import Trial, road_trials, trials_csv


@one_blas_thread
def main(arguments: list[str] | None = None) -> None:
    """Run the experiments of the papers asked for and write their tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--paper", choices=PAPERS, action="append")
    parser.add_argument("--world", choices=(OWN, AS_FOUND), default=OWN)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args(arguments)
    all_trials: list[Trial] = []
    for paper in given.paper or PAPERS:
        trials = trials_of(paper, given.folder / paper, given.quick, given.world)
        home = world_folder(given.folder / paper, given.world)
        write_whole(home / "reasons.csv", trials_csv(trials))
        all_trials += trials
    table = given.folder / ("reasons.csv" if given.world == OWN else f"reasons-{given.world}.csv")
    write_whole(table, trials_csv(all_trials))
    print(f"table: {table.resolve()}")


def trials_of(paper: str, folder: Path, quick: bool, world: str) -> list[Trial]:
    """Run the experiments of a paper, whose studies lie in a folder."""
    study_folder = world_folder(folder, world)
    (study_folder / "reasons").mkdir(parents=True, exist_ok=True)
    experiments = import_module(f"reasons.{paper}")
    with Bars() as track:
        trials: list[Trial] = experiments.trials(study_folder, quick, world, track)
    both_worlds = [found / "findings.json" for found in (folder, study_folder)]
    if world == AS_FOUND and all(path.is_file() for path in both_worlds):
        trials += road_trials(read_findings(study_folder), read_findings(folder))
    return trials


if __name__ == "__main__":
    main()
