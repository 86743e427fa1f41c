"""Registers of recipes, plans and openings: what one demands before a truth is looked at, and what is entered there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.chain.model import MODEL_FILE, read_model
from flgpr.chain.recipe import recipe_names, recipe_text
from flgpr.door import MOST_JSON, DoorError, Folder, parse_json, read_named
from flgpr.execution.finished import results_at
from flgpr.results.result import MODEL, read_result_manifest
from flgpr.results.sections import SECTIONS, read_sections
from flgpr.store.dialects import TableReading
from flgpr.store.files import existing, listed_files
from flgpr.store.outputs import tell_finished
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
from flgpr.trials.ledger import OPENED, Book, before_opening, enter, parts_of, read_book

PathLike = str | Path
BOOK = "book"
"""Column of a planned truth that names its register."""


@dataclass(frozen=True)
class Entrant:
    """An alarm list, and what it was made with, by hash; None where that is not known."""

    path: Path  #: the list
    data: bytes = field(repr=False)  #: what it holds, read once: what is scored is what is hashed
    recipe: str | None
    model: str | None = None
    #: whether a result folder tells the recipe, and nobody has to be believed
    of_result: bool = False
    named: bool = False  #: whether a recipe was named, which asks for a register
    reading: TableReading | None = None  #: what the user says of the list's columns

    def table(self) -> pd.DataFrame:
        """Give the alarms."""
        if self.of_result:
            return parse_own_table(self.data, "alarms", self.path)
        return parse_table(self.data, "alarms", self.path, self.reading)

    def notes(self, line: Mapping[str, Any] | None) -> dict[str, Any]:
        """Tell of what was scored: its digest, and the recipe with the line of the register."""
        told: dict[str, Any] = {"alarms_sha256": content_hash(self.data)}
        if line is not None:
            how = "its result folder" if self.of_result else "whoever gave the list"
            told |= {
                "recipe_sha256": self.recipe,
                "recipe_registered": line["time"],
                "recipe_told_by": how,
            }
        return told | (
            {"model_sha256": self.model} if line is not None and self.model is not None else {}
        )


def find_entrant(
    alarms: PathLike, recipe: PathLike | None = None, reading: TableReading | None = None
) -> Entrant:
    """Find the alarm list of a file or a result folder, and what it was made with.

    A result tells its recipe and its model by itself; a ``recipe`` that is given must be that one, else that is a
    ValueError. ``reading`` is of lists that are no result's.
    """
    path = Path(alarms)
    home = path if path.is_dir() else path.parent
    marks = {name for name in ("manifest.json", SECTIONS) if Folder(home).has(name)}
    if not marks or (path.is_file() and path.name != "alarms.csv"):
        mark = None if recipe is None else recipe_hash(recipe)[0]
        data = read_named(existing(path, "alarms file"))
        return Entrant(path, data, mark, named=recipe is not None, reading=reading)
    path = existing(home / "alarms.csv", "alarms file")
    manifests = [read_result_manifest(one) for one in results_at(home)]
    try:
        files = read_sections(home).files if SECTIONS in marks else listed_files(home, manifests[0])
        data = files.read("alarms.csv")
    except DoorError as error:
        raise ValueError(f"{error}: a changed list is scored under a name of its own") from None
    recipes = {one["recipe_sha256"] for one in manifests}
    models = {one["files"].get(f"{MODEL}/{MODEL_FILE}") for one in manifests}
    given = set(recipe_hash(recipe)) if recipe is not None else recipes
    if len(recipes) > 1 or len(models) > 1:
        raise ValueError(f"{home} must be made by one recipe and model, got sections of several")
    if not recipes <= given:
        raise ValueError(f"recipe must be the one that {home} was made with, got {recipe}")
    return Entrant(
        path,
        data,
        recipe_hash(recipe)[0] if recipe is not None else recipes.pop(),
        models.pop(),
        True,
        recipe is not None,
    )


def recipe_hash(recipe: PathLike) -> tuple[str, str]:
    """Hash a packaged recipe or any file that stands for one: its bytes, and its text as results keep it."""
    if not Path(recipe).exists() and str(recipe) in recipe_names():
        return (content_hash(recipe_text(str(recipe))),) * 2
    if Path(recipe).is_dir():
        raise ValueError(
            f"recipe must be a file or a packaged recipe, got the folder {recipe}; is it a model?"
        )
    path = existing(recipe, "recipe file")
    data = read_named(path)
    return content_hash(data), content_hash(data.replace(b"\r\n", b"\n").replace(b"\r", b"\n"))


def enter_recipe(recipe: PathLike, book: Book, model: PathLike | None = None) -> dict[str, Any]:
    """Enter a recipe, and the model that it is run with, into a register; give the line, or that where it stands.

    ``recipe`` is a packaged recipe or any file that fixes a detector, ``model`` a folder that ``flgpr train`` wrote. If
    the register is missing, or a truth was opened under it, so that it is too late, that is a ValueError or a
    FileNotFoundError.
    """
    existing(parts_of(book)[0], "register")
    entry = {"event": "recipe", "recipe": recipe_hash(recipe)[0]}
    if model is not None:
        existing(Path(model) / MODEL_FILE, "model")
        entry["model"] = content_hash(read_model(model))

    known = [line for line in before_opening(read_book(book)) if _is_entry(line, entry)]
    if known:
        tell_finished(f"recipe {recipe} in {parts_of(book)[0]}", "a register only grows")
        return known[-1]

    def unless_opened(lines: list[dict[str, Any]]) -> dict[str, Any]:
        early = before_opening(lines)
        if len(early) < len(lines):
            raise ValueError(
                f"recipe must be registered before the truth is opened, which line {len(early) + 1} tells"
            )
        return entry

    return enter(book, unless_opened)[-1]


def _is_entry(line: Mapping[str, Any], entry: Mapping[str, Any]) -> bool:
    """Tell whether a line enters just this recipe and model."""
    return all(line.get(name) == entry.get(name) for name in ("event", "recipe", "model"))


def with_witness(book: PathLike, witness: PathLike | None) -> Book:
    """Return a register with its witness, if it has one."""
    return book if witness is None else WitnessedRegister(Path(book), Path(witness))


def read_whole_register(book: Book) -> list[dict[str, Any]]:
    """Read a register, checked line by line and against its witness; one that is missing is an error."""
    existing(parts_of(book)[0], "register")
    return read_book(book)


def heads_of_reports(
    lines: Sequence[dict[str, Any]], book: Book, reports: Sequence[PathLike]
) -> dict[PathLike, dict[str, Any]]:
    """Return how many lines each report of a score knows of a register, and the last one's hash.

    ``reports`` are ``roc.json`` or ``comparison.json`` of scores, or their folders. A line that a
    report knows and the register lacks is a ValueError.
    """
    path, _ = parts_of(book)
    heads = {}
    for report in reports:
        for head in _heads_in(report, _kinds_of(lines)):
            check_head(lines, head, path, str(report))
            heads[report] = head
    return heads


def _kinds_of(lines: Sequence[Mapping[str, Any]]) -> list[str]:
    """Tell under which names a report speaks of these lines: the log of a sealed truth holds looks alone."""
    if not lines:
        return ["register", "log"]  # all of them may be missing
    looks = all("sealed" in line and line.get("event") in ("score", "open") for line in lines)
    return ["log"] if looks else ["register"]


def _heads_in(report: PathLike, kinds: Sequence[str]) -> list[dict[str, Any]]:
    """List what a report tells of a register or log, once for every alarm list; a ValueError where it tells nothing."""
    place = Path(report)
    try:
        notes = parse_json(_report_bytes(place))["notes"]
        told = [notes, *(one for one in notes.values() if isinstance(one, dict))]
        heads = [one[kind] for one in told for kind in kinds if isinstance(one.get(kind), dict)]
        known = bool(heads) and all(
            type(one["lines"]) is int and one["lines"] >= 0 and isinstance(one["head"], str)
            for one in heads
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        known = False
    if not known:
        raise ValueError(
            f"report must be the roc.json of a score that was made with a {' or '.join(kinds)}, got {report}"
        )
    return heads


def _report_bytes(place: Path) -> bytes:
    """Read the JSON of a score: a file that was named, or that of a score's folder."""
    if not place.is_dir():
        return read_named(place, MOST_JSON)
    files = Folder(place)
    return files.read(
        next((name for name in ("roc.json", "comparison.json") if files.has(name)), "roc.json")
    )


