"""Reference systems, and positions on the Earth in them: longitude, latitude, plane, geocentric."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from flgpr.store.notes import log_note
from flgpr.types import ArrayLike, FloatArray, floats

if TYPE_CHECKING:
    from pyproj import CRS, Transformer
_FILE_OF_SYSTEMS = re.compile(r"\binit\s*=\s*(?!epsg:\d+\b)", re.IGNORECASE)
"""A PROJ string whose system is in a file; such a file is opened when the string is read."""
_FILE_IN_WKT = re.compile(
    r'PARAMETERFILE\s*\[\s*"[^"]*"\s*,\s*"(?!@null")|grids\s*=\s*(?!@null\b)|\bfile\s*=',
    re.IGNORECASE,
)
"""WKT of a system whose points are shifted by a grid in a file; ``@null`` is none."""
_TURN = 360.0
_ON_EDGE = 0.05  # degrees outside of a system's area that are still on its edge
GEODETIC = "EPSG:4979"
GEOCENTRIC = "EPSG:4978"


def geocentric(origin: tuple[float, float, float]) -> FloatArray:
    """Return geocentric coordinates of a geodetic position.

    Parameters
    ----------
    origin : (3,) tuple of float
        Longitude and latitude, degrees, and ellipsoidal height, m (WGS 84).

    Returns
    -------
    (3,) ndarray of float
        Coordinates, m.
    """
    return np.array(transformer_of(GEODETIC, GEOCENTRIC).transform(*origin), dtype=np.float64)


def east_north_up(origin: tuple[float, float, float]) -> FloatArray:
    """Return the unit vectors to east, north and up in geocentric axes.

    Parameters
    ----------
    origin : (3,) tuple of float
        Longitude and latitude, degrees, and height, m, at which they point so.

    Returns
    -------
    (3, 3) ndarray of float
        A vector per row.
    """
    lon = math.radians(origin[0])
    lat = math.radians(origin[1])
    cos_lon = math.cos(lon)
    sin_lon = math.sin(lon)
    cos_lat = math.cos(lat)
    sin_lat = math.sin(lat)
    east = [-sin_lon, cos_lon, 0.0]
    north = [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat]
    up = [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat]
    return np.array([east, north, up])


def transform_lonlat(lonlat: ArrayLike, crs: str) -> FloatArray:
    """Return easting and northing of WGS 84 longitude and latitude.

    Parameters
    ----------
    lonlat : (..., 2) array_like of float
        Longitude and latitude, degrees.
    crs : str
        A projected reference system.

    Returns
    -------
    (..., 2) ndarray of float
        Easting and northing, m.

    Raises
    ------
    ValueError
        If there is no such system, or it names a file to be read.
    """
    points = np.moveaxis(floats(lonlat), -1, 0)
    return np.stack(transformer_of("EPSG:4326", reference_system(crs)).transform(*points), axis=-1)


def lonlat_of(points: ArrayLike, crs: str) -> FloatArray:
    """Return WGS 84 longitude and latitude of easting and northing.

    Parameters
    ----------
    points : (..., 2) array_like of float
        Easting and northing, m.
    crs : str
        Their reference system, a projected one.

    Returns
    -------
    (..., 2) ndarray of float
        Longitude and latitude, degrees.

    Raises
    ------
    ValueError
        If the system is not projected, or the points do not lie where it holds.
    """
    system = system_of_kind(crs, geographic=False)
    projected = floats(points)
    lonlat, _ = to_wgs84(system, projected.reshape(-1, 2))
    return lonlat.reshape(projected.shape)


def transformer_of(source: Any, target: Any) -> Transformer:
    """Return the transformation between two systems, longitude or easting first.

    Parameters
    ----------
    source, target : str or pyproj.CRS
        The systems.

    Returns
    -------
    pyproj.Transformer
        The transformation.
    """
    from pyproj import Transformer  # slow, and many commands have no anchor

    return Transformer.from_crs(source, target, always_xy=True)


def reference_system(crs: str) -> CRS:
    """Return the reference system of a registry's name, of WKT or of a PROJ string.

    Grids that PROJ itself knows for a system of a registry are used.

    Parameters
    ----------
    crs : str
        The name, such as EPSG:32633, or the text.

    Returns
    -------
    pyproj.CRS
        The system.

    Raises
    ------
    ValueError
        If there is none, or it names a file, such as a grid of shifts: it could be any file, and it
        would be read, or waited for, when the first point is transformed.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    rule = f"crs must be a reference system such as EPSG:32633, got {crs!r}"
    if _FILE_OF_SYSTEMS.search(crs):
        raise ValueError(f"{rule}, which names a file")
    try:
        system = CRS.from_user_input(crs)
    except CRSError:
        raise ValueError(rule) from None
    if _FILE_IN_WKT.search(system.to_wkt()):
        raise ValueError(f"{rule}, which names a file")
    return system


