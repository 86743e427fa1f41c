"""Alarms, truth and rasters on the Earth: GeoJSON, GeoPackage, KML, GPX, CSV, GeoTIFF.

Alarms are exported as evidence points: positions where the radar saw something, with the confidence
and the processing that they came from. They are never drawn as areas, and ground without a point is
not thereby free of hazards.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.geo.anchor import Anchor
from flgpr.geo.geodesy import transform_lonlat
from flgpr.model.lane import Lane
from flgpr.store.extras import optional
from flgpr.store.files import write_whole
from flgpr.store.outputs import atomic_output
from flgpr.store.tables import json_value, write_features, write_table

STATEMENT = (
    "Evidence points of a radar: something reflected here. They are not hazard areas, and ground "
    "without a point is not thereby free of hazards."
)
RUN_VIEW_QUANTITY = "magnitude over the gain background, no unit; no-data where no scan looked"
"""What the values of a run-view are."""
_UNWRITTEN = "it could not be written, is there room on the disk?"
_TILE = 512  # pixels
_KEYS = {"alarms": "alarm_id", "truth": "target_id", "objects": "object_id"}
NATURES = {"alarms": "evidence point", "truth": "emplaced target", "objects": "other object"}
_NOT_IN_XML = re.compile(r"[\x00-\x08\x0b-\x1f\ud800-\udfff]")
_KML = "http://www.opengis.net/kml/2.2"
_GPX = "http://www.topografix.com/GPX/1/1"


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
        The table with ``longitude``, ``latitude`` (WGS 84, degrees), ``height`` (ellipsoidal, m;
        NaN where the anchor has none), ``anchor_sigma`` (m, one standard deviation in the worst
        direction by the anchor alone), ``crs``, ``time``, ``processing_id`` and ``nature``; x and y
        are ``lane_x`` and ``lane_y``.

    Raises
    ------
    ValueError
        If the kind is unknown, x or y is missing, or the identity or time is not valid.
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
    on_ground = np.stack([x, y, np.zeros_like(x)], axis=-1)
    geodetic = anchor.to_geodetic(on_ground).reshape(-1, 3)
    out = table.rename(columns={"x": "lane_x", "y": "lane_y"}).reset_index(drop=True)
    out["longitude"] = geodetic[:, 0]
    out["latitude"] = geodetic[:, 1]
    out["height"] = geodetic[:, 2] if anchor.heights_known else np.nan
    out["anchor_sigma"] = anchor.uncertainty(x, y)
    out["crs"] = "EPSG:4326"
    out["time"] = stamp
    out["processing_id"] = processing_id
    out["nature"] = NATURES[kind]
    return out


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
    names = ["longitude", "latitude", "height"]
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


def write_kml(points: pd.DataFrame, path: str | Path, title: str) -> None:
    """Write points as KML 2.2 placemarks.

    Parameters
    ----------
    points : DataFrame
        Points of :func:`georeference`.
    path : str or Path
        The file, which holds its old content or all of the new one.
    title : str
        Title of the document.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
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
    _write_document(document, path)


