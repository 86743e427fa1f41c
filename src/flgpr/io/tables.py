"""Alarms, truth, objects and lanes as CSV, TOML and GeoJSON."""

from __future__ import annotations

import io
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.io.files import existing, faults_of, write_whole
from flgpr.model import Lane, as_lane, check_alarms, check_objects, check_truth

_CHECKS = {"alarms": check_alarms, "truth": check_truth, "objects": check_objects}
_NUMBER = re.compile(r"\s*[-+]?\d*([.,]\d*)?([eE][-+]?\d+)?\s*")
_MOST_HEAD = 100_000  # characters of a header


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
