"""``flgpr reproduce``: the papers' experiments run again on simulated lanes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flgpr.commands.options import PathLike, Progress, Scheduler, output_option
from flgpr.commands.run_options import run_options
from flgpr.commands.shell import Arguments, command

PAPERS = ("cosgrove2004", "flsar2004", "fuse2018", "wang2007")


def _lines(page: Path, call: Arguments) -> Iterator[str]:
    """Yield the address of the page, or of the table of reasons."""
    kind = "table" if call.paper == "reasons" else "page"
    yield f"{kind}: {page.resolve()}"


@command(lines=_lines, resumes=True)
def reproduce(
    paper: Annotated[
        str,
        Argument(
            help=f"One of {', '.join(PAPERS)}, all; worlds: a map of what decides; or reasons: "
            "experiments on why statements do not hold."
        ),
    ],
    output: Annotated[PathLike | None, output_option("folder to work in")] = None,
    quick: Annotated[
        bool, Option("--quick", help="A small version that only checks that everything runs.")
    ] = False,
    part: Annotated[
        Sequence[str] | None,
        Option(
            help="Of worlds: detection, ablation, geometry or statements, or figures of the "
            "results so far; of reasons: a paper. May repeat."
        ),
    ] = None,
    workers: Annotated[
        int | None,
        Option(min=1, help="Processes: with all one for a paper, with worlds for a world."),
    ] = None,
    scheduler: Scheduler = None,
    world: Annotated[
        str,
        Option(
            help="Lanes of the studies: own, prepared as each paper says; or as-found, as on roads."
        ),
    ] = "own",
    *,
    track: Progress = None,
) -> Path:
    """Run a paper's experiment again on simulated lanes and write its page.

    An interrupted run resumes.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    ValueError
        If the paper is not known, or an option does not go with it.
    """
    from flgpr.progress import silent

    if paper not in (*PAPERS, "all", "worlds", "reasons"):
        raise ValueError(
            f"paper must be one of {', '.join(PAPERS)}, all, worlds or reasons, got {paper!r}"
        )
    default_folder = "reproduced" if paper in ("all", "reasons") else f"{paper}-result"
    folder = Path(output or default_folder)
    # The studies import everything else, and nothing may import them but on demand.
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
    chosen = {"parts": part} if part else {}
    return Path(papers.map_worlds(folder, **chosen, quick=quick, how=options))
