"""Alarms, truth, objects and lanes as CSV, TOML and GeoJSON; tables of real or complex numbers as text."""

from __future__ import annotations

import csv
import io
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.io.files import existing, faults_of, write_whole
from flgpr.model import Lane, as_lane, check_alarms, check_objects, check_truth

_CHECKS = {"alarms": check_alarms, "truth": check_truth, "objects": check_objects}
_NUMBER = re.compile(r"\s*[-+]?\d*([.,]\d*)?([eE][-+]?\d+)?\s*")
_MOST_HEAD = 100_000  # characters of a header
_MISSING = {"", "nan", "na", "null"}
_SIGN = re.compile(r"\s*([+-])\s*")
_HINT = "decimal commas are read where semicolons or tabs part the columns"


def read_table(path: str | Path, kind: str) -> pd.DataFrame:
    """Read a table of the ``kind`` "alarms", "truth" or "objects" from CSV; a broken rule is a ValueError.

    Columns are separated by commas, or by semicolons with decimal points or decimal commas.
    """
    path = existing(path, f"{kind} file")
    with faults_of(path):
        return _CHECKS[kind](read_columns(path, "alarm_id", "target_id", "object_id"))


def read_columns(path: Path, *texts: str) -> pd.DataFrame:
    """Read CSV separated by commas, or by semicolons with decimal points or decimal commas; ``texts`` are no numbers.

    A header of both semicolons and commas, or columns of numbers of which some have decimal points and others decimal
    commas, could be read in two ways: a ValueError.
    """
    as_text = dict.fromkeys(texts, str)
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        head = file.readline(_MOST_HEAD)
    if ";" not in head:
        return pd.read_csv(path, dtype=as_text)
    if "," in head:
        raise ValueError(f"columns must be separated by commas or by semicolons, got both in {head.strip()[:80]!r}")
    text = path.read_text(encoding="utf-8-sig")
    cells = pd.read_csv(io.StringIO(text), sep=";", dtype=str, keep_default_na=False)
    rest = [cells[name] for name in cells.columns if name not in texts]
    numbers = [one for one in rest if one.str.fullmatch(_NUMBER).all()]
    commas, points = (any(one.str.contains(mark, regex=False).any() for one in numbers) for mark in ",.")
    if commas and points:
        raise ValueError("columns separated by semicolons must have decimal commas or decimal points, got both")
    return pd.read_csv(io.StringIO(text), sep=";", decimal="," if commas else ".", dtype=as_text)


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as CSV, every number in the shortest form that reads back the same; the file is whole or absent."""
    write_whole(Path(path), table.to_csv(index=False, lineterminator="\n"))


def write_geojson(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table with x and y as GeoJSON points in the lane frame, m, as ``flgpr_frame`` says; whole or absent."""
    places = table[["x", "y"]].astype(float).to_numpy().tolist()
    frame = "lane frame: x cross-track, y down-track, metres; not longitude and latitude"
    write_features(path, places, table.drop(columns=["x", "y"]), {"flgpr_frame": frame})


def write_features(path: str | Path, places: list[list[float]], rest: pd.DataFrame, head: dict[str, Any]) -> None:
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
        return as_lane(tomllib.loads(path.read_text(encoding="utf-8")))


def lane_text(lane: Lane) -> str:
    """Write a lane as TOML, the form :func:`read_lane` reads."""
    return "".join(f"{name} = {getattr(lane, name)!r}\n" for name in ("x_min", "x_max", "y_min", "y_max"))


def json_value(value: Any) -> Any:
    """Give a number as JSON can hold it, what is not finite as None."""
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


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
