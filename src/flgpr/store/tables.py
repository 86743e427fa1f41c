"""Alarms, truth, objects and lanes as CSV, TOML and GeoJSON; tables of real or complex numbers as text."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path, PurePath
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pandas.api.types import is_numeric_dtype

from flgpr.door import Folder, parse_toml, read_named
from flgpr.model import Lane, as_lane, check_alarms, check_objects, check_truth
from flgpr.model.tables import ALARM_COLUMNS, OBJECT_COLUMNS, TRUTH_COLUMNS
from flgpr.store.dialects import (
    TableReading,
    column_targets,
    mark_of,
    named_columns,
    without_comments,
)
from flgpr.store.files import existing, faults_of, write_whole
from flgpr.store.notes import tell_note
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.store.text import decode_text

_CHECKS = {"alarms": check_alarms, "truth": check_truth, "objects": check_objects}
_COLUMNS = {"alarms": ALARM_COLUMNS, "truth": TRUTH_COLUMNS, "objects": OBJECT_COLUMNS}
_NUMBER = re.compile(r"\s*[-+]?\d*([.,]\d*)?([eE][-+]?\d+)?\s*")
_MOST_HEAD = 100_000  # bytes of a header
_MOST_ROWS = 2_000_000
_MOST_COLUMNS = 4096
_MOST_CELLS = 10_000_000
_FORMULA = re.compile(r"'*[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
"""What a spreadsheet may run, the full-width forms of the signs included, or such text that was quoted."""
_PLAIN_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_MISSING = {"", "nan", "na", "null"}
_COMMENT = "#%!"
_BEGIN = re.compile(r"BEGIN\b[\s,;]*([^\s,;]*)[\s,;]*", re.IGNORECASE)
_SIGN = re.compile(r"\s*([+-])\s*")
_HINT = "decimal commas are read where semicolons or tabs part the columns"


def read_table(path: str | Path, kind: str, reading: TableReading | None = None) -> pd.DataFrame:
    """Read a table of the ``kind`` "alarms", "truth" or "objects" from CSV; a broken rule is a ValueError.

    Columns are separated by commas, or by semicolons or tabs with decimal points or decimal commas. Names of columns
    in other languages, units in them, comments and other encodings are read, too; what was read otherwise than it
    stands is in ``attrs["notes"]`` and is told. ``reading`` is what the user says of the columns, and the anchor of
    places on the Earth.
    """
    path = existing(path, f"{kind} file")
    return parse_table(read_named(path), kind, path, reading)


def read_table_in(folder: str | Path, name: str | PurePath, kind: str) -> pd.DataFrame:
    """Read a table as :func:`read_table` does from a folder that may come from anywhere, see :mod:`flgpr.door`."""
    place = Folder(folder)
    return parse_table(place.read(str(name)), kind, place.root / name)


def parse_table(
    data: bytes, kind: str, path: str | Path, reading: TableReading | None = None
) -> pd.DataFrame:
    """Read a table as :func:`read_table` does from the bytes of a file, which errors name."""
    ids = ("alarm_id", "target_id", "object_id")
    with faults_of(path):
        if reading is None and _is_plain(data, kind):
            return _CHECKS[kind](parse_columns(data, *ids))
        _check_table_size(data)
        notes: list[str] = []
        text = decode_text(data, "the table", notes)
        body, more = without_comments(text, kind)
        notes += more
        if not body.strip():
            raise ValueError(f"{kind} must have a header, got an empty file")
        head = body.splitlines()[0]
        if mark_of(head) == "\t":
            notes.append("columns are parted by tabs")
        known = tuple(column.name for column in _COLUMNS[kind])
        chosen = reading or TableReading()
        header = _header_of(head)
        targets = column_targets(header, kind, known, chosen.columns)
        texts = [header[k] for k, target in targets.items() if target in ids]
        table, told = named_columns(
            parse_columns(body.encode(), *ids, *texts), targets, chosen.anchor
        )
        checked = _CHECKS[kind](table)
    notes += told
    for note in notes:
        tell_note(f"{Path(path).name}: {note}")
    checked.attrs["notes"] = notes
    return checked


def parse_own_table(data: bytes, kind: str, path: str | Path) -> pd.DataFrame:
    """Read a table as flgpr itself writes it, with its own names of columns in UTF-8; all else is a ValueError."""
    with faults_of(path):
        return _CHECKS[kind](parse_columns(data, "alarm_id", "target_id", "object_id"))


def _is_plain(data: bytes, kind: str) -> bool:
    """Tell whether a table has the columns that it must have by their own names, and no comment before them."""
    head = next(iter(data[:_MOST_HEAD].decode("utf-8-sig", errors="replace").splitlines()), "")
    names = set(_header_of(head)) if "\t" not in head else set()
    if not {column.name for column in _COLUMNS[kind] if column.required} <= names:
        return False
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return False
    return b"\n#" not in data


def _header_of(head: str) -> list[str]:
    return [
        str(plain_text(name.strip()))
        for name in next(csv.reader([head], delimiter=mark_of(head)), [])
    ]


def read_columns(path: Path, *texts: str) -> pd.DataFrame:
    """Read the columns of a file of CSV that a user named, see :func:`parse_columns`."""
    return parse_columns(read_named(path), *texts)


def parse_columns(data: bytes, *texts: str) -> pd.DataFrame:
    """Read CSV parted by commas, or by semicolons or tabs with decimal points or commas; ``texts`` are no numbers.

    A header of both semicolons and commas, or columns of numbers of which some have decimal points and others decimal
    commas, could be read in two ways: a ValueError. So is a table of more than 2 million rows, 4096 columns or 10
    million cells, which are counted before anything is parsed. What :func:`table_text` quoted is as it was.
    """
    as_text = dict.fromkeys(texts, str)
    head = next(iter(data[:_MOST_HEAD].decode("utf-8-sig", errors="replace").splitlines()), "")
    mark = mark_of(head)
    _check_table_size(data)
    if mark == ",":
        return unquoted(pd.read_csv(io.BytesIO(data), dtype=as_text))
    if mark == ";" and "," in head:
        raise ValueError(
            f"columns must be separated by commas or by semicolons, got both in {head.strip()[:80]!r}"
        )
    text = data.decode("utf-8-sig")
    cells = pd.read_csv(io.StringIO(text), sep=mark, dtype=str, keep_default_na=False)
    rest = [cells[name] for name in cells.columns if name not in texts]
    numbers = [one for one in rest if one.str.fullmatch(_NUMBER).all()]
    commas, points = (
        any(one.str.contains(mark, regex=False).any() for one in numbers) for mark in ",."
    )
    parted = "semicolons" if mark == ";" else "tabs"
    if commas and points:
        raise ValueError(
            f"columns separated by {parted} must have decimal commas or decimal points, got both"
        )
    return unquoted(
        pd.read_csv(io.StringIO(text), sep=mark, decimal="," if commas else ".", dtype=as_text)
    )


def _check_table_size(data: bytes) -> None:
    """Refuse a table that would take far more memory than its file; quoted line ends and marks count as such, too."""
    head = next(iter(data[:_MOST_HEAD].decode("utf-8-sig", errors="replace").splitlines()), "")
    mark = mark_of(head)
    columns = head.count(mark) + 1
    marks = data.count(mark.encode())
    rows = max(data.count(b"\n"), data.count(b"\r"))
    counts = {
        "rows": (rows, _MOST_ROWS),
        "columns": (columns, _MOST_COLUMNS),
        "cells": (rows + marks, _MOST_CELLS),
    }
    for what, (count, most) in counts.items():
        if count > most:
            raise ValueError(f"a table must have at most {most} {what}, got {count}")


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as CSV, every number in the shortest form that reads back the same; the file is whole or absent.

    Text that a spreadsheet would run gets an apostrophe in front, which reading takes away again.
    """
    write_whole(Path(path), table_text(table))


