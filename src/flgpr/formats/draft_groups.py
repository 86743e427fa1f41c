"""The files of one measurement in groups: those that differ by numbers in their names, and the arrays they hold."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from flgpr.door import read_named
from flgpr.formats.arrays import LIMIT, ArrayFile, ArrayInfo, open_arrays

TABLES = (".csv", ".txt", ".tsv", ".dat")
"""Endings of tables, whose columns may hold text."""


@dataclass
class FileGroup:
    """Files that differ by numbers in their names alone, and what the first of them holds."""

    key: str  #: name in the mapping's table of files
    paths: list[Path]
    opened: ArrayFile
    texts: dict[str, list[str]] = field(
        default_factory=dict
    )  #: columns of text of a table, by name


@dataclass(frozen=True)
class ArraySource:
    """An array of a group."""

    group: FileGroup
    info: ArrayInfo

    @property
    def count(self) -> int:
        """How many values it has."""
        return math.prod(self.info.shape)

    def values(self) -> NDArray[Any]:
        """Return its values, those of the first file of the group."""
        return self.group.opened.read(self.info.name)

    def entry(self, unit: str | None = None) -> str:
        """Return the inline table (TOML) by which a mapping names it."""
        parts = [f"file = {json.dumps(self.group.key)}", f"variable = {json.dumps(self.info.name)}"]
        if unit is not None:
            parts.append(f'unit = "{unit}"')
        return "{" + ", ".join(parts) + "}"


def group_files(files: list[Path], limit: int) -> list[FileGroup]:
    """Put files together whose names differ by numbers alone and whose arrays are alike."""
    by_name: dict[tuple[str, str], list[Path]] = {}
    for path in files:
        by_name.setdefault((str(path.parent), re.sub(r"\d+", "*", path.name)), []).append(path)
    groups: list[FileGroup] = []
    for alike in by_name.values():
        alike.sort(key=lambda path: [int(part) for part in re.findall(r"\d+", path.name)])
        opened = open_arrays(alike[0], limit)
        for path in alike[1:]:
            names = list(open_arrays(path, limit).arrays)
            if names != list(opened.arrays):
                raise ValueError(
                    f"{path}: files of one kind must hold the same arrays, got {', '.join(names)} beside "
                    f"{', '.join(opened.arrays)} of {alike[0].name}"
                )
        texts = _text_columns(alike[0]) if alike[0].suffix.lower() in TABLES else {}
        groups.append(
            FileGroup(_key(alike[0], {group.key for group in groups}), alike, opened, texts)
        )
    return groups


def _key(path: Path, taken: set[str]) -> str:
    """Return a name for a file that TOML takes without quotes."""
    key = re.sub(r"\W+", "_", re.sub(r"\d+", "", path.stem), flags=re.ASCII).strip("_") or "file"
    while key in taken or key == "data":
        key += "_"
    return key


def _text_columns(path: Path) -> dict[str, list[str]]:
    """Return the columns of a table that hold text, such as which antenna is a transmitter, by their header."""
    text = read_named(path, LIMIT).decode("utf-8-sig", errors="replace")
    lines = [
        line
        for line in text.splitlines()
        if line.strip() and not line.lstrip().startswith(("#", "%"))
    ]
    if len(lines) < 2:
        return {}
    mark = next((mark for mark in ";\t," if mark in lines[0]), ",")
    rows = [row for row in csv.reader(io.StringIO("\n".join(lines)), delimiter=mark) if row]
    columns: dict[str, list[str]] = {}
    for number, name in enumerate(rows[0]):
        cells = [row[number].strip() if number < len(row) else "" for row in rows[1:]]
        if any(re.search(r"[A-Za-z]", cell) for cell in cells):
            columns[name.strip()] = cells
    return columns


def name_token(name: str, words: Collection[str]) -> str | None:
    """Return the word of a name that is one of ``words``; None if none is."""
    tokens = re.split(r"[_\W]+", name.lower())
    return next((token for token in tokens if token in words), None)
