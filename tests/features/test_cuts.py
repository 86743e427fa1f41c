"""Range cuts and chips as feature vectors."""

import numpy as np
import pytest
import xarray as xr

from flgpr.features import (
    clean_pixels,
    clutter_cuts,
    cuts_at,
    quiet_pixels,
    range_cuts,
    stack_channels,
)


@pytest.fixture
def rng():
    return np.random.default_rng(28)


def draw(rng, *shape):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def image_of(values, polarization=("HH", "VV"), subband=("low",)):
    ny, nx = values.shape[-2:]
    return xr.DataArray(
        values,
        dims=("polarization", "subband", "y", "x"),
        coords={
            "polarization": list(polarization),
            "subband": list(subband),
            "y": 14 + 0.02 * np.arange(ny),
            "x": -1 + 0.05 * np.arange(nx),
        },
    )


def test_range_cut_is_hh_then_vv_about_the_pixel(rng):
    values = draw(rng, 2, 1, 101, 41)
    found = range_cuts(image_of(values), [[0.0, 15.0]])
    expected = np.concatenate([values[0, 0, 36:64, 20], values[1, 0, 36:64, 20]])
    assert found.shape == (1, 56)
    assert np.array_equal(found[0], expected)


def test_chip_of_all_channels(rng):
    values = draw(rng, 3, 2, 30, 12)
    image = image_of(values, ("HH", "HV", "VV"), ("low", "high"))
    stack, names = stack_channels(image)
    assert names == ("HH low", "HH high", "HV low", "HV high", "VV low", "VV high")
    found = cuts_at(stack, [10], [5], (4, 3))
    assert np.array_equal(found[0], values[:, :, 8:12, 4:7].reshape(-1))
    picked, _ = stack_channels(image, ("VV high", "HH low"))
    assert np.array_equal(picked, stack[[5, 0]])
    with pytest.raises(ValueError, match="missing: VH low"):
        stack_channels(image, ("VH low",))


def test_cuts_that_leave_the_image_are_nan(rng):
    stack = draw(rng, 2, 40, 6)
    found = cuts_at(stack, [13, 14, 26, 27, 14], [0, 0, 0, 0, 6])
    assert list(np.isnan(found).all(axis=1)) == [True, False, False, True, True]
    assert list(np.isnan(found).any(axis=1)) == [True, False, False, True, True]
    assert np.isnan(range_cuts(image_of(draw(rng, 2, 1, 40, 6)), [[9.0, 90.0]])).all()


def test_search_finds_the_strongest_cut_near_by(rng):
    values = 0.01 * draw(rng, 2, 1, 120, 41)
    values[:, :, 50:78, 24] += 3  # centred on pixel 64 = 15.28 m, 0.2 m right of the middle
    image = image_of(values)
    found = range_cuts(image, [[0.0, 15.1]], search=0.25)
    assert np.array_equal(found, cuts_at(stack_channels(image)[0], [64], [24]))
    near = range_cuts(image, [[0.0, 15.1]], search=0.1)
    assert not np.array_equal(near, found)
    with pytest.raises(ValueError, match="search"):
        range_cuts(image, [[0.0, 15.1]], search=-1)


def test_clutter_cuts_hold_clean_pixels_only(rng):
    stack = draw(rng, 2, 60, 20)
    clean = clean_pixels(0.05 * np.arange(20), 0.02 * np.arange(60), [[0.5, 0.6]], 0.3)
    stack[:, ~clean] = 1e6
    found = clutter_cuts(stack, clean, (10, 1), (5, 2))
    every = [(row, column) for row in range(0, 51, 5) for column in range(0, 20, 2)]
    expected = [stack[:, r : r + 10, c].ravel() for r, c in every if clean[r : r + 10, c].all()]
    assert 0 < len(expected) < len(every)
    assert np.array_equal(found, expected)
    assert clutter_cuts(stack, np.zeros_like(clean), (10, 1)).shape == (0, 20)
    assert clutter_cuts(stack, clean, (99, 1)).shape == (0, 198)


def test_clean_pixels_keep_their_distance():
    clean = clean_pixels([0, 1, 2], [0, 1], [[0, 0], [2, 1]], 0.9)
    assert np.array_equal(clean, [[False, True, True], [True, True, False]])
    assert clean_pixels([0, 1], [0], np.empty((0, 2)), 1.0).all()


def test_quiet_pixels_leave_out_what_is_bright_and_around_it(rng):
    stack = draw(rng, 2, 80, 40)
    stack[1, 30, 10] = 100
    stack[0, 60, 20] = np.nan
    quiet = quiet_pixels(stack, 0.999, (5, 3))
    assert not quiet[28:33, 9:12].any()
    assert not quiet[60, 20]
    assert 0.85 < quiet.mean() < 1
    assert quiet_pixels(stack, 1.0).sum() == 80 * 40 - 1
    with pytest.raises(ValueError, match="quantile"):
        quiet_pixels(stack, 0.0)
