"""Tables of alarms, truth and objects: name, unit, meaning and missing value of every column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd

from flgpr.model.bounds import shown_number

_LONGEST_SHOWN = 60  # characters of a cell in an error


@dataclass(frozen=True)
class Column:
    """What a table's column holds."""

    name: str
    kind: Literal["number", "text"]  #: type of its values
    unit: str  #: unit, "1" for a pure number, "" for text
    meaning: str  #: what the value says
    required: bool = False  #: whether the table must have it
    #: the value that stands for "not known"; empty if every row must have one
    missing: str = "NaN"


def full_column(name: str, unit: str, meaning: str) -> Column:
    """Return a column that every row fills: numbers of a unit, or text."""
    return Column(name, "number" if unit else "text", unit, meaning, required=True, missing="")


def _lane_of(what: str) -> Column:
    """Return the column that names the lane of an alarm or a target."""
    meaning = f"name of the lane the {what} lies in, for tables of several lanes"
    return Column("lane", "text", "", meaning, missing="empty")


_CENTRE = (
    full_column("x", "m", "cross-track position of the centre in the lane frame"),
    full_column("y", "m", "down-track position of the centre in the lane frame"),
)
ALARM_COLUMNS = (
    Column("alarm_id", "text", "", "name of the alarm, unique within its table", missing="empty"),
    full_column("x", "m", "cross-track position in the lane frame"),
    full_column("y", "m", "down-track position in the lane frame"),
    full_column("confidence", "1", "higher means more like a mine; no absolute scale"),
    Column("magnitude", "number", "1", "run-view magnitude over the gain background at the alarm"),
    Column("scans", "number", "1", "number of scans that saw the alarm and entered its confidence"),
    Column(
        "p",
        "number",
        "1",
        "probability of a mine where mines are as frequent as in training, of recipes whose "
        "confidence is its log odds",
    ),
    _lane_of("alarm"),
)
TRUTH_COLUMNS = (
    full_column("target_id", "", "name of the target, unique within its table"),
    *_CENTRE,
    full_column("kind", "", "metal, plastic, simulant or another kind of target"),
    Column(
        "depth",
        "number",
        "m",
        "top of the target below the mean surface; 0 is flush",
        required=True,
    ),
    Column("radius", "number", "m", "radius of the target"),
    Column("height", "number", "m", "height of the target's body"),
    _lane_of("target"),
)
OBJECT_COLUMNS = (
    full_column("object_id", "", "name of the object, unique within its table"),
    *_CENTRE,
    full_column("kind", "", "rock, post, bush, fiducial, hole or other non-target"),
    Column("radius", "number", "m", "radius of the object"),
    Column("height", "number", "m", "height above the mean surface"),
)

TABLES = {"alarms": ALARM_COLUMNS, "truth": TRUTH_COLUMNS, "objects": OBJECT_COLUMNS}
"""Columns of each kind of table; the first names its rows."""


def check_alarms(alarms: pd.DataFrame) -> pd.DataFrame:
    """Return a copy of a valid alarm table with float64 numbers.

    Parameters
    ----------
    alarms : DataFrame
        ``ALARM_COLUMNS`` and any others; it may be empty.

    Returns
    -------
    DataFrame
        The copy.

    Raises
    ------
    ValueError
        If a column is missing, a position or confidence is not finite, or an ``alarm_id`` is
        repeated.
    """
    return check_table(alarms, "alarms")


def check_truth(truth: pd.DataFrame) -> pd.DataFrame:
    """Return a copy of a valid truth table (``TRUTH_COLUMNS``), as :func:`check_alarms` does."""
    return check_table(truth, "truth")


def check_objects(objects: pd.DataFrame) -> pd.DataFrame:
    """Return a copy of a valid table of objects (``OBJECT_COLUMNS``), which never score.

    The checks are those of :func:`check_alarms`.
    """
    return check_table(objects, "objects")


def empty_table(columns: tuple[Column, ...]) -> pd.DataFrame:
    """Return a table of all columns and no rows."""
    types = {"number": "float64", "text": "object"}
    return pd.DataFrame({column.name: pd.Series(dtype=types[column.kind]) for column in columns})


