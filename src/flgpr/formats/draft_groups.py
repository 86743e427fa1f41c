"""The files of one measurement in groups of files that differ by numbers in their names alone."""

from __future__ import annotations

import math
import re
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flgpr.formats.array_file import ArrayFile, ArrayInfo
from flgpr.formats.arrays import open_arrays
from flgpr.formats.draft_names import RECORDING, UNNAMED
from flgpr.formats.draft_units import largest, small_values, unit_of
from flgpr.store.files import natural_order
from flgpr.store.text_tables import text_columns
from flgpr.types import FloatArray

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

    @property
    def is_vector(self) -> bool:
        """Whether it has several values, all along one axis."""
        return max(self.info.shape, default=0) == self.count > 1

    @property
    def rows(self) -> int:
        """How many values it has along its axis, or how many points (row, 3)."""
        return self.count if self.is_vector else self.info.shape[-2]

    @property
    def topic(self) -> str:
        """The topic that it is of, in a recording; else empty."""
        if self.group.opened.kind != RECORDING:
            return ""
        return re.sub(r"@[^/]*$|/[^/@]*$", "", self.info.name)

    @property
    def is_log_time(self) -> bool:
        """Whether it is when the messages of a topic were recorded, not what they hold."""
        return bool(self.topic) and "@" in self.info.name

    @property
    def label(self) -> str:
        """Its name without the topic, in small letters; that of a file which names none."""
        if self.info.name in UNNAMED:
            return self.group.paths[0].stem.lower()
        return self.info.name.removeprefix(self.topic).lower()

    def is_called(self, names: re.Pattern[str]) -> bool:
        """Return whether the last part of its label matches."""
        return names.search(re.split(r"[/.]", self.label)[-1]) is not None

    def numbers(self) -> FloatArray:
        """Return its values, those of the first file of the group.

        They are none where it is large, damaged or of other values than real numbers: that keeps
        no other array from its place.
        """
        values = small_values(self.group.opened, self.info)
        if values is None or values.dtype.kind not in "fiu":
            return np.zeros(0)
        return values.astype(np.float64)

    def increases(self) -> bool:
        """Return whether it holds numbers that increase from one to the next."""
        numbers = self.numbers().ravel()
        return numbers.size > 1 and bool((np.diff(numbers) > 0).all())

    def largest(self) -> float:
        """Return its largest finite magnitude; 0 where it is not read."""
        return largest(self.group.opened, self.info)

    def unit(self, usual: str) -> str:
        """Return its unit; one that is guessed ends in a question mark."""
        return unit_of(self.group.opened, self.info, usual)


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
    by_name: dict[tuple[Path, str], list[Path]] = {}
    for path in files:
        by_name.setdefault((path.parent, re.sub(r"\d+", "*", path.name)), []).append(path)
    groups: list[FileGroup] = []
    taken = {"data"}
    for paths in by_name.values():
        paths.sort(key=natural_order)
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
        texts: dict[str, list[str]] = {}
        if first.suffix.lower() in TABLES:
            with suppress(ValueError):  # a take or a log may end so, too
                texts = text_columns(first)
        # A name that TOML takes without quotes.
        key = re.sub(r"\W+", "_", re.sub(r"\d+", "", first.stem), flags=re.ASCII).strip("_")
        key = key or "file"
        while key in taken:
            key += "_"
        taken.add(key)
        groups.append(FileGroup(key, paths, opened, texts))
    return groups
