"""``flgpr reproduce``: the papers' experiments run again on simulated lanes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flgpr.commands.options import PathLike, Progress, Scheduler
from flgpr.commands.run_options import run_options
from flgpr.commands.shell import Arguments, command

PAPERS = ("cosgrove2004", "flsar2004", "fuse2018", "wang2007")


def _lines(page: Path, call: Arguments) -> Iterator[str]:
    word = "table" if call.paper == "reasons" else "page"
    yield f"{word}: {page.resolve()}"


@command(lines=_lines)
def reproduce(
    paper: Annotated[
        str,
        Argument(
            help=f"One of {', '.join(PAPERS)}, all, worlds: a map of what decides, or reasons: "
            "experiments on why statements do not hold."
        ),
    ],
    output: Annotated[PathLike | None, Option("-o", "--output", help="Folder to work in.")] = None,
    quick: Annotated[
        bool, Option("--quick", help="A small version that only shows that all of it runs.")
    ] = False,
    part: Annotated[
        Sequence[str] | None,
        Option(
            help="Of worlds: detection, ablation, geometry or statements, or figures of what is there; of reasons: a "
            "paper. Several may be."
        ),
    ] = None,
    workers: Annotated[
        int | None, Option(min=1, help="Processes, of all a paper each, of worlds a world.")
    ] = None,
    scheduler: Scheduler = None,
    world: Annotated[
        str,
        Option(
            help="Lanes of the studies: own, prepared as each paper says, or as-found, roads as found."
        ),
    ] = "own",
    *,
    track: Progress = None,
) -> Path:
    """Run a paper's experiment again on simulated lanes and write its page; an interrupted run resumes.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    ValueError
        If the paper is not known, or an option does not go with it.
    """
    from flgpr.chain.progress import silent

    if paper not in (*PAPERS, "all", "worlds", "reasons"):
        raise ValueError(
            f"paper must be one of {', '.join(PAPERS)}, all, worlds or reasons, got {paper!r}"
        )
    of_all = "reproduced" if paper in ("all", "reasons") else f"{paper}-result"
    folder = Path(output or of_all)
    # The studies rest on everything else, and nothing rests on them.
    papers = import_module("flgpr_papers")
    if paper == "reasons":
        return Path(papers.explain(folder, part or (), quick, world, track or silent))
    if paper != "worlds":
        if part:
            raise ValueError(
                f"part must be left out for {paper}: only worlds and reasons have parts"
            )
        page = papers.reproduce(paper, folder, quick, track or silent, workers or 1, world)
        return Path(page)
    if world != "own":
        raise ValueError(f"worlds has worlds of its own: world must be left out, got {world!r}")
    options = run_options(workers, scheduler, track=track)
    parts = {"parts": part} if part else {}
    return Path(papers.map_worlds(folder, **parts, quick=quick, how=options))
