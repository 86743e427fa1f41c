"""Alarms, truth and objects read from CSV, also as other programs write them."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

import pandas as pd

from flgpr.door import Folder, read_named
from flgpr.model.faults import faults_of
from flgpr.model.printable import printable
from flgpr.model.tables import check_table, required_columns
from flgpr.store.dialects import (
    PLACES,
    TableReading,
    cells_of,
    check_widths,
    column_targets,
    first_line,
    named_columns,
    places_have_unit,
    separator_of,
    without_comments,
)
from flgpr.store.files import existing, foreign_content
from flgpr.store.notes import log_note
from flgpr.store.text import decode_text
from flgpr.store.writing import plain_text, without_quotes

_NUMBER = re.compile(r"[-+]?\d*([.,]\d*)?([eE][-+]?\d+)?")
_PANDAS = tuple(int(number) for number in pd.__version__.split(".")[:2])
_NEAREST_NUMBERS: dict[str, Any] = {} if _PANDAS >= (3, 1) else {"float_precision": "round_trip"}
"""Option by which pandas parses the nearest numbers; from 3.1 it always does, and warns of it."""
_JSON = re.compile(rb'(?:\xef\xbb\xbf)?\s*(?:\[\s*)?\{\s*"')
_MOST_HEAD = 100_000  # bytes of a header
_MOST_ROWS = 2_000_000
MOST_COLUMNS = 4096
"""Columns of the widest table that is read."""
_MOST_CELLS = 10_000_000
_LONGEST_CELL = 40  # characters of a cell that a reason shows
_ID_COLUMNS = ("alarm_id", "target_id", "object_id", "lane", "kind")
"""Columns of text, even where it looks like a number or like one that is missing."""
_MISSING = [
    *("", "NA", "N/A", "n/a", "#N/A", "<NA>", "NaN", "nan", "-NaN", "-nan", "NULL", "null", "None"),
]
"""Cells of other columns that hold nothing."""


def read_table(path: str | Path, kind: str, reading: TableReading | None = None) -> pd.DataFrame:
    """Read a table of alarms, truth or objects from CSV.

    Columns are separated by commas, or by semicolons or tabs with decimal points or decimal commas.
    Names of columns in other languages, units in them, comments and other encodings are read, too.
    What was renamed, converted or left out is logged.

    Parameters
    ----------
    path : str or Path
        The file.
    kind : {"alarms", "truth", "objects"}
        What the table holds.
    reading : TableReading, optional
        What the user says of the columns, and the anchor of places on the Earth.

    Returns
    -------
    DataFrame
        The checked table, positions in m; ``attrs["notes"]`` lists what was logged, and
        ``attrs["has_unit"]`` is true where the header or the anchor says in what places are.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    ValueError
        If the table breaks a rule; the error names the file.
    """
    path = existing(path, f"{kind} file")
    return parse_table(read_named(path), kind, path, reading)


def read_table_in(folder: str | Path, name: str | PurePath, kind: str) -> pd.DataFrame:
    """Read a table as :func:`read_table` does, from an untrusted folder (:mod:`flgpr.door`).

    Parameters
    ----------
    folder : str or path
        The folder.
    name : str or path
        Name of the file in it.
    kind : str
        What the table holds, as for :func:`read_table`.

    Returns
    -------
    pandas.DataFrame
        The table.

    Raises
    ------
    ValueError
        If the file is not valid, or against a rule of untrusted folders.
    """
    untrusted = Folder(folder)
    return parse_table(untrusted.read(str(name)), kind, untrusted.root / name)


def parse_table(
    data: bytes, kind: str, path: str | Path, reading: TableReading | None = None
) -> pd.DataFrame:
    """Read a table as :func:`read_table` does from the bytes of a file, which errors name.

    Parameters
    ----------
    data : bytes
        Content of the file.
    kind : str
        What the table holds, as for :func:`read_table`.
    path : str or path
        The file, for errors.
    reading : TableReading, optional
        Columns of other names, and the anchor of geographic positions.

    Returns
    -------
    pandas.DataFrame
        The table.

    Raises
    ------
    ValueError
        If the table is not valid.
    """
    with faults_of(path):
        if foreign := foreign_content(data):
            raise ValueError(f"{kind} must be a table as text (CSV), got {foreign}")
        if _JSON.match(data):
            raise ValueError(f"{kind} must be a table as text (CSV), got JSON: save it as CSV")
        if reading is None and _is_own_dialect(data, kind):
            table = parse_columns(data, *_ID_COLUMNS)
            if kind == "alarms":
                _require_confidences(table)
            return check_table(table, kind)
        checked, notes = _parse_dialect(data, kind, reading or TableReading())
    for note in notes:
        log_note(f"{Path(path).name}: {note}")
    checked.attrs["notes"] = notes
    return checked


def _parse_dialect(data: bytes, kind: str, reading: TableReading) -> tuple[pd.DataFrame, list[str]]:
    """Return a table that another program wrote, and notes on what was renamed or converted."""
    _check_table_size(data)
    notes: list[str] = []
    text = decode_text(data, "the table", notes)
    body, notes_on_comments = without_comments(text, kind)
    notes += notes_on_comments
    if not body.strip():
        raise ValueError(f"{kind} must have a header, got an empty file")
    head = first_line(body)
    if separator_of(head) == "\t":
        notes.append("columns are separated by tabs")

    header = _header_of(head)
    targets = column_targets(header, kind, reading.columns)
    text_columns = list(_ID_COLUMNS)
    for number, target in targets.items():
        if target in _ID_COLUMNS:
            text_columns.append(header[number])
    columns = parse_columns(body.encode(), *text_columns)
    table, notes_on_columns = named_columns(columns, targets, reading.anchor)
    notes += notes_on_columns
    missing = [name for name in required_columns(kind) if name not in table]
    if missing and missing != ["confidence"]:  # the lack of which has a remedy of its own
        option = "truth_columns" if kind == "truth" else "columns"
        raise ValueError(
            f"{kind} must have the columns {', '.join(missing)}; got {', '.join(map(str, table))}; "
            f"`{option}` {missing[0]}=NAME says which it is, and lines above the header begin with #"
        )
    if kind == "alarms" and not reading.unranked:
        _require_confidences(table)
    elif kind == "alarms":
        table, notes_on_ranks = _with_equal_ranks(table)
        notes += notes_on_ranks
    checked = check_table(table, kind)
    checked.attrs["has_unit"] = places_have_unit(header, targets)
    return checked, notes


def split_alarm_rows(
    data: bytes, reading: TableReading
) -> tuple[bytes, list[int], list[tuple[int, str]]]:
    """Part the rows of an alarm list that can be read from those that cannot.

    Parameters
    ----------
    data : bytes
        Content of the file.
    reading : TableReading
        Columns of other names, and whether confidences may be missing.

    Returns
    -------
    readable : bytes
        The table without comments and faulty rows, for :func:`parse_table`.
    lines : list of int
        Line in the file of every row that is left.
    faults : list of (int, str)
        Line in the file of every row that is left out, and the reason.

    Raises
    ------
    ValueError
        If the table is too large, or two columns could be one.
    """
    _check_table_size(data)
    text, _ = without_comments(decode_text(data, "the table"), "alarms")
    head = first_line(text)
    mark = separator_of(head)
    header = _header_of(head)
    numbers = {}
    for number, name in column_targets(header, "alarms", reading.columns).items():
        if name in ("x", "y", *PLACES) or (name == "confidence" and not reading.unranked):
            numbers[number] = name

    kept = text.split("\n")
    lines: list[int] = []
    faults = []
    end = 0
    has_header = False
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=mark)
    try:
        for cells in rows:
            begin, end = end + 1, rows.line_num
            if len(cells) < 2 and not "".join(cells).strip():
                continue
            fault = _fault_of_row(cells, len(header), numbers) if has_header else ""
            if fault:
                faults.append((begin, fault))
                kept[begin - 1 : end] = [""] * (end - begin + 1)
            elif has_header:
                lines.append(begin)
            has_header = True
    except csv.Error as error:
        raise ValueError(f"line {end + 1} must hold cells of text: {error}") from None
    return "\n".join(kept).encode(), lines, faults


def _fault_of_row(cells: Sequence[str], width: int, numbers: Mapping[int, str]) -> str:
    """Return why a row cannot be read; "" if it can. Cells of ``numbers`` must be finite."""
    if len(cells) != width:
        return f"{len(cells)} cells where the header has {width}"
    for number, name in numbers.items():
        cell = cells[number].strip()
        is_number = _NUMBER.fullmatch(cell) and any(map(str.isdigit, cell))
        if not (is_number and math.isfinite(float(cell.replace(",", ".")))):
            shown = printable(cell[:_LONGEST_CELL])
            return f'{name} is no number: "{shown}"' if cell else f"{name} is empty"
    return ""


def _missing_confidences(table: pd.DataFrame) -> int:
    """Return how many alarms have no confidence: all of them without that column."""
    if "confidence" not in table.columns:
        return len(table)
    return int(table["confidence"].isna().sum())


def _require_confidences(table: pd.DataFrame) -> None:
    """Refuse alarms without confidences, and name the way to score them all the same."""
    unranked_hint = "`unranked` takes such a list and ranks all its alarms equal"
    if "confidence" not in table.columns:
        names = ", ".join(map(str, table.columns))
        raise ValueError(
            f"alarms must have the columns confidence; got {names}; "
            f"`columns` confidence=NAME says which it is, {unranked_hint}"
        )
    missing = _missing_confidences(table)
    if missing:
        first = int(table["confidence"].isna().to_numpy().argmax()) + 1
        raise ValueError(
            f"alarms.confidence must be a number in every row, got {missing} of {len(table)} rows "
            f"without one, the first in row {first} below the header; {unranked_hint}"
        )


def _with_equal_ranks(table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Return alarms that rank equal where any of them lacks a confidence, and a note that says so.

    ``attrs["unranked"]`` of the table is true then.
    """
    missing = _missing_confidences(table)
    if "confidence" in table.columns and not missing:
        return table, []
    equal = table.assign(confidence=1.0)
    equal.attrs["unranked"] = True
    return equal, [
        f"{missing} of {len(table)} alarms have no confidence: all alarms of the list rank equal"
    ]


