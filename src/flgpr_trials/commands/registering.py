"""Registers of recipes, plans and openings.

A register demands that a recipe is entered before a truth is opened, and every opening is entered
there. See ``flgpr_trials/ledger.py`` for the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pandas as pd

from flgpr.commands.entrants import Entrant
from flgpr.commands.score_request import ScoreRequest
from flgpr.commands.trial_card import notes_of_lists
from flgpr.commands.trials import REGISTER_COLUMN
from flgpr.door import MOST_JSON, Folder, read_named
from flgpr.json_text import parse_json
from flgpr.method.model import MODEL_FILE, read_model
from flgpr.recipe.schema import recipe_names, recipe_text
from flgpr.store.files import existing
from flgpr.store.outputs import log_finished
from flgpr.store.tables import parse_table
from flgpr_trials.blind import Registration
from flgpr_trials.folder import trial_register
from flgpr_trials.ledger import (
    RegisterLike,
    WitnessedRegister,
    before_opening,
    check_head,
    content_hash,
    enter_opening,
    enter_unopened,
    read_checked_register,
    require_registered,
    require_truth,
)

PathLike = str | Path
R = TypeVar("R", bound=PathLike | None)


class RecipeHashes(NamedTuple):
    """Digests of a recipe."""

    of_file: str  #: of its bytes
    of_text: str  #: of its text as results store it, with line feeds alone at ends of lines


def recipe_hash(recipe: PathLike) -> RecipeHashes:
    """Return the digests of a packaged recipe, or of any file that fixes a detector."""
    if not Path(recipe).exists() and str(recipe) in recipe_names():
        digest = content_hash(recipe_text(str(recipe)))
        return RecipeHashes(digest, digest)
    if Path(recipe).is_dir():
        raise ValueError(
            f"recipe must be a file or a packaged recipe, got the folder {recipe}; is it a model?"
        )
    data = read_named(existing(recipe, "recipe file"))
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return RecipeHashes(content_hash(data), content_hash(text))


def enter_recipe(
    recipe: PathLike, register: RegisterLike, model: PathLike | None = None
) -> dict[str, Any]:
    """Enter a recipe, and the model that it is run with, into a register.

    Parameters
    ----------
    recipe : path
        Packaged recipe, or any file that fixes a detector.
    register : path or WitnessedRegister
        The register.
    model : path, optional
        Folder that ``flgpr train`` wrote.

    Returns
    -------
    dict
        The new line, or the one that enters this recipe and model already.

    Raises
    ------
    ValueError
        If a truth was opened under the register, so that it is too late.
    FileNotFoundError
        If the register, the recipe or the model is missing.
    """
    path = existing(Path(register), "register")
    entry = {"event": "recipe", "recipe": recipe_hash(recipe).of_file}
    if model is not None:
        # The model is read, and so checked, before its hash is entered for good.
        existing(Path(model) / MODEL_FILE, "model")
        entry["model"] = content_hash(read_model(model))

    earlier = before_opening(read_checked_register(register))
    for line in reversed(earlier):
        if all(line.get(name) == entry.get(name) for name in ("event", "recipe", "model")):
            log_finished(f"{recipe} in {path}", "a register only grows")
            return line
    opening = len(earlier) + 1
    too_late = (
        "what fixes the detector must be registered before the truth is opened; "
        f"line {opening} is an opening"
    )
    return enter_unopened(register, entry, too_late)


def with_witness(register: R, witness: PathLike | None) -> R | WitnessedRegister:
    """Return a register with its witness, if it has one; None where the user names no register."""
    if register is None or witness is None:
        return register
    return WitnessedRegister(Path(register), Path(witness))


def read_existing_register(register: RegisterLike) -> list[dict[str, Any]]:
    """Read a register, checked line by line and against its witness; it must exist."""
    existing(Path(register), "register")
    return read_checked_register(register)


def heads_of_reports(
    lines: Sequence[dict[str, Any]], register: RegisterLike, reports: Sequence[PathLike]
) -> dict[PathLike, dict[str, Any]]:
    """Return how many lines of a register each report of a score knows, and the last one's hash.

    Parameters
    ----------
    lines : sequence of dict
        The register's lines.
    register : path or WitnessedRegister
        The register, for errors.
    reports : sequence of path
        ``roc.json`` or ``comparison.json`` of scores, or their folders.

    Returns
    -------
    dict of path to dict
        ``lines`` and ``head`` by report.

    Raises
    ------
    ValueError
        If a report knows a line that the register lacks.
    """
    path = Path(register)
    # The log of a sealed truth holds looks alone. Without lines it may be either.
    is_log = all("sealed" in line and line.get("event") in ("score", "open") for line in lines)
    kinds = ["log"] if is_log else ["register"]
    if not lines:
        kinds = ["register", "log"]
    heads = {}
    for report in reports:
        for head in _heads_in(report, kinds):
            check_head(lines, head, path, str(report))
            heads[report] = head
    return heads


def _heads_in(report: PathLike, kinds: Sequence[str]) -> list[dict[str, Any]]:
    """List the heads of a register or log in a report, one for every alarm list.

    A report that states none is a ValueError.
    """
    path = Path(report)
    try:
        if path.is_dir():
            files = Folder(path)
            name = "roc.json" if files.has("roc.json") else "comparison.json"
            data = files.read(name)
        else:
            data = read_named(path, MOST_JSON)
        stated = [
            of_list.get(kind)
            for of_list in notes_of_lists(parse_json(data)["notes"])
            for kind in kinds
        ]
        heads = [head for head in stated if isinstance(head, dict)]
        is_valid = bool(heads)
        for head in heads:
            is_count = type(head["lines"]) is int and head["lines"] >= 0
            is_valid &= is_count and isinstance(head["head"], str)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        is_valid = False
    if not is_valid:
        raise ValueError(
            "report must be the roc.json of a score that was made with a "
            f"{' or '.join(kinds)}, got {report}"
        )
    return heads


def default_register(truth: PathLike, table: pd.DataFrame) -> Path | None:
    """Return the register that a truth names, that lies next to it, or that is its trial's.

    None if there is none of these. Another name in every row is a ValueError, and so is a path.
    """
    path = Path(truth).resolve()
    if REGISTER_COLUMN not in table.columns:
        neighbour = path.with_name(f"{path.name}.register.jsonl")
        return neighbour if neighbour.is_file() else trial_register(path)
    names = {str(name) for name in table[REGISTER_COLUMN]}
    if len(names) > 1 or any(Path(name).name != name for name in names):
        raise ValueError(
            f"{truth}: {REGISTER_COLUMN} must be the name of one register in every row, "
            f"got {sorted(names)}"
        )
    return path.with_name(names.pop()) if names else None


def open_truth(
    request: ScoreRequest,
    entrants: Sequence[Entrant],
    lanes: Mapping[str, Mapping[str, float]],
    rules: Mapping[str, float],
) -> tuple[pd.DataFrame, list[dict[str, Any]]]:
    """Open a truth, once its register holds the recipes of all alarm lists that are scored.

    A planned truth has a register of its own, which must hold the plan, the lanes and the rules.
    Every opening is entered there. Without a register the truth is open to all.

    Parameters
    ----------
    request : ScoreRequest
        The truth (CSV) and its columns, and a register in place of the truth's own.
    entrants : sequence of Entrant
        Alarm lists.
    lanes : mapping
        Borders of each lane, m, by name.
    rules : mapping
        ``halo`` (m) and ``far`` (per m²) of the score.

    Returns
    -------
    targets : pandas.DataFrame
        The truth.
    provenance : list of dict
        Provenance of each list, for the report.

    Raises
    ------
    ValueError
        If a recipe is named without a register, or the register does not hold what it must.
    """
    data = read_named(existing(request.truth, "truth file"))
    targets = parse_table(data, "truth", request.truth, request.truth_reading)
    digest = content_hash(data)
    own_register = default_register(request.truth, targets)
    register = with_witness(request.trial.book, request.trial.witness) or own_register
    if register is None and any(entrant.named_recipe for entrant in entrants):
        raise ValueError(
            f"`recipe` needs a register: {request.truth} names none, give it by `book`"
        )

    provenance = []
    for entrant in entrants:
        _, of_list = registered_entrant(entrant, register)
        provenance.append(of_list | {"truth_sha256": digest})
    if register is not None:
        path = Path(register)
        require_truth(path, digest, lanes, rules, planned=own_register is not None)
        for of_list in provenance:
            opening = {
                "recipe": of_list["recipe_sha256"],
                "alarms": of_list["alarms_sha256"],
                "truth": digest,
            }
            of_list["register"] = enter_opening(register, opening)
    return targets, provenance


def registered_entrant(
    entrant: Entrant, register: RegisterLike | None
) -> tuple[Registration | None, dict[str, Any]]:
    """Find the recipe of an alarm list in a register, before anybody opens a truth.

    Parameters
    ----------
    entrant : Entrant
        The list.
    register : path or WitnessedRegister, optional
        The register.

    Returns
    -------
    registration : Registration or None
        None where there is neither a register nor a recipe that the user names.
    provenance : dict
        Digests of list, recipe and model, with the time of the recipe's register line.

    Raises
    ------
    ValueError
        If only one of both is there, or the register does not hold the recipe.
    FileNotFoundError
        If the register is missing.
    """
    provenance = entrant.digests()
    if register is None:
        if entrant.named_recipe is not None:
            raise ValueError("`recipe` needs a register: give it by `book`")
        return None, provenance
    recipe = recipe_of(entrant)
    path = Path(register)
    if recipe is None:
        raise ValueError(
            f"the detector of {entrant.path} must stand in the register {path}: "
            "name what fixes it by `recipe`"
        )
    read_existing_register(register)
    provenance["recipe_sha256"] = recipe
    provenance["recipe_registered"] = require_registered(path, recipe, entrant.model)["time"]
    provenance["recipe_told_by"] = (
        "its result folder" if entrant.of_result else "whoever gave the list"
    )
    if entrant.model is not None:
        provenance["model_sha256"] = entrant.model
    return Registration(register, recipe, entrant.model), provenance


def recipe_of(entrant: Entrant) -> str | None:
    """Return the digest of the recipe that an alarm list was made with; None if nobody names one.

    A result states its recipe itself; one that the user names must be the same, or it is a
    ValueError.
    """
    if entrant.named_recipe is None:
        return entrant.recipe
    # The result knows the text; the register may hold the file, with other ends of lines.
    hashes = recipe_hash(entrant.named_recipe)
    if entrant.of_result and entrant.recipe not in hashes:
        raise ValueError(
            f"recipe must be the one that {entrant.path.parent} was made with, "
            f"got {entrant.named_recipe}"
        )
    return hashes.of_file
