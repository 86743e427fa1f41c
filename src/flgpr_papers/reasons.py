"""Run the experiments on why statements of the papers do not hold on simulated lanes."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from flgpr.progress import Track, silent
from flgpr.store import write_whole
from flgpr_papers.kit.findings import read_findings
from flgpr_papers.kit.page import log_if_unchanged
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
    """Run the experiments on why statements do not hold, and write their tables.

    The lanes and verdicts of the studies stay as they are. Each paper has its own experiments, in
    ``flgpr_papers.PAPER.reasons``. They use the lanes that the studies have simulated. Finished
    measurements stay on disk, so that an interrupted run resumes. On roads as found there is one
    more experiment: whether a statement that disagrees there agrees on prepared lanes, where the
    study has run on both.

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
    trials_of_all: list[Trial] = []
    for paper in papers or PAPERS:
        trials = _trials_of(paper, folder / paper, quick, world, track)
        write_trials(world_folder(folder / paper, world), trials)
        trials_of_all += trials
    table = folder / ("reasons.csv" if world == OWN else f"reasons-{world}.csv")
    with log_if_unchanged(table):
        write_whole(table, trials_csv(trials_of_all))
    return table


def _trials_of(paper: str, folder: Path, quick: bool, world: str, track: Track) -> list[Trial]:
    """Run the experiments of a paper, whose studies lie in a folder."""
    study_folder = world_folder(folder, world)
    (study_folder / "reasons").mkdir(parents=True, exist_ok=True)
    experiments = import_module(f"flgpr_papers.{paper}.reasons")
    trials: list[Trial] = experiments.trials(study_folder, quick, world, track)
    if world == AS_FOUND:
        trials += _trials_of_road(prepared=folder, as_found=study_folder)
    return trials


def _trials_of_road(prepared: Path, as_found: Path) -> list[Trial]:
    """Compare the findings of a study on both roads, if it has run on both."""
    for folder in (prepared, as_found):
        if not (folder / "findings.json").is_file():
            return []
    return road_trials(read_findings(as_found), read_findings(prepared))