def required_columns(kind: str) -> list[str]:
    """Return the names of the columns that every table of a kind must have."""
    if kind not in TABLES:
        raise ValueError(f"kind must be one of {', '.join(TABLES)}, got {kind!r}")
    return [column.name for column in TABLES[kind] if column.required]


def check_table(table: pd.DataFrame, kind: str) -> pd.DataFrame:
    """Return a checked copy of a table of a kind, whose rows have names unique within a lane."""
    missing = [name for name in required_columns(kind) if name not in table.columns]
    columns = TABLES[kind]
    key = columns[0].name
    if missing:
        existing = ", ".join(map(str, table.columns))
        raise ValueError(f"{kind} must have the columns {', '.join(missing)}; got {existing}")
    table = table.copy()
    for column in columns:
        if column.kind == "number" and column.name in table.columns:
            _check_numbers(table, column, kind)
        elif column.required and column.kind == "text":
            _check_filled(table[column.name], kind)
    if key in table.columns:
        repeated = table[key].duplicated().to_numpy() & table[key].notna().to_numpy()
        keys = ["lane", key] if "lane" in table.columns else [key]
        if repeated.any() and table.duplicated(keys).any():
            raise ValueError(
                f"{kind}.{key} must be unique, got {table[key][repeated].iloc[0]!r} more than once"
            )
    return table


def _check_filled(values: pd.Series[Any], name: str) -> None:
    """Refuse a column of text with a row that has none."""
    empty = (values.isna() | (values.astype(str).str.strip() == "")).to_numpy()
    if empty.any():
        raise ValueError(
            f"{name}.{values.name} must be filled in every row, got none in row "
            f"{int(np.flatnonzero(empty)[0]) + 1} below the header ({int(empty.sum())} such rows)"
        )


def _check_numbers(table: pd.DataFrame, column: Column, name: str) -> None:
    """Convert a column to float64 in place, and refuse missing values where none may be."""
    values = table[column.name]
    # Float64 stays as it is: to take a column out and put it back costs more than all the rest of a
    # small table.
    if not (isinstance(values, pd.Series) and values.dtype == np.float64):
        values = to_numbers(values, f"{name}.{column.name}", column.unit)
        table[column.name] = values
    bad = ~np.isfinite(values.to_numpy())
    if not column.missing and bad.any():
        raise ValueError(
            f"{name}.{column.name} must be finite in every row, got {values[bad].iloc[0]} in row "
            f"{int(np.flatnonzero(bad)[0]) + 1} below the header ({int(bad.sum())} such rows)"
        )


def to_numbers(values: pd.Series[Any], name: str, unit: str) -> pd.Series[Any]:
    """Return a column as float64; anything else is a ValueError that names the row.

    Parameters
    ----------
    values : Series
        The column; empty cells are missing.
    name : str
        What it is called in errors.
    unit : str
        Unit of its numbers, for errors.

    Returns
    -------
    Series
        The numbers.

    Raises
    ------
    ValueError
        If a cell holds no number, or one of more digits than a number of double precision has.
    """
    if pd.api.types.is_bool_dtype(values):
        values = values.astype(str)  # as a table has it: no number
    try:
        return pd.to_numeric(values).astype(np.float64)
    except (ValueError, TypeError, OverflowError):
        pass
    for row, value in enumerate(values, 1):
        try:
            float(pd.to_numeric(value))
        except (ValueError, TypeError, OverflowError):
            text = str(value) if isinstance(value, str) else shown_number(value)
            shown = repr(text) if len(text) < _LONGEST_SHOWN else f"{text[:20]!r}... of {len(text)}"
            hint = (
                "; decimal commas need semicolons or tabs between the columns"
                if text.count(",") == 1
                else ""
            )
            raise ValueError(
                f"{name} must be numbers ({unit}), got {shown} in row {row} below the header{hint}"
            ) from None
    raise ValueError(f"{name} must be numbers ({unit}), got {values.dtype}")
