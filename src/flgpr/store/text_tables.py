"""Text tables of real or complex numbers, as instruments and other programs write them."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flgpr.budget import Budget
from flgpr.store.text import text_of
from flgpr.store.writing import plain_text
from flgpr.types import AnyArray, Arrays

_MISSING = {"", "nan", "na", "null"}
_COMMENT = "#%!"
_QUOTED_COMMENT = re.compile(rf'\s*"[{_COMMENT}][^"]*"[\s,;]*')
_MARKS = ";\t,"
_BEGIN = re.compile(r"BEGIN\b[\s,;]*([^\s,;]*)[\s,;]*", re.IGNORECASE)
_SIGN = re.compile(r"\s*([+-])\s*")
_BLANKS_AND_COMMAS = re.compile(r"\d,\d+\s+[-+]?\d+,\d")
_HINT = "decimal commas are read where semicolons or tabs separate the columns"


class _Line(NamedTuple):
    """A line of a text and its number, from 1."""

    number: int
    text: str


class _Row(NamedTuple):
    """The cells of a line and its number, from 1."""

    number: int
    cells: list[str]


def read_text_table(path: Path, notes: list[str] | None = None) -> Arrays:
    """Read a text table of real or complex numbers.

    Columns are separated by semicolons, commas, tabs or blanks; complex numbers are ``a+bi``. A
    first line that is not of numbers names the columns. Lines that begin with ``#``, ``%`` or ``!``
    are comments, in quotes, too. Between semicolons or tabs, numbers may have a decimal comma if none has a decimal
    point.

    Parameters
    ----------
    path : Path
        The file.
    notes : list of str, optional
        Gets a line for an encoding other than UTF-8 (:func:`flgpr.store.text.decode_text`), for
        decimal commas, and for every column that is not read because some of its cells are no
        numbers.

    Returns
    -------
    dict of str to ndarray
        ``table`` (row, column) if every column holds numbers; with a header line also every column
        (row,) that holds numbers, by name. Where lines BEGIN and END separate blocks, as network
        analysers write them, the arrays of several blocks are ``BLOCK/name``.

    Raises
    ------
    ValueError
        If there are no numbers, rows have different numbers of cells, or numbers can be read in
        two ways.
    """
    notes = [] if notes is None else notes
    blocks = _blocks(path, notes)
    if len(blocks) == 1:
        return _parse_lines(blocks[0][1], notes)
    arrays: Arrays = {}
    for label, lines in blocks:
        for name, values in _parse_lines(lines, notes).items():
            arrays[f"{label}/{name}"] = values
    return arrays


def text_columns(path: Path) -> dict[str, list[str]]:
    """Return the cells of the columns of a table that hold no numbers, by its header.

    It is empty where nothing names columns. What is no table is a ValueError.
    """
    (_, lines), *_ = _blocks(path, [])
    header, *rows = _rows(lines, []) or [_Row(0, [])]
    names = _header(header) or []
    _check_widths(rows, len(header.cells))
    columns = {}
    for k, name in enumerate(names):
        cells = [row.cells[k].strip() for row in rows]
        if _column(cells) is None:
            columns[name] = cells
    return columns


def _blocks(path: Path, notes: list[str]) -> list[tuple[str, list[_Line]]]:
    """Return the lines of a text by the blocks of BEGIN and END; a single one if there is none."""
    text = text_of(path, notes)
    if "\x00" in text:
        raise ValueError("it holds zero bytes and is no text")
    # Every line and every mark between cells becomes a text of its own.
    budget = Budget("the table")
    blanks = text.count(" ")
    marks = [*(text.count(mark) for mark in _MARKS), min(blanks, len(text) - blanks)]
    budget.spend_values(text.count("\n") + text.count("\r") + max(marks))
    outside: list[_Line] = []
    blocks: dict[str, list[_Line]] = {}
    current = outside
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip()[0] in _COMMENT or _QUOTED_COMMENT.fullmatch(line):
            continue
        begin = _BEGIN.fullmatch(line.strip())
        if begin is not None:
            label = begin[1] or "block"
            if label in blocks:
                label = f"{label} {len(blocks) + 1}"
            current = []
            blocks[label] = current
        elif line.strip(" \t,;").upper() == "END":
            current = outside
        else:
            current.append(_Line(number, line))
    if not blocks:
        return [("", outside)]
    if outside:
        notes.append(f"{len(outside)} lines outside BEGIN and END are not read")
    return list(blocks.items())


def _without_last_mark(rows: list[_Row]) -> list[_Row]:
    """Leave out an empty last column: some network analysers end every line with a mark."""
    if len(rows[0].cells) < 2 or any(row.cells[-1].strip() for row in rows):
        return rows
    return [row._replace(cells=row.cells[:-1]) for row in rows]


def _parse_lines(lines: list[_Line], notes: list[str]) -> Arrays:
    """Return the arrays of one table, which a header may name."""
    rows = _rows(lines, notes)
    if not rows:
        raise ValueError("there is no line with values")
    rows = _without_last_mark(rows)
    names = _header(rows[0])
    if names is not None:
        rows = rows[1:]
        if not rows:
            raise ValueError("there is a header and no line with values")
        if len(set(names)) != len(names):
            raise ValueError(f"the header must name different columns, got {', '.join(names)}")
    width = len(rows[0].cells) if names is None else len(names)
    _check_widths(rows, width)
    columns = []
    for k in range(width):
        cells = [row.cells[k] for row in rows]
        columns.append(_column(cells))
    if names is None:
        return {"table": _unnamed_table(rows, columns)}
    return _named_columns(names, rows, columns, notes)


def _header(row: _Row) -> list[str] | None:
    """Return the names in a first row; None if it holds numbers only."""
    if all(_number(cell) is not None for cell in row.cells):
        return None
    return [str(plain_text(cell.strip())) for cell in row.cells]


def _check_widths(rows: list[_Row], width: int) -> None:
    """Refuse rows with other numbers of cells than the first line of a table."""
    for row in rows:
        if len(row.cells) != width:
            raise ValueError(
                f"line {row.number} must have {width} cells like the first, "
                f"got {len(row.cells)}; {_HINT}"
            )


def _unnamed_table(rows: list[_Row], columns: list[AnyArray | None]) -> AnyArray:
    """Return the columns of a table without a header as (row, column)."""
    numeric = [column for column in columns if column is not None]
    if len(numeric) == len(columns):
        return np.stack(numeric, axis=1)
    cells = ((row.number, cell) for row in rows for cell in row.cells)
    line, text = next((line, cell) for line, cell in cells if _number(cell) is None)
    raise ValueError(f"line {line} must hold numbers, got {text.strip()!r}; {_HINT}")


def _named_columns(
    names: list[str], rows: list[_Row], columns: list[AnyArray | None], notes: list[str]
) -> Arrays:
    """Return the columns that hold numbers, by name, and ``table`` if all do."""
    if all(column is None for column in columns):
        raise ValueError(f"no column holds numbers; {_HINT}")
    arrays: Arrays = {}
    for k, (name, column) in enumerate(zip(names, columns, strict=True)):
        if column is not None:
            arrays[name] = column
            continue
        strange = sum(_number(row.cells[k]) is None for row in rows)
        notes.append(
            f"column {name!r} is not read: {strange} of its {len(rows)} cells are no numbers"
        )
    if len(arrays) < len(names):
        return arrays
    return {"table": np.stack(list(arrays.values()), axis=1)} | arrays


def _rows(lines: list[_Line], notes: list[str]) -> list[_Row]:
    """Return the cells of every line, numbers with decimal points."""
    if not lines:
        return []
    first = lines[0]
    # The order of the marks counts: beside semicolons or tabs, commas are decimal.
    mark = next((mark for mark in _MARKS if mark in first.text), None)
    if mark == "," and _BLANKS_AND_COMMAS.search(first.text):
        raise ValueError(
            f"line {first.number} has blanks between numbers with commas; {_HINT}, not blanks"
        )
    if mark is None:
        return [_Row(line.number, line.text.split()) for line in lines]
    reader = csv.reader([line.text for line in lines], delimiter=mark)
    rows = []
    for line, cells in zip(lines, reader, strict=True):
        rows.append(_Row(line.number, cells))
    may_have_decimal_commas = mark != "," and any("," in line.text for line in lines)
    if not may_have_decimal_commas:
        return rows
    return _with_points(rows, notes)


def _with_points(rows: list[_Row], notes: list[str]) -> list[_Row]:
    """Return rows whose decimal commas are points, unless other numbers of them have points."""
    cells = [(row.number, cell) for row in rows for cell in row.cells]
    with_comma = [place for place in cells if _has_decimal_comma(place[1])]
    if not with_comma:
        return rows
    line_with_comma, first = with_comma[0]
    example = first.strip()
    for line_with_point, cell in cells:
        if "." in cell and _number(cell) is not None:
            raise ValueError(
                f"line {line_with_comma} must not have decimal commas beside the decimal points "
                f"of line {line_with_point}, got {example!r}"
            )
    notes.append(f"commas in numbers, such as {example[:40]}, are read as decimal commas")
    changed_rows = []
    for row in rows:
        changed_cells = []
        for cell in row.cells:
            changed_cells.append(cell.replace(",", ".") if _has_decimal_comma(cell) else cell)
        changed_rows.append(_Row(row.number, changed_cells))
    return changed_rows


def _has_decimal_comma(cell: str) -> bool:
    """Return whether a cell is a number once its commas are points."""
    return "," in cell and _number(cell.replace(",", ".")) is not None


def _number(cell: str) -> complex | None:
    """Return the real or complex number of a cell, NaN where it is missing, None if it is none."""
    # Blanks about the sign between real and imaginary part, which Python does not read.
    text = _SIGN.sub(r"\1", cell.strip().lower())
    if text in _MISSING:
        return complex(np.nan)
    if "inf" not in text:
        text = text.replace("i", "j")
    try:
        return complex(text)
    except ValueError:
        return None


def _column(cells: list[str]) -> AnyArray | None:
    """Return a column as an array, real if no number has an imaginary part; None if one is none."""
    filled = [cell if cell.strip() else "nan" for cell in cells]
    try:
        return np.array(filled, dtype=np.float64)  # much faster than cell by cell
    except ValueError:
        pass
    values = []
    for cell in cells:
        value = _number(cell)
        if value is None:
            return None
        values.append(value)
    array = np.array(values, dtype=np.complex128)
    return array if array.imag.any() else array.real.copy()
