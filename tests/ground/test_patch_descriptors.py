"""Descriptors of patches against slow twins, against scikit-image where it is there, and by hand."""

import numpy as np
import pytest

from flgpr_ground.features.patch_descriptors import (
    LBP_CODES,
    gradient_windows,
    hog,
    lbp_histograms,
    local_binary_patterns,
    normalize_by_border,
    oriented_gradients,
    pixel_windows,
    split_grid,
)
from reference import patch_features as slow

RNG = np.random.default_rng(3)
PATCHES = RNG.rayleigh(1.0, (3, 25, 25))


@pytest.mark.parametrize(("cell", "block", "bins"), [(8, 2, 9), (5, 3, 6), (6, 1, 9)])
def test_hog_is_its_slow_twin(cell, block, bins):
    features = hog(PATCHES, cell, block, bins)
    for patch, of_patch in zip(PATCHES, features, strict=True):
        np.testing.assert_allclose(of_patch, slow.hog(patch, cell, block, bins), atol=1e-12)


def test_hog_is_that_of_scikit_image():
    feature = pytest.importorskip(
        "skimage.feature", reason="scikit-image is a dependency of the tests alone"
    )
    patch = PATCHES[0, :24, :24]
    theirs = feature.hog(patch, orientations=9, pixels_per_cell=(8, 8), cells_per_block=(2, 2))
    np.testing.assert_allclose(hog(patch, 8), theirs, atol=1e-6)  # theirs in single precision


def test_hog_of_a_slope_votes_for_its_direction():
    slope = np.tile(np.arange(16.0), (16, 1))  # grows to the right: direction 0
    votes = hog(slope, 8).reshape(4, 9)
    assert (votes[:, 0] > 0.4).all()
    assert (votes[:, 1:] == 0).all()
    turned = hog(slope.T, 8).reshape(4, 9)  # grows downward: 90 degrees, the fifth of nine
    assert (turned[:, 4] > 0.4).all()
    np.testing.assert_allclose(hog(7.0 * slope, 8), hog(slope, 8), atol=1e-9)
    assert not hog(np.full((16, 16), 3.0), 8).any()
    with pytest.raises(ValueError, match=r"2 cells of 8 pixels each way, got 15 x 16"):
        hog(slope[:15], 8)


def test_signed_directions_go_round():
    slope = np.tile(np.arange(5.0), (5, 1))
    for image, number in ((slope, 0), (slope.T, 2), (-slope, 4), (-slope.T, 6)):
        votes = oriented_gradients(image, 8, signed=True)[:, 2, 2]
        assert votes.argmax() == number
        assert votes.sum() == pytest.approx(2.0)


def test_local_binary_patterns_are_their_slow_twin():
    codes = local_binary_patterns(PATCHES)
    for patch, of_patch in zip(PATCHES, codes, strict=True):
        for row in range(1, 24):
            for column in range(1, 24):
                expected = slow.local_binary_pattern(patch, row, column)
                assert of_patch[row - 1, column - 1] == expected
    assert set(np.unique(codes)) == set(range(LBP_CODES))


def test_local_binary_patterns_are_those_of_scikit_image():
    feature = pytest.importorskip(
        "skimage.feature", reason="scikit-image is a dependency of the tests alone"
    )
    for patch in PATCHES:
        whole_numbers = (1e6 * patch).astype(np.int64)  # of others it warns
        theirs = feature.local_binary_pattern(whole_numbers, 8, 1, method="uniform")
        ours = local_binary_patterns(whole_numbers.astype(float))
        np.testing.assert_array_equal(ours, theirs[1:-1, 1:-1])


def test_a_local_binary_pattern_neither_turns_nor_scales():
    codes = local_binary_patterns(PATCHES[0])
    np.testing.assert_array_equal(local_binary_patterns(3.0 * PATCHES[0] + 1), codes)
    np.testing.assert_array_equal(
        local_binary_patterns(np.rot90(PATCHES[0]).copy()), np.rot90(codes)
    )
    peak = np.zeros((3, 3))
    peak[1, 1] = 1.0
    assert local_binary_patterns(peak) == 0
    assert local_binary_patterns(-peak) == 8


