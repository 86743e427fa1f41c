"""Alarms, truth, objects and lanes as CSV, TOML and GeoJSON."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.io.files import existing, faults_of, write_whole
from flgpr.model import Lane, as_lane, check_alarms, check_objects, check_truth

_CHECKS = {"alarms": check_alarms, "truth": check_truth, "objects": check_objects}


def read_table(path: str | Path, kind: str) -> pd.DataFrame:
    """Read a table of the ``kind`` "alarms", "truth" or "objects" from CSV; a broken rule is a ValueError."""
    path = existing(path, f"{kind} file")
    with faults_of(path):
        table = pd.read_csv(path, dtype={f"{name}_id": str for name in ("alarm", "target", "object")})
        return _CHECKS[kind](table)


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
