"""What a file holds, in words, and a first draft of the mapping that imports it.

Guesses in a draft end in a question mark.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flgpr.formats.array_file import LIMIT, ArrayFile, ArrayInfo
from flgpr.formats.arrays import open_arrays
from flgpr.formats.draft_arrays import SMALL, group_files
from flgpr.formats.draft_mapping import MappingDraft, draft_of_file
from flgpr.formats.draft_roles import Roles
from flgpr.formats.reader import Explanation, reader_of, readers
from flgpr.store.files import existing


def explain_file(path: str | Path, limit: int = LIMIT) -> Explanation:
    """Return what a file holds, with a draft of the mapping that imports it.

    It may be HDF5, MATLAB, NPZ, NPY, CSV, NMEA, or what a reader of another package reads
    (:mod:`flgpr.formats.reader`): gprMax, Touchstone, SigMF, CPHD, MCAP, a take of OptiTrack Motive
    or the recording of a commercial radar.

    Parameters
    ----------
    path : path
        The file.
    limit : int
        Bytes that the file and an array may take.

    Returns
    -------
    Explanation
        What it holds.

    Raises
    ------
    ValueError
        If the file is damaged or of another kind.
    """
    path = existing(path)
    reader = reader_of(path)
    told = None if reader is None else reader.explain(path, limit)
    if told is not None:
        return told
    opened = open_arrays(path, limit)
    for layout in readers():
        if layout.within == opened.kind and layout.owns(path, b""):
            told = told or layout.explain(path, limit)
    return told or Explanation(path, opened.kind, array_lines(opened), draft_of_file(opened))


def explain_files(
    paths: Sequence[str | Path], limit: int = LIMIT, mapping: str | Path | None = None
) -> Explanation:
    """Return what several files of one measurement hold, with a draft of one mapping for all.

    Parameters
    ----------
    paths : sequence of path
        The files: scans, one or many, and what belongs to them, in any order.
    limit : int
        Bytes that a file and an array may take.
    mapping : path, optional
        The mapping that will be written; its file names are relative to its folder. By default they
        are relative to the folder of the first file.

    Returns
    -------
    Explanation
        ``lines`` are of every group of files; ``mapping`` is the draft.

    Raises
    ------
    ValueError
        If a file cannot be read, files of one group differ in their arrays, or no file holds a
        signal.
    """
    files = [existing(path) for path in paths]
    if not files:
        raise ValueError("paths must name at least one file, got none")
    groups = group_files(files, limit)
    lines: list[str] = []
    for group in groups:
        first = group.paths[0]
        count = len(group.paths)
        kind = f"{first.name} ({group.opened.kind})"
        lines.append(kind if count == 1 else f"{count} files like {kind}, each")
        lines += [f"  {line}" for line in explain_file(first, limit).lines]
    folder = files[0].parent if mapping is None else Path(mapping).parent
    draft = MappingDraft(Roles(groups), folder)
    return Explanation(files[0], f"{len(files)} files", lines, draft.text())


def propose_mapping(path: str | Path, limit: int = LIMIT) -> str:
    """Draft the mapping that imports a file of named arrays.

    Parameters
    ----------
    path : path
        The file.
    limit : int
        Bytes that the file and an array may take.

    Returns
    -------
    str
        The mapping, TOML. What is a guess ends in a question mark, and an import refuses it until
        that is taken away.

    Raises
    ------
    ValueError
        If the file is damaged, needs no mapping, or holds no array that can be a signal.
    """
    explanation = explain_file(path, limit)
    if not explanation.mapping:
        if not explanation.needs_mapping:
            raise ValueError(f"{path}: a {explanation.kind} is read without a mapping")
        raise ValueError(f"{path}: no array of this {explanation.kind} can be a signal")
    return explanation.mapping


def array_lines(opened: ArrayFile) -> list[str]:
    """Return what a file of arrays holds: what it states, then a line per array."""
    lines = opened.about + opened.notes
    return lines + [_line(opened, info) for info in opened.arrays.values()]


def _line(opened: ArrayFile, info: ArrayInfo) -> str:
    """Return in words what an array is, and where its values lie."""
    shape = " x ".join(map(str, info.shape)) or "one value"
    text = f"{info.name}: {shape} {info.dtype}" + (f" [{info.unit}]" if info.unit else "")
    if math.prod(info.shape) > SMALL:
        return text
    try:
        values = opened.read(info.name)
    except ValueError as error:
        return f"{text}, not read: {str(error).removeprefix(f'{opened.path}: ')}"
    if values.dtype.kind not in "fciu" or not values.size:
        return text
    quantity = ""
    if np.iscomplexobj(values):
        values, quantity = np.abs(values), "magnitude "
    finite = values[np.isfinite(values)].astype(np.float64)
    if finite.size:
        text += f", {quantity}{finite.min():.6g} to {finite.max():.6g}"
    bad = values.size - finite.size
    return text + (f", {bad} not finite" if bad else "")
