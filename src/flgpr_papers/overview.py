"""The papers, and the overview of where their verdicts stand once they have been run again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from flgpr.chain.progress import Track, silent
from flgpr.execution.workers import InProcess, Processes
from flgpr.store import write_whole
from flgpr_papers.kit.findings import OPEN, read_findings
from flgpr_papers.kit.page import study_html, telling_if_same
from flgpr_papers.kit.settings import PAPERS
from flgpr_papers.kit.study_worlds import AS_FOUND, OWN, check_study_world, world_folder


def reproduce(
    paper: str,
    output: str | Path,
    quick: bool = False,
    track: Track = silent,
    workers: int = 1,
    world: str = OWN,
) -> Path:
    """Run a paper's experiment again on simulated lanes, or all of them.

    What was stopped goes on where it was. With "all" every paper works in a folder of its own, and
    the overview is written anew after each, so that a run that was stopped shows what is there.
    Several processes first take what a study can have made beforehand part by part.

    A study on roads as found works in the folder ``as-found`` within that of the study, so that the
    two never mix. The page of the study shows its verdicts beside if they are there when it is
    written.

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
    if paper != "all":
        return run_study(paper, world_folder(folder, world), quick, track, world)
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [
        (name, str(world_folder(folder / name, world)), quick, world)
        for name in sorted(PAPERS, reverse=True)
    ]
    for _, home, _, _ in jobs:
        _refuse_other_form(Path(home), quick, world)
    pages = _pages_there(folder, world)
    overview = folder / overview_name(world)
    with (
        telling_if_same(overview),
        Processes(workers) if workers > 1 else InProcess() as executor,
    ):
        if workers > 1:
            parts = [(*job, part) for job in jobs for part in parts_of(job[0], quick)]
            parts.sort(key=lambda job: job[-1] is not None)  # whole studies take longest
            list(track(executor.run(study_part, parts), "parts of the studies", len(parts)))
            done = track(executor.run(study_page, jobs), "papers", len(jobs))
        else:
            done = (_study_with_progress(*job, track) for job in jobs)
        for one in done:
            pages[one["paper"]] = Path(one["page"]).relative_to(folder)
            write_overview(folder, pages, quick, world)
    return overview


def _pages_there(folder: Path, world: str) -> dict[str, Path]:
    """Find the pages of the studies that were run before, by paper, as the overview links them."""
    pages = {}
    for name in PAPERS:
        home = world_folder(folder / name, world)
        page = home / study_of(name).PAGE
        if page.is_file() and (home / "findings.json").is_file():
            pages[name] = page.relative_to(folder)
    return pages


def overview_name(world: str) -> str:
    """Return the file of the overview of a world in the folder of "all"."""
    return "index.html" if world == OWN else f"{world}.html"


def write_overview(folder: Path, pages: Mapping[str, Path], quick: bool, world: str) -> None:
    """Write the overview and the verdicts of the studies that have a page.

    Those on roads as found have own files.
    """
    rows = {
        name: verdict_rows(world_folder(folder / name, world)) for name in PAPERS if name in pages
    }
    write_whole(
        folder / ("verdicts.csv" if world == OWN else f"verdicts-{world}.csv"), verdicts_csv(rows)
    )
    other = overview_name(AS_FOUND) if world == OWN else overview_name(OWN)
    html = study_html(
        "overview.html",
        papers=PAPERS,
        pages=pages,
        found=rows,
        quick=quick,
        as_found=world == AS_FOUND,
        other=other if (folder / other).is_file() else "",
    )
    write_whole(folder / overview_name(world), html)


def run_study(
    paper: str, folder: Path, quick: bool, track: Track = silent, world: str = OWN
) -> Path:
    """Run the study of one paper, which is loaded for it; returns its page.

    A folder that has results of the other form, quick or full, or of the other world is a
    FileExistsError.
    """
    _refuse_other_form(folder, quick, world)
    study = study_of(paper)
    with telling_if_same(folder / study.PAGE):
        page: Path = study.reproduce(folder, quick, track, world=world)
    return page


def _refuse_other_form(folder: Path, quick: bool, world: str) -> None:
    path = folder / "findings.json"
    if not path.is_file():
        return
    run = json.loads(path.read_text("utf-8"))
    if run["quick"] != quick:
        form = "full" if quick else "quick"
        raise FileExistsError(
            f"output must not exist yet, got {folder} with the {form} form: choose another output"
        )
    its_world = run.get(
        "world", AS_FOUND
    )  # before there were two worlds, all studies ran on roads as found
    if its_world != world:
        raise FileExistsError(
            f"output must not exist yet, got {folder} with lanes of the world {its_world!r}: "
            f"choose another output"
        )


def study_of(paper: str) -> Any:
    """Load the study of a paper."""
    return import_module(f"flgpr_papers.{paper}.study")


def parts_of(paper: str, quick: bool) -> list[str | None]:
    """Name the parts of a study that can be made beforehand; None stands for all of it."""
    study = study_of(paper)
    return list(study.parts(quick)) if hasattr(study, "parts") else [None]


def study_part(
    paper: str, folder: str, quick: bool, world: str, part: str | None
) -> dict[str, Any]:
    """Make a part of a study beforehand in a process of its own."""
    if part is None:
        run_study(paper, Path(folder), quick, world=world)
    else:
        study_of(paper).make_part(Path(folder), part, quick, world)
    return {"paper": paper, "part": part}


def study_page(paper: str, folder: str, quick: bool, world: str) -> dict[str, str]:
    """Run a study in a process of its own and tell which page it wrote."""
    return _study_with_progress(paper, folder, quick, world, silent)


def _study_with_progress(
    paper: str, folder: str, quick: bool, world: str, track: Track
) -> dict[str, str]:
    return {"paper": paper, "page": str(run_study(paper, Path(folder), quick, track, world))}


def verdict_rows(folder: Path) -> list[tuple[str, str, str, str]]:
    """Read statement, the paper's figure, ours with its interval, and the verdict.

    Open questions are left out.
    """
    rows = []
    for one in read_findings(folder):
        if one.verdict == OPEN:
            continue
        about = "; ".join(
            part for part in (one.quantity, one.group and f"{one.group} lanes") if part
        )
        claim = f"{one.claim} ({about})" if about else one.claim
        rows.append((claim, one.paper, one.ours, one.verdict))
    return rows


def verdicts_csv(found: Mapping[str, list[tuple[str, str, str, str]]]) -> str:
    """Tabulate the verdicts of all papers: paper, claim, what the paper states, ours, verdict."""
    rows = [("paper", "claim", "stated", "ours", "verdict")]
    rows += [(name, *row) for name, verdicts in found.items() for row in verdicts]
    return "".join(
        ",".join('"' + cell.replace('"', '""') + '"' for cell in row) + "\n" for row in rows
    )
