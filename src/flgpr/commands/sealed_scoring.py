"""Sealing a truth, and scoring against a sealed truth: files in, files out."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import pandas as pd

import flgpr
from flgpr import trials
from flgpr.commands.registering import (
    Entrant,
    check_registered,
    default_register,
    find_entrant,
    registration_of,
)
from flgpr.commands.score_output import write_score_files
from flgpr.commands.scoring import (
    borders,
    entrant_names,
    find_entrants,
    read_lanes,
    write_comparison,
)
from flgpr.commands.trial_card import TrialCard, ranking_notes
from flgpr.door import MOST_JSON, Folder, read_named, refuse_links
from flgpr.json_text import parse_json
from flgpr.report import blind_html
from flgpr.results.score import blind_roc_json
from flgpr.scoring import Rules, SideBySide, side_by_side
from flgpr.scoring.matching import LaneLike
from flgpr.store.dialects import TableReading
from flgpr.store.files import existing
from flgpr.store.outputs import OVERWRITE, atomic_output, log_finished, output_exists_error
from flgpr.store.tables import parse_table
from flgpr.trials import BlindScore, content_hash, require_truth
from flgpr.trials.blind import FAR_GRID, match_blind, score_blind
from flgpr.trials.ledger import RegisterLike, read_checked_register, register_paths
from flgpr.trials.sealing import Phrase, seal_truth, seals

PathLike = str | Path


def require_seal() -> None:
    """Refuse, before anybody types a passphrase, where a library for sealing is missing."""
    for library in ("cryptography", "zxcvbn"):
        if importlib.util.find_spec(library) is None:
            raise ModuleNotFoundError(
                f"sealed truth needs the library {library}: pip install 'flgpr[seal]'"
            )


def seal_truth_file(
    truth: PathLike,
    lane: PathLike,
    output: PathLike,
    passphrase: Phrase,
    *,
    halo: float = Rules.halo,
    area: Literal["union", "paper"] = "union",
    by: str | None = "kind",
    show: Literal["curve", "targets"] = "curve",
    register: RegisterLike | None = None,
) -> Path:
    """Encrypt a truth with its lane or lanes and rules for blind scoring.

    A planned truth is sealed with its register: scores then demand it, with the recipe in it.

    Parameters
    ----------
    truth : path
        Targets (CSV).
    lane : path
        Lane or lanes, see :func:`flgpr.commands.scoring.read_lanes`.
    output : path
        The sealed file.
    passphrase, halo, area, by, show
        As for :func:`flgpr.trials.seal_truth`; ``halo`` in m.
    register : path or WitnessedRegister, optional
        Register in place of the truth's own.

    Returns
    -------
    pathlib.Path
        The sealed file; one that seals just this with the same passphrase is left as it is.

    Raises
    ------
    ValueError
        If an input is not valid, or the register does not hold the plan.
    FileExistsError
        If another file is at the output.
    """
    data = read_named(existing(truth, "truth file"))
    table = parse_table(data, "truth", truth)
    lanes = read_lanes(lane)

    named_register = default_register(truth, table)
    if register is None:
        register = named_register
    bound_register = None
    if register is not None:
        is_planned = named_register is not None
        bound_register = _bound_register(register, data, lanes, halo, is_planned)

    rules: dict[str, Any] = {"halo": halo, "area": area, "by": by, "show": show}
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
    register: RegisterLike, truth: bytes, lanes: LaneLike, halo: float, is_planned: bool
) -> dict[str, Any]:
    """Return what a sealed file states of its register: the truth's digest and the last line."""
    path = existing(register_paths(register)[0], "register")
    lines = read_checked_register(register)
    digest = content_hash(truth)
    require_truth(path, digest, borders(lanes), {"halo": halo}, planned=is_planned)
    if not lines:
        raise ValueError(f"book must hold a plan or a recipe, got the empty {path}")
    return {"truth": digest, "line": lines[-1]["hash"]}


