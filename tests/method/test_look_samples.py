"""What one scan shows about alarms: samples of an image whose values are known."""

import numpy as np
import pytest
import xarray as xr

from flgpr.features import PatchShape
from flgpr.method.look_samples import (
    CUT,
    coherency_at,
    cuts_along_sight,
    decibels,
    in_sight,
    patches,
)

X = np.arange(-2.0, 2.01, 0.1)
Y = np.arange(3.0, 9.01, 0.1)


def image(values, labels=("HH", "VV", "HV")):
    """Return an image whose channels hold the same values (y, x)."""
    stacked = np.broadcast_to(values, (len(labels), 1, *np.shape(values)))
    return xr.DataArray(
        stacked,
        dims=("polarization", "subband", "y", "x"),
        coords={"polarization": list(labels), "subband": ["F1"], "y": Y, "x": X},
    )


def plane():
    """Return a plane, which interpolation returns exactly."""
    return (10 * Y[:, None] + X).astype(np.float32)


def test_points_in_sight_lie_within_the_image_and_not_too_far_ahead():
    points = np.array([[0.0, 5.0, 0.0], [-2.1, 5, 0], [0, 2.9, 0], [0, 8.5, 0], [2, 8, 0]])
    assert in_sight(image(plane()), points, 9.0).tolist() == [0, 3, 4]
    assert in_sight(image(plane()), points, 8.2).tolist() == [0, 4]


def test_patches_lie_about_their_points_and_are_empty_outside():
    shape = PatchShape(5, 0.1, (1, 1), (3, 3))
    points = np.array([[0.5, 6.0, 0.0], [1.9, 6.0, 0.0]])
    values = patches(image(plane()), points, shape)
    assert values.shape == (2, 3, 1, 5, 5)
    x = 0.5 + shape.offsets()[..., 0]
    y = 6.0 + shape.offsets()[..., 1]
    np.testing.assert_allclose(values[0, 1, 0], 10 * y + x, rtol=1e-5)
    assert np.isnan(values[1, 0, 0]).any()


def test_cuts_follow_the_line_of_sight():
    point = np.array([[1.2, 6.4, 0.0]])
    values = cuts_along_sight(image(plane()), point)
    assert values.shape == (1, 3, 1, len(CUT))
    unit = point[0, :2] / np.hypot(*point[0, :2])
    x, y = (point[0, :2] + CUT[:, None] * unit).T
    inside = (np.abs(x) <= 2) & (y >= 3) & (y <= 9)
    np.testing.assert_allclose(values[0, 0, 0][inside], (10 * y + x)[inside], rtol=1e-5)


def test_decibels_have_a_floor_and_keep_what_is_missing():
    values = decibels([1.0, 10.0, 0.0, np.nan])
    assert values.dtype == np.float16
    np.testing.assert_allclose(values[:3], [0, 20, -120])
    assert np.isnan(values[3])


@pytest.mark.parametrize(
    ("hh", "vv", "hv", "diagonal"),
    [(1, 1, 0, (50, 0, 0)), (1, -1, 0, (0, 50, 0)), (0, 0, 1, (0, 0, 50))],
)
def test_the_coherency_of_pure_scatterers_has_one_entry(hh, vv, hv, diagonal):
    """25 pixels: a surface, a dihedral and a rotated dihedral, each of Pauli power 2."""
    ones = np.ones((len(Y), len(X)), np.complex64)
    channels = np.stack([hh * ones, vv * ones, hv * ones])
    band = image(ones).isel(subband=0).copy(data=channels)
    matrix = coherency_at(band, np.array([[0.0, 6.0, 0.0]]))[0]
    np.testing.assert_allclose(np.diag(matrix).real, diagonal, atol=1e-5)
    np.testing.assert_allclose(matrix - np.diag(np.diag(matrix)), 0, atol=1e-5)


def test_without_a_cross_polarized_channel_there_is_no_coherency():
    band = image(plane().astype(np.complex64), ("HH", "VV")).isel(subband=0)
    assert not coherency_at(band, np.array([[0.0, 6.0, 0.0]])).any()
