"""Where a lane lies on Earth: an anchor fitted to surveyed points, with its uncertainty."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from flgpr.door import parse_toml, read_named
from flgpr.model.faults import first_fault
from flgpr.model.frames import heading_matrix
from flgpr.store.files import existing, faults_of

FloatArray = NDArray[np.float64]
_FILE_OF_SYSTEMS = re.compile(r"\binit\s*=\s*(?!epsg:\d+\b)", re.IGNORECASE)
"""A PROJ string whose system stands in a file; such files are opened when the string is read."""
_FILE_IN_WKT = re.compile(
    r'PARAMETERFILE\s*\[\s*"[^"]*"\s*,\s*"(?!@null")|grids\s*=\s*(?!@null\b)|\bfile\s*=',
    re.IGNORECASE,
)
"""WKT of a system whose points are shifted by what a file holds; ``@null`` is none."""
GEODETIC = "EPSG:4979"
GEOCENTRIC = "EPSG:4978"


@dataclass(frozen=True)
class Anchor:
    """A rigid tie of the lane frame to the Earth (WGS 84)."""

    #: longitude, latitude (degrees) and ellipsoidal height (m) of the plane's point of contact
    origin: tuple[float, float, float]
    azimuth: float  #: direction of the lane's +y, clockwise from true north at the origin, rad
    shift: tuple[
        float, float, float
    ]  #: lane frame's origin east, north and up of the contact point, m
    #: mean x and y of the surveyed points in the lane frame, m; the uncertainty is least there
    center: tuple[float, float]
    sigma: float  #: standard deviation of one coordinate of one surveyed point, m
    count: int  #: number of surveyed points
    #: sum of squared distances of the surveyed points from their mean, m²; infinite where the direction was given
    spread: float
    sigma_azimuth: float  #: standard deviation of a given direction, rad; 0 where it was fitted
    residuals: tuple[float, ...]  #: horizontal misfit of each surveyed point, m
    crs: str  #: reference system the points were surveyed in
    #: stated accuracy of the step from that system to WGS 84, m; NaN where the registry states none
    crs_accuracy: float
    #: whether the points had heights; else the lane's ground is put on the ellipsoid
    heights_known: bool

    def to_geocentric(self, position: ArrayLike) -> FloatArray:
        """Take points (..., 3) from the lane frame to geocentric (Earth-centred, Earth-fixed) WGS 84 coordinates, m."""
        return geocentric(self.origin) + self.turn(position, shifted=True)

    def turn(self, vector: ArrayLike, shifted: bool = False) -> FloatArray:
        """Turn vectors, or points to which the anchor's shift is added first, from lane to geocentric axes."""
        level = np.asarray(vector, dtype=np.float64) @ heading_matrix(self.azimuth).T
        return (level + (self.shift if shifted else 0.0)) @ east_north_up(self.origin)

    def from_geocentric(self, position: ArrayLike) -> FloatArray:
        """Take geocentric points (..., 3) to the lane frame, the inverse of :meth:`to_geocentric`."""
        local = (np.asarray(position, dtype=np.float64) - geocentric(self.origin)) @ east_north_up(
            self.origin
        ).T
        return (local - self.shift) @ heading_matrix(self.azimuth)

    def to_lonlat(self, points: ArrayLike) -> FloatArray:
        """Return WGS 84 longitude and latitude (..., 2), degrees, of points in the anchor's system.

        Points are easting and northing (..., 2), m. A system that is not projected is a ValueError.
        """
        return lonlat_of(points, self.crs)

    def to_geodetic(self, position: ArrayLike) -> FloatArray:
        """Take points (..., 3) from the lane frame to WGS 84 longitude, latitude (degrees) and height (m)."""
        xyz = self.to_geocentric(position)
        lon, lat, height = _geodesy(GEOCENTRIC, GEODETIC).transform(*np.moveaxis(xyz, -1, 0))
        return np.stack([lon, lat, height], axis=-1)

    def from_geodetic(self, position: ArrayLike) -> FloatArray:
        """Take WGS 84 longitude, latitude (degrees) and height (m), (..., 3), to the lane frame."""
        xyz = _geodesy(GEODETIC, GEOCENTRIC).transform(
            *np.moveaxis(np.asarray(position, dtype=np.float64), -1, 0)
        )
        return self.from_geocentric(np.stack(xyz, axis=-1))

    def uncertainty(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Tell how well the anchor knows a place: the standard deviation in the worst horizontal direction, m.

        Across the line from the points' mean, at distance r, the variance is ``σ²·(1/n + r²/spread) + r²·σ_azimuth²``,
        that of a least-squares fit. What the radar itself does not know comes on top.
        """
        r2 = (np.asarray(x, dtype=np.float64) - self.center[0]) ** 2 + (
            np.asarray(y) - self.center[1]
        ) ** 2
        return np.asarray(
            np.sqrt(
                self.sigma**2 * (1 / self.count + r2 / self.spread) + r2 * self.sigma_azimuth**2
            )
        )

    def georeference(self) -> dict[str, float]:
        """Give the run attribute ``georeference``: ``latitude``, ``longitude`` and ``azimuth`` of +y, degrees."""
        longitude, latitude, _ = (float(value) for value in self.to_geodetic(np.zeros(3)))
        return {"latitude": latitude, "longitude": longitude, "azimuth": math.degrees(self.azimuth)}

    def utm(self) -> str:
        """Name the UTM zone (WGS 84) the lane lies in, such as ``EPSG:32633``."""
        lon, lat, _ = self.origin
        return f"EPSG:{(32600 if lat >= 0 else 32700) + min(int((lon + 180) // 6) + 1, 60)}"


class _Point(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str = ""
    lane: tuple[float, float] | tuple[float, float, float]
    easting: float | None = None
    northing: float | None = None
    longitude: float | None = None
    latitude: float | None = None
    height: float | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> _Point:
        plane = self.easting is not None and self.northing is not None
        globe = self.longitude is not None and self.latitude is not None
        count = sum(
            v is not None for v in (self.easting, self.northing, self.longitude, self.latitude)
        )
        if plane == globe or count != 2:
            raise ValueError("give easting and northing, or longitude and latitude")
        return self


class _AnchorFile(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    crs: str
    accuracy: Annotated[float, Field(gt=0)]
    azimuth_deg: float | None = None
    azimuth_accuracy_deg: Annotated[float, Field(ge=0)] | None = None
    point: list[_Point]

    @model_validator(mode="after")
    def _direction(self) -> _AnchorFile:
        if (self.azimuth_deg is None) != (self.azimuth_accuracy_deg is None):
            raise ValueError("azimuth_deg and azimuth_accuracy_deg go together")
        if (len(self.point) >= 2) == (self.azimuth_deg is not None) or not self.point:
            raise ValueError(
                "give two or more points, or one point and azimuth_deg with azimuth_accuracy_deg"
            )
        return self


def own_anchor(reference: Mapping[str, Any]) -> Anchor:
    """Make the anchor of a run's attribute ``georeference``; how well it ties the lane is not known (NaN)."""
    named = reference if isinstance(reference, Mapping) else {}
    told = [named.get(name) for name in ("longitude", "latitude", "azimuth")]
    if not all(isinstance(one, int | float) and math.isfinite(one) for one in told):
        raise ValueError(
            f"georeference must have longitude, latitude and azimuth in degrees, got {reference!r}"
        )
    longitude, latitude, azimuth = map(float, told)  # type: ignore[arg-type]
    return Anchor(
        (longitude, latitude, 0.0), math.radians(azimuth), (0.0, 0.0, 0.0), (0.0, 0.0), math.nan, 1, math.inf, 0.0, (),
        GEODETIC, math.nan, False,
    )  # fmt: skip


def read_anchor(path: str | Path) -> Anchor:
    """Read an anchor from TOML: ``crs``, ``accuracy`` (m) and a ``[[point]]`` for every surveyed point.

    A point has ``lane`` (x, y or x, y, z in m), either ``easting`` and ``northing`` or ``longitude`` and ``latitude``
    in the reference system, and optionally an ellipsoidal ``height``. One point alone needs ``azimuth_deg``, the
    direction of the lane's +y clockwise from true north, and ``azimuth_accuracy_deg``. A ValueError names the entry
    that is wrong.
    """
    path = existing(path, "anchor file")
    with faults_of(path):
        entries = parse_toml(read_named(path))
    try:
        told = _AnchorFile.model_validate(entries)
        lane = [(*p.lane, 0.0)[:3] for p in told.point]
        plane = told.point[0].easting is not None
        names = ("easting", "northing") if plane else ("longitude", "latitude")
        places = np.array(
            [[getattr(p, name) for name in names] for p in told.point], dtype=np.float64
        )
        heights = [p.height for p in told.point]
        azimuth = None if told.azimuth_deg is None else math.radians(told.azimuth_deg)
        return fit_anchor(
            lane, places, told.crs, told.accuracy, heights, azimuth, math.radians(told.azimuth_accuracy_deg or 0.0),
            geographic=not plane,
        )  # fmt: skip
    except ValidationError as error:
        raise ValueError(f"{path}: {first_fault(error, _AnchorFile)}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def fit_anchor(
    lane: ArrayLike,
    position: ArrayLike,
    crs: str,
    accuracy: float,
    height: Sequence[float | None] | None = None,
    azimuth: float | None = None,
    azimuth_accuracy: float = 0.0,
    geographic: bool | None = None,
) -> Anchor:
    """Fit an anchor to surveyed points: shift and direction by least squares, never a scale.

    ``lane`` (point, 3) are the points in the lane frame, m, ``position`` (point, 2) easting and northing, m, or
    longitude and latitude, degrees (``geographic``), in the system ``crs``; ``height`` is ellipsoidal, m, None where
    unknown. One point alone needs ``azimuth`` of +y clockwise from true north, rad, with its ``azimuth_accuracy``. The
    fit is made in the tangent plane at the points' mean, so a map projection's scale does not enter. ``sigma`` is the
    larger of ``accuracy``, m, of a coordinate and what the misfit tells; a misfit of more than five of it (and 5 cm) is
    a ValueError.
    """
    system = _system(crs, geographic)
    local = np.asarray(lane, dtype=np.float64)
    places = np.asarray(position, dtype=np.float64)
    if local.ndim != 2 or local.shape[1] != 3 or places.shape != (len(local), 2) or not len(local):
        raise ValueError(
            f"anchor needs points with lane (point, 3) and position (point, 2), got {local.shape}"
        )
    if not (np.isfinite(local).all() and np.isfinite(places).all() and accuracy > 0):
        raise ValueError("anchor points must be finite and the accuracy positive")
    known = height is not None and all(one is not None and math.isfinite(one) for one in height)
    up = np.array(height, dtype=np.float64) if known else np.zeros(len(local))
    lonlat, stated = _to_wgs84(system, places)
    origin = (float(lonlat[:, 0].mean()), float(lonlat[:, 1].mean()), float(up.mean()))
    xyz = np.stack(_geodesy(GEODETIC, GEOCENTRIC).transform(*lonlat.T, up), axis=-1)
    enu = (xyz - geocentric(origin)) @ east_north_up(origin).T
    if azimuth is None:
        azimuth, spread = _direction(local, enu)
        azimuth_accuracy = 0.0
    else:
        spread = math.inf
    level = local @ heading_matrix(azimuth).T
    shift = (enu - level).mean(axis=0)
    misfit = np.linalg.norm((enu - level - shift)[:, :2], axis=1)
    freedom = 2 * len(local) - (3 if math.isfinite(spread) else 2)
    found = math.sqrt(float((misfit**2).sum()) / freedom) if freedom > 0 else 0.0
    if misfit.max() > max(5 * accuracy, 0.05):
        worst = int(misfit.argmax())
        raise ValueError(
            f"anchor points must fit one another within five times the accuracy of {accuracy:g} m, point "
            f"{worst + 1} is off by {misfit[worst]:.3g} m: are two points swapped, or x and y?"
        )
    return Anchor(
        origin, azimuth, (float(shift[0]), float(shift[1]), float(shift[2])),
        (float(local[:, 0].mean()), float(local[:, 1].mean())), max(accuracy, found), len(local), spread,
        azimuth_accuracy, tuple(map(float, misfit)), system.to_string(), stated, known,
    )  # fmt: skip


def geocentric(origin: tuple[float, float, float]) -> FloatArray:
    """Take longitude, latitude (degrees) and ellipsoidal height (m) to geocentric coordinates, m."""
    return np.array(_geodesy(GEODETIC, GEOCENTRIC).transform(*origin), dtype=np.float64)


def east_north_up(origin: tuple[float, float, float]) -> FloatArray:
    """Make the unit vectors to east, north and up, in geocentric axes, at longitude, latitude (degrees) and height."""
    lon = math.radians(origin[0])
    lat = math.radians(origin[1])
    cl = math.cos(lon)
    sl = math.sin(lon)
    cp = math.cos(lat)
    sp = math.sin(lat)
    return np.array([[-sl, cl, 0.0], [-sp * cl, -sp * sl, cp], [cp * cl, cp * sl, sp]])


def transform_lonlat(lonlat: ArrayLike, crs: str) -> FloatArray:
    """Take WGS 84 longitude and latitude (..., 2), degrees, to easting and northing of a projected system, m.

    A system that is none, or that names a file to be read, is a ValueError.
    """
    points = np.moveaxis(np.asarray(lonlat, dtype=np.float64), -1, 0)
    return np.stack(_geodesy("EPSG:4326", reference_system(crs)).transform(*points), axis=-1)


def lonlat_of(points: ArrayLike, crs: str) -> FloatArray:
    """Take easting and northing (..., 2) of a projected system, m, to WGS 84 longitude and latitude, degrees.

    Points that do not lie where the system holds, or a system that is not projected, are a ValueError.
    """
    system = _system(crs, geographic=False)
    places = np.asarray(points, dtype=np.float64)
    return _to_wgs84(system, places.reshape(-1, 2))[0].reshape(places.shape)


def _geodesy(source: Any, target: Any) -> Transformer:
    return Transformer.from_crs(source, target, always_xy=True)


def reference_system(crs: str) -> CRS:
    """Read a reference system: a name of a registry, such as EPSG:32633, WKT or a PROJ string.

    One that names a file, such as a grid of shifts, is a ValueError: it could be any file, and it
    would be read, or waited for, when the first point is taken there. Grids that PROJ itself knows
    for a system of a registry are used.
    """
    wanted = f"crs must be a reference system such as EPSG:32633, got {crs!r}"
    if _FILE_OF_SYSTEMS.search(crs):
        raise ValueError(f"{wanted}, which names a file")
    try:
        system = CRS.from_user_input(crs)
    except CRSError:
        raise ValueError(wanted) from None
    if _FILE_IN_WKT.search(system.to_wkt()):
        raise ValueError(f"{wanted}, which names a file")
    return system


def _system(crs: str, geographic: bool | None) -> CRS:
    system = reference_system(crs)
    if not (system.is_geographic or system.is_projected):
        raise ValueError(f"crs must be geographic or projected, got {crs!r} ({system.type_name})")
    if geographic is not None and geographic != system.is_geographic:
        wanted = "longitude and latitude" if system.is_geographic else "easting and northing"
        raise ValueError(f"points in {crs} must be given as {wanted}")
    units = {axis.unit_name for axis in system.axis_info[:2]}
    if not units <= {"metre", "degree"}:
        raise ValueError(f"crs must be in metres or degrees, got {crs!r} in {', '.join(units)}")
    return system


def _to_wgs84(system: CRS, places: FloatArray) -> tuple[FloatArray, float]:
    step = Transformer.from_crs(system, "EPSG:4326", always_xy=True)
    try:
        lon, lat = step.transform(places[:, 0], places[:, 1], errcheck=True)
    except ProjError as error:
        raise ValueError(
            f"anchor points must lie where {system.to_string()} holds: {error}"
        ) from None
    lonlat = np.stack([lon, lat], axis=-1)
    if not np.isfinite(lonlat).all() or np.abs(lonlat[:, 1]).max() > 89.9:
        raise ValueError(
            f"anchor points must lie where {system.to_string()} holds, got {places[0]}"
        )
    accuracy = step.accuracy if step.accuracy is not None and step.accuracy >= 0 else math.nan
    return lonlat, float(accuracy)


def _direction(lane: FloatArray, enu: FloatArray) -> tuple[float, float]:
    a = (lane - lane.mean(axis=0))[:, :2]
    b = (enu - enu.mean(axis=0))[:, :2]
    spread = float((a**2).sum())
    if spread < 1e-6:
        raise ValueError(
            "anchor points must lie apart from one another, they coincide in the lane frame"
        )
    # East + j·north is the lane's x + jy turned by -azimuth.
    turn = np.sum((b[:, 0] + 1j * b[:, 1]) * (a[:, 0] - 1j * a[:, 1]))
    return float(-np.angle(turn)), spread
