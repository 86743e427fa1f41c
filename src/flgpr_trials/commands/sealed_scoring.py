"""Scoring an alarm list against a sealed truth: files in, files out."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import flgpr
from flgpr.commands.entrants import Entrant, find_entrants
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
    recipe_of,
    register_of,
    registered_entrant,
)
from flgpr_trials.ledger import content_hash
from flgpr_trials.pages import blind_html
from flgpr_trials.passphrase import require_seal


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
    entered = registered_entrant(entrant, register_of(request.trial))
    existing(request.truth, "sealed truth")
    # The list is read before the passphrase is asked for and a look is entered.
    table = entrant.table()
    stated = {} if request.card is None else request.card.notes(0, entrant)
    look = match_blind(
        table,
        request.truth,
        request.trial.passphrase,
        registered=entered.registration,
        witness=request.trial.witness if request.trial.book is None else None,
    )
    notes = entered.provenance()
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