def parse_own_table(data: bytes, kind: str, path: str | Path) -> pd.DataFrame:
    """Read a table as flgpr itself writes it, in UTF-8 and in no other dialect.

    Parameters
    ----------
    data : bytes
        Content of the file.
    kind : str
        What the table holds, as for :func:`read_table`.
    path : str or path
        The file, for errors.

    Returns
    -------
    pandas.DataFrame
        The table.

    Raises
    ------
    ValueError
        If the table is of another dialect, or not valid.
    """
    with faults_of(path):
        return check_table(parse_columns(data, *_ID_COLUMNS), kind)


def _is_own_dialect(data: bytes, kind: str) -> bool:
    """Return whether a table has flgpr's names for all required columns, and no comments."""
    head = _first_line(data)
    if "\t" in head:
        return False
    header = _header_of(head)
    # Names that stand twice, or with blanks about them, are for the reader of dialects, too.
    has_blanks = any(cell != cell.strip() for cell in cells_of(head))
    if (
        not set(required_columns(kind)) <= set(header)
        or len(set(header)) < len(header)
        or has_blanks
    ):
        return False
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return False
    # A line that begins with # may be a comment: then the reader of dialects decides.
    return b"\n#" not in data


def _first_line(data: bytes) -> str:
    """Return the first line of a table as text, at most 100 kB of it."""
    return first_line(data[:_MOST_HEAD].decode("utf-8-sig", errors="replace"))