def test_histograms_of_patterns_are_shares_of_each_part():
    histograms = lbp_histograms(PATCHES, 3).reshape(3, 9, LBP_CODES)
    np.testing.assert_allclose(histograms.sum(axis=-1), 1.0)
    codes = local_binary_patterns(PATCHES[1])
    for number, rows in enumerate((slice(0, 8), slice(8, 16), slice(16, 23))):
        counts = np.bincount(codes[rows, 16:].ravel(), minlength=LBP_CODES)
        np.testing.assert_allclose(histograms[1, 3 * number + 2], counts / counts.sum())


def test_windows_of_pixels_are_cut_row_after_row():
    patches = np.arange(2 * 2 * 6 * 7, dtype=float).reshape(2, 2, 6, 7)
    windows = pixel_windows(patches, 3, 2)
    assert windows.shape == (2, 2, 3, 18)
    np.testing.assert_array_equal(windows[1, 1, 2], patches[1, :, 2:5, 4:7].ravel())
    with pytest.raises(ValueError, match=r"window must have 1 to 6 pixels, got 7"):
        pixel_windows(patches, 7, 1)


def test_windows_of_gradients_are_their_slow_twin():
    patches = PATCHES[:2].reshape(1, 2, 25, 25)
    windows = gradient_windows(patches, 12, 4)
    assert windows.shape == (1, 4, 4, 256)
    for row in range(4):
        for column in range(4):
            for image in range(2):
                expected = slow.gradient_window(patches[0, image], 4 * row, 4 * column, 12)
                ours = windows[0, row, column, 128 * image : 128 * (image + 1)]
                np.testing.assert_allclose(ours, expected, atol=1e-12)
    with pytest.raises(ValueError, match="multiple of 4 pixels, got 10"):
        gradient_windows(patches, 10, 4)


def test_a_grid_is_split_into_parts_that_differ_by_one_place():
    grid = np.arange(5 * 4 * 1.0).reshape(5, 4, 1)
    parts = split_grid(grid, 2)
    assert [part.shape[0] for part in parts] == [6, 6, 4, 4]
    np.testing.assert_array_equal(parts[1][:, 0], grid[:3, 2:, 0].ravel())
    with pytest.raises(ValueError, match=r"3 places or more each way, got 5 x 2"):
        split_grid(grid[:, :2], 3)


def test_patches_are_scaled_by_their_borders():
    patch = RNG.normal(5.0, 2.0, (8, 8))
    patch[2:6, 2:6] = 100.0
    border = np.ones((8, 8), dtype=bool)
    border[2:6, 2:6] = False
    normal = normalize_by_border(patch, np.ones((8, 8), dtype=bool))
    assert normal[border].mean() == pytest.approx(0, abs=1e-12)
    assert normal[border].std() == pytest.approx(1)
    assert normal[3, 3] == pytest.approx((100 - patch[border].mean()) / patch[border].std())
    np.testing.assert_allclose(normalize_by_border(3 * patch, border | ~border), normal)


def test_pixels_that_were_not_seen_are_those_of_a_mean_border():
    patch = RNG.normal(5.0, 2.0, (8, 8))
    seen = np.ones((8, 8), dtype=bool)
    seen[:, :2] = False
    hidden = np.where(seen, patch, np.nan)
    normal = normalize_by_border(hidden, seen)
    assert (normal[~seen] == 0).all()
    rest = seen.copy()
    rest[2:6, 2:6] = False
    assert normal[rest].mean() == pytest.approx(0, abs=1e-12)
    assert not normalize_by_border(hidden, np.zeros((8, 8), dtype=bool)).any()
    flat = normalize_by_border(np.full((8, 8), 4.0), np.ones((8, 8), dtype=bool))
    assert not flat.any()
