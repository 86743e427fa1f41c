"""``flgpr benchmark``: the proving ground, detectors side by side on the same sealed lanes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flgpr.commands.options import PathLike, Paths, Progress, Scheduler
from flgpr.commands.run_options import run_options
from flgpr.commands.shell import Arguments, command

Chosen = Annotated[
    str | None,
    Option(
        help="proving-ground-2 (the default), proving-ground-1, full-wave-1, or the TOML of a ground of your own."
    ),
]
Tier = Annotated[
    str | None, Option(help="prepared, as-found or another tier of the ground; all by default.")
]
Workers = Annotated[int | None, Option(min=1, help="Processes that share the work.")]
Quick = Annotated[
    bool, Option("--quick", help="The quick form, which only shows that all of it runs.")
]


def _text_lines(text: str, _: Arguments) -> Iterator[str]:
    yield text


def _page_lines(text: str, call: Arguments) -> Iterator[str]:
    yield text
    yield f"page: {(Path(call.output) / 'index.html').resolve()}"


@command(lines=_page_lines)
def run_benchmark(
    entries: Annotated[
        Sequence[str] | None,
        Argument(
            help="Packaged entries, recipes, or folders of alarm lists SPLIT.csv; none takes all packaged ones."
        ),
    ] = None,
    output: Annotated[PathLike, Option("-o", "--output", help="Folder to work in.")] = Path(
        "proving-ground"
    ),
    quick: Quick = False,
    ground: Chosen = None,
    tier: Tier = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    *,
    track: Progress = None,
) -> str:
    """Make the lanes, train on those of training, freeze, detect on those of test, score; resumes where it stopped.

    Returns
    -------
    str
        The table of the scores.
    """
    from flgpr import proving_ground

    options = run_options(workers, scheduler, track=track)
    proving_ground.run_benchmark(list(entries or ()), output, quick, options, ground, tier)
    return proving_ground.write_table([output], output)


@command(lines=_text_lines)
def run_oracle(
    folder: Annotated[PathLike, Argument(help="Folder of `flgpr benchmark run`.")],
    recipe: Annotated[str, Option(help="Recipe whose images it looks at.")] = "wang2007",
    tier: Tier = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    *,
    track: Progress = None,
) -> str:
    """Tell what a detector would find that knows every mine's echo; opens the truth, which is logged.

    Returns
    -------
    str
        The table of the scores.
    """
    from flgpr import proving_ground

    proving_ground.run_oracle(folder, recipe, run_options(workers, scheduler, track=track), tier)
    return proving_ground.write_table([folder], folder)


@command(lines=_text_lines, quiet=False)
def benchmark_table(
    folders: Annotated[Paths, Argument(help="Folders of `flgpr benchmark run`, of one ground.")],
    output: Annotated[
        PathLike | None, Option("-o", "--output", help="Folder of the table; default the first.")
    ] = None,
) -> str:
    """Set entries side by side; alarms that were not scored yet are, and the look at the truth is logged.

    Returns
    -------
    str
        The table of the scores.
    """
    from flgpr import proving_ground

    return proving_ground.write_table(folders, output or folders[0])


def _list_lines(lines: list[str], _: Arguments) -> Iterator[str]:
    yield from lines


@command(lines=_list_lines, quiet=False)
def list_benchmark(
    quick: Quick = False,
    lanes: Annotated[
        PathLike | None, Option(help="Folder of lanes to compare with those of the authors.")
    ] = None,
    ground: Chosen = None,
) -> list[str]:
    """Name the packaged entries, the lanes and the splits; with a folder of lanes, tell whether they are the same.

    Returns
    -------
    list of str
        Lines of text.
    """
    from flgpr import proving_ground

    return proving_ground.listing(quick, lanes, ground)
