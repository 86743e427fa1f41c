"""Tables of real or complex numbers in text files."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MISSING = {"", "nan", "na", "null"}
_SIGN = re.compile(r"\s*([+-])\s*")
_HINT = "decimal commas are read where semicolons or tabs part the columns"


def read_text_table(path: Path) -> dict[str, NDArray[Any]]:
    """Read a text table; columns are separated by semicolons, commas, tabs or blanks, complex numbers are ``a+bi``.

    A first line that is not of numbers names the columns; lines that begin with ``#`` or ``%`` are left out. Between
    semicolons or tabs, numbers may have a decimal comma, if none has a decimal point. It comes as ``table`` (row,
    column), and with a header line also as every column that holds numbers, by name.
    """
    rows = _rows(path)
    if not rows:
        raise ValueError("there is no line with values")
    names = None if all(_number(cell) is not None for cell in rows[0][1]) else [cell.strip() for cell in rows[0][1]]
    if names is not None:
        rows = rows[1:]
        if not rows:
            raise ValueError("there is a header and no line with values")
        if len(set(names)) != len(names):
            raise ValueError(f"the header must name different columns, got {', '.join(names)}")
    width = len(names) if names is not None else len(rows[0][1])
    for line, cells in rows:
        if len(cells) != width:
            raise ValueError(f"line {line} must have {width} cells like the first, got {len(cells)}; {_HINT}")
    columns = [_column([cells[k] for _, cells in rows]) for k in range(width)]
    bad = [k for k, column in enumerate(columns) if column is None]
    if names is None and bad:
        line, cell = next((line, cells[k]) for line, cells in rows for k in bad if _number(cells[k]) is None)
        raise ValueError(f"line {line} must hold numbers, got {cell.strip()!r}; {_HINT}")
    numeric = {k: column for k, column in enumerate(columns) if column is not None}
    if not numeric:
        raise ValueError(f"no column holds numbers; {_HINT}")
    found: dict[str, NDArray[Any]] = {}
    if not bad:
        found["table"] = np.stack(list(numeric.values()), axis=1)
    if names is not None:
        found |= {names[k]: column for k, column in numeric.items()}
    return found


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    text = path.read_text(encoding="utf-8-sig")
    if "\x00" in text:
        raise ValueError("it holds zero bytes and is no text")
    lines = [(k + 1, line) for k, line in enumerate(text.splitlines()) if line.strip() and line.lstrip()[0] not in "#%"]
    if not lines:
        return []
    first = lines[0][1]
    mark = next((mark for mark in ";\t," if mark in first), None)
    if mark == "," and re.search(r"\d,\d+\s+[-+]?\d+,\d", first):
        raise ValueError(f"line {lines[0][0]} has blanks between numbers with commas; {_HINT}, not blanks")
    if mark is None:
        return [(k, line.split()) for k, line in lines]
    cells = csv.reader([line for _, line in lines], delimiter=mark)
    rows = [(k, row) for (k, _), row in zip(lines, cells, strict=True)]
    return rows if mark == "," or "," not in text else _with_points(rows)


def _with_points(rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Give numbers with a decimal comma a decimal point, unless other numbers of the table have one."""
    point, found = None, []
    comma: tuple[int, str] | None = None
    for line, cells in rows:
        changed = []
        for cell in cells:
            turned = cell.replace(",", ".")
            if turned != cell and _number(turned) is not None:
                comma = comma or (line, cell.strip())
                cell = turned
            elif point is None and "." in cell and _number(cell) is not None:
                point = line
            changed.append(cell)
        found.append((line, changed))
    if comma is not None and point is not None:
        raise ValueError(
            f"line {comma[0]} must not have decimal commas beside the decimal points of line {point}, got {comma[1]!r}"
        )
    return found


def _number(cell: str) -> complex | None:
    text = _SIGN.sub(r"\1", cell.strip().lower())
    if text in _MISSING:
        return complex(np.nan)
    try:
        return complex(text.replace("i", "j") if "inf" not in text else text)
    except ValueError:
        return None


def _column(cells: list[str]) -> NDArray[Any] | None:
    try:
        return np.array([cell if cell.strip() else "nan" for cell in cells], dtype=np.float64)
    except ValueError:
        pass
    values = [_number(cell) for cell in cells]
    if any(value is None for value in values):
        return None
    array = np.array(values, dtype=np.complex128)
    return array if array.imag.any() else array.real.copy()
