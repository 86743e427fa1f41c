"""Places on the ellipsoid by geodesics: independent of the code under test."""

import math

import numpy as np
from pyproj import Geod

AZIMUTH = math.radians(37.0)
LANE = np.array([[-2.0, 0, 0], [2.0, 0, 0], [-2.0, 60, 0], [2.0, 60, 0]])


def on_the_ellipsoid(lane, lon=11.3, lat=47.9, azimuth=AZIMUTH):
    """Independent of the code: geodesics from the lane's origin."""
    distance = np.hypot(lane[..., 0], lane[..., 1])
    bearing = np.degrees(azimuth + np.arctan2(lane[..., 0], lane[..., 1]))
    ones = np.ones_like(distance)
    east, north, _ = Geod(ellps="WGS84").fwd(lon * ones, lat * ones, bearing, distance)
    return np.stack([east, north], axis=-1)


def distance(a, b):
    return np.abs(Geod(ellps="WGS84").inv(a[..., 0], a[..., 1], b[..., 0], b[..., 1])[2])


def anchor_text():
    """Return an anchor (TOML) whose points were surveyed by geodesics."""
    points = [
        f"[[point]]\nlane = [{x}, {y}]\nlongitude = {lon!r}\nlatitude = {lat!r}\nheight = 0.0\n"
        for (x, y, _), (lon, lat) in zip(
            LANE.tolist(), on_the_ellipsoid(LANE).tolist(), strict=True
        )
    ]
    return 'crs = "EPSG:4326"\naccuracy = 0.02\n' + "".join(points)