def _require_same_seal(
    path: Path,
    passphrase: Phrase,
    truth: pd.DataFrame,
    lanes: LaneLike,
    rules: Mapping[str, Any],
    bound_register: Mapping[str, Any] | None,
) -> None:
    """Refuse a file that does not seal this truth with these rules, passphrase and register."""
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
    digest = content_hash(path)
    if any(line.get("sealed") == digest for line in read_checked_register(register)):
        return
    truth = None if bound_register is None else bound_register["truth"]
    trials.register(register, event="sealed", truth=truth, sealed=digest)


def score_sealed(
    alarms: PathLike,
    sealed: PathLike,
    passphrase: Phrase,
    output: PathLike | None = None,
    log: PathLike | None = None,
    *,
    recipe: PathLike | None = None,
    register: RegisterLike | None = None,
    witness: PathLike | None = None,
    reading: TableReading | None = None,
    card: TrialCard | None = None,
) -> BlindScore:
    """Score an alarm list, or that of a result, against a sealed truth; no position is shown.

    Parameters
    ----------
    alarms : path
        Alarm list (CSV) or result folder.
    sealed : path
        Sealed truth.
    passphrase : str or callable
        Passphrase, or a function that asks for it.
    output : path, optional
        Folder of ``report.html`` and ``roc.json``.
    log : path, optional
        Log of all looks, by default beside the sealed file.
    recipe, register : optional
        As for :func:`flgpr.commands.scoring.score_alarms`; a truth that was sealed with a register
        demands them.
    witness : path, optional
        File elsewhere that must know the lines of the log.
    reading : TableReading, optional
        Whether the list may lack confidences.
    card : TrialCard, optional
        What the page states of the trial.

    Returns
    -------
    BlindScore
        Operating points and counts.

    Raises
    ------
    ValueError
        As :func:`flgpr.trials.score_blind`.
    """
    if output is not None:
        refuse_links(Path(output))
    entrant = find_entrant(alarms, recipe, reading)
    check_registered([entrant], register)

    path = existing(sealed, "sealed truth")
    # List and card are read before the passphrase is asked for and a look is entered.
    table = entrant.table()
    stated = _stated_notes(card, 0, entrant, table)
    registration = registration_of(entrant, register)
    blind = score_blind(table, path, passphrase, log, registration, witness)

    if output is not None:
        provenance = {
            **entrant.provenance(blind.registered),
            "sealed_sha256": content_hash(path),
            **blind.heads,
            **stated,
        }
        files = {
            "report.html": blind_html(blind, provenance),
            "roc.json": blind_roc_json(blind, provenance),
        }
        write_score_files(Path(output), files)
    return blind


def _stated_notes(
    card: TrialCard | None, number: int, entrant: Entrant, table: pd.DataFrame
) -> dict[str, str]:
    """Return what a page states of an alarm list: its card, and that it has no ranks."""
    of_card = {} if card is None else card.notes(number, entrant)
    return of_card | ranking_notes(table)


