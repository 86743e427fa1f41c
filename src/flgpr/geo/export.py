"""Alarms, truth and run-views on the Earth: GeoJSON, GeoPackage, KML, GPX, CSV and GeoTIFF.

Alarms leave as evidence points: a place where the radar saw something, with its confidence and what processing it came
from. They are never drawn as areas, and an empty place between them says nothing.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.geo.anchor import Anchor, transform_lonlat
from flgpr.model.lane import Lane
from flgpr.store.extras import optional
from flgpr.store.files import write_whole
from flgpr.store.outputs import whole_output
from flgpr.store.tables import json_value, write_features, write_table

STATEMENT = (
    "Evidence points of a radar: something reflected here. They are not hazard areas, and ground without a point is "
    "not thereby free of hazards."
)
_UNWRITTEN = "it could not be written, is there room on the disk?"
_KEYS = {"alarms": "alarm_id", "truth": "target_id", "objects": "object_id"}
NATURES = {"alarms": "evidence point", "truth": "emplaced target", "objects": "other object"}
_KML = "http://www.opengis.net/kml/2.2"
_GPX = "http://www.topografix.com/GPX/1/1"


def georeference(
    table: pd.DataFrame, anchor: Anchor, kind: str, processing_id: str, time: str | None = None
) -> pd.DataFrame:
    """Put a table with x and y, of the ``kind`` "alarms", "truth" or "objects", on the Earth.

    It gets ``longitude``, ``latitude`` (WGS 84, degrees), ``height`` (ellipsoidal, m; NaN where the anchor has none),
    ``anchor_sigma`` (m, one standard deviation in the worst direction by the anchor alone), ``crs``, ``time`` (ISO 8601
    with a time zone), ``processing_id`` (what the rows came from, such as a manifest's digest) and ``nature``; x and y
    stay, as ``lane_x`` and ``lane_y``.
    """
    if kind not in _KEYS:
        raise ValueError(f"kind must be one of {', '.join(_KEYS)}, got {kind!r}")
    missing = [name for name in ("x", "y") if name not in table.columns]
    if missing:
        raise ValueError(f"{kind} must have x and y, got {', '.join(map(str, table.columns))}")
    if not processing_id:
        raise ValueError("processing_id must say what the rows came from, got nothing")
    stamp = "" if time is None else _stamp(time)
    x = table["x"].to_numpy(dtype=np.float64)
    y = table["y"].to_numpy(dtype=np.float64)
    places = anchor.to_geodetic(np.stack([x, y, np.zeros_like(x)], axis=-1)).reshape(-1, 3)
    out = table.rename(columns={"x": "lane_x", "y": "lane_y"}).reset_index(drop=True)
    out["longitude"] = places[:, 0]
    out["latitude"] = places[:, 1]
    out["height"] = places[:, 2] if anchor.heights_known else np.nan
    out["anchor_sigma"] = anchor.uncertainty(x, y)
    out["crs"] = "EPSG:4326"
    out["time"] = stamp
    out["processing_id"] = processing_id
    out["nature"] = NATURES[kind]
    return out


def write_earth_geojson(
    points: pd.DataFrame, path: str | Path, about: Mapping[str, Any] | None = None
) -> None:
    """Write points of :func:`georeference` as GeoJSON (RFC 7946), ``about`` in its member ``flgpr``."""
    names = ["longitude", "latitude", "height"]
    places = [
        [round(lon, 9), round(lat, 9), *([round(height, 4)] if np.isfinite(height) else [])]
        for lon, lat, height in points[names].to_numpy(dtype=float).tolist()
    ]
    head = {"flgpr": {"statement": STATEMENT, **dict(about or {})}}
    write_features(path, places, points.drop(columns=names), head)


def write_earth_csv(points: pd.DataFrame, path: str | Path) -> None:
    """Write points of :func:`georeference` as CSV, whole or not at all.

    Cells that a spreadsheet would take for formulas are quoted (:func:`flgpr.store.write_table`).
    """
    write_table(points, path)


def write_kml(points: pd.DataFrame, path: str | Path, title: str) -> None:
    """Write points of :func:`georeference` as KML 2.2 placemarks under a title; the file is whole or absent."""
    document, add = _document(_KML, "kml")
    body = add(document, "Document")
    add(body, "name", title)
    add(body, "description", STATEMENT)
    for number, row in enumerate(points.to_dict("records")):
        mark = add(body, "Placemark")
        add(mark, "name", _name_of(row, number))
        if row["time"]:
            add(add(mark, "TimeStamp"), "when", row["time"])
        data = add(mark, "ExtendedData")
        for key, value in row.items():
            text = json_value(value)
            add(add(data, "Data", name=str(key)), "value", "" if text is None else text)
        # Heights in KML are over the geoid, ours over the ellipsoid: the points lie on the ground
        # instead.
        add(add(mark, "Point"), "coordinates", f"{row['longitude']:.9f},{row['latitude']:.9f}")
    write_whole(
        Path(path), ElementTree.tostring(document, encoding="utf-8", xml_declaration=True) + b"\n"
    )


def write_gpx(points: pd.DataFrame, path: str | Path) -> None:
    """Write points of :func:`georeference` as GPX 1.1 waypoints, for a receiver in the hand; whole or absent."""
    document, add = _document(_GPX, "gpx", version="1.1", creator="flgpr")
    if (points["nature"] == NATURES["alarms"]).any():
        add(add(document, "metadata"), "desc", STATEMENT)
    for number, row in enumerate(points.to_dict("records")):
        mark = add(document, "wpt", lat=f"{row['latitude']:.9f}", lon=f"{row['longitude']:.9f}")
        if row["time"]:
            add(mark, "time", row["time"])
        add(mark, "name", _name_of(row, number))
        add(
            mark,
            "desc",
            f"{row['nature']}: x {row['lane_x']:.3f} m, y {row['lane_y']:.3f} m in the lane",
        )
    write_whole(
        Path(path), ElementTree.tostring(document, encoding="utf-8", xml_declaration=True) + b"\n"
    )


def _document(space: str, root: str, **attributes: str) -> tuple[Any, Any]:
    """Begin an XML document of a name space; with what adds an element to another, text made fit for XML."""
    ElementTree.register_namespace("", space)

    def add(parent: Any, tag: str, text: Any = None, **attributes: str) -> Any:
        child = ElementTree.SubElement(parent, f"{{{space}}}{tag}", attributes)
        child.text = None if text is None else printable(str(text))
        return child

    return ElementTree.Element(f"{{{space}}}{root}", attributes), add


def printable(text: str) -> str:
    """Replace what XML does not allow in a text by question marks."""
    return "".join(
        c if c in "\t\n" or (c >= " " and not "\ud800" <= c <= "\udfff") else "?" for c in text
    )


def _name_of(row: Mapping[Any, Any], number: int) -> str:
    return next(
        (row[key] for key in _KEYS.values() if isinstance(row.get(key), str)), f"{number + 1}"
    )


def write_geopackage(points: pd.DataFrame, path: str | Path, layer: str) -> None:
    """Write points of :func:`georeference` as a GeoPackage of one layer, whole or absent (geopandas, pyogrio)."""
    geopandas = optional("geopandas", "gis")
    optional("pyogrio", "gis")
    frame = geopandas.GeoDataFrame(
        points.drop(columns=["longitude", "latitude"]),
        geometry=geopandas.points_from_xy(points["longitude"], points["latitude"]),
        crs="EPSG:4326",
    )
    _write_layer(frame, Path(path), layer)


def write_outline(lane: Lane, path: str | Path, anchor: Anchor) -> None:
    """Write the outline of a lane as a GeoPackage of one polygon, WGS 84; whole or absent (geopandas, pyogrio)."""
    geopandas = optional("geopandas", "gis")
    optional("pyogrio", "gis")
    polygon = optional("shapely.geometry", "gis").Polygon(anchor.to_geodetic(corners(lane))[:, :2])
    told = {"nature": ["outline of the surveyed lane"], "crs": ["EPSG:4326"]}
    frame = geopandas.GeoDataFrame(told, geometry=[polygon], crs="EPSG:4326")
    _write_layer(frame, Path(path), "lane")


def _write_layer(frame: Any, path: Path, layer: str) -> None:
    """Write a layer as a GeoPackage that tells no time of writing: the same points give the same bytes."""
    pyogrio = optional("pyogrio", "gis")
    pyogrio.set_gdal_config_options({"OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z"})
    with whole_output(path, replace=True) as partial, _disk_errors():
        frame.to_file(partial, layer=layer, driver="GPKG", engine="pyogrio")


@contextmanager
def _disk_errors() -> Iterator[None]:
    """Take what a library of maps says when it cannot write for what it mostly means."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise OSError(errno.ENOSPC, f"{_UNWRITTEN} ({error})") from None


def corners(lane: Lane) -> NDArray[np.float64]:
    """Corners of a lane at its mean ground, (4, 3), m, going round."""
    x, y = (lane.x_min, lane.x_max), (lane.y_min, lane.y_max)
    return np.array([[x[i], y[k], 0.0] for i, k in ((0, 0), (1, 0), (1, 1), (0, 1))])


def write_geotiff(
    view: xr.DataArray, path: str | Path, anchor: Anchor, processing_id: str, crs: str | None = None
) -> float:
    """Write a run-view (..., y, x) as GeoTIFF: one band of magnitudes per polarization and sub-band.

    The raster keeps the lane's pixels, turned by its geotransform, so nothing is resampled; what is given back is the
    largest misfit of that, m, for a map is not quite a turned lane. ``processing_id`` is kept as a tag, ``crs`` is a
    projected reference system, by default the UTM zone. The file is whole or absent. It needs rasterio
    (MissingExtraError), and a view of at least two pixels both ways.
    """
    rasterio = optional("rasterio", "gis")
    x = _axis(view, "x")
    y = _axis(view, "y")
    crs = crs or anchor.utm()
    bands = view.values.reshape(-1, y.size, x.size)[:, ::-1].astype(np.float32)
    transform, misfit = _geotransform(x, y, anchor, crs, rasterio)
    names = ["run-view"] * len(bands)
    if view.ndim == 4:
        first, second = (view[name].values for name in view.dims[:2])
        names = [f"{a} {b}" for a in first for b in second]
    middle = float(x.mean()), float(y.mean())
    tags = {
        "flgpr_processing_id": processing_id,
        "flgpr_quantity": "magnitude over the gain background, no unit; no-data where no scan looked",
        "flgpr_anchor_sigma_m": f"{float(anchor.uncertainty(*middle)):.4g}",
        "flgpr_geotransform_misfit_m": f"{misfit:.3g}",
        "flgpr_statement": STATEMENT,
    }
    profile = {"driver": "GTiff", "dtype": "float32", "nodata": float("nan"), "compress": "deflate"}
    profile |= {
        "width": x.size,
        "height": y.size,
        "count": len(bands),
        "crs": crs,
        "transform": transform,
    }
    with whole_output(Path(path), replace=True) as partial, _disk_errors():
        with rasterio.open(partial, "w", **profile) as file:
            file.write(bands)
            file.update_tags(**tags)
            for number, name in enumerate(names):
                file.set_band_description(number + 1, name)
        _check_written(partial, bands, rasterio)
    return misfit


def _check_written(path: Path, bands: NDArray[np.float32], rasterio: Any) -> None:
    """Read a raster again: the library that writes it tells of no full disk."""
    try:
        with rasterio.open(path) as file:
            same = np.array_equal(file.read(), bands, equal_nan=True)
    except (OSError, RuntimeError):
        same = False
    if not same:
        raise OSError(errno.ENOSPC, f"{_UNWRITTEN}, for what was written does not read the same")


def _geotransform(x: Any, y: Any, anchor: Anchor, crs: str, rasterio: Any) -> tuple[Any, float]:
    columns, rows = np.meshgrid(np.linspace(0, x.size, 5), np.linspace(0, y.size, 5))
    dx = x[1] - x[0]
    dy = y[1] - y[0]
    lane = np.stack(
        [x[0] + (columns - 0.5) * dx, y[-1] - (rows - 0.5) * dy, np.zeros_like(rows)], axis=-1
    )
    target = transform_lonlat(anchor.to_geodetic(lane)[..., :2], crs).reshape(-1, 2)
    middle = target.mean(axis=0)
    design = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)], axis=1)
    found, *_ = np.linalg.lstsq(design, target - middle, rcond=None)
    misfit = float(np.linalg.norm(design @ found - (target - middle), axis=1).max())
    (a, d), (b, e), (c, f) = found
    return rasterio.Affine(a, b, c + middle[0], d, e, f + middle[1]), misfit


def _axis(view: xr.DataArray, name: str) -> Any:
    values = np.asarray(view[name].values, dtype=np.float64)
    step = np.diff(values)
    if (
        view.dims[-2:] != ("y", "x")
        or values.size < 2
        or step.min() <= 0
        or np.ptp(step) > 1e-6 * step.mean()
    ):
        raise ValueError(
            f"view must have the dimensions (..., y, x), both uniform and rising; {name} is not"
        )
    return values


def _stamp(time: str) -> str:
    try:
        moment = datetime.fromisoformat(time)
    except ValueError:
        raise ValueError(
            f"time must be ISO 8601 such as 2026-11-21T12:00:00Z, got {time!r}"
        ) from None
    if moment.tzinfo is None:
        raise ValueError(f"time must have a time zone, got {time!r}")
    return moment.isoformat()
