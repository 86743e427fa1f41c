"""``flgpr seal``: encrypt a truth with its lane and rules for blind scoring."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from flgpr.commands.options import Output, PathLike, ShellType, lane_option
from flgpr.commands.score_options import require_witnessed
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    import pandas as pd

    from flgpr.scoring.matching import LaneLike
    from flgpr_trials.ledger import RegisterLike


class Show(StrEnum):
    """What the scores of a sealed truth may tell."""

    curve = "curve"
    targets = "targets"


def ask_new_passphrase() -> str:
    """Ask for a passphrase twice, after its rules; a weak one is refused before it is repeated."""
    from flgpr_trials.passphrase import PASSPHRASE_RULE, check_passphrase

    typer.echo(f"The passphrase must have {PASSPHRASE_RULE}.", err=True)
    typer.echo("It is asked for twice. Nothing is shown while you type.", err=True)
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
    from flgpr.commands.scoring import borders, read_lanes
    from flgpr.door import read_named, refuse_links
    from flgpr.scoring import Rules
    from flgpr.store.files import existing
    from flgpr.store.outputs import atomic_output, log_finished
    from flgpr.store.tables import parse_table
    from flgpr_trials.commands.registering import default_register, with_witness
    from flgpr_trials.commands.sealed_scoring import require_seal
    from flgpr_trials.sealing import seal_truth

    require_witnessed(witness, book)
    require_seal()
    data = read_named(existing(truth, "truth file"))
    table = parse_table(data, "truth", truth)
    lanes = read_lanes(lane)
    rules = {"halo": Rules.halo if halo is None else halo, "show": str(show or Show.curve)}

    own_register = default_register(truth, table)
    register = own_register if book is None else with_witness(book, witness)
    bound_register = None
    if register is not None:
        halo_rule = {"halo": rules["halo"]}
        is_planned = own_register is not None
        bound_register = _bound_register(register, data, borders(lanes), halo_rule, is_planned)

    path = Path(output)
    refuse_links(path)
    if os.path.lexists(path):
        _require_same_seal(path, passphrase, table, lanes, rules, bound_register)
        log_finished(path)
    else:
        with atomic_output(path) as partial:
            seal_truth(table, lanes, partial, passphrase, **rules, register=bound_register)
    if register is not None:
        _enter_sealed(register, path, bound_register)
    return path


def _bound_register(
    register: RegisterLike,
    truth: bytes,
    lanes: Mapping[str, Mapping[str, float]],
    rules: Mapping[str, float],
    is_planned: bool,
) -> dict[str, Any]:
    """Return what a sealed file states of its register: the truth's digest and the last line."""
    from flgpr_trials.commands.registering import read_existing_register
    from flgpr_trials.ledger import content_hash, register_paths, require_truth

    lines = read_existing_register(register)
    path, _ = register_paths(register)
    digest = content_hash(truth)
    require_truth(path, digest, lanes, rules, planned=is_planned)
    if not lines:
        raise ValueError(f"book must hold a plan or a recipe, got the empty {path}")
    return {"truth": digest, "line": lines[-1]["hash"]}


def _require_same_seal(
    path: Path,
    passphrase: Any,
    truth: pd.DataFrame,
    lanes: LaneLike,
    rules: Mapping[str, Any],
    bound_register: Mapping[str, Any] | None,
) -> None:
    """Refuse a file that does not seal this truth with these rules, passphrase and register."""
    from flgpr.store.outputs import output_exists_error
    from flgpr_trials.sealing import seals

    phrase = passphrase() if callable(passphrase) else passphrase
    is_same, sealed_register = seals(path, phrase, truth, lanes, **rules)
    if bound_register is None or sealed_register is None:
        is_same = is_same and bound_register is None and sealed_register is None
    else:
        # The register may have grown since: its last line may be another one.
        is_same = is_same and sealed_register["truth"] == bound_register["truth"]
    if not is_same:
        raise output_exists_error(
            path, "or was sealed with another passphrase: choose another output"
        )


def _enter_sealed(
    register: RegisterLike, path: Path, bound_register: Mapping[str, Any] | None
) -> None:
    """Enter a sealed file into a register that does not hold it yet."""
    from flgpr_trials.ledger import content_hash, read_checked_register
    from flgpr_trials.ledger import register as enter_line

    digest = content_hash(path)
    if any(line.get("sealed") == digest for line in read_checked_register(register)):
        return
    truth = None if bound_register is None else bound_register["truth"]
    enter_line(register, event="sealed", truth=truth, sealed=digest)
