"""Tables written as CSV, in which no cell is a formula, and as GeoJSON."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from flgpr.store.files import write_whole
from flgpr.store.outputs import atomic_output

_FORMULA = re.compile(r"'*[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
"""Beginning of what a spreadsheet may run as a formula, or of such text that was quoted.

Spreadsheets take the full-width forms of the signs for the signs.
"""
_PLAIN_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as CSV, every number in the shortest form that reads back the same.

    Text that a spreadsheet would run as a formula gets an apostrophe in front, which is removed on
    reading.

    Parameters
    ----------
    table : DataFrame
        The table; its index is not written.
    path : str or Path
        The file, which holds its old content or all of the new one.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_whole(Path(path), csv_text(table))


def csv_text(table: pd.DataFrame) -> str:
    """Return the text of a CSV file in which no cell is a formula.

    Spreadsheets run a cell that begins with ``=``, ``+``, ``-`` or ``@``, some also after a tab or
    a line end. An apostrophe in front of a cell marks it as text. It is put in front of a column's
    name and of text that begins so and is no number, and in front of text that begins with
    apostrophes before such a character. Reading removes one apostrophe.

    Parameters
    ----------
    table : pandas.DataFrame
        The table; its index is not written.

    Returns
    -------
    str
        The text.
    """
    quoted = table.rename(columns=_quoted)
    has_returns = False
    for number in _text_columns(table):
        column = table.iloc[:, number].map(_quoted)
        quoted.isetitem(number, column.array)
        has_returns |= any(isinstance(cell, str) and "\r" in cell for cell in column)
    # A lone CR without quotes would be read as the end of a line.
    quoting: Literal[0, 2] = csv.QUOTE_NONNUMERIC if has_returns else csv.QUOTE_MINIMAL
    return str(quoted.to_csv(index=False, lineterminator="\n", quoting=quoting))


def _text_columns(table: pd.DataFrame) -> list[int]:
    """Return the numbers of the columns that are not numeric."""
    numbers = range(table.shape[1])
    return [number for number in numbers if not is_numeric_dtype(table.dtypes.iloc[number])]


def _quoted(cell: Any) -> Any:
    """Return a cell with an apostrophe in front if a spreadsheet could run it."""
    if not isinstance(cell, str) or not _FORMULA.match(cell) or _PLAIN_NUMBER.fullmatch(cell):
        return cell
    return f"'{cell}"


def plain_text(cell: Any) -> Any:
    """Return a cell without the apostrophe in front of what would be a formula without it."""
    is_quoted = isinstance(cell, str) and cell.startswith("'") and _FORMULA.match(cell)
    return cell[1:] if is_quoted else cell


def without_quotes(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table that was read with the apostrophes removed that :func:`csv_text` puts."""
    bare = table.rename(columns=plain_text)
    for number in _text_columns(bare):
        bare.isetitem(number, bare.iloc[:, number].map(plain_text).array)
    return bare


def write_table_pair(table: pd.DataFrame, path: Path, replace: bool = False) -> Path:
    """Write a table as CSV and as .json beside it; refuse others there, unless ``replace``."""
    for file, write in ((path, write_table), (path.with_suffix(".json"), write_geojson)):
        with atomic_output(file, replace) as partial:
            write(table, partial)
    return path


def write_geojson(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table as points in the form of GeoJSON, in the lane frame.

    GeoJSON itself is longitude and latitude (RFC 7946), so that such a file should end in
    ``.json``. Its entry ``flgpr_frame`` names the frame. Maps read the files of
    :func:`flgpr.geo.write_earth_geojson`.

    Parameters
    ----------
    table : DataFrame
        Columns x and y, m, and others, which become properties of the points.
    path : str or Path
        The file, which holds its old content or all of the new one.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    points = table[["x", "y"]].astype(float).to_numpy().tolist()
    frame = "lane frame: x cross-track, y down-track, metres; not longitude and latitude"
    write_features(path, points, table.drop(columns=["x", "y"]), {"flgpr_frame": frame})


def write_features(
    path: str | Path, points: list[list[float]], rest: pd.DataFrame, head: dict[str, Any]
) -> None:
    """Write GeoJSON points with properties of each, and entries of them all.

    Parameters
    ----------
    path : str or path
        The file to write.
    points : list of list of float
        Coordinates of each point, as GeoJSON has them.
    rest : pandas.DataFrame
        Properties, a row for each point.
    head : dict
        Entries of the collection.
    """
    features = []
    for point, row in zip(points, rest.to_dict("records"), strict=True):
        feature = {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": point},
            "properties": {str(name): json_value(value) for name, value in row.items()},
        }
        features.append(feature)
    collection = {"type": "FeatureCollection", **head, "features": features}
    write_whole(Path(path), json.dumps(collection, indent=1, allow_nan=False) + "\n")


def json_value(value: Any) -> Any:
    """Return a number as JSON can hold it; one that is not finite is None."""
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.generic):
        return value.item()
    return value
