"""Alarm lists that are scored, of any detector or of a result, and what is stated of their trial."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.door import DoorError, Folder, listed_files, read_named
from flgpr.method.model import MODEL_FILE
from flgpr.results.manifest import read_result_manifest
from flgpr.results.result import MODEL
from flgpr.results.sections import SECTIONS, read_sections, results_at
from flgpr.store import sha256
from flgpr.store.dialects import TableReading
from flgpr.store.files import existing
from flgpr.store.tables import parse_own_table, parse_table
from flgpr.types import PathLike

_HEAD_LINES = 50  # of an alarm list in which its comments are looked for
_HEAD_BYTES = 20_000
_LONGEST_VENDOR = 120  # characters
_VENDOR_COMMENT = re.compile(
    r"\s*#\s*(?:vendor|manufacturer|supplier|hersteller|fabricant)\s*[:=]\s*(?P<name>.+)",
    re.IGNORECASE,
)
UNRANKED = "none: the list has no confidences, so that all its alarms rank equal"


@dataclass(frozen=True)
class Entrant:
    """An alarm list that is scored, and what it was made with."""

    path: Path  #: the list
    #: content of the list, read once: the bytes that are scored are the bytes that are hashed
    data: bytes = field(repr=False)
    of_result: bool = False  #: whether it is the list of a result folder
    #: recipe, model: digests of what a result was made with; None for other lists
    recipe: str | None = None
    model: str | None = None
    named_recipe: PathLike | None = None  #: recipe that the user names, which demands a register
    reading: TableReading | None = None  #: columns of the list as the user names them

    def table(self) -> pd.DataFrame:
        """Return the alarms."""
        if self.of_result:
            return parse_own_table(self.data, "alarms", self.path)
        return parse_table(self.data, "alarms", self.path, self.reading)

    @property
    def file(self) -> str:
        """Name of the list, with its folder where it is a result's: all of these have one name."""
        folder = f"{self.path.resolve().parent.name}/" if self.of_result else ""
        return folder + self.path.name

    def digests(self) -> dict[str, Any]:
        """Return the digest of the list as reports state it."""
        return {"alarms_sha256": sha256(self.data)}


def find_entrants(
    lists: Sequence[PathLike], recipes: Sequence[PathLike] = (), reading: TableReading | None = None
) -> list[Entrant]:
    """Find alarm lists, in files or result folders, and what those of results were made with.

    Parameters
    ----------
    lists : sequence of path
        Alarm lists (CSV) or result folders.
    recipes : sequence of path
        A recipe for each list, packaged or a file; or none.
    reading : TableReading, optional
        Columns of lists that are not of a result.

    Returns
    -------
    list of Entrant
        An entrant for each list.

    Raises
    ------
    ValueError
        If there are recipes, but not one for each list, sections were made by several recipes, or
        the list of a result was changed.
    """
    if recipes and len(recipes) != len(lists):
        count = "1 list" if len(lists) == 1 else f"{len(lists)} lists"
        raise ValueError(
            f"recipe must be given once per alarm list, got {len(recipes)} for {count}"
        )
    entrants = []
    for path, recipe in zip_longest(map(Path, lists), recipes):
        folder = path if path.is_dir() else path.parent
        is_result = any(Folder(folder).has(name) for name in ("manifest.json", SECTIONS))
        if is_result and (path.is_dir() or path.name == "alarms.csv"):
            entrants.append(_entrant_of_result(folder, recipe))
            continue
        if path.is_dir():
            raise ValueError(
                f"a folder must be a result of `flgpr.detect`, got {path}; "
                "`flgpr.view` shows scores side by side"
            )
        data = read_named(existing(path, "alarms file"))
        entrants.append(Entrant(path, data, named_recipe=recipe, reading=reading))
    return entrants


def _entrant_of_result(folder: Path, named_recipe: PathLike | None) -> Entrant:
    """Read the list of a result folder with the digests of its recipe and its model."""
    path = existing(folder / "alarms.csv", "alarms file")
    manifests = [read_result_manifest(result) for result in results_at(folder)]
    data = _listed_alarms(folder, manifests[0])

    recipes = {manifest["recipe_sha256"] for manifest in manifests}
    models = {manifest["files"].get(f"{MODEL}/{MODEL_FILE}") for manifest in manifests}
    if len(recipes) > 1 or len(models) > 1:
        raise ValueError(f"{folder} must be made by one recipe and model, got sections of several")
    [recipe] = recipes
    [model] = models
    return Entrant(path, data, True, recipe, model, named_recipe)


