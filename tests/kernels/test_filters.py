import numpy as np
import pytest

from flgpr.kernels.filters import mean_filter, median_filter
from flgpr.kernels.sampling import bilinear
from reference.wang2007 import filtered


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (23, 17), (40, 5)])
@pytest.mark.parametrize("size", [(1, 1), (5, 3), (21, 21)])
def test_filters_equal_their_plain_twins_to_the_border(shape, size):
    rng = np.random.default_rng(3)
    image = rng.normal(size=shape)
    image[rng.random(shape) < 0.3] = 0.5  # ties
    np.testing.assert_array_equal(median_filter(image, size), filtered(image, size, np.median))
    np.testing.assert_allclose(mean_filter(image, size), filtered(image, size, np.mean), atol=1e-12)


def test_bilinear_is_exact_on_a_plane_and_nan_outside():
    y, x = np.mgrid[0:6, 0:9]
    plane = np.stack([2.0 * y - 3.0 * x + 1, 0.5 * x])
    rng = np.random.default_rng(1)
    row, column = rng.uniform(0, 5, 50), rng.uniform(0, 8, 50)
    np.testing.assert_allclose(bilinear(plane, row, column)[0], 2 * row - 3 * column + 1, atol=1e-5)
    got = bilinear(plane, np.array([-0.01, 5.0, 0.0]), np.array([0.0, 8.0, 8.01]))
    assert np.isnan(got[0]).tolist() == [True, False, True]
