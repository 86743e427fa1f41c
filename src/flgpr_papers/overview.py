"""Run the studies of the papers, and write the overview of their verdicts."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path

import pandas as pd

from flgpr.jobs.workers import Executor, InProcess, Processes
from flgpr.progress import Track, silent
from flgpr.store import write_whole
from flgpr.types import Entries
from flgpr_papers.kit.findings import OPEN, read_findings
from flgpr_papers.kit.page import log_if_unchanged, study_html
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.study import Study
from flgpr_papers.kit.study_worlds import AS_FOUND, OWN, check_study_world, world_folder

Job = tuple[str, str, bool, str]
"""Paper, folder of the study, whether the run is quick, and world, as a worker gets them."""
VerdictRow = tuple[str, str, str, str]
"""Statement, the paper's figure, ours with its interval, and the verdict."""


def reproduce(
    paper: str,
    output: str | Path,
    quick: bool = False,
    track: Track = silent,
    workers: int = 1,
    world: str = OWN,
) -> Path:
    """Run a paper's experiment again on simulated lanes, or all of them.

    An interrupted run resumes. With "all", every paper works in a folder of its own, and the
    overview is written anew after each of them, so that it always shows the studies that are
    finished. With several processes, the parts of the studies that can be worked on by themselves
    are run first.

    A study on roads as found works in the folder ``as-found`` within that of the study, so that the
    two never mix. The page of the study shows the verdicts of both if those on roads as found are
    there when it is written.

    Parameters
    ----------
    paper : str
        One of `PAPERS`, or "all".
    output : str or Path
        Folder to work in; "all" writes ``index.html`` and ``verdicts.csv`` there.
    quick : bool
        Small versions that only show that everything runs; every page says so.
    track : Track
        Shows progress.
    workers : int
        Number of processes that share the work of "all".
    world : str
        "own", prepared lanes as each paper describes them, or "as-found", roads as they are found.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ValueError
        If there is no such paper or world.
    FileExistsError
        If the folder has the results of the other form, quick or full, or of another world.
    """
    check_study_world(world)
    if paper != "all" and paper not in PAPERS:
        raise ValueError(f"paper must be one of {', '.join(PAPERS)} or all, got {paper!r}")
    folder = Path(output)
    if paper == "all":
        return _run_all_studies(folder, quick, track, workers, world)
    return run_study(paper, world_folder(folder, world), quick, track, world)


def _run_all_studies(folder: Path, quick: bool, track: Track, workers: int, world: str) -> Path:
    """Run the studies of all papers, each in a folder of its own; returns the overview."""
    folder.mkdir(parents=True, exist_ok=True)
    jobs: list[Job] = []
    pages = {}
    for paper in sorted(PAPERS, reverse=True):
        study_folder = world_folder(folder / paper, world)
        _refuse_other_form(study_folder, quick, world)
        jobs.append((paper, str(study_folder), quick, world))
        page = study_folder / study_of(paper).page
        if page.is_file() and (study_folder / "findings.json").is_file():
            pages[paper] = page.relative_to(folder)
    overview = folder / overview_name(world)
    executor = Processes(workers) if workers > 1 else InProcess()
    with log_if_unchanged(overview), executor:
        finished: Iterable[Entries] = (study_page(*job, track) for job in jobs)
        if workers > 1:
            _run_parts(executor, jobs, track)
            finished = track(executor.run(study_page, jobs), "papers", len(jobs))
        for written in finished:
            pages[written["paper"]] = Path(written["page"]).relative_to(folder)
            write_overview(folder, pages, quick, world)
    return overview


def _run_parts(executor: Executor, jobs: Sequence[Job], track: Track) -> None:
    """Run the parts of several studies, so that their pages find the results on disk."""
    part_jobs = [(*job, part) for job in jobs for part in parts_of(job[0], job[2])]
    # A study without parts is one long job: it starts first, so that no worker waits for it.
    part_jobs.sort(key=lambda job: job[-1] is not None)
    for _ in track(executor.run(study_part, part_jobs), "parts of the studies", len(part_jobs)):
        pass


def overview_name(world: str) -> str:
    """Return the file name of a world's overview in the folder of "all"."""
    return "index.html" if world == OWN else f"{world}.html"