def _listed_alarms(folder: Path, manifest: Mapping[str, Any]) -> bytes:
    """Read the alarm list of a result, which must have the digest that the result states."""
    try:
        if Folder(folder).has(SECTIONS):
            return read_sections(folder).files.read("alarms.csv")
        return listed_files(folder, manifest).read("alarms.csv")
    except DoorError as error:
        raise ValueError(f"{error}: a changed list is scored under a name of its own") from None


def entrant_names(entrants: Sequence[Entrant]) -> list[str]:
    """Name alarm lists by file or result folder, or by full paths where those are equal."""
    paths = [entrant.path for entrant in entrants]
    different_files = {path.resolve() for path in paths}
    if len(different_files) < len(paths):
        listed = ", ".join(map(str, paths))
        raise ValueError(f"alarms must be different lists to be compared, got {listed}")
    short_names = []
    for entrant in entrants:
        if entrant.of_result:
            short_names.append(entrant.path.parent.resolve().name)
        else:
            short_names.append(entrant.path.stem)
    if len(set(short_names)) == len(short_names):
        return short_names
    return [str(path) for path in paths]


@dataclass(frozen=True)
class TrialCard:
    """What the user states of a trial; a score without it is of no trial."""

    vendors: tuple[str, ...] = ()  #: one for each alarm list, or none
    scored_on: str = ""  #: day of the score, ISO 8601; empty where it is not to be stated

    def notes(self, number: int, entrant: Entrant) -> dict[str, str]:
        """Return what the report of an alarm list states: vendor, file, and the day of the score.

        Parameters
        ----------
        number : int
            Which of the lists.
        entrant : Entrant
            The list. Its own comment ``# vendor: NAME`` counts where no vendor was named.
        """
        vendor = self.vendors[number] if self.vendors else stated_vendor(entrant)
        notes = {"vendor": vendor or "not stated", "alarms_file": entrant.file}
        if self.scored_on:
            notes["scored_on"] = self.scored_on
        return notes


def checked_vendors(vendors: Sequence[str], lists: int) -> tuple[str, ...]:
    """Return the names of vendors, one for each alarm list, or none.

    A name that is empty, long or of several lines is a ValueError.
    """
    if vendors and len(vendors) != lists:
        raise ValueError(
            f"vendor must be given once per alarm list, got {len(vendors)} for {lists} lists"
        )
    return tuple(checked_name(name) for name in vendors)


def checked_name(name: str, what: str = "vendor") -> str:
    """Return the name of a vendor or a person without spaces around it; no name is a ValueError."""
    stripped = name.strip()
    if not stripped or len(stripped) > _LONGEST_VENDOR or not _is_one_line(stripped):
        raise ValueError(
            f"{what} must be a name of 1 to {_LONGEST_VENDOR} characters in one line, got {name!r}"
        )
    return stripped


def _is_one_line(text: str) -> bool:
    """Return whether a text has no control characters and no marks that change its direction."""
    return all(unicodedata.category(letter) not in ("Cc", "Cf", "Zl", "Zp") for letter in text)


def stated_vendor(entrant: Entrant) -> str:
    """Return the vendor that a comment at the head of an alarm list names; "" if none does.

    Such a comment is ``# vendor: NAME``. A list of a result has no comments.
    """
    head = entrant.data[:_HEAD_BYTES].decode("utf-8-sig", errors="replace")
    for line in head.splitlines()[:_HEAD_LINES]:
        if line.strip() and not line.lstrip().startswith("#"):
            return ""
        comment = _VENDOR_COMMENT.fullmatch(line)
        if comment is not None:
            return checked_name(comment["name"].rstrip(",;\t "))
    return ""


def ranking_notes(alarms: pd.DataFrame) -> dict[str, str]:
    """Return a note that an alarm list has no ranks, for its report; none where it has."""
    return {"ranking": UNRANKED} if alarms.attrs.get("unranked") else {}


def day_of_score(folder: Path, report: str, overwrite: bool) -> str:
    """Return the day that a score states: today (UTC), or that of the score that is there already.

    The same score made on a later day is then the same to the byte, and nothing is written.

    Parameters
    ----------
    folder : Path
        Where the score is written.
    report : str
        Its JSON, "roc.json" or "comparison.json".
    overwrite : bool
        Whether the score is made anew.

    Returns
    -------
    str
        The day, ISO 8601.
    """
    today = datetime.now(UTC).date().isoformat()
    if overwrite or not (folder / report).is_file():
        return today
    try:
        notes = Folder(folder).json(report)["notes"]
        stated = [
            of_list["scored_on"] for of_list in notes_of_lists(notes) if "scored_on" in of_list
        ]
        return datetime.strptime([*stated, today][0], "%Y-%m-%d").date().isoformat()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return today


def notes_of_lists(notes: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the notes of a report's one alarm list, or those of several, which stand by name."""
    return [notes, *(value for value in notes.values() if isinstance(value, dict))]
