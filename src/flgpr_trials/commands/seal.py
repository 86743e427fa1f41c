"""``flgpr seal``: encrypt a truth with its lane and rules for blind scoring."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import typer

from flgpr.commands.messages import say
from flgpr.commands.options import LANE, Output, PathLike, ShellType
from flgpr.commands.score_request import Show, given, require_witnessed
from flgpr.commands.shell import command


def ask_new_passphrase() -> str:
    """Ask for a passphrase twice, after its rules; a weak one is refused before it is repeated."""
    from flgpr_trials.sealing import PASSPHRASE_RULE, check_passphrase

    say(f"The passphrase must have {PASSPHRASE_RULE}.", err=True)
    say("It is asked for twice. Nothing is shown while you type.", err=True)
    phrase = str(typer.prompt("passphrase", hide_input=True, err=True))
    check_passphrase(phrase)
    if phrase != typer.prompt("Repeat for confirmation", hide_input=True, err=True):
        raise ValueError(
            "passphrase must be typed twice alike, got two different ones: nothing was sealed"
        )
    return phrase


@command(python_values=lambda _: {"passphrase": ask_new_passphrase})
def seal(
    truth: PathLike,
    lane: Annotated[PathLike, LANE],
    output: Output,
    halo: float | None = None,
    show: Annotated[str | None, ShellType(Show)] = None,
    book: PathLike | None = None,
    witness: PathLike | None = None,
    *,
    passphrase: Any = None,
) -> Path:
    """Encrypt a truth with its lane or lanes and rules for blind scoring.

    A planned truth is sealed with its register: scores then demand it, with the recipe in it.

    Parameters
    ----------
    truth
        CSV of the targets.
    halo
        Halo radius in metres that scores use (1 m).
    show
        What scores show: curve and counts (default) or also which targets are found.
    book
        Register that scores then demand; a planned truth names its own.
    witness
        A file elsewhere that must hold the register's lines; new ones are added.
    passphrase
        A text, or a function that asks for it.
    lane
        or a CSV of several

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
    from flgpr.commands.reach import targets_in_reach, tell_doubts
    from flgpr.commands.scoring import borders, read_lanes
    from flgpr.door import read_named, refuse_links
    from flgpr.scoring import Rules
    from flgpr.store.files import existing
    from flgpr.store.outputs import atomic_output, log_finished, output_exists_error
    from flgpr.store.tables import parse_table
    from flgpr_trials.commands import scores
    from flgpr_trials.folder import require_trial_rules
    from flgpr_trials.ledger import content_hash, register, require_truth
    from flgpr_trials.sealing import require_seal, seal_truth, seals, to_seal

    require_witnessed(witness, book)
    rules: dict[str, Any] = given({"halo": halo, "show": show and str(show)})
    sealed = Path(output)
    require_seal()
    data = read_named(existing(truth, "truth file"))
    table = parse_table(data, "truth", truth)
    lanes = read_lanes(lane)
    name = Path(truth).name
    reachable, _ = targets_in_reach(table, lanes, rules.get("halo", Rules.halo), name)
    tell_doubts(reachable, "truth", name, lanes)
    own_register = scores.default_register(truth, table)
    bound_to = scores.with_witness(book, witness) or own_register
    bound = None
    if bound_to is not None:
        path = Path(bound_to)
        lines = scores.read_existing_register(bound_to)
        rule = {"halo": rules.get("halo", Rules.halo)}
        require_trial_rules(lines, rule, path)
        digest = content_hash(data)
        require_truth(path, digest, borders(lanes), rule, planned=own_register is not None)
        if not lines:
            raise ValueError(f"book must hold a plan or a recipe, got the empty {path}")
        bound = {"truth": digest, "line": lines[-1]["hash"]}

    refuse_links(sealed)
    if os.path.lexists(sealed):
        phrase = passphrase() if callable(passphrase) else passphrase
        is_same, sealed_register = seals(sealed, phrase, to_seal(table, lanes, **rules))
        # The register may have grown since: its last line may be another one.
        truths = [None if one is None else one["truth"] for one in (bound, sealed_register)]
        if not is_same or truths[0] != truths[1]:
            raise output_exists_error(
                sealed, "or was sealed with another passphrase: choose another output"
            )
        log_finished(sealed)
    else:
        with atomic_output(sealed) as partial:
            seal_truth(table, lanes, partial, passphrase, **rules, register=bound)
    if bound_to is not None and bound is not None:
        entry = {"event": "sealed", "truth": bound["truth"], "sealed": content_hash(sealed)}
        earlier = scores.read_existing_register(bound_to)
        if not any(line.get("sealed") == entry["sealed"] for line in earlier):
            register(bound_to, **entry)
    return sealed