def write_overview(folder: Path, pages: Mapping[str, Path], quick: bool, world: str) -> None:
    """Write the overview and the table of verdicts of the studies that have a page.

    The studies on roads as found have an overview and a table of their own, which the other
    overview links.

    Parameters
    ----------
    folder : Path
        Folder of "all".
    pages : mapping of str to Path
        Page of each finished study by paper, relative to the folder.
    quick : bool
        Whether the studies are quick runs.
    world : str
        World of the studies, see :func:`reproduce`.
    """
    verdicts = {
        paper: verdict_rows(world_folder(folder / paper, world))
        for paper in PAPERS
        if paper in pages
    }
    table_name = "verdicts.csv" if world == OWN else f"verdicts-{world}.csv"
    rows = [(paper, *row) for paper, of_paper in verdicts.items() for row in of_paper]
    table = pd.DataFrame(rows, columns=["paper", "claim", "stated", "ours", "verdict"])
    write_whole(
        folder / table_name, table.to_csv(index=False, quoting=csv.QUOTE_ALL, lineterminator="\n")
    )
    other_overview = overview_name(AS_FOUND if world == OWN else OWN)
    html = study_html(
        "overview.html",
        papers=PAPERS,
        pages=pages,
        found=verdicts,
        quick=quick,
        as_found=world == AS_FOUND,
        other=other_overview if (folder / other_overview).is_file() else "",
    )
    write_whole(folder / overview_name(world), html)


def run_study(
    paper: str, folder: Path, quick: bool, track: Track = silent, world: str = OWN
) -> Path:
    """Run the study of one paper, whose modules are imported for it, and return its page.

    Parameters
    ----------
    paper : str
        One of `PAPERS`.
    folder : Path
        Folder of the study in this world.
    quick : bool
        A small version that only shows that everything runs.
    track : Track
        Shows progress.
    world : str
        World of the lanes, see :func:`reproduce`.

    Raises
    ------
    FileExistsError
        If the folder has results of the other form, quick or full, or of the other world.
    """
    _refuse_other_form(folder, quick, world)
    study = study_of(paper)
    with log_if_unchanged(folder / study.page):
        return study.reproduce(folder, quick, track, world=world)


def _refuse_other_form(folder: Path, quick: bool, world: str) -> None:
    """Refuse a folder that has results of the other form or world, by a FileExistsError."""
    path = folder / "findings.json"
    if not path.is_file():
        return
    finished_run = json.loads(path.read_text("utf-8"))
    if finished_run["quick"] != quick:
        form = "full" if quick else "quick"
        raise FileExistsError(
            f"output must not exist yet, got {folder} with the {form} form: choose another output"
        )
    # Results without a world are of roads as found: they are older than the second world.
    finished_world = finished_run.get("world", AS_FOUND)
    if finished_world != world:
        raise FileExistsError(
            f"output must not exist yet, got {folder} with lanes of the world {finished_world!r}: "
            f"choose another output"
        )


def study_of(paper: str) -> Study:
    """Import the study of a paper."""
    study: Study = import_module(f"flgpr_papers.{paper}.study").STUDY
    return study


def parts_of(paper: str, quick: bool) -> list[str] | list[None]:
    """Return the names of a study's parts that can be run by themselves; None is all of it."""
    parts = study_of(paper).parts
    return [None] if parts is None else parts(quick)


def study_part(paper: str, folder: str, quick: bool, world: str, part: str | None) -> Entries:
    """Run a part of a study in a worker process; its results are then on disk."""
    if part is None:
        run_study(paper, Path(folder), quick, world=world)
    else:
        study_of(paper).make_part(Path(folder), part, quick, world)
    return {"paper": paper, "part": part}


def study_page(
    paper: str, folder: str, quick: bool, world: str, track: Track = silent
) -> dict[str, str]:
    """Run a study, as in a worker process, and return the paper and the page that was written."""
    return {"paper": paper, "page": str(run_study(paper, Path(folder), quick, track, world))}


def verdict_rows(folder: Path) -> list[VerdictRow]:
    """Read the verdicts of a study: statement, the paper's figure, ours with interval, verdict.

    Questions that the paper leaves open are left out.
    """
    rows = []
    for finding in read_findings(folder):
        if finding.verdict != OPEN:
            lanes = f"{finding.group} lanes" if finding.group else ""
            details = "; ".join(detail for detail in (finding.quantity, lanes) if detail)
            claim = f"{finding.claim} ({details})" if details else finding.claim
            rows.append((claim, finding.paper, finding.ours, finding.verdict))
    return rows
