"""Positions on the Earth in several reference systems."""

import math

import numpy as np
import pytest

from flgpr.geo.geodesy import (
    GEODETIC,
    east_north_up,
    geocentric,
    lonlat_of,
    reference_system,
    system_of_kind,
    to_wgs84,
    transform_lonlat,
)

EQUATORIAL_RADIUS = 6378137.0
"""Semi-major axis of WGS 84, m."""
UTM = "EPSG:32633"


def test_geocentric_axes_go_through_the_equator_and_the_pole():
    assert geocentric((0.0, 0.0, 0.0)) == pytest.approx([EQUATORIAL_RADIUS, 0.0, 0.0])
    assert geocentric((90.0, 0.0, 100.0)) == pytest.approx(
        [0.0, EQUATORIAL_RADIUS + 100.0, 0.0], abs=1e-6
    )
    assert geocentric((0.0, 90.0, 0.0))[2] == pytest.approx(6356752.314, abs=1e-3)


def test_east_north_and_up_are_right_handed_and_north_follows_the_meridian():
    origin = (15.0, 52.0, 0.0)
    axes = east_north_up(origin)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), axes[2], atol=1e-12)
    step = geocentric((15.0, 52.0 + 1e-6, 0.0)) - geocentric(origin)
    np.testing.assert_allclose(axes @ step / np.linalg.norm(step), [0.0, 1.0, 0.0], atol=1e-6)


def test_plane_coordinates_are_those_of_the_zone_and_lead_back():
    # On the central meridian of zone 33, 15° east, the easting is 500 km by definition.
    plane = transform_lonlat([[15.0, 52.0], [15.001, 52.0]], UTM)
    assert plane[0, 0] == pytest.approx(500_000.0, abs=1e-6)
    np.testing.assert_allclose(lonlat_of(plane, UTM), [[15.0, 52.0], [15.001, 52.0]], atol=1e-9)


def test_longitude_and_latitude_of_wgs_84_stay_as_they_are():
    lonlat, accuracy = to_wgs84(reference_system(GEODETIC), np.array([[15.0, 52.0]]))
    assert lonlat.tolist() == [[15.0, 52.0]]
    assert math.isnan(accuracy) or accuracy >= 0


@pytest.mark.parametrize(
    ("crs", "geographic", "words"),
    [
        ("nowhere", None, "must be a reference system"),
        ("EPSG:4978", None, "must be geographic or projected"),
        (UTM, True, "must be given as easting and northing"),
        ("EPSG:4326", False, "must be given as longitude and latitude"),
        ("EPSG:2227", None, "must be in metres or degrees"),  # feet of a US survey
    ],
)
def test_a_system_of_another_kind_is_refused(crs, geographic, words):
    with pytest.raises(ValueError, match=words):
        system_of_kind(crs, geographic)


def test_points_where_the_system_does_not_hold_are_refused():
    with pytest.raises(ValueError, match=f"must lie where {UTM} holds"):
        lonlat_of([[1e12, 1e12]], UTM)
