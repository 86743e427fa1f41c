import numpy as np
import pytest

from flgpr.kernels.filters import mean_filter, median_filter, median_stack
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


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (21, 21)])
@pytest.mark.parametrize("step", [1, 3])
def test_the_median_of_a_stack_is_exact_in_single_precision_too(size, step):
    rng = np.random.default_rng(4)
    stack = rng.normal(size=(3, 37, 29)).astype(np.float32)
    stack[1] = np.round(stack[1])  # ties, and zeros of both signs
    stack[2] *= 10.0 ** rng.integers(-20, 20, stack[2].shape)
    got = median_stack(stack, size, step)
    for one, image in zip(got, stack, strict=True):
        want = filtered(image.astype(np.float64), size, np.median)[::step, ::step]
        np.testing.assert_array_equal(one, want.astype(np.float32))


def test_a_plain_value_is_its_own_median():
    np.testing.assert_array_equal(median_stack(np.full((2, 9, 8), -0.5), (3, 5)), np.full((2, 9, 8), -0.5))
    assert median_stack(np.zeros((0, 9, 8)), (3, 5)).shape == (0, 9, 8)
