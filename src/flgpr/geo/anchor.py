"""Anchors: where a lane lies on the Earth, fitted to surveyed points, with the uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, model_validator

from flgpr.door import read_named
from flgpr.geo.geodesy import (
    GEOCENTRIC,
    GEODETIC,
    east_north_up,
    geocentric,
    lonlat_of,
    system_of_kind,
    to_wgs84,
    transformer_of,
)
from flgpr.model.bounds import NotNegative, Positive
from flgpr.model.faults import faults_of, first_fault_of
from flgpr.model.frames import heading_matrix
from flgpr.store.files import existing
from flgpr.toml_text import parse_toml
from flgpr.types import ArrayLike, FloatArray, floats

_TURN = 360.0
_HALF_TURN = 180.0
_SAME_PLACE = 10.0  # m, what satellite receivers without a base may be off; assumed
_COMPARED = 100.0  # m of a lane


@dataclass(frozen=True)
class Anchor:
    """A rigid tie of the lane frame to the Earth (WGS 84)."""

    #: longitude, latitude (degrees) and ellipsoidal height (m) of the plane's point of contact
    origin: tuple[float, float, float]
    azimuth: float  #: direction of the lane's +y, clockwise from true north at the origin, rad
    #: lane frame's origin east, north and up of the contact point, m
    shift: tuple[float, float, float]
    #: mean x and y of the surveyed points in the lane frame, m; the uncertainty is least there
    center: tuple[float, float]
    sigma: float  #: standard deviation of one coordinate of one surveyed point, m
    count: int  #: number of surveyed points
    #: sum of squared distances of the surveyed points from their mean, m²; infinite where the
    #: direction was measured by itself
    spread: float
    #: standard deviation of a direction that was measured by itself, rad; 0 where it was fitted
    sigma_azimuth: float
    residuals: tuple[float, ...]  #: horizontal misfit of each surveyed point, m
    crs: str  #: reference system the points were surveyed in
    #: stated accuracy of the step from that system to WGS 84, m; NaN where the registry states none
    crs_accuracy: float
    #: whether the points had heights; else the lane's ground is put on the ellipsoid
    heights_known: bool

    def to_geocentric(self, position: ArrayLike) -> FloatArray:
        """Return points of the lane frame in geocentric WGS 84 coordinates.

        These axes are centred in the Earth and fixed to it.

        Parameters
        ----------
        position : (..., 3) array_like
            Points in the lane frame, m.

        Returns
        -------
        (..., 3) ndarray
            Geocentric coordinates, m.
        """
        return geocentric(self.origin) + self.turn(position, shifted=True)

    def turn(self, vector: ArrayLike, shifted: bool = False) -> FloatArray:
        """Return vectors of the lane frame in geocentric axes.

        Parameters
        ----------
        vector : (..., 3) array_like
            Vectors, or with ``shifted`` points, m.
        shifted : bool
            Add the anchor's shift first.

        Returns
        -------
        (..., 3) ndarray
            The vectors, m, from the contact point for points.
        """
        enu = floats(vector) @ heading_matrix(self.azimuth).T
        shift = self.shift if shifted else 0.0
        return (enu + shift) @ east_north_up(self.origin)

    def from_geocentric(self, position: ArrayLike) -> FloatArray:
        """Return geocentric points in the lane frame, the inverse of :meth:`to_geocentric`.

        Parameters
        ----------
        position : (..., 3) array_like
            Geocentric coordinates, m.

        Returns
        -------
        (..., 3) ndarray
            Points in the lane frame, m.
        """
        step = floats(position) - geocentric(self.origin)
        enu = step @ east_north_up(self.origin).T
        return (enu - self.shift) @ heading_matrix(self.azimuth)

    def to_lonlat(self, points: ArrayLike) -> FloatArray:
        """Return WGS 84 longitude and latitude of points in the anchor's system.

        Parameters
        ----------
        points : (..., 2) array_like
            Easting and northing, m.

        Returns
        -------
        (..., 2) ndarray
            Longitude and latitude, degrees.

        Raises
        ------
        ValueError
            If the system is not projected, or the points do not lie where it holds.
        """
        return lonlat_of(points, self.crs)

    def to_geodetic(self, position: ArrayLike) -> FloatArray:
        """Return WGS 84 longitude, latitude and height of points in the lane frame.

        Parameters
        ----------
        position : (..., 3) array_like
            Points in the lane frame, m.

        Returns
        -------
        (..., 3) ndarray
            Longitude and latitude, degrees, and ellipsoidal height, m.
        """
        xyz = self.to_geocentric(position)
        lon, lat, height = transformer_of(GEOCENTRIC, GEODETIC).transform(*np.moveaxis(xyz, -1, 0))
        return np.stack([lon, lat, height], axis=-1)

    def from_geodetic(self, position: ArrayLike) -> FloatArray:
        """Return points of WGS 84 longitude, latitude and height in the lane frame.

        Parameters
        ----------
        position : (..., 3) array_like
            Longitude and latitude, degrees, and ellipsoidal height, m.

        Returns
        -------
        (..., 3) ndarray
            Points in the lane frame, m.
        """
        components = np.moveaxis(floats(position), -1, 0)
        xyz = transformer_of(GEODETIC, GEOCENTRIC).transform(*components)
        return self.from_geocentric(np.stack(xyz, axis=-1))

    def uncertainty(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Compute the standard deviation of a position in the worst horizontal direction.

        At distance r from the points' mean, the variance across that line is the one of a
        least-squares fit, ``σ²·(1/n + r²/spread) + r²·σ_azimuth²``. The error of the radar is not
        part of it.

        Parameters
        ----------
        x, y : array_like
            Positions in the lane frame, m.

        Returns
        -------
        ndarray
            Standard deviation of each, m.
        """
        dx = floats(x) - self.center[0]
        dy = np.asarray(y) - self.center[1]
        r2 = dx**2 + dy**2
        by_points = self.sigma**2 * (1 / self.count + r2 / self.spread)
        by_azimuth = r2 * self.sigma_azimuth**2  # of a direction that was given, not fitted
        return np.asarray(np.sqrt(by_points + by_azimuth))

    def georeference(self) -> dict[str, float]:
        """Return the attribute ``georeference`` of a run.

        It has ``latitude``, ``longitude`` and ``azimuth`` of +y, clockwise from true north, all in
        degrees and at the lane's origin, where north is another than at the surveyed points; and
        ``height`` (ellipsoidal, m) where the points had heights.
        """
        longitude, latitude, height = (float(value) for value in self.to_geodetic(np.zeros(3)))
        east, north, _ = east_north_up((longitude, latitude, height)) @ self.turn((0.0, 1.0, 0.0))
        reference = {
            "latitude": latitude,
            "longitude": longitude,
            "azimuth": math.degrees(math.atan2(east, north)),
        }
        return reference | ({"height": height} if self.heights_known else {})

    def utm(self) -> str:
        """Return the UTM zone (WGS 84) that the lane lies in, such as ``EPSG:32633``."""
        lon, lat, _ = self.origin
        hemisphere = 32600 if lat >= 0 else 32700
        zone = min(int((lon + 180) // 6) + 1, 60)
        return f"EPSG:{hemisphere + zone}"


class _Point(BaseModel):
    """A surveyed point of an anchor file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str = ""
    lane: tuple[float, float] | tuple[float, float, float]
    easting: float | None = None
    northing: float | None = None
    longitude: float | None = None
    latitude: float | None = None
    height: float | None = None

    @model_validator(mode="after")
    def _check_coordinates(self) -> _Point:
        """Refuse a point without exactly one pair of coordinates."""
        has_plane = self.easting is not None and self.northing is not None
        has_globe = self.longitude is not None and self.latitude is not None
        coordinates = (self.easting, self.northing, self.longitude, self.latitude)
        count = sum(value is not None for value in coordinates)
        if has_plane == has_globe or count != 2:
            raise ValueError("give easting and northing, or longitude and latitude")
        return self


class _AnchorFile(BaseModel):
    """Entries of an anchor file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    crs: str
    accuracy: Positive
    azimuth_deg: float | None = None
    azimuth_accuracy_deg: NotNegative | None = None
    point: list[_Point]

    @model_validator(mode="after")
    def _check_direction(self) -> _AnchorFile:
        """Refuse a direction that is missing, or stated though the points give it."""
        if (self.azimuth_deg is None) != (self.azimuth_accuracy_deg is None):
            raise ValueError("azimuth_deg and azimuth_accuracy_deg go together")
        if (len(self.point) >= 2) == (self.azimuth_deg is not None) or not self.point:
            raise ValueError(
                "give two or more points, or one point and azimuth_deg with azimuth_accuracy_deg"
            )
        return self


def own_anchor(reference: Mapping[str, Any]) -> Anchor:
    """Return the anchor of a run's attribute ``georeference``.

    Parameters
    ----------
    reference : mapping
        ``longitude``, ``latitude`` and ``azimuth`` of +y, degrees; ``height`` (m), which may lack.

    Returns
    -------
    Anchor
        The anchor, whose uncertainty is not known (NaN).

    Raises
    ------
    ValueError
        If an entry is missing or is no finite number.
    """
    entries = reference if isinstance(reference, Mapping) else {}
    heights_known = entries.get("height") is not None
    values = []
    for name in ("longitude", "latitude", "azimuth", *(["height"] if heights_known else [])):
        value = entries.get(name)
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(
                "georeference must have longitude, latitude and azimuth in degrees, and a height "
                f"in m or none, got {reference!r}"
            )
        values.append(float(value))
    longitude, latitude, azimuth, height = (*values, 0.0)[:4]
    return anchor_at((longitude, latitude, height), math.radians(azimuth), heights_known)


def check_same_place(reference: Any, other: Any, what: object) -> None:
    """Refuse a run, called ``what``, whose lane lies elsewhere on the Earth than that of another run.

    Parameters
    ----------
    reference, other : mapping or None
        Attributes ``georeference`` of the run that it is taken with, and of the run itself. Heights
        do not count, and one that is missing or broken tells nothing.

    Raises
    ------
    ValueError
        If the first 100 m of the lanes come to lie more than 10 m apart.
    """
    ends = [(0.0, 0.0, 0.0), (0.0, _COMPARED, 0.0)]
    places = []
    for one in (reference, other):
        with suppress(ValueError, TypeError):
            places.append(own_anchor({**one, "height": None}).to_geocentric(ends))
    if len(places) < 2:
        return
    apart = float(np.linalg.norm(places[0] - places[1], axis=-1).max())
    if apart > _SAME_PLACE:
        raise ValueError(
            f"{what}: must be a run of the same lane, within {_SAME_PLACE:g} m on the Earth, got one "
            f"whose georeference puts the lane {apart:,.0f} m from there"
        )


def anchor_at(
    origin: tuple[float, float, float], azimuth: float, heights_known: bool = True
) -> Anchor:
    """Return an anchor at a position, whose uncertainty is not known (NaN).

    Parameters
    ----------
    origin : (3,) tuple of float
        Longitude, latitude, degrees, and ellipsoidal height, m.
    azimuth : float
        Direction of +y, rad.
    heights_known : bool
        Whether the height is one.

    Returns
    -------
    Anchor
        The anchor.
    """
    return Anchor(
        origin=origin,
        azimuth=azimuth,
        shift=(0.0, 0.0, 0.0),
        center=(0.0, 0.0),
        sigma=math.nan,
        count=1,
        spread=math.inf,
        sigma_azimuth=math.nan,
        residuals=(),
        crs=GEODETIC,
        crs_accuracy=math.nan,
        heights_known=heights_known,
    )


def read_anchor(path: str | Path) -> Anchor:
    """Read an anchor from TOML.

    The entries are ``crs``, ``accuracy`` (m) and a ``[[point]]`` for every surveyed point. A point
    has ``lane`` (x, y or x, y, z in m), either ``easting`` and ``northing`` or ``longitude`` and
    ``latitude`` in the reference system, and optionally an ellipsoidal ``height``. One point alone
    needs ``azimuth_deg``, the direction of the lane's +y clockwise from true north, and
    ``azimuth_accuracy_deg``.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Anchor
        The fitted anchor, see :func:`fit_anchor`.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    ValueError
        If an entry is wrong; the error names the file and the entry.
    """
    path = existing(path, "anchor file")
    with faults_of(path):
        entries = parse_toml(read_named(path))
        with first_fault_of(_AnchorFile):
            file = _AnchorFile.model_validate(entries)
        return _fit_file(file)


def _fit_file(entries: _AnchorFile) -> Anchor:
    """Fit the anchor of a file's entries."""
    is_plane = entries.point[0].easting is not None
    names = ("easting", "northing") if is_plane else ("longitude", "latitude")
    lane = []
    positions = []
    for number, point in enumerate(entries.point):
        if (point.easting is not None) != is_plane:
            raise ValueError(
                f"points of an anchor must all have {' and '.join(names)} as the first, point "
                f"{number} has others"
            )
        lane.append((*point.lane, 0.0)[:3])
        positions.append([getattr(point, name) for name in names])
    azimuth = None if entries.azimuth_deg is None else math.radians(entries.azimuth_deg)
    return fit_anchor(
        lane,
        np.array(positions, dtype=np.float64),
        entries.crs,
        entries.accuracy,
        [point.height for point in entries.point],
        azimuth,
        math.radians(entries.azimuth_accuracy_deg or 0.0),
        geographic=not is_plane,
    )


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

    The fit is made in the tangent plane at the points' mean, so that a map projection's scale does
    not enter. The anchor's ``sigma`` is the larger of ``accuracy`` and the deviation by the misfit.

    Parameters
    ----------
    lane : (point, 3) array_like
        Points in the lane frame, m.
    position : (point, 2) array_like
        Easting and northing, m, or longitude and latitude, degrees, of the points.
    crs : str
        Reference system of ``position``.
    accuracy : float
        Standard deviation of a surveyed coordinate, m.
    height : sequence of float or None, optional
        Ellipsoidal heights, m; if one is None, the points are put on the ellipsoid.
    azimuth, azimuth_accuracy : float, optional
        Direction of +y clockwise from true north, which one point alone needs, and its standard
        deviation, rad.
    geographic : bool, optional
        Whether ``position`` is longitude and latitude; the system must agree.

    Returns
    -------
    Anchor
        The anchor.

    Raises
    ------
    ValueError
        If the points or the system are not valid, or a point is off by more than five times the
        accuracy and 5 cm.
    """
    system = system_of_kind(crs, geographic)
    local = floats(lane)
    surveyed = floats(position)
    _check_points(local, surveyed, accuracy)
    heights_known = height is not None and all(
        value is not None and math.isfinite(value) for value in height
    )
    up = np.array(height, dtype=np.float64) if heights_known else np.zeros(len(local))
    lonlat, crs_accuracy = to_wgs84(system, surveyed)
    origin = (_mean_longitude(lonlat[:, 0]), float(lonlat[:, 1].mean()), float(up.mean()))
    xyz = np.stack(transformer_of(GEODETIC, GEOCENTRIC).transform(*lonlat.T, up), axis=-1)
    enu = (xyz - geocentric(origin)) @ east_north_up(origin).T
    if azimuth is None:
        azimuth, spread = _direction(local, enu, accuracy)
        azimuth_accuracy = 0.0
    else:
        spread = math.inf
    turned = local @ heading_matrix(azimuth).T
    shift = (enu - turned).mean(axis=0)
    residual = enu - turned - shift
    misfit = np.linalg.norm(residual[:, :2], axis=1)
    _check_misfit(misfit, accuracy)
    # Two numbers of the shift, and the direction if it was fitted.
    parameters = 3 if math.isfinite(spread) else 2
    freedom = 2 * len(local) - parameters
    sigma_by_misfit = 0.0
    if freedom > 0:
        sigma_by_misfit = math.sqrt(float((misfit**2).sum()) / freedom)
    return Anchor(
        origin=origin,
        azimuth=azimuth,
        shift=(float(shift[0]), float(shift[1]), float(shift[2])),
        center=(float(local[:, 0].mean()), float(local[:, 1].mean())),
        sigma=max(accuracy, sigma_by_misfit),
        count=len(local),
        spread=spread,
        sigma_azimuth=azimuth_accuracy,
        residuals=tuple(map(float, misfit)),
        crs=system.to_string(),
        crs_accuracy=crs_accuracy,
        heights_known=heights_known,
    )


def _mean_longitude(longitude: FloatArray) -> float:
    """Return the mean of longitudes, degrees, on the shorter way round where they pass 180."""
    if np.ptp(longitude) <= _HALF_TURN:
        return float(longitude.mean())
    mean = float((longitude % _TURN).mean())
    return mean - _TURN if mean > _HALF_TURN else mean


def _check_points(local: FloatArray, surveyed: FloatArray, accuracy: float) -> None:
    """Refuse points of other shapes or numbers, values that are not finite, and no accuracy."""
    is_table = local.ndim == 2 and local.shape[1] == 3 and len(local) > 0
    if not is_table or surveyed.shape != (len(local), 2):
        raise ValueError(
            f"anchor needs points with lane (point, 3) and position (point, 2), got {local.shape}"
        )
    if not (np.isfinite(local).all() and np.isfinite(surveyed).all() and accuracy > 0):
        raise ValueError("anchor points must be finite and the accuracy positive")


def _check_misfit(misfit: FloatArray, accuracy: float) -> None:
    """Refuse points of which one is off by more than five times the accuracy and 5 cm."""
    if misfit.max() > max(5 * accuracy, 0.05):
        worst = int(misfit.argmax())
        raise ValueError(
            "anchor points must fit one another within five times the accuracy of "
            f"{accuracy:g} m, point {worst + 1} is off by {misfit[worst]:.3g} m: "
            "are two points swapped, or x and y?"
        )


def _direction(lane: FloatArray, enu: FloatArray, accuracy: float) -> tuple[float, float]:
    """Fit the azimuth of +y, rad, and return the sum of squared distances from the mean, m²."""
    a = (lane - lane.mean(axis=0))[:, :2]
    b = (enu - enu.mean(axis=0))[:, :2]
    spread = float((a**2).sum())
    if spread < max(1e-6, (5 * accuracy) ** 2):  # the direction would be known to 0.2 rad or worse
        raise ValueError(
            "anchor points must lie apart from one another in the lane frame, by more than five "
            f"times the accuracy of {accuracy:g} m, got a spread of {math.sqrt(spread):.3g} m"
        )
    # East + j·north is the lane's x + jy turned by -azimuth.
    turn = np.sum((b[:, 0] + 1j * b[:, 1]) * (a[:, 0] - 1j * a[:, 1]))
    return float(-np.angle(turn)), spread
