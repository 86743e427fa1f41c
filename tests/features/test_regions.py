"""Statistics of the regions of a patch against sums over the pixels themselves."""

import numpy as np

from flgpr.features import PatchShape
from flgpr.features.regions import patch_statistics, region_codes
from flgpr.kernels.patches import INNER, MEAN, OUTER, OUTER_MEAN, OUTER_STD, PEAK

SHAPE = PatchShape(7, 0.1, (3, 1), (5, 3))


def test_codes_name_inner_and_outer_region_and_leave_the_guard_out():
    codes = region_codes(SHAPE)
    assert (codes == INNER).sum() == 3
    assert (codes == OUTER).sum() == 49 - 15
    assert codes[3, 3] == INNER
    assert codes[3, 1] == 0
    assert codes[3, 0] == OUTER


def test_statistics_are_those_of_the_pixels():
    images = np.random.default_rng(2).random((2, 20, 30)).astype(np.float32)
    row = np.array([8.0, 4.0])
    column = np.array([12.0, 25.0])
    statistics = patch_statistics(SHAPE, images, row, column, spacing=0.1)
    assert statistics.shape == (2, 2, 4)
    codes = region_codes(SHAPE)
    for patch, (r, c) in enumerate([(8, 12), (4, 25)]):
        for channel, image in enumerate(images):
            pixels = image[r - 3 : r + 4, c - 3 : c + 4].astype(float)
            inner = pixels[codes == INNER]
            outer = pixels[codes == OUTER]
            expected = np.empty(4)
            expected[[PEAK, MEAN]] = inner.max(), inner.mean()
            expected[[OUTER_MEAN, OUTER_STD]] = outer.mean(), outer.std()
            np.testing.assert_allclose(statistics[patch, channel], expected, rtol=1e-5)


def test_a_patch_is_sampled_at_its_own_spacing():
    """A plane sampled at twice the image's spacing has twice the deviation."""
    plane = np.tile(np.arange(40, dtype=np.float32), (40, 1))[None]
    centre = np.array([20.0])
    fine = patch_statistics(SHAPE, plane, centre, centre, spacing=0.1)
    coarse = patch_statistics(SHAPE, plane, centre, centre, spacing=0.05)
    np.testing.assert_allclose(coarse[0, 0, OUTER_STD], 2 * fine[0, 0, OUTER_STD], rtol=1e-5)


def test_an_inner_region_beyond_the_image_is_unknown():
    images = np.ones((1, 20, 20), np.float32)
    statistics = patch_statistics(SHAPE, images, np.array([10.0]), np.array([0.0]), 0.1)
    assert np.isnan(statistics).all()