def _header_of(head: str) -> list[str]:
    """Return the names in the first line of a table."""
    return [str(plain_text(cell.strip())) for cell in cells_of(head)]


def read_columns(path: Path, *texts: str) -> pd.DataFrame:
    """Read a CSV file of any columns.

    Parameters
    ----------
    path : Path
        The file.
    *texts : str
        Columns of text even where they look like numbers.

    Returns
    -------
    pandas.DataFrame
        The table (:func:`parse_columns`).

    Raises
    ------
    ValueError
        If the table could be read in two ways, names a column twice, or is too large.
    """
    data = read_named(path)
    header = [name for name in _header_of(_first_line(data)) if name]
    twice = next((name for name in header if header.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"the header must name each column once, got {twice!r} twice")
    return parse_columns(data, *texts)


def parse_columns(data: bytes, *texts: str) -> pd.DataFrame:
    """Read CSV of any columns.

    Cells are separated by commas, or by semicolons or tabs with decimal points or decimal commas.
    Apostrophes that :func:`csv_text` put in front of text are removed.

    Parameters
    ----------
    data : bytes
        Content of the file.
    *texts : str
        Columns of text even where they look like numbers.

    Returns
    -------
    DataFrame
        The table.

    Raises
    ------
    ValueError
        If the table could be read in two ways: the header has both semicolons and commas, or some
        columns of numbers have decimal points and others decimal commas. If a row has more or fewer
        cells than the header. Also if it has more than 2 million rows, 4096 columns or 10 million
        cells, which are counted before anything is parsed.
    """
    as_text: dict[str, Any] = dict.fromkeys(texts, str)
    _check_table_size(data)
    text = data.decode("utf-8-sig")
    head = first_line(text)
    mark = separator_of(head)
    if mark == ";" and "," in head:
        raise ValueError(
            "columns must be separated by commas or by semicolons, "
            f"got both in {head.strip()[:80]!r}"
        )
    decimal = "." if mark == "," else _decimal_mark(text, mark, texts)
    names = cells_of(head)
    missing = {name: [""] if name in texts else _MISSING for name in names}
    options: dict[str, Any] = {"decimal": decimal, "dtype": as_text}
    if len(missing) == len(names):
        options |= {"keep_default_na": False, "na_values": missing}
    return without_quotes(parse_csv(text, mark, **options))


def parse_csv(
    text: str, mark: str = ",", *, width: int | None = None, first: int = 1, **options: Any
) -> pd.DataFrame:
    """Parse a table by pandas, every number as the nearest one of double precision.

    Tables that are written and read again hold the same numbers then, to the last bit. Every row
    must have as many cells as the header: pandas itself would take a cell too many for the name of
    the row, and move all columns by one.

    Parameters
    ----------
    text : str
        The table.
    mark : str
        What separates its cells.
    width : int, optional
        Cells of every row; by default as many as the first row has.
    first : int
        Number of its first line in the file, for errors.
    **options
        Options of ``pandas.read_csv``.

    Returns
    -------
    DataFrame
        The table.

    Raises
    ------
    ValueError
        If a row has more or fewer cells; the error names its line.
    """
    check_widths(text, mark, width, first)
    return pd.read_csv(io.StringIO(text), sep=mark, index_col=False, **_NEAREST_NUMBERS, **options)


def _decimal_mark(text: str, mark: str, text_columns: Sequence[str]) -> str:
    """Return the decimal mark of a table whose columns are separated by semicolons or tabs."""
    # All cells as text: a comma is decimal only where the whole column is of numbers.
    cells = parse_csv(text, mark, dtype=str, keep_default_na=False)
    with_mark = {",": "", ".": ""}  # an example of each
    for name in cells.columns:
        column = cells[name].str.strip()
        if name in text_columns or not column.str.fullmatch(_NUMBER).all():
            continue
        for decimal in with_mark:
            found = column[column.str.contains(decimal, regex=False)]
            with_mark[decimal] = with_mark[decimal] or next(iter(found), "")
    if all(with_mark.values()):
        separator = "semicolons" if mark == ";" else "tabs"
        raise ValueError(
            f"columns separated by {separator} must have decimal commas or decimal points, got both, "
            f"{' and '.join(with_mark.values())}"
        )
    return "," if with_mark[","] else "."


def _check_table_size(data: bytes) -> None:
    """Refuse a table that would take far more memory than its file.

    Line ends and separators within quotes count, too, so that nothing needs to be parsed.
    """
    head = _first_line(data)
    columns = head.count(separator_of(head)) + 1
    # The header may lie behind comments, and its mark be another than that of the first line.
    marks = max(data.count(mark) for mark in (b",", b";", b"\t"))
    rows = max(data.count(b"\n"), data.count(b"\r"))  # lines end with \n, \r\n or \r alone
    counts = {
        "rows": (rows, _MOST_ROWS),
        "columns": (columns, MOST_COLUMNS),
        "cells": (rows + marks, _MOST_CELLS),
    }
    for noun, (count, most) in counts.items():
        if count > most:
            raise ValueError(f"a table must have at most {most} {noun}, got {count}")
