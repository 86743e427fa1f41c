"""Registers of recipes, plans and openings.

A register demands that a recipe is entered before a truth is opened, and every opening is entered
there. See ``flgpr/trials/ledger.py`` for the file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from flgpr.door import MOST_JSON, DoorError, Folder, listed_files, read_named
from flgpr.json_text import parse_json
from flgpr.method.model import MODEL_FILE, read_model
from flgpr.recipe.schema import recipe_names, recipe_text
from flgpr.results.manifest import read_result_manifest
from flgpr.results.result import MODEL
from flgpr.results.sections import SECTIONS, read_sections, results_at
from flgpr.store.dialects import TableReading
from flgpr.store.files import existing
from flgpr.store.outputs import log_finished
from flgpr.store.tables import parse_own_table, parse_table
from flgpr.trials import (
    Registration,
    WitnessedRegister,
    check_head,
    content_hash,
    head_of,
    require_registered,
    require_truth,
)
from flgpr.trials.ledger import (
    OPENED,
    RegisterLike,
    before_opening,
    enter,
    read_checked_register,
    register_paths,
)

PathLike = str | Path
REGISTER_COLUMN = "book"
"""Column of a planned truth that names its register."""


@dataclass(frozen=True)
class Entrant:
    """An alarm list that is scored, and what it was made with, by hash; None where unknown."""

    path: Path  #: the list
    #: content of the list, read once: the bytes that are scored are the bytes that are hashed
    data: bytes = field(repr=False)
    recipe: str | None
    model: str | None = None
    of_result: bool = False  #: whether a result folder states the recipe, so that it is certain
    #: whether the user named a recipe, which demands a register
    recipe_was_named: bool = False
    reading: TableReading | None = None  #: columns of the list as the user names them

    def table(self) -> pd.DataFrame:
        """Return the alarms."""
        if self.of_result:
            return parse_own_table(self.data, "alarms", self.path)
        return parse_table(self.data, "alarms", self.path, self.reading)

    def provenance(self, line: Mapping[str, Any] | None) -> dict[str, Any]:
        """Return digests of list, recipe and model, with the time of the recipe's register line."""
        digests: dict[str, Any] = {"alarms_sha256": content_hash(self.data)}
        if line is None:
            return digests
        digests["recipe_sha256"] = self.recipe
        digests["recipe_registered"] = line["time"]
        digests["recipe_told_by"] = (
            "its result folder" if self.of_result else "whoever gave the list"
        )
        if self.model is not None:
            digests["model_sha256"] = self.model
        return digests


def find_entrant(
    alarms: PathLike, recipe: PathLike | None = None, reading: TableReading | None = None
) -> Entrant:
    """Find the alarm list of a file or a result folder, and the recipe and model it was made with.

    Parameters
    ----------
    alarms : path
        Alarm list (CSV), or result folder.
    recipe : path, optional
        Packaged recipe or file. A result states its recipe itself; this must be the same.
    reading : TableReading, optional
        Columns of a list that is not of a result.

    Returns
    -------
    Entrant
        List, recipe and model.

    Raises
    ------
    ValueError
        If the recipe is not that of the result, sections differ in theirs, or a list was changed.
    """
    path = Path(alarms)
    folder = path if path.is_dir() else path.parent
    is_result = any(Folder(folder).has(name) for name in ("manifest.json", SECTIONS))
    if is_result and (path.is_dir() or path.name == "alarms.csv"):
        return _entrant_of_result(folder, recipe)
    digest = None if recipe is None else recipe_hash(recipe).of_file
    data = read_named(existing(path, "alarms file"))
    return Entrant(path, data, digest, recipe_was_named=recipe is not None, reading=reading)


def _entrant_of_result(folder: Path, recipe: PathLike | None) -> Entrant:
    """Read the list of a result folder with the digests of its recipe and its model."""
    path = existing(folder / "alarms.csv", "alarms file")
    manifests = [read_result_manifest(result) for result in results_at(folder)]
    data = _listed_alarms(folder, manifests[0])

    recipes = {manifest["recipe_sha256"] for manifest in manifests}
    models = {manifest["files"].get(f"{MODEL}/{MODEL_FILE}") for manifest in manifests}
    if len(recipes) > 1 or len(models) > 1:
        raise ValueError(f"{folder} must be made by one recipe and model, got sections of several")
    [recipe_digest] = recipes
    [model_digest] = models

    if recipe is not None:
        # The result knows the text; the register may hold the file, with other ends of lines.
        hashes = recipe_hash(recipe)
        if recipe_digest not in hashes:
            raise ValueError(f"recipe must be the one that {folder} was made with, got {recipe}")
        recipe_digest = hashes.of_file
    return Entrant(
        path,
        data,
        recipe_digest,
        model_digest,
        of_result=True,
        recipe_was_named=recipe is not None,
    )