def write_gpx(points: pd.DataFrame, path: str | Path) -> None:
    """Write points as GPX 1.1 waypoints, for a hand-held receiver.

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
    document, add = _document(_GPX, "gpx", version="1.1", creator="flgpr")
    if (points["nature"] == NATURES["alarms"]).any():
        add(add(document, "metadata"), "desc", STATEMENT)
    for number, row in enumerate(points.to_dict("records")):
        mark = add(document, "wpt", lat=f"{row['latitude']:.9f}", lon=f"{row['longitude']:.9f}")
        if row["time"]:
            add(mark, "time", row["time"])
        add(mark, "name", _name_of(row, number))
        position = f"x {row['lane_x']:.3f} m, y {row['lane_y']:.3f} m in the lane"
        add(mark, "desc", f"{row['nature']}: {position}")
    _write_document(document, path)


def _write_document(document: ElementTree.Element, path: str | Path) -> None:
    """Write an XML document to a file, which holds its old content or all of the new one."""
    text = ElementTree.tostring(document, encoding="utf-8", xml_declaration=True)
    write_whole(Path(path), text + b"\n")


def _document(space: str, root: str, **attributes: str) -> tuple[Any, Any]:
    """Return a new XML document of a name space, and a function that adds elements of it."""
    ElementTree.register_namespace("", space)

    def add(parent: Any, tag: str, text: Any = None, **attributes: str) -> Any:
        """Add an element with text to another and return it."""
        child = ElementTree.SubElement(parent, f"{{{space}}}{tag}", attributes)
        child.text = None if text is None else xml_text(str(text))
        return child

    return ElementTree.Element(f"{{{space}}}{root}", attributes), add


def xml_text(text: str) -> str:
    """Return a text with question marks for the characters that XML does not allow."""
    return _NOT_IN_XML.sub("?", text)


def _name_of(row: Mapping[Any, Any], number: int) -> str:
    """Return the name of a point, or its number from 1 if it has none."""
    for key in _KEYS.values():
        if isinstance(row.get(key), str):
            return str(row[key])
    return f"{number + 1}"


def write_geopackage(points: pd.DataFrame, path: str | Path, layer: str) -> None:
    """Write points as a GeoPackage of one layer.

    Parameters
    ----------
    points : DataFrame
        Points of :func:`georeference`.
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
        points.drop(columns=["longitude", "latitude"]),
        geometry=geopandas.points_from_xy(points["longitude"], points["latitude"]),
        crs="EPSG:4326",
    )
    _write_layer(frame, Path(path), layer)


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
    with atomic_output(path, replace=True) as partial, _disk_errors():
        frame.to_file(partial, layer=layer, driver="GPKG", engine="pyogrio")


