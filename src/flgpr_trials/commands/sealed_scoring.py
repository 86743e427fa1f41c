"""Scoring and comparing alarm lists against a sealed truth: files in, files out."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import flgpr
from flgpr.commands.entrants import Entrant, entrant_names, find_entrants
from flgpr.commands.score_output import write_score_files
from flgpr.commands.score_request import ScoreRequest
from flgpr.commands.trial_card import ranking_notes
from flgpr.door import MOST_JSON, Folder, refuse_links
from flgpr.json_text import parse_json
from flgpr.report import comparison_html
from flgpr.results.score import comparison_json, detections_json
from flgpr.scoring import Rules, SideBySide, side_by_side
from flgpr.store.files import existing
from flgpr.store.outputs import OVERWRITE, log_finished, output_exists_error
from flgpr_trials.blind import FAR_GRID, BlindLook, BlindScore, blind_score, match_blind
from flgpr_trials.commands.registering import (
    RegisteredEntrant,
    recipe_of,
    register_of,
    registered_entrant,
)
from flgpr_trials.ledger import content_hash
from flgpr_trials.pages import blind_html
from flgpr_trials.passphrase import require_seal


def score_sealed(request: ScoreRequest) -> BlindScore | SideBySide | None:
    """Score an alarm list against a sealed truth, or compare several; no position is shown.

    Every list is a look at the truth, which is entered in its log.

    Parameters
    ----------
    request : ScoreRequest
        Lists, or results; the sealed truth and its passphrase; and where the files go. A truth that
        was sealed with a register demands it, with a recipe for each list. A witness is that of the
        register, or without one that of the log.

    Returns
    -------
    BlindScore, SideBySide or None
        Operating points and counts, of all targets where lists are compared; None where this very
        score is there already, which costs no look.

    Raises
    ------
    ValueError
        As :func:`flgpr.trials.score_blind`.
    FileExistsError
        If another score is at the output and is not to be overwritten.
    """
    require_seal()
    refuse_links(request.output)
    entrants = find_entrants(request.lists, request.trial.recipes, request.reading)
    if not request.overwrite and holds_sealed_score(request, entrants):
        return None
    register = register_of(request.trial)
    entered = [registered_entrant(entrant, register) for entrant in entrants]
    existing(request.truth, "sealed truth")
    if len(entrants) == 1:
        [(look, notes)] = _looks(request, entered)
        blind = blind_score(look)
        files = {
            "report.html": blind_html(blind, notes),
            "roc.json": blind_roc_json(blind, notes),
        }
        write_score_files(request.output, files)
        return blind
    names = entrant_names(entrants)
    return _compare(request, dict(zip(names, _looks(request, entered), strict=True)))


def _looks(
    request: ScoreRequest, entered: Sequence[RegisteredEntrant]
) -> list[tuple[BlindLook, dict[str, Any]]]:
    """Look at a sealed truth once for each alarm list; return also what reports state of it."""
    # All lists are read before the passphrase is asked for and a look is entered.
    tables = [one.entrant.table() for one in entered]
    stated = []
    for number, (one, table) in enumerate(zip(entered, tables, strict=True)):
        card = request.card
        stated.append({} if card is None else card.notes(number, one.entrant))
        stated[-1] |= ranking_notes(table)

    phrase = request.trial.passphrase
    if callable(phrase):
        phrase = cache(phrase)  # it is asked for once, however many lists there are
    witness = request.trial.witness if request.trial.book is None else None
    sealed = content_hash(request.truth)
    looks = []
    for one, table, of_list in zip(entered, tables, stated, strict=True):
        look = match_blind(
            table, request.truth, phrase, registered=one.registration, witness=witness
        )
        notes = one.provenance()
        if len(entered) > 1:
            notes["looks"] = len(look.looks)
            notes |= {**look.heads, "sealed_sha256": sealed}
        else:
            notes |= {"sealed_sha256": sealed, **look.heads}
        looks.append((look, notes | of_list))
    return looks


def _compare(
    request: ScoreRequest, looks: Mapping[str, tuple[BlindLook, dict[str, Any]]]
) -> SideBySide:
    """Compare alarm lists by their looks at a truth, and write the page and the JSON."""
    matches = {name: look.matched for name, (look, _) in looks.items()}
    notes = {name: of_list for name, (_, of_list) in looks.items()}
    [sealed_rules, *_] = [look.rules for look, _ in looks.values()]
    rules = Rules(halo=sealed_rules["halo"], area=sealed_rules["area"])
    comparison = side_by_side(matches, FAR_GRID, rules, means=False)
    # Two digits, as a blind score has them: more would tell where targets lie.
    rounded_points = comparison.points.round({"chance": 2})
    comparison = dataclasses.replace(comparison, points=rounded_points)
    stated_rules = {
        "halo_radius": rules.halo,
        "area_rule": rules.area,
        "level": rules.level,
        "far_max": rules.far_max,
    }
    files = {
        "comparison.html": comparison_html(comparison, {}, stated_rules, notes),
        "comparison.json": comparison_json(comparison, stated_rules, notes),
    }
    write_score_files(request.output, files)
    return comparison


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


def holds_sealed_score(request: ScoreRequest, entrants: Sequence[Entrant]) -> bool:
    """Return, before anybody looks, whether the output has this very score of a sealed truth.

    Parameters
    ----------
    request : ScoreRequest
        The sealed truth, the register and the output.
    entrants : sequence of Entrant
        Alarm lists.

    Returns
    -------
    bool
        Whether it has; False where there is no score.

    Raises
    ------
    FileExistsError
        If the score there is another one, of other recipes in the register, or of another version.
    """
    is_comparison = len(entrants) > 1
    file = request.output / ("comparison.json" if is_comparison else "roc.json")
    if not os.path.lexists(file):
        return False

    sealed = content_hash(existing(request.truth, "sealed truth"))
    expected = []
    for entrant in entrants:
        recipe = "" if request.trial.book is None else str(recipe_of(entrant))
        expected.append((content_hash(entrant.data), sealed, recipe))
    try:
        report = parse_json(Folder(request.output).read(file.name, MOST_JSON))
        of_lists = report["notes"].values() if is_comparison else [report["notes"]]
        names = ("alarms_sha256", "sealed_sha256", "recipe_sha256")
        stated = [tuple(of_list.get(name, "") for name in names) for of_list in of_lists]
        is_same = sorted(stated) == sorted(expected) and report["flgpr"] == flgpr.__version__
    except (ValueError, KeyError, TypeError, AttributeError):
        is_same = False

    if not is_same:
        raise output_exists_error(file, f"{OVERWRITE}, or choose another output")
    log_finished(request.output, f"{OVERWRITE}, which is another look")
    return True
