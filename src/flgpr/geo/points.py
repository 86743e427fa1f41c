"""Alarms and truth on the Earth: points with where they lie, as a table, CSV and GeoJSON.

Alarms are exported as evidence points: positions where the radar saw something, with the confidence
and the processing that they came from. They are never drawn as areas, and ground without a point is
not thereby free of hazards.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.geo.anchor import Anchor
from flgpr.model.printable import printable
from flgpr.store.notes import log_note
from flgpr.store.writing import write_features, write_table

STATEMENT = (
    "Evidence points of a radar: something reflected here. They are not hazard areas, and ground "
    "without a point is not thereby free of hazards."
)
NATURES = {"alarms": "evidence point", "truth": "emplaced target", "objects": "other object"}


def georeference(
    table: pd.DataFrame, anchor: Anchor, kind: str, processing_id: str, time: str | None = None
) -> pd.DataFrame:
    """Return a table of lane positions with their positions on the Earth.

    Parameters
    ----------
    table : DataFrame
        Columns x and y, m, and any others.
    anchor : Anchor
        Where the lane lies.
    kind : {"alarms", "truth", "objects"}
        What the rows are.
    processing_id : str
        What the rows came from, such as a manifest's digest.
    time : str, optional
        ISO 8601 with a time zone.

    Returns
    -------
    DataFrame
        The table with ``longitude``, ``latitude`` (WGS 84, degrees), ``ellipsoidal_height`` (m; NaN
        where the anchor has none), ``anchor_sigma`` (m, one standard deviation in the worst
        direction by the anchor alone), ``crs``, ``time``, ``processing_id`` and ``nature``; x and y
        are ``lane_x`` and ``lane_y``. Such columns of an earlier export are replaced, but a time of
        its own that a table has stays without ``time``.

    Raises
    ------
    ValueError
        If the kind is unknown, x or y is missing, rows are of several lanes, or the identity or
        time is not valid.
    """
    if kind not in NATURES:
        raise ValueError(f"kind must be one of {', '.join(NATURES)}, got {kind!r}")
    missing = [name for name in ("x", "y") if name not in table.columns]
    if missing:
        raise ValueError(f"{kind} must have x and y, got {', '.join(map(str, table.columns))}")
    require_one_lane(table)
    if not processing_id:
        raise ValueError("processing_id must say what the rows came from, got nothing")
    stamp = "" if time is None else _stamp(time)
    x = table["x"].to_numpy(dtype=np.float64)
    y = table["y"].to_numpy(dtype=np.float64)
    on_ground = np.stack([x, y, np.zeros_like(x)], axis=-1)
    geodetic = anchor.to_geodetic(on_ground).reshape(-1, 3)
    placed = {
        "longitude": geodetic[:, 0],
        "latitude": geodetic[:, 1],
        "ellipsoidal_height": geodetic[:, 2] if anchor.heights_known else np.nan,
        "anchor_sigma": anchor.uncertainty(x, y),
        "crs": "EPSG:4326",
        "time": table["time"].to_numpy() if "time" in table and time is None else stamp,
        "processing_id": processing_id,
        "nature": NATURES[kind],
    }
    replaced = [name for name in table if name in ("lane_x", "lane_y", *placed)]
    kept = table.drop(columns=replaced).reset_index(drop=True)
    replaced = [name for name in replaced if name != "time" or time is not None]
    if replaced:
        log_note(f"{kind}: the columns {', '.join(replaced)} of the table are written anew")
    return kept.rename(columns={"x": "lane_x", "y": "lane_y"}).assign(**placed)


def require_one_lane(table: pd.DataFrame) -> None:
    """Refuse a table with rows of several lanes, of which one anchor would put all on one ground."""
    lanes = set(table["lane"].dropna().astype(str)) - {""} if "lane" in table.columns else set()
    if len(lanes) > 1:
        raise ValueError(
            f"anchor ties one lane to the Earth, got rows of {len(lanes)} lanes "
            f"({', '.join(map(printable, sorted(lanes)[:5]))}): give the rows of each with its own anchor"
        )


def write_earth_geojson(
    points: pd.DataFrame, path: str | Path, about: Mapping[str, Any] | None = None
) -> None:
    """Write points as GeoJSON (RFC 7946).

    Parameters
    ----------
    points : DataFrame
        Points of :func:`georeference`.
    path : str or Path
        The file, which holds its old content or all of the new one.
    about : mapping, optional
        Entries for the file's member ``flgpr``.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    names = ["longitude", "latitude", "ellipsoidal_height"]
    coordinates = []
    for longitude, latitude, height in points[names].to_numpy(dtype=float).tolist():
        point = [round(longitude, 9), round(latitude, 9)]
        if np.isfinite(height):
            point.append(round(height, 4))
        coordinates.append(point)
    head = {"flgpr": {"statement": STATEMENT, **dict(about or {})}}
    write_features(path, coordinates, points.drop(columns=names), head)


def write_earth_csv(points: pd.DataFrame, path: str | Path) -> None:
    """Write points as CSV.

    Cells that a spreadsheet would take for formulas are quoted (:func:`flgpr.store.write_table`).

    Parameters
    ----------
    points : DataFrame
        Points of :func:`georeference`.
    path : str or Path
        The file, which holds its old content or all of the new one.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_table(points, path)


def _stamp(time: str) -> str:
    """Return a time in ISO 8601, which must have a time zone."""
    try:
        moment = datetime.fromisoformat(time)
    except ValueError:
        raise ValueError(
            f"time must be ISO 8601 such as 2026-11-21T12:00:00Z, got {time!r}"
        ) from None
    if moment.tzinfo is None:
        raise ValueError(f"time must have a time zone, got {time!r}")
    return moment.isoformat()