def system_of_kind(crs: str, geographic: bool | None) -> CRS:
    """Return a reference system in metres or degrees, of the kind that is asked for.

    Parameters
    ----------
    crs : str
        The system.
    geographic : bool or None
        Whether it must be one of longitude and latitude; None takes either kind.

    Returns
    -------
    pyproj.CRS
        The system.

    Raises
    ------
    ValueError
        If there is none, it names a file, or it is of another kind or in other units.
    """
    system = reference_system(crs)
    if not (system.is_geographic or system.is_projected):
        raise ValueError(f"crs must be geographic or projected, got {crs!r} ({system.type_name})")
    if geographic is not None and geographic != system.is_geographic:
        coordinates = "longitude and latitude" if system.is_geographic else "easting and northing"
        raise ValueError(f"points in {crs} must be given as {coordinates}")
    units = {axis.unit_name for axis in system.axis_info[:2]}
    if not units <= {"metre", "degree"}:
        raise ValueError(f"crs must be in metres or degrees, got {crs!r} in {', '.join(units)}")
    return system


def axes_of(system: CRS) -> tuple[str, str]:
    """Return where the axes of a reference system point, in the order of its transformations.

    Parameters
    ----------
    system : pyproj.CRS
        The system.

    Returns
    -------
    tuple of str
        "east" and "north" of nearly all; of others "west", "south", or another direction.
    """
    first, second = (axis.direction for axis in system.axis_info[:2])
    # Transformations put an easting first; other axes stay in their order.
    is_swapped = (first, second) == ("north", "east")
    return ("east", "north") if is_swapped or system.is_geographic else (first, second)


def _degrees_outside(system: CRS, lonlat: FloatArray) -> float:
    """Return how far points (point, 2), degrees, are outside of the area of use of a system."""
    area = system.area_of_use
    if area is None:
        return 0.0
    middle = lonlat[0]
    width = (area.east - area.west) % _TURN or _TURN
    past_west = (middle[0] - area.west) % _TURN
    aside = 0.0 if past_west <= width else min(past_west - width, _TURN - past_west)
    above = max(area.south - middle[1], middle[1] - area.north, 0.0)
    return float(max(aside, above))


def _note_area(system: CRS, lonlat: FloatArray) -> None:
    """Log a note if points lie outside of the area for which a system is made."""
    outside = _degrees_outside(system, lonlat)
    if outside > _ON_EDGE:
        area = system.area_of_use
        log_note(
            f"points at {lonlat[0, 1]:.4f} N {lonlat[0, 0]:.4f} E lie {outside:.2g} degrees outside "
            f"of the area of use of {system.to_string()} ({area.name[:60]}): is it the right system?"
        )


def to_wgs84(system: CRS, points: FloatArray) -> tuple[FloatArray, float]:
    """Return longitude and latitude of points, and the stated accuracy of this.

    Parameters
    ----------
    system : pyproj.CRS
        Their reference system.
    points : (point, 2) ndarray
        Easting and northing, m, or longitude and latitude, degrees.

    Returns
    -------
    lonlat : (point, 2) ndarray
        WGS 84 longitude and latitude, degrees.
    accuracy : float
        Of the step to WGS 84, m; NaN where the registry states none.

    Raises
    ------
    ValueError
        If the points do not lie where the system holds.
    """
    from pyproj.exceptions import ProjError

    transformer = transformer_of(system, "EPSG:4326")
    along = axes_of(system)
    candidates = [points]
    if along != ("east", "north"):
        # Some give a westing as such, others as a negative easting.
        signs = [-1 if axis in ("west", "south") else 1 for axis in along]
        ordered = points[:, ::-1] if along[0] in ("north", "south") else points
        candidates = [ordered, (points * sorted(signs))[:, :: 1 if ordered is points else -1]]
    fault: Exception | None = None
    found: list[FloatArray] = []
    for candidate in candidates:
        try:
            lon, lat = transformer.transform(candidate[:, 0], candidate[:, 1], errcheck=True)
        except ProjError as error:
            fault = error
            continue
        lonlat = np.stack([lon, lat], axis=-1)
        if np.isfinite(lonlat).all() and np.abs(lonlat[:, 1]).max() <= 89.9:
            found.append(lonlat)
    if not found:
        reason = f": {fault}" if fault else f", got {points[0]}"
        raise ValueError(
            f"anchor points must lie where {system.to_string()} holds{reason}"
        ) from None
    lonlat = min(found, key=lambda one: _degrees_outside(system, one))
    if len(candidates) > 1:
        log_note(
            f"the axes of {system.to_string()} point to {along[0]} and {along[1]}: easting and "
            "northing are read as it counts them, or as negative ones where that lies in its area"
        )
    _note_area(system, lonlat)
    accuracy = transformer.accuracy
    if accuracy is None or accuracy < 0:
        return lonlat, math.nan
    return lonlat, float(accuracy)
