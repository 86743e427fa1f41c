"""Points on the Earth as GeoPackage, KML and GPX, and the outline of a lane.

Alarms are exported as evidence points: positions where the radar saw something, with the confidence
and the processing that they came from. They are never drawn as areas, and ground without a point is
not thereby free of hazards.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.geo.anchor import Anchor
from flgpr.geo.geotiff import disk_errors
from flgpr.geo.points import NATURES, STATEMENT
from flgpr.model.lane import Lane
from flgpr.store.extras import optional
from flgpr.store.files import write_whole
from flgpr.store.notes import log_note
from flgpr.store.outputs import atomic_output
from flgpr.store.text import utc_text, zoned_time
from flgpr.store.writing import json_value
from flgpr.types import Entries, FloatArray
from flgpr_exchange.documents import document

_KEYS = ("alarm_id", "target_id", "object_id")
_TOLD = ("confidence", "kind", "depth")
"""Columns that the text of a waypoint tells, where a table has them."""
_COLUMNS_OF_GEOPACKAGE = ("fid", "geom", "geometry")
"""Columns that every layer of a GeoPackage has of its own."""


def write_kml(points: pd.DataFrame, path: str | Path, title: str) -> None:
    """Write points as KML 2.2 placemarks.

    Parameters
    ----------
    points : DataFrame
        Points of :func:`flgpr.geo.georeference`.
    path : str or Path
        The file, which holds its old content or all of the new one.
    title : str
        Title of the document.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = document(
        "flgpr_exchange.maps", "points.kml", title=title, statement=STATEMENT, points=_marks(points)
    )
    write_whole(Path(path), text)


def write_gpx(points: pd.DataFrame, path: str | Path) -> None:
    """Write points as GPX 1.1 waypoints, for a hand-held receiver.

    Parameters
    ----------
    points : DataFrame
        Points of :func:`flgpr.geo.georeference`.
    path : str or Path
        The file, which holds its old content or all of the new one.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    are_alarms = (points["nature"] == NATURES["alarms"]).any()
    statement = STATEMENT if are_alarms else ""
    write_whole(
        Path(path),
        document("flgpr_exchange.maps", "points.gpx", statement=statement, points=_marks(points)),
    )


def _marks(points: pd.DataFrame) -> list[Entries]:
    """Return points with their names, times and descriptions, and their values as JSON has them."""
    marks = []
    for number, row in enumerate(points.to_dict("records"), start=1):
        entries = {str(name): json_value(value) for name, value in row.items()}
        names = [row[key] for key in _KEYS if isinstance(row.get(key), str)]
        mark = {"name": names[0] if names else f"{number}", "row": row, "entries": entries}
        moment = zoned_time(row["time"])
        time = "" if moment is None else utc_text(moment)
        marks.append(mark | {"time": time, "about": _in_words(entries)})
    return marks


def _in_words(entries: Entries) -> str:
    """Return what a point is, for receivers that show a name and a text and nothing else."""
    lane = entries.get("lane")
    x, y = entries["lane_x"], entries["lane_y"]
    words = [
        f"{entries['nature']}: x {x:.3f} m, y {y:.3f} m in {f'lane {lane}' if lane else 'the lane'}"
    ]
    words += [f"{name} {entries[name]}" for name in _TOLD if entries.get(name) not in (None, "")]
    if entries["anchor_sigma"] is not None:
        words.append(f"anchor good to {entries['anchor_sigma']:.3f} m")
    return "; ".join([*words, f"{entries['crs']}", f"from {entries['processing_id']}"])


def write_geopackage(points: pd.DataFrame, path: str | Path, layer: str) -> None:
    """Write points as a GeoPackage of one layer.

    Parameters
    ----------
    points : DataFrame
        Points of :func:`flgpr.geo.georeference`.
    path : str or Path
        The file, which holds its old content or all of the new one.
    layer : str
        Name of the layer.

    Raises
    ------
    MissingExtraError
        Without geopandas and pyogrio, the extra ``gis``.
    OSError
        If the file cannot be written.
    """
    geopandas = optional("geopandas", "gis")
    optional("pyogrio", "gis")
    frame = geopandas.GeoDataFrame(
        _with_own_names(points.drop(columns=["longitude", "latitude"])),
        geometry=geopandas.points_from_xy(points["longitude"], points["latitude"]),
        crs="EPSG:4326",
    )
    _write_layer(frame, Path(path), layer)


def _with_own_names(points: pd.DataFrame) -> pd.DataFrame:
    """Return points whose columns have names that a GeoPackage tells apart, which knows no case."""
    taken = {*_COLUMNS_OF_GEOPACKAGE, *(str(name).casefold() for name in points)}
    seen = set(_COLUMNS_OF_GEOPACKAGE)
    names = []
    for name in map(str, points):
        number, own = 2, name
        while own.casefold() in seen or (own != name and own.casefold() in taken):
            number, own = number + 1, f"{name}_{number}"
        seen.add(own.casefold())
        names.append(own)
    renamed = [f"{old} as {new}" for old, new in zip(points, names, strict=True) if old != new]
    if renamed:
        log_note(f"columns that a GeoPackage does not tell apart: {', '.join(renamed)}")
    return points.set_axis(names, axis=1)


def write_outline(lane: Lane, path: str | Path, anchor: Anchor) -> None:
    """Write the outline of a lane as a GeoPackage of one polygon, WGS 84.

    Parameters
    ----------
    lane : Lane
        The lane.
    path : str or path
        The file to write.
    anchor : Anchor
        States where the lane lies.

    Raises
    ------
    MissingExtraError
        If geopandas or pyogrio is not installed.
    """
    geopandas = optional("geopandas", "gis")
    optional("pyogrio", "gis")
    geometry = optional("shapely.geometry", "gis")
    polygon = geometry.Polygon(anchor.to_geodetic(corners(lane))[:, :2])
    attributes = {"nature": ["outline of the surveyed lane"], "crs": ["EPSG:4326"]}
    frame = geopandas.GeoDataFrame(attributes, geometry=[polygon], crs="EPSG:4326")
    _write_layer(frame, Path(path), "lane")


def _write_layer(frame: Any, path: Path, layer: str) -> None:
    """Write a layer as a GeoPackage without the time of writing: equal points give equal bytes."""
    pyogrio = optional("pyogrio", "gis")
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z"})
    with atomic_output(path, replace=True) as partial, disk_errors():
        frame.to_file(partial, layer=layer, driver="GPKG", engine="pyogrio")


def corners(lane: Lane) -> FloatArray:
    """Return the corners of a lane at its mean ground, in order around it.

    Parameters
    ----------
    lane : Lane
        The lane.

    Returns
    -------
    (4, 3) ndarray of float
        Corners in the lane frame, m.
    """
    places = [(x, y, 0.0) for y in (lane.y_min, lane.y_max) for x in (lane.x_min, lane.x_max)]
    return np.array(places)[[0, 1, 3, 2]]
