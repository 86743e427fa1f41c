"""The brightest points of a focused image, and how wide they are."""

import math

import numpy as np
import pytest
import xarray as xr

from flgpr.calibrate.peaks import image_peaks

X = np.linspace(-2, 2, 81)
Y = np.linspace(3, 8, 101)


def image_of(*spots, band=(1e9, 3e9), floor=0.01):
    """Make an image of Gaussian spots: x, y, magnitude and standard deviation along x and y (m) each."""
    level = np.full((Y.size, X.size), floor)
    for x, y, size, across, along in spots:
        square = ((X - x) / across) ** 2 + ((Y[:, None] - y) / along) ** 2
        level = np.maximum(level, size * np.exp(-square / 2))
    coords = {"polarization": ["HH"], "z": [0.0], "y": Y, "x": X}
    dims = ("polarization", "z", "y", "x")
    values = level[None, None].astype(np.complex64)
    return xr.DataArray(values, coords, dims, attrs={"band_hz": band})


def test_places_levels_and_widths_are_those_of_the_spots():
    peaks = image_peaks(image_of((0.5, 4.0, 2.0, 0.1, 0.2), (-1.0, 7.0, 1.0, 0.15, 0.1)), 2)
    np.testing.assert_allclose(peaks[["x", "y", "z"]], [[0.5, 4.0, 0.0], [-1.0, 7.0, 0.0]])
    np.testing.assert_allclose(peaks["level"], [0.0, -20 * math.log10(2)], atol=1e-5)
    assert peaks["over_median"][0] == pytest.approx(20 * math.log10(200), abs=1e-4)
    # A Gaussian falls to half its power at sqrt(ln 2) standard deviations, here in single precision.
    full_width = 2 * math.sqrt(math.log(2))
    np.testing.assert_allclose(peaks["width_x"], full_width * np.array([0.1, 0.15]), rtol=0.03)
    np.testing.assert_allclose(peaks["width_y"], full_width * np.array([0.2, 0.1]), rtol=0.03)
    assert "width_z" not in peaks


def test_points_lie_apart_by_more_than_the_range_resolution():
    near = ((0.0, 5.0, 2.0, 0.05, 0.05), (0.2, 5.0, 1.5, 0.05, 0.05))
    assert len(image_peaks(image_of(*near, band=(1.0e9, 1.5e9)), 2)) == 2
    first, second = image_peaks(image_of(*near, band=(1.0e9, 1.5e9)), 2)[["x", "y"]].to_numpy()
    assert math.dist(first, second) > 0.599  # m: c over a band of 0.5 GHz
    both = image_peaks(image_of(*near, band=(1.0e9, 4.0e9)), 2)
    np.testing.assert_allclose(both["x"], [0.0, 0.2], atol=1e-9)


def test_a_width_that_does_not_end_in_the_image_is_missing():
    peaks = image_peaks(image_of((2.0, 5.0, 1.0, 0.3, 0.2)), 1)
    assert math.isnan(peaks["width_x"][0])
    assert math.isfinite(peaks["width_y"][0])


def test_an_image_of_nothing_has_no_peak():
    peaks = image_peaks(image_of(floor=0.0), 3)
    assert len(peaks) == 0
    assert list(peaks.columns) == ["x", "y", "z", "level", "over_median"]


def test_what_lies_below_the_median_is_no_bright_point():
    image = image_of((0.0, 5.0, 2.0, 0.1, 0.1))
    ramp = 0.1 * (X - X[0]) + 0.1 * (Y[:, None] - Y[0])  # whose lowest corner has a bump
    image.values[0, 0] = np.maximum(image.values[0, 0], ramp)
    image.values[0, 0, 2, 2] = 0.05
    peaks = image_peaks(image, 5)
    assert len(peaks) == 2
    assert (peaks["over_median"] > 0).all()
