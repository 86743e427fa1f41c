"""Experiments on why statements of the papers do not hold on simulated lanes, study by study."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from flgpr.chain.progress import Track, silent
from flgpr.store import write_whole
from flgpr_papers.kit.findings import read_findings
from flgpr_papers.kit.page import telling_if_same
from flgpr_papers.kit.reasons import Trial, road_trials, trials_csv, write_trials
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.study_worlds import AS_FOUND, OWN, check_study_world, world_folder
from flgpr_papers.kit.threads import one_blas_thread


@one_blas_thread
def explain(
    output: str | Path,
    papers: Sequence[str] = (),
    quick: bool = False,
    world: str = OWN,
    track: Track = silent,
) -> Path:
    """Run the experiments on why statements do not hold, beside the studies, whose lanes and verdicts stay as they are.

    Each paper has its own, in ``flgpr_papers.PAPER.reasons``. Lanes that the studies have made are taken as they are;
    what an experiment has measured is kept, so that an interrupted run resumes. On roads as found it is asked, too,
    whether a statement that disagrees there agrees on prepared lanes, where the study has run on both.

    Parameters
    ----------
    output : str or Path
        Folder of ``flgpr reproduce all``, with a folder per paper. Every one gets ``reasons.csv``.
    papers : sequence of str
        Which papers; all without any.
    quick : bool
        Small lanes that only show that everything runs.
    world : str
        "own", prepared lanes as each paper describes them, or "as-found", roads as they are found.
    track : Track
        Shows progress.

    Returns
    -------
    Path
        The table of all papers asked for: ``reasons.csv``, or ``reasons-as-found.csv``.

    Raises
    ------
    ValueError
        If there is no such paper or world.
    """
    check_study_world(world)
    for paper in papers:
        if paper not in PAPERS:
            raise ValueError(f"part must be one of {', '.join(PAPERS)}, got {paper!r}")
    folder = Path(output)
    every: list[Trial] = []
    for paper in papers or PAPERS:
        home = world_folder(folder / paper, world)
        (home / "reasons").mkdir(parents=True, exist_ok=True)
        study = import_module(f"flgpr_papers.{paper}.reasons")
        found: list[Trial] = study.trials(home, quick, world, track)
        if world == AS_FOUND:
            found += _roads(folder / paper, home)
        write_trials(home, found)
        every += found
    table = folder / ("reasons.csv" if world == OWN else f"reasons-{world}.csv")
    with telling_if_same(table):
        write_whole(table, trials_csv(every))
    return table


def _roads(prepared: Path, found: Path) -> list[Trial]:
    """Compare a study's findings on both roads, if it has run on both."""
    if not all((folder / "findings.json").is_file() for folder in (prepared, found)):
        return []
    return road_trials(read_findings(found), read_findings(prepared))
