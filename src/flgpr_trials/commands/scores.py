"""What ``flgpr score`` and ``flgpr compare`` ask of a trial: see :mod:`flgpr.commands.trials`.

The entry point of the group "flgpr.trials" names this module.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

import typer

import flgpr
from flgpr.commands.entrants import Entrant, find_entrants
from flgpr.commands.messages import say
from flgpr.commands.score_output import write_score_files
from flgpr.commands.score_request import ScoreRequest
from flgpr.commands.trial_card import ranking_notes
from flgpr.door import MOST_JSON, Folder, refuse_links
from flgpr.json_text import parse_json
from flgpr.results.score import detections_json
from flgpr.store.files import existing
from flgpr.store.outputs import OVERWRITE, log_finished, output_exists_error
from flgpr_trials.blind import BlindScore, blind_score, match_blind
from flgpr_trials.commands.registering import (
    open_truth,
    recipe_of,
    registered_entrant,
    with_witness,
)
from flgpr_trials.commands.seal import ask_new_passphrase, seal
from flgpr_trials.ledger import content_hash
from flgpr_trials.pages import blind_html
from flgpr_trials.passphrase import require_seal

__all__ = ["ask_new_passphrase", "ask_passphrase", "lines", "open_truth", "score_sealed", "seal"]

_BEFORE_OPENING = (
    "The passphrase is the one that this truth was sealed with. Nothing is shown while you type. "
    "A right one makes this score a look at the truth, which is counted in its log for good; a "
    "wrong one changes nothing."
)


def ask_passphrase() -> str:
    """Ask for the passphrase of a sealed truth on the terminal, after its rules."""
    say(_BEFORE_OPENING, err=True)
    return str(typer.prompt("passphrase", hide_input=True, err=True))


def lines(blind: BlindScore) -> Iterator[str]:
    """Yield what a score against a sealed truth shows: points, counts, looks and log heads."""
    yield blind.points.to_string(index=False, float_format="{:.3g}".format)
    if blind.targets is not None:
        yield blind.targets.to_string(index=False, na_rep="never", float_format="{:.3g}".format)
    yield ", ".join(
        f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in blind.counts.items()
    )
    yield (
        f"look {blind.looks} at this truth, different alarm lists so far: {blind.lists}; "
        "the seal guards against accidents, not against the holder of the passphrase"
    )
    for name, head in blind.heads.items():
        yield f"{name}: {head['lines']} lines, the last is {head['head']}"


def score_sealed(request: ScoreRequest) -> BlindScore | None:
    """Score an alarm list against a sealed truth; no position is shown.

    The list is a look at the truth, which is entered in its log.

    Parameters
    ----------
    request : ScoreRequest
        A list, or a result; the sealed truth and its passphrase; and where the files go. A truth
        that was sealed with a register demands it, with a recipe. A witness is that of the
        register, or without one that of the log.

    Returns
    -------
    BlindScore or None
        Operating points and counts; None where this very score is there already, which costs no
        look.

    Raises
    ------
    ValueError
        As :func:`flgpr.trials.score_blind`.
    FileExistsError
        If another score is at the output and is not to be overwritten.
    """
    require_seal()
    refuse_links(request.output)
    [entrant] = find_entrants(request.lists, request.trial.recipes, request.reading)
    if not request.overwrite and holds_sealed_score(request, entrant):
        return None
    trial = request.trial
    registration, notes = registered_entrant(entrant, with_witness(trial.book, trial.witness))
    existing(request.truth, "sealed truth")
    # The list is read before the passphrase is asked for and a look is entered.
    table = entrant.table()
    stated = {} if request.card is None else request.card.notes(0, entrant)
    look = match_blind(
        table,
        request.truth,
        trial.passphrase,
        registered=registration,
        witness=trial.witness if trial.book is None else None,
    )
    notes |= {"sealed_sha256": content_hash(request.truth), **look.heads}
    notes |= stated | ranking_notes(table)
    blind = blind_score(look)
    files = {
        "report.html": blind_html(blind, notes),
        "roc.json": blind_roc_json(blind, notes),
    }
    write_score_files(request.output, files)
    return blind


def blind_roc_json(blind: BlindScore, notes: Mapping[str, Any]) -> str:
    """Return ``roc.json`` of a blind score: points per group at fixed FARs.

    It holds no thresholds and no positions, which would give the truth away.
    """
    counts = dict(blind.counts)
    rules = {name: counts.pop(name) for name in ("area_rule", "halo_radius")}
    main = {"title": "", **counts, "points": blind.points.to_dict("records")}
    if blind.targets is not None:
        main["targets"] = blind.targets.to_dict("records")
    all_notes = {"looks": blind.looks, "lists": blind.lists, **notes}
    return detections_json(rules, all_notes, {"main": main})


def holds_sealed_score(request: ScoreRequest, entrant: Entrant) -> bool:
    """Return, before anybody looks, whether the output has this very score of a sealed truth.

    Parameters
    ----------
    request : ScoreRequest
        The sealed truth, the register and the output.
    entrant : Entrant
        The alarm list.

    Returns
    -------
    bool
        Whether it has; False where there is no score.

    Raises
    ------
    FileExistsError
        If the score there is another one, of another recipe in the register, or of another version.
    """
    file = request.output / "roc.json"
    if not os.path.lexists(file):
        return False
    expected = {
        "alarms_sha256": content_hash(entrant.data),
        "sealed_sha256": content_hash(existing(request.truth, "sealed truth")),
        "recipe_sha256": "" if request.trial.book is None else str(recipe_of(entrant)),
    }
    try:
        report = parse_json(Folder(request.output).read(file.name, MOST_JSON))
        stated = {name: report["notes"].get(name, "") for name in expected}
        is_same = stated == expected and report["flgpr"] == flgpr.__version__
    except (ValueError, KeyError, TypeError, AttributeError):
        is_same = False

    if not is_same:
        raise output_exists_error(file, f"{OVERWRITE}, or choose another output")
    log_finished(request.output, f"{OVERWRITE}, which is another look")
    return True
