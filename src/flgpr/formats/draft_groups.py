"""The files of one measurement in groups of files that differ by numbers in their names alone."""

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
from flgpr.formats.array_file import LIMIT, ArrayFile, ArrayInfo
from flgpr.formats.arrays import open_arrays

TABLES = (".csv", ".txt", ".tsv", ".dat")
"""Endings of tables, whose columns may hold text."""


@dataclass
class FileGroup:
    """Files that differ by numbers in their names alone, and what the first of them holds."""

    key: str  #: name in the mapping's table of files
    paths: list[Path]
    opened: ArrayFile
    #: columns of text of a table, by name
    texts: dict[str, list[str]] = field(default_factory=dict)


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
        cells = [f"file = {json.dumps(self.group.key)}", f"variable = {json.dumps(self.info.name)}"]
        if unit is not None:
            cells.append(f'unit = "{unit}"')
        return "{" + ", ".join(cells) + "}"


def group_files(files: list[Path], limit: int) -> list[FileGroup]:
    """Group files whose names differ by numbers alone.

    Parameters
    ----------
    files : list of Path
        The files.
    limit : int
        Bytes that a file and an array may take.

    Returns
    -------
    list of FileGroup
        The groups, in the order of their first files.

    Raises
    ------
    ValueError
        If a file cannot be read, or the files of a group hold different arrays.
    """
    by_name: dict[tuple[str, str], list[Path]] = {}
    for path in files:
        pattern = re.sub(r"\d+", "*", path.name)
        by_name.setdefault((str(path.parent), pattern), []).append(path)
    groups: list[FileGroup] = []
    for paths in by_name.values():
        paths.sort(key=_numbers_in)
        first, *others = paths
        opened = open_arrays(first, limit)
        expected = list(opened.arrays)
        for path in others:
            names = list(open_arrays(path, limit).arrays)
            if names != expected:
                raise ValueError(
                    f"{path}: files of one kind must hold the same arrays, got {', '.join(names)} "
                    f"beside {', '.join(expected)} of {first.name}"
                )
        texts = _text_columns(first) if first.suffix.lower() in TABLES else {}
        key = _key(first, {group.key for group in groups})
        groups.append(FileGroup(key, paths, opened, texts))
    return groups


def _numbers_in(path: Path) -> list[int]:
    """Return the numbers in the name of a file."""
    return [int(digits) for digits in re.findall(r"\d+", path.name)]


def _key(path: Path, taken: set[str]) -> str:
    """Return a name for a file that TOML takes without quotes."""
    stem = re.sub(r"\d+", "", path.stem)
    key = re.sub(r"\W+", "_", stem, flags=re.ASCII).strip("_") or "file"
    while key in taken or key == "data":
        key += "_"
    return key


def _text_columns(path: Path) -> dict[str, list[str]]:
    """Return the columns of a table that hold text, such as the kind of an antenna, by header."""
    text = read_named(path, LIMIT).decode("utf-8-sig", errors="replace")
    lines = []
    for line in text.splitlines():
        if line.strip() and not line.lstrip().startswith(("#", "%")):
            lines.append(line)
    if len(lines) < 2:
        return {}
    delimiter = next((mark for mark in ";\t," if mark in lines[0]), ",")
    reader = csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
    header, *rows = (row for row in reader if row)
    columns: dict[str, list[str]] = {}
    for number, name in enumerate(header):
        cells = []
        for row in rows:
            cells.append(row[number].strip() if number < len(row) else "")
        if any(re.search(r"[A-Za-z]", cell) for cell in cells):
            columns[name.strip()] = cells
    return columns


def name_token(name: str, vocabulary: Collection[str]) -> str | None:
    """Return the word of a name that is among ``vocabulary``; None if none is."""
    tokens = re.split(r"[_\W]+", name.lower())
    return next((token for token in tokens if token in vocabulary), None)