def compare_sealed(
    alarms: Sequence[PathLike],
    sealed: PathLike,
    passphrase: Phrase,
    output: PathLike,
    log: PathLike | None = None,
    *,
    recipes: Sequence[PathLike] = (),
    register: RegisterLike | None = None,
    witness: PathLike | None = None,
    reading: TableReading | None = None,
    card: TrialCard | None = None,
) -> SideBySide:
    """Compare alarm lists against a sealed truth; each of them is a look.

    Only points and counts of all targets are returned; the files are those of
    :func:`flgpr.commands.scoring.compare_alarms`.

    Parameters
    ----------
    alarms : sequence of path
        Alarm lists (CSV) or result folders.
    sealed : path
        Sealed truth.
    passphrase : str or callable
        Passphrase, or a function that asks for it.
    output : path
        Folder of the page and ``comparison.json``.
    log, witness, reading, card
        As for :func:`score_sealed`.
    recipes, register
        As for :func:`flgpr.commands.scoring.compare_alarms`.

    Returns
    -------
    SideBySide
        Points of each list and differences of every two.

    Raises
    ------
    ValueError
        As :func:`flgpr.trials.score_blind`.
    """
    entrants = find_entrants(alarms, recipes, reading)
    check_registered(entrants, register)
    path = existing(sealed, "sealed truth")
    names = entrant_names(entrants)
    # All lists are read before the passphrase is asked for and a look is entered.
    tables = [entrant.table() for entrant in entrants]
    stated = []
    for number, (entrant, table) in enumerate(zip(entrants, tables, strict=True)):
        stated.append(_stated_notes(card, number, entrant, table))
    phrase = passphrase() if callable(passphrase) else passphrase

    matches = {}
    provenance = {}
    lists = zip(names, entrants, tables, stated, strict=True)
    for name, entrant, table, notes in lists:
        registration = registration_of(entrant, register)
        blind_look = match_blind(
            table,
            path,
            phrase,
            log,
            registered=registration,
            witness=witness,
        )
        matches[name] = blind_look.matched
        provenance[name] = {
            **entrant.provenance(blind_look.line),
            "looks": len(blind_look.looks),
            **blind_look.heads,
            "sealed_sha256": content_hash(path),
            **notes,
        }
        sealed_rules = blind_look.rules

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
    write_comparison(output, comparison, {}, stated_rules, provenance)
    return comparison


def holds_sealed_score(
    alarms: Sequence[PathLike],
    sealed: PathLike,
    output: PathLike,
    recipes: Sequence[PathLike] = (),
    register: RegisterLike | None = None,
) -> bool:
    """Return, before anybody looks, whether a folder has this very score against a sealed truth.

    Parameters
    ----------
    alarms : sequence of path
        Alarm lists (CSV) or result folders.
    sealed : path
        Sealed truth.
    output : path
        The folder.
    recipes : sequence of path
        A recipe for each list, or none.
    register : path or WitnessedRegister, optional
        Register of the recipes.

    Returns
    -------
    bool
        Whether it has; False where there is no score.

    Raises
    ------
    FileExistsError
        If the score there is another one, of other recipes in the register, or of another version.
    """
    folder = Path(output)
    is_comparison = len(alarms) > 1
    name = "comparison.json" if is_comparison else "roc.json"
    file = folder / name
    if not os.path.lexists(file):
        return False

    entrants = find_entrants(alarms, recipes)
    digest = content_hash(existing(sealed, "sealed truth"))
    expected = sorted(_expected_digests(entrants, digest, with_recipe=register is not None))
    try:
        report = parse_json(Folder(folder).read(file.name, MOST_JSON))
        stated = sorted(_stated_digests(report["notes"], is_comparison))
        is_same = stated == expected and report["flgpr"] == flgpr.__version__
    except (ValueError, KeyError, TypeError, AttributeError):
        is_same = False

    if not is_same:
        raise output_exists_error(file, f"{OVERWRITE}, or choose another output")
    log_finished(folder, f"{OVERWRITE}, which is another look")
    return True


def _expected_digests(
    entrants: Sequence[Entrant], sealed: str, with_recipe: bool
) -> Iterator[tuple[str, str, str]]:
    """Yield the digests of list, sealed truth and recipe that a score of these lists states."""
    for entrant in entrants:
        recipe = str(entrant.recipe) if with_recipe else ""
        yield content_hash(entrant.path), sealed, recipe


def _stated_digests(
    provenance: Mapping[str, Any], is_comparison: bool
) -> Iterator[tuple[str, ...]]:
    """Yield the digests that a report states of each of its lists."""
    of_lists = list(provenance.values()) if is_comparison else [provenance]
    for entry in of_lists:
        yield entry["alarms_sha256"], entry["sealed_sha256"], entry.get("recipe_sha256", "")