def _listed_alarms(folder: Path, manifest: Mapping[str, Any]) -> bytes:
    """Read the alarm list of a result, which must have the digest that the result states."""
    try:
        if Folder(folder).has(SECTIONS):
            return read_sections(folder).files.read("alarms.csv")
        return listed_files(folder, manifest).read("alarms.csv")
    except DoorError as error:
        raise ValueError(f"{error}: a changed list is scored under a name of its own") from None


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
    path = existing(register_paths(register)[0], "register")
    entry = {"event": "recipe", "recipe": recipe_hash(recipe).of_file}
    if model is not None:
        # The model is read, and so checked, before its hash is entered for good.
        existing(Path(model) / MODEL_FILE, "model")
        entry["model"] = content_hash(read_model(model))

    earlier = before_opening(read_checked_register(register))
    same = [line for line in earlier if _is_entry(line, entry)]
    if same:
        log_finished(f"recipe {recipe} in {path}", "a register only grows")
        return same[-1]

    def entry_unless_opened(lines: list[dict[str, Any]]) -> dict[str, Any]:
        count = len(before_opening(lines))
        if count < len(lines):
            raise ValueError(
                "recipe must be registered before the truth is opened; "
                f"line {count + 1} is an opening"
            )
        return entry

    return enter(register, entry_unless_opened)[-1]


def _is_entry(line: Mapping[str, Any], entry: Mapping[str, Any]) -> bool:
    """Return whether a line enters just this recipe and model."""
    return all(line.get(name) == entry.get(name) for name in ("event", "recipe", "model"))


def with_witness(register: PathLike, witness: PathLike | None) -> RegisterLike:
    """Return a register with its witness, if it has one."""
    if witness is None:
        return register
    return WitnessedRegister(Path(register), Path(witness))


def read_existing_register(register: RegisterLike) -> list[dict[str, Any]]:
    """Read a register, checked line by line and against its witness; it must exist."""
    existing(register_paths(register)[0], "register")
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
    path, _ = register_paths(register)
    kinds = _kinds_of(lines)
    heads = {}
    for report in reports:
        for head in _heads_in(report, kinds):
            check_head(lines, head, path, str(report))
            heads[report] = head
    return heads