def table_text(table: pd.DataFrame) -> str:
    """Write a table as the text of a CSV file in which no cell is a formula.

    Spreadsheets run a cell that begins with ``=``, ``+``, ``-`` or ``@``, some also after a tab or a line end. A cell
    of text that begins so and is no number, and a column's name, gets an apostrophe in front, by which spreadsheets
    know text; so does one that begins with apostrophes before such a character. Reading takes one away again.
    """
    texts = [
        number
        for number in range(table.shape[1])
        if not is_numeric_dtype(table.dtypes.iloc[number])
    ]
    quoted = table.rename(columns=_quoted)
    for number in texts:
        quoted.isetitem(number, table.iloc[:, number].map(_quoted).array)
    returns = any(
        isinstance(cell, str) and "\r" in cell
        for number in texts
        for cell in quoted.iloc[:, number]
    )
    # A lone CR without quotes would be read as the end of a line.
    quoting: Literal[0, 2] = csv.QUOTE_NONNUMERIC if returns else csv.QUOTE_MINIMAL
    return str(quoted.to_csv(index=False, lineterminator="\n", quoting=quoting))


def unquoted(table: pd.DataFrame) -> pd.DataFrame:
    """Take back from a table that was read what :func:`table_text` put in front of cells and names."""
    plain = table.rename(columns=plain_text)
    for number in range(plain.shape[1]):
        if not is_numeric_dtype(plain.dtypes.iloc[number]):
            plain.isetitem(number, plain.iloc[:, number].map(plain_text).array)
    return plain