def own_book(truth: PathLike, table: pd.DataFrame) -> Path | None:
    """Find the register that a truth names in its column, or that lies beside it; None if there is none."""
    real = Path(truth).resolve()
    if BOOK in table.columns:
        names = {str(name) for name in table[BOOK]}
        if len(names) > 1 or any(Path(name).name != name for name in names):
            raise ValueError(
                f"{truth}: {BOOK} must be the name of one register in every row, got {sorted(names)}"
            )
        return real.with_name(names.pop()) if names else None
    beside = real.with_name(f"{real.name}.register.jsonl")
    return beside if beside.is_file() else None


def open_truth(
    truth: PathLike,
    entrants: Sequence[Entrant],
    lanes: Mapping[str, Mapping[str, float]],
    rules: Mapping[str, float],
    book: Book | None = None,
    reading: TableReading | None = None,
) -> tuple[pd.DataFrame, list[dict[str, Any]]]:
    """Give a truth, once its register holds the recipes of all that enter, with notes on each of them.

    A truth that was planned has a register of its own, which must tell of it, of the lanes and of the rules. Every
    opening is entered there. Without a register the truth is open to all.
    """
    data = read_named(existing(truth, "truth file"))
    targets = parse_table(data, "truth", truth, reading)
    digest = content_hash(data)
    own = own_book(truth, targets)
    book = own if book is None else book
    if book is None:
        if any(one.named for one in entrants):
            raise ValueError(
                f"recipe and book must be given together, got no book, and {truth} names none"
            )
        return targets, [one.notes(None) | {"truth_sha256": digest} for one in entrants]
    asked = [registration(one, book) for one in entrants]
    path, _ = parts_of(book)
    read_book(book)
    lines = [require_registered(path, one.recipe, one.model) for one in asked if one is not None]
    require_truth(path, digest, lanes, rules, planned=own is not None)
    notes = [
        one.notes(line) | {"truth_sha256": digest}
        for one, line in zip(entrants, lines, strict=True)
    ]
    for one, note in zip(entrants, notes, strict=True):
        opening = {
            "event": OPENED,
            "recipe": one.recipe,
            "alarms": note["alarms_sha256"],
            "truth": digest,
        }
        note["register"] = head_of(enter(book, lambda _, opening=opening: opening))  # type: ignore[misc]
    return targets, notes


def check_registered(entrants: Sequence[Entrant], book: Book | None) -> None:
    """Refuse what a register does not hold before anybody types a passphrase."""
    for one in entrants:
        if (asked := registration(one, book)) is not None:
            read_book(asked.book)
            require_registered(parts_of(asked.book)[0], asked.recipe, asked.model)


def registration(one: Entrant, book: Book | None) -> Registration | None:
    """Say what must stand in the register for an alarm list; None where neither register nor recipe is named."""
    if book is None:
        if one.named:
            raise ValueError("recipe and book must be given together, got no book")
        return None
    if one.recipe is None:
        raise ValueError(f"recipe and book must be given together, got no recipe for {one.path}")
    existing(parts_of(book)[0], "register")
    return Registration(book, one.recipe, one.model)
