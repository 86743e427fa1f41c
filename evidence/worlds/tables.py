"""CSV files of the parts of the map, written after each run and read by figures."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from flgpr.door import read_named
from flgpr.store import write_whole
from flgpr.store.tables import parse_csv

_DIGITS = 5


def write_rounded_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table as CSV with numbers to five decimals; an empty table is not written.

    Parameters
    ----------
    path : Path
        The file, which is complete or not there at all.
    table : DataFrame
        The table; its index is not written.
    """
    if not table.empty:
        write_whole(path, table.round(_DIGITS).to_csv(index=False, lineterminator="\n"))


def read_table(folder: Path, name: str) -> pd.DataFrame:
    """Read a table of a folder; an empty one if the file is not there."""
    path = folder / f"{name}.csv"
    if not path.is_file():
        return pd.DataFrame()
    return parse_csv(read_named(path).decode("utf-8"), keep_default_na=False, na_values=[""])