def _kinds_of(lines: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the names under which a report refers to these lines.

    The log of a sealed truth holds looks alone. Without lines both are possible: all of them may be
    missing.
    """
    if not lines:
        return ["register", "log"]
    is_log = all("sealed" in line and line.get("event") in ("score", "open") for line in lines)
    return ["log"] if is_log else ["register"]


def _heads_in(report: PathLike, kinds: Sequence[str]) -> list[dict[str, Any]]:
    """List the heads of a register or log in a report, one for every alarm list.

    A report that states none is a ValueError.
    """
    try:
        provenance = parse_json(_report_bytes(Path(report)))["notes"]
        heads = list(_stated_heads(provenance, kinds))
        is_valid = bool(heads) and all(_is_head(head) for head in heads)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        is_valid = False
    if not is_valid:
        raise ValueError(
            "report must be the roc.json of a score that was made with a "
            f"{' or '.join(kinds)}, got {report}"
        )
    return heads


def _stated_heads(provenance: Mapping[str, Any], kinds: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the heads in the provenance of one alarm list, or in those of several by name."""
    of_lists = [value for value in provenance.values() if isinstance(value, dict)]
    for entry in [provenance, *of_lists]:
        for kind in kinds:
            head = entry.get(kind)
            if isinstance(head, dict):
                yield head


def _is_head(head: Mapping[str, Any]) -> bool:
    """Return whether a head has a count of lines and a hash."""
    lines = head["lines"]
    return type(lines) is int and lines >= 0 and isinstance(head["head"], str)


def _report_bytes(path: Path) -> bytes:
    """Read the JSON of a score, from a file or from a score's folder."""
    if not path.is_dir():
        return read_named(path, MOST_JSON)
    files = Folder(path)
    for name in ("roc.json", "comparison.json"):
        if files.has(name):
            return files.read(name)
    return files.read("roc.json")


def default_register(truth: PathLike, table: pd.DataFrame) -> Path | None:
    """Return the register that a truth names in its column, or that lies next to it.

    None if there is neither. Another name in every row is a ValueError, and so is a path.
    """
    path = Path(truth).resolve()
    if REGISTER_COLUMN not in table.columns:
        neighbour = path.with_name(f"{path.name}.register.jsonl")
        return neighbour if neighbour.is_file() else None
    names = {str(name) for name in table[REGISTER_COLUMN]}
    if len(names) > 1 or any(Path(name).name != name for name in names):
        raise ValueError(
            f"{truth}: {REGISTER_COLUMN} must be the name of one register in every row, "
            f"got {sorted(names)}"
        )
    return path.with_name(names.pop()) if names else None


def open_registered_truth(
    truth: PathLike,
    entrants: Sequence[Entrant],
    lanes: Mapping[str, Mapping[str, float]],
    rules: Mapping[str, float],
    register: RegisterLike | None = None,
    reading: TableReading | None = None,
) -> tuple[pd.DataFrame, list[dict[str, Any]]]:
    """Open a truth, once its register holds the recipes of all alarm lists that are scored.

    A planned truth has a register of its own, which must hold the plan, the lanes and the rules.
    Every opening is entered there. Without a register the truth is open to all.

    Parameters
    ----------
    truth : path
        Targets (CSV).
    entrants : sequence of Entrant
        Alarm lists.
    lanes : mapping
        Borders of each lane, m, by name.
    rules : mapping
        ``halo`` (m) and ``far`` (per m²) of the score.
    register : path or WitnessedRegister, optional
        Register in place of the truth's own.
    reading : TableReading, optional
        Columns of the truth.

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
    data = read_named(existing(truth, "truth file"))
    targets = parse_table(data, "truth", truth, reading)
    digest = content_hash(data)

    named_register = default_register(truth, targets)
    if register is None:
        register = named_register
    if register is None:
        if any(entrant.recipe_was_named for entrant in entrants):
            raise ValueError(
                f"recipe and book must be given together, got no book, and {truth} names none"
            )
        return targets, _provenance_of(entrants, [None] * len(entrants), digest)

    lines = _lines_of_entrants(entrants, register)
    path, _ = register_paths(register)
    require_truth(path, digest, lanes, rules, planned=named_register is not None)
    provenance = _provenance_of(entrants, lines, digest)

    for entrant, of_list in zip(entrants, provenance, strict=True):
        of_list["register"] = _enter_opening(register, entrant, of_list)
    return targets, provenance


def _provenance_of(
    entrants: Sequence[Entrant], lines: Sequence[Mapping[str, Any] | None], digest: str
) -> list[dict[str, Any]]:
    """Return the provenance of each list, with the digest of the truth."""
    provenance = []
    for entrant, line in zip(entrants, lines, strict=True):
        provenance.append({**entrant.provenance(line), "truth_sha256": digest})
    return provenance


def _lines_of_entrants(entrants: Sequence[Entrant], register: RegisterLike) -> list[dict[str, Any]]:
    """Return the lines of a register that enter the recipes of alarm lists, in their order."""
    registrations = [_registration_in(entrant, register) for entrant in entrants]
    path, _ = register_paths(register)
    read_checked_register(register)  # checks it line by line and against its witness
    lines = []
    for registration in registrations:
        lines.append(require_registered(path, registration.recipe, registration.model))
    return lines


def _enter_opening(
    register: RegisterLike, entrant: Entrant, provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """Enter the opening of a truth for an alarm list; return the head of the register."""
    opening = {
        "event": OPENED,
        "recipe": entrant.recipe,
        "alarms": provenance["alarms_sha256"],
        "truth": provenance["truth_sha256"],
    }
    return head_of(enter(register, lambda _: opening))


def check_registered(entrants: Sequence[Entrant], register: RegisterLike | None) -> None:
    """Refuse recipes that a register does not hold, before anybody types a passphrase."""
    for entrant in entrants:
        registration = registration_of(entrant, register)
        if registration is not None:
            read_checked_register(registration.register)
            path, _ = register_paths(registration.register)
            require_registered(path, registration.recipe, registration.model)


def registration_of(entrant: Entrant, register: RegisterLike | None) -> Registration | None:
    """Return what a register must hold for an alarm list; None without register and recipe.

    A recipe without a register, or a register without the list's recipe, is a ValueError.
    """
    if register is not None:
        return _registration_in(entrant, register)
    if entrant.recipe_was_named:
        raise ValueError("recipe and book must be given together, got no book")
    return None


def _registration_in(entrant: Entrant, register: RegisterLike) -> Registration:
    """Return what a register must hold for an alarm list, whose recipe must be known."""
    if entrant.recipe is None:
        raise ValueError(
            f"recipe and book must be given together, got no recipe for {entrant.path}"
        )
    existing(register_paths(register)[0], "register")
    return Registration(register, entrant.recipe, entrant.model)