@contextmanager
def _disk_errors() -> Iterator[None]:
    """Turn an error of GDAL without a number, which mostly means a full disk, into that error."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise OSError(errno.ENOSPC, f"{_UNWRITTEN} ({error})") from None


def corners(lane: Lane) -> NDArray[np.float64]:
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
    return np.array(
        [
            [lane.x_min, lane.y_min, 0.0],
            [lane.x_max, lane.y_min, 0.0],
            [lane.x_max, lane.y_max, 0.0],
            [lane.x_min, lane.y_max, 0.0],
        ]
    )


def write_geotiff(
    view: xr.DataArray,
    path: str | Path,
    anchor: Anchor,
    processing_id: str,
    crs: str | None = None,
    quantity: str | None = None,
    tags: Mapping[str, str] | None = None,
) -> float:
    """Write magnitudes as Cloud Optimized GeoTIFF, one band per polarization and sub-band.

    The raster keeps the lane's pixels, turned by its geotransform, so that nothing is resampled.
    It has tiles of 512 x 512 pixels. Where it is larger than one tile it also has overviews, each
    with half the pixels across and along of the one before. A pixel of an overview is the root of
    the mean square of those below it, so that it shows their mean power; pixels without a value
    do not count.

    Parameters
    ----------
    view : (..., y, x) DataArray
        Magnitudes, such as a run-view, of at least two pixels both ways; NaN where nothing was
        seen.
    path : str or Path
        The file, which holds its old content or all of the new one.
    anchor : Anchor
        Where the lane lies.
    processing_id : str
        What the view came from, a tag of the file.
    crs : str, optional
        A projected reference system, by default the UTM zone.
    quantity : str, optional
        What the values are and in which unit, a tag of the file; by default those of a run-view.
    tags : mapping of str to str, optional
        Further tags of the file.

    Returns
    -------
    float
        Largest misfit of the geotransform, m: a map is not quite a turned lane.

    Raises
    ------
    ValueError
        If the view's axes or the system are not valid.
    MissingExtraError
        Without rasterio, the extra ``gis``.
    OSError
        If the file cannot be written.
    """
    rasterio = optional("rasterio", "gis")
    x = _axis(view, "x")
    y = _axis(view, "y")
    crs = crs or anchor.utm()
    bands = view.values.reshape(-1, y.size, x.size)[:, ::-1].astype(np.float32)
    transform, misfit = _geotransform(x, y, anchor, crs, rasterio)
    names = ["run-view"] * len(bands)
    if view.ndim == 4:
        outer, inner = (view[name].values for name in view.dims[:2])
        names = [f"{first} {second}" for first in outer for second in inner]
    sigma = float(anchor.uncertainty(float(x.mean()), float(y.mean())))
    all_tags = {
        **dict(tags or {}),
        "flgpr_processing_id": processing_id,
        "flgpr_quantity": quantity or RUN_VIEW_QUANTITY,
        "flgpr_anchor_sigma_m": f"{sigma:.4g}",
        "flgpr_geotransform_misfit_m": f"{misfit:.3g}",
        "flgpr_statement": STATEMENT,
    }
    data = _cloud_optimized(bands, names, crs, transform, all_tags, rasterio)
    write_whole(Path(path), data)
    return misfit


def _cloud_optimized(
    bands: NDArray[np.float32],
    names: Sequence[str],
    crs: str,
    transform: Any,
    tags: Mapping[str, str],
    rasterio: Any,
) -> bytes:
    """Return the bytes of a Cloud Optimized GeoTIFF of bands (band, row, column).

    It is made in memory: GDAL leaves files of its own beside one on disk when it is killed, and
    does not report a full disk.
    """
    count, height, width = bands.shape
    profile = {
        "driver": "COG",
        "dtype": "float32",
        "nodata": float("nan"),
        "width": width,
        "height": height,
        "count": count,
        "crs": crs,
        "transform": transform,
        "BLOCKSIZE": _TILE,
        "COMPRESS": "DEFLATE",
        "PREDICTOR": "YES",
        # Magnitudes are averaged as powers.
        "RESAMPLING": "RMS",
        "BIGTIFF": "IF_SAFER",
    }
    with rasterio.MemoryFile() as memory:
        with memory.open(**profile) as file:
            file.write(bands)
            file.update_tags(**tags)
            for number, name in enumerate(names):
                file.set_band_description(number + 1, name)
        with memory.open() as file:
            if not np.array_equal(file.read(), bands, equal_nan=True):
                raise OSError(errno.EIO, "the GDAL library wrote a raster that reads otherwise")
        return bytes(memory.getbuffer())


def _geotransform(x: Any, y: Any, anchor: Anchor, crs: str, rasterio: Any) -> tuple[Any, float]:
    """Fit the affine map from pixels to a projected system, and return its largest misfit, m."""
    columns, rows = np.meshgrid(np.linspace(0, x.size, 5), np.linspace(0, y.size, 5))
    across = x[0] + (columns - 0.5) * (x[1] - x[0])
    along = y[-1] - (rows - 0.5) * (y[1] - y[0])
    lane = np.stack([across, along, np.zeros_like(rows)], axis=-1)
    projected = transform_lonlat(anchor.to_geodetic(lane)[..., :2], crs).reshape(-1, 2)
    # Eastings and northings are large numbers: the fit is made about their mean.
    middle = projected.mean(axis=0)
    design = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)], axis=1)
    coefficients, *_ = np.linalg.lstsq(design, projected - middle, rcond=None)
    residual = design @ coefficients - (projected - middle)
    misfit = float(np.linalg.norm(residual, axis=1).max())
    (a, d), (b, e), (c, f) = coefficients
    return rasterio.Affine(a, b, c + middle[0], d, e, f + middle[1]), misfit


def _axis(view: xr.DataArray, name: str) -> Any:
    """Return an axis of a run-view, which must be uniform and rising."""
    values = np.asarray(view[name].values, dtype=np.float64)
    has_axes = view.dims[-2:] == ("y", "x") and values.size >= 2
    step = np.diff(values)
    if not has_axes or step.min() <= 0 or np.ptp(step) > 1e-6 * step.mean():
        raise ValueError(
            f"view must have the dimensions (..., y, x), both uniform and rising; {name} is not"
        )
    return values


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
