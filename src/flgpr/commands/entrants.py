"""Alarm lists that are scored: those of any detector, and those of result folders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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

PathLike = str | Path


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
