"""``flgpr benchmark``: the proving ground, which compares detectors on the same sealed lanes.

Submissions made elsewhere are in :mod:`flgpr_ground.commands.submissions`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flgpr.commands.options import OptionalOutput, Output, PathLike, Paths, Progress, Scheduler
from flgpr.commands.runs import run_options
from flgpr.commands.shell import Arguments, command

Chosen = Annotated[
    str | None,
    "proving-ground-2 (the default), proving-ground-1, full-wave-2, full-wave-1, or the TOML of "
    "another ground.",
]
Tier = Annotated[str | None, "prepared, as-found or another tier of the ground; all by default."]
Workers = Annotated[int | None, Option(min=1, help="Processes that share the work.")]
Quick = Annotated[bool, "A small version that only checks that everything runs."]
_FOR_A_PAPER = (".pdf", ".tex", ".bib")  # endings of files beside a page of two entries


def _table_lines(text: str, _: Arguments) -> Iterator[str]:
    """Yield the table of the scores."""
    yield text


class RunText(str):
    """The table of the scores, which knows the classes of one's own that did not finish."""

    unfinished: tuple[str, ...] = ()


def _page_lines(text: RunText, call: Arguments) -> Iterator[str]:
    """Yield the table of the scores, the address of the page, and what can be entered."""
    yield text
    yield f"page: {(Path(call.output) / 'index.html').resolve()}"
    for card in sorted(Path(call.output).glob("submissions/*/submission.toml")):
        yield f"to enter, once its card is right: {card.parent}"
    if text.unfinished:
        yield f"did not finish, and has no score where it failed: {', '.join(text.unfinished)}"


@command(lines=_page_lines, status=lambda text: 1 if text.unfinished else 0, resumes=True)
def run_benchmark(
    entries: Annotated[Sequence[str] | None, Argument()] = None,
    output: Output = Path("proving-ground"),
    quick: Quick = False,
    ground: Chosen = None,
    tier: Tier = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    *,
    track: Progress = None,
) -> str:
    """Make the lanes, train, freeze, detect on the test lanes, and score.

    An interrupted run resumes. A class of your own that does not finish ends it with status 1.

    Parameters
    ----------
    entries
        Packaged entries, recipes, MODULE:CLASS of your own, or folders of alarm lists
        SPLIT.csv; all packaged entries by default.
    output
        folder to work in

    Returns
    -------
    str
        The table of the scores.
    """
    from flgpr import proving_ground
    from flgpr_ground.own import is_own, own_name

    options = run_options(workers, scheduler, track=track)
    proving_ground.run_benchmark(list(entries or ()), output, quick, options, ground, tier)
    proving_ground.write_submissions(output)
    text = RunText(proving_ground.write_score_tables([output], output))
    names = [own_name(str(entry)) for entry in entries or () if is_own(entry)]
    fault = " did not finish" + (f" on the tier {tier}" if tier else "")
    text.unfinished = tuple(name for name in names if f"\n{name}{fault}" in text)
    return text


@command(lines=_table_lines)
def run_oracle(
    folder: PathLike,
    recipe: str = "wang2007",
    tier: Tier = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    *,
    track: Progress = None,
) -> str:
    """Score a detector that knows every mine's echo. It opens the truth, which is logged.

    Parameters
    ----------
    folder
        Folder of `flgpr benchmark run`.
    recipe
        Recipe whose images are used.

    Returns
    -------
    str
        The table of the scores.
    """
    from flgpr import proving_ground

    proving_ground.run_oracle(folder, recipe, run_options(workers, scheduler, track=track), tier)
    return proving_ground.write_score_tables([folder], folder)


@command(lines=_table_lines, quiet=False)
def benchmark_table(
    folders: Paths,
    output: OptionalOutput = None,
) -> str:
    """Compare entries. Alarms without a score are scored, and the look at the truth is logged.

    Parameters
    ----------
    folders
        Folders of `flgpr benchmark run`, of one ground.
    output
        folder of the table, by default the first

    Returns
    -------
    str
        The table of the scores.
    """
    from flgpr import proving_ground

    return proving_ground.write_score_tables(folders, output or folders[0])


def _answer_lines(written: tuple[Path, list[str]], _: Arguments) -> Iterator[str]:
    """Yield who finds what, the address of the page, and the files for a paper."""
    page, answers = written
    yield from answers
    yield f"page: {page.resolve()}"
    names = sorted(file.name for file in page.parent.iterdir() if file.suffix in _FOR_A_PAPER)
    yield f"for a paper, beside it: {', '.join(names)}"


@command(lines=_answer_lines)
def compare_benchmark(
    entry: str,
    folder: Annotated[PathLike, Argument()] = Path("proving-ground"),
    other: Annotated[str | None, Option("--with")] = None,
    output: OptionalOutput = None,
    tier: Tier = None,
) -> tuple[Path, list[str]]:
    """Compare two entries mine by mine, with images. It opens the truth, which is logged.

    Parameters
    ----------
    entry
        Name of an entry that ran, such as my-detector.
    folder
        Folder of `flgpr benchmark run`.
    other
        Entry to compare it with, by default the reference.
    output
        folder of page, figure, LaTeX and BibTeX

    Returns
    -------
    page : Path
        The page.
    answers : list of str
        A sentence for each tier.
    """
    from flgpr import proving_ground

    return proving_ground.compare_entries(folder, entry, other, output, tier)


def _template_lines(path: Path, _: Arguments) -> Iterator[str | Path]:
    """Yield the file and the command that runs it."""
    yield path
    yield f"next: flgpr benchmark run {path.stem}:MyDetector --quick --tier prepared"


@command(lines=_template_lines)
def benchmark_template(
    folder: Annotated[PathLike, Argument()] = Path(),
) -> Path:
    """Write a detector of your own to begin with, which runs as it is.

    Parameters
    ----------
    folder
        Folder, by default this one.

    Returns
    -------
    Path
        The file.
    """
    from flgpr import proving_ground

    return proving_ground.write_template(folder)


@command(quiet=False)
def list_benchmark(
    quick: Quick = False,
    lanes: Annotated[
        PathLike | None, Option(help="Folder of lanes to compare with those of the authors.")
    ] = None,
    ground: Chosen = None,
) -> list[str]:
    """List the packaged entries, the lanes and the splits; compare a folder of lanes with them.

    Returns
    -------
    list of str
        Lines of text.
    """
    from flgpr import proving_ground

    return proving_ground.listing(quick, lanes, ground)
