"""``flgpr seal``: encrypt a truth with its lane and rules for blind scoring."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from flgpr.commands.messages import say
from flgpr.commands.options import Output, PathLike, ShellType, lane_option
from flgpr.commands.score_options import Show, given, require_witnessed
from flgpr.commands.score_request import Trial
from flgpr.commands.shell import Arguments, command


def ask_new_passphrase() -> str:
    """Ask for a passphrase twice, after its rules; a weak one is refused before it is repeated."""
    from flgpr_trials.passphrase import PASSPHRASE_RULE, check_passphrase

    say(f"The passphrase must have {PASSPHRASE_RULE}.", err=True)
    say("It is asked for twice. Nothing is shown while you type.", err=True)
    phrase = str(typer.prompt("passphrase", hide_input=True, err=True))
    check_passphrase(phrase)
    if phrase != typer.prompt("Repeat for confirmation", hide_input=True, err=True):
        raise ValueError(
            "passphrase must be typed twice alike, got two different ones: nothing was sealed"
        )
    return phrase


def _lines(sealed: Path, _: Arguments) -> Iterator[Path]:
    """Yield the sealed file."""
    yield sealed


def _passphrase(_: Arguments) -> dict[str, Any]:
    """Return the function that asks for the passphrase."""
    return {"passphrase": ask_new_passphrase}


@command(lines=_lines, python_values=_passphrase)
def seal(
    truth: Annotated[PathLike, Argument(help="CSV of the targets.")],
    lane: Annotated[PathLike, lane_option("or a CSV of several")],
    output: Output,
    halo: Annotated[
        float | None, Option(help="Halo radius in metres that scores use (1 m).")
    ] = None,
    show: Annotated[
        str | None,
        Option(
            help="What scores show: curve and counts (default) or also which targets are found."
        ),
        ShellType(Show),
    ] = None,
    book: Annotated[
        PathLike | None,
        Option(help="Register that scores then demand; a planned truth names its own."),
    ] = None,
    witness: Annotated[
        PathLike | None,
        Option(help="A file elsewhere that must hold the register's lines; new ones are added."),
    ] = None,
    *,
    passphrase: Annotated[Any, "A text, or a function that asks for it."] = None,
) -> Path:
    """Encrypt a truth with its lane or lanes and rules for blind scoring.

    A planned truth is sealed with its register: scores then demand it, with the recipe in it.

    Returns
    -------
    pathlib.Path
        The sealed file; one that seals just this with the same passphrase is left as it is.

    Raises
    ------
    ValueError
        If an input is not valid, the passphrase is weak, or the register does not hold the plan.
    FileExistsError
        If another file is at the output.
    """
    from flgpr_trials.commands.sealed_files import SealOrder, seal_and_enter

    require_witnessed(witness, book)
    rules = given({"halo": halo, "show": show and str(show)})
    order = SealOrder(Path(truth), lane, Path(output), passphrase, rules, Trial((), book, witness))
    return seal_and_enter(order)
