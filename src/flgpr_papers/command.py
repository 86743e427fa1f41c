"""``flgpr reproduce``, which the entry point "papers" adds to the command line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flgpr.commands.options import OptionalOutput, Progress
from flgpr.commands.shell import Arguments, Offer, command

PAPERS = ("cosgrove2004", "flsar2004", "fuse2018", "wang2007")
_SCRIPTS = ("worlds", "reasons")  # in evidence/; words of this command once


def _lines(page: Path, _: Arguments) -> Iterator[str]:
    """Yield the address of the page."""
    yield f"page: {page.resolve()}"


@command(lines=_lines, resumes=True)
def reproduce(
    paper: Annotated[
        str,
        Argument(help=f"One of {', '.join(PAPERS)}, or all."),
    ],
    output: OptionalOutput = None,
    quick: bool = False,
    workers: Annotated[int, Option(min=1)] = 1,
    world: str = "own",
    *,
    track: Progress = None,
) -> Path:
    """Run a paper's experiment again on simulated lanes and write its page.

    An interrupted run resumes.

    Parameters
    ----------
    output
        folder to work in
    quick
        A small version that only checks that everything runs.
    workers
        Processes: with all one for a paper.
    world
        Lanes of the studies: own, prepared as each paper says; or as-found, as on roads.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    ValueError
        If the paper is not known.
    """
    import flgpr_papers as papers  # its studies are loaded here
    from flgpr.progress import silent

    if paper not in (*PAPERS, "all"):
        moved = f"; it is now python evidence/{paper}" if paper in _SCRIPTS else ""
        raise ValueError(f"paper must be one of {', '.join(PAPERS)} or all, got {paper!r}{moved}")
    folder = Path(output or ("reproduced" if paper == "all" else f"{paper}-result"))
    return papers.reproduce(paper, folder, quick, track or silent, workers, world)


OFFER = Offer(commands={"reproduce": reproduce}, panels={"Research": {"reproduce": ""}})