def _quoted(cell: Any) -> Any:
    if not isinstance(cell, str) or not _FORMULA.match(cell) or _PLAIN_NUMBER.fullmatch(cell):
        return cell
    return f"'{cell}"


def plain_text(cell: Any) -> Any:
    """Take an apostrophe away from the front of text that would be a formula without it; all else stays."""
    return (
        cell[1:]
        if isinstance(cell, str) and cell.startswith("'") and _FORMULA.match(cell)
        else cell
    )


def write_geojson(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table with x and y as points in the form of GeoJSON, in the lane frame, m; whole or absent.

    ``flgpr_frame`` says so in the file. GeoJSON itself is longitude and latitude (RFC 7946), so that such a file should
    end in ``.json``: :func:`flgpr.geo.write_earth_geojson` writes what maps read.
    """
    places = table[["x", "y"]].astype(float).to_numpy().tolist()
    frame = "lane frame: x cross-track, y down-track, metres; not longitude and latitude"
    write_features(path, places, table.drop(columns=["x", "y"]), {"flgpr_frame": frame})


def write_features(
    path: str | Path, places: list[list[float]], rest: pd.DataFrame, head: dict[str, Any]
) -> None:
    """Write GeoJSON points with properties, and what is to be said of them all; the file is whole or absent."""
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": place},
            "properties": {str(name): json_value(value) for name, value in row.items()},
        }
        for place, row in zip(places, rest.to_dict("records"), strict=True)
    ]
    collection = {"type": "FeatureCollection", **head, "features": features}
    write_whole(Path(path), json.dumps(collection, indent=1, allow_nan=False) + "\n")


def read_lane(path: str | Path) -> Lane:
    """Read a lane from TOML with x_min, x_max, y_min and y_max, m."""
    path = existing(path, "lane file")
    with faults_of(path):
        return parse_lane(read_named(path))


def parse_lane(data: bytes) -> Lane:
    """Read a lane as :func:`read_lane` does from the bytes of a file."""
    return as_lane(parse_toml(data))


def lane_text(lane: Lane) -> str:
    """Write a lane as TOML, the form :func:`read_lane` reads."""
    return "".join(
        f"{name} = {getattr(lane, name)!r}\n" for name in ("x_min", "x_max", "y_min", "y_max")
    )


def json_value(value: Any) -> Any:
    """Give a number as JSON can hold it, what is not finite as None."""
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def read_text_table(path: Path, notes: list[str] | None = None) -> dict[str, NDArray[Any]]:
    """Read a text table; columns are separated by semicolons, commas, tabs or blanks, complex numbers are ``a+bi``.

    A first line that is not of numbers names the columns; lines that begin with ``#``, ``%`` or ``!`` are left out.
    Between semicolons or tabs, numbers may have a decimal comma, if none has a decimal point. It comes as ``table``
    (row, column), and with a header line also as every column that holds numbers, by name. Where lines BEGIN and END
    part blocks, as network analysers write them, the arrays of several blocks are ``BLOCK/name``. ``notes`` get a line
    for an encoding other than UTF-8 (:func:`flgpr.store.text.decode_text`), for decimal
    commas, and for every column that is not read because cells of it are no numbers, with their
    count.
    """
    notes = [] if notes is None else notes
    blocks = _blocks(path, notes)
    found: dict[str, NDArray[Any]] = {}
    for label, lines in blocks:
        arrays = _parse_lines(lines, notes)
        found |= (
            arrays
            if len(blocks) == 1
            else {f"{label}/{name}": values for name, values in arrays.items()}
        )
    return found


def _parse_lines(lines: list[tuple[int, str]], notes: list[str]) -> dict[str, NDArray[Any]]:
    """Read the numbered lines of one table."""
    rows = _rows(lines, notes)
    if not rows:
        raise ValueError("there is no line with values")
    if len(rows[0][1]) > 1 and not any(cells[-1].strip() for _, cells in rows):
        # A mark at the end of every line, as some network analysers write it, parts nothing.
        rows = [(line, cells[:-1]) for line, cells in rows]
    heads = [str(plain_text(cell.strip())) for cell in rows[0][1]]
    names = None if all(_number(cell) is not None for cell in rows[0][1]) else heads
    if names is not None:
        rows = rows[1:]
        if not rows:
            raise ValueError("there is a header and no line with values")
        if len(set(names)) != len(names):
            raise ValueError(f"the header must name different columns, got {', '.join(names)}")
    width = len(names) if names is not None else len(rows[0][1])
    for line, cells in rows:
        if len(cells) != width:
            raise ValueError(
                f"line {line} must have {width} cells like the first, got {len(cells)}; {_HINT}"
            )
    columns = [_column([cells[k] for _, cells in rows]) for k in range(width)]
    bad = [k for k, column in enumerate(columns) if column is None]
    if names is None and bad:
        line, cell = next(
            (line, cells[k]) for line, cells in rows for k in bad if _number(cells[k]) is None
        )
        raise ValueError(f"line {line} must hold numbers, got {cell.strip()!r}; {_HINT}")
    numeric = {k: column for k, column in enumerate(columns) if column is not None}
    if not numeric:
        raise ValueError(f"no column holds numbers; {_HINT}")
    if names is not None:
        for k in bad:
            strange = sum(_number(cells[k]) is None for _, cells in rows)
            notes.append(
                f"column {names[k]!r} is not read: {strange} of its {len(rows)} cells are no numbers"
            )
    found: dict[str, NDArray[Any]] = {}
    if not bad:
        found["table"] = np.stack(list(numeric.values()), axis=1)
    if names is not None:
        found |= {names[k]: column for k, column in numeric.items()}
    return found


def _blocks(path: Path, notes: list[str]) -> list[tuple[str, list[tuple[int, str]]]]:
    """Return the lines of a text, with their numbers, in the blocks that BEGIN and END part; one if there is none."""
    text = decode_text(read_named(path, MAX_MEMORY), path.name, notes)
    if "\x00" in text:
        raise ValueError("it holds zero bytes and is no text")
    plain: list[tuple[int, str]] = []
    blocks: dict[str, list[tuple[int, str]]] = {}
    open_block: list[tuple[int, str]] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip()[0] in _COMMENT:
            continue
        begin = _BEGIN.fullmatch(line.strip())
        if begin is not None:
            label = begin[1] or "block"
            label = label if label not in blocks else f"{label} {len(blocks) + 1}"
            open_block = blocks[label] = []
        elif line.strip(" \t,;").upper() == "END":
            open_block = None
        else:
            (plain if open_block is None else open_block).append((number, line))
    if not blocks:
        return [("", plain)]
    if plain:
        notes.append(f"{len(plain)} lines outside BEGIN and END are not read")
    return list(blocks.items())


def _rows(lines: list[tuple[int, str]], notes: list[str]) -> list[tuple[int, list[str]]]:
    if not lines:
        return []
    first = lines[0][1]
    mark = next((mark for mark in ";\t," if mark in first), None)
    if mark == "," and re.search(r"\d,\d+\s+[-+]?\d+,\d", first):
        raise ValueError(
            f"line {lines[0][0]} has blanks between numbers with commas; {_HINT}, not blanks"
        )
    if mark is None:
        return [(k, line.split()) for k, line in lines]
    cells = csv.reader([line for _, line in lines], delimiter=mark)
    rows = [(k, row) for (k, _), row in zip(lines, cells, strict=True)]
    if mark == "," or not any("," in line for _, line in lines):
        return rows
    return _with_points(rows, notes)


def _with_points(
    rows: list[tuple[int, list[str]]], notes: list[str]
) -> list[tuple[int, list[str]]]:
    """Give numbers with a decimal comma a decimal point, unless other numbers of the table have one."""
    point = None
    found = []
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
    if comma is not None:
        notes.append(f"commas in numbers, such as {comma[1][:40]}, are read as decimal commas")
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
