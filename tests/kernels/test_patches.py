"""Statistics of several sets of regions at once against the pixels themselves."""

import numpy as np

from flgpr.kernels.patches import (
    INNER,
    MEAN,
    OUTER,
    OUTER_MEAN,
    OUTER_STD,
    PEAK,
    region_statistics,
)


def test_every_set_of_regions_has_the_statistics_of_its_pixels():
    images = np.random.default_rng(4).random((2, 15, 18)).astype(np.float32)
    regions = np.zeros((2, 5, 5), np.int8)
    regions[0, 2, 2] = INNER
    regions[0, 0] = OUTER
    regions[1, 1:4, 1:4] = INNER
    regions[1, :, 0] = OUTER
    out = np.empty((1, 2, 2, 4))
    offset = np.arange(-2.0, 3.0)
    region_statistics(images, np.array([7.0]), np.array([9.0]), offset, regions, out)
    for channel, number in np.ndindex(2, 2):
        patch = images[channel, 5:10, 7:12].astype(float)
        inner = patch[regions[number] == INNER]
        outer = patch[regions[number] == OUTER]
        statistics = out[0, channel, number]
        np.testing.assert_allclose(statistics[[PEAK, MEAN]], [inner.max(), inner.mean()], rtol=1e-5)
        np.testing.assert_allclose(
            statistics[[OUTER_MEAN, OUTER_STD]], [outer.mean(), outer.std()], rtol=1e-5
        )
