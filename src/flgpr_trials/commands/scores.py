"""What ``flgpr score`` and ``flgpr compare`` ask of a trial, and the registers of recipes and openings.

The entry point of the group "flgpr.trials" names this module, see :mod:`flgpr.commands.trials`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pandas as pd
import typer

import flgpr
from flgpr.commands.entrants import Entrant, find_entrants, notes_of_lists, ranking_notes
from flgpr.commands.messages import say
from flgpr.commands.score_output import write_score_files
from flgpr.commands.score_request import ScoreRequest
from flgpr.commands.trials import REGISTER_COLUMN
from flgpr.door import MOST_JSON, Folder, read_named, refuse_links
from flgpr.json_text import parse_json
from flgpr.method.model import MODEL_FILE, read_model
from flgpr.recipe.schema import recipe_names, recipe_text
from flgpr.results.score import detections_json
from flgpr.store.files import existing
from flgpr.store.outputs import OVERWRITE, log_finished, output_exists_error
from flgpr.store.tables import parse_table
from flgpr.types import Entries, PathLike
from flgpr_trials.blind import BlindScore, Registration, blind_score, match_blind
from flgpr_trials.commands.seal import ask_new_passphrase, seal
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
from flgpr_trials.pages import blind_html
from flgpr_trials.sealing import require_seal

__all__ = ["ask_new_passphrase", "ask_passphrase", "lines", "open_truth", "score_sealed", "seal"]

_BEFORE_OPENING = (
    "The passphrase is the one that this truth was sealed with. Nothing is shown while you type. "
    "A right one makes this score a look at the truth, which is counted in its log for good; a "
    "wrong one changes nothing."
)
R = TypeVar("R", bound="str | Path | None")


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
        report = Folder(request.output).json(file.name)
        stated = {name: report["notes"].get(name, "") for name in expected}
        is_same = stated == expected and report["flgpr"] == flgpr.__version__
    except (ValueError, KeyError, TypeError, AttributeError):
        is_same = False

    if not is_same:
        raise output_exists_error(file, f"{OVERWRITE}, or choose another output")
    log_finished(request.output, f"{OVERWRITE}, which is another look")
    return True


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
) -> Entries:
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
    if Path(register).resolve() == Path(witness).resolve():
        raise ValueError(f"witness must be another file than the register, got {witness}")
    return WitnessedRegister(Path(register), Path(witness))


def read_existing_register(register: RegisterLike) -> list[Entries]:
    """Read a register, checked line by line and against its witness; it must exist."""
    existing(Path(register), "register")
    return read_checked_register(register)


def heads_of_reports(
    lines: Sequence[Entries], register: RegisterLike, reports: Sequence[PathLike]
) -> dict[PathLike, Entries]:
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


def _heads_in(report: PathLike, kinds: Sequence[str]) -> list[Entries]:
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
) -> tuple[pd.DataFrame, list[Entries]]:
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
) -> tuple[Registration | None, Entries]:
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
